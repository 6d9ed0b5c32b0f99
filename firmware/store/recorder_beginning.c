/* The rows that say what a run is: see recorder_beginning.h. */
#include "firmware/store/recorder_beginning.h"

#include <stdio.h>
#include <string.h>

#include "firmware/base/identity.h"
#include "firmware/base/sha256.h"
#include "firmware/base/utc.h"
#include "firmware/config/measurements.h"
#include "master/base/utf8.h"

#ifndef TL_VERSION
#define TL_VERSION "unknown"
#endif

/* What a run is begun with. */
typedef struct beginning {
    sqlite3 *connection;
    const tl_recorder_settings *settings;
    const tl_outbox_start *start;
    int64_t run;
    char own[TL_SHA256_TEXT]; /* of the configuration of the settings, */
    const char *hash;         /* and of that of the run */
} beginning;

void tl_recorder_beginning_repair(char *text) {
    for (size_t left = strlen(text); left > 0;) {
        uint32_t code = 0;
        size_t length = tl_utf8_read(text, left, &code);
        if (length == 0) {
            *text = '?';
            length = 1;
        }
        text += length;
        left -= length;
    }
}

/* One change with up to three parameters: the others are NULL. */
static int change(sqlite3 *connection, const char *sql, int64_t first, const char *second, const char *third) {
    sqlite3_stmt *prepared = NULL;
    int code = sqlite3_prepare_v2(connection, sql, -1, &prepared, NULL);
    if (code == SQLITE_OK) {
        (void)sqlite3_bind_int64(prepared, 1, first);
        (void)sqlite3_bind_text(prepared, 2, second, -1, SQLITE_STATIC);
        (void)sqlite3_bind_text(prepared, 3, third, -1, SQLITE_STATIC);
        code = sqlite3_step(prepared);
    }
    (void)sqlite3_finalize(prepared);
    return code == SQLITE_DONE ? SQLITE_OK : code;
}

/* A database of an older program learns the names that came since. */
static int write_names(sqlite3 *connection) {
    int code = SQLITE_OK;
    for (int i = TL_FREE; i < TL_OUTCOMES && code == SQLITE_OK; i++) {
        code = change(connection, "INSERT OR REPLACE INTO outcomes VALUES (?1, ?2)", i, tl_outcome_name((tl_outcome)i),
                      NULL);
    }
    for (int i = TL_STOP_NONE; i <= TL_STOP_TIME && code == SQLITE_OK; i++) {
        code = change(connection, "INSERT OR REPLACE INTO stops VALUES (?1, ?2)", i, tl_stop_name((tl_stop)i), NULL);
    }
    for (unsigned bit = TL_FLAG_FALLBACK; bit <= TL_LAST_FLAG && code == SQLITE_OK; bit <<= 1) {
        code =
            change(connection, "INSERT OR REPLACE INTO flags VALUES (?1, ?2)", bit, tl_flag_name((tl_flag)bit), NULL);
    }
    for (int i = TL_GOOD; i <= TL_OUTLIER && code == SQLITE_OK; i++) {
        code = change(connection, "INSERT OR REPLACE INTO qualities VALUES (?1, ?2)", i, tl_quality_name((tl_quality)i),
                      NULL);
    }
    for (int i = TL_EVENT_INFO; i <= TL_EVENT_ERROR && code == SQLITE_OK; i++) {
        code = change(connection, "INSERT OR REPLACE INTO severities VALUES (?1, ?2)", i,
                      tl_severity_name((tl_severity)i), NULL);
    }
    return code;
}

/* We have the writer's lock: a run without an end was killed. Its last commit was at most one interval after its last
 * step. */
int tl_recorder_beginning_end_killed(sqlite3 *connection) {
    return change(connection,
                  "UPDATE runs SET ended = coalesce(committed, started), ended_reason = 'not ended cleanly'"
                  " WHERE ended IS NULL",
                  0, NULL, NULL);
}

/* What no history would take is none that a twin of ours tells. */
static int64_t small(uint32_t number) {
    return number > INT32_MAX ? INT32_MAX : number;
}

