/*
 * hostile_steps.c -- one generated model, stepped with whatever a caller might send.
 *
 * Compiled with -DMODEL='"<model>.c"' and a sanitizer. Every buffer has exactly the size that
 * dl2c.h asks for, so that reading or writing past one is seen. Exit code 1: a call broke its
 * promise.
 */
#include MODEL

#include <pthread.h>
#include <stdio.h>

enum { STEPS = 60, MODES = 18 };

/* The arrays of a batch, each an allocation of its own. */
typedef struct arrays {
  int32_t *choices;
  double *inputs;
  dl2c_buffers out;
  void *owned[19];
} arrays;

static double hostile_number(dl2c_rng *rng)
{
  static const double odd[] = {0.0,     -0.0,     1.0,      -1.0,      0.5,
                               1e100,   -1e100,   1e300,    -1e300,    5e-324,
                               DBL_MAX, -DBL_MAX, HUGE_VAL, -HUGE_VAL, NAN};
  const uint64_t pick = dl2c_rng_next(rng) % 24;
  return pick < 15 ? odd[pick] : dl2c_rng_uniform(rng, -10.0, 10.0);
}

static int32_t hostile_choice(dl2c_rng *rng)
{
  static const int32_t odd[] = {INT32_MIN, INT32_MAX, -1, -2, 127, 128, 255, 32767, 32768, 65536};
  const uint64_t pick = dl2c_rng_next(rng) % 30;
  return pick < 10 ? odd[pick] : (int32_t)(pick % 4);
}

static void *taken(arrays *a, int k, size_t size)
{
  a->owned[k] = malloc(size);
  if (a->owned[k] == NULL) exit(2);
  memset(a->owned[k], 0, size);
  return a->owned[k];
}

static void take(arrays *a, size_t n)
{
  a->choices = taken(a, 0, n * NCHOICE * sizeof(int32_t));
  a->inputs = taken(a, 1, n * NU * sizeof(double));
  a->out = (dl2c_buffers){
      .choices = a->choices,
      .inputs = a->inputs,
      .obs = taken(a, 2, n * NOBS * sizeof(dl2c_obs)),
      .final_obs = taken(a, 3, n * NOBS * sizeof(dl2c_obs)),
      .rewards = taken(a, 4, n * sizeof(double)),
      .terminated = taken(a, 5, n),
      .truncated = taken(a, 6, n),
      .mask = taken(a, 7, n * NMASK),
      .executed_choices = taken(a, 8, n * NCHOICE * sizeof(int32_t)),
      .executed_inputs = taken(a, 9, n * NU * sizeof(double)),
      .status = taken(a, 10, n * sizeof(int32_t)),
      .reason = taken(a, 11, n * sizeof(int32_t)),
      .cost = taken(a, 12, n * sizeof(int32_t)),
      .blocked = taken(a, 13, n),
      .postcondition = taken(a, 14, n),
      .saturated = taken(a, 15, n),
      .reset = taken(a, 16, n),
      .duration = taken(a, 17, n * sizeof(double)),
      .time = taken(a, 18, n * sizeof(double)),
  };
}

static void give_back(arrays *a)
{
  for (int k = 0; k < 19; k++) free(a->owned[k]);
}

static void expect(bool holds, const char *what)
{
  if (holds) return;
  fprintf(stderr, "broken promise: %s\n", what);
  exit(1);
}

/* Puts every environment somewhere, now and then at hostile places, which must be refused. */
static void place(dl2c_batch *b, int64_t n, dl2c_rng *rng)
{
  double x[NX], p[NP + 1];
  for (int64_t i = 0; i < n; i++) {
    bool finite = true;
    for (int k = 0; k < NX; k++) {
      x[k] = dl2c_rng_next(rng) % 50 == 0 ? hostile_number(rng) : dl2c_rng_uniform(rng, -3.0, 3.0);
      finite = finite && fabs(x[k]) <= 1e100;
    }
    for (int k = 0; k < NCONSTANT; k++) {
      p[k] = dl2c_rng_next(rng) % 50 == 0 ? hostile_number(rng) : dl2c_rng_uniform(rng, 0.5, 2.0);
      finite = finite && isfinite(p[k]);
    }
    expect((dl2c_batch_set_state(b, i, x, p) == DL2C_OK) == finite,
           "a state is taken iff it is finite");
    (void)dl2c_batch_reset_to(b, i, NULL, x, p);
    double y[NX], q[NP + 1];
    expect(dl2c_batch_get_state(b, i, y, q) == DL2C_OK, "get_state");
    for (int k = 0; k < NX; k++) expect(fabs(y[k]) <= 1e100, "the state is finite");
  }
}

/* What a step wrote: flags are 0 or 1, the state is finite, what was executed exists. */
static void check(const dl2c_batch *b, const arrays *a, int64_t n)
{
  for (int64_t i = 0; i < n; i++) {
    expect(a->out.terminated[i] <= 1 && a->out.truncated[i] <= 1 && a->out.reset[i] <= 1, "flags");
    expect(a->out.duration[i] >= 0.0 && isfinite(a->out.time[i]), "time");
    expect(!isnan(a->out.rewards[i]), "rewards are numbers");
    double y[NX], q[NP + 1];
    expect(dl2c_batch_get_state(b, i, y, q) == DL2C_OK, "get_state");
    for (int k = 0; k < NX; k++) expect(fabs(y[k]) <= 1e100, "the state is finite");
    for (int k = 0; k < NMASK; k++)
      expect((a->out.mask[i * NMASK + k] & ~1) == 0, "masks are 0 or 1");
  }
}

