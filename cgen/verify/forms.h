/* SPDX-License-Identifier: MIT-0 */
/*
 * forms.h -- what a network computes on a box, with an error that holds every rounding.
 *
 * Eight boxes are looked at together, in lanes. On each, a point is `middle + half * t` with every t
 * between -1 and 1. A number that the network computes from it is held as a form: a linear function of t,
 * and a radius by which the number may differ from it. Forms go forward through the layers.
 *
 * Rounding. All is computed to nearest in doubles. With u = 2^-53, a sum of n products has an error of at
 * most n u / (1 - n u) times the sum S of their magnitudes, and of n 2^-1075 for products that underflow.
 * The bounds computed here have errors of that kind, and so has the program that is proved, in its own
 * arithmetic: `unit` is its relative error (2^-53, 2^-24, or 0 for real numbers), `tiny` its smallest
 * normal number. The radius gets twice each bound. Radii are sums of numbers that are not negative: their
 * own relative error is below 2^-40 for the sizes that are accepted, by which all are enlarged. That holds
 * in any order of summation. Where a magnitude is beyond `largest`, nothing is known of the outputs.
 */
#ifndef DL2C_FORMS_H
#define DL2C_FORMS_H

#include "formula.h"

#include <string.h>

enum { DL2C_LANES_OF_BOXES = 8, DL2C_MOST_WIDTH = 256, DL2C_MOST_LAYERS = 12, DL2C_MOST_DIMENSIONS = 24 };

/* Functions over lanes exist for several instruction sets. */
#if defined(__x86_64__) && defined(__GLIBC__) && defined(__GNUC__) && !defined(DL2C_NO_TARGET_CLONES)
#define DL2C_FOR_LANES __attribute__((target_clones("arch=x86-64-v3", "default")))
#else
#define DL2C_FOR_LANES
#endif

#define DL2C_INLINE static inline __attribute__((always_inline))

#define DL2C_EACH_LANE for (int k = 0; k < DL2C_LANES_OF_BOXES; k++)

#define DL2C_ENLARGED (1.0 + 0x1p-39)

typedef enum dl2c_activation { DL2C_IDENTITY, DL2C_RELU, DL2C_HYPERBOLIC } dl2c_activation;

/* `weight` has `rows` times `columns` numbers. */
typedef struct dl2c_layer {
  int32_t rows, columns, activation;
  const double *weight, *bias;
} dl2c_layer;

/* `slope * x + offset`, computed with at most six roundings of numbers up to `slope * |x| + size`, then
 * clipped. */
typedef struct dl2c_scale {
  double slope, offset, size, low, high;
} dl2c_scale;

/* What the network observes: a dimension of the box, or a number (dimension -1). It is rounded, by
 * `relative` times its magnitude and `absolute`. `scales` of them follow each other. */
typedef struct dl2c_observation {
  int32_t dimension, scales;
  double value, relative, absolute;
  const dl2c_scale *scale;
} dl2c_observation;

/* An output that is bounded: one of the last layer, or the difference to `other` where that is not -1. */
typedef struct dl2c_output {
  int32_t index, other;
  dl2c_scale scale;
} dl2c_output;

typedef struct dl2c_network {
  int32_t dimensions, observations, layers, outputs;
  const dl2c_observation *observation;
  const dl2c_layer *layer;
  const dl2c_output *output;
  double unit, tiny, largest, library;
} dl2c_network;

/* Sums of products may be rounded after each product or not: bounds hold for both. */
#if defined(__GNUC__) && !defined(__clang__)
#define DL2C_FUSED __attribute__((optimize("fp-contract=fast")))
#pragma GCC diagnostic ignored "-Wpsabi" /* vectors are returned by functions that are always inlined */
#else
#define DL2C_FUSED
#endif

typedef double dl2c_lane[DL2C_LANES_OF_BOXES];

/* Half of the lanes as one value, a truth value for each, and how many sums are made together. */
typedef double dl2c_four __attribute__((vector_size(32), aligned(8), may_alias));
typedef int64_t dl2c_four_truths __attribute__((vector_size(32), aligned(8), may_alias));
enum { DL2C_TOGETHER = 4, DL2C_HALVES = 2 };

#define DL2C_HALF(lane, half) (((dl2c_four *)(lane))[half])
#define DL2C_FIRST_FOUR(lane) DL2C_HALF(lane, 0)
#define DL2C_OTHER_FOUR(lane) DL2C_HALF(lane, 1)

DL2C_INLINE dl2c_four dl2c_four_of(double x) { return (dl2c_four){x, x, x, x}; }

DL2C_INLINE dl2c_four dl2c_four_if(dl2c_four_truths chosen, dl2c_four a, dl2c_four b)
{
  return (dl2c_four)((chosen & (dl2c_four_truths)a) | (~chosen & (dl2c_four_truths)b));
}

