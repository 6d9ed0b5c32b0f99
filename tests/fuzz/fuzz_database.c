/* Fuzzes a database: reads its runs and ticks, shows it in each way, and reads a run as a
 * recording. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "firmware/base/log.h"
#include "firmware/config/config.h"
#include "firmware/plant/recording.h"
#include "firmware/report/show.h"
#include "firmware/store/database.h"
#include "firmware/store/history.h"
#include "tests/fuzz/harness.h"

enum { MOST_TICKS = 500 };

/* The configuration of the runs in the seeds. */
static const char configuration[] =
    "{\"twinlock\": 1, \"name\": \"fuzz\", \"step_s\": 0.01, \"components\": {\"motor\": {\"fmu\": \"motor.fmu\"}},\n"
    " \"plant\": {\"torque\": {\"unit\": \"N.m\"}, \"omega\": {\"unit\": \"rad/s\"}},\n"
    " \"connect\": [[\"plant.torque\", \"motor.M_w\"]]}";

static const tl_config *config(void) {
    return tl_fuzz_config(configuration);
}

/* An error must have a text, and must not be TL_BAD_USAGE. */
static void expect(tl_status status, const tl_error *error) {
    if (status != TL_OK && (status == TL_BAD_USAGE || error->text[0] == '\0')) {
        abort();
    }
}

/* ---- as a history ---- */

static void check_tick(const tl_history_tick *tick, int64_t last) {
    if (tick->sample.tick <= last || tick->adjusted > TL_MAX_ADJUST) {
        abort();
    }
    for (size_t i = 0; i < TL_MAX_SIGNALS; i++) {
        if (!isfinite(tick->sample.values[i]) || tick->sample.quality[i] > TL_LAST_QUALITY) {
            abort();
        }
    }
    for (size_t i = 0; i < tick->adjusted; i++) {
        if (!isfinite(tick->u[i])) {
            abort();
        }
    }
}

static void walk(tl_history *history, const tl_history_run *run) {
    tl_history_ticks *ticks = NULL;
    tl_history_tick tick;
    tl_error error = {TL_OK, ""};
    int64_t last = -1;
    bool end = false;
    tl_status status = tl_history_ticks_begin(history, run, 0, &ticks, &error);
    for (int i = 0; i < MOST_TICKS && status == TL_OK && !end; i++) {
        status = tl_history_ticks_next(ticks, &tick, &end, &error);
        if (status == TL_OK && !end) {
            check_tick(&tick, last);
            last = tick.sample.tick;
        }
    }
    expect(status, &error);
    tl_history_ticks_end(ticks);
}

static void ask(tl_history *history, const tl_history_run *run) {
    const tl_history_checkpoint *checkpoint = NULL;
    const tl_history_tuning *tunings = NULL;
    size_t count = 0;
    const char *text = NULL;
    tl_error error = {TL_OK, ""};
    int64_t step = 0;
    expect(tl_history_configuration_text(history, run->configuration_hash, &text, &error), &error);
    expect(tl_history_tunings(history, run, &tunings, &count, &error), &error);
    expect(tl_history_last_step(history, run, &step, &error), &error);
    expect(tl_history_checkpoint_before(history, run, INT64_MAX, &checkpoint, &error), &error);
    (void)tl_history_execution_cost(history, run);
}

/* ---- as it is shown ---- */

static void show(tl_history *history, const tl_history_run *run, const char *path) {
    FILE *file = fopen("/dev/null", "w");
    tl_error error = {TL_OK, ""};
    const tl_show_request request = {.path = path, .history = history, .run = run, .all_events = true};
    if (file == NULL) {
        exit(1);
    }
    expect(tl_show_text(&request, file, &error), &error);
    expect(tl_show_json(&request, file, &error), &error);
    for (int table = TL_SHOW_OUTPUTS; table <= TL_SHOW_EVENTS; table++) {
        expect(tl_show_csv(&request, (tl_show_csv_table)table, file, &error), &error);
    }
    (void)fclose(file);
}

/* ---- as a recording ---- */

static void replay(const char *path) {
    tl_recording *recording = NULL;
    tl_recording_tick tick;
    tl_error error = {TL_OK, ""};
    bool end = false;
    tl_status status = tl_recording_open(path, config(), &recording, &error);
    expect(status, &error);
    if (status != TL_OK) {
        return;
    }
    for (int i = 0; i < MOST_TICKS && status == TL_OK && !end; i++) {
        status = tl_recording_next(recording, &tick, &end, &error);
    }
    expect(status, &error);
    tl_recording_close(recording);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    static const char *const ends[] = {"-wal", "-shm", "-journal"};
    char path[256];
    tl_history *history = NULL;
    const tl_history_run *run = NULL;
    tl_error error = {TL_OK, ""};
    tl_log_set_level(TL_LOG_ERROR - 1);
    (void)snprintf(path, sizeof path, "%.200s/fuzz.db", tl_fuzz_folder());
    FILE *file = fopen(path, "wb");
    if (file == NULL || fwrite(data, 1, size, file) != size || fclose(file) != 0) {
        exit(1);
    }
    tl_status status = tl_history_open(path, &history, &error);
    if (status == TL_OK) {
        status = tl_history_find(history, 0, &run, &error);
    }
    expect(status, &error);
    if (status == TL_OK) {
        walk(history, run);
        ask(history, run);
        show(history, run, path);
    }
    tl_history_close(history);
    replay(path);
    for (size_t i = 0; i < sizeof ends / sizeof ends[0]; i++) {
        char beside[300];
        (void)snprintf(beside, sizeof beside, "%s%s", path, ends[i]);
        (void)remove(beside);
    }
    return 0;
}
