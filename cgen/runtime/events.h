/* SPDX-License-Identifier: MIT-0 */
/*
 * events.h -- what happens along a stretch of a flow: where its conditions first fail.
 *
 * Formulas of a flow are over the signs of its margins; formula 0 is the domain, then three for
 * each watch: what must stay, what is due, and the goal. The same operations in the same order
 * as dl2c/ir/follow.py.
 */
#ifndef DL2C_EVENTS_H
#define DL2C_EVENTS_H

#include "roots.h"

/* Every margin may cross once for each degree, and once more at once. */
enum { DL2C_ROOM = NMARGIN * ((NDEGREE > 12 ? NDEGREE : 12) + 1) };

/* Signs of all margins over a stretch: at its start, just after, and where they change. */
typedef struct dl2c_events {
  int32_t count;
  int8_t at_start[NMARGIN];
  int8_t after_start[NMARGIN];
  uint8_t at_end[NMARGIN]; /* whether it ends at zero but for rounding; of sampled margins */
  dl2c_crossing crossings[DL2C_ROOM];
} dl2c_events;

/* The first failure of one condition, and the signs that tell what happened there. */
typedef struct dl2c_breach {
  dl2c_exit exit;
  int8_t at[NMARGIN];
  int8_t after[NMARGIN];
} dl2c_breach;

static inline int8_t dl2c_sign_of(real a) { return (int8_t)((a > 0.0) - (a < 0.0)); }

static void dl2c_fails(int flow, int formula, const dl2c_events *events, dl2c_breach *failure)
{
  failure->exit =
      dl2c_first_exit(flow, formula, events->crossings, events->count, FLOW_MARGINS[flow],
                      events->at_start, events->after_start, failure->at, failure->after);
}

/* Whether a flow that ends at `stop` of a stretch got as far as a failure. */
static bool dl2c_reached(const dl2c_exit *exit, real stop, bool included)
{
  return exit->found
         && (exit->at < stop || (exit->at == stop && (included || !exit->holds)));
}

/*
 * What the watches say of a stretch on which the domain lets the flow go as far as `limit`.
 * Returns where a violation cuts it, or 2.
 */
static real dl2c_watch(int flow, const dl2c_events *events, real limit, uint8_t *watch)
{
  dl2c_breach failures[NWATCH + 1] = {0};
  real stop = 2.0;
  for (int w = 0; w < NWATCH; w++) {
    if (watch[w] != DL2C_WATCHING) continue;
    dl2c_fails(flow, 1 + 3 * w, events, &failures[w]);
    const dl2c_exit *exit = &failures[w].exit;
    if (WATCH_CUTS[w] && dl2c_reached(exit, limit, false) && exit->at < stop) stop = exit->at;
  }
  for (int w = 0; w < NWATCH; w++) {
    if (watch[w] != DL2C_WATCHING) continue;
    const dl2c_exit *exit = &failures[w].exit;
    if (!dl2c_reached(exit, limit, false)) continue;
    if (stop <= 1.0 && !dl2c_reached(exit, stop, WATCH_CUTS[w])) continue;
    const int8_t *signs = exit->holds ? failures[w].after : failures[w].at;
    if (model_condition(flow, 3 + 3 * w, signs))
      watch[w] = DL2C_MET;
    else if (model_condition(flow, 2 + 3 * w, signs))
      watch[w] = DL2C_FAILED;
  }
  return stop;
}

#endif
