/* SPDX-License-Identifier: MIT-0 */
/* ahead.h -- runs beyond the head of a while loop, and what happens before the agent decides. */
#ifndef DL2C_AHEAD_H
#define DL2C_AHEAD_H

#include "rng.h"
#include "step.h"

/* Marks the alternatives of the agent on a run that goes on along a path.   seen: (NMASK) */
static inline void dl2c_see(const dl2c_trial *trial, int path, uint8_t *seen)
{
  for (int c = 0; c < NCHOICE; c++) {
    const int taken = DECISIONS[path][c] >= 0 ? DECISIONS[path][c] : trial->taken[c];
    if (taken >= 0) seen[MASK_START[c] + taken] = 1;
  }
}

/* Whether a path decides by chance what the run has not decided yet. */
static inline bool dl2c_draws(const dl2c_trial *trial, int path)
{
  bool found = false;
  for (int j = 0; NDECISION > NCHOICE && j < PATHS[path].nmet; j++)
    found |= PATHS[path].met[j] >= NCHOICE && trial->taken[PATHS[path].met[j]] < 0;
  return found;
}

/*
 * Whether a run that goes on along a path counts as open without being followed: beyond its end, a
 * new input, and a flow, unless masks are deep and chance has decided nothing on the way, nor how long
 * the flow lasts.
 */
static inline bool dl2c_surely(const dl2c_trial *trial, int path, bool drawn)
{
  const bool flows = PATHS[path].flow != DL2C_NO_FLOW;
  const bool chance = drawn || (flows && FLOW_DRAW[PATHS[path].flow] >= 0);
  bool sure = PATHS[path].next == DL2C_END || (flows && (!DL2C_LOOKS_DEEP || chance));
  for (int j = 0; NU > 0 && j < PATHS[path].ninput; j++)
    sure |= !trial->given[PATHS[path].inputs[j].input];
  return sure;
}

/*
 * Whether some run passes every test up to its first flow, or where masks are deep up to its end;
 * marks what such runs decide. A run is not followed beyond a while loop that a new input may have
 * decided, nor without end.
 *   ask: constants and solver   drawn: chance has decided something in the run
 *   enabled: (NPATH) open paths of the point where the run stands, used up   seen: (NMASK)
 */
DL2C_OPTIONAL bool dl2c_look(const dl2c_request *ask, dl2c_trial *trial, bool drawn, uint8_t *enabled,
                             uint8_t *seen)
{
  bool found = false;
  for (;;) {
    const int first = POINT_START[trial->point];
    const int end = POINT_START[trial->point + 1];
    int open = 0;
    for (int k = first; k < end; k++) open += enabled[k - first];
    bool goes_on = false;
    for (int k = first; k < end && !goes_on; k++) {
      if (!enabled[k - first]) continue;
      const bool chance = drawn || dl2c_draws(trial, k);
      const bool sure = dl2c_surely(trial, k, chance);
      if (sure) {
        dl2c_see(trial, k, seen);
        found = true;
        continue;
      }
      dl2c_trial ahead = *trial;
      dl2c_follow(ask, &ahead, k);
      if (ahead.failure != DL2C_SOUND) {
        dl2c_see(trial, k, seen);
        found = true;
      } else if (open == 1) {
        *trial = ahead;
        drawn = chance;
        goes_on = true;
      } else {
        uint8_t next[NPATH];
        dl2c_open(&ahead, ask->p, next);
        found |= dl2c_look(ask, &ahead, chance, next, seen);
      }
    }
    if (!goes_on) return found;
    dl2c_open(trial, ask->p, enabled);
  }
}

/* What is drawn for a step, and what its leading statements led to. */
typedef struct dl2c_start {
  bool closed; /* they have no run */
  dl2c_trial trial;
  real draws[NSTEPDRAW + 1];
} dl2c_start;

/*
 * Whether a step has a run from where its leading statements led to. The first open path that need not be
 * followed is enough.
 */
static bool dl2c_starts(const dl2c_request *request, const dl2c_trial *trial)
{
  uint8_t enabled[NPATH];
  uint8_t seen[NMASK + 1];
  dl2c_trial ahead = *trial;
  ahead.point = 0;
  model_guards(0, ahead.x, request->p, 1, 1, enabled);
  for (int k = 0; k < POINT_START[1]; k++) {
    enabled[k] = enabled[k] && dl2c_is_open(&ahead, request->p, k);
    if (enabled[k] && (!DL2C_LOOKS_AHEAD || dl2c_surely(&ahead, k, dl2c_draws(&ahead, k)))) return true;
  }
  const dl2c_request ask = {.p = request->p, .solver = request->solver};
  return DL2C_LOOKS_AHEAD && dl2c_look(&ask, &ahead, false, enabled, seen);
}

/* Draws for a step and executes its leading statements. */
static void dl2c_lead(struct dl2c_solver *solver, dl2c_rng *rng, const real *x, const real *p,
                      dl2c_start *start)
{
  for (int k = 0; k < NSTEPDRAW; k++) start->draws[k] = dl2c_rng_unit(rng);
  dl2c_begin_run(&start->trial, DL2C_POINT_LEAD, x);
  start->closed = false;
  if (DL2C_POINT_LEAD > 0) {
    const dl2c_request request = {.p = p, .draws = start->draws, .solver = solver};
    uint8_t enabled[NPATH];
    dl2c_trial trial = start->trial;
    dl2c_open(&trial, p, enabled);
    start->closed =
        !dl2c_complete(&request, &trial, enabled, dl2c_starts) || trial.failure != DL2C_SOUND;
    if (!start->closed) start->trial = trial;
  }
  start->trial.point = 0;
  start->trial.entered = 0;
}

/* Executes the program before the loop; false if it has no run. */
static bool dl2c_prefix(struct dl2c_solver *solver, dl2c_rng *rng, const real *p, real *x)
{
  if (DL2C_POINT_PREFIX == 0) return true;
  real draws[NDRAW + 1];
  for (int k = NSTEPDRAW; k < NDRAW; k++) draws[k] = dl2c_rng_unit(rng);
  const dl2c_request request = {.p = p, .draws = draws, .solver = solver};
  uint8_t enabled[NPATH];
  dl2c_trial trial;
  dl2c_begin_run(&trial, DL2C_POINT_PREFIX, x);
  memset(trial.watch, DL2C_MET, sizeof trial.watch); /* nothing is watched before the first step */
  dl2c_open(&trial, p, enabled);
  if (!dl2c_complete(&request, &trial, enabled, NULL) || trial.failure != DL2C_SOUND) return false;
  memcpy(x, trial.x, sizeof trial.x);
  return true;
}

#endif
