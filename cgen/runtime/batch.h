/* SPDX-License-Identifier: MIT-0 */
/* batch.h -- the calls of dl2c.h. Compiled with one model. */
#ifndef DL2C_BATCH_H
#define DL2C_BATCH_H

#include <stdlib.h>

#include "snapshot.h"
#include "threads.h"
#if DL2C_INSPECT
#include "inspect.h"
#endif

#ifndef DL2C_SCENE
#define DL2C_SCENE 0 /* the model has no scene */
#endif

int32_t dl2c_abi_version(void) { return DL2C_ABI_VERSION; }
int32_t dl2c_stream_version(void) { return DL2C_STREAM_VERSION; }

void dl2c_model_sizes(dl2c_sizes *out)
{
  *out = (dl2c_sizes){
      .nx = NX,
      .np = NCONSTANT,
      .nobs = NOBS,
      .nchoice = NCHOICE,
      .ninput = NINPUT,
      .nenvchoice = NENVCHOICE,
      .nenvinput = NENVINPUT,
      .nmask = NMASK,
      .npred = NPRED,
      .nflow = NFLOW,
      .nroot = NROOT,
      .obs_size = (int32_t)sizeof(dl2c_obs),
      .snapshot_size = (int32_t)sizeof(dl2c_snapshot),
      .nscene = DL2C_SCENE,
  };
}

/* Environments that a batch may have: products of sizes stay far below SIZE_MAX. */
#define DL2C_MOST INT32_MAX

static bool dl2c_options_valid(const dl2c_options *o)
{
  return o->max_steps >= 0 && o->stall_limit >= 0 && isfinite(o->blocked_penalty)
         && o->autoreset >= DL2C_AUTORESET_DISABLED && o->autoreset <= DL2C_AUTORESET_SAME_STEP
         && o->on_blocked >= DL2C_BLOCKED_FALLBACK && o->on_blocked <= DL2C_BLOCKED_TERMINATE
         && (o->action_map == DL2C_MAP_PROJECT || o->action_map == DL2C_MAP_SQUASH)
         && o->threads >= 0 && o->threads <= DL2C_MOST_THREADS
         && (o->shared_obs == 0 || o->shared_obs == 1);
}

/* Zeros from the beginning of a cache line on, to be given back to `free`; NULL where there is no memory. */
static void *dl2c_cleared(size_t count, size_t size)
{
  const size_t lines = (count * size + DL2C_CACHE_LINE - 1) / DL2C_CACHE_LINE;
  void *memory = aligned_alloc(DL2C_CACHE_LINE, lines * DL2C_CACHE_LINE);
  if (memory != NULL) memset(memory, 0, lines * DL2C_CACHE_LINE);
  return memory;
}