static void run(int64_t n, int mode, uint64_t seed, int32_t threads)
{
  dl2c_rng rng = dl2c_rng_make(seed, (uint64_t)mode);
  arrays a;
  take(&a, (size_t)n);
  const dl2c_options options = {.max_steps = mode % 4 == 0 ? 0 : 7,
                                .stall_limit = mode % 5,
                                .blocked_penalty = -0.25,
                                .autoreset = mode % 3,
                                .on_blocked = mode / 3 % 3,
                                .action_map = mode / 9 % 2,
                                .threads = threads,
                                .shared_obs = mode % 2};
  dl2c_batch *b = NULL;
  expect(dl2c_batch_create(n, &options, &a.out, &b) == DL2C_OK, "create");
  uint64_t *seeds = malloc((size_t)n * sizeof *seeds);
  for (int64_t i = 0; i < n; i++) seeds[i] = dl2c_rng_next(&rng);
  (void)dl2c_batch_reset(b, NULL, seeds);
  free(seeds);
  place(b, n, &rng);
  const int steps = n >= 1000 ? STEPS / 6 : STEPS;
  for (int step = 0; step < steps; step++) {
    for (int64_t k = 0; k < n * NCHOICE; k++) a.choices[k] = hostile_choice(&rng);
    for (int64_t k = 0; k < n * NU; k++) a.inputs[k] = hostile_number(&rng);
    if (dl2c_batch_step(b) == DL2C_OK) check(b, &a, n);
    if (step % 9 == 8) place(b, n, &rng);
  }
  dl2c_batch_free(b);
  give_back(&a);
}

/* Calls that must be refused, whatever else is right. */
static void misuse(void)
{
  arrays a;
  take(&a, 1);
  dl2c_options options = {.max_steps = 10};
  dl2c_batch *b = NULL;
  double x[NX + 1] = {0.0}, p[NP + 1] = {0.0}, g[NROOT + 1], dg[NROOT + 1], dx[NX];
  expect(dl2c_batch_create(0, &options, &a.out, &b) == DL2C_ERR_ARG, "no environments");
  expect(dl2c_batch_create(-1, &options, &a.out, &b) == DL2C_ERR_ARG, "less than none");
  expect(dl2c_batch_create(1, NULL, &a.out, &b) == DL2C_ERR_ARG, "no options");
  expect(dl2c_batch_create(INT64_MAX, &options, &a.out, &b) == DL2C_ERR_NOMEM, "far too many");
  expect(dl2c_batch_create(INT64_MAX / 8, &options, &a.out, &b) == DL2C_ERR_NOMEM, "too many");
  expect(dl2c_batch_step(NULL) == DL2C_ERR_ARG
             && dl2c_batch_reset(NULL, NULL, NULL) == DL2C_ERR_ARG,
         "none");
  const dl2c_options wrong[] = {{.max_steps = -1}, {.stall_limit = -1},     {.autoreset = 3},
                                {.autoreset = -1}, {.on_blocked = 3},       {.on_blocked = -1},
                                {.action_map = 2}, {.blocked_penalty = NAN},
                                {.threads = -1},   {.threads = 257},
                                {.shared_obs = 2}, {.shared_obs = -1}};
  for (size_t k = 0; k < sizeof wrong / sizeof *wrong; k++)
    expect(dl2c_batch_create(1, &wrong[k], &a.out, &b) == DL2C_ERR_ARG,
           "an option that does not exist");
  expect(dl2c_batch_create(1, &options, &a.out, &b) == DL2C_OK, "create");
  expect(dl2c_batch_get_state(b, 1, x, p) == DL2C_ERR_ARG, "index");
  expect(dl2c_batch_set_state(b, -1, x, p) == DL2C_ERR_ARG, "index");
  expect(dl2c_batch_step(b) != DL2C_ERR_NOMEM, "a step before any reset");
  expect(dl2c_flow_rates(-1, x, p, dx) == DL2C_ERR_ARG
             && dl2c_flow_rates(NFLOW, x, p, dx) == DL2C_ERR_ARG,
         "flow");
  for (int32_t flow = 0; flow < NFLOW; flow++)
    expect(dl2c_flow_roots(flow, x, p, g, dg) == DL2C_OK, "roots");
  dl2c_batch_free(b);
  dl2c_batch_free(NULL);
  give_back(&a);
}

static void *thread(void *seed)
{
  for (int mode = 0; mode < MODES; mode += 5) run(97, mode, *(const uint64_t *)seed, 1);
  return NULL;
}

int main(int argc, char **argv)
{
  if (argc > 1 && strcmp(argv[1], "threads") == 0) {
    const uint64_t seeds[] = {1, 2};
    pthread_t threads[2];
    for (int k = 0; k < 2; k++)
      expect(pthread_create(&threads[k], NULL, thread, (void *)(uintptr_t)&seeds[k]) == 0,
             "create");
    for (int k = 0; k < 2; k++) pthread_join(threads[k], NULL);
    for (int mode = 0; mode < MODES; mode += 5) run(1000, mode, 3, 3);
    return 0;
  }
  const int64_t sizes[] = {1, 7, 64, 1000};
  const int every = argc > 1 && strcmp(argv[1], "long") == 0 ? 1 : 5;
  misuse();
  for (int k = 0; k < 4; k++)
    for (int mode = k % every; mode < MODES; mode += every) run(sizes[k], mode, (uint64_t)mode + 1, 1 + k % 2);
  return 0;
}
