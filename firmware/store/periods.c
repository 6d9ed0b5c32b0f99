/* Summaries of minutes and hours: see periods.h. */
#include "firmware/store/periods.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "master/base/signal.h"
#include "master/base/simtime.h"
#include "master/twin/twin.h"

static const tl_time MINUTE_NS = TL_MINUTE * TL_SECOND;

static const tl_time LONGEST_STEP = TL_HOUR * TL_SECOND;
static const tl_time LATE = 300 * TL_SECOND;

enum { LEAST_ROOM = 120 };                                       /* minutes are kept until their hour is summarised */
enum { MINUTES_PER_HOUR = TL_HOUR / TL_MINUTE, ROW_BYTES = 56 }; /* of a row, measured */

typedef enum kind { PLANT, MATCH, ADJUST, OUTCOME, KINDS } kind;

static const char *const kind_names[KINDS] = {"plant", "match", "adjust", "outcome"};

enum { SERIES = TL_MAX_SIGNALS }; /* of a kind, at most */

typedef enum periods_statement {
    FACTS_OF,
    LAST_MINUTE,
    NEXT_TICK,    /* at or after ?2; NULL: there is none */
    READ_SAMPLES, /* in the order of `kind` */
    READ_OUTPUTS,
    READ_ADJUSTMENTS,
    READ_STEPS,
    READ_MINUTES,
    WRITE,
    COUNT,
    REMOVE,
    STATEMENTS
} periods_statement;

#define PERIODS_OF_RUN "(SELECT period FROM periods WHERE length_s = ?1 AND run = runs.run ORDER BY period"

static const char *const sql_of[STATEMENTS] = {
    [FACTS_OF] = "SELECT step_ns, verb = 'hold', lead FROM runs WHERE run = ?1",
    [LAST_MINUTE] = "SELECT period FROM periods WHERE length_s = 60 AND run = ?1 ORDER BY period DESC LIMIT 1",
    [NEXT_TICK] = "SELECT min(tick) FROM"
                  " (SELECT * FROM (SELECT tick FROM samples WHERE run = ?1 AND tick >= ?2 ORDER BY tick LIMIT 1)"
                  " UNION ALL"
                  " SELECT * FROM (SELECT step FROM steps WHERE run = ?1 AND step >= ?2 ORDER BY step LIMIT 1))",
    [READ_SAMPLES] = "SELECT signal, value FROM samples WHERE run = ?1 AND tick >= ?2 AND tick < ?3 AND quality = 0",
    [READ_OUTPUTS] = "SELECT signal, error FROM outputs WHERE run = ?1 AND step >= ?2 AND step < ?3 AND quality = 0",
    [READ_ADJUSTMENTS] = "SELECT signal, correction FROM adjustments WHERE run = ?1 AND step >= ?2 AND step < ?3",
    [READ_STEPS] = "SELECT outcome, 0 FROM steps WHERE run = ?1 AND step >= ?2 AND step < ?3",
    [READ_MINUTES] = "SELECT kind, signal, count, mean, least, largest, spread FROM periods"
                     " WHERE length_s = 60 AND run = ?1 AND period >= ?2 AND period < ?3",
    [WRITE] =
        "INSERT OR REPLACE INTO periods (length_s, run, period, kind, signal, count, mean, least, largest, spread)"
        " VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?10)",
    /* A step longer than a period leaves periods out. */
    [COUNT] = "SELECT CAST(sum((" PERIODS_OF_RUN " DESC LIMIT 1) - " PERIODS_OF_RUN " LIMIT 1) + 1)"
              " * min(1.0, ?1 * 1e9 / step_ns)) AS INTEGER) FROM runs",
    [REMOVE] = "DELETE FROM periods WHERE length_s = ?1 AND (run, period) IN (SELECT DISTINCT run, period FROM periods"
               " WHERE length_s = ?1 ORDER BY run, period LIMIT ?2)",
};

/* Of the values of a series. */
typedef struct course {
    int64_t count;
    double mean, least, largest;
    double squares; /* of the deviations from the mean */
} course;

