/* SPDX-License-Identifier: MIT-0 */
/* dense.h -- small dense linear systems: LU factors with row exchanges, in place, without
 * allocation. */
#ifndef DL2C_DENSE_H
#define DL2C_DENSE_H

#include "numbers.h"

/*
 * Replaces a matrix by its factors: below the diagonal the multipliers of L, from the diagonal
 * on U. False: it is singular or a value is not a number.
 *   a: (n, n) row-major   pivot: (n) the row exchanged with row k
 */
static bool dl2c_lu_factor(real *a, int32_t *pivot, int n)
{
  for (int k = 0; k < n; k++) {
    int best = k;
    for (int i = k + 1; i < n; i++)
      if (fabs(a[i * n + k]) > fabs(a[best * n + k])) best = i;
    pivot[k] = best;
    const real top = a[best * n + k];
    if (!(fabs(top) > 0.0 && fabs(top) <= DBL_MAX)) return false;
    for (int j = 0; best != k && j < n; j++) {
      const real moved = a[k * n + j];
      a[k * n + j] = a[best * n + j];
      a[best * n + j] = moved;
    }
    for (int i = k + 1; i < n; i++) {
      const real multiplier = a[i * n + k] / top;
      a[i * n + k] = multiplier;
      if (multiplier == 0.0) continue;
      for (int j = k + 1; j < n; j++) a[i * n + j] -= multiplier * a[k * n + j];
    }
  }
  return true;
}

/* Solves the factored system in place.   x: (n) the right-hand side, then the solution */
static void dl2c_lu_solve(const real *a, const int32_t *pivot, int n, real *x)
{
  for (int k = 0; k < n; k++) {
    const real moved = x[pivot[k]];
    x[pivot[k]] = x[k];
    x[k] = moved;
  }
  for (int i = 1; i < n; i++)
    for (int j = 0; j < i; j++) x[i] -= a[i * n + j] * x[j];
  for (int i = n - 1; i >= 0; i--) {
    for (int j = i + 1; j < n; j++) x[i] -= a[i * n + j] * x[j];
    x[i] /= a[i * n + i];
  }
}

#endif
