/* batch.h -- n environments in flat arrays, and the calls of dl2c.h. Compiled with one model. */
#ifndef DL2C_BATCH_H
#define DL2C_BATCH_H

#include <stdlib.h>

#include "sampler.h"
#include "step.h"

struct dl2c_batch {
  int64_t n;
  dl2c_options options;
  dl2c_buffers out;
  real *x;           /* (NX, n) */
  real *p;           /* (NP, n) */
  uint8_t *enabled;  /* (n, paths of point 0) open paths in the present state */
  uint8_t *ended;    /* (n) the episode is over and waits for a reset */
  uint64_t *seed;    /* (n) */
  uint64_t *episode; /* (n) episodes begun since the seed was given */
  int64_t *steps;    /* (n) in this episode */
  real *elapsed;     /* (n) time in this episode */
  int64_t *stalled;  /* (n) zero-duration steps in a row */
};

#define DL2C_NSTART (POINT_START[1])

static void dl2c_load(const dl2c_batch *b, int64_t i, real *x, real *p)
{
  for (int k = 0; k < NX; k++) x[k] = b->x[k * b->n + i];
  for (int k = 0; k < NP; k++) p[k] = b->p[k * b->n + i];
}

static void dl2c_store(dl2c_batch *b, int64_t i, const real *x)
{
  for (int k = 0; k < NX; k++) b->x[k * b->n + i] = x[k];
}

/* Writes observation, Q and mask of a state. A final state shows every alternative as open. */
static inline void dl2c_show(dl2c_batch *b, int64_t i, const real *x, const real *p, bool final)
{
  uint8_t saturated = 0;
  model_observe(x, p, (dl2c_obs *)b->out.obs + i * NOBS, &saturated);
  b->out.saturated[i] = saturated;
  b->out.postcondition[i] = model_postcondition(x, p);

  int8_t *mask = b->out.mask + i * NMASK;
  const uint8_t *enabled = b->enabled + i * DL2C_NSTART;
  for (int c = 0; c < NCHOICE; c++) {
    bool met = false;
    for (int32_t a = MASK_START[c]; a < MASK_START[c + 1]; a++) mask[a] = 0;
    for (int k = 0; k < DL2C_NSTART && !final; k++)
      if (enabled[k] && DECISIONS[k][c] >= 0) {
        mask[MASK_START[c] + DECISIONS[k][c]] = 1;
        met = true;
      }
    if (!met)
      for (int32_t a = MASK_START[c]; a < MASK_START[c + 1]; a++) mask[a] = 1;
  }
}

static bool dl2c_any_enabled(const uint8_t *enabled)
{
  for (int k = 0; k < DL2C_NSTART; k++)
    if (enabled[k]) return true;
  return false;
}

/* Begins an episode in the state given. */
static void dl2c_begin(dl2c_batch *b, int64_t i, const real *x, const real *p)
{
  for (int k = 0; k < NP; k++) b->p[k * b->n + i] = p[k];
  dl2c_store(b, i, x);
  b->ended[i] = 0;
  b->steps[i] = 0;
  b->stalled[i] = 0;
  b->out.reset[i] = 1;
  b->elapsed[i] = 0.0;
  b->out.time[i] = 0.0;
  dl2c_show(b, i, x, p, false);
}

/* Draws initial states until one has a run. */
static dl2c_status dl2c_reset_one(dl2c_batch *b, int64_t i)
{
  real x[NX];
  real p[NP + 1];
  dl2c_rng rng = dl2c_rng_make(b->seed[i], b->episode[i]++);
  for (int tries = 0; tries < DL2C_MAX_DEADLOCKS; tries++) {
    if (!dl2c_sample(&rng, x, p)) return DL2C_ERR_RESET;
    dl2c_enabled(0, x, p, b->enabled + i * DL2C_NSTART);
    if (dl2c_any_enabled(b->enabled + i * DL2C_NSTART)) {
      dl2c_begin(b, i, x, p);
      return DL2C_OK;
    }
  }
  return DL2C_ERR_RESET;
}

/* Results of a call that only began an episode. */
static void dl2c_clear_results(dl2c_batch *b, int64_t i)
{
  for (int c = 0; c < NCHOICE; c++)
    b->out.executed_choices[i * NCHOICE + c] = b->out.choices[i * NCHOICE + c];
  for (int j = 0; j < NU; j++) b->out.executed_inputs[i * NU + j] = b->out.inputs[i * NU + j];
  b->out.rewards[i] = 0.0;
  b->out.terminated[i] = 0;
  b->out.truncated[i] = 0;
  b->out.status[i] = DL2C_NONE;
  b->out.reason[i] = DL2C_REASON_NONE;
  b->out.cost[i] = 0;
  b->out.blocked[i] = 0;
  b->out.duration[i] = 0.0;
}

