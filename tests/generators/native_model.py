"""A model written by hand against dl2c.h: one variable, one constant, one decision of two alternatives.

A step adds the alternative times GAIN to x; the observation is (x, k), the reward k*k + x, the
initial state the seed. Seed 13 has no initial state, a negative x is not admissible.
"""

from pathlib import Path

from generators.toy_library import toy_manifest

from dl2c.native.compile import compile_library

MODEL_H = "#ifndef GAIN\n#define GAIN 1\n#endif\n"

MODEL_C = r"""
#include <stdlib.h>
#include "dl2c.h"
#include "toy.h"

struct dl2c_batch { int64_t n; dl2c_buffers to; double *x; double *k; };

int32_t dl2c_abi_version(void) { return DL2C_ABI_VERSION; }
int32_t dl2c_stream_version(void) { return DL2C_STREAM_VERSION; }
void dl2c_model_sizes(dl2c_sizes *out)
{
  *out = (dl2c_sizes){.nx = 1, .np = 1, .nobs = 2, .nchoice = 1, .nmask = 2, .npred = 2, .obs_size = 4};
}

dl2c_status dl2c_flow_rates(int32_t flow, const double *x, const double *p, double *dx)
{
  (void)flow, (void)x, (void)p, (void)dx;
  return DL2C_ERR_ARG;
}

dl2c_status dl2c_flow_roots(int32_t flow, const double *x, const double *p, double *g, double *dg)
{
  (void)flow, (void)x, (void)p, (void)g, (void)dg;
  return DL2C_ERR_ARG;
}

dl2c_status dl2c_scene_values(const double *x, const double *p, double *values)
{
  (void)x, (void)p, (void)values;
  return DL2C_OK;
}

dl2c_status dl2c_batch_save(const dl2c_batch *b, int64_t i, void *snapshot)
{
  (void)b, (void)i, (void)snapshot;
  return DL2C_ERR_ARG;
}

dl2c_status dl2c_batch_restore(dl2c_batch *b, int64_t i, const void *snapshot)
{
  (void)b, (void)i, (void)snapshot;
  return DL2C_ERR_ARG;
}

static void show(dl2c_batch *b, int64_t i)
{
  float *obs = b->to.obs;
  obs[2 * i] = (float)b->x[i];
  obs[2 * i + 1] = (float)b->k[i];
  b->to.mask[2 * i] = 1;
  b->to.mask[2 * i + 1] = b->x[i] < 5.0;
}

dl2c_status dl2c_batch_create(int64_t n, const dl2c_options *o, const dl2c_buffers *to, dl2c_batch **out)
{
  dl2c_batch *b = malloc(sizeof *b);
  if (b == NULL || o->max_steps < 0) return DL2C_ERR_NOMEM;
  *b = (dl2c_batch){n, *to, calloc((size_t)n, sizeof(double)), calloc((size_t)n, sizeof(double))};
  *out = b;
  return DL2C_OK;
}

void dl2c_batch_free(dl2c_batch *b)
{
  if (b == NULL) return;
  free(b->x);
  free(b->k);
  free(b);
}

dl2c_status dl2c_batch_reset(dl2c_batch *b, const uint8_t *mask, const uint64_t *seeds)
{
  if (b == NULL) return DL2C_ERR_ARG;
  for (int64_t i = 0; i < b->n; i++) {
    if (mask != NULL && !mask[i]) continue;
    if (seeds != NULL && seeds[i] == 13) return DL2C_ERR_RESET;
    b->x[i] = seeds != NULL ? (double)seeds[i] : 0.0;
    b->k[i] = 0.5;
    b->to.reset[i] = 1;
    show(b, i);
  }
  return DL2C_OK;
}

dl2c_status dl2c_batch_set_state(dl2c_batch *b, int64_t i, const double *x, const double *p)
{
  b->x[i] = x[0];
  b->k[i] = p[0];
  show(b, i);
  return DL2C_OK;
}

dl2c_status dl2c_batch_reset_to(dl2c_batch *b, int64_t i, const uint64_t *seed,
                                const double *x, const double *p)
{
  (void)seed;
  return x[0] < 0.0 ? DL2C_ERR_STATE : dl2c_batch_set_state(b, i, x, p);
}

dl2c_status dl2c_batch_step(dl2c_batch *b)
{
  if (b == NULL) return DL2C_ERR_ARG;
  for (int64_t i = 0; i < b->n; i++) {
    b->x[i] += GAIN * (double)b->to.choices[i];
    b->to.rewards[i] = b->k[i] * b->k[i] + b->x[i];
    b->to.terminated[i] = b->x[i] >= 10.0;
    b->to.reset[i] = 0;
    show(b, i);
  }
  return DL2C_OK;
}

dl2c_status dl2c_batch_get_state(const dl2c_batch *b, int64_t i, double *x, double *p)
{
  x[0] = b->x[i];
  p[0] = b->k[i];
  return DL2C_OK;
}

dl2c_status dl2c_solver_library(const char *path, char *problem, size_t room)
{
  (void)path, (void)problem, (void)room;
  return DL2C_OK;
}

const char *dl2c_status_text(dl2c_status status)
{
  switch (status) {
    case DL2C_OK: return "ok";
    case DL2C_ERR_ARG: return "a null pointer";
    case DL2C_ERR_NOMEM: return "out of memory";
    case DL2C_ERR_RESET: return "no initial state was found";
    case DL2C_ERR_STATE: return "the state is not admissible";
    case DL2C_ERR_SOLVER: return "no solver";
    case DL2C_ERR_BLOCKED: return "no run is possible";
    case DL2C_ERR_MONITOR: return "a step violates its monitor";
  }
  return "unknown";
}
"""


def build_model(directory: Path, gain: int = 1) -> Path:
    """Compile the model into a folder as a build does, and return the folder."""
    header = f"#define GAIN {gain}\n" if gain != 1 else MODEL_H
    compile_library({"toy.h": header, "toy.c": MODEL_C}, "toy", directory)
    (directory / "manifest.json").write_text(toy_manifest(counts=(2,)).to_json(), encoding="utf-8")
    return directory
