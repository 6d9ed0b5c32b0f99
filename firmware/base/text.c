/* Texts for display: see text.h. */
#include "firmware/base/text.h"

#include <assert.h>
#include <math.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <time.h>
#include <unistd.h>

#include "firmware/base/os.h"
#include "master/base/text.h"

/* ---- clean text ---- */

enum { LONGEST = 16 };

/* Writes `begin` and `value` with at least `least` digits. Avoids stdio, which is not safe in a
 * signal handler. */
static size_t put_hex(char *to, const char *begin, uint32_t value, int least) {
    size_t size = 0;
    int digits = least;
    while (begin[size] != '\0') {
        to[size] = begin[size];
        size++;
    }
    while (digits < 8 && value >> (4 * digits) != 0) {
        digits++;
    }
    for (int i = digits - 1; i >= 0; i--) {
        to[size++] = "0123456789ABCDEF"[value >> (4 * i) & 0xFU];
    }
    return size;
}

/* Converts a character of `length` bytes for display; `length` 0: an invalid byte. Returns the
 * number of bytes in `shown`. */
static size_t show(const char *bytes, size_t length, uint32_t code, char shown[LONGEST]) {
    if (length == 0 || (length == 1 && code != '\t' && !tl_utf8_can_be_shown(code))) {
        return put_hex(shown, "\\x", (unsigned char)bytes[0], 2);
    }
    if (length > 1 && !tl_utf8_can_be_shown(code)) {
        size_t size = put_hex(shown, "\\u{", code, 1);
        shown[size++] = '}';
        return size;
    }
    memcpy(shown, bytes, length);
    return length;
}

size_t tl_clean_text(const char *bytes, size_t size, char *clean, size_t room) {
    size_t end = 0;
    for (size_t i = 0; i < size;) {
        char shown[LONGEST];
        uint32_t code = 0;
        size_t length = tl_utf8_read(bytes + i, size - i, &code);
        size_t added = show(bytes + i, length, code, shown);
        if (end + added >= room) {
            break;
        }
        memcpy(clean + end, shown, added);
        end += added;
        i += length == 0 ? 1 : length;
    }
    clean[end] = '\0';
    return end;
}

void tl_clean_field(char *field, size_t room) {
    char copy[TL_CLEAN_FIELD];
    size_t length = strnlen(field, room - 1);
    memcpy(copy, field, length);
    (void)tl_clean_text(copy, length, field, room);
}

/* ---- wrapped ---- */

enum { WIDTH = 79 };

/* Counts characters, not bytes. */
static size_t columns_of(const char *word, size_t length) {
    size_t columns = 0;
    for (size_t i = 0; i < length; i++) {
        columns += ((unsigned char)word[i] & 0xC0U) != 0x80U ? 1 : 0;
    }
    return columns;
}

void tl_wrapped_print(FILE *file, const char *text, int first, int indent) {
    (void)fprintf(file, "%*s", first, "");
    tl_wrapped_continue(file, text, first, indent);
}

void tl_wrapped_continue(FILE *file, const char *text, int column, int indent) {
    for (const char *word = text; *word != '\0';) {
        size_t length = strcspn(word, " ");
        int columns = (int)columns_of(word, length);
        if (word != text && column + 1 + columns > WIDTH) {
            (void)fprintf(file, "\n%*s", indent, "");
            column = indent;
        } else if (word != text) {
            (void)fputc(' ', file);
            column++;
        }
        (void)fprintf(file, "%.*s", (int)length, word);
        column += columns;
        word += length + (word[length] == ' ' ? 1 : 0);
    }
    (void)fputc('\n', file);
}

/* ---- UTC stamps. The parser does not use strptime(), which depends on the locale and accepts too
 * much. The calendar does not use time_t, because a 32-bit one ends in 2038. */

enum { MS = 1000, DAY = 86400 };

static const int64_t EARLIEST = INT64_C(-62167219200000); /* 0000-01-01T00:00:00.000Z */
static const int64_t LATEST = INT64_C(253402300799999);   /* 9999-12-31T23:59:59.999Z */

typedef struct date {
    int year;
    int month; /* 1 … 12 */
    int day;   /* 1 … 31 */
} date;

/* ---- Calendar -------------------------------------------------------------------------------- */

