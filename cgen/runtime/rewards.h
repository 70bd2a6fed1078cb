/* SPDX-License-Identifier: MIT-0 */
/*
 * rewards.h -- where rewards and endings are compiled: in the model's unit, or with DL2C_REWARDS_APART=1 in a
 * unit of their own, so that a model with other rewards compiles nothing else again. Included last by
 * <model>_rewards.h.
 */
#ifndef DL2C_RUNTIME_REWARDS_H
#define DL2C_RUNTIME_REWARDS_H

#include "model.h"

#if DL2C_REWARDS_APART

/* The rewards of a full block. */
DL2C_LANES static void dl2c_judge_block(const real *restrict x, const real *restrict p, int64_t stride,
                                        const uint8_t *restrict facts, dl2c_judgement *restrict judged)
{
  model_judge(x, p, stride, DL2C_BLOCK, facts, DL2C_BLOCK, judged);
}

void dl2c_judge(const real *restrict x, const real *restrict p, int64_t stride, int64_t count,
                const uint8_t *restrict facts, int64_t row, dl2c_judgement *restrict judged)
{
  if (count == 1)
    model_judge(x, p, stride, 1, facts, row, judged);
  else if (count == DL2C_BLOCK && row == DL2C_BLOCK)
    dl2c_judge_block(x, p, stride, facts, judged);
  else
    model_judge(x, p, stride, count, facts, row, judged);
}

real dl2c_shapes(const real *x, const real *p) { return model_shapes(x, p); }

#else

DL2C_INLINE void dl2c_judge(const real *restrict x, const real *restrict p, int64_t stride, int64_t count,
                            const uint8_t *restrict facts, int64_t row, dl2c_judgement *restrict judged)
{
  model_judge(x, p, stride, count, facts, row, judged);
}

DL2C_INLINE real dl2c_shapes(const real *x, const real *p) { return model_shapes(x, p); }

#endif

#endif
