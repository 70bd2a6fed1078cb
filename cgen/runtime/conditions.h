/* SPDX-License-Identifier: MIT-0 */
/*
 * conditions.h -- why a model admits something or does not, for pages in which it is driven by hand.
 *
 * Included last by a generated file that includes the model's own file, with DL2C_INSPECT=1, and defines
 *
 *   enum { NATOM };                              comparisons of all its conditions
 *   void model_atoms(x, p, u, real *margin, uint8_t *truth)   of each: positive inside, 0 on its boundary, for
 *                                                = and != left minus right; and whether it holds
 *
 * Never part of a library that trains.
 */
#ifndef DL2C_CONDITIONS_H
#define DL2C_CONDITIONS_H

#include "batch.h"

/* Sizes for whoever allocates what the functions below fill. */
typedef struct dl2c_condition_sizes {
  int32_t natom;  /* comparisons */
  int32_t nu;     /* inputs of all players */
  int32_t npiece; /* intervals of admissible values of an input, at most */
  int32_t nnoted; /* paths of a run, at most */
} dl2c_condition_sizes;

DL2C_API void dl2c_sizes_of_conditions(dl2c_condition_sizes *out)
{
  *out = (dl2c_condition_sizes){NATOM, NU, DL2C_NPIECE, DL2C_MOST_NOTED};
}

/* Memory that holds zeros, for callers without an allocator of their own; NULL where there is none. */
DL2C_API void *dl2c_memory(size_t bytes) { return calloc(bytes > 0 ? bytes : 1, 1); }
DL2C_API void dl2c_memory_free(void *memory) { free(memory); }

/*
 * Every comparison in a state, with these values of inputs.
 *   x: (nx)   p: (np)   u: (nu)   margin, truth: (natom)
 */
DL2C_API void dl2c_atoms(const double *x, const double *p, const double *u, double *margin, uint8_t *truth)
{
  model_atoms(x, p, u, margin, truth);
}

/*
 * The admissible values of the input at a place of a path, given the values of some others: closed
 * intervals in order; how many, or DL2C_ERR_ARG.
 *   given: (nu) 1 for inputs with a value in u: (nu)   low, high: (npiece)
 */
DL2C_API int32_t dl2c_admissible_values(int32_t path, int32_t place, const double *x, const double *p,
                                        const uint8_t *given, const double *u, double *low, double *high)
{
  if (path < 0 || path >= NPATH || place < 0 || place >= PATHS[path].ninput) return DL2C_ERR_ARG;
  bool met[NU + 1];
  real values[NU + 1];
  for (int j = 0; j < NU; j++) met[j] = given[j] != 0;
  for (int j = 0; j < NU; j++) values[j] = u[j];
  const dl2c_search search = {path, x, p, met, values};
  dl2c_pieces pieces;
  dl2c_admissible(&search, place, NULL, &pieces);
  for (int k = 0; k < pieces.count; k++) {
    low[k] = pieces.low[k];
    high[k] = pieces.high[k];
  }
  return pieces.count;
}

/*
 * The paths that a step of environment i will take, as it is requested in the buffers; the environment stays
 * as it is. How many, 0 where there is no run, or DL2C_ERR_ARG.   paths: (nnoted)
 */
DL2C_API int32_t dl2c_paths_ahead(const dl2c_batch *b, int64_t i, int32_t *paths)
{
  if (b == NULL || i < 0 || i >= b->n) return DL2C_ERR_ARG;
  real p[NP + 1];
  dl2c_trial run;
  uint8_t enabled[NPATH];
  dl2c_stand(b, i, &run, p);
  for (int k = 0; k < DL2C_NSTART; k++) enabled[k] = b->enabled[k * b->stride + i];
  run.nnoted = 0;
  dl2c_request request = dl2c_request_of(b, i, p);
  request.noted = paths;
  request.followed = NULL;
  return dl2c_complete(&request, &run, enabled, NULL) ? run.nnoted : 0;
}

#endif
