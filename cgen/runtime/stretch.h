/* SPDX-License-Identifier: MIT-0 */
/*
 * stretch.h -- what is watched along motion whose margins are no polynomials of time.
 *
 * Margins are sampled at the nodes of pieces.h, stretch by stretch, and taken for the polynomials
 * through the samples. A stretch on which such a curve misses the margin elsewhere is halved.
 */
#ifndef DL2C_STRETCH_H
#define DL2C_STRETCH_H

#include "events.h"
#include "pieces.h"

/* Part of a motion from x: of a solver's track, or, without one, of a solution in closed form. */
typedef struct dl2c_stretch {
  int flow;
  const real *x, *p;
  const dl2c_track *track;
  real from, length; /* of the whole motion or track, since the flow began */
  real low, width;   /* the part of it, within [0, 1] */
  int32_t halvings;  /* of stretches of the flow so far */
} dl2c_stretch;

/* Stretches are not halved below this part of a track, nor more often in a flow. */
#define DL2C_NARROWEST 0x1p-40
enum { DL2C_HALVINGS = 1024 };
/* How far a curve may miss a margin between nodes, relative to its largest coefficient. */
#define DL2C_MISSES 0x1p-40
/* By how much rounding of the values at the nodes may be larger between them. */
#define DL2C_FIT_SPREAD 16.0
/* How far a margin may be off by rounding, relative to the numbers that it is made of. */
#define DL2C_ROUNDING 0x1p-50
/* A polynomial of degree 12 stays this many times their spread around its values at the nodes. */
#define DL2C_OVERSHOOT 1.3

static real dl2c_stretch_time(const dl2c_stretch *stretch, real s)
{
  return stretch->from + stretch->length * (stretch->low + stretch->width * s);
}

/* The state at s in [0,1] of the stretch.   y: (NX) */
static void dl2c_stretch_at(const dl2c_stretch *stretch, real s, real *y)
{
  if (stretch->track != NULL) {
    dl2c_track_at(stretch->track, stretch->low + stretch->width * s, y);
  } else {
    memcpy(y, stretch->x, sizeof(real) * NX);
    model_at(stretch->flow, stretch->x, stretch->p, dl2c_stretch_time(stretch, s), y);
  }
}

/* Margins in a state; 0 where one has no finite value.   g: (NMARGIN) */
static void dl2c_margins(const dl2c_stretch *stretch, const real *y, real *g)
{
  model_margins(stretch->flow, y, stretch->p, g);
  for (int j = 0; j < FLOW_MARGINS[stretch->flow]; j++) g[j] = isfinite(g[j]) ? g[j] : 0.0;
}

/* The states at all nodes.   rows: (NX, DL2C_NODES) */
static void dl2c_stretch_samples(const dl2c_stretch *stretch, real *rows)
{
  if (stretch->track != NULL && stretch->width >= 1.0) {
    dl2c_track_samples(stretch->track, rows);
    return;
  }
  for (int k = 0; k < DL2C_NODES; k++) {
    real y[NX];
    dl2c_stretch_at(stretch, DL2C_NODE[k], y);
    for (int j = 0; j < NX; j++) rows[j * DL2C_NODES + k] = y[j];
  }
}

/* Whether the polynomial through the values plainly has no zero.   values: (DL2C_NODES) */
static bool dl2c_plain(const real *values)
{
  real least = values[0];
  real largest = values[0];
  for (int k = 1; k < DL2C_NODES; k++) {
    least = dl2c_min(least, values[k]);
    largest = dl2c_max(largest, values[k]);
  }
  return fabs(0.5 * (least + largest)) > DL2C_OVERSHOOT * (largest - least);
}

/* Margins at all nodes of a stretch.   values: (NMARGIN, DL2C_NODES) */
static void dl2c_sample_margins(const dl2c_stretch *stretch, real (*values)[DL2C_NODES])
{
  const int n = FLOW_MARGINS[stretch->flow];
  real rows[NX * DL2C_NODES];
  dl2c_stretch_samples(stretch, rows);
  for (int k = 0; k < DL2C_NODES; k++) {
    real y[NX];
    real g[NMARGIN] = {0.0};
    for (int j = 0; j < NX; j++) y[j] = rows[j * DL2C_NODES + k];
    dl2c_margins(stretch, y, g);
    for (int j = 0; j < n; j++) values[j][k] = g[j];
  }
}

