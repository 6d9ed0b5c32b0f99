/* A network of test FMUs described by its edges: graphs of any shape in a few lines, and their paths by other means.
 *
 * Purpose: tests of the method think of components and edges; names, channels and widths are found here. Components are
 *          k0 … k(n − 1), all telling (see test_fmu.h), with lag, so that states matter. Any of them may be `scaled`.
 * Use:     tl_test_network_init(), edges and the like, tl_test_network_build(); then the plan is complete.
 * Owner:   the caller places it (it is large: make it static) and calls tl_test_network_end() after the twin is gone.
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

/* Which variable of a component a link leads to; each has as many Reals as it has width, and one of each other. */
typedef enum tl_test_kind {
    TL_TEST_REAL,   /* u0 …; from y0 … or sum */
    TL_TEST_COUNT,  /* from count_out */
    TL_TEST_FLAG,   /* from flag_out, which passes nothing on but the flag */
    TL_TEST_OFFSET, /* the tunable parameter: adjusted, or nothing */
    TL_TEST_KINDS
} tl_test_kind;

/* An input, and what drives it. */
typedef struct tl_test_link {
    tl_test_kind kind;
    int from;      /* component; −1 − s: signal s of the plant; TL_TEST_FAR: nothing, it is adjusted */
    size_t to;     /* component */
    size_t output; /* Real: which one of the source, modulo those it has */
    size_t input;  /* Real: u0 …, filled in */
    int adjusted;  /* 1: by the search; then the source delivers û */
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
    bool booleans;  /* what is adjusted are flags */
    tl_test_fmu fmus[TL_TEST_COMPONENTS];
    size_t width[TL_TEST_COMPONENTS];
    int taken[TL_TEST_COMPONENTS][TL_TEST_KINDS]; /* 1: a link leads to the variable of that kind */
    int scaled[TL_TEST_COMPONENTS];               /* 1: Real inputs are in another unit than outputs are */
    tl_type types[TL_MAX_SIGNALS];                /* of the plant's signals: Real, unless a link says otherwise */
    tl_test_link links[TL_TEST_LINKS];
    size_t link_count;
    tl_test_view views[TL_MAX_MATCH];
    size_t view_count;
    char names[TL_TEST_NAMES][16];
    size_t name_count;
    /* Paths by Floyd and Warshall, over components: filled by tl_test_network_build(). */
    uint32_t way[TL_TEST_COMPONENTS][TL_TEST_COMPONENTS];
} tl_test_network;

/* `count` components without edges; the plan begins anew, with a step of 0.1 s. */
void tl_test_network_init(tl_test_network *network, tl_test_plan *plan, tl_test_log *log, size_t count);

/* From an output of one component, or a signal of the plant (−1 − s), to an input of its own of another. Nothing where `to`
 * has no input left; NULL then. */
tl_test_link *tl_test_network_edge(tl_test_network *network, int from, size_t to);

/* The same of another kind. A signal of the plant has that type then; it must not be used for another one. */
tl_test_link *tl_test_network_edge_of(tl_test_network *network, tl_test_kind kind, int from, size_t to);

/* An input, or the parameter, of component `to` that is adjusted and nothing else drives; NULL where there is none left. */
tl_test_link *tl_test_network_adjust(tl_test_network *network, size_t to);
tl_test_link *tl_test_network_adjust_of(tl_test_network *network, tl_test_kind kind, size_t to);

/* An output of a component that is matched with a signal of its own; the signal's number is in the view. */
tl_test_view *tl_test_network_match(tl_test_network *network, size_t from);

/* Makes FMUs and plan of it; gains differ, and all loops are stable. */
void tl_test_network_build(tl_test_network *network);

void tl_test_network_end(tl_test_network *network);

/* From the nearest adjusted variable to k, from k to the nearest matched output that has a weight, T_D. */
uint32_t tl_test_network_from_u(const tl_test_network *network, size_t k);
uint32_t tl_test_network_to_y(const tl_test_network *network, size_t k);
uint32_t tl_test_network_distance(const tl_test_network *network);

/* The least T_P: every adjusted variable reaches an output, and every matched output is reached; TL_TEST_FAR where
 * one never is. */
uint32_t tl_test_network_least(const tl_test_network *network);

/* Eq. 4.13 by components: executions of k from the second evaluation on, at most. */
uint32_t tl_test_network_most(const tl_test_network *network, size_t k, uint32_t prediction);

#endif
