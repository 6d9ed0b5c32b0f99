/* Life cycle of an instance: instantiate, initialise, step, terminate, reset, free.
 *
 * A macro step consists of equal inner steps. Their number is the macro step divided by t_step,
 * rounded to the nearest integer. If the result fits within a millionth, an inner step is exactly
 * t_step, so that rounding of the importer's clock does not change a result. A model of whole steps
 * has one inner step: the macro step.
 */
#include "fmus/common/instance.h"

#include <float.h>
#include <math.h>
#include <string.h>

#define MODEL tl_fmu_model_of_this_fmu

static const double FIT = 1e-6;            /* of a step: tolerance for comparing times */
static const double MAX_INNER_STEPS = 1e6; /* in one macro step; more can only be a mistake */

const char *fmi2GetTypesPlatform(void) {
    return fmi2TypesPlatform;
}

const char *fmi2GetVersion(void) {
    return fmi2Version;
}

fmi2Component fmi2Instantiate(fmi2String instance_name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean logging_on) {
    (void)resources;
    (void)visible;
    if (!functions) {
        return NULL;
    }
    char no_name[] = "";
    const tl_fmu_instance nameless = {
        .name = no_name, .logger = functions->logger, .environment = functions->componentEnvironment};
    if (!instance_name || !*instance_name) {
        (void)tl_fmu_refuse(&nameless, "fmi2Instantiate: the instance needs a name");
        return NULL;
    }
    if (type != fmi2CoSimulation) {
        (void)tl_fmu_refuse(&nameless, "fmi2Instantiate: this FMU is for co-simulation only");
        return NULL;
    }
    if (!guid || strcmp(guid, MODEL.guid) != 0) {
        (void)tl_fmu_refuse(&nameless, "fmi2Instantiate: the GUID given is not that of this FMU, %s", MODEL.guid);
        return NULL;
    }
    tl_fmu_instance *instance = tl_fmu_create(instance_name, functions);
    if (!instance) {
        (void)tl_fmu_refuse(&nameless, "fmi2Instantiate: out of memory");
        return NULL;
    }
    instance->log_events = logging_on != fmi2False;
    tl_fmu_log_event(instance, "instantiated");
    return instance;
}

void fmi2FreeInstance(fmi2Component component) {
    if (component) {
        tl_fmu_release(component);
    }
}

fmi2Status fmi2SetDebugLogging(fmi2Component component, fmi2Boolean on, size_t count, const fmi2String categories[]) {
    tl_fmu_instance *instance = tl_fmu_enter(component, "fmi2SetDebugLogging", TL_FMU_ANY_MODE);
    if (!instance) {
        return fmi2Error;
    }
    bool events = count == 0;
    for (size_t i = 0; i < count; i++) {
        if (strcmp(categories[i], "logEvents") == 0) {
            events = true;
        } else if (strcmp(categories[i], "logStatusError") != 0) {
            return tl_fmu_refuse(instance, "fmi2SetDebugLogging: categories are logEvents and logStatusError");
        }
    }
    instance->log_events = on && events;
    return fmi2OK;
}

fmi2Status fmi2SetupExperiment(fmi2Component component, fmi2Boolean tolerance_defined, fmi2Real tolerance,
                               fmi2Real start_time, fmi2Boolean stop_time_defined, fmi2Real stop_time) {
    (void)tolerance_defined;
    (void)tolerance;
    tl_fmu_instance *instance = tl_fmu_enter(component, "fmi2SetupExperiment", TL_FMU_INSTANTIATED);
    if (!instance) {
        return fmi2Error;
    }
    if (!isfinite(start_time) || (stop_time_defined && !(stop_time >= start_time))) {
        return tl_fmu_refuse(instance, "fmi2SetupExperiment: from %g s to %g s is no span of time", start_time,
                             stop_time);
    }
    instance->state->time = start_time;
    instance->state->stop_time = stop_time_defined ? stop_time : HUGE_VAL;
    return fmi2OK;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component component) {
    tl_fmu_instance *instance = tl_fmu_enter(component, "fmi2EnterInitializationMode", TL_FMU_INSTANTIATED);
    if (!instance) {
        return fmi2Error;
    }
    MODEL.start(instance->state->model);
    instance->state->mode = TL_FMU_INITIALISING;
    return fmi2OK;
}

/* Returns the inner step in s; HUGE_VAL if the model takes whole steps. */
static double inner_step_of(const tl_fmu_state *state) {
    double t_step = HUGE_VAL;
    if (MODEL.t_step == TL_FMU_WHOLE_STEPS) {
        return t_step;
    }
    memcpy(&t_step, (const char *)state->model + MODEL.t_step, sizeof t_step);
    return t_step;
}

