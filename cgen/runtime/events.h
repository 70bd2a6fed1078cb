/* SPDX-License-Identifier: MIT-0 */
/*
 * events.h -- what happens along a stretch of a flow: where its conditions first fail.
 *
 * Formulas of a flow are over the signs of its margins; formula 0 is the domain, then three for
 * each watch: what must stay, what is due, and the goal. The same operations in the same order
 * as dl2c/flows/events.py.
 */
#ifndef DL2C_EVENTS_H
#define DL2C_EVENTS_H

#include "numbers.h"

/* One place where a margin is zero: its sign is 0 at `at` and `after` just after. */
typedef struct dl2c_crossing {
  real at; /* in [0,1] */
  int32_t margin;
  int8_t after;
} dl2c_crossing;

typedef struct dl2c_exit {
  bool found;
  bool holds; /* the formula still holds at `at`; it fails just after */
  real at;    /* in [0,1] */
} dl2c_exit;

/* Given by the model: whether a formula of a flow holds where its margins have these signs. */
static inline bool model_condition(int flow, int formula, const int8_t *sign);

/* Signs of all margins over a stretch: at its start, just after, and where they change, in order. */
typedef struct dl2c_events {
  int32_t count;
  int8_t at_start[NMARGIN];
  int8_t after_start[NMARGIN];
  uint8_t begins[NMARGIN]; /* whether a margin begins at zero but for rounding, */
  uint8_t ends[NMARGIN];   /* and whether it ends there */
  dl2c_crossing crossings[2 * NMARGIN];
} dl2c_events;

/* The first failure of one condition, and the signs that tell what happened there. */
typedef struct dl2c_breach {
  dl2c_exit exit;
  int8_t at[NMARGIN];
  int8_t after[NMARGIN];
} dl2c_breach;

static inline int8_t dl2c_sign_of(real a) { return (int8_t)((a > 0.0) - (a < 0.0)); }

static inline bool dl2c_later(const dl2c_crossing *a, const dl2c_crossing *b)
{
  return a->at > b->at || (a->at == b->at && a->margin > b->margin);
}

/* Adds a crossing in its place; each margin has two at most. */
static inline void dl2c_cross(dl2c_events *events, real at, int32_t margin, int after)
{
  const dl2c_crossing new = {at, margin, (int8_t)after};
  int k = events->count++;
  for (; k > 0 && dl2c_later(&events->crossings[k - 1], &new); k--)
    events->crossings[k] = events->crossings[k - 1];
  events->crossings[k] = new;
}

/*
 * When a formula first fails. The breach has the signs at and just after the exit, at 1 if there is
 * none. What comes just after 1 is not looked at.
 */
static void dl2c_fails(int flow, int formula, const dl2c_events *events, dl2c_breach *failure)
{
  const size_t n = (size_t)FLOW_MARGINS[flow];
  int8_t *at_it = failure->at;
  int8_t *after = failure->after;
  memcpy(at_it, events->at_start, n);
  memcpy(after, events->after_start, n);
  failure->exit = (dl2c_exit){true, false, 0.0};
  if (!model_condition(flow, formula, at_it)) return;
  failure->exit.holds = true;
  if (!model_condition(flow, formula, after)) return;
  for (int i = 0; i < events->count;) {
    const real at = events->crossings[i].at;
    memcpy(at_it, after, n);
    for (; i < events->count && events->crossings[i].at == at; i++) {
      at_it[events->crossings[i].margin] = 0;
      after[events->crossings[i].margin] = events->crossings[i].after;
    }
    failure->exit = (dl2c_exit){true, false, at};
    if (!model_condition(flow, formula, at_it)) return;
    failure->exit = (dl2c_exit){at < 1.0, true, at};
    if (at == 1.0 || !model_condition(flow, formula, after)) return;
  }
  memcpy(at_it, after, n);
  failure->exit = (dl2c_exit){false, true, 1.0};
}

/* Whether a flow that ends at `stop` of a stretch got as far as a failure. */
static bool dl2c_reached(const dl2c_exit *exit, real stop, bool included)
{
  return exit->found
         && (exit->at < stop || (exit->at == stop && (included || !exit->holds)));
}

/*
 * Updates the watches on a stretch on which the domain lets the flow go as far as `limit`. Returns
 * where a violation cuts the flow, or 2.
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
