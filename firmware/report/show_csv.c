/* Tables as CSV (quoted as RFC 4180 says), one line per step or tick, so that a spreadsheet or a plot can take them as they are.
 *
 * A line of samples has the signals' names (without "plant.") as columns, and "time" in front: `replay --recording` takes it. A value that was
 * missing or old at its tick is left empty there; its quality is in a column beside it. Control characters become "?". */
#include <inttypes.h>
#include <math.h>
#include <string.h>

#include "firmware/report/show.h"
#include "firmware/store/history.h"

enum { MOST_FIELDS = 4 * TL_MAX_SIGNALS, NUMBER = 40 };

typedef char csv_field[NUMBER];

/* One line while its rows come. Fields are in the order of the header, `per_signal` for each signal. */
typedef struct csv_line {
    const tl_show_request *request;
    FILE *file;
    tl_history_table table;
    tl_history_visitor visitor;
    size_t signals;
    size_t per_signal;
    int64_t number;                     /* of the step or tick; −1: none begun */
    const tl_recorder_signal *adjusted; /* for the names of those that were held */
    size_t adjusted_count;
    csv_field fields[MOST_FIELDS];
} csv_line;

/* Texts come from FMUs and devices too: none breaks a line, or commands the terminal. */
static void put_text(FILE *file, const char *text) {
    bool quoted = strpbrk(text, ",\"") != NULL;
    (void)fputs(quoted ? "\"" : "", file);
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
    (void)fputs(quoted ? "\"" : "", file);
}

static void end_line(FILE *file) {
    (void)fputc('\n', file);
}

