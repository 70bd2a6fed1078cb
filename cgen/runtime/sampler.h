/* SPDX-License-Identifier: MIT-0 */
/*
 * sampler.h -- initial states: a box by its share, a uniform point in it, then the precondition.
 *
 * Names that no condition connects are in different blocks, which are drawn independently. Where
 * equalities make the set of initial states a manifold, a box belongs to a chart of it, which says
 * what the drawn numbers are; a point is kept with a probability proportional to the part of the
 * set that it stands for.
 */
#ifndef DL2C_SAMPLER_H
#define DL2C_SAMPLER_H

#include "numbers.h"
#include "rng.h"

/* Draws that may fail before a reset gives up, and states without a run that may be drawn. */
enum { DL2C_MAX_DRAWS = 10000000, DL2C_MAX_DEADLOCKS = 1000 };

/* One draw of the names of a block, and of which chart; false if it is not admissible. */
static inline bool dl2c_draw(dl2c_rng *rng, int block, real *drawn, int *of_chart, real *x, real *p)
{
  int box = SAMPLE_START[block];
  const int count = SAMPLE_START[block + 1] - box;
  if (count > 1) {
    const real place = dl2c_rng_unit(rng) * (real)count;
    box += (int)place;
    const bool other = place - (real)(int)place >= SAMPLE_SHARE[box];
    box = dl2c_pick(other, (int)SAMPLE_ALIAS[box], box); /* no branch: the processor cannot predict it */
  }
  const int chart = *of_chart = SAMPLE_CHART[NCHART > 1 ? box : 0];
  for (int k = 0; k < SAMPLE_FREE[chart]; k++)
    drawn[k] = dl2c_rng_uniform(rng, SAMPLE_LOW[box][k], SAMPLE_HIGH[box][k]);
  model_initial(chart, drawn, x, p);
  if (DL2C_WEIGHTED) {
    const real u = dl2c_rng_unit(rng);
    if (!(u * u * SAMPLE_DENSITY[DL2C_WEIGHTED ? box : 0] <= model_density(chart, x, p))) return false;
  }
  return model_accept(chart, x, p);
}

/* Draws until a block is admissible; false if it never was. */
static inline bool dl2c_draw_until(dl2c_rng *rng, int block, real *drawn, int *chart, real *x,
                                   real *p)
{
  for (int tries = 0; tries < DL2C_MAX_DRAWS; tries++)
    if (dl2c_draw(rng, block, drawn, chart, x, p)) return true;
  return false;
}

#endif
