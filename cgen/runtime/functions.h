/* SPDX-License-Identifier: MIT-0 */
/*
 * functions.h -- quotients, roots and functions of libm: of Taylor models, and those of libm of hulls.
 *
 * Functions of libm may be off by one unit, and are widened. The same operations in the same order as
 * dl2c/flows/hull.py, dl2c/flows/taylor.py and the rows of dl2c/ir/functions.py.
 */
#ifndef DL2C_FUNCTIONS_H
#define DL2C_FUNCTIONS_H

#include "taylor.h"

/* How far functions of libm may be off, relative to the result, or to 1 for sin and cos. */
#define DL2C_LIBM_ERROR 0x1p-50

/* A monotone function of libm, evaluated at the ends. */
static inline dl2c_hull dl2c_hull_grown(real low, real high)
{
  return dl2c_hull_of(low - (fabs(low) * DL2C_LIBM_ERROR + DBL_MIN),
                      high + (fabs(high) * DL2C_LIBM_ERROR + DBL_MIN));
}

/* 1/a. Unknown unless a keeps away from zero. */
static inline dl2c_taylor dl2c_taylor_inverse(const dl2c_taylor *a)
{
  const dl2c_hull hull = dl2c_hull_div(dl2c_hull_at(1.0), a->hull);
  const int32_t lacks = dl2c_taylor_lacks(a, true);
  const real middle = a->c[0];
  if (!(fabs(middle) > DL2C_TINY)) return dl2c_taylor_unknown(lacks, hull);
  const real q = dl2c_taylor_deviation(a) / fabs(middle);
  if (!(q < 0.999)) return dl2c_taylor_unknown(lacks, hull);
  real f[DL2C_ORDER + 1];
  f[0] = 1.0 / middle;
  for (int k = 1; k <= DL2C_ORDER; k++) f[k] = -f[k - 1] / middle;
  return dl2c_taylor_compose(a, f, fabs(f[0]) * dl2c_geometric_rest(q), 0.0, hull);
}

static inline dl2c_taylor dl2c_taylor_div(const dl2c_taylor *a, const dl2c_taylor *b)
{
  const dl2c_taylor inverse = dl2c_taylor_inverse(b);
  dl2c_taylor t = dl2c_taylor_product(a, &inverse);
  if (!isfinite(t.r)) t.r = t.e = (real)INFINITY;
  t.hull = dl2c_hull_out(dl2c_hull_div(a->hull, b->hull));
  return t;
}

static inline dl2c_taylor dl2c_taylor_sqrt(const dl2c_taylor *a)
{
  const dl2c_hull hull = dl2c_hull_sqrt(a->hull);
  const int32_t lacks = dl2c_taylor_lacks(a, !(a->hull.high < 0.0));
  const real middle = a->c[0];
  if (!(middle > DL2C_TINY)) return dl2c_taylor_unknown(lacks, hull);
  const real q = dl2c_taylor_deviation(a) / middle;
  if (!(q < 0.999)) return dl2c_taylor_unknown(lacks, hull);
  const real root = sqrt(middle);
  real f[DL2C_ORDER + 1];
  f[0] = root;
  f[1] = root / (2.0 * middle);
  f[2] = -f[1] / (4.0 * middle);
  f[3] = -f[2] / (2.0 * middle);
  f[4] = -f[3] * 5.0 / (8.0 * middle);
  return dl2c_taylor_compose(a, f, 0.03125 * root * dl2c_geometric_rest(q), 0.0, hull);
}

static inline dl2c_taylor dl2c_taylor_abs(const dl2c_taylor *a)
{
  if (a->hull.low >= 0.0) return *a;
  if (a->hull.high <= 0.0) return dl2c_taylor_neg(a);
  return dl2c_taylor_unknown(a->lacks, dl2c_hull_abs(a->hull));
}

static inline dl2c_taylor dl2c_taylor_min(const dl2c_taylor *a, const dl2c_taylor *b)
{
  if (a->hull.high < b->hull.low) return *a;
  if (b->hull.high < a->hull.low) return *b;
  return dl2c_taylor_unknown(a->lacks | b->lacks, dl2c_hull_min(a->hull, b->hull));
}

