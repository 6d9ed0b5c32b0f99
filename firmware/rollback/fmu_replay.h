/* Rollback by replay: an FMU is reset and gets its inputs again.
 *
 * Thread:  the one that calls the FMU.
 */
#ifndef TL_FIRMWARE_ROLLBACK_FMU_REPLAY_H
#define TL_FIRMWARE_ROLLBACK_FMU_REPLAY_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "master/base/status.h"
#include "master/fmi/component.h"
#include "master/fmi/fmi2.h"

/* ---- What an FMU was given from its beginning to its first step: start values, the experiment, its initialisation, and what was asked of it meanwhile.
 *
 * Purpose: after a reset it is given all of that again, in the same order and with the same values, and then stands where it stood.
 * Memory:  a list of calls, with copies of their values, texts and references, until tl_fmu_prologue_end().
 * Errors:  if memory is out, what is kept is not whole (`is_cut`), and cannot be given again.
 * Thread:  that of the FMUs.
 */

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
    struct tl_fmu_prologue_call *first, *last; /* private */
    bool is_cut;
} tl_fmu_prologue;

/* A call that was made. `references` and `values` as in FMI, of `count`; of a get there are no values. */
void tl_fmu_prologue_add(tl_fmu_prologue *prologue, tl_fmu_prologue_kind kind, const fmi2ValueReference *references,
                         size_t count, const void *values);

/* All calls again, to `instance` by `functions`, until one is not well: its status. fmi2Error if they are not all kept. Takes no memory. */
fmi2Status tl_fmu_prologue_play(const tl_fmu_prologue *prologue, const tl_fmi2 *functions, fmi2Component instance);

/* Drops all calls: it is zeroed. */
void tl_fmu_prologue_end(tl_fmu_prologue *prologue);

/* ---- What an FMU was given since its first step, on all branches that may still be wanted: a tree of calls.
 *
 * Purpose: a *position* is what an FMU was given so far. One that is kept can be come back to: reset, and given everything again on the way from the root to
 *          there; or from where the FMU stands, if that is on the way. This is the memory for it, and knows nothing of FMUs: fmu_replay.h makes the calls.
 * Freed:   a branch is given up once no position on it is kept and nothing stands there.
 * Limits:  a position of more than `most` steps is not kept, nor one for which there is no room: the FMU is *off* the tree then. It can be kept as
 *          long as it stays where it is.
 * Memory:  all of it is taken by tl_fmu_history_open().
 * Thread:  one at a time.
 */

/* Steps on branches beside the way to where it is, for which there is room too: what a search keeps at most, and what is kept of those before. */
enum { TL_FMU_HISTORY_BRANCHES = 4096 };

#define TL_FMU_HISTORY_NONE UINT32_MAX

/* A call, as its user numbers them. */
typedef struct tl_fmu_history_call {
    uint8_t kind;
    bool is_step;
    bool is_final;     /* of a step */
    double now, size;  /* of a step */
    uint64_t gave;     /* of a call that reads values: a mark of these */
    uint32_t steps;    /* since the root, this one included */
    uint32_t parent;   /* private, from here on */
    uint32_t next;     /* on the way that is played, or the next free one */
    uint32_t children; /* calls that follow it */
    uint32_t kept;     /* handles that lead here */
} tl_fmu_history_call;

/* Fields are private. Zeroed: not open. */
typedef struct tl_fmu_history {
    uint32_t most; /* steps */
    uint32_t call_count;
    size_t size; /* bytes of values that a call sets at most */
    tl_fmu_history_call *calls;
    unsigned char *values; /* of each call */
    uint32_t free_call;
    uint32_t root;
    uint32_t at;       /* NONE: off the tree */
    uint32_t off;      /* numbers the places off the tree */
    bool has_run_over; /* there was no room once */
} tl_fmu_history;

/* For `most` steps of `calls` calls at most, each of which sets up to `size` bytes of values. It stands at the root. Errors: TL_TRY_AGAIN. */
tl_status tl_fmu_history_open(tl_fmu_history *history, uint32_t most, uint32_t calls, size_t size, tl_error *error);
void tl_fmu_history_close(tl_fmu_history *history);

/* It stands at a root without a past. What was kept before is still to be given back, and leads nowhere. */
void tl_fmu_history_begin(tl_fmu_history *history);

/* A call was made from where it stands, which set `size` bytes of values. Then it stands behind it, or off the tree. */
void tl_fmu_history_add(tl_fmu_history *history, const tl_fmu_history_call *call, const void *values, size_t size);

/* Nobody knows where it stands: a call has failed. */
void tl_fmu_history_lose(tl_fmu_history *history);

/* Where it stands, to come back to; never NULL. To be given back. */
void *tl_fmu_history_keep(tl_fmu_history *history);
void tl_fmu_history_give_back(tl_fmu_history *history, void *kept);

/* Whether it stands there. */
bool tl_fmu_history_is_at(const tl_fmu_history *history, const void *kept);

/* The way there: the first call to be made again in *first (NONE: none), the one after it by tl_fmu_history_follow(). *anew: from the root, after a reset; else from where it
 * stands. False: there is none. */
bool tl_fmu_history_find_path(tl_fmu_history *history, const void *kept, uint32_t *first, bool *anew);

/* What this call of the way was, and the values that it set. Returns the next one, or NONE. */
uint32_t tl_fmu_history_follow(const tl_fmu_history *history, uint32_t call, const tl_fmu_history_call **made,
                               const void **values);

/* The way was gone to its end. */
void tl_fmu_history_arrive(tl_fmu_history *history, const void *kept);

/* ---- A rollback that needs nothing of an FMU: it is reset, and given again what it was given.
 *
 * Purpose: for one that has no states, or wrong ones, and whose memory cannot be copied. Each call that was made is noted here: until the first step by
 *          its prologue, from then on by its history. A state is a position in that, and costs no memory of its own.
 * Exact:   if the FMU does the same again when it is given the same again. What calls gave is held against what they give again, and a difference ends the
 *          replay (`is_over`).
 * Cost:    of a way back, the steps from the beginning on, or none if it stands on the way.
 * Memory:  taken once, at the first position that is kept or step that is noted, or before.
 * Thread:  that of the FMUs.
 */

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
    double *place; /* for the values of a call that reads some */
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
fmi2Status tl_fmu_replay_restore(tl_fmu_replay *replay, fmi2FMUstate state);
void tl_fmu_replay_give_back(tl_fmu_replay *replay, fmi2FMUstate *state);

/* To the end of its prologue, after tl_fmu_replay_start(). */
fmi2Status tl_fmu_replay_restore_start(tl_fmu_replay *replay);

#endif
