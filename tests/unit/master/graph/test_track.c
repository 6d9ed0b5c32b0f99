/* The track: after each step, a candidate gives the same values as the execution of everything.
 * Random networks; repeated and changed candidates, failing components, small caches, and
 * candidates that end early. TL_TEST_GRAPHS is the number of graphs, TL_TEST_SEED the first
 * seed. */
#include <stdio.h>
#include <string.h>
#include <unity.h>

#include "tests/support/random_network.h"
#include "tests/support/random_numbers.h"
#include "tests/support/test_rig.h"

enum { LONGEST = 64, LARGEST = 1 << 13, STEPS = 12 };

static tl_test_log call_log;
static tl_test_plan plan;
static tl_test_network network;
static tl_test_rig tracked;
static tl_test_rig plain; /* without sequences, so without a track */
static double known[4][TL_MAX_UNKNOWNS];
static unsigned char course[LONGEST][LARGEST]; /* all values after each step of the plain candidate */
static uint32_t walked;                        /* steps of the plain candidate */
static uint64_t seed;
static char where[96];
static uint64_t failed; /* failed candidates */
static uint64_t left;   /* candidates that ended early */

void setUp(void) {
    tl_test_log_clear(&call_log);
    failed = 0;
    left = 0;
}

void tearDown(void) {
    tl_test_rig_end(&tracked);
    tl_test_rig_end(&plain);
    tl_test_network_end(&network);
}

/* ---- both, side by side ---- */

static void keep_course(tl_test_rig *rig, uint32_t depth) {
    TEST_ASSERT_TRUE(depth < LONGEST && rig->exchange.values_size <= LARGEST);
    memcpy(course[depth], rig->exchange.values, rig->exchange.values_size);
    walked = depth;
}

/* Returns true if a port's value is defined after `depth` steps: an output if its component was in
 * the last step, an input if it is in the next one. The candidate sets adjusted inputs before each
 * step, so these do not count. */
static bool is_telling(const tl_test_rig *rig, const tl_port *port, uint32_t depth) {
    if (port->input && (port->adjusted || depth == rig->horizon.prediction)) {
        return false;
    }
    uint32_t reach = rig->exchange.reach == NULL ? LONGEST : rig->exchange.reach[port->node];
    return port->input ? depth < reach : depth - 1 < reach;
}

static void assert_same_value(const void *value, tl_type type, uint32_t depth) {
    size_t size = type == TL_REAL ? sizeof(fmi2Real) : sizeof(fmi2Integer);
    ptrdiff_t offset = (const unsigned char *)value - tracked.exchange.values;
    TEST_ASSERT_TRUE_MESSAGE(memcmp(&course[depth][offset], value, size) == 0, where);
}

/* Both have their values in the same order. */
static void compare(tl_test_rig *rig, uint32_t depth) {
    const tl_graph *graph = &rig->graph;
    TEST_ASSERT_TRUE_MESSAGE(depth <= walked, where);
    for (size_t i = 0; i < graph->port_count; i++) {
        const tl_port *port = &graph->ports[i];
        const void *value = tl_exchange_output(&rig->exchange, port);
        if (value != NULL && is_telling(rig, port, depth)) {
            assert_same_value(value, port->type, depth);
        }
    }
    for (size_t i = 0; i < graph->connection_count && rig->exchange.reach == NULL; i++) {
        if (graph->connections[i].cut) {
            assert_same_value(graph->connections[i].nominal, graph->connections[i].to->type, depth);
        }
    }
}

static void start(tl_test_random *random) {
    bool structure = tl_test_random_chance(random, 50);
    memset(known, 0, sizeof known);
    plan.plan.saving = (tl_plan_saving){.structure = structure};
    tl_test_rig_start(&plain, &plan, 0);
    plan.plan.saving.sequences = true;
    uint32_t least = 2 * plan.plan.prediction + 2;
    bool small = tl_test_random_chance(random, 50);
    for (size_t k = 0; k < network.count; k++) {
        plan.components[k].keep = (tl_keep)tl_test_random_below(random, 3);
    }
    tl_test_rig_start(&tracked, &plan, small ? least + (uint32_t)tl_test_random_below(random, 12) : 1024);
    TEST_ASSERT_NOT_NULL(tracked.exchange.cached);
    TEST_ASSERT_NULL(plain.exchange.cached);
    plain.watch = keep_course;
    tracked.watch = compare;
}

static void push(tl_test_random *random) {
    double values[TL_MAX_SIGNALS] = {0.0};
    for (size_t s = 0; s < network.signals; s++) {
        values[s] = network.types[s] == TL_REAL ? tl_test_random_number(random, -1.0, 2.0)
                                                : (double)tl_test_random_below(random, 2);
    }
    tl_test_rig_push(&tracked, values);
    tl_test_rig_push(&plain, values);
}

