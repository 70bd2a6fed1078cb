/* SPDX-License-Identifier: MIT-0 */
/*
 * pieces.h -- motion as polynomials: a track, and curves through what it is sampled at.
 *
 * A track is one internal step of a solver. A term along it is no polynomial in general; it is
 * taken to be the one of degree 12 through its values at thirteen Chebyshev nodes, which for a
 * quadratic term of a track of degree 6 it is.
 */
#ifndef DL2C_PIECES_H
#define DL2C_PIECES_H

#include "hull.h"
#include "roots.h"

enum { DL2C_TRACK_DEGREE = 12, DL2C_NODES = 13, DL2C_HALF = DL2C_NODES / 2 };

/*
 * x(from + s*length), s in [0,1]: variable k is the sum of c[k][i] * s^i, i <= degree. At 0 and 1
 * it is c[k][0] and end[k] to the last bit, so that tracks join.
 */
typedef struct dl2c_track {
  real from;
  real length;
  int32_t degree;
  real c[NX][DL2C_TRACK_DEGREE + 1];
  real end[NX];
} dl2c_track;

/* How far rounding takes a value of a track, relative to the sum of its terms. */
#define DL2C_TRACK_ROUNDING 0x1p-46

/* Where terms are sampled: sin(k*pi/24)^2, more closely towards the ends. */
static const real DL2C_NODE[DL2C_NODES] = {
    0.0,
    0.017037086855465858,
    0.06698729810778067,
    0.14644660940672624,
    0.25,
    0.37059047744873963,
    0.5,
    0.6294095225512604,
    0.75,
    0.8535533905932737,
    0.9330127018922193,
    0.9829629131445341,
    1.0,
};

/*
 * From values to a Bernstein curve by way of Chebyshev coefficients. The curve's even and odd parts
 * about its middle are treated alone; a row belongs to node j, and then to coefficient 2i (2i+1).
 */
static const real DL2C_EVEN_COEFFICIENT[7][7] = {
    {0.041666666666666664, 0.08333333333333333, 0.08333333333333333, 0.08333333333333333,
     0.08333333333333333, 0.08333333333333333, 0.041666666666666664},
    {0.08333333333333333, 0.14433756729740643, 0.08333333333333333, 0.0, -0.08333333333333333,
     -0.14433756729740643, -0.08333333333333333},
    {0.08333333333333333, 0.08333333333333333, -0.08333333333333333, -0.16666666666666666,
     -0.08333333333333333, 0.08333333333333333, 0.08333333333333333},
    {0.08333333333333333, 0.0, -0.16666666666666666, 0.0, 0.16666666666666666, 0.0,
     -0.08333333333333333},
    {0.08333333333333333, -0.08333333333333333, -0.08333333333333333, 0.16666666666666666,
     -0.08333333333333333, -0.08333333333333333, 0.08333333333333333},
    {0.08333333333333333, -0.14433756729740643, 0.08333333333333333, 0.0, -0.08333333333333333,
     0.14433756729740643, -0.08333333333333333},
    {0.08333333333333333, -0.16666666666666666, 0.16666666666666666, -0.16666666666666666,
     0.16666666666666666, -0.16666666666666666, 0.08333333333333333},
};
static const real DL2C_ODD_COEFFICIENT[6][6] = {
    {-0.08333333333333333, -0.08333333333333333, -0.08333333333333333, -0.08333333333333333,
     -0.08333333333333333, -0.08333333333333333},
    {-0.16098763771484473, -0.11785113019775792, -0.043136507517086795, 0.043136507517086795,
     0.11785113019775792, 0.16098763771484473},
    {-0.14433756729740643, 0.0, 0.14433756729740643, 0.14433756729740643, 0.0,
     -0.14433756729740643},
    {-0.11785113019775792, 0.11785113019775792, 0.11785113019775792, -0.11785113019775792,
     -0.11785113019775792, 0.11785113019775792},
    {-0.08333333333333333, 0.16666666666666666, -0.08333333333333333, -0.08333333333333333,
     0.16666666666666666, -0.08333333333333333},
    {-0.043136507517086795, 0.11785113019775792, -0.16098763771484473, 0.16098763771484473,
     -0.11785113019775792, 0.043136507517086795},
};

