/* Networks at random: see random_network.h. */
#include "tests/support/random_network.h"

#include <assert.h>

static tl_test_kind choose_kind(tl_test_random *random, bool exact) {
    size_t chance = tl_test_random_below(random, 100);
    if (!exact && chance >= 80) {
        return TL_TEST_FLAG;
    }
    return chance < 15 ? TL_TEST_COUNT : TL_TEST_REAL;
}

static void add_edges(tl_test_network *network, tl_test_random *random, bool exact) {
    assert(network->count != 0);
    size_t edges = tl_test_random_between(random, network->count - 1, 2 * network->count);
    for (size_t i = 0; i < edges; i++) {
        size_t from = tl_test_random_below(random, network->count);
        size_t to = tl_test_random_chance(random, 60) ? (from + 1) % network->count
                                                      : tl_test_random_below(random, network->count);
        tl_test_link *link = tl_test_network_edge_of(network, choose_kind(random, exact), (int)from, to);
        if (link != NULL) {
            link->output = tl_test_random_below(random, 5);
        }
    }
}

static size_t any(tl_test_network *network, tl_test_random *random) {
    return tl_test_random_below(random, network->count);
}

static void add_signals(tl_test_network *network, tl_test_random *random) {
    size_t signals = tl_test_random_below(random, 4);
    for (size_t i = 0; i < 2 * signals; i++) {
        (void)tl_test_network_edge(network, -1 - (int)tl_test_random_below(random, signals), any(network, random));
    }
    if (tl_test_random_chance(random, 20)) {
        (void)tl_test_network_edge_of(network, TL_TEST_COUNT, -1 - (int)network->signals, any(network, random));
    }
    if (tl_test_random_chance(random, 20)) {
        (void)tl_test_network_edge_of(network, TL_TEST_FLAG, -1 - (int)network->signals, any(network, random));
    }
}

/* Chooses a connected input, whose connection is then cut, or a free input, or a parameter. */
static tl_test_link *choose_real(tl_test_network *network, tl_test_random *random) {
    tl_test_kind kind = tl_test_random_chance(random, 25) ? TL_TEST_OFFSET : TL_TEST_REAL;
    if (network->link_count != 0 && tl_test_random_chance(random, 30)) {
        tl_test_link *link = &network->links[tl_test_random_below(random, network->link_count)];
        return link->kind == TL_TEST_REAL ? link : NULL;
    }
    return tl_test_network_adjust_of(network, kind, any(network, random));
}

/* Chooses a Boolean input without a source, or one that the plant or a component drives: that
 * connection is then cut. */
static tl_test_link *choose_flag(tl_test_network *network, tl_test_random *random) {
    int from = tl_test_random_chance(random, 50) ? -1 - (int)network->signals : (int)any(network, random);
    from = tl_test_random_chance(random, 30) ? TL_TEST_FAR : from;
    return tl_test_network_edge_of(network, TL_TEST_FLAG, from, any(network, random));
}

static void add_adjusted(tl_test_network *network, tl_test_random *random) {
    size_t adjusted = tl_test_random_between(random, 1, 3);
    for (size_t i = 0; i < adjusted; i++) {
        tl_test_link *link = network->booleans ? choose_flag(network, random) : choose_real(network, random);
        if (link != NULL) {
            link->adjusted = 1;
            link->step = tl_test_random_number(random, 0.1, 1.0);
        }
    }
}

/* Adds Boolean connections beside Real ones, because a Boolean alone would not show each difference
 * of its source. */
static void add_flags(tl_test_network *network, tl_test_random *random) {
    size_t links = network->link_count;
    for (size_t i = 0; i < links; i++) {
        const tl_test_link *link = &network->links[i];
        if (link->kind == TL_TEST_REAL && link->adjusted == 0 && link->from >= 0 && tl_test_random_chance(random, 10)) {
            (void)tl_test_network_edge_of(network, TL_TEST_FLAG, link->from, link->to);
        }
    }
}

static void add_views(tl_test_network *network, tl_test_random *random) {
    size_t views = tl_test_random_between(random, 1, 3);
    for (size_t i = 0; i < views; i++) {
        tl_test_view *view = tl_test_network_match(network, any(network, random));
        view->output = tl_test_random_below(random, 5);
        view->tolerance = tl_test_random_number(random, 0.002, 0.1);
        view->weight = i > 0 && tl_test_random_chance(random, 20) ? 0.0 : tl_test_random_number(random, 0.5, 2.0);
    }
}

static void add_all(tl_test_network *network, tl_test_random *random, bool booleans, bool exact) {
    network->booleans = booleans;
    for (size_t k = 0; k < network->count; k++) {
        network->scaled[k] = tl_test_random_chance(random, 25);
    }
    add_edges(network, random, exact);
    add_signals(network, random);
    add_adjusted(network, random);
    add_flags(network, random);
    add_views(network, random);
}

void tl_test_random_network(tl_test_network *network, tl_test_plan *plan, tl_test_log *log, tl_test_random *random,
                            bool exact) {
    bool booleans = tl_test_random_chance(random, 20);
    do {
        tl_test_network_end(network);
        tl_test_network_init(network, plan, log, tl_test_random_between(random, 2, 12));
        add_all(network, random, booleans, exact);
        tl_test_network_build(network);
    } while (plan->plan.adjust_count == 0 || tl_test_network_least(network) >= TL_TEST_FAR);
}

double tl_test_random_value(const tl_test_network *network, tl_test_random *random) {
    static const double special[] = {0.0, -0.0, 1.0};
    if (network->booleans) {
        return (double)tl_test_random_below(random, 2);
    }
    return tl_test_random_chance(random, 20) ? special[tl_test_random_below(random, 3)]
                                             : tl_test_random_number(random, -2.0, 2.0);
}
