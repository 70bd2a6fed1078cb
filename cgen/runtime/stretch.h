/* SPDX-License-Identifier: MIT-0 */
/*
 * stretch.h -- what margins do on an interval of a track: every change of sign is bracketed.
 *
 * On an interval, called stretch here, each margin, as it is written, has a Taylor model
 * (taylor.h). Where the model excludes zero the margin's sign is certain. Where the model is
 * monotone the margin changes its sign at most once, up to the model's error; the change is found
 * by the margin's sign in doubles. Otherwise the stretch is bisected, until the error is that of
 * rounding: then the margin counts as zero there, unless its value in doubles is further on the
 * other side than rounding can take it. So a condition is judged wrongly at most where the term
 * that it is written with is within rounding of its boundary.
 *
 * The same operations in the same order as dl2c/flows/stretch.py.
 */
#ifndef DL2C_STRETCH_H
#define DL2C_STRETCH_H

#include "events.h"
#include "pieces.h"

/* A part of a track of a motion from x, and what is known where it begins. */
typedef struct dl2c_stretch {
  int flow;
  const real *x, *p;
  const dl2c_track *track;
  real low, width; /* the part, within [0, 1] */
  real clear;      /* the last place where all margins had certain signs */
  int32_t parts;   /* number of stretches examined */
  bool begun;      /* a stretch was examined before */
  bool known;      /* and these signs are known: */
  int8_t here[NMARGIN];  /* at its start, */
  int8_t since[NMARGIN]; /* and just after; */
  bool near[NMARGIN];    /* whether a margin was within rounding of zero just before */
} dl2c_stretch;

/* Stretches are not halved below this part of a track. */
#define DL2C_NARROWEST 0x1p-50
/* A change of sign is bracketed well enough within this part of a track. */
#define DL2C_CLOSE 0x1p-44
/* Events whose relative distance is at most this are one. */
#define DL2C_TOGETHER 0x1p-49

/* The time since the flow began at a place of the track. */
static real dl2c_time_at(const dl2c_track *track, real place)
{
  return track->from + track->length * place;
}

/* The sign of a margin at a place of the track, as doubles compute it; 2 where it has no value. */
static int dl2c_sign_at(const dl2c_stretch *stretch, int margin, real place)
{
  real y[NX];
  dl2c_track_at(stretch->track, place, y);
  const real value = model_margin(stretch->flow, margin, y, stretch->p);
  return isfinite(value) ? dl2c_sign_of(value) : 2;
}

/*
 * The signs just after y of margins that are zero there, by their Lie derivatives; those within
 * their rounding errors count as zero.
 *   g: (NMARGIN) models of the margins   after: (NMARGIN) changed where it can be told
 */
static void dl2c_lie_signs(int flow, const real *y, const real *p, const dl2c_taylor *g,
                           const int8_t *at, int8_t *after)
{
#if DL2C_TRACKED_FLOWS
  real lie[3 * NMARGIN];
  real rates[NX];
  model_lie(flow, y, p, lie);
  model_rates(flow, y, p, rates);
  const real pace = dl2c_pace(y, rates);
  for (int j = 0; j < FLOW_MARGINS[flow]; j++) {
    real least = isfinite(g[j].e) ? g[j].e : 0.0;
    for (int k = 0; at[j] == 0 && k < 3; k++) {
      const real slope = lie[k * NMARGIN + j];
      least *= pace;
      if (!(fabs(slope) > least)) continue;
      after[j] = dl2c_sign_of(slope);
      break;
    }
  }
#else
  (void)flow, (void)y, (void)p, (void)g, (void)at, (void)after;
#endif
}

/* The same for solutions: by their Taylor coefficients at the start. */
static void dl2c_solution_signs(const dl2c_stretch *stretch, int8_t *after)
{
  dl2c_taylor x[NX];
  dl2c_taylor g[NMARGIN] = {{.r = 0.0}};
  dl2c_track_models(stretch->track, 0.0, 1.0, x);
  model_taylor(stretch->flow, x, stretch->x, stretch->p, g);
  for (int j = 0; j < FLOW_MARGINS[stretch->flow]; j++)
    for (int k = 1; after[j] == 0 && k <= DL2C_ORDER; k++)
      if (fabs(g[j].c[k]) > g[j].e) after[j] = dl2c_sign_of(g[j].c[k]);
}

/*
 * Signs where a stretch begins, if what came before does not tell. A flow begins with exact
 * values: a margin that is zero there has the sign of its first derivative that is not.
 *   g: (NMARGIN) on the stretch
 */
