/* See test_network.h. */
#include "tests/support/test_network.h"

#include <assert.h>
#include <stdio.h>
#include <string.h>

void tl_test_network_init(tl_test_network *network, tl_test_plan *plan, tl_test_log *log, size_t count) {
    memset(network, 0, sizeof *network);
    network->plan = plan;
    network->log = log;
    network->count = count;
    tl_test_plan_init(plan, TL_SECOND / 10);
}

static bool is_full(const tl_test_network *network, tl_test_kind kind, size_t k) {
    return kind == TL_TEST_REAL ? network->width[k] == TL_TEST_WIDTH : network->taken[k][kind] != 0;
}

tl_test_link *tl_test_network_edge_of(tl_test_network *network, tl_test_kind kind, int from, size_t to) {
    static const tl_type types[TL_TEST_KINDS] = {TL_REAL, TL_INTEGER, TL_BOOLEAN, TL_REAL};
    if (is_full(network, kind, to)) {
        return NULL;
    }
    assert(network->link_count < TL_TEST_LINKS);
    tl_test_link *link = &network->links[network->link_count++];
    *link = (tl_test_link){.kind = kind, .from = from, .to = to, .step = 0.5};
    link->input = kind == TL_TEST_REAL ? network->width[to]++ : 0;
    network->taken[to][kind] = 1;
    if (from < 0) {
        size_t signal = (size_t)(-1 - from);
        network->signals = signal < network->signals ? network->signals : signal + 1;
        network->types[signal] = types[kind];
    }
    return link;
}

tl_test_link *tl_test_network_edge(tl_test_network *network, int from, size_t to) {
    return tl_test_network_edge_of(network, TL_TEST_REAL, from, to);
}

tl_test_link *tl_test_network_adjust_of(tl_test_network *network, tl_test_kind kind, size_t to) {
    tl_test_link *link = tl_test_network_edge_of(network, kind, TL_TEST_FAR, to);
    if (link != NULL) {
        link->adjusted = 1;
    }
    return link;
}

tl_test_link *tl_test_network_adjust(tl_test_network *network, size_t to) {
    return tl_test_network_adjust_of(network, TL_TEST_REAL, to);
}

tl_test_view *tl_test_network_match(tl_test_network *network, size_t from) {
    assert(network->view_count < TL_MAX_MATCH);
    tl_test_view *view = &network->views[network->view_count++];
    *view = (tl_test_view){from, 0, network->signals++, 0.01, 1.0};
    return view;
}

static char *next_name(tl_test_network *network) {
    assert(network->name_count < TL_TEST_NAMES);
    return network->names[network->name_count++];
}

/* Stores and returns a name: "k3", "k3.sum" … */
static const char *name(tl_test_network *network, size_t k, const char *part) {
    char *text = next_name(network);
    (void)snprintf(text, sizeof network->names[0], "k%u%s", (unsigned)(k % 1000), part);
    return text;
}

/* Stores and returns a name: "k3.u1" … */
static const char *channel_name(tl_test_network *network, size_t k, const char *part, size_t number) {
    char *text = next_name(network);
    (void)snprintf(text, sizeof network->names[0], "k%u%s%u", (unsigned)(k % 1000), part, (unsigned)(number % 10));
    return text;
}

static const char *output(tl_test_network *network, size_t k, size_t number) {
    size_t channel = number % (network->width[k] + 1);
    return channel == 0 ? name(network, k, ".sum") : channel_name(network, k, ".y", channel - 1);
}

/* Stores and returns a name: "s2", or "plant.s2". */
static const char *signal_name(tl_test_network *network, const char *prefix, size_t number) {
    char *text = next_name(network);
    (void)snprintf(text, sizeof network->names[0], "%ss%u", prefix, (unsigned)(number % 1000));
    return text;
}

