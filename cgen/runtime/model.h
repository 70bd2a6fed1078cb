/* SPDX-License-Identifier: MIT-0 */
/*
 * model.h -- what a generated model tells the runtime.
 *
 * A generated file includes this header, defines the sizes, tables and functions named
 * below, and then includes batch.h, which compiles the runtime around them. Arrays of
 * size zero do not exist in C: tables have at least one entry. Functions with stride and
 * count work on lanes: value k of environment i is x[k*stride + i], i < count.
 *
 *   enum { NX, NCONSTANT, NP, NU, NINPUT, NENVINPUT, NDECISION, NCHOICE, NENVCHOICE, NMASK, NSTEPDRAW, NDRAW,
 *          NPRED, NOBS, NFIXED, NPOINT, NPATH, NFLOW, NROOT, NFACT, NFREE, NCHART, NFROZEN, NPROJECTION,
 *          DL2C_WEIGHTED, DL2C_TARGETED, NBLOCK, NMARGIN, NWATCH, NCRITICAL, DL2C_LOOPS,
 *          DL2C_JOINT_INPUTS, DL2C_DECIDES_IN_LANES, DL2C_STEPS_IN_LANES, DL2C_LOOKS_AHEAD,
 *          DL2C_LOOKS_DEEP, DL2C_WATCHES_ALL, DL2C_MAX_LOOP, DL2C_POINT_LEAD, DL2C_POINT_PREFIX };
 *   #define DL2C_LANE_FLOW                       the flow of a step in lanes, or -1
 *   #define DL2C_FEW_PATHS 1                     lanes select among the assignments of all paths
 *   #define DL2C_FLOWS_IN_LANES 1                steps integrate that flow in an active set of lanes
 *   #define DL2C_MONITORED 1                     steps are judged by the model's monitor
 *   #define DL2C_SCENE 5                         values of its scene, where it has one
 *   typedef float dl2c_obs;                      one observation entry, or double
 *   typedef int8_t dl2c_alternative;             a number of a path, of an alternative or of an order of them
 *   static const dl2c_path PATHS[];              all paths, grouped by point
 *   static const int32_t POINT_START[];          (NPOINT + 1) first path of each point
 *   static const int16_t DECISIONS[][];          (NPATH, NDECISION) alternative taken, or -1
 *   static const int16_t SAME_TESTS[];           (NPATH) the first path that asks the same of its inputs, where DL2C_FEW_PATHS
 *   static const int32_t MASK_START[];           (NCHOICE + 1) first mask entry of each decision
 *   static const int32_t CHOICE_DRAW[], INPUT_DRAW[], FLOW_DRAW[];   first number drawn for it, or -1
 *   static const double INPUT_LOW[], INPUT_HIGH[];
 *   static const int32_t SAMPLE_START[];         (NBLOCK + 1) first box of each block
 *   static const double SAMPLE_LOW[][], SAMPLE_HIGH[][], SAMPLE_SHARE[]; static const int64_t SAMPLE_ALIAS[];
 *   static const int32_t SAMPLE_CHART[], SAMPLE_FREE[]; static const double SAMPLE_DENSITY[];   one each where they do not matter
 *
 * The NDECISION discrete decisions are in this order: NCHOICE of the agent, NENVCHOICE of the
 * environment, then those of the program before the loop; so are the NU inputs, NINPUT and NENVINPUT
 * of them. A step draws NSTEPDRAW numbers, the program before the loop the rest of NDRAW. A step
 * starts at point 0, its leading statements at DL2C_POINT_LEAD, the program before the loop at
 * DL2C_POINT_PREFIX; 0 for none.
 *
 *   void model_guards(int point, x, p, stride, count, uint8_t *enabled)   tests that no input decides
 *   void model_limits(int path, int input, x, p, u, real *low, real *high)
 *   int model_criticals(int path, int input, x, p, u, real *root)   where its tests may change; how many
 *   int model_pins(int path, int input, x, p, u, real *root)     all that an equality leaves; -1: there is none
 *   bool model_admits(int path, int input, x, p, u)              tests that this input decides
 *   bool model_refuses(int path, int input, x, p, u, dl2c_hull z)   surely none of its values in z passes
 *                                                                them; only with DL2C_REFUSES
 *   bool model_update(int path, x, p, u, real *y)                false: a value is undefined
 *   bool model_assign(int64_t path, x, p, u, real *y)            the same by selection, for lanes
 *   DL2C_QUICK, DL2C_SOLUTION, DL2C_LINEAR, ...                  kernels: how flows are followed (dl2c/flows/kernel.py)
 *   static const uint8_t FLOW_KERNEL[], WATCH_CUTS[]; static const int32_t FLOW_MARGINS[], FLOW_DURATION[];
 *   static const real FLOW_REACH[];              how long its domain may take to end a flow without a clock, or 0
 *   int64_t model_motion(int flow, x, p, real *y, real *duration)   a dl2c_motion; flows of kernel QUICK
 *   void model_at(int flow, x, p, real tau, real *y)             moves x by the time tau into its copy y
 *   int model_solution(int flow, x, p, real (*c)[13])            by powers of the time; kernels QUICK, SOLUTION
 *   bool model_inside(int flow, y, p)                            whether a flow may end in y
 *   bool model_begin(int flow, x, p, real *horizon)              how long it may last; false: undefined
 *   void model_snap(int flow, x, p, real end, sign, real *y)     clocks and bounds that were met
 *   real model_margin(int flow, int margin, x, p)                positive inside its atom, as it is written
 *   void model_taylor(int flow, const dl2c_taylor *z, x, p, dl2c_taylor *g)   all margins where x moves like z
 *   bool model_condition(int flow, int formula, const int8_t *sign)  formulas over signs of margins
 *   void model_jacobian(int flow, x, p, real *jac)               (NX, NX) of the rates; kernels LINEAR, NUMERIC, DOPRI
 *   void model_lie(int flow, x, p, real *lie)                    (3, NMARGIN) of margins; the same kernels
 *   void model_freeze(int flow, x, real *p)                      what does not change along a flow from x, from p[NP] on
 *   void model_invariants(int flow, y, p, real *off, real (*by)[NX])   what it conserves; kernels LINEAR, NUMERIC, DOPRI
 *   bool model_keeps_watches(int flow, x, p, real duration, y)   it is proved to change no watch
 *   bool model_event_free(int flow, const dl2c_hull *z, x, p, bool bounded, watch)   no event inside z
 *   void model_rates(int flow, x, p, real *dx)                   the right-hand sides of its ODE
 *   bool model_moves(int flow, int variable)                     whether they name it; where a flow is of kernel DOPRI
 *   void model_roots(int flow, x, p, real *g, real *dg)          margins of its domain, their Lie derivatives
 *   void model_facts(x, p, stride, count, row, uint8_t *facts)   conditions of predicates, F_postcondition
 *   void model_revise(count, watch, late, row, uint8_t *facts)   facts that a post-state does not show
 *   void model_judge(x, p, stride, count, facts, row, dl2c_judgement *judged)   rewards and endings
 *   real model_shapes(x, p)                      of all predicates together; one without a value is 0
 *   bool model_precondition(x, p)
 *   void model_derive(real *p)                   derived constants, behind the NCONSTANT of the model
 *   void model_facts_and_guards(x, p, stride, count, row, facts, enabled)   model_facts and model_guards of point 0
 *   void model_observe(x, p, stride, count, row, dl2c_obs *obs, uint8_t *saturated)   obs: (NOBS - NFIXED, row)
 *   void model_observe_constants(p, stride, count, row, dl2c_obs *obs, uint8_t *saturated)   obs: (NFIXED, row)
 *   void model_initial(int chart, const real *drawn, real *x, real *p)   a state from the drawn values
 *   real model_density(int chart, x, p)                          how much of all states it stands for, squared
 *   bool model_accept(int chart, x, p)                           and whether it is admissible
 *   void model_scene(x, p, real *values)                         what a picture shows, where DL2C_SCENE > 0
 *   int32_t model_monitor_control(const real *before, after, p)   the condition violated, 0 for none,
 *   int32_t model_monitor_step(const real *before, after, p)      where DL2C_MONITORED
 */
