/* CSV recording reader: reads a complete file row by row. */
#include "board/csv/csv.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "board/csv/csv_file.h"
#include "board/csv/csv_table.h"

/* Most rows with one time. A simulation writes two to four at an event. More come from a clock that
 * is too coarse, and only one of them would count. */
enum { MOST_SAME = 4 };

struct tl_csv_reader {
    char **paths; /* of the files, of which `path_next` were opened */
    size_t path_count, path_next;
    tl_csv_file *file;
    bool at_end;        /* of the bytes of this file */
    bool any;           /* there was a row */
    bool any_here;      /* there was a row of this file */
    tl_csv_clock clock; /* of the first file */
    tl_time time;       /* of the last row that was read */
    int64_t merged;     /* rows with the time of the row before */
    /* the result of reading the row after the returned one */
    bool has_next;
    tl_csv_row next;
    bool next_end;
    tl_status next_status;
    tl_error next_error;
    tl_csv_table table;
    tl_csv_lines lines;
};

/* The next line; NULL at the end of the file. */
static tl_status next_line(tl_csv_reader *reader, char **line, tl_error *error) {
    for (;;) {
        switch (tl_csv_lines_take(&reader->lines, reader->at_end, line)) {
        case TL_CSV_A_LINE:
            return TL_OK;
        case TL_CSV_TOO_LONG:
            return tl_csv_table_too_long(&reader->table, reader->lines.number, error);
        case TL_CSV_NOTHING:
            break;
        }
        if (reader->at_end) {
            *line = NULL;
            return TL_OK;
        }
        size_t room = 0;
        size_t count = 0;
        char *bytes = tl_csv_lines_room(&reader->lines, &room);
        const tl_status status = tl_csv_file_read(reader->file, reader->table.path, bytes, room, &count, error);
        if (status != TL_OK) {
            return status;
        }
        reader->at_end = count == 0;
        tl_csv_lines_added(&reader->lines, count);
    }
}

static tl_status next_header(tl_csv_reader *reader, char **line, tl_error *error) {
    tl_status status = next_line(reader, line, error);
    if (status == TL_OK && *line == NULL) {
        return tl_fail(error, TL_BAD_DATA, "%s: the file is empty (expected a header with the names of its columns)",
                       reader->table.path);
    }
    return status;
}

static tl_status read_header(tl_csv_reader *reader, tl_error *error) {
    char *line = NULL;
    tl_status status = next_header(reader, &line, error);
    return status == TL_OK ? tl_csv_table_header(&reader->table, line, reader->lines.number, error) : status;
}

/* Opens the next file instead of the present one. */
static tl_status open_next(tl_csv_reader *reader, tl_error *error) {
    char *path = strdup(reader->paths[reader->path_next]);
    if (path == NULL) {
        return tl_fail(error, TL_TRY_AGAIN, "%s: not enough memory", reader->table.path);
    }
    free(reader->table.path);
    reader->table.path = path;
    reader->path_next++;
    tl_csv_lines_drop(&reader->lines);
    reader->lines.number = 0;
    reader->at_end = false;
    reader->any_here = false;
    tl_csv_file_close(reader->file);
    reader->file = NULL;
    return tl_csv_file_open(path, &reader->file, error);
}

/* Returns NULL after an error. */
static tl_csv_reader *open_file(const tl_csv_settings *settings, tl_error *error) {
    tl_csv_reader *made = calloc(1, sizeof *made);
    if (made == NULL) {
        (void)tl_fail(error, TL_TRY_AGAIN, "%s: not enough memory", settings->path);
        return NULL;
    }
    tl_status status = tl_csv_table_make(&made->table, settings, error);
    if (status == TL_OK) {
        status = tl_csv_file_list(settings->path, &made->paths, &made->path_count, error);
    }
    if (status == TL_OK && open_next(made, error) == TL_OK) {
        return made;
    }
    tl_csv_close(made);
    return NULL;
}

