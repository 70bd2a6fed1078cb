/* SPDX-License-Identifier: MIT-0 */
/*
 * span.h -- interval arithmetic rounded outwards, of real numbers, for proofs by boxes.
 *
 * The ends of + - * / and of square roots are the exact ends rounded once, outwards: the rounding error of
 * an operation is computed exactly (TwoSum, fma). Functions of libm are taken to be within four units in
 * the last place. An infinite end is not a limit; a finite value beyond the largest double has the largest
 * double as its lower end. `total` says that the term is defined on the whole box; a span whose low end is
 * above its high end holds no number. The same sets as dl2c/interval/arithmetic.py.
 */
#ifndef DL2C_SPAN_H
#define DL2C_SPAN_H

#include <float.h>
#include <math.h>
#include <stdbool.h>

typedef struct dl2c_span {
  double low, high;
  bool total;
} dl2c_span;

static inline dl2c_span dl2c_span_of(double low, double high, bool total)
{
  return (dl2c_span){low, high, total};
}

static inline dl2c_span dl2c_span_empty(void) { return dl2c_span_of(INFINITY, -INFINITY, false); }

static inline bool dl2c_is_empty(dl2c_span a) { return !(a.low <= a.high); }

static inline bool dl2c_has_zero(dl2c_span a) { return a.low <= 0.0 && 0.0 <= a.high; }

static inline double dl2c_lesser(double a, double b) { return a < b ? a : b; }
static inline double dl2c_greater(double a, double b) { return a > b ? a : b; }

static inline double dl2c_before(double a) { return nextafter(a, -INFINITY); }

/* Below this a product may lose bits that fma does not see. */
#define DL2C_SEEN 0x1p-960

static inline double dl2c_add_down(double a, double b)
{
  const double s = a + b;
  if (isinf(s)) return s < 0.0 ? s : DBL_MAX;
  const double t = s - a;
  const double error = (a - (s - t)) + (b - t);
  return error >= 0.0 ? s : dl2c_before(s);
}

static inline double dl2c_mul_down(double a, double b)
{
  if (a == 0.0 || b == 0.0) return 0.0;
  const double p = a * b;
  if (isinf(p)) return p < 0.0 || isinf(a) || isinf(b) ? p : DBL_MAX;
  if (fabs(p) < DL2C_SEEN) return dl2c_before(p);
  return fma(a, b, -p) >= 0.0 ? p : dl2c_before(p);
}

/* a / b for 0 <= b; b = 0 is the limit from above. */
static inline double dl2c_div_down(double a, double b)
{
  if (a == 0.0 || (isinf(b) && a > 0.0)) return 0.0;
  if (b == 0.0 || isinf(a)) return a > 0.0 ? DBL_MAX : -(double)INFINITY;
  const double q = a / b;
  if (isinf(q)) return q < 0.0 ? q : DBL_MAX;
  if (fabs(q) < DL2C_SEEN || fabs(a) < DL2C_SEEN) return dl2c_before(q);
  return fma(q, b, -a) <= 0.0 ? q : dl2c_before(q);
}

static inline double dl2c_root_down(double a)
{
  if (isinf(a)) return DBL_MAX;
  const double r = sqrt(a);
  if (a < DL2C_SEEN) return dl2c_greater(0.0, dl2c_before(r));
  return fma(r, r, -a) <= 0.0 ? r : dl2c_before(r);
}

static inline double dl2c_root_up(double a)
{
  if (isinf(a)) return INFINITY;
  const double r = sqrt(a);
  if (a < DL2C_SEEN) return a == 0.0 ? 0.0 : nextafter(r, INFINITY);
  return fma(r, r, -a) >= 0.0 ? r : nextafter(r, INFINITY);
}

static inline double dl2c_add_up(double a, double b) { return -dl2c_add_down(-a, -b); }
static inline double dl2c_mul_up(double a, double b) { return -dl2c_mul_down(-a, b); }
static inline double dl2c_div_up(double a, double b) { return -dl2c_div_down(-a, b); }

