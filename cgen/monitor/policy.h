/* SPDX-License-Identifier: MIT-0 */
/*
 * policy.h -- what an exported policy does with observations and with the outputs of its network.
 *
 * Exported policies contain copies of the functions they need, below the definition of `real`.
 */
#ifndef DL2C_MONITOR_POLICY_H
#define DL2C_MONITOR_POLICY_H

static inline real clipped(real value, real low, real high)
{
  return value > low ? (value < high ? value : high) : low;
}

/* The first of the largest numbers that are open; all are where `open` is null. */
static int largest(const real *values, const bool *open, int count)
{
  int best = -1;
  for (int k = 0; k < count; k++) {
    const bool allowed = open == 0 || open[k];
    if (allowed && (best < 0 || values[k] > values[best]))
      best = k;
  }
  return best < 0 ? 0 : best;
}

#endif
