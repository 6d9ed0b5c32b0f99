/* Tables as CSV (quoted as RFC 4180 requires), one line per step or tick, for spreadsheets and
 * plots.
 *
 * A line of samples has the columns "time" and the names of the signals, without "plant.", so
 * `replay --recording` can read it. A value that was missing or stale at its tick is empty; its
 * quality has its own column. Control characters become "?".
 */
#include <errno.h>
#include <inttypes.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "firmware/report/show.h"
#include "firmware/store/history.h"

enum { MOST_FIELDS = 4 * TL_MAX_SIGNALS, NUMBER = 40 };

typedef char csv_field[NUMBER];

/* Column of a signal: its own name or that of its matched signal, and a suffix. */
typedef struct csv_column {
    bool is_to;
    const char *what;
} csv_column;

typedef struct csv_table {
    tl_history_table rows;
    tl_history_kind kind; /* of the signals */
    const char *head;     /* columns after the time */
    size_t per_signal;
    csv_column columns[4];
    tl_history_visitor visitor;
} csv_table;

/* One line while its rows are read. Fields are in the order of the header, `per_signal` for each
 * signal. */
typedef struct csv_line {
    const tl_show_request *request;
    tl_show_output output;
    const csv_table *table;
    const tl_recorder_signal *signal; /* signals of the table's kind; for steps those that can be held */
    size_t signals;
    int64_t number; /* of the step or tick; −1: no line is open */
    csv_field fields[MOST_FIELDS];
} csv_line;

/* FMUs and devices supply some texts, so control characters are replaced: a text must not break a
 * line or control the terminal. */
static void put_characters(FILE *file, const char *text) {
    while (*text != '\0') {
        bool is_control = false;
        size_t length = tl_show_character(text, &is_control);
        if (is_control) {
            (void)fputc('?', file);
        } else {
            (void)fputs(*text == '"' ? "\"" : "", file);
            (void)fwrite(text, 1, length, file);
        }
        text += length;
    }
}

/* Writes `text` and `what` into one field. */
static void put_field(FILE *file, const char *text, const char *what) {
    bool quoted = strpbrk(text, ",\"") != NULL;
    (void)fputs(quoted ? "\"" : "", file);
    put_characters(file, text);
    put_characters(file, what);
    (void)fputs(quoted ? "\"" : "", file);
}

static void put_text(FILE *file, const char *text) {
    put_field(file, text, "");
}

/* Writes a comma and a header cell: a name and a suffix. */
static void put_name(FILE *file, const char *name, const char *what) {
    (void)fputc(',', file);
    put_field(file, name, what);
}

/* Leaves the text empty for NaN, which stands for any value that was not finite. */
static void format_number(double value, csv_field text) {
    text[0] = '\0';
    if (!isnan(value)) {
        tl_show_exact(value, text, NUMBER);
    }
}

/* Writes "time"; for a live run also the date and time. */
static void put_instant(const csv_line *line, int64_t step) {
    char text[NUMBER];
    const tl_history_run *run = line->request->run;
    tl_show_exact((double)step * (double)run->step / 1e9, text, sizeof text);
    (void)fputs(text, line->output.file);
    if (tl_show_is_live(run)) {
        char utc[TL_UTC_TEXT];
        tl_utc_text(tl_show_instant(run, step), utc);
        (void)fprintf(line->output.file, ",%s", utc);
    }
}

/* ---- Lines of several rows ------------------------------------------------------------------- */

static void flush_line(csv_line *line) {
    if (line->number < 0) {
        return;
    }
    /* y belongs to the end of its step; u and samples belong to the beginning. */
    put_instant(line, line->table->rows == TL_HISTORY_OUTPUTS ? line->number + 1 : line->number);
    (void)fprintf(line->output.file, ",%lld", (long long)line->number);
    for (size_t i = 0; i < line->signals * line->table->per_signal; i++) {
        (void)fprintf(line->output.file, ",%s", line->fields[i]);
        line->fields[i][0] = '\0';
    }
    (void)fputc('\n', line->output.file);
    line->number = -1;
}

static const char *quality_text(int64_t quality) {
    return quality < TL_GOOD || quality > TL_LAST_QUALITY ? "unknown" : tl_quality_name((tl_quality)quality);
}

/* Returns the fields of one signal in the line of this tick or step. */
static csv_field *fields_of(csv_line *line, int64_t number, size_t signal) {
    if (number != line->number) {
        flush_line(line);
        line->number = number;
    }
    return &line->fields[signal * line->table->per_signal];
}

