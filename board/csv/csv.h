/* CSV: reads rows of numbers by time stamp; and the plant driver that uses it.
 *
 * Purpose: tl_csv_reader reads a recording row by row (replay, plant). tl_csv_driver reads a file
 *          or a FIFO while it is written (thesis 5.4.2) and maps row times to the cycle's clock.
 * Format:  see config/SPEC.md, "Recordings": a header row, comma separated. One column is the time
 *          in seconds, strictly increasing; empty cells mean "no new value". Cells may be quoted
 *          and have spaces around them; lines end with LF or CRLF. A UTF-8 byte order mark, blank
 *          lines and other columns are ignored. Numbers are decimal, with a point.
 */
#ifndef TL_BOARD_CSV_CSV_H
#define TL_BOARD_CSV_CSV_H

#include "board/csv/csv_table.h"
#include "board/io/plant_access.h"
#include "board/io/plant_io.h"

/* ---- rows of a file ---- */

typedef struct tl_csv_reader tl_csv_reader;

/* Errors TL_BAD_DATA: the file is absent or empty, a column is missing (the text lists the existing
 * ones) or there twice, semicolons separate the cells, or there are more columns than
 * TL_MAX_SIGNALS. TL_TRY_AGAIN: out of memory or descriptors. Copies all settings. */
tl_status tl_csv_open(const tl_csv_settings *settings, tl_csv_reader **reader, tl_error *error);

/* Reads the next row. At the end of the file it sets *end and leaves *row unchanged. Errors
 * TL_BAD_DATA with file and line: the time is no number or not increasing, wrong number of cells,
 * line longer than 64 KiB. */
tl_status tl_csv_next(tl_csv_reader *reader, tl_csv_row *row, bool *end, tl_error *error);

/* NULL is allowed. */
void tl_csv_close(tl_csv_reader *reader);

/* ---- the driver ---- */

extern const tl_plant_io_driver tl_csv_driver;
extern const tl_plant_access tl_csv_access; /* only its files */

/* Opens a file or FIFO for live reading without blocking. The path may not exist yet: then the link
 * is down.
 * Regular file: is played in its own time. The first row is posted when it is read, each further
 *               row when it is due. Its end is the end of the source; a malformed row is an error.
 * FIFO: rows are posted as they come; a poll without a row waits up to 50 ms. The link is down
 *       while no process writes to it.
 * Stamps follow the times of the rows. The first row anchors them to the clock; so does the first
 * row after a restart of the writer (it closed the FIFO, repeated its header, or its time went back
 * in two consecutive rows). No stamp is later than the arrival; if the clocks drift apart, the
 * anchor is corrected once a minute.
 * link(…) reports a malformed row of a FIFO, which is skipped, at most once per second; the same
 * for lines before a header and lines longer than 64 KiB. */
tl_status tl_csv_open_live(const tl_csv_settings *settings, tl_plant_io **io, tl_error *error);

#endif
