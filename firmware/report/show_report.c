/* Report of a recorded run: reads the database and fills the page of html_report.h. */
#include <stdlib.h>
#include <string.h>

#include "firmware/base/os.h"
#include "firmware/config/config.h"
#include "firmware/report/html_report.h"
#include "firmware/report/show.h"
#include "firmware/report/show_summary.h"
#include "firmware/store/history.h"

typedef struct recorded_run {
    const tl_show_request *request;
    tl_show_summary summary;
    tl_html_settings settings;
    tl_html_report *report;
    tl_trend trend;
    tl_config config; /* of the run; empty if this program cannot parse it */
    char source[512];
    double tolerance[TL_MAX_MATCH];
} recorded_run;

/* ---- Settings -------------------------------------------------------------------------------- */

/* Tolerances, solver and budget are only in the configuration. They stay unknown if this program
 * rejects it, for example because a newer program wrote it. */
static tl_status read_configuration(recorded_run *run, tl_error *error) {
    tl_report report = {.add = NULL};
    const char *text = NULL;
    tl_status status =
        tl_history_configuration_text(run->request->history, run->request->run->configuration_hash, &text, error);
    if (status == TL_OK && tl_config_read_text("configuration", text, strlen(text), &run->config, &report) != TL_OK) {
        run->config = (tl_config){0};
    }
    return status;
}

static void find_tolerances(recorded_run *run) {
    for (size_t i = 0; i < run->summary.match_count; i++) {
        for (size_t k = 0; k < run->config.match_count; k++) {
            if (strcmp(run->config.match[k].variable, run->summary.match[i].name) == 0) {
                run->tolerance[i] = tl_html_tolerance(&run->config.match[k], run->config.synchronise);
            }
        }
    }
}

static const char *solver_of(const recorded_run *run) {
    if (run->summary.adjust_count == 0) {
        return "";
    }
    if (run->config.algorithm != NULL) {
        return run->config.algorithm;
    }
    if (run->config.name == NULL) {
        return "unknown";
    }
    return run->summary.adjust[0].type == TL_BOOLEAN ? "boolean" : "secant";
}

static void fill_settings(recorded_run *run) {
    const tl_history_run *recorded = run->request->run;
    const tl_show_summary *summary = &run->summary;
    bool live = tl_show_is_live(recorded);
    (void)snprintf(run->source, sizeof run->source, "run %lld of %s", (long long)recorded->run, run->request->path);
    find_tolerances(run);
    run->settings = (tl_html_settings){
        .name = recorded->name,
        .source = run->source,
        .begun = recorded->started,
        .version = recorded->version,
        .solver = solver_of(run),
        .fallback = run->config.fallback == NULL ? "" : run->config.fallback,
        .measurements = tl_pairing_names[recorded->measurements],
        .step = recorded->step,
        .prediction = recorded->prediction,
        .live = live,
        .origin = tl_show_instant(recorded, 0),
        .clock = live,
        .budget = run->config.budget_time,
        .first = summary->range[0],
        .match = summary->match,
        .adjust = summary->adjust,
        .match_count = summary->match_count,
        .adjust_count = summary->adjust_count,
        .tolerance = run->tolerance,
    };
}

/* ---- The page -------------------------------------------------------------------------------- */

static tl_status add_changes(const recorded_run *run, tl_error *error) {
    tl_show_changes changes;
    tl_status status = tl_show_read_changes(run->request, &changes, error);
    if (status == TL_OK && (changes.is_watched || changes.count > 0)) {
        tl_html_report_set_verdict(run->report, &changes.detection, changes.open, changes.gone);
    }
    for (size_t i = 0; status == TL_OK && i < changes.count; i++) {
        const tl_history_finding *finding = &changes.finding[i];
        tl_html_report_add_finding(run->report, &finding->row, tl_show_now(run->request->run, finding),
                                   finding->started, finding->explanation);
    }
    return status;
}

/* The file is created after all data was read, so that an interrupted `show` leaves no file. */
static tl_status write_page(const recorded_run *run, const char *path, tl_error *error) {
    tl_new_file file;
    tl_status status = tl_new_file_open(path, &file, error);
    if (status != TL_OK) {
        return status;
    }
    const tl_history_run *recorded = run->request->run;
    const char *ended = recorded->ended == NULL ? "running, or killed" : recorded->ended_reason;
    tl_html_report_write(run->report, &run->summary.figures, &run->summary.lock, ended, file.file);
    return tl_new_file_keep(&file, error);
}

static tl_status report_into(recorded_run *run, const char *path, tl_error *error) {
    const tl_show_request *request = run->request;
    tl_history *history = request->history;
    tl_status status = tl_show_summarise(history, request->run, request->from_step, &run->summary, error);
    if (status == TL_OK) {
        status = read_configuration(run, error);
    }
    if (status != TL_OK) {
        return status;
    }
    fill_settings(run);
    status = tl_html_report_create(&run->settings, &run->report, error);
    if (status != TL_OK) {
        return status;
    }
    const tl_history_visitor visitor = tl_html_report_visitor(run->report);
    if (run->summary.any) {
        status = tl_history_rows(history, request->run, run->summary.range, &visitor, error);
    }
    if (status == TL_OK) {
        status = tl_history_events(history, request->run, request->from_at, -1, &visitor, error);
    }
    status = status == TL_OK ? add_changes(run, error) : status;
    if (status == TL_OK) {
        status = tl_trend_read(history, request->run, &run->trend, error);
        tl_html_report_set_trend(run->report, &run->trend);
    }
    return status == TL_OK ? write_page(run, path, error) : status;
}

tl_status tl_show_report(const tl_show_request *request, const char *path, tl_error *error) {
    if (tl_new_file_would_replace(path, request->path)) {
        return tl_fail(error, TL_BAD_USAGE, "--report %.200s would overwrite the database: give it another name", path);
    }
    recorded_run *run = calloc(1, sizeof *run);
    if (run == NULL) {
        return tl_fail(error, TL_TRY_AGAIN, "not enough memory for a report");
    }
    run->request = request;
    tl_status status = report_into(run, path, error);
    tl_html_report_destroy(run->report);
    tl_config_free(&run->config);
    free(run);
    return status;
}
