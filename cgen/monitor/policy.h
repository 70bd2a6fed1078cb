/* SPDX-License-Identifier: MIT-0 */
/*
 * policy.h -- what an exported policy does with observations and with the outputs of its network.
 *
 * Exported policies contain copies of the functions they need, below the definition of `real`, with words
 * of their own for MODEL, RUNS (how many vectors of alternatives TAKEN has, one for each control path; -1 for
 * a choice that is not met), CHOICES, ALTERNATIVES (of all choices; those of choice c begin at START[c]),
 * POLICY_PATHS (how many paths an output stands for, in PATHS) and MADE (choices that `asks` makes).
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

/* Which alternatives are possible; all of a choice that no possible path meets. */
static void mask(MODEL_state curr, const MODEL_parameters *params, const MODEL_input *input,
                 bool open[ALTERNATIVES])
{
  MODEL_state post = curr;
  bool met[CHOICES] = {false};
  for (int k = 0; k < ALTERNATIVES; k++)
    open[k] = false;
  for (int r = 0; r < RUNS; r++) {
    const bool possible = MODEL_run(curr, params, input, TAKEN[r], &post);
    for (int c = 0; c < CHOICES; c++) {
      if (possible && TAKEN[r][c] >= 0) {
        open[START[c] + TAKEN[r][c]] = true;
        met[c] = true;
      }
    }
  }
  for (int c = 0; c < CHOICES; c++)
    for (int k = START[c]; k < START[c + 1]; k++)
      open[k] = open[k] || !met[c];
}

/* Which paths are possible: those of which all alternatives are. */
static void mask_paths(const bool open[ALTERNATIVES], bool whole[POLICY_PATHS])
{
  for (int r = 0; r < POLICY_PATHS; r++) {
    whole[r] = true;
    for (int c = 0; c < CHOICES; c++)
      whole[r] = whole[r] && (PATHS[r][c] < 0 || open[START[c] + PATHS[r][c]]);
  }
}

MODEL_state MODEL_policy_ctrl(MODEL_state curr, const MODEL_parameters *params,
                              const MODEL_input *input)
{
  MODEL_input asked;
  int choices[MADE];
  MODEL_state post = curr;
  MODEL_policy_asks(curr, params, input, &asked, choices);
  (void)MODEL_run(curr, params, &asked, choices, &post);
  return post;
}

#endif
