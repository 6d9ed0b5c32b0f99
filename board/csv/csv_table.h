/* CSV text as a table of numbers, row by row.
 *
 * Thread:  one per table.
 */
#ifndef TL_BOARD_CSV_CSV_TABLE_H
#define TL_BOARD_CSV_CSV_TABLE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "board/csv/csv_time.h"
#include "master/base/signal.h"
#include "master/base/simtime.h"
#include "master/base/status.h"

/* ---- Columns and one row of a CSV stream.
 *
 * Purpose: shared by the reader, the driver and the table below.
 * Units:   times in ns (csv_time.h); values as the columns scale them.
 * Owner:   the caller owns rows and the texts of the settings.
 */

/* Source of a channel: value = cell·scale + offset. */
typedef struct tl_csv_column {
    const char *name;
    double scale; /* not 0 */
    double offset;
} tl_csv_column;

typedef struct tl_csv_settings {
    const char *path;
    const char *time_column;
    const tl_csv_column *columns; /* of each channel, by channel index */
    size_t column_count;
} tl_csv_settings;

/* One row; the arrays are indexed by channel. `present` is false for an empty cell. A cell that is
 * no truth value and whose value is not finite, also an empty one, has the quality TL_NOT_A_NUMBER
 * and the value 0. */
typedef struct tl_csv_row {
    tl_time time; /* ns, by the time column */
    bool present[TL_MAX_SIGNALS];
    double values[TL_MAX_SIGNALS];
    tl_quality quality[TL_MAX_SIGNALS];
} tl_csv_row;

/* ---- Lines and cells of a CSV stream. Private to the CSV reader and driver.
 *
 * Purpose: tl_csv_lines splits incoming bytes into lines; tl_csv_table finds the columns from the
 *          header line and converts each further line to a row.
 * Owner:   the caller owns the structs. Only make and header allocate.
 */

/* ---- lines ---- */

enum { TL_CSV_LINE = 64 * 1024 }; /* longest line in bytes, with its line end */

/* Results of tl_csv_lines_take(). */
typedef enum tl_csv_found { TL_CSV_NOTHING, TL_CSV_A_LINE, TL_CSV_TOO_LONG } tl_csv_found;

/* Buffer that splits a stream into lines. Initialise it with zeros: empty. */
typedef struct tl_csv_lines {
    size_t begin, end; /* offsets of the bytes that are not returned yet */
    int64_t number;    /* number of the last line, from 1; counts blank lines too */
    bool skipping;     /* dropping the rest of a line that is too long */
    char bytes[TL_CSV_LINE + 1];
} tl_csv_lines;

/* Returns where to write the next bytes, and sets *room to their maximum number, which is never 0
 * after tl_csv_lines_take() has returned TL_CSV_NOTHING. Ends the validity of the last line. */
char *tl_csv_lines_room(tl_csv_lines *lines, size_t *room);

/* Adds the `count` bytes that the caller has written to that place. */
void tl_csv_lines_added(tl_csv_lines *lines, size_t count);

/* Finds the next complete line that is not blank. TL_CSV_A_LINE: *line is the line without its end,
 * valid until the next call for `lines`. TL_CSV_TOO_LONG: a line is too long and is skipped;
 * returned once per line. TL_CSV_NOTHING: there is no complete line: add more bytes. `last`: no
 * more bytes follow, so the rest is a line too. */
tl_csv_found tl_csv_lines_take(tl_csv_lines *lines, bool last, char **line);

/* Drops all bytes in the buffer; keeps the line number. */
void tl_csv_lines_drop(tl_csv_lines *lines);

/* ---- files ---- */

/* True if the path is a device. Call it before opening: opening a device may have an effect, for
 * example start a watchdog. */
bool tl_csv_is_device(const char *path);

/* ---- cells ---- */

typedef struct tl_csv_table {
    char *path; /* for error texts */
    char *time_column;
    char **columns;
    double scales[TL_MAX_SIGNALS], offsets[TL_MAX_SIGNALS]; /* of each channel */
    size_t column_count;
    size_t cell_count;              /* cells of each row; 0: no header yet */
    size_t time_cell;               /* index of the time cell in a row */
    size_t cell_of[TL_MAX_SIGNALS]; /* index of each channel's cell in a row */
    char **cells;                   /* cells of the current row */
    char separator;                 /* of cells: comma, semicolon or tab */
    char mark;                      /* decimal comma or point of the values; 0: none yet */
    tl_csv_clock clock;             /* form of the times, since the header */
    bool has_rows;                  /* since the header */
} tl_csv_table;

/* Initialises the table; copies the settings. After an error nothing needs to be released. Errors:
 * TL_BAD_DATA for more than TL_MAX_SIGNALS columns; TL_TRY_AGAIN if memory is out. */
tl_status tl_csv_table_make(tl_csv_table *table, const tl_csv_settings *settings, tl_error *error);

/* Finds the columns in the header line; modifies `line`. `number`: of the line, for error texts.
 * After an error the columns are as before. Errors: TL_BAD_DATA for the errors of a header that
 * tl_csv_open() lists; TL_TRY_AGAIN if memory is out. */
tl_status tl_csv_table_header(tl_csv_table *table, char *line, int64_t number, tl_error *error);

/* Converts a line to a row, after a header; modifies `line`. Does not compare the time with earlier
 * rows. *is_units: the line is a second header, with units, and *row is undefined. After an error
 * (TL_BAD_DATA) both are undefined. */
tl_status tl_csv_table_row(tl_csv_table *table, char *line, int64_t number, tl_csv_row *row, bool *is_units,
                           tl_error *error);

/* Splits a header of unknown columns at its most frequent separator; modifies `line`. Sets *count
 * to the number of cells, of which at most `room` are stored. Errors: as tl_csv_table_header(). */
tl_status tl_csv_table_split(const tl_csv_table *table, char *line, int64_t number, char **cells, size_t room,
                             size_t *count, tl_error *error);

enum { TL_CSV_FORM = 64 }; /* longest text, with its end */

/* Writes how the rows are written if not with commas and seconds, for messages: "semicolons,
 * dates", else "". */
void tl_csv_table_describe(const tl_csv_table *table, char text[TL_CSV_FORM]);

/* Sets *error for a line that was TL_CSV_TOO_LONG. Returns TL_BAD_DATA. */
tl_status tl_csv_table_too_long(const tl_csv_table *table, int64_t number, tl_error *error);

/* Frees the content. Allowed twice. */
void tl_csv_table_release(tl_csv_table *table);

#endif
