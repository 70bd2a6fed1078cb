/* SPDX-License-Identifier: MIT-0 */
/* project.h -- the end of a flow that is followed numerically, moved onto what the flow conserves. */
#ifndef DL2C_PROJECT_H
#define DL2C_PROJECT_H

#include "model.h"

/* A gradient of which less than this part is left counts as a combination of those before it. */
#define DL2C_DEPENDENT 0x1p-20

/*
 * The part of a gradient that is orthogonal to the first `count` of `axes`, which are orthogonal
 * to each other. Returns its square, 0 where nothing is left.   rest: (NX)
 */
static inline real dl2c_orthogonal(const real *gradient, const real (*axes)[NX],
                                   const real *squares, int count, real *rest)
{
  real whole = 0.0;
  real square = 0.0;
  for (int k = 0; k < NX; k++) {
    rest[k] = gradient[k];
    whole += gradient[k] * gradient[k];
  }
  for (int j = 0; j < count; j++) {
    real along = 0.0;
    for (int k = 0; k < NX; k++) along += rest[k] * axes[j][k];
    for (int k = 0; k < NX; k++) rest[k] -= squares[j] > 0.0 ? along / squares[j] * axes[j][k] : 0.0;
  }
  for (int k = 0; k < NX; k++) square += rest[k] * rest[k];
  return square > whole * DL2C_DEPENDENT * DL2C_DEPENDENT ? square : 0.0;
}

/*
 * One step of Newton's method from y towards all equalities together, the shortest one that leaves
 * some variables as they are. Solutions in closed form keep them anyway.   fixed: (NX) which, or NULL for none
 */
static inline void dl2c_project(int flow, const real *p, const bool *fixed, real *y)
{
#if DL2C_TRACKED_FLOWS
  if (NPROJECTION == 0) return;
  real off[NPROJECTION + 1] = {0.0};
  real by[NPROJECTION + 1][NX] = {{0.0}};
  real axes[NPROJECTION + 1][NX];
  real squares[NPROJECTION + 1];
  real moved[NX] = {0.0};
  model_invariants(flow, y, p, off, by);
  for (int j = 0; j < NPROJECTION; j++) {
    for (int k = 0; fixed != NULL && k < NX; k++) by[j][k] = fixed[k] ? 0.0 : by[j][k];
    squares[j] = dl2c_orthogonal(by[j], (const real(*)[NX])axes, squares, j, axes[j]);
    if (!(squares[j] > 0.0)) continue;
    real left = off[j];
    for (int k = 0; k < NX; k++) left -= by[j][k] * moved[k];
    const real step = left / squares[j];
    for (int k = 0; k < NX; k++) moved[k] += step * axes[j][k];
  }
  for (int k = 0; k < NX; k++) y[k] -= moved[k];
#else
  (void)flow, (void)p, (void)fixed, (void)y;
#endif
}

/*
 * Bounds that were met hold exactly where a flow from x ends after some time: variables that this
 * moves keep their values while the others are moved onto the equalities once more.
 */
static inline void dl2c_snap(int flow, const real *x, const real *p, real time, const int8_t *sign,
                               real *y)
{
  real before[NX];
  bool fixed[NX];
  bool moved = false;
  memcpy(before, y, sizeof before);
  model_snap(flow, x, p, time, sign, y);
  for (int k = 0; k < NX; k++) moved |= fixed[k] = y[k] != before[k];
  if (NPROJECTION == 0 || !moved) return;
  dl2c_project(flow, p, fixed, y);
  model_snap(flow, x, p, time, sign, y);
}

#endif