struct tl_periods {
    sqlite3_stmt *statements[STATEMENTS];
    int64_t run;     /* those below are of this run; 0: of none */
    int64_t step_ns; /* T_S */
    bool holds;      /* it has only samples */
    int64_t lead;    /* step i is computed at tick i + lead */
    int64_t next;    /* first minute that is not summarised */
    int64_t hour;    /* some of its minutes are summarised, but not the hour; −1: none */
    course courses[KINDS][SERIES];
};

/* ---- Statements ---- */

static sqlite3_stmt *bind_whole(tl_periods *periods, periods_statement which, int64_t first, int64_t second,
                                int64_t third) {
    sqlite3_stmt *prepared = periods->statements[which];
    const int64_t values[] = {first, second, third};
    const int count = sqlite3_bind_parameter_count(prepared);
    for (int i = 0; i < count && i < 3; i++) {
        (void)sqlite3_bind_int64(prepared, i + 1, values[i]);
    }
    return prepared;
}

static int end_statement(sqlite3_stmt *prepared, int code) {
    (void)sqlite3_reset(prepared);
    return code == SQLITE_ROW || code == SQLITE_DONE ? SQLITE_OK : code;
}

/* Reads the whole numbers of one row; leaves those that are NULL. */
static int query_whole(tl_periods *periods, periods_statement which, int64_t first, int64_t second, int64_t *results,
                       int count) {
    sqlite3_stmt *prepared = bind_whole(periods, which, first, second, 0);
    const int code = sqlite3_step(prepared);
    for (int i = 0; code == SQLITE_ROW && i < count; i++) {
        if (sqlite3_column_type(prepared, i) == SQLITE_INTEGER) {
            results[i] = sqlite3_column_int64(prepared, i);
        }
    }
    return end_statement(prepared, code);
}

/* ---- Sums ---- */

/* Joins two sets of values (Chan, Golub, LeVeque 1983). */
static void join_course(course *to, const course *more) {
    if (to->count == 0 || more->count == 0) {
        *to = to->count == 0 ? *more : *to;
        return;
    }
    const double all = (double)to->count + (double)more->count;
    const double apart = more->mean - to->mean;
    to->squares += more->squares + apart * apart * (double)to->count * (double)more->count / all;
    to->mean += apart * (double)more->count / all;
    to->least = fmin(to->least, more->least);
    to->largest = fmax(to->largest, more->largest);
    to->count += more->count;
}

static course *find_course(tl_periods *periods, kind of, int64_t signal) {
    return signal >= 0 && signal < SERIES ? &periods->courses[of][signal] : NULL;
}

static int add_rows(tl_periods *periods, kind of, int64_t from, int64_t until) {
    sqlite3_stmt *prepared = bind_whole(periods, (periods_statement)(READ_SAMPLES + of), periods->run, from, until);
    int code = SQLITE_ROW;
    while ((code = sqlite3_step(prepared)) == SQLITE_ROW) {
        course *to = find_course(periods, of, sqlite3_column_int64(prepared, 0));
        if (to != NULL && sqlite3_column_type(prepared, 1) != SQLITE_NULL) {
            const double value = sqlite3_column_double(prepared, 1);
            join_course(to, &(course){.count = 1, .mean = value, .least = value, .largest = value});
        }
    }
    return end_statement(prepared, code);
}

static double read_number(sqlite3_stmt *prepared, int column) {
    return sqlite3_column_type(prepared, column) == SQLITE_NULL ? (double)NAN : sqlite3_column_double(prepared, column);
}

static int add_minutes(tl_periods *periods, int64_t from, int64_t until) {
    sqlite3_stmt *prepared = bind_whole(periods, READ_MINUTES, periods->run, from, until);
    int code = SQLITE_ROW;
    while ((code = sqlite3_step(prepared)) == SQLITE_ROW) {
        const char *name = (const char *)sqlite3_column_text(prepared, 0);
        const double spread = read_number(prepared, 6);
        course more = {.count = sqlite3_column_int64(prepared, 2),
                       .mean = read_number(prepared, 3),
                       .least = read_number(prepared, 4),
                       .largest = read_number(prepared, 5)};
        more.squares = spread * spread * (double)more.count;
        for (int i = 0; i < KINDS && name != NULL; i++) {
            course *to = find_course(periods, (kind)i, sqlite3_column_int64(prepared, 1));
            bool is_count = more.count > 0 && more.count <= TL_ROW_NUMBER_MAX / MINUTES_PER_HOUR;
            if (to != NULL && is_count && strcmp(name, kind_names[i]) == 0) {
                join_course(to, &more);
            }
        }
    }
    return end_statement(prepared, code);
}

