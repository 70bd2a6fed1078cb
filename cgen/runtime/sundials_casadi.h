/* SPDX-License-Identifier: MIT-0 */
/*
 * sundials_casadi.h -- SUNDIALS 2.6 as the casadi wheel carries it, loaded at run time.
 *
 * The declarations state facts of that interface, which no wheel ships a header for.
 */
#ifndef DL2C_SUNDIALS_CASADI_H
#define DL2C_SUNDIALS_CASADI_H

#include <dlfcn.h>
#include <pthread.h>
#include <stdio.h>

typedef struct dl2c_serial {
  long length;
  int owns_data;
  double *data;
} dl2c_serial;
typedef struct dl2c_vector {
  dl2c_serial *content;
  void *operations;
} *N_Vector;

typedef int (*dl2c_rates_fn)(double t, N_Vector y, N_Vector dy, void *data);
typedef int (*dl2c_setup_fn)(double t, N_Vector y, N_Vector dy, int known, int *fresh, double gamma,
                             void *data, N_Vector work1, N_Vector work2, N_Vector work3);
typedef int (*dl2c_solve_fn)(double t, N_Vector y, N_Vector dy, N_Vector r, N_Vector z,
                             double gamma, double delta, int side, void *data, N_Vector work);
typedef int (*dl2c_times_fn)(N_Vector v, N_Vector jv, double t, N_Vector y, N_Vector dy, void *data,
                             N_Vector work);
typedef void (*dl2c_error_fn)(int code, const char *module, const char *function, char *text,
                              void *data);

enum { CV_ADAMS = 1, CV_BDF = 2, CV_FUNCTIONAL = 1, CV_NEWTON = 2, PREC_LEFT = 1 };
enum { CV_ONE_STEP = 2, CV_SUCCESS = 0, CV_TSTOP_RETURN = 1 };

#define DL2C_SUNDIALS_FUNCTIONS(F)                                                           \
  F(N_Vector, N_VMake_Serial, (long length, double *data))                                   \
  F(void, N_VDestroy_Serial, (N_Vector y))                                                   \
  F(void, N_VLinearSum_Serial, (double a, N_Vector x, double b, N_Vector y, N_Vector z))     \
  F(void, N_VScale_Serial, (double c, N_Vector x, N_Vector z))                               \
  F(double, N_VWrmsNorm_Serial, (N_Vector x, N_Vector w))                                    \
  F(void, N_VAbs_Serial, (N_Vector x, N_Vector z))                                           \
  F(void, N_VInv_Serial, (N_Vector x, N_Vector z))                                           \
  F(void, N_VAddConst_Serial, (N_Vector x, double b, N_Vector z))                            \
  F(double, N_VMin_Serial, (N_Vector x))                                                     \
  F(void *, CVodeCreate, (int method, int iteration))                                        \
  F(void, CVodeFree, (void **memory))                                                        \
  F(int, CVodeInit, (void *memory, dl2c_rates_fn rates, double t, N_Vector y))               \
  F(int, CVodeReInit, (void *memory, double t, N_Vector y))                                  \
  F(int, CVodeSStolerances, (void *memory, double rtol, double atol))                        \
  F(int, CVodeSetErrHandlerFn, (void *memory, dl2c_error_fn handler, void *data))            \
  F(int, CVodeSetMaxOrd, (void *memory, int order))                                          \
  F(int, CVodeSetStopTime, (void *memory, double t))                                         \
  F(int, CVodeSetUserData, (void *memory, void *data))                                       \
  F(int, CVode, (void *memory, double t, N_Vector y, double *reached, int task))             \
  F(int, CVodeGetDky, (void *memory, double t, int k, N_Vector dky))                         \
  F(int, CVodeGetLastOrder, (void *memory, int *order))                                      \
  F(int, CVodeGetLastStep, (void *memory, double *length))                                   \
  F(int, CVSpgmr, (void *memory, int side, int dimensions))                                  \
  F(int, CVSpilsSetPreconditioner, (void *memory, dl2c_setup_fn setup, dl2c_solve_fn solve)) \
  F(int, CVSpilsSetJacTimesVecFn, (void *memory, dl2c_times_fn times))

#define DL2C_MEMBER(result, name, parameters) result(*name) parameters;
#define DL2C_NAME(result, name, parameters) #name,
typedef struct dl2c_sundials {
  DL2C_SUNDIALS_FUNCTIONS(DL2C_MEMBER)
} dl2c_sundials;
static const char *const DL2C_SUNDIALS_NAMES[] = {DL2C_SUNDIALS_FUNCTIONS(DL2C_NAME)};
#undef DL2C_MEMBER
#undef DL2C_NAME
enum { DL2C_SUNDIALS_COUNT = sizeof DL2C_SUNDIALS_NAMES / sizeof DL2C_SUNDIALS_NAMES[0] };
_Static_assert(sizeof(dl2c_sundials) == DL2C_SUNDIALS_COUNT * sizeof(void *),
               "functions and data pointers are of one size");