tl_status tl_csv_open(const tl_csv_settings *settings, tl_csv_reader **reader, tl_error *error) {
    tl_csv_reader *made = open_file(settings, error);
    if (made == NULL) {
        return error->status;
    }
    tl_status status = read_header(made, error);
    if (status != TL_OK) {
        tl_csv_close(made);
        return status;
    }
    *reader = made;
    return TL_OK;
}

/* A row must not be before the one before, also if that is in the file before. */
static tl_status check_order(const tl_csv_reader *reader, tl_time time, tl_error *error) {
    if (!reader->any || time >= reader->time) {
        return TL_OK;
    }
    if (!reader->any_here) {
        return tl_fail(error, TL_BAD_DATA,
                       "%s, line %lld: the time %.9f s is before %.9f s at the end of %s: name the files in the order "
                       "of their times, which must not overlap",
                       reader->table.path, (long long)reader->lines.number, tl_seconds(time), tl_seconds(reader->time),
                       reader->paths[reader->path_next - 2]);
    }
    const bool is_local = reader->table.clock.form == TL_CSV_TIME_ZONELESS; /* perhaps the end of summer time */
    return tl_fail(error, TL_BAD_DATA, "%s, line %lld: the time %.9f s is before %.9f s in the row before: %s",
                   reader->table.path, (long long)reader->lines.number, tl_seconds(time), tl_seconds(reader->time),
                   is_local ? "export UTC or local times with +01:00, or correct the row"
                            : "sort the rows, or correct the time");
}

/* The times of all files have one form. */
static tl_status check_form(tl_csv_reader *reader, tl_error *error) {
    const tl_csv_clock *clock = &reader->table.clock;
    if (!reader->any) {
        reader->clock = *clock;
    }
    return reader->clock.form == clock->form && reader->clock.per_second == clock->per_second
               ? TL_OK
               : tl_fail(error, TL_BAD_DATA,
                         "%s: its times have another form or unit than those of the files before: replay it alone, or "
                         "export all files alike",
                         reader->table.path);
}

static tl_status read_row(tl_csv_reader *reader, tl_csv_row *row, bool *end, tl_error *error) {
    bool is_units = true;
    while (is_units) {
        char *line = NULL;
        tl_status status = next_line(reader, &line, error);
        const bool is_file_end = status == TL_OK && line == NULL;
        *end = is_file_end && reader->path_next == reader->path_count;
        if (status != TL_OK || *end) {
            return status;
        }
        if (is_file_end) {
            status = open_next(reader, error);
            status = status == TL_OK ? read_header(reader, error) : status;
        } else {
            status = tl_csv_table_row(&reader->table, line, reader->lines.number, row, &is_units, error);
        }
        if (status != TL_OK) {
            return status;
        }
    }
    const tl_status form = reader->any_here ? TL_OK : check_form(reader, error);
    const tl_status status = form == TL_OK ? check_order(reader, row->time, error) : form;
    reader->any = true;
    reader->any_here = true;
    reader->time = row->time;
    return status;
}

/* Takes the row that was read ahead, or else reads one. */
static tl_status take_row(tl_csv_reader *reader, tl_csv_row *row, bool *end, tl_error *error) {
    if (!reader->has_next) {
        return read_row(reader, row, end, error);
    }
    reader->has_next = false;
    *end = reader->next_end;
    if (reader->next_status != TL_OK) {
        *error = reader->next_error;
    } else if (!*end) {
        *row = reader->next;
    }
    return reader->next_status;
}

/* Of two rows with one time the later counts, in the cells that it has. */
static void merge_row(const tl_csv_reader *reader, tl_csv_row *row) {
    for (size_t i = 0; i < reader->table.column_count; i++) {
        if (reader->next.present[i]) {
            row->present[i] = true;
            row->values[i] = reader->next.values[i];
            row->quality[i] = reader->next.quality[i];
        }
    }
}

