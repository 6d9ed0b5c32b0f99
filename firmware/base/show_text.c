/* Text for people. Numbers are written and read with a point, whatever the locale (c_locale.h). */
#include "firmware/base/show_text.h"

#include <math.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <unistd.h>

#include "master/base/utf8.h"

enum { CELL = 512 };

static bool is_set(const char *value) {
    return value != NULL && value[0] != '\0';
}

/* The locale's name, as POSIX finds it. */
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

/* ---- Characters -------------------------------------------------------------------------------------------------- */

/* The database holds valid UTF-8, and what does not is still only bytes. */
size_t tl_show_character(const char *text) {
    unsigned char first = (unsigned char)text[0];
    size_t length = first < 0xC0 ? 1 : first < 0xE0 ? 2 : first < 0xF0 ? 3 : 4;
    for (size_t i = 1; i < length; i++) {
        if (((unsigned char)text[i] & 0xC0) != 0x80) {
            return 1;
        }
    }
    return length;
}

bool tl_show_is_control(const char *text, size_t length) {
    uint32_t code = 0;
    return tl_utf8_read(text, length, &code) == 0 || !tl_utf8_can_be_shown(code);
}

void tl_show_clean(tl_show_style style, const char *text, char *clean, size_t size) {
    size_t end = 0;
    while (*text != '\0') {
        size_t length = tl_show_character(text);
        bool replace = tl_show_is_control(text, length) || (style.ascii && length > 1);
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

/* Columns on a terminal, one per character. */
static size_t width_of(const char *text) {
    size_t width = 0;
    for (; *text != '\0'; text += tl_show_character(text)) {
        width++;
    }
    return width;
}

/* ---- Numbers ----------------------------------------------------------------------------------------------------- */

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

/* Halved, so that the difference of the largest numbers is one too. */
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

/* ---- Tables ------------------------------------------------------------------------------------------------------ */

void tl_show_table_begin(tl_show_table *table, tl_show_style style, const char *alignment) {
    memset(table, 0, sizeof *table);
    table->style = style;
    table->columns = strlen(alignment);
    for (size_t i = 0; i < table->columns && i < TL_SHOW_COLUMNS; i++) {
        table->right[i] = alignment[i] == 'r';
    }
}

void tl_show_table_add(tl_show_table *table, const char *format, ...) {
    char text[CELL];
    char clean[CELL];
    va_list arguments;
    va_start(arguments, format);
    (void)vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    tl_show_clean(table->style, text, clean, sizeof clean);
    if (table->count == table->room) {
        size_t room = table->room == 0 ? 64 : table->room * 2;
        char **cells = realloc(table->cells, room * sizeof *cells);
        if (cells == NULL) {
            table->failed = true;
            return;
        }
        table->cells = cells;
        table->room = room;
    }
    char *cell = strdup(clean);
    if (cell == NULL) {
        table->failed = true;
        return;
    }
    table->cells[table->count++] = cell;
}

static void pad(FILE *file, size_t count) {
    (void)fprintf(file, "%*s", (int)count, "");
}

/* The header is dim. */
static void print_row(const tl_show_table *table, size_t row, const size_t *widths, FILE *file) {
    bool dim = row == 0 && table->style.colour;
    size_t last = table->columns; /* no blanks at the end of a line */
    while (last > 0 && table->cells[row + last - 1][0] == '\0') {
        last--;
    }
    (void)fputs(dim ? "\x1b[2m" : "", file);
    for (size_t i = 0; i < last; i++) {
        const char *cell = table->cells[row + i];
        size_t blanks = widths[i] - width_of(cell);
        pad(file, 2 + (table->right[i] ? blanks : 0));
        (void)fputs(cell, file);
        pad(file, table->right[i] || i + 1 == last ? 0 : blanks);
    }
    (void)fputs(dim ? "\x1b[0m\n" : "\n", file);
}

tl_status tl_show_table_end(tl_show_table *table, FILE *file, tl_error *error) {
    size_t widths[TL_SHOW_COLUMNS] = {0};
    for (size_t i = 0; i < table->count; i++) {
        size_t width = width_of(table->cells[i]);
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
    return failed ? tl_fail(error, TL_TRY_AGAIN, "out of memory") : TL_OK;
}

const char *tl_show_unit(const char *unit) {
    return strcmp(unit, "1") == 0 ? "" : unit;
}