#ifndef DL2C_MODEL_H
#define DL2C_MODEL_H

#include "dl2c.h"
#include "flow_exact.h"
#include "functions.h"
#include "numbers.h"
#include "zeros.h"
#if DL2C_INSPECT
#include "dl2c_inspect.h"
#endif

/* The longest list of decisions or inputs of one path that a table row holds. */
enum { DL2C_END = -1 };
#define DL2C_NO_FLOW (-1)

/* An input on a path. */
typedef struct dl2c_input {
  int16_t input;
  int16_t interval;  /* its tests leave an interval between limits that are linear in it */
  int16_t following; /* the place of the next input that shares tests with it, -1 for none */
  int16_t first;     /* none before shares tests with it */
} dl2c_input;

typedef struct dl2c_path {
  int32_t flow;          /* DL2C_NO_FLOW for none */
  int32_t next;          /* point, or DL2C_END */
  int32_t nmet;          /* decisions met, */
  const int16_t *met;    /* which, in order, */
  const int16_t *marked; /* and whether the alternative taken is marked as fallback */
  int32_t ninput;        /* inputs met, */
  const dl2c_input *inputs; /* and which, in order */
  int32_t enters;        /* it begins with an iteration of a while loop */
} dl2c_path;

/* offset + slope * value >= 0: a lower limit of the value where slope > 0, else an upper one. */
static inline void dl2c_limit(real offset, real slope, real *low, real *high)
{
  const real root = -offset / slope;
  *low = dl2c_select((slope > 0.0) & (root > *low), root, *low);
  *high = dl2c_select((slope < 0.0) & (root < *high), root, *high);
}

/* What became of a flow. */
typedef enum dl2c_motion {
  DL2C_ARRIVED = 0,   /* y is where it ends */
  DL2C_UNDEFINED = 1, /* a value is undefined or too large */
  DL2C_OUTSIDE = 2,   /* rounding put the end point outside the domain */
  DL2C_UNSOLVED = 3,  /* the solver failed */
  DL2C_DOUBTFUL = 4,  /* rounding may decide where it ends: search for the end */
} dl2c_motion;

