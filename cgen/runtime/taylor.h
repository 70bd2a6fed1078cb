/* SPDX-License-Identifier: MIT-0 */
/*
 * taylor.h -- Taylor models: a polynomial of degree 4 and a bound of how far the truth is from it.
 *
 * A model stands for a quantity along a stretch of motion, whose time u runs from -1 to 1. The
 * quantity is within `r` of c[0] + c[1]*u + ... + c[4]*u^4, and so is what doubles compute for it
 * at any double u, operation by operation as the term is written. Of `r`, `e` is what rounding
 * adds; the rest is what the polynomial leaves out, which falls with the fifth power of the
 * stretch's length. `hull` holds the quantity too. Where nothing is known `r` is infinite, and `lacks`
 * may say why.
 *
 * Rounding: sums and products of n terms are off by less than n*2^-53 of the sum of their sizes,
 * which DL2C_SLOP covers for all operations here; functions of libm by 2^-50 of their value at most.
 * Beyond that numbers below 2^-900 count as zero. The same operations in the same order as
 * dl2c/flows/taylor.py.
 */
#ifndef DL2C_TAYLOR_H
#define DL2C_TAYLOR_H

#include "hull.h"

/*
 * For what most of the time of a search along motion goes into. Where few steps search, the rest is compiled to
 * be small (see DL2C_COLD), and these are compiled for speed, once each.
 */
#if DL2C_TRACKED_FLOWS
#define DL2C_TAYLOR static inline
#else
#define DL2C_TAYLOR __attribute__((hot, noinline, unused)) static
#endif

enum { DL2C_ORDER = 4 };

/* Why nothing is known of a quantity: flags. */
enum {
  DL2C_LACKS_DIGITS = 1, /* rounding decides whether it has a value: shorter stretches do not help */
  DL2C_LACKS_VALUE = 2,  /* it has no value anywhere on the stretch */
};

/* An error is that of rounding where it is at most so many times as large. */
#define DL2C_FINE 8.0

typedef struct dl2c_taylor {
  real c[DL2C_ORDER + 1];
  real r, e;
  dl2c_hull hull;
  int32_t lacks;
} dl2c_taylor;

/* Rounding of one operation on models, relative to the sizes of its operands. */
#define DL2C_SLOP 0x1p-50
/* Sums of bounds are rounded up by this factor. */
#define DL2C_ROUND_UP (1.0 + 0x1p-49)

static inline dl2c_taylor dl2c_taylor_number(real a)
{
  dl2c_taylor t = {.c = {a}, .hull = dl2c_hull_at(a)};
  if (isfinite(a)) return t;
  t.r = t.e = (real)INFINITY;
  t.lacks = DL2C_LACKS_VALUE;
  return t;
}

/* The radius of the polynomial about its middle; its size with the middle; its value at u. */
static inline real dl2c_taylor_spread(const dl2c_taylor *a)
{
  return fabs(a->c[1]) + fabs(a->c[2]) + fabs(a->c[3]) + fabs(a->c[4]);
}

static inline real dl2c_taylor_size(const dl2c_taylor *a)
{
  return fabs(a->c[0]) + dl2c_taylor_spread(a);
}
static inline real dl2c_taylor_at(const dl2c_taylor *a, real u)
{
  return (((a->c[4] * u + a->c[3]) * u + a->c[2]) * u + a->c[1]) * u + a->c[0];
}

/*
 * Along the stretch [middle - half, middle + half] of the polynomial b[0] + b[1]*s + ..., s in
 * [0,1], whose last value is `end`. Changes b.   b: (degree + 1)
 */
DL2C_TAYLOR dl2c_taylor dl2c_taylor_of(real *b, int degree, real end, real middle, real half)
{
  bool still = true;
  for (int i = 1; i <= degree; i++) still &= b[i] == 0.0;
  if (still && end == b[0]) return dl2c_taylor_number(b[0]);
  const real reach = middle + half;
  real size = fabs(b[degree]);
  real last = b[degree];
  for (int i = degree - 1; i >= 0; i--) size = size * reach + fabs(b[i]);
  for (int i = degree - 1; i >= 0; i--) last = last + b[i];
  for (int i = 0; i < degree; i++)
    for (int j = degree - 1; j >= i; j--) b[j] += middle * b[j + 1];
  dl2c_taylor t = {.c = {b[0]}};
  real power = half;
  for (int i = 1; i <= degree; i++, power *= half) {
    const real term = b[i] * power;
    if (i <= DL2C_ORDER) t.c[i] = term;
    else t.r += fabs(term);
  }
  t.e = (real)(degree + 1) * size * DL2C_SLOP;
  if (reach >= 1.0) t.e += fabs(end - last);
  t.r = (t.r + t.e) * DL2C_ROUND_UP;
  const real beyond = dl2c_taylor_spread(&t) + t.r;
  t.hull = dl2c_hull_out(dl2c_hull_of(t.c[0] - beyond, t.c[0] + beyond));
  return t;
}

