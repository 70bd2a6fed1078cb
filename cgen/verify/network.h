/* SPDX-License-Identifier: MIT-0 */
/*
 * network.h -- linear bounds of a network's outputs on a box, with an error that holds every rounding.
 *
 * Forms go forward through the layers (forms.h); then linear bounds of each output go backward, which keeps
 * signs that forms lose (Zhang, Weng, Chen, Hsieh, Daniel: "Efficient neural network robustness
 * certification", NeurIPS 2018).
 */
#ifndef DL2C_NETWORK_H
#define DL2C_NETWORK_H

#include "forms.h"

/* row * weight, added up for each column. */
DL2C_FOR_LANES DL2C_FUSED static void dl2c_row_times(const dl2c_layer *layer, dl2c_lane *row, dl2c_lane *made)
{
  const size_t columns = (size_t)layer->columns, rows = (size_t)layer->rows;
  for (size_t first = 0; first < columns; first += DL2C_TOGETHER) {
    const size_t count = columns - first < DL2C_TOGETHER ? columns - first : DL2C_TOGETHER;
    dl2c_four sum[DL2C_TOGETHER] = {{0.0}}, other[DL2C_TOGETHER] = {{0.0}};
    size_t at[DL2C_TOGETHER];
    for (size_t c = 0; c < DL2C_TOGETHER; c++) at[c] = first + (c < count ? c : 0);
    for (size_t j = 0; j < rows; j++)
      for (size_t c = 0; c < DL2C_TOGETHER; c++) {
        const double factor = layer->weight[j * columns + at[c]];
        sum[c] += factor * DL2C_FIRST_FOUR(row[j]);
        other[c] += factor * DL2C_OTHER_FOUR(row[j]);
      }
    for (size_t c = 0; c < count; c++) {
      DL2C_FIRST_FOUR(made[first + c]) = sum[c];
      DL2C_OTHER_FOUR(made[first + c]) = other[c];
    }
  }
}

/*
 * A linear bound, from above, of `sign` times an output. Going back through a layer, `row * f(z)` is at most
 * `row * (slope * z + offset)` with the line above where the row is positive, else the one below, and z is
 * a sum of the layer before. Errors of a layer are multiples of its `scope`.
 */
DL2C_FOR_LANES static void dl2c_bounded(const dl2c_network *n, dl2c_workspace *w, const dl2c_output *output, double sign,
                         dl2c_linear *bound)
{
  const dl2c_layer *last = n->layer + n->layers - 1;
  dl2c_lane constant, error;
  for (int i = 0; i < last->rows; i++) {
    const double chosen = i == output->index ? sign : i == output->other ? -sign : 0.0;
    DL2C_EACH_LANE w->row[i][k] = chosen;
  }
  DL2C_EACH_LANE constant[k] = error[k] = 0.0;
  for (int at = n->layers - 1; at >= 0; at--) {
    const dl2c_layer *layer = n->layer + at;
    const dl2c_lines *l = w->lines + at;
    const double own = 4.0 * (double)(layer->columns + layer->rows + 8) * 0x1p-53;
    for (int j = 0; j < layer->rows; j++)
      DL2C_EACH_LANE
      {
        const double factor = w->row[j][k], size = fabs(factor);
        const bool above = factor > 0.0;
        const double slope = above ? l->slope[1][j][k] : l->slope[0][j][k];
        const double offset = above ? l->offset[1][j][k] : l->offset[0][j][k];
        const double steep = size * slope;
        constant[k] += factor * offset + (factor * slope) * layer->bias[j];
        error[k] += size * l->after[j][k] + steep * l->error[j][k]
                    + own * (size * fabs(offset) + steep * (l->scope[j][k] + l->extent[j][k])) + DBL_MIN;
        w->row[j][k] = factor * slope;
      }
    DL2C_EACH_LANE error[k] += own * fabs(constant[k]);
    dl2c_row_times(layer, w->row, w->next);
    memcpy(w->row, w->next, (size_t)layer->columns * sizeof *w->row);
  }
  const double own = 4.0 * (double)(n->observations + 8) * 0x1p-53;
  for (int d = 0; d < n->dimensions; d++) DL2C_EACH_LANE bound->slope[d][k] = 0.0;
  for (int i = 0; i < n->observations; i++)
    DL2C_EACH_LANE
    {
      const double factor = w->row[i][k];
      constant[k] += factor * w->observed.part[0][i][k];
      for (int d = 0; d < n->dimensions; d++)
        bound->slope[d][k] += factor * w->observed.part[1 + d][i][k];
      error[k] += fabs(factor) * (w->observed.radius[i][k] + own * w->observed.size[i][k]) + DBL_MIN;
    }
  DL2C_EACH_LANE
  bound->constant[k] = constant[k] + (error[k] + own * fabs(constant[k])) * DL2C_ENLARGED;
}

