/* Whether states that FMUs have turned into bytes are read back by another process: what the one says and the other looks for.
 *
 * Purpose: a checkpoint is of use only to a process that does not have the FMU's memory, and there are FMUs whose bytes hold places of that memory, or
 *          leave something out. So a twin tells its states, what each component is given in the next steps, and what it gives; another one of the same
 *          configuration, in a process of its own, reads each of them and is led by the same. The same bits at each output that is exchanged, or not.
 *          As control the twin that tells goes back itself, by the states as they are: what differs there says nothing about bytes.
 * Inputs:  of adjusted variables by the first step of their search around what they are; the others as they come.
 * Bytes:   for another process of this program on this machine; who reads them trusts nothing in them.
 * Thread:  the twin's. Memory: none of its own.
 */
#ifndef TL_MASTER_TWIN_TWIN_READ_BACK_H
#define TL_MASTER_TWIN_TWIN_READ_BACK_H

#include <stddef.h>

#include "master/twin/twin.h"

/* Of each component. An FMU that refuses a later one has no more of them: that says nothing about its state. */
enum { TL_READ_BACK_STEPS = 10 };

typedef enum tl_read_back_outcome {
    TL_READ_BACK_EXACT,   /* the same bits in all steps */
    TL_READ_BACK_REFUSED, /* by an error of the FMU; or the bytes are none */
    TL_READ_BACK_DIFFERS
} tl_read_back_outcome;

/* Of one component. */
typedef struct tl_read_back {
    tl_read_back_outcome outcome;
    tl_error error;       /* REFUSED */
    const char *variable; /* DIFFERS: an output, */
    unsigned after;       /* so many steps after the state, 1 … TL_READ_BACK_STEPS */
    double first;         /* of who has told, */
    double again;         /* and of who has read */
} tl_read_back;

/* Between two ticks of a twin that tl_twin_save() could save, which stays where it is. *size: what was told; above `capacity` it did not fit, and is of no
 * use; 0: an FMU would have to be executed again to be where the twin is. `here`: the control, of each component. Errors: those of tl_twin_save(). */
tl_status tl_twin_tell_states(tl_twin *twin, unsigned char *bytes, size_t capacity, size_t *size, tl_read_back *here,
                              tl_error *error);

/* A twin that has not begun: its FMUs are initialised as by a warm restart, with a plant of which nothing is known. Left out, they are as they were
 * instantiated. */
tl_status tl_twin_begin_to_read(tl_twin *twin, tl_error *error);

/* One component reads what was told of it, and is led on. The twin is of no use but for this afterwards. */
void tl_twin_read_state(tl_twin *twin, const unsigned char *bytes, size_t size, size_t component, tl_read_back *read);

#endif