static inline dl2c_taylor dl2c_taylor_neg(const dl2c_taylor *a)
{
  dl2c_taylor t = *a;
  for (int i = 0; i <= DL2C_ORDER; i++) t.c[i] = -a->c[i];
  t.hull = dl2c_hull_neg(a->hull);
  return t;
}

/* What rounding adds to a sum. */
static inline void dl2c_taylor_summed(const dl2c_taylor *a, const dl2c_taylor *b, dl2c_taylor *t)
{
  const real slop = dl2c_taylor_size(t) * DL2C_SLOP + DL2C_TINY;
  t->r = (a->r + b->r + slop) * DL2C_ROUND_UP;
  t->e = (a->e + b->e + slop) * DL2C_ROUND_UP;
  t->lacks = a->lacks | b->lacks;
}

DL2C_TAYLOR dl2c_taylor dl2c_taylor_add(const dl2c_taylor *a, const dl2c_taylor *b)
{
  dl2c_taylor t;
  for (int i = 0; i <= DL2C_ORDER; i++) t.c[i] = a->c[i] + b->c[i];
  dl2c_taylor_summed(a, b, &t);
  t.hull = dl2c_hull_out(dl2c_hull_add(a->hull, b->hull));
  return t;
}

DL2C_TAYLOR dl2c_taylor dl2c_taylor_sub(const dl2c_taylor *a, const dl2c_taylor *b)
{
  dl2c_taylor t;
  for (int i = 0; i <= DL2C_ORDER; i++) t.c[i] = a->c[i] - b->c[i];
  dl2c_taylor_summed(a, b, &t);
  t.hull = dl2c_hull_out(dl2c_hull_sub(a->hull, b->hull));
  return t;
}

/* Sums and products with a number: the bits of the same with dl2c_taylor_number. */
DL2C_TAYLOR dl2c_taylor dl2c_taylor_plus(const dl2c_taylor *a, real b)
{
  dl2c_taylor t = *a;
  t.c[0] += b;
  const real slop = dl2c_taylor_size(&t) * DL2C_SLOP + DL2C_TINY;
  t.r = (a->r + slop) * DL2C_ROUND_UP;
  t.e = (a->e + slop) * DL2C_ROUND_UP;
  t.lacks |= isfinite(b) ? 0 : DL2C_LACKS_VALUE;
  t.hull = dl2c_hull_out(dl2c_hull_add(a->hull, dl2c_hull_at(b)));
  return t;
}
DL2C_TAYLOR dl2c_taylor dl2c_taylor_from(real a, const dl2c_taylor *b)
{
  const dl2c_taylor minus = dl2c_taylor_neg(b);
  return dl2c_taylor_plus(&minus, a);
}
DL2C_TAYLOR dl2c_taylor dl2c_taylor_times(const dl2c_taylor *a, real b)
{
  dl2c_taylor t = {.lacks = a->lacks | (isfinite(b) ? 0 : DL2C_LACKS_VALUE)};
  for (int i = 0; i <= DL2C_ORDER; i++) t.c[i] = a->c[i] * b;
  const real slop = dl2c_taylor_size(a) * fabs(b) * DL2C_SLOP + DL2C_TINY;
  t.r = (a->r * fabs(b) + slop) * DL2C_ROUND_UP;
  t.e = (a->e * fabs(b) + slop) * DL2C_ROUND_UP;
  t.hull = dl2c_hull_out(dl2c_hull_mul(a->hull, dl2c_hull_at(b)));
  return t;
}

