/* SPDX-License-Identifier: MIT-0 */
/*
 * numeric.h -- flows that are followed track by track: by a solution in closed form, power series,
 * the solver, or dopri5.h.
 */
#ifndef DL2C_NUMERIC_H
#define DL2C_NUMERIC_H

#include "at_once.h"
#include "growth.h"
#include "project.h"
#if DL2C_LINEAR_FLOWS
#include "linear.h"
#endif
#if DL2C_SOLVED_FLOWS
#include "flow_cvodes.h"
#endif
#if DL2C_DOPRI_FLOWS
#include "dopri5.h"
#endif

/* A solution in closed form, which is one track. */
typedef struct dl2c_solution {
  const real *x;
  real stop;
  bool done;
} dl2c_solution;

/* The whole of a motion from x as one track. False where it has an undefined or infinite value. */
static bool dl2c_solution_track(int flow, const real *x, const real *p, real stop,
                                dl2c_track *track)
{
  real scale = stop;
  *track = (dl2c_track){.length = stop};
  for (int k = 0; k < NX; k++) track->c[k][0] = x[k];
  track->degree = model_solution(flow, x, p, track->c);
  for (int i = 1; i <= track->degree; i++, scale *= stop)
    for (int k = 0; k < NX; k++) track->c[k][i] *= scale;
  memcpy(track->end, x, sizeof track->end);
  model_at(flow, x, p, stop, track->end);
  return dl2c_all_finite(track->end, NX);
}

/* The source of the tracks of a flow. */
typedef struct dl2c_integrator {
  int flow;
  uint8_t kernel; /* that of the flow, or NUMERIC where its series are too many */
  int32_t series; /* how many there may be */
  const real *p;
  struct dl2c_solver *solver; /* for flows of kernel NUMERIC */
  union {
    dl2c_solution solution; /* for flows with a solution in closed form */
#if DL2C_LINEAR_FLOWS
    dl2c_linear linear; /* for flows of kernel LINEAR */
#endif
#if DL2C_DOPRI_FLOWS
    dl2c_dopri dopri; /* for flows of kernel DOPRI */
#endif
  };
} dl2c_integrator;

static bool dl2c_integrator_start(dl2c_integrator *integrator, const real *x, real stop)
{
#if DL2C_SOLVED_FLOWS
  if (integrator->kernel == DL2C_NUMERIC) {
    const bool stiffly = FLOW_KERNEL[integrator->flow] == DL2C_LINEAR;
    return dl2c_solver_begin(integrator->solver, integrator->flow, x, integrator->p, stop, stiffly);
  }
#endif
#if DL2C_DOPRI_FLOWS
  if (integrator->kernel == DL2C_DOPRI)
    return dl2c_dopri_start(&integrator->dopri, integrator->flow, x, integrator->p, stop);
#endif
  if (integrator->kernel < DL2C_LINEAR) {
    integrator->solution = (dl2c_solution){.x = x, .stop = stop};
    return true;
  }
#if DL2C_LINEAR_FLOWS
  dl2c_linear_start(&integrator->linear, integrator->flow, x, integrator->p, stop, integrator->series);
#endif
  return true;
}

static bool dl2c_integrator_step(dl2c_integrator *integrator, dl2c_track *track)
{
#if DL2C_SOLVED_FLOWS
  if (integrator->kernel == DL2C_NUMERIC) return dl2c_solver_step(integrator->solver, track);
#endif
#if DL2C_DOPRI_FLOWS
  if (integrator->kernel == DL2C_DOPRI)
    return dl2c_dopri_step(&integrator->dopri, integrator->flow, integrator->p, track);
#endif
#if DL2C_LINEAR_FLOWS
  if (integrator->kernel == DL2C_LINEAR)
    return dl2c_linear_step(&integrator->linear, integrator->flow, integrator->p, track);
#endif
  integrator->solution.done = true;
  return dl2c_solution_track(integrator->flow, integrator->solution.x, integrator->p, integrator->solution.stop, track);
}

static bool dl2c_integrator_done(const dl2c_integrator *integrator)
{
#if DL2C_SOLVED_FLOWS
  if (integrator->kernel == DL2C_NUMERIC) return dl2c_solver_done(integrator->solver);
#endif
#if DL2C_DOPRI_FLOWS
  if (integrator->kernel == DL2C_DOPRI) return dl2c_dopri_done(&integrator->dopri);
#endif
#if DL2C_LINEAR_FLOWS
  if (integrator->kernel == DL2C_LINEAR) return dl2c_linear_done(&integrator->linear);
#endif
  return integrator->solution.done;
}

/*
 * Whether a solver has come too close to a singularity (see dl2c_blows_up).   limit:
 * dl2c_growth_limit
 */
static bool dl2c_lost(const dl2c_integrator *integrator, const dl2c_track *track, real limit)
{
#ifdef DL2C_RTOL
  if (integrator->kernel > DL2C_LINEAR)
    return dl2c_blows_up(integrator->flow, integrator->p, track->end, limit, track->from + track->length);
#endif
  (void)integrator, (void)track, (void)limit;
  return false;
}