/* The only global variable: written once, under the lock, before any solver exists. */
static dl2c_sundials dl2c_wheel;
static bool dl2c_wheel_loaded = false;
static char dl2c_wheel_path[4096]; /* of a library to be opened when it is needed */
static pthread_mutex_t dl2c_wheel_lock = PTHREAD_MUTEX_INITIALIZER;

#define DL2C_SUN(function) dl2c_wheel.function

/*
 * The wheel's symbols come first for the wheel itself, whatever other SUNDIALS the process has
 * loaded for all to see. Address sanitizers refuse the flag, macOS and musl have none.
 */
#if defined(__has_feature)
#if __has_feature(address_sanitizer)
#define DL2C_SANITIZED
#endif
#endif
#if defined(RTLD_DEEPBIND) && !defined(__SANITIZE_ADDRESS__) && !defined(DL2C_SANITIZED)
enum { DL2C_OPENING = RTLD_NOW | RTLD_LOCAL | RTLD_DEEPBIND };
#else
enum { DL2C_OPENING = RTLD_NOW | RTLD_LOCAL };
#endif

/* Fills the table from the library at a path; says in `problem` what is wrong with it. */
static bool dl2c_wheel_open(const char *path, char *problem, size_t size)
{
  void *const library = dlopen(path, DL2C_OPENING);
  if (library == NULL) {
    snprintf(problem, size, "%s", dlerror());
    return false;
  }
  void *found[DL2C_SUNDIALS_COUNT];
  for (int k = 0; k < DL2C_SUNDIALS_COUNT; k++) {
    found[k] = dlsym(library, DL2C_SUNDIALS_NAMES[k]);
    if (found[k] == NULL) {
      snprintf(problem, size, "%.180s has no function %s", path, DL2C_SUNDIALS_NAMES[k]);
      dlclose(library);
      return false;
    }
  }
  memcpy(&dl2c_wheel, found, sizeof dl2c_wheel);
  return true;
}

dl2c_status dl2c_solver_library(const char *path, char *problem, size_t capacity)
{
  if (path == NULL || problem == NULL || capacity == 0) return DL2C_ERR_ARG;
  problem[0] = '\0';
  pthread_mutex_lock(&dl2c_wheel_lock);
#ifdef DL2C_SPARE_SOLVER
  bool loaded = strlen(path) < sizeof dl2c_wheel_path;
  if (loaded) memcpy(dl2c_wheel_path, path, strlen(path) + 1);
#else
  if (!dl2c_wheel_loaded) dl2c_wheel_loaded = dl2c_wheel_open(path, problem, capacity);
  const bool loaded = dl2c_wheel_loaded;
#endif
  pthread_mutex_unlock(&dl2c_wheel_lock);
  return loaded ? DL2C_OK : DL2C_ERR_SOLVER;
}

/* Whether functions can be called; a library that is needed for the first time is opened. */
static bool dl2c_sundials_ready(void)
{
  char problem[256];
  pthread_mutex_lock(&dl2c_wheel_lock);
  if (!dl2c_wheel_loaded && dl2c_wheel_path[0] != '\0')
    dl2c_wheel_loaded = dl2c_wheel_open(dl2c_wheel_path, problem, sizeof problem);
  dl2c_wheel_path[0] = '\0';
  const bool loaded = dl2c_wheel_loaded;
  pthread_mutex_unlock(&dl2c_wheel_lock);
  return loaded;
}

/* CVODES would write to stderr by itself. */
static void dl2c_solver_silent(int code, const char *module, const char *function, char *text,
                               void *data)
{
  (void)code, (void)module, (void)function, (void)text, (void)data;
}

static inline real *dl2c_values(N_Vector y) { return y->content->data; }

/* One solver memory and the vector it is started from. */
typedef struct dl2c_engine {
  void *memory;
  N_Vector y;
  N_Vector derivative;
  N_Vector noting;
  dl2c_nordsieck noted;
} dl2c_engine;

/* What a stiff engine calls, with the parameters of newer versions. */
static int dl2c_newton_setup(real t, N_Vector y, N_Vector dy, int known, int *fresh, real gamma,
                             void *data);
static int dl2c_newton_solve(real t, N_Vector y, N_Vector dy, N_Vector r, N_Vector z, real gamma,
                             real delta, int side, void *data);

static int dl2c_wheel_setup(double t, N_Vector y, N_Vector dy, int known, int *fresh, double gamma,
                            void *data, N_Vector work1, N_Vector work2, N_Vector work3)
{
  (void)work1, (void)work2, (void)work3;
  return dl2c_newton_setup(t, y, dy, known, fresh, gamma, data);
}

