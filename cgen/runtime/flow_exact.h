/* SPDX-License-Identifier: MIT-0 */
/*
 * flow_exact.h -- when a polynomial motion leaves its domain.
 *
 * The margin of a condition is c0 + c1*tau + c2*tau^2, inside at tau = 0. The same
 * operations in the same order as dl2c/flows/exact.py.
 */
#ifndef DL2C_FLOW_EXACT_H
#define DL2C_FLOW_EXACT_H

#include "numbers.h"

/* Motion is followed by polynomials of this degree at most. */
enum { DL2C_TRACK_DEGREE = 12 };

/* How far a rounded end point steps back at first, relative to its time; then four times as far. */
#define DL2C_RETREAT_FIRST 0x1p-52

/*
 * Whether rounding may decide if and where the margin is zero: it nearly has a double zero ahead, of
 * which the roots lie closer together than 2^-9 of the way.
 */
static inline bool dl2c_doubtful(real c0, real c1, real c2)
{
  const real ahead = dl2c_select(c0 < 0.0, -c1, c1);
  return (c2 != 0.0) & (ahead < 0.0) & (fabs(c1 * c1 - 4.0 * c2 * c0) <= 0x1p-20 * (c1 * c1));
}

/* When the motion leaves c0 + c1*tau >= 0, or > 0; INFINITY for never. Without branches. */
DL2C_INLINE real dl2c_exit_linear(real c0, real c1)
{
  const real distance = dl2c_select(c0 > 0.0, c0, 0.0);
  return dl2c_select(c1 < 0.0, distance / -c1, (real)INFINITY);
}

/*
 * Where the margin of a starting point on or inside the boundary crosses zero; INFINITY for never. Without
 * branches: all cases share one division and one root.
 */
DL2C_INLINE real dl2c_leaves_at(real c0, real c1, real c2, bool touching_counts)
{
  const bool linear = c2 == 0.0;
  const bool at_edge = c0 <= 0.0;
  const bool falls = c1 < 0.0;
  const real disc = c1 * c1 - 4.0 * c2 * c0;
  const real root = sqrt(disc);
  const bool avoids = ((c1 >= 0.0) & (c2 >= 0.0)) | (disc < 0.0)
      | ((disc == 0.0) & (c2 > 0.0) & !touching_counts);
  const bool never = (at_edge & !(c2 < 0.0)) | (!at_edge & avoids);

  real part = dl2c_select(falls, c0, -(c1 + root) / 2.0);
  real whole = dl2c_select(falls, (root - c1) / 2.0, c2);
  part = dl2c_select(at_edge, -c1, part);
  whole = dl2c_select(at_edge, c2, whole);
  real at = dl2c_select(never, (real)INFINITY, part / whole);
  at = dl2c_select(at_edge & (c1 <= 0.0), dl2c_select(falls | (c2 < 0.0), 0.0, (real)INFINITY), at);
  return dl2c_select(linear, dl2c_exit_linear(c0, c1), at);
}

/* margin >= 0: leaves where the margin becomes negative. */
static inline real dl2c_exit_nonnegative(real c0, real c1, real c2)
{
  return dl2c_leaves_at(c0, c1, c2, false);
}

/* margin > 0: leaves where it becomes zero. */
static inline real dl2c_exit_positive(real c0, real c1, real c2)
{
  return dl2c_leaves_at(c0, c1, c2, true);
}

/* margin != 0: leaves where it becomes zero from either side. */
static inline real dl2c_exit_nonzero(real c0, real c1, real c2)
{
  const bool below = c0 < 0.0;
  return dl2c_leaves_at(dl2c_select(below, -c0, c0), dl2c_select(below, -c1, c1),
                        dl2c_select(below, -c2, c2), true);
}

/* margin = 0 that motion changes: leaves at once. */
static inline real dl2c_exit_zero(void) { return 0.0; }

#endif
