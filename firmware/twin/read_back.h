/* Read-back test: checks whether another process can load the saved states of a twin's FMUs, before
 * checkpoints rely on it.
 *
 * Purpose: the FMU process writes its states and the expected results
 *          (master/twin/twin_read_back.h) into a shared block. Its parent starts a second process
 *          with the same FMUs. That process loads one component after the other and writes the
 *          results into the same block. If that process ends while it loads a component, the parent
 *          starts another one for the remaining components.
 * Trust:   both processes run the same FMUs, which can write to the block. The parent uses only the
 *          exit status.
 * Thread:  the FMU thread, in either process.
 * Errors:  a failed test is an outcome, not an error.
 */
#ifndef TL_FIRMWARE_TWIN_READ_BACK_H
#define TL_FIRMWARE_TWIN_READ_BACK_H

#include <stdbool.h>
#include <stddef.h>

#include "firmware/store/run_types.h"
#include "firmware/twin/assembly.h"

enum {
    TL_READ_BACK_BYTES = 64 << 20, /* size of the block; only used pages take memory */
    TL_READ_BACK_TEXT = 512
};

typedef enum tl_saved_state_outcome {
    TL_READ_BACK_UNKNOWN, /* not tested, or not completely */
    TL_READ_BACK_IS_EXACT,
    TL_READ_BACK_ENDS,       /* the process that loads it ended, or was killed because loading took too long */
    TL_READ_BACK_IS_REFUSED, /* loading the state, or a step after it, failed */
    TL_READ_BACK_IS_OTHER,   /* after loading, the same inputs give other values */
    TL_READ_BACK_NOT_REPEATABLE /* a rollback in the saving process already differs or fails, so another process cannot be tested */
} tl_saved_state_outcome;

/* Of one component. */
typedef struct tl_read_back_component {
    tl_saved_state_outcome finding;
    char text[TL_READ_BACK_TEXT]; /* the cause: a sentence about the component, without its name; "": none */
} tl_read_back_component;

typedef struct tl_read_back_report {
    bool is_tried; /* the test was started */
    bool is_exact; /* all components are exact */
    size_t count;
    tl_read_back_component of[TL_RECORDER_COMPONENTS];
} tl_read_back_report;

/* Request to the parent: `start_reader` starts another process and returns when that has ended.
 * TL_OK: it ended as expected; else the error says how it ended. */
typedef struct tl_read_back_host {
    tl_status (*start_reader)(void *context, tl_error *error);
    void *context;
    void *block; /* TL_READ_BACK_BYTES bytes */
} tl_read_back_host;

/* Runs the test in the FMU process between two ticks; the twin is unchanged afterwards. If `host`
 * is NULL or the twin cannot save its state, nothing is tested. */
void tl_read_back_run(const tl_assembly *assembly, const tl_read_back_host *host, tl_read_back_report *report);

/* Returns true if a checkpoint of a component with this outcome cannot be used. */
bool tl_read_back_prevents_resume(tl_saved_state_outcome finding);

/* Text for a bad outcome, for example "ends the process that loads it". */
const char *tl_read_back_text(tl_saved_state_outcome finding);

/* Runs in the second process, whose twin is built: loads the states and writes the results. Errors:
 * the FMUs could not be initialised. */
tl_status tl_read_back_run_reader(const tl_assembly *assembly, void *block, tl_error *error);

#endif
