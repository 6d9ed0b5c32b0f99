/* Read-back test of serialised states: one process writes them, another process loads and tests
 * them.
 *
 * Purpose: a checkpoint is loaded by a new process. But the serialised states of some FMUs contain
 *          memory addresses or are incomplete. So a twin writes its states, and the inputs and
 *          outputs of each component in the next steps. Another twin of the same configuration, in
 *          its own process, loads each state and executes the steps with the same inputs. Every
 *          exchanged output must have the same bits. As a control, the first twin does the same
 *          with its states in memory. If the control fails, the test says nothing about the bytes.
 *          Of 35 public FMUs 13 were exact, 19 failed the control too, and 3 ended the process.
 * Inputs:  adjusted variables move by the first step of their search; other inputs are those of the
 *          run.
 * Bytes:   only for another process of the same program on the same machine. The reader validates
 *          them.
 * Thread:  the twin's. Memory: allocates none.
 */
#ifndef TL_MASTER_TWIN_TWIN_READ_BACK_H
#define TL_MASTER_TWIN_TWIN_READ_BACK_H

#include <stddef.h>

#include "master/twin/twin.h"

/* Number of steps of each component. If an FMU rejects a later step, only the steps before it
 * count, because this is no fault of the state. */
enum { TL_READ_BACK_STEPS = 10 };

typedef enum tl_read_back_outcome {
    TL_READ_BACK_EXACT,   /* the same bits in all steps */
    TL_READ_BACK_REFUSED, /* the FMU returned an error, or the bytes are invalid */
    TL_READ_BACK_DIFFERS  /* an output differs */
} tl_read_back_outcome;

/* Result of one component. */
typedef struct tl_read_back {
    tl_read_back_outcome outcome;
    tl_error error;       /* only if REFUSED */
    const char *variable; /* only if DIFFERS, like the next three: the output */
    unsigned after;       /* number of steps since the loaded state, 1 … TL_READ_BACK_STEPS */
    double first;         /* value when the state was written */
    double again;         /* value after the state was loaded (control: restored) */
} tl_read_back;

/* Writes the states of a twin that tl_twin_save() could save, between two ticks. Afterwards the
 * twin is in its old state. *size: number of bytes; if it is above `capacity`, the bytes are
 * invalid. 0: an FMU would have to be executed again, or the twin has not started. `here`: results
 * of the control, one per component. Errors: those of tl_twin_save(). */
tl_status tl_twin_write_states(tl_twin *twin, unsigned char *bytes, size_t capacity, size_t *size, tl_read_back *here,
                               tl_error *error);

/* Initialises the FMUs of a new twin as a restart from a checkpoint does. The samples of the plant
 * have quality TL_NO_LINK. Without this call the FMUs are only instantiated. */
tl_status tl_twin_prepare_reader(tl_twin *twin, tl_error *error);

/* Loads one component's state and executes its steps. Afterwards only this function and
 * tl_twin_destroy() may be called for the twin. */
void tl_twin_read_state(tl_twin *twin, const unsigned char *bytes, size_t size, size_t component, tl_read_back *read);

#endif