/* The Bernstein coefficients of degree 12 of the Chebyshev polynomials 2i (2i+1), up to the middle.
 */
static const real DL2C_EVEN_BERNSTEIN[7][7] = {
    {1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0},
    {1.0, 0.3333333333333333, -0.21212121212121213, -0.6363636363636364, -0.9393939393939394,
     -1.121212121212121, -1.1818181818181819},
    {1.0, -1.6666666666666667, -1.9090909090909092, -0.8909090909090909, 0.48282828282828283,
     1.5656565656565657, 1.9696969696969697},
    {1.0, -5.0, 1.7272727272727273, 4.890909090909091, 2.1636363636363636, -2.5757575757575757,
     -4.783549783549783},
    {1.0, -9.666666666666666, 20.393939393939394, -6.5636363636363635, -17.618181818181817,
     3.2626262626262625, 18.17748917748918},
    {1.0, -15.666666666666666, 67.66666666666667, -133.0, 107.66666666666667, 35.888888888888886,
     -127.24242424242425},
    {1.0, -23.0, 161.0, -611.8, 1485.8, -2476.3333333333335, 2926.5757575757575},
};
static const real DL2C_ODD_BERNSTEIN[6][6] = {
    {-1.0, -0.8333333333333334, -0.6666666666666666, -0.5, -0.3333333333333333,
     -0.16666666666666666},
    {-1.0, 0.5, 1.2727272727272727, 1.4636363636363636, 1.2181818181818183, 0.6818181818181818},
    {-1.0, 3.1666666666666665, 1.2727272727272727, -1.5909090909090908, -2.919191919191919,
     -2.1464646464646466},
    {-1.0, 7.166666666666667, -8.424242424242424, -5.009090909090909, 5.872727272727273,
     8.156565656565656},
    {-1.0, 12.5, -39.45454545454545, 44.736363636363635, 5.872727272727273, -44.04545454545455},
    {-1.0, 19.166666666666668, -107.33333333333333, 305.9, -495.26666666666665, 412.72222222222223},
};

/* The state along a track, s in [0,1].   x: (NX) */
static void dl2c_track_at(const dl2c_track *track, real s, real *x)
{
  if (s >= 1.0) {
    memcpy(x, track->end, sizeof track->end);
    return;
  }
  for (int k = 0; k < NX; k++) {
    real value = track->c[k][track->degree];
    for (int i = track->degree - 1; i >= 0; i--) value = value * s + track->c[k][i];
    x[k] = value;
  }
}

/* What one variable stays in: s^i is between 0 and 1, and rounding adds little.   c: (degree + 1) */
DL2C_INLINE dl2c_hull dl2c_terms_hull(const real *c, int degree, real end)
{
  real down = 0.0;
  real up = 0.0;
  DL2C_UNROLL
  for (int i = 1; i <= degree; i++) {
    down += dl2c_min(c[i], 0.0);
    up += dl2c_max(c[i], 0.0);
  }
  const real rounding = (fabs(c[0]) + up - down) * DL2C_TRACK_ROUNDING;
  return dl2c_hull_of(dl2c_min(c[0] + down - rounding, end), dl2c_max(c[0] + up + rounding, end));
}

/* What a track stays in.   x: (NX) */
static inline void dl2c_track_hull(const dl2c_track *track, dl2c_hull *x)
{
  for (int k = 0; k < NX; k++) x[k] = dl2c_terms_hull(track->c[k], track->degree, track->end[k]);
}

/* The states at all nodes, each variable in a row.   x: (NX, DL2C_NODES) */
static void dl2c_track_samples(const dl2c_track *track, real *restrict x)
{
  for (int k = 0; k < NX; k++) {
    real *restrict row = x + k * DL2C_NODES;
    for (int j = 0; j < DL2C_NODES; j++) row[j] = track->c[k][track->degree];
    for (int i = track->degree - 1; i >= 0; i--)
      for (int j = 0; j < DL2C_NODES; j++) row[j] = row[j] * DL2C_NODE[j] + track->c[k][i];
    row[DL2C_NODES - 1] = track->end[k];
  }
}

