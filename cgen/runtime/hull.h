/* SPDX-License-Identifier: MIT-0 */
/*
 * hull.h -- intervals that contain whatever doubles the same operations compute from doubles
 * inside.
 *
 * Rounding is monotone, so that the operations at the ends enclose those between them and no
 * rounding mode is needed. Ends are finite; where a value between them may be undefined or infinite
 * both are NaN, for which no condition holds. dl2c_hull_out turns an interval into an enclosure of
 * the real values. functions.h has the functions of libm. The same operations in the same order as
 * dl2c/flows/hull.py.
 */
#ifndef DL2C_HULL_H
#define DL2C_HULL_H

#include "numbers.h"

typedef struct dl2c_hull {
  real low, high;
} dl2c_hull;

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

/* Whether every value inside is: > 0, != 0, = 0. */
static inline bool dl2c_hull_positive(dl2c_hull a) { return a.low > 0.0; }
static inline bool dl2c_hull_nonzero(dl2c_hull a) { return (a.low > 0.0) | (a.high < 0.0); }
static inline bool dl2c_hull_zero(dl2c_hull a) { return (a.low == 0.0) & (a.high == 0.0); }

#endif
