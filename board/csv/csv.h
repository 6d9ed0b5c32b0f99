/* CSV: reading rows of numbers by time stamp, and the plant I/O driver on top of it.
 *
 * Purpose: tl_csv_reader reads a recording row by row (replay, plant); tl_csv_driver reads a file or a FIFO
 *          that is written while we read (thesis 5.4.2), row time 0 … being mapped to the cycle's clock.
 * Format:  see config/SPEC.md, "Recordings": a header row, comma separated, one column is the time in seconds,
 *          strictly increasing; empty cells mean "no new value". Cells may be quoted and have spaces around them;
 *          lines end with LF or CRLF; a UTF-8 byte order mark, blank lines and further columns are passed over.
 *          Numbers are decimal, with a point.
 */
#ifndef TL_BOARD_CSV_CSV_H
#define TL_BOARD_CSV_CSV_H

#include "board/csv/csv_table.h"
#include "board/io/plant_access.h"
#include "board/io/plant_io.h"

/* ---- rows of a file ---- */

typedef struct tl_csv_reader tl_csv_reader;

/* Errors TL_BAD_DATA: file absent or empty, column missing (names those that are there) or there twice, cells
 * separated by semicolons, more columns than TL_MAX_SIGNALS; TL_TRY_AGAIN: memory or descriptors are out. Everything is
 * copied. */
tl_status tl_csv_open(const tl_csv_settings *settings, tl_csv_reader **reader, tl_error *error);

/* *end is set at the end of the file, and *row is then as it was. Errors TL_BAD_DATA with file and line: time not a
 * number or not increasing, wrong number of cells, line longer than 64 KiB. */
tl_status tl_csv_next(tl_csv_reader *reader, tl_csv_row *row, bool *end, tl_error *error);

/* NULL is allowed. */
void tl_csv_close(tl_csv_reader *reader);

/* ---- the driver ---- */

extern const tl_plant_io_driver tl_csv_driver;
extern const tl_plant_access tl_csv_access; /* nothing beside its files */

/* Opens a file or FIFO for live reading without blocking; the path may not exist yet (that is a link that is
 * down).
 * A regular file is played in its own time: the first row is posted when it is read, each further one once it is
 * due. Its end is the end of the source; anything malformed in it is an error.
 * A FIFO's rows are posted as they come; a poll that finds none waits up to 50 ms for one. It is down while nobody
 * writes to it.
 * Stamps follow the rows' own time, which is anchored to the clock by the first row, and anew after the writer was
 * restarted (it closed the FIFO, sent its header again, or its time went back in two rows running). No stamp is
 * later than the arrival, and where the two clocks drift apart the anchor follows, once a minute.
 * A malformed row of a FIFO is reported by link(…) once per second at most and skipped, never fatal; so are lines
 * without a header before them, and ones longer than 64 KiB. */
tl_status tl_csv_open_live(const tl_csv_settings *settings, tl_plant_io **io, tl_error *error);

#endif
