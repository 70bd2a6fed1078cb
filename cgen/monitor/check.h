/* SPDX-License-Identifier: MIT-0 */
/*
 * check.h -- a check of an exported monitor: which of its conditions is violated, and by how much.
 *
 * A monitor holds a copy of the statements, with its own words for KIND (the check), STATES (what it is
 * given), GIVEN (the same passed on), USABLE (whether these numbers are in range), COUNTS (whether a margin
 * is less than the least of those that count), FIRST and END (where the conditions of a single case begin
 * and end), CASES (how many there are), `firsts` (where their conditions begin), OUT_OF_RANGE and LARGEST.
 * The model says whether condition `id` holds (KIND_holds) and by how much (KIND_margin, negative where
 * it is violated).
 */
#ifndef DL2C_MONITOR_CHECK_H
#define DL2C_MONITOR_CHECK_H

/* The first of a case's conditions that does not hold, 0 for none. */
static int KIND_case(int first, int end, STATES)
{
  for (int id = first; id < end; id++) {
    if (!KIND_holds(id, GIVEN))
      return id;
  }
  return 0;
}

/* The least margin of a satisfied case in its inequalities. */
static real KIND_least_margin(int first, int end, STATES)
{
  real least = LARGEST;
  for (int id = first; id < end; id++) {
    const real margin = KIND_margin(id, GIVEN);
    if (COUNTS)
      least = margin;
  }
  return least;
}

/* A check of a single case. */
MODEL_verdict KIND_check_one(STATES)
{
  MODEL_verdict verdict = {OUT_OF_RANGE, -DL2C_SMALLEST};
  if (!(USABLE))
    return verdict;
  verdict.id = KIND_case(FIRST, END, GIVEN);
  if (verdict.id == 0) {
    verdict.val = KIND_least_margin(FIRST, END, GIVEN);
    return verdict;
  }
  const real margin = KIND_margin(verdict.id, GIVEN);
  if (margin < verdict.val)
    verdict.val = margin;
  return verdict;
}

/* A check of several cases, of which one has to be satisfied. */
MODEL_verdict KIND_check_any(STATES)
{
  MODEL_verdict verdict = {OUT_OF_RANGE, -DL2C_SMALLEST};
  if (!(USABLE))
    return verdict;
  int closest = -1;
  for (int k = 0; k < CASES; k++) {
    const int id = KIND_case(firsts[k], firsts[k + 1], GIVEN);
    if (id == 0) {
      const real least = KIND_least_margin(firsts[k], firsts[k + 1], GIVEN);
      verdict.id = 0;
      if (least > verdict.val)
        verdict.val = least;
    } else if (verdict.id != 0 && id - firsts[k] > closest) {
      closest = id - firsts[k];
      verdict.id = id;
    }
  }
  if (verdict.id == 0)
    return verdict;
  const real margin = KIND_margin(verdict.id, GIVEN);
  if (margin < verdict.val)
    verdict.val = margin;
  return verdict;
}

#endif