DL2C_INLINE dl2c_four dl2c_four_greater(dl2c_four a, dl2c_four b) { return dl2c_four_if(a > b, a, b); }
DL2C_INLINE dl2c_four dl2c_four_size(dl2c_four a) { return dl2c_four_if(a < 0.0, -a, a); }

/* Numbers of one layer. `part` 0 is the value at the middle, part 1 + d the slope along dimension d;
 * `size` is a bound of the magnitude. */
typedef struct dl2c_forms {
  dl2c_lane part[1 + DL2C_MOST_DIMENSIONS][DL2C_MOST_WIDTH];
  dl2c_lane radius[DL2C_MOST_WIDTH], size[DL2C_MOST_WIDTH];
} dl2c_forms;

/* Of the sums of one layer: `scope`, the sum of magnitudes, `error` of the program's arithmetic, and lines
 * below and above the activation: slope[0] * z + offset[0] <= f(z) <= slope[1] * z + offset[1]. */
typedef struct dl2c_lines {
  dl2c_lane scope[DL2C_MOST_WIDTH], error[DL2C_MOST_WIDTH], extent[DL2C_MOST_WIDTH];
  dl2c_lane slope[2][DL2C_MOST_WIDTH], offset[2][DL2C_MOST_WIDTH];
  dl2c_lane after[DL2C_MOST_WIDTH];
} dl2c_lines;

/* A linear bound of an output over t: the constant, then the slopes. */
typedef struct dl2c_linear {
  dl2c_lane constant, slope[DL2C_MOST_DIMENSIONS];
} dl2c_linear;

/* Memory of one thread. */
typedef struct dl2c_workspace {
  dl2c_lane middle[DL2C_MOST_DIMENSIONS], half[DL2C_MOST_DIMENSIONS];
  dl2c_forms forms[2], observed;
  dl2c_lines lines[DL2C_MOST_LAYERS];
  dl2c_lane row[DL2C_MOST_WIDTH], next[DL2C_MOST_WIDTH];
  dl2c_linear bound[2][DL2C_MOST_WIDTH];
  bool known[DL2C_LANES_OF_BOXES];
} dl2c_workspace;

/* slope * x + offset, for a form. `unit` and `tiny` are those of the program. */
static void dl2c_scaled(const dl2c_network *n, dl2c_forms *f, int i, const dl2c_scale *s)
{
  const int dimensions = n->dimensions;
  DL2C_EACH_LANE
  {
    const double scope = fabs(s->slope) * f->size[i][k] + s->size;
    const double error = (16.0 * (0x1p-53 + n->unit)) * scope + 16.0 * (n->tiny + DBL_MIN);
    f->radius[i][k] = (fabs(s->slope) * f->radius[i][k] + error) * DL2C_ENLARGED;
    f->part[0][i][k] = s->slope * f->part[0][i][k] + s->offset;
    double reach = f->radius[i][k];
    for (int d = 0; d < dimensions; d++) {
      f->part[1 + d][i][k] *= s->slope;
      reach += fabs(f->part[1 + d][i][k]);
    }
    reach *= DL2C_ENLARGED;
    const double low = f->part[0][i][k] - reach, high = f->part[0][i][k] + reach;
    const double excess = dl2c_greater(0.0, dl2c_greater(s->low - low, high - s->high));
    if (excess <= reach) {
      f->radius[i][k] = (f->radius[i][k] + excess) * DL2C_ENLARGED;
    } else {
      const double from = dl2c_lesser(dl2c_greater(low, s->low), s->high);
      const double to = dl2c_greater(dl2c_lesser(high, s->high), s->low);
      f->part[0][i][k] = from + 0.5 * (to - from);
      for (int d = 0; d < dimensions; d++) f->part[1 + d][i][k] = 0.0;
      f->radius[i][k] = ((to - from) + (fabs(from) + fabs(to)) * 0x1p-50 + DBL_MIN) * DL2C_ENLARGED;
    }
    double size = fabs(f->part[0][i][k]) + f->radius[i][k];
    for (int d = 0; d < dimensions; d++) size += fabs(f->part[1 + d][i][k]);
    f->size[i][k] = size * DL2C_ENLARGED;
  }
}

