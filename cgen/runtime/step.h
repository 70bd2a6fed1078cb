/* SPDX-License-Identifier: MIT-0 */
/* step.h -- one step of one environment: decide, move, judge. A step is a whole run or no change. */
#ifndef DL2C_STEP_H
#define DL2C_STEP_H

#include "actions.h"
#include "travel.h"

/* What a request led to. */
typedef struct dl2c_run {
  const int32_t *choices; /* (NCHOICE) requested */
  const real *inputs;     /* (NU) requested */
  const real *p;
  int32_t map;       /* dl2c_action_map */
  bool request_only; /* do not fall back to other alternatives */
  bool blocked;      /* the run taken is not the one requested */
  bool numerical;    /* it led to an undefined or infinite value */
  dl2c_motion motion; /* what became of its last flow */
  real duration;      /* time its flows took */
  uint8_t *watch;     /* (NWATCH) dl2c_watched so far */
  struct dl2c_solver *solver; /* NULL where no flow needs one */
  int32_t *decided;  /* (NCHOICE) alternatives taken, the request where none was met */
  real *executed;    /* (NU) inputs as the action space writes them */
} dl2c_run;

/*
 * The part of its longest duration that a flow takes, from 0 to 1; noted among the inputs in effect.
 * Always the whole where neither the agent nor chance decides on durations.
 */
static inline real dl2c_share(dl2c_run *run, int flow)
{
  const int input = FLOW_DURATION[flow];
  if (input < 0) return 1.0;
  const dl2c_range range = {false, 0.0, 1.0};
  return dl2c_resolve(run->map, range, run->inputs[input], &run->executed[input]);
}

/* Moves y along a flow and notes what happened on the way. False: the run came to nothing. */
static inline bool dl2c_evolve(dl2c_run *run, int flow, real *y, real *duration)
{
  dl2c_travel travel = {.p = run->p, .solver = run->solver, .part = dl2c_share(run, flow), .watch = run->watch};
  run->motion = dl2c_flow(flow, &travel, y);
  *duration = travel.duration;
  return run->motion == DL2C_SETTLED;
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
  return PATHS[path].flow == DL2C_NO_FLOW || dl2c_evolve(run, PATHS[path].flow, y, duration);
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
    uint8_t watched[NWATCH + 1];
    memcpy(watched, run->watch, NWATCH);
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
    if (PATHS[path].flow != DL2C_NO_FLOW && FLOW_DURATION[PATHS[path].flow] >= 0)
      run->executed[FLOW_DURATION[PATHS[path].flow]] = run->inputs[FLOW_DURATION[PATHS[path].flow]];
    memcpy(run->watch, watched, NWATCH);
  }
}

#endif
