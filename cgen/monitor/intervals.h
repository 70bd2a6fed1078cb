/* SPDX-License-Identifier: MIT-0 */
/*
 * intervals.h -- interval arithmetic without switches of the rounding mode, for sound monitors.
 *
 * A monitor holds a copy of what it uses of this file, after `real` and the limits of its arithmetic
 * (IV_EPSILON, IV_SMALLEST, IV_LARGEST: those of <float.h>; IV_TINY; IV_SHORT, IV_SHORT_SCALE).
 * Every operation widens its result by more than the rounding error of one operation to nearest, and by
 * the smallest normal number, which covers results that are denormal or flushed to zero (after Rump,
 * Zimmermann, Boldo, Melquiond: "Computing predecessor and successor in rounding to nearest", 2009);
 * except where it shows that there was no rounding. Points come of such operations alone, so that a
 * contraction to fused operations does no harm. An interval with lo > hi says nothing: an operand is
 * undefined, or a number too large or a divisor too small.
 */
#ifndef DL2C_MONITOR_INTERVALS_H
#define DL2C_MONITOR_INTERVALS_H

typedef struct {
  real lo, hi;
} iv_pair;

static inline iv_pair iv_between(real lo, real hi)
{
  const iv_pair pair = {lo, hi};
  return pair;
}

static inline iv_pair iv_point(real a) { return iv_between(a, a); }

static inline iv_pair iv_unknown(void) { return iv_between(1, 0); }

static inline real iv_smaller(real a, real b) { return a < b ? a : b; }

static inline real iv_larger(real a, real b) { return a > b ? a : b; }

static inline bool is_known(iv_pair a) { return a.lo <= a.hi; }

static inline bool is_zero(iv_pair a) { return a.lo >= 0 && a.hi <= 0 && is_known(a); }

static inline bool are_points(iv_pair a, iv_pair b) { return a.lo >= a.hi && b.lo >= b.hi; }

/* Whether a has so few digits that its product with another such number is exact. */
static inline bool is_short(real a)
{
  const real scaled = a * IV_SHORT_SCALE;
  if (!(-IV_SHORT < scaled && scaled < IV_SHORT))
    return false;
  const real whole = (real)(long)scaled;
  return !(whole < scaled || whole > scaled);
}

/* A bound of the rounding error of one operation; nothing known where numbers are too large. */
static inline iv_pair iv_widened(real lo, real hi)
{
  const real down = lo - (iv_larger(lo, -lo) * IV_EPSILON + IV_SMALLEST);
  const real up = hi + (iv_larger(hi, -hi) * IV_EPSILON + IV_SMALLEST);
  return -IV_LARGEST <= down && up <= IV_LARGEST ? iv_between(down, up) : iv_unknown();
}

static inline iv_pair iv_negative(iv_pair a) { return iv_between(-a.hi, -a.lo); }

/* Whether a + b has no rounding error (Knuth's TwoSum), nor one too small to be seen. */
static inline bool is_exact_sum(real a, real b)
{
  const real sum = a + b, second = sum - a;
  const real error = (a - (sum - second)) + (b - second);
  const bool seen = iv_larger(a, -a) >= IV_TINY && iv_larger(b, -b) >= IV_TINY;
  return seen && error >= 0 && error <= 0;
}

static inline iv_pair iv_sum(iv_pair a, iv_pair b)
{
  if (!(is_known(a) && is_known(b)))
    return iv_unknown();
  if (is_zero(a) || is_zero(b))
    return is_zero(a) ? b : a;
  if (are_points(a, b) && is_exact_sum(a.lo, b.lo))
    return iv_point(a.lo + b.lo);
  return iv_widened(a.lo + b.lo, a.hi + b.hi);
}

static inline iv_pair iv_difference(iv_pair a, iv_pair b) { return iv_sum(a, iv_negative(b)); }

/* What encloses four numbers. */
static inline iv_pair iv_around(real p, real q, real r, real s)
{
  const real lo = iv_smaller(iv_smaller(p, q), iv_smaller(r, s));
  return iv_widened(lo, iv_larger(iv_larger(p, q), iv_larger(r, s)));
}