/* How the step ends the episode, if it does; a predicate's ending goes before all others. */
static void dl2c_conclude(dl2c_batch *b, int64_t i, const dl2c_run *run, bool moved, bool open,
                          dl2c_judgement *judged)
{
  const bool stalled = b->options.stall_limit > 0 && b->stalled[i] >= b->options.stall_limit;
  const bool late = b->options.max_steps > 0 && b->steps[i] >= b->options.max_steps;

  if (!moved || run->numerical) {
    const bool terminates = !moved && b->options.on_blocked == DL2C_BLOCKED_TERMINATE;
    judged->end = terminates ? DL2C_TERMINATE : DL2C_TRUNCATE;
    judged->status = DL2C_NONE;
    judged->reason = run->numerical ? DL2C_REASON_NUMERICAL
        : b->options.on_blocked == DL2C_BLOCKED_FALLBACK ? DL2C_REASON_DEADLOCK
                                                         : DL2C_REASON_BLOCKED;
    return;
  }
  if (judged->end != DL2C_GOES_ON) return;
  judged->end = DL2C_TRUNCATE;
  if (judged->undefined) {
    judged->reason = DL2C_REASON_NUMERICAL;
  } else if (!DL2C_LOOPS) {
    judged->end = DL2C_TERMINATE;
    judged->reason = DL2C_REASON_END;
  } else if (!open) {
    judged->reason = DL2C_REASON_DEADLOCK;
  } else if (stalled) {
    judged->reason = DL2C_REASON_STALLED;
  } else if (late) {
    judged->reason = DL2C_REASON_TIME_LIMIT;
  } else {
    judged->end = DL2C_GOES_ON;
    return;
  }
  judged->status = DL2C_NONE;
}

static void dl2c_step_one(dl2c_batch *b, int64_t i)
{
  real x[NX];
  real p[NP + 1];
  dl2c_load(b, i, x, p);

  dl2c_clear_results(b, i);
  b->out.reset[i] = 0;
  dl2c_run run = {
    .choices = b->out.choices + i * NCHOICE,
    .inputs = b->out.inputs + i * NU,
    .p = p,
    .map = b->options.action_map,
    .request_only = b->options.on_blocked != DL2C_BLOCKED_FALLBACK,
    .decided = b->out.executed_choices + i * NCHOICE,
    .executed = b->out.executed_inputs + i * NU,
  };
  uint8_t *enabled = b->enabled + i * DL2C_NSTART;
  real y[NX];
  memcpy(y, x, sizeof y);
  const bool moved = dl2c_complete(&run, 0, enabled, false, y);
  if (moved && !run.numerical) {
    memcpy(x, y, sizeof x);
    dl2c_store(b, i, x);
    b->out.duration[i] = run.duration;
    b->elapsed[i] += run.duration;
  }

  dl2c_enabled(0, x, p, enabled);
  b->steps[i] += 1;
  b->stalled[i] = b->out.duration[i] > 0.0 ? 0 : b->stalled[i] + 1;
  dl2c_judgement judged;
  model_judge(x, p, &judged);
  dl2c_conclude(b, i, &run, moved, dl2c_any_enabled(enabled), &judged);

  const bool blocked = run.blocked || !moved;
  b->out.time[i] = b->elapsed[i];
  b->out.blocked[i] = blocked;
  b->out.rewards[i] = judged.reward + (blocked ? b->options.blocked_penalty : 0.0);
  b->out.cost[i] = judged.cost;
  b->out.status[i] = judged.status;
  b->out.reason[i] = judged.reason;
  b->out.terminated[i] = judged.end == DL2C_TERMINATE;
  b->out.truncated[i] = judged.end == DL2C_TRUNCATE;
  b->ended[i] = judged.end != DL2C_GOES_ON;
  dl2c_show(b, i, x, p, judged.end != DL2C_GOES_ON);
}

int32_t dl2c_abi_version(void) { return DL2C_ABI_VERSION; }
int32_t dl2c_stream_version(void) { return DL2C_STREAM_VERSION; }

void dl2c_model_sizes(dl2c_sizes *out)
{
  *out = (dl2c_sizes){
    .nx = NX,
    .np = NP,
    .nobs = NOBS,
    .nchoice = NCHOICE,
    .ninput = NU,
    .nmask = NMASK,
    .npred = NPRED,
    .obs_size = (int32_t)sizeof(dl2c_obs),
  };
}

dl2c_status dl2c_batch_create(int64_t n, const dl2c_options *options, const dl2c_buffers *buffers,
                              dl2c_batch **out)
{
  if (n <= 0 || options == NULL || buffers == NULL || out == NULL) return DL2C_ERR_ARG;
  dl2c_batch *b = calloc(1, sizeof *b);
  if (b == NULL) return DL2C_ERR_NOMEM;
  const size_t rows = (size_t)n;
  b->n = n;
  b->options = *options;
  b->out = *buffers;
  b->x = calloc(rows * (NX + 1), sizeof *b->x);
  b->p = calloc(rows * (NP + 1), sizeof *b->p);
  b->enabled = calloc(rows * ((size_t)DL2C_NSTART + 1), sizeof *b->enabled);
  b->ended = calloc(rows, sizeof *b->ended);
  b->seed = calloc(rows, sizeof *b->seed);
  b->episode = calloc(rows, sizeof *b->episode);
  b->steps = calloc(rows, sizeof *b->steps);
  b->elapsed = calloc(rows, sizeof *b->elapsed);
  b->stalled = calloc(rows, sizeof *b->stalled);
  if (!b->x || !b->p || !b->enabled || !b->ended || !b->seed || !b->episode || !b->steps
      || !b->elapsed || !b->stalled) {
    dl2c_batch_free(b);
    return DL2C_ERR_NOMEM;
  }
  *out = b;
  return DL2C_OK;
}

