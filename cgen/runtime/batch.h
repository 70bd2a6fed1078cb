/* batch.h -- n environments in flat arrays, and the calls of dl2c.h. Compiled with one model. */
#ifndef DL2C_BATCH_H
#define DL2C_BATCH_H

#include <stdlib.h>

#include "lanes.h"
#include "sampler.h"

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
  int64_t *stalled;  /* (n) zero-duration steps in a row */
};

#define DL2C_NSTART (POINT_START[1])

/*
 * An odd number of cache lines from row to row: with a power of two the values of one
 * environment would compete for the same few places in the cache.
 */
static int64_t dl2c_stride(int64_t n)
{
  enum { LINE = 8 };
  const int64_t lines = (n + LINE - 1) / LINE;
  return n == 1 ? 1 : (lines | 1) * LINE;
}

static void dl2c_load(const dl2c_batch *b, int64_t i, real *x, real *p)
{
  for (int k = 0; k < NX; k++) x[k] = b->x[k * b->stride + i];
  for (int k = 0; k < NP; k++) p[k] = b->p[k * b->stride + i];
}

static void dl2c_store(dl2c_batch *b, int64_t i, const real *x)
{
  for (int k = 0; k < NX; k++) b->x[k * b->stride + i] = x[k];
}

/* Tests the states of environments `first` to `first + count`: open paths, and facts of (NFACT, row). */
static inline void dl2c_test(dl2c_batch *b, int64_t first, int64_t count, int64_t row, uint8_t *facts)
{
  dl2c_enabled(0, b->x + first, b->p + first, b->stride, count, b->enabled + first);
  model_facts(b->x + first, b->p + first, b->stride, count, row, facts);
}

/* Whether some path is open in each environment.   open: (count) */
static inline void dl2c_any_enabled(const dl2c_batch *b, int64_t first, int64_t count, uint8_t *open)
{
  for (int64_t i = 0; i < count; i++) open[i] = 0;
  for (int k = 0; k < DL2C_NSTART; k++)
    for (int64_t i = 0; i < count; i++) open[i] |= b->enabled[k * b->stride + first + i];
}

/* Writes the mask of environment i. A final state shows every alternative as open. */
static inline void dl2c_mask(dl2c_batch *b, int64_t i, bool final)
{
  int8_t *mask = b->out.mask + i * NMASK;
  for (int c = 0; c < NCHOICE; c++) {
    const int32_t from = MASK_START[c];
    int8_t met = 0;
    for (int32_t a = from; a < MASK_START[c + 1]; a++) mask[a] = 0;
    for (int k = 0; k < DL2C_NSTART; k++) {
      if (DECISIONS[k][c] < 0) continue;
      const int8_t open = (int8_t)(b->enabled[k * b->stride + i] & !final);
      mask[from + DECISIONS[k][c]] |= open;
      met |= open;
    }
    if (!met)
      for (int32_t a = from; a < MASK_START[c + 1]; a++) mask[a] = 1;
  }
}

/* Tests and shows the state that environment i is in; whether a run is possible from it. */
static bool dl2c_show(dl2c_batch *b, int64_t i)
{
  uint8_t facts[NFACT];
  uint8_t open;
  dl2c_test(b, i, 1, 1, facts);
  dl2c_any_enabled(b, i, 1, &open);
  b->out.postcondition[i] = facts[F_postcondition];
  model_observe(b->x + i, b->p + i, b->stride, 1, 1, (dl2c_obs *)b->out.obs + i * NOBS,
                b->out.saturated + i);
  dl2c_mask(b, i, false);
  return open;
}

/* Begins an episode in the state given, if a run is possible from it. */
static bool dl2c_begin(dl2c_batch *b, int64_t i, const real *x, const real *p)
{
  for (int k = 0; k < NP; k++) b->p[k * b->stride + i] = p[k];
  dl2c_store(b, i, x);
  b->ended[i] = 0;
  b->steps[i] = 0;
  b->stalled[i] = 0;
  b->elapsed[i] = 0.0;
  b->out.reset[i] = 1;
  b->out.time[i] = 0.0;
  return dl2c_show(b, i);
}

