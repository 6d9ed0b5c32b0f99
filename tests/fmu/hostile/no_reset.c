/* Refuses a reset: fmi2Reset fails with the status RESET (frame.c). After that, the function SECOND
 * fails too. */
#include "tests/fmu/hostile/hostile.h"

#include <string.h>

#ifndef SECOND
#define SECOND ""
#endif

bool hostile_before(const char *function) {
    static bool refused;
    refused = refused || strcmp(function, "fmi2Reset") == 0;
    return strcmp(function, "fmi2Reset") != 0 && !(refused && strcmp(function, SECOND) == 0);
}
