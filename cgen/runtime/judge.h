/* SPDX-License-Identifier: MIT-0 */
/* judge.h -- rewards, endings, observations and masks of a block. */
#ifndef DL2C_JUDGE_H
#define DL2C_JUDGE_H

#include "move.h"

/* How the step ends each episode, if it does; the ending of a predicate takes precedence. */
DL2C_INLINE void dl2c_endings(int64_t count, const dl2c_options *options,
                              const int64_t *restrict steps, const int64_t *restrict stalled,
                              const uint8_t *restrict open, const uint8_t *restrict attempt,
                              dl2c_judgement *restrict judged)
{
  const int64_t stall = options->stall_limit > 0 ? options->stall_limit : INT64_MAX;
  const int64_t longest = options->max_steps > 0 ? options->max_steps : INT64_MAX;
  const int32_t refused =
      options->on_blocked == DL2C_BLOCKED_TERMINATE ? DL2C_TERMINATE : DL2C_TRUNCATE;
  const int32_t stuck =
      options->on_blocked == DL2C_BLOCKED_FALLBACK ? DL2C_REASON_DEADLOCK : DL2C_REASON_BLOCKED;
  int32_t *restrict ends = judged->end;
  int32_t *restrict statuses = judged->status;
  int32_t *restrict reasons = judged->reason;
  const uint8_t *restrict undefined = judged->undefined;
  int32_t others[DL2C_BLOCK];
  int64_t ending = !DL2C_LOOPS;
  for (int64_t i = 0; i < count; i++) {
    const int64_t late = steps[i] >= longest ? DL2C_REASON_TIME_LIMIT : DL2C_REASON_NONE;
    const int64_t other = stalled[i] >= stall ? (int64_t)DL2C_REASON_STALLED : late;
    others[i] = (int32_t)other;
    ending |= other;
  }
  uint8_t unusual = 0;
  for (int64_t i = 0; i < count; i++)
    unusual |= (uint8_t)((attempt[i] != DL2C_RAN) | !open[i] | undefined[i]);
  if (!ending && !unusual) return; /* mostly nothing ends but by a predicate */
  for (int64_t i = 0; i < count; i++) {
    const int32_t no_run = attempt[i] == DL2C_NO_RUN;
    const int32_t failed = attempt[i] >= DL2C_NUMERICAL;
    const int32_t unsolved = attempt[i] == DL2C_NO_SOLUTION;
    const int32_t cause = dl2c_pick(unsolved, DL2C_REASON_SOLVER, DL2C_REASON_NUMERICAL);
    const int32_t failure = dl2c_pick(attempt[i] == DL2C_DIVERGED, DL2C_REASON_DIVERGED, cause);
    const int32_t closed = !open[i];
    const int32_t lost = undefined[i];
    int32_t other = others[i];
    other = dl2c_pick(closed, DL2C_REASON_DEADLOCK, other);
    other = DL2C_LOOPS ? other : DL2C_REASON_END;
    other = dl2c_pick(lost, DL2C_REASON_NUMERICAL, other);
    const int32_t kind = dl2c_pick(other == DL2C_REASON_END, DL2C_TERMINATE, DL2C_TRUNCATE);
    const int32_t so = (ends[i] == DL2C_GOES_ON) & (other != DL2C_REASON_NONE);
    const int32_t end = dl2c_pick(so, kind, ends[i]);
    const int32_t status = dl2c_pick(so, DL2C_NONE, statuses[i]);
    const int32_t reason = dl2c_pick(so, other, reasons[i]);
    ends[i] = dl2c_pick(failed, DL2C_TRUNCATE, dl2c_pick(no_run, refused, end));
    statuses[i] = dl2c_pick(failed | no_run, DL2C_NONE, status);
    reasons[i] = dl2c_pick(failed, failure, dl2c_pick(no_run, stuck, reason));
  }
}

/* Flags of how the episodes stand. */
DL2C_INLINE void dl2c_flags(int64_t count, const int32_t *restrict end,
                            uint8_t *restrict terminated, uint8_t *restrict truncated,
                            uint8_t *restrict ended)
{
  for (int64_t i = 0; i < count; i++) terminated[i] = end[i] == DL2C_TERMINATE;
  for (int64_t i = 0; i < count; i++) truncated[i] = end[i] == DL2C_TRUNCATE;
  for (int64_t i = 0; i < count; i++) ended[i] = end[i] != DL2C_GOES_ON;
}

/* Rewards, with the penalty of requests that blocked. */
DL2C_INLINE void dl2c_rewards(int64_t count, const real *restrict reward,
                              const uint8_t *restrict blocked, real penalty, real *restrict rewards)
{
  for (int64_t i = 0; i < count; i++) {
    const real extra = blocked[i] ? penalty : 0.0;
    rewards[i] = reward[i] + extra;
  }
}

