/* Memory, logging and the check of the mode, for all FMI functions. */
#include "fmus/common/instance.h"

#include <ctype.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define MODEL tl_fmu_model_of_this_fmu

static const char *mode_name(int64_t mode) {
    switch (mode) {
    case TL_FMU_INSTANTIATED:
        return "instantiated";
    case TL_FMU_INITIALISING:
        return "in initialization mode";
    case TL_FMU_STEPPING:
        return "stepping";
    case TL_FMU_FAILED:
        return "failed";
    default:
        return "terminated";
    }
}

/* The message is passed as the logger's format string, because many importers ignore further
 * arguments. So '%' and '#', which have a meaning there, are replaced; names and contents of files
 * may contain them. */
static void disarm(char *message) {
    for (char *c = message; *c; c++) {
        if (*c == '%' || *c == '#' || iscntrl((unsigned char)*c)) {
            *c = '?';
        }
    }
}

fmi2Status tl_fmu_refuse(const tl_fmu_instance *instance, const char *format, ...) {
    if (instance->logger) {
        char message[2048];
        va_list arguments;
        va_start(arguments, format);
        (void)vsnprintf(message, sizeof message, format, arguments);
        va_end(arguments);
        disarm(message);
        instance->logger(instance->environment, instance->name, fmi2Error, "logStatusError", message);
    }
    return fmi2Error;
}

void tl_fmu_log_event(const tl_fmu_instance *instance, const char *text) {
    if (instance->logger && instance->log_events) {
        instance->logger(instance->environment, instance->name, fmi2OK, "logEvents", text);
    }
}

tl_fmu_instance *tl_fmu_enter(fmi2Component component, const char *function, int modes) {
    tl_fmu_instance *instance = component;
    if (!instance) {
        return NULL;
    }
    if (!(instance->state->mode & modes)) {
        (void)tl_fmu_refuse(instance, "%s is not allowed while the instance is %s", function,
                            mode_name(instance->state->mode));
        return NULL;
    }
    return instance;
}

size_t tl_fmu_state_size(void) {
    return sizeof(tl_fmu_state) + MODEL.size;
}

void tl_fmu_set_defaults(tl_fmu_instance *instance) {
    tl_fmu_state *state = instance->state;
    memset(state, 0, tl_fmu_state_size());
    memcpy(state->guid, MODEL.guid, sizeof state->guid);
    memcpy(state->model, MODEL.defaults, MODEL.size);
    state->mode = TL_FMU_INSTANTIATED;
    state->stop_time = HUGE_VAL;
}

static void close_outside(tl_fmu_outside *outside) {
    if (outside) {
        MODEL.close(outside);
    }
}

tl_fmu_instance *tl_fmu_create(fmi2String name, const fmi2CallbackFunctions *functions) {
    tl_fmu_instance *instance = calloc(1, sizeof *instance);
    const size_t name_size = strlen(name) + 1;
    char *name_copy = malloc(name_size);
    tl_fmu_state *state = malloc(tl_fmu_state_size());
    tl_fmu_outside *outside = MODEL.open ? MODEL.open() : NULL;
    if (!instance || !name_copy || !state || (MODEL.open && !outside)) {
        close_outside(outside);
        free(state);
        free(name_copy);
        free(instance);
        return NULL;
    }
    instance->outside = outside;
    memcpy(name_copy, name, name_size);
    instance->name = name_copy;
    instance->logger = functions->logger;
    instance->environment = functions->componentEnvironment;
    instance->state = state;
    tl_fmu_set_defaults(instance);
    return instance;
}

void tl_fmu_release(tl_fmu_instance *instance) {
    close_outside(instance->outside);
    free(instance->state);
    free(instance->name);
    free(instance);
}

fmi2Status tl_fmu_look_outside(const tl_fmu_instance *instance, const char *function, double ahead, bool may_forget) {
    char why[1536] = "";
    const tl_fmu_look look = {instance->state->time + ahead, may_forget, why, sizeof why};
    if (instance->outside && !MODEL.look(instance->state->model, instance->outside, &look)) {
        return tl_fmu_refuse(instance, "%s: %s", function, why);
    }
    return fmi2OK;
}

bool tl_fmu_results_finite(const tl_fmu_instance *instance) {
    const char *model = (const char *)instance->state->model;
    for (size_t i = 0; i < MODEL.variable_count; i++) {
        const tl_fmu_variable *variable = &MODEL.variables[i];
        if (variable->role == TL_FMU_RESULT && variable->type == TL_FMU_REAL) {
            fmi2Real value;
            memcpy(&value, model + variable->offset, sizeof value);
            if (!isfinite(value)) {
                return false;
            }
        }
    }
    return true;
}
