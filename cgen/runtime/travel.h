/* SPDX-License-Identifier: MIT-0 */
/*
 * travel.h -- following a flow: how long its domain lets it last, what is watched on the way.
 *
 * A flow is looked at in stretches of time. On a stretch every margin is a curve; where the
 * curves cross zero is all that its conditions depend on. Simple flows have straight-line motion
 * (model_motion) and are one stretch, as are flows whose margins are polynomials of time; the
 * margins of other flows are sampled, stretch by stretch. The same operations in the same
 * order as dl2c/ir/follow.py wherever margins are polynomials.
 */
#ifndef DL2C_TRAVEL_H
#define DL2C_TRAVEL_H

#include "events.h"

/* What is asked of a flow, and what became of it. */
typedef struct dl2c_travel {
  const real *p;
  struct dl2c_solver *solver; /* NULL where no flow needs one */
  real part;                  /* of the longest time that the domain allows, 0 to 1 */
  real duration;              /* out: time that it took */
  uint8_t *watch;             /* (NWATCH) dl2c_watched of this step so far; updated */
} dl2c_travel;

#if DL2C_TRACKED_FLOWS
#include "numeric.h"
#elif DL2C_SAMPLED_FLOWS
#include "stretch.h"
#endif

/* The curves of a flow from x over the time `length`, where they are polynomials. */
static void dl2c_see_curves(int flow, const real *x, const real *p, real length, dl2c_events *events)
{
  real c[NMARGIN][NDEGREE + 1] = {{0.0}};
  int32_t degree[NMARGIN] = {0};
  dl2c_curve curves[NMARGIN];
  const int n = FLOW_MARGINS[flow];
  model_polynomials(flow, x, p, c, degree);
  for (int j = 0; j < n; j++) {
    bool defined = true;
    for (int k = 0; k <= degree[j]; k++) defined &= (bool)isfinite(c[j][k]);
    if (!defined) degree[j] = 0;
    if (!defined) c[j][0] = 0.0;
    events->at_start[j] = events->after_start[j] = dl2c_sign_of(c[j][0]);
    if (!(length > 0.0)) continue;
    dl2c_curve_of(c[j], degree[j], length, &curves[j]);
    events->after_start[j] = dl2c_sign_after(&curves[j]);
  }
  events->count = 0;
  if (length > 0.0)
    events->count = dl2c_crossings(curves, n, events->after_start, events->crossings, DL2C_ROOM);
}

/* Rounding put the end of a motion from x outside the domain: steps back until it is inside. */
static void dl2c_retreat(int flow, const real *x, const real *p, real end, real *y, real *duration)
{
  real part = DL2C_RETREAT_FIRST;
  for (int k = 0; k < DL2C_RETREATS; k++, part *= 4.0) {
    *duration = end - end * part;
    memcpy(y, x, sizeof(real) * NX);
    model_at(flow, x, p, *duration, y);
    if (model_inside(flow, y, p)) return;
  }
  memcpy(y, x, sizeof(real) * NX);
  *duration = 0.0;
}

/* Moves x along a flow for a time that its domain allows but for rounding. */
static dl2c_motion dl2c_stop(int flow, const real *x, const real *p, real end, real *y,
                             real *duration)
{
  memcpy(y, x, sizeof(real) * NX);
  *duration = 0.0;
  if (!(end > 0.0)) return DL2C_SETTLED;
  model_at(flow, x, p, end, y);
  if (!dl2c_all_finite(y, NX)) return DL2C_UNDEFINED;
  *duration = end;
  if (!model_inside(flow, y, p)) dl2c_retreat(flow, x, p, end, y, duration);
  return DL2C_SETTLED;
}

/*
 * Moves x along a flow with polynomial margins as long as its domain allows, at most for the time
 * `limit`.   ended: whether the domain ended it
 */