/* Writes results and endings of a block. */
DL2C_INLINE void dl2c_conclude(dl2c_batch *b, int64_t first, int64_t count, const uint8_t *attempt,
                               dl2c_scratch *s)
{
  const size_t n = (size_t)count;
  dl2c_endings(count, &b->options, b->steps + first, b->stalled + first, s->open, attempt,
               &s->judged);
  memcpy(b->out.status + first, s->judged.status, n * sizeof(int32_t));
  memcpy(b->out.reason + first, s->judged.reason, n * sizeof(int32_t));
  memcpy(b->out.cost + first, s->judged.cost, n * sizeof(int32_t));
  memcpy(b->out.postcondition + first, s->facts + F_postcondition * DL2C_BLOCK, n);
  dl2c_flags(count, s->judged.end, b->out.terminated + first, b->out.truncated + first,
             b->ended + first);
  dl2c_rewards(count, s->judged.reward, b->out.blocked + first, b->options.blocked_penalty,
               b->out.rewards + first);
}

#if defined(__has_builtin)
#if __has_builtin(__builtin_shufflevector)
#define DL2C_SHUFFLES 1
#endif
#endif

#ifdef DL2C_SHUFFLES
/* Four observation entries. */
typedef dl2c_obs dl2c_four __attribute__((vector_size(4 * sizeof(dl2c_obs))));

/* Four entries of four environments.   columns: a row of DL2C_BLOCK for each entry   rows: (4, stride) */
DL2C_INLINE void dl2c_four_rows(const dl2c_obs *restrict columns, int stride, dl2c_obs *restrict rows)
{
  dl2c_four a[4];
  for (int k = 0; k < 4; k++) memcpy(&a[k], columns + k * DL2C_BLOCK, sizeof a[k]);
  const dl2c_four low = __builtin_shufflevector(a[0], a[1], 0, 4, 1, 5);
  const dl2c_four high = __builtin_shufflevector(a[0], a[1], 2, 6, 3, 7);
  const dl2c_four low_next = __builtin_shufflevector(a[2], a[3], 0, 4, 1, 5);
  const dl2c_four high_next = __builtin_shufflevector(a[2], a[3], 2, 6, 3, 7);
  const dl2c_four turned[4] = {
      __builtin_shufflevector(low, low_next, 0, 1, 4, 5),
      __builtin_shufflevector(low, low_next, 2, 3, 6, 7),
      __builtin_shufflevector(high, high_next, 0, 1, 4, 5),
      __builtin_shufflevector(high, high_next, 2, 3, 6, 7),
  };
  for (int k = 0; k < 4; k++) memcpy(rows + k * stride, &turned[k], sizeof turned[k]);
}
#endif

/*
 * Entries of observations, from a row for each entry to a row for each environment: four by four in registers.
 * The last four entries may overlap those before.   columns: (width, DL2C_BLOCK)   rows: (count, stride)
 */
DL2C_INLINE void dl2c_rows(int width, int stride, int64_t count, const dl2c_obs *restrict columns,
                           dl2c_obs *restrict rows)
{
#ifdef DL2C_SHUFFLES
  if (width >= 4 && count % 4 == 0) {
    for (int k = 0; k < width; k += 4) {
      const int first = k + 4 <= width ? k : width - 4;
      for (int64_t i = 0; i < count; i += 4)
        dl2c_four_rows(columns + first * DL2C_BLOCK + i, stride, rows + i * stride + first);
    }
    return;
  }
#endif
  for (int64_t i = 0; i < count; i++) {
    DL2C_UNROLL
    for (int k = 0; k < width; k++) rows[i * stride + k] = columns[k * DL2C_BLOCK + i];
  }
}

/* Whether the time limit ends each episode after this step. */
DL2C_INLINE void dl2c_late(const dl2c_batch *b, int64_t first, int64_t count, uint8_t *restrict late)
{
  const int64_t longest = b->options.max_steps > 0 ? b->options.max_steps : INT64_MAX;
  const int64_t *restrict steps = b->steps + first;
  for (int64_t i = 0; i < count; i++) late[i] = steps[i] >= longest;
}

/*
 * A step without a complete run fires no predicate: where it kept the state, in a problem with a loop,
 * there is the sum of the shapes; else nothing, and nothing was violated.
 */
