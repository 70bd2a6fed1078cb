/* SPDX-License-Identifier: MIT-0 */
/* episodes.h -- the episodes that follow those which ended: one by one, or several at once in lanes. */
#ifndef DL2C_EPISODES_H
#define DL2C_EPISODES_H

#include "initial.h"
#include "judge.h"

/* Lanes serve where an episode begins in the state drawn, and the environment decides nothing. */
enum {
  DL2C_BEGINS_IN_LANES = DL2C_DRAWS_IN_LANES && NDRAW == 0 && DL2C_POINT_PREFIX == 0 &&
                         DL2C_POINT_LEAD == 0 && !DL2C_LOOKS_AHEAD
};

/* Environments whose next episode begins before a call returns. */
typedef struct dl2c_followers {
  int64_t count;
  int64_t env[DL2C_BLOCK];
} dl2c_followers;

/* An observation at the end of an episode is kept when the next one begins in the same step. */
static inline void dl2c_keep_last(dl2c_batch *b, int64_t i)
{
  memcpy((dl2c_obs *)b->out.final_obs + i * NOBS, (dl2c_obs *)b->out.obs + i * NOBS,
         sizeof(dl2c_obs) * NOBS);
}

/* Begins the next episode of an environment: in the step that ended the last, whose results stay, or after it. */
static dl2c_status dl2c_next_episode(dl2c_batch *b, int64_t i)
{
  if (b->options.autoreset != DL2C_AUTORESET_SAME_STEP) {
    dl2c_clear_results(b, i);
    return dl2c_reset_one(b, i);
  }
  dl2c_keep_last(b, i);
  const real time = b->out.time[i];
  const uint8_t postcondition = b->out.postcondition[i];
  const uint8_t saturated = b->out.saturated[i];
  const dl2c_status status = dl2c_reset_one(b, i);
  b->out.time[i] = time;
  b->out.postcondition[i] = postcondition;
  b->out.saturated[i] = saturated;
  return status;
}

/* Initial states of the next episodes, and how they look. */
typedef struct dl2c_beginnings {
  dl2c_initials drawn;
  uint8_t enabled[NPATH * DL2C_BLOCK];
  uint8_t open[DL2C_BLOCK];
  uint8_t ended[DL2C_BLOCK]; /* no episode has ended where it begins */
  uint8_t saturated[DL2C_BLOCK];
  uint8_t clipped[DL2C_BLOCK];
  dl2c_obs fixed[(NFIXED + 1) * DL2C_BLOCK];
  dl2c_obs obs[(NOBS + 1) * DL2C_BLOCK];
  int8_t mask[(NMASK + 1) * DL2C_BLOCK];
} dl2c_beginnings;

/* Which paths are open in `count` lanes, none in the others of the block.   enabled: (paths, DL2C_BLOCK) */
DL2C_LANES static void dl2c_open_block(const dl2c_initials *lanes, int64_t count, uint8_t *enabled, uint8_t *open)
{
  model_guards(0, lanes->x, lanes->p, DL2C_BLOCK, DL2C_BLOCK, enabled);
  for (int k = 0; k < DL2C_NSTART; k++)
    memset(enabled + k * DL2C_BLOCK + count, 0, (size_t)(DL2C_BLOCK - count));
  dl2c_enabled_by_inputs(0, lanes->x, lanes->p, DL2C_BLOCK, DL2C_BLOCK, enabled);
  dl2c_any_enabled(enabled, DL2C_BLOCK, DL2C_BLOCK, open);
}

/* The constants in observations of a full block.   fixed: (DL2C_BLOCK, NFIXED) */
DL2C_LANES static void dl2c_fix_block(const real *p, dl2c_obs *fixed, uint8_t *clipped)
{
  dl2c_obs columns[NFIXED * DL2C_BLOCK + 1];
  model_observe_constants(p, DL2C_BLOCK, DL2C_BLOCK, DL2C_BLOCK, columns, clipped);
  dl2c_rows(NFIXED, NFIXED, DL2C_BLOCK, columns, fixed);
}

static void dl2c_draw_beginnings(const dl2c_batch *b, const dl2c_followers *who, dl2c_beginnings *all)
{
  dl2c_initials *drawn = &all->drawn;
  for (int64_t i = 0; i < who->count; i++) {
    const dl2c_rng rng = dl2c_rng_make(b->seed[who->env[i]], b->episode[who->env[i]]);
    for (int k = 0; k < 4; k++) drawn->points.stream[k * DL2C_BLOCK + i] = rng.s[k];
  }
  dl2c_draw_initials(drawn, who->count);
  memset(all->ended, 0, sizeof all->ended);
  dl2c_fix_block(drawn->p, all->fixed, all->clipped);
  const dl2c_view view = {drawn->x, drawn->p, DL2C_BLOCK, all->enabled, NULL, all->ended, all->fixed,
                          all->clipped};
  dl2c_open_block(drawn, who->count, all->enabled, all->open);
  dl2c_show_block(&view, all->obs, all->saturated, all->mask);
}

/* Takes lane i of the beginnings over into the environment whose episode it is. */
static void dl2c_take_over(dl2c_batch *b, int64_t env, const dl2c_beginnings *all, int64_t i)
{
  const bool at_once = b->options.autoreset == DL2C_AUTORESET_SAME_STEP;
  if (at_once)
    dl2c_keep_last(b, env);
  else
    dl2c_clear_results(b, env);
  for (int k = 0; k < NX; k++) b->x[k * b->stride + env] = all->drawn.x[k * DL2C_BLOCK + i];
  for (int k = 0; k < NP; k++) b->p[k * b->stride + env] = all->drawn.p[k * DL2C_BLOCK + i];
  for (int k = 0; k < DL2C_NSTART; k++)
    b->enabled[k * b->stride + env] = all->enabled[k * DL2C_BLOCK + i];
  memcpy(b->fixed + env * NFIXED, all->fixed + i * NFIXED, sizeof(dl2c_obs) * NFIXED);
  b->clipped[env] = all->clipped[i];
  memcpy((dl2c_obs *)b->out.obs + env * NOBS, all->obs + i * NOBS, sizeof(dl2c_obs) * NOBS);
  memcpy(b->out.mask + env * NMASK, all->mask + i * NMASK, NMASK);
  b->episode[env]++;
  dl2c_start_clocks(b, env);
  if (at_once) return;
  b->out.time[env] = 0.0;
  b->out.saturated[env] = all->saturated[i];
  dl2c_show_postcondition(b, env);
}

/* Begins the episodes that follow; `who` is empty afterwards. */
static dl2c_status dl2c_begin_followers(dl2c_batch *b, dl2c_followers *who)
{
  const bool together = DL2C_BEGINS_IN_LANES && who->count >= DL2C_DRAW_GROUP;
  dl2c_beginnings all;
  dl2c_status found = DL2C_OK;
  if (together) dl2c_draw_beginnings(b, who, &all);
  for (int64_t i = 0; i < who->count && found == DL2C_OK; i++)
    if (together && all.open[i] && !all.drawn.lost[i])
      dl2c_take_over(b, who->env[i], &all, i);
    else
      found = dl2c_next_episode(b, who->env[i]);
  who->count = 0;
  return found;
}

#endif
