/* SPDX-License-Identifier: MIT-0 */
/*
 * active_set.h -- a flow that dopri5.h integrates, for several environments at once.
 *
 * All lanes of a block attempt their steps together, each of its own length; whether a lane accepts its
 * step is a selection. Environments need different numbers of steps: lanes that are still going take the
 * places of those that have finished, so that the active set stays dense. A lane that meets an event
 * before its time is up is left to the scalar step, which computes the same bits.
 */
#ifndef DL2C_ACTIVE_SET_H
#define DL2C_ACTIVE_SET_H

#include "lanes.h"

#if DL2C_FLOWS_IN_LANES

/* Places of the active set whose steps are one vector loop. */
enum { DL2C_ACTIVE = 8 };

/* The environments of a block, one row per variable. */
typedef struct dl2c_block_flow {
  real x[NX][DL2C_BLOCK]; /* state where the flow begins */
  real p[NP + NFROZEN + 1][DL2C_BLOCK];
  int64_t going[DL2C_BLOCK]; /* lanes that are integrated */
  int64_t there[DL2C_BLOCK]; /* out: lanes that have reached the end of the flow */
  real y[NX][DL2C_BLOCK];    /* their states there */
  real stop[DL2C_BLOCK];     /* duration of the flow */
} dl2c_block_flow;

/* The active set, one column per place. */
typedef struct dl2c_active_set {
  real p[NP + NFROZEN + 1][DL2C_BLOCK];
  real y[NX][DL2C_BLOCK];
  real rates[NX][DL2C_BLOCK]; /* at y */
  real now[DL2C_BLOCK];
  real stop[DL2C_BLOCK];
  real wanted[DL2C_BLOCK]; /* length of the next attempted step */
  real error[DL2C_BLOCK];  /* of the last one; before the first one, how much the flow bends */
  int64_t fits[DL2C_BLOCK]; /* whether the error of the last one is small enough */
  real limit[DL2C_BLOCK];  /* beyond which dl2c_blows_up checks */
  int64_t going[DL2C_BLOCK];
  int64_t there[DL2C_BLOCK];
  int64_t lane[DL2C_BLOCK]; /* lane of the block, -1 for none */
  int64_t refilled;         /* places from 0 on that may hold another lane than they began with */
} dl2c_active_set;

/*
 * Executes the control of every lane where dl2c_decide_lane can, and marks those lanes as going.
 *   x: (NX, stride)   p: (NP, stride)   path: (count)   inputs: (count, NINPUT)
 */
DL2C_INLINE void dl2c_block_decide(dl2c_block_flow *f, const real *x, const real *p, int64_t stride,
                                    int64_t count, const int64_t *path, const real *inputs)
{
  DL2C_ALIAS_FREE
  for (int64_t i = 0; i < count; i++) {
    real own[NX];
    real start[NX];
    real constants[NP + 1];
    dl2c_read_lane(x, p, stride, i, own, constants);
    f->going[i] = dl2c_decide_lane(path[i], own, constants, inputs + i * NINPUT, start);
    f->there[i] = 0;
    DL2C_UNROLL
    for (int k = 0; k < NX; k++) f->x[k][i] = start[k];
    DL2C_UNROLL
    for (int k = 0; k < NP; k++) f->p[k][i] = constants[k];
  }
}

/* Fills places of the active set: every lane at its own, with its rates and how much its flow bends. */
DL2C_INLINE void dl2c_active_start(dl2c_active_set *c, dl2c_block_flow *f, int64_t first)
{
  DL2C_ALIAS_FREE
  for (int64_t i = first; i < first + DL2C_ACTIVE; i++) {
    real x[NX];
    real p[NP + NFROZEN + 1];
    real rates[NX];
    real stop;
    DL2C_UNROLL
    for (int k = 0; k < NX; k++) x[k] = f->x[k][i];
    DL2C_UNROLL
    for (int k = 0; k < NP; k++) p[k] = f->p[k][i];
    model_freeze(DL2C_LANE_FLOW, x, p);
    DL2C_UNROLL
    for (int k = NP; k < NP + NFROZEN; k++) f->p[k][i] = p[k];
    const bool begins = model_begin(DL2C_LANE_FLOW, x, p, &stop);
    model_rates(DL2C_LANE_FLOW, x, p, rates);
    const bool well = begins & (stop > 0.0) & dl2c_all_finite(x, NX) & dl2c_all_finite(rates, NX);
    f->stop[i] = stop;
    c->error[i] = dl2c_dopri_bend(DL2C_LANE_FLOW, x, rates, p, stop, &c->wanted[i]);
    c->stop[i] = stop;
    c->now[i] = 0.0;
    c->limit[i] = dl2c_growth_limit(x);
    c->going[i] = f->going[i] & (int64_t)well;
    c->there[i] = 0;
    c->lane[i] = i;
    DL2C_UNROLL
    for (int k = 0; k < NP + NFROZEN; k++) c->p[k][i] = p[k];
    DL2C_UNROLL
    for (int k = 0; k < NX; k++) c->y[k][i] = x[k];
    DL2C_UNROLL
    for (int k = 0; k < NX; k++) c->rates[k][i] = rates[k];
  }
}

