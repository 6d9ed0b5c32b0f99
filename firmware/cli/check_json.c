/* Results of `twinlock check --json`: see check_json.h. */
#include "firmware/cli/check_json.h"

#include <math.h>

#include "firmware/base/json.h"

/* 0 ns is an unknown time, INT64_MAX one that does not fit. */
static void add_time(tl_json_writer *json, const char *key, tl_time time) {
    tl_json_add_number(json, key, time > 0 && time < INT64_MAX ? tl_seconds(time) : (double)NAN);
}

static void add_components(tl_json_writer *json, const tl_check_facts *facts) {
    static const char *const rollbacks[] = {"none", "auto", "state", "memory", "replay"};
    static const char *const keeps[] = {"states", "outputs", "none", "auto"};
    const tl_assembly *assembly = facts->assembly;
    tl_json_open_object(json, "components");
    for (size_t i = 0; i < assembly->config.component_count; i++) {
        tl_json_open_object(json, assembly->config.components[i].name);
        tl_json_add_text(json, "rollback", rollbacks[tl_fmu_rollback(tl_assembly_fmu(assembly, i))]);
        tl_json_add_text(json, "keep", keeps[tl_twin_get_ledger(assembly->twin, i).keep]);
        add_time(json, "execution_s", facts->prognosis->cost[i]);
        tl_json_close(json);
    }
    tl_json_close(json);
    tl_json_open_array(json, "connections");
    for (size_t i = 0; i < assembly->plan.connection_count; i++) {
        tl_json_open_array(json, NULL);
        tl_json_add_text(json, NULL, assembly->plan.connections[i].from);
        tl_json_add_text(json, NULL, assembly->plan.connections[i].to);
        tl_json_close(json);
    }
    tl_json_close(json);
}

static void add_search(tl_json_writer *json, const tl_check_facts *facts) {
    const tl_config *config = &facts->assembly->config;
    const tl_twin_facts about = tl_twin_get_facts(facts->assembly->twin);
    tl_json_open_object(json, "horizon");
    tl_json_add_count(json, "distance", about.distance);
    tl_json_add_count(json, "prediction", about.prediction);
    tl_json_add_count(json, "unknowns", about.unknowns);
    tl_json_add_count(json, "lead", about.lead);
    tl_json_close(json);
    tl_json_open_object(json, "reactions");
    for (size_t i = 0; i < config->adjust_count; i++) {
        const tl_response *response = &facts->responses[i];
        if (response->is_known) {
            tl_json_open_object(json, config->adjust[i].variable);
            tl_json_add_text(json, "output", config->match[response->match].variable);
            tl_json_add_number(json, "within_prediction", response->soon);
            tl_json_add_number(json, "most", response->most);
            add_time(json, "within_s", response->length);
            add_time(json, "half_s", response->half);
            tl_json_close(json);
        }
    }
    tl_json_close(json);
}

static void add_costs(tl_json_writer *json, const tl_check_facts *facts) {
    const tl_prognosis *prognosis = facts->prognosis;
    const tl_config *config = &facts->assembly->config;
    tl_json_open_object(json, "cost");
    tl_json_add_count(json, "step_executions", prognosis->step);
    add_time(json, "step_s", prognosis->step_time);
    tl_json_add_count(json, "worst_executions", prognosis->worst);
    add_time(json, "worst_s", prognosis->worst_time);
    add_time(json, "budget_s", config->adjust_count != 0 ? config->budget_time : 0);
    tl_json_add_count(json, "memory_bytes", tl_twin_get_facts(facts->assembly->twin).memory);
    tl_json_close(json);
}

tl_status tl_check_json_print(const tl_check_facts *facts, FILE *output, tl_error *error) {
    tl_json_writer json;
    tl_json_writer_begin(&json);
    tl_json_open_array(&json, "warnings");
    (void)tl_advice_print(facts->assembly, facts->prognosis, facts->responses, facts->rollback, facts->states, NULL,
                          &json);
    tl_json_close(&json);
    add_components(&json, facts);
    add_search(&json, facts);
    add_costs(&json, facts);
    const tl_status status = tl_json_writer_print(&json, output, error);
    tl_json_writer_free(&json);
    return status;
}
