/* Emulated plant stream: writes CSV rows into a file or a FIFO.
 *
 * Purpose: `twinlock plant` writes the rows that a live CSV source reads.
 * FIFO:    rows are dropped while there is no reader. Each new reader first gets the header. Limit:
 *          a reader that replaces another one between two rows is not detected and gets no header.
 * File:    must not exist yet, so that no recording is overwritten. The header is written first.
 * Bound:   a row takes at most 50 ms. If it cannot be written by then, the whole row is dropped and
 *          counted.
 * Thread:  one thread at a time. open() makes the process ignore SIGPIPE.
 */
#ifndef TL_FIRMWARE_CLI_PLANT_STREAM_H
#define TL_FIRMWARE_CLI_PLANT_STREAM_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "master/base/simtime.h"
#include "master/base/status.h"

typedef struct tl_plant_stream_settings {
    const char *path;           /* of the file or FIFO */
    bool make_fifo;             /* if the path does not exist: true creates a FIFO, false a file */
    const char *time_column;    /* name of the column with the time */
    const char *const *columns; /* names of the other columns */
    size_t column_count;        /* at most TL_MAX_SIGNALS */
} tl_plant_stream_settings;

/* Numbers of rows. */
typedef struct tl_plant_stream_counts {
    uint64_t written;
    uint64_t dropped;
} tl_plant_stream_counts;

typedef struct tl_plant_stream tl_plant_stream;

/* Opens the stream; copies the settings and does not wait for a reader. Errors: TL_BAD_DATA if the
 * path cannot be written, or is an existing file; TL_TRY_AGAIN if memory is out or the disk is
 * full. */
tl_status tl_plant_stream_open(const tl_plant_stream_settings *settings, tl_plant_stream **stream, tl_error *error);

/* Writes one row: `time` (ns; the cell is in s), and a value per column. A cell is empty if
 * `present` is false for it or its value is not finite. `present` NULL: all values are present.
 * Returns false if the row was dropped. */
bool tl_plant_stream_row(tl_plant_stream *stream, tl_time time, const double *values, const bool *present);

/* Returns an error if an earlier write has failed. Errors: TL_TRY_AGAIN if a file could not be
 * written, for example because the disk is full. Dropped rows of a FIFO without a reader are not an
 * error. */
tl_status tl_plant_stream_check(const tl_plant_stream *stream, tl_error *error);

/* Returns the counts of rows since open(). */
tl_plant_stream_counts tl_plant_stream_count(const tl_plant_stream *stream);

/* Closes the stream. Does not remove the file or FIFO. */
void tl_plant_stream_close(tl_plant_stream *stream);

#endif
