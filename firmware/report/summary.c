/* The summary of a run: see summary.h. */
#include "firmware/report/summary.h"

#include <cjson/cJSON.h>
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "firmware/text/show_text.h"

/* Rows of the run: each is one committed step of the twin. */
static uint64_t committed(const tl_summary *summary) {
    return summary->steps + summary->outcomes[TL_MADE_UP] + summary->outcomes[TL_FOLLOWED];
}

void tl_summary_add(tl_summary *summary, const tl_config *config, const tl_record *record) {
    for (size_t i = 0; i < config->adjust_count; i++) {
        tl_summary_adjust *adjust = &summary->adjust[i];
        if (committed(summary) == 0) {
            adjust->first = record->u[i];
        }
        adjust->last = record->u[i];
        adjust->sum += record->u[i];
        adjust->delta_sum += record->u[i] - record->u_hat[i];
    }
    summary->steps += record->outcome == TL_MADE_UP || record->outcome == TL_FOLLOWED ? 0 : 1;
    summary->evaluations += record->evaluations;
    summary->optimised_steps += record->evaluations > 1 ? 1 : 0;
    summary->outcomes[record->outcome]++;
    summary->time_limited += record->stop == TL_STOP_TIME ? 1 : 0;
    summary->used_longest = record->used > summary->used_longest ? record->used : summary->used_longest;
}

void tl_summary_sample(tl_summary *summary, const tl_config *config, const tl_sample *sample) {
    summary->samples++;
    for (size_t i = 0; i < config->signal_count; i++) {
        summary->not_good[i] += sample->quality[i] == TL_GOOD ? 0 : 1;
    }
}

static double mean(double sum, uint64_t count) {
    return count == 0 ? 0.0 : sum / (double)count;
}

static uint64_t total_executions(const tl_twin *twin) {
    uint64_t total = 0;
    for (size_t i = 0; i < tl_twin_get_facts(twin).components; i++) {
        total += tl_twin_executions(twin, i);
    }
    return total;
}

static void add_executions(cJSON *root, const tl_twin *twin) {
    cJSON *executions = cJSON_AddObjectToObject(root, "executions");
    (void)cJSON_AddNumberToObject(executions, "total", (double)total_executions(twin));
    for (size_t i = 0; i < tl_twin_get_facts(twin).components; i++) {
        (void)cJSON_AddNumberToObject(executions, tl_twin_component_name(twin, i), (double)tl_twin_executions(twin, i));
    }
}

/* What cannot be told is null: no data must not look like a perfect fit. */
static void add_measure(cJSON *match, const char *name, double value, bool known) {
    if (known) {
        (void)cJSON_AddNumberToObject(match, name, value);
    } else {
        (void)cJSON_AddNullToObject(match, name);
    }
}

static void add_matches(cJSON *root, const tl_config *config, const tl_twin *twin) {
    cJSON *matches = cJSON_AddObjectToObject(root, "match");
    for (size_t i = 0; i < config->match_count; i++) {
        const tl_metrics *metrics = tl_twin_metrics(twin, i);
        cJSON *match = cJSON_AddObjectToObject(matches, config->match[i].variable);
        add_measure(match, "mse", tl_metrics_mse(metrics), metrics->pairs > 1);
        add_measure(match, "max", metrics->maximum, metrics->pairs > 0);
        (void)cJSON_AddStringToObject(match, "unit", tl_twin_match_unit(twin, i));
        (void)cJSON_AddNumberToObject(match, "pairs", (double)metrics->pairs);
    }
}

static void add_adjusted(cJSON *root, const tl_summary *summary, const tl_config *config, const tl_twin *twin) {
    cJSON *variables = cJSON_AddObjectToObject(root, "adjust");
    for (size_t i = 0; i < config->adjust_count; i++) {
        const tl_summary_adjust *adjust = &summary->adjust[i];
        cJSON *variable = cJSON_AddObjectToObject(variables, config->adjust[i].variable);
        (void)cJSON_AddNumberToObject(variable, "first", adjust->first);
        (void)cJSON_AddNumberToObject(variable, "last", adjust->last);
        (void)cJSON_AddNumberToObject(variable, "mean", mean(adjust->sum, committed(summary)));
        (void)cJSON_AddNumberToObject(variable, "delta_mean", mean(adjust->delta_sum, committed(summary)));
        (void)cJSON_AddStringToObject(variable, "unit", tl_twin_adjust_unit(twin, i));
    }
}

/* Δo as measured: what the twin has found is left to be shifted, and Δi. */
static double measured_delay(const tl_config *config, const tl_twin_delay *found) {
    return tl_seconds(found->delay + (config->delays->has_input ? config->delays->input.delay : 0));
}