/* Gives Real outputs the unit m, and Real inputs a unit of 1.25 m. */
static void scale(tl_test_fmu *fmu) {
    static const tl_unit whole = {"m", true, {0, 1}, 1.0, 0.0};
    static const tl_unit larger = {"yd", true, {0, 1}, 1.25, 0.0};
    for (size_t i = 0; i < fmu->model.variable_count; i++) {
        tl_variable *variable = &fmu->variables[i];
        if (variable->type == TL_REAL && variable->causality != TL_PARAMETER) {
            variable->unit = variable->causality == TL_INPUT ? &larger : &whole;
        }
    }
}

/* True if a component needs its discrete variables. */
static bool is_discrete(const tl_test_network *network, size_t k) {
    bool discrete = network->taken[k][TL_TEST_COUNT] != 0 || network->taken[k][TL_TEST_FLAG] != 0;
    for (size_t i = 0; i < network->link_count; i++) {
        const tl_test_link *link = &network->links[i];
        discrete = discrete || (link->from == (int)k && link->kind != TL_TEST_REAL);
    }
    return discrete;
}

/* Sets the inputs without a connection. */
static void set_others(tl_test_network *network, size_t k, bool discrete) {
    if (network->width[k] == 0) {
        network->width[k] = 1;
        tl_test_plan_set(network->plan, "u0", 0.75);
    }
    if (discrete) {
        tl_test_plan_set(network->plan, "mode", 1.0);
    }
    if (discrete && network->taken[k][TL_TEST_COUNT] == 0) {
        tl_test_plan_set(network->plan, "count", 2.0);
    }
    if (discrete && network->taken[k][TL_TEST_FLAG] == 0) {
        const tl_value set = {.type = TL_BOOLEAN, .integer = 1};
        tl_test_plan_set_value(network->plan, "flag", set);
    }
}

/* Gains differ between components and keep each loop stable: their sum over the inputs of a
 * component is below 1. */
static void add_component(tl_test_network *network, size_t k) {
    tl_test_fmu *fmu = &network->fmus[k];
    size_t inputs = network->width[k] == 0 ? 1 : network->width[k];
    bool discrete = is_discrete(network, k);
    tl_test_fmu_init(fmu, inputs, discrete, network->log);
    fmu->control.telling = true;
    double width = (double)inputs;
    tl_test_fmu_variable(fmu, "gain")->start.real = (0.9 - 0.02 * (double)(k % 7)) / (width * width);
    tl_test_fmu_variable(fmu, "offset")->start.real = 0.125 * (double)(k % 3);
    tl_test_fmu_variable(fmu, "lag")->start.real = 0.15 + 0.01 * (double)(k % 5);
    if (network->scaled[k] != 0) {
        scale(fmu);
    }
    tl_test_plan_component(network->plan, name(network, k, ""), fmu);
    set_others(network, k, discrete);
}

static const char *target(tl_test_network *network, const tl_test_link *link) {
    static const char *const parts[TL_TEST_KINDS] = {"", ".count", ".flag", ".offset"};
    return link->kind == TL_TEST_REAL ? channel_name(network, link->to, ".u", link->input)
                                      : name(network, link->to, parts[link->kind]);
}

static const char *source(tl_test_network *network, const tl_test_link *link) {
    if (link->from < 0) {
        return signal_name(network, "plant.", (size_t)(-1 - link->from));
    }
    return link->kind == TL_TEST_REAL    ? output(network, (size_t)link->from, link->output)
           : link->kind == TL_TEST_COUNT ? name(network, (size_t)link->from, ".count_out")
                                         : name(network, (size_t)link->from, ".flag_out");
}

static void add_link(tl_test_network *network, const tl_test_link *link) {
    const char *to = target(network, link);
    if (link->from != TL_TEST_FAR) {
        tl_test_plan_connect(network->plan, source(network, link), to);
    }
    if (link->adjusted != 0) {
        tl_plan_adjust *adjust = tl_test_plan_adjust(network->plan, to, link->step);
        adjust->lower = -50.0;
        adjust->upper = 50.0;
    }
}

static uint32_t smaller(uint32_t a, uint32_t b) {
    return a < b ? a : b;
}