fmi2Status fmi2ExitInitializationMode(fmi2Component component) {
    tl_fmu_instance *instance = tl_fmu_enter(component, "fmi2ExitInitializationMode", TL_FMU_INITIALISING);
    if (!instance) {
        return fmi2Error;
    }
    if (!(inner_step_of(instance->state) > 0)) {
        return tl_fmu_refuse(instance, "fmi2ExitInitializationMode: t_step is %g s and must be greater than 0",
                             inner_step_of(instance->state));
    }
    if (tl_fmu_look_outside(instance, "fmi2ExitInitializationMode", 0, false) != fmi2OK) {
        return fmi2Error;
    }
    if (!tl_fmu_results_finite(instance)) {
        return tl_fmu_refuse(instance, "fmi2ExitInitializationMode: these parameters give no finite start; "
                                       "look for a division by zero");
    }
    instance->state->mode = TL_FMU_STEPPING;
    tl_fmu_log_event(instance, "initialised");
    return fmi2OK;
}

/* Returns fmi2OK if a step from `point` over `size` seconds is allowed. */
static fmi2Status check_step(const tl_fmu_instance *instance, double point, double size) {
    const tl_fmu_state *state = instance->state;
    if (!(size >= 0) || !isfinite(size)) {
        return tl_fmu_refuse(instance, "fmi2DoStep: a step of %g s cannot be taken", size);
    }
    const double fit = FIT * size + 8 * DBL_EPSILON * fabs(state->time);
    if (!(fabs(point - state->time) <= fit)) {
        return tl_fmu_refuse(instance,
                             "fmi2DoStep: the communication point is %.17g s, but the instance is at "
                             "%.17g s",
                             point, state->time);
    }
    if (point + size > state->stop_time + fit) {
        return tl_fmu_refuse(instance, "fmi2DoStep: a step to %.17g s would pass the stop time, %.17g s", point + size,
                             state->stop_time);
    }
    if (size / inner_step_of(state) > MAX_INNER_STEPS) {
        return tl_fmu_refuse(instance, "fmi2DoStep: t_step of %g s is too small for a step of %g s",
                             inner_step_of(state), size);
    }
    return fmi2OK;
}

static void take_inner_steps(tl_fmu_state *state, double size) {
    const double t_step = inner_step_of(state);
    const double fitting = floor(size / t_step + 0.5);
    const int count = fitting < 1 ? 1 : (int)fitting;
    const bool fits = isfinite(t_step) && fabs(size - count * t_step) <= FIT * t_step;
    const double h = fits ? t_step : size / count;
    for (int i = 0; i < count; i++) {
        MODEL.step(state->model, h);
    }
}

fmi2Status fmi2DoStep(fmi2Component component, fmi2Real point, fmi2Real size, fmi2Boolean no_set_state_prior) {
    tl_fmu_instance *instance = tl_fmu_enter(component, "fmi2DoStep", TL_FMU_STEPPING);
    if (!instance || check_step(instance, point, size) != fmi2OK) {
        return fmi2Error;
    }
    if (size > 0) {
        take_inner_steps(instance->state, size);
    }
    if (tl_fmu_look_outside(instance, "fmi2DoStep", size, no_set_state_prior != fmi2False) != fmi2OK) {
        instance->state->mode = TL_FMU_FAILED;
        return fmi2Error;
    }
    if (!tl_fmu_results_finite(instance)) {
        instance->state->mode = TL_FMU_FAILED;
        return tl_fmu_refuse(instance,
                             "fmi2DoStep: the step from %.17g s diverged; restore a saved state, or "
                             "reset",
                             point);
    }
    instance->state->time = point + size;
    return fmi2OK;
}

fmi2Status fmi2CancelStep(fmi2Component component) {
    tl_fmu_instance *instance = tl_fmu_enter(component, "fmi2CancelStep", TL_FMU_ANY_MODE);
    return instance ? tl_fmu_refuse(instance, "fmi2CancelStep: steps are never pending") : fmi2Error;
}

fmi2Status fmi2Terminate(fmi2Component component) {
    tl_fmu_instance *instance = tl_fmu_enter(component, "fmi2Terminate", TL_FMU_STEPPING);
    if (!instance) {
        return fmi2Error;
    }
    instance->state->mode = TL_FMU_TERMINATED;
    tl_fmu_log_event(instance, "terminated");
    return fmi2OK;
}

fmi2Status fmi2Reset(fmi2Component component) {
    tl_fmu_instance *instance = tl_fmu_enter(component, "fmi2Reset", TL_FMU_ANY_MODE);
    if (!instance) {
        return fmi2Error;
    }
    if (instance->outside) {
        tl_fmu_outside *opened = MODEL.open();
        if (!opened) {
            return tl_fmu_refuse(instance, "fmi2Reset: out of memory");
        }
        MODEL.close(instance->outside);
        instance->outside = opened;
    }
    tl_fmu_set_defaults(instance);
    tl_fmu_log_event(instance, "reset");
    return fmi2OK;
}
