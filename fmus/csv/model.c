/* CSV: outputs the columns of a CSV file or FIFO. It replaces the plant in a master that has none
 *      (section 5.4.2).
 *
 * A step that ends at t sets each output to the newest value of its column at or before t
 * (zero-order hold). Before the first value, an output has its initial value. Times are compared
 * with a tolerance of 1 ns, because a master's clock is rounded. An empty cell is no new value. The
 * FMU never waits for rows that have not arrived.
 *
 * A state contains the outputs and the number of the next row. Stored rows do not change, so a step
 * can be repeated. The repeated step gives the same values even if new rows have arrived since. The
 * reason: a row counts only in steps that end later than all steps before its arrival. Rows of a
 * FIFO are dropped if the master declares that it restores no earlier state
 * (noSetFMUStatePriorToCurrentPoint).
 */
#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "description.h"
#include "fmus/common/model.h"
#include "fmus/csv/rows.h"

enum { COLUMNS = 8 };

static const double NANOSECOND = 1e-9;

typedef struct csv {
    tl_fmu_text file, time_column, column[COLUMNS]; /* fixed */
    fmi2Boolean from_first;                         /* fixed */
    fmi2Real initial[COLUMNS];                      /* fixed */
    fmi2Real y[COLUMNS];                            /* results */
    fmi2Real t_start, offset;                       /* s; offset: master's time minus the row's; NaN: not known yet */
    fmi2Real t_step;                                /* larger than any macro step, so that each has one inner step */
    int64_t next;                                   /* number of the first row that was not used yet */
} csv;

struct tl_fmu_outside {
    csv_rows *rows;
    double latest; /* s: latest end of a step so far */
};

/* Written by hand, because variables such as y1 are elements of arrays here. */
static const csv defaults = {.time_column = "time", .t_step = 1e9};

#define COLUMN(i)                                                                                                      \
    {TL_FMU_REAL, 2 * (i), TL_FMU_RESULT, offsetof(csv, y[i])},                                                        \
        {TL_FMU_REAL, 2 * (i) + 1, TL_FMU_FIXED, offsetof(csv, initial[i])}, {                                         \
        TL_FMU_STRING, 2 + (i), TL_FMU_FIXED, offsetof(csv, column[i])                                                 \
    }

static const tl_fmu_variable variables[] = {
    {TL_FMU_STRING, 0, TL_FMU_FIXED, offsetof(csv, file)},
    {TL_FMU_STRING, 1, TL_FMU_FIXED, offsetof(csv, time_column)},
    {TL_FMU_BOOLEAN, 0, TL_FMU_FIXED, offsetof(csv, from_first)},
    COLUMN(0),
    COLUMN(1),
    COLUMN(2),
    COLUMN(3),
    COLUMN(4),
    COLUMN(5),
    COLUMN(6),
    COLUMN(7),
};

static void start(void *model) {
    csv *c = model;
    for (int i = 0; i < COLUMNS; i++) {
        c->y[i] = c->initial[i];
    }
    c->next = 0;
    c->t_start = (double)NAN;
    c->offset = (double)NAN;
}

static void step(void *model, double h) {
    (void)model;
    (void)h;
}

static tl_fmu_outside *make_outside(void) {
    tl_fmu_outside *outside = malloc(sizeof *outside);
    csv_rows *rows = csv_rows_new();
    if (!outside || !rows) {
        if (rows) {
            csv_rows_close(rows);
        }
        free(outside);
        return NULL;
    }
    *outside = (tl_fmu_outside){rows, -HUGE_VAL};
    return outside;
}

static void end_outside(tl_fmu_outside *outside) {
    csv_rows_close(outside->rows);
    free(outside);
}

static bool check_columns(const csv *c, const csv_rows *rows, const csv_rows_error *error) {
    for (int i = 0; i < COLUMNS; i++) {
        if (c->column[i][0] && !csv_rows_check_column(rows, c->column[i], error)) {
            return false;
        }
    }
    return true;
}

/* Times are the master's, or are counted from the first row if from_first is set. */
static void set_offset(csv *c, const csv_rows *rows, double time) {
    if (isnan(c->t_start)) {
        c->t_start = time;
    }
    if (isnan(c->offset) && csv_rows_has(rows, 0)) {
        c->offset = c->from_first ? c->t_start - csv_rows_time(rows, 0) : 0;
    }
}

/* Returns true if row c->next must be used at `time`. */
static bool is_due(const csv *c, const csv_rows *rows, double time) {
    const double fit = NANOSECOND + 4 * DBL_EPSILON * fabs(time);
    return csv_rows_has(rows, c->next) && csv_rows_time(rows, c->next) + c->offset <= time + fit &&
           csv_rows_since(rows, c->next) < time;
}

static bool use_row(csv *c, const csv_rows *rows, const csv_rows_error *error) {
    for (int i = 0; i < COLUMNS; i++) {
        if (c->column[i][0] && !csv_rows_number(rows, c->next, c->column[i], &c->y[i], error)) {
            return false;
        }
    }
    c->next++;
    return true;
}

/* Fails if the next row is not stored: it was dropped, or the state comes from another instance
 * that has read other rows. */
static bool check_next(const csv *c, const csv_rows *rows, const csv_rows_error *error) {
    if (c->next == csv_rows_end(rows) || csv_rows_has(rows, c->next)) {
        return true;
    }
    (void)snprintf(
        error->why, error->size,
        "row %lld of %s, from which this state continues, is missing; rows of a FIFO are dropped after a step "
        "that says that nothing from before it comes back (noSetFMUStatePriorToCurrentPoint)",
        (long long)c->next, c->file);
    return false;
}

static bool read_rows(const csv *c, tl_fmu_outside *outside, const csv_rows_error *error) {
    csv_rows *rows = outside->rows;
    return csv_rows_choose(rows, c->file, c->time_column, error) && csv_rows_read(rows, outside->latest, error) &&
           (!csv_rows_has_header(rows) || check_columns(c, rows, error)) && check_next(c, rows, error);
}

static bool look(void *model, tl_fmu_outside *outside, const tl_fmu_look *at) {
    csv *c = model;
    const csv_rows_error error = {at->why, at->why_size};
    if (at->may_forget) {
        csv_rows_forget(outside->rows, c->next);
    }
    if (!read_rows(c, outside, &error)) {
        return false;
    }
    set_offset(c, outside->rows, at->time);
    if (at->time > c->t_start) {
        outside->latest = fmax(outside->latest, at->time);
    }
    while (is_due(c, outside->rows, at->time)) {
        if (!use_row(c, outside->rows, &error)) {
            return false;
        }
    }
    return true;
}

TL_FMU_MODEL_WITH_TABLE(csv, .t_step = offsetof(csv, t_step), .start = start, .step = step, .open = make_outside,
                        .look = look, .close = end_outside);
