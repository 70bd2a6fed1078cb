/*
 * solver_program.c -- follows hand-written flows with the CVODES kernel, as told on standard input:
 *
 * - `new STIFF RTOL ATOL`: a solver for what follows
 * - `run FLOW STOP X[NX] P`: its tracks, "track FROM LENGTH DEGREE c.. END[NX]", and how it ended;
 *   after each track "noted 1" if it came from Nordsieck's array, else "noted 0"
 * - `time FLOW STOP REPEAT X[NX] P`: microseconds a flow takes
 * - `sum ALIAS A B X[NX] Y[NX]`, `norm 0 0 X[NX] W[NX]`, and `scale`, `add`, `abs`, `inverse` or `min` with
 *   ALIAS A X[NX]: "values" of the operation of the kernel, then of that of the wheel; into X or Y where ALIAS
 *   is 1 or 2
 * - `replaced 0 0`: "values", how many operations of the wheel a vector has, and how many of the kernel
 *
 * Numbers are hexadecimal, so that nothing is lost. The only argument is the solver's library.
 */
#define _POSIX_C_SOURCE 200809L

enum { NX = 6, NP = 1 };

#include "numbers.h"

static inline void model_rates(int flow, const real *x, const real *p, real *dx);
static inline void model_jacobian(int flow, const real *x, const real *p, real *jac);

#include "flow_cvodes.h"

#include <time.h>

enum {
  DECAY,
  OSCILLATOR,
  ROBERTSON,
  ROCKET,
  BALL,
  BLOW_UP,
  UNDEFINED,
  DUBINS,
  STIFF,
  DRAIN,
  PENDULUM
};

/* SUNDIALS's cvRocket: height, speed, fuel; the engine burns where p[0] is 1. */
static void rocket(const real *x, const real *p, real *dx)
{
  dx[0] = x[1];
  dx[1] = p[0] * 2200.0 / (10.0 + x[2]) - 0.3 * x[1] - 32.0;
  dx[2] = p[0] * -0.1;
}

static inline void model_rates(int flow, const real *x, const real *p, real *dx)
{
  for (int k = 0; k < NX; k++) dx[k] = 0.0;
  switch (flow) {
  case DECAY: dx[0] = -x[0]; break;
  case OSCILLATOR:
    dx[0] = x[1];
    dx[1] = -x[0];
    break;
  case ROBERTSON:
    dx[0] = -0.04 * x[0] + 1e4 * x[1] * x[2];
    dx[2] = 3e7 * x[1] * x[1];
    dx[1] = -dx[0] - dx[2];
    break;
  case ROCKET: rocket(x, p, dx); break;
  case BALL:
    dx[0] = x[1];
    dx[1] = -9.81;
    break;
  case BLOW_UP: dx[0] = x[0] * x[0]; break;
  case UNDEFINED: dx[0] = sqrt(x[0] - 2.0); break;
  case DUBINS:
    dx[0] = x[4] * x[2];
    dx[1] = x[4] * x[3];
    dx[2] = -0.7 * x[3];
    dx[3] = 0.7 * x[2];
    dx[4] = 1.3;
    dx[5] = 1.0;
    break;
  case STIFF:
    dx[0] = -1e5 * (x[0] - x[1]);
    dx[1] = 1.0;
    break;
  case DRAIN: dx[0] = -sqrt(x[0]) - 0.1; break;
  case PENDULUM:
    dx[0] = x[1];
    dx[1] = -sin(x[0]) - 0.1 * x[1];
    break;
  default: break;
  }
}

