/* An emulated plant stream: CSV rows into a file or a FIFO.
 *
 * Purpose: what `twinlock plant` lets a live CSV source read.
 * FIFO:    rows are dropped while nobody reads. Each reader is sent the header first; one that takes the place of
 *          another between two rows cannot be told from it, and is not.
 * File:    must not exist yet: a recording is never overwritten.
 * Bound:   a row costs at most 50 ms: one that cannot be written by then is dropped, as a whole, and counted.
 * Thread:  one at a time. open() makes the process ignore SIGPIPE.
 */
#ifndef TL_FIRMWARE_CLI_PLANT_STREAM_H
#define TL_FIRMWARE_CLI_PLANT_STREAM_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "master/base/simtime.h"
#include "master/base/status.h"

typedef struct tl_plant_stream_settings {
    const char *path;
    bool make_fifo; /* where the path does not exist: a FIFO, else a file */
    const char *time_column;
    const char *const *columns;
    size_t column_count; /* TL_MAX_SIGNALS at most */
} tl_plant_stream_settings;

typedef struct tl_plant_stream_counts {
    uint64_t written;
    uint64_t dropped;
} tl_plant_stream_counts;

typedef struct tl_plant_stream tl_plant_stream;

/* Copies what it needs; does not wait for a reader. Errors: TL_BAD_DATA where the path cannot be written, or is a
 * file that exists; TL_TRY_AGAIN where memory is out, or the disk is full. */
tl_status tl_plant_stream_open(const tl_plant_stream_settings *settings, tl_plant_stream **stream, tl_error *error);

/* One row: a value per column, empty where `present` (which may be NULL: all are) is false or the value is not
 * finite. false where it was dropped. */
bool tl_plant_stream_row(tl_plant_stream *stream, tl_time time, const double *values, const bool *present);

/* TL_TRY_AGAIN where a file could not be written, for example on a full disk. A FIFO that nobody reads is no failure:
 * its rows are dropped. */
tl_status tl_plant_stream_check(const tl_plant_stream *stream, tl_error *error);

tl_plant_stream_counts tl_plant_stream_count(const tl_plant_stream *stream);

/* Removes nothing. */
void tl_plant_stream_close(tl_plant_stream *stream);

#endif
