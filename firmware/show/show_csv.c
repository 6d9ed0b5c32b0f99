/* Tables as CSV (quoted as RFC 4180 says), one line per step or tick, so that a spreadsheet or a plot can take them as they are.
 *
 * A line of samples has the signals' names (without "plant.") as columns, and "time" in front: `replay --recording` takes it. A value that was
 * missing or old at its tick is left empty there; its quality is in a column beside it. Control characters become "?". */
#include <math.h>
#include <sqlite3.h>
#include <string.h>

#include "firmware/show/show.h"
#include "firmware/show/show_rows.h"

enum { MOST_FIELDS = 4 * TL_MAX_SIGNALS, NUMBER = 40 };

/* One line while its rows come. Fields are in the order of the header, `per_signal` for each signal. */
typedef struct csv_line {
    const tl_show_request *request;
    FILE *file;
    tl_show_source source;
    size_t signals;
    size_t per_signal;
    int64_t number;                     /* of the step or tick; −1: none begun */
    const tl_recorder_signal *adjusted; /* for the names of those that were held */
    size_t adjusted_count;
    char fields[MOST_FIELDS][NUMBER];
} csv_line;

/* Texts come from FMUs and devices too: none breaks a line, or commands the terminal. */
static void put_text(FILE *file, const char *text) {
    bool quoted = strpbrk(text, ",\"") != NULL;
    (void)fputs(quoted ? "\"" : "", file);
    while (*text != '\0') {
        size_t length = tl_show_character(text);
        if (tl_show_is_control(text, length)) {
            (void)fputc('?', file);
        } else {
            (void)fputs(*text == '"' ? "\"" : "", file);
            (void)fwrite(text, 1, length, file);
        }
        text += length;
    }
    (void)fputs(quoted ? "\"" : "", file);
}

static void end_line(FILE *file) {
    (void)fputc('\n', file);
}

/* Empty for NULL. */
static void format_column(sqlite3_stmt *row, int column, char *text, size_t size) {
    text[0] = '\0';
    if (sqlite3_column_type(row, column) == SQLITE_INTEGER) {
        (void)snprintf(text, size, "%lld", (long long)sqlite3_column_int64(row, column));
    } else if (sqlite3_column_type(row, column) == SQLITE_FLOAT) {
        tl_show_exact(sqlite3_column_double(row, column), text, size);
    }
}

/* "time", and for a live run when that was in the world. */
static void put_instant(const csv_line *line, int64_t step) {
    char text[NUMBER];
    const tl_history_run *run = line->request->run;
    tl_show_exact((double)step * (double)run->step / 1e9, text, sizeof text);
    (void)fputs(text, line->file);
    if (tl_show_is_live(run)) {
        char utc[TL_UTC_TEXT];
        tl_utc_text(tl_show_instant(run, step), utc);
        (void)fprintf(line->file, ",%s", utc);
    }
}

static void put_instant_header(const csv_line *line) {
    (void)fputs(tl_show_is_live(line->request->run) ? "time,at" : "time", line->file);
}

/* ---- Lines of several rows --------------------------------------------------------------------------------------- */

static void flush_line(csv_line *line) {
    if (line->number < 0) {
        return;
    }
    /* y belongs to the end of its step, u and a sample to the beginning. */
    put_instant(line, line->source == TL_SHOW_FROM_OUTPUTS ? line->number + 1 : line->number);
    (void)fprintf(line->file, ",%lld", (long long)line->number);
    for (size_t i = 0; i < line->signals * line->per_signal; i++) {
        (void)fprintf(line->file, ",%s", line->fields[i]);
        line->fields[i][0] = '\0';
    }
    end_line(line->file);
    line->number = -1;
}

static const char *quality_text(sqlite3_stmt *row, int column) {
    int64_t quality = sqlite3_column_int64(row, column);
    return quality < TL_GOOD || quality > TL_OUTLIER ? "unknown" : tl_quality_name((tl_quality)quality);
}

static void put_delta(sqlite3_stmt *row, char field[NUMBER]) {
    field[0] = '\0';
    if (sqlite3_column_type(row, 2) != SQLITE_NULL && sqlite3_column_type(row, 3) != SQLITE_NULL) {
        tl_show_exact(sqlite3_column_double(row, 2) - sqlite3_column_double(row, 3), field, NUMBER);
    }
}

