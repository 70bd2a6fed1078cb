/* block.h -- a step of a block of environments: move all, judge all, begin the episodes that follow. */
#ifndef DL2C_BLOCK_H
#define DL2C_BLOCK_H

#include "state.h"

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

#endif