/*
 * The lengths of their first steps. A root takes long to compute: in a loop of its own those of several
 * vectors overlap, here and in dl2c_active_lengths.
 */
DL2C_INLINE void dl2c_active_first_lengths(dl2c_active_set *c, int64_t first)
{
  DL2C_ALIAS_FREE
  for (int64_t i = first; i < first + DL2C_ACTIVE; i++)
    c->wanted[i] = dl2c_dopri_first(c->error[i], c->wanted[i]);
}

/* Whether a step is proved to have no event that matters (see dl2c_event_free). */
DL2C_INLINE bool dl2c_lane_event_free(const real *x, const real *y, const real *p, real h,
                                const real (*k)[NX])
{
  static const uint8_t watch[NWATCH + 1] = {DL2C_WATCHING};
  dl2c_hull hull[NX];
  DL2C_UNROLL
  for (int i = 0; i < NX; i++) {
    real c[DL2C_DOPRI_DEGREE + 1];
    real down = 0.0;
    real up = 0.0;
    dl2c_dopri_terms(x[i], y[i], h, k, i, c);
    DL2C_UNROLL
    for (int j = 1; j <= DL2C_DOPRI_DEGREE; j++) {
      down += dl2c_min(c[j], 0.0);
      up += dl2c_max(c[j], 0.0);
    }
    hull[i] = dl2c_terms_between(c[0], down, up, y[i]);
  }
  return model_event_free(DL2C_LANE_FLOW, hull, x, p, true, watch);
}

/* One attempted step at the places from `first` on, as in dl2c_dopri_step. */
DL2C_INLINE void dl2c_active_step(dl2c_active_set *c, int64_t first)
{
  DL2C_ALIAS_FREE
  for (int64_t i = first; i < first + DL2C_ACTIVE; i++) {
    real x[NX];
    real p[NP + NFROZEN + 1];
    real k[7][NX];
    real y[NX];
    DL2C_UNROLL
    for (int j = 0; j < NX; j++) x[j] = c->y[j][i];
    DL2C_UNROLL
    for (int j = 0; j < NP + NFROZEN; j++) p[j] = c->p[j][i];
    DL2C_UNROLL
    for (int j = 0; j < NX; j++) k[0][j] = c->rates[j][i];
    const real now = c->now[i];
    const real left = c->stop[i] - now;
    const bool whole = !(c->wanted[i] < left);
    const real h = dl2c_select(whole, left, c->wanted[i]);
    const real after = dl2c_select(whole, c->stop[i], now + h);
    const real error = dl2c_dopri_try(DL2C_LANE_FLOW, p, x, h, k, y);
    bool fits = error <= 1.0;
    bool grown = false;
    DL2C_UNROLL
    for (int j = 0; j < NX; j++) {
      if (!model_moves(DL2C_LANE_FLOW, j)) continue;
      fits &= dl2c_finite(y[j]);
      grown |= fabs(y[j]) > c->limit[i];
    }
    const bool event_free = dl2c_lane_event_free(x, y, p, h, (const real(*)[NX])k);
    const bool proved = event_free & !grown;
    const bool well = (now + h > now) & (!fits | proved);
    const bool taken = (c->going[i] != 0) & fits & well;
    const bool there = taken & (after >= c->stop[i]);
    c->wanted[i] = h;
    c->error[i] = error;
    c->fits[i] = (int64_t)fits;
    c->now[i] = dl2c_select(taken, after, now);
    c->there[i] |= (int64_t)there;
    c->going[i] &= (int64_t)(well & !there);
    DL2C_UNROLL
    for (int j = 0; j < NX; j++) {
      if (!model_moves(DL2C_LANE_FLOW, j)) continue;
      c->y[j][i] = dl2c_select(taken, y[j], x[j]);
      c->rates[j][i] = dl2c_select(taken, k[6][j], k[0][j]);
    }
  }
}

/* The lengths of their next steps. */
DL2C_INLINE void dl2c_active_lengths(dl2c_active_set *c, int64_t first)
{
  DL2C_ALIAS_FREE
  for (int64_t i = first; i < first + DL2C_ACTIVE; i++) {
    const real h = c->wanted[i];
    const real error = c->error[i];
    const real next = h * dl2c_dopri_factor(error);
    c->wanted[i] = dl2c_select(c->fits[i] != 0, next, dl2c_dopri_shorter(h, error, next));
  }
}

/* Copies what the lane at a place has come to into the block. */
static void dl2c_active_write(const dl2c_active_set *c, int64_t place, dl2c_block_flow *f)
{
  const int64_t lane = c->lane[place];
  if (lane < 0) return;
  f->there[lane] = c->there[place];
  DL2C_UNROLL
  for (int k = 0; k < NX; k++)
    if (model_moves(DL2C_LANE_FLOW, k)) f->y[k][lane] = c->y[k][place];
}

