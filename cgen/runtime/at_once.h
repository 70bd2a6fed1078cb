/* SPDX-License-Identifier: MIT-0 */
/*
 * at_once.h -- flows that leave their domain where they begin, which need neither solver nor search.
 *
 * A flow that begins on the boundary of its domain and moves outwards ends there, after no time. The search
 * along its first track says the same, by the same derivatives, where these are far from zero compared with
 * the errors of any track. All else is left to the search.
 */
#ifndef DL2C_AT_ONCE_H
#define DL2C_AT_ONCE_H

#include "search.h"

/* A track's errors are taken to be this large relative to what it consists of, far more than they are. */
#define DL2C_DOUBT 0x1p-20
/* A margin that is no more than this part of its error by those counts as zero but for rounding. */
#define DL2C_DOUBT_OF_ROUNDING 0x1p-30

#if DL2C_TRACKED_FLOWS
/* Signs of all margins in a state. True if all have values and some is zero.   sign: (NMARGIN) */
static inline bool dl2c_on_edge(int flow, const real *x, const real *p, int8_t *sign)
{
  bool finite = true;
  bool zero = false;
  memset(sign, 1, NMARGIN);
  for (int j = 0; j < FLOW_MARGINS[flow]; j++) {
    const real value = model_margin(flow, j, x, p);
    sign[j] = dl2c_sign_of(value);
    finite &= isfinite(value) != 0;
    zero |= value == 0.0;
  }
  return finite & zero;
}

/*
 * Whether a solver can begin in a state: the rates have values there and soon after. A zero with a sign is
 * left to it, because the sign is lost along some tracks.   rates: (NX)
 */
static inline bool dl2c_begins_well(int flow, const real *x, const real *p, real stop, real *rates)
{
  real soon[NX];
  real later[NX];
  bool signless = true;
  model_rates(flow, x, p, rates);
  for (int k = 0; k < NX; k++) {
    soon[k] = x[k] + rates[k] * (stop * DL2C_DOUBT);
    signless &= !(x[k] == 0.0 && signbit(x[k]));
  }
  model_rates(flow, soon, p, later);
  return signless && dl2c_all_finite(rates, NX) && dl2c_all_finite(later, NX);
}

/*
 * A state with more error than any track has where it begins, as models. Variables may soon move as far as
 * the fastest does, however slowly they begin: all have the same error.   z: (NX)
 */
static inline void dl2c_doubtful_state(const real *x, const real *rates, real stop, dl2c_taylor *z)
{
  real reach = 0.0;
  for (int k = 0; k < NX; k++) reach = dl2c_max(fabs(x[k]) + fabs(rates[k]) * stop, reach);
  real doubt = reach * DL2C_DOUBT;
#ifdef DL2C_RTOL
  doubt += reach * DL2C_RTOL + DL2C_ATOL;
#endif
  for (int k = 0; k < NX; k++) {
    z[k] = dl2c_taylor_number(x[k]);
    z[k].r = z[k].e = doubt;
    z[k].hull = dl2c_hull_of(x[k] - doubt, x[k] + doubt);
  }
}

/*
 * The signs of margins just after a flow began, if the first derivative that is not zero tells them.
 *   sign: (NMARGIN) where it begins   lie: (3, NMARGIN)   order, after: (NMARGIN) which derivative that is,
 *   and the signs
 */
static inline void dl2c_first_slopes(int flow, const int8_t *sign, const real *lie, int8_t *order,
                                     int8_t *after)
{
  for (int j = 0; j < FLOW_MARGINS[flow]; j++) {
    order[j] = 0;
    while (order[j] < 2 && lie[order[j] * NMARGIN + j] == 0.0) order[j] += 1;
    after[j] = sign[j] != 0 ? sign[j] : dl2c_sign_of(lie[order[j] * NMARGIN + j]);
  }
}

/*
 * Whether the errors of a track leave no doubt about these signs, and a solver can begin.   sign, lie, order:
 * see dl2c_first_slopes
 */
static bool dl2c_no_doubt(const dl2c_stretch *stretch, real stop, const int8_t *sign, const real *lie,
                          const int8_t *order)
{
  const int flow = stretch->flow;
  real rates[NX];
  dl2c_taylor z[NX];
  dl2c_taylor g[NMARGIN] = {{.r = 0.0}};
  if (!dl2c_begins_well(flow, stretch->x, stretch->p, stop, rates)) return false;
  dl2c_doubtful_state(stretch->x, rates, stop, z);
  model_taylor(flow, z, stretch->x, stretch->p, g);
  const real pace = dl2c_pace(stretch->x, rates);
  bool sure = true;
  for (int j = 0; j < FLOW_MARGINS[flow]; j++) {
    const real slope = fabs(lie[order[j] * NMARGIN + j]);
    const real least = g[j].e * (order[j] == 0 ? pace : order[j] == 1 ? pace * pace : pace * pace * pace);
    sure &= isfinite(g[j].r) && g[j].lacks == 0;
    sure &= sign[j] == 0 ? slope > least : fabs(g[j].c[0]) > g[j].r * DL2C_DOUBT_OF_ROUNDING;
  }
  return sure;
}
#endif

/*
 * Whether a flow surely leaves its domain where it begins, and changes no watch. False where that is not
 * known.   stop: how long it may last   sign: (NMARGIN) those of the margins there
 */
static inline bool dl2c_leaves_at_once(const dl2c_stretch *stretch, real stop, const uint8_t *watch,
                                       int8_t *sign)
{
#if DL2C_TRACKED_FLOWS
  const int flow = stretch->flow;
  real lie[3 * NMARGIN];
  int8_t order[NMARGIN] = {0};
  int8_t after[NMARGIN] = {0};
  if (FLOW_KERNEL[flow] < DL2C_LINEAR) return false;
  if (!dl2c_on_edge(flow, stretch->x, stretch->p, sign)) return false;
  model_lie(flow, stretch->x, stretch->p, lie);
  dl2c_first_slopes(flow, sign, lie, order, after);
  if (!model_condition(flow, 0, sign) || model_condition(flow, 0, after)) return false;
  for (int w = 0; w < NWATCH; w++)
    if (watch[w] == DL2C_WATCHING && !model_condition(flow, 1 + 3 * w, sign)) return false;
  return dl2c_no_doubt(stretch, stop, sign, lie, order);
#else
  (void)stretch, (void)stop, (void)watch, (void)sign;
  return false;
#endif
}

#endif
