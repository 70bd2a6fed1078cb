/* SPDX-License-Identifier: MIT-0 */
/*
 * admissible.h -- which values of an input pass the tests on a path.
 *
 * A value of an input passes where its tests hold and every later input that shares tests with it
 * still has a value that passes. Over the reals that only changes at the roots that model_criticals
 * gives: one value between each two neighbours speaks for all, and the ends of what passes are
 * then found by bisection over doubles. The same operations in the same order as dl2c/interp/inputs.py.
 */
#ifndef DL2C_ADMISSIBLE_H
#define DL2C_ADMISSIBLE_H

#include "model.h"

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

DL2C_OPTIONAL bool dl2c_any(const dl2c_search *search, int place);

/* Whether a value passes for the input at a place of the path, which is set to it. */
DL2C_OPTIONAL bool dl2c_passes(const dl2c_search *search, int place, real value)
{
  const dl2c_input *met = &PATHS[search->path].inputs[place];
  search->u[met->input] = value;
  if (!model_admits(search->path, met->input, search->x, search->p, search->u)) return false;
  return !DL2C_JOINT_INPUTS || met->following < 0 || dl2c_any(search, met->following);
}

/* Whether it is known that no double between these two passes. */
static inline bool dl2c_refuses(const dl2c_search *search, int place, real low, real high)
{
#ifdef DL2C_REFUSES
  const int input = PATHS[search->path].inputs[place].input;
  return model_refuses(search->path, input, search->x, search->p, search->u, (dl2c_hull){low, high});
#else
  (void)search, (void)place, (void)low, (void)high;
  return false;
#endif
}

DL2C_OPTIONAL bool dl2c_number_passes(const dl2c_search *search, int place, int64_t number)
{
  return dl2c_passes(search, place, dl2c_from_ordinal(number));
}

/*
 * Steps of 1, 2, 4, ... units in the last place towards a limit, until passing becomes `wanted`.
 * *last is the last value before, *there the first one where it is; false if there is none.
 */
DL2C_OPTIONAL bool dl2c_bracket(const dl2c_search *search, int place, int64_t here, int64_t limit,
                                bool wanted, int64_t *last, int64_t *there)
{
  const int direction = limit > here ? 1 : -1;
  *last = *there = here;
  for (uint64_t step = 1; *last != limit; step *= 2) {
    const uint64_t distance = dl2c_distance(limit, *last);
    *there = dl2c_moved(*last, direction, step < distance ? step : distance);
    if (dl2c_number_passes(search, place, *there) == wanted) return true;
    *last = *there;
  }
  return false;
}

