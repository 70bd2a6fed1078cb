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
 *   - wherever |p(s)| > 2^-42*top, the reported sign is that of p. So between two such places
 *     of different sign a crossing is never missed;
 *   - every zero of p is reported: at it, or merged with others along a stretch on which
 *     |p| <= 2^-42*top. At a crossing |p| is at most that;
 *   - `after` of a crossing is the sign just before the next one of its margin. A touch keeps
 *     its sign; what comes so near to zero that rounding decides counts as a touch.
 * Coefficients below 2^-1000*top are lost. `start` is what is true just after 0: the first
 * coefficients that contradict it are taken for zero, up to 2^-20*top each. If that does not
 * help, there is a crossing at once, at DL2C_AT_ONCE.
 *
 * The same operations in the same order as dl2c/ir/roots.py and roots_float.py.
 */
#ifndef DL2C_ROOTS_H
#define DL2C_ROOTS_H

#include "numbers.h"

enum { DL2C_MAX_DEGREE = 24 };

/* Bernstein coefficients on [0,1]; finite. */
typedef struct dl2c_curve {
  int32_t degree;
  real b[DL2C_MAX_DEGREE + 1];
} dl2c_curve;

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
static inline bool model_holds(int flow, int formula, const int8_t *sign);

/* Where a margin changes its sign that has the other sign from the start. */
#define DL2C_AT_ONCE 0x1p-1074
/* Coefficients that contradict `start` may be so large, relative to the largest. */
#define DL2C_START_NOISE 0x1p-20
/* Parts that wait: near 0 parts become no shorter than 2^-63, elsewhere doubles are the limit. */
enum { DL2C_PARTS = 64 };
/* Steps towards a zero before it is looked for nearby. */
enum { DL2C_APPROACH = 24 };

/* Coefficients on [low, high], each with a bound of its error. */
typedef struct dl2c_part {
  real low, high;
  real b[DL2C_MAX_DEGREE + 1];
  real e[DL2C_MAX_DEGREE + 1];
} dl2c_part;

/* A search from left to right. While `open`, [from, to] is one zero whose other side is not yet known. */
typedef struct dl2c_search {
  int32_t margin;
  int sign; /* after the last zero that is reported */
  bool open;
  real from, to;
  dl2c_crossing *out;
  int room;
  int count; /* also of those for which there was no room */
} dl2c_search;

/* Monomial c0 + c1*t + ... on [0, length] into Bernstein form on [0,1].   c: (degree + 1) */
static inline void dl2c_curve_of(const real *c, int degree, real length, dl2c_curve *curve)
{
  real *b = curve->b;
  real power = 1.0;
  real choose = 1.0;
  curve->degree = degree;
  for (int k = 0; k <= degree; k++) {
    b[k] = c[k] * power / choose;
    power *= length;
    choose = choose * (real)(degree - k) / (real)(k + 1);
  }
  for (int k = degree; k >= 1; k--)
    for (int i = k; i <= degree; i++) b[i] += b[i - 1];
}

/* The value at s in [0,1]. */
static inline real dl2c_curve_at(const dl2c_curve *curve, real s)
{
  real b[DL2C_MAX_DEGREE + 1];
  for (int i = 0; i <= curve->degree; i++) b[i] = curve->b[i];
  for (int k = curve->degree; k >= 1; k--)
    for (int i = 0; i < k; i++) b[i] = b[i] * (1.0 - s) + b[i + 1] * s;
  return b[0];
}

/* The sign just after 0: that of the first coefficient that is not zero; 0 if all are. */
static inline int8_t dl2c_sign_after(const dl2c_curve *curve)
{
  for (int i = 0; i <= curve->degree; i++)
    if (curve->b[i] != 0.0) return curve->b[i] > 0.0 ? 1 : -1;
  return 0;
}

/* The sign just after a zero at exactly 1: that before it, turned once for every zero coefficient. */
static inline int dl2c_sign_after_end(const dl2c_curve *curve)
{
  int turn = 1;
  for (int i = curve->degree; i >= 0; i--) {
    if (curve->b[i] != 0.0) return curve->b[i] > 0.0 ? turn : -turn;
    turn = -turn;
  }
  return 0;
}

static inline void dl2c_report(dl2c_search *search, real at, int after)
{
  if (search->count < search->room)
    search->out[search->count] = (dl2c_crossing){at, search->margin, (int8_t)after};
  search->count++;
  search->sign = after;
}

/* The open zero, whose other side turned out to have a sign. */
static inline void dl2c_close(dl2c_search *search, int after)
{
  const real middle = search->from + 0.5 * (search->to - search->from);
  search->open = false;
  dl2c_report(search, middle > search->from ? middle : search->to, after);
}