static int write_run(beginning *self, int64_t began) {
    static const char sql[] = "INSERT INTO runs (verb, name, version, configuration, started, committed, step_ns,"
                              " prediction, measurements, lead) VALUES (?1, ?2, ?3, ?4, ?5, ?5, ?6, ?7, ?8, ?9)";
    const tl_recorder_settings *settings = self->settings;
    sqlite3_stmt *prepared = NULL;
    char text[TL_UTC_TEXT];
    int code = sqlite3_prepare_v2(self->connection, sql, -1, &prepared, NULL);
    if (code == SQLITE_OK) {
        tl_utc_text(began, text);
        (void)sqlite3_bind_text(prepared, 1, self->start->holds ? "hold" : settings->verb, -1, SQLITE_STATIC);
        (void)sqlite3_bind_text(prepared, 2, settings->name, -1, SQLITE_STATIC);
        (void)sqlite3_bind_text(prepared, 3, TL_VERSION, -1, SQLITE_STATIC);
        (void)sqlite3_bind_text(prepared, 4, self->hash, -1, SQLITE_STATIC);
        (void)sqlite3_bind_text(prepared, 5, text, -1, SQLITE_STATIC);
        (void)sqlite3_bind_int64(prepared, 6, settings->step);
        (void)sqlite3_bind_int64(prepared, 7, small(self->start->account.prediction));
        (void)sqlite3_bind_text(prepared, 8, tl_measurements_name(settings->measurements), -1, SQLITE_STATIC);
        (void)sqlite3_bind_int64(prepared, 9, small(self->start->account.lead));
        code = sqlite3_step(prepared);
    }
    (void)sqlite3_finalize(prepared);
    self->run = sqlite3_last_insert_rowid(self->connection);
    return code == SQLITE_DONE ? SQLITE_OK : code;
}

/* Which FMUs there are, by who has loaded them or else by the settings; none if nothing but the plant is recorded. */
static int write_beginning(const beginning *self) {
    char none[TL_SHA256_TEXT];
    const tl_recorder_settings *settings = self->settings;
    const char *known = settings->fmus != NULL ? settings->fmus : "";
    const char *fmus = self->start->fmus[0] != '\0' ? self->start->fmus : known;
    if (self->start->holds) {
        tl_identity_files(NULL, 0, none);
        fmus = none;
    }
    return change(self->connection, "INSERT INTO beginnings (run, fmus, boot) VALUES (?1, ?2, ?3)", self->run, fmus,
                  settings->boot != NULL ? settings->boot : "");
}

/* ---- Signals and components -------------------------------------------------------------------------------------- */

static int write_signal(const beginning *self, sqlite3_stmt *prepared, int64_t index,
                        const tl_recorder_signal *signal) {
    char unit[TL_ACCOUNT_TEXT];
    (void)snprintf(unit, sizeof unit, "%s", signal->unit);
    tl_recorder_beginning_repair(unit);
    (void)sqlite3_bind_int64(prepared, 1, self->run);
    (void)sqlite3_bind_int64(prepared, 3, index);
    (void)sqlite3_bind_text(prepared, 4, signal->name, -1, SQLITE_STATIC);
    (void)sqlite3_bind_text(prepared, 5, unit, -1, SQLITE_STATIC);
    (void)sqlite3_bind_text(prepared, 6, tl_type_name(signal->type), -1, SQLITE_STATIC);
    (void)sqlite3_bind_text(prepared, 7, signal->to, -1, SQLITE_STATIC);
    int code = sqlite3_step(prepared);
    (void)sqlite3_reset(prepared);
    return code == SQLITE_DONE ? SQLITE_OK : code;
}

static int prepare_signals(const beginning *self, const char *kind, sqlite3_stmt **prepared) {
    static const char sql[] = "INSERT INTO signals (run, kind, signal, name, unit, type, compared_with)"
                              " VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7)";
    int code = sqlite3_prepare_v2(self->connection, sql, -1, prepared, NULL);
    (void)sqlite3_bind_text(*prepared, 2, kind, -1, SQLITE_STATIC);
    return code;
}