dl2c_status dl2c_batch_create(int64_t n, const dl2c_options *options, const dl2c_buffers *buffers,
                              dl2c_batch **out)
{
  if (n <= 0 || options == NULL || buffers == NULL || out == NULL) return DL2C_ERR_ARG;
  if (!dl2c_options_valid(options)) return DL2C_ERR_ARG;
  if (n > DL2C_MOST) return DL2C_ERR_NOMEM;
  dl2c_batch *b = calloc(1, sizeof *b);
  if (b == NULL) return DL2C_ERR_NOMEM;
  const size_t rows = (size_t)n;
  b->stride = dl2c_stride(n);
  const size_t wide = (size_t)b->stride;
  b->n = n;
  b->options = *options;
  b->out = *buffers;
  b->x = dl2c_cleared(wide * (NX + 1), sizeof *b->x);
  b->p = dl2c_cleared(wide * (NP + 1), sizeof *b->p);
  b->enabled = dl2c_cleared(wide * ((size_t)DL2C_NSTART + 1), sizeof *b->enabled);
  b->ended = dl2c_cleared(rows, sizeof *b->ended);
  b->seed = dl2c_cleared(rows, sizeof *b->seed);
  b->episode = dl2c_cleared(rows, sizeof *b->episode);
  b->steps = dl2c_cleared(rows, sizeof *b->steps);
  b->elapsed = dl2c_cleared(rows, sizeof *b->elapsed);
  b->stalled = dl2c_cleared(rows, sizeof *b->stalled);
  b->rng = dl2c_cleared(NSTEPDRAW > 0 ? rows : 1, sizeof *b->rng);
  b->start = dl2c_cleared(NSTEPDRAW > 0 ? rows : 1, sizeof *b->start);
  b->scalar_steps = dl2c_cleared(DL2C_FLOWS_IN_LANES ? rows / DL2C_BLOCK + 1 : 1, sizeof *b->scalar_steps);
  b->fixed = dl2c_cleared(rows * NFIXED + 1, sizeof *b->fixed);
  b->clipped = dl2c_cleared(rows, sizeof *b->clipped);
  b->seen = dl2c_cleared(DL2C_LOOKS_AHEAD ? rows * NMASK + 1 : 1, sizeof *b->seen);
#if DL2C_INSPECT
  b->followed = calloc(rows * DL2C_INSPECT_FLOWS, sizeof *b->followed);
  b->nfollowed = calloc(rows, sizeof *b->nfollowed);
  if (!b->followed || !b->nfollowed) {
    dl2c_batch_free(b);
    return DL2C_ERR_NOMEM;
  }
#endif
  if (!b->x || !b->p || !b->enabled || !b->ended || !b->seed || !b->episode || !b->steps
      || !b->elapsed || !b->stalled || !b->rng || !b->start || !b->scalar_steps
      || !b->fixed || !b->clipped || !b->seen) {
    dl2c_batch_free(b);
    return DL2C_ERR_NOMEM;
  }
#if DL2C_SOLVED_FLOWS
  const dl2c_status solver = dl2c_solver_new(DL2C_RTOL, DL2C_ATOL, DL2C_STIFF, &b->solver);
  if (solver != DL2C_OK) {
    dl2c_batch_free(b);
    return solver;
  }
#endif
  const dl2c_status team = dl2c_team_create(b, options->threads);
  if (team != DL2C_OK) {
    dl2c_batch_free(b);
    return team;
  }
  *out = b;
  return DL2C_OK;
}

void dl2c_batch_free(dl2c_batch *b)
{
  if (b == NULL) return;
  dl2c_team_free(b->team);
#if DL2C_SOLVED_FLOWS
  dl2c_solver_free(b->solver);
#endif
  free(b->x);
  free(b->p);
  free(b->enabled);
  free(b->ended);
  free(b->seed);
  free(b->episode);
  free(b->steps);
  free(b->elapsed);
  free(b->stalled);
  free(b->rng);
  free(b->start);
  free(b->scalar_steps);
  free(b->fixed);
  free(b->clipped);
  free(b->seen);
#if DL2C_INSPECT
  free(b->followed);
  free(b->nfollowed);
#endif
  free(b);
}

/* Whether all constants are numbers.   p: (n) */
static bool dl2c_are_numbers(const real *p, int n)
{
  bool finite = true;
  for (int k = 0; k < n; k++) finite &= isfinite(p[k]) != 0;
  return finite;
}

static void dl2c_reseed(dl2c_batch *b, int64_t i, const uint64_t *seed)
{
  if (seed == NULL) return;
  b->seed[i] = *seed;
  b->episode[i] = 0;
}

static dl2c_status dl2c_reset_blocks(dl2c_batch *b, int64_t first, int64_t count,
                                     const dl2c_order *order)
{
  for (int64_t i = first; i < first + count; i++) {
    if (order->mask != NULL && !order->mask[i]) continue;
    dl2c_reseed(b, i, order->seeds == NULL ? NULL : &order->seeds[i]);
    dl2c_clear_results(b, i);
    const dl2c_status status = dl2c_reset_one(b, i);
    if (status != DL2C_OK) return status;
  }
  return DL2C_OK;
}

