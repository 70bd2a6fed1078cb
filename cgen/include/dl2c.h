/* SPDX-License-Identifier: MIT-0 */
/*
 * dl2c.h -- run compiled dL models: many environments, one call.
 *
 * A batch is n environments of one model. Its state lives in flat arrays, one row of
 * neighbouring environments for each variable; a batch of one is the single environment.
 * Results are written to buffers the caller owns and names once.
 */
#ifndef DL2C_H
#define DL2C_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define DL2C_ABI_VERSION 6
#define DL2C_STREAM_VERSION 4

#ifdef DL2C_SHARED
#define DL2C_API __attribute__((visibility("default")))
#else
#define DL2C_API
#endif

/* Every call returns DL2C_OK or a negative code. */
typedef enum dl2c_status {
  DL2C_OK = 0,
  DL2C_ERR_ARG = -1,   /* a null pointer; a size, an index or an option out of range */
  DL2C_ERR_NOMEM = -2, /* out of memory */
  DL2C_ERR_RESET = -3, /* no admissible initial state found in the allowed number of draws */
  DL2C_ERR_STATE = -4, /* a given state violates the precondition, or no run is possible from it */
  DL2C_ERR_SOLVER = -5, /* the library of differential equation solvers is missing or lacks a function */
  DL2C_ERR_BLOCKED = -6, /* no run is possible from any of many initial states drawn */
  DL2C_ERR_MONITOR = -7, /* a step violates the monitor of its model; its reason says which condition */
} dl2c_status;

/* How an episode stands (info["status"]). */
typedef enum dl2c_outcome {
  DL2C_NONE = 0,
  DL2C_SUCCESS = 1,
  DL2C_FAILURE = 2,
} dl2c_outcome;

/* Why a step ended the episode (info["reason"]). Predicates follow from DL2C_REASON_PREDICATE on. */
typedef enum dl2c_reason {
  DL2C_REASON_NONE = 0,
  DL2C_REASON_BLOCKED = 1,
  DL2C_REASON_DEADLOCK = 2,
  DL2C_REASON_NUMERICAL = 3,
  DL2C_REASON_SOLVER = 4,
  DL2C_REASON_STALLED = 5,
  DL2C_REASON_DIVERGED = 6,
  DL2C_REASON_TIME_LIMIT = 7,
  DL2C_REASON_END = 8,        /* the program has no loop: one step is the whole run */
  DL2C_REASON_PREDICATE = 16, /* + index of the predicate that ended the episode */
} dl2c_reason;

typedef enum dl2c_autoreset {
  DL2C_AUTORESET_DISABLED = 0,
  DL2C_AUTORESET_NEXT_STEP = 1,
  DL2C_AUTORESET_SAME_STEP = 2,
} dl2c_autoreset;

typedef enum dl2c_on_blocked {
  DL2C_BLOCKED_FALLBACK = 0,
  DL2C_BLOCKED_TRUNCATE = 1,
  DL2C_BLOCKED_TERMINATE = 2,
} dl2c_on_blocked;

typedef enum dl2c_action_map {
  DL2C_MAP_PROJECT = 0,
  DL2C_MAP_SQUASH = 1,
} dl2c_action_map;

/* What may differ between batches of one compiled model. */
typedef struct dl2c_options {
  int64_t max_steps;      /* truncate an episode after so many steps; 0: never */
  int64_t stall_limit;    /* truncate after so many zero-duration steps in a row; 0: never */
  double blocked_penalty; /* added to the reward of a step whose requested run blocks */
  int32_t autoreset;      /* dl2c_autoreset */
  int32_t on_blocked;     /* dl2c_on_blocked */
  int32_t action_map;     /* dl2c_action_map */
  int32_t threads;        /* that share the environments, at most 256; results are the same */
  int32_t shared_obs;     /* 1: others write to `obs` too, so that every call writes all of it */
} dl2c_options;

/* Sizes of a compiled model, for whoever allocates the buffers. */
typedef struct dl2c_sizes {
  int32_t nx;       /* program variables */
  int32_t np;       /* episode constants */
  int32_t nobs;     /* observation entries */
  int32_t nchoice;  /* discrete decisions of the agent in a step */
  int32_t ninput;   /* continuous decisions of the agent in a step */
  int32_t nenvchoice; /* discrete decisions of the environment in a step */
  int32_t nenvinput;  /* continuous decisions of the environment in a step */
  int32_t nmask;    /* alternatives of all discrete decisions together */
  int32_t npred;    /* annotated predicates */
  int32_t nflow;    /* flows */
  int32_t nroot;    /* margins of the flow that has most */
  int32_t obs_size; /* bytes of one observation entry: 4 or 8 */
  int32_t snapshot_size; /* bytes of all that an environment keeps between steps */
  int32_t nscene; /* values of the model's scene, 0 where it has none */
} dl2c_sizes;