static void dl2c_begin_signs(dl2c_stretch *stretch, const dl2c_taylor *g)
{
  if (stretch->known) return;
  bool on_edge = false;
  for (int j = 0; j < FLOW_MARGINS[stretch->flow]; j++) {
    const int sign = dl2c_sign_at(stretch, j, stretch->low);
    stretch->here[j] = stretch->since[j] = (int8_t)(sign == 2 ? 0 : sign);
    stretch->near[j] = false;
    on_edge |= sign == 0;
  }
  stretch->known = true;
  if (!on_edge || stretch->begun) return;
  if (FLOW_KERNEL[stretch->flow] < DL2C_LINEAR) dl2c_solution_signs(stretch, stretch->since);
  else dl2c_lie_signs(stretch->flow, stretch->x, stretch->p, g, stretch->here, stretch->since);
}

/* An approximate zero of a monotone model: Newton's method between two signs. */
static real dl2c_model_zero(const dl2c_stretch *stretch, const dl2c_taylor *g, int before)
{
  const real *c = g->c;
  real near = -1.0;
  real far = 1.0;
  real u = 0.0;
  for (int k = 0; k < 60; k++) {
    const real value = dl2c_taylor_at(g, u);
    const real slope = ((4.0 * c[4] * u + 3.0 * c[3]) * u + 2.0 * c[2]) * u + c[1];
    const bool same = (value > 0.0) == (before > 0);
    near = same ? u : near;
    far = same ? far : u;
    real next = u - value / slope;
    if (fabs(next - u) <= DL2C_TOGETHER) break;
    if (!(next > near && next < far)) next = near + 0.5 * (far - near);
    u = next;
  }
  return stretch->low + stretch->width * (0.5 + 0.5 * u);
}

/*
 * Where a margin, whose model is monotone, leaves the side on which it was: a place where doubles
 * make it zero, if one is found in steps of 1, 2, 4, ... doubles from the zero of the model, else
 * the last double before.
 */
static real dl2c_change(const dl2c_stretch *stretch, int margin, const dl2c_taylor *g, int before)
{
  const int64_t low = dl2c_ordinal(stretch->low);
  const int64_t high = dl2c_ordinal(stretch->low + stretch->width);
  int64_t near = low;
  int64_t far = high;
  const int64_t start = dl2c_ordinal(dl2c_model_zero(stretch, g, before));
  if (stretch->begun && dl2c_sign_at(stretch, margin, stretch->low) == 0) return stretch->low;
  int direction = 0;
  int64_t step = 0;
  while (far - near > 1) {
    int64_t number = near + (far - near) / 2;
    if (direction == 0) number = start;
    else if (direction > 0 && far == high && near + step < far) number = near + step;
    else if (direction < 0 && near == low && far - step > near) number = far - step;
    number = number <= near ? near + 1 : number >= far ? far - 1 : number;
    const int sign = dl2c_sign_at(stretch, margin, dl2c_from_ordinal(number));
    if (sign == 0) return dl2c_from_ordinal(number);
    const bool still = sign == before;
    near = still ? number : near;
    far = still ? far : number;
    if (direction == 0) direction = still ? 1 : -1;
    step = step == 0 ? 1 : step < high ? 2 * step : step;
  }
  return dl2c_from_ordinal(near > low ? near : far);
}

/* The extremum of a model; the middle if it has none. */
static real dl2c_turn(const dl2c_stretch *stretch, const dl2c_taylor *g)
{
  const real *c = g->c;
  real near = -1.0;
  real far = 1.0;
  const bool rises = c[1] - 2.0 * c[2] + 3.0 * c[3] - 4.0 * c[4] > 0.0;
  const bool falls = c[1] + 2.0 * c[2] + 3.0 * c[3] + 4.0 * c[4] > 0.0;
  for (int k = 0; k < 40 && rises != falls; k++) {
    const real u = near + 0.5 * (far - near);
    const bool same = (((4.0 * c[4] * u + 3.0 * c[3]) * u + 2.0 * c[2]) * u + c[1] > 0.0) == rises;
    near = same ? u : near;
    far = same ? far : u;
  }
  return stretch->low + stretch->width * (0.5 + 0.25 * (near + far));
}

/*
 * A crossing at a place of the track, or at another one that rounding does not distinguish from
 * it. vague: how uncertain the place is
 */
static void dl2c_cross_at(const dl2c_stretch *stretch, int j, real place, real vague, int after,
                          dl2c_events *events)
{
  real at = (place - stretch->low) / stretch->width;
  for (int k = 0; k < events->count; k++) {
    const real other = stretch->low + stretch->width * events->crossings[k].at;
    if (fabs(other - place) <= place * DL2C_TOGETHER + vague) at = events->crossings[k].at;
  }
  dl2c_cross(events, at, j, after);
}