static const char *state_name(tl_delay_state state) {
    static const char *const names[] = {
        [TL_DELAY_UNKNOWN] = "unknown", [TL_DELAY_KNOWN] = "known", [TL_DELAY_LOST] = "lost"};
    return names[state];
}

static void add_delays(cJSON *root, const tl_config *config, const tl_twin *twin) {
    const tl_config_delays *delays = config->delays;
    if (delays == NULL) {
        return;
    }
    cJSON *object = cJSON_AddObjectToObject(root, "delays");
    add_measure(object, "input_s", tl_seconds(delays->input.delay), delays->has_input);
    add_measure(object, "output_s", tl_seconds(delays->output.delay), delays->has_output);
    if (delays->measure) {
        tl_twin_delay found = tl_twin_get_delay(twin);
        add_measure(object, "measured_s", measured_delay(config, &found), found.state != TL_DELAY_UNKNOWN);
        (void)cJSON_AddStringToObject(object, "state", state_name(found.state));
        (void)cJSON_AddNumberToObject(object, "confidence", found.confidence);
    }
}

static void add_plant(cJSON *root, const tl_summary *summary, const tl_config *config) {
    cJSON *plant = cJSON_AddObjectToObject(root, "plant");
    for (size_t i = 0; i < config->signal_count; i++) {
        cJSON *signal = cJSON_AddObjectToObject(plant, config->signals[i].plan.name);
        (void)cJSON_AddNumberToObject(signal, "samples", (double)summary->samples);
        (void)cJSON_AddNumberToObject(signal, "not_good", (double)summary->not_good[i]);
    }
}

/* Of all components together. */
static tl_twin_ledger total_ledger(const tl_twin *twin) {
    tl_twin_ledger total = {0};
    for (size_t i = 0; i < tl_twin_get_facts(twin).components; i++) {
        tl_twin_ledger entry = tl_twin_get_ledger(twin, i);
        total.nodes_peak = entry.nodes_peak > total.nodes_peak ? entry.nodes_peak : total.nodes_peak;
        total.plain += entry.plain;
        total.predicted += entry.predicted;
        total.executions += entry.executions;
        total.caught_up += entry.caught_up;
        total.unstored += entry.unstored;
        total.difference += entry.difference;
    }
    return total;
}

/* Executions that were not needed; less than 0 where catching up cost more than was saved. */
static double saved(const tl_twin_ledger *entry) {
    return (double)entry->plain - (double)entry->executions;
}

static void add_cache(cJSON *root, const tl_twin *twin) {
    tl_twin_ledger total = total_ledger(twin);
    cJSON *cache = cJSON_AddObjectToObject(root, "cache");
    (void)cJSON_AddNumberToObject(cache, "saved", saved(&total));
    (void)cJSON_AddNumberToObject(cache, "nodes_peak", (double)total.nodes_peak);
    (void)cJSON_AddNumberToObject(cache, "full", (double)total.unstored);
}

static void add_ledger_entry(cJSON *ledger, const char *name, const tl_twin_ledger *entry) {
    cJSON *object = cJSON_AddObjectToObject(ledger, name);
    (void)cJSON_AddNumberToObject(object, "plain", (double)entry->plain);
    (void)cJSON_AddNumberToObject(object, "predicted", (double)entry->predicted);
    (void)cJSON_AddNumberToObject(object, "executions", (double)entry->executions);
    (void)cJSON_AddNumberToObject(object, "saved", saved(entry));
    (void)cJSON_AddNumberToObject(object, "caught_up", (double)entry->caught_up);
    (void)cJSON_AddNumberToObject(object, "unstored", (double)entry->unstored);
    (void)cJSON_AddNumberToObject(object, "difference", (double)entry->difference);
}

/* What the graph predicts against what was done. */
static void add_ledger(cJSON *root, const tl_twin *twin) {
    tl_twin_ledger total = total_ledger(twin);
    cJSON *ledger = cJSON_AddObjectToObject(root, "ledger");
    (void)cJSON_AddBoolToObject(ledger, "complete", tl_twin_ledger_is_complete(twin));
    cJSON *components = cJSON_AddObjectToObject(ledger, "components");
    for (size_t i = 0; i < tl_twin_get_facts(twin).components; i++) {
        tl_twin_ledger entry = tl_twin_get_ledger(twin, i);
        add_ledger_entry(components, entry.name, &entry);
    }
    add_ledger_entry(ledger, "total", &total);
}

static void add_outcomes(cJSON *root, const tl_summary *summary) {
    cJSON *outcomes = cJSON_AddObjectToObject(root, "outcomes");
    for (int i = 0; i < TL_OUTCOMES; i++) {
        (void)cJSON_AddNumberToObject(outcomes, tl_outcome_name((tl_outcome)i), (double)summary->outcomes[i]);
    }
}

