/* SPDX-License-Identifier: MIT-0 */
/*
 * numeric.h -- flows that are followed track by track: a solution in closed form, power series, the
 * solver, or dopri5.h.
 */
#ifndef DL2C_NUMERIC_H
#define DL2C_NUMERIC_H

#include "growth.h"
#include "project.h"
#include "search.h"
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

/* What makes the tracks of a flow. */
typedef struct dl2c_motor {
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
} dl2c_motor;

static bool dl2c_motor_start(dl2c_motor *motor, const real *x, real stop)
{
#if DL2C_SOLVED_FLOWS
  if (motor->kernel == DL2C_NUMERIC) {
    const bool stiffly = FLOW_KERNEL[motor->flow] == DL2C_LINEAR;
    return dl2c_solver_begin(motor->solver, motor->flow, x, motor->p, stop, stiffly);
  }
#endif
#if DL2C_DOPRI_FLOWS
  if (motor->kernel == DL2C_DOPRI)
    return dl2c_dopri_start(&motor->dopri, motor->flow, x, motor->p, stop);
#endif
  if (motor->kernel < DL2C_LINEAR) {
    motor->solution = (dl2c_solution){.x = x, .stop = stop};
    return true;
  }
#if DL2C_LINEAR_FLOWS
  dl2c_linear_start(&motor->linear, motor->flow, x, motor->p, stop, motor->series);
#endif
  return true;
}

static bool dl2c_motor_step(dl2c_motor *motor, dl2c_track *track)
{
#if DL2C_SOLVED_FLOWS
  if (motor->kernel == DL2C_NUMERIC) return dl2c_solver_step(motor->solver, track);
#endif
#if DL2C_DOPRI_FLOWS
  if (motor->kernel == DL2C_DOPRI)
    return dl2c_dopri_step(&motor->dopri, motor->flow, motor->p, track);
#endif
#if DL2C_LINEAR_FLOWS
  if (motor->kernel == DL2C_LINEAR)
    return dl2c_linear_step(&motor->linear, motor->flow, motor->p, track);
#endif
  motor->solution.done = true;
  return dl2c_solution_track(motor->flow, motor->solution.x, motor->p, motor->solution.stop, track);
}

static bool dl2c_motor_done(const dl2c_motor *motor)
{
#if DL2C_SOLVED_FLOWS
  if (motor->kernel == DL2C_NUMERIC) return dl2c_solver_done(motor->solver);
#endif
#if DL2C_DOPRI_FLOWS
  if (motor->kernel == DL2C_DOPRI) return dl2c_dopri_done(&motor->dopri);
#endif
#if DL2C_LINEAR_FLOWS
  if (motor->kernel == DL2C_LINEAR) return dl2c_linear_done(&motor->linear);
#endif
  return motor->solution.done;
}

/* Whether a solver's motion has come to where it is unknown (see dl2c_bursts).   limit: dl2c_growth_limit */
static bool dl2c_lost(const dl2c_motor *motor, const dl2c_track *track, real limit)
{
#if DL2C_SOLVED_FLOWS || DL2C_DOPRI_FLOWS
  if (motor->kernel > DL2C_LINEAR)
    return dl2c_bursts(motor->flow, motor->p, track->end, limit, track->from + track->length);
#endif
  (void)motor, (void)track, (void)limit;
  return false;
}

/* A track that stays in x, for what is watched where a flow has no time. */
static void dl2c_rest(const real *x, dl2c_track *track)
{
  *track = (dl2c_track){.from = 0.0};
  for (int k = 0; k < NX; k++) track->c[k][0] = track->end[k] = x[k];
}

/*
 * A retreat steps back each time four times as far: at most by this part of a track, or to where
 * rounding last told all margins from zero.
 */
#define DL2C_FARTHEST_BACK 0x1p-12
/* One that went further than this is halved until it is known as well as this. */
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
 * Rounding told no margin from zero all along, and no place near the end is inside the domain: steps
 * towards the start of the flow, which is inside.
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

/* One flow that is followed, and how it ended. */
typedef struct dl2c_pursuit {
  const real *x;  /* (NX) where it begins */
  real cap;       /* how long it may last at most, */
  real reach;     /* and how long instead of its horizon, 0 for no longer */
  uint8_t *watch; /* (NWATCH) updated */
  real *y;        /* (NX) out: where it ends, */
  real duration;  /* out: when, */
  bool ended;     /* out: and whether its domain ended it */
} dl2c_pursuit;