static inline iv_pair iv_product(iv_pair a, iv_pair b)
{
  if (!(is_known(a) && is_known(b)))
    return iv_unknown();
  if (is_zero(a) || is_zero(b))
    return iv_point(0);
  if (are_points(a, b) && is_short(a.lo) && is_short(b.lo))
    return iv_point(a.lo * b.lo);
  return iv_around(a.lo * b.lo, a.lo * b.hi, a.hi * b.lo, a.hi * b.hi);
}

static inline iv_pair iv_quotient(iv_pair a, iv_pair b)
{
  if (!(is_known(a) && (b.lo >= IV_TINY || b.hi <= -IV_TINY) && b.lo <= b.hi))
    return iv_unknown();
  if (is_zero(a))
    return a;
  const real p = a.lo / b.lo;
  const real back = p * b.lo;
  if (are_points(a, b) && is_short(p) && is_short(b.lo) && !(back < a.lo || back > a.lo))
    return iv_point(p);
  return iv_around(p, a.lo / b.hi, a.hi / b.lo, a.hi / b.hi);
}

/* What a function that grows makes of an interval, from what it makes of its ends. */
static inline iv_pair iv_rising(iv_pair low, iv_pair high)
{
  return is_known(low) && is_known(high) ? iv_between(low.lo, high.hi) : iv_unknown();
}

static inline iv_pair iv_magnitude(iv_pair a)
{
  if (!is_known(a))
    return a;
  return iv_between(iv_larger(0, iv_larger(a.lo, -a.hi)), iv_larger(a.hi, -a.lo));
}

static inline iv_pair iv_square(iv_pair a)
{
  const iv_pair size = iv_magnitude(a);
  const iv_pair found = iv_product(size, size);
  return is_known(found) ? iv_between(iv_larger(0, found.lo), found.hi) : found;
}

static inline iv_pair iv_root(iv_pair a)
{
  if (!(is_known(a) && a.lo >= 0))
    return iv_unknown();
  const real low = IV_SQRT(a.lo);
  const real back = low * low;
  if (are_points(a, a) && is_short(low) && !(back < a.lo || back > a.lo))
    return iv_point(low);
  const iv_pair found = iv_widened(low, IV_SQRT(a.hi));
  return iv_between(iv_larger(0, found.lo), found.hi);
}

static inline iv_pair iv_least(iv_pair a, iv_pair b)
{
  if (!(is_known(a) && is_known(b)))
    return iv_unknown();
  return iv_between(iv_smaller(a.lo, b.lo), iv_smaller(a.hi, b.hi));
}

static inline iv_pair iv_greatest(iv_pair a, iv_pair b)
{
  if (!(is_known(a) && is_known(b)))
    return iv_unknown();
  return iv_between(iv_larger(a.lo, b.lo), iv_larger(a.hi, b.hi));
}

/* Truth: false, not decided, true. */
enum { IV_FALSE, IV_UNKNOWN, IV_TRUE };

static inline int is_less(iv_pair a, iv_pair b)
{
  if (!(is_known(a) && is_known(b)))
    return IV_UNKNOWN;
  return a.hi < b.lo ? IV_TRUE : a.lo >= b.hi ? IV_FALSE : IV_UNKNOWN;
}

static inline int is_at_most(iv_pair a, iv_pair b)
{
  if (!(is_known(a) && is_known(b)))
    return IV_UNKNOWN;
  return a.hi <= b.lo ? IV_TRUE : a.lo > b.hi ? IV_FALSE : IV_UNKNOWN;
}

static inline int is_unequal(iv_pair a, iv_pair b)
{
  if (!(is_known(a) && is_known(b)))
    return IV_UNKNOWN;
  if (a.hi < b.lo || b.hi < a.lo)
    return IV_TRUE;
  return a.hi <= b.lo && b.hi <= a.lo ? IV_FALSE : IV_UNKNOWN;
}

static inline int is_equal(iv_pair a, iv_pair b) { return IV_TRUE - is_unequal(a, b); }

static inline int iv_both(int a, int b) { return a < b ? a : b; }

static inline int iv_either(int a, int b) { return a > b ? a : b; }

#endif