/* Null where the run has begun anew. */
static void add_resumption(cJSON *root, const tl_resumption *resumption) {
    if (resumption->from == TL_RESUMED_NOT) {
        (void)cJSON_AddNullToObject(root, "resumed");
        return;
    }
    cJSON *object = cJSON_AddObjectToObject(root, "resumed");
    (void)cJSON_AddNumberToObject(object, "run", (double)resumption->run);
    (void)cJSON_AddNumberToObject(object, "tick", (double)resumption->tick);
    (void)cJSON_AddStringToObject(object, "from", tl_resumed_from_name(resumption->from));
}

void tl_summary_print_json(const tl_summary *summary, const tl_config *config, const tl_twin *twin, FILE *file) {
    cJSON *root = cJSON_CreateObject();
    (void)cJSON_AddNumberToObject(root, "steps", (double)summary->steps);
    add_executions(root, twin);
    (void)cJSON_AddNumberToObject(root, "evaluations", (double)summary->evaluations);
    (void)cJSON_AddNumberToObject(root, "optimised_steps", (double)summary->optimised_steps);
    add_matches(root, config, twin);
    add_plant(root, summary, config);
    add_adjusted(root, summary, config, twin);
    add_delays(root, config, twin);
    add_cache(root, twin);
    add_ledger(root, twin);
    add_outcomes(root, summary);
    (void)cJSON_AddNumberToObject(root, "ticks", (double)summary->ticks);
    (void)cJSON_AddNumberToObject(root, "skipped", (double)summary->skipped);
    (void)cJSON_AddNumberToObject(root, "deadline_misses", (double)summary->deadline_misses);
    (void)cJSON_AddNumberToObject(root, "time_limited", (double)summary->time_limited);
    add_resumption(root, &summary->resumption);
    (void)cJSON_AddNumberToObject(root, "wall_s", summary->wall_s);
    char *text = cJSON_Print(root);
    if (text != NULL) {
        (void)fprintf(file, "%s\n", text);
    }
    cJSON_free(text);
    cJSON_Delete(root);
}

static void print_outcomes(const tl_summary *summary, FILE *file) {
    const char *separator = "";
    for (int i = 0; i < TL_OUTCOMES; i++) {
        if (summary->outcomes[i] != 0) {
            (void)fprintf(file, "%s%" PRIu64 " %s", separator, summary->outcomes[i], tl_outcome_name((tl_outcome)i));
            separator = ", ";
        }
    }
    (void)fputc('\n', file);
}

static void print_executions(const tl_summary *summary, const tl_twin *twin, FILE *file) {
    uint64_t executions = total_executions(twin);
    uint64_t floor_executions = committed(summary) * tl_twin_get_facts(twin).components;
    (void)fprintf(file, "  executions   %" PRIu64 " (%.3f per free-running one), %" PRIu64 " evaluations\n", executions,
                  floor_executions == 0 ? 0.0 : (double)executions / (double)floor_executions, summary->evaluations);
}

static void print_ledger(const tl_twin *twin, FILE *file) {
    tl_twin_ledger total = total_ledger(twin);
    (void)fprintf(file, "  ledger       predicted %s%" PRIu64 ", without saving %" PRIu64 ", saved %.0f\n",
                  tl_twin_ledger_is_complete(twin) ? "" : "at most ", total.predicted, total.plain, saved(&total));
    if (total.caught_up + total.unstored != 0) {
        (void)fprintf(file, "               %" PRIu64 " caught up, %" PRIu64 " results found no room\n",
                      total.caught_up, total.unstored);
    }
}

/* A dash where JSON has null: the square of a large difference may be more than a number can be. */
static void write_measure(double value, int digits, char *text, size_t size) {
    if (isfinite(value)) {
        (void)snprintf(text, size, "%.*g", digits, value);
    } else {
        (void)snprintf(text, size, "-");
    }
}

/* " mm²", " (rad/s)²", nothing for no unit. */
static void write_square(const char *unit, char *text, size_t size) {
    bool compound = strpbrk(unit, "./*^ 0123456789") != NULL;
    (void)snprintf(text, size, "%s%s%s%s", unit[0] == '\0' ? "" : " ", compound ? "(" : "", unit,
                   compound          ? ")\302\262"
                   : unit[0] == '\0' ? ""
                                     : "\302\262");
}

static const char *space_before(const char *unit) {
    return unit[0] == '\0' ? "" : " ";
}

