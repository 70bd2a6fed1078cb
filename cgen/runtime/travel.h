/* SPDX-License-Identifier: MIT-0 */
/*
 * travel.h -- follows a flow: how long its domain lets it last, what is watched on the way.
 *
 * Simple flows have straight-line code (model_motion), whose end is a root of degree two at most.
 * Where that root is in doubt, and for all other flows, motion is followed track by track and
 * searched (numeric.h, search.h). The same operations in the same order as dl2c/interp/follow.py
 * for flows with a solution in closed form.
 */
#ifndef DL2C_TRAVEL_H
#define DL2C_TRAVEL_H

#include "model.h"

/* A flow to follow, and its result. */
typedef struct dl2c_travel {
  const real *p;
  struct dl2c_solver *solver; /* NULL where no flow needs one */
  real part;                  /* of the longest time that the domain allows, 0 to 1 */
  real duration;              /* out: time that it took */
  uint8_t *watch;             /* (NWATCH) dl2c_watched of this step so far; updated */
#if DL2C_INSPECT
  uint8_t kernel; /* out: what followed it, */
  int32_t series; /* with how many series at most, where that was by series, */
  real stop;      /* and how long it would have, had nothing ended it */
#endif
} dl2c_travel;

#if DL2C_INSPECT
/* A flow that a step followed, with all that is needed to follow it again. */
typedef struct dl2c_followed {
  int32_t flow;
  uint8_t kernel;
  int32_t series;
  real stop;
  real duration;
  real x[NX]; /* where it began */
  real y[NX]; /* and ended */
} dl2c_followed;
#endif

#if DL2C_SEARCHED_FLOWS
#include "numeric.h"
#endif

/* The number of steps of a retreat, from 2^-52 to 2^-40 of the time. */
enum { DL2C_RETREATS = 7 };

/* Rounding put the end of a motion from x outside the domain: steps back until it is inside. */
static bool dl2c_retreat(int flow, const real *x, const real *p, real end, real *y, real *duration)
{
  real part = DL2C_RETREAT_FIRST;
  for (int k = 0; k < DL2C_RETREATS; k++, part *= 4.0) {
    *duration = end - end * part;
    memcpy(y, x, sizeof(real) * NX);
    model_at(flow, x, p, *duration, y);
    if (model_inside(flow, y, p)) return true;
  }
  return false;
}

/* Moves x along a flow for a time that its domain allows but for rounding. */
static dl2c_motion dl2c_stop(int flow, const real *x, const real *p, real end, real *y,
                             real *duration)
{
  memcpy(y, x, sizeof(real) * NX);
  *duration = 0.0;
  if (!(end > 0.0)) return DL2C_ARRIVED;
  model_at(flow, x, p, end, y);
  if (!dl2c_all_finite(y, NX)) return DL2C_UNDEFINED;
  *duration = end;
  if (model_inside(flow, y, p) || dl2c_retreat(flow, x, p, end, y, duration)) return DL2C_ARRIVED;
  return DL2C_DOUBTFUL;
}

/* Straight-line motion as long as the domain allows; DOUBTFUL where the end has to be searched. */
static inline dl2c_motion dl2c_longest(int flow, const real *x, const real *p, real *y,
                                       real *duration)
{
  const int64_t motion = model_motion(flow, x, p, y, duration);
  if (motion != DL2C_OUTSIDE) return (dl2c_motion)motion;
  return dl2c_retreat(flow, x, p, *duration, y, duration) ? DL2C_ARRIVED : DL2C_DOUBTFUL;
}

/*
 * Updates the watches along straight-line motion from x. Returns the time after which it is cut,
 * or infinity; negative where the search for events gives up.
 */
static real dl2c_watch_motion(int flow, const real *x, const real *p, real length, uint8_t *watch)
{
#if DL2C_SEARCHED_FLOWS
  dl2c_track track;
  int8_t sign[NMARGIN];
  real place;
  dl2c_stretch stretch = {.flow = flow, .x = x, .p = p, .track = &track};
  if (!(length > 0.0)) dl2c_constant_track(x, &track);
  else if (!dl2c_solution_track(flow, x, p, length, &track)) return -1.0;
  const dl2c_halt halt = dl2c_search_track(&stretch, false, watch, &place, sign);
  if (halt == DL2C_GIVES_UP) return -1.0;
  if (halt == DL2C_CUT) return dl2c_time_at(&track, place);
#else
  (void)flow, (void)x, (void)p, (void)length, (void)watch;
#endif
  return (real)INFINITY;
}

/* Moves y along a flow by straight-line motion. */
static inline dl2c_motion dl2c_flow_straight(int flow, dl2c_travel *travel, const real *x, real *y)
{
  const real *p = travel->p;
  dl2c_motion motion = dl2c_longest(flow, x, p, y, &travel->duration);
  if (motion == DL2C_ARRIVED && travel->part < 1.0)
    motion = dl2c_stop(flow, x, p, travel->duration * travel->part, y, &travel->duration);
  if (NWATCH == 0 || motion != DL2C_ARRIVED || model_keeps_watches(flow, x, p, travel->duration, y))
    return motion;
  const real length = travel->duration;
  uint8_t watch[NWATCH + 1];
  memcpy(watch, travel->watch, NWATCH);
  const real stop = dl2c_watch_motion(flow, x, p, length, watch);
  if (stop < 0.0) return DL2C_UNDEFINED;
  if (stop < length) motion = dl2c_stop(flow, x, p, stop, y, &travel->duration);
  if (motion == DL2C_ARRIVED) memcpy(travel->watch, watch, NWATCH);
  return motion;
}

/* Moves y along a flow. y is meaningless unless the result is DL2C_ARRIVED. */
static inline dl2c_motion dl2c_flow(int flow, dl2c_travel *travel, real *y)
{
  real x[NX];
  memcpy(x, y, sizeof x);
  dl2c_motion motion = DL2C_DOUBTFUL;
#if DL2C_INSPECT
  travel->kernel = FLOW_KERNEL[flow];
#endif
  if (FLOW_KERNEL[flow] == DL2C_QUICK) motion = dl2c_flow_straight(flow, travel, x, y);
#if DL2C_SEARCHED_FLOWS
  if (motion == DL2C_DOUBTFUL) {
    memcpy(y, x, sizeof x);
    motion = dl2c_flow_tracks(flow, travel, y);
  }
#endif
  return motion == DL2C_DOUBTFUL ? DL2C_UNDEFINED : motion;
}

#endif
