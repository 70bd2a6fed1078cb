/* SPDX-License-Identifier: MIT-0 */
/*
 * actions.h -- which paths are open, which values of an input pass.
 *
 * A value of an input passes where its tests hold and every later input that shares tests with it
 * still has a value that passes. Over the reals that only changes at the roots that model_criticals
 * gives: one value between each two neighbours speaks for all, and the ends of what passes are
 * then found by bisection over doubles. The same operations in the same order as dl2c/ir/inputs.py.
 */
#ifndef DL2C_ACTIONS_H
#define DL2C_ACTIONS_H

/* Where nothing around a root passes, values up to 4^(DL2C_NEARBY - 1) doubles away are tried. */
enum { DL2C_NEARBY = 8 };
enum { DL2C_NPIECE = NCRITICAL + 3, DL2C_NPROBE = 2 * NCRITICAL + 3 };

/* The values that pass: closed intervals in order, `count` of them. */
typedef struct dl2c_pieces {
  int count;
  real low[DL2C_NPIECE];
  real high[DL2C_NPIECE];
} dl2c_pieces;

/* The inputs of a path in a state. */
typedef struct dl2c_search {
  int path;
  const real *x, *p;
  const bool *given; /* (NU) inputs that were met before */
  real *u;           /* (NU) their values, and those of other inputs while they are tried */
} dl2c_search;

/* Values that are tried, by number, in order. */
typedef struct dl2c_probes {
  int count;
  int64_t at[DL2C_NPROBE];
  bool critical[DL2C_NPROBE]; /* a root or an end of the Box */
  bool passes[DL2C_NPROBE];
} dl2c_probes;

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

static bool dl2c_any(const dl2c_search *search, int place);

/* Whether a value passes for the input at a place of the path, which is set to it. */
static bool dl2c_passes(const dl2c_search *search, int place, real value)
{
  const dl2c_input *met = &PATHS[search->path].inputs[place];
  search->u[met->input] = value;
  if (!model_admits(search->path, met->input, search->x, search->p, search->u)) return false;
  return !DL2C_JOINT_INPUTS || met->following < 0 || dl2c_any(search, met->following);
}

static bool dl2c_number_passes(const dl2c_search *search, int place, int64_t number)
{
  return dl2c_passes(search, place, dl2c_from_ordinal(number));
}

/*
 * Steps of 1, 2, 4, ... units in the last place towards a limit, until passing becomes `wanted`.
 * *last is the last value before, *there the first one where it is; false if there is none.
 */
static bool dl2c_bracket(const dl2c_search *search, int place, int64_t here, int64_t limit,
                         bool wanted, int64_t *last, int64_t *there)
{
  const int direction = limit > here ? 1 : -1;
  *last = *there = here;
  for (uint64_t step = 1; *last != limit; step *= 2) {
    const uint64_t room = dl2c_distance(limit, *last);
    *there = dl2c_moved(*last, direction, step < room ? step : room);
    if (dl2c_number_passes(search, place, *there) == wanted) return true;
    *last = *there;
  }
  return false;
}

/* The passing value next to a failing one, between one of each. */
static int64_t dl2c_bisected(const dl2c_search *search, int place, int64_t inside, int64_t outside)
{
  while (dl2c_distance(inside, outside) > 1) {
    const int64_t middle =
        dl2c_moved(outside, inside > outside ? 1 : -1, dl2c_distance(inside, outside) / 2);
    if (dl2c_number_passes(search, place, middle))
      inside = middle;
    else
      outside = middle;
  }
  return inside;
}

/* The last passing value from a passing one towards a limit. */
static int64_t dl2c_edge(const dl2c_search *search, int place, int64_t here, int64_t limit)
{
  int64_t last;
  int64_t there;
  const bool ends = dl2c_bracket(search, place, here, limit, false, &last, &there);
  return ends ? dl2c_bisected(search, place, last, there) : last;
}

/*
 * The passing value nearest to the limit `outer`, searched from `start`. Where that does not
 * pass, from a passing value on its inner side, up to `middle` if that passes, else to the limit
 * `inner`, else on its outer side. False if no tried value passes.
 */
