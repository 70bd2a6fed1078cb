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

enum { DL2C_LANES_OF_BOXES = 8, DL2C_MOST_WIDTH = 256, DL2C_MOST_LAYERS = 12, DL2C_MOST_DIMENSIONS = 12 };

/* Functions over lanes exist for several instruction sets, all of which compute the same bits. */
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

typedef double dl2c_lane[DL2C_LANES_OF_BOXES];

/* Half of the lanes as one value, and how many sums are made together. */
typedef double dl2c_four __attribute__((vector_size(32), aligned(8), may_alias));
enum { DL2C_TOGETHER = 4 };

#define DL2C_FIRST_FOUR(lane) (((dl2c_four *)(lane))[0])
#define DL2C_OTHER_FOUR(lane) (((dl2c_four *)(lane))[1])

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
static inline __attribute__((always_inline)) void dl2c_add_rows(const dl2c_layer *layer, int first, int rows,
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
DL2C_FOR_LANES static void dl2c_sums(const dl2c_network *n, const dl2c_layer *layer,
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

/* Lines below and above max(0, z) for z between `low` and `high`. */
DL2C_INLINE void dl2c_lines_of_relu(dl2c_lines *l, int i, int k, double low, double high)
{
  const double chord = low >= 0.0 ? 1.0 : high <= 0.0 ? 0.0 : high / (high - low);
  const bool bent = low < 0.0 && high > 0.0;
  const double above = dl2c_greater(-chord * low, (1.0 - chord) * high);
  l->slope[0][i][k] = bent ? (high > -low ? 1.0 : 0.0) : chord;
  l->offset[0][i][k] = 0.0;
  l->slope[1][i][k] = chord;
  l->offset[1][i][k] = bent ? above * (1.0 + 0x1p-49) + high * 0x1p-50 + DBL_MIN : 0.0;
}

/* Of tanh: a slope that is nowhere larger than the function's, so that tanh(z) - slope * z grows. */
DL2C_INLINE void dl2c_lines_of_tanh(dl2c_lines *l, int i, int k, double low, double high)
{
  const double first = tanh(low), last = tanh(high);
  const double flattest = dl2c_greater(fabs(first), fabs(last));
  const double slope = dl2c_greater(0.0, (1.0 - flattest * flattest) - 0x1p-45) * (1.0 - 0x1p-45);
  l->slope[0][i][k] = l->slope[1][i][k] = slope;
  l->offset[0][i][k] = first - slope * low - (1.0 + slope * fabs(low)) * 0x1p-49;
  l->offset[1][i][k] = last - slope * high + (1.0 + slope * fabs(high)) * 0x1p-49;
}

/* What the activation of a layer makes of its sums; fills in the lines. */
DL2C_FOR_LANES static void dl2c_activated(const dl2c_network *n, const dl2c_layer *layer, dl2c_forms *f, dl2c_lines *l)
{
  for (int i = 0; i < layer->rows; i++)
    DL2C_EACH_LANE
    {
      double reach = f->radius[i][k];
      for (int d = 0; d < n->dimensions; d++) reach += fabs(f->part[1 + d][i][k]);
      reach = (reach + fabs(f->part[0][i][k]) * 0x1p-50) * DL2C_ENLARGED + DBL_MIN;
      const double low = f->part[0][i][k] - reach, high = f->part[0][i][k] + reach;
      const double extent = fabs(f->part[0][i][k]) + reach;
      l->after[i][k] = 0.0;
      l->extent[i][k] = extent * DL2C_ENLARGED;
      if (layer->activation == DL2C_RELU) {
        dl2c_lines_of_relu(l, i, k, low, high);
      } else if (layer->activation == DL2C_HYPERBOLIC) {
        dl2c_lines_of_tanh(l, i, k, low, high);
        l->after[i][k] = n->library;
      } else {
        l->slope[0][i][k] = l->slope[1][i][k] = 1.0;
        l->offset[0][i][k] = l->offset[1][i][k] = 0.0;
      }
      const double slope = l->slope[1][i][k];
      const double above = l->offset[1][i][k];
      const double below = layer->activation == DL2C_HYPERBOLIC ? l->offset[0][i][k] : 0.0;
      const double rounding = (slope * extent + fabs(above) + fabs(below)) * 0x1p-49 + DBL_MIN;
      f->part[0][i][k] = slope * f->part[0][i][k] + 0.5 * (above + below);
      for (int d = 0; d < n->dimensions; d++) f->part[1 + d][i][k] *= slope;
      const double gap = dl2c_greater(0.0, above - below);
      f->radius[i][k] = (slope * f->radius[i][k] + 0.5 * gap + rounding + l->after[i][k]) * DL2C_ENLARGED;
      double size = fabs(f->part[0][i][k]) + f->radius[i][k];
      for (int d = 0; d < n->dimensions; d++) size += fabs(f->part[1 + d][i][k]);
      f->size[i][k] = size * DL2C_ENLARGED;
    }
}

#endif
