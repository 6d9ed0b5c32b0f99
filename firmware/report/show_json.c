/* Prints the figures of the page as one JSON object, for programs. */
#include <math.h>

#include "firmware/base/json.h"
#include "firmware/config/config.h"
#include "firmware/report/changes.h"
#include "firmware/report/run_figures.h"
#include "firmware/report/show.h"
#include "firmware/report/show_summary.h"
#include "firmware/store/history.h"

enum { EVENTS_SHOWN = 10 };

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
    tl_json_add_number(json, "start_s", run->experiment.start_s);
    tl_json_add_number(json, "stop_s",
                       run->experiment.stop_s > run->experiment.start_s ? run->experiment.stop_s : (double)NAN);
    tl_json_add_count(json, "prediction", run->prediction);
    tl_json_add_count(json, "lead", run->lead);
    tl_json_add_text(json, "measurements", tl_pairing_names[run->measurements]);
    tl_json_add_count(json, "samples", run->samples);
    tl_json_add_count(json, "steps", run->steps);
    tl_json_add_count(json, "events", run->events);
    tl_json_add_count(json, "lost", run->lost);
    tl_json_add_number(json, "removed_before", (double)run->removed_before);
    tl_figures_json_add_resumption(json, &run->resumption);
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
    const tl_run_figures *figures = &summary->figures;
    tl_json_add_count(json, "steps", figures->steps);
    if (summary->any) {
        tl_json_add_number(json, "first_step", (double)summary->range[0]);
        tl_json_add_number(json, "last_step", (double)summary->range[1]);
    }
    tl_json_add_count(json, "evaluations", figures->evaluations);
    tl_json_add_count(json, "optimised_steps", figures->optimised_steps);
    tl_json_add_count(json, "rested_steps", figures->rested);
    tl_json_add_count(json, "refused_steps", figures->refused);
    tl_json_add_count(json, "time_limited", figures->time_limited);
    tl_figures_json_add_outcomes(json, figures);
}

static void add_matches(tl_json_writer *json, const tl_show_summary *summary) {
    tl_json_open_object(json, "match");
    for (size_t i = 0; i < summary->match_count; i++) {
        const tl_recorder_signal *signal = &summary->match[i];
        tl_json_open_object(json, signal->name);
        tl_json_add_text(json, "to", signal->to);
        tl_figures_json_add_match(json, &summary->figures, i, signal->unit);
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
        tl_json_add_number(json, "correction_mean", tl_show_part_mean(&adjust->windows[i]));
        tl_json_close(json);
    }
    tl_json_close(json);
}

static void add_adjusted(tl_json_writer *json, const tl_show_request *request, const tl_show_summary *summary) {
    tl_json_open_object(json, "adjust");
    for (size_t i = 0; i < summary->adjust_count; i++) {
        const tl_run_adjusted *adjusted = &summary->figures.adjust[i];
        const tl_show_adjust *detail = &summary->detail[i];
        bool any = adjusted->count > 0;
        tl_json_open_object(json, summary->adjust[i].name);
        tl_json_add_number(json, "first", any ? adjusted->first : (double)NAN);
        tl_json_add_number(json, "last", any ? adjusted->last : (double)NAN);
        tl_json_add_number(json, "mean", tl_run_figures_mean(&summary->figures, i));
        tl_json_add_number(json, "correction_mean", tl_run_figures_correction_mean(&summary->figures, i));
        tl_json_add_number(json, "min", any ? detail->least : (double)NAN);
        tl_json_add_number(json, "max", any ? detail->largest : (double)NAN);
        tl_json_add_text(json, "unit", summary->adjust[i].unit);
        add_windows(json, request, summary, detail);
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

static tl_status add_tunings(tl_json_writer *json, const tl_show_request *request, tl_error *error) {
    const tl_history_tuning *tunings = NULL;
    size_t count = 0;
    tl_status status = tl_history_tunings(request->history, request->run, &tunings, &count, error);
    tl_json_open_array(json, "tunings");
    for (size_t i = 0; status == TL_OK && i < count; i++) {
        tl_json_open_object(json, NULL);
        tl_json_add_number(json, "tick", (double)tunings[i].tick);
        tl_json_add_text(json, "configuration", tunings[i].hash);
        tl_json_add_text(json, "at", tunings[i].at);
        tl_json_add_text(json, "who", tunings[i].who);
        tl_json_add_text(json, "origin", tunings[i].origin);
        tl_json_add_text(json, "why", tunings[i].why);
        tl_json_close(json);
    }
    tl_json_close(json);
    return status;
}

static tl_status add_changes(tl_json_writer *json, const tl_show_request *request, tl_error *error) {
    tl_show_changes changes;
    tl_status status = tl_show_read_changes(request, &changes, error);
    if (status != TL_OK) {
        return status;
    }
    if (changes.is_watched) {
        tl_changes_add_detection(json, &changes.detection);
    } else {
        tl_json_add_text(json, "detection", NULL);
    }
    tl_json_open_array(json, "findings");
    for (size_t i = 0; i < changes.count; i++) {
        const tl_history_finding *finding = &changes.finding[i];
        tl_changes_add_finding(json, &finding->row, finding->started);
        tl_json_add_text(json, "acknowledged_at", finding->acknowledged_at);
        tl_json_add_text(json, "acknowledged_by", finding->acknowledged_by);
        tl_json_add_text(json, "note", finding->note);
        tl_json_add_text(json, "explained_at", finding->explained_at);
        tl_json_add_text(json, "explanation", finding->explanation);
        tl_json_close(json);
    }
    tl_json_close(json);
    return TL_OK;
}

static tl_status add_all(tl_json_writer *json, const tl_show_request *request, tl_error *error) {
    tl_show_summary summary;
    tl_status status = tl_show_summarise(request->history, request->run, request->from_step, &summary, error);
    if (status != TL_OK) {
        return status;
    }
    tl_json_add_text(json, "file", request->path);
    status = add_changes(json, request, error);
    status = status == TL_OK ? add_runs(json, request, error) : status;
    if (status != TL_OK) {
        return status;
    }
    tl_json_add_number(json, "run", (double)request->run->run);
    add_steps(json, &summary);
    if (tl_lock_tally_total(&summary.lock) == 0) {
        tl_json_add_text(json, "lock", NULL);
    } else {
        tl_json_open_object(json, "lock");
        tl_figures_json_add_lock(json, &summary.lock);
        tl_json_close(json);
    }
    add_matches(json, &summary);
    add_adjusted(json, request, &summary);
    if (summary.figures.ledger_count == 0) {
        tl_json_add_text(json, "ledger", NULL);
    } else {
        tl_json_open_object(json, "ledger");
        tl_figures_json_add_components(json, &summary.figures);
        tl_json_close(json);
    }
    status = add_tunings(json, request, error);
    return status == TL_OK ? add_events(json, request, error) : status;
}

tl_status tl_show_json(const tl_show_request *request, FILE *file, tl_error *error) {
    tl_json_writer json;
    tl_json_writer_begin(&json);
    tl_status status = add_all(&json, request, error);
    if (status == TL_OK) {
        status = tl_json_writer_print(&json, file, error);
    }
    tl_json_writer_free(&json);
    return status;
}
