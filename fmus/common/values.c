/* Reads and sets variables, and reports the status of the last step.
 *
 * A set call with one wrong reference or value is rejected as a whole: all are checked before any
 * is written.
 */
#include "fmus/common/instance.h"

#include <math.h>
#include <string.h>

#define MODEL tl_fmu_model_of_this_fmu

static const tl_fmu_variable *find(tl_fmu_type type, fmi2ValueReference reference) {
    for (size_t i = 0; i < MODEL.variable_count; i++) {
        if (MODEL.variables[i].type == type && MODEL.variables[i].reference == reference) {
            return &MODEL.variables[i];
        }
    }
    return NULL;
}

static size_t size_of(tl_fmu_type type) {
    switch (type) {
    case TL_FMU_REAL:
        return sizeof(fmi2Real);
    case TL_FMU_INTEGER:
        return sizeof(fmi2Integer);
    default:
        return sizeof(fmi2Boolean);
    }
}

/* During initialisation, results that need external data are computed only when they are read,
 * because parameters may be set in any order. */
static fmi2Status make_results(const tl_fmu_instance *instance, const char *function, tl_fmu_role role) {
    if (instance->state->mode != TL_FMU_INITIALISING || role != TL_FMU_RESULT || !instance->outside) {
        return fmi2OK;
    }
    return tl_fmu_look_outside(instance, function, 0, false);
}

static fmi2Status get(fmi2Component component, const char *function, tl_fmu_type type,
                      const fmi2ValueReference references[], size_t count, void *values) {
    tl_fmu_instance *instance = tl_fmu_enter(component, function, TL_FMU_GETTABLE);
    if (!instance) {
        return fmi2Error;
    }
    const char *model = (const char *)instance->state->model;
    const size_t size = size_of(type);
    for (size_t i = 0; i < count; i++) {
        const tl_fmu_variable *variable = find(type, references[i]);
        if (!variable) {
            return tl_fmu_refuse(instance, "%s: no variable of this type has value reference %u", function,
                                 references[i]);
        }
        if (make_results(instance, function, variable->role) != fmi2OK) {
            return fmi2Error;
        }
        memcpy((char *)values + i * size, model + variable->offset, size);
    }
    return fmi2OK;
}

/* Returns fmi2OK if every variable exists and may be set now. */
static fmi2Status check_set(const tl_fmu_instance *instance, const char *function, tl_fmu_type type,
                            const fmi2ValueReference references[], size_t count) {
    for (size_t i = 0; i < count; i++) {
        const tl_fmu_variable *variable = find(type, references[i]);
        if (!variable) {
            return tl_fmu_refuse(instance, "%s: no variable of this type has value reference %u", function,
                                 references[i]);
        }
        if (variable->role == TL_FMU_RESULT) {
            return tl_fmu_refuse(instance, "%s: value reference %u is computed by the model", function, references[i]);
        }
        if (variable->role == TL_FMU_FIXED && instance->state->mode == TL_FMU_STEPPING) {
            return tl_fmu_refuse(instance,
                                 "%s: value reference %u is a fixed parameter, settable until "
                                 "initialization ends",
                                 function, references[i]);
        }
    }
    return fmi2OK;
}

/* Any number except 0 means true. It is stored as fmi2True so that values can be compared. */
static void normalise_boolean(void *member) {
    fmi2Boolean value;
    memcpy(&value, member, sizeof value);
    value = value != fmi2False ? fmi2True : fmi2False;
    memcpy(member, &value, sizeof value);
}

static fmi2Status set(fmi2Component component, const char *function, tl_fmu_type type,
                      const fmi2ValueReference references[], size_t count, const void *values) {
    tl_fmu_instance *instance = tl_fmu_enter(component, function, TL_FMU_SETTABLE);
    if (!instance || check_set(instance, function, type, references, count) != fmi2OK) {
        return fmi2Error;
    }
    char *model = (char *)instance->state->model;
    const size_t size = size_of(type);
    for (size_t i = 0; i < count; i++) {
        char *member = model + find(type, references[i])->offset;
        memcpy(member, (const char *)values + i * size, size);
        if (type == TL_FMU_BOOLEAN) {
            normalise_boolean(member);
        }
    }
    if (instance->state->mode == TL_FMU_INITIALISING) {
        MODEL.start(model); /* so that results read before fmi2ExitInitializationMode are right */
    }
    return fmi2OK;
}

fmi2Status fmi2GetReal(fmi2Component component, const fmi2ValueReference references[], size_t count,
                       fmi2Real values[]) {
    return get(component, "fmi2GetReal", TL_FMU_REAL, references, count, values);
}

fmi2Status fmi2GetInteger(fmi2Component component, const fmi2ValueReference references[], size_t count,
                          fmi2Integer values[]) {
    return get(component, "fmi2GetInteger", TL_FMU_INTEGER, references, count, values);
}

fmi2Status fmi2GetBoolean(fmi2Component component, const fmi2ValueReference references[], size_t count,
                          fmi2Boolean values[]) {
    return get(component, "fmi2GetBoolean", TL_FMU_BOOLEAN, references, count, values);
}

fmi2Status fmi2SetReal(fmi2Component component, const fmi2ValueReference references[], size_t count,
                       const fmi2Real values[]) {
    for (size_t i = 0; component && i < count; i++) {
        if (!isfinite(values[i])) {
            return tl_fmu_refuse(component, "fmi2SetReal: the value for value reference %u is %g, not finite",
                                 references[i], values[i]);
        }
    }
    return set(component, "fmi2SetReal", TL_FMU_REAL, references, count, values);
}