/* A known candidate with up to three changed values, or a new one. */
static void vary(tl_test_random *random, double *u) {
    size_t count = tracked.horizon.count;
    size_t changes = tl_test_random_below(random, 4);
    memcpy(u, known[tl_test_random_below(random, 4)], count * sizeof *u);
    for (size_t i = 0; i < changes; i++) {
        u[tl_test_random_below(random, count)] = tl_test_random_value(&network, random);
    }
    memcpy(known[tl_test_random_below(random, 4)], u, count * sizeof *u);
}

static void try_both(tl_test_random *random) {
    double u[TL_MAX_UNKNOWNS];
    uint32_t prediction = plan.plan.prediction;
    bool leaves = tl_test_random_chance(random, 25);
    uint32_t steps = leaves ? (uint32_t)tl_test_random_below(random, prediction) : prediction;
    vary(random, u);
    walked = 0;
    uint64_t wanted = tl_test_rig_walk(&plain, u, steps);
    uint64_t given = tl_test_rig_walk(&tracked, u, steps);
    TEST_ASSERT_EQUAL_INT_MESSAGE(plain.status, tracked.status, where);
    TEST_ASSERT_EQUAL_UINT64_MESSAGE(wanted, given, where);
    failed += plain.status != TL_OK;
    left += leaves;
}

/* Tries a few u; returns false if the step cannot be committed with any of them. */
static bool commit_both(tl_test_random *random) {
    double u[TL_MAX_UNKNOWNS];
    for (size_t i = 0; i < 5; i++) {
        vary(random, u);
        uint64_t wanted = tl_test_rig_commit(&plain, u);
        uint64_t given = tl_test_rig_commit(&tracked, u);
        TEST_ASSERT_EQUAL_INT_MESSAGE(plain.status, tracked.status, where);
        TEST_ASSERT_EQUAL_UINT64_MESSAGE(wanted, given, where);
        if (plain.status == TL_OK) {
            return true;
        }
    }
    return false;
}

static void walk_graph(tl_test_random *random) {
    bool going = true;
    for (size_t step = 0; step < STEPS && going; step++) {
        size_t candidates = tl_test_random_between(random, 0, 8);
        push(random);
        for (size_t i = 0; i < candidates; i++) {
            try_both(random);
        }
        going = commit_both(random);
    }
}

static uint64_t count_unstored(void) {
    uint64_t sum = 0;
    for (size_t k = 0; k < network.count; k++) {
        sum += tracked.exchange.cached[k].uncached;
    }
    return sum;
}

/* Some components fail beyond a limit of their input. */
static void make_fragile(tl_test_random *random) {
    static const tl_test_fault_kind kinds[] = {TL_TEST_DISCARD, TL_TEST_ERROR, TL_TEST_NAN};
    for (size_t k = 0; k < network.count; k++) {
        if (tl_test_random_chance(random, 30)) {
            tl_test_fault_kind kind = kinds[tl_test_random_below(random, 3)];
            tl_test_fmu_fail_above(&network.fmus[k], kind, tl_test_random_number(random, 0.3, 1.2));
        }
    }
}

/* Returns the number of results that did not fit into a cache. */
static uint64_t walk_graphs(bool fragile, size_t graphs) {
    size_t first = tl_test_campaign("TL_TEST_SEED", 1);
    uint64_t uncached = 0;
    for (seed = first; seed < first + graphs; seed++) {
        tl_test_random random = {tl_test_mix(seed + 11)};
        (void)snprintf(where, sizeof where, "seed %llu", (unsigned long long)seed);
        tl_test_random_network(&network, &plan, &call_log, &random, false);
        plan.plan.prediction = tl_test_network_least(&network) + (uint32_t)tl_test_random_below(&random, 5);
        plan.plan.shape = tl_test_random_chance(&random, 70) ? TL_DYNAMIC : TL_STATIC;
        if (fragile) {
            make_fragile(&random);
        }
        start(&random);
        walk_graph(&random);
        uncached += count_unstored();
        tl_test_rig_end(&tracked);
        tl_test_rig_end(&plain);
        TEST_ASSERT_EQUAL_STRING_MESSAGE("", call_log.first_violation, where);
    }
    return uncached;
}

/* A long campaign must have covered it. */
static void assert_met(uint64_t times, size_t graphs) {
    TEST_ASSERT_TRUE(graphs < 200 || times > 100);
}

static void candidates_give_the_same_after_every_step(void) {
    size_t graphs = tl_test_campaign("TL_TEST_GRAPHS", 300);
    assert_met(walk_graphs(false, graphs), graphs);
    assert_met(left, graphs);
    TEST_ASSERT_EQUAL_UINT64(0, failed);
}

static void so_they_do_where_components_fail(void) {
    size_t graphs = tl_test_campaign("TL_TEST_GRAPHS", 300);
    assert_met(walk_graphs(true, graphs), graphs);
    assert_met(left, graphs);
    assert_met(failed, graphs);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(candidates_give_the_same_after_every_step);
    RUN_TEST(so_they_do_where_components_fail);
    return UNITY_END();
}