static int dl2c_wheel_solve(double t, N_Vector y, N_Vector dy, N_Vector r, N_Vector z, double gamma,
                            double delta, int side, void *data, N_Vector work)
{
  (void)work;
  return dl2c_newton_solve(t, y, dy, r, z, gamma, delta, side, data);
}

static void dl2c_engine_free(dl2c_engine *engine)
{
  if (engine->memory != NULL) DL2C_SUN(CVodeFree)(&engine->memory);
  if (engine->y != NULL) DL2C_SUN(N_VDestroy_Serial)(engine->y);
  if (engine->derivative != NULL) DL2C_SUN(N_VDestroy_Serial)(engine->derivative);
  if (engine->noting != NULL) DL2C_SUN(N_VDestroy_Serial)(engine->noting);
}

/* z = a x + b y, rounded as N_VLinearSum_Serial does. Products with 1 and -1 are exact. */
static void dl2c_vector_sum(double a, N_Vector x, double b, N_Vector y, N_Vector z)
{
  const double *u = dl2c_values(x), *v = dl2c_values(y);
  const bool exact = fabs(a) == 1.0 || fabs(b) == 1.0;
  double sum[NX];
  if (!exact && a == b)
    for (int k = 0; k < NX; k++) sum[k] = a * (u[k] + v[k]);
  else if (!exact && a == -b)
    for (int k = 0; k < NX; k++) sum[k] = a * (u[k] - v[k]);
  else
    for (int k = 0; k < NX; k++) sum[k] = a * u[k] + b * v[k];
  memcpy(dl2c_values(z), sum, sizeof sum);
}

/* z = c x */
static void dl2c_vector_scale(double c, N_Vector x, N_Vector z)
{
  const double *u = dl2c_values(x);
  double scaled[NX];
  for (int k = 0; k < NX; k++) scaled[k] = c * u[k];
  memcpy(dl2c_values(z), scaled, sizeof scaled);
}

/* The root of the mean square of x with weights w. */
static double dl2c_vector_norm(N_Vector x, N_Vector w)
{
  const double *u = dl2c_values(x), *weights = dl2c_values(w);
  double sum = 0.0;
  for (int k = 0; k < NX; k++) {
    const double weighted = u[k] * weights[k];
    sum += weighted * weighted;
  }
  return sqrt(sum / NX);
}

/* z = |x| */
static void dl2c_vector_abs(N_Vector x, N_Vector z)
{
  const double *u = dl2c_values(x);
  double sizes[NX];
  for (int k = 0; k < NX; k++) sizes[k] = fabs(u[k]);
  memcpy(dl2c_values(z), sizes, sizeof sizes);
}

/* z = 1 / x */
static void dl2c_vector_inverse(N_Vector x, N_Vector z)
{
  const double *u = dl2c_values(x);
  double inverse[NX];
  for (int k = 0; k < NX; k++) inverse[k] = 1.0 / u[k];
  memcpy(dl2c_values(z), inverse, sizeof inverse);
}

/* z = x + b */
static void dl2c_vector_add(N_Vector x, double b, N_Vector z)
{
  const double *u = dl2c_values(x);
  double sum[NX];
  for (int k = 0; k < NX; k++) sum[k] = u[k] + b;
  memcpy(dl2c_values(z), sum, sizeof sum);
}

static double dl2c_vector_min(N_Vector x)
{
  const double *u = dl2c_values(x);
  double least = u[0];
  for (int k = 1; k < NX; k++) least = u[k] < least ? u[k] : least;
  return least;
}

static const dl2c_sundials dl2c_vector_operations = {.N_VLinearSum_Serial = dl2c_vector_sum,
                                                     .N_VScale_Serial = dl2c_vector_scale,
                                                     .N_VWrmsNorm_Serial = dl2c_vector_norm,
                                                     .N_VAbs_Serial = dl2c_vector_abs,
                                                     .N_VInv_Serial = dl2c_vector_inverse,
                                                     .N_VAddConst_Serial = dl2c_vector_add,
                                                     .N_VMin_Serial = dl2c_vector_min};

/*
 * CVODES tells Nordsieck's array where it adds up a first derivative, if the vector for the sum notes what is
 * added: a times row a. At the end of a step what was added before counts 0 times.
 */
static void dl2c_note_sum(double a, N_Vector x, double b, N_Vector y, N_Vector z)
{
  dl2c_nordsieck *const noted = (dl2c_nordsieck *)(void *)dl2c_values(z);
  (void)y;
  if (b == 0.0 && a >= 1.0 && a < DL2C_NORDSIECK) noted->row[(int)a] = dl2c_values(x);
}