/* The forms of what the network observes. */
static void dl2c_observe(const dl2c_network *n, dl2c_workspace *w)
{
  dl2c_forms *f = &w->observed;
  for (int i = 0; i < n->observations; i++) {
    const dl2c_observation *o = n->observation + i;
    DL2C_EACH_LANE
    {
      const bool moving = o->dimension >= 0;
      f->part[0][i][k] = moving ? w->middle[o->dimension][k] : o->value;
      for (int d = 0; d < n->dimensions; d++)
        f->part[1 + d][i][k] = d == o->dimension ? w->half[d][k] : 0.0;
      const double reach = moving ? w->half[o->dimension][k] : 0.0;
      const double exact = (fabs(f->part[0][i][k]) + reach) * DL2C_ENLARGED;
      f->radius[i][k] = (exact * o->relative + o->absolute) * DL2C_ENLARGED;
      f->size[i][k] = (exact + f->radius[i][k]) * DL2C_ENLARGED;
    }
    for (int s = 0; s < o->scales; s++) dl2c_scaled(n, f, i, o->scale + s);
  }
}

/* Add weight * given to `sums`, for rows `first` on; of the sizes of weights where `sizes`. */
DL2C_INLINE DL2C_FUSED void dl2c_add_rows(const dl2c_layer *layer, int first, int rows,
                                                                dl2c_lane *given, bool sizes,
                                                                dl2c_lane *sums)
{
  const size_t columns = (size_t)layer->columns;
  const double *weight[DL2C_TOGETHER];
  dl2c_four sum[DL2C_TOGETHER], other[DL2C_TOGETHER];
  for (int r = 0; r < DL2C_TOGETHER; r++) {
    const int row = r < rows ? r : rows - 1;
    weight[r] = layer->weight + (size_t)(first + row) * columns;
    sum[r] = DL2C_FIRST_FOUR(sums[row]);
    other[r] = DL2C_OTHER_FOUR(sums[row]);
  }
  for (size_t j = 0; j < columns; j++) {
    const dl2c_four value = DL2C_FIRST_FOUR(given[j]), second = DL2C_OTHER_FOUR(given[j]);
    for (int r = 0; r < DL2C_TOGETHER; r++) {
      const double factor = sizes ? fabs(weight[r][j]) : weight[r][j];
      sum[r] += factor * value;
      other[r] += factor * second;
    }
  }
  for (int r = 0; r < rows; r++) {
    DL2C_FIRST_FOUR(sums[r]) = sum[r];
    DL2C_OTHER_FOUR(sums[r]) = other[r];
  }
}

/* The sums `weight * given + bias` of a layer, as forms. */
DL2C_FOR_LANES DL2C_FUSED static void dl2c_sums(const dl2c_network *n, const dl2c_layer *layer,
                                     dl2c_forms *given, dl2c_forms *made, dl2c_lines *lines)
{
  const double terms = (double)(layer->columns + 8);
  const double own = 2.0 * terms * 0x1p-53, its = 2.0 * terms * n->unit;
  const double least = 2.0 * terms * DBL_MIN * (double)(n->dimensions + 2);
  const double vanished = 2.0 * terms * n->tiny;
  for (int first = 0; first < layer->rows; first += DL2C_TOGETHER) {
    const int rows = layer->rows - first < DL2C_TOGETHER ? layer->rows - first : DL2C_TOGETHER;
    for (int p = 0; p <= n->dimensions; p++) {
      for (int r = 0; r < rows; r++)
        DL2C_EACH_LANE made->part[p][first + r][k] = p == 0 ? layer->bias[first + r] : 0.0;
      dl2c_add_rows(layer, first, rows, given->part[p], false, made->part[p] + first);
    }
    for (int i = first; i < first + rows; i++)
      DL2C_EACH_LANE
      {
        made->radius[i][k] = 0.0;
        lines->scope[i][k] = fabs(layer->bias[i]);
      }
    dl2c_add_rows(layer, first, rows, given->radius, true, made->radius + first);
    dl2c_add_rows(layer, first, rows, given->size, true, lines->scope + first);
    for (int i = first; i < first + rows; i++)
      DL2C_EACH_LANE
      {
        const double scope = lines->scope[i][k], error = (its * scope + vanished) * DL2C_ENLARGED;
        lines->scope[i][k] = scope * DL2C_ENLARGED;
        lines->error[i][k] = error;
        made->radius[i][k] = (made->radius[i][k] + own * scope + least + error) * DL2C_ENLARGED;
      }
  }
}

/* Four lines below and four above an activation: slope[0] * z + offset[0] <= f(z) <= slope[1] * z + offset[1]. */
typedef struct dl2c_four_lines {
  dl2c_four slope[2], offset[2];
} dl2c_four_lines;

