/* Random numbers: see random_numbers.h. */
#include "tests/support/random_numbers.h"

#include <stdlib.h>

uint64_t tl_test_mix(uint64_t bits) {
    bits = (bits ^ (bits >> 30)) * UINT64_C(0xBF58476D1CE4E5B9);
    bits = (bits ^ (bits >> 27)) * UINT64_C(0x94D049BB133111EB);
    return bits ^ (bits >> 31);
}

uint64_t tl_test_random_bits(tl_test_random *random) {
    random->state += UINT64_C(0x9E3779B97F4A7C15);
    return tl_test_mix(random->state);
}

size_t tl_test_random_below(tl_test_random *random, size_t limit) {
    return (size_t)(tl_test_random_bits(random) % limit);
}

size_t tl_test_random_between(tl_test_random *random, size_t least, size_t most) {
    return least + tl_test_random_below(random, most - least + 1);
}

bool tl_test_random_chance(tl_test_random *random, size_t percent) {
    return tl_test_random_below(random, 100) < percent;
}

double tl_test_random_number(tl_test_random *random, double least, double most) {
    return least + (most - least) * ((double)(tl_test_random_bits(random) >> 11) / 9007199254740992.0);
}

uint32_t tl_test_any(uint32_t *seed, uint32_t below) {
    *seed = *seed * 1664525U + 1013904223U;
    return (*seed >> 8) % below;
}

double tl_test_noise(uint32_t *seed) {
    return (double)tl_test_any(seed, 20001) / 10000.0 - 1.0;
}

size_t tl_test_campaign(const char *variable, size_t usual) {
    const char *text = getenv(variable);
    size_t wanted = text == NULL ? 0 : (size_t)strtoull(text, NULL, 10);
    return wanted != 0 ? wanted : usual;
}
