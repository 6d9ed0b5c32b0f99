/* Refuses to be reset: the function fails, as RESET says (frame.c); so does what SECOND names, when it is called after that. */
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
