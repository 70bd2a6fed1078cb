/* SPDX-License-Identifier: MIT-0 */
/*
 * functions.h -- enclosures of exp, log, sine and their kin, for sound monitors.
 *
 * Nothing is taken from libm but sqrt, frexp and ldexp, which are exact or rounded once. An argument is
 * reduced with constants in parts: the products of a part and a whole number are exact. What is left goes
 * into a series whose last factor is an interval around the remainder (Taylor's theorem in Lagrange's
 * form, or the tail of an alternating or geometric series), summed from there by intervals.h.
 */
#ifndef DL2C_MONITOR_FUNCTIONS_H
#define DL2C_MONITOR_FUNCTIONS_H

#include "intervals.h"

/* a - k * constant; the constant is parts[0] + parts[1] + a number between parts[2] and parts[3]. */
static inline iv_pair iv_reduced(real a, long k, const real *parts)
{
  const iv_pair first = iv_difference(iv_point(a), iv_point((real)k * parts[0]));
  const iv_pair second = iv_difference(first, iv_point((real)k * parts[1]));
  return iv_difference(second, iv_product(iv_point((real)k), iv_between(parts[2], parts[3])));
}

static inline long iv_nearest(real a)
{
  return (long)(a < 0 ? a - (real)0.5 : a + (real)0.5);
}

/* |a| <= IV_EXP_MOST: 2^k exp(r), |r| < 0.36, where exp of what is between 0 and r is in [0.5, 2]. */
static inline iv_pair iv_exp_at(real a)
{
  const long k = iv_nearest(a * (real)1.4426950408889634);
  const iv_pair r = iv_reduced(a, k, iv_log_2);
  iv_pair sum = iv_between((real)0.5, 2);
  for (int n = 14; n > 0; n--)
    sum = iv_sum(iv_point(1), iv_quotient(iv_product(r, sum), iv_point((real)n)));
  return iv_between(IV_LDEXP(sum.lo, (int)k), IV_LDEXP(sum.hi, (int)k));
}

static inline iv_pair iv_exp(iv_pair a)
{
  if (!(is_known(a) && a.hi <= IV_EXP_MOST))
    return iv_unknown();
  const iv_pair low = iv_exp_at(iv_larger(a.lo, -IV_EXP_MOST));
  const iv_pair high = iv_exp_at(iv_larger(a.hi, -IV_EXP_MOST));
  return iv_between(a.lo < -IV_EXP_MOST ? 0 : low.lo, high.hi);
}

/* 1 - s/3 + s^2/5 - ... for 0 <= s < 0.04; for `sign` 1, all signs are plus. */
static inline iv_pair iv_odd_series(iv_pair s, int sign)
{
  iv_pair sum = iv_between(0, 1);
  for (int n = 25; n > 0; n -= 2) {
    const iv_pair rest = iv_product(s, sum), one = iv_quotient(iv_point(1), iv_point((real)n));
    sum = sign > 0 ? iv_sum(one, rest) : iv_difference(one, rest);
  }
  return sum;
}

/* a > 0: k log 2 + 2 artanh((m - 1)/(m + 1)), 0.7 < m < 1.42. */
static inline iv_pair iv_log_at(real a)
{
  int k = 0;
  real m = IV_FREXP(a, &k);
  if (m < (real)0.70710678) {
    m *= 2;
    k--;
  }
  const iv_pair one = iv_point(1), part = iv_point(m);
  const iv_pair s = iv_quotient(iv_difference(part, one), iv_sum(part, one));
  const iv_pair half = iv_product(s, iv_odd_series(iv_square(s), 1));
  return iv_difference(iv_sum(half, half), iv_reduced(0, k, iv_log_2));
}

static inline iv_pair iv_log(iv_pair a)
{
  if (!(is_known(a) && a.lo > 0))
    return iv_unknown();
  return iv_rising(iv_log_at(a.lo), iv_log_at(a.hi));
}

/* A power of a base that is positive; of 0 too, where the exponent is positive. */
static inline iv_pair iv_power(iv_pair a, iv_pair b)
{
  if (!(is_known(a) && is_known(b) && a.lo >= 0 && (a.lo > 0 || b.lo > 0)))
    return iv_unknown();
  if (is_zero(a))
    return a;
  const iv_pair high = iv_exp(iv_product(b, iv_log(iv_point(a.hi))));
  const iv_pair low = a.lo > 0 ? iv_exp(iv_product(b, iv_log(iv_point(a.lo)))) : iv_point(0);
  if (!(is_known(low) && is_known(high)))
    return iv_unknown();
  return iv_between(iv_smaller(low.lo, high.lo), iv_larger(low.hi, high.hi));
}

/* So many quarters of a turn, and the rest. */
typedef struct {
  long quarters;
  iv_pair rest;
} iv_angle;

static inline iv_angle iv_angle_of(real a)
{
  const long quarters = iv_nearest(a * (real)0.6366197723675814);
  const iv_angle angle = {quarters, iv_reduced(a, quarters, iv_half_pi)};
  return angle;
}

/* |r| < 1: the sine for `first` 2, the cosine for 1. The remainder has a cosine in it, not below 0.5. */
static inline iv_pair iv_wave(iv_pair r, int first)
{
  const iv_pair square = iv_square(r);
  iv_pair sum = iv_between((real)0.5, 1);
  for (int n = first + 18; n > 0; n -= 2) {
    const iv_pair divisor = iv_point((real)(n * (n + 1)));
    sum = iv_difference(iv_point(1), iv_quotient(iv_product(square, sum), divisor));
  }
  return first == 2 ? iv_product(r, sum) : sum;
}