void dl2c_batch_free(dl2c_batch *b)
{
  if (b == NULL) return;
  free(b->x);
  free(b->p);
  free(b->enabled);
  free(b->ended);
  free(b->seed);
  free(b->episode);
  free(b->steps);
  free(b->elapsed);
  free(b->stalled);
  free(b);
}

static void dl2c_reseed(dl2c_batch *b, int64_t i, const uint64_t *seed)
{
  if (seed == NULL) return;
  b->seed[i] = *seed;
  b->episode[i] = 0;
}

dl2c_status dl2c_batch_reset(dl2c_batch *b, const uint8_t *mask, const uint64_t *seeds)
{
  if (b == NULL) return DL2C_ERR_ARG;
  for (int64_t i = 0; i < b->n; i++) {
    if (mask != NULL && !mask[i]) continue;
    dl2c_reseed(b, i, seeds == NULL ? NULL : &seeds[i]);
    dl2c_clear_results(b, i);
    const dl2c_status status = dl2c_reset_one(b, i);
    if (status != DL2C_OK) return status;
  }
  return DL2C_OK;
}

dl2c_status dl2c_batch_reset_to(dl2c_batch *b, int64_t i, const uint64_t *seed, const double *x,
                                const double *p)
{
  if (b == NULL || i < 0 || i >= b->n || x == NULL || p == NULL) return DL2C_ERR_ARG;
  uint8_t enabled[NPATH];
  if (!dl2c_all_finite(x, NX) || !model_precondition(x, p)) return DL2C_ERR_STATE;
  dl2c_enabled(0, x, p, enabled);
  if (!dl2c_any_enabled(enabled)) return DL2C_ERR_STATE;
  dl2c_reseed(b, i, seed);
  b->episode[i]++;
  memcpy(b->enabled + i * DL2C_NSTART, enabled, (size_t)DL2C_NSTART);
  dl2c_clear_results(b, i);
  dl2c_begin(b, i, x, p);
  return DL2C_OK;
}

dl2c_status dl2c_batch_step(dl2c_batch *b)
{
  if (b == NULL) return DL2C_ERR_ARG;
  for (int64_t i = 0; i < b->n; i++) {
    if (b->options.autoreset == DL2C_AUTORESET_NEXT_STEP && b->ended[i]) {
      dl2c_clear_results(b, i);
      const dl2c_status status = dl2c_reset_one(b, i);
      if (status != DL2C_OK) return status;
      continue;
    }
    dl2c_step_one(b, i);
    if (b->options.autoreset == DL2C_AUTORESET_SAME_STEP && b->ended[i]) {
      memcpy((dl2c_obs *)b->out.final_obs + i * NOBS, (dl2c_obs *)b->out.obs + i * NOBS,
             sizeof(dl2c_obs) * NOBS);
      const real ended_at = b->out.time[i];
      const uint8_t postcondition = b->out.postcondition[i];
      const uint8_t saturated = b->out.saturated[i];
      const dl2c_status status = dl2c_reset_one(b, i);
      if (status != DL2C_OK) return status;
      b->out.time[i] = ended_at;
      b->out.postcondition[i] = postcondition;
      b->out.saturated[i] = saturated;
    }
  }
  return DL2C_OK;
}

dl2c_status dl2c_batch_get_state(const dl2c_batch *b, int64_t i, double *x, double *p)
{
  if (b == NULL || i < 0 || i >= b->n || x == NULL || p == NULL) return DL2C_ERR_ARG;
  dl2c_load(b, i, x, p);
  return DL2C_OK;
}

dl2c_status dl2c_batch_set_state(dl2c_batch *b, int64_t i, const double *x, const double *p)
{
  if (b == NULL || i < 0 || i >= b->n || x == NULL || p == NULL) return DL2C_ERR_ARG;
  if (!dl2c_all_finite(x, NX)) return DL2C_ERR_STATE;
  dl2c_store(b, i, x);
  for (int k = 0; k < NP; k++) b->p[k * b->n + i] = p[k];
  b->ended[i] = 0;
  dl2c_enabled(0, x, p, b->enabled + i * DL2C_NSTART);
  dl2c_show(b, i, x, p, false);
  return DL2C_OK;
}

const char *dl2c_status_text(dl2c_status status)
{
  switch (status) {
    case DL2C_OK: return "ok";
    case DL2C_ERR_ARG: return "a null pointer or a size that is not positive";
    case DL2C_ERR_NOMEM: return "out of memory";
    case DL2C_ERR_RESET: return "no admissible initial state was found";
    case DL2C_ERR_STATE: return "the state violates the precondition, or no run is possible from it";
  }
  return "unknown status";
}

#endif
