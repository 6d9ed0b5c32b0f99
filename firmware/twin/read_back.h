/* Read-back test: checks whether another process can load the saved states of a twin's FMUs, before
 * checkpoints rely on it.
 *
 * Purpose: the FMU process writes its states and the expected results
 *          (master/twin/twin_read_back.h) into a shared block. On its request the parent starts a
 *          *reader*: a second process with the same FMUs. The reader loads one component after the
 *          other and writes the results into the same block. If the reader ends while it loads a
 *          component, another one is started for the remaining components.
 * Trust:   both processes run the same FMUs, which can write to the block. The parent uses only the
 *          exit status of the reader.
 * Thread:  the FMU thread, in either process. Errors: none; a failed test is an outcome.
 */
#ifndef TL_FIRMWARE_TWIN_READ_BACK_H
#define TL_FIRMWARE_TWIN_READ_BACK_H

#include <stdbool.h>
#include <stddef.h>

#include "firmware/store/run_types.h"
#include "firmware/twin/assembly.h"

enum {
    TL_READ_BACK_BYTES = 64 << 20, /* size of the block, 64 MiB; only used pages take memory */
    TL_READ_BACK_TEXT = 512        /* bytes of a text with its NUL */
};

/* Outcome of a component's whole test; tl_read_back_outcome is that in one process. */
typedef enum tl_saved_state_outcome {
    TL_READ_BACK_UNKNOWN,    /* not tested, or not completely */
    TL_READ_BACK_IS_EXACT,   /* after loading, the same inputs give the same values */
    TL_READ_BACK_ENDS,       /* the reader ended while it loaded the state, or was killed because that took too long */
    TL_READ_BACK_IS_REFUSED, /* loading the state, or a step after it, failed */
    TL_READ_BACK_IS_OTHER,   /* after loading, the same inputs give other values */
    TL_READ_BACK_NOT_REPEATABLE /* a rollback already differs or fails in the process that saved; no reader was tried */
} tl_saved_state_outcome;

/* Result for one component. */
typedef struct tl_read_back_component {
    tl_saved_state_outcome finding;
    char text[TL_READ_BACK_TEXT]; /* the cause: a sentence about the component, without its name; "": none */
} tl_read_back_component;

typedef struct tl_read_back_report {
    bool is_tried; /* the test was started */
    bool is_exact; /* the test was started, and all components are exact */
    size_t count;  /* number of components in `of` */
    tl_read_back_component of[TL_RECORDER_COMPONENTS];
} tl_read_back_report;

/* Access to the parent. `start_reader` requests a reader and returns when the reader has ended:
 * TL_OK if it ended as expected; else `error` describes how it ended. */
typedef struct tl_read_back_host {
    tl_status (*start_reader)(void *context, tl_error *error);
    void *context;
    void *block; /* TL_READ_BACK_BYTES bytes */
} tl_read_back_host;

/* Runs the test in the FMU process between two ticks; the twin is unchanged afterwards. If `host`
 * is NULL or the twin cannot save its state, nothing is tested. */
void tl_read_back_run(const tl_assembly *assembly, const tl_read_back_host *host, tl_read_back_report *report);

/* Returns true if this outcome proves that a checkpoint of the component cannot be used. */
bool tl_read_back_prevents_resume(tl_saved_state_outcome finding);

/* Returns the text for an outcome that is not exact, such as "ends the process that loads it". */
const char *tl_read_back_text(tl_saved_state_outcome finding);

/* Runs in the reader, after its twin was built: loads the states and writes the results. Errors:
 * the FMUs could not be initialised. */
tl_status tl_read_back_run_reader(const tl_assembly *assembly, void *block, tl_error *error);

#endif
