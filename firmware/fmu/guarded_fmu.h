/* Data of one FMU behind the guard (fmu_guard.h), and of each of its instances.
 *
 * Owner:   the guard; the modules of its rollback methods read and write it too.
 * Thread:  the thread that calls the FMU.
 */
#ifndef TL_FIRMWARE_FMU_GUARDED_FMU_H
#define TL_FIRMWARE_FMU_GUARDED_FMU_H

#include <locale.h>
#include <stdbool.h>
#include <stdint.h>

#include "firmware/fmu/fmu_logger.h"
#include "firmware/fmu/last_inputs.h"
#include "firmware/rollback/fmu_memory.h"
#include "firmware/rollback/fmu_replay.h"
#include "master/fmi/fmi2.h"

/* The caller provides the memory. Before the FMU is loaded, the caller sets `memory`, `by_memory`,
 * `may_replay`, `by_replay`, `most` and `is_free`. Callers use `functions` and `callbacks`; all
 * other fields are private. "Proof": the rollback proof before a run (master/sync/proof.h). "Copy":
 * a copy of the FMU's memory. */
typedef struct tl_fmu_guard {
    tl_fmi2 functions; /* the table for callers; a function is NULL if the FMU lacks it or if twinlock never calls it */
    fmi2CallbackFunctions callbacks;     /* to be passed to functions.instantiate; their environment is this guard */
    tl_fmi2 own;                         /* the FMU's functions */
    fmi2CallbackFunctions fmu_callbacks; /* callbacks that the guard passes to the FMU */
    tl_fmu_logger logger;
    tl_fmu_memory *memory;    /* NULL: the FMU cannot be rolled back by memory */
    tl_fmu_memory own_memory; /* `memory` points to it, unless the FMU shares the memory of all FMUs in Python */
    bool by_memory;           /* memory is the method in use; false: it may be the fallback if own states are wrong */
    bool may_replay;          /* rollback by replay is allowed if no other method works */
    bool by_replay;           /* replay is the rollback method in use */
    bool renews;      /* a reset frees and instantiates the FMU again, because fmi2Reset fails or is incomplete */
    uint32_t most;    /* replay can roll back at most this many steps after the start */
    bool sets_inputs; /* own states are used, and the last inputs are set again after each restore */
    bool was_remaining_reported;    /* side effects that prevent a copy were logged */
    bool was_environment_reported;  /* it was logged that the FMU changes environment variables */
    bool was_writing_reported;      /* it was logged that the FMU writes files */
    bool was_construction_reported; /* it was logged that the FMU has opened a library in a step */
    void *
        instantiated; /* copy from after fmi2Instantiate, to reset an FMU that is rolled back by memory; NULL: no copy */
    void *full_copy;  /* copy from the start of the proof; NULL: no copy */
    void *noted;      /* copy with which the proof compares the present memory; NULL: no copy */
    bool was_proved;  /* the proof has ended; only copies chosen for speed may still be replaced by own states */
    uint32_t name;    /* number of the FMU's name (tl_fmu_calls_name()), for calls without an instance */
    unsigned logged_changes; /* bits: changes of the process that were already logged, for calls without an instance */
    tl_fmi2 by_states;       /* table with the FMU's own state functions */
    bool is_by_choice;       /* copies are in use because they are faster; the FMU's own states are exact too */
    tl_fmi2_times times;     /* measured durations of both methods, if is_by_choice */
    fmi2FMUstate
        beginning; /* the FMU's own state from the start of the proof, while copies are proved; NULL: not saved */
    bool is_by_openmodelica; /* the FMU was exported by OpenModelica */
    bool is_free;            /* the FMU is never rolled back */
    bool has_crashed; /* saving, restoring or freeing an own state crashed; no such function is called any more */
    struct tl_fmu_guarded *instances; /* list of all instances */
} tl_fmu_guard;

/* Wrapper of one instance. Callers of the table get its address instead of the FMU's own handle.
 * The fields that a step needs come first and fit into one cache line. With many small FMUs,
 * reading these fields is most of the cost of a step. */
typedef struct tl_fmu_guarded {
    fmi2Component instance; /* the FMU's own handle */
    fmi2SetRealTYPE *set_real;
    fmi2DoStepTYPE *do_step;
    fmi2GetRealTYPE *get_real;
    const unsigned short *const *characters; /* the C library's pointer to the character table of this thread */
    const unsigned short *table;             /* *characters at instantiation; another value: the locale was changed */
    tl_fmu_replay *replay;                   /* notes all calls for a replay; NULL: calls are not noted */
    bool by_replay;                          /* this instance is rolled back by replay */
    bool is_noted;                           /* the instance has `memory`, or its calls may be noted */
    tl_last_inputs *last_inputs;             /* notes the last inputs; NULL: not noted */
    tl_fmu_memory *memory;                   /* serves allocations of its calls; NULL: the C library serves them */
    double shift;                            /* s; the FMU's time is smaller by this, if it accepts only start time 0 */
    uint32_t name;                           /* number of the instance's name (tl_fmu_calls_name()) */
    uint64_t control;                        /* floating-point control bits at instantiation (host_state.h) */
    const tl_fmi2 *own;                      /* all functions of the FMU */
    locale_t locale;                         /* locale of the thread at instantiation */
    unsigned logged_changes;                 /* bits: changes that were already logged for this instance */
    struct tl_fmu_guard *guard;
    struct tl_fmu_guarded *next;
    struct begun { /* arguments of fmi2Instantiate; the texts belong to the caller and must remain valid */
        fmi2String name, guid, resources;
        fmi2Type type;
        fmi2Boolean visible, logging;
    } begun;
} tl_fmu_guarded;

/* Returns true if the proof may still choose another rollback method. */
static inline bool tl_fmu_guarded_has_fallback(const tl_fmu_guarded *self) {
    return self->replay != NULL && !self->guard->was_proved && !(self->by_replay && self->guard->renews);
}

#endif