fmi2Status fmi2SetInteger(fmi2Component component, const fmi2ValueReference references[], size_t count,
                          const fmi2Integer values[]) {
    return set(component, "fmi2SetInteger", TL_FMU_INTEGER, references, count, values);
}

fmi2Status fmi2SetBoolean(fmi2Component component, const fmi2ValueReference references[], size_t count,
                          const fmi2Boolean values[]) {
    return set(component, "fmi2SetBoolean", TL_FMU_BOOLEAN, references, count, values);
}

fmi2Status fmi2GetString(fmi2Component component, const fmi2ValueReference references[], size_t count,
                         fmi2String values[]) {
    tl_fmu_instance *instance = tl_fmu_enter(component, "fmi2GetString", TL_FMU_GETTABLE);
    if (!instance) {
        return fmi2Error;
    }
    for (size_t i = 0; i < count; i++) {
        const tl_fmu_variable *variable = find(TL_FMU_STRING, references[i]);
        if (!variable) {
            return tl_fmu_refuse(instance, "fmi2GetString: no variable of this type has value reference %u",
                                 references[i]);
        }
        values[i] = (const char *)instance->state->model + variable->offset;
    }
    return fmi2OK;
}

fmi2Status fmi2SetString(fmi2Component component, const fmi2ValueReference references[], size_t count,
                         const fmi2String values[]) {
    tl_fmu_instance *instance = tl_fmu_enter(component, "fmi2SetString", TL_FMU_SETTABLE);
    if (!instance || check_set(instance, "fmi2SetString", TL_FMU_STRING, references, count) != fmi2OK) {
        return fmi2Error;
    }
    for (size_t i = 0; i < count; i++) {
        if (!values[i] || strlen(values[i]) >= sizeof(tl_fmu_text)) {
            return tl_fmu_refuse(instance,
                                 "fmi2SetString: the text for value reference %u is missing or has more than %zu bytes",
                                 references[i], sizeof(tl_fmu_text) - 1);
        }
    }
    for (size_t i = 0; i < count; i++) {
        char *text = (char *)instance->state->model + find(TL_FMU_STRING, references[i])->offset;
        memset(text, 0, sizeof(tl_fmu_text)); /* so that a serialised state has no remains of earlier texts */
        memcpy(text, values[i], strlen(values[i]));
    }
    if (instance->state->mode == TL_FMU_INITIALISING) {
        MODEL.start(instance->state->model);
    }
    return fmi2OK;
}

/* Rejects functions that modelDescription.xml does not declare. */
static fmi2Status refuse_missing(fmi2Component component, const char *function) {
    tl_fmu_instance *instance = tl_fmu_enter(component, function, TL_FMU_ANY_MODE);
    return instance ? tl_fmu_refuse(instance, "%s: not provided by this FMU", function) : fmi2Error;
}

fmi2Status fmi2GetDirectionalDerivative(fmi2Component component, const fmi2ValueReference unknowns[],
                                        size_t unknown_count, const fmi2ValueReference knowns[], size_t known_count,
                                        const fmi2Real known_seeds[], fmi2Real unknown_seeds[]) {
    (void)unknowns;
    (void)unknown_count;
    (void)knowns;
    (void)known_count;
    (void)known_seeds;
    (void)unknown_seeds;
    return refuse_missing(component, "fmi2GetDirectionalDerivative");
}

fmi2Status fmi2SetRealInputDerivatives(fmi2Component component, const fmi2ValueReference references[], size_t count,
                                       const fmi2Integer orders[], const fmi2Real values[]) {
    (void)references;
    (void)count;
    (void)orders;
    (void)values;
    return refuse_missing(component, "fmi2SetRealInputDerivatives");
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component component, const fmi2ValueReference references[], size_t count,
                                        const fmi2Integer orders[], fmi2Real values[]) {
    (void)references;
    (void)count;
    (void)orders;
    (void)values;
    return refuse_missing(component, "fmi2GetRealOutputDerivatives");
}

/* Returns fmi2Discard for a status that is not stored, as FMI 2.0 (4.2.3) requires; steps are never
 * pending. */
static fmi2Status not_kept(fmi2Component component, const char *function) {
    const int modes = TL_FMU_STEPPING | TL_FMU_FAILED | TL_FMU_TERMINATED;
    return tl_fmu_enter(component, function, modes) ? fmi2Discard : fmi2Error;
}

fmi2Status fmi2GetStatus(fmi2Component component, const fmi2StatusKind kind, fmi2Status *value) {
    (void)kind;
    (void)value;
    return not_kept(component, "fmi2GetStatus");
}

fmi2Status fmi2GetRealStatus(fmi2Component component, const fmi2StatusKind kind, fmi2Real *value) {
    const fmi2Status status = not_kept(component, "fmi2GetRealStatus");
    if (status == fmi2Discard && kind == fmi2LastSuccessfulTime) {
        *value = ((const tl_fmu_instance *)component)->state->time;
        return fmi2OK;
    }
    return status;
}

fmi2Status fmi2GetIntegerStatus(fmi2Component component, const fmi2StatusKind kind, fmi2Integer *value) {
    (void)kind;
    (void)value;
    return not_kept(component, "fmi2GetIntegerStatus");
}

fmi2Status fmi2GetBooleanStatus(fmi2Component component, const fmi2StatusKind kind, fmi2Boolean *value) {
    const fmi2Status status = not_kept(component, "fmi2GetBooleanStatus");
    if (status == fmi2Discard && kind == fmi2Terminated) {
        *value = fmi2False; /* no model terminates on its own */
        return fmi2OK;
    }
    return status;
}

fmi2Status fmi2GetStringStatus(fmi2Component component, const fmi2StatusKind kind, fmi2String *value) {
    (void)kind;
    (void)value;
    return not_kept(component, "fmi2GetStringStatus");
}
