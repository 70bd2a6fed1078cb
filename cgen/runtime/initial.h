/* SPDX-License-Identifier: MIT-0 */
/*
 * initial.h -- initial states of several environments, drawn in lanes.
 *
 * Every lane draws from the stream of its own episode in the order of sampler.h, so that the states
 * are the same to the bit. Lanes whose draw is not admissible move to the front and draw again.
 */
#ifndef DL2C_INITIAL_H
#define DL2C_INITIAL_H

#include "actions.h"
#include "sampler.h"

enum {
  DL2C_MAX_ROUNDS = 64, /* after so many draws a lane is given up */
  DL2C_DRAW_GROUP = 8,  /* lanes that are drawn together */
  DL2C_ONE_CHART_EACH = (int)NCHART == (int)NBLOCK, /* chart and block have the same number */
  DL2C_DRAWS_IN_LANES = NBLOCK > 0 && NBLOCK <= 16 && DL2C_ONE_CHART_EACH && !DL2C_TARGETED
};

/* Numbers in a row of the tables of boxes. */
#define DL2C_BOX_WIDTH ((int64_t)(sizeof SAMPLE_LOW[0] / sizeof(real)))

/* Streams of lanes, and what was drawn from them last for a block. */
typedef struct dl2c_points {
  _Alignas(DL2C_CACHE_LINE) uint64_t stream[4 * DL2C_BLOCK]; /* (4, DL2C_BLOCK) */
  real drawn[(NFREE + 1) * DL2C_BLOCK]; /* (NFREE + 1, DL2C_BLOCK) in its box; last: see dl2c_draw */
  uint8_t admitted[DL2C_BLOCK];         /* what was drawn is admissible */
} dl2c_points;

typedef struct dl2c_initials {
  dl2c_points points;
  real x[NX * DL2C_BLOCK];       /* (NX, DL2C_BLOCK) */
  real p[(NP + 1) * DL2C_BLOCK]; /* (NP, DL2C_BLOCK) */
  uint8_t lost[DL2C_BLOCK];      /* no draw was admissible in so many rounds */
} dl2c_initials;

/* The next number in [0, 1) of the stream of lane i.   s: (4, DL2C_BLOCK) */
DL2C_INLINE double dl2c_unit_of_lane(uint64_t *restrict s, int64_t i)
{
  dl2c_rng rng;
  DL2C_UNROLL
  for (int k = 0; k < 4; k++) rng.s[k] = s[k * DL2C_BLOCK + i];
  const double unit = dl2c_rng_unit(&rng);
  DL2C_UNROLL
  for (int k = 0; k < 4; k++) s[k * DL2C_BLOCK + i] = rng.s[k];
  return unit;
}

/* A box for each lane, and a point in it.   groups: of DL2C_DRAW_GROUP lanes */
DL2C_LANES static void dl2c_draw_points(dl2c_points *lanes, int block, int64_t groups)
{
  uint64_t *restrict s = lanes->stream;
  real *restrict drawn = lanes->drawn;
  int64_t box[DL2C_BLOCK];
  const int64_t first = SAMPLE_START[block];
  const int64_t boxes = SAMPLE_START[block + 1] - first;
  const int free_names = SAMPLE_FREE[block];
  for (int64_t i = 0; i < groups * DL2C_DRAW_GROUP; i++) box[i] = first;
  for (int64_t i = 0; boxes > 1 && i < groups * DL2C_DRAW_GROUP; i++) {
    const real place = dl2c_unit_of_lane(s, i) * (real)boxes;
    const int64_t cell = (int64_t)place;
    const int64_t alias = SAMPLE_ALIAS[first + cell];
    const int64_t other = -(int64_t)(place - (real)cell >= SAMPLE_SHARE[first + cell]);
    box[i] = (first + cell) ^ (((first + cell) ^ alias) & other);
  }
  for (int k = 0; k < free_names; k++) {
    DL2C_ALIAS_FREE
    for (int64_t i = 0; i < groups * DL2C_DRAW_GROUP; i++) {
      const int64_t row = box[i] * DL2C_BOX_WIDTH;
      const real low = (&SAMPLE_LOW[0][k])[row], high = (&SAMPLE_HIGH[0][k])[row];
      const real a = low + (high - low) * dl2c_unit_of_lane(s, i);
      drawn[k * DL2C_BLOCK + i] = dl2c_select(a < high, a, high);
    }
  }
  for (int64_t i = 0; DL2C_WEIGHTED && i < groups * DL2C_DRAW_GROUP; i++) {
    const real u = dl2c_unit_of_lane(s, i);
    drawn[NFREE * DL2C_BLOCK + i] = u * u * SAMPLE_DENSITY[DL2C_WEIGHTED ? box[i] : 0];
  }
}

/* Which points are admissible: a block has no condition on names of others. */
DL2C_INLINE void dl2c_admit_points(dl2c_points *lanes, int block, int64_t groups)
{
  const real *restrict drawn = lanes->drawn;
  int64_t good[DL2C_BLOCK];
  DL2C_ALIAS_FREE
  for (int64_t i = 0; i < groups * DL2C_DRAW_GROUP; i++) {
    real point[NFREE + 1], x[NX] = {0.0}, p[NP + 1] = {0.0};
    DL2C_UNROLL
    for (int k = 0; k <= NFREE; k++) point[k] = drawn[k * DL2C_BLOCK + i];
    model_initial(block, point, x, p);
    good[i] = model_accept(block, x, p);
    if (DL2C_WEIGHTED) good[i] &= point[NFREE] <= model_density(block, x, p);
  }
  for (int64_t i = 0; i < groups * DL2C_DRAW_GROUP; i++) lanes->admitted[i] = good[i] != 0;
}

