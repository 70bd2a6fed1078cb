/* SPDX-License-Identifier: MIT-0 */
/*
 * flow_cvodes.h -- flows followed step by step by SUNDIALS CVODES.
 *
 * A solver keeps one memory for each method it may use and starts it anew for every flow: what it
 * answers depends on that flow alone. Flows that are not stiff take an Adams method with functional
 * iteration, stiff ones BDF with the exact Jacobian. Where that is left open, a flow begins with
 * Adams; after DL2C_ADAMS_STEPS steps, or where Adams fails, it goes on with BDF from the point
 * reached.
 *
 * A tenth of the tolerances bounds the Euclidean norm of the local error in units of rtol*|x| + atol. That is
 * CVODES's own norm without the mean over all variables, by which variables that stand still would
 * loosen it.
 */
#ifndef DL2C_FLOW_CVODES_H
#define DL2C_FLOW_CVODES_H

#include "dense.h"
#include "pieces.h"
#include "sundials.h"

#include <stdlib.h>

enum { DL2C_STIFF_NO = 0, DL2C_STIFF_YES = 1, DL2C_STIFF_AUTO = 2 };

/*
 * The share of the tolerances that the error of one step may take. Errors of many steps add up;
 * with this, most flows end within ten times the tolerances.
 */
#define DL2C_STEP_SHARE 0.1

/* With order 6, a quadratic margin of a track has degree 12. */
enum { DL2C_ADAMS_ORDER = 6, DL2C_BDF_ORDER = 5 };

/* Steps of one flow: before it counts as stiff, and before it counts as failed. */
enum { DL2C_ADAMS_STEPS = 500, DL2C_SOLVER_STEPS = 100000 };

/* Steps of a linear flow whose series are too many: a stiff one needs few, a fast oscillation all. */
enum { DL2C_SPARE_STEPS = 20000 };

/* Flows that last less are one straight step; the solver squares times, which must not underflow. */
#define DL2C_NEGLIGIBLE 1e-100

typedef struct dl2c_solver {
  dl2c_engine adams; /* without memory if every flow is stiff */
  dl2c_engine bdf;   /* without memory if none is */
  bool prepared;     /* the engines exist */
  real rtol, atol;
  int32_t stiff;
  dl2c_engine *engine; /* the one that follows the present flow */
  int32_t flow;
  int32_t steps;
  real now;
  real stop;
  real p[NP + 1];
  real last[NX]; /* the state at `now` */
  real y[NX];    /* what the engines work on */
  real derivative[NX];
  real jacobian[NX * NX]; /* of the rates, where it was last evaluated */
  real factors[NX * NX];  /* of I - gamma * jacobian */
  int32_t pivot[NX];
} dl2c_solver;

/* The rates. A state in which one has no value makes the solver try a shorter step. */
static int dl2c_solver_rates(real t, N_Vector y, N_Vector dy, void *data)
{
  const dl2c_solver *const solver = data;
  (void)t;
  real *const dx = dl2c_values(dy);
  model_rates(solver->flow, dl2c_values(y), solver->p, dx);
  return dl2c_all_finite(dx, NX) ? 0 : 1;
}

/* Factors I - gamma * J; `known`: J may stay what it is. */
static int dl2c_newton_setup(real t, N_Vector y, N_Vector dy, int known, int *fresh, real gamma,
                             void *data)
{
  dl2c_solver *const solver = data;
  (void)t, (void)dy;
  *fresh = !known;
  if (!known) model_jacobian(solver->flow, dl2c_values(y), solver->p, solver->jacobian);
  if (!known && !dl2c_all_finite(solver->jacobian, NX * NX)) return 1;
  for (int k = 0; k < NX * NX; k++) solver->factors[k] = -gamma * solver->jacobian[k];
  for (int k = 0; k < NX; k++) solver->factors[k * NX + k] += 1.0;
  return dl2c_lu_factor(solver->factors, solver->pivot, NX) ? 0 : 1;
}

