/* SPDX-License-Identifier: MIT-0 */
/*
 * dl2c_inspect.h -- what happened inside the last step, for whoever shows it.
 *
 * Only in a model that is compiled with -DDL2C_INSPECT=1, which steps to the same bits but one environment
 * after the other.
 */
#ifndef DL2C_INSPECT_H
#define DL2C_INSPECT_H

#include "dl2c.h"

/* Flows of one step that are noted; of a step with more of them the first ones. */
#define DL2C_INSPECT_FLOWS 64

/*
 * States inside the last step of environment i: fraction k of the time that its flows took, from 0, where
 * the first of them began, to 1, where the last one ended. Several flows are passed one after the other; what
 * was assigned between two takes no time. Where no time passed, the state is the present one: in a step
 * without flows or that failed, after a reset, and after a state was set or restored. Fractions in rising
 * order are quickest. Not while another call of the batch is under way.
 *   fractions: (count)   x: (count, nx)
 */
DL2C_API dl2c_status dl2c_inspect_motion(dl2c_batch *batch, int64_t i, int64_t count,
                                         const double *fractions, double *x);

/*
 * How many @safety predicates are violated in each of some states, within the tolerance as after a step.
 *   x: (count, nx)   p: (np)   violated: (count)
 */
DL2C_API dl2c_status dl2c_inspect_violations(int64_t count, const double *x, const double *p,
                                             int32_t *violated);

#endif