static bool dl2c_outermost(const dl2c_search *search, int place, real start, real middle,
                           real inner, real outer, real *out)
{
  const int64_t end = dl2c_ordinal(outer);
  int64_t here = dl2c_ordinal(start);
  int64_t last;
  int64_t there;
  if (!dl2c_passes(search, place, start)) {
    const int64_t limit = dl2c_ordinal(dl2c_passes(search, place, middle) ? middle : inner);
    if (dl2c_bracket(search, place, here, limit, true, &last, &there)) {
      *out = dl2c_from_ordinal(dl2c_bisected(search, place, there, last));
      return true;
    }
    if (!dl2c_bracket(search, place, here, end, true, &last, &there)) return false;
    here = there;
  }
  *out = dl2c_from_ordinal(dl2c_edge(search, place, here, end));
  return true;
}

/*
 * The values of an input whose tests leave an interval between limits that are linear in it; false
 * if it is empty. `high` is NULL where only that is asked.
 */
static bool dl2c_interval(const dl2c_search *search, int place, real *low, real *high)
{
  const int input = PATHS[search->path].inputs[place].input;
  real first = INPUT_LOW[input];
  real last = INPUT_HIGH[input];
  model_limits(search->path, input, search->x, search->p, search->u, &first, &last);
  if (first > INPUT_HIGH[input]) first = INPUT_HIGH[input];
  if (last < INPUT_LOW[input]) last = INPUT_LOW[input];
  const real middle = first + (last - first) / 2.0;
  if (!dl2c_outermost(search, place, first, middle, INPUT_HIGH[input], INPUT_LOW[input], low))
    return false;
  if (high == NULL) return true;
  if (last < *low) last = *low;
  return dl2c_outermost(search, place, last, middle, *low, INPUT_HIGH[input], high);
}

/* Enters a root between the ends of the Box, each value once and in order. */
static void dl2c_enter(real *critical, int *count, real root)
{
  if (!(root > critical[0] && root < critical[*count - 1])) return;
  int k = *count;
  while (critical[k - 1] > root) k--;
  if (critical[k - 1] == root) return;
  memmove(critical + k + 1, critical + k, sizeof(real) * (size_t)(*count - k));
  critical[k] = root;
  *count += 1;
}

/* The values to try: ends of the Box and roots, and one value between each two neighbours. */
static void dl2c_list_probes(const dl2c_search *search, int place, dl2c_probes *probes)
{
  const int input = PATHS[search->path].inputs[place].input;
  real root[NCRITICAL + 1];
  real critical[NCRITICAL + 2] = {INPUT_LOW[input], INPUT_HIGH[input]};
  int count = INPUT_LOW[input] < INPUT_HIGH[input] ? 2 : 1;
  const int found = model_criticals(search->path, input, search->x, search->p, search->u, root);
  for (int k = 0; k < found; k++) dl2c_enter(critical, &count, root[k]);
  probes->count = 0;
  for (int k = 0; k < count; k++) {
    const real middle = k > 0 ? critical[k - 1] + (critical[k] - critical[k - 1]) / 2.0 : 0.0;
    if (k > 0 && critical[k - 1] < middle && middle < critical[k]) {
      probes->critical[probes->count] = false;
      probes->at[probes->count++] = dl2c_ordinal(middle);
    }
    probes->critical[probes->count] = true;
    probes->at[probes->count++] = dl2c_ordinal(critical[k]);
  }
}

/* Where neither a root nor its neighbours pass: replaces it by a value next to it that does. */
static bool dl2c_try_nearby(const dl2c_search *search, int place, dl2c_probes *probes, int k)
{
  if (!probes->critical[k] || k == 0 || k + 1 == probes->count) return false;
  if (probes->passes[k - 1] || probes->passes[k] || probes->passes[k + 1]) return false;
  for (int n = 0; n < DL2C_NEARBY; n++)
    for (int direction = -1; direction <= 1; direction += 2) {
      const int64_t number = dl2c_moved(probes->at[k], direction, (uint64_t)1 << (2 * n));
      if (!(probes->at[k - 1] < number && number < probes->at[k + 1])) continue;
      if (!dl2c_number_passes(search, place, number)) continue;
      probes->at[k] = number;
      probes->passes[k] = true;
      return true;
    }
  return false;
}

