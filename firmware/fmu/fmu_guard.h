/* FMU guard: a table of FMI functions that wraps the functions of an FMU.
 *
 * Thread:  the thread that calls the FMU.
 */
#ifndef TL_FIRMWARE_FMU_FMU_GUARD_H
#define TL_FIRMWARE_FMU_FMU_GUARD_H

#include <locale.h>
#include <stdbool.h>
#include <stdint.h>

#include "firmware/fmu/fmu_logger.h"
#include "firmware/process/fmu_call.h"
#include "firmware/rollback/fmu_memory.h"
#include "firmware/rollback/fmu_replay.h"
#include "master/fmi/component.h"
#include "master/fmi/fmi2.h"

/* ---- Last inputs of an FMU, saved with each of its states.
 *
 * Purpose: FMUs of some exporters save and restore only time and variables, not the inputs that
 *          were set. So after each restore the guard sets the inputs again that such an FMU had
 *          when the state was saved. It does so only if the rollback proof (master/sync/proof.h)
 *          has found that the FMU needs it. In other FMUs, setting a value may have side effects.
 * Thread:  the thread that calls the FMU.
 * Memory:  malloc().
 */

/* Fields are private. */
typedef struct tl_last_inputs {
    const tl_ports *ports; /* the ports that are set */
    size_t bytes;          /* size of `values` */
    double values[];       /* the inputs set last: reals, then integers, then Booleans */
} tl_last_inputs;

/* A state of the FMU, and the inputs that were set last before it was saved. */
typedef struct tl_last_inputs_state {
    fmi2FMUstate own; /* the FMU's own state; NULL: not saved yet */
    double values[];
} tl_last_inputs_state;

/* Allocates the list of last inputs, with the present values of the ports. `ports` must outlive it.
 * The caller frees it with free(). Returns NULL if memory is out. */
tl_last_inputs *tl_last_inputs_open(const tl_ports *ports);

/* Notes the values of an FMI call that sets all ports of one type. Ignores all other calls. */
void tl_last_inputs_note(tl_last_inputs *last_inputs, tl_fmu_prologue_kind kind, const fmi2ValueReference *references,
                         const void *values);

/* Allocates a state with the present values, without the FMU's own state yet. Returns NULL if
 * memory is out. */
tl_last_inputs_state *tl_last_inputs_make_state(const tl_last_inputs *last_inputs);

/* The first function copies the last inputs into `state`. The second one copies them back from
 * `state` and sets them in the instance, by the functions in `fmi`. It returns the status of the
 * last FMI call. Neither saves nor restores the FMU's own state. */
void tl_last_inputs_save(const tl_last_inputs *last_inputs, tl_last_inputs_state *state);
fmi2Status tl_last_inputs_restore(tl_last_inputs *last_inputs, const tl_last_inputs_state *state, const tl_fmi2 *fmi,
                                  fmi2Component instance);

/* ---- Data of the guard and of one instance. */

/* The caller provides the memory. Fields are private, except the first two and those that are set
 * before the FMU is loaded (see tl_fmu_guard_open()). "Proof" is the rollback proof before a run
 * (master/sync/proof.h). "Copy" is a copy of the FMU's memory. */
typedef struct tl_fmu_guard {
    tl_fmi2 functions; /* the table for callers; a function is NULL if the FMU lacks it or if twinlock never calls it */
    fmi2CallbackFunctions callbacks;     /* to be passed to functions.instantiate; their environment is this guard */
    tl_fmi2 own;                         /* private, from here on: the FMU's functions */
    fmi2CallbackFunctions fmu_callbacks; /* callbacks that the FMU gets */
    tl_fmu_logger logger;
    tl_fmu_memory *memory;    /* NULL: the FMU cannot be rolled back by memory */
    tl_fmu_memory own_memory; /* used by `memory`, unless the FMU shares that of all FMUs in Python */
    bool by_memory;           /* memory is the method in use; if not, it may be the fallback if own states are wrong */
    bool may_replay;          /* rollback by replay is allowed if no other method works */
    bool by_replay;           /* replay is the method in use */
    unsigned renewals; /* private: times that the FMU was started again in the proof, because it had opened libraries */
    bool lacks_library; /* private: a copy could not be restored, because it lacks a library that was opened later */
    bool renews;   /* private: a reset frees and instantiates the FMU again, because fmi2Reset fails or is incomplete */
    uint32_t most; /* replay can roll back at most this many steps after the start */
    bool sets_inputs; /* private: own states are used, and the last inputs are set again after each restore */
    bool was_remaining_reported;    /* private: the side effects that prevent a copy were logged */
    bool was_environment_reported;  /* private: environment variables that it changes were logged */
    bool was_writing_reported;      /* private: files that it writes were logged */
    bool was_construction_reported; /* private: memory of a library that it opened in a step was logged */
    void *
        instantiated; /* private: copy of the memory from after fmi2Instantiate, to reset an FMU that is rolled back by memory; NULL: no copy */
    void *full_copy;  /* private: copy of the memory from the start of the proof; NULL: no copy */
    bool was_proved;  /* private: the proof has ended; only a copy chosen for speed may still fall back to states */
    uint32_t name;    /* number of the FMU's name in fmu_call.h, for calls without an instance */
    unsigned was_reported; /* bits: changes of process state that were already logged, for calls without an instance */
    tl_fmi2 by_states;     /* private: the table with the FMU's own state functions */
    bool is_by_choice;     /* copies are in use because they are faster; the FMU's own states are exact too */
    tl_fmi2_times times;
    fmi2FMUstate
        beginning; /* private: the FMU's own state from the start of the proof, while copies are proved; NULL: not saved */
    bool is_by_openmodelica; /* private: generator of the FMU */
    bool is_free;            /* the FMU is never rolled back */
    bool has_crashed;        /* private: one of the FMU's own state functions crashed; none is called any more */
    struct tl_fmu_guarded *instances;
} tl_fmu_guard;

