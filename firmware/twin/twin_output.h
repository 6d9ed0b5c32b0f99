/* What a process with FMUs prints, on its way to our log: a thread that nobody waits for who watches the process.
 *
 * Purpose: the log may be a terminal that was stopped, or a pipe that nobody reads. What waits for its reader is this thread alone, and for
 *          TL_TWIN_OUTPUT_PATIENCE at most: what is not taken until then is left out and counted.
 * Bounds:  of lines, and apart of those that say their level (our own, or so they say), as many bytes as an honest FMU has ever printed, and a few
 *          per second for those that live long. What exceeds is left out: that is said once, and how many lines it were when all ends. The page of
 *          a check has a length that no honest one has.
 * Marks:   a line of an FMU begins with "fmu: ", so that it is no line of ours. One that begins with "<3>" to "<7>" is taken for ours: both come from
 *          one process, so an FMU can forge that.
 * Thread:  start and stop from one; the rest from any.
 */
#ifndef TL_FIRMWARE_TWIN_TWIN_OUTPUT_H
#define TL_FIRMWARE_TWIN_TWIN_OUTPUT_H

#include <stdbool.h>
#include <stdio.h>

#include "master/base/status.h"

enum {
    TL_TWIN_OUTPUT_PATIENCE = 2000,     /* ms */
    TL_TWIN_OUTPUT_MOST = 32 << 20,     /* bytes at once, */
    TL_TWIN_OUTPUT_RATE = 16 << 10,     /* and per second */
    TL_TWIN_OUTPUT_PAGE_MOST = 64 << 20 /* bytes */
};

typedef struct tl_twin_output tl_twin_output;

typedef struct tl_twin_output_settings {
    int output; /* what it prints: a pipe, ours from now on, */
    int page;   /* and this, which goes to `page_file`; -1: none */
    FILE *page_file;
    void (*speak)(void *context); /* in the thread, when it is woken, and at the end: says what else there is to say */
    void (*ended)(void *context); /* in any thread: it ends, or has closed what it was given */
    void *context;
} tl_twin_output_settings;

/* The descriptors are its own on failure too. Errors: TL_TRY_AGAIN. */
tl_status tl_twin_output_start(const tl_twin_output_settings *settings, tl_twin_output **output, tl_error *error);

/* There is something to say. */
void tl_twin_output_wake(const tl_twin_output *output);

/* All that was printed until now has been passed on, or left out. */
void tl_twin_output_flush(tl_twin_output *output);

/* The page is longer than TL_TWIN_OUTPUT_PAGE_MOST. */
bool tl_twin_output_page_is_too_long(const tl_twin_output *output);

/* Passes on what is left, and ends the thread. NULL is allowed. */
void tl_twin_output_stop(tl_twin_output *output);

#endif
