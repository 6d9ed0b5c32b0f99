/* Key figures as JSON: see figures_json.h. */
#include "firmware/report/figures_json.h"

void tl_figures_json_add_outcomes(tl_json_writer *json, const tl_run_figures *figures) {
    tl_json_open_object(json, "outcomes");
    for (int i = TL_FREE; i < TL_OUTCOMES; i++) {
        tl_json_add_count(json, tl_outcome_name((tl_outcome)i), figures->outcomes[i]);
    }
    tl_json_close(json);
}

static void add_component(tl_json_writer *json, const char *name, const tl_recorder_component *counts) {
    tl_json_open_object(json, name);
    tl_json_add_count(json, "plain", counts->plain);
    tl_json_add_count(json, "predicted", counts->predicted);
    tl_json_add_count(json, "executions", counts->executions);
    tl_json_add_number(json, "saved", tl_run_component_saved(counts));
    tl_json_add_count(json, "caught_up", counts->caught_up);
    tl_json_add_count(json, "unstored", counts->unstored);
    tl_json_add_number(json, "difference", (double)tl_run_component_difference(counts));
    tl_json_close(json);
}

void tl_figures_json_add_components(tl_json_writer *json, const tl_run_figures *figures) {
    tl_recorder_component total = tl_run_figures_total(figures);
    tl_json_open_object(json, "components");
    for (size_t i = 0; i < figures->ledger_count; i++) {
        add_component(json, figures->ledger[i].name, &figures->ledger[i].counts);
    }
    tl_json_close(json);
    add_component(json, "total", &total);
}

void tl_figures_json_add_resumption(tl_json_writer *json, const tl_resumption *resumption) {
    if (resumption->from == TL_RESUMED_NOT) {
        tl_json_add_null(json, "resumed");
        return;
    }
    tl_json_open_object(json, "resumed");
    tl_json_add_number(json, "run", (double)resumption->run);
    tl_json_add_number(json, "tick", (double)resumption->tick);
    tl_json_add_text(json, "from", tl_resumed_from_name(resumption->from));
    tl_json_close(json);
}

void tl_figures_json_add_lock(tl_json_writer *json, const tl_lock_tally *lock) {
    tl_json_add_text(json, "state", tl_lock_state_name(lock->state));
    tl_json_add_number(json, "percent", tl_lock_tally_percent(lock));
    tl_json_open_object(json, "steps");
    for (int i = 0; i < TL_LOCK_STATES; i++) {
        tl_json_add_count(json, tl_lock_state_name((tl_lock_state)i), lock->steps[i]);
    }
    tl_json_close(json);
    tl_json_add_count(json, "changes", lock->changes);
    tl_json_add_count(json, "losses", lock->losses);
}
