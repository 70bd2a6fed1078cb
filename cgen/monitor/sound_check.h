/* SPDX-License-Identifier: MIT-0 */
/*
 * sound_check.h -- a check of a sound monitor: which of its conditions is violated, or may be.
 *
 * The words are those of check.h. The model says with certainty whether condition `id` holds: KIND_truth is
 * IV_TRUE, IV_FALSE or IV_UNKNOWN.
 */
#ifndef DL2C_MONITOR_SOUND_CHECK_H
#define DL2C_MONITOR_SOUND_CHECK_H

/* The first of a case's conditions that is false, else the first that is unknown, 0 if all hold. */
static MODEL_verdict KIND_case(int first, int end, STATES)
{
  MODEL_verdict verdict = {0, false};
  for (int id = first; id < end; id++) {
    const int truth = KIND_truth(id, GIVEN);
    if (truth == IV_FALSE || (truth == IV_UNKNOWN && verdict.id == 0)) {
      verdict.id = id;
      verdict.unknown = truth == IV_UNKNOWN;
    }
    if (truth == IV_FALSE)
      return verdict;
  }
  return verdict;
}

/* A check of a single case. */
MODEL_verdict KIND_check_one(STATES)
{
  MODEL_verdict verdict = {OUT_OF_RANGE, false};
  if (!(USABLE))
    return verdict;
  return KIND_case(FIRST, END, GIVEN);
}

/* A check of several cases: one that may hold comes before those that do not. */
MODEL_verdict KIND_check_any(STATES)
{
  MODEL_verdict verdict = {OUT_OF_RANGE, false};
  if (!(USABLE))
    return verdict;
  int closest = -1;
  for (int k = 0; k < CASES; k++) {
    const MODEL_verdict found =
        KIND_case(firsts[k], firsts[k + 1], GIVEN);
    if (found.id == 0)
      return found;
    if ((found.unknown && !verdict.unknown)
        || (found.unknown == verdict.unknown && found.id - firsts[k] > closest)) {
      closest = found.id - firsts[k];
      verdict = found;
    }
  }
  return verdict;
}

#endif
