/* Function table of one loaded FMI 2.0 for Co-Simulation binary.
 *
 * Purpose: component.c calls an FMU through it. The module that loads the binary (firmware) fills
 *          it, so that the master needs neither files nor dlopen.
 * Owner:   the module that filled it; it must outlive every instance.
 * Source:  FMI 2.0.4, sections 2.1 and 4.2.
 */
#ifndef TL_MASTER_FMI_FMI2_H
#define TL_MASTER_FMI_FMI2_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "fmi2FunctionTypes.h"

struct tl_component;
struct tl_ports;

/* One step of an instance. */
typedef struct tl_fmi2_step {
    fmi2Real now;      /* s: communication point */
    fmi2Real size;     /* s */
    fmi2Boolean final; /* no state from before `now` will be restored */
} tl_fmi2_step;

/* Where a step of many instances (below: of the array `components`) has stopped. */
typedef struct tl_fmi2_end {
    size_t stepped;    /* instances that have made their step */
    fmi2Status status; /* of instance number `stepped`, which failed; fmi2OK: it was not called */
    unsigned done;     /* the call that returned `status`: 0 set, 1 step, 2 get */
} tl_fmi2_end;

/* Not part of FMI: fmi2SetReal, fmi2DoStep and fmi2GetReal of `count` components, which have only
 * Real ports. The FMU guard then does its own work once and not three times, which saves much time
 * if the FMUs are small. `step->now` counts from the start; each component adds its own start time.
 * Stops at the first component that fails or is not in TL_MODE_STEPPING; component 0 must be in it.
 * Increments the execution counter of each component. */
typedef tl_fmi2_end tl_fmi2_step_reals(struct tl_component *components, size_t count, const tl_fmi2_step *step);

/* Duration of one round (save, step and restore) by each of two rollback methods, ns. */
typedef struct tl_fmi2_times {
    int64_t by_states; /* by the FMU's own states */
    int64_t by_copy;   /* by a copy of its memory */
} tl_fmi2_times;

/* If a run has no end, the FMUs get the stop time start_s + this: 20 years in whole days, s. Some
 * FMUs cannot start without a stop time, some need whole days, and some count seconds in 32
 * bits. */
#define TL_EXPERIMENT_FAR (7300 * 86400.0)

/* Not part of FMI: tests and changes the rollback method of an FMU, whose own states may be wrong.
 * The test before a run is the rollback proof (sync/proof.h).
 * Errors: fmi2Error if it is not possible; the reason was logged. */
typedef struct tl_fmi2_fallback {
    fmi2Status (*keep)(fmi2Component instance);          /* makes a full copy of the FMU, frees the earlier one */
    fmi2Status (*restore_start)(fmi2Component instance); /* restores the full copy */
    /* Restores the full copy, and from now on uses the next method: own states, copies, own states
     * with the inputs set again, replay. `why`: cause for the log; "": not known. */
    fmi2Status (*next_method)(fmi2Component instance, const char *why);
    void (*end_proof)(fmi2Component instance);  /* frees the full copy */
    size_t (*size)(fmi2Component instance);     /* bytes of a full copy; 0: not known */
    bool (*has_choice)(fmi2Component instance); /* true: rolled back by its own states, copies are possible too */
    /* Only with has_choice(), and while no state is saved: rolls back by copies from now on. Then
     * next_method() returns to own states. `times`: for the log. */
    fmi2Status (*prefer_copy)(fmi2Component instance, const tl_fmi2_times *times);
    fmi2Status (*note_memory)(fmi2Component instance); /* only with has_choice(): copies the present memory */
    bool (*is_memory_same)(fmi2Component instance);    /* true: the memory has the same bits as that copy */
} tl_fmi2_fallback;

/* Not part of FMI: rollback by replay. The instance is reset, and its steps are executed again with
 * the same inputs. Zeroed: another method is used, or none. */
typedef struct tl_fmi2_replay {
    uint32_t most; /* limit of the steps from the start to a restored instant; 0: no replay */
    bool
        is_disabled; /* its inputs could not be recorded (memory, or other ports than announced): no rollback any more */
    bool differs;    /* the repeated steps gave other outputs: no rollback any more */
    uint64_t steps;  /* number of steps that were executed again */
    size_t bytes;    /* memory for its inputs */
    int64_t longest_reset; /* longest duration of a reset with initialisation so far, ns */
} tl_fmi2_replay;

/* Not part of FMI: announces to an instance, before its first step, which ports are set and read in
 * each step. */
typedef void tl_fmi2_announce_ports(fmi2Component instance, const struct tl_ports *inputs,
                                    const struct tl_ports *outputs);

/* Not part of FMI: bytes that one more state would need; 0: not known. Does not call the FMU. */
typedef size_t tl_fmi2_state_size(fmi2Component instance);

/* Not part of FMI: allocates the memory for `states` states now, so that none is allocated later.
 * fmi2Error: memory is out, and the error was logged. */
typedef fmi2Status tl_fmi2_reserve_states(fmi2Component instance, size_t states);

/* Functions that an FMU may omit (see its capability flags) are NULL. */
typedef struct tl_fmi2 {
    fmi2GetTypesPlatformTYPE *get_types_platform;
    fmi2GetVersionTYPE *get_version;
    fmi2InstantiateTYPE *instantiate;
    fmi2FreeInstanceTYPE *free_instance;
    fmi2SetupExperimentTYPE *setup_experiment;
    fmi2EnterInitializationModeTYPE *enter_initialization_mode;
    fmi2ExitInitializationModeTYPE *exit_initialization_mode;
    fmi2TerminateTYPE *terminate;
    fmi2ResetTYPE *reset;
    fmi2GetRealTYPE *get_real;
    fmi2GetIntegerTYPE *get_integer;
    fmi2GetBooleanTYPE *get_boolean;
    fmi2GetStringTYPE *get_string;
    fmi2SetRealTYPE *set_real;
    fmi2SetIntegerTYPE *set_integer;
    fmi2SetBooleanTYPE *set_boolean;
    fmi2SetStringTYPE *set_string;
    fmi2GetFMUstateTYPE *get_fmu_state;                        /* optional */
    fmi2SetFMUstateTYPE *set_fmu_state;                        /* optional */
    fmi2FreeFMUstateTYPE *free_fmu_state;                      /* optional */
    fmi2SerializedFMUstateSizeTYPE *serialized_fmu_state_size; /* optional */
    fmi2SerializeFMUstateTYPE *serialize_fmu_state;            /* optional */
    fmi2DeSerializeFMUstateTYPE *deserialize_fmu_state;        /* optional */
    fmi2GetBooleanStatusTYPE *get_boolean_status;              /* optional */
    fmi2DoStepTYPE *do_step;
    tl_fmi2_step_reals *step_reals;         /* NULL: the three functions are called one by one */
    const tl_fmi2_fallback *fallback;       /* NULL: there is no other method */
    tl_fmi2_announce_ports *announce_ports; /* NULL: not needed */
    tl_fmi2_replay replay;
    bool prefers_copies;                    /* copies of its memory are chosen, also if its own states are faster */
    bool always_final;                      /* rollback by copy or replay: every step is marked as final */
    tl_fmi2_state_size *state_size;         /* NULL: the size is not known */
    tl_fmi2_reserve_states *reserve_states; /* NULL: each state is allocated when it is saved */
} tl_fmi2;

#endif
