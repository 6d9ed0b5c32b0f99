/* Its saved states hold places of its process's memory: a process that has saved none has nothing there. HOW says what comes of loading one there.
 *
 * "ends"     the process does; if nothing else is said
 * "refuses"  the function fails
 * "hangs"    it does not return
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