/* What is known of a margin at the end of a stretch. */
typedef struct dl2c_leg {
  int8_t sign;
  bool near; /* it is so near to zero that its sign is that before */
} dl2c_leg;

/* Notes the sign of a margin over a stretch, as far as it does not change.   turned: it was near zero */
static dl2c_leg dl2c_keeps(const dl2c_stretch *stretch, int j, int sign, bool turned,
                           dl2c_events *events)
{
  events->at_start[j] = sign == stretch->since[j] && !turned ? stretch->here[j] : 0;
  events->after_start[j] = (int8_t)sign;
  return (dl2c_leg){(int8_t)sign, false};
}

/*
 * The sign of a margin at a place of the track, 0 if rounding may change it: that of the margin, or
 * that of the state, by the margin's slopes.
 */
DL2C_COLD static int dl2c_sure_sign(const dl2c_stretch *stretch, int margin, real place)
{
  dl2c_taylor x[NX];
  dl2c_taylor g[NMARGIN] = {{.r = 0.0}};
  real errors[NX];
  real off = 0.0;
  dl2c_track_models(stretch->track, place, 0.0, x);
  for (int k = 0; k < NX; k++) {
    errors[k] = x[k].e;
    x[k] = dl2c_taylor_number(x[k].c[0]);
  }
  model_taylor(stretch->flow, x, stretch->x, stretch->p, g);
  const dl2c_hull value = g[margin].hull;
  for (int k = 0; k < NX && (value.low > off || value.high < -off); k++) {
    if (errors[k] == 0.0) continue;
    const dl2c_taylor exact = x[k];
    x[k].c[1] = errors[k];
    x[k].hull = dl2c_hull_of(exact.c[0] - 2.0 * errors[k], exact.c[0] + 2.0 * errors[k]);
    model_taylor(stretch->flow, x, stretch->x, stretch->p, g);
    off += isfinite(g[margin].r) ? dl2c_taylor_spread(&g[margin]) : (real)INFINITY;
    x[k] = exact;
  }
  return (value.low > off) - (value.high < -off);
}

/* Whether a margin that had a sign is certain to have the other one at a place of the track. */
static bool dl2c_surely_passed(const dl2c_stretch *stretch, int margin, real place, int sign)
{
  return dl2c_sign_at(stretch, margin, place) == -sign
         && dl2c_sure_sign(stretch, margin, place) == -sign;
}

/*
 * The last double between two places before a margin, as doubles compute it, loses a sign; or where
 * they make it zero.
 */
static real dl2c_last_of(const dl2c_stretch *stretch, int margin, real from, real to, int sign)
{
  int64_t near = dl2c_ordinal(from);
  int64_t far = dl2c_ordinal(to);
  while (far - near > 1) {
    const int64_t number = near + (far - near) / 2;
    const int there = dl2c_sign_at(stretch, margin, dl2c_from_ordinal(number));
    if (there == 0) return dl2c_from_ordinal(number);
    near = there == sign ? number : near;
    far = there == sign ? far : number;
  }
  return dl2c_from_ordinal(near);
}

/* A margin is so near to zero at the end of a stretch that its value there decides. */
static dl2c_leg dl2c_comes_near(const dl2c_stretch *stretch, int j, int sign, dl2c_events *events)
{
  const real end = stretch->low + stretch->width;
  const bool zero = dl2c_sign_at(stretch, j, end) == 0;
  if (!zero && !dl2c_surely_passed(stretch, j, end, sign)) return (dl2c_leg){(int8_t)sign, true};
  const real place = zero ? end : dl2c_last_of(stretch, j, stretch->low, end, sign);
  const int after = zero ? 0 : -sign;
  events->ends[j] = zero;
  dl2c_cross_at(stretch, j, place, 0.0, after, events);
  return (dl2c_leg){(int8_t)after, false};
}

/* A margin has an extremum so near to zero that its value there decides whether it crosses. */
static void dl2c_turns_near(const dl2c_stretch *stretch, int j, const dl2c_taylor *g, int sign,
                            dl2c_events *events)
{
  const real end = stretch->low + stretch->width;
  const real turn = dl2c_turn(stretch, g);
  if (!dl2c_surely_passed(stretch, j, turn, sign)) {
    dl2c_cross_at(stretch, j, turn, 0.0, sign, events);
    return;
  }
  dl2c_cross_at(stretch, j, dl2c_last_of(stretch, j, stretch->low, turn, sign), 0.0, -sign, events);
  dl2c_cross_at(stretch, j, dl2c_last_of(stretch, j, turn, end, -sign), 0.0, sign, events);
}

