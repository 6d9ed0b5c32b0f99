/* Its saved states hold places of its process's memory: a process that has saved none has nothing there, and dies of loading one. */
#include "tests/fmu/hostile/hostile.h"

#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

static bool has_saved;

bool hostile_before(const char *function) {
    if (strcmp(function, "fmi2SerializeFMUstate") == 0) {
        has_saved = true;
    }
    if (strcmp(function, "fmi2DeSerializeFMUstate") == 0 && !has_saved) {
        abort(); /* a signal that no sanitizer catches */
    }
    return true;
}