static void fill_sample(char (*fields)[NUMBER], sqlite3_stmt *row) {
    int64_t quality = sqlite3_column_int64(row, 3);
    fields[0][0] = '\0';
    if (quality == TL_GOOD || quality == TL_OUT_OF_RANGE || quality == TL_OUTLIER) {
        format_column(row, 2, fields[0], NUMBER);
    }
    (void)snprintf(fields[1], NUMBER, "%s", quality_text(row, 3));
}

static void take_row(void *context, struct sqlite3_stmt *row) {
    csv_line *line = context;
    int64_t number = sqlite3_column_int64(row, 0);
    if (number != line->number) {
        flush_line(line);
        line->number = number;
    }
    char(*fields)[NUMBER] = &line->fields[(size_t)sqlite3_column_int64(row, 1) * line->per_signal];
    if (line->source == TL_SHOW_FROM_SAMPLES) {
        fill_sample(fields, row);
        return;
    }
    format_column(row, 2, fields[0], NUMBER);
    format_column(row, 3, fields[1], NUMBER);
    put_delta(row, fields[2]);
    if (line->source == TL_SHOW_FROM_OUTPUTS) {
        (void)snprintf(fields[3], NUMBER, "%s", quality_text(row, 4));
    }
}

/* One column of the header: a name, and what of it. */
static void put_header(const csv_line *line, const char *name, const char *what) {
    char text[512];
    (void)snprintf(text, sizeof text, "%s%s", name, what);
    (void)fputc(',', line->file);
    put_text(line->file, text);
}

/* As a recording's columns are named where nothing else is configured: "plant.torque" is in the column "torque". */
static const char *column_of(const char *name) {
    static const char prefix[] = "plant.";
    return strncmp(name, prefix, sizeof prefix - 1) == 0 ? name + sizeof prefix - 1 : name;
}

static void put_signal_header(const csv_line *line, const tl_recorder_signal *signal) {
    switch (line->source) {
    case TL_SHOW_FROM_SAMPLES:
        put_header(line, column_of(signal->name), "");
        put_header(line, column_of(signal->name), " quality");
        break;
    case TL_SHOW_FROM_OUTPUTS:
        put_header(line, signal->name, "");
        put_header(line, signal->to == NULL ? "" : signal->to, "");
        put_header(line, signal->name, " delta");
        put_header(line, signal->to == NULL ? "" : signal->to, " quality");
        break;
    case TL_SHOW_FROM_ADJUSTMENTS:
        put_header(line, signal->name, "");
        put_header(line, signal->name, " nominal");
        put_header(line, signal->name, " delta");
        break;
    case TL_SHOW_FROM_STEPS:
        break;
    }
}

static tl_status print_wide(csv_line *line, tl_history_kind kind, tl_error *error) {
    const tl_show_request *request = line->request;
    const tl_recorder_signal *signals = NULL;
    int64_t range[2] = {0, 0};
    bool any = false;
    tl_status status = tl_history_signals(request->history, request->run, kind, &signals, &line->signals, error);
    if (status == TL_OK) {
        status = tl_show_range(request->history, request->run, line->source, request->from_step, range, &any, error);
    }
    if (status != TL_OK) {
        return status;
    }
    put_instant_header(line);
    (void)fputs(line->source == TL_SHOW_FROM_SAMPLES ? ",tick" : ",step", line->file);
    for (size_t i = 0; i < line->signals; i++) {
        put_signal_header(line, &signals[i]);
    }
    end_line(line->file);
    if (any) {
        status = tl_show_rows(request->history, request->run, line->source, range, line->signals,
                              (tl_show_taker){take_row, line}, error);
        flush_line(line);
    }
    return status;
}

/* ---- Lines of one row -------------------------------------------------------------------------------------------- */

/* The names of set bits; nothing where there is none, or an older program did not say. */
static void put_flags(FILE *file, uint32_t flags) {
    char text[128] = "";
    for (unsigned bit = TL_FLAG_FALLBACK; bit <= TL_LAST_FLAG; bit <<= 1) {
        size_t length = strlen(text);
        if ((flags & bit) != 0) {
            (void)snprintf(text + length, sizeof text - length, "%s%s", length > 0 ? ", " : "",
                           tl_flag_name((tl_flag)bit));
        }
    }
    put_text(file, text);
}