static inline void model_jacobian(int flow, const real *x, const real *p, real *jac)
{
  (void)p;
  for (int k = 0; k < NX * NX; k++) jac[k] = 0.0;
  switch (flow) {
  case DECAY: jac[0] = -1.0; break;
  case OSCILLATOR:
    jac[0 * NX + 1] = 1.0;
    jac[1 * NX + 0] = -1.0;
    break;
  case ROBERTSON:
    jac[0 * NX + 0] = -0.04;
    jac[0 * NX + 1] = 1e4 * x[2];
    jac[0 * NX + 2] = 1e4 * x[1];
    jac[2 * NX + 1] = 6e7 * x[1];
    for (int k = 0; k < 3; k++) jac[1 * NX + k] = -jac[0 * NX + k] - jac[2 * NX + k];
    break;
  case BLOW_UP: jac[0] = 2.0 * x[0]; break;
  case DRAIN: jac[0] = -0.5 / sqrt(x[0]); break;
  case PENDULUM:
    jac[0 * NX + 1] = 1.0;
    jac[1 * NX + 0] = -cos(x[0]);
    jac[1 * NX + 1] = -0.1;
    break;
  case STIFF:
    jac[0] = -1e5;
    jac[1] = 1e5;
    break;
  default: break; /* the others are never stiff */
  }
}

static void print_track(const dl2c_track *track)
{
  printf("track %a %a %d", track->from, track->length, (int)track->degree);
  for (int k = 0; k < NX; k++)
    for (int i = 0; i <= track->degree; i++) printf(" %a", track->c[k][i]);
  for (int k = 0; k < NX; k++) printf(" %a", track->end[k]);
  printf("\n");
}

static bool is_noted(dl2c_solver *solver)
{
  int degree = 0;
  real length;
  return DL2C_SUN(CVodeGetLastOrder)(solver->engine->memory, &degree) == CV_SUCCESS
         && dl2c_engine_rows(solver->engine, solver->now, degree, &length) != NULL;
}

static const char *run(dl2c_solver *solver, int flow, real stop, const real *x, const real *p,
                       bool print)
{
  dl2c_track track;
  if (!dl2c_solver_start(solver, flow, x, p, stop)) return "failed";
  while (!dl2c_solver_done(solver)) {
    if (!dl2c_solver_step(solver, &track)) return "failed";
    if (print) print_track(&track);
    if (print) printf("noted %d\n", is_noted(solver));
  }
  return "done";
}

static real microseconds(dl2c_solver *solver, int flow, real stop, const real *x, const real *p,
                         int repeat)
{
  struct timespec begin;
  struct timespec end;
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &begin);
  for (int k = 0; k < repeat; k++) run(solver, flow, stop, x, p, false);
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &end);
  const real taken =
      (real)(end.tv_sec - begin.tv_sec) * 1e6 + (real)(end.tv_nsec - begin.tv_nsec) / 1e3;
  return taken / (real)repeat;
}

static bool read_reals(real *values, int n)
{
  for (int k = 0; k < n; k++)
    if (scanf("%la", &values[k]) != 1) return false;
  return true;
}

#ifndef DL2C_SUNDIALS_SYSTEM
static void print_values(const real *values, int n)
{
  for (int k = 0; k < n; k++) printf(" %a", values[k]);
}

/* Writes what an operation gives with these functions.   xy: (2, NX) */
static void operate(const dl2c_sundials *functions, const char *word, int alias, real a, real b,
                    const real *xy)
{
  real values[3][NX] = {{0.0}};
  N_Vector v[3];
  memcpy(values[0], xy, sizeof values[0]);
  memcpy(values[1], xy + NX, sizeof values[1]);
  for (int k = 0; k < 3; k++) v[k] = DL2C_SUN(N_VMake_Serial)(NX, values[k]);
  const int to = alias == 0 ? 2 : alias - 1;
  if (strcmp(word, "sum") == 0) functions->N_VLinearSum_Serial(a, v[0], b, v[1], v[to]);
  if (strcmp(word, "scale") == 0) functions->N_VScale_Serial(a, v[0], v[to]);
  if (strcmp(word, "norm") == 0) values[to][0] = functions->N_VWrmsNorm_Serial(v[0], v[1]);
  if (strcmp(word, "add") == 0) functions->N_VAddConst_Serial(v[0], a, v[to]);
  if (strcmp(word, "abs") == 0) functions->N_VAbs_Serial(v[0], v[to]);
  if (strcmp(word, "inverse") == 0) functions->N_VInv_Serial(v[0], v[to]);
  if (strcmp(word, "min") == 0) values[to][0] = functions->N_VMin_Serial(v[0]);
  print_values(values[to], NX);
  for (int k = 0; k < 3; k++) DL2C_SUN(N_VDestroy_Serial)(v[k]);
}

