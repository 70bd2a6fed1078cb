/* SPDX-License-Identifier: MIT-0 */
/* snapshot.h -- everything that an environment keeps between steps, saved and restored. */
#ifndef DL2C_SNAPSHOT_H
#define DL2C_SNAPSHOT_H

#include "move.h"

typedef struct dl2c_snapshot {
  uint64_t ended; /* comes first: 1 where the episode is over and waits for a reset, else 0 */
  uint64_t seed;
  uint64_t episode;
  int64_t steps;
  int64_t stalled;
  real elapsed;
  real x[NX];
  real p[NP + 1];
  dl2c_rng rng;
  dl2c_start start;
} dl2c_snapshot;

static void dl2c_keep(const dl2c_batch *b, int64_t i, dl2c_snapshot *kept)
{
  memset(kept, 0, sizeof *kept);
  kept->seed = b->seed[i];
  kept->episode = b->episode[i];
  kept->steps = b->steps[i];
  kept->stalled = b->stalled[i];
  kept->elapsed = b->elapsed[i];
  kept->ended = b->ended[i];
  dl2c_load(b, i, kept->x, kept->p);
  if (NSTEPDRAW > 0) {
    kept->rng = b->rng[i];
    memcpy(&kept->start, &b->start[i], sizeof kept->start);
  }
}

/* Restores environment i from the snapshot of itself or another one, and shows it. */
static void dl2c_return_to(dl2c_batch *b, int64_t i, const dl2c_snapshot *kept)
{
  dl2c_forget(b, i);
  b->seed[i] = kept->seed;
  b->episode[i] = kept->episode;
  b->steps[i] = kept->steps;
  b->stalled[i] = kept->stalled;
  b->elapsed[i] = kept->elapsed;
  b->ended[i] = kept->ended != 0;
  dl2c_store(b, i, kept->x);
  for (int k = 0; k < NP; k++) b->p[k * b->stride + i] = kept->p[k];
  if (NSTEPDRAW > 0) {
    b->rng[i] = kept->rng;
    memcpy(&b->start[i], &kept->start, sizeof kept->start);
  }
  dl2c_clear_results(b, i);
  b->out.reset[i] = 0;
  b->out.time[i] = kept->elapsed;
  dl2c_show_postcondition(b, i);
  dl2c_show(b, i);
}

#endif