/* Days from 0000-01-01 to the first day of a year; the year 0 is a leap year. */
static int64_t days_before_year(int year) {
    return INT64_C(365) * year + (year + 3) / 4 - (year + 99) / 100 + (year + 399) / 400;
}

/* Days from the start of the year to the start of a month, 1 … 13. */
static int days_before_month(int year, int month) {
    assert(month >= 1 && month <= 13);
    static const int before[] = {0, 31, 59, 90, 120, 151, 181, 212, 243, 273, 304, 334, 365};
    bool is_leap = (year % 4 == 0 && year % 100 != 0) || year % 400 == 0;
    return before[month - 1] + (month > 2 && is_leap ? 1 : 0);
}

/* Converts days since 0000-01-01 to a date. */
static void set_date(date *utc, int64_t day) {
    utc->year = (int)(day / 366); /* a lower bound */
    while (days_before_year(utc->year + 1) <= day) {
        utc->year++;
    }
    int within = (int)(day - days_before_year(utc->year));
    utc->month = 1;
    while (days_before_month(utc->year, utc->month + 1) <= within) {
        utc->month++;
    }
    utc->day = within - days_before_month(utc->year, utc->month) + 1;
}

/* ---- Texts ----------------------------------------------------------------------------------- */

int64_t tl_utc_now(void) {
    struct timespec now = {.tv_sec = 0}; /* remains if time_t has 4 bytes and 2038 is over */
    (void)clock_gettime(CLOCK_REALTIME, &now);
    return (int64_t)now.tv_sec * MS + now.tv_nsec / 1000000;
}

void tl_utc_text(int64_t milliseconds, char text[TL_UTC_TEXT]) {
    int64_t within = milliseconds < EARLIEST ? EARLIEST : milliseconds > LATEST ? LATEST : milliseconds;
    int64_t seconds = (within - EARLIEST) / MS;
    int second = (int)(seconds % DAY);
    date utc;
    set_date(&utc, seconds / DAY);
    char wide[96]; /* avoids a compiler warning about truncation */
    (void)snprintf(wide, sizeof wide, "%04d-%02d-%02dT%02d:%02d:%02d.%03dZ", utc.year, utc.month, utc.day,
                   second / 3600, second / 60 % 60, second % 60, (int)((within - EARLIEST) % MS));
    memcpy(text, wide, TL_UTC_TEXT - 1);
    text[TL_UTC_TEXT - 1] = '\0';
}

static int number_at(const char *text, int digits) {
    int value = 0;
    for (int i = 0; i < digits; i++) {
        value = value * 10 + (text[i] - '0');
    }
    return value;
}

/* Returns how many characters at the start of the text have the form of a stamp. */
static size_t count_fitting(const char *text) {
    static const char shape[] = "9999-99-99T99:99:99.999999999";
    size_t length = 0;
    for (const char *c = shape; *c != '\0'; c++, length++) {
        bool fits = *c == '9' ? text[length] >= '0' && text[length] <= '9'
                              : text[length] == *c || (*c == 'T' && text[length] == ' ');
        if (!fits) {
            break;
        }
    }
    return length;
}

bool tl_utc_parse(const char *text, int64_t *milliseconds) {
    enum { DATE = 10, MINUTE = 16, SECOND = 19, TENTH = 21 }; /* valid lengths */
    char full[] = "0000-00-00T00:00:00.000";
    size_t length = count_fitting(text);
    const char *rest = text + length + (text[length] == 'Z' ? 1 : 0);
    if (*rest != '\0' || (length != DATE && length != MINUTE && length != SECOND && length < TENTH)) {
        return false;
    }
    memcpy(full, text, length < sizeof full - 1 ? length : sizeof full - 1);
    const date utc = {number_at(full, 4), number_at(full + 5, 2), number_at(full + 8, 2)};
    int hour = number_at(full + 11, 2);
    int minute = number_at(full + 14, 2);
    int second = number_at(full + 17, 2);
    if (utc.month < 1 || utc.month > 12 || utc.day < 1 || hour > 23 || minute > 59 || second > 59 ||
        utc.day > days_before_month(utc.year, utc.month + 1) - days_before_month(utc.year, utc.month)) {
        return false;
    }
    int64_t day = days_before_year(utc.year) + days_before_month(utc.year, utc.month) + utc.day - 1;
    second += (hour * 60 + minute) * 60;
    *milliseconds = EARLIEST + (day * DAY + second) * MS + number_at(full + 20, 3);
    return true;
}

