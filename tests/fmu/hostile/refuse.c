/* The function AT fails from the CALL-th time on, and says so. UNTIL: not any more once that function was called. */
#include "tests/fmu/hostile/hostile.h"

#include <string.h>

#ifndef CALL
#define CALL 1
#endif
#ifndef UNTIL
#define UNTIL ""
#endif

bool hostile_before(const char *function) {
    static int calls;
    static bool is_over;
    is_over = is_over || strcmp(function, UNTIL) == 0;
    bool fails = !is_over && strcmp(function, AT) == 0 && ++calls >= CALL;
    if (fails && hostile_callbacks != NULL) {
        hostile_callbacks->logger(hostile_callbacks->componentEnvironment, "hostile", fmi2Error, "error",
                                  "refused: %s, call %d", function, calls);
    }
    return !fails;
}
