/* FMI functions of a hostile FMU. Each first runs hostile_before(), and then the function of the
 * good FMU. */
#include <fmi2Functions.h>
#include <stdlib.h>
#include <string.h>

#include "tests/fmu/hostile/hostile.h"

fmi2InstantiateTYPE inner_instantiate;
fmi2FreeInstanceTYPE inner_free_instance;
fmi2SetupExperimentTYPE inner_setup_experiment;
fmi2EnterInitializationModeTYPE inner_enter_initialization_mode;
fmi2ExitInitializationModeTYPE inner_exit_initialization_mode;
fmi2TerminateTYPE inner_terminate;
fmi2ResetTYPE inner_reset;
fmi2GetRealTYPE inner_get_real;
fmi2SetRealTYPE inner_set_real;
fmi2GetFMUstateTYPE inner_get_state;
fmi2SetFMUstateTYPE inner_set_state;
fmi2FreeFMUstateTYPE inner_free_state;
fmi2SerializedFMUstateSizeTYPE inner_serialized_size;
fmi2SerializeFMUstateTYPE inner_serialize;
fmi2DeSerializeFMUstateTYPE inner_deserialize;
fmi2DoStepTYPE inner_do_step;

const fmi2CallbackFunctions *hostile_callbacks;

__attribute__((constructor)) static void load(void) {
    (void)hostile_before("load");
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean logging) {
    hostile_callbacks = functions;
    return hostile_before("fmi2Instantiate")
               ? inner_instantiate(name, type, guid, resources, functions, visible, logging)
               : NULL;
}

void fmi2FreeInstance(fmi2Component component) {
    (void)hostile_before("fmi2FreeInstance");
    inner_free_instance(component);
}

fmi2Status fmi2SetupExperiment(fmi2Component component, fmi2Boolean has_tolerance, fmi2Real tolerance, fmi2Real start,
                               fmi2Boolean has_stop, fmi2Real stop) {
#ifdef STARTS_AT_0
    if (start > 0.0) {
        return fmi2Error;
    }
#endif
    return hostile_before("fmi2SetupExperiment")
               ? inner_setup_experiment(component, has_tolerance, tolerance, start, has_stop, stop)
               : fmi2Error;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component component) {
    return hostile_before("fmi2EnterInitializationMode") ? inner_enter_initialization_mode(component) : fmi2Error;
}

fmi2Status fmi2ExitInitializationMode(fmi2Component component) {
    return hostile_before("fmi2ExitInitializationMode") ? inner_exit_initialization_mode(component) : fmi2Error;
}

fmi2Status fmi2Terminate(fmi2Component component) {
    return hostile_before("fmi2Terminate") ? inner_terminate(component) : fmi2Error;
}

/* The status of a fmi2Reset that fails. */
#ifndef RESET
#define RESET fmi2Error
#endif

fmi2Status fmi2Reset(fmi2Component component) {
    return hostile_before("fmi2Reset") ? inner_reset(component) : RESET;
}

fmi2Status fmi2GetReal(fmi2Component component, const fmi2ValueReference references[], size_t count,
                       fmi2Real values[]) {
    return hostile_before("fmi2GetReal") ? inner_get_real(component, references, count, values) : fmi2Error;
}

fmi2Status fmi2SetReal(fmi2Component component, const fmi2ValueReference references[], size_t count,
                       const fmi2Real values[]) {
    return hostile_before("fmi2SetReal") ? inner_set_real(component, references, count, values) : fmi2Error;
}

/* A state: that of the good FMU, and BALLAST unused bytes. */
#ifndef BALLAST
#define BALLAST 0
#endif

typedef struct heavy_state {
    fmi2FMUstate inner;
    unsigned char ballast[BALLAST + 1];
} heavy_state;

/* Returns the given state, or a new one. Writes all bytes of a new one, so that its pages exist. */
static heavy_state *ready(fmi2FMUstate *state) {
    if (*state == NULL) {
        heavy_state *made = malloc(sizeof *made);
        if (made != NULL) {
            memset(made, 1, sizeof *made);
            made->inner = NULL;
        }
        *state = made;
    }
    return *state;
}

fmi2Status fmi2GetFMUstate(fmi2Component component, fmi2FMUstate *state) {
    return hostile_before("fmi2GetFMUstate") && ready(state) != NULL
               ? inner_get_state(component, &((heavy_state *)*state)->inner)
               : fmi2Error;
}

fmi2Status fmi2SetFMUstate(fmi2Component component, fmi2FMUstate state) {
    return hostile_before("fmi2SetFMUstate") ? inner_set_state(component, ((heavy_state *)state)->inner) : fmi2Error;
}

fmi2Status fmi2FreeFMUstate(fmi2Component component, fmi2FMUstate *state) {
    heavy_state *heavy = *state;
    bool allowed = hostile_before("fmi2FreeFMUstate");
    *state = NULL;
    fmi2Status status = allowed && heavy != NULL ? inner_free_state(component, &heavy->inner) : fmi2Error;
    free(heavy);
    return status;
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component component, fmi2FMUstate state, size_t *size) {
    return hostile_before("fmi2SerializedFMUstateSize")
               ? inner_serialized_size(component, ((heavy_state *)state)->inner, size)
               : fmi2Error;
}

fmi2Status fmi2SerializeFMUstate(fmi2Component component, fmi2FMUstate state, fmi2Byte bytes[], size_t size) {
    return hostile_before("fmi2SerializeFMUstate")
               ? inner_serialize(component, ((heavy_state *)state)->inner, bytes, size)
               : fmi2Error;
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component component, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state) {
    return hostile_before("fmi2DeSerializeFMUstate") && ready(state) != NULL
               ? inner_deserialize(component, bytes, size, &((heavy_state *)*state)->inner)
               : fmi2Error;
}

fmi2Status fmi2DoStep(fmi2Component component, fmi2Real point, fmi2Real size, fmi2Boolean no_set_state_prior) {
    return hostile_before("fmi2DoStep") ? inner_do_step(component, point, size, no_set_state_prior) : fmi2Error;
}