static void put_held(const csv_line *line, uint32_t held) {
    char text[1024] = "";
    for (size_t i = 0; i < line->adjusted_count; i++) {
        size_t length = strlen(text);
        if ((held >> i & 1U) != 0) {
            (void)snprintf(text + length, sizeof text - length, "%s%s", length > 0 ? ", " : "", line->adjusted[i].name);
        }
    }
    put_text(line->file, text);
}

static void take_step(void *context, struct sqlite3_stmt *row) {
    const csv_line *line = context;
    int64_t step = sqlite3_column_int64(row, 0);
    int64_t outcome = sqlite3_column_int64(row, 2);
    int64_t stop = sqlite3_column_int64(row, 3);
    put_instant(line, step);
    (void)fprintf(line->file, ",%lld,%s,%s", (long long)step,
                  outcome < TL_FREE || outcome >= TL_OUTCOMES ? "unknown" : tl_outcome_name((tl_outcome)outcome),
                  stop < TL_STOP_NONE || stop > TL_STOP_TIME ? "unknown" : tl_stop_name((tl_stop)stop));
    for (int i = 4; i <= 9; i++) {
        char text[NUMBER];
        format_column(row, i, text, sizeof text);
        (void)fprintf(line->file, ",%s", text);
    }
    (void)fputc(',', line->file);
    put_flags(line->file, (uint32_t)sqlite3_column_int64(row, 10));
    (void)fputc(',', line->file);
    put_held(line, (uint32_t)sqlite3_column_int64(row, 11));
    end_line(line->file);
}

static tl_status print_steps(csv_line *line, tl_error *error) {
    const tl_show_request *request = line->request;
    int64_t range[2] = {0, 0};
    bool any = false;
    tl_status status =
        tl_show_range(request->history, request->run, line->source, request->from_step, range, &any, error);
    if (status == TL_OK) {
        status = tl_history_signals(request->history, request->run, TL_HISTORY_ADJUST, &line->adjusted,
                                    &line->adjusted_count, error);
    }
    put_instant_header(line);
    (void)fputs(",step,outcome,stop,J,J_nominal,evaluations,executions,used_ns,predicted,flags,held", line->file);
    end_line(line->file);
    if (status == TL_OK && any) {
        status = tl_show_rows(request->history, request->run, line->source, range, 1, (tl_show_taker){take_step, line},
                              error);
    }
    return status;
}

static void take_event(void *context, const tl_show_event *event) {
    const csv_line *line = context;
    const char *const texts[] = {event->severity, event->source, event->text};
    put_text(line->file, event->at);
    (void)fputc(',', line->file);
    if (event->has_tick) {
        (void)fprintf(line->file, "%lld", (long long)event->tick);
    }
    for (size_t i = 0; i < sizeof texts / sizeof texts[0]; i++) {
        (void)fputc(',', line->file);
        put_text(line->file, texts[i]);
    }
    end_line(line->file);
}

static tl_status print_events(csv_line *line, tl_error *error) {
    const tl_show_request *request = line->request;
    (void)fputs("at,tick,severity,source,text", line->file);
    end_line(line->file);
    return tl_show_event_rows(request->history, request->run, request->from_at, -1,
                              (tl_show_event_taker){take_event, line}, error);
}

tl_status tl_show_csv(const tl_show_request *request, tl_show_csv_table table, FILE *file, tl_error *error) {
    static csv_line line; /* too large for a small stack; `show` has one thread */
    static const struct {
        tl_show_source source;
        size_t per_signal;
        tl_history_kind kind;
    } tables[] = {
        [TL_SHOW_OUTPUTS] = {TL_SHOW_FROM_OUTPUTS, 4, TL_HISTORY_MATCH},
        [TL_SHOW_ADJUSTMENTS] = {TL_SHOW_FROM_ADJUSTMENTS, 3, TL_HISTORY_ADJUST},
        [TL_SHOW_STEPS] = {TL_SHOW_FROM_STEPS, 0, TL_HISTORY_PLANT},
        [TL_SHOW_SAMPLES] = {TL_SHOW_FROM_SAMPLES, 2, TL_HISTORY_PLANT},
    };
    memset(&line, 0, sizeof line);
    line.request = request;
    line.file = file;
    line.number = -1;
    if (table == TL_SHOW_EVENTS) {
        return print_events(&line, error);
    }
    line.source = tables[table].source;
    line.per_signal = tables[table].per_signal;
    return table == TL_SHOW_STEPS ? print_steps(&line, error) : print_wide(&line, tables[table].kind, error);
}
