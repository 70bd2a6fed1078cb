/* SPDX-License-Identifier: MIT-0 */
/*
 * active_set.h -- a flow that dopri5.h integrates, for several environments at once.
 *
 * An active set of DL2C_ACTIVE lanes attempts its steps together, each of its own length; whether
 * a lane accepts its step is a selection. Environments need different numbers of steps: when a
 * lane is finished, the next environment of the block takes its place. A lane that meets an event
 * before its time is up is left to the scalar step, which computes the same bits.
 */
#ifndef DL2C_ACTIVE_SET_H
#define DL2C_ACTIVE_SET_H

#include "lanes.h"

#if DL2C_FLOWS_IN_LANES

enum { DL2C_ACTIVE = 8 };

/* The environments of a block, one row per variable. */
typedef struct dl2c_block_flow {
  real x[NX][DL2C_BLOCK]; /* state where the flow begins */
  real p[NP + NFROZEN + 1][DL2C_BLOCK];
  int64_t going[DL2C_BLOCK]; /* lanes that are integrated */
  int64_t there[DL2C_BLOCK]; /* out: lanes that have reached the end of the flow */
  real y[NX][DL2C_BLOCK];    /* their states there */
  real stop[DL2C_BLOCK];     /* duration of the flow */
  real rates[NX][DL2C_BLOCK]; /* at x */
  real wanted[DL2C_BLOCK];    /* length of the first attempted step */
  real limit[DL2C_BLOCK];     /* dl2c_growth_limit */
} dl2c_block_flow;

