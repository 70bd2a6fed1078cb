/* SPDX-License-Identifier: MIT-0 */
/* move.h -- moving the environments of a block as requested. */
#ifndef DL2C_MOVE_H
#define DL2C_MOVE_H

#include "active_set.h"
#include "state.h"

/* Results of a call that only began an episode. */
static void dl2c_clear_results(dl2c_batch *b, int64_t i)
{
  for (int c = 0; c < NCHOICE; c++)
    b->out.executed_choices[i * NCHOICE + c] = b->out.choices[i * NCHOICE + c];
  for (int j = 0; j < NINPUT; j++)
    b->out.executed_inputs[i * NINPUT + j] = b->out.inputs[i * NINPUT + j];
  for (int c = 0; c < NENVCHOICE; c++) b->out.drawn_choices[i * NENVCHOICE + c] = -1;
  for (int j = 0; j < NENVINPUT; j++) b->out.drawn_inputs[i * NENVINPUT + j] = (double)NAN;
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
  DL2C_NO_SOLUTION = 3, /* the solver failed */
  DL2C_DIVERGED = 4,  /* while loops did not come to an end */
} dl2c_attempt;

/* Everything that a step of one block computes on its way. */
typedef struct dl2c_scratch {
  _Alignas(DL2C_CACHE_LINE) dl2c_moves moves;
  dl2c_judgement judged;
  uint8_t attempt[DL2C_BLOCK]; /* dl2c_attempt */
  uint8_t waited[DL2C_BLOCK];  /* the episode had ended before: this call begins the next */
  uint8_t open[DL2C_BLOCK];    /* some path is open after the step */
  uint8_t late[DL2C_BLOCK];    /* the time limit ends the episode */
  uint8_t facts[NFACT * DL2C_BLOCK];
  uint8_t watch[(NWATCH > 0 ? NWATCH : 1) * DL2C_BLOCK]; /* (NWATCH, DL2C_BLOCK) dl2c_watched */
#if DL2C_MONITORED
  int32_t violated[DL2C_BLOCK]; /* conditions of the monitor, 0 for none */
#endif
} dl2c_scratch;

/* The clocks of environments from `first` on. */
static inline dl2c_clocks dl2c_clocks_of(const dl2c_batch *b, int64_t first)
{
  return (dl2c_clocks){b->out.duration + first, b->out.time + first, b->elapsed + first,
                       b->steps + first, b->stalled + first};
}

/* Writes the decisions of the lanes of a block to the results. */
DL2C_INLINE void dl2c_show_moves(dl2c_batch *b, int64_t first, int64_t count,
                                 const dl2c_moves *moves)
{
  dl2c_decided_lanes(moves->path, count, b->out.choices + first * NCHOICE,
                     b->out.executed_choices + first * NCHOICE);
  uint8_t *restrict blocked = b->out.blocked + first;
  const uint8_t *restrict requested = moves->requested;
  for (int64_t i = 0; i < count; i++) blocked[i] = !requested[i];
  uint8_t *restrict reset = b->out.reset + first;
  for (int64_t i = 0; i < count; i++) reset[i] = 0;
  if (NINPUT > 0)
    memcpy(b->out.executed_inputs + first * NINPUT, b->out.inputs + first * NINPUT,
           sizeof(real) * (size_t)(count * NINPUT));
}

/* Writes the decisions of a run of environment i to the results. */
static void dl2c_show_run(dl2c_batch *b, int64_t i, const dl2c_trial *run)
{
  for (int c = 0; c < NCHOICE; c++)
    if (run->taken[c] >= 0) b->out.executed_choices[i * NCHOICE + c] = run->taken[c];
  for (int j = 0; j < NINPUT; j++)
    if (run->given[j]) b->out.executed_inputs[i * NINPUT + j] = run->executed[j];
  for (int c = 0; c < NENVCHOICE; c++)
    b->out.drawn_choices[i * NENVCHOICE + c] = run->taken[NCHOICE + c];
  for (int j = 0; j < NENVINPUT; j++)
    if (run->given[NINPUT + j]) b->out.drawn_inputs[i * NENVINPUT + j] = run->value[NINPUT + j];
}

