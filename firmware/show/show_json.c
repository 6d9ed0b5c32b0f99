/* The same numbers as the page, for programs: one JSON object. */
#include <cjson/cJSON.h>
#include <math.h>

#include "firmware/config/measurements.h"
#include "firmware/record/history_rows.h"
#include "firmware/show/show.h"
#include "firmware/show/show_summary.h"

enum { EVENTS_SHOWN = 10 };

/* JSON has no NaN and no infinity: null. A failed allocation is seen at the end, when the object is printed. */
static void add_number(cJSON *object, const char *key, double value) {
    if (isfinite(value)) {
        (void)cJSON_AddNumberToObject(object, key, value);
    } else {
        (void)cJSON_AddNullToObject(object, key);
    }
}

static void add_count(cJSON *object, const char *key, uint64_t value) {
    (void)cJSON_AddNumberToObject(object, key, (double)value);
}

static void add_text(cJSON *object, const char *key, const char *text) {
    if (text == NULL) {
        (void)cJSON_AddNullToObject(object, key);
    } else {
        (void)cJSON_AddStringToObject(object, key, text);
    }
}

/* Null where the run has begun anew. */
static void add_resumption(cJSON *run, const tl_resumption *resumption) {
    if (resumption->from == TL_RESUMED_NOT) {
        (void)cJSON_AddNullToObject(run, "resumed");
        return;
    }
    cJSON *object = cJSON_AddObjectToObject(run, "resumed");
    add_number(object, "run", (double)resumption->run);
    add_number(object, "tick", (double)resumption->tick);
    add_text(object, "from", tl_resumed_from_name(resumption->from));
}

static void add_run(cJSON *array, const tl_history_run *run) {
    cJSON *object = cJSON_CreateObject();
    (void)cJSON_AddItemToArray(array, object);
    add_number(object, "run", (double)run->run);
    add_text(object, "verb", run->verb);
    add_text(object, "name", run->name);
    add_text(object, "version", run->version);
    add_text(object, "configuration", run->configuration_hash);
    add_text(object, "started", run->started);
    add_text(object, "ended", run->ended);
    add_text(object, "ended_reason", run->ended_reason);
    add_text(object, "committed", run->committed);
    add_number(object, "step_s", tl_seconds(run->step));
    add_count(object, "prediction", run->prediction);
    add_count(object, "lead", run->lead);
    add_text(object, "measurements", tl_measurements_name(run->measurements));
    add_count(object, "samples", run->samples);
    add_count(object, "steps", run->steps);
    add_count(object, "events", run->events);
    add_count(object, "lost", run->lost);
    add_number(object, "removed_before", (double)run->removed_before);
    add_resumption(object, &run->resumption);
}

static tl_status add_runs(cJSON *root, const tl_show_request *request, tl_error *error) {
    const tl_history_run *runs = NULL;
    size_t count = 0;
    tl_status status = tl_history_runs(request->history, &runs, &count, error);
    cJSON *array = cJSON_AddArrayToObject(root, "runs");
    for (size_t i = 0; status == TL_OK && i < count; i++) {
        add_run(array, &runs[i]);
    }
    return status;
}

static void add_steps(cJSON *root, const tl_show_summary *summary) {
    cJSON *outcomes = NULL;
    add_count(root, "steps", summary->steps - summary->outcomes[TL_MADE_UP] - summary->outcomes[TL_FOLLOWED]);
    if (summary->any) {
        add_number(root, "first_step", (double)summary->range[0]);
        add_number(root, "last_step", (double)summary->range[1]);
    }
    add_count(root, "evaluations", summary->evaluations);
    add_count(root, "optimised_steps", summary->optimised_steps);
    add_count(root, "time_limited", summary->time_limited);
    outcomes = cJSON_AddObjectToObject(root, "outcomes");
    for (int i = TL_FREE; i < TL_OUTCOMES; i++) {
        add_count(outcomes, tl_outcome_name((tl_outcome)i), summary->outcomes[i]);
    }
}

static void add_counts(cJSON *parent, const char *key, const tl_recorder_component *counts) {
    cJSON *object = cJSON_AddObjectToObject(parent, key);
    add_count(object, "plain", counts->plain);
    add_count(object, "predicted", counts->predicted);
    add_count(object, "executions", counts->executions);
    (void)cJSON_AddNumberToObject(object, "saved", (double)counts->plain - (double)counts->executions);
    add_count(object, "caught_up", counts->caught_up);
    add_count(object, "unstored", counts->unstored);
    (void)cJSON_AddNumberToObject(object, "difference",
                                  (double)counts->executions - (double)counts->caught_up - (double)counts->predicted);
}