dl2c_status dl2c_batch_reset(dl2c_batch *b, const uint8_t *mask, const uint64_t *seeds)
{
  if (b == NULL) return DL2C_ERR_ARG;
  dl2c_leave_upper_halves();
  return dl2c_together(b, dl2c_reset_blocks, &(dl2c_order){mask, seeds});
}

dl2c_status dl2c_batch_reset_to(dl2c_batch *b, int64_t i, const uint64_t *seed, const double *x,
                                const double *p)
{
  if (b == NULL || i < 0 || i >= b->n || x == NULL || p == NULL) return DL2C_ERR_ARG;
  if (!dl2c_all_finite(x, NX) || !dl2c_are_numbers(p, NCONSTANT) || !model_precondition(x, p))
    return DL2C_ERR_STATE;
  real constants[NP + 1] = {0.0}; /* there may be none */
  dl2c_complete_constants(p, constants);
  const uint64_t key = seed == NULL ? b->seed[i] : *seed;
  dl2c_rng rng = dl2c_rng_make(key, seed == NULL ? b->episode[i] : 0);
  for (int tries = 0; tries < (NDRAW > 0 ? DL2C_MAX_DEADLOCKS : 1); tries++) {
    if (!dl2c_begin(b, i, &rng, x, constants)) continue;
    dl2c_reseed(b, i, seed);
    b->episode[i]++;
    dl2c_clear_results(b, i);
    return DL2C_OK;
  }
  return DL2C_ERR_STATE;
}

static dl2c_status dl2c_advance_blocks(dl2c_batch *b, int64_t first, int64_t count,
                                       const dl2c_order *order)
{
  (void)order;
  return dl2c_step_blocks(b, first, count);
}

dl2c_status dl2c_batch_step(dl2c_batch *b)
{
  if (b == NULL) return DL2C_ERR_ARG;
  dl2c_leave_upper_halves();
  return dl2c_together(b, dl2c_advance_blocks, NULL);
}

/*
 * Whether a path meets a decision of the agent, or leads to a point that does. Cold, as its caller is: steps
 * are faster without these between their functions.   points: (NPOINT)
 */
__attribute__((cold)) static bool dl2c_path_decides(const dl2c_path *path, const bool *points)
{
  const int duration = path->flow == DL2C_NO_FLOW ? -1 : FLOW_DURATION[path->flow];
  bool decides = duration >= 0 && duration < NINPUT;
  for (int k = 0; k < path->nmet; k++) decides |= path->met[k] < NCHOICE;
  for (int k = 0; k < path->ninput; k++) decides |= path->inputs[k].input < NINPUT;
  return decides || (path->next != DL2C_END && points[path->next]);
}

__attribute__((cold)) dl2c_status dl2c_batch_decides(const dl2c_batch *b, uint8_t *decides)
{
  if (b == NULL || decides == NULL) return DL2C_ERR_ARG;
  bool points[NPOINT] = {false}; /* from where on a decision may be met, however many points later */
  for (int round = 0; round < NPOINT; round++)
    for (int m = 0; m < NPOINT; m++)
      for (int k = POINT_START[m]; k < POINT_START[m + 1]; k++)
        points[m] |= dl2c_path_decides(&PATHS[k], points);
  memset(decides, 0, (size_t)b->n);
  for (int k = 0; k < DL2C_NSTART; k++) {
    if (!dl2c_path_decides(&PATHS[k], points)) continue;
    for (int64_t i = 0; i < b->n; i++) decides[i] |= b->enabled[k * b->stride + i] & !b->ended[i];
  }
  return DL2C_OK;
}

dl2c_status dl2c_batch_get_state(const dl2c_batch *b, int64_t i, double *x, double *p)
{
  if (b == NULL || i < 0 || i >= b->n || x == NULL || p == NULL) return DL2C_ERR_ARG;
  for (int k = 0; k < NX; k++) x[k] = b->x[k * b->stride + i];
  for (int k = 0; k < NCONSTANT; k++) p[k] = b->p[k * b->stride + i];
  return DL2C_OK;
}