static inline dl2c_span dl2c_meet(dl2c_span a, dl2c_span b)
{
  return dl2c_span_of(dl2c_greater(a.low, b.low), dl2c_lesser(a.high, b.high), a.total && b.total);
}

static inline dl2c_span dl2c_hull_of_both(dl2c_span a, dl2c_span b)
{
  return dl2c_span_of(dl2c_lesser(a.low, b.low), dl2c_greater(a.high, b.high), a.total && b.total);
}

static inline dl2c_span dl2c_negative(dl2c_span a) { return dl2c_span_of(-a.high, -a.low, a.total); }

static inline dl2c_span dl2c_sum(dl2c_span a, dl2c_span b)
{
  if (dl2c_is_empty(a) || dl2c_is_empty(b)) return dl2c_span_empty();
  return dl2c_span_of(dl2c_add_down(a.low, b.low), dl2c_add_up(a.high, b.high), a.total && b.total);
}

static inline dl2c_span dl2c_difference(dl2c_span a, dl2c_span b)
{
  return dl2c_sum(a, dl2c_negative(b));
}

static inline dl2c_span dl2c_product(dl2c_span a, dl2c_span b)
{
  if (dl2c_is_empty(a) || dl2c_is_empty(b)) return dl2c_span_empty();
  const double low = dl2c_lesser(
      dl2c_lesser(dl2c_mul_down(a.low, b.low), dl2c_mul_down(a.low, b.high)),
      dl2c_lesser(dl2c_mul_down(a.high, b.low), dl2c_mul_down(a.high, b.high)));
  const double high = dl2c_greater(
      dl2c_greater(dl2c_mul_up(a.low, b.low), dl2c_mul_up(a.low, b.high)),
      dl2c_greater(dl2c_mul_up(a.high, b.low), dl2c_mul_up(a.high, b.high)));
  return dl2c_span_of(low, high, a.total && b.total);
}

/* a over what is positive, between `low` and `high`. */
static inline dl2c_span dl2c_over(dl2c_span a, double low, double high, bool total)
{
  return dl2c_span_of(dl2c_div_down(a.low, a.low >= 0.0 ? high : low),
                      dl2c_div_up(a.high, a.high >= 0.0 ? low : high), total);
}

/* What a / b can be for positive b (part 1) and for negative b (part -1); empty where there is none. */
static inline dl2c_span dl2c_quotient_part(dl2c_span a, dl2c_span b, int part)
{
  if (part < 0) {
    a = dl2c_negative(a);
    b = dl2c_negative(b);
  }
  if (dl2c_is_empty(a) || !(b.high > 0.0) || dl2c_is_empty(b)) return dl2c_span_empty();
  return dl2c_over(a, dl2c_greater(b.low, 0.0), b.high, true);
}

static inline dl2c_span dl2c_quotient(dl2c_span a, dl2c_span b)
{
  dl2c_span both = dl2c_hull_of_both(dl2c_quotient_part(a, b, 1), dl2c_quotient_part(a, b, -1));
  both.total = a.total && b.total && !dl2c_has_zero(b) && !dl2c_is_empty(both);
  return both;
}

static inline dl2c_span dl2c_magnitude(dl2c_span a)
{
  if (dl2c_is_empty(a)) return a;
  const double high = dl2c_greater(-a.low, a.high);
  return dl2c_span_of(dl2c_greater(0.0, dl2c_greater(a.low, -a.high)), high, a.total);
}

static inline double dl2c_power_down(double a, int n)
{
  double result = a;
  for (int k = 1; k < n; k++) result = dl2c_mul_down(result, a);
  return result;
}

static inline double dl2c_power_up(double a, int n)
{
  double result = a;
  for (int k = 1; k < n; k++) result = dl2c_mul_up(result, a);
  return result;
}