static void take_sample(void *context, const tl_history_sample *sample) {
    csv_field *fields = fields_of(context, sample->tick, sample->signal);
    bool is_known = sample->quality == TL_GOOD || sample->quality == TL_OUT_OF_RANGE || sample->quality >= TL_OUTLIER;
    format_number(is_known ? sample->value : (double)NAN, fields[0]);
    (void)snprintf(fields[1], NUMBER, "%s", quality_text(sample->quality));
}

static void take_output(void *context, const tl_history_output *output) {
    csv_field *fields = fields_of(context, output->step, output->signal);
    format_number(output->y, fields[0]);
    format_number(output->measured, fields[1]);
    format_number(output->y - output->measured, fields[2]);
    (void)snprintf(fields[3], NUMBER, "%s", quality_text(output->quality));
}

static void take_adjustment(void *context, const tl_history_adjustment *adjustment) {
    csv_field *fields = fields_of(context, adjustment->step, adjustment->signal);
    format_number(adjustment->u, fields[0]);
    format_number(adjustment->nominal, fields[1]);
    format_number(adjustment->u - adjustment->nominal, fields[2]);
}

/* Removes "plant.": the default column of the signal "plant.torque" in a recording is "torque". */
static const char *column_of(const char *name) {
    static const char prefix[] = "plant.";
    return strncmp(name, prefix, sizeof prefix - 1) == 0 ? name + sizeof prefix - 1 : name;
}

static void put_signal_header(const csv_line *line, const tl_recorder_signal *signal) {
    for (size_t i = 0; i < line->table->per_signal; i++) {
        const csv_column *column = &line->table->columns[i];
        const char *name = line->table->rows == TL_HISTORY_SAMPLES ? column_of(signal->name) : signal->name;
        put_name(line->output.file, !column->is_to ? name : signal->to != NULL ? signal->to : "", column->what);
    }
}

/* ---- Lines of one row ------------------------------------------------------------------------ */

/* Appends a name to a list. */
static void append_name(char *text, size_t size, const char *name) {
    size_t length = strlen(text);
    (void)snprintf(text + length, size - length, "%s%s", length > 0 ? ", " : "", name);
}

/* Writes the names of the set bits. */
static void put_flags(FILE *file, uint32_t flags) {
    char text[128] = "";
    for (unsigned bit = TL_FLAG_FALLBACK; bit <= TL_LAST_FLAG; bit <<= 1) {
        if ((flags & bit) != 0) {
            append_name(text, sizeof text, tl_flag_name((tl_flag)bit));
        }
    }
    put_text(file, text);
}

static void put_held(const csv_line *line, uint32_t held) {
    char text[1024] = "";
    for (size_t i = 0; i < line->signals; i++) {
        if ((held >> i & 1U) != 0) {
            append_name(text, sizeof text, line->signal[i].name);
        }
    }
    put_text(line->output.file, text);
}

static void take_step(void *context, const tl_history_step *step) {
    const csv_line *line = context;
    csv_field objective;
    csv_field nominal;
    format_number(step->objective, objective);
    format_number(step->objective_nominal, nominal);
    put_instant(line, step->step);
    (void)fprintf(
        line->output.file, ",%" PRId64 ",%s,%s,%s,%s,%" PRId64 ",%" PRId64 ",%" PRId64 ",%" PRId64 ",", step->step,
        step->outcome < TL_FREE || step->outcome >= TL_OUTCOMES ? "unknown"
                                                                : tl_outcome_name((tl_outcome)step->outcome),
        step->stop < TL_STOP_NONE || step->stop > TL_STOP_TIME ? "unknown" : tl_stop_name((tl_stop)step->stop),
        objective, nominal, step->evaluations, step->executions, step->used, step->predicted);
    put_flags(line->output.file, step->flags);
    (void)fputc(',', line->output.file);
    put_held(line, step->held);
    (void)fputc('\n', line->output.file);
}

static void take_event(void *context, const tl_history_event *event) {
    const csv_line *line = context;
    const char *const texts[] = {event->severity, event->source, event->text};
    put_text(line->output.file, event->at);
    (void)fputc(',', line->output.file);
    if (event->has_tick) {
        (void)fprintf(line->output.file, "%lld", (long long)event->tick);
    }
    for (size_t i = 0; i < sizeof texts / sizeof texts[0]; i++) {
        (void)fputc(',', line->output.file);
        put_text(line->output.file, texts[i]);
    }
    (void)fputc('\n', line->output.file);
}

