/* Random numbers that are equal on every machine, so that a failed test can be repeated with its
 * seed.
 *
 * Source:  splitmix64 (Steele, Lea, Flood 2014).
 * Thread:  a generator belongs to one thread at a time.
 */
#ifndef TL_TESTS_SUPPORT_RANDOM_NUMBERS_H
#define TL_TESTS_SUPPORT_RANDOM_NUMBERS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* The state is the seed. */
typedef struct tl_test_random {
    uint64_t state;
} tl_test_random;

/* Returns a hash of `bits`. */
uint64_t tl_test_mix(uint64_t bits);

uint64_t tl_test_random_bits(tl_test_random *random);

/* 0 … limit − 1; limit ≥ 1. */
size_t tl_test_random_below(tl_test_random *random, size_t limit);

/* least … most, both included. */
size_t tl_test_random_between(tl_test_random *random, size_t least, size_t most);

/* True with a probability of `percent` / 100. */
bool tl_test_random_chance(tl_test_random *random, size_t percent);

/* least ≤ number < most. */
double tl_test_random_number(tl_test_random *random, double least, double most);

/* The same with a 32-bit state, which is the seed: 0 … below − 1, and −1 … 1. */
uint32_t tl_test_any(uint32_t *seed, uint32_t below);
double tl_test_noise(uint32_t *seed);

/* Returns the length of a campaign: the number in the environment variable; `usual` if it is unset
 * or 0. */
size_t tl_test_campaign(const char *variable, size_t usual);

#endif
