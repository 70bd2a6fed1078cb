/* SPDX-License-Identifier: MIT-0 */
/*
 * policy.h -- what an exported policy does with observations and with the outputs of its network.
 *
 * An exported policy contains copies of the functions that it needs, below the definition of `real`. In the
 * copies these words are replaced:
 *   MODEL         the name of the model;
 *   RUNS          rows of TAKEN: each is the alternatives that control paths take, -1 for a choice not met;
 *   CHOICES       how many choices there are;
 *   ALTERNATIVES  of all choices together; those of choice c begin at START[c];
 *   POLICY_PATHS  rows of PATHS: the paths that have an output each;
 *   MADE          the length of the array of choices that `asks` makes.
 */
#ifndef DL2C_MONITOR_POLICY_H
#define DL2C_MONITOR_POLICY_H

static inline real clipped(real value, real low, real high)
{
  return value > low ? (value < high ? value : high) : low;
}

/* The index of the largest value that is open, the first of equals; 0 if none is. Without `open` all are. */
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

/* Marks the alternatives that some possible path takes; for a choice that no such path meets, all. */
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

/* Marks the paths whose alternatives are all open. */
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