static void print_matches(const tl_config *config, const tl_twin *twin, FILE *file) {
    for (size_t i = 0; i < config->match_count; i++) {
        const tl_metrics *metrics = tl_twin_metrics(twin, i);
        const char *unit = tl_show_unit(tl_twin_match_unit(twin, i));
        if (metrics->pairs < 2) {
            (void)fprintf(file, "  %-12s fewer than two good measurements: nothing to compare\n",
                          config->match[i].variable);
        } else {
            char mse[32];
            char maximum[32];
            char square[128];
            write_measure(tl_metrics_mse(metrics), 5, mse, sizeof mse);
            write_measure(metrics->maximum, 4, maximum, sizeof maximum);
            write_square(unit, square, sizeof square);
            (void)fprintf(file, "  %-12s MSE %s%s, MAX %s%s%s%s\n", config->match[i].variable, mse, square, maximum,
                          space_before(unit), unit,
                          config->match[i].weight > 0.0 || config->adjust_count == 0 ? "" : ", compared only");
        }
        if (metrics->left_out != 0) {
            (void)fprintf(file, "  %-12s %" PRIu64 " of %" PRIu64 " measurements were not good and are left out\n", "",
                          metrics->left_out, metrics->left_out + metrics->pairs);
        }
    }
}

static bool is_matched(const tl_config *config, size_t signal) {
    const char *name = config->signals[signal].plan.name;
    for (size_t i = 0; i < config->match_count; i++) {
        if (strcmp(config->matched_as[i] + strlen("plant."), name) == 0) {
            return true;
        }
    }
    return false;
}

/* Of those that are matched it was told above. */
static void print_inputs(const tl_summary *summary, const tl_config *config, FILE *file) {
    for (size_t i = 0; i < config->signal_count; i++) {
        if (summary->not_good[i] != 0 && !is_matched(config, i)) {
            (void)fprintf(file,
                          "  plant.%s: %" PRIu64 " of %" PRIu64
                          " samples were not good; its last good value was held meanwhile\n",
                          config->signals[i].plan.name, summary->not_good[i], summary->samples);
        }
    }
}

/* Of a Boolean: how often it was on, and how often it would have been. */
static void print_boolean(const tl_summary_adjust *adjust, const char *name, uint64_t steps, FILE *file) {
    double on = mean(adjust->sum, steps);
    double nominal = mean(adjust->sum - adjust->delta_sum, steps);
    (void)fprintf(file, "  %-12s on in %.1f %% of the steps, last %s; nominal in %.1f %%\n", name, 100 * on,
                  adjust->last > 0.5 ? "on" : "off", 100 * nominal);
}

static void print_adjusted(const tl_summary *summary, const tl_config *config, const tl_twin *twin, FILE *file) {
    for (size_t i = 0; i < config->adjust_count; i++) {
        const tl_summary_adjust *adjust = &summary->adjust[i];
        const char *name = config->adjust[i].variable;
        const char *unit = tl_show_unit(tl_twin_adjust_unit(twin, i));
        uint64_t steps = committed(summary);
        if (!tl_twin_get_adjusted(twin, i).is_real) {
            print_boolean(adjust, name, steps, file);
        } else {
            (void)fprintf(file, "  %-12s mean %.5g, last %.5g%s%s; mean \316\224u %+.4g\n", name,
                          mean(adjust->sum, steps), adjust->last, space_before(unit), unit,
                          mean(adjust->delta_sum, steps));
        }
    }
}

static void print_delays(const tl_config *config, const tl_twin *twin, FILE *file) {
    if (config->delays == NULL || !config->delays->measure) {
        return;
    }
    tl_twin_delay found = tl_twin_get_delay(twin);
    if (found.state == TL_DELAY_UNKNOWN) {
        (void)fprintf(file, "  delay        not found: confidence %.2f\n", found.confidence);
    } else {
        (void)fprintf(file, "  delay        measured \316\224o = %.4g ms, confidence %.2f%s\n",
                      measured_delay(config, &found) * 1e3, found.confidence,
                      found.state == TL_DELAY_LOST ? ": lost" : "");
    }
}

void tl_summary_print_table(const tl_summary *summary, const tl_config *config, const tl_twin *twin, FILE *file) {
    (void)fprintf(file, "%s\n", config->name);
    (void)fprintf(file, "  steps        %" PRIu64 " of %g s: ", summary->steps, tl_seconds(config->step));
    print_outcomes(summary, file);
    print_executions(summary, twin, file);
    if (config->adjust_count != 0) {
        print_ledger(twin, file);
    }
    print_matches(config, twin, file);
    print_inputs(summary, config, file);
    print_adjusted(summary, config, twin, file);
    print_delays(config, twin, file);
    if (summary->ticks != 0) {
        (void)fprintf(file,
                      "  real time    %" PRIu64 " ticks, %" PRIu64 " skipped, %" PRIu64
                      " deadlines missed, longest cycle %.3f ms\n",
                      summary->ticks, summary->skipped, summary->deadline_misses,
                      tl_seconds(summary->used_longest) * 1e3);
    }
    (void)fprintf(file, "  took         %.3f s\n", summary->wall_s);
}
