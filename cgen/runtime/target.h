/* SPDX-License-Identifier: MIT-0 */
/*
 * target.h -- initial states near random targets.
 *
 * A target is uniform in the box around what is drawn for a chart, admissible or not. The search
 * starts from the nearest of a few states drawn as usual; then it moves to admissible points that
 * are nearer: sometimes along one axis, part of the way to the target, else anywhere in a cube
 * that grows on success and shrinks on failure. Distances are relative to the box.
 */
#ifndef DL2C_TARGET_H
#define DL2C_TARGET_H

#include "sampler.h"

enum { DL2C_STARTS = 4, DL2C_MOVES = 40 }; /* DL2C_MOVES for each number that varies */
#define DL2C_GROW 1.5
#define DL2C_SHRINK 0.9

/* The box around all boxes of a chart, and how many numbers of it vary. */
static inline int dl2c_around(int block, int chart, real *low, real *high)
{
  const int count = SAMPLE_FREE[chart];
  for (int k = 0; k < count; k++) {
    low[k] = (real)INFINITY;
    high[k] = (real)-INFINITY;
  }
  for (int box = SAMPLE_START[block]; box < SAMPLE_START[block + 1]; box++) {
    if (SAMPLE_CHART[NCHART > 1 ? box : 0] != chart) continue;
    for (int k = 0; k < count; k++) {
      if (SAMPLE_LOW[box][k] < low[k]) low[k] = SAMPLE_LOW[box][k];
      if (SAMPLE_HIGH[box][k] > high[k]) high[k] = SAMPLE_HIGH[box][k];
    }
  }
  int varying = 0;
  for (int k = 0; k < count; k++) varying += low[k] < high[k];
  return varying;
}

/* The square of the distance of two points, relative to the ranges. */
static inline real dl2c_squared_distance(int count, const real *a, const real *b, const real *low,
                              const real *high)
{
  real sum = 0.0;
  for (int k = 0; k < count; k++) {
    const real part = low[k] < high[k] ? (a[k] - b[k]) / (high[k] - low[k]) : 0.0;
    sum += part * part;
  }
  return sum;
}

static inline bool dl2c_is_initial(int chart, const real *drawn, real *x, real *p)
{
  model_initial(chart, drawn, x, p);
  return model_accept(chart, x, p);
}

/* Where the point may go next: part of the way to the target along one axis, or into a cube. */
static inline void dl2c_propose(dl2c_rng *rng, int count, bool along, real size, const real *low,
                                const real *high, const real *target, const real *at, real *next)
{
  memcpy(next, at, (size_t)count * sizeof *next);
  if (along) {
    const int k = (int)(dl2c_rng_unit(rng) * (real)count);
    const real part = 1.25 * dl2c_rng_unit(rng);
    next[k] = part >= 1.0 ? target[k] : at[k] + part * (target[k] - at[k]);
    return;
  }
  for (int k = 0; k < count; k++) {
    const real moved = at[k] + size * (high[k] - low[k]) * (2.0 * dl2c_rng_unit(rng) - 1.0);
    next[k] = moved < low[k] ? low[k] : moved > high[k] ? high[k] : moved;
  }
}

/* A state of a block near a random target; false if none was found. */
DL2C_OPTIONAL bool dl2c_draw_near(dl2c_rng *rng, int block, real *x, real *p)
{
  real low[NFREE + 1], high[NFREE + 1], target[NFREE + 1];
  real at[NFREE + 1] = {0.0}, next[NFREE + 1] = {0.0};
  int chart;
  if (!dl2c_draw_until(rng, block, at, &chart, x, p)) return false;
  const int count = SAMPLE_FREE[chart], varying = dl2c_around(block, chart, low, high);
  for (int k = 0; k < count; k++) target[k] = dl2c_rng_uniform(rng, low[k], high[k]);
  if (varying == 0 || dl2c_is_initial(chart, target, x, p)) {
    model_initial(chart, varying == 0 ? at : target, x, p);
    return true;
  }
  real left = dl2c_squared_distance(count, at, target, low, high);
  for (int start = 1; start < DL2C_STARTS; start++) {
    int other;
    if (!dl2c_draw_until(rng, block, next, &other, x, p)) return false;
    const real distance = dl2c_squared_distance(count, next, target, low, high);
    if (other != chart || !(distance < left)) continue;
    left = distance;
    memcpy(at, next, sizeof at);
  }
  real size = sqrt(left / (real)varying);
  for (int move = 0; move < DL2C_MOVES * varying; move++) {
    const bool along = move % 4 == 0;
    dl2c_propose(rng, count, along, size, low, high, target, at, next);
    const real distance = dl2c_squared_distance(count, next, target, low, high);
    const bool better = distance < left && dl2c_is_initial(chart, next, x, p);
    if (!along) size *= better ? DL2C_GROW : DL2C_SHRINK;
    if (!better) continue;
    left = distance;
    memcpy(at, next, sizeof at);
  }
  model_initial(chart, at, x, p);
  return true;
}

/* Draws each block, and derives constants; false if a block has no admissible draw. */
static bool dl2c_sample(dl2c_rng *rng, real *x, real *p)
{
  real drawn[NFREE + 1];
  int chart;
  for (int block = 0; block < NBLOCK; block++)
    if (DL2C_TARGETED ? !dl2c_draw_near(rng, block, x, p)
                      : !dl2c_draw_until(rng, block, drawn, &chart, x, p))
      return false;
  model_derive(p);
  return NBLOCK > 0;
}

#endif
