/* SPDX-License-Identifier: MIT-0 */
/* actions.h -- which paths are open, which values of an input pass. */
#ifndef DL2C_ACTIONS_H
#define DL2C_ACTIONS_H

typedef struct dl2c_range {
  bool empty;
  real low, high;
} dl2c_range;

/* Steps between two doubles by number; they may be further apart than an int64_t reaches. */
static inline uint64_t dl2c_distance(int64_t a, int64_t b)
{
  return a > b ? (uint64_t)a - (uint64_t)b : (uint64_t)b - (uint64_t)a;
}

/* The number so many steps up (direction 1) or down (-1); stays inside the doubles. */
static inline int64_t dl2c_moved(int64_t number, int direction, uint64_t steps)
{
  const uint64_t moved = direction > 0 ? (uint64_t)number + steps : (uint64_t)number - steps;
  int64_t result;
  memcpy(&result, &moved, sizeof result);
  return result;
}

/* A search among the values of one input on one path. */
typedef struct dl2c_search {
  int path, input;
  const real *x, *p;
} dl2c_search;

static bool dl2c_passes(const dl2c_search *search, int64_t number)
{
  return model_admits(search->path, search->input, search->x, search->p, dl2c_from_ordinal(number));
}

/*
 * Steps of 1, 2, 4, ... units in the last place, inside the input's limits, until the test
 * becomes `wanted`. *last is the last value before, *there the first one where it is; false
 * if there is none.
 */
static bool dl2c_bracket(const dl2c_search *search, int64_t here, int direction, bool wanted,
                         int64_t *last, int64_t *there)
{
  const int64_t limit =
      dl2c_ordinal(direction > 0 ? INPUT_HIGH[search->input] : INPUT_LOW[search->input]);
  for (uint64_t step = 1;; step *= 2) {
    const uint64_t room = dl2c_distance(limit, here);
    *last = here;
    *there = dl2c_moved(here, direction, step < room ? step : room);
    if (*there == here) return false;
    if (dl2c_passes(search, *there) == wanted) return true;
    here = *there;
  }
}

/* The passing value next to a failing one, between one of each. */
static real dl2c_bisected(const dl2c_search *search, int64_t inside, int64_t outside)
{
  while (dl2c_distance(inside, outside) > 1) {
    const int64_t middle =
        dl2c_moved(outside, inside > outside ? 1 : -1, dl2c_distance(inside, outside) / 2);
    if (dl2c_passes(search, middle))
      inside = middle;
    else
      outside = middle;
  }
  return dl2c_from_ordinal(inside);
}

/*
 * The passing value furthest in `direction` (-1 down, 1 up), searched from `start`; where
 * that does not pass, from a passing value on its inner side, else on its outer side. False
 * if no tried value passes.
 */
static bool dl2c_outermost(const dl2c_search *search, real start, int direction, real *out)
{
  int64_t here = dl2c_ordinal(start);
  int64_t last;
  int64_t there;
  if (!dl2c_passes(search, here)) {
    if (dl2c_bracket(search, here, -direction, true, &last, &there)) {
      *out = dl2c_bisected(search, there, last);
      return true;
    }
    if (!dl2c_bracket(search, here, direction, true, &last, &there)) return false;
    here = there;
  }
  const bool ends = dl2c_bracket(search, here, direction, false, &last, &there);
  *out = ends ? dl2c_bisected(search, last, there) : dl2c_from_ordinal(last);
  return true;
}

/* The values of an input that pass the tests it decides on a path. */
static dl2c_range dl2c_admissible(int path, int input, const real *x, const real *p)
{
  dl2c_range range = {true, INPUT_LOW[input], INPUT_HIGH[input]};
  model_limits(path, input, x, p, &range.low, &range.high);
  if (range.low > INPUT_HIGH[input]) range.low = INPUT_HIGH[input];
  if (range.high < INPUT_LOW[input]) range.high = INPUT_LOW[input];
  const dl2c_search search = {path, input, x, p};
  range.empty = !dl2c_outermost(&search, range.low, -1, &range.low)
                || !dl2c_outermost(&search, range.high, 1, &range.high);
  return range;
}

/*
 * Which paths of a point pass all their tests up to their flow, in `count` environments.
 *   enabled: (paths of the point, stride)
 */
DL2C_INLINE void dl2c_enabled(int point, const real *x, const real *p, int64_t stride,
                              int64_t count, uint8_t *enabled)
{
  model_guards(point, x, p, stride, count, enabled);
  if (NU == 0) return;
  const int first = POINT_START[point];
  for (int64_t i = 0; i < count; i++) {
    real own_x[NX];
    real own_p[NP + 1];
    for (int k = 0; k < NX; k++) own_x[k] = x[k * stride + i];
    for (int k = 0; k < NP; k++) own_p[k] = p[k * stride + i];
    for (int k = first; k < POINT_START[point + 1]; k++)
      for (int j = 0; j < PATHS[k].ninput && enabled[(k - first) * stride + i]; j++)
        if (dl2c_admissible(k, PATHS[k].inputs[j], own_x, own_p).empty)
          enabled[(k - first) * stride + i] = 0;
  }
}

/* The value an input takes, and in *executed how the action space writes it. */
static inline real dl2c_resolve(int32_t map, dl2c_range range, real requested, real *executed)
{
  const real span = range.high - range.low;
  real value = requested;
  if (map == DL2C_MAP_SQUASH) {
    const real unit = !(requested >= -1.0) ? -1.0 : requested > 1.0 ? 1.0 : requested;
    value = range.low + span * (0.5 * (unit + 1.0));
  }
  if (!(value >= range.low)) value = range.low;
  if (value > range.high) value = range.high;
  *executed = value;
  if (map == DL2C_MAP_SQUASH)
    *executed = span > 0.0 ? 2.0 * ((value - range.low) / span) - 1.0 : 0.0;
  return value;
}

#endif