/*
 * The only values that an equality leaves to an input, in order. Negative where there is no such
 * equality, or it is void, else their number.
 */
static int dl2c_pinned(const dl2c_search *search, int place, real *root)
{
  const int input = PATHS[search->path].inputs[place].input;
  const int found = model_pins(search->path, input, search->x, search->p, search->u, root);
  int count = 0;
  for (int k = 0; k < found; k++)
    if (root[k] >= INPUT_LOW[input] && root[k] <= INPUT_HIGH[input]) root[count++] = root[k];
  if (count == 2 && root[1] <= root[0]) {
    const real second = root[0];
    root[0] = root[1];
    root[1] = second;
    if (root[0] == root[1]) count = 1;
  }
  return found < 0 ? found : count;
}

/* Whether some value of an input passes; of one that was met before, its own. */
static bool dl2c_any(const dl2c_search *search, int place)
{
  const int input = PATHS[search->path].inputs[place].input;
  if (search->given[input]) return dl2c_passes(search, place, search->u[input]);
  if (PATHS[search->path].inputs[place].interval) {
    real low;
    return dl2c_interval(search, place, &low, NULL);
  }
  real root[2];
  const int pins = dl2c_pinned(search, place, root);
  for (int k = 0; k < pins; k++)
    if (dl2c_passes(search, place, root[k])) return true;
  if (pins >= 0) return false;
  dl2c_probes probes;
  dl2c_list_probes(search, place, &probes);
  for (int k = 0; k < probes.count; k++) {
    probes.passes[k] = dl2c_number_passes(search, place, probes.at[k]);
    if (probes.passes[k]) return true;
  }
  for (int k = 0; k < probes.count; k++)
    if (dl2c_try_nearby(search, place, &probes, k)) return true;
  return false;
}

/* The outermost passing value between a passing probe and a failing one, near the critical of them. */
static real dl2c_end_between(const dl2c_search *search, int place, const dl2c_probes *probes,
                             int inside, int outside)
{
  const int64_t passing = probes->at[inside];
  const int64_t failing = probes->at[outside];
  if (probes->critical[inside])
    return dl2c_from_ordinal(dl2c_edge(search, place, passing, failing));
  int64_t last;
  int64_t there;
  dl2c_bracket(search, place, failing, passing, true, &last, &there);
  return dl2c_from_ordinal(dl2c_bisected(search, place, there, last));
}

/* All values of an input that pass; count 0 if there are none. */
static void dl2c_admissible(const dl2c_search *search, int place, dl2c_pieces *pieces)
{
  pieces->count = 0;
  if (PATHS[search->path].inputs[place].interval) {
    pieces->count = dl2c_interval(search, place, &pieces->low[0], &pieces->high[0]);
    return;
  }
  real root[2];
  const int pins = dl2c_pinned(search, place, root);
  for (int k = 0; k < pins; k++)
    if (dl2c_passes(search, place, root[k])) {
      pieces->low[pieces->count] = root[k];
      pieces->high[pieces->count++] = root[k];
    }
  if (pins >= 0) return;
  dl2c_probes probes;
  dl2c_list_probes(search, place, &probes);
  for (int k = 0; k < probes.count; k++)
    probes.passes[k] = dl2c_number_passes(search, place, probes.at[k]);
  for (int k = 0; k < probes.count; k++) dl2c_try_nearby(search, place, &probes, k);
  for (int k = 0; k < probes.count; k++) {
    const int first = k;
    while (k < probes.count && probes.passes[k]) k++;
    if (k == first) continue;
    pieces->low[pieces->count] = first == 0
                                     ? dl2c_from_ordinal(probes.at[0])
                                     : dl2c_end_between(search, place, &probes, first, first - 1);
    pieces->high[pieces->count] = k == probes.count
                                      ? dl2c_from_ordinal(probes.at[k - 1])
                                      : dl2c_end_between(search, place, &probes, k - 1, k);
    pieces->count += 1;
  }
}