static dl2c_motion dl2c_roam_within(int flow, const real *x, const real *p, real limit, real *y,
                                    real *duration, bool *ended)
{
  memcpy(y, x, sizeof(real) * NX);
  *duration = 0.0;
  *ended = false;
  if (!(limit > 0.0)) return DL2C_SETTLED;
  dl2c_events events;
  dl2c_breach failure = {0};
  dl2c_see_curves(flow, x, p, limit, &events);
  dl2c_fails(flow, 0, &events, &failure);
  real end = limit;
  if (failure.exit.found) {
    *ended = true;
    end = failure.exit.at * limit;
    if (!(end > 0.0)) return DL2C_SETTLED;
    if (!failure.exit.holds) end = dl2c_before(end);
  }
  model_at(flow, x, p, end, y);
  model_settle(flow, x, p, end, failure.at, y);
  if (!dl2c_all_finite(y, NX)) return DL2C_UNDEFINED;
  *duration = end;
  if (!model_inside(flow, y, p)) dl2c_retreat(flow, x, p, end, y, duration);
  return DL2C_SETTLED;
}

/* The same for as long as its clocks let it last, or without one until its domain ends it. */
static dl2c_motion dl2c_roam(int flow, const real *x, const real *p, real *y, real *duration)
{
  real horizon;
  bool ended;
  if (!model_begin(flow, x, p, &horizon)) return DL2C_UNDEFINED;
  if (FLOW_REACH[flow] > 0.0
      && dl2c_roam_within(flow, x, p, FLOW_REACH[flow], y, duration, &ended) == DL2C_SETTLED
      && ended)
    return DL2C_SETTLED;
  return dl2c_roam_within(flow, x, p, horizon, y, duration, &ended);
}

/* As long as the domain allows, for flows with a solution. */
static inline dl2c_motion dl2c_longest(int flow, const real *x, const real *p, real *y,
                                       real *duration)
{
  if (FLOW_KERNEL[flow] == DL2C_POLYNOMIAL) return dl2c_roam(flow, x, p, y, duration);
  const int64_t motion = model_motion(flow, x, p, y, duration);
  if (motion == DL2C_OUTSIDE) dl2c_retreat(flow, x, p, *duration, y, duration);
  return motion == DL2C_UNDEFINED ? DL2C_UNDEFINED : DL2C_SETTLED;
}

/* What the watches say of a motion from x. Returns the part of it after which it is cut, or 2. */
static real dl2c_watch_motion(int flow, const real *x, const real *p, real length, uint8_t *watch)
{
#if DL2C_SAMPLED_FLOWS
  if (FLOW_KERNEL[flow] == DL2C_QUICK_SAMPLED) {
    dl2c_stretch stretch = {.flow = flow, .x = x, .p = p, .length = length};
    int8_t sign[NMARGIN];
    real s;
    if (dl2c_look_along(&stretch, false, watch, &s, sign) != DL2C_CUT) return 2.0;
    return stretch.low + stretch.width * s;
  }
#endif
  dl2c_events events;
  dl2c_see_curves(flow, x, p, length, &events);
  return dl2c_watch(flow, &events, 1.0, watch);
}

/* Moves y along a flow. What is left of y is meaningless unless it settled. */
static inline dl2c_motion dl2c_flow(int flow, dl2c_travel *travel, real *y)
{
#if DL2C_TRACKED_FLOWS
  if (FLOW_KERNEL[flow] >= DL2C_LINEAR) return dl2c_flow_tracks(flow, travel, y);
#endif
  const real *p = travel->p;
  real x[NX];
  memcpy(x, y, sizeof x);
  dl2c_motion motion = dl2c_longest(flow, x, p, y, &travel->duration);
  if (motion == DL2C_SETTLED && travel->part < 1.0)
    motion = dl2c_stop(flow, x, p, travel->duration * travel->part, y, &travel->duration);
  if (NWATCH == 0 || motion != DL2C_SETTLED || model_quiet(flow, x, p, travel->duration, y))
    return motion;
  const real length = travel->duration;
  const real stop = dl2c_watch_motion(flow, x, p, length, travel->watch);
  if (stop < 1.0) motion = dl2c_stop(flow, x, p, stop * length, y, &travel->duration);
  return motion;
}

#endif
