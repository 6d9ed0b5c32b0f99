/* twinlock show: shows the corrections in a database. */
#include <errno.h>
#include <math.h>
#include <string.h>

#include "firmware/base/log.h"
#include "firmware/cli/options.h"
#include "firmware/report/show.h"

/* ---- Start of the output --------------------------------------------------------------------- */

static int64_t step_at(double seconds, tl_time step) {
    double number = ceil(seconds * 1e9 / (double)step);
    return number < 0.0 ? 0 : number > 4e18 ? INT64_MAX / 4 : (int64_t)number;
}

/* Selects a time before the end: steps before the last tick, events before the last commit. */
static tl_status select_last(tl_show_request *request, double seconds, tl_error *error) {
    int64_t last = -1;
    int64_t committed = 0;
    tl_status status = tl_history_last_step(request->history, request->run, &last, error);
    if (status == TL_OK && last >= 0) {
        int64_t back = step_at(seconds, request->run->step);
        request->from_step = back > last + 1 ? 0 : last + 1 - back;
    }
    if (status == TL_OK && tl_utc_parse(request->run->committed, &committed)) {
        tl_utc_text(committed - (int64_t)fmin(seconds * 1e3, 1e15), request->from_at);
    }
    return status;
}

static tl_status choose_since(tl_show_request *request, const tl_options_since *since, tl_error *error) {
    int64_t started = 0;
    if (since->text == NULL) {
        return TL_OK;
    }
    if (!since->is_date) {
        return select_last(request, since->back_s, error);
    }
    if (!tl_show_is_live(request->run)) {
        return tl_fail(
            error, TL_BAD_USAGE,
            "--since %s: run %lld is a replay, its steps have no date: give a time before its end, for example 90s",
            since->text, (long long)request->run->run);
    }
    (void)tl_utc_parse(request->run->started, &started);
    tl_utc_text(since->at, request->from_at);
    request->from_step = step_at((double)(since->at - started) / 1e3, request->run->step);
    return TL_OK;
}

/* Shows only the newest steps of a long run, so that the page appears within about a second. */
static tl_status choose_newest(tl_show_request *request, tl_error *error) {
    static const int64_t most_rows = 2000000;
    const tl_recorder_signal *signals = NULL;
    size_t matches = 0;
    size_t adjusts = 0;
    int64_t range[2] = {0, 0};
    bool any = false;
    tl_history *history = request->history;
    tl_status status = tl_history_signals(history, request->run, TL_HISTORY_MATCH, &signals, &matches, error);
    if (status == TL_OK) {
        status = tl_history_signals(history, request->run, TL_HISTORY_ADJUST, &signals, &adjusts, error);
    }
    if (status == TL_OK) {
        status = tl_history_range(history, request->run, TL_HISTORY_STEPS, INT64_MIN, range, &any, error);
    }
    const int64_t most = most_rows / (int64_t)(1 + matches + adjusts);
    if (any && range[1] - range[0] >= most) {
        request->from_step = range[1] + 1 - most;
        request->is_newest = true;
    }
    return status;
}

/* ---- The verb -------------------------------------------------------------------------------- */

static tl_status show(const tl_options *options, tl_error *error) {
    tl_show_request request = {.path = options->subject,
                               .all_events = options->events,
                               .verbose = options->verbose,
                               .style = tl_show_style_of(stdout)};
    tl_status status = tl_history_open(options->subject, &request.history, error);
    if (status == TL_OK) {
        status = tl_history_find(request.history, (int64_t)options->run, &request.run, error);
    }
    if (status == TL_OK) {
        status = choose_since(&request, &options->since, error);
    }
    if (status == TL_OK && options->since.text == NULL && options->table == TL_OPTIONS_NO_TABLE) {
        status = choose_newest(&request, error);
    }
    if (status == TL_OK) {
        status = options->table != TL_OPTIONS_NO_TABLE
                     ? tl_show_csv(&request, (tl_show_csv_table)options->table, stdout, error)
                 : options->report != NULL ? tl_show_report(&request, options->report, error)
                 : options->json           ? tl_show_json(&request, stdout, error)
                                           : tl_show_text(&request, stdout, error);
    }
    if (status == TL_BAD_DATA) {
        tl_history_diagnose(request.history, error);
    }
    tl_history_close(request.history);
    if ((fflush(stdout) != 0 || ferror(stdout)) && status == TL_OK) {
        status = tl_fail(error, TL_TRY_AGAIN, "standard output: %s", strerror(errno));
    }
    return status;
}

int tl_verb_show(const tl_options *options) {
    tl_error error = {TL_OK, ""};
    tl_status status = show(options, &error);
    if (status != TL_OK) {
        tl_log(TL_LOG_ERROR, "%s", error.text);
    }
    return tl_exit_code(status);
}
