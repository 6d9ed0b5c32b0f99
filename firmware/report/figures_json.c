/* Key figures as JSON: see figures_json.h. */
#include "firmware/report/figures_json.h"

#include <math.h>

void tl_figures_json_add_number(cJSON *object, const char *key, double value) {
    if (isfinite(value)) {
        (void)cJSON_AddNumberToObject(object, key, value);
    } else {
        (void)cJSON_AddNullToObject(object, key);
    }
}

void tl_figures_json_add_count(cJSON *object, const char *key, uint64_t value) {
    (void)cJSON_AddNumberToObject(object, key, (double)value);
}

void tl_figures_json_add_outcomes(cJSON *object, const tl_run_figures *figures) {
    cJSON *outcomes = cJSON_AddObjectToObject(object, "outcomes");
    for (int i = TL_FREE; i < TL_OUTCOMES; i++) {
        tl_figures_json_add_count(outcomes, tl_outcome_name((tl_outcome)i), figures->outcomes[i]);
    }
}

static void add_component(cJSON *parent, const char *name, const tl_recorder_component *counts) {
    cJSON *object = cJSON_AddObjectToObject(parent, name);
    tl_figures_json_add_count(object, "plain", counts->plain);
    tl_figures_json_add_count(object, "predicted", counts->predicted);
    tl_figures_json_add_count(object, "executions", counts->executions);
    (void)cJSON_AddNumberToObject(object, "saved", tl_run_component_saved(counts));
    tl_figures_json_add_count(object, "caught_up", counts->caught_up);
    tl_figures_json_add_count(object, "unstored", counts->unstored);
    (void)cJSON_AddNumberToObject(object, "difference", (double)tl_run_component_difference(counts));
}

void tl_figures_json_add_components(cJSON *ledger, const tl_run_figures *figures) {
    tl_recorder_component total = tl_run_figures_total(figures);
    cJSON *components = cJSON_AddObjectToObject(ledger, "components");
    for (size_t i = 0; i < figures->ledger_count; i++) {
        add_component(components, figures->ledger[i].name, &figures->ledger[i].counts);
    }
    add_component(ledger, "total", &total);
}

void tl_figures_json_add_resumption(cJSON *object, const tl_resumption *resumption) {
    if (resumption->from == TL_RESUMED_NOT) {
        (void)cJSON_AddNullToObject(object, "resumed");
        return;
    }
    cJSON *resumed = cJSON_AddObjectToObject(object, "resumed");
    (void)cJSON_AddNumberToObject(resumed, "run", (double)resumption->run);
    (void)cJSON_AddNumberToObject(resumed, "tick", (double)resumption->tick);
    (void)cJSON_AddStringToObject(resumed, "from", tl_resumed_from_name(resumption->from));
}
