/* SPDX-License-Identifier: MIT-0 */
/* growth.h -- when a solver's motion has come so near to a singularity that its state is unknown. */
#ifndef DL2C_GROWTH_H
#define DL2C_GROWTH_H

#include "model.h"

/* A variable has grown when it is so many times what the largest one was, or 1. */
#define DL2C_GROWN 0x1p20

/* What a flow from x may not pass before its growth is looked at. */
static inline real dl2c_growth_limit(const real *x)
{
  real largest = 1.0;
  for (int k = 0; k < NX; k++) largest = dl2c_max(fabs(x[k]), largest);
  return DL2C_GROWN * largest;
}

#if DL2C_SOLVED_FLOWS || DL2C_DOPRI_FLOWS
/* The part of the time that has passed by which a solver may be off: ends are within ten tolerances. */
#define DL2C_TIME_SHARE (10.0 * DL2C_RTOL)

/*
 * Whether in y, at the time `now` of a flow, something has grown past the limit and would double within
 * what that time may be off by. Only a singularity does that: what grows exponentially from the
 * beginning is out of range long before. It is nearer than the solver knows where it is.
 */
static inline bool dl2c_bursts(int flow, const real *p, const real *y, real limit, real now)
{
  bool grown = false;
  for (int k = 0; k < NX; k++) grown |= fabs(y[k]) > limit;
  if (!grown) return false;
  real rates[NX];
  bool bursts = false;
  model_rates(flow, y, p, rates);
  for (int k = 0; k < NX; k++)
    bursts |= (fabs(y[k]) > limit) & !(rates[k] / y[k] * DL2C_TIME_SHARE * now <= 1.0);
  return bursts;
}
#endif

#endif