/* A track that stays at x, for what is watched where a flow takes no time. */
static void dl2c_constant_track(const real *x, dl2c_track *track)
{
  *track = (dl2c_track){.from = 0.0};
  for (int k = 0; k < NX; k++) track->c[k][0] = track->end[k] = x[k];
}

/*
 * A retreat steps back four times as far each time: by at most this part of a track, or to where
 * all margins last had certain signs.
 */
#define DL2C_FARTHEST_BACK 0x1p-12
/*
 * A retreat that went further than this is refined by bisection until it is known as well as this.
 */
#define DL2C_RETREAT_FINE 0x1p-40

/* Whether the state at a place of a track, its invariants met, is inside the domain. */
static bool dl2c_arrives(const dl2c_stretch *stretch, real place, real *y, real *duration)
{
  dl2c_track_at(stretch->track, place, y);
  dl2c_project(stretch->flow, stretch->p, NULL, y);
  *duration = dl2c_time_at(stretch->track, place);
  return model_inside(stretch->flow, y, stretch->p);
}

/* Rounding put a place of a track outside the domain: steps back until it is inside. */
static bool dl2c_back(const dl2c_stretch *stretch, real place, real *y, real *duration)
{
  real outside = 0.0;
  real inside = DL2C_RETREAT_FIRST;
  const real farthest = dl2c_max(DL2C_FARTHEST_BACK, place - stretch->clear);
  for (; inside < 1.0 && inside * place <= farthest; outside = inside, inside *= 4.0) {
    if (!dl2c_arrives(stretch, place - place * inside, y, duration)) continue;
    while (inside - outside > DL2C_RETREAT_FINE) {
      const real middle = 0.5 * (outside + inside);
      if (dl2c_arrives(stretch, place - place * middle, y, duration))
        inside = middle;
      else
        outside = middle;
    }
    (void)dl2c_arrives(stretch, place - place * inside, y, duration);
    return true;
  }
  return false;
}

/*
 * No margin has a certain sign, and no place near the end is inside the domain: steps towards the
 * start of the flow, which is inside.
 */
static void dl2c_back_to_start(const dl2c_stretch *stretch, real place, real *y, real *duration)
{
  for (real part = 0.5; part > DL2C_RETREAT_FINE; part *= 0.5)
    if (dl2c_arrives(stretch, place * part, y, duration)) return;
  memcpy(y, stretch->x, sizeof(real) * NX);
  *duration = 0.0;
}

/*
 * The state at a place of a track, as the end of a flow: invariants and bounds that were met hold
 * exactly. Where that is outside the domain by rounding, an earlier one. OUTSIDE if that would be
 * before the track.
 */
static dl2c_motion dl2c_arrive(const dl2c_stretch *stretch, real place, bool settled, real time,
                               const int8_t *sign, real *y, real *duration)
{
  const int flow = stretch->flow;
  const real *p = stretch->p;
  dl2c_track_at(stretch->track, place, y);
  dl2c_project(flow, p, NULL, y);
  if (settled) dl2c_snap(flow, stretch->x, p, time, sign, y);
  if (!dl2c_all_finite(y, NX)) return DL2C_UNDEFINED;
  *duration = time;
  if (model_inside(flow, y, p)) return DL2C_ARRIVED;
  if (dl2c_back(stretch, place, y, duration)) return DL2C_ARRIVED;
  *duration = time;
  if (stretch->clear > 0.0 && !(place < DL2C_RETREAT_FINE)) return DL2C_UNDEFINED;
  if (stretch->track->from > 0.0) return DL2C_OUTSIDE;
  dl2c_back_to_start(stretch, place, y, duration);
  return DL2C_ARRIVED;
}

/* One flow to follow, and its result. */
typedef struct dl2c_integration {
  const real *x;  /* (NX) where it begins */
  real cap;       /* how long it may last at most, */
  real reach;     /* and how long instead of its horizon, 0 for no longer */
  uint8_t *watch; /* (NWATCH) updated */
  real *y;        /* (NX) out: where it ends, */
  real duration;  /* out: when, */
  bool ended;     /* out: and whether its domain ended it */
  real stop;      /* out: until when it was followed, had nothing ended it */
} dl2c_integration;

