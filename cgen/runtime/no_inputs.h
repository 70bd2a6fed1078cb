/* SPDX-License-Identifier: MIT-0 */
/* no_inputs.h -- what model.h asks of the inputs of a model, for one that has none. */
#ifndef DL2C_NO_INPUTS_H
#define DL2C_NO_INPUTS_H

#include "model.h"

DL2C_INLINE void model_limits(int path, int input, const real *x, const real *p, const real *u,
                              real *low, real *high)
{
  (void)path, (void)input, (void)x, (void)p, (void)u, (void)low, (void)high;
}

static inline int model_criticals(int path, int input, const real *x, const real *p, const real *u,
                                  real *root)
{
  (void)path, (void)input, (void)x, (void)p, (void)u, (void)root;
  return 0;
}

static inline int model_pins(int path, int input, const real *x, const real *p, const real *u,
                             real *root)
{
  (void)path, (void)input, (void)x, (void)p, (void)u, (void)root;
  return -1;
}

DL2C_INLINE bool model_admits(int path, int input, const real *x, const real *p, const real *u)
{
  (void)path, (void)input, (void)x, (void)p, (void)u;
  return true;
}

#endif
