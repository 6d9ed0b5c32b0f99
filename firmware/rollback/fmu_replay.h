/* Rollback by replay: resets an FMU and repeats the calls that were made before.
 *
 * Thread:  the thread that calls the FMU.
 */
#ifndef TL_FIRMWARE_ROLLBACK_FMU_REPLAY_H
#define TL_FIRMWARE_ROLLBACK_FMU_REPLAY_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "master/base/status.h"
#include "master/fmi/component.h"
#include "master/fmi/fmi2.h"

/* ---- Prologue: all calls of an FMU before its first step.
 *
 * Purpose: contains the start values, the experiment, the initialisation, and calls that read
 *          values. After a reset all calls are repeated in the same order with the same values.
 *          Then the FMU is ready for its first step again.
 * Memory:  a list of calls with copies of their values, texts and references; freed by
 *          tl_fmu_prologue_end().
 * Errors:  if memory is out for a call, the list is incomplete (`is_cut`) and cannot be repeated.
 * Thread:  the thread that calls the FMUs.
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

/* Arguments of fmi2SetupExperiment; times in s. */
typedef struct tl_fmu_setup {
    fmi2Real tolerance, start, stop;
    fmi2Boolean has_tolerance, has_stop;
} tl_fmu_setup;

/* Zeroed: empty. */
typedef struct tl_fmu_prologue {
    struct tl_fmu_prologue_call *first, *last; /* private */
    bool is_cut;                               /* memory was out: the list is incomplete */
} tl_fmu_prologue;

/* Appends a call. `references` (NULL: none) and `values`: as in FMI, `count` of each. Both are
 * copied, except values that the call reads. */
void tl_fmu_prologue_add(tl_fmu_prologue *prologue, tl_fmu_prologue_kind kind, const fmi2ValueReference *references,
                         size_t count, const void *values);

/* Repeats all calls on `instance` by `functions` until one fails. Returns the status of the last
 * repeated call; fmi2Error if the list is incomplete. Allocates no memory. */
fmi2Status tl_fmu_prologue_play(const tl_fmu_prologue *prologue, const tl_fmi2 *functions, fmi2Component instance);

/* Frees all calls and zeroes the prologue. */
void tl_fmu_prologue_end(tl_fmu_prologue *prologue);

/* ---- History: all calls of an FMU since its first step, as a tree with all branches that may be
 * restored.
 *
 * Purpose: each call is a node of the tree; the root is the end of the prologue. A *position* is a
 *          node, and stands for all calls on the path from the root to it. To restore a saved
 *          position, the FMU is reset and these calls are repeated. If the present position is on
 *          that path, only the later calls are repeated. The history only stores calls; the replay
 *          repeats them.
 * Freed:   a branch is freed once it contains neither a saved position nor the present one.
 * Limits:  the history stores no position after more than `most` steps, and none if memory is out.
 *          Then the FMU is *off* the tree. Such a position can be saved, but can be restored only
 *          if no call was made since.
 * Memory:  tl_fmu_history_open() allocates all of it.
 * Thread:  one at a time.
 */

/* Steps of memory for branches, in addition to `most` steps. They are enough for the states that a
 * search saves, and for those saved before it. */
enum { TL_FMU_HISTORY_BRANCHES = 4096 };

#define TL_FMU_HISTORY_NONE UINT32_MAX

/* One call. The user of the history defines `kind`. */
typedef struct tl_fmu_history_call {
    uint8_t kind;
    bool is_step;
    bool is_final;        /* of a step: no earlier state will be restored */
    double now, size;     /* of a step: communication point and step size, s */
    uint64_t result_hash; /* of a call that reads values: hash of these values */
    uint32_t steps;       /* steps since the root, this call included; set by the history */
    uint32_t parent;      /* private, from here on */
    uint32_t next;        /* next call on the path that is repeated, or next free entry */
    uint32_t children;    /* number of calls that directly follow this one in the tree */
    uint32_t kept;        /* how often this position is saved */
} tl_fmu_history_call;

/* Fields are private. Zeroed: not open. */
typedef struct tl_fmu_history {
    uint32_t most; /* maximum number of steps from the root */
    uint32_t call_count;
    size_t size; /* maximum number of bytes of values that one call sets */
    tl_fmu_history_call *calls;
    unsigned char *values; /* `size` bytes of each call */
    uint32_t free_call;
    uint32_t root;
    uint32_t at;       /* the present position; TL_FMU_HISTORY_NONE: off the tree */
    uint32_t off;      /* number of the present position off the tree, to recognise it */
    bool has_run_over; /* memory for a call was missing since the last restart */
} tl_fmu_history;

/* Allocates memory for `most` steps and the branches. A step has at most `calls` calls, itself
 * included, and each call sets at most `size` bytes of values. The present position is the root.
 * Errors: TL_TRY_AGAIN if memory is out. tl_fmu_history_close() frees all of it. */
tl_status tl_fmu_history_open(tl_fmu_history *history, uint32_t most, uint32_t calls, size_t size, tl_error *error);
void tl_fmu_history_close(tl_fmu_history *history);

/* Restarts with an empty tree. Positions saved before can no longer be restored, but the caller
 * must still free them (tl_fmu_history_forget()). */
void tl_fmu_history_begin(tl_fmu_history *history);

/* Appends a call at the present position, with the `size` bytes of values that it set. The new call
 * becomes the present position; if it cannot be stored, the FMU is off the tree. */
void tl_fmu_history_add(tl_fmu_history *history, const tl_fmu_history_call *call, const void *values, size_t size);

/* Sets the FMU off the tree, because a call has failed and its state is unknown. */
void tl_fmu_history_lose(tl_fmu_history *history);