static void add_ledger(cJSON *root, const tl_show_summary *summary) {
    if (summary->ledger_count == 0) {
        (void)cJSON_AddNullToObject(root, "ledger");
        return;
    }
    cJSON *ledger = cJSON_AddObjectToObject(root, "ledger");
    cJSON *components = cJSON_AddObjectToObject(ledger, "components");
    for (size_t i = 0; i < summary->ledger_count; i++) {
        add_counts(components, summary->ledger[i].name, &summary->ledger[i].counts);
    }
    add_counts(ledger, "total", &summary->total);
}

static void add_matches(cJSON *root, const tl_show_summary *summary) {
    cJSON *matches = cJSON_AddObjectToObject(root, "match");
    for (size_t i = 0; i < summary->match_count; i++) {
        const tl_show_match *match = &summary->match[i];
        cJSON *object = cJSON_AddObjectToObject(matches, match->signal->name);
        add_text(object, "to", match->signal->to);
        add_number(object, "mse", tl_metrics_mse(&match->metrics));
        add_number(object, "max", match->metrics.maximum);
        add_text(object, "unit", match->signal->unit);
        add_count(object, "pairs", match->metrics.pairs);
        add_count(object, "left_out", match->metrics.left_out);
    }
}

static void add_windows(cJSON *object, const tl_show_request *request, const tl_show_summary *summary,
                        const tl_show_adjust *adjust) {
    cJSON *array = cJSON_AddArrayToObject(object, "windows");
    for (size_t i = 0; i < summary->windows; i++) {
        int64_t step = tl_show_window_start(summary, i);
        cJSON *window = cJSON_CreateObject();
        (void)cJSON_AddItemToArray(array, window);
        add_number(window, "from_step", (double)step);
        add_number(window, "from_s", (double)step * tl_seconds(request->run->step));
        if (tl_show_is_live(request->run)) {
            char utc[TL_UTC_TEXT];
            tl_utc_text(tl_show_instant(request->run, step), utc);
            add_text(window, "from", utc);
        }
        add_count(window, "steps", adjust->windows[i].count);
        add_number(window, "delta_mean", tl_show_part_mean(&adjust->windows[i]));
    }
}

static void add_adjusted(cJSON *root, const tl_show_request *request, const tl_show_summary *summary) {
    cJSON *variables = cJSON_AddObjectToObject(root, "adjust");
    for (size_t i = 0; i < summary->adjust_count; i++) {
        const tl_show_adjust *adjust = &summary->adjust[i];
        cJSON *object = cJSON_AddObjectToObject(variables, adjust->signal->name);
        double count = adjust->count == 0 ? (double)NAN : (double)adjust->count;
        add_number(object, "first", adjust->count == 0 ? (double)NAN : adjust->first);
        add_number(object, "last", adjust->count == 0 ? (double)NAN : adjust->last);
        add_number(object, "mean", adjust->sum / count);
        add_number(object, "delta_mean", adjust->delta_sum / count);
        add_number(object, "min", adjust->count == 0 ? (double)NAN : adjust->least);
        add_number(object, "max", adjust->count == 0 ? (double)NAN : adjust->largest);
        add_text(object, "unit", adjust->signal->unit);
        add_windows(object, request, summary, adjust);
    }
}

static void take_event(void *context, const tl_history_event *event) {
    cJSON *object = cJSON_CreateObject();
    (void)cJSON_AddItemToArray(context, object);
    add_text(object, "at", event->at);
    add_number(object, "tick", event->has_tick ? (double)event->tick : (double)NAN);
    add_text(object, "severity", event->severity);
    add_text(object, "source", event->source);
    add_text(object, "text", event->text);
}

static tl_status fill(cJSON *root, const tl_show_request *request, tl_error *error) {
    tl_show_summary summary;
    tl_status status = tl_show_summarise(request->history, request->run, request->from_step, &summary, error);
    if (status != TL_OK) {
        return status;
    }
    add_text(root, "file", request->path);
    status = add_runs(root, request, error);
    if (status != TL_OK) {
        return status;
    }
    add_number(root, "run", (double)request->run->run);
    add_steps(root, &summary);
    add_matches(root, &summary);
    add_adjusted(root, request, &summary);
    add_ledger(root, &summary);
    const tl_history_visitor visitor = {.context = cJSON_AddArrayToObject(root, "events"), .event = take_event};
    return tl_history_events(request->history, request->run, request->from_at, request->all_events ? -1 : EVENTS_SHOWN,
                             &visitor, error);
}

tl_status tl_show_json(const tl_show_request *request, FILE *file, tl_error *error) {
    cJSON *root = cJSON_CreateObject();
    tl_status status = fill(root, request, error);
    char *text = status == TL_OK ? cJSON_Print(root) : NULL;
    if (text != NULL) {
        (void)fprintf(file, "%s\n", text);
    } else if (status == TL_OK) {
        status = tl_fail(error, TL_TRY_AGAIN, "out of memory");
    }
    cJSON_free(text);
    cJSON_Delete(root);
    return status;
}
