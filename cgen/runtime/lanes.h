/* SPDX-License-Identifier: MIT-0 */
/*
 * lanes.h -- a step of many environments at once, for models whose step draws nothing and has one
 * flow.
 *
 * Every lane selects its path and moves along the flow without branches. Lanes with an exception,
 * such as an input that is not admissible, are left to the scalar step, which computes the same
 * bits.
 */
#ifndef DL2C_LANES_H
#define DL2C_LANES_H

#include "step.h"

/* Decisions and moves of the lanes of a block. */
typedef struct dl2c_moves {
  int64_t path[DL2C_BLOCK];      /* the path taken, -1 for none */
  uint8_t requested[DL2C_BLOCK]; /* it is the one requested */
  uint8_t moved[DL2C_BLOCK];     /* the lane has moved */
} dl2c_moves;

/* The alternatives requested, by choice; -1 where none has that number.   choices: (count, NCHOICE) */
DL2C_INLINE void dl2c_wanted(const int32_t *restrict choices, int64_t count,
                             dl2c_alternative wanted[][DL2C_BLOCK])
{
  enum { LARGEST = (1 << (8 * sizeof(dl2c_alternative) - 1)) - 1 };
  DL2C_UNROLL
  for (int c = 0; c < NCHOICE; c++)
    for (int64_t i = 0; i < count; i++) {
      const int32_t choice = choices[i * NCHOICE + c];
      wanted[c][i] = (dl2c_alternative)((choice & ~LARGEST) != 0 ? -1 : choice);
    }
}

/*
 * The path that each lane prefers (see dl2c_preferred), where it may take it: another than the one
 * requested only if `falls_back`.   enabled: (paths, stride)   choices: (count, NCHOICE)
 */
DL2C_INLINE void dl2c_choose_lanes(const uint8_t *restrict enabled, int64_t stride, int64_t count,
                                   const int32_t *restrict choices, bool falls_back,
                                   const uint8_t *restrict waited, int64_t *restrict path,
                                   uint8_t *restrict requested)
{
  dl2c_alternative wanted[NCHOICE + 1][DL2C_BLOCK];
  dl2c_alternative taken[DL2C_BLOCK];
  const dl2c_alternative lowest = falls_back ? 0 : 2 * NCHOICE + 2;
  dl2c_wanted(choices, count, wanted);
  for (int64_t i = 0; i < count; i++) {
    dl2c_alternative best = -1;
    dl2c_alternative best_rank = -1;
    DL2C_UNROLL_PATHS
    for (int k = 0; k < NPATH; k++) {
      dl2c_alternative agreed = 0;
      dl2c_alternative rank = 0;
      dl2c_alternative whole = 1;
      DL2C_UNROLL
      for (int j = 0; j < PATHS[k].nmet; j++) {
        const dl2c_alternative same = DECISIONS[k][PATHS[k].met[j]] == wanted[PATHS[k].met[j]][i];
        rank = (whole & !same) ? (dl2c_alternative)(2 * agreed + PATHS[k].marked[j]) : rank;
        whole &= same;
        agreed = (dl2c_alternative)(agreed + whole);
      }
      rank = whole ? 2 * NCHOICE + 2 : rank;
      const bool better = (enabled[k * stride + i] != 0) & (rank > best_rank);
      best = better ? (dl2c_alternative)k : best;
      best_rank = better ? rank : best_rank;
    }
    requested[i] = best_rank == 2 * NCHOICE + 2;
    taken[i] = ((best_rank >= lowest) & !waited[i]) ? best : -1;
  }
  for (int64_t i = 0; i < count; i++) path[i] = taken[i];
}

