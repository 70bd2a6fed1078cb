/* SPDX-License-Identifier: MIT-0 */
/*
 * values.h -- how an exported controller finds values of inputs that pass their tests.
 *
 * A monitor holds a copy of the functions that it needs, with its own names for MODEL (what all its names
 * begin with), VALUES_MOST (how many values are examined at most), VALUES_HALVINGS (the bits of a number),
 * VALUES_SQRT and VALUES_ABS. It is included after `real` and the types of the model. Every loop is bounded
 * by VALUES_MOST or VALUES_HALVINGS.
 */
#ifndef DL2C_MONITOR_VALUES_H
#define DL2C_MONITOR_VALUES_H

enum { MOST = VALUES_MOST, HALVINGS = VALUES_HALVINGS };

/*
 * The search for a value of an input. Between two neighbours in `at`, the first and the last of
 * which are the ends of its range, either all values pass its tests or none does.
 */
typedef struct {
  const MODEL_state *before;
  const MODEL_parameters *parameters;
  MODEL_input *given; /* holds the values of earlier inputs */
  real *value; /* of this one, in `given` */
  bool (*admits)(const MODEL_state *, const MODEL_parameters *, const MODEL_input *);
  int count;
  real at[MOST];
} search;

static bool passes(const search *s, real value)
{
  *s->value = value;
  return s->admits(s->before, s->parameters, s->given);
}

/* Enters a root, in order, if it lies inside the range; a NaN does not. */
static void enter(search *s, real root)
{
  if (s->count == MOST || !(root > s->at[0] && root < s->at[s->count - 1]))
    return;
  real moved = root;
  for (int k = 1; k < MOST; k++) {
    if (k < s->count && s->at[k] > moved) {
      const real next = s->at[k];
      s->at[k] = moved;
      moved = next;
    }
  }
  s->at[s->count] = moved;
  s->count++;
}

/* Enters the roots of c0 + c1*u + c2*u^2; where there is none, the place where it is nearest to 0. */
static void enter_roots(search *s, real c0, real c1, real c2)
{
  const real square = c1 * c1 - 4 * c2 * c0;
  const real root = square > 0 ? VALUES_SQRT(square) : 0;
  const real sum = -(c1 < 0 ? c1 - root : c1 + root) / 2;
  enter(s, sum / c2);
  enter(s, c0 / sum);
}

/* The last value that passes on the way from one that does to one that does not. */
static real last_passing(const search *s, real passing, real failing)
{
  for (int n = 0; n < HALVINGS; n++) {
    const real middle = passing + (failing - passing) / 2;
    if (passes(s, middle))
      passing = middle;
    else
      failing = middle;
  }
  return passing;
}

/* The value nearest to `wanted` that passes; where none is found, one inside the range. */
static real nearest(const search *s, real wanted)
{
  const real low = s->at[0];
  const real high = s->at[s->count - 1];
  const real inside = wanted > low ? (wanted < high ? wanted : high) : low;
  if (passes(s, inside))
    return inside;
  real best = inside;
  real least = high - low;
  bool found = false;
  for (int k = 0; k < 2 * MOST - 1; k++) { /* one of the values in `at`, or all up to the next */
    if (k / 2 + k % 2 >= s->count)
      continue;
    const real first = s->at[k / 2];
    const real last = s->at[k / 2 + k % 2];
    const real middle = first + (last - first) / 2;
    real value = inside > first ? (inside < last ? inside : last) : first;
    bool passing = passes(s, value);
    if (!passing && passes(s, middle)) {
      value = last_passing(s, middle, value);
      passing = true;
    }
    const real off = VALUES_ABS(value - inside);
    if (passing && (!found || off < least)) {
      best = value;
      least = off;
      found = true;
    }
  }
  *s->value = best;
  return best;
}

/* The value so far along all that pass, from -1 to 1; single values only where there is nothing else. */
static real spread(const search *s, real wanted)
{
  const real share = (wanted + 1) / 2;
  const real part = share > 0 ? (share < 1 ? share : 1) : 0;
  real length = 0;
  int points = 0;
  bool open[MOST] = {false};
  for (int k = 0; k < MOST; k++) {
    if (k >= s->count)
      continue;
    points += passes(s, s->at[k]) ? 1 : 0;
    if (k + 1 == s->count)
      continue;
    const real width = s->at[k + 1] - s->at[k];
    open[k] = width > 0 && passes(s, s->at[k] + width / 2);
    length += open[k] ? width : 0;
  }
  real along = length > 0 ? length * part : part * (real)points;
  real value = s->at[0];
  bool found = false;
  for (int k = 0; k < MOST; k++) {
    if (k >= s->count || found || (length > 0 ? !open[k] : !passes(s, s->at[k])))
      continue;
    const real width = length > 0 ? s->at[k + 1] - s->at[k] : 1;
    found = along < width;
    value = s->at[k] + (length > 0 ? (found ? along : width) : 0);
    along -= width;
  }
  return nearest(s, value);
}

#endif