#if DL2C_MONITORED
/* The first condition of the monitor that a complete run violates, 0 for none. */
static int32_t dl2c_violated(const dl2c_trial *run, const real *p)
{
  if (run->unexplained || run->violated != 0) return run->unexplained ? 0 : run->violated;
  return model_monitor_step(run->before, run->x, p);
}
#endif

/* What environment i is asked for.   p: (NP) */
static inline dl2c_request dl2c_request_of(const dl2c_batch *b, int64_t i, const real *p)
{
  return (dl2c_request){
      .choices = b->out.choices + i * NCHOICE,
      .inputs = b->out.inputs + i * NINPUT,
      .draws = NSTEPDRAW > 0 ? b->start[i].draws : NULL,
      .p = p,
      .map = b->options.action_map,
      .request_only = b->options.on_blocked != DL2C_BLOCKED_FALLBACK,
      .solver = b->solver,
#if DL2C_INSPECT
      .followed = b->followed + i * DL2C_INSPECT_FLOWS,
#endif
  };
}

/* Takes over the final state of a run of environment i, or its present state if there was none. */
static dl2c_attempt dl2c_record(dl2c_batch *b, int64_t i, const dl2c_trial *run, bool moved,
                                uint8_t *watch)
{
  const bool sound = moved && run->failure == DL2C_SOUND;
  const dl2c_clocks clocks = dl2c_clocks_of(b, i);
  dl2c_clear_results(b, i);
  b->out.reset[i] = 0;
  if (sound) dl2c_store(b, i, run->x);
  dl2c_show_run(b, i, run);
  dl2c_count(&clocks, 0, true, sound ? run->duration : 0.0);
  b->out.blocked[i] = run->left || !moved;
  if (!moved) return DL2C_NO_RUN;
  switch (run->failure) {
  case DL2C_LOST: return DL2C_NUMERICAL;
  case DL2C_UNSOLVABLE: return DL2C_NO_SOLUTION;
  case DL2C_ENDLESS: return DL2C_DIVERGED;
  default: break;
  }
  for (int w = 0; w < NWATCH; w++) watch[w * DL2C_BLOCK] = run->watch[w];
  return DL2C_RAN;
}

/* Moves environment i as requested, in scalar code.   watch: (NWATCH, DL2C_BLOCK) */
static dl2c_attempt dl2c_advance(dl2c_batch *b, int64_t i, uint8_t *watch, int32_t *violated)
{
  real p[NP + 1];
  dl2c_trial start;
  uint8_t enabled[NPATH];
  dl2c_stand(b, i, &start, p);
  for (int k = 0; k < DL2C_NSTART; k++) enabled[k] = b->enabled[k * b->stride + i];
  const dl2c_request request = dl2c_request_of(b, i, p);
  dl2c_trial run = start;
  const bool moved = dl2c_complete(&request, &run, enabled, NULL);
#if DL2C_INSPECT
  b->nfollowed[i] = moved && run.failure == DL2C_SOUND ? run.nfollowed : 0;
#endif
#if DL2C_MONITORED
  *violated = moved && run.failure == DL2C_SOUND ? dl2c_violated(&run, p) : 0;
#else
  (void)violated;
#endif
  return dl2c_record(b, i, moved ? &run : &start, moved, watch);
}

#if DL2C_FLOWS_IN_LANES
/*
 * The control of environment i, up to its flow from run->x. False where the scalar step is needed.
 */
static bool dl2c_decide_one(const dl2c_batch *b, int64_t i, dl2c_trial *run, real *p)
{
  uint8_t enabled[NPATH];
  real y[NX];
  dl2c_stand(b, i, run, p);
  for (int k = 0; k < DL2C_NSTART; k++) enabled[k] = b->enabled[k * b->stride + i];
  const dl2c_request request = dl2c_request_of(b, i, p);
  bool left = false;
  const int path = dl2c_preferred(&request, run, enabled, &left);
  if (path < 0 || (request.request_only && left)) return false;
  run->left = left;
  dl2c_decide(&request, run, path, y);
  memcpy(run->x, y, sizeof y);
  return run->failure == DL2C_SOUND;
}