/* Draws initial states until one has a run. */
static dl2c_status dl2c_reset_one(dl2c_batch *b, int64_t i)
{
  real x[NX];
  real p[NP + 1];
  dl2c_rng rng = dl2c_rng_make(b->seed[i], b->episode[i]++);
  for (int tries = 0; tries < DL2C_MAX_DEADLOCKS; tries++) {
    if (!dl2c_sample(&rng, x, p)) return DL2C_ERR_RESET;
    if (dl2c_begin(b, i, x, p)) return DL2C_OK;
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

/* What became of a requested step. */
typedef enum dl2c_attempt {
  DL2C_RAN = 0,
  DL2C_NO_RUN = 1,    /* neither the request nor, where allowed, another alternative has a run */
  DL2C_NUMERICAL = 2, /* the run led to an undefined or infinite value */
} dl2c_attempt;

/* Everything that a step of one block computes on its way. */
typedef struct dl2c_scratch {
  dl2c_moves moves;
  dl2c_judgement judged;
  uint8_t attempt[DL2C_BLOCK]; /* dl2c_attempt */
  uint8_t waited[DL2C_BLOCK];  /* the episode had ended before: this call begins the next */
  uint8_t open[DL2C_BLOCK];    /* some path is open after the step */
  uint8_t facts[NFACT * DL2C_BLOCK];
  dl2c_obs obs[NOBS * DL2C_BLOCK + 1];
} dl2c_scratch;

/* Counters after a move that took so long. */
static inline void dl2c_count(dl2c_batch *b, int64_t first, int64_t count, const real *duration)
{
  for (int64_t i = 0; i < count; i++) {
    b->out.duration[first + i] = duration[i];
    b->elapsed[first + i] += duration[i];
    b->out.time[first + i] = b->elapsed[first + i];
  }
  for (int64_t i = 0; i < count; i++) {
    b->steps[first + i] += 1;
    b->stalled[first + i] = duration[i] > 0.0 ? 0 : b->stalled[first + i] + 1;
  }
}

/* Takes over what lanes `lane` to `lane + count` did for environments from `at` on. */
static inline void dl2c_commit(dl2c_batch *b, int64_t at, int64_t count, const dl2c_moves *moves,
                               int64_t lane, uint8_t *attempt)
{
  const size_t n = (size_t)count;
  for (int k = 0; k < NX; k++)
    memcpy(b->x + k * b->stride + at, moves->state + k * DL2C_BLOCK + lane, n * sizeof(real));
  dl2c_decided_lanes(moves->path + lane, count, b->out.choices + at * NCHOICE,
                     b->out.executed_choices + at * NCHOICE);
  for (int64_t i = 0; i < count; i++) b->out.blocked[at + i] = !moves->requested[lane + i];
  memset(b->out.reset + at, 0, n);
  memset(attempt, DL2C_RAN, n);
  dl2c_count(b, at, count, moves->duration + lane);
}

/* Moves environment i as requested, in scalar code. */
static dl2c_attempt dl2c_advance(dl2c_batch *b, int64_t i)
{
  real x[NX];
  real p[NP + 1];
  uint8_t enabled[NPATH];
  dl2c_load(b, i, x, p);
  for (int k = 0; k < DL2C_NSTART; k++) enabled[k] = b->enabled[k * b->stride + i];

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
  const bool moved = dl2c_complete(&run, 0, enabled, false, x);
  const real duration = moved && !run.numerical ? run.duration : 0.0;
  if (moved && !run.numerical) dl2c_store(b, i, x);
  dl2c_count(b, i, 1, &duration);
  b->out.blocked[i] = run.blocked || !moved;
  return !moved ? DL2C_NO_RUN : run.numerical ? DL2C_NUMERICAL : DL2C_RAN;
}

/* Moves a block: in lanes where the model and every state in it allow, else one by one. */
static inline void dl2c_move_block(dl2c_batch *b, int64_t first, int64_t count, dl2c_scratch *s)
{
  const bool waits = b->options.autoreset == DL2C_AUTORESET_NEXT_STEP;
  const bool falls_back = b->options.on_blocked == DL2C_BLOCKED_FALLBACK;
  bool all = DL2C_STEPS_IN_LANES;
  if (DL2C_STEPS_IN_LANES) {
    dl2c_choose_lanes(b->enabled + first, b->stride, count, b->out.choices + first * NCHOICE,
                      s->moves.path, s->moves.requested);
    dl2c_move_lanes(b->x + first, b->p + first, b->stride, count, s->moves.path, s->moves.state,
                    s->moves.duration, s->moves.settled);
    for (int64_t i = 0; i < count; i++) s->moves.settled[i] &= s->moves.requested[i] | falls_back;
  }
  for (int64_t i = 0; i < count; i++) {
    s->waited[i] = waits & b->ended[first + i];
    all = all && s->moves.settled[i] && !s->waited[i];
  }
  if (all) {
    dl2c_commit(b, first, count, &s->moves, 0, s->attempt);
    return;
  }
  for (int64_t i = 0; i < count; i++) {
    s->attempt[i] = DL2C_RAN;
    if (s->waited[i]) continue;
    if (DL2C_STEPS_IN_LANES && s->moves.settled[i])
      dl2c_commit(b, first + i, 1, &s->moves, i, s->attempt + i);
    else
      s->attempt[i] = (uint8_t)dl2c_advance(b, first + i);
  }
}

/* How the step ends each episode, if it does; a predicate's ending goes before all others. */
static inline void dl2c_conclude(dl2c_batch *b, int64_t first, int64_t count, const dl2c_scratch *s)
{
  const int64_t stall = b->options.stall_limit > 0 ? b->options.stall_limit : INT64_MAX;
  const int64_t longest = b->options.max_steps > 0 ? b->options.max_steps : INT64_MAX;
  const int32_t refused = b->options.on_blocked == DL2C_BLOCKED_TERMINATE ? DL2C_TERMINATE : DL2C_TRUNCATE;
  const int32_t stuck =
      b->options.on_blocked == DL2C_BLOCKED_FALLBACK ? DL2C_REASON_DEADLOCK : DL2C_REASON_BLOCKED;
  for (int64_t i = 0; i < count; i++) {
    int32_t end = s->judged.end[i];
    int32_t status = s->judged.status[i];
    int32_t reason = s->judged.reason[i];
    int32_t other = DL2C_REASON_NONE;
    other = b->steps[first + i] >= longest ? DL2C_REASON_TIME_LIMIT : other;
    other = b->stalled[first + i] >= stall ? DL2C_REASON_STALLED : other;
    other = s->open[i] ? other : DL2C_REASON_DEADLOCK;
    other = DL2C_LOOPS ? other : DL2C_REASON_END;
    other = s->judged.undefined[i] ? DL2C_REASON_NUMERICAL : other;
    const bool ends_so = (end == DL2C_GOES_ON) & (other != DL2C_REASON_NONE);
    end = ends_so ? (other == DL2C_REASON_END ? DL2C_TERMINATE : DL2C_TRUNCATE) : end;
    status = ends_so ? DL2C_NONE : status;
    reason = ends_so ? other : reason;

    const bool failed = s->attempt[i] != DL2C_RAN;
    const bool numerical = s->attempt[i] == DL2C_NUMERICAL;
    end = failed ? (numerical ? DL2C_TRUNCATE : refused) : end;
    status = failed ? DL2C_NONE : status;
    reason = failed ? (numerical ? DL2C_REASON_NUMERICAL : stuck) : reason;

    b->out.status[first + i] = status;
    b->out.reason[first + i] = reason;
    b->out.cost[first + i] = s->judged.cost[i];
    b->out.terminated[first + i] = end == DL2C_TERMINATE;
    b->out.truncated[first + i] = end == DL2C_TRUNCATE;
    b->ended[first + i] = end != DL2C_GOES_ON;
    b->out.postcondition[first + i] = s->facts[F_postcondition * DL2C_BLOCK + i];
  }
  const real penalty = b->options.blocked_penalty;
  for (int64_t i = 0; i < count; i++)
    b->out.rewards[first + i] = s->judged.reward[i] + (b->out.blocked[first + i] ? penalty : 0.0);
}

/* Judges the states of a block and shows them. */
static inline void dl2c_judge_block(dl2c_batch *b, int64_t first, int64_t count, dl2c_scratch *s)
{
  const real *x = b->x + first;
  const real *p = b->p + first;
  dl2c_test(b, first, count, DL2C_BLOCK, s->facts);
  dl2c_any_enabled(b, first, count, s->open);
  model_judge(x, p, b->stride, count, s->facts, DL2C_BLOCK, &s->judged);
  dl2c_conclude(b, first, count, s);
  model_observe(x, p, b->stride, count, DL2C_BLOCK, s->obs, b->out.saturated + first);
  dl2c_obs *obs = (dl2c_obs *)b->out.obs + first * NOBS;
  for (int64_t i = 0; i < count; i++) {
    for (int k = 0; k < NOBS; k++) obs[i * NOBS + k] = s->obs[k * DL2C_BLOCK + i];
    dl2c_mask(b, first + i, b->ended[first + i]);
  }
}

/* Begins the next episode of an environment whose episode ended in this step; results stay. */
static dl2c_status dl2c_next_episode(dl2c_batch *b, int64_t i)
{
  memcpy((dl2c_obs *)b->out.final_obs + i * NOBS, (dl2c_obs *)b->out.obs + i * NOBS,
         sizeof(dl2c_obs) * NOBS);
  const real time = b->out.time[i];
  const uint8_t postcondition = b->out.postcondition[i];
  const uint8_t saturated = b->out.saturated[i];
  const dl2c_status status = dl2c_reset_one(b, i);
  b->out.time[i] = time;
  b->out.postcondition[i] = postcondition;
  b->out.saturated[i] = saturated;
  return status;
}

/* One step of environments `first` to `first + count`: move all, judge all, begin what is next. */
static dl2c_status dl2c_step_block(dl2c_batch *b, int64_t first, int64_t count)
{
  dl2c_scratch s;
  dl2c_move_block(b, first, count, &s);
  dl2c_judge_block(b, first, count, &s);
  for (int64_t i = 0; i < count; i++) {
    dl2c_status status = DL2C_OK;
    if (s.waited[i]) {
      dl2c_clear_results(b, first + i);
      status = dl2c_reset_one(b, first + i);
    } else if (b->options.autoreset == DL2C_AUTORESET_SAME_STEP && b->ended[first + i]) {
      status = dl2c_next_episode(b, first + i);
    }
    if (status != DL2C_OK) return status;
  }
  return DL2C_OK;
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
  b->stride = dl2c_stride(n);
  const size_t wide = (size_t)b->stride;
  b->n = n;
  b->options = *options;
  b->out = *buffers;
  b->x = calloc(wide * (NX + 1), sizeof *b->x);
  b->p = calloc(wide * (NP + 1), sizeof *b->p);
  b->enabled = calloc(wide * ((size_t)DL2C_NSTART + 1), sizeof *b->enabled);
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
  if (!dl2c_all_finite(x, NX) || !model_precondition(x, p)) return DL2C_ERR_STATE;
  dl2c_reseed(b, i, seed);
  b->episode[i]++;
  dl2c_clear_results(b, i);
  return dl2c_begin(b, i, x, p) ? DL2C_OK : DL2C_ERR_STATE;
}

dl2c_status dl2c_batch_step(dl2c_batch *b)
{
  if (b == NULL) return DL2C_ERR_ARG;
  for (int64_t first = 0; first < b->n; first += DL2C_BLOCK) {
    const int64_t rest = b->n - first;
    const dl2c_status status = dl2c_step_block(b, first, rest < DL2C_BLOCK ? rest : DL2C_BLOCK);
    if (status != DL2C_OK) return status;
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
  for (int k = 0; k < NP; k++) b->p[k * b->stride + i] = p[k];
  b->ended[i] = 0;
  dl2c_show(b, i);
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
