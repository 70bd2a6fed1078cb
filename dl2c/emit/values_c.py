"""How an exported controller finds values of inputs that pass: C that knows nothing of a model but names.

`MODEL` stands for what all names of the model begin with, `MOST` for the largest number of values that
are looked at. Every loop is bounded by it; where a test is violated by rounding alone, values up to 4^9
units in the last place inside of its root are tried.
"""

SEARCH = """\
enum { MOST = @MOST, TRIES = 9 };

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
"""

ROOTS = """\
/* Enters the roots of c0 + c1*u + c2*u^2; where there is none, the place where it is nearest to 0. */
static void enter_roots(search *s, real c0, real c1, real c2)
{
  const real square = c1 * c1 - 4 * c2 * c0;
  const real root = square > 0 ? @SQRT(square) : 0;
  const real sum = -(c1 < 0 ? c1 - root : c1 + root) / 2;
  enter(s, sum / c2);
  enter(s, c0 / sum);
}
"""

NEAREST = """\
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
  for (int k = 0; k < 2 * MOST; k++) {
    if (k / 2 >= s->count || (k % 2 != 0 && k / 2 + 1 == s->count))
      continue;
    const real root = s->at[k / 2];
    const real start = k % 2 == 0 ? root : root + (s->at[k / 2 + 1] - root) / 2;
    real unit = @ABS(start) * @EPSILON + DL2C_SMALLEST;
    for (int n = 0; n <= 2 * TRIES; n++) {
      const real value = n == 0 ? start : n % 2 == 0 ? start + unit : start - unit;
      const real off = @ABS(value - inside);
      if (value >= low && value <= high && (!found || off < least) && passes(s, value)) {
        best = value;
        least = off;
        found = true;
      }
      unit = n > 0 && n % 2 == 0 ? 4 * unit : unit;
    }
  }
  *s->value = best;
  return best;
}
"""

SPREAD = """\
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
"""


def search_functions(stem: str, most: int, single: bool, quadratic: bool, squash: bool) -> str:
    """What runs with inputs need. `most` counts the roots of an input and the two ends of its range."""
    parts = [SEARCH, *([ROOTS] if quadratic else []), NEAREST, *([SPREAD] if squash else [])]
    suffix = "f" if single else ""
    words = {
        "MODEL": stem,
        "@MOST": str(most),
        "@SQRT": f"sqrt{suffix}",
        "@ABS": f"fabs{suffix}",
        "@EPSILON": "FLT_EPSILON" if single else "DBL_EPSILON",
    }
    text = "\n".join(parts)
    for word, meaning in words.items():
        text = text.replace(word, meaning)
    return text