/* ---- Text for display. The decimal separator is a point, whatever the locale is (os.h). */

enum { CELL = 512 };

static bool is_set(const char *value) {
    return value != NULL && value[0] != '\0';
}

/* Finds the locale's name in the order of POSIX. */
static bool is_utf8_locale(void) {
    static const char *const names[] = {"LC_ALL", "LC_CTYPE", "LANG"};
    for (size_t i = 0; i < sizeof names / sizeof names[0]; i++) {
        const char *value = getenv(names[i]);
        if (is_set(value)) {
            return strcasestr(value, "utf-8") != NULL || strcasestr(value, "utf8") != NULL;
        }
    }
    return false;
}

tl_show_style tl_show_style_of(FILE *file) {
    tl_show_style style = {false, false, false};
    const char *terminal = getenv("TERM");
    if (isatty(fileno(file))) {
        style.unicode = is_utf8_locale();
        style.ascii = !style.unicode;
        style.colour = is_set(terminal) && strcmp(terminal, "dumb") != 0 && !is_set(getenv("NO_COLOR"));
    }
    return style;
}

/* ---- Characters ------------------------------------------------------------------------------ */

size_t tl_show_character(const char *text, bool *is_control) {
    uint32_t code = 0;
    size_t length = tl_utf8_read(text, strnlen(text, 4), &code);
    *is_control = length == 0 || !tl_utf8_can_be_shown(code);
    return length == 0 ? 1 : length;
}

void tl_show_clean(tl_show_style style, const char *text, char *clean, size_t size) {
    size_t end = 0;
    while (*text != '\0') {
        bool replace = false;
        size_t length = tl_show_character(text, &replace);
        replace = replace || (style.ascii && length > 1);
        if (end + (replace ? 1 : length) >= size) {
            break;
        }
        if (replace) {
            clean[end++] = '?';
        } else {
            memcpy(clean + end, text, length);
            end += length;
        }
        text += length;
    }
    clean[end] = '\0';
}

/* ---- Numbers --------------------------------------------------------------------------------- */

void tl_show_number(double value, bool sign, char *text, size_t size) {
    if (!isfinite(value)) {
        (void)snprintf(text, size, "-");
    } else if (value == 0.0) {
        (void)snprintf(text, size, "0"); /* never "-0" */
    } else {
        (void)snprintf(text, size, sign ? "%+.4g" : "%.5g", value);
    }
}

void tl_show_exact(double value, char *text, size_t size) {
    for (int digits = 15; digits <= 17; digits++) {
        (void)snprintf(text, size, "%.*g", digits, value);
        if (strtod(text, NULL) == value) {
            return;
        }
    }
}

void tl_show_duration(double seconds, char *text, size_t size) {
    double whole = floor(seconds + 0.5);
    if (seconds < 10.0) {
        (void)snprintf(text, size, "%.3g s", seconds);
    } else if (whole < 60.0) {
        (void)snprintf(text, size, "%.0f s", whole);
    } else if (whole < 3600.0) {
        (void)snprintf(text, size, "%.0f min %.0f s", floor(whole / 60.0), fmod(whole, 60.0));
    } else if (whole < 86400.0) {
        (void)snprintf(text, size, "%.0f h %.0f min", floor(whole / 3600.0), floor(fmod(whole, 3600.0) / 60.0));
    } else {
        (void)snprintf(text, size, "%.0f d %.0f h", floor(whole / 86400.0), floor(fmod(whole, 86400.0) / 3600.0));
    }
}

void tl_show_bytes(double bytes, char *text, size_t size) {
    static const char *const units[] = {"B", "kB", "MB", "GB", "TB"};
    size_t unit = 0;
    while (bytes >= 999.5 && unit + 1 < sizeof units / sizeof units[0]) {
        bytes /= 1000.0;
        unit++;
    }
    (void)snprintf(text, size, bytes < 99.95 && unit > 0 ? "%.1f %s" : "%.0f %s", bytes, units[unit]);
}