/* The same, path by path: for more of them than can be compared in one loop. */
DL2C_INLINE void dl2c_choose_among_many(const uint8_t *restrict enabled, int64_t stride, int64_t count,
                                        const int32_t *restrict choices, bool falls_back,
                                        const uint8_t *restrict waited, int64_t *restrict path,
                                        uint8_t *restrict requested)
{
  dl2c_alternative wanted[NCHOICE + 1][DL2C_BLOCK];
  dl2c_alternative best[DL2C_BLOCK];
  dl2c_alternative best_rank[DL2C_BLOCK];
  dl2c_alternative rank[DL2C_BLOCK];
  dl2c_alternative agreed[DL2C_BLOCK];
  const dl2c_alternative whole = 2 * NCHOICE + 2;
  dl2c_wanted(choices, count, wanted);
  for (int64_t i = 0; i < count; i++) best[i] = best_rank[i] = -1;
  for (int k = 0; k < NPATH; k++) {
    for (int64_t i = 0; i < count; i++) rank[i] = whole;
    for (int64_t i = 0; i < count; i++) agreed[i] = 0;
    for (int j = 0; j < PATHS[k].nmet; j++) {
      const dl2c_alternative *own = wanted[PATHS[k].met[j]];
      const int16_t alternative = DECISIONS[k][PATHS[k].met[j]];
      const int16_t marked = PATHS[k].marked[j];
      for (int64_t i = 0; i < count; i++) {
        const dl2c_alternative so_far = rank[i] == whole;
        const dl2c_alternative same = so_far & (own[i] == alternative);
        rank[i] = same == so_far ? rank[i] : (dl2c_alternative)(2 * agreed[i] + marked);
        agreed[i] = (dl2c_alternative)(agreed[i] + same);
      }
    }
    const uint8_t *restrict open = enabled + k * stride;
    for (int64_t i = 0; i < count; i++) {
      const dl2c_alternative better = (dl2c_alternative)((open[i] != 0) & (rank[i] > best_rank[i]));
      best[i] = better ? (dl2c_alternative)k : best[i];
      best_rank[i] = better ? rank[i] : best_rank[i];
    }
  }
  const dl2c_alternative lowest = falls_back ? 0 : whole;
  for (int64_t i = 0; i < count; i++) requested[i] = best_rank[i] == whole;
  for (int64_t i = 0; i < count; i++)
    path[i] = ((best_rank[i] >= lowest) & !waited[i]) ? best[i] : -1;
}

/* Whether the inputs on a path are admissible as they are.   u: (NU) */
DL2C_INLINE bool dl2c_all_admissible(int path, const real *x, const real *p, const real *u)
{
  bool well = true;
  DL2C_UNROLL
  for (int j = 0; j < PATHS[path].ninput; j++) {
    const int input = PATHS[path].inputs[j].input;
    well &= (u[input] >= INPUT_LOW[input]) & (u[input] <= INPUT_HIGH[input]);
    well &= model_admits(path, input, x, p, u);
  }
  return well;
}

/*
 * Inputs and assignments of the path that a lane takes, from x into y. False where the scalar step
 * is needed.
 *   path: -1 for none   inputs: (NINPUT) as requested, which are all that there are
 */
DL2C_INLINE bool dl2c_decide_lane(int64_t path, const real *x, const real *p, const real *inputs,
                                  real *y)
{
  bool well = DL2C_FEW_PATHS & (path >= 0);
  real u[NU + 1];
  dl2c_copy(inputs, NU, u);
  dl2c_copy(x, NX, y);
  DL2C_UNROLL_PATHS
  for (int k = 0; k < NPATH; k++)
    if (NU > 0) well &= (path != k) | dl2c_all_admissible(k, x, p, u);
  return well & model_assign(path, x, p, u, y);
}

/*
 * The same, environment by environment: where paths are many, a selection among all their assignments would
 * take longer.   x: (NX, stride)   y: (NX, DL2C_BLOCK)   well: (count)
 */
static __attribute__((noinline)) void dl2c_decide_each(const real *x, const real *p, int64_t stride,
                                                       int64_t count, const int64_t *path,
                                                       const real *inputs, real (*y)[DL2C_BLOCK],
                                                       int64_t *well)
{
  for (int64_t i = 0; i < count; i++) {
    const int taken = (int)path[i];
    real own[NX];
    real start[NX];
    real constants[NP + 1];
    real u[NU + 1] = {0.0};
    dl2c_read_lane(x, p, stride, i, own, constants);
    dl2c_copy(own, NX, start);
    dl2c_copy(inputs + i * NINPUT, NU, u);
    well[i] = taken >= 0 && dl2c_all_admissible(taken, own, constants, u) &&
              model_update(taken, own, constants, u, start) && dl2c_all_finite(start, NX);
    for (int k = 0; k < NX; k++) y[k][i] = start[k];
  }
}

/* Clocks and counters of the environments of a batch. */
typedef struct dl2c_clocks {
  real *duration;   /* of the last step */
  real *time;       /* in this episode, shown */
  real *elapsed;    /* and kept */
  int64_t *steps;   /* in this episode */
  int64_t *stalled; /* steps in a row that did not advance it */
} dl2c_clocks;

