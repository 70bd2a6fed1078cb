/* SPDX-License-Identifier: MIT-0 */
/* block.h -- a step of a block of environments: move all, judge all, begin the episodes that follow. */
#ifndef DL2C_BLOCK_H
#define DL2C_BLOCK_H

#include "judge.h"

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

/* A full block: the number of lanes is known when this is compiled. */
DL2C_LANES static void dl2c_full(dl2c_batch *b, int64_t first, dl2c_scratch *s)
{
  dl2c_move_block(b, first, 0, DL2C_BLOCK, s);
  dl2c_judge_lanes(b, first, 0, DL2C_BLOCK, s);
}

/*
 * Some lanes of the last block, and a single one. These are functions of a fixed number of lanes, because
 * loops of any other length take a quarter of the time to compile.
 */
static DL2C_NOINLINE void dl2c_group(dl2c_batch *b, int64_t first, int64_t lane, dl2c_scratch *s)
{
  dl2c_move_block(b, first, lane, DL2C_GROUP, s);
  dl2c_judge_lanes(b, first, lane, DL2C_GROUP, s);
}

static DL2C_NOINLINE void dl2c_one(dl2c_batch *b, int64_t first, int64_t lane, dl2c_scratch *s)
{
  dl2c_move_block(b, first, lane, 1, s);
  dl2c_judge_lanes(b, first, lane, 1, s);
}

/* The last block of a batch. */
static void dl2c_part(dl2c_batch *b, int64_t first, int64_t count, dl2c_scratch *s)
{
  int64_t lane = 0;
  for (; lane + DL2C_GROUP <= count; lane += DL2C_GROUP) dl2c_group(b, first, lane, s);
  for (; lane < count; lane++) dl2c_one(b, first, lane, s);
}

/* Begins the next episodes after a step of a block: of those that ended, or had ended before. */
static dl2c_status dl2c_follow_up(dl2c_batch *b, int64_t first, int64_t count, const dl2c_scratch *s)
{
  const bool at_once = b->options.autoreset == DL2C_AUTORESET_SAME_STEP;
  const uint8_t *over = at_once ? b->ended + first : s->waited;
  for (int64_t i = dl2c_next(over, 0, count); i < count; i = dl2c_next(over, i + 1, count)) {
    if (!at_once) dl2c_clear_results(b, first + i);
    const dl2c_status status =
        at_once ? dl2c_next_episode(b, first + i) : dl2c_reset_one(b, first + i);
    if (status != DL2C_OK) return status;
  }
  dl2c_status found = DL2C_OK;
#if DL2C_MONITORED
  for (int64_t i = 0; i < count; i++) {
    if (s->waited[i] || s->violated[i] == 0) continue;
    b->out.reason[first + i] = -s->violated[i];
    found = DL2C_ERR_MONITOR;
  }
#endif
  return found;
}

/* One step of environments `first` to `first + count`: move all, judge all, begin next episodes. */
static dl2c_status dl2c_step_block(dl2c_batch *b, int64_t first, int64_t count)
{
  dl2c_scratch s;
  if (count == DL2C_BLOCK)
    dl2c_full(b, first, &s);
  else
    dl2c_part(b, first, count, &s);
  return dl2c_follow_up(b, first, count, &s);
}

#endif
