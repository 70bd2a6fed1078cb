/* SPDX-License-Identifier: MIT-0 */
/*
 * search.h -- what is known of a policy on each of many boxes of states.
 *
 * A box is `outside` where no state of it satisfies the hypothesis, `proved` where in each case that the
 * outputs leave possible the conclusion of that case holds, and else `open`. Every box is judged by itself,
 * so that answers do not depend on which thread judges which. Nothing is allocated for a box.
 */
#ifndef DL2C_SEARCH_H
#define DL2C_SEARCH_H

#include "network.h"

#include <stdlib.h>

#ifndef DL2C_NO_THREADS
#include <pthread.h>
#include <stdatomic.h>
#endif

enum { DL2C_BOXES = 64, DL2C_MOST_WORKERS = 64, DL2C_MOST_OUTPUTS = 64 };

typedef enum dl2c_verdict { DL2C_OPEN, DL2C_OUTSIDE, DL2C_PROVED, DL2C_SUSPECT } dl2c_verdict;

/* An output that is between `low` and `high`, both excluded where it is `inside`. It gives a value to a
 * symbol, or to none (-1). */
typedef struct dl2c_premise {
  int32_t output, inside, symbol;
  double low, high;
} dl2c_premise;

/* What must hold where all premises do. */
typedef struct dl2c_case {
  int32_t first, count, conclusion;
} dl2c_case;

/* The last dimensions are `computed`: the hypothesis says what they are of the others. */
typedef struct dl2c_question {
  dl2c_formulas formulas;
  dl2c_network network;
  int32_t hypothesis, cases, computed;
  const dl2c_case *each;
  const dl2c_premise *premises;
} dl2c_question;

/* The outputs on a box. With `without` >= 0 that dimension stays in the middle. */
static dl2c_span dl2c_output_range(const dl2c_question *q, const dl2c_workspace *w, int lane, int output,
                                   int without)
{
  if (!w->known[lane]) return dl2c_span_of(-INFINITY, INFINITY, true);
  const dl2c_linear *up = w->bound[1] + output, *down = w->bound[0] + output;
  double above = 0.0, below = 0.0;
  for (int d = 0; d < q->network.dimensions; d++) {
    if (d == without) continue;
    above += fabs(up->slope[d][lane]);
    below += fabs(down->slope[d][lane]);
  }
  const double high = dl2c_add_up(up->constant[lane], above * DL2C_ENLARGED);
  const double low = -dl2c_add_up(down->constant[lane], below * DL2C_ENLARGED);
  const dl2c_scale *s = &q->network.output[output].scale;
  const double most = dl2c_greater(fabs(low), fabs(high));
  const double error = 16.0 * (0x1p-53 + q->network.unit) * (fabs(s->slope) * most + s->size)
                       + 16.0 * (q->network.tiny + DBL_MIN);
  const double reach = error * DL2C_ENLARGED;
  const double first = s->slope * (s->slope < 0.0 ? high : low) + s->offset;
  const double last = s->slope * (s->slope < 0.0 ? low : high) + s->offset;
  return dl2c_span_of(dl2c_add_down(first, -reach), dl2c_add_up(last, reach), true);
}

/* Whether the premises of a case may hold; gives symbols their values. */
static bool dl2c_possible(const dl2c_question *q, const dl2c_case *c, const dl2c_span *outputs,
                          dl2c_span *box)
{
  for (int32_t p = c->first; p < c->first + c->count; p++) {
    const dl2c_premise *premise = q->premises + p;
    const dl2c_span given = outputs[premise->output];
    const double low = dl2c_greater(given.low, premise->low), high = dl2c_lesser(given.high, premise->high);
    if (low > high || (premise->inside && (given.high <= premise->low || given.low >= premise->high)))
      return false;
    if (premise->symbol >= 0) box[premise->symbol] = dl2c_span_of(low, high, true);
  }
  return true;
}

/* Whether every case that is possible ends well: everywhere, or, where `nowhere`, for no point in one. */
static bool dl2c_ends_well(const dl2c_question *q, const dl2c_span *outputs, dl2c_span *box, bool nowhere)
{
  for (int32_t c = 0; c < q->cases; c++) {
    const dl2c_case *one = q->each + c;
    if (!dl2c_possible(q, one, outputs, box)) continue;
    const int truth = dl2c_judged(&q->formulas, one->conclusion, box);
    if (nowhere ? truth == DL2C_FALSE : truth != DL2C_TRUE) return false;
  }
  return true;
}

