/* SPDX-License-Identifier: MIT-0 */
/*
 * threads.h -- the blocks of a batch, shared among threads.
 *
 * Environments are independent, so results do not depend on which thread steps which. Threads take
 * blocks in order until none is left. Each sees the batch through a copy of its own, which differs
 * in the solver alone. -DDL2C_NO_THREADS leaves only the caller's thread, for systems without
 * others.
 */
#ifndef DL2C_THREADS_H
#define DL2C_THREADS_H

#include "block.h"

#ifndef DL2C_NO_THREADS
#include <pthread.h>
#include <stdatomic.h>
#include <unistd.h>
#endif

enum { DL2C_MOST_THREADS = 256 };

/* Which environments begin an episode, and from which seeds; see dl2c_batch_reset. */
typedef struct dl2c_order {
  const uint8_t *mask;
  const uint64_t *seeds;
} dl2c_order;

/* What is done to the blocks of environments `first` to `first + count`. */
typedef dl2c_status (*dl2c_work)(dl2c_batch *b, int64_t first, int64_t count,
                                 const dl2c_order *order);

static int64_t dl2c_blocks(const dl2c_batch *b) { return (b->n + DL2C_BLOCK - 1) / DL2C_BLOCK; }

/* Blocks whose episodes that follow begin together. */
enum { DL2C_MOST_BLOCKS = 16 };

DL2C_INLINE dl2c_status dl2c_do_blocks(dl2c_batch *b, int64_t block, int64_t some, dl2c_work work,
                                       const dl2c_order *order)
{
  const int64_t first = block * DL2C_BLOCK;
  const int64_t rest = b->n - first;
  return work(b, first, rest < some * DL2C_BLOCK ? rest : some * DL2C_BLOCK, order);
}

/*
 * All blocks in order, up to the first that fails. A violation that a monitor reports stops
 * nothing.
 */
DL2C_INLINE dl2c_status dl2c_alone(dl2c_batch *b, dl2c_work work, const dl2c_order *order)
{
  const int64_t blocks = dl2c_blocks(b);
  dl2c_status found = DL2C_OK;
  for (int64_t block = 0; block < blocks; block += DL2C_MOST_BLOCKS) {
    const dl2c_status status = dl2c_do_blocks(b, block, DL2C_MOST_BLOCKS, work, order);
    if (status == DL2C_OK) continue;
    if (status != DL2C_ERR_MONITOR) return status;
    found = status;
  }
  return found;
}

#ifdef DL2C_NO_THREADS

static dl2c_status dl2c_team_create(dl2c_batch *b, int32_t threads)
{
  (void)b, (void)threads;
  return DL2C_OK;
}

static void dl2c_team_free(struct dl2c_team *team) { (void)team; }

DL2C_INLINE dl2c_status dl2c_together(dl2c_batch *b, dl2c_work work, const dl2c_order *order)
{
  return dl2c_alone(b, work, order);
}

#else

typedef struct dl2c_member {
  struct dl2c_team *team;
  dl2c_batch view;
  pthread_t thread;
} dl2c_member;

typedef struct dl2c_team {
  pid_t owner;  /* threads do not survive a fork */
  int32_t size; /* threads beside the caller's */
  dl2c_member *members;
  pthread_mutex_t lock; /* of what follows, but `next` */
  pthread_cond_t called;
  pthread_cond_t finished;
  uint64_t call; /* calls so far */
  int32_t busy;  /* threads that still work on the present one */
  bool dismissed;
  dl2c_work work;
  const dl2c_order *order;
  int64_t blocks;
  int64_t failed; /* the first block that failed, and how */
  dl2c_status status;
  bool objected; /* a monitor did */
  _Atomic int64_t next; /* the first block that nobody has taken */
} dl2c_team;

static void dl2c_fail(dl2c_team *team, int64_t block, dl2c_status status)
{
  const bool objects = status == DL2C_ERR_MONITOR;
  pthread_mutex_lock(&team->lock);
  team->objected |= objects;
  if (!objects && block < team->failed) {
    team->failed = block;
    team->status = status;
  }
  pthread_mutex_unlock(&team->lock);
  if (!objects) atomic_store(&team->next, team->blocks);
}

/* Works on blocks of the present call until all are taken, a few at a time. */
static void dl2c_take_part(dl2c_team *team, dl2c_batch *view)
{
  enum { TURNS = 8 };
  const int64_t share = team->blocks / (TURNS * (team->size + 1)) + 1;
  const int64_t some = share < DL2C_MOST_BLOCKS ? share : DL2C_MOST_BLOCKS;
  for (;;) {
    const int64_t first = atomic_fetch_add(&team->next, some);
    if (first >= team->blocks) return;
    const dl2c_status status = dl2c_do_blocks(view, first, some, team->work, team->order);
    if (status == DL2C_OK) continue;
    dl2c_fail(team, first, status);
    if (status != DL2C_ERR_MONITOR) return;
  }
}

