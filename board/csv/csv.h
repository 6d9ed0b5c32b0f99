/* CSV files of time-stamped rows: a reader of recordings, and a plant driver.
 *
 * Purpose: tl_csv_reader reads a recording row by row (`twinlock replay`, `plant`). tl_csv_driver
 *          plays a file in real time, or reads a file or FIFO while another program writes it
 *          (thesis 5.4.2). It converts row times to stamps of CLOCK_MONOTONIC.
 * Format:  see docs/reference/files.md, "Recordings": UTF-8; the reader also takes gzip, UTF-16 and
 *          folders of files (csv_file.h). A header row; commas, semicolons or tabs
 *          separate the cells: the first of these by which all columns are found. A row of units
 *          may follow. One column is the time (csv_time.h). An empty cell means "no new value".
 *          Cells may be quoted and have spaces around them; lines end with LF or CRLF. A UTF-8 byte
 *          order mark, blank lines and other columns are ignored. Numbers are decimal, with a
 *          point, or with a comma if commas do not separate cells; a file has one of them. TRUE and
 *          FALSE are 1 and 0.
 * Thread:  one per reader; for the driver see plant_io.h.
 */
#ifndef TL_BOARD_CSV_CSV_H
#define TL_BOARD_CSV_CSV_H

#include "board/csv/csv_table.h"
#include "board/io/plant_access.h"
#include "board/io/plant_io.h"

/* ---- rows of a file ---- */

typedef struct tl_csv_reader tl_csv_reader;

/* Opens a file and reads its header. If the path is a folder, its files are read one after the
 * other, as one; each has a header. Copies all settings. The caller closes the reader. Errors:
 * TL_BAD_DATA: those of csv_file.h; the file is empty; a requested column is missing (the text
 * lists the existing ones) or occurs twice; the file is compressed, but not by gzip; a quote is not
 * closed; the header exceeds 64 KiB; or more than TL_MAX_SIGNALS columns are
 * requested. TL_TRY_AGAIN: out of memory or descriptors. */
tl_status tl_csv_open(const tl_csv_settings *settings, tl_csv_reader **reader, tl_error *error);

/* Reads the next row. At the end of the file, sets *end to true and leaves *row unchanged. Waits if
 * the file is a FIFO. Of two rows with one time, as at an event of a simulation, the later counts
 * in the cells that it has; rows of a FIFO are not merged. Errors: TL_BAD_DATA: the time cannot be
 * read, has another form than the first one, is beyond ±4.6e9 s or before that of the last row;
 * more than four rows have one time; the number of cells is wrong; a quote is not closed; the line
 * exceeds 64 KiB; or the file cannot be read. */
tl_status tl_csv_next(tl_csv_reader *reader, tl_csv_row *row, bool *end, tl_error *error);

/* How the rows read so far are written. */
typedef struct tl_csv_form {
    char text[TL_CSV_FORM + 16]; /* of tl_csv_file_form() and tl_csv_table_describe() */
    tl_csv_clock clock;          /* of the times */
    int64_t merged;              /* rows with the time of the row before */
    size_t files;
} tl_csv_form;

tl_csv_form tl_csv_get_form(const tl_csv_reader *reader);

/* Closes the file and frees the reader. NULL is allowed. */
void tl_csv_close(tl_csv_reader *reader);

/* ---- the columns of a file ---- */

enum { TL_CSV_COLUMNS = 256 }; /* further ones are ignored */

/* Names and units of the columns; the texts belong to the struct. */
typedef struct tl_csv_columns {
    char *names[TL_CSV_COLUMNS];
    char *units[TL_CSV_COLUMNS]; /* of a row of units; "": none */
    size_t count;
    size_t time; /* index of the time column: one whose name says so, else the first one */
    char *lines[2];
} tl_csv_columns;

/* Reads the header of a file, and the row of units if one follows. The caller releases the columns,
 * also after an error. Errors: those of tl_csv_open(). */
tl_status tl_csv_columns_read(const char *path, tl_csv_columns *columns, tl_error *error);

void tl_csv_columns_release(tl_csv_columns *columns);

/* ---- the driver ---- */

extern const tl_plant_io_driver tl_csv_driver;
extern const tl_plant_access tl_csv_access; /* allows nothing besides the files of its sources */

/* Creates a driver that reads a file or FIFO live. Copies the settings; the first poll opens the
 * path without blocking. If the path does not exist, the link is down and each poll tries again.
 * Regular file: the driver posts the first row when it reads it, and each further row when it is
 *               due by its time. If the file grows, is truncated or is replaced, a program writes
 *               it, as `tail -F` assumes. From then on the driver skips the rows that the file had
 *               at first, and posts new ones as they arrive. In a truncated or new file it skips
 *               rows up to the time of the last used row; if there are only such rows, the writer
 *               has restarted. A line is used when its line end has arrived. If no row comes for
 *               2 s and for 10 times the distance of the last two rows, the driver reports the
 *               silence once.
 * FIFO: the driver posts rows as they arrive; a poll without a row waits up to 50 ms. The link is
 *       down while no process writes to the FIFO.
 * Stamp = row time + anchor. The first row sets the anchor so that its stamp is its time of
 * arrival. The first row after a restart of the writer sets it again. A restart is: the writer
 * closed the FIFO, repeated its header, or set its time back for two consecutive rows. These two
 * rows are posted too. No stamp is later than the arrival. If the clocks drift apart, the driver
 * corrects the anchor once a minute (csv_live.h).
 * The driver skips malformed rows, lines before a header, and lines longer than 64 KiB. It reports
 * them to part_failed() (or link(), while the link is down), at most once per second.
 * Errors: TL_BAD_DATA for too many columns; TL_TRY_AGAIN if memory or a descriptor is missing. */
tl_status tl_csv_open_live(const tl_csv_settings *settings, tl_plant_io **io, tl_error *error);

#endif