/* Whether the middle of a box, of which not all is proved, seems to violate the claim. */
static bool dl2c_suspect(const dl2c_question *q, const dl2c_span *box)
{
  dl2c_span point[DL2C_MOST_SYMBOLS], outputs[DL2C_MOST_OUTPUTS];
  double at[DL2C_MOST_DIMENSIONS], found[DL2C_MOST_OUTPUTS];
  for (int s = 0; s < q->formulas.symbols; s++)
    point[s] = s < q->network.dimensions ? box[s] : dl2c_span_of(-INFINITY, INFINITY, true);
  for (int d = 0; d < q->network.dimensions; d++) {
    const bool computed = d >= q->network.dimensions - q->computed;
    if (computed && !dl2c_contract(&q->formulas, q->hypothesis, point)) return false;
    const dl2c_span around = computed ? point[d] : box[d];
    at[d] = around.low + 0.5 * (around.high - around.low);
    point[d] = dl2c_span_of(at[d], at[d], true);
  }
  if (dl2c_judged(&q->formulas, q->hypothesis, point) == DL2C_FALSE) return false;
  dl2c_outputs(&q->network, at, found);
  for (int o = 0; o < q->network.outputs; o++) outputs[o] = dl2c_span_of(found[o], found[o], true);
  return !dl2c_ends_well(q, outputs, point, true);
}

/* The widths of undecided atoms of a formula, each as a share of that in `full`. */
static double dl2c_vagueness(const dl2c_formulas *f, int32_t node, const dl2c_span *full,
                             const dl2c_span *box)
{
  const dl2c_node *n = f->nodes + node;
  double sum = 0.0;
  if (n->kind != DL2C_ATOM) {
    for (int32_t k = 0; k < n->count; k++)
      sum += dl2c_vagueness(f, f->parts[n->first + k], full, box);
    return sum;
  }
  const dl2c_atom *a = f->atoms + n->first;
  dl2c_span values[DL2C_MOST_STEPS];
  dl2c_atom_values(f, a, full, values);
  const dl2c_span left = values[a->left], right = values[a->right];
  if (dl2c_compared(a->comparison, left, right) != DL2C_UNDECIDED) return 0.0;
  const double before = (left.high - left.low) + (right.high - right.low);
  dl2c_atom_values(f, a, box, values);
  const dl2c_span first = values[a->left], second = values[a->right];
  const double after = (first.high - first.low) + (second.high - second.low);
  if (isinf(before)) return isinf(after) ? 1.0 : 0.5;
  return before > 0.0 ? after / before : 0.0;
}

/* The middle of what the hypothesis leaves of a box; false where it leaves nothing. */
static bool dl2c_middle(const dl2c_question *q, const double *given, double *point)
{
  dl2c_span box[DL2C_MOST_SYMBOLS];
  for (int s = 0; s < q->formulas.symbols; s++) box[s] = dl2c_span_of(-INFINITY, INFINITY, true);
  for (int d = 0; d < q->network.dimensions; d++)
    box[d] = dl2c_span_of(given[2 * d], given[2 * d + 1], true);
  if (!dl2c_contract(&q->formulas, q->hypothesis, box)) return false;
  for (int d = 0; d < q->network.dimensions; d++)
    point[d] = box[d].low + 0.5 * (box[d].high - box[d].low);
  return true;
}

/* How much narrower an output becomes where what is computed has other limits than in its box. */
static double dl2c_computed_less(const dl2c_question *q, const dl2c_workspace *w, int lane, int output,
                                 const dl2c_span *box, const dl2c_span *thin)
{
  if (!w->known[lane]) return 0.0;
  const dl2c_linear *up = w->bound[1] + output, *down = w->bound[0] + output;
  const double slope = fabs(q->network.output[output].scale.slope);
  double less = 0.0;
  for (int d = q->network.dimensions - q->computed; d < q->network.dimensions; d++) {
    const double width = box[d].high - box[d].low;
    const double share = width > 0.0 ? (thin[d].high - thin[d].low) / width : 1.0;
    less += (1.0 - share) * slope * (fabs(up->slope[d][lane]) + fabs(down->slope[d][lane]));
  }
  return less;
}

