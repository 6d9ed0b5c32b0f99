/* An FMU whose serialised states can be loaded only in a process that has serialised one, as if
 * they contained addresses. HOW: what fmi2DeSerializeFMUstate does in another process.
 *
 * "ends"     ends the process; the default
 * "refuses"  fails
 * "hangs"    does not return
 */
#include "tests/fmu/hostile/hostile.h"

#include <stdbool.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#ifndef HOW
#define HOW "ends"
#endif

static bool has_saved;

static bool does(const char *how) {
    return strcmp(HOW, how) == 0;
}

static bool load_foreign(void) {
    if (does("ends")) {
        abort(); /* a signal that no sanitizer catches */
    }
    while (does("hangs")) {
        (void)pause();
    }
    return !does("refuses");
}

bool hostile_before(const char *function) {
    if (strcmp(function, "fmi2SerializeFMUstate") == 0) {
        has_saved = true;
    }
    return strcmp(function, "fmi2DeSerializeFMUstate") != 0 || has_saved || load_foreign();
}
