/* Shared code of the benchmark FMUs: instances and states as plain memory, and the FMI 2.0
 * functions that these FMUs do not need. */
#include "tests/bench/fmus/frame.h"

#include <stdlib.h>
#include <string.h>

#include "fmi2Functions.h"

/* ---- Instances ---- */

static void begin(void *instance) {
    if (model.defaults != NULL) {
        memcpy(instance, model.defaults, model.size);
    } else {
        memset(instance, 0, model.size);
    }
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *callbacks, fmi2Boolean visible, fmi2Boolean logging) {
    (void)name;
    (void)resources;
    (void)callbacks;
    (void)visible;
    (void)logging;
    void *instance = type == fmi2CoSimulation && strcmp(guid, model.guid) == 0 ? malloc(model.size) : NULL;
    if (instance != NULL) {
        begin(instance);
    }
    return instance;
}

void fmi2FreeInstance(fmi2Component component) {
    free(component);
}

fmi2Status fmi2Reset(fmi2Component component) {
    begin(component);
    return fmi2OK;
}

/* ---- States ---- */

fmi2Status fmi2GetFMUstate(fmi2Component component, fmi2FMUstate *state) {
    if (*state == NULL) {
        *state = malloc(model.size);
    }
    if (*state == NULL) {
        return fmi2Error;
    }
    memcpy(*state, component, model.size);
    return fmi2OK;
}

fmi2Status fmi2SetFMUstate(fmi2Component component, fmi2FMUstate state) {
    memcpy(component, state, model.size);
    return fmi2OK;
}

fmi2Status fmi2FreeFMUstate(fmi2Component component, fmi2FMUstate *state) {
    (void)component;
    free(*state);
    *state = NULL;
    return fmi2OK;
}

/* ---- Types, version, logging ---- */

const char *fmi2GetTypesPlatform(void) {
    return fmi2TypesPlatform;
}

const char *fmi2GetVersion(void) {
    return fmi2Version;
}

fmi2Status fmi2SetDebugLogging(fmi2Component component, fmi2Boolean on, size_t count, const fmi2String categories[]) {
    (void)component;
    (void)on;
    (void)count;
    (void)categories;
    return fmi2OK;
}

/* ---- Modes: there is nothing to do in them ---- */

fmi2Status fmi2SetupExperiment(fmi2Component component, fmi2Boolean has_tolerance, fmi2Real tolerance, fmi2Real start,
                               fmi2Boolean has_stop, fmi2Real stop) {
    (void)component;
    (void)has_tolerance;
    (void)tolerance;
    (void)start;
    (void)has_stop;
    (void)stop;
    return fmi2OK;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component component) {
    (void)component;
    return fmi2OK;
}

fmi2Status fmi2ExitInitializationMode(fmi2Component component) {
    (void)component;
    return fmi2OK;
}

fmi2Status fmi2Terminate(fmi2Component component) {
    (void)component;
    return fmi2OK;
}

/* ---- Types that no variable has ---- */

static fmi2Status take_none(size_t count) {
    return count == 0 ? fmi2OK : fmi2Error;
}

fmi2Status fmi2GetInteger(fmi2Component component, const fmi2ValueReference references[], size_t count,
                          fmi2Integer values[]) {
    (void)component;
    (void)references;
    (void)values;
    return take_none(count);
}

fmi2Status fmi2GetBoolean(fmi2Component component, const fmi2ValueReference references[], size_t count,
                          fmi2Boolean values[]) {
    (void)component;
    (void)references;
    (void)values;
    return take_none(count);
}

fmi2Status fmi2GetString(fmi2Component component, const fmi2ValueReference references[], size_t count,
                         fmi2String values[]) {
    (void)component;
    (void)references;
    (void)values;
    return take_none(count);
}

fmi2Status fmi2SetInteger(fmi2Component component, const fmi2ValueReference references[], size_t count,
                          const fmi2Integer values[]) {
    (void)component;
    (void)references;
    (void)values;
    return take_none(count);
}

fmi2Status fmi2SetBoolean(fmi2Component component, const fmi2ValueReference references[], size_t count,
                          const fmi2Boolean values[]) {
    (void)component;
    (void)references;
    (void)values;
    return take_none(count);
}

fmi2Status fmi2SetString(fmi2Component component, const fmi2ValueReference references[], size_t count,
                         const fmi2String values[]) {
    (void)component;
    (void)references;
    (void)values;
    return take_none(count);
}

/* ---- Capabilities that the descriptions do not claim ---- */

fmi2Status fmi2SerializedFMUstateSize(fmi2Component component, fmi2FMUstate state, size_t *size) {
    (void)component;
    (void)state;
    (void)size;
    return fmi2Error;
}

fmi2Status fmi2SerializeFMUstate(fmi2Component component, fmi2FMUstate state, fmi2Byte bytes[], size_t size) {
    (void)component;
    (void)state;
    (void)bytes;
    (void)size;
    return fmi2Error;
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component component, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state) {
    (void)component;
    (void)bytes;
    (void)size;
    (void)state;
    return fmi2Error;
}

fmi2Status fmi2GetDirectionalDerivative(fmi2Component component, const fmi2ValueReference unknowns[],
                                        size_t unknown_count, const fmi2ValueReference knowns[], size_t known_count,
                                        const fmi2Real seed[], fmi2Real sensitivity[]) {
    (void)component;
    (void)unknowns;
    (void)unknown_count;
    (void)knowns;
    (void)known_count;
    (void)seed;
    (void)sensitivity;
    return fmi2Error;
}

fmi2Status fmi2SetRealInputDerivatives(fmi2Component component, const fmi2ValueReference references[], size_t count,
                                       const fmi2Integer orders[], const fmi2Real values[]) {
    (void)component;
    (void)references;
    (void)orders;
    (void)values;
    return take_none(count);
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component component, const fmi2ValueReference references[], size_t count,
                                        const fmi2Integer orders[], fmi2Real values[]) {
    (void)component;
    (void)references;
    (void)orders;
    (void)values;
    return take_none(count);
}

/* ---- Asynchronous steps: there are none ---- */

fmi2Status fmi2CancelStep(fmi2Component component) {
    (void)component;
    return fmi2Error;
}

fmi2Status fmi2GetStatus(fmi2Component component, const fmi2StatusKind kind, fmi2Status *value) {
    (void)component;
    (void)kind;
    (void)value;
    return fmi2Discard;
}

fmi2Status fmi2GetRealStatus(fmi2Component component, const fmi2StatusKind kind, fmi2Real *value) {
    (void)component;
    (void)kind;
    (void)value;
    return fmi2Discard;
}

fmi2Status fmi2GetIntegerStatus(fmi2Component component, const fmi2StatusKind kind, fmi2Integer *value) {
    (void)component;
    (void)kind;
    (void)value;
    return fmi2Discard;
}

fmi2Status fmi2GetBooleanStatus(fmi2Component component, const fmi2StatusKind kind, fmi2Boolean *value) {
    (void)component;
    (void)kind;
    (void)value;
    return fmi2Discard;
}

fmi2Status fmi2GetStringStatus(fmi2Component component, const fmi2StatusKind kind, fmi2String *value) {
    (void)component;
    (void)kind;
    (void)value;
    return fmi2Discard;
}
