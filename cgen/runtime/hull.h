/* SPDX-License-Identifier: MIT-0 */
/*
 * hull.h -- intervals that contain whatever doubles the same operations compute from doubles
 * inside.
 *
 * Rounding is monotone, so that the operations at the ends enclose those between them and no
 * rounding mode is needed. Functions of libm, which may be off by one unit, are widened. Ends are
 * finite; where a value between them may be undefined or infinite both are NaN, for which no
 * condition holds. dl2c_hull_out turns an interval into an enclosure of the real values. The same
 * operations in the same order as dl2c/flows/hull.py.
 */
#ifndef DL2C_HULL_H
#define DL2C_HULL_H

#include "numbers.h"

typedef struct dl2c_hull {
  real low, high;
} dl2c_hull;

/* How far functions of libm may be off, relative to the result, or to 1 for sin and cos. */
#define DL2C_LIBM_ERROR 0x1p-50

static inline dl2c_hull dl2c_hull_unknown(void) { return (dl2c_hull){(real)NAN, (real)NAN}; }

/* These ends where they are known, without a branch. */
static inline dl2c_hull dl2c_hull_where(bool known, real low, real high)
{
  return (dl2c_hull){dl2c_select(known, low, (real)NAN), dl2c_select(known, high, (real)NAN)};
}

/* Between two values, if they are finite. */
static inline dl2c_hull dl2c_hull_of(real low, real high)
{
  return dl2c_hull_where(isfinite(high - low), low, high);
}

/* Smaller numbers count as zero. */
#define DL2C_TINY 0x1p-1000

/* Ends that were rounded once, moved outwards by more than that. */
static inline dl2c_hull dl2c_hull_out(dl2c_hull a)
{
  return (dl2c_hull){a.low - (fabs(a.low) * 0x1p-52 + DL2C_TINY),
                     a.high + (fabs(a.high) * 0x1p-52 + DL2C_TINY)};
}

static inline dl2c_hull dl2c_hull_at(real a) { return dl2c_hull_of(a, a); }

static inline dl2c_hull dl2c_hull_neg(dl2c_hull a) { return (dl2c_hull){-a.high, -a.low}; }
static inline dl2c_hull dl2c_hull_add(dl2c_hull a, dl2c_hull b)
{
  return dl2c_hull_of(a.low + b.low, a.high + b.high);
}
static inline dl2c_hull dl2c_hull_sub(dl2c_hull a, dl2c_hull b)
{
  return dl2c_hull_of(a.low - b.high, a.high - b.low);
}

/* Between the least and the largest of four values. */
static inline dl2c_hull dl2c_hull_four(real a, real b, real c, real d)
{
  const dl2c_hull all = dl2c_hull_of(dl2c_min(dl2c_min(a, b), dl2c_min(c, d)),
                                     dl2c_max(dl2c_max(a, b), dl2c_max(c, d)));
  return dl2c_hull_where(isfinite(a + b + c + d), all.low, all.high);
}

static inline dl2c_hull dl2c_hull_mul(dl2c_hull a, dl2c_hull b)
{
  return dl2c_hull_four(a.low * b.low, a.low * b.high, a.high * b.low, a.high * b.high);
}
static inline dl2c_hull dl2c_hull_div(dl2c_hull a, dl2c_hull b)
{
  const dl2c_hull all =
      dl2c_hull_four(a.low / b.low, a.low / b.high, a.high / b.low, a.high / b.high);
  return dl2c_hull_where((b.low > 0.0) | (b.high < 0.0), all.low, all.high);
}
static inline dl2c_hull dl2c_hull_abs(dl2c_hull a)
{
  const real low = dl2c_select(a.low > 0.0, a.low, dl2c_select(a.high < 0.0, -a.high, 0.0));
  return dl2c_hull_of(low, dl2c_max(-a.low, a.high));
}
static inline dl2c_hull dl2c_hull_square(dl2c_hull a)
{
  const dl2c_hull size = dl2c_hull_abs(a);
  return dl2c_hull_of(size.low * size.low, size.high * size.high);
}
static inline dl2c_hull dl2c_hull_min(dl2c_hull a, dl2c_hull b)
{
  return dl2c_hull_where(isfinite(a.low + b.low), dl2c_min(a.low, b.low), dl2c_min(a.high, b.high));
}
static inline dl2c_hull dl2c_hull_max(dl2c_hull a, dl2c_hull b)
{
  return dl2c_hull_where(isfinite(a.low + b.low), dl2c_max(a.low, b.low), dl2c_max(a.high, b.high));
}
static inline dl2c_hull dl2c_hull_sqrt(dl2c_hull a)
{
  return dl2c_hull_of(sqrt(a.low), sqrt(a.high));
}