/* The first term, or what the sum is multiplied by. */
static void dl2c_note_scale(double c, N_Vector x, N_Vector z)
{
  dl2c_nordsieck *const noted = (dl2c_nordsieck *)(void *)dl2c_values(z);
  if (x == z)
    noted->inverse = c;
  else
    dl2c_note_sum(c, x, 0.0, x, z);
}

static const dl2c_sundials dl2c_noting_operations = {.N_VLinearSum_Serial = dl2c_note_sum,
                                                     .N_VScale_Serial = dl2c_note_scale};

/*
 * Nordsieck's array at the end of a step of this length. NULL where CVODES does not tell it as expected; the
 * derivatives themselves can then be asked for.
 */
static const dl2c_nordsieck *dl2c_engine_rows(dl2c_engine *engine, real reached, int degree, real *length)
{
  dl2c_nordsieck *const noted = &engine->noted;
  *noted = (dl2c_nordsieck){.inverse = 0.0};
  if (degree < 1 || degree >= DL2C_NORDSIECK) return NULL;
  if (DL2C_SUN(CVodeGetDky)(engine->memory, reached, 1, engine->noting) != CV_SUCCESS) return NULL;
  if (DL2C_SUN(CVodeGetLastStep)(engine->memory, length) != CV_SUCCESS) return NULL;
  bool told = noted->inverse == 1.0 / *length;
  for (int i = 1; i <= degree; i++) told &= noted->row[i] != NULL;
  return told ? noted : NULL;
}

/*
 * Lets a vector, and all that CVODES makes like it, use these operations in place of those of the wheel.
 * They are compiled for its length, and read it in the pieces in which they wrote it: in others it can be
 * read only once it has reached the cache. With those of the wheel a small system spends a third of the time
 * in them.
 */
static void dl2c_wheel_operations(N_Vector y, const dl2c_sundials *operations)
{
  enum { SLOTS = 24 }; /* the table has more */
  const void *theirs[DL2C_SUNDIALS_COUNT], *ours[DL2C_SUNDIALS_COUNT];
  memcpy(theirs, &dl2c_wheel, sizeof theirs);
  memcpy(ours, operations, sizeof ours);
  for (int k = 0; k < DL2C_SUNDIALS_COUNT; k++) {
    char *slot = y->operations;
    for (int j = 0; j < SLOTS && ours[k] != NULL; j++, slot += sizeof(void *))
      if (memcmp(slot, &theirs[k], sizeof(void *)) == 0) memcpy(slot, &ours[k], sizeof(void *));
  }
}

/* A vector over an array; NULL also where its layout is not the one declared above. */
static N_Vector dl2c_wheel_vector(real *values, const dl2c_sundials *operations)
{
  N_Vector y = DL2C_SUN(N_VMake_Serial)(NX, values);
  if (y == NULL) return NULL;
  if (y->content->length == NX && y->content->data == values) {
    dl2c_wheel_operations(y, operations);
    return y;
  }
  DL2C_SUN(N_VDestroy_Serial)(y);
  return NULL;
}

/*
 * Vectors and memory for one method; the linear solver of a stiff one. `data` is what rates and
 * linear solver are called with. False: out of memory.
 */
static bool dl2c_engine_create(dl2c_engine *engine, bool stiff, real *y, real *derivative,
                               dl2c_rates_fn rates, dl2c_times_fn times, void *data)
{
  engine->y = dl2c_wheel_vector(y, &dl2c_vector_operations);
  engine->derivative = dl2c_wheel_vector(derivative, &dl2c_vector_operations);
  engine->noting = dl2c_wheel_vector((real *)(void *)&engine->noted, &dl2c_noting_operations);
  if (engine->y == NULL || engine->derivative == NULL || engine->noting == NULL) return false;
  engine->memory =
      DL2C_SUN(CVodeCreate)(stiff ? CV_BDF : CV_ADAMS, stiff ? CV_NEWTON : CV_FUNCTIONAL);
  if (engine->memory == NULL) return false;
  if (DL2C_SUN(CVodeSetErrHandlerFn)(engine->memory, dl2c_solver_silent, NULL) != CV_SUCCESS)
    return false;
  if (DL2C_SUN(CVodeInit)(engine->memory, rates, 0.0, engine->y) != CV_SUCCESS) return false;
  /* CVSpgmr copies the pointer. */
  if (DL2C_SUN(CVodeSetUserData)(engine->memory, data) != CV_SUCCESS) return false;
  if (!stiff) return true;
  return DL2C_SUN(CVSpgmr)(engine->memory, PREC_LEFT, 0) == CV_SUCCESS
         && DL2C_SUN(CVSpilsSetPreconditioner)(engine->memory, dl2c_wheel_setup, dl2c_wheel_solve)
                == CV_SUCCESS
         && DL2C_SUN(CVSpilsSetJacTimesVecFn)(engine->memory, times) == CV_SUCCESS;
}

#endif