/* Halves the values, because the difference of the largest ones would overflow. */
static size_t level_of(double value, double least, double largest, size_t levels) {
    double range = largest / 2.0 - least / 2.0;
    if (!(range > 0.0)) {
        return levels / 2 - 1;
    }
    double position = (value / 2.0 - least / 2.0) / range * (double)(levels - 1) + 0.5;
    return position < (double)levels ? (size_t)position : levels - 1;
}

void tl_show_curve(tl_show_style style, const double *values, size_t count, char *text, size_t size) {
    static const char *const blocks[] = {"▁", "▂", "▃", "▄", "▅", "▆", "▇", "█"};
    static const char *const plain[] = {"_", ".", ",", "-", "~", "=", "+", "#"};
    enum { LEVELS = sizeof blocks / sizeof blocks[0] };
    double least = (double)INFINITY;
    double largest = (double)-INFINITY;
    for (size_t i = 0; i < count; i++) {
        if (isfinite(values[i])) {
            least = fmin(least, values[i]);
            largest = fmax(largest, values[i]);
        }
    }
    size_t end = 0;
    text[0] = '\0';
    for (size_t i = 0; i < count; i++) {
        const char *mark = " ";
        if (isfinite(values[i])) {
            mark = (style.unicode ? blocks : plain)[level_of(values[i], least, largest, LEVELS)];
        }
        if (end + strlen(mark) < size) {
            end += (size_t)snprintf(text + end, size - end, "%s", mark);
        }
    }
}

/* ---- Tables ---------------------------------------------------------------------------------- */

void tl_show_table_begin(tl_show_table *table, tl_show_style style, const char *alignment) {
    *table = (tl_show_table){.style = style, .alignment = alignment, .columns = strlen(alignment)};
}

void tl_show_table_add(tl_show_table *table, const char *format, ...) {
    char text[CELL];
    char clean[CELL];
    va_list arguments;
    va_start(arguments, format);
    (void)vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    tl_show_clean(table->style, text, clean, sizeof clean);
    char **cells = tl_array_grown((void *)table->cells, table->count, sizeof *cells);
    char *cell = cells != NULL ? strdup(clean) : NULL;
    table->cells = cells != NULL ? cells : table->cells;
    table->failed = table->failed || cell == NULL;
    if (cell != NULL) {
        table->cells[table->count++] = cell;
    }
}

/* Prints the first row, the header, dim. */
static void print_row(const tl_show_table *table, size_t row, const size_t *widths, FILE *file) {
    bool dim = row == 0 && table->style.colour;
    size_t last = table->columns; /* omits blanks at the end of the line */
    while (last > 0 && table->cells[row + last - 1][0] == '\0') {
        last--;
    }
    (void)fputs(dim ? "\x1b[2m" : "", file);
    for (size_t i = 0; i < last; i++) {
        const char *cell = table->cells[row + i];
        size_t blanks = widths[i] - columns_of(cell, strlen(cell));
        size_t left = table->alignment[i] == 'r' ? blanks : 0;
        size_t right = i + 1 == last ? 0 : blanks - left;
        (void)fprintf(file, "  %*s%s%*s", (int)left, "", cell, (int)right, "");
    }
    (void)fputs(dim ? "\x1b[0m\n" : "\n", file);
}

tl_status tl_show_table_end(tl_show_table *table, FILE *file, tl_error *error) {
    size_t widths[TL_SHOW_COLUMNS] = {0};
    for (size_t i = 0; i < table->count; i++) {
        size_t width = columns_of(table->cells[i], strlen(table->cells[i]));
        widths[i % table->columns] = width > widths[i % table->columns] ? width : widths[i % table->columns];
    }
    for (size_t row = 0; !table->failed && row + table->columns <= table->count; row += table->columns) {
        print_row(table, row, widths, file);
    }
    for (size_t i = 0; i < table->count; i++) {
        free(table->cells[i]);
    }
    free((void *)table->cells);
    bool failed = table->failed;
    memset(table, 0, sizeof *table);
    return failed ? tl_fail(error, TL_TRY_AGAIN, "not enough memory for a table; free memory and try again") : TL_OK;
}

const char *tl_show_unit(const char *unit) {
    return strcmp(unit, "1") == 0 ? "" : unit;
}