/* What is left undecided when a box is reduced to the middle of one dimension. */
static double dl2c_left_open(const dl2c_question *q, const dl2c_workspace *w, int lane, const dl2c_span *box,
                             int dimension)
{
  dl2c_span full[DL2C_MOST_SYMBOLS], thin[DL2C_MOST_SYMBOLS];
  dl2c_span wide[DL2C_MOST_OUTPUTS], narrow[DL2C_MOST_OUTPUTS];
  for (int s = 0; s < q->formulas.symbols; s++)
    full[s] = thin[s] = s < q->network.dimensions ? box[s] : dl2c_span_of(-INFINITY, INFINITY, true);
  const double middle = box[dimension].low + 0.5 * (box[dimension].high - box[dimension].low);
  thin[dimension] = dl2c_span_of(middle, middle, true);
  if (q->computed > 0 && !dl2c_contract(&q->formulas, q->hypothesis, thin)) return 0.0;
  for (int o = 0; o < q->network.outputs; o++) {
    wide[o] = dl2c_output_range(q, w, lane, o, -1);
    narrow[o] = dl2c_output_range(q, w, lane, o, dimension);
    if (q->computed > 0) {
      const double less = 0.5 * dl2c_computed_less(q, w, lane, o, box, thin);
      narrow[o].low += less;
      narrow[o].high -= less;
    }
  }
  double sum = 0.0;
  for (int32_t c = 0; c < q->cases; c++) {
    const dl2c_case *one = q->each + c;
    if (!dl2c_possible(q, one, wide, full)) continue;
    for (int32_t p = one->first; p < one->first + one->count; p++) {
      const int32_t o = q->premises[p].output;
      const double before = wide[o].high - wide[o].low;
      if (before > 0.0 && !isinf(before)) sum += (narrow[o].high - narrow[o].low) / before;
    }
    if (!dl2c_possible(q, one, narrow, thin)) continue;
    sum += dl2c_vagueness(&q->formulas, one->conclusion, full, thin);
  }
  return sum;
}

/* The dimension along which a box is to be split: the one without which least is undecided. */
static uint8_t dl2c_split_along(const dl2c_question *q, const dl2c_workspace *w, int lane,
                                const dl2c_span *box, const double *given)
{
  int best = -1;
  double least = INFINITY;
  for (int d = 0; d < q->network.dimensions - q->computed; d++) {
    const double middle = given[2 * d] + 0.5 * (given[2 * d + 1] - given[2 * d]);
    if (!(given[2 * d] < middle && middle < given[2 * d + 1])) continue;
    const double open = dl2c_left_open(q, w, lane, box, d);
    if (best < 0 || open < least) {
      best = d;
      least = open;
    }
  }
  return best < 0 ? 255 : (uint8_t)best;
}

/* Put one dimension of a box into a lane: its middle, and how far it reaches from there. */
static void dl2c_place(dl2c_workspace *w, int lane, int dimension, double low, double high)
{
  const double middle = low + 0.5 * (high - low);
  w->middle[dimension][lane] = middle;
  w->half[dimension][lane] = dl2c_greater(dl2c_add_up(high, -middle), dl2c_add_up(middle, -low));
}

/* Judge up to DL2C_LANES_OF_BOXES boxes that are not outside. `given` are the boxes before contraction. */
static void dl2c_judge_lanes(const dl2c_question *q, dl2c_workspace *w, int count,
                             dl2c_span boxes[][DL2C_MOST_SYMBOLS], const double *const *given,
                             uint8_t *const *verdicts, uint8_t *const *splits)
{
  DL2C_EACH_LANE
  {
    const dl2c_span *box = boxes[k < count ? k : count - 1];
    for (int d = 0; d < q->network.dimensions; d++) dl2c_place(w, k, d, box[d].low, box[d].high);
  }
  dl2c_bounds(&q->network, w);
  for (int k = 0; k < count; k++) {
    dl2c_span outputs[DL2C_MOST_OUTPUTS];
    for (int o = 0; o < q->network.outputs; o++) outputs[o] = dl2c_output_range(q, w, k, o, -1);
    if (dl2c_ends_well(q, outputs, boxes[k], false)) {
      *verdicts[k] = DL2C_PROVED;
      continue;
    }
    *verdicts[k] = dl2c_suspect(q, boxes[k]) ? DL2C_SUSPECT : DL2C_OPEN;
    *splits[k] = dl2c_split_along(q, w, k, boxes[k], given[k]);
  }
}