/* a to a positive whole power. */
static inline dl2c_span dl2c_power(dl2c_span a, int n)
{
  if (dl2c_is_empty(a)) return a;
  if (n % 2 == 0) {
    const dl2c_span size = dl2c_magnitude(a);
    return dl2c_span_of(dl2c_power_down(size.low, n), dl2c_power_up(size.high, n), a.total);
  }
  const double low = a.low >= 0.0 ? dl2c_power_down(a.low, n) : -dl2c_power_up(-a.low, n);
  const double high = a.high >= 0.0 ? dl2c_power_up(a.high, n) : -dl2c_power_down(-a.high, n);
  return dl2c_span_of(low, high, a.total);
}

static inline dl2c_span dl2c_root(dl2c_span a)
{
  if (dl2c_is_empty(a) || a.high < 0.0) return dl2c_span_empty();
  const double low = dl2c_root_down(dl2c_greater(a.low, 0.0));
  return dl2c_span_of(low, dl2c_root_up(a.high), a.total && a.low >= 0.0);
}

static inline dl2c_span dl2c_least(dl2c_span a, dl2c_span b)
{
  if (dl2c_is_empty(a) || dl2c_is_empty(b)) return dl2c_span_empty();
  return dl2c_span_of(dl2c_lesser(a.low, b.low), dl2c_lesser(a.high, b.high), a.total && b.total);
}

static inline dl2c_span dl2c_greatest(dl2c_span a, dl2c_span b)
{
  return dl2c_negative(dl2c_least(dl2c_negative(a), dl2c_negative(b)));
}

/* How far functions of libm may be off: four units in the last place, with one to spare. */
static inline double dl2c_library_error(double value) { return fabs(value) * 0x1p-49 + DBL_MIN; }

/* Cosine and sine change no faster than their argument: from the middle by half the width at most. */
static inline dl2c_span dl2c_wave(dl2c_span a, double (*function)(double))
{
  if (dl2c_is_empty(a)) return a;
  if (!(dl2c_greater(-a.low, a.high) < 1e6)) return dl2c_span_of(-1.0, 1.0, a.total);
  const double middle = a.low + 0.5 * (a.high - a.low);
  const double value = function(middle);
  const double reach = dl2c_greater(dl2c_add_up(middle, -a.low), dl2c_add_up(a.high, -middle));
  const double slack = dl2c_add_up(reach, 0x1p-48);
  return dl2c_span_of(dl2c_greater(-1.0, dl2c_add_down(value, -slack)),
                      dl2c_lesser(1.0, dl2c_add_up(value, slack)), a.total);
}

/* A function of libm that grows, with values between `least` and `most`. */
static inline dl2c_span dl2c_rising(dl2c_span a, double (*function)(double), double least, double most)
{
  if (dl2c_is_empty(a)) return a;
  const double low = function(a.low), high = function(a.high);
  const double down = isinf(low) ? (low > 0.0 ? DBL_MAX : low) : low - dl2c_library_error(low);
  const double up = isinf(high) ? high : high + dl2c_library_error(high);
  return dl2c_span_of(dl2c_greater(least, down), dl2c_lesser(most, up), a.total);
}

/* Truth: false, not decided, true. */
enum { DL2C_FALSE, DL2C_UNDECIDED, DL2C_TRUE };

static inline int dl2c_less(dl2c_span a, dl2c_span b)
{
  return a.high < b.low ? DL2C_TRUE : a.low >= b.high ? DL2C_FALSE : DL2C_UNDECIDED;
}

static inline int dl2c_at_most(dl2c_span a, dl2c_span b)
{
  return a.high <= b.low ? DL2C_TRUE : a.low > b.high ? DL2C_FALSE : DL2C_UNDECIDED;
}

static inline int dl2c_unequal(dl2c_span a, dl2c_span b)
{
  if (a.high < b.low || b.high < a.low) return DL2C_TRUE;
  return a.high <= b.low && b.high <= a.low ? DL2C_FALSE : DL2C_UNDECIDED;
}

#endif
