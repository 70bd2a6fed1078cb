/*
 * model.h -- what a generated model tells the runtime.
 *
 * A generated file includes this header, defines the sizes, tables and functions named
 * below, and then includes batch.h, which compiles the runtime around them. Arrays of
 * size zero do not exist in C: tables have at least one entry. Functions with stride and
 * count work on lanes: value k of environment i is x[k*stride + i], i < count.
 *
 *   enum { NX, NP, NU, NCHOICE, NMASK, NPRED, NOBS, NPOINT, NPATH, NFLOW, NROOT, NFACT, NFREE,
 *          NBOX, DL2C_LOOPS, DL2C_STEPS_IN_LANES };
 *   #define DL2C_LANE_FLOW                       the flow of a step in lanes, or -1
 *   typedef float dl2c_obs;                      one observation entry, or double
 *   static const dl2c_path PATHS[];              all paths, grouped by point
 *   static const int32_t POINT_START[];          (NPOINT + 1) first path of each point
 *   static const int16_t DECISIONS[][];          (NPATH, NCHOICE) alternative taken, or -1
 *   static const int32_t MASK_START[];           (NCHOICE + 1) first mask entry of each decision
 *   static const double INPUT_LOW[], INPUT_HIGH[];
 *   static const double SAMPLE_LOW[][], SAMPLE_HIGH[][], SAMPLE_SHARE[]; static const int32_t SAMPLE_ALIAS[];
 *
 *   void model_guards(int point, x, p, stride, count, uint8_t *enabled)   tests that no input decides
 *   void model_limits(int path, int input, x, p, real *low, real *high)
 *   bool model_admits(int path, int input, x, p, real value)     tests that this input decides
 *   bool model_update(int path, x, p, u, real *y)                false: a value is undefined
 *   bool model_assign(int64_t path, x, p, real *y)               the same by selection, for lanes
 *   dl2c_motion model_motion(int flow, x, p, real *y, real *duration)
 *   bool model_at(int flow, x, p, real tau, real *y)             whether the domain holds after tau
 *   void model_rates(int flow, x, p, real *dx)                   the right-hand sides of its ODE
 *   void model_roots(int flow, x, p, real *g, real *dg)          margins of its domain, their Lie derivatives
 *   void model_facts(x, p, stride, count, row, uint8_t *facts)   conditions of predicates, F_postcondition
 *   void model_judge(x, p, stride, count, facts, row, dl2c_judgement *judged)   rewards and endings
 *   bool model_precondition(x, p)
 *   void model_observe(x, p, stride, count, row, dl2c_obs *obs, uint8_t *saturated)   obs: (NOBS, row)
 *   void model_initial(const real *drawn, real *x, real *p)      a state from the drawn values
 *   bool model_accept(x, p)                                      and whether it is admissible
 */
#ifndef DL2C_MODEL_H
#define DL2C_MODEL_H

#include "dl2c.h"
#include "flow_exact.h"
#include "numbers.h"

/* The longest list of decisions or inputs of one path that a table row holds. */
enum { DL2C_END = -1 };
#define DL2C_NO_FLOW (-1)

typedef struct dl2c_path {
  int32_t flow;          /* DL2C_NO_FLOW for none */
  int32_t target;        /* the next point, or DL2C_END */
  int32_t nmet;          /* decisions met, */
  const int16_t *met;    /* which, in order, */
  const int16_t *marked; /* and whether the alternative taken is marked as fallback */
  int32_t ninput;        /* inputs met, */
  const int16_t *inputs; /* and which, in order */
} dl2c_path;

/* offset + slope * value >= 0: a lower limit of the value where slope > 0, else an upper one. */
static inline void dl2c_limit(real offset, real slope, real *low, real *high)
{
  const real root = -offset / slope;
  if (slope > 0.0 && root > *low) *low = root;
  if (slope < 0.0 && root < *high) *high = root;
}

/* What became of a flow. */
typedef enum dl2c_motion {
  DL2C_SETTLED = 0,   /* y is where it ends */
  DL2C_UNDEFINED = 1, /* a value is undefined or too large */
  DL2C_OUTSIDE = 2,   /* rounding put the end point outside the domain */
} dl2c_motion;

typedef enum dl2c_end {
  DL2C_GOES_ON = 0,
  DL2C_TERMINATE = 1,
  DL2C_TRUNCATE = 2,
} dl2c_end;

/* Environments that are moved and judged together: what they need fits the first cache. */
enum { DL2C_BLOCK = 64 };

/* What the annotated predicates say of the states of a block. */
typedef struct dl2c_judgement {
  real reward[DL2C_BLOCK];
  int32_t cost[DL2C_BLOCK];      /* violated @safety predicates */
  int32_t end[DL2C_BLOCK];       /* dl2c_end */
  int32_t status[DL2C_BLOCK];    /* dl2c_outcome */
  int32_t reason[DL2C_BLOCK];    /* dl2c_reason */
  uint8_t undefined[DL2C_BLOCK]; /* a reward term has no finite value */
} dl2c_judgement;

#endif
