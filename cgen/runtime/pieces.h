/* SPDX-License-Identifier: MIT-0 */
/*
 * pieces.h -- motion as polynomials: a track is a whole solution, or one internal step of a solver.
 */
#ifndef DL2C_PIECES_H
#define DL2C_PIECES_H

#include "flow_exact.h"
#include "taylor.h"

/*
 * For a function that few steps call where no flow is always searched: optimised for size, which takes half
 * the time to compile.
 */
#ifndef DL2C_COLD
#if DL2C_TRACKED_FLOWS
#define DL2C_COLD
#else
#define DL2C_COLD __attribute__((cold))
#endif
#endif

/*
 * x(from + s*length), s in [0,1]: variable k is the sum of c[k][i] * s^i, i <= degree. At 0 and 1
 * it is c[k][0] and end[k] to the last bit, so that tracks join.
 */
typedef struct dl2c_track {
  real from;
  real length;
  int32_t degree;
  real c[NX][DL2C_TRACK_DEGREE + 1];
  real end[NX];
} dl2c_track;

/* The rounding error of a value of a track, relative to the sum of its terms. */
#define DL2C_TRACK_ROUNDING 0x1p-46

/* The state along a track, s in [0,1].   x: (NX) */
static void dl2c_track_at(const dl2c_track *track, real s, real *x)
{
  if (s >= 1.0) {
    memcpy(x, track->end, sizeof track->end);
    return;
  }
  for (int k = 0; k < NX; k++) {
    real value = track->c[k][track->degree];
    for (int i = track->degree - 1; i >= 0; i--) value = value * s + track->c[k][i];
    x[k] = value;
  }
}

/* How fast a state changes, relative to its size. */
static inline real dl2c_pace(const real *y, const real *rates)
{
  real size = 0.0;
  real speed = 0.0;
  for (int k = 0; k < NX; k++) {
    size = dl2c_max(fabs(y[k]), size);
    speed = dl2c_max(fabs(rates[k]), speed);
  }
  return size > 0.0 ? speed / size : speed;
}

/*
 * An interval that contains one variable: s^i is between 0 and 1, and rounding adds little.   down, up: sums
 * of its negative and positive terms, without the first
 */
DL2C_INLINE dl2c_hull dl2c_terms_between(real first, real down, real up, real end)
{
  const real rounding = (fabs(first) + up - down) * DL2C_TRACK_ROUNDING;
  return dl2c_hull_of(dl2c_min(first + down - rounding, end), dl2c_max(first + up + rounding, end));
}

/* Intervals that contain the state along a track.   x: (NX) */
static inline void dl2c_track_hull(const dl2c_track *track, dl2c_hull *x)
{
  for (int k = 0; k < NX; k++) {
    const real *c = track->c[k];
    real down = 0.0;
    real up = 0.0;
    for (int i = 1; i <= track->degree; i++) {
      down += dl2c_min(c[i], 0.0);
      up += dl2c_max(c[i], 0.0);
    }
    x[k] = dl2c_terms_between(c[0], down, up, track->end[k]);
  }
}

/* Models of all variables on a part of a track.   x: (NX) */
DL2C_TAYLOR void dl2c_track_models(const dl2c_track *track, real middle, real half, dl2c_taylor *x)
{
  for (int k = 0; k < NX; k++) {
    real b[DL2C_TRACK_DEGREE + 1];
    memcpy(b, track->c[k], sizeof b);
    x[k] = dl2c_taylor_of(b, track->degree, track->end[k], middle, half);
  }
}

#endif
