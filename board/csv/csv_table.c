/* CSV text as a table of numbers: see csv_table.h. */
#include "board/csv/csv_table.h"

#include <assert.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>

#include "board/csv/csv_number.h"

/* ---- Splits a stream into lines and lines into cells.
 *
 * Cells are split in place: each cell's end becomes a zero byte, and quotes are removed by moving
 * the text to the left.
 */

/* ---- lines ---- */

char *tl_csv_lines_room(tl_csv_lines *lines, size_t *room) {
    if (lines->begin > 0) {
        memmove(lines->bytes, lines->bytes + lines->begin, lines->end - lines->begin);
        lines->end -= lines->begin;
        lines->begin = 0;
    }
    *room = TL_CSV_LINE - lines->end;
    return lines->bytes + lines->end;
}

void tl_csv_lines_added(tl_csv_lines *lines, size_t count) {
    lines->end += count;
}

void tl_csv_lines_drop(tl_csv_lines *lines) {
    lines->begin = 0;
    lines->end = 0;
    lines->skipping = false;
}

static bool is_blank(const char *text) {
    return text[strspn(text, " \t")] == '\0';
}

/* Makes a text of the bytes from `begin` on. Zero bytes are replaced, because they would hide the
 * rest. */
static char *terminated(tl_csv_lines *lines, size_t length) {
    char *line = lines->bytes + lines->begin;
    for (char *zero = line; (zero = memchr(zero, '\0', length - (size_t)(zero - line))) != NULL;) {
        *zero++ = '?';
    }
    if (length > 0 && line[length - 1] == '\r') {
        length--;
    }
    line[length] = '\0';
    return line;
}

/* The bytes up to the next line end, without it; *whole if there is one. */
static size_t measure(const tl_csv_lines *lines, bool *whole) {
    const char *begin = lines->bytes + lines->begin;
    const char *newline = memchr(begin, '\n', lines->end - lines->begin);
    *whole = newline != NULL;
    return newline != NULL ? (size_t)(newline - begin) : lines->end - lines->begin;
}

tl_csv_found tl_csv_lines_take(tl_csv_lines *lines, bool last, char **line) {
    for (;;) {
        bool whole = false;
        size_t length = measure(lines, &whole);
        bool full = !whole && length == TL_CSV_LINE;
        if (!whole && !full && (!last || length == 0)) {
            lines->begin = lines->skipping ? lines->end : lines->begin;
            return TL_CSV_NOTHING;
        }
        bool was_skipping = lines->skipping;
        lines->skipping = full;
        lines->number += was_skipping ? 0 : 1;
        *line = terminated(lines, length);
        lines->begin += length + (whole ? 1 : 0);
        if (full && !was_skipping) {
            return TL_CSV_TOO_LONG;
        }
        if (!full && !was_skipping && !is_blank(*line)) {
            return TL_CSV_A_LINE;
        }
    }
}

/* ---- files ---- */

bool tl_csv_is_device(const char *path) {
    struct stat what;
    return stat(path, &what) == 0 && (S_ISCHR(what.st_mode) || S_ISBLK(what.st_mode));
}

/* ---- cells ---- */

static bool is_space(char character, char separator) {
    return character == ' ' || (character == '\t' && separator != '\t');
}

static char *skip_spaces(char *text, char separator) {
    while (is_space(*text, separator)) {
        text++;
    }
    return text;
}

/* Removes the quotes of a cell. Returns the rest of the line, or NULL if the closing quote is
 * missing. */
static char *unquote(char *cell) {
    char *to = cell;
    for (char *from = cell + 1; *from != '\0'; from++) {
        if (*from == '"') {
            if (from[1] != '"') {
                *to = '\0';
                return from + 1;
            }
            from++;
        }
        *to++ = *from;
    }
    return NULL;
}

/* Takes the next cell off *rest, which is NULL after the last one. Returns NULL if the cell is
 * malformed. */
static char *cut_cell(char **rest, char separator) {
    const char ends[] = {separator, '\0'};
    char *cell = skip_spaces(*rest, separator);
    char *end;
    if (*cell == '"') {
        end = unquote(cell);
        end = end != NULL ? skip_spaces(end, separator) : NULL;
        if (end == NULL || (*end != separator && *end != '\0')) {
            return NULL;
        }
        *rest = *end == separator ? end + 1 : NULL;
        return cell;
    }
    end = cell + strcspn(cell, ends);
    *rest = *end == separator ? end + 1 : NULL;
    while (end > cell && is_space(end[-1], separator)) {
        end--;
    }
    *end = '\0';
    return cell;
}

static char *copy_of(const char *text) {
    size_t size = strlen(text) + 1;
    char *copy = malloc(size);
    if (copy != NULL) {
        memcpy(copy, text, size);
    }
    return copy;
}

