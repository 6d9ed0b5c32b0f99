/* The same numbers as the page, for programs: one JSON object. */
#include <math.h>

#include "firmware/config/measurements.h"
#include "firmware/record/history_rows.h"
#include "firmware/show/show.h"
#include "firmware/show/show_summary.h"
#include "firmware/text/json_writer.h"

enum { EVENTS_SHOWN = 10 };

/* Null if the run has begun anew. */
static void add_resumption(tl_json_writer *json, const tl_resumption *resumption) {
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

static void add_run(tl_json_writer *json, const tl_history_run *run) {
    tl_json_open_object(json, NULL);
    tl_json_add_number(json, "run", (double)run->run);
    tl_json_add_text(json, "verb", run->verb);
    tl_json_add_text(json, "name", run->name);
    tl_json_add_text(json, "version", run->version);
    tl_json_add_text(json, "configuration", run->configuration_hash);
    tl_json_add_text(json, "started", run->started);
    tl_json_add_text(json, "ended", run->ended);
    tl_json_add_text(json, "ended_reason", run->ended_reason);
    tl_json_add_text(json, "committed", run->committed);
    tl_json_add_number(json, "step_s", tl_seconds(run->step));
    tl_json_add_count(json, "prediction", run->prediction);
    tl_json_add_count(json, "lead", run->lead);
    tl_json_add_text(json, "measurements", tl_measurements_name(run->measurements));
    tl_json_add_count(json, "samples", run->samples);
    tl_json_add_count(json, "steps", run->steps);
    tl_json_add_count(json, "events", run->events);
    tl_json_add_count(json, "lost", run->lost);
    tl_json_add_number(json, "removed_before", (double)run->removed_before);
    add_resumption(json, &run->resumption);
    tl_json_close(json);
}

static tl_status add_runs(tl_json_writer *json, const tl_show_request *request, tl_error *error) {
    const tl_history_run *runs = NULL;
    size_t count = 0;
    tl_status status = tl_history_runs(request->history, &runs, &count, error);
    tl_json_open_array(json, "runs");
    for (size_t i = 0; status == TL_OK && i < count; i++) {
        add_run(json, &runs[i]);
    }
    tl_json_close(json);
    return status;
}

static void add_steps(tl_json_writer *json, const tl_show_summary *summary) {
    tl_json_add_count(json, "steps", summary->steps - summary->outcomes[TL_MADE_UP] - summary->outcomes[TL_FOLLOWED]);
    if (summary->any) {
        tl_json_add_number(json, "first_step", (double)summary->range[0]);
        tl_json_add_number(json, "last_step", (double)summary->range[1]);
    }
    tl_json_add_count(json, "evaluations", summary->evaluations);
    tl_json_add_count(json, "optimised_steps", summary->optimised_steps);
    tl_json_add_count(json, "time_limited", summary->time_limited);
    tl_json_open_object(json, "outcomes");
    for (int i = TL_FREE; i < TL_OUTCOMES; i++) {
        tl_json_add_count(json, tl_outcome_name((tl_outcome)i), summary->outcomes[i]);
    }
    tl_json_close(json);
}

static void add_counts(tl_json_writer *json, const char *key, const tl_recorder_component *counts) {
    tl_json_open_object(json, key);
    tl_json_add_count(json, "plain", counts->plain);
    tl_json_add_count(json, "predicted", counts->predicted);
    tl_json_add_count(json, "executions", counts->executions);
    tl_json_add_number(json, "saved", (double)counts->plain - (double)counts->executions);
    tl_json_add_count(json, "caught_up", counts->caught_up);
    tl_json_add_count(json, "unstored", counts->unstored);
    tl_json_add_number(json, "difference",
                       (double)counts->executions - (double)counts->caught_up - (double)counts->predicted);
    tl_json_close(json);
}

static void add_ledger(tl_json_writer *json, const tl_show_summary *summary) {
    if (summary->ledger_count == 0) {
        tl_json_add_null(json, "ledger");
        return;
    }
    tl_json_open_object(json, "ledger");
    tl_json_open_object(json, "components");
    for (size_t i = 0; i < summary->ledger_count; i++) {
        add_counts(json, summary->ledger[i].name, &summary->ledger[i].counts);
    }
    tl_json_close(json);
    add_counts(json, "total", &summary->total);
    tl_json_close(json);
}

static void add_matches(tl_json_writer *json, const tl_show_summary *summary) {
    tl_json_open_object(json, "match");
    for (size_t i = 0; i < summary->match_count; i++) {
        const tl_show_match *match = &summary->match[i];
        tl_json_open_object(json, match->signal->name);
        tl_json_add_text(json, "to", match->signal->to);
        tl_json_add_number(json, "mse", tl_metrics_mse(&match->metrics));
        tl_json_add_number(json, "max", match->metrics.maximum);
        tl_json_add_text(json, "unit", match->signal->unit);
        tl_json_add_count(json, "pairs", match->metrics.pairs);
        tl_json_add_count(json, "left_out", match->metrics.left_out);
        tl_json_close(json);
    }
    tl_json_close(json);
}

static void add_windows(tl_json_writer *json, const tl_show_request *request, const tl_show_summary *summary,
                        const tl_show_adjust *adjust) {
    tl_json_open_array(json, "windows");
    for (size_t i = 0; i < summary->windows; i++) {
        int64_t step = tl_show_window_start(summary, i);
        tl_json_open_object(json, NULL);
        tl_json_add_number(json, "from_step", (double)step);
        tl_json_add_number(json, "from_s", (double)step * tl_seconds(request->run->step));
        if (tl_show_is_live(request->run)) {
            char utc[TL_UTC_TEXT];
            tl_utc_text(tl_show_instant(request->run, step), utc);
            tl_json_add_text(json, "from", utc);
        }
        tl_json_add_count(json, "steps", adjust->windows[i].count);
        tl_json_add_number(json, "delta_mean", tl_show_part_mean(&adjust->windows[i]));
        tl_json_close(json);
    }
    tl_json_close(json);
}

static void add_adjusted(tl_json_writer *json, const tl_show_request *request, const tl_show_summary *summary) {
    tl_json_open_object(json, "adjust");
    for (size_t i = 0; i < summary->adjust_count; i++) {
        const tl_show_adjust *adjust = &summary->adjust[i];
        double count = adjust->count == 0 ? (double)NAN : (double)adjust->count;
        tl_json_open_object(json, adjust->signal->name);
        tl_json_add_number(json, "first", adjust->count == 0 ? (double)NAN : adjust->first);
        tl_json_add_number(json, "last", adjust->count == 0 ? (double)NAN : adjust->last);
        tl_json_add_number(json, "mean", adjust->sum / count);
        tl_json_add_number(json, "delta_mean", adjust->delta_sum / count);
        tl_json_add_number(json, "min", adjust->count == 0 ? (double)NAN : adjust->least);
        tl_json_add_number(json, "max", adjust->count == 0 ? (double)NAN : adjust->largest);
        tl_json_add_text(json, "unit", adjust->signal->unit);
        add_windows(json, request, summary, adjust);
        tl_json_close(json);
    }
    tl_json_close(json);
}

static void take_event(void *context, const tl_history_event *event) {
    tl_json_writer *json = context;
    tl_json_open_object(json, NULL);
    tl_json_add_text(json, "at", event->at);
    tl_json_add_number(json, "tick", event->has_tick ? (double)event->tick : (double)NAN);
    tl_json_add_text(json, "severity", event->severity);
    tl_json_add_text(json, "source", event->source);
    tl_json_add_text(json, "text", event->text);
    tl_json_close(json);
}

static tl_status add_events(tl_json_writer *json, const tl_show_request *request, tl_error *error) {
    const tl_history_visitor visitor = {.context = json, .event = take_event};
    tl_json_open_array(json, "events");
    tl_status status = tl_history_events(request->history, request->run, request->from_at,
                                         request->all_events ? -1 : EVENTS_SHOWN, &visitor, error);
    tl_json_close(json);
    return status;
}

static tl_status fill(tl_json_writer *json, const tl_show_request *request, tl_error *error) {
    tl_show_summary summary;
    tl_status status = tl_show_summarise(request->history, request->run, request->from_step, &summary, error);
    if (status != TL_OK) {
        return status;
    }
    tl_json_add_text(json, "file", request->path);
    status = add_runs(json, request, error);
    if (status != TL_OK) {
        return status;
    }
    tl_json_add_number(json, "run", (double)request->run->run);
    add_steps(json, &summary);
    add_matches(json, &summary);
    add_adjusted(json, request, &summary);
    add_ledger(json, &summary);
    return add_events(json, request, error);
}

tl_status tl_show_json(const tl_show_request *request, FILE *file, tl_error *error) {
    tl_json_writer json;
    tl_json_writer_begin(&json);
    tl_status status = fill(&json, request, error);
    if (status == TL_OK) {
        status = tl_json_writer_print(&json, file, error);
    }
    tl_json_writer_free(&json);
    return status;
}