static inline dl2c_taylor dl2c_taylor_max(const dl2c_taylor *a, const dl2c_taylor *b)
{
  if (a->hull.low > b->hull.high) return *a;
  if (b->hull.low > a->hull.high) return *b;
  return dl2c_taylor_unknown(a->lacks | b->lacks, dl2c_hull_max(a->hull, b->hull));
}

static inline dl2c_hull dl2c_hull_exp(dl2c_hull a)
{
  return dl2c_hull_grown(exp(a.low), exp(a.high));
}
static inline dl2c_taylor dl2c_taylor_exp(const dl2c_taylor *a)
{
  const dl2c_hull hull = dl2c_hull_exp(a->hull);
  const int32_t lacks = dl2c_taylor_lacks(a, true);
  const real d = dl2c_taylor_deviation(a);
  if (!(d < 1.0 && fabs(a->c[0]) < 700.0)) return dl2c_taylor_unknown(lacks, hull);
  const real value = exp(a->c[0]);
  const real f[] = {value, value, value / 2.0, value / 6.0, value / 24.0};
  return dl2c_taylor_compose(a, f, value * 0.023 * (d * d * d * d * d), 0.0, hull);
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

/* Sine and cosine from their values in the middle. */
static inline dl2c_taylor dl2c_taylor_wave(const dl2c_taylor *a, real value, real slope,
                                           dl2c_hull hull)
{
  const int32_t lacks = dl2c_taylor_lacks(a, true);
  const real d = dl2c_taylor_deviation(a);
  if (!(d < 4.0)) return dl2c_taylor_unknown(lacks, hull);
  const real f[] = {value, slope, -value / 2.0, -slope / 6.0, value / 24.0};
  const real noise = 8.0 * DL2C_SLOP * (1.0 + d * (1.0 + d));
  return dl2c_taylor_compose(a, f, d * d * d * d * d / 120.0, noise, hull);
}
static inline dl2c_taylor dl2c_taylor_sin(const dl2c_taylor *a)
{
  return dl2c_taylor_wave(a, sin(a->c[0]), cos(a->c[0]), dl2c_hull_sin(a->hull));
}
static inline dl2c_taylor dl2c_taylor_cos(const dl2c_taylor *a)
{
  return dl2c_taylor_wave(a, cos(a->c[0]), -sin(a->c[0]), dl2c_hull_cos(a->hull));
}

static inline dl2c_hull dl2c_hull_tan(dl2c_hull a)
{
  if (!(a.low > -1.57 && a.high < 1.57)) return dl2c_hull_unknown();
  return dl2c_hull_grown(tan(a.low), tan(a.high));
}
static inline dl2c_taylor dl2c_taylor_tan(const dl2c_taylor *a)
{
  const dl2c_taylor above = dl2c_taylor_sin(a);
  const dl2c_taylor below = dl2c_taylor_cos(a);
  dl2c_taylor t = dl2c_taylor_div(&above, &below);
  t.hull = dl2c_hull_out(dl2c_hull_tan(a->hull));
  return t;
}

static inline dl2c_hull dl2c_hull_tanh(dl2c_hull a)
{
  return dl2c_hull_grown(tanh(a.low), tanh(a.high));
}
/* The fourth derivative is below 4.8 everywhere, as is that of arctan. */
static inline dl2c_taylor dl2c_taylor_tanh(const dl2c_taylor *a)
{
  const real d = dl2c_taylor_deviation(a);
  const real value = tanh(a->c[0]);
  const real slope = 1.0 - value * value;
  const real f[] = {value, slope, -value * slope, slope * (3.0 * (value * value) - 1.0) / 3.0, 0.0};
  const real noise = 8.0 * DL2C_SLOP * (1.0 + d);
  return dl2c_taylor_compose(a, f, 0.2 * (d * d * d * d), noise, dl2c_hull_tanh(a->hull));
}

static inline dl2c_hull dl2c_hull_arctan(dl2c_hull a)
{
  return dl2c_hull_grown(atan(a.low), atan(a.high));
}
static inline dl2c_taylor dl2c_taylor_arctan(const dl2c_taylor *a)
{
  const real d = dl2c_taylor_deviation(a);
  const real middle = a->c[0];
  const real slope = 1.0 / (1.0 + middle * middle);
  const real third = slope * slope * slope * (3.0 * (middle * middle) - 1.0) / 3.0;
  const real f[] = {atan(middle), slope, -middle * (slope * slope), third, 0.0};
  const real noise = 8.0 * DL2C_SLOP * (1.0 + d);
  return dl2c_taylor_compose(a, f, 0.2 * (d * d * d * d), noise, dl2c_hull_arctan(a->hull));
}

static inline dl2c_hull dl2c_hull_arcsin(dl2c_hull a)
{
  return dl2c_hull_grown(asin(a.low), asin(a.high));
}
/* The third derivative grows with the size of the argument. */
static inline dl2c_taylor dl2c_taylor_arcsin(const dl2c_taylor *a)
{
  const dl2c_hull hull = dl2c_hull_arcsin(a->hull);
  const int32_t lacks =
      dl2c_taylor_lacks(a, !(a->hull.low > 1.0) & !(a->hull.high < -1.0));
  const real d = dl2c_taylor_deviation(a);
  const real middle = a->c[0];
  const real far = fabs(middle) + d;
  if (!(far < 0.999999)) return dl2c_taylor_unknown(lacks, hull);
  const real complement = (1.0 - far) * (1.0 + far);
  const real slope = 1.0 / sqrt((1.0 - middle) * (1.0 + middle));
  const real f[] = {asin(middle), slope, 0.5 * middle * (slope * slope * slope), 0.0, 0.0};
  const real rest = d * d * d * (1.0 + 2.0 * (far * far)) / (5.9 * (complement * complement * sqrt(complement)));
  return dl2c_taylor_compose(a, f, rest, 8.0 * DL2C_SLOP * (1.0 + slope * d), hull);
}

static inline dl2c_taylor dl2c_taylor_log(const dl2c_taylor *a)
{
  const int32_t lacks = dl2c_taylor_lacks(a, !(a->hull.high <= 0.0));
  const real middle = a->c[0];
  if (!(middle > DL2C_TINY)) return dl2c_taylor_unknown(lacks, dl2c_hull_unknown());
  const real q = dl2c_taylor_deviation(a) / middle;
  if (!(q < 0.999)) return dl2c_taylor_unknown(lacks, dl2c_hull_unknown());
  real f[DL2C_ORDER + 1];
  real power = 1.0 / middle;
  f[0] = log(middle);
  for (int k = 1; k <= DL2C_ORDER; k++, power = -power / middle) f[k] = power / (real)k;
  return dl2c_taylor_compose(a, f, 0.2 * dl2c_geometric_rest(q), 16.0 * DL2C_SLOP,
                             dl2c_hull_unknown());
}

/* A power of a positive base: monotone in the base and in the exponent. */
static inline dl2c_hull dl2c_hull_pow(dl2c_hull a, dl2c_hull b)
{
  if (!(a.low > 0.0) || !isfinite(b.low)) return dl2c_hull_unknown();
  const dl2c_hull all =
      dl2c_hull_four(pow(a.low, b.low), pow(a.low, b.high), pow(a.high, b.low), pow(a.high, b.high));
  return dl2c_hull_grown(all.low, all.high);
}
static inline dl2c_taylor dl2c_taylor_pow(const dl2c_taylor *a, const dl2c_taylor *b)
{
  const dl2c_taylor log_base = dl2c_taylor_log(a);
  const dl2c_taylor exponent = dl2c_taylor_product(b, &log_base);
  dl2c_taylor t = dl2c_taylor_exp(&exponent);
  t.hull = dl2c_hull_out(dl2c_hull_pow(a->hull, b->hull));
  return t;
}

#endif
