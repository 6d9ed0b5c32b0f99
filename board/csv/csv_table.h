/* CSV text as a table of numbers, row by row.
 *
 * Thread:  one per table.
 */
#ifndef TL_BOARD_CSV_CSV_TABLE_H
#define TL_BOARD_CSV_CSV_TABLE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "master/base/signal.h"
#include "master/base/simtime.h"
#include "master/base/status.h"

/* ---- Columns and one row of a CSV stream.
 *
 * Purpose: shared by the reader, the driver and the table below.
 * Units:   times in ns, from the time column; values as in the cells.
 * Owner:   the caller places rows and owns the texts of the settings.
 */

typedef struct tl_csv_settings {
    const char *path;
    const char *time_column;
    const char *const *columns; /* one per channel, in channel order */
    size_t column_count;
} tl_csv_settings;

/* One row. An empty cell leaves `present` false; a cell that is no finite number has quality
 * TL_NOT_A_NUMBER and value 0. */
typedef struct tl_csv_row {
    tl_time time; /* as in the time column */
    bool present[TL_MAX_SIGNALS];
    double values[TL_MAX_SIGNALS];
    tl_quality quality[TL_MAX_SIGNALS];
} tl_csv_row;

/* ---- Lines and cells of a CSV stream. Private to the CSV reader and driver.
 *
 * Purpose: tl_csv_lines splits incoming bytes into lines; tl_csv_table finds the columns from the
 *          header line and converts each further line to a row.
 * Owner:   the caller places the structures. No allocation after the header.
 */

/* ---- lines ---- */

enum { TL_CSV_LINE = 64 * 1024 }; /* longest line in bytes, with its end */

typedef enum tl_csv_found { TL_CSV_NOTHING, TL_CSV_A_LINE, TL_CSV_TOO_LONG } tl_csv_found;

/* Starts as zeros: empty. */
typedef struct tl_csv_lines {
    size_t begin, end; /* of the bytes not taken yet */
    int64_t number;    /* of the line taken last, from 1 */
    bool skipping;     /* skipping the rest of a line that is too long */
    char bytes[TL_CSV_LINE + 1];
} tl_csv_lines;

/* Buffer for the next bytes, and its size: never 0 after take() has returned TL_CSV_NOTHING. */
char *tl_csv_lines_room(tl_csv_lines *lines, size_t *room);
void tl_csv_lines_added(tl_csv_lines *lines, size_t count);

/* The next whole line without its end, valid until the next call; blank lines are skipped. `last`:
 * no more bytes will come, so the rest is a line too. A line that is too long is reported once. */
tl_csv_found tl_csv_lines_take(tl_csv_lines *lines, bool last, char **line);

/* Drops the remaining bytes; keeps the line number. */
void tl_csv_lines_drop(tl_csv_lines *lines);

/* ---- files ---- */

/* True if the path is a device, which must not be read: opening one may act, for example on a
 * watchdog. Call before opening. */
bool tl_csv_is_device(const char *path);

/* ---- cells ---- */

typedef struct tl_csv_table {
    char *path; /* for error texts */
    char *time_column;
    char **columns;
    size_t column_count;
    size_t cell_count; /* of each row; 0: no header yet */
    size_t time_cell;
    size_t cell_of[TL_MAX_SIGNALS];
    const char **cells; /* of one row */
} tl_csv_table;

/* Copies the settings. After an error nothing needs to be released. */
tl_status tl_csv_table_make(tl_csv_table *table, const tl_csv_settings *settings, tl_error *error);

/* Finds the columns; modifies `line`. After an error the table is unchanged. */
tl_status tl_csv_table_header(tl_csv_table *table, char *line, int64_t number, tl_error *error);

/* Modifies `line`. After an error *row is undefined. */
tl_status tl_csv_table_row(tl_csv_table *table, char *line, int64_t number, tl_csv_row *row, tl_error *error);

/* Error of a line that was TL_CSV_TOO_LONG. */
tl_status tl_csv_table_too_long(const tl_csv_table *table, int64_t number, tl_error *error);

void tl_csv_table_release(tl_csv_table *table);

#endif
