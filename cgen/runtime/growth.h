/* SPDX-License-Identifier: MIT-0 */
/* growth.h -- detects that a solver has come too close to a singularity to know its state. */
#ifndef DL2C_GROWTH_H
#define DL2C_GROWTH_H

#include "model.h"

/* A variable has grown when it is this many times the largest initial one, or 1. */
#define DL2C_GROWN 0x1p20

/* The size beyond which the growth of a flow from x is examined. */
static inline real dl2c_growth_limit(const real *x)
{
  real largest = 1.0;
  for (int k = 0; k < NX; k++) largest = dl2c_max(fabs(x[k]), largest);
  return DL2C_GROWN * largest;
}

#ifdef DL2C_RTOL
/* The relative uncertainty of time: ends of flows are within ten tolerances. */
#define DL2C_TIME_SHARE (10.0 * DL2C_RTOL)

/*
 * Whether at time `now` some variable of y has grown past the limit and would double within the
 * uncertainty of time. Only a singularity causes that: what grows exponentially from the beginning
 * leaves the range of numbers long before.
 */
static inline bool dl2c_blows_up(int flow, const real *p, const real *y, real limit, real now)
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