/* The passing value next to a failing one, between one of each. */
DL2C_OPTIONAL int64_t dl2c_bisected(const dl2c_search *search, int place, int64_t inside, int64_t outside)
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
DL2C_OPTIONAL int64_t dl2c_edge(const dl2c_search *search, int place, int64_t here, int64_t limit)
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
DL2C_OPTIONAL bool dl2c_outermost(const dl2c_search *search, int place, real start, real middle,
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
DL2C_OPTIONAL bool dl2c_interval(const dl2c_search *search, int place, real *low, real *high)
{
  const int input = PATHS[search->path].inputs[place].input;
  real first = INPUT_LOW[input];
  real last = INPUT_HIGH[input];
  model_limits(search->path, input, search->x, search->p, search->u, &first, &last);
  if (first > INPUT_HIGH[input]) first = INPUT_HIGH[input];
  if (last < INPUT_LOW[input]) last = INPUT_LOW[input];
  const real middle = first + (last - first) / 2.0;
  if (high == NULL && dl2c_passes(search, place, first)) return true;
  if (!dl2c_outermost(search, place, first, middle, INPUT_HIGH[input], INPUT_LOW[input], low))
    return false;
  if (high == NULL) return true;
  if (last < *low) last = *low;
  return dl2c_outermost(search, place, last, middle, *low, INPUT_HIGH[input], high);
}

/*
 * Ends of the Box and roots, in order; a root outside counts as the nearer end. Returns how many.
 */
DL2C_OPTIONAL int dl2c_list_criticals(const dl2c_search *search, int input, real *critical)
{
  const real low = critical[0] = INPUT_LOW[input];
  const real high = INPUT_HIGH[input];
  const int found =
      model_criticals(search->path, input, search->x, search->p, search->u, critical + 1);
  for (int k = 1; k <= found; k++) {
    critical[k] = dl2c_min(dl2c_max(critical[k], low), high);
    for (int j = k; j > 1; j--) { /* no branch: a comparison that the processor cannot predict */
      const real smaller = dl2c_min(critical[j], critical[j - 1]);
      critical[j] = dl2c_max(critical[j], critical[j - 1]);
      critical[j - 1] = smaller;
    }
  }
  critical[found + 1] = high;
  return found + 2;
}

/* The values to try: ends of the Box and roots, and one value between each two neighbours. */
DL2C_OPTIONAL void dl2c_list_probes(const dl2c_search *search, int place, dl2c_probes *probes)
{
  real critical[NCRITICAL + 2];
  const int count =
      dl2c_list_criticals(search, PATHS[search->path].inputs[place].input, critical);
  probes->count = 0;
  for (int k = 0; k < count; k++) {
    if (k > 0 && critical[k] == critical[k - 1]) continue;
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
DL2C_OPTIONAL bool dl2c_try_nearby(const dl2c_search *search, int place, dl2c_probes *probes, int k)
{
  if (!probes->critical[k] || k == 0 || k + 1 == probes->count) return false;
  if (probes->passes[k - 1] || probes->passes[k] || probes->passes[k + 1]) return false;
  const real low = dl2c_from_ordinal(probes->at[k - 1]);
  const real high = dl2c_from_ordinal(probes->at[k + 1]);
  if (dl2c_refuses(search, place, low, high)) return false;
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
DL2C_OPTIONAL int dl2c_pinned(const dl2c_search *search, int place, real *root)
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
DL2C_OPTIONAL bool dl2c_any(const dl2c_search *search, int place)
{
  const int input = PATHS[search->path].inputs[place].input;
  if (search->given[input]) return dl2c_passes(search, place, search->u[input]);
  if (dl2c_refuses(search, place, INPUT_LOW[input], INPUT_HIGH[input])) return false;
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
  for (int n = 0; n < probes.count; n++) {
    const int k = (probes.count / 2 + n) % probes.count; /* from the middle on: ends pass less often */
    probes.passes[k] = dl2c_number_passes(search, place, probes.at[k]);
    if (probes.passes[k]) return true;
  }
  for (int k = 0; k < probes.count; k++)
    if (dl2c_try_nearby(search, place, &probes, k)) return true;
  return false;
}

/* The outermost passing value between a passing probe and a failing one, near the critical of them. */
DL2C_OPTIONAL real dl2c_end_between(const dl2c_search *search, int place, const dl2c_probes *probes,
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

/*
 * All values of an input that pass; count 0 if there are none. Where only the one nearest to a value is
 * asked for, that is `wanted`, else NULL: an end of a piece whose other end is nearer is any value of it.
 */
DL2C_OPTIONAL void dl2c_admissible(const dl2c_search *search, int place, const real *wanted,
                                   dl2c_pieces *pieces)
{
  pieces->count = 0;
  pieces->low[0] = pieces->high[0] = 0.0; /* no number is read before it is set, which compilers cannot see */
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
    const bool below = wanted != NULL && k < probes.count && *wanted >= dl2c_from_ordinal(probes.at[k]);
    const bool above =
        wanted != NULL && first > 0 && !(*wanted > dl2c_from_ordinal(probes.at[first - 1]));
    pieces->low[pieces->count] = first == 0 || below
                                     ? dl2c_from_ordinal(probes.at[first])
                                     : dl2c_end_between(search, place, &probes, first, first - 1);
    pieces->high[pieces->count] = k == probes.count || above
                                      ? dl2c_from_ordinal(probes.at[k - 1])
                                      : dl2c_end_between(search, place, &probes, k - 1, k);
    pieces->count += 1;
  }
}

/* Whether every input of a path has a value that passes. */
DL2C_OPTIONAL bool dl2c_all_have_values(const dl2c_search *search)
{
  const dl2c_path *path = &PATHS[search->path];
  for (int place = 0; place < path->ninput; place++)
    if (path->inputs[place].first && !dl2c_any(search, place)) return false;
  return true;
}

#endif
