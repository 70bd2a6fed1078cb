/* SPDX-License-Identifier: MIT-0 */
/* sundials_system.h -- an installed SUNDIALS, version 6 or 7. */
#ifndef DL2C_SUNDIALS_SYSTEM_H
#define DL2C_SUNDIALS_SYSTEM_H

#include <cvodes/cvodes.h>
#include <nvector/nvector_serial.h>
#include <sundials/sundials_version.h>
#include <sunlinsol/sunlinsol_spgmr.h>
#include <sunnonlinsol/sunnonlinsol_fixedpoint.h>

#if SUNDIALS_VERSION_MAJOR < 6
#error "SUNDIALS 6 or newer is needed"
#endif
#ifndef SUNDIALS_DOUBLE_PRECISION
#error "SUNDIALS in double precision is needed"
#endif

#define DL2C_SUN(function) function

/* Linked with the model: there is nothing to load. */
dl2c_status dl2c_solver_library(const char *path, char *problem, size_t capacity)
{
  if (path == NULL || problem == NULL || capacity == 0) return DL2C_ERR_ARG;
  problem[0] = '\0';
  return DL2C_OK;
}

static bool dl2c_sundials_ready(void) { return true; }

static inline real *dl2c_values(N_Vector y) { return NV_DATA_S(y); }

typedef int (*dl2c_rates_fn)(real t, N_Vector y, N_Vector dy, void *data);
typedef int (*dl2c_times_fn)(N_Vector v, N_Vector jv, real t, N_Vector y, N_Vector dy, void *data,
                             N_Vector work);

/* One solver memory, what it consists of, and the vector it is started from. */
typedef struct dl2c_engine {
  void *memory;
  N_Vector y;
  N_Vector derivative;
  SUNContext context;
  SUNLinearSolver linear;
  SUNNonlinearSolver fixed_point;
} dl2c_engine;

static int dl2c_newton_setup(real t, N_Vector y, N_Vector dy, int known, int *fresh, real gamma,
                             void *data);
static int dl2c_newton_solve(real t, N_Vector y, N_Vector dy, N_Vector r, N_Vector z, real gamma,
                             real delta, int side, void *data);

static void dl2c_engine_free(dl2c_engine *engine)
{
  if (engine->memory != NULL) CVodeFree(&engine->memory);
  if (engine->linear != NULL) SUNLinSolFree(engine->linear);
  if (engine->fixed_point != NULL) SUNNonlinSolFree(engine->fixed_point);
  if (engine->y != NULL) N_VDestroy(engine->y);
  if (engine->derivative != NULL) N_VDestroy(engine->derivative);
  if (engine->context != NULL) SUNContext_Free(&engine->context);
}

static SUNContext dl2c_system_context(void)
{
  SUNContext context = NULL;
#if SUNDIALS_VERSION_MAJOR >= 7
  if (SUNContext_Create(SUN_COMM_NULL, &context) != 0) return NULL;
  SUNContext_ClearErrHandlers(context);
#else
  if (SUNContext_Create(NULL, &context) != 0) return NULL;
#endif
  return context;
}

#if SUNDIALS_VERSION_MAJOR < 7
static void dl2c_solver_silent(int code, const char *module, const char *function, char *text,
                               void *data)
{
  (void)code, (void)module, (void)function, (void)text, (void)data;
}
#endif

/*
 * Vectors and memory for one method; the linear solver of a stiff one. `data` is what rates and
 * linear solver are called with. False: out of memory.
 */
static bool dl2c_engine_create(dl2c_engine *engine, bool stiff, real *y, real *derivative,
                               dl2c_rates_fn rates, dl2c_times_fn times, void *data)
{
  engine->context = dl2c_system_context();
  if (engine->context == NULL) return false;
  engine->y = N_VMake_Serial(NX, y, engine->context);
  engine->derivative = N_VMake_Serial(NX, derivative, engine->context);
  if (engine->y == NULL || engine->derivative == NULL) return false;
  engine->memory = CVodeCreate(stiff ? CV_BDF : CV_ADAMS, engine->context);
  if (engine->memory == NULL) return false;
#if SUNDIALS_VERSION_MAJOR < 7
  if (CVodeSetErrHandlerFn(engine->memory, dl2c_solver_silent, NULL) != CV_SUCCESS) return false;
#endif
  if (CVodeInit(engine->memory, rates, 0.0, engine->y) != CV_SUCCESS) return false;
  if (CVodeSetUserData(engine->memory, data) != CV_SUCCESS) return false;
  if (!stiff) {
    engine->fixed_point = SUNNonlinSol_FixedPoint(engine->y, 0, engine->context);
    return engine->fixed_point != NULL
           && CVodeSetNonlinearSolver(engine->memory, engine->fixed_point) == CV_SUCCESS;
  }
  engine->linear = SUNLinSol_SPGMR(engine->y, SUN_PREC_LEFT, 0, engine->context);
  return engine->linear != NULL
         && CVodeSetLinearSolver(engine->memory, engine->linear, NULL) == CV_SUCCESS
         && CVodeSetPreconditioner(engine->memory, dl2c_newton_setup, dl2c_newton_solve)
                == CV_SUCCESS
         && CVodeSetJacTimes(engine->memory, NULL, times) == CV_SUCCESS;
}

/* Only the wheel's CVODES tells it. */
static inline const dl2c_nordsieck *dl2c_engine_rows(dl2c_engine *engine, real reached, int degree, real *length)
{
  (void)engine, (void)reached, (void)degree, (void)length;
  return NULL;
}

#endif
