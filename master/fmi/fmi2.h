/* The functions of one loaded FMI 2.0 for Co-Simulation binary.
 *
 * Purpose: the table that component.c calls through. It is filled by whoever loads the binary (firmware), so
 *          that the master knows neither files nor dlopen.
 * Source:  FMI 2.0.4, section 2.1 and 4.2.
 */
#ifndef TL_MASTER_FMI_FMI2_H
#define TL_MASTER_FMI_FMI2_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "fmi2FunctionTypes.h"

struct tl_ports;

/* A step of an instance. */
typedef struct tl_fmi2_step {
    fmi2Real now;      /* s: communication point */
    fmi2Real size;     /* s */
    fmi2Boolean final; /* no earlier state will be restored */
    bool last;         /* no other instance is stepped right after this one */
} tl_fmi2_step;

/* Not FMI's: fmi2SetReal, fmi2DoStep and fmi2GetReal of one instance in one go, of an instance that has no other ports. Whoever stands
 * in front of an FMU has its own work once and not three times, which for a small FMU is the difference. *done counts the calls that
 * were followed by another one; the status is that of the last one made. */
typedef fmi2Status tl_fmi2_step_reals(fmi2Component instance, const struct tl_ports *inputs,
                                      const struct tl_ports *outputs, const tl_fmi2_step *step, unsigned *done);

/* ns that an FMU takes to be saved, stepped and led back, in two ways. */
typedef struct tl_fmi2_times {
    int64_t by_states;
    int64_t by_copy;
} tl_fmi2_times;

/* Not FMI's: of an FMU whose own states may be wrong, by a way of ours that needs none of them. `keep` keeps all that the FMU knows now, in place of what was
 * kept; `come_back` leads back there, as if nothing had been called since; `give_up_states` does so for good: from then on saving and restoring are of that way.
 * `let_go`: what was kept is not needed any more. `size`: bytes that it would take now; 0: not known. fmi2Error: it cannot be, and the FMU has said why.
 * `has_choice`: what was kept is a copy of its memory, and its states are its own, which may be slower. `prefer_copy`, if so and while nothing else is kept: from then on saving and
 * restoring are by copies, until `give_up_states` leads back to its own. */
typedef struct tl_fmi2_aside {
    fmi2Status (*keep)(fmi2Component instance);
    fmi2Status (*come_back)(fmi2Component instance);
    fmi2Status (*give_up_states)(fmi2Component instance, const char *why);
    void (*let_go)(fmi2Component instance);
    size_t (*size)(fmi2Component instance);
    bool (*has_choice)(fmi2Component instance);
    fmi2Status (*prefer_copy)(fmi2Component instance, const tl_fmi2_times *times);
} tl_fmi2_aside;

/* Not FMI's: of an instance that is reset and given again what it was given, to lead it back. Zeroed: it is led back otherwise, or not at all. */
typedef struct tl_fmi2_replay {
    uint32_t most;     /* steps from its beginning to where it can be led back; 0: see above */
    bool is_over;      /* nor to where it was since: there was no room for what it was given, */
    bool differs;      /* or it did not do again what it had done */
    uint64_t steps;    /* executed again */
    size_t bytes;      /* that what it was given has room in */
    int64_t beginning; /* ns that a reset and its initialisation take, at most so far */
} tl_fmi2_replay;

/* Not FMI's: before its first step, what will be set and read in each. */
typedef void tl_fmi2_know_ports(fmi2Component instance, const struct tl_ports *inputs, const struct tl_ports *outputs);

/* Not FMI's: bytes that one state more takes, if that is known without asking the FMU. */
typedef size_t tl_fmi2_state_size(fmi2Component instance);

/* Not FMI's: so many states more will be had at a time. Takes memory for them now, and none later. fmi2Error: there is none, and it was said. */
typedef fmi2Status tl_fmi2_reserve_states(fmi2Component instance, size_t states);

/* Functions an FMU may omit (its capability flags say so) are NULL. */
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
    fmi2DoStepTYPE *do_step;
    tl_fmi2_step_reals *step_reals; /* NULL: the three are called one by one */
    const tl_fmi2_aside *aside;     /* NULL: there is no such way */
    tl_fmi2_know_ports *know_ports; /* NULL: nobody asks */
    tl_fmi2_replay replay;
    bool is_unaware; /* it is led back in a way that it cannot know of: for it no earlier state is ever restored */
    tl_fmi2_state_size *state_size;         /* NULL: it is not known */
    tl_fmi2_reserve_states *reserve_states; /* NULL: each is made when it is saved */
} tl_fmi2;

#endif
