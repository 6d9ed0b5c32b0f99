/* Key figures of a run: see run_figures.h. */
#include "firmware/report/run_figures.h"

#include <inttypes.h>
#include <math.h>

#include "firmware/base/text.h"

/* ---- run figures ---- */

void tl_run_figures_add_step(tl_run_figures *figures, const tl_history_step *step, tl_time period) {
    figures->steps += step->outcome == TL_CAUGHT_UP || step->outcome == TL_RESUMED ? 0 : 1;
    figures->evaluations += (uint64_t)step->evaluations;
    figures->optimised_steps += step->evaluations > 1 ? 1 : 0;
    figures->rested += (step->flags & TL_FLAG_RESTS) != 0 ? 1 : 0;
    figures->refused += (step->flags & TL_FLAG_REFUSED) != 0 ? 1 : 0;
    figures->time_limited += step->stop == TL_STOP_TIME ? 1 : 0;
    figures->late += step->used > period ? 1 : 0;
    figures->longest = step->used > figures->longest ? step->used : figures->longest;
    if (step->outcome >= TL_FREE && step->outcome < TL_OUTCOMES) {
        figures->outcomes[step->outcome]++;
    }
}

void tl_run_figures_add_adjusted(tl_run_figures *figures, size_t adjust, double u, double nominal) {
    tl_run_adjusted *adjusted = &figures->adjust[adjust];
    if (adjusted->count == 0) {
        adjusted->first = u;
    }
    adjusted->last = u;
    adjusted->count++;
    adjusted->sum += u;
    adjusted->correction_sum += u - nominal;
}

void tl_run_figures_take_account(tl_run_figures *figures, const tl_account *account) {
    for (size_t i = 0; i < account->matches; i++) {
        figures->match[i] = account->match[i].metrics;
        figures->readings[i] = account->match[i].readings;
        figures->released[i] = account->match[i].released;
    }
    figures->ledger_count = account->components;
    for (size_t i = 0; i < account->components; i++) {
        const tl_account_component *entry = &account->component[i];
        figures->ledger[i] = (tl_run_component){
            entry->name, {entry->plain, entry->predicted, entry->executions, entry->repeated, entry->uncached}};
        figures->nodes_peak = entry->nodes_peak > figures->nodes_peak ? entry->nodes_peak : figures->nodes_peak;
    }
}

uint64_t tl_run_figures_committed(const tl_run_figures *figures) {
    return figures->steps + figures->outcomes[TL_CAUGHT_UP] + figures->outcomes[TL_RESUMED];
}

bool tl_run_figures_print_outcomes(const tl_run_figures *figures, const char *before, FILE *file) {
    const char *separator = before;
    for (int i = 0; i < TL_OUTCOMES; i++) {
        if (figures->outcomes[i] != 0) {
            (void)fprintf(file, "%s%" PRIu64 " %s", separator, figures->outcomes[i], tl_outcome_name((tl_outcome)i));
            separator = ", ";
        }
    }
    return separator != before;
}

static double find_mse(const tl_metrics *metrics) {
    return metrics->pairs > 1 ? tl_metrics_mse(metrics) : (double)NAN;
}

double tl_run_figures_mse(const tl_run_figures *figures, size_t match) {
    return find_mse(&figures->match[match]);
}

double tl_run_figures_mse_readings(const tl_run_figures *figures, size_t match) {
    return find_mse(&figures->readings[match]);
}

double tl_run_figures_mse_released(const tl_run_figures *figures, size_t match) {
    return find_mse(&figures->released[match]);
}

double tl_run_figures_maximum(const tl_run_figures *figures, size_t match) {
    return figures->match[match].pairs > 0 ? figures->match[match].maximum : (double)NAN;
}

static double mean_of(const tl_run_adjusted *adjusted, double sum) {
    return adjusted->count > 0 ? sum / (double)adjusted->count : (double)NAN;
}

double tl_run_figures_mean(const tl_run_figures *figures, size_t adjust) {
    return mean_of(&figures->adjust[adjust], figures->adjust[adjust].sum);
}

double tl_run_figures_correction_mean(const tl_run_figures *figures, size_t adjust) {
    return mean_of(&figures->adjust[adjust], figures->adjust[adjust].correction_sum);
}