/*
 * Counts a step of lane i of this duration, if it has moved. An episode stalls when its time no
 * longer advances: at a Zeno point durations are lost in rounding before they are zero, if they
 * ever are.
 */
DL2C_INLINE void dl2c_count(const dl2c_clocks *clocks, int64_t i, bool moved, real duration)
{
  const real before = clocks->elapsed[i];
  const real after = before + duration;
  const int64_t all = -(int64_t)moved;
  const int64_t stalled = clocks->stalled[i];
  const int64_t still = (stalled + 1) & -(int64_t)!(after > before);
  clocks->duration[i] = dl2c_select(moved, duration, clocks->duration[i]);
  clocks->time[i] = dl2c_select(moved, after, clocks->time[i]);
  clocks->elapsed[i] = dl2c_select(moved, after, before);
  clocks->stalled[i] = stalled ^ ((stalled ^ still) & all);
  clocks->steps[i] -= all;
}

/*
 * Assignments and flow of every lane, in place; lanes with an exception do not move. Whether a
 * lane moves is first computed in words as wide as its numbers (see model_guards).
 *   x: (NX, stride)   p: (NP, stride)   path: (count) -1 for lanes that may not move
 *   inputs: (count, NINPUT)
 */
DL2C_INLINE void dl2c_move_lanes(real *x, const real *p, int64_t stride, int64_t count,
                                 const int64_t *path, const real *inputs,
                                 const dl2c_clocks *clocks, uint8_t *moved)
{
  int64_t flags[DL2C_BLOCK];
  real times[DL2C_BLOCK];
  real starts[DL2C_FEW_PATHS ? 1 : NX][DL2C_BLOCK];
  if (!DL2C_FEW_PATHS) dl2c_decide_each(x, p, stride, count, path, inputs, starts, flags);
  DL2C_ALIAS_FREE
  for (int64_t i = 0; i < count; i++) {
    real own[NX];
    real start[NX];
    real end[NX];
    real constants[NP + 1];
    dl2c_read_lane(x, p, stride, i, own, constants);
#if DL2C_FEW_PATHS
    bool well = dl2c_decide_lane(path[i], own, constants, inputs + i * NINPUT, start);
#else
    bool well = flags[i] != 0;
    DL2C_UNROLL
    for (int k = 0; k < NX; k++) start[k] = starts[k][i];
#endif
    real time = 0.0;
#if DL2C_LANE_FLOW == DL2C_NO_FLOW
    DL2C_UNROLL
    for (int k = 0; k < NX; k++) end[k] = start[k];
#else
    well &= model_motion(DL2C_LANE_FLOW, start, constants, end, &time) == DL2C_ARRIVED;
    well &= model_keeps_watches(DL2C_LANE_FLOW, start, constants, time, end);
#endif
    DL2C_UNROLL
    for (int k = 0; k < NX; k++) x[k * stride + i] = dl2c_select(well, end[k], own[k]);
    times[i] = time;
    flags[i] = well;
  }
  DL2C_ALIAS_FREE
  for (int64_t i = 0; i < count; i++) dl2c_count(clocks, i, flags[i] != 0, times[i]);
  for (int64_t i = 0; i < count; i++) moved[i] = (uint8_t)flags[i];
}

/* The alternatives that the lanes took, the request where a decision was not met. */
DL2C_INLINE void dl2c_decided_lanes(const int64_t *restrict path, int64_t count,
                                    const int32_t *restrict choices, int32_t *restrict decided)
{
  for (int64_t i = 0; i < count; i++) {
    const int32_t taken = (int32_t)path[i];
    DL2C_UNROLL
    for (int c = 0; c < NCHOICE; c++) {
      int32_t chosen = choices[i * NCHOICE + c];
      if (!DL2C_FEW_PATHS && taken >= 0 && DECISIONS[taken][c] >= 0) chosen = DECISIONS[taken][c];
      DL2C_UNROLL_PATHS
      for (int k = 0; DL2C_FEW_PATHS && k < NPATH; k++)
        if (DECISIONS[k][c] >= 0) chosen = dl2c_pick(taken == k, DECISIONS[k][c], chosen);
      decided[i * NCHOICE + c] = chosen;
    }
  }
}

#endif
