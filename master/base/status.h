/* Status codes, error texts and reports of many problems.
 *
 * Purpose: every failure in twinlock is a returned tl_status with a text: what failed, where, and
 *          what to do. Library code in board/ and master/ never prints or exits.
 * Owner:   the caller owns tl_error and tl_report; nothing is allocated.
 * Thread:  no shared state; one thread at a time uses an object.
 */
#ifndef TL_MASTER_BASE_STATUS_H
#define TL_MASTER_BASE_STATUS_H

#include <stddef.h>

#if defined(__GNUC__)
#define TL_PRINTF(format_index, first_argument) __attribute__((format(printf, format_index, first_argument)))
#else
#define TL_PRINTF(format_index, first_argument)
#endif

typedef enum tl_status {
    TL_OK = 0,
    TL_BAD_USAGE,   /* the command line is wrong */
    TL_BAD_DATA,    /* a configuration, recording or FMU file is wrong */
    TL_PLANT_DOWN,  /* plant I/O cannot be opened or read */
    TL_FMU_FAILED,  /* an FMU returned an error */
    TL_FMU_FATAL,   /* an FMU returned fmi2Fatal: none of its functions may be called again */
    TL_TRY_AGAIN,   /* a resource is not available now: disk, memory, file lock, port */
    TL_INTERRUPTED, /* the user or the system asked to stop */
    TL_NOT_LOCKED   /* all was done, but the twin was not in lock as required */
} tl_status;

enum { TL_ERROR_TEXT = 512 }; /* bytes */

/* One failure. `text` is one sentence in English, without a full stop and without a newline. */
typedef struct tl_error {
    tl_status status;
    char text[TL_ERROR_TEXT];
} tl_error;

/* Sets `error` (which may be NULL) and returns `status`, so that a function can end with `return
 * tl_fail(…)`. */
tl_status tl_fail(tl_error *error, tl_status status, const char *format, ...) TL_PRINTF(3, 4);

/* Collects every problem of one configuration. `add` is called once per problem and may be NULL;
 * `where` is the JSON path of the item ("connect[2][0]"), or "". Both texts are valid only during
 * the call. */
typedef struct tl_report {
    void (*add)(void *context, tl_status status, const char *where, const char *text);
    void *context;
    size_t count;           /* problems so far; 0: none */
    tl_status first_status; /* of the first problem; TL_OK if there is none */
} tl_report;

/* Adds one problem to the report and calls `add`. `where` NULL: "". */
void tl_report_add(tl_report *report, tl_status status, const char *where, const char *format, ...) TL_PRINTF(4, 5);

/* The process exit code for a status: 0 done, 2 usage, 3 not in lock, 65 data, 69 plant I/O, 70
 * FMU, 75 try again or interrupted. */
int tl_exit_code(tl_status status);

#endif
