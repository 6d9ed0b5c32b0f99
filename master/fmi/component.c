/* One instance of an FMU: see component.h. */
#include "master/fmi/component.h"

#include <math.h>

/* Judges the status of an FMI call; `call` is its name. */
static tl_status judge(tl_component *component, fmi2Status status, const char *call, tl_error *error) {
    switch (status) {
    case fmi2OK:
    case fmi2Warning:
        return TL_OK;
    case fmi2Discard:
        return tl_fail(error, TL_FMU_FAILED,
                       "%s: %s was discarded (fmi2Discard): the FMU could not do it with these "
                       "values; see its messages in the log",
                       component->name, call);
    case fmi2Error:
        component->mode = TL_MODE_FAILED;
        return tl_fail(error, TL_FMU_FAILED, "%s: %s failed (fmi2Error); see the FMU's messages in the log",
                       component->name, call);
    case fmi2Pending:
        component->mode = TL_MODE_FAILED;
        return tl_fail(error, TL_FMU_FAILED, "%s: %s answered fmi2Pending although no asynchronous step was offered",
                       component->name, call);
    case fmi2Fatal:
        break;
    }
    component->mode = TL_MODE_DEAD;
    return tl_fail(error, TL_FMU_FATAL, "%s: %s failed for good (fmi2Fatal); this FMU cannot be used any more",
                   component->name, call);
}

tl_status tl_component_instantiate(tl_component *component, const fmi2CallbackFunctions *callbacks,
                                   const char *resources, tl_error *error) {
    component->instance = component->fmi->instantiate(component->name, fmi2CoSimulation, component->model->guid,
                                                      resources, callbacks, fmi2False, fmi2False);
    if (component->instance == NULL) {
        return tl_fail(error, TL_FMU_FAILED,
                       "%s: fmi2Instantiate refused; the usual cause is a GUID of "
                       "modelDescription.xml (%s) that is not the binary's: export the FMU again",
                       component->name, component->model->guid);
    }
    component->mode = TL_MODE_INSTANTIATED;
    return TL_OK;
}

tl_status tl_component_set_start(tl_component *component, const tl_variable *variable, const tl_value *value,
                                 tl_error *error) {
    const tl_fmi2 *fmi = component->fmi;
    fmi2ValueReference reference = variable->reference;
    fmi2Integer integer = value->integer;
    fmi2Boolean boolean = value->integer != 0 ? fmi2True : fmi2False;
    fmi2String text = value->text;
    switch (variable->type) {
    case TL_REAL:
        return judge(component, fmi->set_real(component->instance, &reference, 1, &value->real), "fmi2SetReal", error);
    case TL_INTEGER:
    case TL_ENUMERATION:
        return judge(component, fmi->set_integer(component->instance, &reference, 1, &integer), "fmi2SetInteger",
                     error);
    case TL_BOOLEAN:
        return judge(component, fmi->set_boolean(component->instance, &reference, 1, &boolean), "fmi2SetBoolean",
                     error);
    case TL_STRING:
        return judge(component, fmi->set_string(component->instance, &reference, 1, &text), "fmi2SetString", error);
    }
    return tl_fail(error, TL_BAD_DATA, "%s.%s: unknown base type", component->name, variable->name);
}

tl_status tl_component_enter_initialization(tl_component *component, tl_error *error) {
    const tl_fmi2 *fmi = component->fmi;
    tl_status status = judge(component, fmi->setup_experiment(component->instance, fmi2False, 0.0, 0.0, fmi2False, 0.0),
                             "fmi2SetupExperiment", error);
    if (status != TL_OK) {
        return status;
    }
    component->mode = TL_MODE_INITIALIZING;
    return judge(component, fmi->enter_initialization_mode(component->instance), "fmi2EnterInitializationMode", error);
}

tl_status tl_component_exit_initialization(tl_component *component, tl_error *error) {
    tl_status status = judge(component, component->fmi->exit_initialization_mode(component->instance),
                             "fmi2ExitInitializationMode", error);
    if (status == TL_OK) {
        component->mode = TL_MODE_STEPPING;
    }
    return status;
}

