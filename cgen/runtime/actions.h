/* SPDX-License-Identifier: MIT-0 */
/* actions.h -- which paths are open, and the values that inputs take. */
#ifndef DL2C_ACTIONS_H
#define DL2C_ACTIONS_H

#include "admissible.h"

/* Variables and constants of lane i.   x: (NX, stride)   p: (NP, stride) */
DL2C_INLINE void dl2c_read_lane(const real *x, const real *p, int64_t stride, int64_t i,
                                real *own_x, real *own_p)
{
  DL2C_UNROLL
  for (int k = 0; k < NX; k++) own_x[k] = x[k * stride + i];
  DL2C_UNROLL
  for (int k = 0; k < NP; k++) own_p[k] = p[k * stride + i];
}

/*
 * Whether the first value that dl2c_interval tries is admissible for every input of a path. No
 * branches. False means that it is not known whether there is an admissible value.
 */
DL2C_INLINE bool dl2c_surely_have_values(int path, const real *x, const real *p)
{
  bool well = true;
  real u[NU + 1] = {0.0};
  DL2C_UNROLL
  for (int j = 0; j < PATHS[path].ninput; j++) {
    const dl2c_input *met = &PATHS[path].inputs[j];
    const int input = met->input;
    real first = INPUT_LOW[input];
    real last = INPUT_HIGH[input];
    if (!met->interval || !met->first || met->following >= 0) return false;
    model_limits(path, input, x, p, u, &first, &last);
    u[input] = dl2c_select(first > INPUT_HIGH[input], INPUT_HIGH[input], first);
    well &= model_admits(path, input, x, p, u);
  }
  return well;
}

/* The same in lanes.   sure: (count) */
DL2C_INLINE void dl2c_sure_lanes(int path, const real *x, const real *p, int64_t stride,
                                  int64_t count, uint8_t *sure)
{
  int64_t flags[DL2C_BLOCK];
  DL2C_ALIAS_FREE
  for (int64_t i = 0; i < count; i++) {
    real own_x[NX];
    real own_p[NP + 1];
    dl2c_read_lane(x, p, stride, i, own_x, own_p);
    flags[i] = dl2c_surely_have_values(path, own_x, own_p);
  }
  for (int64_t i = 0; i < count; i++) sure[i] = flags[i] != 0;
}

/*
 * Whether the inputs of a path have values, where it is open and `sure` does not say so.
 * enabled: (count)
 */
DL2C_OPTIONAL void dl2c_search_lanes(int path, const real *x, const real *p, int64_t stride,
                                     int64_t count, const uint8_t *sure, uint8_t *enabled)
{
  uint8_t asked[DL2C_BLOCK];
  const bool given[NU + 1] = {false};
  real u[NU + 1] = {0.0};
  for (int64_t i = 0; i < count; i++) asked[i] = enabled[i] & !sure[i];
  for (int64_t i = dl2c_next(asked, 0, count); i < count; i = dl2c_next(asked, i + 1, count)) {
    real own_x[NX];
    real own_p[NP + 1];
    dl2c_read_lane(x, p, stride, i, own_x, own_p);
    const dl2c_search search = {path, own_x, own_p, given, u};
    enabled[i] = dl2c_all_have_values(&search);
  }
}

/*
 * Which paths of a point whose guards hold have values for their inputs, too.
 *   enabled: (paths of the point, stride)
 */
DL2C_INLINE void dl2c_enabled_by_inputs(int point, const real *x, const real *p, int64_t stride,
                                        int64_t count, uint8_t *enabled)
{
  if (NU == 0) return;
  const int first = POINT_START[point];
  const bool in_lanes = DL2C_DECIDES_IN_LANES && DL2C_FEW_PATHS;
  uint8_t sure[DL2C_FEW_PATHS ? NPATH : 1][DL2C_BLOCK];
  if (!in_lanes) memset(sure[0], 0, sizeof sure[0]);
  DL2C_UNROLL_PATHS
  for (int k = first; k < POINT_START[point + 1]; k++) {
    if (PATHS[k].ninput == 0) continue;
    const int same = in_lanes ? SAME_TESTS[k] : 0;
    if (in_lanes && same == k) dl2c_sure_lanes(k, x, p, stride, count, sure[k]);
    dl2c_search_lanes(k, x, p, stride, count, sure[same], enabled + (k - first) * stride);
  }
}

/*
 * Which paths of a point pass all their tests up to their flow, in `count` environments.
 *   enabled: (paths of the point, stride)
 */
DL2C_INLINE void dl2c_enabled(int point, const real *x, const real *p, int64_t stride,
                              int64_t count, uint8_t *enabled)
{
  model_guards(point, x, p, stride, count, enabled);
  dl2c_enabled_by_inputs(point, x, p, stride, count, enabled);
}

