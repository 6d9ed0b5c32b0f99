/* What an FMU was given from its beginning to its first step: start values, the experiment, its initialisation, and what was asked of it meanwhile.
 *
 * Purpose: after a reset it is given all of that again, in the same order and with the same values, and then stands where it stood.
 * Memory:  one block that grows; what was kept is dropped by tl_fmu_prologue_begin(), and its room used again. Texts and references are copied.
 * Errors:  if memory is out, what is kept is not whole (`is_cut`), and cannot be given again.
 * Thread:  that of the FMUs.
 */
#ifndef TL_FIRMWARE_ROLLBACK_FMU_PROLOGUE_H
#define TL_FIRMWARE_ROLLBACK_FMU_PROLOGUE_H

#include <stdbool.h>
#include <stddef.h>

#include "master/fmi/fmi2.h"

typedef enum tl_fmu_prologue_kind {
    TL_PROLOGUE_SET_REAL,
    TL_PROLOGUE_SET_INTEGER,
    TL_PROLOGUE_SET_BOOLEAN,
    TL_PROLOGUE_SET_STRING,
    TL_PROLOGUE_GET_REAL,
    TL_PROLOGUE_GET_INTEGER,
    TL_PROLOGUE_GET_BOOLEAN,
    TL_PROLOGUE_SETUP, /* one value of type tl_fmu_setup */
    TL_PROLOGUE_ENTER_INITIALIZATION,
    TL_PROLOGUE_EXIT_INITIALIZATION
} tl_fmu_prologue_kind;

/* Arguments of fmi2SetupExperiment. */
typedef struct tl_fmu_setup {
    fmi2Real tolerance, start, stop;
    fmi2Boolean has_tolerance, has_stop;
} tl_fmu_setup;

/* Zeroed: nothing is kept. */
typedef struct tl_fmu_prologue {
    unsigned char *bytes; /* private: calls one behind the other */
    size_t used, room;
    double *place; /* for values that are got, or pointers to texts: as many as a call has at most */
    size_t most;
    bool is_cut;
} tl_fmu_prologue;

/* From the beginning. */
void tl_fmu_prologue_begin(tl_fmu_prologue *prologue);

/* A call that was made. `references` and `values` as in FMI, of `count`; of a get there are no values. */
void tl_fmu_prologue_add(tl_fmu_prologue *prologue, tl_fmu_prologue_kind kind, const fmi2ValueReference *references,
                         size_t count, const void *values);

/* All calls again, to `instance` by `functions`, until one is not well: its status. fmi2Error if they are not all kept. Takes no memory. */
fmi2Status tl_fmu_prologue_play(const tl_fmu_prologue *prologue, const tl_fmi2 *functions, fmi2Component instance);

/* Gives the memory back. */
void tl_fmu_prologue_end(tl_fmu_prologue *prologue);

#endif
