/* Needs a thread-local variable in each function; fmi2Instantiate sets it. */
#include "tests/fmu/hostile/hostile.h"

#include <string.h>

static __thread int known;

bool hostile_before(const char *function) {
    if (strcmp(function, "fmi2Instantiate") == 0) {
        known = 1000;
    }
    return known == 1000 || strcmp(function, "load") == 0;
}