/* The admissible value nearest to the one wanted, the lower of two, the lowest for a NaN; its piece. */
DL2C_OPTIONAL real dl2c_nearest(const dl2c_pieces *pieces, real wanted, int *piece)
{
  *piece = 0;
  if (!(wanted >= pieces->low[0])) return pieces->low[0];
  for (int k = 0; k < pieces->count; k++) {
    if (wanted < pieces->low[k]) {
      if (wanted - pieces->high[k - 1] <= pieces->low[k] - wanted) return pieces->high[k - 1];
      *piece = k;
      return pieces->low[k];
    }
    *piece = k;
    if (wanted <= pieces->high[k]) return wanted;
  }
  return pieces->high[pieces->count - 1];
}

/* The total length of all pieces. */
static inline real dl2c_length(const dl2c_pieces *pieces)
{
  real length = 0.0;
  for (int k = 0; k < pieces->count; k++) length += pieces->high[k] - pieces->low[k];
  return length;
}

/*
 * The value so far along all pieces, from 0 to 1; its piece. Single values have no length, and are
 * equally likely where there is nothing else.
 */
DL2C_OPTIONAL real dl2c_spread(const dl2c_pieces *pieces, real part, int *piece)
{
  const real length = dl2c_length(pieces);
  if (!(length > 0.0)) {
    const int k = (int)(part * pieces->count);
    *piece = k < pieces->count ? k : pieces->count - 1;
    return pieces->low[*piece];
  }
  real along = length * part;
  for (int k = 0; k < pieces->count; k++) {
    const real own = pieces->high[k] - pieces->low[k];
    if (!(own > 0.0)) continue;
    *piece = k;
    if (along <= own) return dl2c_min(pieces->low[k] + along, pieces->high[k]);
    along -= own;
  }
  return pieces->high[*piece];
}

/* How the squashed action space writes a value of a piece: the inverse of dl2c_spread, in [-1, 1]. */
DL2C_OPTIONAL real dl2c_squashed(const dl2c_pieces *pieces, real value, int piece)
{
  const real length = dl2c_length(pieces);
  if (!(length > 0.0)) return 2.0 * ((piece + 0.5) / pieces->count) - 1.0;
  real before = 0.0;
  for (int k = 0; k < piece; k++) before += pieces->high[k] - pieces->low[k];
  return 2.0 * ((before + (value - pieces->low[piece])) / length) - 1.0;
}

/* The value, or where rounding makes it fail the next one towards the nearer end of its piece. */
DL2C_OPTIONAL real dl2c_settled(const dl2c_search *search, int place, const dl2c_pieces *pieces, int piece,
                                real value)
{
  const real low = pieces->low[piece];
  const real high = pieces->high[piece];
  if (value == low || value == high || dl2c_passes(search, place, value)) return value;
  int64_t last;
  int64_t there;
  dl2c_bracket(search, place, dl2c_ordinal(value),
               dl2c_ordinal(value - low < high - value ? low : high), true, &last, &there);
  return dl2c_from_ordinal(dl2c_bisected(search, place, there, last));
}

/* The value that an input takes at the request of the agent; *executed is how the action space writes it. */
DL2C_OPTIONAL real dl2c_requested(const dl2c_search *search, int place, int32_t map, real wanted,
                                  real *executed)
{
  const int input = PATHS[search->path].inputs[place].input;
  const bool squash = map == DL2C_MAP_SQUASH;
  const bool inside = wanted >= INPUT_LOW[input] && wanted <= INPUT_HIGH[input];
  if (!squash && inside && dl2c_passes(search, place, wanted)) return *executed = wanted;
  dl2c_pieces pieces;
  int piece = 0;
  dl2c_admissible(search, place, squash ? NULL : &wanted, &pieces);
  const real unit = !(wanted >= -1.0) ? -1.0 : wanted > 1.0 ? 1.0 : wanted;
  const real value = squash ? dl2c_spread(&pieces, 0.5 * (unit + 1.0), &piece)
                            : dl2c_nearest(&pieces, wanted, &piece);
  const real settled = dl2c_settled(search, place, &pieces, piece, value);
  *executed = squash ? dl2c_squashed(&pieces, settled, piece) : settled;
  return settled;
}

/* The value that an input takes by chance, given a number in [0, 1). */
DL2C_OPTIONAL real dl2c_drawn(const dl2c_search *search, int place, real number)
{
  dl2c_pieces pieces;
  int piece = 0;
  dl2c_admissible(search, place, NULL, &pieces);
  const real value = dl2c_spread(&pieces, number, &piece);
  return dl2c_settled(search, place, &pieces, piece, value);
}

#endif