/* z = (I - gamma * J)^-1 r */
static int dl2c_newton_solve(real t, N_Vector y, N_Vector dy, N_Vector r, N_Vector z, real gamma,
                             real delta, int side, void *data)
{
  const dl2c_solver *const solver = data;
  (void)t, (void)y, (void)dy, (void)gamma, (void)delta, (void)side;
  memcpy(dl2c_values(z), dl2c_values(r), sizeof solver->y);
  dl2c_lu_solve(solver->factors, solver->pivot, NX, dl2c_values(z));
  return 0;
}

/* jv = J v, with the Jacobian that the factors were made of. */
static int dl2c_newton_times(N_Vector v, N_Vector jv, real t, N_Vector y, N_Vector dy, void *data,
                             N_Vector work)
{
  const dl2c_solver *const solver = data;
  (void)t, (void)y, (void)dy, (void)work;
  for (int i = 0; i < NX; i++) {
    real sum = 0.0;
    for (int j = 0; j < NX; j++) sum += solver->jacobian[i * NX + j] * dl2c_values(v)[j];
    dl2c_values(jv)[i] = sum;
  }
  return 0;
}

static void dl2c_solver_free(dl2c_solver *solver)
{
  if (solver == NULL) return;
  dl2c_engine_free(&solver->adams);
  dl2c_engine_free(&solver->bdf);
  free(solver);
}

static bool dl2c_solver_engine(dl2c_solver *solver, dl2c_engine *engine, bool stiff)
{
  const real share = DL2C_STEP_SHARE / sqrt((real)NX);
  return dl2c_engine_create(engine, stiff, solver->y, solver->derivative, dl2c_solver_rates,
                            dl2c_newton_times, solver)
         && DL2C_SUN(CVodeSStolerances)(engine->memory, solver->rtol * share, solver->atol * share)
                == CV_SUCCESS
         && DL2C_SUN(CVodeSetMaxOrd)(engine->memory, stiff ? DL2C_BDF_ORDER : DL2C_ADAMS_ORDER)
                == CV_SUCCESS;
}

/* Makes what a solver needs to follow a flow, once. DL2C_ERR_SOLVER: see dl2c_solver_create. */
static dl2c_status dl2c_solver_prepare(dl2c_solver *solver)
{
  if (solver->prepared) return DL2C_OK;
  if (!dl2c_sundials_ready()) return DL2C_ERR_SOLVER;
  if ((solver->stiff != DL2C_STIFF_YES && !dl2c_solver_engine(solver, &solver->adams, false))
      || (solver->stiff != DL2C_STIFF_NO && !dl2c_solver_engine(solver, &solver->bdf, true))) {
    dl2c_engine_free(&solver->adams);
    dl2c_engine_free(&solver->bdf);
    memset(&solver->adams, 0, sizeof solver->adams);
    memset(&solver->bdf, 0, sizeof solver->bdf);
    return DL2C_ERR_NOMEM;
  }
  solver->prepared = true;
  return DL2C_OK;
}

/* A solver with tolerances rtol >= 0 and atol > 0 that is not prepared yet.   stiff: DL2C_STIFF_* */
static dl2c_status dl2c_solver_reserve(real rtol, real atol, int stiff, dl2c_solver **out)
{
  dl2c_solver *solver = calloc(1, sizeof *solver);
  if (solver == NULL) return DL2C_ERR_NOMEM;
  solver->rtol = rtol;
  solver->atol = atol;
  solver->stiff = stiff;
  *out = solver;
  return DL2C_OK;
}

/* One that is. DL2C_ERR_SOLVER: there is no SUNDIALS, see dl2c_solver_library. */
static inline dl2c_status dl2c_solver_create(real rtol, real atol, int stiff, dl2c_solver **out)
{
  dl2c_solver *solver;
  dl2c_status status = dl2c_solver_reserve(rtol, atol, stiff, &solver);
  if (status != DL2C_OK) return status;
  status = dl2c_solver_prepare(solver);
  if (status == DL2C_OK)
    *out = solver;
  else
    dl2c_solver_free(solver);
  return status;
}

