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

/* A flow that needs more steps counts as failed: it is stiff, and a case for CVODES. */
enum { DL2C_DOPRI_STEPS = 100000 };

/* The share of the tolerances that the error of one step may take, and how near to it steps go. */
#define DL2C_DOPRI_SHARE 0.1
#define DL2C_DOPRI_CARE 0.9

/* Steps grow and shrink by these factors at most. */
#define DL2C_DOPRI_GROWTH 5.0
#define DL2C_DOPRI_SHRINK 0.2

/* Near the fifth root of a value > 0; exact powers of two apart, a line and Newton's method. */
static real dl2c_fifth_root(real value)
{
  int exponent;
  const real part = frexp(value, &exponent);
  const int fifth = exponent >= 0 ? exponent / 5 : -((4 - exponent) / 5);
  const real rest = ldexp(part, exponent - 5 * fifth); /* from 0.5 to 16 */
  real root = 0.9 + 0.06 * rest;
  for (int k = 0; k < 3; k++) {
    const real square = root * root;
    root = 0.8 * root + 0.2 * rest / (square * square);
  }
  return ldexp(root, fifth);
}

/* The Euclidean norm of d in units of the tolerances at y and z. */
static real dl2c_dopri_norm(const real *d, const real *y, const real *z)
{
  real sum = 0.0;
  for (int k = 0; k < NX; k++) {
    const real unit = DL2C_ATOL + DL2C_RTOL * dl2c_max(fabs(y[k]), fabs(z[k]));
    sum += (d[k] / unit) * (d[k] / unit);
  }
  return sqrt(sum);
}

/* A first step over which the flow bends no more than the tolerances allow: one Euler step shows.
 */
static real dl2c_dopri_first(const dl2c_dopri *dopri, int flow, const real *p)
{
  const real *const x = dopri->last;
  const real slope = dl2c_dopri_norm(dopri->rates, x, x);
  const real size = dl2c_dopri_norm(x, x, x);
  real h = slope > 1e-5 && size > 1e-5 ? 0.01 * (size / slope) : 1e-6;
  if (!(h < dopri->stop)) h = dopri->stop;
  real y[NX], rates[NX];
  for (int k = 0; k < NX; k++) y[k] = x[k] + h * dopri->rates[k];
  model_rates(flow, y, p, rates);
  for (int k = 0; k < NX; k++) rates[k] = (rates[k] - dopri->rates[k]) / h;
  const real bend = dl2c_dopri_norm(rates, x, x);
  const real most = bend > slope ? bend : slope;
  if (!(most <= DBL_MAX)) return h;
  const real next = most > 1e-15 ? dl2c_fifth_root(DL2C_DOPRI_SHARE / most) : 100.0 * h;
  return next < 100.0 * h ? next : 100.0 * h;
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
  dopri->wanted = dl2c_dopri_first(dopri, flow, p);
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

/* What the interpolant has beyond Hermite's. */
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

/* A step of length h from x to y: slopes k[0] to k[6], of which the first is given. */
static void dl2c_dopri_stages(int flow, const real *p, const real *x, real h, real (*k)[NX],
                              real *y)
{
  DL2C_UNROLL
  for (int s = 0; s < 6; s++) {
    for (int i = 0; i < NX; i++)
      y[i] = x[i] + h * dl2c_dopri_sum(DL2C_DOPRI_WEIGHTS[s], (const real(*)[NX])k, s + 1, i);
    model_rates(flow, y, p, k[s + 1]);
  }
}

/* The error of a step in units of what it may be; not finite where a rate has no value. */
static real dl2c_dopri_error(const real *x, const real *y, real h, const real (*k)[NX])
{
  real error[NX];
  for (int i = 0; i < NX; i++) error[i] = h * dl2c_dopri_sum(DL2C_DOPRI_ERROR, k, 7, i);
  return dl2c_dopri_norm(error, x, y) / DL2C_DOPRI_SHARE;
}

/* By what the next step is longer than one with this error. */
static real dl2c_dopri_factor(real error)
{
  if (!(error <= DBL_MAX)) return DL2C_DOPRI_SHRINK;
  if (!(error > 0.0)) return DL2C_DOPRI_GROWTH;
  const real factor = DL2C_DOPRI_CARE / dl2c_fifth_root(error);
  return dl2c_max(DL2C_DOPRI_SHRINK, dl2c_min(factor, DL2C_DOPRI_GROWTH));
}

/* The interpolant of a step from x to y. */
static void dl2c_dopri_track(const real *x, const real *y, real h, const real (*k)[NX],
                             dl2c_track *track)
{
  track->degree = 4;
  for (int i = 0; i < NX; i++) {
    const real rise = y[i] - x[i];
    const real left = h * k[0][i] - rise;
    const real right = rise - h * k[6][i] - left;
    const real bow = h * dl2c_dopri_sum(DL2C_DOPRI_BOW, k, 7, i);
    track->c[i][0] = x[i];
    track->c[i][1] = rise + left;
    track->c[i][2] = right - left + bow;
    track->c[i][3] = -right - 2.0 * bow;
    track->c[i][4] = bow;
    track->end[i] = y[i];
  }
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
    dl2c_dopri_stages(flow, p, dopri->last, h, k, y);
    const real error = dl2c_dopri_error(dopri->last, y, h, (const real(*)[NX])k);
    const real next = h * dl2c_dopri_factor(error);
    if (error <= 1.0 && dl2c_all_finite(y, NX)) {
      track->from = dopri->now;
      track->length = h;
      dl2c_dopri_track(dopri->last, y, h, (const real(*)[NX])k, track);
      memcpy(dopri->last, y, sizeof dopri->last);
      memcpy(dopri->rates, k[6], sizeof dopri->rates);
      dopri->now = whole ? dopri->stop : dopri->now + h;
      dopri->wanted = next;
      return true;
    }
    h = error <= 1.0 ? DL2C_DOPRI_SHRINK * h : next;
  }
}

#endif
