/* SPDX-License-Identifier: MIT-0 */
/*
 * dopri5.h -- flows followed step by step by the Runge-Kutta method of Dormand and Prince.
 *
 * Order 5 with an embedded error estimate, and Shampine's interpolant of order 4 as the track of a
 * step (Hairer, Norsett, Wanner, "Solving Ordinary Differential Equations I", II.5 and II.6). For
 * flows that are not stiff. No memory, no library, and but for the rates only operations that all
 * machines round alike.
 *
 * As with CVODES a tenth of the tolerances bounds the Euclidean norm of a step's error in units of
 * rtol*|x| + atol.
 */
#ifndef DL2C_DOPRI5_H
#define DL2C_DOPRI5_H

#include "pieces.h"

typedef struct dl2c_dopri {
  int32_t steps; /* tried so far */
  real now, stop;
  real wanted;    /* length of the next step, if the flow lasts that long */
  real last[NX];  /* the state at `now`, */
  real rates[NX]; /* and its rates */
} dl2c_dopri;

/* Of the polynomials that are the track of a step. */
enum { DL2C_DOPRI_DEGREE = 4 };

/* A flow that needs more steps counts as failed: it is stiff, and a case for CVODES. */
enum { DL2C_DOPRI_STEPS = 100000 };

/* The share of the tolerances that the error of one step may take, and how near to it steps go. */
#define DL2C_DOPRI_SHARE 0.1
#define DL2C_DOPRI_CARE 0.9

/* Steps grow and shrink by these factors at most. */
#define DL2C_DOPRI_GROWTH 5.0
#define DL2C_DOPRI_SHRINK 0.2

/*
 * An approximation of the fifth root of a value > 0: exact powers of two, a line and Newton's
 * method. Without a branch, so that lanes can use it.
 */
static inline real dl2c_fifth_root(real value)
{
  const bool tiny = value < DBL_MIN;
  const real normal = value * dl2c_select(tiny, 0x1p60, 1.0);
  uint64_t bits;
  memcpy(&bits, &normal, sizeof bits);
  const uint64_t place = (bits >> 52) + 3;              /* value is part * 2^(place - 5*205), part < 1 */
  const uint64_t fifths = (place * 52429) >> 18;        /* place / 5 */
  const uint64_t rest_bits = (bits & 0xfffffffffffffu) | ((1022 + place - 5 * fifths) << 52);
  real rest; /* from 0.5 to 16 */
  memcpy(&rest, &rest_bits, sizeof rest);
  real root = 0.9 + 0.06 * rest;
  DL2C_UNROLL
  for (int k = 0; k < 3; k++) {
    const real square = root * root;
    root = 0.8 * root + 0.2 * rest / (square * square);
  }
  const uint64_t scale_bits = (1023 - 205 + fifths - (tiny ? 12 : 0)) << 52;
  real scale;
  memcpy(&scale, &scale_bits, sizeof scale);
  return root * scale;
}

/* The Euclidean norm of what moves, in units of the tolerances.   d: (NX)   unit: (NX) one by them */
DL2C_INLINE real dl2c_dopri_norm(int flow, const real *d, const real *unit)
{
  real sum = 0.0;
  DL2C_UNROLL
  for (int k = 0; k < NX; k++) {
    if (!model_moves(flow, k)) continue;
    const real part = d[k] * unit[k];
    sum += part * part;
  }
  return sqrt(sum);
}

/*
 * How much the flow bends over an Euler step, or how steep it is if that is more, in units of the tolerances.
 *   x, slopes: (NX) a state and its rates   length: out, of that step, at most `stop`
 */
DL2C_INLINE real dl2c_dopri_bend(int flow, const real *x, const real *slopes, const real *p, real stop,
                                 real *length)
{
  real y[NX];
  real rates[NX];
  real unit[NX];
  DL2C_UNROLL
  for (int k = 0; k < NX; k++) unit[k] = 1.0 / (DL2C_ATOL + DL2C_RTOL * fabs(x[k]));
  const real slope = dl2c_dopri_norm(flow, slopes, unit);
  const real size = dl2c_dopri_norm(flow, x, unit);
  real h = dl2c_select((slope > 1e-5) & (size > 1e-5), 0.01 * (size / slope), 1e-6);
  h = dl2c_select(h < stop, h, stop);
  DL2C_UNROLL
  for (int k = 0; k < NX; k++) y[k] = x[k] + h * slopes[k];
  model_rates(flow, y, p, rates);
  DL2C_UNROLL
  for (int k = 0; k < NX; k++) rates[k] = rates[k] - slopes[k];
  const real bend = dl2c_dopri_norm(flow, rates, unit) / h;
  *length = h;
  return dl2c_select(bend > slope, bend, slope);
}

