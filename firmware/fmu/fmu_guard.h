/* The guard in front of an FMU: a table of FMI functions of ours that calls the FMU's own.
 *
 * Thread:  the one that calls the FMU.
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

/* ---- What an FMU was given last, kept with each of its states.
 *
 * Purpose: for an FMU whose states do not hold what is set (some exporters restore time and variables only): it is given again after each restore what it had when
 *          it was saved. Only for those that have been shown to need it; others may do more on being set than to take a value.
 * Thread:  that of the FMUs.
 */

/* Fields are private. */
typedef struct tl_fmu_given {
    const tl_ports *ports; /* that are set */
    size_t bytes;          /* of the last values: */
    double values[];       /* reals, then integers, then Booleans */
} tl_fmu_given;

/* A state with what was given before it. */
typedef struct tl_fmu_given_state {
    fmi2FMUstate own; /* the FMU's; NULL: none yet */
    double values[];
} tl_fmu_given_state;

/* What is in the ports was given last; they must stay. The caller frees it. NULL: there is no memory. */
tl_fmu_given *tl_fmu_given_open(const tl_ports *ports);

/* A call that sets values of the ports, or another one, which says nothing. */
void tl_fmu_given_note(tl_fmu_given *given, tl_fmu_prologue_kind kind, const fmi2ValueReference *references,
                       const void *values);

/* A state with what is given now; without the FMU's own yet. NULL: there is no memory. */
tl_fmu_given_state *tl_fmu_given_make_state(const tl_fmu_given *given);

/* What is given now is what a state has; and the other way round: the instance is given that again, by `fmi`. */
void tl_fmu_given_keep(const tl_fmu_given *given, tl_fmu_given_state *state);
fmi2Status tl_fmu_given_give_again(tl_fmu_given *given, const tl_fmu_given_state *state, const tl_fmi2 *fmi,
                                   fmi2Component instance);

/* ---- What the guard is made of, and one instance behind it: for fmu_guard.h, which says what it does, and fmu_guard.h.
 */

/* Placed by its caller; fields are private but for the first two and those that fmu_guard.h sets. */
typedef struct tl_fmu_guard {
    tl_fmi2 functions;               /* ours, to be called; functions that the FMU has not, or nobody calls, are NULL */
    fmi2CallbackFunctions callbacks; /* what functions.instantiate wants: leads it back here */
    tl_fmi2 own;                     /* private, from here on: the FMU's functions */
    fmi2CallbackFunctions given;     /* to the FMU */
    tl_fmu_logger logger;
    tl_fmu_memory memory; /* zeroed: it is not rolled back by that */
    bool by_memory;       /* it is; else it may be, if its own states are wrong */
    bool may_replay;      /* it may be reset and given again what it was given, if all else is wrong, */
    bool by_replay;       /* and it is; */
    bool renews;        /* private: and is freed and instantiated for it, since fmi2Reset refuses, or does not do it; */
    uint32_t most;      /* of so many steps */
    bool gives_again;   /* private: its states are its own, and what it had been given is given again after them */
    bool was_left_told; /* private: what no copy of its memory takes back */
    void *aside;        /* private: all that it knew when a proof began; NULL: nothing is kept */
    bool was_proved;    /* private: no other way is tried any more */
    uint32_t name;      /* of the file, for calls without an instance */
    unsigned told;      /* changes of the process that were said of the file */
    tl_fmi2 by_states;  /* private: the table as it is if states are the FMU's own */
    bool is_by_choice;  /* private: they would do as well as the copy that is in use, but take longer: */
    tl_fmi2_times times;
    fmi2FMUstate
        beginning; /* private: its own state where the proof began, while copies are proved; NULL: there is none */
    struct tl_fmu_guarded *instances;
} tl_fmu_guard;

/* One instance. The table's callers get this in place of the FMU's own handle. What a step needs comes first, in one line of a
 * processor's cache: with many small FMUs that is most of what a step costs. */
typedef struct tl_fmu_guarded {
    fmi2Component instance;
    fmi2SetRealTYPE *set_real;
    fmi2DoStepTYPE *do_step;
    fmi2GetRealTYPE *get_real;
    const unsigned short *const *characters; /* where the C library keeps the thread's table of characters, and which */
    const unsigned short *table;             /* it is: a glance at the locale */
    tl_fmu_replay *replay;                   /* what it is given is noted there; NULL: it is not */
    bool by_replay;                          /* it is led back by that */
    tl_fmu_given *given;                     /* what it was given last is noted there; NULL: it is not */
    tl_fmu_heap *heap;                       /* that its calls are served from; NULL: the C library's */
    uint32_t name;
    uint32_t control;
    const tl_fmi2 *own; /* all functions */
    locale_t locale;
    unsigned told; /* changes that were said of this instance */
    struct tl_fmu_guard *guard;
    struct tl_fmu_guarded *next;
    struct begun { /* how it was instantiated; texts are the caller's, and stay */
        fmi2String name, guid, resources;
        fmi2Type type;
        fmi2Boolean visible, logging;
    } begun;
} tl_fmu_guarded;

/* ---- The guard: a table of FMI functions of ours in front of an FMU's own.
 *
 * Purpose: everything that calls an FMU comes through here, so this is the place for what must be done around each call:
 *            - note the call, so that a crash, a hang or an exit in it is told by name (fmu_call.h);
 *            - put back the floating-point control bits (host_state.h) and the locale of the thread, without a system call;
 *            - after loading, instantiating, initialising, resetting, freeing, and once a tick: put back the rest of what an FMU may have
 *              changed of the process (host_state.h), and say so once;
 *            - take for a failure what claims success and is none: no state with fmi2OK;
 *            - if the FMU is rolled back by its memory (rollback/fmu_memory.h): serve it from a heap of its own, and save and restore that in
 *              place of the FMU's own functions.
 *            - or if it is rolled back by replay (rollback/fmu_replay.h): note what it is given.
 *          A caller of the table cannot tell the difference.
 * Owner:   the caller places a guard and keeps it where it is until tl_fmu_guard_close(); instances made through it, and their
 *          states, are the guard's.
 * Thread:  that of the FMUs.
 */

/* Before the FMU is loaded: from now on it may be called. `name` and `generator` are those of its
 * description. Then the caller opens its memory and sets in which ways it may be rolled back. */
void tl_fmu_guard_open(tl_fmu_guard *guard, const char *name, const char *generator);

/* Around what calls the FMU without the table: opening its library, asking for its version. */
void tl_fmu_guard_enter(tl_fmu_guard *guard, tl_fmu_function function);
void tl_fmu_guard_leave(tl_fmu_guard *guard);

/* The FMU's functions are known: fills the table. */
void tl_fmu_guard_front(tl_fmu_guard *guard, const tl_fmi2 *own);

/* No instance is called any more; those that were never freed are given up. A zeroed guard is allowed. */
void tl_fmu_guard_close(tl_fmu_guard *guard);

/* Once a tick: puts back what any FMU may have changed of the process since; said once a process for each kind. */
void tl_fmu_guard_tick(void);

#endif