tl_status tl_csv_next(tl_csv_reader *reader, tl_csv_row *row, bool *end, tl_error *error) {
    tl_status status = take_row(reader, row, end, error);
    bool is_same = status == TL_OK && !*end && tl_csv_file_is_regular(reader->file);
    for (int same = 1; is_same; same++) {
        reader->next_status = read_row(reader, &reader->next, &reader->next_end, &reader->next_error);
        is_same = reader->next_status == TL_OK && !reader->next_end && reader->next.time == row->time;
        reader->has_next = !is_same;
        if (is_same && same >= MOST_SAME) {
            return tl_fail(error, TL_BAD_DATA,
                           "%s, line %lld: more than %d rows have the time %.9f s: export times with fractions of a "
                           "second",
                           reader->table.path, (long long)reader->lines.number, (int)MOST_SAME, tl_seconds(row->time));
        }
        if (is_same) {
            merge_row(reader, row);
            reader->merged++;
        }
    }
    return status;
}

tl_csv_form tl_csv_get_form(const tl_csv_reader *reader) {
    tl_csv_form form = {.clock = reader->table.clock, .merged = reader->merged, .files = reader->path_count};
    const char *file = tl_csv_file_form(reader->file);
    char table[TL_CSV_FORM];
    tl_csv_table_describe(&reader->table, table);
    (void)snprintf(form.text, sizeof form.text, "%s%s%s", file, file[0] != '\0' && table[0] != '\0' ? ", " : "", table);
    return form;
}

void tl_csv_close(tl_csv_reader *reader) {
    if (reader == NULL) {
        return;
    }
    tl_csv_file_close(reader->file);
    tl_csv_file_list_free(reader->paths, reader->path_count);
    tl_csv_table_release(&reader->table);
    free(reader);
}

/* ---- the columns of a file ---- */

/* Keeps a copy of the line, and splits it. */
static tl_status split_line(tl_csv_reader *reader, const char *line, char **copy, char **cells, size_t *count,
                            tl_error *error) {
    *copy = strdup(line);
    return *copy != NULL
               ? tl_csv_table_split(&reader->table, *copy, reader->lines.number, cells, TL_CSV_COLUMNS, count, error)
               : tl_fail(error, TL_TRY_AGAIN, "%s: not enough memory", reader->table.path);
}

static size_t find_time(const tl_csv_columns *columns) {
    static const char *const names[] = {"time", "t", "timestamp", "datetime", "date", "time_s", "zeit", "seconds"};
    for (size_t k = 0; k < sizeof names / sizeof names[0]; k++) {
        for (size_t i = 0; i < columns->count; i++) {
            if (strcasecmp(columns->names[i], names[k]) == 0) {
                return i;
            }
        }
    }
    return 0;
}

static tl_status read_columns(tl_csv_reader *reader, tl_csv_columns *columns, tl_error *error) {
    static char none[] = "";
    char *line = NULL;
    tl_csv_clock clock = {0};
    size_t count = 0;
    tl_status status = next_header(reader, &line, error);
    if (status == TL_OK && line != NULL) {
        status = split_line(reader, line, &columns->lines[0], columns->names, &count, error);
    }
    if (status != TL_OK) {
        return status;
    }
    columns->count = count < TL_CSV_COLUMNS ? count : TL_CSV_COLUMNS;
    columns->time = find_time(columns);
    status = next_line(reader, &line, error);
    size_t units = 0;
    if (status == TL_OK && line != NULL) {
        status = split_line(reader, line, &columns->lines[1], columns->units, &units, error);
    }
    if (status == TL_OK && (units != count || !tl_csv_time_read_unit(&clock, columns->units[columns->time]))) {
        for (size_t i = 0; i < columns->count; i++) {
            columns->units[i] = none;
        }
    }
    return status;
}

tl_status tl_csv_columns_read(const char *path, tl_csv_columns *columns, tl_error *error) {
    const tl_csv_settings settings = {.path = path, .time_column = ""};
    *columns = (tl_csv_columns){.count = 0};
    tl_csv_reader *reader = open_file(&settings, error);
    if (reader == NULL) {
        return error->status;
    }
    tl_status status = read_columns(reader, columns, error);
    tl_csv_close(reader);
    return status;
}

void tl_csv_columns_release(tl_csv_columns *columns) {
    free(columns->lines[0]);
    free(columns->lines[1]);
}