/* Where a batch reads actions and writes results. All arrays are the caller's, row-major. */
typedef struct dl2c_buffers {
  const int32_t *choices; /* (n, nchoice) requested alternative of each discrete decision */
  const double *inputs;   /* (n, ninput) requested value of each continuous decision */
  void *obs;              /* (n, nobs) float or double; constants are written when an episode begins */
  void *final_obs;        /* (n, nobs) last observation of an episode that same-step autoreset ended */
  double *rewards;        /* (n) */
  uint8_t *terminated;    /* (n) */
  uint8_t *truncated;     /* (n) */
  int8_t *mask;           /* (n, nmask) 1 where an alternative has a run */
  int32_t *executed_choices; /* (n, nchoice) the run taken; the request where a decision was not met */
  double *executed_inputs;   /* (n, ninput) */
  int32_t *drawn_choices; /* (n, nenvchoice) what the environment decided, -1 where it did not */
  double *drawn_inputs;   /* (n, nenvinput) likewise, NaN where it did not */
  int32_t *status;        /* (n) dl2c_outcome */
  int32_t *reason;        /* (n) dl2c_reason, or DL2C_REASON_PREDICATE + index; after DL2C_ERR_MONITOR
                             the number of the violated condition, negative */
  int32_t *cost;          /* (n) violated @safety predicates */
  uint8_t *blocked;       /* (n) the requested run blocked */
  uint8_t *postcondition; /* (n) the problem's Q on the state after the step; 1 where a step
                             without a loop has no run */
  uint8_t *saturated;     /* (n) some observation was clipped to its bounds */
  uint8_t *reset;         /* (n) this observation begins an episode */
  double *duration;       /* (n) time the step's flows took */
  double *time;           /* (n) time since the episode began */
} dl2c_buffers;

typedef struct dl2c_batch dl2c_batch;

DL2C_API int32_t dl2c_abi_version(void);
DL2C_API int32_t dl2c_stream_version(void);
DL2C_API void dl2c_model_sizes(dl2c_sizes *out);

/*
 * Loads the solver that flows without a closed form need: `path` is a library with the functions of
 * SUNDIALS CVODES 2.6. Once before the first batch; more often does nothing, and so does a model
 * whose flows need no solver or that was linked with one. On DL2C_ERR_SOLVER `problem` (capacity) says what
 * is missing. May be called by several threads. Where only stiff states of linear flows need a solver, the
 * path is noted and the library opened when one is met; without it their power series go on.
 */
DL2C_API dl2c_status dl2c_solver_library(const char *path, char *problem, size_t capacity);

/* Makes n environments. Writes *out only on success. */
DL2C_API dl2c_status dl2c_batch_create(int64_t n, const dl2c_options *options,
                                       const dl2c_buffers *buffers, dl2c_batch **out);

/* Frees the batch, not the buffers. NULL is allowed. */
DL2C_API void dl2c_batch_free(dl2c_batch *batch);

/*
 * Begins a new episode in every environment whose mask entry is set (in all if mask
 * is NULL). Environments named in a non-NULL `seeds` restart their stream from their
 * seed; the others go on with their next episode.
 *   mask: (n)   seeds: (n)
 */
DL2C_API dl2c_status dl2c_batch_reset(dl2c_batch *batch, const uint8_t *mask, const uint64_t *seeds);

/* Begins an episode of environment i in a given state, checked against the precondition. */
DL2C_API dl2c_status dl2c_batch_reset_to(dl2c_batch *batch, int64_t i, const uint64_t *seed,
                                         const double *x, const double *p);

/*
 * Advances every environment by one step: reads choices and inputs, writes every buffer. A
 * choice that is not an alternative requests a run that does not exist; an input that is NaN
 * counts as the lowest admissible value, one beyond the admissible values as the nearest.
 */
DL2C_API dl2c_status dl2c_batch_step(dl2c_batch *batch);

/*
 * In which environments the agent has a decision to take in the next step: some run that is open may meet
 * a choice, an input or a duration of its own. Elsewhere it makes no difference what it asks for.
 *   decides: (n)
 */
DL2C_API dl2c_status dl2c_batch_decides(const dl2c_batch *batch, uint8_t *decides);

/* Copies state and constants of environment i.   x: (nx)   p: (np) */
DL2C_API dl2c_status dl2c_batch_get_state(const dl2c_batch *batch, int64_t i, double *x, double *p);

/*
 * Overwrites them as they are, mid-episode; the mask follows. For planners and tests. Refuses
 * (DL2C_ERR_STATE) what is not finite: magnitudes above 1e100 count as infinite.
 */
DL2C_API dl2c_status dl2c_batch_set_state(dl2c_batch *batch, int64_t i, const double *x, const double *p);

/*
 * Copies all that environment i keeps between steps, and puts it back, there or in another place or batch
 * of the same library: what follows is the same to the last bit. For planners. Only what dl2c_batch_save
 * wrote may be restored; nothing is checked. It begins with a uint64_t: whether the episode is over.
 *   snapshot: (snapshot_size) bytes
 */
DL2C_API dl2c_status dl2c_batch_save(const dl2c_batch *batch, int64_t i, void *snapshot);
DL2C_API dl2c_status dl2c_batch_restore(dl2c_batch *batch, int64_t i, const void *snapshot);

/*
 * The right-hand sides of a flow's ODE in state x with constants p; 0 for variables that it
 * does not name. Nothing is checked: a term without a value gives whatever arithmetic gives.
 *   x, dx: (nx)   p: (np)
 */
DL2C_API dl2c_status dl2c_flow_rates(int32_t flow, const double *x, const double *p, double *dx);

/*
 * Margins of a flow's domain, in the order of its comparisons without the bounds of clocks:
 * positive inside, for = and != left minus right; and their derivatives along the flow. A flow
 * with fewer than nroot has 1 and 0 in the other places.   x: (nx)   p: (np)   g, dg: (nroot)
 */
DL2C_API dl2c_status dl2c_flow_roots(int32_t flow, const double *x, const double *p, double *g, double *dg);

/*
 * What a picture of a state shows: places, lengths and angles, which the scene of the model's manifest names.
 * Nothing is checked: one that has no value is not finite.   x: (nx)   p: (np)   values: (nscene)
 */
DL2C_API dl2c_status dl2c_scene_values(const double *x, const double *p, double *values);

/* A short description of a status, never NULL. */
DL2C_API const char *dl2c_status_text(dl2c_status status);

#endif