/* Empty for NaN: what was not finite. */
static void format_number(double value, csv_field text) {
    text[0] = '\0';
    if (!isnan(value)) {
        tl_show_exact(value, text, NUMBER);
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
    put_instant(line, line->table == TL_HISTORY_OUTPUTS ? line->number + 1 : line->number);
    (void)fprintf(line->file, ",%lld", (long long)line->number);
    for (size_t i = 0; i < line->signals * line->per_signal; i++) {
        (void)fprintf(line->file, ",%s", line->fields[i]);
        line->fields[i][0] = '\0';
    }
    end_line(line->file);
    line->number = -1;
}

static const char *quality_text(int64_t quality) {
    return quality < TL_GOOD || quality > TL_OUTLIER ? "unknown" : tl_quality_name((tl_quality)quality);
}

/* The fields of one signal in the line of this tick or step. */
static csv_field *fields_of(csv_line *line, int64_t number, size_t signal) {
    if (number != line->number) {
        flush_line(line);
        line->number = number;
    }
    return &line->fields[signal * line->per_signal];
}

static void take_sample(void *context, const tl_history_sample *sample) {
    csv_field *fields = fields_of(context, sample->tick, sample->signal);
    bool is_known = sample->quality == TL_GOOD || sample->quality == TL_OUT_OF_RANGE || sample->quality == TL_OUTLIER;
    format_number(is_known ? sample->value : (double)NAN, fields[0]);
    (void)snprintf(fields[1], NUMBER, "%s", quality_text(sample->quality));
}

static void take_output(void *context, const tl_history_output *output) {
    csv_field *fields = fields_of(context, output->step, output->signal);
    format_number(output->y, fields[0]);
    format_number(output->y_hat, fields[1]);
    format_number(output->y - output->y_hat, fields[2]);
    (void)snprintf(fields[3], NUMBER, "%s", quality_text(output->quality));
}

static void take_adjustment(void *context, const tl_history_adjustment *adjustment) {
    csv_field *fields = fields_of(context, adjustment->step, adjustment->signal);
    format_number(adjustment->u, fields[0]);
    format_number(adjustment->u_hat, fields[1]);
    format_number(adjustment->u - adjustment->u_hat, fields[2]);
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
    switch (line->table) {
    case TL_HISTORY_SAMPLES:
        put_header(line, column_of(signal->name), "");
        put_header(line, column_of(signal->name), " quality");
        break;
    case TL_HISTORY_OUTPUTS:
        put_header(line, signal->name, "");
        put_header(line, signal->to == NULL ? "" : signal->to, "");
        put_header(line, signal->name, " delta");
        put_header(line, signal->to == NULL ? "" : signal->to, " quality");
        break;
    case TL_HISTORY_ADJUSTMENTS:
        put_header(line, signal->name, "");
        put_header(line, signal->name, " nominal");
        put_header(line, signal->name, " delta");
        break;
    case TL_HISTORY_STEPS:
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
        status = tl_history_range(request->history, request->run, line->table, request->from_step, range, &any, error);
    }
    if (status != TL_OK) {
        return status;
    }
    put_instant_header(line);
    (void)fputs(line->table == TL_HISTORY_SAMPLES ? ",tick" : ",step", line->file);
    for (size_t i = 0; i < line->signals; i++) {
        put_signal_header(line, &signals[i]);
    }
    end_line(line->file);
    if (any) {
        line->visitor.signals[kind] = line->signals;
        status = tl_history_rows(request->history, request->run, range, &line->visitor, error);
        flush_line(line);
    }
    return status;
}

/* ---- Lines of one row -------------------------------------------------------------------------------------------- */

/* The names of the set bits. */
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

static void put_number(const csv_line *line, double value) {
    csv_field text;
    format_number(value, text);
    (void)fprintf(line->file, ",%s", text);
}

static void take_step(void *context, const tl_history_step *step) {
    const csv_line *line = context;
    put_instant(line, step->step);
    (void)fprintf(line->file, ",%" PRId64 ",%s,%s", step->step,
                  step->outcome < TL_FREE || step->outcome >= TL_OUTCOMES ? "unknown"
                                                                          : tl_outcome_name((tl_outcome)step->outcome),
                  step->stop < TL_STOP_NONE || step->stop > TL_STOP_TIME ? "unknown"
                                                                         : tl_stop_name((tl_stop)step->stop));
    put_number(line, step->objective);
    put_number(line, step->objective_nominal);
    (void)fprintf(line->file, ",%" PRId64 ",%" PRId64 ",%" PRId64 ",%" PRId64 ",", step->evaluations, step->executions,
                  step->used, step->predicted);
    put_flags(line->file, step->flags);
    (void)fputc(',', line->file);
    put_held(line, step->held);
    end_line(line->file);
}

static tl_status print_steps(csv_line *line, tl_error *error) {
    const tl_show_request *request = line->request;
    int64_t range[2] = {0, 0};
    bool any = false;
    tl_status status =
        tl_history_range(request->history, request->run, line->table, request->from_step, range, &any, error);
    if (status == TL_OK) {
        status = tl_history_signals(request->history, request->run, TL_HISTORY_ADJUST, &line->adjusted,
                                    &line->adjusted_count, error);
    }
    put_instant_header(line);
    (void)fputs(",step,outcome,stop,J,J_nominal,evaluations,executions,used_ns,predicted,flags,held", line->file);
    end_line(line->file);
    if (status == TL_OK && any) {
        status = tl_history_rows(request->history, request->run, range, &line->visitor, error);
    }
    return status;
}

static void take_event(void *context, const tl_history_event *event) {
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
    const tl_history_visitor visitor = {.context = line, .event = take_event};
    return tl_history_events(request->history, request->run, request->from_at, -1, &visitor, error);
}

tl_status tl_show_csv(const tl_show_request *request, tl_show_csv_table table, FILE *file, tl_error *error) {
    static csv_line line; /* too large for a small stack; `show` has one thread */
    static const struct {
        tl_history_table table;
        size_t per_signal;
        tl_history_kind kind;
        tl_history_visitor visitor;
    } tables[] = {
        [TL_SHOW_OUTPUTS] = {TL_HISTORY_OUTPUTS, 4, TL_HISTORY_MATCH, {.output = take_output}},
        [TL_SHOW_ADJUSTMENTS] = {TL_HISTORY_ADJUSTMENTS, 3, TL_HISTORY_ADJUST, {.adjustment = take_adjustment}},
        [TL_SHOW_STEPS] = {TL_HISTORY_STEPS, 0, TL_HISTORY_PLANT, {.step = take_step}},
        [TL_SHOW_SAMPLES] = {TL_HISTORY_SAMPLES, 2, TL_HISTORY_PLANT, {.sample = take_sample}},
    };
    memset(&line, 0, sizeof line);
    line.request = request;
    line.file = file;
    line.number = -1;
    if (table == TL_SHOW_EVENTS) {
        return print_events(&line, error);
    }
    line.table = tables[table].table;
    line.per_signal = tables[table].per_signal;
    line.visitor = tables[table].visitor;
    line.visitor.context = &line;
    return table == TL_SHOW_STEPS ? print_steps(&line, error) : print_wide(&line, tables[table].kind, error);
}