/* Whether every input of a path has a value that passes. */
static bool dl2c_all_have_values(const dl2c_search *search)
{
  const dl2c_path *path = &PATHS[search->path];
  for (int place = 0; place < path->ninput; place++)
    if (path->inputs[place].first && !dl2c_any(search, place)) return false;
  return true;
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
  const bool given[NU + 1] = {false};
  real u[NU + 1] = {0.0};
  for (int64_t i = 0; i < count; i++) {
    real own_x[NX];
    real own_p[NP + 1];
    for (int k = 0; k < NX; k++) own_x[k] = x[k * stride + i];
    for (int k = 0; k < NP; k++) own_p[k] = p[k * stride + i];
    for (int k = first; k < POINT_START[point + 1]; k++) {
      const dl2c_search search = {k, own_x, own_p, given, u};
      if (enabled[(k - first) * stride + i])
        enabled[(k - first) * stride + i] = dl2c_all_have_values(&search);
    }
  }
}

/* The admissible value nearest to the one wanted, the lower of two, the lowest for a NaN; its piece. */
static real dl2c_nearest(const dl2c_pieces *pieces, real wanted, int *piece)
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

/* How long all pieces are together. */
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
static real dl2c_spread(const dl2c_pieces *pieces, real part, int *piece)
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
static real dl2c_squashed(const dl2c_pieces *pieces, real value, int piece)
{
  const real length = dl2c_length(pieces);
  if (!(length > 0.0)) return 2.0 * ((piece + 0.5) / pieces->count) - 1.0;
  real before = 0.0;
  for (int k = 0; k < piece; k++) before += pieces->high[k] - pieces->low[k];
  return 2.0 * ((before + (value - pieces->low[piece])) / length) - 1.0;
}

/* The value, or where rounding makes it fail the next one towards the nearer end of its piece. */
static real dl2c_settled(const dl2c_search *search, int place, const dl2c_pieces *pieces, int piece,
                         real value)
{
  if (dl2c_passes(search, place, value)) return value;
  const real low = pieces->low[piece];
  const real high = pieces->high[piece];
  int64_t last;
  int64_t there;
  dl2c_bracket(search, place, dl2c_ordinal(value),
               dl2c_ordinal(value - low < high - value ? low : high), true, &last, &there);
  return dl2c_from_ordinal(dl2c_bisected(search, place, there, last));
}

/* The value that an input takes at the request of the agent; *executed is how the action space writes it. */
static real dl2c_requested(const dl2c_search *search, int place, int32_t map, real wanted,
                           real *executed)
{
  const int input = PATHS[search->path].inputs[place].input;
  const bool squash = map == DL2C_MAP_SQUASH;
  const bool inside = wanted >= INPUT_LOW[input] && wanted <= INPUT_HIGH[input];
  if (!squash && inside && dl2c_passes(search, place, wanted)) return *executed = wanted;
  dl2c_pieces pieces;
  int piece = 0;
  dl2c_admissible(search, place, &pieces);
  const real unit = !(wanted >= -1.0) ? -1.0 : wanted > 1.0 ? 1.0 : wanted;
  const real value = squash ? dl2c_spread(&pieces, 0.5 * (unit + 1.0), &piece)
                            : dl2c_nearest(&pieces, wanted, &piece);
  const real settled = dl2c_settled(search, place, &pieces, piece, value);
  *executed = squash ? dl2c_squashed(&pieces, settled, piece) : settled;
  return settled;
}

/* The value that an input takes by chance, given a number in [0, 1). */
static real dl2c_drawn(const dl2c_search *search, int place, real number)
{
  dl2c_pieces pieces;
  int piece = 0;
  dl2c_admissible(search, place, &pieces);
  const real value = dl2c_spread(&pieces, number, &piece);
  return dl2c_settled(search, place, &pieces, piece, value);
}

#endif
