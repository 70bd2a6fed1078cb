/* SPDX-License-Identifier: MIT-0 */
/* inspect.h -- the calls of dl2c_inspect.h. Compiled with one model, on request. */
#ifndef DL2C_RUNTIME_INSPECT_H
#define DL2C_RUNTIME_INSPECT_H

#include "dl2c_inspect.h"
#include "judge.h"

/* Where in the motion of a step its state was last asked for. */
typedef struct dl2c_reader {
  const dl2c_followed *flow; /* NULL before the first question */
  real p[NP + NFROZEN + 1];  /* constants, and what is constant along this flow */
#if DL2C_TRACKED_FLOWS
  dl2c_integrator integrator;
  dl2c_track track;
#endif
} dl2c_reader;

#if DL2C_TRACKED_FLOWS
/*
 * The state of a flow after the time tau from its tracks, which are followed on from the last one or, where
 * that `begins` or lies behind, anew. False: the solver failed.   x: (NX)
 */
static bool dl2c_read_tracks(dl2c_batch *b, dl2c_reader *reader, bool begins, real tau, real *x)
{
  dl2c_integrator *integrator = &reader->integrator;
  dl2c_track *track = &reader->track;
  const dl2c_followed *flow = reader->flow;
  if (begins || tau < track->from) {
    integrator->flow = flow->flow;
    integrator->kernel = flow->kernel;
    integrator->series = flow->series;
    integrator->p = reader->p;
    integrator->solver = b->solver;
    if (!dl2c_integrator_start(integrator, flow->x, flow->stop)) return false;
    if (!dl2c_integrator_step(integrator, track)) return false;
  }
  while (tau > track->from + track->length && !dl2c_integrator_done(integrator))
    if (!dl2c_integrator_step(integrator, track)) return false;
  dl2c_track_at(track, (tau - track->from) / track->length, x);
  return true;
}
#endif

/* The state of a flow after the time tau, which is inside its duration.   x: (NX) */
static bool dl2c_read_state(dl2c_batch *b, dl2c_reader *reader, const dl2c_followed *flow, real tau,
                            real *x)
{
  memcpy(x, tau < flow->duration ? flow->x : flow->y, sizeof flow->x);
  if (!(tau > 0.0) || !(tau < flow->duration)) return true;
  const bool begins = reader->flow != flow;
  if (begins) model_freeze(flow->flow, flow->x, reader->p);
  reader->flow = flow;
#if DL2C_TRACKED_FLOWS
  if (flow->kernel >= DL2C_LINEAR) return dl2c_read_tracks(b, reader, begins, tau, x);
#endif
  (void)b;
  model_at(flow->flow, flow->x, reader->p, tau, x);
  return true;
}

dl2c_status dl2c_inspect_motion(dl2c_batch *b, int64_t i, int64_t count, const double *fractions, double *x)
{
  if (b == NULL || i < 0 || i >= b->n || count < 0 || fractions == NULL || x == NULL) return DL2C_ERR_ARG;
  const dl2c_followed *flows = b->followed + i * DL2C_INSPECT_FLOWS;
  const int32_t n = b->nfollowed[i];
  dl2c_reader reader = {.flow = NULL};
  real now[NX];
  real total = 0.0;
  dl2c_load(b, i, now, reader.p);
  for (int32_t k = 0; k < n; k++) total += flows[k].duration;
  for (int64_t j = 0; j < count; j++) {
    if (!(fractions[j] >= 0.0 && fractions[j] <= 1.0)) return DL2C_ERR_ARG;
    if (!(total > 0.0)) {
      memcpy(x + j * NX, now, sizeof now);
      continue;
    }
    real left = fractions[j] * total;
    int32_t k = 0;
    while (k < n - 1 && left > flows[k].duration) left -= flows[k++].duration;
    if (fractions[j] == 1.0) left = flows[k = n - 1].duration;
    if (!dl2c_read_state(b, &reader, &flows[k], left, x + j * NX)) return DL2C_ERR_SOLVER;
  }
  return DL2C_OK;
}

dl2c_status dl2c_inspect_violations(int64_t count, const double *x, const double *p, int32_t *violated)
{
  if (count < 0 || x == NULL || p == NULL || violated == NULL) return DL2C_ERR_ARG;
  dl2c_judgement judged;
  real constants[NP + 1] = {0.0}; /* there may be none */
  dl2c_complete_constants(p, constants);
  for (int64_t j = 0; j < count; j++) {
    uint8_t facts[NFACT] = {0};
    model_facts(x + j * NX, constants, 1, 1, 1, facts);
    dl2c_judge(x + j * NX, constants, 1, 1, facts, 1, &judged);
    violated[j] = judged.cost[0];
  }
  return DL2C_OK;
}

#endif
