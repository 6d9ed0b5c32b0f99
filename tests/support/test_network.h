/* Network of test FMUs, described by its edges. It also computes path lengths independently of the
 * master.
 *
 * Purpose: tests of the method only describe components and edges. This module chooses names,
 *          channels and widths. Components are k0 … k(n − 1), all `telling` (see test_fmu.h), with
 *          a lag, so that states matter. Any of them may be `scaled`.
 * Use:     tl_test_network_init(); add edges, adjusted inputs and matched outputs;
 *          tl_test_network_build() completes the plan.
 * Owner:   the caller provides the memory; it is large, so make it static. The caller calls
 *          tl_test_network_end() after the twin was destroyed.
 * Thread:  one at a time.
 */
#ifndef TL_TESTS_SUPPORT_TEST_NETWORK_H
#define TL_TESTS_SUPPORT_TEST_NETWORK_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "tests/support/test_fmu.h"
#include "tests/support/test_plan.h"

enum {
    TL_TEST_LINKS = 96,
    TL_TEST_NAMES = 512,
    TL_TEST_FAR = 1000000 /* no path; sums of two do not overflow */
};

/* Variable of a component to which a link goes. A component has as many Real inputs as its width,
 * and one variable of each other kind. */
typedef enum tl_test_kind {
    TL_TEST_REAL,   /* u0 …; from y0 … or sum */
    TL_TEST_COUNT,  /* count; from count_out */
    TL_TEST_FLAG,   /* flag; from flag_out, which depends on the flag only */
    TL_TEST_OFFSET, /* the tunable parameter; it can only be adjusted */
    TL_TEST_KINDS
} tl_test_kind;

/* An input and its source. */
typedef struct tl_test_link {
    tl_test_kind kind;
    int from;      /* component; −1 − s: signal s of the plant; TL_TEST_FAR: no source, it is adjusted */
    size_t to;     /* component */
    size_t output; /* Real: index of the source's output, modulo the number of its outputs */
    size_t input;  /* Real: index of the input u0 …; set by this module */
    int adjusted;  /* 1: the search adjusts the input, and the source delivers û */
    double step;   /* of the search */
} tl_test_link;

/* A matched output. */
typedef struct tl_test_view {
    size_t from;
    size_t output;
    size_t signal;
    double tolerance;
    double weight;
} tl_test_view;

typedef struct tl_test_network {
    tl_test_plan *plan;
    tl_test_log *log;
    size_t count;   /* components */
    size_t signals; /* of the plant */
    bool booleans;  /* the adjusted variables are flags */
    tl_test_fmu fmus[TL_TEST_COMPONENTS];
    size_t width[TL_TEST_COMPONENTS];
    int taken[TL_TEST_COMPONENTS][TL_TEST_KINDS]; /* 1: a link goes to the variable of that kind */
    int scaled[TL_TEST_COMPONENTS];               /* 1: Real inputs have another unit than outputs */
    tl_type types[TL_MAX_SIGNALS];                /* of the plant's signals: Real, unless a link says otherwise */
    tl_test_link links[TL_TEST_LINKS];
    size_t link_count;
    tl_test_view views[TL_MAX_MATCH];
    size_t view_count;
    char names[TL_TEST_NAMES][16];
    size_t name_count;
    /* Path lengths between components (Floyd-Warshall); tl_test_network_build() computes them. */
    uint32_t way[TL_TEST_COMPONENTS][TL_TEST_COMPONENTS];
} tl_test_network;

/* Makes `count` components without edges, and resets the plan, with a step of 0.1 s. */
void tl_test_network_init(tl_test_network *network, tl_test_plan *plan, tl_test_log *log, size_t count);

/* Connects an output of component `from`, or signal s of the plant (`from` = −1 − s), to an unused
 * Real input of component `to`. Returns NULL if `to` has no unused one. */
tl_test_link *tl_test_network_edge(tl_test_network *network, int from, size_t to);

/* The same for any kind. A signal of the plant gets the type of that kind, and must not be used for
 * another type. */
tl_test_link *tl_test_network_edge_of(tl_test_network *network, tl_test_kind kind, int from, size_t to);

/* Adds an adjusted input without a source: an unused Real input of component `to`, or for the
 * second function its variable of that kind. Returns NULL if there is no unused one. */
tl_test_link *tl_test_network_adjust(tl_test_network *network, size_t to);
tl_test_link *tl_test_network_adjust_of(tl_test_network *network, tl_test_kind kind, size_t to);

/* Adds a matched output of component `from`, with a new signal of the plant (view->signal). */
tl_test_view *tl_test_network_match(tl_test_network *network, size_t from);

/* Makes the FMUs and the plan. Gains differ, and all loops are stable. */
void tl_test_network_build(tl_test_network *network);

void tl_test_network_end(tl_test_network *network);

/* Path lengths: from the nearest adjusted variable to component k; from k to the nearest matched
 * output with a weight above 0. The third function returns T_D. */
uint32_t tl_test_network_from_u(const tl_test_network *network, size_t k);
uint32_t tl_test_network_to_y(const tl_test_network *network, size_t k);
uint32_t tl_test_network_distance(const tl_test_network *network);

/* Returns the least T_P with which each adjusted variable reaches a matched output, and each
 * matched output is reached. Outputs with weight 0 do not count. TL_TEST_FAR: no T_P is enough. */
uint32_t tl_test_network_least(const tl_test_network *network);

/* Returns the most executions of component k in an evaluation after the first one (Eq. 4.13 for one
 * component). `prediction`: T_P. */
uint32_t tl_test_network_most(const tl_test_network *network, size_t k, uint32_t prediction);

#endif
