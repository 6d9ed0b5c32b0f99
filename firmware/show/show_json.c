/* The same numbers as the page, for programs: one JSON object. */
#include <cjson/cJSON.h>
#include <math.h>

#include "firmware/config/measurements.h"
#include "firmware/report/figures_json.h"
#include "firmware/show/show.h"
#include "firmware/show/show_rows.h"
#include "firmware/show/show_summary.h"

enum { EVENTS_SHOWN = 10 };

static void add_text(cJSON *object, const char *key, const char *text) {
    if (text == NULL) {
        (void)cJSON_AddNullToObject(object, key);
    } else {
        (void)cJSON_AddStringToObject(object, key, text);
    }
}

static void add_run(cJSON *array, const tl_history_run *run) {
    cJSON *object = cJSON_CreateObject();
    (void)cJSON_AddItemToArray(array, object);
    tl_figures_json_add_number(object, "run", (double)run->run);
    add_text(object, "verb", run->verb);
    add_text(object, "name", run->name);
    add_text(object, "version", run->version);
    add_text(object, "configuration", run->configuration_hash);
    add_text(object, "started", run->started);
    add_text(object, "ended", run->ended);
    add_text(object, "ended_reason", run->ended_reason);
    add_text(object, "committed", run->committed);
    tl_figures_json_add_number(object, "step_s", tl_seconds(run->step));
    tl_figures_json_add_count(object, "prediction", run->prediction);
    tl_figures_json_add_count(object, "lead", run->lead);
    add_text(object, "measurements", tl_measurements_name(run->measurements));
    tl_figures_json_add_count(object, "samples", run->samples);
    tl_figures_json_add_count(object, "steps", run->steps);
    tl_figures_json_add_count(object, "events", run->events);
    tl_figures_json_add_count(object, "lost", run->lost);
    tl_figures_json_add_number(object, "removed_before", (double)run->removed_before);
    tl_figures_json_add_resumption(object, &run->resumption);
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
    const tl_run_figures *figures = &summary->figures;
    tl_figures_json_add_count(root, "steps", figures->steps);
    if (summary->any) {
        tl_figures_json_add_number(root, "first_step", (double)summary->range[0]);
        tl_figures_json_add_number(root, "last_step", (double)summary->range[1]);
    }
    tl_figures_json_add_count(root, "evaluations", figures->evaluations);
    tl_figures_json_add_count(root, "optimised_steps", figures->optimised_steps);
    tl_figures_json_add_count(root, "time_limited", figures->time_limited);
    tl_figures_json_add_outcomes(root, figures);
}

static void add_ledger(cJSON *root, const tl_run_figures *figures) {
    if (figures->ledger_count == 0) {
        (void)cJSON_AddNullToObject(root, "ledger");
    } else {
        tl_figures_json_add_components(cJSON_AddObjectToObject(root, "ledger"), figures);
    }
}

static void add_matches(cJSON *root, const tl_show_summary *summary) {
    cJSON *matches = cJSON_AddObjectToObject(root, "match");
    for (size_t i = 0; i < summary->match_count; i++) {
        const tl_recorder_signal *signal = &summary->match[i];
        const tl_metrics *metrics = &summary->figures.match[i];
        cJSON *object = cJSON_AddObjectToObject(matches, signal->name);
        add_text(object, "to", signal->to);
        tl_figures_json_add_number(object, "mse", tl_metrics_mse(metrics));
        tl_figures_json_add_number(object, "max", metrics->maximum);
        add_text(object, "unit", signal->unit);
        tl_figures_json_add_count(object, "pairs", metrics->pairs);
        tl_figures_json_add_count(object, "left_out", metrics->left_out);
    }
}

static void add_windows(cJSON *object, const tl_show_request *request, const tl_show_summary *summary,
                        const tl_show_adjust *adjust) {
    cJSON *array = cJSON_AddArrayToObject(object, "windows");
    for (size_t i = 0; i < summary->windows; i++) {
        int64_t step = tl_show_window_start(summary, i);
        cJSON *window = cJSON_CreateObject();
        (void)cJSON_AddItemToArray(array, window);
        tl_figures_json_add_number(window, "from_step", (double)step);
        tl_figures_json_add_number(window, "from_s", (double)step * tl_seconds(request->run->step));
        if (tl_show_is_live(request->run)) {
            char utc[TL_UTC_TEXT];
            tl_utc_text(tl_show_instant(request->run, step), utc);
            add_text(window, "from", utc);
        }
        tl_figures_json_add_count(window, "steps", adjust->windows[i].count);
        tl_figures_json_add_number(window, "delta_mean", tl_show_part_mean(&adjust->windows[i]));
    }
}

static void add_adjusted(cJSON *root, const tl_show_request *request, const tl_show_summary *summary) {
    cJSON *variables = cJSON_AddObjectToObject(root, "adjust");
    for (size_t i = 0; i < summary->adjust_count; i++) {
        const tl_run_adjusted *adjusted = &summary->figures.adjust[i];
        const tl_show_adjust *detail = &summary->detail[i];
        cJSON *object = cJSON_AddObjectToObject(variables, summary->adjust[i].name);
        bool any = adjusted->count > 0;
        tl_figures_json_add_number(object, "first", any ? adjusted->first : (double)NAN);
        tl_figures_json_add_number(object, "last", any ? adjusted->last : (double)NAN);
        tl_figures_json_add_number(object, "mean", tl_run_figures_mean(&summary->figures, i));
        tl_figures_json_add_number(object, "delta_mean", tl_run_figures_delta_mean(&summary->figures, i));
        tl_figures_json_add_number(object, "min", any ? detail->least : (double)NAN);
        tl_figures_json_add_number(object, "max", any ? detail->largest : (double)NAN);
        add_text(object, "unit", summary->adjust[i].unit);
        add_windows(object, request, summary, detail);
    }
}

static void take_event(void *context, const tl_show_event *event) {
    cJSON *object = cJSON_CreateObject();
    (void)cJSON_AddItemToArray(context, object);
    add_text(object, "at", event->at);
    tl_figures_json_add_number(object, "tick", event->has_tick ? (double)event->tick : (double)NAN);
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
    tl_figures_json_add_number(root, "run", (double)request->run->run);
    add_steps(root, &summary);
    add_matches(root, &summary);
    add_adjusted(root, request, &summary);
    add_ledger(root, &summary.figures);
    const tl_show_event_taker taker = {take_event, cJSON_AddArrayToObject(root, "events")};
    return tl_show_event_rows(request->history, request->run, request->from_at, request->all_events ? -1 : EVENTS_SHOWN,
                              taker, error);
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
