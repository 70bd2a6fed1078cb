/* SPDX-License-Identifier: MIT-0 */
/* step.h -- one step of one environment: decide and move. A step is a whole run or no change. */
#ifndef DL2C_STEP_H
#define DL2C_STEP_H

#include "actions.h"
#include "travel.h"

#ifndef DL2C_MONITORED
#define DL2C_MONITORED 0 /* steps are not judged by a monitor */
#endif

/* Paths of one run that are noted; of a run with more of them the first ones. */
enum { DL2C_MOST_NOTED = 256 };

/* What a step is asked for. */
typedef struct dl2c_request {
  const int32_t *choices; /* (NCHOICE) alternatives */
  const real *inputs;     /* (NINPUT) values */
  const real *draws;      /* numbers in [0, 1) for all else, see CHOICE_DRAW */
  const real *p;
  struct dl2c_solver *solver; /* NULL where no flow needs one */
  int32_t map;
  bool request_only; /* do not fall back to other alternatives */
#if DL2C_INSPECT
  dl2c_followed *followed; /* (DL2C_INSPECT_FLOWS) flows of the run are noted here, unless NULL, */
  int32_t *noted;          /* (DL2C_MOST_NOTED) and here which paths it takes, likewise */
#endif
} dl2c_request;

typedef enum dl2c_failure {
  DL2C_SOUND = 0,
  DL2C_LOST = 1,    /* an undefined or infinite value */
  DL2C_ENDLESS = 2, /* too many iterations of while loops */
  DL2C_UNSOLVABLE = 3, /* the solver failed */
} dl2c_failure;

/* A run so far. */
typedef struct dl2c_trial {
  int32_t point;
  int32_t failure;             /* dl2c_failure */
  int32_t entered;             /* iterations of while loops */
  int32_t nfollowed;           /* flows that are noted, see dl2c_request, */
  int32_t nnoted;              /* and paths */
  bool left;                   /* it is not the run requested */
  real duration;               /* time its flows took */
  int16_t taken[NDECISION + 1]; /* alternatives, -1 where a decision was not met */
  bool given[NU + 1];          /* inputs met, */
  real value[NU + 1];          /* their values, */
  real executed[NU + 1];       /* and how the action space writes them */
  uint8_t watch[NWATCH + 1];   /* dl2c_watched */
  real x[NX];
#if DL2C_MONITORED
  bool controlled;   /* the control of the step has been judged by the monitor, */
  int32_t violated;  /* which found this condition violated, 0 for none */
  bool unexplained;  /* its state was set by hand, so that there is nothing to judge */
  real before[NX];   /* the state where the step began */
#endif
} dl2c_trial;

/* A run that begins at a point. */
static inline void dl2c_begin_run(dl2c_trial *trial, int point, const real *x)
{
  *trial = (dl2c_trial){.point = point};
  for (int c = 0; c < NDECISION; c++) trial->taken[c] = -1;
  memcpy(trial->x, x, sizeof trial->x);
#if DL2C_MONITORED
  memcpy(trial->before, x, sizeof trial->before);
#endif
}

/*
 * The part of its longest duration that a flow takes, from 0 to 1: all of it, or what the agent or
 * chance decides.
 */
static inline real dl2c_share(const dl2c_request *request, dl2c_trial *trial, int flow)
{
  if (FLOW_DRAW[flow] >= 0) return 1.0 - request->draws[FLOW_DRAW[flow]];
  const int input = FLOW_DURATION[flow];
  if (NU == 0 || input < 0) return 1.0;
  if (!trial->given[input]) {
    static const dl2c_pieces all = {1, {0.0}, {1.0}};
    const bool squash = request->map == DL2C_MAP_SQUASH;
    const real wanted = request->inputs[input];
    int piece = 0;
    trial->given[input] = true;
    trial->value[input] = dl2c_nearest(&all, squash ? 0.5 * (wanted + 1.0) : wanted, &piece);
    trial->executed[input] =
        squash ? dl2c_squashed(&all, trial->value[input], piece) : trial->value[input];
  }
  return trial->value[input];
}

#if DL2C_INSPECT
/* Notes a flow from x to y. */
static inline void dl2c_note(const dl2c_request *request, dl2c_trial *trial, int flow,
                             const dl2c_travel *travel, const real *x, const real *y)
{
  if (request->followed == NULL || trial->nfollowed == DL2C_INSPECT_FLOWS) return;
  dl2c_followed *noted = &request->followed[trial->nfollowed++];
  *noted = (dl2c_followed){.flow = flow,
                           .kernel = travel->kernel,
                           .series = travel->series,
                           .stop = travel->stop,
                           .duration = travel->duration};
  memcpy(noted->x, x, sizeof noted->x);
  memcpy(noted->y, y, sizeof noted->y);
}
#endif

