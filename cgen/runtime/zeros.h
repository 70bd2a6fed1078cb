/* SPDX-License-Identifier: MIT-0 */
/*
 * zeros.h -- zeros of the polynomials that tests make of an input.
 *
 * Of degree 1 and 2 by formula. Of higher degrees between the turning points, which are the zeros of
 * the derivative, by bisection over doubles: the same operations in the same order as
 * dl2c/paths/zeros.py.
 */
#ifndef DL2C_ZEROS_H
#define DL2C_ZEROS_H

#include "numbers.h"

/*
 * A value counts as zero if it is within this of zero, relative to the terms that it is the sum
 * of.
 */
#define DL2C_TOUCH 0x1p-48

/* The highest degree of a polynomial in an input. */
enum { DL2C_DEGREE = 12 };

/* Appends where c0 + c1*u + c2*u^2 is zero, or if that is nowhere where it is nearest to zero. */
static inline int dl2c_roots(real c0, real c1, real c2, real *root, int count)
{
  if (c2 == 0.0) {
    if (c1 != 0.0) root[count++] = -c0 / c1;
    return count;
  }
  const real inner = c1 * c1 - 4.0 * c2 * c0;
  if (!(inner > 0.0)) {
    root[count++] = -c1 / (2.0 * c2);
    return count;
  }
  const real sum = c1 < 0.0 ? c1 - sqrt(inner) : c1 + sqrt(inner);
  root[count++] = -sum / (2.0 * c2);
  root[count++] = -2.0 * c0 / sum;
  return count;
}

/* Whether a square has no root, not even one that rounding may have taken from it. */
static inline bool dl2c_misses(real c0, real c1, real c2)
{
  return c2 != 0.0 && c1 * c1 - 4.0 * c2 * c0 < -(c1 * c1) * DL2C_TOUCH;
}

/* The roots, or -1 where every value is one. */
static inline int dl2c_pins(real c0, real c1, real c2, real *root)
{
  return c0 == 0.0 && c1 == 0.0 && c2 == 0.0 ? -1 : dl2c_roots(c0, c1, c2, root, 0);
}

/* Whether a value is a root as computed, 1 or 0; all are where the polynomial is zero. */
static inline real dl2c_solves(real c0, real c1, real c2, real value)
{
  real root[2];
  if (c0 == 0.0 && c1 == 0.0 && c2 == 0.0) return 1.0;
  if (dl2c_misses(c0, c1, c2)) return 0.0;
  const int count = dl2c_roots(c0, c1, c2, root, 0);
  for (int k = 0; k < count; k++)
    if (value == root[k]) return 1.0;
  return 0.0;
}

/* c[0] + ... + c[degree]*u^degree */
static inline real dl2c_value(const real *c, int degree, real u)
{
  real value = c[degree];
  for (int k = degree - 1; k >= 0; k--) value = value * u + c[k];
  return value;
}

/* Whether the polynomial is as near to zero as rounding could bring it. */
static inline bool dl2c_touches(const real *c, int degree, real u)
{
  real size = fabs(c[degree]);
  for (int k = degree - 1; k >= 0; k--) size = size * fabs(u) + fabs(c[k]);
  return fabs(dl2c_value(c, degree, u)) <= DL2C_TOUCH * size;
}

/*
 * Where the sign changes between neighbours of (count) places in order, and those between the first
 * and the last that are zeros; how many.
 */
static inline int dl2c_crossings(const real *c, int degree, const real *place, int count, real *root)
{
  int found = 0;
  for (int k = 1; k < count; k++) {
    const real before = dl2c_value(c, degree, place[k - 1]);
    const real after = dl2c_value(c, degree, place[k]);
    if (after == 0.0 && k + 1 < count) root[found++] = place[k];
    if (!((before < 0.0 && after > 0.0) || (after < 0.0 && before > 0.0))) continue;
    int64_t left = dl2c_ordinal(place[k - 1]);
    int64_t right = dl2c_ordinal(place[k]);
    while (dl2c_distance(left, right) > 1) {
      const int64_t middle = dl2c_moved(left, 1, dl2c_distance(left, right) / 2);
      if ((dl2c_value(c, degree, dl2c_from_ordinal(middle)) < 0.0) == (before < 0.0)) left = middle;
      else right = middle;
    }
    root[found++] = dl2c_from_ordinal(right);
  }
  return found;
}