tl_execution_counts tl_run_figures_total(const tl_run_figures *figures) {
    tl_execution_counts total = {0};
    for (size_t i = 0; i < figures->ledger_count; i++) {
        const tl_execution_counts *counts = &figures->ledger[i].counts;
        total.plain += counts->plain;
        total.predicted += counts->predicted;
        total.executions += counts->executions;
        total.repeated += counts->repeated;
        total.uncached += counts->uncached;
    }
    return total;
}

double tl_run_component_saved(const tl_execution_counts *counts) {
    return (double)counts->plain - (double)counts->executions;
}

int64_t tl_run_component_difference(const tl_execution_counts *counts) {
    return (int64_t)(counts->executions - counts->repeated - counts->predicted);
}

/* ---- figures json ---- */

void tl_figures_json_add_outcomes(tl_json_writer *json, const tl_run_figures *figures) {
    tl_json_open_object(json, "outcomes");
    for (int i = TL_FREE; i < TL_OUTCOMES; i++) {
        tl_json_add_count(json, tl_outcome_name((tl_outcome)i), figures->outcomes[i]);
    }
    tl_json_close(json);
}

void tl_figures_json_add_match(tl_json_writer *json, const tl_run_figures *figures, size_t match, const char *unit) {
    tl_json_add_number(json, "mse", tl_run_figures_mse(figures, match));
    tl_json_add_number(json, "max", tl_run_figures_maximum(figures, match));
    tl_json_add_number(json, "mse_readings", tl_run_figures_mse_readings(figures, match));
    tl_json_add_number(json, "mse_released", tl_run_figures_mse_released(figures, match));
    tl_json_add_text(json, "unit", unit);
    tl_json_add_count(json, "pairs", figures->match[match].pairs);
    tl_json_add_count(json, "left_out", figures->match[match].left_out);
    tl_json_add_count(json, "readings", figures->readings[match].pairs);
    tl_json_add_count(json, "rejected", figures->readings[match].left_out);
}

static void add_component(tl_json_writer *json, const char *name, const tl_execution_counts *counts) {
    tl_json_open_object(json, name);
    tl_json_add_count(json, "plain", counts->plain);
    tl_json_add_count(json, "predicted", counts->predicted);
    tl_json_add_count(json, "executions", counts->executions);
    tl_json_add_number(json, "saved", tl_run_component_saved(counts));
    tl_json_add_count(json, "repeated", counts->repeated);
    tl_json_add_count(json, "uncached", counts->uncached);
    tl_json_add_number(json, "difference", (double)tl_run_component_difference(counts));
    tl_json_close(json);
}

void tl_figures_json_add_components(tl_json_writer *json, const tl_run_figures *figures) {
    tl_execution_counts total = tl_run_figures_total(figures);
    tl_json_open_object(json, "components");
    for (size_t i = 0; i < figures->ledger_count; i++) {
        add_component(json, figures->ledger[i].name, &figures->ledger[i].counts);
    }
    tl_json_close(json);
    add_component(json, "total", &total);
}

void tl_figures_json_add_resumption(tl_json_writer *json, const tl_resumption *resumption) {
    if (resumption->from == TL_RESUMED_NOT) {
        tl_json_add_text(json, "resumed", NULL);
        return;
    }
    tl_json_open_object(json, "resumed");
    tl_json_add_number(json, "run", (double)resumption->run);
    tl_json_add_number(json, "tick", (double)resumption->tick);
    tl_json_add_text(json, "from", tl_resumed_from_name(resumption->from));
    tl_json_close(json);
}

static void add_standing(tl_json_writer *json, const tl_lock_standing *standing) {
    static const char *const reasons[] = {[TL_LOCK_REASON_CORRECTION] = "correction",
                                          [TL_LOCK_REASON_BOUND] = "bound",
                                          [TL_LOCK_REASON_RELEASED] = "released"};
    unsigned reason = standing->reason;
    if (reason == TL_LOCK_REASON_NONE || reason >= sizeof reasons / sizeof reasons[0]) {
        tl_json_add_text(json, "corrected", NULL);
        return;
    }
    char utc[TL_UTC_TEXT];
    tl_utc_text(tl_lock_utc(standing->since_s, standing->started), utc);
    tl_json_open_object(json, "corrected");
    tl_json_add_text(json, "reason", reasons[reason]);
    tl_json_add_text(json, "variable", standing->variable);
    tl_json_add_number(json, "value", standing->value);
    tl_json_add_text(json, "unit", standing->unit);
    tl_json_add_number(json, "since_s", standing->since_s);
    tl_json_add_text(json, "since", standing->started != 0 ? utc : NULL);
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
    add_standing(json, &lock->standing);
}
