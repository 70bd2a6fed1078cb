/* SPDX-License-Identifier: MIT-0 */
/* state.h -- what a batch keeps of its environments, and how their episodes begin. */
#ifndef DL2C_STATE_H
#define DL2C_STATE_H

#include "ahead.h"
#include "lanes.h"
#include "target.h"

struct dl2c_batch {
  int64_t n;
  dl2c_options options;
  dl2c_buffers out;
  int64_t stride;    /* from one variable to the next in the arrays below */
  real *x;           /* (NX, stride) */
  real *p;           /* (NP, stride) */
  uint8_t *enabled;  /* (paths of point 0, stride) open paths in the present state */
  uint8_t *ended;    /* (n) the episode is over and waits for a reset */
  uint64_t *seed;    /* (n) */
  uint64_t *episode; /* (n) episodes begun since the seed was given */
  int64_t *steps;    /* (n) in this episode */
  real *elapsed;     /* (n) time in this episode */
  int64_t *stalled;  /* (n) steps in a row that did not advance `elapsed` */
  struct dl2c_solver *solver; /* NULL where no flow needs one */
  struct dl2c_team *team;     /* threads beside the caller's, NULL for none */
  dl2c_rng *rng;     /* (n) what the environment decides, only where it does */
  dl2c_start *start; /* (n) likewise */
  uint8_t *scalar_steps;     /*
   * (blocks) steps before the active set is tried again, see dl2c_move_together
   */
  dl2c_obs *fixed;   /* (n, NFIXED) the last entries of observations: constants of the episode */
  uint8_t *clipped;  /* (n) one of these lies outside its bounds */
  uint8_t *seen;     /* (n, NMASK) alternatives of open runs, only where masks look ahead */
#if DL2C_INSPECT
  dl2c_followed *followed; /* (n, DL2C_INSPECT_FLOWS) flows of the last step, */
  int32_t *nfollowed;      /* (n) and how many they are */
#endif
};

#define DL2C_NSTART (POINT_START[1])

enum { NVARYING = NOBS - NFIXED }; /* entries of observations that a step may change */

/*
 * An odd number of cache lines from row to row: with a power of two the values of one environment
 * would compete for the same cache sets.
 */
static int64_t dl2c_stride(int64_t n)
{
  enum { LINE = DL2C_CACHE_LINE / sizeof(real) };
  const int64_t lines = (n + LINE - 1) / LINE;
  return n == 1 ? 1 : (lines | 1) * LINE;
}

static void dl2c_load(const dl2c_batch *b, int64_t i, real *x, real *p)
{
  dl2c_read_lane(b->x, b->p, b->stride, i, x, p);
}

/* Constants of a model with those derived from them.   given: (NCONSTANT)   p: (NP) */
static inline void dl2c_complete_constants(const real *given, real *p)
{
  for (int k = 0; k < NCONSTANT; k++) p[k] = given[k];
  model_derive(p);
}

static void dl2c_store(dl2c_batch *b, int64_t i, const real *x)
{
  for (int k = 0; k < NX; k++) b->x[k * b->stride + i] = x[k];
}

/* No step of environment i is behind where it is now. */
static inline void dl2c_forget(dl2c_batch *b, int64_t i)
{
#if DL2C_INSPECT
  b->nfollowed[i] = 0;
#else
  (void)b, (void)i;
#endif
}

/* Where the next step of environment i starts. */
static void dl2c_stand(const dl2c_batch *b, int64_t i, dl2c_trial *trial, real *p)
{
  real x[NX];
  dl2c_load(b, i, x, p);
  dl2c_begin_run(trial, 0, x);
  if (NSTEPDRAW > 0) *trial = b->start[i].trial;
  memcpy(trial->x, x, sizeof x);
}

/* Which paths of environment i have a run as far as masks look, and what they decide. */
DL2C_OPTIONAL void dl2c_look_from(dl2c_batch *b, int64_t i)
{
  dl2c_trial trial;
  real p[NP + 1];
  uint8_t enabled[NPATH];
  uint8_t *seen = b->seen + i * NMASK;
  const bool closed = NSTEPDRAW > 0 && b->start[i].closed;
  dl2c_stand(b, i, &trial, p);
  dl2c_open(&trial, p, enabled);
  const dl2c_request ask = {.p = p, .solver = b->solver};
  memset(seen, 0, NMASK);
  for (int k = 0; k < DL2C_NSTART; k++) {
    b->enabled[k * b->stride + i] = 0;
    if (closed || !enabled[k]) continue;
    uint8_t only[NPATH] = {0};
    dl2c_trial ahead = trial;
    only[k] = 1;
    b->enabled[k * b->stride + i] = dl2c_look(&ask, &ahead, false, only, seen);
  }
}

/* Which paths of point 0 are open in environments `first` to `first + count`. */
DL2C_INLINE void dl2c_open_lanes(dl2c_batch *b, int64_t first, int64_t count)
{
  if (DL2C_LOOKS_AHEAD)
    for (int64_t i = 0; i < count; i++) dl2c_look_from(b, first + i);
  else
    dl2c_enabled(0, b->x + first, b->p + first, b->stride, count, b->enabled + first);
}

/* Whether some path is open in each environment.   enabled: (paths, stride)   some: (count) */
DL2C_INLINE void dl2c_any_enabled(const uint8_t *restrict enabled, int64_t stride, int64_t count,
                                  uint8_t *restrict some)
{
  for (int64_t i = 0; i < count; i++) some[i] = 0;
  DL2C_UNROLL_PATHS
  for (int k = 0; k < DL2C_NSTART; k++)
    for (int64_t i = 0; i < count; i++) some[i] |= enabled[k * stride + i];
}

