/* Horizon: see horizon.h. */
#include "master/sync/horizon.h"

#include <string.h>

/* Shortest path from `from` to every node. */
static void measure(const tl_graph *graph, size_t nodes, size_t from, size_t *scratch, uint32_t *steps) {
    for (size_t k = 0; k < nodes; k++) {
        size_t distance = tl_graph_distance(graph, from, k, scratch);
        steps[k] = distance == TL_UNREACHABLE ? TL_NEVER : (uint32_t)distance;
    }
}

/* From each component that reads a signal, as if the signal were an adjusted input of it. */
static void measure_signal(const tl_graph *graph, size_t nodes, size_t signal, size_t *scratch, uint32_t *steps) {
    for (size_t k = 0; k < nodes; k++) {
        steps[k] = TL_NEVER;
    }
    for (size_t i = 0; i < graph->connection_count; i++) {
        const tl_connection *connection = &graph->connections[i];
        if (connection->cut || connection->from->variable != NULL || connection->from->signal != signal) {
            continue;
        }
        for (size_t k = 0; k < nodes; k++) {
            size_t distance = tl_graph_distance(graph, connection->to->node, k, scratch);
            if (distance < steps[k]) {
                steps[k] = (uint32_t)distance;
            }
        }
    }
}

static uint32_t smaller(uint32_t a, uint32_t b) {
    return a < b ? a : b;
}

/* T_D of each variable and of each match: to its nearest partner. */
static void pair(tl_horizon *horizon, const tl_plan *plan, const tl_port *const *matched) {
    for (size_t m = 0; m < plan->match_count; m++) {
        horizon->match_distance[m] = TL_NEVER;
    }
    for (size_t v = 0; v < plan->adjust_count; v++) {
        horizon->variable_distance[v] = TL_NEVER;
        for (size_t m = 0; m < plan->match_count; m++) {
            uint32_t path_length = horizon->from_adjust[v * horizon->nodes + matched[m]->node];
            if (plan->match[m].weight > 0.0 && path_length != TL_NEVER) {
                horizon->variable_distance[v] = smaller(horizon->variable_distance[v], path_length + 1);
                horizon->match_distance[m] = smaller(horizon->match_distance[m], path_length + 1);
            }
        }
    }
}

/* If no variable reaches any output, report that and not each match. */
static void report_unreached(const tl_horizon *horizon, const tl_plan *plan, tl_report *report) {
    bool reaching = false;
    for (size_t v = 0; v < plan->adjust_count; v++) {
        reaching = reaching || horizon->variable_distance[v] != TL_NEVER;
        if (horizon->variable_distance[v] == TL_NEVER) {
            tl_report_add(report, TL_BAD_DATA, plan->adjust[v].where,
                          "%s has no path to any matched output, so it can correct nothing: adjust another variable",
                          plan->adjust[v].variable);
        }
    }
    for (size_t m = 0; m < plan->match_count && reaching; m++) {
        if (plan->match[m].weight > 0.0 && horizon->match_distance[m] == TL_NEVER) {
            tl_report_add(
                report, TL_BAD_DATA, plan->match[m].where,
                "%s has no path from any adjusted variable: set its \"weight\" to 0, or adjust a variable that "
                "affects it",
                plan->match[m].variable);
        }
    }
}

/* T_D, and T_P as configured or as short as possible. */
static void choose_prediction(tl_horizon *horizon, const tl_plan *plan, tl_report *report) {
    uint32_t largest = 0;
    horizon->distance = TL_NEVER;
    for (size_t v = 0; v < plan->adjust_count; v++) {
        if (horizon->variable_distance[v] != TL_NEVER) {
            horizon->distance = smaller(horizon->distance, horizon->variable_distance[v]);
            largest = largest > horizon->variable_distance[v] ? largest : horizon->variable_distance[v];
        }
    }
    if (largest == 0) {
        horizon->distance = 0;
        horizon->prediction = 1;
        return;
    }
    for (size_t m = 0; m < plan->match_count; m++) {
        if (horizon->match_distance[m] != TL_NEVER && horizon->match_distance[m] > largest) {
            largest = horizon->match_distance[m];
        }
    }
    horizon->prediction = plan->prediction != 0 ? plan->prediction : largest;
    if (horizon->prediction < largest) {
        tl_report_add(
            report, TL_BAD_DATA, "synchronise.horizon.prediction",
            "found %u, expected at least %u: the adjusted variables need that many steps to affect all matched outputs",
            (unsigned)horizon->prediction, (unsigned)largest);
    }
}

