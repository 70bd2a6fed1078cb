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

#include "roots.h"

/* What is asked of a flow, and what became of it. */
typedef struct dl2c_travel {
  const real *p;
  real part;      /* of the longest time that its domain allows, 0 to 1 */
  real duration;  /* out: time that it took */
  uint8_t *watch; /* (NWATCH) dl2c_watched of this step so far; updated */
} dl2c_travel;

enum { DL2C_ROOM = NMARGIN * (NDEGREE > 12 ? NDEGREE : 12) };

/* Signs of all margins over a stretch: at its start, just after, and where they change. */
typedef struct dl2c_events {
  int32_t count;
  int8_t at_start[NMARGIN];
  int8_t after_start[NMARGIN];
  dl2c_crossing crossings[DL2C_ROOM];
} dl2c_events;

/* The first failure of one condition, and the signs that tell what happened there. */
typedef struct dl2c_failure {
  dl2c_exit exit;
  int8_t at[NMARGIN];
  int8_t after[NMARGIN];
} dl2c_failure;

static inline int8_t dl2c_sign_of(real a) { return (int8_t)((a > 0.0) - (a < 0.0)); }

static void dl2c_fails(int flow, int formula, const dl2c_events *events, dl2c_failure *failure)
{
  failure->exit =
      dl2c_first_exit(flow, formula, events->crossings, events->count, FLOW_MARGINS[flow],
                      events->at_start, events->after_start, failure->at, failure->after);
}

/* The curves of a flow from x over the time `length`, where they are polynomials. */
static void dl2c_look(int flow, const real *x, const real *p, real length, dl2c_events *events)
{
  real c[NMARGIN][NDEGREE + 1];
  int32_t degree[NMARGIN];
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
  if (events->count < 0) events->count = 0;
}

/* Whether a flow that ends at `stop` of a stretch got as far as a failure. */
static bool dl2c_reached(const dl2c_exit *exit, real stop, bool included)
{
  return exit->found
         && (exit->at < stop || (exit->at == stop && (included || !exit->holds)));
}

/*
 * What the watches say of a stretch on which the domain lets the flow go as far as `limit`.
 * Returns where a violation cuts it, or 2.
 */
static real dl2c_watch(int flow, const dl2c_events *events, real limit, uint8_t *watch)
{
  dl2c_failure failures[NWATCH + 1];
  real stop = 2.0;
  for (int w = 0; w < NWATCH; w++) {
    if (watch[w] != DL2C_WATCHING) continue;
    dl2c_fails(flow, 1 + 3 * w, events, &failures[w]);
    const dl2c_exit *exit = &failures[w].exit;
    if (WATCH_CUTS[w] && dl2c_reached(exit, limit, false) && exit->at < stop) stop = exit->at;
  }
  for (int w = 0; w < NWATCH; w++) {
    if (watch[w] != DL2C_WATCHING) continue;
    const dl2c_exit *exit = &failures[w].exit;
    if (!dl2c_reached(exit, limit, false)) continue;
    if (stop <= 1.0 && !dl2c_reached(exit, stop, WATCH_CUTS[w])) continue;
    const int8_t *signs = exit->holds ? failures[w].after : failures[w].at;
    if (model_holds(flow, 3 + 3 * w, signs))
      watch[w] = DL2C_MET;
    else if (model_holds(flow, 2 + 3 * w, signs))
      watch[w] = DL2C_FAILED;
  }
  return stop;
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

/* Moves x along a flow with polynomial margins as long as its domain allows. */
static dl2c_motion dl2c_roam(int flow, const real *x, const real *p, real *y, real *duration)
{
  memcpy(y, x, sizeof(real) * NX);
  *duration = 0.0;
  real horizon;
  if (!model_begin(flow, x, p, &horizon)) return DL2C_UNDEFINED;
  if (!(horizon > 0.0)) return DL2C_SETTLED;
  dl2c_events events;
  dl2c_failure failure;
  dl2c_look(flow, x, p, horizon, &events);
  dl2c_fails(flow, 0, &events, &failure);
  real end = horizon;
  if (failure.exit.found) {
    end = failure.exit.at * horizon;
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

/* As long as the domain allows, for flows with a solution. */
static inline dl2c_motion dl2c_longest(int flow, const real *x, const real *p, real *y,
                                       real *duration)
{
  if (FLOW_KERNEL[flow] != DL2C_QUICK) return dl2c_roam(flow, x, p, y, duration);
  const dl2c_motion motion = model_motion(flow, x, p, y, duration);
  if (motion == DL2C_OUTSIDE) dl2c_retreat(flow, x, p, *duration, y, duration);
  return motion == DL2C_UNDEFINED ? DL2C_UNDEFINED : DL2C_SETTLED;
}

/* Moves y along a flow. What is left of y is meaningless where a value is undefined. */
static inline dl2c_motion dl2c_flow(int flow, dl2c_travel *travel, real *y)
{
  const real *p = travel->p;
  real x[NX];
  memcpy(x, y, sizeof x);
  dl2c_motion motion = dl2c_longest(flow, x, p, y, &travel->duration);
  if (motion == DL2C_SETTLED && travel->part < 1.0)
    motion = dl2c_stop(flow, x, p, travel->duration * travel->part, y, &travel->duration);
  if (NWATCH == 0 || motion != DL2C_SETTLED || model_quiet(flow, x, p, travel->duration))
    return motion;
  const real length = travel->duration;
  dl2c_events events;
  dl2c_look(flow, x, p, length, &events);
  const real stop = dl2c_watch(flow, &events, 1.0, travel->watch);
  if (stop < 1.0) motion = dl2c_stop(flow, x, p, stop * length, y, &travel->duration);
  return motion;
}

#endif