/* How far margins may be off at both ends of a stretch, by rounding.   noise: (NMARGIN) */
static void dl2c_margin_noise(const dl2c_stretch *stretch, real *noise)
{
  real y[NX];
  real last[NMARGIN] = {0.0};
  dl2c_stretch_at(stretch, 1.0, y);
  model_sizes(stretch->flow, y, stretch->p, last);
  dl2c_stretch_at(stretch, 0.0, y);
  model_sizes(stretch->flow, y, stretch->p, noise);
  for (int j = 0; j < FLOW_MARGINS[stretch->flow]; j++) {
    noise[j] = DL2C_ROUNDING * dl2c_max(noise[j], last[j]);
    if (!isfinite(noise[j])) noise[j] = 0.0;
  }
}

/*
 * Where margins that are zero in y go, by their Lie derivatives; those within their rounding
 * errors count as zero.   noise: (NMARGIN) of the margins   after: (NMARGIN) changed where it can be told
 */
static void dl2c_lie_signs(int flow, const real *y, const real *p, const real *noise,
                           const int8_t *at, int8_t *after)
{
  real lie[3 * NMARGIN];
  real rates[NX];
  real size = 0.0;
  real speed = 0.0;
  model_lie(flow, y, p, lie);
  model_rates(flow, y, p, rates);
  for (int k = 0; k < NX; k++) {
    size = dl2c_max(fabs(y[k]), size);
    speed = dl2c_max(fabs(rates[k]), speed);
  }
  const real pace = size > 0.0 ? speed / size : speed;
  for (int j = 0; j < FLOW_MARGINS[flow]; j++) {
    real least = noise[j];
    for (int k = 0; at[j] == 0 && k < 3; k++) {
      const real slope = lie[k * NMARGIN + j];
      least *= pace;
      if (!(fabs(slope) > least)) continue;
      after[j] = dl2c_sign_of(slope);
      break;
    }
  }
}

/*
 * Signs at and after the start of a stretch. A flow begins with the very values; where a margin
 * is zero there, its Lie derivatives tell where it goes. Later stretches begin where rounding has
 * an effect, and go by the curves.   noise: (NMARGIN)
 */
static void dl2c_begin_signs(const dl2c_stretch *stretch, const dl2c_curve *curves,
                             const real *noise, dl2c_events *events)
{
  const bool at_start = !(stretch->from + stretch->low > 0.0);
  bool on_edge = false;
  for (int j = 0; j < FLOW_MARGINS[stretch->flow]; j++) {
    const real value = curves[j].b[0];
    const bool sure = fabs(value) > curves[j].noise || (at_start && value != 0.0);
    events->at_start[j] = sure ? dl2c_sign_of(value) : 0;
    events->after_start[j] = sure ? events->at_start[j] : dl2c_sign_after(&curves[j]);
    on_edge |= !sure;
  }
  if (!on_edge || !at_start) return;
  real y[NX];
  dl2c_stretch_at(stretch, 0.0, y);
  dl2c_lie_signs(stretch->flow, y, stretch->p, noise, events->at_start, events->after_start);
}

/*
 * Whether curves do not miss their margins at two places between the nodes.
 *   noise: (NMARGIN) of the values that they were fitted to
 */
static bool dl2c_curves_fit(const dl2c_stretch *stretch, const dl2c_curve *curves,
                            const real *noise)
{
  bool close = true;
  for (int side = 0; side < 2; side++) {
    const real s = side == 0 ? 0.31 : 0.79;
    real y[NX];
    real g[NMARGIN] = {0.0};
    dl2c_stretch_at(stretch, s, y);
    dl2c_margins(stretch, y, g);
    for (int j = 0; j < FLOW_MARGINS[stretch->flow]; j++) {
      if (curves[j].degree == 0) continue;
      real largest = 0.0;
      for (int k = 0; k < DL2C_NODES; k++) largest = dl2c_max(largest, fabs(curves[j].b[k]));
      const real miss = fabs(dl2c_curve_at(&curves[j], s) - g[j]);
      close &= miss <= DL2C_MISSES * largest + DL2C_FIT_SPREAD * noise[j];
    }
  }
  return close;
}

