/* SPDX-License-Identifier: MIT-0 */
/*
 * formula.h -- conditions as tables: whether they hold on a box, and which part of a box they leave.
 *
 * An atom compares the values of two steps of its own run of steps, each of which is an operation on
 * steps before it. Formulas are atoms joined by "and" and "or", in negation normal form; an atom with an
 * undefined term is false. A box is a span for every symbol.
 */
#ifndef DL2C_FORMULA_H
#define DL2C_FORMULA_H

#include "span.h"

#include <stdint.h>

enum { DL2C_MOST_STEPS = 400, DL2C_MOST_SYMBOLS = 32, DL2C_ROUNDS = 4 };

typedef enum dl2c_operation {
  DL2C_NUMBER,
  DL2C_SYMBOL,
  DL2C_NEGATIVE,
  DL2C_ADD,
  DL2C_SUBTRACT,
  DL2C_MULTIPLY,
  DL2C_DIVIDE,
  DL2C_POWER,
  DL2C_ROOT,
  DL2C_ABS,
  DL2C_MIN,
  DL2C_MAX,
  DL2C_SIN,
  DL2C_COS,
  DL2C_EXP,
  DL2C_TANH,
  DL2C_DIVIDE_NONZERO,
} dl2c_operation;

/* `left` and `right` count from the first step of the atom; of a symbol `left` is its number, of a power
 * `right` is the exponent, of a number `low` and `high` enclose it. The divisor of DL2C_DIVIDE_NONZERO is
 * not 0, though its span may have 0 in it. */
typedef struct dl2c_operation_step {
  int32_t operation, left, right;
  double low, high;
} dl2c_operation_step;

typedef enum dl2c_comparison { DL2C_LT, DL2C_LE, DL2C_EQ, DL2C_NE } dl2c_comparison;

typedef struct dl2c_atom {
  int32_t comparison, first, count, left, right;
} dl2c_atom;

typedef enum dl2c_junction { DL2C_ATOM, DL2C_ALL, DL2C_SOME } dl2c_junction;

/* Of an atom `first` is its number; else the parts are those that `parts` lists from `first` on. No
 * parts: "all" is true, "some" is false. */
typedef struct dl2c_node {
  int32_t kind, first, count;
} dl2c_node;

typedef struct dl2c_formulas {
  const dl2c_operation_step *steps;
  const dl2c_atom *atoms;
  const dl2c_node *nodes;
  const int32_t *parts;
  int32_t symbols;
} dl2c_formulas;

static dl2c_span dl2c_step_value(const dl2c_operation_step *s, const dl2c_span *box, const dl2c_span *v)
{
  switch (s->operation) {
    case DL2C_NUMBER: return dl2c_span_of(s->low, s->high, true);
    case DL2C_SYMBOL: return box[s->left];
    case DL2C_NEGATIVE: return dl2c_negative(v[s->left]);
    case DL2C_ADD: return dl2c_sum(v[s->left], v[s->right]);
    case DL2C_SUBTRACT: return dl2c_difference(v[s->left], v[s->right]);
    case DL2C_MULTIPLY:
      return s->left == s->right ? dl2c_power(v[s->left], 2) : dl2c_product(v[s->left], v[s->right]);
    case DL2C_DIVIDE: return dl2c_quotient(v[s->left], v[s->right]);
    case DL2C_DIVIDE_NONZERO: {
      dl2c_span both = dl2c_quotient(v[s->left], v[s->right]);
      both.total = v[s->left].total && v[s->right].total && !dl2c_is_empty(both);
      return both;
    }
    case DL2C_POWER: return dl2c_power(v[s->left], s->right);
    case DL2C_ROOT: return dl2c_root(v[s->left]);
    case DL2C_ABS: return dl2c_magnitude(v[s->left]);
    case DL2C_MIN: return dl2c_least(v[s->left], v[s->right]);
    case DL2C_MAX: return dl2c_greatest(v[s->left], v[s->right]);
    case DL2C_SIN: return dl2c_wave(v[s->left], sin);
    case DL2C_COS: return dl2c_wave(v[s->left], cos);
    case DL2C_EXP: return dl2c_rising(v[s->left], exp, 0.0, INFINITY);
    default: return dl2c_rising(v[s->left], tanh, -1.0, 1.0);
  }
}

