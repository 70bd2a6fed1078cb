/*
 * waypoint_loop.c -- examples/waypoint.kyx written by hand, for comparison with the generated code.
 *
 * One scalar loop over n environments that does all that a batch with same-step autoreset does:
 * first enabled alternative, flow with snap, predicates with tolerance, mask, observation. Initial
 * states are drawn by plain rejection, constants first.
 */
#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <string.h>

#define API __attribute__((visibility("default")))

enum { NOBS = 11, NMASK = 4, MAX_STEPS = 1000 };
enum { NONE, SUCCESS, FAILURE };
enum { TIME_LIMIT = 7, LOOP_INV = 16, ENSURE = 17 };

/* One environment: 18 words of 8 bytes, first the state and constants as in the model. */
typedef struct waypoint {
  double xr, vr, ar, xg, t, T;
  double ep, b, A, GDelta, Vmax;
  double elapsed;
  int64_t steps;
  uint64_t rng[4];
  uint8_t mask[8];
} waypoint;

/* Where results go. */
typedef struct results {
  float *obs, *final_obs; /* (n, NOBS) */
  int8_t *mask;           /* (n, NMASK) */
  double *reward;         /* this and all that follow: (n) */
  double *duration, *time;
  int32_t *choice, *status, *reason, *cost;
  uint8_t *terminated, *truncated, *blocked, *postcondition, *saturated, *reset;
} results;

static uint64_t splitmix64(uint64_t *state)
{
  uint64_t z = (*state += 0x9e3779b97f4a7c15u);
  z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
  z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
  return z ^ (z >> 31);
}

static inline uint64_t rotated(uint64_t a, int k) { return (a << k) | (a >> (64 - k)); }

static inline double uniform(uint64_t *s, double low, double high)
{
  const uint64_t drawn = rotated(s[0] + s[3], 23) + s[0];
  const uint64_t shifted = s[1] << 17;
  s[2] ^= s[0];
  s[3] ^= s[1];
  s[1] ^= s[2];
  s[0] ^= s[3];
  s[2] ^= shifted;
  s[3] = rotated(s[3], 45);
  return low + (high - low) * ((double)(drawn >> 11) * 0x1p-53);
}

/* Which alternatives are open: brake, stay, accelerate, coast. */
static inline void open_alternatives(waypoint *w)
{
  const bool inside = w->xr > w->xg - w->GDelta;
  const double stop = w->vr * w->vr / (2 * w->b);
  const double more = (w->A / w->b + 1) * (w->A / 2 * (w->ep * w->ep) + w->ep * w->vr);
  const bool room = w->xr + stop + more < w->xg + w->GDelta && w->vr + w->A * w->ep <= w->Vmax;
  w->mask[0] = inside;
  w->mask[1] = inside && w->vr == 0;
  w->mask[2] = !inside && room;
  w->mask[3] = !inside && !room;
}

static void begin(waypoint *w)
{
  do {
    w->ep = uniform(w->rng, 0.1, 0.5);
    w->b = uniform(w->rng, 0.5, 5);
    w->A = uniform(w->rng, 1, 10);
    w->GDelta = uniform(w->rng, 1, 10);
    w->Vmax = uniform(w->rng, 5, 30);
  } while (!(w->Vmax >= 2 * w->A * w->ep && w->GDelta > w->Vmax * w->ep + w->Vmax * w->Vmax / (2 * w->b)));
  do {
    w->xr = uniform(w->rng, 0, 100);
    w->xg = uniform(w->rng, 0, 100);
    w->T = uniform(w->rng, 0, 1000);
  } while (!(w->xr < w->xg - w->GDelta
             && w->T > w->ep + (w->xg - w->xr - w->GDelta) / (w->A * w->ep) + w->ep + w->Vmax / w->b));
  w->ar = uniform(w->rng, -10, 10);
  w->t = uniform(w->rng, 0, 1);
  w->vr = 0;
  w->elapsed = 0;
  w->steps = 0;
  open_alternatives(w);
}

/* {xr' = vr, vr' = ar, t' = 1, T' = -1 & t <= ep & vr >= 0} from t = 0; its duration. */
static inline double drive(waypoint *w)
{
  const bool stops = w->ar < 0 && w->vr <= -w->ar * w->ep;
  const double tau = stops ? w->vr / -w->ar : w->ep;
  w->xr += (w->ar / 2 * tau + w->vr) * tau;
  w->vr = stops ? 0 : w->vr + w->ar * tau;
  w->t = tau;
  w->T -= tau;
  return tau;
}

/* a >= b, a > b and a = b, with the tolerance of annotated predicates */
static inline double slack(double a, double b) { return 1e-9 * (1 + fabs(a) + fabs(b)); }
static inline bool at_least(double a, double b) { return a + slack(a, b) >= b; }
static inline bool above(double a, double b) { return a + slack(a, b) > b; }
static inline bool equal(double a, double b) { return fabs(a - b) <= slack(a, b); }

