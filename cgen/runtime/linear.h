/* SPDX-License-Identifier: MIT-0 */
/*
 * linear.h -- flows with linear equations by their power series.
 *
 * Where x' = J*x + c with J and c constant along the flow (rotations, decay, springs, and what
 * integrates them), the coefficients of the solution's power series follow from each other by one
 * product with J. A series of degree 12 is used as far as its last terms are below the rounding
 * of the state, then begun anew: no tolerance is involved.
 */
#ifndef DL2C_LINEAR_H
#define DL2C_LINEAR_H

#include "pieces.h"

typedef struct dl2c_linear {
  int32_t first[NX + 1], column[NX * NX]; /* entries of the Jacobian that are not zero, by rows */
  real entry[NX * NX];
  real now, stop;
  real last[NX]; /* the state at `now` */
  int32_t steps, most; /* series so far, and how many there may be */
} dl2c_linear;

/*
 * A flow that needs more series than a few is passed to the solver, if there is one. If that fails
 * too, as it does for fast oscillations, many are allowed: about a second of work for a few
 * variables.
 */
enum { DL2C_FEW_SERIES = 10000, DL2C_MANY_SERIES = 2000000 };

/* The last two terms of a series are at most this, relative to the largest one. */
#define DL2C_SERIES_REST 0x1p-56

static void dl2c_linear_start(dl2c_linear *linear, int flow, const real *x, const real *p,
                              real stop, int32_t most)
{
  real jacobian[NX * NX];
  linear->now = 0.0;
  linear->stop = stop;
  linear->steps = 0;
  linear->most = most;
  memcpy(linear->last, x, sizeof linear->last);
  model_jacobian(flow, x, p, jacobian);
  int32_t count = 0;
  for (int row = 0; row < NX; row++) {
    linear->first[row] = count;
    for (int column = 0; column < NX; column++) {
      if (jacobian[row * NX + column] == 0.0) continue;
      linear->column[count] = column;
      linear->entry[count++] = jacobian[row * NX + column];
    }
  }
  linear->first[NX] = count;
}

static bool dl2c_linear_done(const dl2c_linear *linear) { return linear->now >= linear->stop; }

/* The last two terms after the time h, relative to the largest one of their variable. */
static real dl2c_linear_rest(const real (*c)[NX], real h)
{
  real largest[NX] = {0.0};
  real last[NX] = {0.0};
  real power = 1.0;
  for (int i = 0; i <= DL2C_TRACK_DEGREE; i++, power *= h)
    for (int k = 0; k < NX; k++) {
      const real term = fabs(c[i][k] * power);
      largest[k] = dl2c_max(term, largest[k]);
      if (i >= DL2C_TRACK_DEGREE - 1) last[k] = dl2c_max(term, last[k]);
    }
  real rest = 0.0;
  for (int k = 0; k < NX; k++)
    if (last[k] > 0.0) rest = dl2c_max(rest, last[k] / largest[k]);
  return rest;
}

/*
 * The next track, as long as a series of degree 12 gives every digit. False: it is not finite, or
 * there were too many series; then `steps` is more than `most`.
 */
static bool dl2c_linear_step(dl2c_linear *linear, int flow, const real *p, dl2c_track *track)
{
  enum { DEGREE = DL2C_TRACK_DEGREE };
  if (linear->steps++ >= linear->most) return false;
  real c[DEGREE + 1][NX];
  memcpy(c[0], linear->last, sizeof c[0]);
  model_rates(flow, linear->last, p, c[1]);
  DL2C_UNROLL /* divisions by 2, 4 and 8 become products, which are as exact and quicker */
  for (int i = 1; i < DEGREE; i++) {
    for (int k = 0, entry = 0; k < NX; k++) {
      real sum = 0.0;
      for (; entry < linear->first[k + 1]; entry++)
        sum += linear->entry[entry] * c[i][linear->column[entry]];
      c[i + 1][k] = sum / (real)(i + 1);
    }
  }
  bool finite = true;
  for (int i = 0; i <= DEGREE; i++) finite &= dl2c_all_finite(c[i], NX);
  if (!finite) return false;

  real h = linear->stop - linear->now;
  while (dl2c_linear_rest((const real(*)[NX])c, h) > DL2C_SERIES_REST) {
    h *= 0.5;
    if (!(linear->now + 0.5 * h > linear->now)) return false;
  }
  const bool whole = h == linear->stop - linear->now;
  track->from = linear->now;
  track->length = h;
  track->degree = DEGREE;
  real scale = 1.0;
  for (int i = 0; i <= DEGREE; i++, scale *= h)
    for (int k = 0; k < NX; k++) track->c[k][i] = c[i][k] * scale;
  for (int k = 0; k < NX; k++) {
    real value = track->c[k][DEGREE];
    for (int i = DEGREE - 1; i >= 0; i--) value += track->c[k][i];
    track->end[k] = value;
  }
  memcpy(linear->last, track->end, sizeof linear->last);
  linear->now = whole ? linear->stop : linear->now + h;
  return dl2c_all_finite(linear->last, NX);
}

#endif