/* The solver of one thread: only reserved where flows need it in some states alone. */
static inline dl2c_status dl2c_solver_new(real rtol, real atol, int stiff, dl2c_solver **out)
{
#ifdef DL2C_SPARE_SOLVER
  return dl2c_solver_reserve(rtol, atol, stiff, out);
#else
  return dl2c_solver_create(rtol, atol, stiff, out);
#endif
}

/* Lets an engine go on from where the flow is. */
static bool dl2c_solver_resume(dl2c_solver *solver, dl2c_engine *engine)
{
  solver->engine = engine;
  memcpy(solver->y, solver->last, sizeof solver->y);
  return DL2C_SUN(CVodeReInit)(engine->memory, solver->now, engine->y) == CV_SUCCESS
         && DL2C_SUN(CVodeSetStopTime)(engine->memory, solver->stop) == CV_SUCCESS;
}

/*
 * Begins a flow in state x (NX) with constants p (NP), to be followed for a time stop > 0; `stiffly`
 * with BDF, if there is a choice.
 */
static bool dl2c_solver_begin(dl2c_solver *solver, int flow, const real *x, const real *p,
                              real stop, bool stiffly)
{
  if (dl2c_solver_prepare(solver) != DL2C_OK) return false;
  solver->flow = flow;
  solver->steps = stiffly ? DL2C_SOLVER_STEPS - DL2C_SPARE_STEPS : 0;
  solver->now = 0.0;
  solver->stop = stop;
  memcpy(solver->last, x, sizeof solver->last);
  if (NP > 0) memcpy(solver->p, p, sizeof(real) * NP);
  const bool bdf = solver->stiff == DL2C_STIFF_YES || (stiffly && solver->stiff != DL2C_STIFF_NO);
  return dl2c_solver_resume(solver, bdf ? &solver->bdf : &solver->adams);
}

static inline bool dl2c_solver_start(dl2c_solver *solver, int flow, const real *x, const real *p,
                              real stop)
{
  return dl2c_solver_begin(solver, flow, x, p, stop, false);
}

/* Whether the last step reached the end of the flow. */
static bool dl2c_solver_done(const dl2c_solver *solver) { return solver->now >= solver->stop; }

/* A polynomial of each variable about s = 1 as one about s = 0.   c: (degree + 1, NX) */
static void dl2c_solver_shift(real (*c)[NX], int degree)
{
  for (int first = 0; first < degree; first++)
    for (int i = degree - 1; i >= first; i--)
      for (int k = 0; k < NX; k++) c[i][k] -= c[i + 1][k];
}

/*
 * Coefficients 1 to `degree` of the last step's interpolant about its end: derivatives, as CVODES gives
 * them, times length^i / i!. False where it does not.
 */
static bool dl2c_solver_asked(const dl2c_solver *solver, real reached, int degree, real (*c)[NX])
{
  real scale = 1.0;
  for (int i = 1; i <= degree; i++) {
    if (DL2C_SUN(CVodeGetDky)(solver->engine->memory, reached, i, solver->engine->derivative) != CV_SUCCESS)
      return false;
    scale *= (reached - solver->now) / (real)i;
    for (int k = 0; k < NX; k++) c[i][k] = solver->derivative[k] * scale;
  }
  return true;
}

/*
 * The same numbers in one call, from Nordsieck's array: row i times i! / h^i is the i-th derivative, to
 * which CVODES adds higher ones 0 times. False where the array is not known.
 */
