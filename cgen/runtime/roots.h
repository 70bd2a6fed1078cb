/* SPDX-License-Identifier: MIT-0 */
/*
 * roots.h -- all zeros of margins along a piece of a flow, and when a formula first fails.
 *
 * A margin is a polynomial on [0,1] in Bernstein form. The number of sign variations of
 * its coefficients bounds the number of its zeros (Descartes): none, no zero; one, exactly
 * one zero, which is bracketed between neighbouring doubles; more, the part is halved (de
 * Casteljau). Every coefficient carries a bound of the rounding that went into it, exact
 * sums add nothing to it, and one that is not larger than its bound counts as zero. Parts
 * that only have such coefficients, or that have no double inside, are one zero in the
 * middle of them, together with their neighbours of the same kind.
 *
 * What is certain, relative to the polynomial p that has exactly the given coefficients, with
 * top = max |b|, where `start` agrees with them:
 *   - wherever |p(s)| > 2^-40*top, the reported sign is that of p. So between two such places
 *     of different sign a crossing is never missed;
 *   - every zero of p is reported: there, or elsewhere on a stretch around it on which
 *     |p| <= 2^-40*top, together with the other zeros of that stretch. At a crossing |p| is at
 *     most that;
 *   - `after` of a crossing is the sign just before the next one of its margin. A touch keeps
 *     its sign; what comes so near to zero that rounding decides counts as a touch.
 * Coefficients below 2^-1000*top are lost. `start` is what is true just after 0: the first
 * coefficients that contradict it are taken for zero, up to 2^-20*top each. If that does not
 * help, there is a crossing at once, at DL2C_AT_ONCE. Where coefficients have noise, all this is true
 * of some polynomial as near as that to the given one.
 *
 * The same operations in the same order as dl2c/ir/roots.py and roots_float.py.
 */
#ifndef DL2C_ROOTS_H
#define DL2C_ROOTS_H

#include "curve.h"

/* One place where a margin is zero: its sign is 0 at `at` and `after` just after. */
typedef struct dl2c_crossing {
  real at; /* in (0,1] */
  int32_t margin;
  int8_t after;
} dl2c_crossing;

typedef struct dl2c_exit {
  bool found;
  bool holds; /* the formula still holds at `at`; it fails just after */
  real at;    /* in [0,1] */
} dl2c_exit;

/* Given by the model: whether a formula of a flow holds where its margins have these signs. */
static inline bool model_condition(int flow, int formula, const int8_t *sign);

/* Where a margin changes its sign that has the other sign from the start. */
#define DL2C_AT_ONCE 0x1p-1074
/* Coefficients that contradict `start` may be so large, relative to the largest. */
#define DL2C_START_NOISE 0x1p-20
/* Parts that wait: near 0 parts become no shorter than 2^-63, elsewhere doubles are the limit. */
enum { DL2C_SECTIONS = 64 };

/* A search from left to right. While `open`, the other side of the zero [from, to] is not known. */
typedef struct dl2c_hunt {
  int32_t margin;
  int sign; /* after the last zero that is reported */
  bool open;
  real from, to;
  dl2c_crossing *out;
  int room;
  int count; /* also of those for which there was no room */
} dl2c_hunt;

static inline void dl2c_report(dl2c_hunt *search, real at, int after)
{
  if (search->count < search->room)
    search->out[search->count] = (dl2c_crossing){at, search->margin, (int8_t)after};
  search->count++;
  search->sign = after;
}

/* The open zero, whose other side turned out to have a sign. */
static inline void dl2c_close(dl2c_hunt *search, int after)
{
  const real middle = search->from + 0.5 * (search->to - search->from);
  search->open = false;
  dl2c_report(search, middle > search->from ? middle : search->to, after);
}

/* What a part that is not halved any more says, the parts before it being known. */
static inline void dl2c_settle(dl2c_hunt *search, const dl2c_section *part, int degree,
                               int variations, int first)
{
  if (first == 0 || variations > 1) {
    if (!search->open) search->from = part->low;
    search->open = true;
    search->to = part->high;
    return;
  }
  if (search->open) dl2c_close(search, first);
  else if (first != search->sign) dl2c_report(search, DL2C_AT_ONCE, first);
  real at = 0.0;
  if (variations == 1) at = dl2c_refined(part, degree);
  if (at > 0.0 && at < part->high) dl2c_report(search, at, -first);
  search->open = at == part->high || fabs(part->b[degree]) <= part->e[degree];
  search->from = part->high;
  search->to = part->high;
}

/* The first part: the curve scaled by a power of two, without what contradicts the start. */
static inline void dl2c_prepare(const dl2c_curve *curve, int start, dl2c_section *part)
{
  real top = 0.0;
  int exponent;
  bool leading = true;
  for (int i = 0; i <= curve->degree; i++) top = dl2c_max(top, fabs(curve->b[i]));
  frexp(top, &exponent);
  const real noise = ldexp(curve->noise, -exponent);
  part->low = 0.0;
  part->high = 1.0;
  for (int i = 0; i <= curve->degree; i++) {
    const real b = ldexp(curve->b[i], -exponent);
    leading = leading && start * b <= 0.0 && fabs(b) <= DL2C_START_NOISE;
    part->b[i] = leading ? 0.0 : b;
    part->e[i] = noise;
  }
}