/* Follows a flow with one source of tracks. */
static dl2c_motion dl2c_integrate_with(dl2c_integrator *integrator, dl2c_integration *task)
{
  const int flow = integrator->flow;
  const real *x = task->x;
  const real *p = integrator->p;
  real horizon;
  dl2c_track track;
  int8_t sign[NMARGIN];
  real place = 1.0;
  track.from = track.length = 0.0; /* compilers do not see that a track is computed before it is used */
  track.degree = 0;
  memcpy(task->y, x, sizeof(real) * NX);
  task->duration = 0.0;
  task->ended = false;
  if (!model_begin(flow, x, p, &horizon)) return DL2C_UNDEFINED;
  if (task->reach > 0.0) horizon = task->reach;
  const real stop = horizon < task->cap ? horizon : task->cap;
  task->stop = stop;
  dl2c_stretch stretch = {.flow = flow, .x = x, .p = p, .track = &track};
  if (!(stop > 0.0)) {
    dl2c_constant_track(x, &track);
    (void)dl2c_search_track(&stretch, false, task->watch, &place, sign);
    return DL2C_ARRIVED;
  }
  if (dl2c_leaves_at_once(&stretch, stop, task->watch, sign)) {
    dl2c_constant_track(x, &track);
    task->ended = true;
    return dl2c_arrive(&stretch, 0.0, true, 0.0, sign, task->y, &task->duration);
  }
  if (!dl2c_integrator_start(integrator, x, stop)) return DL2C_UNSOLVED;
  const real grown = dl2c_growth_limit(x);
  dl2c_halt halt = DL2C_NO_HALT;
  do {
    if (!dl2c_integrator_step(integrator, &track) || dl2c_lost(integrator, &track, grown))
      return FLOW_KERNEL[flow] < DL2C_LINEAR ? DL2C_UNDEFINED : DL2C_UNSOLVED;
    halt = dl2c_search_track(&stretch, true, task->watch, &place, sign);
  } while (halt == DL2C_NO_HALT && !dl2c_integrator_done(integrator));
  if (halt == DL2C_GIVES_UP) return DL2C_UNDEFINED;
  if (halt == DL2C_NO_HALT) place = 1.0;
  task->ended = halt == DL2C_LEAVES;
  const real time = halt == DL2C_NO_HALT ? stop : dl2c_time_at(&track, place);
  return dl2c_arrive(&stretch, place, halt != DL2C_CUT, time, sign, task->y, &task->duration);
}

/*
 * Follows a flow, with another source of tracks where one fails: needing too many series is a sign
 * of stiffness, and the flow begins anew with the solver; where that fails too, with many series.
 */
static dl2c_motion dl2c_integrate_stiff(dl2c_integrator *integrator, dl2c_integration *task)
{
  integrator->kernel = FLOW_KERNEL[integrator->flow];
#if DL2C_LINEAR_FLOWS
  integrator->series = DL2C_MANY_SERIES;
#endif
#if DL2C_SOLVED_FLOWS && DL2C_LINEAR_FLOWS
  if (integrator->kernel == DL2C_LINEAR) {
    uint8_t before[NWATCH + 1];
    memcpy(before, task->watch, NWATCH);
    integrator->series = DL2C_FEW_SERIES;
    dl2c_motion motion = dl2c_integrate_with(integrator, task);
    if (motion != DL2C_UNSOLVED || integrator->linear.steps <= integrator->series) return motion;
    memcpy(task->watch, before, NWATCH);
    integrator->kernel = DL2C_NUMERIC;
    motion = dl2c_integrate_with(integrator, task);
    if (motion != DL2C_UNSOLVED) return motion;
    memcpy(task->watch, before, NWATCH);
    integrator->kernel = DL2C_LINEAR;
    integrator->series = DL2C_MANY_SERIES;
  }
#endif
  return dl2c_integrate_with(integrator, task);
}

/* Follows a flow; where rounding put its end outside the domain it ends a little earlier. */
static dl2c_motion dl2c_integrate(dl2c_integrator *integrator, dl2c_integration *task)
{
  const dl2c_motion motion = dl2c_integrate_stiff(integrator, task);
  if (motion != DL2C_OUTSIDE) return motion;
  uint8_t closed[NWATCH + 1];
  dl2c_integration earlier = *task;
  earlier.cap = task->duration - task->duration * DL2C_RETREAT_FINE;
  earlier.watch = closed;
  memset(closed, DL2C_MET, sizeof closed);
  const dl2c_motion again = dl2c_integrate_stiff(integrator, &earlier);
  task->duration = earlier.duration;
  task->stop = earlier.stop;
  return again == DL2C_OUTSIDE ? DL2C_UNDEFINED : again;
}

/* Moves y along a flow that is followed track by track. */
static dl2c_motion dl2c_flow_tracks(int flow, dl2c_travel *travel, real *y)
{
  real x[NX];
  uint8_t closed[NWATCH + 1];
  memcpy(x, y, sizeof x);
  memset(closed, DL2C_MET, sizeof closed);
  dl2c_integrator integrator;
  integrator.flow = flow;
  integrator.p = travel->p;
  integrator.solver = travel->solver;
  dl2c_integration task = {
      .x = x, .cap = (real)INFINITY, .reach = FLOW_REACH[flow], .watch = closed, .y = y};
  if (task.reach > 0.0 && (dl2c_integrate(&integrator, &task) != DL2C_ARRIVED || !task.ended))
    task.reach = 0.0;
  if (travel->part < 1.0) {
    const dl2c_motion longest = dl2c_integrate(&integrator, &task);
    if (longest != DL2C_ARRIVED) return longest;
    task.cap = task.duration * travel->part;
  }
  task.watch = travel->watch;
  const dl2c_motion motion = dl2c_integrate(&integrator, &task);
  travel->duration = task.duration;
#if DL2C_INSPECT
  travel->kernel = integrator.kernel;
  travel->series = integrator.kernel == DL2C_LINEAR ? integrator.series : 0;
  travel->stop = task.stop;
#endif
  return motion;
}

#endif
