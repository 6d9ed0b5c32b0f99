/* Why an FMU does not come back to where it was: see restore_cause.h. */
#include "master/sync/restore_cause.h"

#include <stdbool.h>
#include <string.h>

/* Of an input. */
static const double ASTRAY = 0.05;

static unsigned char *outputs_of(const tl_restore_trial *trial, unsigned place) {
    return trial->outputs + place * trial->output_bytes;
}

/* Elsewhere than the FMU would go: a twentieth more of each input that is a real number. */
static void write_inputs(const tl_restore_trial *trial, unsigned step, bool astray) {
    tl_ports *inputs = &trial->component->inputs;
    tl_ports_write(inputs, trial->inputs + step * trial->input_bytes);
    for (size_t i = 0; i < inputs->real_count && astray; i++) {
        inputs->reals[i] += ASTRAY * (inputs->reals[i] < 0.0 || inputs->reals[i] > 0.0 ? inputs->reals[i] : 1.0);
    }
}

static tl_status take_step(const tl_restore_trial *trial, int64_t step, tl_error *error) {
    tl_time at = tl_time_of_step(0, trial->macro_step, step);
    return tl_component_step(trial->component, tl_seconds(at), tl_seconds(trial->macro_step), false, error);
}

/* *same NULL: the outputs are noted; else whether they are those that were. */
static tl_status take_steps(const tl_restore_trial *trial, bool *same, tl_error *error) {
    tl_component *component = trial->component;
    tl_status status = TL_OK;
    for (unsigned i = 0; i < trial->steps && status == TL_OK; i++) {
        write_inputs(trial, i, false);
        status = take_step(trial, trial->step + i, error);
        tl_ports_read(&component->outputs, outputs_of(trial, same == NULL ? i : trial->steps));
        if (same != NULL) {
            *same = *same && memcmp(outputs_of(trial, trial->steps), outputs_of(trial, i),
                                    tl_ports_size(&component->outputs)) == 0;
        }
    }
    return status;
}

/* It may fail, as any candidate may. */
static tl_status go_astray(const tl_restore_trial *trial, tl_error *error) {
    tl_status status = TL_OK;
    for (unsigned i = 0; i < trial->steps && status == TL_OK; i++) {
        write_inputs(trial, i, true);
        status = take_step(trial, trial->step + i, error);
    }
    return status == TL_FMU_FAILED ? TL_OK : status;
}

static tl_status come_back(const tl_restore_trial *trial, tl_error *error) {
    return tl_component_come_back(trial->component, false)
               ? TL_OK
               : tl_fail(error, TL_FMU_FAILED, "%s: cannot be led to where it was", trial->component->name);
}

/* Saved and restored, with steps between or without; then whether they are the same. The handle is as it was once the FMU is back. */
static tl_status lead_back(const tl_restore_trial *trial, bool astray, bool *same, tl_error *error) {
    fmi2FMUstate state = trial->state;
    tl_status status = tl_component_save(trial->component, &state, error);
    status = status == TL_OK && astray ? go_astray(trial, error) : status;
    status = status == TL_OK ? tl_component_restore(trial->component, state, error) : status;
    return status == TL_OK ? take_steps(trial, same, error) : status;
}

/* What is tried, one after the other: the first that is not the same is the cause. */
static tl_status try(const tl_restore_trial *trial, tl_restore_cause which, bool *same, tl_error *error) {
    return which == TL_CAUSE_UNSTEADY ? take_steps(trial, same, error)
                                      : lead_back(trial, which == TL_CAUSE_INCOMPLETE, same, error);
}

tl_status tl_restore_cause_find(const tl_restore_trial *trial, tl_restore_cause *cause, tl_error *error) {
    tl_error ignored;
    *cause = TL_CAUSE_UNKNOWN;
    tl_status status = take_steps(trial, NULL, error);
    bool failed = status == TL_FMU_FAILED; /* which says nothing of a restore */
    status = status == TL_FMU_FATAL ? status : come_back(trial, error);
    for (tl_restore_cause which = TL_CAUSE_UNSTEADY;
         which <= TL_CAUSE_INCOMPLETE && status == TL_OK && !failed && *cause == TL_CAUSE_UNKNOWN; which++) {
        bool same = true;
        tl_status tried = try(trial, which, &same, &ignored);
        *cause = same ? TL_CAUSE_UNKNOWN : which;
        *cause = tried == TL_FMU_FAILED ? TL_CAUSE_REFUSES : *cause;
        status = tried == TL_FMU_FATAL ? tl_fail(error, tried, "%s", ignored.text) : come_back(trial, error);
    }
    return status;
}