/* The active set. */
typedef struct dl2c_active_set {
  real p[NP + NFROZEN + 1][DL2C_ACTIVE];
  real y[NX][DL2C_ACTIVE];
  real rates[NX][DL2C_ACTIVE]; /* at y */
  real now[DL2C_ACTIVE];
  real stop[DL2C_ACTIVE];
  real wanted[DL2C_ACTIVE]; /* length of the next attempted step */
  real limit[DL2C_ACTIVE];  /* beyond which dl2c_blows_up checks */
  int64_t going[DL2C_ACTIVE];
  int64_t there[DL2C_ACTIVE];
  int64_t lane[DL2C_ACTIVE]; /* lane of the block, -1 for none */
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

/* Rates and first step lengths of all lanes. */
DL2C_INLINE void dl2c_block_start(dl2c_block_flow *f, int64_t count)
{
  DL2C_ALIAS_FREE
  for (int64_t i = 0; i < count; i++) {
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
    const bool well = begins & (stop > 0.0) & dl2c_all_finite(rates, NX);
    f->wanted[i] = dl2c_dopri_first(DL2C_LANE_FLOW, x, rates, p, stop);
    f->stop[i] = stop;
    f->limit[i] = dl2c_growth_limit(x);
    f->going[i] &= (int64_t)well;
    DL2C_UNROLL
    for (int k = 0; k < NX; k++) f->rates[k][i] = rates[k];
  }
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

/* One attempted step of every lane, as in dl2c_dopri_step. */
DL2C_INLINE void dl2c_active_step(dl2c_active_set *c)
{
  DL2C_ALIAS_FREE
  for (int64_t i = 0; i < DL2C_ACTIVE; i++) {
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
    const real next = h * dl2c_dopri_factor(error);
    const bool fits = (error <= 1.0) & dl2c_all_finite(y, NX);
    const bool event_free = dl2c_lane_event_free(x, y, p, h, (const real(*)[NX])k);
    bool grown = false;
    DL2C_UNROLL
    for (int j = 0; j < NX; j++) grown |= fabs(y[j]) > c->limit[i];
    const bool proved = event_free & !grown;
    const bool well = (now + h > now) & (!fits | proved);
    const bool taken = (c->going[i] != 0) & fits & well;
    const bool there = taken & (after >= c->stop[i]);
    c->wanted[i] = dl2c_select(fits, next, dl2c_dopri_shorter(h, error, next));
    c->now[i] = dl2c_select(taken, after, now);
    c->there[i] = (int64_t)there;
    c->going[i] &= (int64_t)(well & !there);
    DL2C_UNROLL
    for (int j = 0; j < NX; j++) c->y[j][i] = dl2c_select(taken, y[j], x[j]);
    DL2C_UNROLL
    for (int j = 0; j < NX; j++) c->rates[j][i] = dl2c_select(taken, k[6][j], k[0][j]);
  }
}

/* Copies the result of a finished lane to the block. */
static void dl2c_active_remove(const dl2c_active_set *c, int64_t i, dl2c_block_flow *f)
{
  const int64_t lane = c->lane[i];
  f->there[lane] = c->there[i];
  for (int k = 0; k < NX; k++) f->y[k][lane] = c->y[k][i];
}

/* Completes the flow of the lanes that reached its end, as dl2c_arrive does. */
DL2C_INLINE void dl2c_block_finish(dl2c_block_flow *f, int64_t count)
{
  DL2C_ALIAS_FREE
  for (int64_t i = 0; i < count; i++) {
    real x[NX];
    real y[NX];
    real p[NP + NFROZEN + 1];
    int8_t sign[NMARGIN];
    DL2C_UNROLL
    for (int k = 0; k < NMARGIN; k++) sign[k] = 1;
    DL2C_UNROLL
    for (int k = 0; k < NX; k++) x[k] = f->x[k][i];
    DL2C_UNROLL
    for (int k = 0; k < NX; k++) y[k] = f->y[k][i];
    DL2C_UNROLL
    for (int k = 0; k < NP + NFROZEN; k++) p[k] = f->p[k][i];
    dl2c_project(DL2C_LANE_FLOW, p, NULL, y);
    dl2c_snap(DL2C_LANE_FLOW, x, p, f->stop[i], sign, y);
    f->there[i] &= (int64_t)(dl2c_all_finite(y, NX) & model_inside(DL2C_LANE_FLOW, y, p));
    DL2C_UNROLL
    for (int k = 0; k < NX; k++) f->y[k][i] = y[k];
  }
}

static void dl2c_active_insert(dl2c_active_set *c, int64_t i, const dl2c_block_flow *f, int64_t lane)
{
  for (int k = 0; k < NX; k++) c->y[k][i] = f->x[k][lane];
  for (int k = 0; k < NP + NFROZEN; k++) c->p[k][i] = f->p[k][lane];
  for (int k = 0; k < NX; k++) c->rates[k][i] = f->rates[k][lane];
  c->now[i] = 0.0;
  c->stop[i] = f->stop[lane];
  c->wanted[i] = f->wanted[lane];
  c->limit[i] = f->limit[lane];
  c->going[i] = 1;
  c->there[i] = 0;
}

/* Integrates the flow in all lanes that are going. */
DL2C_LANES static void dl2c_block_integrate(dl2c_block_flow *f, int64_t count)
{
  dl2c_active_set set;
  int64_t next = 0;
  memset(&set, 0, sizeof set);
  for (int64_t i = 0; i < DL2C_ACTIVE; i++) set.lane[i] = -1;
  dl2c_block_start(f, count);
  for (int attempt = 0; attempt < DL2C_DOPRI_STEPS; attempt++) {
    int64_t going = 0;
    for (int64_t i = 0; i < DL2C_ACTIVE; i++) {
      if (!set.going[i]) {
        if (set.lane[i] >= 0) dl2c_active_remove(&set, i, f);
        while (next < count && !f->going[next]) next++;
        set.lane[i] = next < count ? next : -1;
        if (next < count) dl2c_active_insert(&set, i, f, next++);
      }
      going |= set.going[i];
    }
    if (!going) break;
    dl2c_active_step(&set);
  }
  dl2c_block_finish(f, count);
}

#endif
#endif
