/* An FMU whose state has SIZE bytes; a step changes one byte in each of PAGES pages. For measuring
 * the cost of save and restore. Its variables are those of fmus/lag. Its state functions copy the
 * whole state. */
#include <fmi2Functions.h>
#include <stdlib.h>
#include <string.h>

enum { U = 0, Y = 1, T = 2, PAGE = 4096 };

typedef struct sized {
    double values[3];
    unsigned char bytes[SIZE];
} sized;

const char *fmi2GetTypesPlatform(void) {
    return fmi2TypesPlatform;
}

const char *fmi2GetVersion(void) {
    return fmi2Version;
}

fmi2Status fmi2SetDebugLogging(fmi2Component component, fmi2Boolean on, size_t count, const fmi2String categories[]) {
    (void)component, (void)on, (void)count, (void)categories;
    return fmi2OK;
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean logging) {
    (void)name, (void)type, (void)guid, (void)resources, (void)visible, (void)logging;
    sized *self = functions->allocateMemory(1, sizeof *self);
    if (self != NULL) {
        memset(self->bytes, 1, SIZE);
        self->values[T] = 0.1;
    }
    return self;
}

void fmi2FreeInstance(fmi2Component component) {
    free(component);
}

fmi2Status fmi2SetupExperiment(fmi2Component component, fmi2Boolean has_tolerance, fmi2Real tolerance, fmi2Real start,
                               fmi2Boolean has_stop, fmi2Real stop) {
    (void)component, (void)has_tolerance, (void)tolerance, (void)start, (void)has_stop, (void)stop;
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

fmi2Status fmi2Reset(fmi2Component component) {
    (void)component;
    return fmi2OK;
}

fmi2Status fmi2GetReal(fmi2Component component, const fmi2ValueReference references[], size_t count,
                       fmi2Real values[]) {
    const sized *self = component;
    for (size_t i = 0; i < count; i++) {
        values[i] = self->values[references[i]];
    }
    return fmi2OK;
}

fmi2Status fmi2SetReal(fmi2Component component, const fmi2ValueReference references[], size_t count,
                       const fmi2Real values[]) {
    sized *self = component;
    for (size_t i = 0; i < count; i++) {
        self->values[references[i]] = values[i];
    }
    return fmi2OK;
}

fmi2Status fmi2DoStep(fmi2Component component, fmi2Real now, fmi2Real step, fmi2Boolean final) {
    sized *self = component;
    (void)now, (void)step, (void) final;
    unsigned sum = 0;
    for (size_t i = 0; i < PAGES; i++) {
        unsigned char *byte = &self->bytes[i * PAGE % SIZE];
        *byte = (unsigned char)(*byte * 5 + 3);
        sum += *byte;
    }
    self->values[Y] = self->values[Y] * 0.9 + self->values[T] * self->values[U] + sum * 1e-6;
    return fmi2OK;
}

fmi2Status fmi2GetFMUstate(fmi2Component component, fmi2FMUstate *state) {
    *state = *state != NULL ? *state : malloc(sizeof(sized));
    if (*state != NULL) {
        memcpy(*state, component, sizeof(sized));
    }
    return *state != NULL ? fmi2OK : fmi2Error;
}

fmi2Status fmi2SetFMUstate(fmi2Component component, fmi2FMUstate state) {
    memcpy(component, state, sizeof(sized));
    return fmi2OK;
}

fmi2Status fmi2FreeFMUstate(fmi2Component component, fmi2FMUstate *state) {
    (void)component;
    free(*state);
    *state = NULL;
    return fmi2OK;
}

/* ---- what nobody calls, but must be there ---- */

fmi2Status fmi2CancelStep(fmi2Component component) {
    (void)component;
    return fmi2Error;
}

#define STATUS(name, type)                                                                                             \
    fmi2Status name(fmi2Component component, const fmi2StatusKind kind, type *value) {                                 \
        (void)component, (void)kind, (void)value;                                                                      \
        return fmi2Discard;                                                                                            \
    }

STATUS(fmi2GetStatus, fmi2Status)
STATUS(fmi2GetRealStatus, fmi2Real)
STATUS(fmi2GetIntegerStatus, fmi2Integer)
STATUS(fmi2GetBooleanStatus, fmi2Boolean)
STATUS(fmi2GetStringStatus, fmi2String)

#define ABSENT(name, type)                                                                                             \
    fmi2Status name(fmi2Component component, const fmi2ValueReference references[], size_t count, type values[]) {     \
        (void)component, (void)references, (void)values;                                                               \
        return count == 0 ? fmi2OK : fmi2Error;                                                                        \
    }

ABSENT(fmi2GetInteger, fmi2Integer)
ABSENT(fmi2GetBoolean, fmi2Boolean)
ABSENT(fmi2GetString, fmi2String)
ABSENT(fmi2SetInteger, const fmi2Integer)
ABSENT(fmi2SetBoolean, const fmi2Boolean)
ABSENT(fmi2SetString, const fmi2String)
