/* Texts for people: what may be shown, columns, numbers, durations, dates, wrapped lines.
 *
 * Thread:  any, but for a table of columns, which belongs to one.
 */
#ifndef TL_FIRMWARE_BASE_TEXT_H
#define TL_FIRMWARE_BASE_TEXT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

#include "master/base/status.h"

/* ---- Clean text: what a stranger has written, so that it can be shown and kept.
 *
 * Purpose: the one way for all that comes from a process with FMUs, be it printed, logged, an error or a name. What is left is valid UTF-8 that cannot
 *          command a terminal, forge a line's end or turn its direction: printable characters and tabs as they are; control characters and what is
 *          no UTF-8 as \xHH; C1, separators of lines, what turns or hides as \u{HEX} (master/base/text.h).
 * Thread:  pure; safe in a signal handler.
 */

/* As much of `size` bytes as fits into `room` > 0 with a NUL behind it; nothing is cut in its middle. The bytes must be our own by now: nobody may
 * change them meanwhile. Returns the length. */
size_t tl_clean_text(const char *bytes, size_t size, char *clean, size_t room);

/* The same in place, of a field that may have no NUL: it is cut to `room` bytes, at most TL_CLEAN_FIELD. */
enum { TL_CLEAN_FIELD = 4096 };
void tl_clean_field(char *field, size_t room);

/* ---- Paragraphs for a terminal.
 *
 * Purpose: what is told in sentences, broken between words at 79 columns.
 * Thread:  the writer's.
 */

/* A paragraph and a new line: behind `first` blanks its first line, and behind `indent` all others. */
void tl_wrapped_print(FILE *file, const char *text, int first, int indent);

/* ---- UTC as people and databases write it: "2026-11-21T10:02:03.456Z".
 *
 * Purpose: one format for every stamp that leaves the process. Inside, times are monotonic nanoseconds
 *          (master/base/simtime.h); the wall clock is only ever a stamp.
 * Thread:  any; no lock, no allocation.
 */

enum { TL_UTC_TEXT = 25 }; /* bytes, the zero at the end included */

/* Milliseconds since 1970-01-01T00:00:00Z. Wait-free. */
int64_t tl_utc_now(void);

/* Years 0 … 9999; a time outside is written as the nearest inside. */
void tl_utc_text(int64_t milliseconds, char text[TL_UTC_TEXT]);

/* "2026-11-21", "2026-11-21T10:02", "… 10:02:03", "….456"; 'T' or one blank between, an optional 'Z' at the end.
 * False where it is none of these. */
bool tl_utc_parse(const char *text, int64_t *milliseconds);

/* ---- Text for people: what a terminal can show, columns, numbers, durations, small curves.
 *
 * Purpose: the page of `show` says what it says on any terminal and in any pipe, and nothing in a database can command
 *          the terminal.
 * Thread:  pure but for the table, which belongs to one thread.
 */

typedef struct tl_show_style {
    bool unicode; /* a terminal that shows UTF-8 */
    bool colour;  /* a terminal that shows colours, and nobody who forbids them */
    bool ascii;   /* a terminal that shows no UTF-8: nothing else may reach it */
} tl_show_style;

/* By isatty(), LC_ALL, LC_CTYPE, LANG, TERM and NO_COLOR. */
tl_show_style tl_show_style_of(FILE *file);

/* Bytes of the UTF-8 character at `text`, which is not its end; 1 for a byte that begins none. `is_control`: it is none, or it commands a terminal,
 * turns the direction of text or hides, instead of standing in it (master/base/text.h). */
size_t tl_show_character(const char *text, bool *is_control);

/* Cuts a text so that it can be printed: control characters become "?", and with `ascii` all that is not ASCII. */
void tl_show_clean(tl_show_style style, const char *text, char *clean, size_t size);

/* "0.0031", "1.2e-07", "-" for what is not finite; the sign always where `sign`. */
void tl_show_number(double value, bool sign, char *text, size_t size);

/* The shortest text that reads back as the same number. */
void tl_show_exact(double value, char *text, size_t size);

/* "0.35 s", "14 s", "1 min 30 s", "2 h 5 min", "3 d 4 h". */
void tl_show_duration(double seconds, char *text, size_t size);

/* "12.4 MB" */
void tl_show_bytes(double bytes, char *text, size_t size);

/* One character per value between the least and the largest; NaN: blank. */
void tl_show_curve(tl_show_style style, const double *values, size_t count, char *text, size_t size);

enum { TL_SHOW_COLUMNS = 16, TL_SHOW_CURVE = 64 * 3 + 1 };

/* A table of cells, printed with columns as wide as they need. */
typedef struct tl_show_table {
    tl_show_style style;
    const char *alignment; /* of its columns */
    size_t columns;        /* TL_SHOW_COLUMNS at most */
    char **cells;
    size_t count;
    bool failed; /* memory is out */
} tl_show_table;

/* `alignment`: one letter per column, "l" or "r"; it stays. */
void tl_show_table_begin(tl_show_table *table, tl_show_style style, const char *alignment);

/* The next cell, row by row; the text is cleaned. */
void tl_show_table_add(tl_show_table *table, const char *format, ...) TL_PRINTF(2, 3);

/* Prints with two blanks before each row and between columns, and frees. The first row is a header. */
tl_status tl_show_table_end(tl_show_table *table, FILE *file, tl_error *error);

/* A unit as people read it: nothing where it is "1". */
const char *tl_show_unit(const char *unit);

#endif