static int write_plant(const beginning *self) {
    sqlite3_stmt *prepared = NULL;
    int code = prepare_signals(self, "plant", &prepared);
    for (size_t i = 0; i < self->settings->plant_count && code == SQLITE_OK; i++) {
        code = write_signal(self, prepared, (int64_t)i, &self->settings->plant[i]);
    }
    (void)sqlite3_finalize(prepared);
    return code;
}

/* Their units and types are what the account says. */
static int write_matches(const beginning *self) {
    const tl_account *account = &self->start->account;
    sqlite3_stmt *prepared = NULL;
    int code = prepare_signals(self, "match", &prepared);
    for (size_t i = 0; i < self->settings->match_count && code == SQLITE_OK; i++) {
        tl_recorder_signal signal = self->settings->match[i];
        signal.unit = i < account->matches ? account->match[i].unit : "";
        signal.type = i < account->matches ? account->match[i].type : TL_REAL;
        code = write_signal(self, prepared, (int64_t)i, &signal);
    }
    (void)sqlite3_finalize(prepared);
    return code;
}

static int write_adjusts(const beginning *self) {
    const tl_account *account = &self->start->account;
    sqlite3_stmt *prepared = NULL;
    int code = prepare_signals(self, "adjust", &prepared);
    for (size_t i = 0; i < self->settings->adjust_count && code == SQLITE_OK; i++) {
        tl_recorder_signal signal = self->settings->adjust[i];
        signal.unit = i < account->adjusts ? account->adjust[i].unit : "";
        signal.type = i < account->adjusts ? account->adjust[i].type : TL_REAL;
        code = write_signal(self, prepared, (int64_t)i, &signal);
    }
    (void)sqlite3_finalize(prepared);
    return code;
}

/* Their counts come with the steps. */
static int write_components(const beginning *self) {
    static const char sql[] = "INSERT INTO components (run, component, name) VALUES (?1, ?2, ?3)";
    const tl_account *account = &self->start->account;
    sqlite3_stmt *prepared = NULL;
    int code = sqlite3_prepare_v2(self->connection, sql, -1, &prepared, NULL);
    for (size_t i = 0; i < self->settings->component_count && i < account->components && code == SQLITE_OK; i++) {
        char name[TL_ACCOUNT_TEXT];
        (void)snprintf(name, sizeof name, "%s", account->component[i].name);
        tl_recorder_beginning_repair(name);
        (void)sqlite3_bind_int64(prepared, 1, self->run);
        (void)sqlite3_bind_int64(prepared, 2, (sqlite3_int64)i);
        (void)sqlite3_bind_text(prepared, 3, name, -1, SQLITE_STATIC);
        code = sqlite3_step(prepared);
        (void)sqlite3_reset(prepared);
        code = code == SQLITE_DONE ? SQLITE_OK : code;
    }
    (void)sqlite3_finalize(prepared);
    return code;
}

/* ---- All of it --------------------------------------------------------------------------------------------------- */

int tl_recorder_beginning_write(sqlite3 *connection, const tl_recorder_settings *settings, const tl_outbox_start *start,
                                int64_t began, int64_t *run) {
    beginning self = {.connection = connection, .settings = settings, .start = start};
    tl_sha256(settings->configuration, strlen(settings->configuration), self.own);
    self.hash = start->holds || start->configured.hash[0] == '\0' ? self.own : start->configured.hash;
    int code = tl_recorder_beginning_end_killed(connection);
    if (code == SQLITE_OK) {
        code = write_names(connection);
    }
    if (code == SQLITE_OK) {
        code = change(connection, "INSERT OR IGNORE INTO configurations (hash, text) VALUES (?2, ?3)", 0, self.hash,
                      strcmp(self.hash, self.own) == 0 ? settings->configuration : "");
    }
    if (code == SQLITE_OK) {
        code = write_run(&self, began);
    }
    if (code == SQLITE_OK) {
        code = write_beginning(&self);
    }
    if (code == SQLITE_OK) {
        code = write_plant(&self);
    }
    if (code == SQLITE_OK && !start->holds) {
        code = write_matches(&self);
    }
    if (code == SQLITE_OK && !start->holds) {
        code = write_adjusts(&self);
    }
    if (code == SQLITE_OK && !start->holds) {
        code = write_components(&self);
    }
    *run = self.run;
    return code;
}