/*
 * Integrates the flow of a block in the active set, and notes which lanes have moved. Control is
 * executed in lanes where `path` gives a path, else one by one.
 */
DL2C_INLINE void dl2c_move_active(dl2c_batch *b, int64_t first, int64_t count, const int64_t *path,
                                 const uint8_t *waited, uint8_t *moved, uint8_t *watch)
{
  dl2c_block_flow block;
  dl2c_trial runs[DL2C_BLOCK];
  uint8_t alone[DL2C_BLOCK];
  if (count < DL2C_BLOCK) memset(&block, 0, sizeof block); /* groups of lanes are computed whole */
  dl2c_block_decide(&block, b->x + first, b->p + first, b->stride, count, path,
                     b->out.inputs + first * NINPUT);
  for (int64_t i = 0; i < count; i++) alone[i] = !block.going[i] & !waited[i];
  for (int64_t i = dl2c_next(alone, 0, count); i < count; i = dl2c_next(alone, i + 1, count)) {
    real p[NP + 1];
    block.going[i] = dl2c_decide_one(b, first + i, &runs[i], p);
    for (int k = 0; k < NX && block.going[i]; k++) block.x[k][i] = runs[i].x[k];
  }
  dl2c_block_integrate(&block, count);
  const dl2c_clocks clocks = dl2c_clocks_of(b, first);
  for (int64_t i = 0; i < count; i++) moved[i] = (block.there[i] != 0) & !alone[i];
  DL2C_ALIAS_FREE
  for (int64_t i = 0; i < count; i++) dl2c_count(&clocks, i, moved[i], block.stop[i]);
  for (int k = 0; k < NX; k++) {
    real *x = b->x + k * b->stride + first;
    DL2C_ALIAS_FREE
    for (int64_t i = 0; i < count; i++) x[i] = dl2c_select(moved[i], block.y[k][i], x[i]);
  }
  for (int64_t i = dl2c_next(alone, 0, count); i < count; i = dl2c_next(alone, i + 1, count)) {
    if (!block.there[i]) continue;
    for (int k = 0; k < NX; k++) runs[i].x[k] = block.y[k][i];
    runs[i].duration = block.stop[i];
    moved[i] = dl2c_record(b, first + i, &runs[i], true, watch + i) == DL2C_RAN;
  }
}
#endif

/*
 * Draws for the next step of every environment of a block that moved, and begins that step. Without a
 * loop there is none.
 */
DL2C_INLINE void dl2c_lead_block(dl2c_batch *b, int64_t first, int64_t count,
                                 const uint8_t *attempt)
{
  if (NSTEPDRAW == 0 || !DL2C_LOOPS) return;
  for (int64_t i = 0; i < count; i++) {
    if (attempt[i] != DL2C_RAN) continue;
    real x[NX];
    real p[NP + 1] = {0.0}; /* there may be no constants */
    dl2c_load(b, first + i, x, p);
    dl2c_lead(b->solver, b->rng + first + i, x, p, b->start + first + i);
    dl2c_store(b, first + i, b->start[first + i].trial.x);
  }
}

/*
 * Steps after which a block tries the active set again, and the fraction that has to succeed: 1/4.
 */
enum { DL2C_SCALAR_STEPS = 15, DL2C_WORTHWHILE = 4 };

/* Moves some lanes of a block, `first` to `first + count`, which are in the scratch from `lane` on. */
DL2C_INLINE void dl2c_move_some(dl2c_batch *b, int64_t first, int64_t lane, int64_t count,
                                dl2c_scratch *s)
{
  const int64_t begin = first + lane;
  const dl2c_clocks clocks = dl2c_clocks_of(b, begin);
  dl2c_move_lanes(b->x + begin, b->p + begin, b->stride, count, s->moves.path + lane,
                  b->out.inputs + begin * NINPUT, &clocks, s->moves.moved + lane);
}

/* Moves a full block. All that moves a lane is inlined, in large models too: else the loop is not vectorised. */
DL2C_LANES DL2C_FLAT static void dl2c_move_all(dl2c_batch *b, int64_t first, dl2c_scratch *s)
{
  dl2c_move_some(b, first, 0, DL2C_BLOCK, s);
}

