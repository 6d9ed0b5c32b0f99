/* Uses BYTES of stack in the function AT; 0: without limit. */
#include "tests/fmu/hostile/hostile.h"

#include <stddef.h>
#include <string.h>

enum { FRAME = 64 * 1024 };

static int use(size_t left) {
    volatile char frame[FRAME];
    for (size_t i = 0; i < sizeof frame; i += 1024) {
        frame[i] = (char)left;
    }
    if (BYTES != 0 && left <= FRAME) {
        return frame[0];
    }
    return use(left - FRAME) + frame[FRAME / 2];
}

bool hostile_before(const char *function) {
    return strcmp(function, AT) != 0 || use(BYTES) != 1 << 30;
}