/* What became of a watch in a step: a safety predicate that was violated on the way has failed. */
typedef enum dl2c_watched {
  DL2C_WATCHING = 0,
  DL2C_FAILED = 1,
  DL2C_MET = 2, /* an obligation that was met before it was due */
} dl2c_watched;

/*
 * A margin of degree 0 to 2 over an interval of time: its Bernstein coefficients, which enclose
 * it. The same operations in the same order as dl2c_curve_of, so that these are the coefficients
 * of its curve.
 */
typedef struct dl2c_span {
  real b0, b1, b2;
} dl2c_span;

static inline dl2c_span dl2c_constant(real c0) { return (dl2c_span){c0, c0, c0}; }
static inline dl2c_span dl2c_line(real c0, real c1, real length)
{
  return (dl2c_span){c0, c0, c1 * length + c0};
}
static inline dl2c_span dl2c_parabola(real c0, real c1, real c2, real length)
{
  const real half = c1 * length / 2.0;
  const real middle = half + c0;
  return (dl2c_span){c0, middle, c2 * (length * length) + half + middle};
}

/* Whether the coefficients prove that the margin stays >= 0, > 0, != 0, = 0. */
static inline bool dl2c_stays_nonnegative(dl2c_span s) { return (s.b0 >= 0.0) & (s.b1 >= 0.0) & (s.b2 >= 0.0); }
static inline bool dl2c_stays_positive(dl2c_span s) { return (s.b0 > 0.0) & (s.b1 > 0.0) & (s.b2 > 0.0); }
static inline bool dl2c_stays_nonzero(dl2c_span s)
{
  return dl2c_stays_positive(s) | ((s.b0 < 0.0) & (s.b1 < 0.0) & (s.b2 < 0.0));
}
static inline bool dl2c_stays_zero(dl2c_span s) { return (s.b0 == 0.0) & (s.b1 == 0.0) & (s.b2 == 0.0); }

typedef enum dl2c_end {
  DL2C_GOES_ON = 0,
  DL2C_TERMINATE = 1,
  DL2C_TRUNCATE = 2,
} dl2c_end;

/* Environments that are moved and judged together: their data fit into the first-level cache. */
enum { DL2C_BLOCK = 64 };

/* Bytes. The arrays of a batch begin with a cache line, so that no vector lies in two of them. */
enum { DL2C_CACHE_LINE = 64 };

/* What the annotated predicates say of the states of a block. */
typedef struct dl2c_judgement {
  real reward[DL2C_BLOCK];
  int32_t cost[DL2C_BLOCK];      /* violated @safety predicates */
  int32_t end[DL2C_BLOCK];       /* dl2c_end */
  int32_t status[DL2C_BLOCK];    /* dl2c_outcome */
  int32_t reason[DL2C_BLOCK];    /* dl2c_reason */
  uint8_t undefined[DL2C_BLOCK]; /* a reward term has no finite value */
} dl2c_judgement;

#ifndef DL2C_REWARDS_APART
#define DL2C_REWARDS_APART 0
#endif
#if DL2C_REWARDS_APART
/* model_judge and model_shapes, in a unit of their own: see rewards.h. */
DL2C_HIDDEN void dl2c_judge(const real *restrict x, const real *restrict p, int64_t stride, int64_t count,
                            const uint8_t *restrict facts, int64_t row, dl2c_judgement *restrict judged);
DL2C_HIDDEN real dl2c_shapes(const real *x, const real *p);
#endif

/* Judged by no predicate yet. */
DL2C_INLINE void dl2c_unjudged(int64_t count, dl2c_judgement *restrict judged)
{
  for (int64_t i = 0; i < count; i++) judged->reward[i] = 0.0;
  for (int64_t i = 0; i < count; i++) {
    judged->cost[i] = 0;
    judged->undefined[i] = 0;
  }
}

/* Adds to lane i a reward that is due; without a value it adds nothing and says so. */
static inline void dl2c_earn(bool due, bool defined, real value, int64_t i, dl2c_judgement *judged)
{
  judged->reward[i] += dl2c_select(due && defined, value, 0.0);
  judged->undefined[i] |= (uint8_t)(due & !defined);
}

/* How a step ends an episode: dl2c_end, dl2c_outcome, dl2c_reason. */
typedef struct dl2c_ending {
  int32_t end, status, reason;
} dl2c_ending;

/* A trigger makes an ending its own where it fires. */
static inline void dl2c_trigger(int32_t fires, int32_t end, int32_t status, int32_t reason,
                                dl2c_ending *ending)
{
  ending->end = dl2c_pick(fires, end, ending->end);
  ending->status = dl2c_pick(fires, status, ending->status);
  ending->reason = dl2c_pick(fires, reason, ending->reason);
}

static inline void dl2c_ends(dl2c_ending ending, int64_t i, dl2c_judgement *judged)
{
  judged->end[i] = ending.end;
  judged->status[i] = ending.status;
  judged->reason[i] = ending.reason;
}

#endif