/* The mask of an environment whose masks look ahead.   seen, mask: (NMASK) */
static inline void dl2c_mask(const uint8_t *seen, bool final, int8_t *mask)
{
  for (int c = 0; c < NCHOICE; c++) {
    bool met = false;
    for (int a = MASK_START[c]; a < MASK_START[c + 1]; a++) met |= seen[a] != 0;
    for (int a = MASK_START[c]; a < MASK_START[c + 1]; a++) mask[a] = final || !met || seen[a];
  }
}

/*
 * Masks: an alternative is open if an open path takes it; all are where no open path meets their
 * decision, and in a final state. First a row for each alternative, then one for each environment.
 * enabled: (paths, stride) seen, mask: (count, NMASK)
 */
DL2C_INLINE void dl2c_masks(int64_t count, const uint8_t *restrict enabled, int64_t stride,
                            const uint8_t *restrict final, const uint8_t *restrict seen,
                            int8_t *restrict mask)
{
  if (DL2C_LOOKS_AHEAD) {
    for (int64_t i = 0; i < count; i++) dl2c_mask(seen + i * NMASK, final[i], mask + i * NMASK);
    return;
  }
  int8_t rows[NMASK + 1][DL2C_BLOCK];
  int8_t met[DL2C_BLOCK];
  DL2C_UNROLL
  for (int c = 0; c < NCHOICE; c++) {
    for (int64_t i = 0; i < count; i++) met[i] = 0;
    DL2C_UNROLL_PATHS
    for (int32_t a = MASK_START[c]; a < MASK_START[c + 1]; a++)
      for (int64_t i = 0; i < count; i++) rows[a][i] = 0;
    DL2C_UNROLL_PATHS
    for (int k = 0; k < DL2C_NSTART; k++) {
      if (DECISIONS[k][c] < 0) continue;
      int8_t *row = rows[MASK_START[c] + DECISIONS[k][c]];
      for (int64_t i = 0; i < count; i++) row[i] |= (int8_t)(enabled[k * stride + i] & !final[i]);
      for (int64_t i = 0; i < count; i++) met[i] |= row[i];
    }
    DL2C_UNROLL_PATHS
    for (int32_t a = MASK_START[c]; a < MASK_START[c + 1]; a++)
      for (int64_t i = 0; i < count; i++) rows[a][i] |= !met[i];
  }
  for (int64_t i = 0; i < count; i++) {
    DL2C_UNROLL
    for (int a = 0; a < NMASK; a++) mask[i * NMASK + a] = rows[a][i];
  }
}

/* Shows the state that environment i is in, with its constants; the next step starts there. */
static void dl2c_show(dl2c_batch *b, int64_t i)
{
  dl2c_obs *obs = (dl2c_obs *)b->out.obs + i * NOBS;
  dl2c_open_lanes(b, i, 1);
  model_observe(b->x + i, b->p + i, b->stride, 1, 1, obs, b->out.saturated + i);
  model_observe_constants(b->p + i, b->stride, 1, 1, b->fixed + i * NFIXED, b->clipped + i);
  memcpy(obs + NVARYING, b->fixed + i * NFIXED, sizeof(dl2c_obs) * NFIXED);
  b->out.saturated[i] |= b->clipped[i];
  dl2c_masks(1, b->enabled + i, b->stride, b->ended + i, b->seen + i * NMASK, b->out.mask + i * NMASK);
}

/* Judges the postcondition where environment i is. */
static void dl2c_show_postcondition(dl2c_batch *b, int64_t i)
{
  uint8_t facts[NFACT];
  model_facts(b->x + i, b->p + i, b->stride, 1, 1, facts);
  b->out.postcondition[i] = facts[F_postcondition];
}

/* An episode of environment i begins. */
static inline void dl2c_start_clocks(dl2c_batch *b, int64_t i)
{
  dl2c_forget(b, i);
  b->ended[i] = 0;
  b->steps[i] = 0;
  b->stalled[i] = 0;
  b->elapsed[i] = 0.0;
  b->out.reset[i] = 1;
}

/*
 * Begins an episode in the state given: executes what stands before the loop, then the leading
 * statements of the first step. False, and no change, if one of them or the step has no run.
 */
static bool dl2c_begin(dl2c_batch *b, int64_t i, dl2c_rng *rng, const real *x, const real *p)
{
  real before[NX];
  memcpy(before, x, sizeof before);
  dl2c_start start;
  if (!dl2c_prefix(b->solver, rng, p, before)) return false;
  dl2c_lead(b->solver, rng, before, p, &start);
  const dl2c_request request = {.p = p, .solver = b->solver};
  if (start.closed || !dl2c_starts(&request, &start.trial)) return false;

  for (int k = 0; k < NP; k++) b->p[k * b->stride + i] = p[k];
  dl2c_store(b, i, before);
  dl2c_show_postcondition(b, i);
  dl2c_store(b, i, start.trial.x);
  if (NSTEPDRAW > 0) {
    b->rng[i] = *rng;
    b->start[i] = start;
  }
  dl2c_start_clocks(b, i);
  b->out.time[i] = 0.0;
  dl2c_show(b, i);
  return true;
}

/* Draws initial states until one has a run. */
static dl2c_status dl2c_reset_one(dl2c_batch *b, int64_t i)
{
  real x[NX] = {0.0};
  real p[NP + 1] = {0.0};
  dl2c_rng rng = dl2c_rng_make(b->seed[i], b->episode[i]++);
  for (int tries = 0; tries < DL2C_MAX_DEADLOCKS; tries++) {
    if (!dl2c_sample(&rng, x, p)) return DL2C_ERR_RESET;
    if (dl2c_begin(b, i, &rng, x, p)) return DL2C_OK;
  }
  return DL2C_ERR_BLOCKED;
}

#endif