/*
 * Moves y along the flow of a path, and notes in the run what happened on the way. It is watched
 * where the run may end with it, or everywhere if that was asked for.
 */
static inline void dl2c_evolve(const dl2c_request *request, dl2c_trial *trial,
                               const dl2c_path *path, real *y)
{
  const int flow = path->flow;
  uint8_t closed[NWATCH + 1];
  const bool watched = DL2C_WATCHES_ALL || path->next == DL2C_END;
  if (!watched) memset(closed, DL2C_MET, sizeof closed);
  real p[NP + NFROZEN + 1];
  if (NP > 0) memcpy(p, request->p, sizeof(real) * NP);
  model_freeze(flow, y, p);
  dl2c_travel travel = {
      .p = p,
      .solver = request->solver,
      .part = dl2c_share(request, trial, flow),
      .watch = watched ? trial->watch : closed,
  };
#if DL2C_INSPECT
  real x[NX];
  memcpy(x, y, sizeof x);
#endif
  const dl2c_motion motion = dl2c_flow(flow, &travel, y);
  trial->duration += travel.duration;
#if DL2C_INSPECT
  if (motion == DL2C_ARRIVED) dl2c_note(request, trial, flow, &travel, x, y);
#endif
  if (motion == DL2C_UNDEFINED) trial->failure = DL2C_LOST;
  if (motion == DL2C_UNSOLVED) trial->failure = DL2C_UNSOLVABLE;
}

/* Whether a path whose guard holds is open to a run. Decisions and inputs that it met keep their outcome. */
static inline bool dl2c_is_open(dl2c_trial *trial, const real *p, int path)
{
  for (int j = 0; j < PATHS[path].nmet; j++) {
    const int met = PATHS[path].met[j];
    if (trial->taken[met] >= 0 && trial->taken[met] != DECISIONS[path][met]) return false;
  }
  const dl2c_search search = {path, trial->x, p, trial->given, trial->value};
  return NU == 0 || dl2c_all_have_values(&search);
}

/* Which paths are open where a run stands.   enabled: (paths of the point) */
static inline void dl2c_open(dl2c_trial *trial, const real *p, uint8_t *enabled)
{
  const int first = POINT_START[trial->point];
  model_guards(trial->point, trial->x, p, 1, 1, enabled);
  for (int k = first; k < POINT_START[trial->point + 1]; k++)
    enabled[k - first] = enabled[k - first] && dl2c_is_open(trial, p, k);
}

/*
 * How a path ranks, decision by decision; the least is tried first. Decisions of the agent: the
 * one requested, then a marked one, then in program order, which alone counts once the run has
 * left the request. Others: by the numbers drawn. Returns whether the run then has left.
 */
static inline bool dl2c_rank(const dl2c_request *request, const dl2c_trial *trial, int path,
                             real *rank)
{
  bool left = trial->left;
  int n = 0;
  for (int j = 0; j < PATHS[path].nmet; j++) {
    const int met = PATHS[path].met[j];
    const int alternative = DECISIONS[path][met];
    if (trial->taken[met] >= 0) continue;
    if (NDECISION > NCHOICE && met >= NCHOICE) {
      rank[n] = request->draws[CHOICE_DRAW[met] + alternative];
    } else if (left || request->choices[met] == alternative) {
      rank[n] = left ? (real)alternative : 0.0;
    } else {
      rank[n] = PATHS[path].marked[j] ? 1.0 : (real)(2 + alternative);
      left = true;
    }
    n++;
  }
  for (; n < NDECISION; n++) rank[n] = 0.0;
  return left;
}

/* The open path to try first, -1 if none is open; left as dl2c_rank says of it. */
static inline int dl2c_preferred(const dl2c_request *request, const dl2c_trial *trial,
                                 const uint8_t *enabled, bool *left)
{
  const int first = POINT_START[trial->point];
  real ranks[2][NDECISION + 1];
  int best = -1;
  int held = 0;
  for (int k = first; k < POINT_START[trial->point + 1]; k++) {
    if (!enabled[k - first]) continue;
    const real *lowest = ranks[held];
    real *rank = ranks[!held];
    const bool leaves = dl2c_rank(request, trial, k, rank);
    int c = 0;
    while (best >= 0 && c < NDECISION && rank[c] == lowest[c]) c++;
    if (best >= 0 && (c == NDECISION || rank[c] > lowest[c])) continue;
    best = k;
    held = !held;
    *left = leaves;
  }
  return best;
}