/* The two roots of a quadratic that are between low and high, in order, between these two; how many. */
static inline int dl2c_between(const real *c, real low, real high, real *place)
{
  real root[2];
  const int count = dl2c_roots(c[0], c[1], c[2], root, 0);
  int found = 1;
  place[0] = low;
  for (int k = 0; k < count; k++)
    if (low < root[k] && root[k] < high) place[found++] = root[k];
  if (found == 3 && place[2] < place[1]) {
    const real larger = place[1];
    place[1] = place[2];
    place[2] = larger;
  }
  place[found++] = high;
  return found;
}

/* Low, where a polynomial of degree above 2 turns between, in order, and high; how many. */
static inline int dl2c_turns(const real *c, int degree, real low, real high, real *place)
{
  real row[DL2C_DEGREE - 1][DL2C_DEGREE + 1]; /* the derivatives */
  memcpy(row[0], c, (size_t)(degree + 1) * sizeof *c);
  for (int m = 1; m <= degree - 2; m++)
    for (int k = 0; k <= degree - m; k++) row[m][k] = (real)(k + 1) * row[m - 1][k + 1];
  int places = dl2c_between(row[degree - 2], low, high, place);
  for (int m = degree - 3; m > 0; m--) {
    real turn[DL2C_DEGREE];
    const int turns = dl2c_crossings(row[m], degree - m, place, places, turn);
    memcpy(place + 1, turn, (size_t)turns * sizeof *turn);
    place[turns + 1] = high;
    places = turns + 2;
  }
  return places;
}

/*
 * Appends where the polynomial is zero from low to high; up to degree 2 anywhere. Where it turns and
 * nearly touches zero too, and if `near`, wherever it turns. How many.   root: (2*degree + 1 more)
 */
static inline int dl2c_zeros(const real *c, int degree, real low, real high, bool near, real *root,
                             int count)
{
  while (degree > 2 && c[degree] == 0.0) degree--;
  if (degree <= 2)
    return !near && dl2c_misses(c[0], c[1], c[2]) ? count : dl2c_roots(c[0], c[1], c[2], root, count);
  real place[DL2C_DEGREE + 2];
  const int places = dl2c_turns(c, degree, low, high, place);
  for (int k = 1; k + 1 < places; k++)
    if (near || dl2c_touches(c, degree, place[k])) root[count++] = place[k];
  if (dl2c_touches(c, degree, low)) root[count++] = low;
  if (dl2c_touches(c, degree, high)) root[count++] = high;
  return count + dl2c_crossings(c, degree, place, places, root + count);
}

/* Where a polynomial of degree 3 or more in (c) changes its sign for the n-th time from low to high,
 * the first being 0; NaN where it does so less often. */
static inline real dl2c_root_of(const real *c, int degree, real low, real high, int n)
{
  while (degree > 2 && c[degree] == 0.0) degree--;
  real place[DL2C_DEGREE + 2], root[DL2C_DEGREE];
  if (degree <= 2) return n + 2 < dl2c_between(c, low, high, place) ? place[n + 1] : (real)NAN;
  const int places = dl2c_turns(c, degree, low, high, place);
  return n < dl2c_crossings(c, degree, place, places, root) ? root[n] : (real)NAN;
}

/* The zeros, or -1 where every value is one. */
static inline int dl2c_pin_zeros(const real *c, int degree, real low, real high, real *root)
{
  bool any = false;
  for (int k = 0; k <= degree; k++) any |= c[k] != 0.0;
  return any ? dl2c_zeros(c, degree, low, high, false, root, 0) : -1;
}

/* Whether a value is a zero as computed, 1 or 0; all are where the polynomial is zero. */
static inline real dl2c_is_zero(const real *c, int degree, real low, real high, real value)
{
  real root[2 * DL2C_DEGREE + 1];
  const int count = dl2c_pin_zeros(c, degree, low, high, root);
  if (count < 0) return 1.0;
  for (int k = 0; k < count; k++)
    if (value == root[k]) return 1.0;
  return 0.0;
}

#endif