/* The product without its hull. */
static inline dl2c_taylor dl2c_taylor_product(const dl2c_taylor *a, const dl2c_taylor *b)
{
  dl2c_taylor t = {.lacks = a->lacks | b->lacks};
  real over = 0.0;
  for (int i = 0; i <= DL2C_ORDER; i++)
    for (int j = 0; j <= DL2C_ORDER; j++) {
      const real term = a->c[i] * b->c[j];
      if (i + j <= DL2C_ORDER) t.c[i + j] += term;
      else over += fabs(term);
    }
  const real first = dl2c_taylor_size(a);
  const real second = dl2c_taylor_size(b);
  const real slop = first * second * DL2C_SLOP + DL2C_TINY;
  t.r = (over + first * b->r + a->r * (second + b->r) + slop) * DL2C_ROUND_UP;
  t.e = (first * b->e + a->e * (second + b->e) + slop) * DL2C_ROUND_UP;
  return t;
}

DL2C_TAYLOR dl2c_taylor dl2c_taylor_mul(const dl2c_taylor *a, const dl2c_taylor *b)
{
  dl2c_taylor t = dl2c_taylor_product(a, b);
  t.hull = dl2c_hull_out(dl2c_hull_mul(a->hull, b->hull));
  return t;
}

DL2C_TAYLOR dl2c_taylor dl2c_taylor_square(const dl2c_taylor *a)
{
  dl2c_taylor t = dl2c_taylor_product(a, a);
  t.hull = dl2c_hull_out(dl2c_hull_square(a->hull));
  return t;
}

/* The largest deviation of a quantity from its middle. */
static inline real dl2c_taylor_deviation(const dl2c_taylor *a)
{
  return (dl2c_taylor_spread(a) + a->r) * DL2C_ROUND_UP;
}

/*
 * A function of a model, by the function's own Taylor polynomial about the model's middle.
 *   f: (5) its coefficients   tail: what it leaves out   noise: by how much the coefficients are
 *   off, beyond 2^-46 of the first   hull: of the result
 */
static inline dl2c_taylor dl2c_taylor_compose(const dl2c_taylor *a, const real *f, real tail,
                                              real noise, dl2c_hull hull)
{
  dl2c_taylor rest = *a;
  rest.c[0] = 0.0;
  dl2c_taylor t = {.c = {f[DL2C_ORDER]}};
  for (int k = DL2C_ORDER - 1; k >= 0; k--) {
    t = dl2c_taylor_product(&t, &rest);
    t.c[0] += f[k];
  }
  const real rounding = (16.0 * fabs(f[0]) + dl2c_taylor_size(&t)) * DL2C_SLOP;
  const real slop = rounding + noise + DL2C_TINY;
  t.r = (t.r + tail + slop) * DL2C_ROUND_UP;
  t.e = (t.e + slop) * DL2C_ROUND_UP;
  if (!isfinite(t.r)) t.r = t.e = (real)INFINITY;
  t.hull = dl2c_hull_out(hull);
  return t;
}

/* A model of which only the hull is known. */
static inline dl2c_taylor dl2c_taylor_unknown(int32_t lacks, dl2c_hull hull)
{
  dl2c_taylor t = {.r = (real)INFINITY, .e = (real)INFINITY, .lacks = lacks};
  t.hull = dl2c_hull_out(hull);
  return t;
}

/*
 * The flag of a function that does not have a value for all numbers near a model's. `some`: it may
 * have one on the stretch.
 */
static inline int32_t dl2c_taylor_lacks(const dl2c_taylor *a, bool some)
{
  const bool rounding = isfinite(a->r) & (dl2c_taylor_spread(a) <= a->r) & (a->r <= DL2C_FINE * a->e);
  return a->lacks | (rounding ? DL2C_LACKS_DIGITS : 0) | (some ? 0 : DL2C_LACKS_VALUE);
}

/* q^5 / (1 - q): the remainder of a geometric series, 0 <= q < 1. */
static inline real dl2c_geometric_rest(real q) { return q * q * q * q * q / (1.0 - q); }

/* The sign of a quantity on the whole stretch; 0 if it may have several. */
static inline int dl2c_taylor_sign(const dl2c_taylor *a)
{
  if (a->hull.low > 0.0) return 1;
  if (a->hull.high < 0.0) return -1;
  const real side = a->c[0] < 0.0 ? -1.0 : 1.0;
  const real slope = fabs(a->c[1]);
  const real bend = side * a->c[2];
  const real least = bend > 0.0 && slope < 2.0 * bend
                         ? side * a->c[0] - slope * slope / (4.0 * bend)
                         : side * a->c[0] - slope + bend;
  const real rest = fabs(a->c[3]) + fabs(a->c[4]) + a->r;
  const real slop = dl2c_taylor_size(a) * DL2C_SLOP;
  return least > rest + slop ? (int)side : 0;
}

#endif