static void *dl2c_worker(void *data)
{
  dl2c_member *const member = data;
  dl2c_team *const team = member->team;
  uint64_t served = 0;
  pthread_mutex_lock(&team->lock);
  for (;;) {
    while (team->call == served && !team->dismissed) pthread_cond_wait(&team->called, &team->lock);
    if (team->dismissed) break;
    served = team->call;
    pthread_mutex_unlock(&team->lock);
    dl2c_take_part(team, &member->view);
    pthread_mutex_lock(&team->lock);
    if (--team->busy == 0) pthread_cond_signal(&team->finished);
  }
  pthread_mutex_unlock(&team->lock);
  return NULL;
}

static void dl2c_team_free(dl2c_team *team)
{
  if (team == NULL) return;
  if (team->owner == getpid()) {
    pthread_mutex_lock(&team->lock);
    team->dismissed = true;
    pthread_cond_broadcast(&team->called);
    pthread_mutex_unlock(&team->lock);
    for (int32_t k = 0; k < team->size; k++) pthread_join(team->members[k].thread, NULL);
    pthread_cond_destroy(&team->finished);
    pthread_cond_destroy(&team->called);
    pthread_mutex_destroy(&team->lock);
  }
#if DL2C_SOLVED_FLOWS
  for (int32_t k = 0; k < team->size; k++) dl2c_solver_free(team->members[k].view.solver);
#endif
  free(team->members);
  free(team);
}

/* One more thread; false if the system gives none. */
static dl2c_status dl2c_start_thread(dl2c_team *team, const dl2c_batch *b)
{
  dl2c_member *const member = &team->members[team->size];
  *member = (dl2c_member){.team = team, .view = *b};
#if DL2C_SOLVED_FLOWS
  const dl2c_status solver =
      dl2c_solver_new(DL2C_RTOL, DL2C_ATOL, DL2C_STIFF, &member->view.solver);
  if (solver != DL2C_OK) return solver;
#endif
  if (pthread_create(&member->thread, NULL, dl2c_worker, member) == 0) {
    team->size++;
    return DL2C_OK;
  }
#if DL2C_SOLVED_FLOWS
  dl2c_solver_free(member->view.solver);
#endif
  return DL2C_ERR_NOMEM;
}

/* Starts the threads of a batch: as many as there are blocks at most. */
static dl2c_status dl2c_team_create(dl2c_batch *b, int32_t threads)
{
  const int64_t blocks = dl2c_blocks(b);
  const int64_t wanted = (threads < blocks ? threads : blocks) - 1;
  if (wanted <= 0) return DL2C_OK;
  dl2c_team *const team = calloc(1, sizeof *team);
  if (team == NULL) return DL2C_ERR_NOMEM;
  team->members = calloc((size_t)wanted, sizeof *team->members);
  if (team->members == NULL || pthread_mutex_init(&team->lock, NULL) != 0) {
    free(team->members);
    free(team);
    return DL2C_ERR_NOMEM;
  }
  pthread_cond_init(&team->called, NULL);
  pthread_cond_init(&team->finished, NULL);
  team->owner = getpid();
  team->blocks = blocks;
  dl2c_status status = DL2C_OK;
  for (int64_t k = 0; k < wanted && status == DL2C_OK; k++) status = dl2c_start_thread(team, b);
  if (status == DL2C_OK) {
    b->team = team;
  } else {
    dl2c_team_free(team);
  }
  return status;
}

/* All blocks, by all threads; in a forked copy of the process by the caller's alone. */
DL2C_INLINE dl2c_status dl2c_together(dl2c_batch *b, dl2c_work work, const dl2c_order *order)
{
  dl2c_team *const team = b->team;
  if (team == NULL || team->owner != getpid()) return dl2c_alone(b, work, order);
  pthread_mutex_lock(&team->lock);
  team->work = work;
  team->order = order;
  team->failed = team->blocks;
  team->status = DL2C_OK;
  team->objected = false;
  team->busy = team->size;
  team->call++;
  atomic_store(&team->next, 0);
  pthread_cond_broadcast(&team->called);
  pthread_mutex_unlock(&team->lock);
  dl2c_take_part(team, b);
  pthread_mutex_lock(&team->lock);
  while (team->busy > 0) pthread_cond_wait(&team->finished, &team->lock);
  const bool objected = team->status == DL2C_OK && team->objected;
  const dl2c_status status = objected ? DL2C_ERR_MONITOR : team->status;
  pthread_mutex_unlock(&team->lock);
  return status;
}

#endif

#endif