/* A margin whose model is monotone; `slope` is its least slope. */
static bool dl2c_monotone_events(const dl2c_stretch *stretch, int j, const dl2c_taylor *g, bool fine,
                                 real slope, bool turned, dl2c_events *events, dl2c_leg *ending)
{
  const real first_value = dl2c_taylor_at(g, -1.0);
  const real last_value = dl2c_taylor_at(g, 1.0);
  const bool sure_first = fabs(first_value) > g->r;
  const bool sure_last = fabs(last_value) > g->r;
  if (!fine && !(sure_first && sure_last)) return false;
  const int first = sure_first ? dl2c_sign_of(first_value) : stretch->since[j];
  const int last = sure_last ? dl2c_sign_of(last_value) : 0;
  if (first * last < 0 && !fine && !(g->r * stretch->width <= slope * DL2C_CLOSE)) return false;
  *ending = dl2c_keeps(stretch, j, first != 0 ? first : last, turned, events);
  events->ends[j] = !sure_last;
  if (first * last < 0) {
    const real vague = g->r / slope * stretch->width;
    dl2c_cross_at(stretch, j, dl2c_change(stretch, j, g, first), vague, last, events);
    ending->sign = (int8_t)last;
  }
  if (first != 0 && !sure_last) *ending = dl2c_comes_near(stretch, j, first, events);
  return true;
}

/* A margin that is within rounding of zero on the whole stretch. */
static dl2c_leg dl2c_vague_events(const dl2c_stretch *stretch, int j, const dl2c_taylor *g,
                                  real first_slope, bool turned, dl2c_events *events)
{
  const real *c = g->c;
  const int came = stretch->since[j];
  const real last_slope = c[1] + 2.0 * c[2] + 3.0 * c[3] + 4.0 * c[4];
  const dl2c_leg ending = dl2c_keeps(stretch, j, came, turned, events);
  events->ends[j] = true;
  if (came * first_slope < 0.0 && came * last_slope <= 0.0)
    return dl2c_comes_near(stretch, j, came, events);
  if (came != 0 && !(came * first_slope >= 0.0 && came * last_slope > 0.0))
    dl2c_turns_near(stretch, j, g, came, events);
  return ending;
}

/*
 * What a margin does on a stretch. Returns whether that is known; else the stretch should be
 * bisected. A margin without a value counts as zero: definedness is a condition of its own.
 * ending: what is known at the end
 */
static bool dl2c_margin_events(const dl2c_stretch *stretch, int j, const dl2c_taylor *g,
                               dl2c_events *events, dl2c_leg *ending)
{
  if ((g->lacks & DL2C_LACKS_VALUE) != 0 || !isfinite(g->c[0])) {
    *ending = dl2c_keeps(stretch, j, 0, false, events);
    return true;
  }
  const real *c = g->c;
  const real first_slope = c[1] - 2.0 * c[2] + 3.0 * c[3] - 4.0 * c[4];
  const bool turned = stretch->near[j] && !(stretch->since[j] * first_slope < 0.0);
  const int always = dl2c_taylor_sign(g);
  if (always != 0) {
    *ending = dl2c_keeps(stretch, j, always, turned, events);
    return true;
  }
  const bool narrow = stretch->width <= DL2C_NARROWEST || g->lacks != 0;
  const bool fine = (isfinite(g->r) && g->r <= DL2C_FINE * g->e) || narrow;
  const real slope = fabs(c[1]) - 2.0 * fabs(c[2]) - 3.0 * fabs(c[3]) - 4.0 * fabs(c[4]);
  if (slope > 0.0) return dl2c_monotone_events(stretch, j, g, fine, slope, turned, events, ending);
  if (!narrow && !(fine && dl2c_taylor_size(g) <= 2.0 * g->r)) return false;
  *ending = dl2c_vague_events(stretch, j, g, first_slope, turned, events);
  return true;
}

/*
 * The events of a stretch. False where a margin's model does not decide them, so that it should be
 * bisected.
 */
static bool dl2c_stretch_events(dl2c_stretch *stretch, const dl2c_taylor *x, dl2c_events *events)
{
  const int n = FLOW_MARGINS[stretch->flow];
  dl2c_taylor g[NMARGIN] = {{.r = 0.0}};
  dl2c_leg legs[NMARGIN];
  model_taylor(stretch->flow, x, stretch->x, stretch->p, g);
  dl2c_begin_signs(stretch, g);
  events->count = 0;
  memset(events->ends, 0, sizeof events->ends);
  for (int j = 0; j < n; j++)
    if (!dl2c_margin_events(stretch, j, &g[j], events, &legs[j])) return false;
  for (int j = 0; j < n; j++) {
    events->begins[j] = stretch->near[j];
    stretch->here[j] = stretch->since[j] = legs[j].sign;
    stretch->near[j] = legs[j].near;
  }
  return true;
}

#endif