/* A monotone function of libm, evaluated at the ends. */
static inline dl2c_hull dl2c_hull_grown(real low, real high)
{
  return dl2c_hull_of(low - (fabs(low) * DL2C_LIBM_ERROR + DBL_MIN),
                      high + (fabs(high) * DL2C_LIBM_ERROR + DBL_MIN));
}

static inline dl2c_hull dl2c_hull_exp(dl2c_hull a)
{
  return dl2c_hull_grown(exp(a.low), exp(a.high));
}
static inline dl2c_hull dl2c_hull_tanh(dl2c_hull a)
{
  return dl2c_hull_grown(tanh(a.low), tanh(a.high));
}
static inline dl2c_hull dl2c_hull_arctan(dl2c_hull a)
{
  return dl2c_hull_grown(atan(a.low), atan(a.high));
}
static inline dl2c_hull dl2c_hull_arcsin(dl2c_hull a)
{
  return dl2c_hull_grown(asin(a.low), asin(a.high));
}
static inline dl2c_hull dl2c_hull_tan(dl2c_hull a)
{
  if (!(a.low > -1.57 && a.high < 1.57)) return dl2c_hull_unknown();
  return dl2c_hull_grown(tan(a.low), tan(a.high));
}

/* A power of a positive base is monotone in the base and in the exponent. */
static inline dl2c_hull dl2c_hull_pow(dl2c_hull a, dl2c_hull b)
{
  if (!(a.low > 0.0) || !isfinite(b.low)) return dl2c_hull_unknown();
  const dl2c_hull all =
      dl2c_hull_four(pow(a.low, b.low), pow(a.low, b.high), pow(a.high, b.low), pow(a.high, b.high));
  return dl2c_hull_grown(all.low, all.high);
}

/* Sine and cosine change no faster than their argument: from the middle by half the width at most. */
static inline real dl2c_hull_middle(dl2c_hull a) { return a.low + 0.5 * (a.high - a.low); }
static inline dl2c_hull dl2c_hull_wave(dl2c_hull a, real value)
{
  const real middle = dl2c_hull_middle(a);
  const real reach = dl2c_max(middle - a.low, a.high - middle) + DL2C_LIBM_ERROR;
  if (reach >= 2.0) return (dl2c_hull){-1.0, 1.0};
  return dl2c_hull_of(dl2c_max(-1.0, value - reach), dl2c_min(1.0, value + reach));
}
static inline dl2c_hull dl2c_hull_sin(dl2c_hull a)
{
  return dl2c_hull_wave(a, sin(dl2c_hull_middle(a)));
}
static inline dl2c_hull dl2c_hull_cos(dl2c_hull a)
{
  return dl2c_hull_wave(a, cos(dl2c_hull_middle(a)));
}

/* Whether every value inside is: > 0, != 0, = 0. */
static inline bool dl2c_hull_positive(dl2c_hull a) { return a.low > 0.0; }
static inline bool dl2c_hull_nonzero(dl2c_hull a) { return (a.low > 0.0) | (a.high < 0.0); }
static inline bool dl2c_hull_zero(dl2c_hull a) { return (a.low == 0.0) & (a.high == 0.0); }

#endif
