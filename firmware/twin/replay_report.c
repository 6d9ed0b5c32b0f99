/* The report that `replay --report` writes: see replay_report.h. */
#include "firmware/twin/replay_report.h"

#include <stdlib.h>

#include "firmware/base/new_file.h"
#include "firmware/config/measurements.h"
#include "firmware/report/html_report.h"
#include "firmware/twin/twin_recorder.h"

struct tl_replay_report {
    const tl_config *config;
    const tl_account *account;
    tl_new_file file;
    tl_html_report *report;
    char recording[PATH_MAX];
    char begun[TL_UTC_TEXT];
    tl_recorder_signal match[TL_MAX_MATCH];
    tl_recorder_signal adjust[TL_MAX_ADJUST];
    double tolerance[TL_MAX_MATCH];
};

static tl_status create(tl_replay_report *report, tl_error *error) {
    const tl_config *config = report->config;
    tl_twin_recorder_signals(config, report->account, report->match, report->adjust);
    for (size_t i = 0; i < config->match_count; i++) {
        report->tolerance[i] = tl_html_tolerance(&config->match[i], config->synchronise);
    }
    tl_utc_text(tl_utc_now(), report->begun);
    const tl_html_settings settings = {
        .name = config->name,
        .source = report->recording,
        .begun = report->begun,
        .version = TL_VERSION,
        .solver = report->account->algorithm,
        .fallback = report->account->fallback,
        .measurements = tl_measurements_name(config->measurements),
        .step = config->step,
        .prediction = report->account->prediction,
        .match = report->match,
        .adjust = report->adjust,
        .match_count = config->match_count,
        .adjust_count = config->adjust_count,
        .tolerance = report->tolerance,
    };
    return tl_html_report_create(&settings, &report->report, error);
}

tl_status tl_replay_report_open(const tl_config *config, const tl_account *account, const char *path,
                                const char *recording, tl_replay_report **report, tl_error *error) {
    tl_replay_report *made = calloc(1, sizeof *made);
    if (made == NULL) {
        return tl_fail(error, TL_TRY_AGAIN, "not enough memory for a report");
    }
    made->config = config;
    made->account = account;
    (void)snprintf(made->recording, sizeof made->recording, "%s", recording);
    tl_status status = create(made, error);
    if (status == TL_OK) {
        status = tl_new_file_open(path, &made->file, error);
    }
    if (status != TL_OK) {
        tl_replay_report_close(made);
        return status;
    }
    *report = made;
    return TL_OK;
}

void tl_replay_report_add(tl_replay_report *report, const tl_record *record) {
    tl_html_report_add_record(report->report, record);
}

static void hear(void *context, int64_t tick, tl_severity severity, const char *source, const char *text) {
    tl_replay_report *report = context;
    const tl_html_event event = {"", tick, tl_severity_name(severity), source, text};
    tl_html_report_add_event(report->report, &event);
}

void tl_replay_report_listen(tl_replay_report *report, tl_journal *journal) {
    tl_journal_listen(journal, hear, report);
}

tl_status tl_replay_report_keep(tl_replay_report *report, const tl_summary *summary, const char *ended,
                                tl_error *error) {
    tl_run_figures figures = summary->figures;
    tl_run_figures_take_account(&figures, report->account);
    tl_html_report_write(report->report, &figures, ended, report->file.file);
    return tl_new_file_keep(&report->file, error);
}

void tl_replay_report_close(tl_replay_report *report) {
    if (report != NULL) {
        tl_new_file_discard(&report->file);
        tl_html_report_destroy(report->report);
        free(report);
    }
}