/* Moves a lane that is going from one place to another. */
static void dl2c_active_move(dl2c_active_set *c, int64_t from, int64_t to)
{
  DL2C_UNROLL
  for (int k = 0; k < NP + NFROZEN; k++) c->p[k][to] = c->p[k][from];
  DL2C_UNROLL
  for (int k = 0; k < NX; k++) c->y[k][to] = c->y[k][from];
  DL2C_UNROLL
  for (int k = 0; k < NX; k++)
    if (model_moves(DL2C_LANE_FLOW, k)) c->rates[k][to] = c->rates[k][from];
  c->now[to] = c->now[from];
  c->stop[to] = c->stop[from];
  c->wanted[to] = c->wanted[from];
  c->limit[to] = c->limit[from];
  c->going[to] = 1;
  c->there[to] = 0;
  c->lane[to] = c->lane[from];
  c->lane[from] = -1;
}

/*
 * Of the first `width` places, how many have to be stepped: a multiple of DL2C_ACTIVE that takes all lanes
 * still going. Those behind them move to places of lanes that have finished.
 */
static int64_t dl2c_active_compact(dl2c_active_set *c, int64_t width, dl2c_block_flow *f)
{
  int64_t going = 0;
  for (int64_t i = 0; i < width; i++) going += c->going[i];
  const int64_t needed = (going + DL2C_ACTIVE - 1) / DL2C_ACTIVE * DL2C_ACTIVE;
  int64_t place = 0;
  for (int64_t i = needed; i < width; i++) {
    if (!c->going[i]) continue;
    while (c->going[place]) place++;
    dl2c_active_write(c, place, f);
    dl2c_active_move(c, i, place++);
  }
  c->refilled = place > c->refilled ? place : c->refilled;
  return needed;
}

/* Completes the flow of the lanes that reached its end, as dl2c_arrive does. */
DL2C_INLINE void dl2c_block_finish(dl2c_block_flow *f, const dl2c_active_set *c, int64_t first)
{
  DL2C_ALIAS_FREE
  for (int64_t i = first; i < first + DL2C_ACTIVE; i++) {
    real x[NX];
    real y[NX];
    real p[NP + NFROZEN + 1];
    int8_t sign[NMARGIN];
    const bool stayed = c->lane[i] == i;
    const bool there = (stayed & (c->there[i] != 0)) | (!stayed & (f->there[i] != 0));
    DL2C_UNROLL
    for (int k = 0; k < NMARGIN; k++) sign[k] = 1;
    DL2C_UNROLL
    for (int k = 0; k < NX; k++) x[k] = f->x[k][i];
    DL2C_UNROLL
    for (int k = 0; k < NX; k++)
      y[k] = model_moves(DL2C_LANE_FLOW, k) ? dl2c_select(stayed, c->y[k][i], f->y[k][i]) : x[k];
    DL2C_UNROLL
    for (int k = 0; k < NP + NFROZEN; k++) p[k] = f->p[k][i];
    dl2c_project(DL2C_LANE_FLOW, p, NULL, y);
    dl2c_snap(DL2C_LANE_FLOW, x, p, f->stop[i], sign, y);
    f->there[i] = (int64_t)(there & dl2c_all_finite(y, NX) & model_inside(DL2C_LANE_FLOW, y, p));
    DL2C_UNROLL
    for (int k = 0; k < NX; k++) f->y[k][i] = y[k];
  }
}

/* Integrates the flow in all lanes that are going. */
DL2C_LANES static void dl2c_block_integrate(dl2c_block_flow *f, int64_t count)
{
  dl2c_active_set set;
  int64_t width = (count + DL2C_ACTIVE - 1) / DL2C_ACTIVE * DL2C_ACTIVE;
  const int64_t all = width;
  set.refilled = 0;
  for (int64_t i = 0; i < all; i += DL2C_ACTIVE) dl2c_active_start(&set, f, i);
  for (int64_t i = 0; i < all; i += DL2C_ACTIVE) dl2c_active_first_lengths(&set, i);
  for (int attempt = 0; attempt < DL2C_DOPRI_STEPS; attempt++) {
    width = dl2c_active_compact(&set, width, f);
    if (width == 0) break;
    for (int64_t i = 0; i < width; i += DL2C_ACTIVE) dl2c_active_step(&set, i);
    for (int64_t i = 0; i < width; i += DL2C_ACTIVE) dl2c_active_lengths(&set, i);
  }
  for (int64_t i = 0; i < set.refilled; i++)
    if (set.lane[i] != i) dl2c_active_write(&set, i, f);
  for (int64_t i = 0; i < all; i += DL2C_ACTIVE) dl2c_block_finish(f, &set, i);
}

#endif
#endif