static void place_unknowns(tl_horizon *horizon, const tl_plan *plan, tl_report *report) {
    horizon->count = 0;
    for (size_t v = 0; v < horizon->variables; v++) {
        uint32_t distance = smaller(horizon->variable_distance[v], horizon->prediction);
        horizon->offset[v] = horizon->count;
        horizon->length[v] = plan->shape == TL_DYNAMIC ? horizon->prediction - distance + 1 : 1;
        horizon->count += horizon->length[v];
        horizon->longest = horizon->length[v] > horizon->longest ? horizon->length[v] : horizon->longest;
    }
    if (horizon->count > TL_MAX_UNKNOWNS) {
        tl_report_add(report, TL_BAD_DATA, "synchronise.horizon",
                      "a dynamic horizon of %u steps has %u unknowns, expected at most %u: shorten \"prediction\", or "
                      "make \"shape\" \"static\"",
                      (unsigned)horizon->prediction, (unsigned)horizon->count, (unsigned)TL_MAX_UNKNOWNS);
    }
}

/* Γ_k: the largest need of all matched outputs (eq. 4.5). */
static uint32_t find_reach(const tl_horizon *horizon, const tl_graph *graph, const tl_port *const *matched, size_t node,
                           size_t *scratch) {
    uint32_t nearest = TL_NEVER;
    for (size_t m = 0; m < graph->plan->match_count; m++) {
        size_t path_length = tl_graph_distance(graph, node, matched[m]->node, scratch);
        if (graph->plan->match[m].weight > 0.0 && path_length < nearest) {
            nearest = (uint32_t)path_length;
        }
    }
    return nearest < horizon->prediction ? horizon->prediction - nearest : 0;
}

/* C_k = (T_P − T_D + 1) − (executions from the second evaluation on), eq. 4.13 read backwards. */
static void find_needs(tl_horizon *horizon, const tl_graph *graph, const tl_port *const *matched, size_t *scratch) {
    for (size_t k = 0; k < horizon->nodes; k++) {
        horizon->reach[k] = horizon->variables == 0 ? 0 : find_reach(horizon, graph, matched, k, scratch);
        uint32_t nearest = TL_NEVER;
        for (size_t v = 0; v < horizon->variables; v++) {
            nearest = smaller(nearest, horizon->from_adjust[v * horizon->nodes + k]);
        }
        horizon->nearest[k] = nearest;
        bool on_path = nearest != TL_NEVER && horizon->reach[k] != 0;
        horizon->longer[k] =
            on_path ? nearest + (horizon->prediction - horizon->reach[k]) + 1 - horizon->distance : TL_NEVER;
    }
}

bool tl_horizon_init(tl_horizon *horizon, tl_arena *arena, const tl_graph *graph, const tl_port *const *adjusted,
                     const tl_port *const *matched, tl_report *report) {
    const tl_plan *plan = graph->plan;
    size_t nodes = graph->component_count + 1;
    *horizon = (tl_horizon){.variables = plan->adjust_count, .nodes = nodes};
    size_t *scratch = tl_arena_take(arena, nodes, sizeof *scratch);
    horizon->reach = tl_arena_take(arena, nodes, sizeof *horizon->reach);
    horizon->nearest = tl_arena_take(arena, nodes, sizeof *horizon->nearest);
    horizon->longer = tl_arena_take(arena, nodes, sizeof *horizon->longer);
    horizon->from_adjust = tl_arena_take(arena, nodes * plan->adjust_count, sizeof *horizon->from_adjust);
    horizon->from_signal = tl_arena_take(arena, nodes * plan->signal_count, sizeof *horizon->from_signal);
    if (scratch == NULL || horizon->reach == NULL || horizon->nearest == NULL || horizon->longer == NULL ||
        horizon->from_adjust == NULL || horizon->from_signal == NULL) {
        return false;
    }
    for (size_t v = 0; v < plan->adjust_count; v++) {
        measure(graph, nodes, adjusted[v]->node, scratch, &horizon->from_adjust[v * nodes]);
    }
    for (size_t s = 0; s < plan->signal_count; s++) {
        measure_signal(graph, nodes, s, scratch, &horizon->from_signal[s * nodes]);
    }
    pair(horizon, plan, matched);
    report_unreached(horizon, plan, report);
    choose_prediction(horizon, plan, report);
    place_unknowns(horizon, plan, report);
    find_needs(horizon, graph, matched, scratch);
    return true;
}

double tl_horizon_value(const tl_horizon *horizon, const double *u, size_t variable, uint32_t depth) {
    uint32_t last = horizon->length[variable] - 1;
    return u[horizon->offset[variable] + smaller(depth, last)];
}

void tl_horizon_hold(const tl_horizon *horizon, const double *values, double *u) {
    for (size_t v = 0; v < horizon->variables; v++) {
        for (uint32_t m = 0; m < horizon->length[v]; m++) {
            u[horizon->offset[v] + m] = values[v];
        }
    }
}

void tl_horizon_shift(const tl_horizon *horizon, double *u) {
    for (size_t v = 0; v < horizon->variables; v++) {
        double *sequence = &u[horizon->offset[v]];
        memmove(sequence, sequence + 1, (horizon->length[v] - 1) * sizeof *sequence);
    }
}

uint32_t tl_horizon_next_need(const tl_horizon *horizon, size_t node, uint32_t reach) {
    return reach > horizon->nearest[node] ? reach - horizon->nearest[node] : 0;
}