static inline bool loop_inv(const waypoint *w)
{
  const double area = w->xg - w->GDelta;
  if (!(at_least(w->vr, 0) && at_least(w->Vmax, w->vr))) return false;
  if (!above(w->xg + w->GDelta, w->xr + w->vr * w->vr / (2 * w->b))) return false;
  if (!(at_least(area, w->xr) || equal(w->vr, 0) || at_least(w->T, w->vr / w->b))) return false;
  if (above(w->xr, area)) return true;
  const double gain = w->A * w->ep;
  const double travel = (w->xg - w->xr - w->GDelta) / gain;
  const double rest = w->Vmax / w->b;
  return (at_least(w->vr, gain) && above(w->T, travel + w->ep + rest))
      || (at_least(gain, w->vr) && above(w->T, w->ep - w->vr / w->A + travel + w->ep + rest));
}

static inline float clipped(double a, float low, float high, uint8_t *saturated)
{
  const float narrow = (float)a;
  *saturated |= narrow < low || narrow > high;
  return narrow < low ? low : narrow > high ? high : narrow;
}

static inline uint8_t observe(const waypoint *w, float *obs)
{
  uint8_t saturated = 0;
  obs[0] = clipped(w->xr, 0, 100, &saturated);
  obs[1] = clipped(w->vr, 0, 20, &saturated);
  obs[2] = clipped(w->ar, -10, 10, &saturated);
  obs[3] = clipped(w->xg, 0, 100, &saturated);
  obs[4] = clipped(w->t, 0, 1, &saturated);
  obs[5] = clipped(w->T, 0, 1000, &saturated);
  obs[6] = clipped(w->ep, 0.09999999403953552f, 0.5f, &saturated);
  obs[7] = clipped(w->b, 0.5f, 5, &saturated);
  obs[8] = clipped(w->A, 1, 10, &saturated);
  obs[9] = clipped(w->GDelta, 1, 10, &saturated);
  obs[10] = clipped(w->Vmax, 5, 30, &saturated);
  return saturated;
}

/* Rewards and the end of the episode; whether it has ended. */
static inline bool judge(const waypoint *w, int64_t i, const results *out)
{
  const bool safe = loop_inv(w);
  const bool there = above(w->xr, w->xg - w->GDelta) && equal(w->vr, 0);
  const bool late = !there && w->T <= 0;
  const bool over = w->steps >= MAX_STEPS;
  out->reward[i] = (safe ? 0 : -1000) + (there ? 1000 : 0);
  out->cost[i] = !safe;
  out->terminated[i] = safe && (there || late);
  out->truncated[i] = !safe || (!there && !late && over);
  out->status[i] = !safe || late ? FAILURE : there ? SUCCESS : NONE;
  out->reason[i] = !safe ? LOOP_INV : there || late ? ENSURE : over ? TIME_LIMIT : 0;
  out->postcondition[i] = w->xr < w->xg + w->GDelta
      && (w->T > 0 || (w->xr > w->xg - w->GDelta && w->vr == 0));
  return !safe || there || late || over;
}

static void step(waypoint *w, int64_t i, const results *out)
{
  const int choice = w->mask[0] ? 0 : w->mask[2] ? 2 : 3;
  w->ar = choice == 0 ? -w->b : choice == 2 ? w->A : 0;
  const double duration = drive(w);
  w->elapsed += duration;
  w->steps += 1;
  out->choice[i] = choice;
  out->blocked[i] = choice != 0;
  out->duration[i] = duration;
  out->time[i] = w->elapsed;
  const bool ended = judge(w, i, out);
  open_alternatives(w);
  out->saturated[i] = observe(w, out->obs + i * NOBS);
  out->reset[i] = ended;
  if (ended) {
    memcpy(out->final_obs + i * NOBS, out->obs + i * NOBS, sizeof(float) * NOBS);
    begin(w);
    observe(w, out->obs + i * NOBS);
  }
  memcpy(out->mask + i * NMASK, w->mask, NMASK);
}

/* Begins an episode in every environment; environment i draws from the stream of seed + i. */
API void waypoint_reset(waypoint *w, int64_t n, uint64_t seed)
{
  for (int64_t i = 0; i < n; i++) {
    uint64_t state = seed + (uint64_t)i;
    for (int k = 0; k < 4; k++) w[i].rng[k] = splitmix64(&state);
    begin(&w[i]);
  }
}

/* Takes note of states that were written from outside. */
API void waypoint_refresh(waypoint *w, int64_t n)
{
  for (int64_t i = 0; i < n; i++) open_alternatives(&w[i]);
}

/* Steps every environment once, by the first open alternative. */
API void waypoint_step(waypoint *w, int64_t n, const results *out)
{
  for (int64_t i = 0; i < n; i++) step(&w[i], i, out);
}