/* Follows a flow with one motor. */
static dl2c_motion dl2c_pursue_with(dl2c_motor *motor, dl2c_pursuit *pursuit)
{
  const int flow = motor->flow;
  const real *x = pursuit->x;
  const real *p = motor->p;
  real horizon;
  dl2c_track track;
  int8_t sign[NMARGIN];
  real place = 1.0;
  memcpy(pursuit->y, x, sizeof(real) * NX);
  pursuit->duration = 0.0;
  pursuit->ended = false;
  if (!model_begin(flow, x, p, &horizon)) return DL2C_UNDEFINED;
  if (pursuit->reach > 0.0) horizon = pursuit->reach;
  const real stop = horizon < pursuit->cap ? horizon : pursuit->cap;
  dl2c_stretch stretch = {.flow = flow, .x = x, .p = p, .track = &track};
  if (!(stop > 0.0)) {
    dl2c_rest(x, &track);
    (void)dl2c_look_along(&stretch, false, pursuit->watch, &place, sign);
    return DL2C_ARRIVED;
  }
  if (!dl2c_motor_start(motor, x, stop)) return DL2C_UNSOLVED;
  const real grown = dl2c_growth_limit(x);
  dl2c_halt halt = DL2C_NO_HALT;
  do {
    if (!dl2c_motor_step(motor, &track) || dl2c_lost(motor, &track, grown))
      return FLOW_KERNEL[flow] < DL2C_LINEAR ? DL2C_UNDEFINED : DL2C_UNSOLVED;
    halt = dl2c_look_along(&stretch, true, pursuit->watch, &place, sign);
  } while (halt == DL2C_NO_HALT && !dl2c_motor_done(motor));
  if (halt == DL2C_GIVES_UP) return DL2C_UNDEFINED;
  if (halt == DL2C_NO_HALT) place = 1.0;
  pursuit->ended = halt == DL2C_LEAVES;
  const real time = halt == DL2C_NO_HALT ? stop : dl2c_time_at(&track, place);
  return dl2c_arrive(&stretch, place, halt != DL2C_CUT, time, sign, pursuit->y, &pursuit->duration);
}

/*
 * Follows a flow, with another motor where one fails: series that are too many are a sign of
 * stiffness, and the flow begins anew with the solver; where that fails too, with many series.
 */
static dl2c_motion dl2c_pursue_stiff(dl2c_motor *motor, dl2c_pursuit *pursuit)
{
  motor->kernel = FLOW_KERNEL[motor->flow];
#if DL2C_LINEAR_FLOWS
  motor->series = DL2C_MANY_SERIES;
#endif
#if DL2C_SOLVED_FLOWS && DL2C_LINEAR_FLOWS
  if (motor->kernel == DL2C_LINEAR) {
    uint8_t before[NWATCH + 1];
    memcpy(before, pursuit->watch, NWATCH);
    motor->series = DL2C_FEW_SERIES;
    dl2c_motion motion = dl2c_pursue_with(motor, pursuit);
    if (motion != DL2C_UNSOLVED || motor->linear.steps <= motor->series) return motion;
    memcpy(pursuit->watch, before, NWATCH);
    motor->kernel = DL2C_NUMERIC;
    motion = dl2c_pursue_with(motor, pursuit);
    if (motion != DL2C_UNSOLVED) return motion;
    memcpy(pursuit->watch, before, NWATCH);
    motor->kernel = DL2C_LINEAR;
    motor->series = DL2C_MANY_SERIES;
  }
#endif
  return dl2c_pursue_with(motor, pursuit);
}

/* Follows a flow; where rounding put its end outside the domain it ends a little earlier. */
static dl2c_motion dl2c_pursue(dl2c_motor *motor, dl2c_pursuit *pursuit)
{
  const dl2c_motion motion = dl2c_pursue_stiff(motor, pursuit);
  if (motion != DL2C_OUTSIDE) return motion;
  uint8_t closed[NWATCH + 1];
  dl2c_pursuit earlier = *pursuit;
  earlier.cap = pursuit->duration - pursuit->duration * DL2C_RETREAT_FINE;
  earlier.watch = closed;
  memset(closed, DL2C_MET, sizeof closed);
  const dl2c_motion again = dl2c_pursue_stiff(motor, &earlier);
  pursuit->duration = earlier.duration;
  return again == DL2C_OUTSIDE ? DL2C_UNDEFINED : again;
}

/* Moves y along a flow that is followed track by track. */
static dl2c_motion dl2c_flow_tracks(int flow, dl2c_travel *travel, real *y)
{
  real x[NX];
  uint8_t closed[NWATCH + 1];
  memcpy(x, y, sizeof x);
  memset(closed, DL2C_MET, sizeof closed);
  dl2c_motor motor;
  motor.flow = flow;
  motor.p = travel->p;
  motor.solver = travel->solver;
  dl2c_pursuit pursuit = {
      .x = x, .cap = (real)INFINITY, .reach = FLOW_REACH[flow], .watch = closed, .y = y};
  if (pursuit.reach > 0.0 && (dl2c_pursue(&motor, &pursuit) != DL2C_ARRIVED || !pursuit.ended))
    pursuit.reach = 0.0;
  if (travel->part < 1.0) {
    const dl2c_motion longest = dl2c_pursue(&motor, &pursuit);
    if (longest != DL2C_ARRIVED) return longest;
    pursuit.cap = pursuit.duration * travel->part;
  }
  pursuit.watch = travel->watch;
  const dl2c_motion motion = dl2c_pursue(&motor, &pursuit);
  travel->duration = pursuit.duration;
  return motion;
}

#endif
