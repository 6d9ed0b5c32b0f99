/* Its saved states hold places of its process's memory: a process that has saved none has nothing there, and dies of loading one. */
#include "tests/fmu/hostile/hostile.h"

#include <string.h>

static int known;
static int *volatile place; /* where a state that was saved says that something is */

bool hostile_before(const char *function) {
    if (strcmp(function, "fmi2SerializeFMUstate") == 0) {
        place = &known;
    }
    if (strcmp(function, "fmi2DeSerializeFMUstate") == 0) {
        *place += 1;
    }
    return true;
}
