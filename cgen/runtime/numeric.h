/* SPDX-License-Identifier: MIT-0 */
/*
 * numeric.h -- flows that are followed track by track, by power series, by the solver or by dopri5.h.
 */
#ifndef DL2C_NUMERIC_H
#define DL2C_NUMERIC_H

#include "growth.h"
#include "linear.h"
#include "project.h"
#include "stretch.h"
#if DL2C_SOLVED_FLOWS
#include "flow_cvodes.h"
#endif
#if DL2C_DOPRI_FLOWS
#include "dopri5.h"
#endif

/* What makes the tracks of a flow. */
typedef struct dl2c_motor {
  int flow;
  uint8_t kernel; /* that of the flow, or NUMERIC where its series are too many */
  int32_t series; /* how many there may be */
  const real *p;
  struct dl2c_solver *solver; /* for flows of kernel NUMERIC */
  union {
    dl2c_linear linear; /* for flows of kernel LINEAR */
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
  dl2c_linear_start(&motor->linear, motor->flow, x, motor->p, stop, motor->series);
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
  return dl2c_linear_step(&motor->linear, motor->flow, motor->p, track);
}

static bool dl2c_motor_done(const dl2c_motor *motor)
{
#if DL2C_SOLVED_FLOWS
  if (motor->kernel == DL2C_NUMERIC) return dl2c_solver_done(motor->solver);
#endif
#if DL2C_DOPRI_FLOWS
  if (motor->kernel == DL2C_DOPRI) return dl2c_dopri_done(&motor->dopri);
#endif
  return dl2c_linear_done(&motor->linear);
}

/* Whether a solver's motion has come to where it is unknown (see dl2c_bursts).   limit: dl2c_growth_limit */
static bool dl2c_lost(const dl2c_motor *motor, const dl2c_track *track, real limit)
{
#if DL2C_SOLVED_FLOWS || DL2C_DOPRI_FLOWS
  if (motor->kernel != DL2C_LINEAR)
    return dl2c_bursts(motor->flow, motor->p, track->end, limit, track->from + track->length);
#endif
  (void)motor, (void)track, (void)limit;
  return false;
}

/* A track that stays in x, for what is watched where a flow has no time. */
static void dl2c_rest(const real *x, dl2c_track *track)
{
  memset(track, 0, sizeof *track);
  for (int k = 0; k < NX; k++) track->c[k][0] = track->end[k] = x[k];
}

/* A retreat that went further than this is halved until it is known as well as this. */
#define DL2C_RETREAT_FINE 0x1p-40

/* Whether the state at s of a stretch, its invariants met, is inside the domain. */
static bool dl2c_arrives(const dl2c_stretch *stretch, real s, real *y, real *duration)
{
  dl2c_stretch_at(stretch, s, y);
  dl2c_project(stretch->flow, stretch->p, y);
  *duration = dl2c_stretch_time(stretch, s);
  return model_inside(stretch->flow, y, stretch->p);
}

/*
 * The state at s of a stretch, as the end of a flow that began in x: invariants and bounds that
 * were met hold exactly. Where that is outside the domain by rounding, an earlier one.
 */
static dl2c_motion dl2c_arrive(const dl2c_stretch *stretch, real s, bool settled, real time,
                               const int8_t *sign, real *y, real *duration)
{
  const int flow = stretch->flow;
  const real *p = stretch->p;
  dl2c_stretch_at(stretch, s, y);
  dl2c_project(flow, p, y);
  if (settled) model_settle(flow, stretch->x, p, time, sign, y);
  if (!dl2c_all_finite(y, NX)) return DL2C_UNDEFINED;
  *duration = time;
  if (model_inside(flow, y, p)) return DL2C_SETTLED;
  real outside = 0.0;
  real inside = DL2C_RETREAT_FIRST;
  for (int k = 0; k < DL2C_RETREATS; k++, outside = inside, inside *= 4.0) {
    if (!dl2c_arrives(stretch, s - s * inside, y, duration)) continue;
    while (inside - outside > DL2C_RETREAT_FINE) {
      const real middle = 0.5 * (outside + inside);
      if (dl2c_arrives(stretch, s - s * middle, y, duration))
        inside = middle;
      else
        outside = middle;
    }
    (void)dl2c_arrives(stretch, s - s * inside, y, duration);
    return DL2C_SETTLED;
  }
  for (int j = 0; j < NX; j++) y[j] = stretch->track->c[j][0];
  *duration = stretch->from;
  if (model_inside(flow, y, p)) return DL2C_SETTLED;
  memcpy(y, stretch->x, sizeof(real) * NX);
  *duration = 0.0;
  return DL2C_SETTLED;
}

/*
 * Follows a flow from x for `cap` at most, with an eye on the watches that are open.
 *   watch: (NWATCH) updated   y: (NX) where it ends
 */
static dl2c_motion dl2c_voyage(dl2c_motor *motor, const real *x, real cap, uint8_t *watch, real *y,
                               real *duration)
{
  const int flow = motor->flow;
  const real *p = motor->p;
  real horizon;
  dl2c_track track;
  int8_t sign[NMARGIN];
  real s = 1.0;
  memcpy(y, x, sizeof(real) * NX);
  *duration = 0.0;
  if (!model_begin(flow, x, p, &horizon)) return DL2C_UNDEFINED;
  const real stop = horizon < cap ? horizon : cap;
  dl2c_stretch stretch = {.flow = flow, .x = x, .p = p, .track = &track};
  if (!(stop > 0.0)) {
    dl2c_rest(x, &track);
    (void)dl2c_look_along(&stretch, false, watch, &s, sign);
    return DL2C_SETTLED;
  }
  if (!dl2c_motor_start(motor, x, stop)) return DL2C_UNSOLVED;
  const real grown = dl2c_growth_limit(x);
  dl2c_halt halt = DL2C_NO_HALT;
  while (halt == DL2C_NO_HALT && !dl2c_motor_done(motor)) {
    if (!dl2c_motor_step(motor, &track) || dl2c_lost(motor, &track, grown)) return DL2C_UNSOLVED;
    stretch.from = track.from;
    stretch.length = track.length;
    halt = dl2c_look_along(&stretch, true, watch, &s, sign);
  }
  if (halt == DL2C_NO_HALT) {
    s = 1.0;
    stretch.low = 0.0;
    stretch.width = 1.0;
  }
  const real time = halt == DL2C_NO_HALT ? stop : dl2c_stretch_time(&stretch, s);
  return dl2c_arrive(&stretch, s, halt != DL2C_CUT, time, sign, y, duration);
}

/*
 * The same with another motor where one fails: series that are too many are a sign of stiffness, and the
 * flow begins anew with the solver; where that fails too, with many series.
 */
static dl2c_motion dl2c_sail(dl2c_motor *motor, const real *x, real cap, uint8_t *watch, real *y,
                             real *duration)
{
  motor->kernel = FLOW_KERNEL[motor->flow];
  motor->series = DL2C_MANY_SERIES;
#if DL2C_SOLVED_FLOWS
  if (motor->kernel == DL2C_LINEAR) {
    uint8_t before[NWATCH + 1];
    memcpy(before, watch, NWATCH);
    motor->series = DL2C_FEW_SERIES;
    dl2c_motion motion = dl2c_voyage(motor, x, cap, watch, y, duration);
    if (motion != DL2C_UNSOLVED || motor->linear.steps <= motor->series) return motion;
    memcpy(watch, before, NWATCH);
    motor->kernel = DL2C_NUMERIC;
    motion = dl2c_voyage(motor, x, cap, watch, y, duration);
    if (motion != DL2C_UNSOLVED) return motion;
    memcpy(watch, before, NWATCH);
    motor->kernel = DL2C_LINEAR;
    motor->series = DL2C_MANY_SERIES;
  }
#endif
  return dl2c_voyage(motor, x, cap, watch, y, duration);
}

/* Moves y along a flow that is followed track by track. */
static dl2c_motion dl2c_flow_tracks(int flow, dl2c_travel *travel, real *y)
{
  real x[NX];
  memcpy(x, y, sizeof x);
  dl2c_motor motor;
  motor.flow = flow;
  motor.p = travel->p;
  motor.solver = travel->solver;
  real cap = (real)INFINITY;
  if (travel->part < 1.0) {
    uint8_t closed[NWATCH + 1];
    memset(closed, DL2C_MET, sizeof closed);
    const dl2c_motion longest = dl2c_sail(&motor, x, cap, closed, y, &travel->duration);
    if (longest != DL2C_SETTLED) return longest;
    cap = travel->duration * travel->part;
  }
  return dl2c_sail(&motor, x, cap, travel->watch, y, &travel->duration);
}

#endif