/* Writes a row for each series that has values; an outcome has only a count. */
static int write_courses(tl_periods *periods, int length_s, int64_t period) {
    int code = SQLITE_OK;
    for (int i = 0; i < KINDS * SERIES && code == SQLITE_OK; i++) {
        const int of = i / SERIES;
        const course *from = &periods->courses[of][i % SERIES];
        const double numbers[] = {from->mean, from->least, from->largest, sqrt(from->squares / (double)from->count)};
        if (from->count == 0) {
            continue;
        }
        sqlite3_stmt *prepared = periods->statements[WRITE];
        (void)sqlite3_clear_bindings(prepared);
        (void)bind_whole(periods, WRITE, length_s, periods->run, period);
        (void)sqlite3_bind_text(prepared, 4, kind_names[of], -1, SQLITE_STATIC);
        (void)sqlite3_bind_int(prepared, 5, i % SERIES);
        (void)sqlite3_bind_int64(prepared, 6, from->count);
        for (int k = 0; k < 4 && of != OUTCOME; k++) {
            (void)(isfinite(numbers[k]) ? sqlite3_bind_double(prepared, 7 + k, numbers[k])
                                        : sqlite3_bind_null(prepared, 7 + k));
        }
        code = end_statement(prepared, sqlite3_step(prepared));
    }
    return code;
}

/* ---- Periods ---- */

static int64_t tick_of(const tl_periods *periods, int64_t minute) {
    return (minute * MINUTE_NS + periods->step_ns - 1) / periods->step_ns;
}

static int summarise_minute(tl_periods *periods, int64_t minute) {
    int code = SQLITE_OK;
    memset(periods->courses, 0, sizeof periods->courses);
    for (int i = 0; i < KINDS && code == SQLITE_OK; i++) {
        code = add_rows(periods, (kind)i, tick_of(periods, minute), tick_of(periods, minute + 1));
    }
    return code == SQLITE_OK ? write_courses(periods, TL_MINUTE, minute) : code;
}

/* Summarises the hour of which some minutes are summarised. */
static int close_hour(tl_periods *periods) {
    const int64_t hour = periods->hour;
    if (hour < 0) {
        return SQLITE_OK;
    }
    periods->hour = -1;
    memset(periods->courses, 0, sizeof periods->courses);
    const int code = add_minutes(periods, hour * MINUTES_PER_HOUR, (hour + 1) * MINUTES_PER_HOUR);
    return code == SQLITE_OK ? write_courses(periods, TL_HOUR, hour) : code;
}

/* Finds where to continue. The newest minute is summarised again: its rows may not have been
 * complete. A damaged run is left out. */
static int begin_run(tl_periods *periods, int64_t run) {
    int64_t facts[3] = {0, 0, 0};
    int64_t next = 0;
    if (periods->run == run) {
        return SQLITE_OK;
    }
    int code = query_whole(periods, FACTS_OF, run, 0, facts, 3);
    code = code == SQLITE_OK ? query_whole(periods, LAST_MINUTE, run, 0, &next, 1) : code;
    const bool is_right = code == SQLITE_OK && facts[0] > 0 && facts[0] <= LONGEST_STEP && facts[2] >= 0 &&
                          facts[2] <= INT32_MAX && next >= 0 && next < TL_ROW_NUMBER_MAX / MINUTE_NS;
    periods->run = is_right ? run : 0;
    periods->step_ns = facts[0];
    periods->holds = facts[1] != 0;
    periods->lead = facts[2];
    periods->next = next;
    periods->hour = -1;
    return code;
}