/* The states that the points stand for: sets the names of a block. */
DL2C_INLINE void dl2c_place_points(dl2c_initials *lanes, int block, int64_t groups)
{
  real *restrict x = lanes->x;
  real *restrict p = lanes->p;
  const real *restrict drawn = lanes->points.drawn;
  DL2C_ALIAS_FREE
  for (int64_t i = 0; i < groups * DL2C_DRAW_GROUP; i++) {
    real point[NFREE + 1], own_x[NX], own_p[NP + 1];
    DL2C_UNROLL
    for (int k = 0; k <= NFREE; k++) point[k] = drawn[k * DL2C_BLOCK + i];
    dl2c_read_lane(x, p, DL2C_BLOCK, i, own_x, own_p);
    model_initial(block, point, own_x, own_p);
    DL2C_UNROLL
    for (int k = 0; k < NX; k++) x[k * DL2C_BLOCK + i] = own_x[k];
    DL2C_UNROLL
    for (int k = 0; k < NP; k++) p[k * DL2C_BLOCK + i] = own_p[k];
  }
}

/* Lane `to` goes on with the stream of lane `from`. */
static inline void dl2c_copy_stream(const dl2c_points *a, int64_t from, dl2c_points *b, int64_t to)
{
  for (int k = 0; k < 4; k++) b->stream[k * DL2C_BLOCK + to] = a->stream[k * DL2C_BLOCK + from];
}

/* How many groups the lanes are. The last one may have fewer. */
static inline int64_t dl2c_groups_of(int64_t count)
{
  return (count + DL2C_DRAW_GROUP - 1) / DL2C_DRAW_GROUP;
}

/* The same; lanes that complete the last one draw what the first lane draws. */
static inline int64_t dl2c_whole_groups(uint64_t *stream, int64_t count)
{
  const int64_t groups = dl2c_groups_of(count);
  for (int64_t i = count; i < groups * DL2C_DRAW_GROUP; i++)
    for (int k = 0; k < 4; k++) stream[k * DL2C_BLOCK + i] = stream[k * DL2C_BLOCK];
  return groups;
}

/* Draws the names of a block in each of `count` lanes; `rest` is for those that draw again. */
DL2C_INLINE void dl2c_draw_block(dl2c_initials *all, dl2c_points *rest, int block, int64_t count)
{
  dl2c_points *lanes = &all->points;
  int64_t place[DL2C_BLOCK]; /* where among all the lanes are that still draw */
  int64_t left = count;
  for (int64_t i = 0; i < count; i++) place[i] = i;
  for (int round = 0; left > 0 && round < DL2C_MAX_ROUNDS; round++) {
    const int64_t groups = dl2c_whole_groups(lanes->stream, left);
    dl2c_draw_points(lanes, block, groups);
    dl2c_admit_points(lanes, block, groups);
    int64_t failed = 0;
    for (int64_t i = 0; i < left; i++) {
      if (!lanes->admitted[i]) {
        dl2c_copy_stream(lanes, i, rest, failed);
        place[failed++] = place[i];
      } else if (lanes == rest) {
        dl2c_copy_stream(rest, i, &all->points, place[i]);
        for (int k = 0; k < SAMPLE_FREE[block]; k++)
          all->points.drawn[k * DL2C_BLOCK + place[i]] = rest->drawn[k * DL2C_BLOCK + i];
      }
    }
    left = failed;
    lanes = rest;
  }
  for (int64_t i = 0; i < left; i++) all->lost[place[i]] = 1;
  dl2c_place_points(all, block, dl2c_groups_of(count));
}

/* Constants that are derived, in groups of lanes. */
DL2C_LANES static void dl2c_derive_in_lanes(dl2c_initials *lanes, int64_t groups)
{
  real *restrict p = lanes->p;
  DL2C_ALIAS_FREE
  for (int64_t i = 0; i < groups * DL2C_DRAW_GROUP; i++) {
    real own_p[NP + 1];
    for (int k = 0; k < NCONSTANT; k++) own_p[k] = p[k * DL2C_BLOCK + i];
    model_derive(own_p);
    for (int k = NCONSTANT; k < NP; k++) p[k * DL2C_BLOCK + i] = own_p[k];
  }
}

/* Draws initial states in `count` lanes whose streams are given. */
static void dl2c_draw_initials(dl2c_initials *lanes, int64_t count)
{
  dl2c_points rest;
  memset(lanes->x, 0, sizeof lanes->x);
  memset(lanes->p, 0, sizeof lanes->p);
  memset(lanes->lost, 0, sizeof lanes->lost);
  DL2C_UNROLL
  for (int block = 0; block < (DL2C_DRAWS_IN_LANES ? NBLOCK : 0); block++)
    dl2c_draw_block(lanes, &rest, block, count);
  dl2c_derive_in_lanes(lanes, dl2c_groups_of(count));
}

#endif