/* The outputs at a point, computed in doubles: what the program in doubles computes, but for scalings. */
static void dl2c_outputs(const dl2c_network *n, const double *point, double *result)
{
  double given[DL2C_MOST_WIDTH], made[DL2C_MOST_WIDTH];
  for (int i = 0; i < n->observations; i++) {
    const dl2c_observation *o = n->observation + i;
    given[i] = o->dimension >= 0 ? point[o->dimension] : o->value;
    for (int s = 0; s < o->scales; s++) {
      const dl2c_scale *scale = o->scale + s;
      given[i] = scale->slope * given[i] + scale->offset;
      given[i] = dl2c_lesser(dl2c_greater(given[i], scale->low), scale->high);
    }
  }
  for (int at = 0; at < n->layers; at++) {
    const dl2c_layer *layer = n->layer + at;
    for (int i = 0; i < layer->rows; i++) {
      double sum = layer->bias[i];
      for (int j = 0; j < layer->columns; j++)
        sum += layer->weight[(size_t)i * (size_t)layer->columns + (size_t)j] * given[j];
      const bool bent = layer->activation == DL2C_RELU && !(sum > 0.0);
      made[i] = bent ? 0.0 : layer->activation == DL2C_HYPERBOLIC ? tanh(sum) : sum;
    }
    memcpy(given, made, (size_t)layer->rows * sizeof *given);
  }
  for (int k = 0; k < n->outputs; k++) {
    const dl2c_output *o = n->output + k;
    const double value = given[o->index] - (o->other >= 0 ? given[o->other] : 0.0);
    result[k] = o->scale.slope * value + o->scale.offset;
  }
}

/* Whether all magnitudes of a lane are below what the program can hold. */
static bool dl2c_moderate(const dl2c_network *n, const dl2c_workspace *w, int k)
{
  bool moderate = true;
  for (int at = 0; at < n->layers; at++)
    for (int i = 0; i < n->layer[at].rows; i++)
      moderate = moderate && w->lines[at].scope[i][k] < n->largest && w->lines[at].error[i][k] < n->largest
                 && w->lines[at].extent[i][k] < n->largest;
  return moderate;
}

/* Linear bounds of all outputs on the boxes in `middle` and `half`: bound[1] above, bound[0] of the negative
 * values above. `known` says for which lanes they hold. */
static void dl2c_bounds(const dl2c_network *n, dl2c_workspace *w)
{
  dl2c_observe(n, w);
  dl2c_forms *given = &w->observed;
  for (int at = 0; at < n->layers; at++) {
    dl2c_forms *made = w->forms + at % 2;
    dl2c_sums(n, n->layer + at, given, made, w->lines + at);
    dl2c_activated(n, n->layer + at, made, w->lines + at);
    given = made;
  }
  for (int o = 0; o < n->outputs; o++) {
    dl2c_bounded(n, w, n->output + o, 1.0, w->bound[1] + o);
    dl2c_bounded(n, w, n->output + o, -1.0, w->bound[0] + o);
  }
  DL2C_EACH_LANE w->known[k] = dl2c_moderate(n, w, k);
}

#endif
