/* SPDX-License-Identifier: MIT-0 */
/* step.h -- one step of one environment: decide, move, judge. A step is a whole run or no change. */
#ifndef DL2C_STEP_H
#define DL2C_STEP_H

#include "actions.h"

/* What a request led to. */
typedef struct dl2c_run {
  const int32_t *choices; /* (NCHOICE) requested */
  const real *inputs;     /* (NU) requested */
  const real *p;
  int32_t map;       /* dl2c_action_map */
  bool request_only; /* do not fall back to other alternatives */
  bool blocked;      /* the run taken is not the one requested */
  bool numerical;    /* it led to an undefined or infinite value */
  real duration;     /* time its flows took */
  int32_t *decided;  /* (NCHOICE) alternatives taken, the request where none was met */
  real *executed;    /* (NU) inputs as the action space writes them */
} dl2c_run;

/* Moves y along a flow. Where rounding left the domain, steps back until it holds. False: undefined. */
static inline bool dl2c_flow(int flow, const real *p, real *y, real *duration)
{
  real end[NX];
  const dl2c_motion motion = model_motion(flow, y, p, end, duration);
  if (motion == DL2C_OUTSIDE) {
    const real whole = *duration;
    real part = DL2C_RETREAT_FIRST;
    bool inside = false;
    for (int k = 0; k < DL2C_RETREATS && !inside; k++, part *= 4.0) {
      *duration = whole - whole * part;
      memcpy(end, y, sizeof end);
      inside = model_at(flow, y, p, *duration, end);
    }
    if (!inside) {
      memcpy(end, y, sizeof end);
      *duration = 0.0;
    }
  }
  if (motion != DL2C_UNDEFINED) memcpy(y, end, sizeof end);
  return motion != DL2C_UNDEFINED;
}

/* Executes one path from x into y: inputs, assignments, flow. False: a value is undefined. */
static inline bool dl2c_follow(dl2c_run *run, int path, const real *x, real *y, real *duration)
{
  real u[NU + 1];
  for (int j = 0; j < PATHS[path].ninput; j++) {
    const int input = PATHS[path].inputs[j];
    const dl2c_range range = dl2c_admissible(path, input, x, run->p);
    u[input] = dl2c_resolve(run->map, range, run->inputs[input], &run->executed[input]);
  }
  *duration = 0.0;
  memcpy(y, x, sizeof(real) * NX);
  if (!model_update(path, x, run->p, u, y) || !dl2c_all_finite(y, NX)) return false;
  return PATHS[path].flow == DL2C_NO_FLOW || dl2c_flow(PATHS[path].flow, run->p, y, duration);
}

/*
 * Completes a step from a point, trying its open paths in order of preference and
 * returning to them when a later test fails. x holds the state at the point, and on
 * success the state after the step.
 *   enabled: (paths of the point), used up
 */
static bool dl2c_complete(dl2c_run *run, int point, uint8_t *enabled, bool left, real *x)
{
  for (;;) {
    bool as_requested;
    const int path = dl2c_preferred(point, enabled, run->choices, left, &as_requested);
    if (path < 0 || (run->request_only && !as_requested)) return false;
    enabled[path - POINT_START[point]] = 0;

    real y[NX];
    real duration;
    run->numerical = !dl2c_follow(run, path, x, y, &duration);
    bool done = run->numerical || PATHS[path].target == DL2C_END;
    if (NPOINT > 1 && !done) {
      uint8_t next[NPATH];
      dl2c_enabled(PATHS[path].target, y, run->p, 1, 1, next);
      done = dl2c_complete(run, PATHS[path].target, next, left || !as_requested, y);
    } else {
      run->blocked = left || !as_requested;
    }
    if (done) {
      run->duration += duration;
      for (int c = 0; c < NCHOICE; c++)
        if (DECISIONS[path][c] >= 0) run->decided[c] = DECISIONS[path][c];
      memcpy(x, y, sizeof y);
      return true;
    }
    for (int j = 0; j < PATHS[path].ninput; j++)
      run->executed[PATHS[path].inputs[j]] = run->inputs[PATHS[path].inputs[j]];
  }
}

#endif
