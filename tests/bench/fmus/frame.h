/* What a benchmark FMU tells its frame: frame.c does the rest of FMI 2.0 with it. An instance is a plain block of memory. */
#ifndef TL_TESTS_BENCH_FMUS_FRAME_H
#define TL_TESTS_BENCH_FMUS_FRAME_H

#include <stddef.h>

typedef struct bench_model {
    const char *guid;
    size_t size;          /* of an instance */
    const void *defaults; /* what it starts as; NULL: zeros */
} bench_model;

extern const bench_model model;

#endif