/* How many of these functions, but for those that the kernel has no other for, an operation of a vector is. */
static int used(N_Vector v, const dl2c_sundials *functions)
{
  void *ours[DL2C_SUNDIALS_COUNT], *wanted[DL2C_SUNDIALS_COUNT];
  memcpy(ours, &dl2c_vector_operations, sizeof ours);
  memcpy(wanted, functions, sizeof wanted);
  int found = 0;
  for (int k = 0; k < DL2C_SUNDIALS_COUNT; k++)
    for (size_t j = 0; j < 24 && ours[k] != NULL; j++)
      found += memcmp((char *)v->operations + j * sizeof(void *), &wanted[k], sizeof(void *)) == 0;
  return found;
}

/* How many vectors an operation takes, 0 for a word that is none. */
static int taken_by(const char *word)
{
  static const char *const names[] = {"sum", "norm", "scale", "add", "abs", "inverse", "min"};
  for (int k = 0; k < 7; k++)
    if (strcmp(word, names[k]) == 0) return k < 2 ? 2 : 1;
  return 0;
}

/* Answers what is about vectors; false if the word is not. */
static bool about_vectors(const char *word, int alias, real a)
{
  real numbers[1 + 2 * NX] = {0.0};
  if (strcmp(word, "replaced") == 0) {
    N_Vector v = dl2c_wheel_vector(numbers, &dl2c_vector_operations);
    printf("values %d %d\n", used(v, &dl2c_wheel), used(v, &dl2c_vector_operations));
    DL2C_SUN(N_VDestroy_Serial)(v);
    return true;
  }
  const bool sum = strcmp(word, "sum") == 0;
  const int vectors = taken_by(word);
  if (vectors == 0 || !read_reals(numbers + !sum, (int)sum + vectors * NX)) return false;
  printf("values");
  operate(&dl2c_vector_operations, word, alias, a, numbers[0], numbers + 1);
  operate(&dl2c_wheel, word, alias, a, numbers[0], numbers + 1);
  printf("\n");
  return true;
}
#else
static bool about_vectors(const char *word, int alias, real a)
{
  (void)word, (void)alias, (void)a;
  return false;
}
#endif

int main(int argc, char **argv)
{
  char problem[512];
  char word[16];
  dl2c_solver *solver = NULL;
  if (argc != 2) return 2;
  if (dl2c_solver_create(1e-8, 1e-10, DL2C_STIFF_NO, &solver) != DL2C_OK) printf("not loaded\n");
  dl2c_solver_free(solver);
  solver = NULL;
  for (int k = 0; k < 2; k++) {
    if (dl2c_solver_library(argv[1], problem, sizeof problem) == DL2C_OK) continue;
    printf("%s\n", problem);
    return 1;
  }
  while (scanf("%15s", word) == 1) {
    int a;
    int repeat = 1;
    real stop = 0.0;
    real x[NX + 1];
    if (scanf("%d", &a) != 1 || !read_reals(&stop, 1)) return 2;
    if (about_vectors(word, a, stop)) continue;
    if (strcmp(word, "new") == 0) {
      dl2c_solver_free(solver);
      if (!read_reals(x, 1) || dl2c_solver_create(stop, x[0], a, &solver) != DL2C_OK) return 2;
      continue;
    }
    if (strcmp(word, "time") == 0 && scanf("%d", &repeat) != 1) return 2;
    if (!read_reals(x, NX + NP)) return 2;
    const real *const p = x + NX;
    if (strcmp(word, "run") == 0) printf("%s\n", run(solver, a, stop, x, p, true));
    if (strcmp(word, "time") == 0) printf("time %a\n", microseconds(solver, a, stop, x, p, repeat));
  }
  dl2c_solver_free(solver);
  return 0;
}
