/* SPDX-License-Identifier: MIT-0 */
/*
 * curve.h -- polynomials on [0,1] in Bernstein form, parts of them, and the only zero of a part.
 *
 * The same operations in the same order as dl2c/ir/roots.py and roots_float.py.
 */
#ifndef DL2C_CURVE_H
#define DL2C_CURVE_H

#include "numbers.h"

enum { DL2C_MAX_DEGREE = 24 };

/* Bernstein coefficients on [0,1]; finite. Each is off by `noise` at most. */
typedef struct dl2c_curve {
  int32_t degree;
  real noise;
  real b[DL2C_MAX_DEGREE + 1];
} dl2c_curve;

/* Steps towards a zero before it is looked for nearby. */
enum { DL2C_APPROACH = 24 };

/* Coefficients on [low, high], each with a bound of its error. */
typedef struct dl2c_section {
  real low, high;
  real b[DL2C_MAX_DEGREE + 1];
  real e[DL2C_MAX_DEGREE + 1];
} dl2c_section;

/* Monomial c0 + c1*t + ... on [0, length] into Bernstein form on [0,1].   c: (degree + 1) */
static inline void dl2c_curve_of(const real *c, int degree, real length, dl2c_curve *curve)
{
  real *b = curve->b;
  real power = 1.0;
  real choose = 1.0;
  curve->degree = degree;
  curve->noise = 0.0;
  for (int k = 0; k <= degree; k++) {
    b[k] = choose == 1.0 ? c[k] * power : c[k] * power / choose;
    power *= length;
    if (k < degree) choose = choose * (real)(degree - k) / (real)(k + 1);
  }
  for (int k = degree; k >= 1; k--)
    for (int i = k; i <= degree; i++) b[i] += b[i - 1];
}

/* The value at s in [0,1]. */
static inline real dl2c_curve_at(const dl2c_curve *curve, real s)
{
  real b[DL2C_MAX_DEGREE + 1];
  for (int i = 0; i <= curve->degree; i++) b[i] = curve->b[i];
  for (int k = curve->degree; k >= 1; k--)
    for (int i = 0; i < k; i++) b[i] = b[i] * (1.0 - s) + b[i + 1] * s;
  return b[0];
}

/* The sign just after 0: that of the first coefficient that is surely not zero; 0 if none is. */
static inline int8_t dl2c_sign_after(const dl2c_curve *curve)
{
  for (int i = 0; i <= curve->degree; i++)
    if (fabs(curve->b[i]) > curve->noise) return curve->b[i] > 0.0 ? 1 : -1;
  return 0;
}

/* The sign just after a zero at 1: that before it, turned once for every zero coefficient. */
static inline int dl2c_sign_after_end(const dl2c_curve *curve)
{
  int turn = 1;
  for (int i = curve->degree; i >= 0; i--) {
    if (curve->b[i] != 0.0) return curve->b[i] > 0.0 ? turn : -turn;
    turn = -turn;
  }
  return 0;
}

/*
 * How many zeros are inside the part at most, 2 for more than one, and the first sign there, 0 for
 * none. Coefficients within their error are zero at the ends of the row; between others they may
 * have any sign.
 */
static inline int dl2c_variations(const dl2c_section *part, int degree, int *first)
{
  int variations = 0;
  int vague = 0;
  int last = 0;
  *first = 0;
  for (int i = 0; i <= degree; i++) {
    const int sign = (part->b[i] > part->e[i]) - (part->b[i] < -part->e[i]);
    if (sign == 0) {
      vague += part->e[i] > 0.0;
      continue;
    }
    if (last == 0) *first = sign;
    else variations += (sign != last) + 2 * (vague > (sign != last));
    last = sign;
    vague = 0;
  }
  return variations < 2 ? variations : 2;
}

/* Halve the part: itself the right half, *left the left one. */
static inline void dl2c_split(dl2c_section *part, int degree, real middle, dl2c_section *left)
{
  real *b = part->b;
  real *e = part->e;
  left->low = part->low;
  left->high = middle;
  part->low = middle;
  for (int k = degree; k >= 0; k--) {
    left->b[degree - k] = b[0];
    left->e[degree - k] = e[0];
    for (int i = 0; i < k; i++) {
      const real sum = b[i] + b[i + 1];
      const real second = sum - b[i];
      const real lost = (b[i] - (sum - second)) + (b[i + 1] - second);
      e[i] = (e[i] + e[i + 1] + fabs(lost)) * (0.5 + 0x1p-51);
      b[i] = 0.5 * sum;
    }
  }
}

