/* All bytes read are stored in one block. A row has the position of its line in it, and its time.
 * Cells are searched in the line each time, because a row is used only once or twice. */
#include "fmus/csv/rows.h"

#include <errno.h>
#include <fcntl.h>
#include <locale.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

enum { LONGEST_LINE = 64 * 1024, READ_AT_ONCE = 64 * 1024, READS_OF_A_FIFO = 16, SHOWN = 40 };

/* Part of a line. */
typedef struct cell {
    const char *text;
    size_t length;
} cell;

typedef struct row {
    size_t begin, length; /* in bytes[], without the line end */
    int64_t line;         /* of the file, from 1 */
    double time, since;
} row;

struct csv_rows {
    char *file, *time_column; /* NULL: no file is selected */
    int descriptor;           /* -1: none */
    bool is_file;             /* a regular file: its rows are kept, and it must have a header */
    locale_t c_locale;
    char *header; /* NULL: not read yet */
    char *bytes;
    size_t size, room;    /* of bytes[] */
    size_t cut;           /* start of the next line */
    int64_t line;         /* number of the last complete line */
    row *row;             /* the stored rows */
    size_t count, places; /* of row[] */
    int64_t first;        /* number of row[0] */
};

static bool fail(const csv_rows_error *error, const char *format, ...) __attribute__((format(printf, 2, 3)));

static bool fail(const csv_rows_error *error, const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    (void)vsnprintf(error->why, error->size, format, arguments);
    va_end(arguments);
    return false;
}

static bool fail_memory(const csv_rows_error *error) {
    return fail(error, "out of memory");
}

/* ---- open and close ---- */

csv_rows *csv_rows_new(void) {
    csv_rows *all = calloc(1, sizeof *all);
    if (!all) {
        return NULL;
    }
    all->descriptor = -1;
    all->c_locale = newlocale(LC_NUMERIC_MASK, "C", (locale_t)0);
    if (all->c_locale == (locale_t)0) {
        free(all);
        return NULL;
    }
    return all;
}

/* Drops all data that was read; the file stays open. */
static void drop(csv_rows *all) {
    free(all->header);
    all->header = NULL;
    all->size = all->cut = all->count = 0;
    all->line = all->first = 0;
}

static void close_file(csv_rows *all) {
    if (all->descriptor >= 0) {
        (void)close(all->descriptor);
        all->descriptor = -1;
    }
    free(all->file);
    free(all->time_column);
    all->file = all->time_column = NULL;
    drop(all);
}

void csv_rows_close(csv_rows *all) {
    close_file(all);
    freelocale(all->c_locale);
    free(all->bytes);
    free(all->row);
    free(all);
}

static char *copy_of(const char *text) {
    const size_t size = strlen(text) + 1;
    char *copy = malloc(size);
    return copy ? memcpy(copy, text, size) : NULL;
}

static bool open_file(csv_rows *all, const char *file, const csv_rows_error *error) {
    all->descriptor = open(file, O_RDONLY | O_NONBLOCK | O_CLOEXEC | O_NOCTTY);
    struct stat found;
    if (all->descriptor < 0 || fstat(all->descriptor, &found) != 0) {
        return fail(error, "cannot open %s: %s", file, strerror(errno));
    }
    all->is_file = S_ISREG(found.st_mode);
    if (!all->is_file && !S_ISFIFO(found.st_mode)) {
        return fail(error, "%s is neither a file nor a FIFO", file);
    }
    return true;
}

/* If the time column changes, the file is read again from its beginning. */
bool csv_rows_choose(csv_rows *all, const char *file, const char *time_column, const csv_rows_error *error) {
    if (all->file && strcmp(all->file, file) == 0 && strcmp(all->time_column, time_column) == 0) {
        return true;
    }
    close_file(all);
    if (!*file) {
        return fail(error, "no file is named; set the parameter file, for example to measured.csv");
    }
    if (!open_file(all, file, error)) {
        close_file(all);
        return false;
    }
    all->file = copy_of(file);
    all->time_column = copy_of(time_column);
    if (!all->file || !all->time_column) {
        close_file(all);
        return fail_memory(error);
    }
    return true;
}

/* ---- cells ---- */

static bool is_space(char c) {
    return c == ' ' || c == '\t';
}

static cell trimmed(cell part) {
    while (part.length > 0 && is_space(part.text[0])) {
        part.text++;
        part.length--;
    }
    while (part.length > 0 && is_space(part.text[part.length - 1])) {
        part.length--;
    }
    if (part.length >= 2 && part.text[0] == '"' && part.text[part.length - 1] == '"') {
        part.text++;
        part.length -= 2;
    }
    return part;
}