/* What is left of a part that has one zero inside: the curve without its zeros at the ends. */
typedef struct dl2c_weights {
  real low, width;
  int degree;
  real w[DL2C_MAX_DEGREE + 1]; /* coefficients times binomials; the first and the last are not 0 */
} dl2c_weights;

static inline void dl2c_weigh(const dl2c_part *part, int degree, dl2c_weights *weights)
{
  int skipped = 0;
  real choose = 1.0;
  weights->low = part->low;
  weights->width = part->high - part->low;
  weights->degree = 0;
  for (int i = 0; i <= degree; i++) {
    const bool certain = fabs(part->b[i]) > part->e[i];
    weights->w[i - skipped] = part->b[i] * choose;
    choose = choose * (real)(degree - i) / (real)(i + 1);
    if (certain) weights->degree = i - skipped;
    else if (i == skipped) skipped++;
  }
}

/* At s in the part, a continuous function with the signs of the curve there. */
static inline real dl2c_weighted_at(const dl2c_weights *weights, real s)
{
  const real *w = weights->w;
  const int degree = weights->degree;
  const real t = (s - weights->low) / weights->width;
  if (t <= 0.5) {
    const real ratio = t / (1.0 - t);
    real value = w[degree];
    for (int i = degree - 1; i >= 0; i--) value = value * ratio + w[i];
    return value;
  }
  const real ratio = (1.0 - t) / t;
  real value = w[0];
  for (int i = 1; i <= degree; i++) value = value * ratio + w[i];
  return value;
}

/* Ordinals of doubles: the curve has its first sign at `near` and the other one at `far`. */
typedef struct dl2c_bracket {
  const dl2c_weights *weights;
  int64_t near, far;
} dl2c_bracket;

/* The value at a place inside the bracket, which becomes its end on that side; both ends for a zero. */
static inline real dl2c_probe(dl2c_bracket *bracket, real s)
{
  const real value = dl2c_weighted_at(bracket->weights, s);
  const bool before = (value > 0.0) == (bracket->weights->w[0] > 0.0);
  const int64_t number = dl2c_ordinal(s);
  if (value == 0.0 || before) bracket->near = number;
  if (value == 0.0 || !before) bracket->far = number;
  return value;
}

/* Secant steps as long as they halve the value, else the midpoint. Returns the last place. */
static inline real dl2c_approach(dl2c_bracket *bracket)
{
  real last = dl2c_from_ordinal(bracket->near);
  real here = dl2c_from_ordinal(bracket->far);
  real last_value = dl2c_weighted_at(bracket->weights, last);
  real value = dl2c_weighted_at(bracket->weights, here);
  bool secant = true;
  for (int k = 0; k < DL2C_APPROACH && bracket->far - bracket->near > 1; k++) {
    const real near = dl2c_from_ordinal(bracket->near);
    const real far = dl2c_from_ordinal(bracket->far);
    real next = near + 0.5 * (far - near);
    if (secant && value != last_value) {
      const real step = value * ((here - last) / (value - last_value));
      if (fabs(step) <= 0x1p-52 * here) break;
      if (here - step > near && here - step < far) next = here - step;
    }
    if (!(next > near && next < far)) break;
    last = here;
    last_value = value;
    here = next;
    value = dl2c_probe(bracket, here);
    secant = fabs(value) <= 0.5 * fabs(last_value);
  }
  return here;
}

/*
 * The only zero inside the part: the last double before it, or the next one where that is the
 * part's low end; an exact zero where met. Steps of 1, 2, 4, ... units in the last place lead from
 * near the zero to its other side.
 */
static inline real dl2c_refined(const dl2c_part *part, int degree)
{
  dl2c_weights weights;
  dl2c_weigh(part, degree, &weights);
  dl2c_bracket at = {&weights, dl2c_ordinal(part->low), dl2c_ordinal(part->high)};
  const int64_t start = dl2c_ordinal(dl2c_approach(&at));
  const bool upward = start == at.near;
  for (int64_t step = 1; step < at.far - at.near; step *= 2) {
    const int64_t number = upward ? at.near + step : at.far - step;
    dl2c_probe(&at, dl2c_from_ordinal(number));
    if (upward != (at.near == number)) break;
  }
  while (at.far - at.near > 1)
    dl2c_probe(&at, dl2c_from_ordinal(at.near + (at.far - at.near) / 2));
  return dl2c_from_ordinal(at.near > dl2c_ordinal(part->low) ? at.near : at.far);
}

/*
 * How many zeros are inside the part at most, 2 for more than one, and the first sign there, 0 for
 * none. Coefficients within their error are zero at the ends of the row; between others they may
 * have any sign.
 */