static inline long iv_quarter(long quarters) { return (quarters % 4 + 4) % 4; }

static inline iv_pair iv_sine_at(iv_angle a, long turned)
{
  const long quarter = iv_quarter(a.quarters + turned);
  const iv_pair value = iv_wave(a.rest, quarter % 2 == 0 ? 2 : 1);
  return quarter < 2 ? value : iv_negative(value);
}

/* The sine of a plus so many quarters of a turn: that of the ends, and the crests between them. */
static inline iv_pair iv_sine_turned(iv_pair a, long turned)
{
  if (!is_known(a))
    return a;
  if (!(-IV_ANGLE_MOST <= a.lo && a.hi <= IV_ANGLE_MOST))
    return iv_between(-1, 1);
  const iv_angle from = iv_angle_of(a.lo), to = iv_angle_of(a.hi);
  const iv_pair low = iv_sine_at(from, turned), high = iv_sine_at(to, turned);
  iv_pair found = iv_between(iv_smaller(low.lo, high.lo), iv_larger(low.hi, high.hi));
  const long first = from.quarters + (from.rest.lo > 0), last = to.quarters - (to.rest.hi < 0);
  for (long k = first; a.lo < a.hi && k <= last && k < first + 4; k++) {
    const long quarter = iv_quarter(k + turned);
    if (quarter == 1)
      found.hi = 1;
    if (quarter == 3)
      found.lo = -1;
  }
  return iv_between(iv_larger(found.lo, -1), iv_smaller(found.hi, 1));
}

static inline iv_pair iv_sine(iv_pair a) { return iv_sine_turned(a, 0); }

static inline iv_pair iv_cosine(iv_pair a) { return iv_sine_turned(a, 1); }

static inline iv_pair iv_tangent(iv_pair a) { return iv_quotient(iv_sine(a), iv_cosine(a)); }

/* 1 - 2 / (exp(2 a) + 1), odd; above 20 it is 1 to rounding. */
static inline iv_pair iv_tanh_at(real a)
{
  const real size = iv_larger(a, -a);
  iv_pair found = iv_between(1 - IV_EPSILON, 1);
  if (size < 20) {
    const iv_pair grown = iv_sum(iv_exp_at(2 * size), iv_point(1));
    const iv_pair value = iv_difference(iv_point(1), iv_quotient(iv_point(2), grown));
    found = iv_between(iv_larger(value.lo, 0), iv_smaller(value.hi, 1));
  }
  return a < 0 ? iv_negative(found) : found;
}

static inline iv_pair iv_tanh(iv_pair a)
{
  return is_known(a) ? iv_rising(iv_tanh_at(a.lo), iv_tanh_at(a.hi)) : a;
}

/* The tangent of a quarter of the angle, twice arctan(x) = 2 arctan(x / (1 + sqrt(1 + x^2))). */
static inline iv_pair iv_halved_twice(iv_pair x)
{
  const iv_pair one = iv_point(1);
  for (int k = 0; k < 2; k++)
    x = iv_quotient(x, iv_sum(one, iv_root(iv_sum(one, iv_square(x)))));
  return x;
}

static inline iv_pair iv_arctan_at(real a)
{
  const real size = iv_larger(a, -a);
  const iv_pair x = size > 1 ? iv_quotient(iv_point(1), iv_point(size)) : iv_point(size);
  const iv_pair t = iv_halved_twice(x);
  const iv_pair quarter = iv_product(t, iv_odd_series(iv_square(t), -1));
  const iv_pair angle = iv_product(iv_point(4), quarter);
  const iv_pair found = size > 1 ? iv_difference(iv_reduced(0, -1, iv_half_pi), angle) : angle;
  return a < 0 ? iv_negative(found) : found;
}

static inline iv_pair iv_arctan(iv_pair a)
{
  return is_known(a) ? iv_rising(iv_arctan_at(a.lo), iv_arctan_at(a.hi)) : a;
}

/* The tangent of the arcsine of x, for |x| < 0.8, is x / sqrt((1 - x) (1 + x)). */
static inline iv_pair iv_small_arcsin(iv_pair x)
{
  const iv_pair one = iv_point(1);
  const iv_pair square = iv_product(iv_difference(one, x), iv_sum(one, x));
  return iv_arctan(iv_quotient(x, iv_root(square)));
}

/* |a| <= 1; above 0.5, where the angle left to a quarter turn is twice the arcsine of sqrt((1 - a)/2). */
static inline iv_pair iv_arcsin_at(real a)
{
  const real size = iv_larger(a, -a);
  iv_pair found = iv_unknown();
  if (size > (real)0.5) {
    const iv_pair left = iv_quotient(iv_difference(iv_point(1), iv_point(size)), iv_point(2));
    const iv_pair half = iv_small_arcsin(iv_root(left));
    found = iv_difference(iv_reduced(0, -1, iv_half_pi), iv_sum(half, half));
  } else
    found = iv_small_arcsin(iv_point(size));
  return a < 0 ? iv_negative(found) : found;
}

static inline iv_pair iv_arcsin(iv_pair a)
{
  if (!(is_known(a) && -1 <= a.lo && a.hi <= 1))
    return iv_unknown();
  return iv_rising(iv_arcsin_at(a.lo), iv_arcsin_at(a.hi));
}

#endif
