/* The change detector, fed with the recorded runs of replays as if they were live runs, one after
 * another: script/studies/plants.py uses it, because days of live runs take days.
 *
 * Usage:  change_probe CONFIG DATABASE T_START…   t_start of each run, s since 1970 UTC
 * Output: one line for each report: turn (0 new, 1 further, 2 gone), instant of the report, finding,
 *         onset, size, percent, all times in s since 1970 UTC, and the sentence. "learning" if the
 *         detector is not ready at the end.
 */
#include <math.h>
#include <sqlite3.h>
#include <stdio.h>
#include <stdlib.h>

#include "firmware/monitor/change_detector.h"

static double begun; /* t_start of the present run, s since 1970 UTC */

static void print(void *context, int64_t tick, const tl_finding *finding, tl_finding_turn turn) {
    const tl_config *config = context;
    char text[TL_FINDING_TEXT];
    tl_finding_write(finding, finding->found, 0, text);
    (void)printf("%d\t%.3f\t%u\t%.3f\t%.6g\t%.4g\t%s\n", (int)turn, begun + (double)tick * tl_seconds(config->step),
                 finding->number, begun + finding->onset, finding->size, finding->percent, text);
}

static double number(sqlite3_stmt *row, int column) {
    return sqlite3_column_type(row, column) == SQLITE_NULL ? (double)NAN : sqlite3_column_double(row, column);
}

/* The rows of one step, or none; the statement is at its first one. */
static void read_outputs(sqlite3_stmt *row, tl_record *record) {
    while (sqlite3_data_count(row) > 0 && sqlite3_column_int64(row, 0) <= record->step) {
        int at = sqlite3_column_int(row, 1);
        if (sqlite3_column_int64(row, 0) == record->step && at >= 0 && at < TL_MAX_MATCH) {
            record->measured[at] = number(row, 2);
            record->measured_quality[at] = (uint8_t)sqlite3_column_int(row, 3);
            record->released[at] = number(row, 4);
        }
        (void)sqlite3_step(row);
    }
}

static void read_corrections(sqlite3_stmt *row, tl_record *record) {
    while (sqlite3_data_count(row) > 0 && sqlite3_column_int64(row, 0) <= record->step) {
        int at = sqlite3_column_int(row, 1);
        if (sqlite3_column_int64(row, 0) == record->step && at >= 0 && at < TL_MAX_ADJUST) {
            record->u[at] = number(row, 2);
            record->nominal[at] = number(row, 3);
        }
        (void)sqlite3_step(row);
    }
}

static void feed(tl_change_detector *detector, sqlite3 *database, int run) {
    static const char *const sql[] = {
        "SELECT step, outcome, flags, release_age FROM steps WHERE run = ? ORDER BY step",
        "SELECT step, signal, measured, quality, released FROM outputs WHERE run = ? ORDER BY step, signal",
        "SELECT step, signal, applied, nominal FROM adjustments WHERE run = ? ORDER BY step, signal"};
    static tl_record record;
    sqlite3_stmt *row[3] = {NULL, NULL, NULL};
    for (int i = 0; i < 3; i++) {
        (void)sqlite3_prepare_v2(database, sql[i], -1, &row[i], NULL);
        (void)sqlite3_bind_int(row[i], 1, run);
        (void)(i > 0 ? sqlite3_step(row[i]) : 0);
    }
    while (sqlite3_step(row[0]) == SQLITE_ROW) {
        record.step = sqlite3_column_int64(row[0], 0);
        record.outcome = (tl_outcome)sqlite3_column_int(row[0], 1);
        record.flags = (uint32_t)sqlite3_column_int(row[0], 2);
        record.release_age = (uint32_t)sqlite3_column_int(row[0], 3);
        read_outputs(row[1], &record);
        read_corrections(row[2], &record);
        tl_change_detector_step(detector, record.step, &record);
    }
    for (int i = 0; i < 3; i++) {
        (void)sqlite3_finalize(row[i]);
    }
}

/* What a restart of the recorder's process keeps. */
static tl_change_detector *restart(tl_change_detector *before, tl_config *config, const tl_account *account) {
    size_t size = tl_change_detector_size(before);
    unsigned char *bytes = malloc(size);
    tl_change_detector *after = tl_change_detector_create(config, account, print, config);
    tl_change_detector_save(before, bytes);
    if (!tl_change_detector_load(after, bytes, size)) {
        (void)puts("damaged");
    }
    free(bytes);
    tl_change_detector_destroy(before);
    return after;
}

int main(int count, char **arguments) {
    static tl_config config;
    static tl_account account;
    tl_report silent = {.add = NULL};
    sqlite3 *database = NULL;
    if (count < 4 || tl_config_read(arguments[1], &config, &silent) != TL_OK ||
        sqlite3_open_v2(arguments[2], &database, SQLITE_OPEN_READONLY, NULL) != SQLITE_OK) {
        (void)fputs("change_probe: CONFIG DATABASE T_START…\n", stderr);
        return 1;
    }
    for (size_t i = 0; i < config.adjust_count; i++) {
        account.adjust[i] = (tl_account_adjust){.unit = "", .type = TL_REAL, .step = config.adjust[i].step};
    }
    for (size_t i = 0; i < config.match_count; i++) {
        account.match[i] = (tl_account_match){.unit = ""};
    }
    tl_change_detector *detector = tl_change_detector_create(&config, &account, print, &config);
    for (int run = 1; run + 2 < count; run++) {
        detector = run > 1 ? restart(detector, &config, &account) : detector;
        begun = strtod(arguments[run + 2], NULL);
        tl_change_detector_begin(detector, &account, (int64_t)llround(begun * 1e3));
        feed(detector, database, run);
    }
    if (!tl_change_detector_get(detector).detection.is_ready) {
        (void)puts("learning");
    }
    tl_change_detector_destroy(detector);
    (void)sqlite3_close(database);
    tl_config_free(&config);
    return 0;
}
