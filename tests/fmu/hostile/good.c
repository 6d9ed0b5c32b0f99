/* An FMU without an attack; its states may be large (BALLAST, bytes: see frame.c). */
#include "tests/fmu/hostile/hostile.h"

bool hostile_before(const char *function) {
    (void)function;
    return true;
}