/*
 * The events of a stretch. False where a curve misses its margin between the nodes, so that the
 * stretch should be halved.
 */
static bool dl2c_stretch_events(const dl2c_stretch *stretch, dl2c_events *events)
{
  const int n = FLOW_MARGINS[stretch->flow];
  real values[NMARGIN][DL2C_NODES];
  real noise[NMARGIN] = {0.0};
  dl2c_curve curves[NMARGIN];
  bool all_plain = true;
  dl2c_sample_margins(stretch, values);
  for (int j = 0; j < n; j++) {
    curves[j] = (dl2c_curve){.degree = 0, .b = {values[j][0]}};
    events->at_start[j] = events->after_start[j] = dl2c_sign_of(values[j][0]);
    if (dl2c_plain(values[j])) continue;
    if (all_plain) dl2c_margin_noise(stretch, noise);
    all_plain = false;
    dl2c_fit(values[j], noise[j], &curves[j]);
  }
  events->count = 0;
  memset(events->at_end, 0, sizeof events->at_end);
  if (all_plain) return true;
  dl2c_begin_signs(stretch, curves, noise, events);
  for (int j = 0; j < n; j++) {
    const dl2c_curve *const curve = &curves[j];
    events->at_end[j] = fabs(curve->b[curve->degree]) <= curve->noise;
  }
  events->count = dl2c_crossings(curves, n, events->after_start, events->crossings, DL2C_ROOM);
  return dl2c_curves_fit(stretch, curves, noise);
}

/* Whether a whole track plainly has no events that matter. */
static bool dl2c_calm(const dl2c_stretch *stretch, const uint8_t *watch)
{
#if DL2C_TRACKED_FLOWS
  dl2c_hull x[NX];
  if (stretch->track == NULL) return false;
  dl2c_track_hull(stretch->track, x);
  return model_calm(stretch->flow, x, stretch->p, watch);
#else
  (void)stretch, (void)watch;
  return false;
#endif
}

/* Where and why a motion ends within a track. */
typedef enum dl2c_halt {
  DL2C_NO_HALT = 0,
  DL2C_LEAVES = 1, /* its domain ends it */
  DL2C_CUT = 2,    /* a violation does */
} dl2c_halt;

/*
 * Looks along a track, or a whole solution, for the end of the flow, stretch by stretch. On a
 * halt *stretch is where that is, *s the place in it; sign: (NMARGIN) the signs there, else at the
 * end. `bounded`: the domain has not been considered before.
 */
static dl2c_halt dl2c_look_along(dl2c_stretch *stretch, bool bounded, uint8_t *watch, real *s,
                                 int8_t *sign)
{
  dl2c_events events;
  dl2c_breach failure = {0};
  stretch->low = 0.0;
  stretch->width = 1.0;
  if (dl2c_calm(stretch, watch)) {
    memset(sign, 1, NMARGIN);
    return DL2C_NO_HALT;
  }
  while (stretch->low < 1.0) {
    if (!dl2c_stretch_events(stretch, &events) && stretch->width > DL2C_NARROWEST
        && stretch->halvings < DL2C_HALVINGS) {
      stretch->halvings++;
      stretch->width *= 0.5;
      continue;
    }
    dl2c_fails(stretch->flow, 0, &events, &failure);
    const bool leaves = bounded && failure.exit.found;
    const real limit = leaves ? failure.exit.at : 1.0;
    const real stop = dl2c_watch(stretch->flow, &events, limit, watch);
    if (NWATCH > 0 && stop <= 1.0) {
      *s = stop;
      return DL2C_CUT;
    }
    memcpy(sign, failure.at, sizeof failure.at);
    if (leaves) {
      *s = failure.exit.holds || !(limit > 0.0) ? limit : dl2c_before(limit);
      return DL2C_LEAVES;
    }
    stretch->low += stretch->width;
    if (fmod(stretch->low, 2.0 * stretch->width) == 0.0) stretch->width *= 2.0;
  }
  for (int j = 0; j < FLOW_MARGINS[stretch->flow]; j++)
    if (events.at_end[j]) sign[j] = 0;
  return DL2C_NO_HALT;
}

#endif
