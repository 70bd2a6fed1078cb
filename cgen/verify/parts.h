/* SPDX-License-Identifier: MIT-0 */
/* parts.h -- parts of a search by themselves, for measurements. */
#ifndef DL2C_PARTS_H
#define DL2C_PARTS_H

#include "search.h"

/* The outputs on each box, low and high: what the network contributes to verdicts, by itself. */
static bool dl2c_ranges(const dl2c_question *q, const double *boxes, int64_t count, double *ranges)
{
  dl2c_workspace *w = calloc(1, sizeof *w);
  if (w == NULL) return false;
  const int dimensions = q->network.dimensions;
  for (int64_t first = 0; first < count; first += DL2C_LANES_OF_BOXES) {
    const int lanes = count - first < DL2C_LANES_OF_BOXES ? (int)(count - first) : DL2C_LANES_OF_BOXES;
    DL2C_EACH_LANE
    {
      const double *box = boxes + 2 * dimensions * (first + (k < lanes ? k : 0));
      for (int d = 0; d < dimensions; d++) dl2c_place(w, k, d, box[2 * d], box[2 * d + 1]);
    }
    dl2c_bounds(&q->network, w);
    for (int k = 0; k < lanes; k++)
      for (int o = 0; o < q->network.outputs; o++) {
        const dl2c_span range = dl2c_output_range(q, w, k, o, -1);
        *ranges++ = range.low;
        *ranges++ = range.high;
      }
  }
  free(w);
  return true;
}

/* How many boxes have states of the hypothesis, as far as contraction tells. */
static int64_t dl2c_inside(const dl2c_question *q, const double *boxes, int64_t count)
{
  double point[DL2C_MOST_DIMENSIONS];
  int64_t inside = 0;
  for (int64_t i = 0; i < count; i++)
    inside += dl2c_middle(q, boxes + 2 * q->network.dimensions * i, point);
  return inside;
}

#endif
