/* SPDX-License-Identifier: MIT-0 */
/*
 * rng.h -- xoshiro256++ (Blackman and Vigna), one stream per environment and episode.
 *
 * A stream is keyed by splitmix64 from (seed, episode), so an environment's episodes
 * do not depend on what other environments of its batch draw.
 */
#ifndef DL2C_RNG_H
#define DL2C_RNG_H

#include <stdint.h>

typedef struct dl2c_rng {
  uint64_t s[4];
} dl2c_rng;

static inline uint64_t dl2c_splitmix64(uint64_t *state)
{
  uint64_t z = (*state += 0x9e3779b97f4a7c15u);
  z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
  z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
  return z ^ (z >> 31);
}

static inline dl2c_rng dl2c_rng_make(uint64_t seed, uint64_t episode)
{
  uint64_t key = seed;
  uint64_t state = dl2c_splitmix64(&key) ^ (episode * 0xd1342543de82ef95u);
  dl2c_rng rng;
  for (int k = 0; k < 4; k++) rng.s[k] = dl2c_splitmix64(&state);
  return rng;
}

static inline uint64_t dl2c_rotl(uint64_t a, int k) { return (a << k) | (a >> (64 - k)); }

static inline uint64_t dl2c_rng_next(dl2c_rng *rng)
{
  uint64_t *s = rng->s;
  const uint64_t result = dl2c_rotl(s[0] + s[3], 23) + s[0];
  const uint64_t shifted = s[1] << 17;
  s[2] ^= s[0];
  s[3] ^= s[1];
  s[1] ^= s[2];
  s[0] ^= s[3];
  s[2] ^= shifted;
  s[3] = dl2c_rotl(s[3], 45);
  return result;
}

/* Uniform on the multiples of 2^-53 in [0, 1). */
static inline double dl2c_rng_unit(dl2c_rng *rng)
{
  return (double)(dl2c_rng_next(rng) >> 11) * 0x1p-53;
}

/* Uniform in [low, high]. */
static inline double dl2c_rng_uniform(dl2c_rng *rng, double low, double high)
{
  const double a = low + (high - low) * dl2c_rng_unit(rng);
  return a < high ? a : high;
}

#endif