/* One instance. Callers of the table get it instead of the FMU's own handle. The fields that a step
 * needs come first and fit into one cache line. With many small FMUs, reading these fields is most
 * of the cost of a step. */
typedef struct tl_fmu_guarded {
    fmi2Component instance;
    fmi2SetRealTYPE *set_real;
    fmi2DoStepTYPE *do_step;
    fmi2GetRealTYPE *get_real;
    const unsigned short *const *characters; /* the C library's pointer to the character table of this thread */
    const unsigned short *table;             /* its value at instantiation; if it differs, the locale was changed */
    tl_fmu_replay *replay;                   /* notes all calls for a replay; NULL: calls are not noted */
    bool by_replay;                          /* this instance is rolled back by replay */
    bool is_noted;                           /* it has `memory`, or its calls may be noted */
    tl_last_inputs *last_inputs;             /* notes the last inputs; NULL: not noted */
    tl_fmu_memory *memory;                   /* serves allocations of its calls; NULL: the C library serves them */
    double shift;                            /* s; the FMU's time is smaller by this: it accepts only start time 0 */
    uint32_t name;
    uint64_t control;
    const tl_fmi2 *own; /* all functions of the FMU */
    locale_t locale;
    unsigned was_reported; /* bits: changes that were already logged for this instance */
    struct tl_fmu_guard *guard;
    struct tl_fmu_guarded *next;
    struct begun { /* arguments of its instantiation; the texts belong to the caller and must remain valid */
        fmi2String name, guid, resources;
        fmi2Type type;
        fmi2Boolean visible, logging;
    } begun;
} tl_fmu_guarded;

/* ---- The guard: a table of FMI functions that wraps an FMU's own functions.
 *
 * Purpose: all calls of an FMU go through the guard. Around each call the guard:
 *            - notes the call, so that a crash, a timeout or an exit can be reported with its name
 *              (fmu_call.h);
 *            - restores the floating-point control bits (host_state.h) and the locale of the
 *              thread, without a system call;
 *            - after loading, instantiating, initialising, resetting and freeing, and in turn at
 *              each tick: restores all other process state that an FMU may have changed
 *              (host_state.h), and logs this once;
 *            - leaves out a far stop time (TL_EXPERIMENT_FAR) for FMUs of OpenModelica;
 *            - if the FMU refuses a start time other than 0: starts it at 0, shifts its time, and
 *              logs this;
 *            - reports an error if the FMU returns fmi2OK without a state;
 *            - catches crashes in its own state functions until the rollback is proved: they count
 *              as fmi2Error, so that the next rollback method is used;
 *            - if the FMU is rolled back by memory (rollback/fmu_memory.h): serves its allocations
 *              from its own heap, and saves and restores copies instead of calling the FMU's state
 *              functions;
 *            - if the FMU is rolled back by replay (rollback/fmu_replay.h): notes its inputs.
 *          A caller uses the table as it would use the FMU's own functions.
 * Owner:   the caller provides the memory of a guard and must not move it before
 *          tl_fmu_guard_close(). The guard owns the instances created through it, and their states.
 * Thread:  the thread that calls the FMUs.
 */

/* Initialises a guard before the FMU is loaded; from then on calls may go through it. `name` and
 * `generator` come from the model description. Afterwards the caller opens `memory` and sets the
 * allowed rollback methods. */
void tl_fmu_guard_open(tl_fmu_guard *guard, const char *name, const char *generator);

/* Call them before and after a call of the FMU that does not go through the table: opening its
 * binary, and reading its version. */
void tl_fmu_guard_enter(tl_fmu_guard *guard, tl_fmu_function function);
void tl_fmu_guard_leave(tl_fmu_guard *guard);

/* Fills the table for callers. `own`: the functions of the FMU, which its binary exports. */
void tl_fmu_guard_front(tl_fmu_guard *guard, const tl_fmi2 *own);

/* Chooses the first rollback method again, by `memory`, `by_memory`, `by_replay` and `may_replay`.
 * Call it before the FMU is instantiated. */
void tl_fmu_guard_choose_method(tl_fmu_guard *guard);

/* Frees what the guard owns. Use no instance afterwards. Memory of instances that still exist is
 * freed without a call of the FMU. A zeroed guard is allowed. */
void tl_fmu_guard_close(tl_fmu_guard *guard);

/* Restores process state that any FMU may have changed, and logs each kind of change once per
 * process. `whole`: all of it; else one system call: one kind in turn, all within
 * TL_HOST_STATE_TURNS calls. */
void tl_fmu_guard_tick(bool whole);

#endif