static void take_period(void *context, const tl_history_period *period) {
    const csv_line *line = context;
    const double numbers[] = {period->mean, period->least, period->largest, period->spread};
    (void)fprintf(line->output.file, "%" PRId64, period->start_s);
    if (tl_show_is_live(period->run)) {
        char utc[TL_UTC_TEXT];
        int64_t started = 0;
        (void)tl_utc_parse(period->run->started, &started);
        tl_utc_text(started + period->start_s * 1000, utc);
        (void)fprintf(line->output.file, ",%s", utc);
    }
    (void)fprintf(line->output.file, ",%" PRId64 ",%s", period->run->run, period->kind);
    put_name(line->output.file, period->name, "");
    put_name(line->output.file, period->unit, "");
    (void)fprintf(line->output.file, ",%" PRId64, period->count);
    for (size_t i = 0; i < sizeof numbers / sizeof numbers[0]; i++) {
        csv_field text;
        format_number(numbers[i], text);
        (void)fprintf(line->output.file, ",%s", text);
    }
    (void)fputc('\n', line->output.file);
}

/* ---- Output ---------------------------------------------------------------------------------- */

tl_status tl_show_output_open(tl_show_output *output, FILE *to, tl_error *error) {
    *output = (tl_show_output){.to = to};
    output->file = open_memstream(&output->text, &output->size);
    return output->file != NULL ? TL_OK : tl_fail(error, TL_TRY_AGAIN, "not enough memory");
}

void tl_show_output_write(tl_show_output *output) {
    (void)fflush(output->file);
    (void)fwrite(output->text, 1, output->size, output->to);
    (void)fseek(output->file, 0, SEEK_SET); /* rewind() would clear an error */
}

tl_status tl_show_output_close(tl_show_output *output, tl_status status, tl_error *error) {
    tl_show_output_write(output);
    bool is_complete = ferror(output->file) == 0;
    (void)fclose(output->file);
    free(output->text);
    return status == TL_OK && !is_complete ? tl_fail(error, TL_TRY_AGAIN, "not enough memory") : status;
}

static void write_lines(void *context) {
    csv_line *line = context;
    tl_show_output_write(&line->output);
}

/* ---- The tables ------------------------------------------------------------------------------ */

static tl_status print_periods(csv_line *line, int length_s, tl_error *error) {
    const tl_show_request *request = line->request;
    const tl_history_visitor visitor = {.context = line, .period = take_period, .pause = write_lines};
    (void)fprintf(line->output.file, "time%s,run,kind,name,unit,count,mean,least,largest,spread\n",
                  tl_show_is_live(request->run) ? ",at" : "");
    return tl_history_periods(request->history, request->run, length_s, &visitor, error);
}

static tl_status print_events(csv_line *line, tl_error *error) {
    const tl_show_request *request = line->request;
    const tl_history_visitor visitor = {.context = line, .event = take_event, .pause = write_lines};
    (void)fputs("at,tick,severity,source,text\n", line->output.file);
    return tl_history_events(request->history, request->run, request->from_at, -1, &visitor, error);
}

static tl_status print_rows(csv_line *line, tl_error *error) {
    const tl_show_request *request = line->request;
    const csv_table *table = line->table;
    tl_history_visitor visitor = table->visitor;
    int64_t range[2] = {0, 0};
    bool any = false;
    tl_status status =
        tl_history_range(request->history, request->run, table->rows, request->from_step, range, &any, error);
    if (status == TL_OK) {
        status = tl_history_signals(request->history, request->run, table->kind, &line->signal, &line->signals, error);
    }
    if (status != TL_OK) {
        return status;
    }
    (void)fprintf(line->output.file, "time%s,%s", tl_show_is_live(request->run) ? ",at" : "", table->head);
    for (size_t i = 0; i < line->signals; i++) {
        put_signal_header(line, &line->signal[i]);
    }
    (void)fputc('\n', line->output.file);
    if (any) {
        visitor.context = line;
        visitor.pause = write_lines;
        visitor.signals[table->kind] = line->signals;
        status = tl_history_rows(request->history, request->run, range, &visitor, error);
        flush_line(line);
    }
    return status;
}