/* Cuts the next cell off *rest. After the last cell, rest->text is NULL. */
static cell next_cell(cell *rest) {
    bool quoted = false;
    size_t length = 0;
    while (length < rest->length && (quoted || rest->text[length] != ',')) {
        quoted ^= rest->text[length] == '"';
        length++;
    }
    const cell part = {rest->text, length};
    const bool last = length == rest->length;
    *rest = (cell){last ? NULL : rest->text + length + 1, last ? 0 : rest->length - length - 1};
    return trimmed(part);
}

static size_t count_cells(cell line) {
    size_t count = 0;
    while (line.text) {
        (void)next_cell(&line);
        count++;
    }
    return count;
}

static cell cell_at(cell line, size_t index) {
    cell found = next_cell(&line);
    for (size_t i = 0; i < index; i++) {
        found = next_cell(&line);
    }
    return found;
}

static cell header_of(const csv_rows *all) {
    return (cell){all->header, strlen(all->header)};
}

static bool find_column(const csv_rows *all, const char *name, size_t *index, const csv_rows_error *error) {
    size_t times = 0;
    cell rest = header_of(all);
    for (size_t i = 0; rest.text; i++) {
        const cell found = next_cell(&rest);
        if (found.length == strlen(name) && memcmp(found.text, name, found.length) == 0) {
            *index = i;
            times++;
        }
    }
    if (times == 0) {
        return fail(error, "%s has no column \"%s\"; its columns are %.300s", all->file, name, all->header);
    }
    return times == 1 || fail(error, "%s has more than one column \"%s\"", all->file, name);
}

static bool parse(const csv_rows *all, cell text, double *number) {
    char copy[64];
    if (text.length == 0 || text.length >= sizeof copy) {
        return false;
    }
    memcpy(copy, text.text, text.length);
    copy[text.length] = '\0';
    if (strspn(copy, "+-.0123456789eE") != text.length) {
        return false; /* also rejects words and hexadecimal numbers, which strtod() would accept */
    }
    char *end;
    const locale_t before = uselocale(all->c_locale);
    const double value = strtod(copy, &end);
    (void)uselocale(before);
    if (*end || !isfinite(value)) {
        return false;
    }
    *number = value;
    return true;
}

static bool fail_number(const csv_rows *all, int64_t line, const char *column, cell found,
                        const csv_rows_error *error) {
    return fail(error, "%s, line %lld, column \"%s\": \"%.*s\" is no finite number, such as 12.5", all->file,
                (long long)line, column, found.length > SHOWN ? SHOWN : (int)found.length, found.text);
}

/* ---- lines ---- */

static bool take_header(csv_rows *all, cell line, const csv_rows_error *error) {
    static const char mark[] = "\xEF\xBB\xBF";
    if (line.length >= 3 && memcmp(line.text, mark, 3) == 0) {
        line = (cell){line.text + 3, line.length - 3};
    }
    char *header = malloc(line.length + 1);
    if (!header) {
        return fail_memory(error);
    }
    memcpy(header, line.text, line.length);
    header[line.length] = '\0';
    all->header = header;
    size_t index;
    if (!find_column(all, all->time_column, &index, error)) {
        free(all->header);
        all->header = NULL;
        return false;
    }
    return true;
}

static bool check_time(const csv_rows *all, double time, const csv_rows_error *error) {
    if (all->count > 0 && !(time > all->row[all->count - 1].time)) {
        return fail(error, "%s, line %lld: the time %.17g s does not come after %.17g s", all->file,
                    (long long)all->line, time, all->row[all->count - 1].time);
    }
    return true;
}

static bool has_place(csv_rows *all) {
    if (all->count < all->places) {
        return true;
    }
    const size_t places = all->places ? 2 * all->places : 256;
    row *larger = realloc(all->row, places * sizeof *larger);
    if (larger) {
        all->row = larger;
        all->places = places;
    }
    return larger != NULL;
}

static bool take_row(csv_rows *all, cell line, double instant, const csv_rows_error *error) {
    const size_t cells = count_cells(line), columns = count_cells(header_of(all));
    if (cells != columns) {
        return fail(error, "%s, line %lld: %zu cells, but the first line names %zu columns", all->file,
                    (long long)all->line, cells, columns);
    }
    size_t index;
    double time;
    if (!find_column(all, all->time_column, &index, error)) {
        return false;
    }
    const cell stamp = cell_at(line, index);
    if (!parse(all, stamp, &time)) {
        return fail_number(all, all->line, all->time_column, stamp, error);
    }
    if (!check_time(all, time, error)) {
        return false;
    }
    if (!has_place(all)) {
        return fail_memory(error);
    }
    all->row[all->count++] = (row){(size_t)(line.text - all->bytes), line.length, all->line, time, instant};
    return true;
}