static void dl2c_atom_values(const dl2c_formulas *f, const dl2c_atom *a, const dl2c_span *box,
                             dl2c_span *values)
{
  for (int32_t k = 0; k < a->count; k++)
    values[k] = dl2c_step_value(f->steps + a->first + k, box, values);
}

static int dl2c_compared(int32_t comparison, dl2c_span left, dl2c_span right)
{
  if (dl2c_is_empty(left) || dl2c_is_empty(right)) return DL2C_FALSE;
  int truth;
  switch (comparison) {
    case DL2C_LT: truth = dl2c_less(left, right); break;
    case DL2C_LE: truth = dl2c_at_most(left, right); break;
    case DL2C_NE: truth = dl2c_unequal(left, right); break;
    default: truth = DL2C_TRUE - dl2c_unequal(left, right); break;
  }
  return truth == DL2C_TRUE && !(left.total && right.total) ? DL2C_UNDECIDED : truth;
}

/* Whether a formula holds everywhere on a box, nowhere, or neither is known. */
static int dl2c_judged(const dl2c_formulas *f, int32_t node, const dl2c_span *box)
{
  const dl2c_node *n = f->nodes + node;
  if (n->kind == DL2C_ATOM) {
    dl2c_span values[DL2C_MOST_STEPS];
    const dl2c_atom *a = f->atoms + n->first;
    dl2c_atom_values(f, a, box, values);
    return dl2c_compared(a->comparison, values[a->left], values[a->right]);
  }
  const bool all = n->kind == DL2C_ALL;
  int truth = all ? DL2C_TRUE : DL2C_FALSE;
  for (int32_t k = 0; k < n->count; k++) {
    const int part = dl2c_judged(f, f->parts[n->first + k], box);
    if (all ? part < truth : part > truth) truth = part;
    if (truth == (all ? DL2C_FALSE : DL2C_TRUE)) break;
  }
  return truth;
}

static bool dl2c_narrowed(dl2c_span *value, dl2c_span target)
{
  value->low = dl2c_greater(value->low, target.low);
  value->high = dl2c_lesser(value->high, target.high);
  return value->low <= value->high;
}

/* factor * other = product. Nothing follows where `other` may be 0 and `product` too. */
static bool dl2c_narrow_factor(dl2c_span *factor, dl2c_span product, dl2c_span other)
{
  if (dl2c_has_zero(product) && dl2c_has_zero(other)) return true;
  dl2c_span kept = dl2c_span_empty();
  for (int part = -1; part <= 1; part += 2) {
    dl2c_span piece = dl2c_quotient_part(product, other, part);
    if (!dl2c_is_empty(piece) && dl2c_narrowed(&piece, *factor)) kept = dl2c_hull_of_both(kept, piece);
  }
  return dl2c_narrowed(factor, kept);
}

/* |value| lies in `size`. */
static bool dl2c_narrow_mirrored(dl2c_span *value, dl2c_span size)
{
  dl2c_span positive = size, negative = dl2c_negative(size), kept = dl2c_span_empty();
  if (dl2c_narrowed(&positive, *value)) kept = positive;
  if (dl2c_narrowed(&negative, *value)) kept = dl2c_hull_of_both(kept, negative);
  return dl2c_narrowed(value, kept);
}