static bool dl2c_solver_noted(const dl2c_solver *solver, real reached, int degree, real (*c)[NX])
{
  real h;
  const dl2c_nordsieck *const noted = dl2c_engine_rows(solver->engine, reached, degree, &h);
  if (noted == NULL) return false;
  real scale = 1.0;
  real factorial = 1.0;
  real power = 1.0;
  memcpy(c[degree], noted->row[degree], sizeof c[degree]);
  for (int i = degree - 1; i >= 1; i--)
    for (int k = 0; k < NX; k++) c[i][k] = noted->row[i][k] + 0.0 * c[i + 1][k];
  for (int i = 1; i <= degree; i++) {
    factorial *= (real)i;
    power *= h;
    scale *= (reached - solver->now) / (real)i;
    const real inverse = 1.0 / power;
    for (int k = 0; k < NX; k++) c[i][k] = factorial * c[i][k] * inverse * scale;
  }
  return true;
}

/*
 * The interpolant of the step from `now` to `reached`, which CVODES gives by its derivatives there.
 * False: a coefficient is out of range.
 */
static bool dl2c_solver_track(dl2c_solver *solver, real reached, dl2c_track *track)
{
  void *const memory = solver->engine->memory;
  int degree = 0;
  if (DL2C_SUN(CVodeGetLastOrder)(memory, &degree) != CV_SUCCESS) return false;
  track->from = solver->now;
  track->length = reached - solver->now;
  track->degree = degree;
  real c[DL2C_ADAMS_ORDER + 1][NX];
  memcpy(c[0], solver->y, sizeof c[0]);
  if (!dl2c_solver_noted(solver, reached, degree, c) && !dl2c_solver_asked(solver, reached, degree, c))
    return false;
  dl2c_solver_shift(c, degree);
  memcpy(c[0], solver->last, sizeof c[0]);
  bool finite = true;
  for (int i = 0; i <= degree; i++) {
    for (int k = 0; k < NX; k++) track->c[k][i] = c[i][k];
    finite &= dl2c_all_finite(c[i], NX);
  }
  memcpy(track->end, solver->y, sizeof track->end);
  return finite;
}

/* A flow that is too short for the solver, as one straight step. */
static bool dl2c_solver_straight(dl2c_solver *solver, dl2c_track *track)
{
  real rates[NX];
  model_rates(solver->flow, solver->last, solver->p, rates);
  track->from = 0.0;
  track->length = solver->stop;
  track->degree = 1;
  for (int k = 0; k < NX; k++) {
    track->c[k][0] = solver->last[k];
    track->c[k][1] = rates[k] * solver->stop;
    track->end[k] = track->c[k][0] + track->c[k][1];
  }
  memcpy(solver->last, track->end, sizeof solver->last);
  solver->now = solver->stop;
  return dl2c_all_finite(track->end, NX);
}

/*
 * One internal step, never beyond `stop`; its interpolant in *track. False: the solver failed, or
 * the state left the range of numbers.
 */
static bool dl2c_solver_step(dl2c_solver *solver, dl2c_track *track)
{
  real reached = solver->now;
  if (solver->stop < DL2C_NEGLIGIBLE) return dl2c_solver_straight(solver, track);
  for (;;) {
    const bool adams = solver->engine == &solver->adams;
    const bool may_switch = adams && solver->stiff == DL2C_STIFF_AUTO;
    if (!may_switch || solver->steps < DL2C_ADAMS_STEPS) {
      if (solver->steps++ >= DL2C_SOLVER_STEPS) return false;
      const int status = DL2C_SUN(CVode)(solver->engine->memory, solver->stop, solver->engine->y,
                                         &reached, CV_ONE_STEP);
      if (status >= CV_SUCCESS && reached > solver->now && dl2c_all_finite(solver->y, NX)) break;
    }
    if (!may_switch || !dl2c_solver_resume(solver, &solver->bdf)) return false;
  }
  if (!dl2c_solver_track(solver, reached, track)) return false;
  memcpy(solver->last, solver->y, sizeof solver->last);
  solver->now = reached;
  return true;
}

#endif