static bool is_blank(cell line) {
    return line.length == 0 || trimmed(line).length == 0;
}

/* Cuts all complete lines. After an error, the next call starts again with the faulty line. */
static bool cut_lines(csv_rows *all, double instant, const csv_rows_error *error) {
    while (all->cut < all->size) {
        const char *begin = all->bytes + all->cut;
        const char *end = memchr(begin, '\n', all->size - all->cut);
        if (!end) {
            return all->size - all->cut <= LONGEST_LINE || fail(error, "%s, line %lld has more than %d bytes",
                                                                all->file, (long long)all->line + 1, LONGEST_LINE);
        }
        cell line = {begin, (size_t)(end - begin)};
        line.length -= line.length > 0 && end[-1] == '\r';
        all->line++;
        if (!is_blank(line) && !(all->header ? take_row(all, line, instant, error) : take_header(all, line, error))) {
            all->line--;
            return false;
        }
        all->cut += (size_t)(end - begin) + 1;
    }
    return true;
}

/* Returns the number of bytes read, 0 if there are none now, −1 on an error. */
static ssize_t take_bytes(csv_rows *all, const csv_rows_error *error) {
    if (all->room - all->size < READ_AT_ONCE) {
        const size_t room = 2 * all->room + READ_AT_ONCE;
        char *larger = realloc(all->bytes, room);
        if (!larger) {
            (void)fail_memory(error);
            return -1;
        }
        all->bytes = larger;
        all->room = room;
    }
    ssize_t got;
    do {
        got = read(all->descriptor, all->bytes + all->size, READ_AT_ONCE);
    } while (got < 0 && errno == EINTR);
    if (got < 0 && (errno == EAGAIN || errno == EWOULDBLOCK)) {
        return 0;
    }
    if (got < 0) {
        (void)fail(error, "cannot read %s: %s", all->file, strerror(errno));
        return -1;
    }
    all->size += (size_t)got;
    return got;
}

/* The number of reads of a FIFO is limited, because its writer may be faster than this reader. The
 * next call reads on. */
bool csv_rows_read(csv_rows *all, double instant, const csv_rows_error *error) {
    ssize_t got = 1;
    for (int i = 0; got > 0 && (all->is_file || i < READS_OF_A_FIFO); i++) {
        got = take_bytes(all, error);
        if (got < 0 || !cut_lines(all, instant, error)) {
            return false;
        }
    }
    if (all->is_file && !all->header) {
        return fail(error, "%s has no first line that names its columns", all->file);
    }
    return true;
}

/* ---- rows ---- */

int64_t csv_rows_end(const csv_rows *all) {
    return all->first + (int64_t)all->count;
}

bool csv_rows_has(const csv_rows *all, int64_t number) {
    return number >= all->first && number < csv_rows_end(all);
}

static const row *row_of(const csv_rows *all, int64_t number) {
    return &all->row[number - all->first];
}

double csv_rows_time(const csv_rows *all, int64_t number) {
    return row_of(all, number)->time;
}

double csv_rows_since(const csv_rows *all, int64_t number) {
    return row_of(all, number)->since;
}

bool csv_rows_number(const csv_rows *all, int64_t number, const char *column, double *value,
                     const csv_rows_error *error) {
    const row *found = row_of(all, number);
    size_t index;
    if (!find_column(all, column, &index, error)) {
        return false;
    }
    const cell text = cell_at((cell){all->bytes + found->begin, found->length}, index);
    if (text.length == 0) {
        return true;
    }
    return parse(all, text, value) || fail_number(all, found->line, column, text, error);
}

bool csv_rows_has_header(const csv_rows *all) {
    return all->header != NULL;
}

bool csv_rows_check_column(const csv_rows *all, const char *column, const csv_rows_error *error) {
    size_t index;
    return find_column(all, column, &index, error);
}

/* Moves the bytes only if that at least halves them, so that each byte is moved about once. */
void csv_rows_forget(csv_rows *all, int64_t number) {
    const int64_t before = number - all->first;
    if (all->is_file || before <= 0) {
        return;
    }
    const size_t old = (size_t)before < all->count ? (size_t)before : all->count; /* a state may name a later row */
    const size_t begin = old < all->count ? all->row[old].begin : all->cut;
    if (begin < READ_AT_ONCE || begin < all->size / 2) {
        return;
    }
    memmove(all->bytes, all->bytes + begin, all->size - begin);
    all->size -= begin;
    all->cut -= begin;
    all->count -= old;
    all->first += (int64_t)old;
    memmove(all->row, all->row + old, all->count * sizeof *all->row);
    for (size_t i = 0; i < all->count; i++) {
        all->row[i].begin -= begin;
    }
}