/* Narrow the operands of a step to where its value may be what it was narrowed to. */
static bool dl2c_narrow_operands(const dl2c_operation_step *s, dl2c_span target, dl2c_span *v)
{
  dl2c_span *a = v + s->left, *b = v + s->right;
  switch (s->operation) {
    case DL2C_NEGATIVE: return dl2c_narrowed(a, dl2c_negative(target));
    case DL2C_ADD:
      return dl2c_narrowed(a, dl2c_difference(target, *b)) && dl2c_narrowed(b, dl2c_difference(target, *a));
    case DL2C_SUBTRACT:
      return dl2c_narrowed(a, dl2c_sum(target, *b)) && dl2c_narrowed(b, dl2c_difference(*a, target));
    case DL2C_MULTIPLY:
      if (s->left != s->right)
        return dl2c_narrow_factor(a, target, *b) && dl2c_narrow_factor(b, target, *a);
      return dl2c_narrow_mirrored(a, dl2c_root(target));
    case DL2C_DIVIDE:
    case DL2C_DIVIDE_NONZERO:
      return dl2c_narrowed(a, dl2c_product(target, *b)) && dl2c_narrow_factor(b, *a, target);
    case DL2C_POWER: return s->right != 2 || dl2c_narrow_mirrored(a, dl2c_root(target));
    case DL2C_ROOT:
      target = dl2c_meet(target, dl2c_span_of(0.0, INFINITY, true));
      return dl2c_narrowed(a, dl2c_power(target, 2));
    case DL2C_ABS: return dl2c_narrow_mirrored(a, dl2c_meet(target, dl2c_span_of(0.0, INFINITY, true)));
    default: return true;
  }
}

static bool dl2c_narrow_atom(const dl2c_formulas *f, const dl2c_atom *a, dl2c_span *box)
{
  dl2c_span values[DL2C_MOST_STEPS];
  dl2c_atom_values(f, a, box, values);
  dl2c_span *left = values + a->left, *right = values + a->right;
  if (dl2c_compared(a->comparison, *left, *right) == DL2C_FALSE) return false;
  if (a->comparison == DL2C_NE) return true;
  if (!dl2c_narrowed(left, dl2c_span_of(-INFINITY, right->high, true))) return false;
  if (!dl2c_narrowed(right, dl2c_span_of(left->low, INFINITY, true))) return false;
  if (a->comparison == DL2C_EQ && !(dl2c_narrowed(left, *right) && dl2c_narrowed(right, *left)))
    return false;
  for (int32_t k = a->count - 1; k >= 0; k--) {
    const dl2c_operation_step *s = f->steps + a->first + k;
    if (s->operation == DL2C_SYMBOL) {
      if (!dl2c_narrowed(box + s->left, values[k])) return false;
    } else if (s->operation != DL2C_NUMBER && !dl2c_narrow_operands(s, values[k], values))
      return false;
  }
  return true;
}

/* Shrink a box without losing a point at which the formula holds; false where there is none. */
static bool dl2c_contract(const dl2c_formulas *f, int32_t node, dl2c_span *box)
{
  const dl2c_node *n = f->nodes + node;
  if (n->kind == DL2C_ATOM) return dl2c_narrow_atom(f, f->atoms + n->first, box);
  if (n->kind == DL2C_ALL) {
    const int rounds = n->count > 1 ? DL2C_ROUNDS : 1;
    for (int round = 0; round < rounds; round++)
      for (int32_t k = 0; k < n->count; k++)
        if (!dl2c_contract(f, f->parts[n->first + k], box)) return false;
    return true;
  }
  dl2c_span around[DL2C_MOST_SYMBOLS];
  bool any = false;
  for (int32_t k = 0; k < n->count; k++) {
    dl2c_span part[DL2C_MOST_SYMBOLS];
    for (int32_t s = 0; s < f->symbols; s++) part[s] = box[s];
    if (!dl2c_contract(f, f->parts[n->first + k], part)) continue;
    for (int32_t s = 0; s < f->symbols; s++)
      around[s] = any ? dl2c_hull_of_both(around[s], part[s]) : part[s];
    any = true;
  }
  for (int32_t s = 0; any && s < f->symbols; s++) box[s] = around[s];
  return any;
}

#endif