tl_status tl_csv_table_make(tl_csv_table *table, const tl_csv_settings *settings, tl_error *error) {
    memset(table, 0, sizeof *table);
    if (settings->column_count > TL_MAX_SIGNALS) {
        return tl_fail(error, TL_BAD_DATA, "%s: %zu columns are requested (at most %d)", settings->path,
                       settings->column_count, (int)TL_MAX_SIGNALS);
    }
    table->path = copy_of(settings->path);
    table->time_column = copy_of(settings->time_column);
    table->columns = calloc(settings->column_count + 1, sizeof *table->columns);
    bool complete = table->path != NULL && table->time_column != NULL && table->columns != NULL;
    for (size_t i = 0; complete && i < settings->column_count; i++) {
        table->columns[i] = copy_of(settings->columns[i].name);
        table->scales[i] = settings->columns[i].scale;
        table->offsets[i] = settings->columns[i].offset;
        complete = table->columns[i] != NULL;
        table->column_count++;
    }
    if (!complete) {
        tl_csv_table_release(table);
        return tl_fail(error, TL_TRY_AGAIN, "%s: not enough memory", settings->path);
    }
    return TL_OK;
}

void tl_csv_table_release(tl_csv_table *table) {
    for (size_t i = 0; table->columns != NULL && i < table->column_count; i++) {
        free(table->columns[i]);
    }
    free(table->columns);
    free(table->cells);
    free(table->time_column);
    free(table->path);
    memset(table, 0, sizeof *table);
}

/* Splits a line into at most `room` cells. Returns their number (perhaps more than `room`), or 0 if
 * the line is malformed. */
static size_t cut_line(char *line, char separator, char **cells, size_t room) {
    size_t count = 0;
    for (char *rest = line; rest != NULL; count++) {
        char *cell = cut_cell(&rest, separator);
        if (cell == NULL) {
            return 0;
        }
        if (count < room) {
            cells[count] = cell;
        }
    }
    return count;
}

/* Lists the existing columns as far as there is room. */
static tl_status missing(const tl_csv_table *table, const char *column, int64_t number, char *const *cells,
                         size_t count, tl_error *error) {
    char existing[280] = "";
    size_t used = 0;
    for (size_t i = 0; i < count; i++) {
        size_t needed = strlen(cells[i]) + 2;
        if (used + needed + sizeof ", ..." > sizeof existing) {
            (void)snprintf(existing + used, sizeof existing - used, ", ...");
            break;
        }
        (void)snprintf(existing + used, sizeof existing - used, "%s%s", i > 0 ? ", " : "", cells[i]);
        used = strlen(existing);
    }
    const bool is_header =
        strspn(cells[0], "0123456789") == 0 || strspn(cells[0], "0123456789.,+-eE") != strlen(cells[0]);
    return tl_fail(error, TL_BAD_DATA, "%.100s, line %lld: the column \"%.64s\" is missing, the file has: %s: %s",
                   table->path, (long long)number, column, existing,
                   !is_header                     ? "add a header with names"
                   : column == table->time_column ? "set time_column, or give another recording"
                                                  : "set csv.column of the signal");
}

/* The cell of a column. */
static tl_status find_column(const tl_csv_table *table, const char *column, int64_t number, char *const *cells,
                             size_t count, size_t *found, tl_error *error) {
    size_t times = 0;
    for (size_t i = count; i-- > 0;) {
        if (strcmp(cells[i], column) == 0) {
            *found = i;
            times++;
        }
    }
    if (times > 1) {
        return tl_fail(error, TL_BAD_DATA, "%s, line %lld: the column \"%.64s\" occurs %zu times: rename the others",
                       table->path, (long long)number, column, times);
    }
    return times == 1 ? TL_OK : missing(table, column, number, cells, count, error);
}

static tl_status find_columns(tl_csv_table *table, int64_t number, char *const *cells, size_t count, tl_error *error) {
    size_t time_cell = 0;
    size_t cell_of[TL_MAX_SIGNALS] = {0};
    tl_status status = find_column(table, table->time_column, number, cells, count, &time_cell, error);
    for (size_t i = 0; i < table->column_count && status == TL_OK; i++) {
        status = find_column(table, table->columns[i], number, cells, count, &cell_of[i], error);
    }
    if (status == TL_OK) {
        table->time_cell = time_cell;
        memcpy(table->cell_of, cell_of, sizeof cell_of);
    }
    return status;
}

