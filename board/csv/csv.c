/* CSV recording reader: reads a complete file row by row. */
#include "board/csv/csv.h"

#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>
#include <unistd.h>

#include "board/csv/csv_table.h"

/* Most rows with one time. A simulation writes two to four at an event. More come from a clock that
 * is too coarse, and only one of them would count. */
enum { MOST_SAME = 4 };

struct tl_csv_reader {
    int file;
    bool at_end;    /* of the bytes */
    bool any;       /* there was a row */
    tl_time time;   /* of the last row that was read */
    bool is_file;   /* no FIFO: the next row can be awaited */
    int64_t merged; /* rows with the time of the row before */
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
        char *bytes = tl_csv_lines_room(&reader->lines, &room);
        ssize_t count = read(reader->file, bytes, room);
        if (count < 0 && errno != EINTR) {
            return tl_fail(error, TL_BAD_DATA, "%s: cannot be read: %s", reader->table.path, strerror(errno));
        }
        reader->at_end = count == 0;
        tl_csv_lines_added(&reader->lines, count > 0 ? (size_t)count : 0);
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

/* Returns NULL after an error. */
static tl_csv_reader *open_file(const tl_csv_settings *settings, tl_error *error) {
    tl_csv_reader *made = calloc(1, sizeof *made);
    if (made == NULL) {
        (void)tl_fail(error, TL_TRY_AGAIN, "%s: not enough memory", settings->path);
        return NULL;
    }
    tl_status status = tl_csv_table_make(&made->table, settings, error);
    if (status != TL_OK) {
        free(made);
        return NULL;
    }
    bool is_device = tl_csv_is_device(settings->path);
    made->file = is_device ? -1 : open(settings->path, O_RDONLY | O_CLOEXEC);
    if (is_device) {
        (void)tl_fail(error, TL_BAD_DATA, "%s: this is a device (expected a file or a FIFO)", settings->path);
    } else if (made->file < 0) {
        bool shortage = errno == EMFILE || errno == ENFILE || errno == ENOMEM;
        (void)tl_fail(error, shortage ? TL_TRY_AGAIN : TL_BAD_DATA, "%s: cannot be opened: %s", settings->path,
                      strerror(errno));
    } else {
        struct stat about;
        made->is_file = fstat(made->file, &about) == 0 && S_ISREG(about.st_mode) != 0;
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

static tl_status read_row(tl_csv_reader *reader, tl_csv_row *row, bool *end, tl_error *error) {
    bool is_units = true;
    while (is_units) {
        char *line = NULL;
        tl_status status = next_line(reader, &line, error);
        *end = status == TL_OK && line == NULL;
        if (status != TL_OK || *end) {
            return status;
        }
        status = tl_csv_table_row(&reader->table, line, reader->lines.number, row, &is_units, error);
        if (status != TL_OK) {
            return status;
        }
    }
    if (reader->any && row->time < reader->time) {
        return tl_fail(
            error, TL_BAD_DATA,
            "%s, line %lld: the time %.9f s is before %.9f s in the row before: remove the row, or correct its time",
            reader->table.path, (long long)reader->lines.number, tl_seconds(row->time), tl_seconds(reader->time));
    }
    reader->any = true;
    reader->time = row->time;
    return TL_OK;
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
    bool is_same = status == TL_OK && !*end && reader->is_file;
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
    tl_csv_form form = {.clock = reader->table.clock, .merged = reader->merged};
    tl_csv_table_describe(&reader->table, form.text);
    return form;
}

void tl_csv_close(tl_csv_reader *reader) {
    if (reader == NULL) {
        return;
    }
    if (reader->file >= 0) {
        (void)close(reader->file);
    }
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