dl2c_status dl2c_batch_set_state(dl2c_batch *b, int64_t i, const double *x, const double *p)
{
  if (b == NULL || i < 0 || i >= b->n || x == NULL || p == NULL) return DL2C_ERR_ARG;
  if (!dl2c_all_finite(x, NX) || !dl2c_are_numbers(p, NCONSTANT)) return DL2C_ERR_STATE;
  real constants[NP + 1] = {0.0}; /* there may be none */
  dl2c_complete_constants(p, constants);
  dl2c_forget(b, i);
  dl2c_store(b, i, x);
  for (int k = 0; k < NP; k++) b->p[k * b->stride + i] = constants[k];
  b->ended[i] = 0;
  if (NSTEPDRAW > 0) b->start[i].closed = false;
#if DL2C_MONITORED
  memcpy(b->start[NSTEPDRAW > 0 ? i : 0].trial.before, x, sizeof(real) * NX);
  b->start[NSTEPDRAW > 0 ? i : 0].trial.unexplained = DL2C_POINT_LEAD > 0;
#endif
  dl2c_show_postcondition(b, i);
  dl2c_show(b, i);
  return DL2C_OK;
}

dl2c_status dl2c_batch_save(const dl2c_batch *b, int64_t i, void *snapshot)
{
  if (b == NULL || i < 0 || i >= b->n || snapshot == NULL) return DL2C_ERR_ARG;
  dl2c_snapshot kept;
  dl2c_keep(b, i, &kept);
  memcpy(snapshot, &kept, sizeof kept);
  return DL2C_OK;
}

dl2c_status dl2c_batch_restore(dl2c_batch *b, int64_t i, const void *snapshot)
{
  if (b == NULL || i < 0 || i >= b->n || snapshot == NULL) return DL2C_ERR_ARG;
  dl2c_snapshot kept;
  memcpy(&kept, snapshot, sizeof kept);
  dl2c_return_to(b, i, &kept);
  return DL2C_OK;
}

dl2c_status dl2c_flow_rates(int32_t flow, const double *x, const double *p, double *dx)
{
  if (flow < 0 || flow >= NFLOW || x == NULL || p == NULL || dx == NULL) return DL2C_ERR_ARG;
  model_rates(flow, x, p, dx);
  return DL2C_OK;
}

dl2c_status dl2c_flow_roots(int32_t flow, const double *x, const double *p, double *g, double *dg)
{
  if (flow < 0 || flow >= NFLOW || x == NULL || p == NULL || g == NULL || dg == NULL)
    return DL2C_ERR_ARG;
  model_roots(flow, x, p, g, dg);
  return DL2C_OK;
}

dl2c_status dl2c_scene_values(const double *x, const double *p, double *values)
{
  if (x == NULL || p == NULL || values == NULL) return DL2C_ERR_ARG;
#if DL2C_SCENE > 0
  model_scene(x, p, values);
#endif
  return DL2C_OK;
}

#if !DL2C_SOLVED_FLOWS
/* No flow of this model needs a solver. */
dl2c_status dl2c_solver_library(const char *path, char *problem, size_t capacity)
{
  if (path == NULL || problem == NULL || capacity == 0) return DL2C_ERR_ARG;
  problem[0] = '\0';
  return DL2C_OK;
}
#endif

const char *dl2c_status_text(dl2c_status status)
{
  switch (status) {
  case DL2C_OK: return "ok";
  case DL2C_ERR_ARG: return "a null pointer, or a size, an index or an option out of range";
  case DL2C_ERR_NOMEM: return "out of memory";
  case DL2C_ERR_RESET: return "no admissible initial state was found";
  case DL2C_ERR_BLOCKED: return "none of 1000 initial states that were drawn has a run";
  case DL2C_ERR_STATE: return "the state violates the precondition, or no run is possible from it";
  case DL2C_ERR_MONITOR: return "a step violates the monitor of its model";
  case DL2C_ERR_SOLVER: return "the library of differential equation solvers is missing or unfit";
  }
  return "unknown status";
}

#endif