/* Files that are no text in UTF-8. */
static tl_status check_kind(const tl_csv_table *table, const char *line, tl_error *error) {
    static const struct {
        const char *begin, *what, *remedy;
    } kinds[] = {
        {"\x1F\x8B", "is compressed", "gzip -dc FILE > NEW"},
        {"\xFD"
         "7zXZ",
         "is compressed", "xz -dc FILE > NEW"},
        {"BZh", "is compressed", "bzip2 -dc FILE > NEW"},
        {"\x28\xB5\x2F\xFD", "is compressed", "zstd -dc FILE > NEW"},
        {"PK\x03\x04", "is a spreadsheet or ZIP archive", "save it as CSV, or unzip it"},
        {"\xFF\xFE", "is in UTF-16", "iconv -f UTF-16 -t UTF-8 FILE > NEW"},
        {"\xFE\xFF", "is in UTF-16", "iconv -f UTF-16 -t UTF-8 FILE > NEW"},
    };
    for (size_t i = 0; i < sizeof kinds / sizeof kinds[0]; i++) {
        if (strncmp(line, kinds[i].begin, strlen(kinds[i].begin)) == 0) {
            return tl_fail(error, TL_BAD_DATA, "%s: the file %s (expected CSV in UTF-8): %s", table->path,
                           kinds[i].what, kinds[i].remedy);
        }
    }
    return TL_OK;
}

static size_t count_unquoted(const char *line, char separator) {
    size_t count = 0;
    bool is_quoted = false;
    for (const char *at = line; *at != '\0'; at++) {
        is_quoted = *at == '"' ? !is_quoted : is_quoted;
        count += *at == separator && !is_quoted ? 1 : 0;
    }
    return count;
}

/* Finds the columns in a line that `separator` splits. */
static tl_status split_header(tl_csv_table *table, const char *header, char separator, int64_t number,
                              tl_error *error) {
    size_t room = 1;
    for (const char *at = strchr(header, separator); at != NULL; at = strchr(at + 1, separator)) {
        room++;
    }
    char **cells = calloc(room, sizeof *cells);
    char *line = copy_of(header);
    if (cells == NULL || line == NULL) {
        free(cells);
        free(line);
        return tl_fail(error, TL_TRY_AGAIN, "%s: not enough memory", table->path);
    }
    const size_t count = cut_line(line, separator, cells, room);
    assert(count <= room); /* a separator in quotes separates none */
    tl_status status = TL_OK;
    if (count == 0) {
        status = tl_fail(error, TL_BAD_DATA, "%s, line %lld: a quote in the header is not closed, or text follows it",
                         table->path, (long long)number);
    } else {
        status = find_columns(table, number, cells, count, error);
    }
    free(line);
    if (status != TL_OK) {
        free(cells);
        return status;
    }
    free(table->cells);
    table->cells = cells;
    table->cell_count = count;
    table->separator = separator;
    table->mark = '\0';
    table->clock = (tl_csv_clock){0};
    table->has_rows = false;
    return TL_OK;
}

static const char SEPARATORS[] = ",;\t";

static char *skip_mark(char *line) {
    return strncmp(line, "\xEF\xBB\xBF", 3) == 0 ? line + 3 : line;
}

/* The first separator counts by which all columns are found. If there is none, the error is that of
 * the most frequent one. */
tl_status tl_csv_table_header(tl_csv_table *table, char *line, int64_t number, tl_error *error) {
    size_t most = 0;
    line = skip_mark(line);
    tl_status status = check_kind(table, line, error);
    if (status != TL_OK) {
        return status;
    }
    tl_error chosen = {.status = TL_OK};
    for (const char *separator = SEPARATORS; *separator != '\0'; separator++) {
        tl_error own = {.status = TL_OK};
        const size_t count = count_unquoted(line, *separator);
        status = split_header(table, line, *separator, number, &own);
        if (status == TL_OK) {
            return TL_OK;
        }
        if (*separator == ',' || count > most || status != TL_BAD_DATA) {
            most = count;
            chosen = own;
        }
    }
    *error = chosen;
    return chosen.status;
}

tl_status tl_csv_table_split(const tl_csv_table *table, char *line, int64_t number, char **cells, size_t room,
                             size_t *count, tl_error *error) {
    char separator = SEPARATORS[0];
    line = skip_mark(line);
    tl_status status = check_kind(table, line, error);
    for (const char *other = SEPARATORS; *other != '\0'; other++) {
        separator = count_unquoted(line, *other) >= count_unquoted(line, separator) ? *other : separator;
    }
    *count = status == TL_OK ? cut_line(line, separator, cells, room) : 0;
    if (status == TL_OK && *count == 0) {
        status = tl_fail(error, TL_BAD_DATA, "%s, line %lld: a quote is not closed, or text follows it", table->path,
                         (long long)number);
    }
    return status;
}

/* ---- rows ---- */

static void put(char *place, char character) {
    if (place != NULL) {
        *place = character;
    }
}

/* Where commas do not separate cells, a comma is a decimal one, unless other values have points:
 * then it may separate thousands. */
