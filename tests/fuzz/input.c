/* Bytes one after the other: see input.h. */
#include "tests/fuzz/input.h"

#include <stdlib.h>

static const uint8_t *input;
static size_t left;

void tl_fuzz_begin(const uint8_t *data, size_t size) {
    input = data;
    left = size;
}

unsigned tl_fuzz_take(void) {
    if (left == 0) {
        return 0;
    }
    left--;
    return *input++;
}

uint32_t tl_fuzz_take_word(void) {
    uint32_t word = 0;
    for (int i = 0; i < 4; i++) {
        word = word << 8 | tl_fuzz_take();
    }
    return word;
}

bool tl_fuzz_is_over(void) {
    return left == 0;
}

void tl_fuzz_hold(bool what) {
    if (!what) {
        abort();
    }
}
