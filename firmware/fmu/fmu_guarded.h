/* What the guard is made of, and one instance behind it: for fmu_guard.h, which says what it does, and fmu_ladder.h. */
#ifndef TL_FIRMWARE_FMU_FMU_GUARDED_H
#define TL_FIRMWARE_FMU_FMU_GUARDED_H

#include <locale.h>
#include <stdbool.h>
#include <stdint.h>

#include "firmware/fmu/fmu_given.h"
#include "firmware/fmu/fmu_logger.h"
#include "firmware/rollback/fmu_memory.h"
#include "firmware/rollback/fmu_replay.h"
#include "master/fmi/fmi2.h"

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

#endif