static inline int dl2c_variations(const dl2c_part *part, int degree, int *first)
{
  int variations = 0;
  int vague = 0;
  int last = 0;
  *first = 0;
  for (int i = 0; i <= degree; i++) {
    const int sign = (part->b[i] > part->e[i]) - (part->b[i] < -part->e[i]);
    if (sign == 0) {
      vague += part->e[i] > 0.0;
      continue;
    }
    if (last == 0) *first = sign;
    else variations += (sign != last) + 2 * (vague > (sign != last));
    last = sign;
    vague = 0;
  }
  return variations < 2 ? variations : 2;
}

/* Halve the part: itself the right half, *left the left one. */
static inline void dl2c_split(dl2c_part *part, int degree, real middle, dl2c_part *left)
{
  real *b = part->b;
  real *e = part->e;
  left->low = part->low;
  left->high = middle;
  part->low = middle;
  for (int k = degree; k >= 0; k--) {
    left->b[degree - k] = b[0];
    left->e[degree - k] = e[0];
    for (int i = 0; i < k; i++) {
      const real sum = b[i] + b[i + 1];
      const real second = sum - b[i];
      const real lost = (b[i] - (sum - second)) + (b[i + 1] - second);
      e[i] = (e[i] + e[i + 1] + fabs(lost)) * (0.5 + 0x1p-51);
      b[i] = 0.5 * sum;
    }
  }
}

/* What a part that is not halved any more says, the parts before it being known. */
static inline void dl2c_settle(dl2c_search *search, const dl2c_part *part, int degree,
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
static inline void dl2c_prepare(const dl2c_curve *curve, int start, dl2c_part *part)
{
  real top = 0.0;
  int exponent;
  bool leading = true;
  for (int i = 0; i <= curve->degree; i++) top = dl2c_max(top, fabs(curve->b[i]));
  frexp(top, &exponent);
  part->low = 0.0;
  part->high = 1.0;
  for (int i = 0; i <= curve->degree; i++) {
    const real b = ldexp(curve->b[i], -exponent);
    leading = leading && start * b <= 0.0 && fabs(b) <= DL2C_START_NOISE;
    part->b[i] = leading ? 0.0 : b;
    part->e[i] = 0.0;
  }
}

/* All zeros of a curve in (0,1] that has coefficients of both signs. */
static inline void dl2c_search_zeros(const dl2c_curve *curve, dl2c_search *search)
{
  dl2c_part parts[DL2C_PARTS];
  dl2c_prepare(curve, search->sign, &parts[0]);
  const int degree = curve->degree;
  int top = 0;
  while (top >= 0) {
    dl2c_part *part = &parts[top];
    int first;
    const int variations = dl2c_variations(part, degree, &first);
    const real middle = part->low + 0.5 * (part->high - part->low);
    const bool divisible = part->low < middle && middle < part->high && top + 1 < DL2C_PARTS;
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

/* Zeros of one curve; only a look at the coefficients where all of them have the sign of the start. */
static inline void dl2c_curve_zeros(const dl2c_curve *curve, dl2c_search *search)
{
  const real sign = search->sign;
  bool opposite = false;
  for (int i = 0; i <= curve->degree; i++) opposite |= sign * curve->b[i] < 0.0;
  if (opposite) {
    dl2c_search_zeros(curve, search);
  } else if (sign != 0.0 && curve->b[curve->degree] == 0.0) {
    const int after = dl2c_sign_after_end(curve);
    if (after != 0) dl2c_report(search, 1.0, after);
  }
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
  dl2c_search search;
  search.out = out;
  search.room = room;
  search.count = 0;
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
    for (; j > 0 && (out[j - 1].at > moving.at
                     || (out[j - 1].at == moving.at && out[j - 1].margin > moving.margin));
         j--)
      out[j] = out[j - 1];
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
  if (!model_holds(flow, formula, sign_at)) return (dl2c_exit){true, false, 0.0};
  if (!model_holds(flow, formula, sign_after)) return (dl2c_exit){true, true, 0.0};
  memcpy(sign_at, start, (size_t)n);
  for (int i = 0; i < count;) {
    const real at = crossings[i].at;
    memcpy(sign_at, sign_after, (size_t)n);
    for (; i < count && crossings[i].at == at; i++) {
      sign_at[crossings[i].margin] = 0;
      sign_after[crossings[i].margin] = crossings[i].after;
    }
    if (!model_holds(flow, formula, sign_at)) return (dl2c_exit){true, false, at};
    if (at == 1.0) return (dl2c_exit){false, true, 1.0};
    if (!model_holds(flow, formula, sign_after)) return (dl2c_exit){true, true, at};
  }
  memcpy(sign_at, sign_after, (size_t)n);
  return (dl2c_exit){false, true, 1.0};
}

#endif