/* Judge boxes `first` to `first + count`: each is low and high of every dimension. */
static void dl2c_judge_boxes(const dl2c_question *q, dl2c_workspace *w, const double *boxes, int64_t first,
                             int64_t count, uint8_t *verdicts, uint8_t *splits)
{
  const int dimensions = q->network.dimensions;
  dl2c_span lanes[DL2C_LANES_OF_BOXES][DL2C_MOST_SYMBOLS];
  const double *given[DL2C_LANES_OF_BOXES];
  uint8_t *verdict[DL2C_LANES_OF_BOXES], *split[DL2C_LANES_OF_BOXES];
  int filled = 0;
  for (int64_t i = first; i < first + count; i++) {
    const double *box = boxes + 2 * dimensions * i;
    dl2c_span *lane = lanes[filled];
    for (int s = 0; s < q->formulas.symbols; s++) lane[s] = dl2c_span_of(-INFINITY, INFINITY, true);
    for (int d = 0; d < dimensions; d++) lane[d] = dl2c_span_of(box[2 * d], box[2 * d + 1], true);
    splits[i] = 255;
    verdicts[i] = DL2C_OUTSIDE;
    if (dl2c_contract(&q->formulas, q->hypothesis, lane)) {
      given[filled] = box;
      verdict[filled] = verdicts + i;
      split[filled] = splits + i;
      filled++;
    }
    if (filled == DL2C_LANES_OF_BOXES || (filled > 0 && i + 1 == first + count)) {
      dl2c_judge_lanes(q, w, filled, lanes, given, verdict, split);
      filled = 0;
    }
  }
}

/* What threads share. */
typedef struct dl2c_shared_work {
  const dl2c_question *question;
  const double *boxes;
  int64_t count;
  uint8_t *verdicts, *splits;
#ifndef DL2C_NO_THREADS
  atomic_llong next;
#else
  long long next;
#endif
} dl2c_shared_work;

typedef struct dl2c_worker {
  dl2c_shared_work *work;
  dl2c_workspace *memory;
} dl2c_worker;

static void *dl2c_work_through(void *argument)
{
  const dl2c_worker *worker = argument;
  dl2c_shared_work *work = worker->work;
  for (;;) {
#ifndef DL2C_NO_THREADS
    const int64_t first = atomic_fetch_add(&work->next, DL2C_BOXES);
#else
    const int64_t first = work->next;
    work->next += DL2C_BOXES;
#endif
    if (first >= work->count) return NULL;
    const int64_t rest = work->count - first;
    dl2c_judge_boxes(work->question, worker->memory, work->boxes, first,
                     rest < DL2C_BOXES ? rest : DL2C_BOXES, work->verdicts, work->splits);
  }
}

/* Judge boxes with so many threads; false where there is no memory. */
static bool dl2c_judge(const dl2c_question *q, const double *boxes, int64_t count, uint8_t *verdicts,
                       uint8_t *splits, int threads)
{
  dl2c_shared_work work = {q, boxes, count, verdicts, splits, 0};
  dl2c_worker workers[DL2C_MOST_WORKERS];
  const int most = threads < 1 ? 1 : threads > DL2C_MOST_WORKERS ? DL2C_MOST_WORKERS : threads;
  int ready = 0;
  for (; ready < most; ready++) {
    workers[ready].work = &work;
    workers[ready].memory = calloc(1, sizeof(dl2c_workspace));
    if (workers[ready].memory == NULL) break;
  }
  if (ready == 0) return false;
#ifndef DL2C_NO_THREADS
  pthread_t ids[DL2C_MOST_WORKERS];
  int begun = 1;
  while (begun < ready && pthread_create(ids + begun, NULL, dl2c_work_through, workers + begun) == 0)
    begun++;
  (void)dl2c_work_through(workers);
  for (int t = 1; t < begun; t++) pthread_join(ids[t], NULL);
#else
  (void)dl2c_work_through(workers);
#endif
  for (int t = 0; t < ready; t++) free(workers[t].memory);
  return true;
}

/* Linear bounds of the outputs on one box, before their scales: `linear` gets for each output, below and
 * above, the constant and the slopes, over t between -1 and 1. */
static bool dl2c_linear_bounds(const dl2c_question *q, const double *box, double *linear)
{
  dl2c_workspace *w = calloc(1, sizeof *w);
  if (w == NULL) return false;
  const int dimensions = q->network.dimensions;
  for (int d = 0; d < dimensions; d++) DL2C_EACH_LANE dl2c_place(w, k, d, box[2 * d], box[2 * d + 1]);
  dl2c_bounds(&q->network, w);
  for (int o = 0; o < q->network.outputs; o++)
    for (int side = 0; side < 2; side++) {
      const dl2c_linear *bound = w->bound[side] + o;
      const double sign = side == 0 ? -1.0 : 1.0;
      *linear++ = sign * bound->constant[0];
      for (int d = 0; d < dimensions; d++) *linear++ = sign * bound->slope[d][0];
    }
  const bool known = w->known[0];
  free(w);
  return known;
}

#endif