tl_status tl_component_set_inputs(tl_component *component, tl_error *error) {
    const tl_ports *in = &component->inputs;
    const tl_fmi2 *fmi = component->fmi;
    fmi2Status status = fmi2OK;
    if (in->real_count != 0) {
        status = fmi->set_real(component->instance, in->real_references, in->real_count, in->reals);
        if (status > fmi2Warning) {
            return judge(component, status, "fmi2SetReal", error);
        }
    }
    if (in->integer_count != 0) {
        status = fmi->set_integer(component->instance, in->integer_references, in->integer_count, in->integers);
        if (status > fmi2Warning) {
            return judge(component, status, "fmi2SetInteger", error);
        }
    }
    if (in->boolean_count != 0) {
        status = fmi->set_boolean(component->instance, in->boolean_references, in->boolean_count, in->booleans);
        if (status > fmi2Warning) {
            return judge(component, status, "fmi2SetBoolean", error);
        }
    }
    return TL_OK;
}

/* Finite reals; booleans as 0 and 1, so that equal values have equal bits. */
static tl_status tidy_outputs(tl_component *component, tl_error *error) {
    const tl_ports *out = &component->outputs;
    for (size_t i = 0; i < out->real_count; i++) {
        if (!isfinite(out->reals[i])) {
            return tl_fail(error, TL_FMU_FAILED, "%s: the Real output with value reference %u is not finite",
                           component->name, (unsigned)out->real_references[i]);
        }
    }
    for (size_t i = 0; i < out->boolean_count; i++) {
        out->booleans[i] = out->booleans[i] != fmi2False ? fmi2True : fmi2False;
    }
    return TL_OK;
}

tl_status tl_component_get_outputs(tl_component *component, tl_error *error) {
    const tl_ports *out = &component->outputs;
    const tl_fmi2 *fmi = component->fmi;
    fmi2Status status = fmi2OK;
    if (out->real_count != 0) {
        status = fmi->get_real(component->instance, out->real_references, out->real_count, out->reals);
        if (status > fmi2Warning) {
            return judge(component, status, "fmi2GetReal", error);
        }
    }
    if (out->integer_count != 0) {
        status = fmi->get_integer(component->instance, out->integer_references, out->integer_count, out->integers);
        if (status > fmi2Warning) {
            return judge(component, status, "fmi2GetInteger", error);
        }
    }
    if (out->boolean_count != 0) {
        status = fmi->get_boolean(component->instance, out->boolean_references, out->boolean_count, out->booleans);
        if (status > fmi2Warning) {
            return judge(component, status, "fmi2GetBoolean", error);
        }
    }
    return tidy_outputs(component, error);
}

tl_status tl_component_step(tl_component *component, tl_time now, tl_time step, bool final, tl_error *error) {
    if (component->mode != TL_MODE_STEPPING) {
        return tl_fail(error, component->mode == TL_MODE_DEAD ? TL_FMU_FATAL : TL_FMU_FAILED,
                       "%s: cannot step after an earlier failure", component->name);
    }
    tl_status status = tl_component_set_inputs(component, error);
    if (status != TL_OK) {
        return status;
    }
    component->executions++;
    fmi2Status result =
        component->fmi->do_step(component->instance, tl_seconds(now), tl_seconds(step), final ? fmi2True : fmi2False);
    if (result > fmi2Warning) {
        return judge(component, result, "fmi2DoStep", error);
    }
    return tl_component_get_outputs(component, error);
}

tl_status tl_component_save(tl_component *component, tl_error *error) {
    if (component->mode == TL_MODE_DEAD) {
        return tl_fail(error, TL_FMU_FATAL, "%s: cannot be saved after fmi2Fatal", component->name);
    }
    return judge(component, component->fmi->get_fmu_state(component->instance, &component->state), "fmi2GetFMUstate",
                 error);
}

tl_status tl_component_restore(tl_component *component, tl_error *error) {
    if (component->mode == TL_MODE_DEAD) {
        return tl_fail(error, TL_FMU_FATAL, "%s: cannot be restored after fmi2Fatal", component->name);
    }
    tl_status status = judge(component, component->fmi->set_fmu_state(component->instance, component->state),
                             "fmi2SetFMUstate", error);
    if (status == TL_OK) {
        component->mode = TL_MODE_STEPPING;
    }
    return status;
}

void tl_component_free(tl_component *component) {
    const tl_fmi2 *fmi = component->fmi;
    if (component->mode == TL_MODE_ABSENT || component->mode == TL_MODE_DEAD) {
        return;
    }
    fmi2Status status = fmi2OK;
    if (component->state != NULL) {
        status = fmi->free_fmu_state(component->instance, &component->state);
    }
    if (component->mode == TL_MODE_STEPPING && status != fmi2Fatal) {
        status = fmi->terminate(component->instance);
    }
    if (status == fmi2Fatal) {
        component->mode = TL_MODE_DEAD;
        return;
    }
    fmi->free_instance(component->instance);
    component->mode = TL_MODE_ABSENT;
    component->instance = NULL;
}
