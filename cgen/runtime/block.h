/* SPDX-License-Identifier: MIT-0 */
/* block.h -- a step of a block of environments: move all, judge all, note which episodes follow. */
#ifndef DL2C_BLOCK_H
#define DL2C_BLOCK_H

#include "episodes.h"

/* A full block: the number of lanes is known when this is compiled. */
DL2C_LANES static void dl2c_full(dl2c_batch *b, int64_t first, dl2c_scratch *s)
{
  dl2c_move_block(b, first, DL2C_BLOCK, DL2C_BLOCK, s);
  dl2c_judge_lanes(b, first, 0, DL2C_BLOCK, s);
}

/* Judges lane `lane` of a block alone. */
static void dl2c_judge_one(dl2c_batch *b, int64_t first, int64_t lane, dl2c_scratch *s)
{
  dl2c_judge_lanes(b, first, lane, 1, s);
}

/* A single environment. */
static void dl2c_one(dl2c_batch *b, int64_t first, dl2c_scratch *s)
{
  dl2c_move_block(b, first, 1, 1, s);
  dl2c_judge_one(b, first, 0, s);
}

/* Lanes of the last block that are moved and judged together. */
enum { DL2C_GROUP = 4 };

/*
 * The last block of a batch. Its lanes are moved and judged in groups of a fixed size, and those left
 * over one by one: loops of a fixed length take a quarter of the time to compile, and results are the
 * same.
 */
static void dl2c_part(dl2c_batch *b, int64_t first, int64_t count, dl2c_scratch *s)
{
  int64_t lane = 0;
  dl2c_move_block(b, first, count, DL2C_GROUP, s);
  for (; lane + DL2C_GROUP <= count; lane += DL2C_GROUP)
    dl2c_judge_lanes(b, first, lane, DL2C_GROUP, s);
  for (; lane < count; lane++) dl2c_judge_one(b, first, lane, s);
}

/*
 * Notes whose next episode begins after a step of a block: of those that ended, or had ended before. They
 * begin when they fill a block of their own.
 */
static dl2c_status dl2c_follow_up(dl2c_batch *b, int64_t first, int64_t count, const dl2c_scratch *s,
                                  dl2c_followers *who)
{
  const bool at_once = b->options.autoreset == DL2C_AUTORESET_SAME_STEP;
  const uint8_t *over = at_once ? b->ended + first : s->waited;
  for (int64_t i = dl2c_next(over, 0, count); i < count; i = dl2c_next(over, i + 1, count)) {
    who->env[who->count++] = first + i;
    if (who->count < DL2C_BLOCK) continue;
    const dl2c_status status = dl2c_begin_followers(b, who);
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

/* One step of environments `first` to `first + count`: move all, judge all. */
static dl2c_status dl2c_step_block(dl2c_batch *b, int64_t first, int64_t count, dl2c_followers *who)
{
  dl2c_scratch s;
  if (count == DL2C_BLOCK)
    dl2c_full(b, first, &s);
  else if (count == 1)
    dl2c_one(b, first, &s);
  else
    dl2c_part(b, first, count, &s);
  return dl2c_follow_up(b, first, count, &s, who);
}

/*
 * One step of environments `first` to `first + count`, block by block, and the episodes that follow. A
 * violation that a monitor reports stops nothing.
 */
static dl2c_status dl2c_step_blocks(dl2c_batch *b, int64_t first, int64_t count)
{
  dl2c_followers who; /* an initialiser would clear all of it in every step */
  who.count = 0;
  dl2c_status found = DL2C_OK;
  for (int64_t begin = first; begin < first + count; begin += DL2C_BLOCK) {
    const int64_t rest = first + count - begin;
    const dl2c_status status = dl2c_step_block(b, begin, rest < DL2C_BLOCK ? rest : DL2C_BLOCK, &who);
    if (status == DL2C_OK) continue;
    found = status;
    if (status != DL2C_ERR_MONITOR) break;
  }
  const dl2c_status followed = dl2c_begin_followers(b, &who);
  const bool sound = found == DL2C_OK || found == DL2C_ERR_MONITOR;
  return sound && followed != DL2C_OK ? followed : found;
}

#endif