/* Of max(0, z) for z between `low` and `high`: a line through 0 below, the chord above. */
DL2C_INLINE dl2c_four_lines dl2c_lines_of_relu(dl2c_four low, dl2c_four high)
{
  const dl2c_four zero = dl2c_four_of(0.0), one = dl2c_four_of(1.0);
  const dl2c_four above = dl2c_four_greater(high, zero), width = above + dl2c_four_greater(-low, zero);
  const dl2c_four chord = above / dl2c_four_greater(width, dl2c_four_of(DBL_MIN));
  const dl2c_four raised = dl2c_four_greater(-chord * low, (one - chord) * high);
  const dl2c_four rounded = raised * (1.0 + 0x1p-49) + above * 0x1p-50 + DBL_MIN;
  return (dl2c_four_lines){{dl2c_four_if(high > -low, one, zero), chord},
                           {zero, dl2c_four_if(raised > zero, rounded, zero)}};
}

/* Of tanh: a slope that is nowhere larger than the function's, so that tanh(z) - slope * z grows. */
DL2C_INLINE dl2c_four_lines dl2c_lines_of_tanh(dl2c_four low, dl2c_four high)
{
  dl2c_four first, last;
  for (int k = 0; k < DL2C_LANES_OF_BOXES / DL2C_HALVES; k++) {
    first[k] = tanh(low[k]);
    last[k] = tanh(high[k]);
  }
  const dl2c_four flattest = dl2c_four_greater(dl2c_four_size(first), dl2c_four_size(last));
  const dl2c_four steep = (1.0 - flattest * flattest) - 0x1p-45;
  const dl2c_four slope = dl2c_four_greater(dl2c_four_of(0.0), steep) * (1.0 - 0x1p-45);
  return (dl2c_four_lines){
    {slope, slope},
    {first - slope * low - (1.0 + slope * dl2c_four_size(low)) * 0x1p-49,
     last - slope * high + (1.0 + slope * dl2c_four_size(high)) * 0x1p-49}};
}

DL2C_INLINE dl2c_four_lines dl2c_lines_of(int32_t activation, dl2c_four low, dl2c_four high)
{
  const dl2c_four zero = dl2c_four_of(0.0), one = dl2c_four_of(1.0);
  if (activation == DL2C_RELU) return dl2c_lines_of_relu(low, high);
  if (activation == DL2C_HYPERBOLIC) return dl2c_lines_of_tanh(low, high);
  return (dl2c_four_lines){{one, one}, {zero, zero}};
}

/* What the activation of a layer makes of its sums; fills in the lines. */
DL2C_FOR_LANES static void dl2c_activated(const dl2c_network *n, const dl2c_layer *layer, dl2c_forms *f,
                                          dl2c_lines *l)
{
  const bool hyperbolic = layer->activation == DL2C_HYPERBOLIC;
  const double after = hyperbolic ? n->library : 0.0;
  for (int i = 0; i < layer->rows; i++)
    for (int h = 0; h < DL2C_HALVES; h++) {
      const dl2c_four middle = DL2C_HALF(f->part[0][i], h), radius = DL2C_HALF(f->radius[i], h);
      dl2c_four reach = radius;
      for (int d = 0; d < n->dimensions; d++) reach += dl2c_four_size(DL2C_HALF(f->part[1 + d][i], h));
      reach = (reach + dl2c_four_size(middle) * 0x1p-50) * DL2C_ENLARGED + DBL_MIN;
      const dl2c_four extent = dl2c_four_size(middle) + reach;
      const dl2c_four_lines lines = dl2c_lines_of(layer->activation, middle - reach, middle + reach);
      const dl2c_four slope = lines.slope[1], above = lines.offset[1];
      const dl2c_four below = hyperbolic ? lines.offset[0] : dl2c_four_of(0.0);
      const dl2c_four rounding =
        (slope * extent + dl2c_four_size(above) + dl2c_four_size(below)) * 0x1p-49 + DBL_MIN;
      const dl2c_four gap = dl2c_four_greater(dl2c_four_of(0.0), above - below);
      const dl2c_four center = slope * middle + 0.5 * (above + below);
      const dl2c_four around = (slope * radius + 0.5 * gap + rounding + after) * DL2C_ENLARGED;
      dl2c_four size = dl2c_four_size(center) + around;
      for (int d = 0; d < n->dimensions; d++) {
        const dl2c_four part = slope * DL2C_HALF(f->part[1 + d][i], h);
        DL2C_HALF(f->part[1 + d][i], h) = part;
        size += dl2c_four_size(part);
      }
      DL2C_HALF(f->part[0][i], h) = center;
      DL2C_HALF(f->radius[i], h) = around;
      DL2C_HALF(f->size[i], h) = size * DL2C_ENLARGED;
      DL2C_HALF(l->extent[i], h) = extent * DL2C_ENLARGED;
      DL2C_HALF(l->after[i], h) = dl2c_four_of(after);
      for (int side = 0; side < 2; side++) {
        DL2C_HALF(l->slope[side][i], h) = lines.slope[side];
        DL2C_HALF(l->offset[side][i], h) = lines.offset[side];
      }
    }
}

#endif