/* Moves a lane of a block alone. */
static void dl2c_move_one(dl2c_batch *b, int64_t first, int64_t lane, dl2c_scratch *s)
{
  dl2c_move_some(b, first, lane, 1, s);
}

/*
 * Moves the lanes of a block that can move together, `group` at a time, and notes which have. Where few
 * succeed they are moved one by one for a while: the bits are the same.
 */
DL2C_INLINE void dl2c_move_together(dl2c_batch *b, int64_t first, int64_t count, int64_t group,
                                    dl2c_scratch *s)
{
#if DL2C_FLOWS_IN_LANES
  uint8_t *scalar_steps = &b->scalar_steps[first / DL2C_BLOCK];
  if (count > 1 && *scalar_steps == 0 && !DL2C_ONE_BY_ONE) {
    dl2c_move_active(b, first, count, s->moves.path, s->waited, s->moves.moved, s->watch);
    int64_t arrived = 0;
    for (int64_t i = 0; i < count; i++) arrived += s->moves.moved[i];
    *scalar_steps = DL2C_WORTHWHILE * arrived < count ? DL2C_SCALAR_STEPS : 0;
    return;
  }
  if (*scalar_steps > 0) *scalar_steps -= 1;
#endif
  int64_t lane = 0;
  if (DL2C_STEPS_IN_LANES && (DL2C_FEW_PATHS || group > 1) && !DL2C_ONE_BY_ONE) {
    if (group == DL2C_BLOCK) {
      dl2c_move_all(b, first, s);
      lane = group;
    }
    for (; lane + group <= count; lane += group) dl2c_move_some(b, first, lane, group, s);
    for (; lane < count; lane++) dl2c_move_one(b, first, lane, s);
  }
  for (; lane < count; lane++) s->moves.moved[lane] = 0;
}

#if DL2C_MONITORED
#define DL2C_VIOLATED(scratch, i) (&(scratch)->violated[i])
#else
#define DL2C_VIOLATED(scratch, i) NULL
#endif

/*
 * Moves a block: in lanes, `group` of them at a time, where the model and every state in it allow, else one
 * by one, as a single environment with many paths.
 */
DL2C_INLINE void dl2c_move_block(dl2c_batch *b, int64_t first, int64_t count, int64_t group,
                                 dl2c_scratch *s)
{
  const bool waits = b->options.autoreset == DL2C_AUTORESET_NEXT_STEP;
  const bool falls_back = b->options.on_blocked == DL2C_BLOCKED_FALLBACK;
  const uint8_t *restrict ended = b->ended + first;
  uint8_t *restrict waited = s->waited;
  for (int64_t i = 0; i < count; i++) waited[i] = waits & ended[i];
  memset(s->watch, DL2C_WATCHING, sizeof s->watch);
  uint8_t *restrict attempt = s->attempt;
  for (int64_t i = 0; i < count; i++) attempt[i] = DL2C_RAN;
  uint8_t *restrict moved = s->moves.moved;
  if (DL2C_DECIDES_IN_LANES && (DL2C_FEW_PATHS || group > 1) &&
      (NU == 0 || b->options.action_map == DL2C_MAP_PROJECT)) {
    (DL2C_FEW_PATHS ? dl2c_choose_lanes : dl2c_choose_among_many)(
        b->enabled + first, b->stride, count, b->out.choices + first * NCHOICE, falls_back, waited,
        s->moves.path, s->moves.requested);
    dl2c_show_moves(b, first, count, &s->moves);
  } else {
    for (int64_t i = 0; i < count; i++) s->moves.path[i] = -1;
  }
  dl2c_move_together(b, first, count, group, s);
  uint8_t left[DL2C_BLOCK];
  for (int64_t i = 0; i < count; i++) left[i] = !moved[i] & !waited[i];
  for (int64_t i = dl2c_next(left, 0, count); i < count; i = dl2c_next(left, i + 1, count))
    attempt[i] = (uint8_t)dl2c_advance(b, first + i, s->watch + i, DL2C_VIOLATED(s, i));
}

#endif
