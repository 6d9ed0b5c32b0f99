/* Has no states, though it claims to: the function fails. */
#include "tests/fmu/hostile/hostile.h"

#include <string.h>

bool hostile_before(const char *function) {
    return strcmp(function, "fmi2GetFMUstate") != 0;
}