/* The length of a first step which the tolerances allow if the flow bends so much over one of length h. */
DL2C_INLINE real dl2c_dopri_first(real most, real h)
{
  real next = dl2c_select(most > 1e-15, dl2c_fifth_root(DL2C_DOPRI_SHARE / most), 100.0 * h);
  next = dl2c_select(next < 100.0 * h, next, 100.0 * h);
  return dl2c_select(most <= DBL_MAX, next, h);
}

/* Begins a flow in state x (NX), to be followed for a time stop > 0. False: it has no finite rates.
 */
static bool dl2c_dopri_start(dl2c_dopri *dopri, int flow, const real *x, const real *p, real stop)
{
  dopri->steps = 0;
  dopri->now = 0.0;
  dopri->stop = stop;
  memcpy(dopri->last, x, sizeof dopri->last);
  model_rates(flow, x, p, dopri->rates);
  if (!dl2c_all_finite(dopri->rates, NX)) return false;
  real tried;
  const real most = dl2c_dopri_bend(flow, x, dopri->rates, p, stop, &tried);
  dopri->wanted = dl2c_dopri_first(most, tried);
  return true;
}

static bool dl2c_dopri_done(const dl2c_dopri *dopri) { return dopri->now >= dopri->stop; }

/* Row s: the weights of slopes 0 to s in the point at which slope s + 1 is taken, from Butcher's
 * table. */
static const real DL2C_DOPRI_WEIGHTS[6][6] = {
    {0.2},
    {3.0 / 40.0, 9.0 / 40.0},
    {44.0 / 45.0, -56.0 / 15.0, 32.0 / 9.0},
    {19372.0 / 6561.0, -25360.0 / 2187.0, 64448.0 / 6561.0, -212.0 / 729.0},
    {9017.0 / 3168.0, -355.0 / 33.0, 46732.0 / 5247.0, 49.0 / 176.0, -5103.0 / 18656.0},
    {35.0 / 384.0, 0.0, 500.0 / 1113.0, 125.0 / 192.0, -2187.0 / 6784.0, 11.0 / 84.0},
};

/* The difference to the embedded method of order 4. */
static const real DL2C_DOPRI_ERROR[7] = {
    71.0 / 57600.0,      0.0,          -71.0 / 16695.0, 71.0 / 1920.0,
    -17253.0 / 339200.0, 22.0 / 525.0, -1.0 / 40.0,
};

/* The term of the interpolant that Hermite's does not have. */
static const real DL2C_DOPRI_BOW[7] = {
    -12715105075.0 / 11282082432.0,  0.0,
    87487479700.0 / 32700410799.0,   -10690763975.0 / 1880347072.0,
    701980252875.0 / 199316789632.0, -1453857185.0 / 822651844.0,
    69997945.0 / 29380423.0,
};

/* The weighted sum of the first `count` slopes of variable i. */
DL2C_INLINE real dl2c_dopri_sum(const real *weights, const real (*k)[NX], int count, int i)
{
  real sum = weights[0] * k[0][i];
  DL2C_UNROLL
  for (int j = 1; j < count; j++) sum += weights[j] * k[j][i];
  return sum;
}

/* Slope s + 1 of a step of length h from x, and the point y where it is taken, from slopes 0 to s. */
DL2C_INLINE void dl2c_dopri_stage(int flow, int s, const real *p, const real *x, real h,
                                  real (*k)[NX], real *y)
{
  DL2C_UNROLL
  for (int i = 0; i < NX; i++)
    if (model_moves(flow, i))
      y[i] = x[i] + h * dl2c_dopri_sum(DL2C_DOPRI_WEIGHTS[s], (const real(*)[NX])k, s + 1, i);
  model_rates(flow, y, p, k[s + 1]);
}

/*
 * A step of length h from x to y: slopes k[0] to k[6], of which the first is given. Returns its error
 * in units of what that may be, which is not finite where a rate has no value.
 */