/*
 * How much of a Chebyshev coefficient may be rounding, relative to the largest value. Smaller ones
 * after the last larger one are left out: as Bernstein coefficients they would be a thousand times
 * as large.
 */
#define DL2C_FIT_NOISE 0x1p-49

/* By how much rounding of the values may be larger in Bernstein coefficients, by how many matter. */
static const real DL2C_FIT_GAIN[DL2C_NODES + 1] = {1.0,  2.0,  3.0,  5.0,  6.0,   8.0,   12.0,
                                                   17.0, 25.0, 46.0, 91.0, 224.0, 719.0, 3646.0};

/*
 * The Chebyshev coefficients of the curve through the values, each off by `noise` at most; returns
 * how many matter.
 */
static int dl2c_chebyshev(const real *values, real noise, real *even, real *odd)
{
  real sums[DL2C_HALF + 1];
  real differences[DL2C_HALF];
  real largest = fabs(values[DL2C_HALF]);
  for (int j = 0; j < DL2C_HALF; j++) {
    const real mirrored = values[DL2C_NODES - 1 - j];
    sums[j] = values[j] + mirrored;
    differences[j] = values[j] - mirrored;
    largest = dl2c_max(largest, dl2c_max(fabs(values[j]), fabs(mirrored)));
  }
  sums[DL2C_HALF] = values[DL2C_HALF];

  for (int i = 0; i <= DL2C_HALF; i++) even[i] = 0.0;
  for (int i = 0; i < DL2C_HALF; i++) odd[i] = 0.0;
  for (int j = 0; j <= DL2C_HALF; j++)
    for (int i = 0; i <= DL2C_HALF; i++) even[i] += DL2C_EVEN_COEFFICIENT[j][i] * sums[j];
  for (int j = 0; j < DL2C_HALF; j++)
    for (int i = 0; i < DL2C_HALF; i++) odd[i] += DL2C_ODD_COEFFICIENT[j][i] * differences[j];

  const real least = dl2c_max(noise, DL2C_FIT_NOISE * largest);
  int count = DL2C_NODES;
  while (count > 0 && fabs(count % 2 ? even[count / 2] : odd[count / 2 - 1]) <= least) count--;
  return count;
}

/*
 * The Bernstein curve of degree DL2C_NODES - 1 through values at the nodes; its ends are the first
 * and the last value to the last bit.   values: (DL2C_NODES), each off by `noise` at most
 */
static void dl2c_fit(const real *values, real noise, dl2c_curve *curve)
{
  real even[DL2C_HALF + 1];
  real odd[DL2C_HALF];
  const int count = dl2c_chebyshev(values, noise, even, odd);
  real symmetric[DL2C_HALF + 1] = {0.0};
  real skew[DL2C_HALF] = {0.0};
  for (int i = 0; 2 * i < count; i++)
    for (int j = 0; j <= DL2C_HALF; j++) symmetric[j] += DL2C_EVEN_BERNSTEIN[i][j] * even[i];
  for (int i = 0; 2 * i + 1 < count; i++)
    for (int j = 0; j < DL2C_HALF; j++) skew[j] += DL2C_ODD_BERNSTEIN[i][j] * odd[i];

  curve->degree = DL2C_NODES - 1;
  curve->noise = noise * DL2C_FIT_GAIN[count];
  for (int j = 0; j < DL2C_HALF; j++) {
    curve->b[j] = symmetric[j] + skew[j];
    curve->b[DL2C_NODES - 1 - j] = symmetric[j] - skew[j];
  }
  curve->b[DL2C_HALF] = symmetric[DL2C_HALF];
  curve->b[0] = values[0];
  curve->b[DL2C_NODES - 1] = values[DL2C_NODES - 1];
}

#endif