static tl_status print_table(csv_line *line, tl_show_csv_table table, tl_error *error) {
    return table == TL_SHOW_EVENTS    ? print_events(line, error)
           : table == TL_SHOW_MINUTES ? print_periods(line, TL_MINUTE, error)
           : table == TL_SHOW_HOURS   ? print_periods(line, TL_HOUR, error)
                                      : print_rows(line, error);
}

tl_status tl_show_csv(const tl_show_request *request, tl_show_csv_table table, FILE *file, tl_error *error) {
    static csv_line line; /* static because it is too large for a small stack; `show` has one thread */
    static const csv_table tables[] = {
        [TL_SHOW_OUTPUTS] = {TL_HISTORY_OUTPUTS,
                             TL_HISTORY_MATCH,
                             "step",
                             4,
                             {{false, " simulated"}, {true, " measured"}, {false, " error"}, {true, " quality"}},
                             {.output = take_output}},
        [TL_SHOW_ADJUSTMENTS] = {TL_HISTORY_ADJUSTMENTS,
                                 TL_HISTORY_ADJUST,
                                 "step",
                                 3,
                                 {{false, " applied"}, {false, " nominal"}, {false, " correction"}},
                                 {.adjustment = take_adjustment}},
        [TL_SHOW_STEPS] = {TL_HISTORY_STEPS, TL_HISTORY_ADJUST,
                           "step,outcome,stop,J,J_nominal,evaluations,executions,used_ns,predicted,flags,held",
                           .visitor = {.step = take_step}},
        [TL_SHOW_SAMPLES] = {TL_HISTORY_SAMPLES,
                             TL_HISTORY_PLANT,
                             "tick",
                             2,
                             {{false, ""}, {false, " quality"}},
                             {.sample = take_sample}},
    };
    memset(&line, 0, sizeof line);
    line.request = request;
    line.number = -1;
    line.table = table < TL_SHOW_EVENTS ? &tables[table] : NULL;
    tl_status status = tl_show_output_open(&line.output, file, error);
    if (status == TL_OK) {
        status = print_table(&line, table, error);
        status = tl_show_output_close(&line.output, status, error);
    }
    return status;
}

/* ---- The trajectory of a replay -------------------------------------------------------------- */

tl_status tl_trajectory_open(const char *path, FILE *output, const tl_config *config, FILE **file, tl_error *error) {
    *file = strcmp(path, "-") == 0 ? output : fopen(path, "w");
    if (*file == NULL) {
        return tl_fail(error, TL_TRY_AGAIN, "%s: cannot be written: %s", path, strerror(errno));
    }
    (void)fputs("time,step,outcome,evaluations,J", *file);
    for (size_t i = 0; i < config->match_count; i++) {
        put_name(*file, config->match[i].variable, " simulated");
        put_name(*file, config->match[i].to, " measured");
        put_name(*file, config->match[i].to, " quality");
    }
    for (size_t i = 0; i < config->adjust_count; i++) {
        put_name(*file, config->adjust[i].variable, " applied");
        put_name(*file, config->adjust[i].variable, " nominal");
    }
    (void)fputc('\n', *file);
    return TL_OK;
}

void tl_trajectory_add(FILE *file, const tl_config *config, const tl_record *record) {
    (void)fprintf(file, "%.9f,%" PRId64 ",%s,%" PRIu32 ",",
                  tl_seconds(tl_time_of_step(0, config->step, record->step + 1)), record->step,
                  tl_outcome_name(record->outcome), record->evaluations);
    if (isfinite(record->objective)) {
        (void)fprintf(file, "%.17g", record->objective);
    }
    for (size_t i = 0; i < config->match_count; i++) {
        (void)fprintf(file, ",%.17g,%.17g,%s", record->y[i], record->measured[i],
                      tl_quality_name((tl_quality)record->measured_quality[i]));
    }
    for (size_t i = 0; i < config->adjust_count; i++) {
        (void)fprintf(file, ",%.17g,%.17g", record->u[i], record->nominal[i]);
    }
    (void)fputc('\n', file);
}

tl_status tl_trajectory_close(FILE *file, FILE *output, const char *path, tl_error *error) {
    bool failed = ferror(file) != 0;
    errno = EIO; /* the cause that is reported if only an earlier write failed */
    if (file == output) {
        failed = fflush(file) != 0 || failed;
    } else {
        failed = fclose(file) != 0 || failed;
    }
    return failed ? tl_fail(error, TL_TRY_AGAIN, "%s: not everything could be written: %s%s", path, strerror(errno),
                            errno == ENOSPC ? ": free space, or give another file" : "")
                  : TL_OK;
}
