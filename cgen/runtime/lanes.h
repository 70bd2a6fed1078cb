/* SPDX-License-Identifier: MIT-0 */
/*
 * lanes.h -- a step of many environments at once, for models whose step has no inputs and one flow.
 *
 * Every lane chooses its path and moves along the flow by selection, without branches;
 * lanes that meet something out of the ordinary are left to the scalar step, which
 * computes the same bits.
 */
#ifndef DL2C_LANES_H
#define DL2C_LANES_H

#include "step.h"

/* What the lanes of a block did. Rows of `state` are DL2C_BLOCK apart. */
typedef struct dl2c_moves {
  int64_t path[DL2C_BLOCK];      /* the path taken, -1 for none */
  uint8_t requested[DL2C_BLOCK]; /* it is the one requested */
  uint8_t settled[DL2C_BLOCK];   /* state and duration are the result */
  real duration[DL2C_BLOCK];
  real state[NX * DL2C_BLOCK];
} dl2c_moves;

/* The path that each lane prefers (see dl2c_preferred).   enabled: (paths, stride)   choices: (count, NCHOICE) */
DL2C_INLINE void dl2c_choose_lanes(const uint8_t *restrict enabled, int64_t stride, int64_t count,
                                   const int32_t *restrict choices, int64_t *restrict path,
                                   uint8_t *restrict requested)
{
  for (int64_t i = 0; i < count; i++) {
    int64_t best = -1;
    int64_t best_rank = -1;
    DL2C_UNROLL
    for (int k = 0; k < NPATH; k++) {
      int64_t agreed = 0;
      int64_t rank = 0;
      bool whole = true;
      DL2C_UNROLL
      for (int j = 0; j < PATHS[k].nmet; j++) {
        const bool same = DECISIONS[k][PATHS[k].met[j]] == choices[i * NCHOICE + PATHS[k].met[j]];
        rank = (whole & !same) ? 2 * agreed + PATHS[k].marked[j] : rank;
        whole &= same;
        agreed += whole;
      }
      rank = whole ? 2 * NCHOICE + 2 : rank;
      const bool better = (enabled[k * stride + i] != 0) & (rank > best_rank);
      best = better ? k : best;
      best_rank = better ? rank : best_rank;
    }
    path[i] = best;
    requested[i] = best_rank == 2 * NCHOICE + 2;
  }
}

/*
 * Assignments and flow of every lane; whether it is settled first as wide as the numbers that decide
 * it (see model_guards).   x: (NX, stride)   p: (NP, stride)   state: (NX, DL2C_BLOCK)
 */
DL2C_INLINE void dl2c_move_lanes(const real *restrict x, const real *restrict p, int64_t stride,
                                 int64_t count, const int64_t *restrict path, real *restrict state,
                                 real *restrict duration, uint8_t *restrict settled)
{
  int64_t flags[DL2C_BLOCK];
  for (int64_t i = 0; i < count; i++) {
    real own[NX];
    real start[NX];
    real end[NX];
    real constants[NP + 1];
    DL2C_UNROLL
    for (int k = 0; k < NX; k++) own[k] = start[k] = x[k * stride + i];
    DL2C_UNROLL
    for (int k = 0; k < NP; k++) constants[k] = p[k * stride + i];
    bool well = model_assign(path[i], own, constants, start) & (path[i] >= 0);
    well &= dl2c_all_finite(start, NX);
    real time = 0.0;
#if DL2C_LANE_FLOW == DL2C_NO_FLOW
    DL2C_UNROLL
    for (int k = 0; k < NX; k++) end[k] = start[k];
#else
    well &= model_motion(DL2C_LANE_FLOW, start, constants, end, &time) == DL2C_SETTLED;
    well &= model_quiet(DL2C_LANE_FLOW, start, constants, time, end);
#endif
    DL2C_UNROLL
    for (int k = 0; k < NX; k++) state[k * DL2C_BLOCK + i] = end[k];
    duration[i] = time;
    flags[i] = well;
  }
  for (int64_t i = 0; i < count; i++) settled[i] = (uint8_t)flags[i];
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
      DL2C_UNROLL
      for (int k = 0; k < NPATH; k++)
        if (DECISIONS[k][c] >= 0) chosen = dl2c_pick(taken == k, DECISIONS[k][c], chosen);
      decided[i * NCHOICE + c] = chosen;
    }
  }
}

#endif