/* The algorithm of Floyd and Warshall. */
static void find_ways(tl_test_network *network) {
    for (size_t i = 0; i < network->count; i++) {
        for (size_t k = 0; k < network->count; k++) {
            network->way[i][k] = i == k ? 0 : TL_TEST_FAR;
        }
    }
    for (size_t i = 0; i < network->link_count; i++) {
        const tl_test_link *link = &network->links[i];
        if (link->from >= 0 && link->from != TL_TEST_FAR && link->adjusted == 0 && (size_t)link->from != link->to) {
            network->way[link->from][link->to] = 1;
        }
    }
    for (size_t m = 0; m < network->count; m++) {
        for (size_t i = 0; i < network->count; i++) {
            for (size_t k = 0; k < network->count; k++) {
                network->way[i][k] = smaller(network->way[i][k], network->way[i][m] + network->way[m][k]);
            }
        }
    }
}

void tl_test_network_build(tl_test_network *network) {
    for (size_t k = 0; k < network->count; k++) {
        add_component(network, k);
    }
    for (size_t s = 0; s < network->signals; s++) {
        tl_test_plan_signal(network->plan, signal_name(network, "", s), network->types[s], "");
    }
    for (size_t i = 0; i < network->link_count; i++) {
        add_link(network, &network->links[i]);
    }
    for (size_t i = 0; i < network->view_count; i++) {
        const tl_test_view *view = &network->views[i];
        tl_test_plan_match(network->plan, output(network, view->from, view->output),
                           signal_name(network, "plant.", view->signal), view->tolerance)
            ->weight = view->weight;
    }
    find_ways(network);
}

void tl_test_network_end(tl_test_network *network) {
    for (size_t k = 0; k < network->count; k++) {
        tl_test_fmu_end(&network->fmus[k]);
    }
}

uint32_t tl_test_network_from_u(const tl_test_network *network, size_t k) {
    uint32_t nearest = TL_TEST_FAR;
    for (size_t i = 0; i < network->link_count; i++) {
        if (network->links[i].adjusted != 0) {
            nearest = smaller(nearest, network->way[network->links[i].to][k]);
        }
    }
    return nearest;
}

uint32_t tl_test_network_to_y(const tl_test_network *network, size_t k) {
    uint32_t nearest = TL_TEST_FAR;
    for (size_t i = 0; i < network->view_count; i++) {
        if (network->views[i].weight > 0.0) {
            nearest = smaller(nearest, network->way[k][network->views[i].from]);
        }
    }
    return nearest;
}

uint32_t tl_test_network_distance(const tl_test_network *network) {
    uint32_t nearest = TL_TEST_FAR;
    for (size_t k = 0; k < network->count; k++) {
        nearest = smaller(nearest, tl_test_network_from_u(network, k) + tl_test_network_to_y(network, k));
    }
    return nearest + 1;
}

uint32_t tl_test_network_least(const tl_test_network *network) {
    uint32_t least = 0;
    for (size_t i = 0; i < network->link_count; i++) {
        uint32_t way = network->links[i].adjusted == 0 ? 0 : tl_test_network_to_y(network, network->links[i].to) + 1;
        least = way > least ? way : least;
    }
    for (size_t i = 0; i < network->view_count; i++) {
        const tl_test_view *view = &network->views[i];
        uint32_t way = view->weight > 0.0 ? tl_test_network_from_u(network, view->from) + 1 : 0;
        least = way > least ? way : least;
    }
    return least < TL_TEST_FAR ? least : TL_TEST_FAR;
}

uint32_t tl_test_network_most(const tl_test_network *network, size_t k, uint32_t prediction) {
    uint32_t through = tl_test_network_from_u(network, k) + tl_test_network_to_y(network, k) + 1;
    uint32_t distance = tl_test_network_distance(network);
    uint32_t longer = through - distance; /* C_k */
    uint32_t room = prediction - distance + 1;
    return room > longer ? room - longer : 0;
}
