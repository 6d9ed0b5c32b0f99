/* A CSV text as a table of numbers, row by row.
 *
 * Thread:  one for each table.
 */
#ifndef TL_BOARD_CSV_CSV_TABLE_H
#define TL_BOARD_CSV_CSV_TABLE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "master/base/signal.h"
#include "master/base/simtime.h"
#include "master/base/status.h"

/* ---- What is read of a CSV stream: which columns, and one row of them.
 *
 * Purpose: what the reader, the driver and the table below both speak of.
 * Units:   times in ns, as the time column counts them; values as in the cells.
 * Owner:   a row is placed by its owner; texts of the settings belong to the caller.
 */

typedef struct tl_csv_settings {
    const char *path;
    const char *time_column;
    const char *const *columns; /* one per channel, in channel order */
    size_t column_count;
} tl_csv_settings;

/* One row. A cell that is empty leaves present false; one that is no finite number has quality
 * TL_NOT_A_NUMBER and value 0. */
typedef struct tl_csv_row {
    tl_time time; /* as in the time column */
    bool present[TL_MAX_SIGNALS];
    double values[TL_MAX_SIGNALS];
    tl_quality quality[TL_MAX_SIGNALS];
} tl_csv_row;

/* ---- Lines and cells of a CSV stream. Private to the CSV reader and driver.
 *
 * Purpose: tl_csv_lines cuts lines out of bytes as they come; tl_csv_table finds the columns by a header line and
 *          makes a row of each further one.
 * Owner:   the structures are placed by their owner. No allocation after the header.
 */

/* ---- lines ---- */

enum { TL_CSV_LINE = 64 * 1024 }; /* bytes of the longest line, its end included */

typedef enum tl_csv_found { TL_CSV_NOTHING, TL_CSV_A_LINE, TL_CSV_TOO_LONG } tl_csv_found;

/* Zeroed is empty. */
typedef struct tl_csv_lines {
    size_t begin, end; /* of the bytes that were not taken yet */
    int64_t number;    /* of the line taken last, from 1 */
    bool skipping;     /* the rest of a line that is too long */
    char bytes[TL_CSV_LINE + 1];
} tl_csv_lines;

/* Where the next bytes go, and how many may come: never 0 after take() has returned TL_CSV_NOTHING. */
char *tl_csv_lines_room(tl_csv_lines *lines, size_t *room);
void tl_csv_lines_added(tl_csv_lines *lines, size_t count);

/* The next whole line, without its end, valid until the next call; blank ones are passed over. `last`: nothing
 * more will come, so what is left is a line too. A line that is too long is told once. */
tl_csv_found tl_csv_lines_take(tl_csv_lines *lines, bool last, char **line);

/* Forgets what was not taken, not the line number. */
void tl_csv_lines_drop(tl_csv_lines *lines);

/* ---- files ---- */

/* A device is never read: to open one is to act, as on a watchdog. Look before opening. */
bool tl_csv_is_device(const char *path);

/* ---- cells ---- */

typedef struct tl_csv_table {
    char *path; /* for error texts */
    char *time_column;
    char **columns;
    size_t column_count;
    size_t cell_count; /* of each row; 0: there was no header yet */
    size_t time_cell;
    size_t cell_of[TL_MAX_SIGNALS];
    const char **cells; /* of one row */
} tl_csv_table;

/* Copies the settings. Nothing needs to be released after an error. */
tl_status tl_csv_table_make(tl_csv_table *table, const tl_csv_settings *settings, tl_error *error);

/* Finds the columns; changes the text of `line`. After an error the table is as it was. */
tl_status tl_csv_table_header(tl_csv_table *table, char *line, int64_t number, tl_error *error);

/* Changes the text of `line`. *row means nothing after an error. */
tl_status tl_csv_table_row(tl_csv_table *table, char *line, int64_t number, tl_csv_row *row, tl_error *error);

/* The error of a line that was TL_CSV_TOO_LONG. */
tl_status tl_csv_table_too_long(const tl_csv_table *table, int64_t number, tl_error *error);

void tl_csv_table_release(tl_csv_table *table);

#endif