/* What is left of a part that has one zero inside: the curve without its zeros at the ends. */
typedef struct dl2c_weights {
  real low, width;
  int degree;
  real w[DL2C_MAX_DEGREE + 1]; /* coefficients times binomials; the first and the last are not 0 */
} dl2c_weights;

static inline void dl2c_weigh(const dl2c_section *part, int degree, dl2c_weights *weights)
{
  int skipped = 0;
  real choose = 1.0;
  weights->low = part->low;
  weights->width = part->high - part->low;
  weights->degree = 0;
  for (int i = 0; i <= degree; i++) {
    const bool certain = fabs(part->b[i]) > part->e[i];
    weights->w[i - skipped] = part->b[i] * choose;
    choose = choose * (real)(degree - i) / (real)(i + 1);
    if (certain) weights->degree = i - skipped;
    else if (i == skipped) skipped++;
  }
}

/* At s in the part, a continuous function with the signs of the curve there. */
static inline real dl2c_weighted_at(const dl2c_weights *weights, real s)
{
  const real *w = weights->w;
  const int degree = weights->degree;
  const real t = (s - weights->low) / weights->width;
  if (t <= 0.5) {
    const real ratio = t / (1.0 - t);
    real value = w[degree];
    for (int i = degree - 1; i >= 0; i--) value = value * ratio + w[i];
    return value;
  }
  const real ratio = (1.0 - t) / t;
  real value = w[0];
  for (int i = 1; i <= degree; i++) value = value * ratio + w[i];
  return value;
}

/* Ordinals of doubles: the curve has its first sign at `near` and the other one at `far`. */
typedef struct dl2c_enclosure {
  const dl2c_weights *weights;
  int64_t near, far;
} dl2c_enclosure;

/* The value inside the bracket at a place that becomes its end there; both ends for a zero. */
static inline real dl2c_probe(dl2c_enclosure *bracket, real s)
{
  const real value = dl2c_weighted_at(bracket->weights, s);
  const bool before = (value > 0.0) == (bracket->weights->w[0] > 0.0);
  const int64_t number = dl2c_ordinal(s);
  if (value == 0.0 || before) bracket->near = number;
  if (value == 0.0 || !before) bracket->far = number;
  return value;
}

/* Secant steps as long as they halve the value, else the midpoint. Returns the last place. */
static inline real dl2c_approach(dl2c_enclosure *bracket)
{
  real last = dl2c_from_ordinal(bracket->near);
  real here = dl2c_from_ordinal(bracket->far);
  real last_value = dl2c_weighted_at(bracket->weights, last);
  real value = dl2c_weighted_at(bracket->weights, here);
  bool secant = true;
  for (int k = 0; k < DL2C_APPROACH && bracket->far - bracket->near > 1; k++) {
    const real near = dl2c_from_ordinal(bracket->near);
    const real far = dl2c_from_ordinal(bracket->far);
    real next = near + 0.5 * (far - near);
    if (secant && value != last_value) {
      const real step = value * ((here - last) / (value - last_value));
      if (fabs(step) <= 0x1p-52 * here) break;
      if (here - step > near && here - step < far) next = here - step;
    }
    if (!(next > near && next < far)) break;
    last = here;
    last_value = value;
    here = next;
    value = dl2c_probe(bracket, here);
    secant = fabs(value) <= 0.5 * fabs(last_value);
  }
  return here;
}

/*
 * The only zero inside the part: the last double before it, or the next one where that is the
 * part's low end; an exact zero where met. Steps of 1, 2, 4, ... units in the last place lead from
 * near the zero to its other side.
 */
static inline real dl2c_refined(const dl2c_section *part, int degree)
{
  dl2c_weights weights;
  dl2c_weigh(part, degree, &weights);
  dl2c_enclosure at = {&weights, dl2c_ordinal(part->low), dl2c_ordinal(part->high)};
  const int64_t start = dl2c_ordinal(dl2c_approach(&at));
  const bool upward = start == at.near;
  for (int64_t step = 1; step < at.far - at.near; step *= 2) {
    const int64_t number = upward ? at.near + step : at.far - step;
    dl2c_probe(&at, dl2c_from_ordinal(number));
    if (upward != (at.near == number)) break;
  }
  while (at.far - at.near > 1) dl2c_probe(&at, dl2c_from_ordinal(at.near + (at.far - at.near) / 2));
  return dl2c_from_ordinal(at.near > dl2c_ordinal(part->low) ? at.near : at.far);
}

#endif