/* The value of an input that a run meets for the first time, at a place of the path. */
static inline void dl2c_give(const dl2c_request *request, dl2c_trial *trial, int path, int place)
{
  const int input = PATHS[path].inputs[place].input;
  const bool own = (int)NU == (int)NINPUT || (NINPUT > 0 && input < NINPUT);
  const dl2c_search search = {path, trial->x, request->p, trial->given, trial->value};
  const real value = own ? dl2c_requested(&search, place, request->map, request->inputs[input],
                                          &trial->executed[input])
                         : dl2c_drawn(&search, place, request->draws[INPUT_DRAW[input]]);
  trial->given[input] = true;
  trial->value[input] = value;
}

#if DL2C_MONITORED
/* Judges what a step's control led to, once, where its motion begins or it ends without any. */
static inline void dl2c_judge_control(dl2c_trial *trial, const dl2c_path *taken, const real *y,
                                      const real *p)
{
  const bool leads = DL2C_POINT_LEAD > 0 && trial->point >= DL2C_POINT_LEAD;
  const bool begins = DL2C_POINT_PREFIX > 0 && trial->point >= DL2C_POINT_PREFIX;
  if (leads || begins || trial->controlled) return;
  if (taken->flow == DL2C_NO_FLOW && taken->next != DL2C_END) return;
  trial->controlled = true;
  trial->violated = model_monitor_control(trial->before, y, p);
}
#endif

/* Decisions, inputs and assignments of a path, which lead to y, unless they fail. */
static inline void dl2c_decide(const dl2c_request *request, dl2c_trial *trial, int path, real *y)
{
  const dl2c_path *taken = &PATHS[path];
  for (int j = 0; j < taken->nmet; j++)
    trial->taken[taken->met[j]] = DECISIONS[path][taken->met[j]];
  for (int j = 0; NU > 0 && j < taken->ninput; j++)
    if (!trial->given[taken->inputs[j].input]) dl2c_give(request, trial, path, j);
  memcpy(y, trial->x, sizeof trial->x);
  const bool defined = model_update(path, trial->x, request->p, trial->value, y);
  if (!defined || !dl2c_all_finite(y, NX)) trial->failure = DL2C_LOST;
}

/* Executes one path: decisions, inputs, assignments, flow. */
static inline void dl2c_follow(const dl2c_request *request, dl2c_trial *trial, int path)
{
  const dl2c_path *taken = &PATHS[path];
  if (taken->enters && trial->entered++ == DL2C_MAX_LOOP) {
    trial->failure = DL2C_ENDLESS;
    return;
  }
#if DL2C_INSPECT
  if (request->noted != NULL && trial->nnoted < DL2C_MOST_NOTED) request->noted[trial->nnoted++] = path;
#endif
  real y[NX];
  dl2c_decide(request, trial, path, y);
#if DL2C_MONITORED
  if (trial->failure == DL2C_SOUND) dl2c_judge_control(trial, taken, y, request->p);
#endif
  if (trial->failure == DL2C_SOUND && taken->flow != DL2C_NO_FLOW)
    dl2c_evolve(request, trial, taken, y);
  memcpy(trial->x, y, sizeof trial->x);
  trial->point = taken->next;
}

/*
 * Completes a run from the point where it stands, trying open paths in order of preference and
 * returning to them when a later test fails; a failure ends it too. Only where several paths are
 * open is there something to return to, so that long loops need no memory.
 *   enabled: (NPATH) open paths of the point, used up   accepted: what else must hold at the end
 */
static bool dl2c_complete(const dl2c_request *request, dl2c_trial *trial, uint8_t *enabled,
                          bool (*accepted)(const dl2c_request *request, const dl2c_trial *trial))
{
  for (;;) {
    const int first = POINT_START[trial->point];
    int open = 0;
    for (int k = first; k < POINT_START[trial->point + 1]; k++) open += enabled[k - first];
    bool left = false;
    const int path = dl2c_preferred(request, trial, enabled, &left);
    if (path < 0 || (request->request_only && left)) return false;
    enabled[path - first] = 0;

    dl2c_trial before;
    if (open > 1) before = *trial;
    trial->left = left;
    dl2c_follow(request, trial, path);
    if (trial->failure != DL2C_SOUND) return true;
    if (trial->point == DL2C_END) {
      if (accepted == NULL || accepted(request, trial)) return true;
    } else if (open == 1) {
      dl2c_open(trial, request->p, enabled);
      continue;
    } else {
      uint8_t next[NPATH];
      dl2c_open(trial, request->p, next);
      if (dl2c_complete(request, trial, next, accepted)) return true;
    }
    if (open == 1) return false;
    *trial = before;
  }
}

#endif
