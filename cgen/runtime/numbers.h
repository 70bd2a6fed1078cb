/* SPDX-License-Identifier: MIT-0 */
/* numbers.h -- small exact operations on doubles that models and runtime share. */
#ifndef DL2C_NUMBERS_H
#define DL2C_NUMBERS_H

#include <float.h>
#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <string.h>

typedef double real;

/* Conditions use & and | where && and || would do: loops over lanes vectorise if they have no branches. */
#if defined(__clang__)
#if __has_warning("-Wbitwise-instead-of-logical")
#pragma clang diagnostic ignored "-Wbitwise-instead-of-logical"
#endif
#endif

/*
 * DL2C_UNROLL: for loops over variables inside loops over lanes. DL2C_UNROLL_PATHS: for loops over paths;
 * there may be many, so that only 16 are unrolled.
 */
#if defined(__clang__)
#define DL2C_UNROLL _Pragma("unroll")
#define DL2C_UNROLL_PATHS _Pragma("unroll 16")
#elif defined(__GNUC__)
#define DL2C_UNROLL _Pragma("GCC unroll 128")
#define DL2C_UNROLL_PATHS _Pragma("GCC unroll 16")
#else
#define DL2C_UNROLL
#define DL2C_UNROLL_PATHS
#endif

/* For loops over lanes whose iterations do not access each other's memory. */
#if defined(__clang__)
#define DL2C_ALIAS_FREE _Pragma("clang loop vectorize(assume_safety)")
#pragma clang diagnostic ignored "-Wpass-failed"
#elif defined(__GNUC__)
#define DL2C_ALIAS_FREE _Pragma("GCC ivdep")
#else
#define DL2C_ALIAS_FREE
#endif

/*
 * Functions over full blocks exist several times, for AVX-512 (from GCC 12 on), AVX2 and every x86-64; all
 * compute the same bits. DL2C_NO_TARGET_CLONES leaves one, for linkers and C libraries
 * without indirect functions.
 */
#if defined(__GNUC__) && !defined(__clang__) && __GNUC__ >= 12
#define DL2C_CLONES "arch=x86-64-v4", "avx2", "default"
#else
#define DL2C_CLONES "avx2", "default"
#endif
#if defined(__x86_64__) && defined(__GLIBC__) && defined(__GNUC__) \
    && !defined(DL2C_NO_TARGET_CLONES)
#define DL2C_LANES __attribute__((target_clones(DL2C_CLONES)))
#else
#define DL2C_LANES
#endif

/*
 * Ends the use of upper halves of vector registers that a caller has left behind: without that, the first
 * vector instruction after other code waits for hundreds of cycles on some processors.
 */
static inline void dl2c_leave_upper_halves(void)
{
#if defined(__AVX__) && defined(__GNUC__)
  __builtin_ia32_vzeroupper();
#endif
}

/*
 * The widest vectors, which GCC avoids on some CPUs, where all motion is exact. Solvers, whose loops over
 * variables are short, are slower with them. A model's header says which flows it has before it includes
 * this.
 */
#if defined(__AVX512F__) && defined(__GNUC__) && !defined(__clang__) && !DL2C_TRACKED_FLOWS
#pragma GCC target("prefer-vector-width=512")
#endif

/* DL2C_INSPECT=1 notes the flows of each step and adds the calls of dl2c_inspect.h. */
#ifndef DL2C_INSPECT
#define DL2C_INSPECT 0
#endif

/* DL2C_ONE_BY_ONE=1 moves environments by the scalar step alone, to measure what lanes gain. */
#ifndef DL2C_ONE_BY_ONE
#define DL2C_ONE_BY_ONE DL2C_INSPECT
#endif

/*
 * DL2C_INLINE: inlined into each clone of its caller, so that it is compiled for the same instructions.
 * Without optimisation it is an ordinary function: that takes two thirds of the time to compile, and a
 * debugger can step into it. DL2C_OPTIONAL: a function that some models do not call, which GCC leaves out
 * without optimisation only if it is inline.
 */
#ifdef __OPTIMIZE__
#define DL2C_INLINE static inline __attribute__((always_inline))
#define DL2C_OPTIONAL static
#else
#define DL2C_INLINE static inline
#define DL2C_OPTIONAL static inline
#endif

/* For a function that several units of one model share. */
#if defined(__GNUC__)
#define DL2C_HIDDEN __attribute__((visibility("hidden")))
#else
#define DL2C_HIDDEN
#endif

/* For a function: inlines all that it calls. */
#define DL2C_FLAT __attribute__((flatten))

/* a where the condition holds, else b: both are known, so that compilers blend them in loops over lanes. */
static inline real dl2c_select(bool condition, real a, real b)
{
  return condition ? a : b;
}