DL2C_INLINE void dl2c_forgive(const dl2c_batch *b, int64_t first, int64_t count,
                              const uint8_t *attempt, dl2c_scratch *s)
{
  for (int64_t i = dl2c_next(attempt, 0, count); i < count; i = dl2c_next(attempt, i + 1, count)) {
    real x[NX];
    real p[NP + 1];
    dl2c_load(b, first + i, x, p);
    s->judged.reward[i] = DL2C_LOOPS ? dl2c_shapes(x, p) : 0.0;
    s->judged.cost[i] = 0;
    if (!DL2C_LOOPS) s->facts[F_postcondition * DL2C_BLOCK + i] = 1;
  }
}

/* States in lanes, and what is known of them. */
typedef struct dl2c_view {
  const real *x;          /* (NX, stride) */
  const real *p;          /* (NP, stride) */
  int64_t stride;
  const uint8_t *enabled; /* (paths of point 0, stride) */
  const uint8_t *seen;    /* (count, NMASK) only where masks look ahead */
  const uint8_t *ended;   /* (count) */
  const dl2c_obs *fixed;  /* (count, NFIXED) NULL where observations still have them */
  const uint8_t *clipped; /* (count) */
} dl2c_view;

/* Observations and masks.   obs: (count, NOBS)   saturated: (count)   mask: (count, NMASK) */
DL2C_INLINE void dl2c_show_lanes(const dl2c_view *v, int64_t count, dl2c_obs *restrict obs,
                                 uint8_t *restrict saturated, int8_t *restrict mask)
{
  dl2c_obs columns[NVARYING * DL2C_BLOCK + 1];
  const uint8_t *restrict clipped = v->clipped;
  model_observe(v->x, v->p, v->stride, count, DL2C_BLOCK, columns, saturated);
  dl2c_rows(NVARYING, NOBS, count, columns, obs);
  for (int64_t i = 0; v->fixed != NULL && i < count; i++)
    memcpy(obs + i * NOBS + NVARYING, v->fixed + i * NFIXED, sizeof(dl2c_obs) * NFIXED);
  for (int64_t i = 0; i < count; i++) saturated[i] |= clipped[i];
  dl2c_masks(count, v->enabled, v->stride, v->ended, v->seen, mask);
}

/* The same of a full block. */
DL2C_LANES static void dl2c_show_block(const dl2c_view *v, dl2c_obs *obs, uint8_t *saturated, int8_t *mask)
{
  dl2c_show_lanes(v, DL2C_BLOCK, obs, saturated, mask);
}

/* Whether the next step starts in the states that are judged, and masks say no more than the guards there. */
enum { DL2C_GUARDS_WITH_FACTS = !DL2C_LOOKS_AHEAD && !(NSTEPDRAW > 0 && DL2C_LOOPS) };

/*
 * Judges the states of lanes `lane` to `lane + count` of the block that begins with environment `block`,
 * and shows them. What moving the block left is read from `lane` on, all else in the scratch is used from
 * 0 on.
 */
DL2C_INLINE void dl2c_judge_lanes(dl2c_batch *b, int64_t block, int64_t lane, int64_t count,
                                  dl2c_scratch *s)
{
  const int64_t first = block + lane;
  const uint8_t *attempt = s->attempt + lane;
  const real *x = b->x + first;
  const real *p = b->p + first;
  uint8_t *enabled = b->enabled + first;
  if (DL2C_GUARDS_WITH_FACTS)
    model_facts_and_guards(x, p, b->stride, count, DL2C_BLOCK, s->facts, enabled);
  else
    model_facts(x, p, b->stride, count, DL2C_BLOCK, s->facts);
  dl2c_late(b, first, count, s->late);
  model_revise(count, s->watch + lane, s->late, DL2C_BLOCK, s->facts);
  dl2c_judge(x, p, b->stride, count, s->facts, DL2C_BLOCK, &s->judged);
  dl2c_forgive(b, first, count, attempt, s);
  dl2c_lead_block(b, first, count, attempt);
  if (DL2C_GUARDS_WITH_FACTS)
    dl2c_enabled_by_inputs(0, x, p, b->stride, count, enabled);
  else
    dl2c_open_lanes(b, first, count);
  dl2c_any_enabled(enabled, b->stride, count, s->open);
  const dl2c_view view = {x, p, b->stride, enabled, b->seen + first * NMASK, b->ended + first,
                          b->options.shared_obs ? b->fixed + first * NFIXED : NULL, b->clipped + first};
  dl2c_conclude(b, first, count, attempt, s);
  dl2c_obs *obs = (dl2c_obs *)b->out.obs + first * NOBS;
  int8_t *mask = b->out.mask + first * NMASK;
  if (count == DL2C_BLOCK)
    dl2c_show_block(&view, obs, b->out.saturated + first, mask);
  else
    dl2c_show_lanes(&view, count, obs, b->out.saturated + first, mask);
}

#endif