static bool read_value(tl_csv_table *table, char *cell, double *value) {
    char *comma = table->separator == ',' ? NULL : strchr(cell, ',');
    const char mark = comma != NULL ? ',' : strchr(cell, '.') != NULL ? '.' : '\0';
    const bool is_other = table->separator != ',' && mark != '\0' && table->mark != '\0' && mark != table->mark;
    put(comma, '.');
    const bool is_number = !is_other && tl_csv_number_read(cell, value);
    put(comma, ','); /* the cell may belong to another channel too */
    if (is_number) {
        table->mark = mark != '\0' ? mark : table->mark;
        return true;
    }
    *value = strcasecmp(cell, "true") == 0 ? 1 : 0;
    return *value > 0 || strcasecmp(cell, "false") == 0;
}

/* Without a scale, value and cell have the same bits, also −0. */
static bool read_channel(tl_csv_table *table, size_t channel, double *value) {
    const double scale = table->scales[channel];
    const double offset = table->offsets[channel];
    bool is_good = read_value(table, table->cells[table->cell_of[channel]], value);
    if (is_good && (scale != 1 || offset != 0)) {
        *value = *value * scale + offset;
        is_good = isfinite(*value) != 0;
        *value = is_good ? *value : 0;
    }
    return is_good;
}

static bool read_time(tl_csv_table *table, char *cell, tl_time *time) {
    char *comma = table->separator == ',' || strpbrk(cell, ".:") != NULL ? NULL : strchr(cell, ',');
    put(comma, '.');
    const bool is_read = tl_csv_time_read(&table->clock, cell, time);
    put(comma, ',');
    return is_read;
}

tl_status tl_csv_table_row(tl_csv_table *table, char *line, int64_t number, tl_csv_row *row, bool *is_units,
                           tl_error *error) {
    size_t count = cut_line(line, table->separator, table->cells, table->cell_count);
    *is_units = false;
    if (count == 0) {
        return tl_fail(error, TL_BAD_DATA, "%s, line %lld: a quote is not closed, or text follows it", table->path,
                       (long long)number);
    }
    if (count != table->cell_count) {
        return tl_fail(error, TL_BAD_DATA, "%s, line %lld: the row has %zu cells (expected %zu, as the header)%s",
                       table->path, (long long)number, count, table->cell_count,
                       table->separator == ',' && count > table->cell_count
                           ? ": with decimal commas, separate cells by semicolons"
                           : "");
    }
    char *time = table->cells[table->time_cell];
    if (!table->has_rows && table->clock.form == TL_CSV_TIME_UNKNOWN && tl_csv_time_read_unit(&table->clock, time)) {
        *is_units = true;
        return TL_OK;
    }
    if (strcmp(time, table->time_column) == 0) {
        return tl_fail(error, TL_BAD_DATA, "%s, line %lld: the time is \"%.40s\", as in the header: remove this line",
                       table->path, (long long)number, time);
    }
    if (!read_time(table, time, &row->time)) {
        return tl_fail(error, TL_BAD_DATA,
                       "%s, line %lld: the time is \"%.40s\" (expected seconds from -4.6e9 to 4.6e9, a Unix time in "
                       "s, ms, us or ns, or a date as 2026-11-30T06:44:34.5Z; in all rows the same)",
                       table->path, (long long)number, time);
    }
    table->has_rows = true;
    for (size_t i = 0; i < table->column_count; i++) {
        bool good = read_channel(table, i, &row->values[i]);
        row->present[i] = table->cells[table->cell_of[i]][0] != '\0';
        row->quality[i] = good ? TL_GOOD : TL_NOT_A_NUMBER;
    }
    return TL_OK;
}

void tl_csv_table_describe(const tl_csv_table *table, char text[TL_CSV_FORM]) {
    const char *const separator = table->separator == ';' ? "semicolons" : table->separator == '\t' ? "tabs" : "";
    const char *time = "";
    switch (table->clock.form) {
    case TL_CSV_TIME_DATE:
        time = "dates";
        break;
    case TL_CSV_TIME_ZONELESS:
        time = "dates without zone (UTC)";
        break;
    case TL_CSV_TIME_NUMBER:
        time = table->clock.per_second == 1000         ? "times in ms"
               : table->clock.per_second == 1000000    ? "times in us"
               : table->clock.per_second == 1000000000 ? "times in ns"
                                                       : "";
        break;
    case TL_CSV_TIME_UNKNOWN:
        break;
    }
    (void)snprintf(text, TL_CSV_FORM, "%s%s%s", separator, separator[0] != '\0' && time[0] != '\0' ? ", " : "", time);
}

tl_status tl_csv_table_too_long(const tl_csv_table *table, int64_t number, tl_error *error) {
    return tl_fail(error, TL_BAD_DATA, "%s, line %lld: the line is longer than %d bytes", table->path,
                   (long long)number, (int)TL_CSV_LINE);
}
