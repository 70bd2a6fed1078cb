/* SPDX-License-Identifier: MIT-0 */
/*
 * search.h -- searches a track for the end of the flow, interval by interval.
 *
 * The same operations in the same order as dl2c/flows/search.py.
 */
#ifndef DL2C_SEARCH_H
#define DL2C_SEARCH_H

#include "stretch.h"

/* The number of intervals of a track after which the search for events gives up. */
enum { DL2C_MOST_PARTS = 1 << 14 };

/* Where and why a motion ends within a track. */
typedef enum dl2c_halt {
  DL2C_NO_HALT = 0,
  DL2C_LEAVES = 1,   /* its domain ends it */
  DL2C_CUT = 2,      /* a violation does */
  DL2C_GIVES_UP = 3, /* there are too many intervals */
} dl2c_halt;

/* Goes on to the next interval of the track; it is twice as long where the bisection allows. */
static void dl2c_next_stretch(dl2c_stretch *stretch)
{
  stretch->begun = true;
  stretch->low += stretch->width;
  if (fmod(stretch->low, 2.0 * stretch->width) == 0.0) stretch->width *= 2.0;
}

/* Whether rounding leaves the sign of a margin open.   vague: (NMARGIN) */
static bool dl2c_some_vague(int flow, const uint8_t *vague)
{
  return memchr(vague, true, (size_t)FLOW_MARGINS[flow]) != NULL;
}

/* Whether there is no event on an interval: its conditions hold in every state within the hull. */
static bool dl2c_event_free(dl2c_stretch *stretch, const dl2c_hull *x, bool bounded, const uint8_t *watch)
{
  if (!model_event_free(stretch->flow, x, stretch->x, stretch->p, bounded, watch)) return false;
  stretch->known = false;
  return true;
}

/*
 * Searches a track for the end of the flow, interval by interval. On a halt *place is where on the
 * track; sign: (NMARGIN) the signs there, else at the end. `bounded`: the domain counts too.
 */
DL2C_COLD static dl2c_halt dl2c_search_track(dl2c_stretch *stretch, bool bounded, uint8_t *watch, real *place,
                                 int8_t *sign)
{
  dl2c_events events;
  dl2c_breach failure = {0};
  dl2c_taylor x[NX];
  dl2c_hull hull[NX];
  bool event_free = false;
  bool vague = false;
  stretch->low = 0.0;
  stretch->width = stretch->clear = 1.0;
  stretch->parts = 0;
  memset(sign, 1, NMARGIN);
  if (FLOW_MARGINS[stretch->flow] == 0) return DL2C_NO_HALT;
  dl2c_track_hull(stretch->track, hull);
  if (dl2c_event_free(stretch, hull, bounded, watch)) {
    stretch->begun = true;
    return DL2C_NO_HALT;
  }
  stretch->clear = 0.0;
  while (stretch->low < 1.0) {
    if (stretch->parts++ == DL2C_MOST_PARTS) return DL2C_GIVES_UP;
    const real half = 0.5 * stretch->width;
    dl2c_track_models(stretch->track, stretch->low + half, half, x);
    for (int k = 0; k < NX; k++) hull[k] = x[k].hull;
    event_free = stretch->width < 1.0 && dl2c_event_free(stretch, hull, bounded, watch);
    if (!event_free && !dl2c_stretch_events(stretch, x, &events)) {
      stretch->width *= 0.5;
      continue;
    }
    const bool begins_vague = vague;
    if (!begins_vague) stretch->clear = stretch->low;
    vague = !event_free && dl2c_some_vague(stretch->flow, events.ends);
    if (!event_free) {
      dl2c_fails(stretch->flow, 0, &events, &failure);
      const bool leaves = bounded && failure.exit.found;
      const real limit = leaves ? failure.exit.at : 1.0;
      const real stop = dl2c_watch(stretch->flow, &events, limit, watch);
      *place = stretch->low + stretch->width * (stop <= 1.0 ? stop : limit);
      if (!begins_vague && !vague) stretch->clear = *place;
      if (NWATCH > 0 && stop <= 1.0) return DL2C_CUT;
      memcpy(sign, failure.at, sizeof failure.at);
      for (int j = 0; j < FLOW_MARGINS[stretch->flow]; j++)
        if ((limit >= 1.0 && events.ends[j]) || (!(limit > 0.0) && events.begins[j])) sign[j] = 0;
      if (leaves) {
        if (!failure.exit.holds && *place > 0.0) *place = dl2c_before(*place);
        return DL2C_LEAVES;
      }
    }
    dl2c_next_stretch(stretch);
  }
  if (event_free) memset(sign, 1, NMARGIN);
  return DL2C_NO_HALT;
}

#endif