/* All zeros of a curve in (0,1] that has coefficients of both signs. */
static inline void dl2c_hunt_zeros(const dl2c_curve *curve, dl2c_hunt *search)
{
  dl2c_section parts[DL2C_SECTIONS];
  dl2c_prepare(curve, search->sign, &parts[0]);
  const int degree = curve->degree;
  int top = 0;
  while (top >= 0) {
    dl2c_section *part = &parts[top];
    int first;
    const int variations = dl2c_variations(part, degree, &first);
    const real middle = part->low + 0.5 * (part->high - part->low);
    const bool divisible = part->low < middle && middle < part->high && top + 1 < DL2C_SECTIONS;
    if (first != 0 && variations > 1 && divisible) {
      top++;
      dl2c_split(part, degree, middle, &parts[top]);
    } else {
      dl2c_settle(search, part, degree, variations, first);
      top--;
    }
  }
  if (!search->open) return;
  const real last = curve->b[degree];
  if (last == 0.0) dl2c_report(search, 1.0, dl2c_sign_after_end(curve));
  else dl2c_close(search, last > 0.0 ? 1 : -1);
}

/* Zeros of one curve; only a look at the coefficients where none contradicts the start. */
static inline void dl2c_curve_zeros(const dl2c_curve *curve, dl2c_hunt *search)
{
  const real sign = search->sign;
  bool opposite = false;
  for (int i = 0; i <= curve->degree; i++) opposite |= sign * curve->b[i] < -curve->noise;
  if (opposite) {
    dl2c_hunt_zeros(curve, search);
  } else if (sign != 0.0 && curve->b[curve->degree] == 0.0) {
    const int after = dl2c_sign_after_end(curve);
    if (after != 0) dl2c_report(search, 1.0, after);
  }
}

static inline bool dl2c_later(const dl2c_crossing *a, const dl2c_crossing *b)
{
  return a->at > b->at || (a->at == b->at && a->margin > b->margin);
}

/*
 * All zeros of all curves in (0,1], sorted by `at` (then margin). Signs just after 0 come in
 * `start`; 0 means that the margin stays zero. Returns how many, or -1 if they do not fit.
 *
 * curves, start: (n)   out: (room)
 */
static inline int dl2c_crossings(const dl2c_curve *curves, int n, const int8_t *start,
                                 dl2c_crossing *out, int room)
{
  dl2c_hunt search = {.out = out, .room = room};
  for (int32_t k = 0; k < n; k++) {
    search.margin = k;
    search.sign = start[k];
    search.open = false;
    dl2c_curve_zeros(&curves[k], &search);
  }
  if (search.count > room) return -1;
  for (int i = 1; i < search.count; i++) {
    const dl2c_crossing moving = out[i];
    int j = i;
    for (; j > 0 && dl2c_later(&out[j - 1], &moving); j--) out[j] = out[j - 1];
    out[j] = moving;
  }
  return search.count;
}

/*
 * When a formula that (normally) holds first fails. at0: signs at 0; start: signs just after 0.
 * On return sign_at and sign_after hold the signs at and just after the exit, at 1 if there is
 * none. What comes just after 1 is not looked at.
 *
 * at0, start, sign_at, sign_after: (n)   crossings: (count), sorted
 */
static inline dl2c_exit dl2c_first_exit(int flow, int formula, const dl2c_crossing *crossings,
                                        int count, int n, const int8_t *at0, const int8_t *start,
                                        int8_t *sign_at, int8_t *sign_after)
{
  memcpy(sign_at, at0, (size_t)n);
  memcpy(sign_after, start, (size_t)n);
  if (!model_condition(flow, formula, sign_at)) return (dl2c_exit){true, false, 0.0};
  if (!model_condition(flow, formula, sign_after)) return (dl2c_exit){true, true, 0.0};
  memcpy(sign_at, start, (size_t)n);
  for (int i = 0; i < count;) {
    const real at = crossings[i].at;
    memcpy(sign_at, sign_after, (size_t)n);
    for (; i < count && crossings[i].at == at; i++) {
      sign_at[crossings[i].margin] = 0;
      sign_after[crossings[i].margin] = crossings[i].after;
    }
    if (!model_condition(flow, formula, sign_at)) return (dl2c_exit){true, false, at};
    if (at == 1.0) return (dl2c_exit){false, true, 1.0};
    if (!model_condition(flow, formula, sign_after)) return (dl2c_exit){true, true, at};
  }
  memcpy(sign_at, sign_after, (size_t)n);
  return (dl2c_exit){false, true, 1.0};
}

#endif
