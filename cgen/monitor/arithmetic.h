/* SPDX-License-Identifier: MIT-0 */
/*
 * arithmetic.h -- refuses to be compiled for arithmetic that a monitor of doubles cannot rely on.
 *
 * A monitor holds a copy. That of floats allows FLT_EVAL_METHOD 0 alone, and says float.
 */
#ifndef DL2C_MONITOR_ARITHMETIC_H
#define DL2C_MONITOR_ARITHMETIC_H

#include <float.h>

#if defined(__FAST_MATH__) || (defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__ > 0)
#error "a monitor needs NaN and infinities: compile it without -ffast-math and -ffinite-math-only"
#endif
#if defined(FLT_EVAL_METHOD) && FLT_EVAL_METHOD != 0 && FLT_EVAL_METHOD != 1
#error "a monitor needs arithmetic that rounds to double: on x86 compile it with -mfpmath=sse -msse2"
#endif

#endif
