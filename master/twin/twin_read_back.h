/* Test of serialised states in another process: the data that one process writes and the other
 * checks.
 *
 * Purpose: a checkpoint is read by a process without the FMU's memory, but the bytes of some FMUs
 *          contain addresses or are not complete. So a twin writes its states, and the inputs and
 *          outputs of each component in the next steps. Another twin of the same configuration, in
 *          its own process, loads each state and executes the same inputs. Every exchanged output
 *          must have the same bits. As a control the first twin restores its own states in memory:
 *          a difference there says nothing about the bytes.
 * Inputs:  adjusted variables move by the first step of their search; other inputs are those of the
 *          run.
 * Bytes:   for another process of this program on this machine. The reader trusts nothing in them.
 * Thread:  the twin's. Memory: none of its own.
 */
#ifndef TL_MASTER_TWIN_TWIN_READ_BACK_H
#define TL_MASTER_TWIN_TWIN_READ_BACK_H

#include <stddef.h>

#include "master/twin/twin.h"

/* Steps of each component. If an FMU rejects a later step, there are fewer: that says nothing about
 * its state. */
enum { TL_READ_BACK_STEPS = 10 };

typedef enum tl_read_back_outcome {
    TL_READ_BACK_EXACT,   /* the same bits in all steps */
    TL_READ_BACK_REFUSED, /* by an error of the FMU, or because the bytes are invalid */
    TL_READ_BACK_DIFFERS
} tl_read_back_outcome;

/* Result of one component. */
typedef struct tl_read_back {
    tl_read_back_outcome outcome;
    tl_error error;       /* REFUSED */
    const char *variable; /* DIFFERS: an output */
    unsigned after;       /* steps since the state, 1 … TL_READ_BACK_STEPS */
    double first;         /* value in the writer */
    double again;         /* value in the reader */
} tl_read_back;

/* Writes the states between two ticks of a twin that tl_twin_save() could save; it is left where it
 * is. *size: bytes written; above `capacity` they did not fit and are invalid; 0: an FMU would have
 * to be executed again. `here`: the control for each component. Errors: those of tl_twin_save(). */
tl_status tl_twin_write_states(tl_twin *twin, unsigned char *bytes, size_t capacity, size_t *size, tl_read_back *here,
                               tl_error *error);

/* Initialises the FMUs of a new twin as a warm restart does, with an unknown plant. Without this
 * call they are only instantiated. */
tl_status tl_twin_prepare_reader(tl_twin *twin, tl_error *error);

/* Loads one component's state and executes its steps. Afterwards the twin can only be used for
 * this. */
void tl_twin_read_state(tl_twin *twin, const unsigned char *bytes, size_t size, size_t component, tl_read_back *read);

#endif
