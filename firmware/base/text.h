/* Texts for display: clean text, columns, numbers, durations, dates, wrapped lines.
 *
 * Thread:  any; a table belongs to one thread.
 */
#ifndef TL_FIRMWARE_BASE_TEXT_H
#define TL_FIRMWARE_BASE_TEXT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

#include "master/base/status.h"

/* ---- Clean text: makes untrusted text safe to display and store.
 *
 * Purpose: used for all texts from an FMU process: output, log lines, errors and names. The result
 *          is valid UTF-8 that cannot control a terminal, fake a line end, or change the text
 *          direction. Printable characters and tabs stay. ASCII control characters and invalid
 *          UTF-8 become \xHH. C1 control characters, line separators, direction marks and invisible
 *          characters become \u{HEX} (master/base/text.h).
 * Thread:  pure; safe in a signal handler.
 */

/* Cleans `size` bytes into `clean`, which has `room` > 0 bytes, and adds a NUL. If the text does
 * not fit, it is truncated between two characters or escapes. No other process may change `bytes`
 * during the call: copy them first if they are in shared memory. Returns the length of `clean`. */
size_t tl_clean_text(const char *bytes, size_t size, char *clean, size_t room);

/* Cleans a field in place; before the call the field may have no NUL. `room`: bytes of the field,
 * at most TL_CLEAN_FIELD. The result has a NUL and is truncated if it does not fit. */
enum { TL_CLEAN_FIELD = 4096 };
void tl_clean_field(char *field, size_t room);

/* ---- Paragraphs for a terminal.
 *
 * Purpose: breaks sentences between words at 79 columns.
 * Thread:  the thread that writes `file`.
 */

/* Prints a paragraph and a newline. Indents the first line by `first` blanks, all others by
 * `indent`. Words are separated by one blank. */
void tl_wrapped_print(FILE *file, const char *text, int first, int indent);

/* As tl_wrapped_print(), if `column` columns of the first line are already printed. */
void tl_wrapped_continue(FILE *file, const char *text, int column, int indent);

/* ---- UTC for users and databases: "2026-11-21T10:02:03.456Z".
 *
 * Purpose: one format for all time stamps that leave the process. Internal times are monotonic
 *          nanoseconds (master/base/simtime.h); the wall clock is used for stamps only.
 * Thread:  any; no lock, no allocation.
 */

enum { TL_UTC_TEXT = 25 }; /* bytes, including the NUL */

/* Returns milliseconds since 1970-01-01T00:00:00Z. Wait-free. */
int64_t tl_utc_now(void);

/* Formats a time. A time outside of the years 0 … 9999 becomes the nearest one in them. */
void tl_utc_text(int64_t milliseconds, char text[TL_UTC_TEXT]);

/* Parses "2026-11-21", "2026-11-21T10:02", "2026-11-21T10:02:03" or "2026-11-21T10:02:03.456" (1 to
 * 9 digits after the point, of which 3 are used). 'T' may be a blank; a 'Z' may follow. The time is
 * UTC in each case. Returns false for any other text. */
bool tl_utc_parse(const char *text, int64_t *milliseconds);

/* ---- Display on a terminal: supported characters, columns, numbers, durations, small curves.
 *
 * Purpose: the output of `show` is readable on any terminal and in any pipe, and no text in a
 *          database can control the terminal.
 * Thread:  pure; a table belongs to one thread.
 */

/* Abilities of the output. All false: no terminal; then UTF-8 is printed without colours. */
typedef struct tl_show_style {
    bool unicode; /* a terminal that displays UTF-8 */
    bool colour;  /* a terminal that displays colours, and the user has not disabled them */
    bool ascii;   /* a terminal without UTF-8: print ASCII only */
} tl_show_style;

/* Detects the style from isatty(), LC_ALL, LC_CTYPE, LANG, TERM and NO_COLOR. */
tl_show_style tl_show_style_of(FILE *file);

/* Returns the number of bytes of the UTF-8 character at `text`, which must not be the NUL; 1 for an
 * invalid byte. Sets *is_control to true if the character must not be shown: an invalid byte, a
 * control character, a direction mark or an invisible character (master/base/text.h). */
size_t tl_show_character(const char *text, bool *is_control);

/* Copies a text for printing. Each control character (as in tl_show_character()) becomes "?"; with
 * style.ascii, also each character that is not ASCII. Truncates the copy to `size` bytes with its
 * NUL. */
void tl_show_clean(tl_show_style style, const char *text, char *clean, size_t size);

/* Writes "0.0031", "1.2e-07", "0"; "-" if not finite. At most 5 significant digits. With `sign`,
 * positive numbers get a +, and there are at most 4 digits. */
void tl_show_number(double value, bool sign, char *text, size_t size);

/* Writes a number with 15 to 17 digits: the fewest with which it parses to the same number. */
void tl_show_exact(double value, char *text, size_t size);

/* Writes "0.35 s", "14 s", "1 min 30 s", "2 h 5 min", "3 d 4 h". */
void tl_show_duration(double seconds, char *text, size_t size);

/* Writes "12.4 MB"; units of 1000, from B to TB. */
void tl_show_bytes(double bytes, char *text, size_t size);

/* Draws one character per value; the height of the character is scaled between the smallest and the
 * largest value. A value that is not finite is blank. A character needs 3 bytes with style.unicode,
 * else 1. Truncates to `size` bytes. */
void tl_show_curve(tl_show_style style, const double *values, size_t count, char *text, size_t size);

/* Maximum number of columns of a table; bytes of a curve of 64 values. */
enum { TL_SHOW_COLUMNS = 16, TL_SHOW_CURVE = 64 * 3 + 1 };

/* Table of cells, printed with columns as wide as necessary. Fields are private, except `columns`,
 * which the caller may reduce before the first cell. */
typedef struct tl_show_table {
    tl_show_style style;
    const char *alignment; /* one letter per column */
    size_t columns;        /* at most TL_SHOW_COLUMNS */
    char **cells;
    size_t count; /* number of cells in all rows */
    bool failed;  /* memory was out */
} tl_show_table;

/* Initialises a table. `alignment`: one letter per column, 'l' (left) or 'r' (right); the text must
 * stay valid until the end. */
void tl_show_table_begin(tl_show_table *table, tl_show_style style, const char *alignment);

/* Adds the next cell, row by row; `format` as for printf(). Cleans the text (tl_show_clean()) and
 * truncates it to 511 bytes. */
void tl_show_table_add(tl_show_table *table, const char *format, ...) TL_PRINTF(2, 3);

/* Prints the table with two blanks before each row and between columns, and frees it. The first row
 * is the header. Errors: TL_TRY_AGAIN if memory was out; then nothing is printed. */
tl_status tl_show_table_end(tl_show_table *table, FILE *file, tl_error *error);

/* Returns the unit to display: "" for "1" (no unit), else `unit`. */
const char *tl_show_unit(const char *unit);

#endif
