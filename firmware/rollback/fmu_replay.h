/* A rollback that needs nothing of an FMU: it is reset, and given again what it was given.
 *
 * Purpose: for one that has no states, or wrong ones, and whose memory cannot be copied. Each call that was made is noted here: until the first step by
 *          fmu_prologue.h, from then on by fmu_history.h. A state is a position in that, and costs no memory of its own.
 * Exact:   if the FMU does the same again when it is given the same again. What calls gave is held against what they give again, and a difference ends the
 *          replay (`is_over`).
 * Cost:    of a way back, the steps from the beginning on, or none if it stands on the way.
 * Memory:  taken once, at the first position that is kept or step that is noted, or before.
 * Thread:  that of the FMUs.
 */
#ifndef TL_FIRMWARE_ROLLBACK_FMU_REPLAY_H
#define TL_FIRMWARE_ROLLBACK_FMU_REPLAY_H

#include "firmware/rollback/fmu_history.h"
#include "firmware/rollback/fmu_prologue.h"
#include "master/fmi/component.h"
#include "master/fmi/fmi2.h"

typedef enum tl_fmu_replay_phase {
    TL_FMU_REPLAY_BEGINS, /* what it is given is its prologue's */
    TL_FMU_REPLAY_WAITS,  /* it stands at the end of that, and goes on by another way: nothing is noted */
    TL_FMU_REPLAY_NOTES,
    TL_FMU_REPLAY_PLAYS
} tl_fmu_replay_phase;

/* Zeroed and with `most`: one that begins. */
typedef struct tl_fmu_replay {
    uint32_t most;                               /* steps to where it can be led back */
    tl_fmi2_replay *told;                        /* to the caller of the table */
    const tl_fmi2 *functions;                    /* that calls are made by again, */
    fmi2Component instance;                      /* of this one */
    fmi2Status (*reset)(fmi2Component instance); /* leads it to where it can be initialised */
    const tl_ports *inputs;                      /* that steps set, */
    const tl_ports *outputs;                     /* and read; NULL: not known yet */
    tl_fmu_replay_phase phase;                   /* private, from here on */
    tl_fmu_prologue prologue;
    tl_fmu_history history;
    uint64_t *scratch; /* values of the greatest call, as history has them, */
    double *place;     /* and as FMI has them */
} tl_fmu_replay;

void tl_fmu_replay_end(tl_fmu_replay *replay);

/* It was instantiated or reset: what comes is its prologue. */
void tl_fmu_replay_begin(tl_fmu_replay *replay);

/* The prologue is complete; nothing more is noted, until it is led back here. */
void tl_fmu_replay_wait(tl_fmu_replay *replay);

/* After that, or while it begins: from here on all is noted, and states are positions. fmi2Error: not enough memory, or what steps set is not known. */
fmi2Status tl_fmu_replay_start(tl_fmu_replay *replay);

/* A call was made, and how it went. `values` as in FMI, of the kind; also of what was got. */
void tl_fmu_replay_note(tl_fmu_replay *replay, tl_fmu_prologue_kind kind, const fmi2ValueReference *references,
                        size_t count, const void *values, fmi2Status status);
void tl_fmu_replay_note_step(tl_fmu_replay *replay, const tl_fmi2_step *step, fmi2Status status);

/* States. */
fmi2Status tl_fmu_replay_keep(tl_fmu_replay *replay, fmi2FMUstate *state);
fmi2Status tl_fmu_replay_lead(tl_fmu_replay *replay, fmi2FMUstate state);
void tl_fmu_replay_give_back(tl_fmu_replay *replay, fmi2FMUstate *state);

/* To the end of its prologue, after tl_fmu_replay_start(). */
fmi2Status tl_fmu_replay_lead_to_beginning(tl_fmu_replay *replay);

#endif
