/* Function table of one loaded FMI 2.0 for Co-Simulation binary.
 *
 * Purpose: component.c calls an FMU through it. The module that loads the binary (firmware) fills
 *          it, so that the master knows neither files nor dlopen.
 * Source:  FMI 2.0.4, section 2.1 and 4.2.
 */
#ifndef TL_MASTER_FMI_FMI2_H
#define TL_MASTER_FMI_FMI2_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "fmi2FunctionTypes.h"

struct tl_ports;

/* One step of an instance. */
typedef struct tl_fmi2_step {
    fmi2Real now;      /* s: communication point */
    fmi2Real size;     /* s */
    fmi2Boolean final; /* no earlier state will be restored */
    bool last;         /* no other instance is stepped directly after this one */
} tl_fmi2_step;

/* Not part of FMI: fmi2SetReal, fmi2DoStep and fmi2GetReal in one call, for an instance that has no
 * other ports. A wrapper of an FMU then does its own work once and not three times, which matters
 * for a small FMU. *done counts the calls that were followed by another one; the status is that of
 * the last call. */
typedef fmi2Status tl_fmi2_step_reals(fmi2Component instance, const struct tl_ports *inputs,
                                      const struct tl_ports *outputs, const tl_fmi2_step *step, unsigned *done);

/* Duration of save, step and restore in two ways, ns. */
typedef struct tl_fmi2_times {
    int64_t by_states;
    int64_t by_copy;
} tl_fmi2_times;

/* Not part of FMI: another rollback method for an FMU whose own states may be wrong. `keep` makes a
 * full copy of the FMU, replacing the one before. `come_back` restores it. `give_up_states`
 * restores it and switches saving and restoring to this method. `let_go` frees the copy. `size`:
 * bytes of such a copy; 0: not known. fmi2Error: not possible, and the FMU has given the reason.
 * `has_choice`: the copy is one of the FMU's memory, and its states are its own, which may be
 * slower. `prefer_copy`, if so and while nothing else is kept: switches to copies, until
 * `give_up_states` switches back. */
typedef struct tl_fmi2_fallback {
    fmi2Status (*keep)(fmi2Component instance);
    fmi2Status (*come_back)(fmi2Component instance);
    fmi2Status (*give_up_states)(fmi2Component instance, const char *why);
    void (*let_go)(fmi2Component instance);
    size_t (*size)(fmi2Component instance);
    bool (*has_choice)(fmi2Component instance);
    fmi2Status (*prefer_copy)(fmi2Component instance, const tl_fmi2_times *times);
} tl_fmi2_fallback;

/* Not part of FMI: rollback by replay; the instance is reset and given its inputs again. Zeroed:
 * another method, or none. */
typedef struct tl_fmi2_replay {
    uint32_t most;     /* most steps from its start to a restored instant; 0: no replay */
    bool is_over;      /* it cannot be rolled back any more: its inputs did not fit, */
    bool differs;      /* or the repeated steps gave other outputs */
    uint64_t steps;    /* executed again */
    size_t bytes;      /* memory for its inputs */
    int64_t beginning; /* longest duration of a reset with initialisation so far, ns */
} tl_fmi2_replay;

/* Not part of FMI: tells an instance, before its first step, which ports are set and read in each
 * step. */
typedef void tl_fmi2_note_ports(fmi2Component instance, const struct tl_ports *inputs, const struct tl_ports *outputs);

/* Not part of FMI: bytes of one more state, if known without calling the FMU. */
typedef size_t tl_fmi2_state_size(fmi2Component instance);

/* Not part of FMI: reserves memory for so many states now, and none later. fmi2Error: memory is
 * out, and the error was logged. */
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
    tl_fmi2_step_reals *step_reals;    /* NULL: the three are called one by one */
    const tl_fmi2_fallback *full_copy; /* NULL: there is no such method */
    tl_fmi2_note_ports *know_ports;    /* NULL: not needed */
    tl_fmi2_replay replay;
    bool
        is_unaware; /* it is rolled back without its knowledge: no earlier state is ever restored from its point of view */
    tl_fmi2_state_size *state_size;         /* NULL: it is not known */
    tl_fmi2_reserve_states *reserve_states; /* NULL: each is created when it is saved */
} tl_fmi2;

#endif
