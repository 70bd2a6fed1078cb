/*
 * resolve_inputs.c -- what it costs to find an admissible value: masks and requests, without the rest
 * of a step. Compiled with -DMODEL='"model.c"'; prints nanoseconds for each request, and for one that a
 * function only clips to the bounds, each the least of many.
 */
#define _POSIX_C_SOURCE 199309L
#include <stdio.h>
#include <time.h>

#include MODEL

enum { STATES = 4096, ROUNDS = 40 };

static double now(void)
{
  struct timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return (double)t.tv_sec * 1e9 + (double)t.tv_nsec;
}

/* What an environment without tests does with a request. */
__attribute__((noinline)) static real clipped(real wanted, real low, real high)
{
  return wanted < low ? low : wanted > high ? high : wanted;
}

int main(void)
{
  static real x[STATES][NX];
  static real wanted[STATES][NU];
  const real p[NP + 1] = {0.0};
  const bool given[NU + 1] = {false};
  dl2c_rng rng = dl2c_rng_make(1, 0);
  double least = 1e300, least_clipped = 1e300;
  real sum = 0.0;
  for (int i = 0; i < STATES; i++) {
    for (int k = 0; k < NX; k++) x[i][k] = 4.0 * dl2c_rng_unit(&rng) - 1.0;
    for (int k = 0; k < NU; k++) wanted[i][k] = 6.0 * dl2c_rng_unit(&rng) - 3.0;
  }
  for (int round = 0; round < ROUNDS; round++) {
    const double start = now();
    for (int i = 0; i < STATES; i++) {
      real u[NU + 1];
      real executed;
      const dl2c_search search = {0, x[i], p, given, u};
      if (!dl2c_all_have_values(&search)) continue;
      for (int k = 0; k < PATHS[0].ninput; k++) {
        u[k] = dl2c_requested(&search, k, DL2C_MAP_PROJECT, wanted[i][k], &executed);
        sum += u[k];
      }
    }
    const double took = (now() - start) / STATES;
    if (took < least) least = took;
    const double again = now();
    for (int i = 0; i < STATES; i++) sum += clipped(wanted[i][0], INPUT_LOW[0], INPUT_HIGH[0]);
    const double took_clipped = (now() - again) / STATES;
    if (took_clipped < least_clipped) least_clipped = took_clipped;
  }
  printf("%.2f %.2f %g\n", least, least_clipped, sum);
  return 0;
}