/* The first function saves the present position and returns a handle, never NULL. The second one
 * frees a handle (NULL: does nothing) and keeps the present position. To restore a position, use
 * tl_fmu_history_find_path(). */
void *tl_fmu_history_save(tl_fmu_history *history);
void tl_fmu_history_forget(tl_fmu_history *history, void *kept);

/* Returns true if the saved position `kept` is the present one. */
bool tl_fmu_history_is_at(const tl_fmu_history *history, const void *kept);

/* Finds the path to a saved position. *first: the first call to be repeated (TL_FMU_HISTORY_NONE:
 * none); tl_fmu_history_follow() returns the next. *restarted: true if the path begins at the root,
 * so that the FMU must be reset first; false if it begins at the present position. Returns false if
 * there is no path: the position is off the tree, or was saved before a restart. */
bool tl_fmu_history_find_path(tl_fmu_history *history, const void *kept, uint32_t *first, bool *restarted);

/* Sets *made to the call number `call` of the path, and *values to the values that it set. Returns
 * the next call, or TL_FMU_HISTORY_NONE. */
uint32_t tl_fmu_history_follow(const tl_fmu_history *history, uint32_t call, const tl_fmu_history_call **made,
                               const void **values);

/* The saved position becomes the present one. Call it after all calls of the path were repeated. */
void tl_fmu_history_arrive(tl_fmu_history *history, const void *kept);

/* ---- Replay: rollback that needs no state functions; the FMU is reset and its calls are repeated.
 *
 * Purpose: for an FMU that cannot save its state correctly and whose memory cannot be copied. Each
 *          call is noted: before the first step in the prologue, then in the history. A state is a
 *          position in the history and needs no memory of its own.
 * Exact:   a restore is exact if the FMU gives the same results after the same calls. The values
 *          that repeated calls of the history read are compared with the original ones, by a hash.
 *          A difference sets `differs` of tl_fmi2_replay.
 * Cost:    a restore executes all steps from the start, or only the later ones if the present
 *          position is on the path.
 * Memory:  the first tl_fmu_replay_start() or tl_fmu_replay_save() allocates the history; the
 *          prologue grows with each call. tl_fmu_replay_end() frees both.
 * Thread:  the thread that calls the FMUs.
 */

typedef enum tl_fmu_replay_phase {
    TL_FMU_REPLAY_BEGINS, /* calls are noted in the prologue */
    TL_FMU_REPLAY_WAITS,  /* the prologue is complete; another rollback method is in use and nothing is noted */
    TL_FMU_REPLAY_NOTES,  /* calls are noted in the history */
    TL_FMU_REPLAY_PLAYS   /* calls are repeated and not noted */
} tl_fmu_replay_phase;

/* The caller sets the fields before `phase`, and zeroes the others. */
typedef struct tl_fmu_replay {
    uint32_t most;                               /* maximum number of steps from the start that can be rolled back */
    tl_fmi2_replay *results;                     /* results, for the FMU's caller (fmi2.h) */
    const tl_fmi2 *functions;                    /* the functions by which calls are repeated */
    fmi2Component instance;                      /* the instance for these calls */
    fmi2Status (*reset)(fmi2Component instance); /* resets the instance, so that it can be initialised */
    const tl_ports *inputs;                      /* ports that are set in each step; NULL: not known yet */
    const tl_ports *outputs;                     /* ports that are read in each step; NULL: not known yet */
    tl_fmu_replay_phase phase;                   /* private, from here on */
    tl_fmu_prologue prologue;
    tl_fmu_history history;
    double *value_buffer; /* buffer for the values of one call */
} tl_fmu_replay;

/* Frees all memory. */
void tl_fmu_replay_end(tl_fmu_replay *replay);

/* Restarts the prologue and the history, after the FMU was instantiated or reset. States saved
 * before can no longer be restored. */
void tl_fmu_replay_begin(tl_fmu_replay *replay);

/* Ends the prologue, if it has not ended yet. Nothing is noted until tl_fmu_replay_start(). */
void tl_fmu_replay_wait(tl_fmu_replay *replay);

/* Starts to note all calls in the history. Does nothing if this was done before. Returns fmi2Error
 * if memory is out or the ports are not known. */
fmi2Status tl_fmu_replay_start(tl_fmu_replay *replay);

/* Note a call that was made, and its status. `values`: the values that the call has set or read, of
 * the type of this kind. In the history, calls must set all `inputs` or read all `outputs` of one
 * type: any other call disables the replay (`is_disabled`), and so does a lack of memory. */
void tl_fmu_replay_note(tl_fmu_replay *replay, tl_fmu_prologue_kind kind, const fmi2ValueReference *references,
                        size_t count, const void *values, fmi2Status status);
void tl_fmu_replay_note_step(tl_fmu_replay *replay, const tl_fmi2_step *step, fmi2Status status);

/* Save, restore and free a state. Saving calls tl_fmu_replay_start() and frees *state before; NULL
 * is allowed. A restore returns fmi2Error and changes nothing if there is no path to the state. If
 * a repeated call fails, it returns that status, and the present position is unknown. */
fmi2Status tl_fmu_replay_save(tl_fmu_replay *replay, fmi2FMUstate *state);
fmi2Status tl_fmu_replay_restore(tl_fmu_replay *replay, fmi2FMUstate state);
void tl_fmu_replay_forget(tl_fmu_replay *replay, fmi2FMUstate *state);

/* Restores the end of the prologue, and restarts the history; call tl_fmu_replay_start() before.
 * Returns fmi2OK, or the status of the call that has failed. */
fmi2Status tl_fmu_replay_restore_start(tl_fmu_replay *replay);

#endif
