/* The function AT fails from the CALL-th call on, and logs it. After a call of UNTIL it succeeds
 * until the next fmi2Instantiate. With SPOILS, fmi2ExitInitializationMode also fails after a
 * failure of AT, until the next fmi2Instantiate. */
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
    static bool is_spoilt;
    is_over = (is_over || strcmp(function, UNTIL) == 0) && strcmp(function, "fmi2Instantiate") != 0;
    is_spoilt = is_spoilt && strcmp(function, "fmi2Instantiate") != 0;
    bool fails = !is_over && strcmp(function, AT) == 0 && ++calls >= CALL;
#ifdef SPOILS
    is_spoilt = is_spoilt || fails;
#endif
    if (fails && hostile_callbacks != NULL) {
        hostile_callbacks->logger(hostile_callbacks->componentEnvironment, "hostile", fmi2Error, "error",
                                  "refused: %s, call %d", function, calls);
    }
    return !fails && !(is_spoilt && strcmp(function, "fmi2ExitInitializationMode") == 0);
}