/* The same for whole numbers; the condition is 0 or 1. */
static inline int32_t dl2c_pick(int32_t condition, int32_t a, int32_t b)
{
  return b ^ ((a ^ b) & -condition);
}

#if defined(__GNUC__) && defined(__BYTE_ORDER__)
#if __BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__
#define DL2C_LITTLE_ENDIAN /* the lowest byte of a word is the first */
#endif
#endif

/* The first index from i on where a flag is set, `count` for none. Tests eight flags at a time. */
static inline int64_t dl2c_next(const uint8_t *flags, int64_t i, int64_t count)
{
  uint64_t word = 0;
  for (; i + 8 <= count && word == 0; i += 8) memcpy(&word, flags + i, sizeof word);
#ifdef DL2C_LITTLE_ENDIAN
  if (word != 0) return i - 8 + (__builtin_ctzll(word) >> 3);
#else
  if (word != 0) i -= 8;
#endif
  while (i < count && !flags[i]) i++;
  return i;
}

/* dL's min and max; b where the two are equal or one is NaN. */
static inline real dl2c_min(real a, real b) { return a < b ? a : b; }
static inline real dl2c_max(real a, real b) { return a > b ? a : b; }

/* y = x.   x, y: (n) */
static inline void dl2c_copy(const real *x, int n, real *y)
{
  DL2C_UNROLL
  for (int k = 0; k < n; k++) y[k] = x[k];
}

/* State values beyond this magnitude count as infinite. */
#define DL2C_LARGEST_STATE 1e100

/* Whether a value is neither NaN nor larger than that in magnitude. */
static inline bool dl2c_finite(real value) { return fabs(value) <= DL2C_LARGEST_STATE; }

/* Whether all values are finite.   x: (n) */
static inline bool dl2c_all_finite(const real *x, int n)
{
  bool finite = true;
  DL2C_UNROLL
  for (int k = 0; k < n; k++) finite &= dl2c_finite(x[k]);
  return finite;
}

/* A value that stays constant along a flow; NaN and values out of range become 0. */
static inline real dl2c_frozen(real value) { return dl2c_finite(value) ? value : 0.0; }

/* -1, 0 or 1. */
static inline real dl2c_sign(real a) { return (real)((a > 0.0) - (a < 0.0)); }

/* The next double towards zero from a positive one. */
static inline real dl2c_before(real a)
{
  uint64_t bits;
  memcpy(&bits, &a, sizeof bits);
  bits -= 1;
  memcpy(&a, &bits, sizeof a);
  return a;
}

/* Doubles numbered in order: neighbours differ by one, both zeros are 0. */
static inline int64_t dl2c_ordinal(real a)
{
  int64_t bits;
  memcpy(&bits, &a, sizeof bits);
  return bits >= 0 ? bits : -(bits & INT64_MAX);
}

/* The double with this ordinal. */
static inline real dl2c_from_ordinal(int64_t number)
{
  const int64_t bits = number >= 0 ? number : -number;
  real a;
  memcpy(&a, &bits, sizeof a);
  return number >= 0 ? a : -a;
}

/* The largest finite float: the limit of observations whose own limit is infinite. */
#define DL2C_LARGEST_FLOAT 0x1.fffffep+127f

/* An observation entry, clipped to its bounds; sets *saturated to 1 if it was outside of them. */
static inline float dl2c_observe_float(real a, float low, float high, int32_t *saturated)
{
  const float narrow = (float)a;
  const float least = low < -DL2C_LARGEST_FLOAT ? -DL2C_LARGEST_FLOAT : low;
  const float largest = high > DL2C_LARGEST_FLOAT ? DL2C_LARGEST_FLOAT : high;
  const float raised = narrow < least ? least : narrow;
  const float shown = raised > largest ? largest : raised;
  *saturated |= shown != narrow;
  return shown;
}

static inline double dl2c_observe_double(real a, double low, double high, int32_t *saturated)
{
  const double raised = a < low ? low : a;
  const double shown = raised > high ? high : raised;
  *saturated |= shown != a;
  return shown;
}

/* The distance of two ordinals; it may exceed the range of int64_t. */
static inline uint64_t dl2c_distance(int64_t a, int64_t b)
{
  return a > b ? (uint64_t)a - (uint64_t)b : (uint64_t)b - (uint64_t)a;
}

/* The ordinal `steps` above (direction 1) or below (-1) a number; callers stay in the range of doubles. */
static inline int64_t dl2c_moved(int64_t number, int direction, uint64_t steps)
{
  const uint64_t moved = direction > 0 ? (uint64_t)number + steps : (uint64_t)number - steps;
  int64_t result;
  memcpy(&result, &moved, sizeof result);
  return result;
}

#endif