/* Summarises the minutes that end at or before this tick. */
static int summarise(tl_periods *periods, int64_t tick) {
    int code = SQLITE_OK;
    while (code == SQLITE_OK) {
        int64_t found = -1;
        code = query_whole(periods, NEXT_TICK, periods->run, tick_of(periods, periods->next), &found, 1);
        const bool any = code == SQLITE_OK && found >= 0 && found < TL_ROW_NUMBER_MAX / periods->step_ns;
        const int64_t minute = any ? found * periods->step_ns / MINUTE_NS : -1;
        if (minute < periods->next || tick_of(periods, minute + 1) > tick) {
            break;
        }
        if (periods->hour != minute / MINUTES_PER_HOUR) {
            code = close_hour(periods);
        }
        code = code == SQLITE_OK ? summarise_minute(periods, minute) : code;
        periods->hour = minute / MINUTES_PER_HOUR;
        periods->next = minute + 1;
        if (code == SQLITE_OK && periods->next % MINUTES_PER_HOUR == 0) {
            code = close_hour(periods);
        }
    }
    return code;
}

int tl_periods_until(tl_periods *periods, int64_t run, int64_t step, int64_t sample) {
    int code = step < 0 && sample < 0 ? SQLITE_OK : begin_run(periods, run);
    if (code != SQLITE_OK || periods->run != run || periods->step_ns <= 0) {
        return code;
    }
    /* Steps that are so late do not come any more. */
    const int64_t late = sample - 2 * periods->lead - LATE / periods->step_ns;
    return summarise(periods, periods->holds ? sample : step > late ? step : late);
}

int tl_periods_end(tl_periods *periods, int64_t run) {
    int code = begin_run(periods, run);
    if (code == SQLITE_OK && periods->run == run && periods->step_ns > 0) {
        code = summarise(periods, INT64_MAX);
        code = code == SQLITE_OK ? close_hour(periods) : code;
    }
    tl_periods_forget(periods);
    return code;
}

void tl_periods_forget(tl_periods *periods) {
    periods->run = 0;
}

/* ---- Retention ---- */

int64_t tl_periods_room(int64_t max_bytes, int64_t series) {
    const int64_t outcomes = 4; /* that are usual in a period */
    const int64_t room = max_bytes / TL_PERIODS_SHARE / ((series + outcomes) * ROW_BYTES);
    return room > LEAST_ROOM ? room : LEAST_ROOM;
}

int tl_periods_remove(tl_periods *periods, int64_t max_bytes, int64_t series, int64_t rows, bool *removed) {
    int code = SQLITE_OK;
    *removed = false;
    for (int length_s = TL_MINUTE; length_s <= TL_HOUR && code == SQLITE_OK && !*removed;
         length_s += TL_HOUR - TL_MINUTE) {
        int64_t count = 0;
        code = query_whole(periods, COUNT, length_s, 0, &count, 1);
        const int64_t surplus = count - tl_periods_room(max_bytes, series);
        if (code != SQLITE_OK || surplus <= 0) {
            continue;
        }
        const int64_t at_once = rows / (series + 1) + 1;
        sqlite3_stmt *prepared = bind_whole(periods, REMOVE, length_s, surplus < at_once ? surplus : at_once, 0);
        code = end_statement(prepared, sqlite3_step(prepared));
        *removed = code == SQLITE_OK;
    }
    return code;
}

/* ---- Opening ---- */

int tl_periods_open(sqlite3 *connection, tl_periods **periods) {
    tl_periods *opened = calloc(1, sizeof *opened);
    int code = opened == NULL ? SQLITE_NOMEM : SQLITE_OK;
    *periods = opened;
    for (int i = 0; i < STATEMENTS && code == SQLITE_OK; i++) {
        code = sqlite3_prepare_v3(connection, sql_of[i], -1, SQLITE_PREPARE_PERSISTENT, &opened->statements[i], NULL);
    }
    return code;
}

void tl_periods_close(tl_periods *periods) {
    if (periods != NULL) {
        for (int i = 0; i < STATEMENTS; i++) {
            (void)sqlite3_finalize(periods->statements[i]);
        }
        free(periods);
    }
}
