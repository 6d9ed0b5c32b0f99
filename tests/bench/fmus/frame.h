/* Description of a benchmark FMU, with which frame.c implements the rest of FMI 2.0. An instance is
 * a plain block of memory. */
#ifndef TL_TESTS_BENCH_FMUS_FRAME_H
#define TL_TESTS_BENCH_FMUS_FRAME_H

#include <stddef.h>

typedef struct bench_model {
    const char *guid;
    size_t size;          /* of an instance */
    const void *defaults; /* start content of an instance; NULL: zeros */
} bench_model;

extern const bench_model model;

#endif