DL2C_INLINE real dl2c_dopri_try(int flow, const real *p, const real *x, real h, real (*k)[NX],
                                real *y)
{
  DL2C_UNROLL
  for (int i = 0; i < NX; i++) y[i] = x[i];
  dl2c_dopri_stage(flow, 0, p, x, h, k, y);
  dl2c_dopri_stage(flow, 1, p, x, h, k, y);
  dl2c_dopri_stage(flow, 2, p, x, h, k, y);
  dl2c_dopri_stage(flow, 3, p, x, h, k, y);
  dl2c_dopri_stage(flow, 4, p, x, h, k, y);
  dl2c_dopri_stage(flow, 5, p, x, h, k, y);
  real sum = 0.0;
  DL2C_UNROLL
  for (int i = 0; i < NX; i++) {
    if (!model_moves(flow, i)) continue;
    const real size = dl2c_select(fabs(x[i]) > fabs(y[i]), fabs(x[i]), fabs(y[i]));
    const real off = h * dl2c_dopri_sum(DL2C_DOPRI_ERROR, (const real(*)[NX])k, 7, i);
    const real error = off / (DL2C_ATOL + DL2C_RTOL * size);
    sum += error * error;
  }
  return sqrt(sum) / DL2C_DOPRI_SHARE;
}

/* The factor by which the next step is longer than one with this error. */
DL2C_INLINE real dl2c_dopri_factor(real error)
{
  const real wanted = DL2C_DOPRI_CARE / dl2c_fifth_root(error);
  const real least = dl2c_select(wanted > DL2C_DOPRI_SHRINK, wanted, DL2C_DOPRI_SHRINK);
  const real factor = dl2c_select(least < DL2C_DOPRI_GROWTH, least, DL2C_DOPRI_GROWTH);
  const real grown = dl2c_select(error > 0.0, factor, DL2C_DOPRI_GROWTH);
  return dl2c_select(error <= DBL_MAX, grown, DL2C_DOPRI_SHRINK);
}

/* The interpolant of variable i over a step that takes it from `here` to `there`.   c: (5) */
DL2C_INLINE void dl2c_dopri_terms(real here, real there, real h, const real (*k)[NX], int i,
                                  real *c)
{
  const real rise = there - here;
  const real left = h * k[0][i] - rise;
  const real right = rise - h * k[6][i] - left;
  const real bow = h * dl2c_dopri_sum(DL2C_DOPRI_BOW, k, 7, i);
  c[0] = here;
  c[1] = rise + left;
  c[2] = right - left + bow;
  c[3] = -right - 2.0 * bow;
  c[4] = bow;
}

/* The interpolant of a step from x to y. */
static void dl2c_dopri_track(int flow, const real *x, const real *y, real h, const real (*k)[NX],
                             dl2c_track *track)
{
  track->degree = DL2C_DOPRI_DEGREE;
  for (int i = 0; i < NX; i++) {
    track->c[i][0] = track->end[i] = y[i];
    for (int j = 1; j <= DL2C_DOPRI_DEGREE; j++) track->c[i][j] = 0.0;
  }
  DL2C_UNROLL
  for (int i = 0; i < NX; i++)
    if (model_moves(flow, i)) dl2c_dopri_terms(x[i], y[i], h, k, i, track->c[i]);
}

/* The next length to try after an attempt that is not taken. */
DL2C_INLINE real dl2c_dopri_shorter(real h, real error, real next)
{
  return dl2c_select(error <= 1.0, DL2C_DOPRI_SHRINK * h, next);
}

/* One step, never beyond `stop`; its interpolant in *track. False: there is none that is short
 * enough. */
static bool dl2c_dopri_step(dl2c_dopri *dopri, int flow, const real *p, dl2c_track *track)
{
  real k[7][NX], y[NX];
  memcpy(k[0], dopri->rates, sizeof k[0]);
  const real left = dopri->stop - dopri->now;
  real h = dopri->wanted;
  for (;;) {
    const bool whole = !(h < left);
    if (whole) h = left;
    if (dopri->steps++ >= DL2C_DOPRI_STEPS || !(dopri->now + h > dopri->now)) return false;
    const real error = dl2c_dopri_try(flow, p, dopri->last, h, k, y);
    const real next = h * dl2c_dopri_factor(error);
    if (error <= 1.0 && dl2c_all_finite(y, NX)) {
      track->from = dopri->now;
      track->length = h;
      dl2c_dopri_track(flow, dopri->last, y, h, (const real(*)[NX])k, track);
      memcpy(dopri->last, y, sizeof dopri->last);
      memcpy(dopri->rates, k[6], sizeof dopri->rates);
      dopri->now = whole ? dopri->stop : dopri->now + h;
      dopri->wanted = next;
      return true;
    }
    h = dl2c_dopri_shorter(h, error, next);
  }
}

#endif
