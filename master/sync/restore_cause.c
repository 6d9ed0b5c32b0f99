/* Why an FMU does not come back to where it was: see restore_cause.h. */
#include "master/sync/restore_cause.h"

#include <stdbool.h>
#include <string.h>

/* Of an input. */
static const double ASTRAY = 0.05;

static unsigned char *outputs_of(const tl_restore_trial *trial, unsigned place) {
    return trial->outputs + place * trial->output_bytes;
}

const char *tl_restore_cause_text(tl_restore_cause cause) {
    static const char *const texts[TL_RESTORE_CAUSES] = {
        [TL_CAUSE_UNKNOWN] = "",
        [TL_CAUSE_UNSTEADY] = "not steady: it goes two ways from one copy of its memory",
        [TL_CAUSE_COLD] = "cold solver: so it is if it is led back at once",
        [TL_CAUSE_PARAMETERS] = "parameters kept: so it is if a value was set since it was saved",
        [TL_CAUSE_INCOMPLETE] = "incomplete state: led back at once it is exact, after other steps it is not",
        [TL_CAUSE_ONE_STATE] = "one handle only: so it is if a second state was saved",
        [TL_CAUSE_EVENTS] = "events lost: after other steps it is exact, after some with inputs that go far it is not",
        [TL_CAUSE_LATE] = "refuses late: it was saved before, and is not now",
        [TL_CAUSE_REFUSES] = "",
        [TL_CAUSE_FINAL] = "final steps: so it is if it is told that no earlier state will be restored"};
    return texts[cause];
}

/* ---- ways to go ---- */

/* A twentieth more of each input that is a real number. */
static void move_inputs(tl_ports *inputs) {
    for (size_t i = 0; i < inputs->real_count; i++) {
        inputs->reals[i] += ASTRAY * (inputs->reals[i] < 0.0 || inputs->reals[i] > 0.0 ? inputs->reals[i] : 1.0);
    }
}

static void write_inputs(const tl_restore_trial *trial, const unsigned char *inputs, unsigned step) {
    tl_ports_write(&trial->component->inputs, inputs + step * trial->input_bytes);
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
        write_inputs(trial, trial->inputs, i);
        status = take_step(trial, trial->step + i, error);
        tl_ports_read(&component->outputs, outputs_of(trial, same == NULL ? i : trial->steps));
        if (same != NULL) {
            *same = *same && memcmp(outputs_of(trial, trial->steps), outputs_of(trial, i),
                                    tl_ports_size(&component->outputs)) == 0;
        }
    }
    return status;
}

/* What lies between save and restore. */
typedef enum between { NOTHING, VALUES, NEAR, STATE, FAR } between;

static tl_status set_values(const tl_restore_trial *trial, tl_error *error) {
    write_inputs(trial, trial->inputs, 0);
    move_inputs(&trial->component->inputs);
    return tl_component_set_inputs(trial->component, error);
}

/* It may fail, as any candidate may. */
static tl_status go_elsewhere(const tl_restore_trial *trial, between how, tl_error *error) {
    tl_status status = TL_OK;
    for (unsigned i = 0; i < trial->steps && status == TL_OK; i++) {
        write_inputs(trial, how == FAR ? trial->elsewhere : trial->inputs, i);
        if (how == NEAR) {
            move_inputs(&trial->component->inputs);
        }
        status = take_step(trial, trial->step + i, error);
    }
    return status == TL_FMU_FAILED ? TL_OK : status;
}

static tl_status go_between(const tl_restore_trial *trial, between how, fmi2FMUstate *second, tl_error *error) {
    tl_status status = TL_OK;
    if (how == VALUES) {
        return set_values(trial, error);
    }
    if (how == NEAR || how == FAR || how == STATE) {
        status = go_elsewhere(trial, how, error);
    }
    return status == TL_OK && how == STATE ? tl_component_save(trial->component, second, error) : status;
}

static tl_status come_back(const tl_restore_trial *trial, tl_error *error) {
    return tl_component_come_back(trial->component, NULL)
               ? TL_OK
               : tl_fail(error, TL_FMU_FAILED, "%s: cannot be led to where it was", trial->component->name);
}

/* Saved and restored, with that between; then whether they are the same. The caller's handle is as it was once the FMU is back; others are given back. */
static tl_status lead_back(const tl_restore_trial *trial, between how, bool *same, tl_error *error) {
    tl_component *component = trial->component;
    fmi2FMUstate state = trial->state;
    fmi2FMUstate second = NULL;
    tl_status status = tl_component_save(component, &state, error);
    status = status == TL_OK ? go_between(trial, how, &second, error) : status;
    status = status == TL_OK ? tl_component_restore(component, state, error) : status;
    status = status == TL_OK ? take_steps(trial, same, error) : status;
    tl_component_forget(component, &second);
    if (trial->state == NULL) {
        tl_component_forget(component, &state);
    }
    return status;
}

/* What is tried, one after the other: the first that is not the same is the cause. */
static tl_status try(const tl_restore_trial *trial, tl_restore_cause which, bool *same, tl_error *error) {
    static const between ways[TL_RESTORE_CAUSES] = {[TL_CAUSE_COLD] = NOTHING,
                                                    [TL_CAUSE_PARAMETERS] = VALUES,
                                                    [TL_CAUSE_INCOMPLETE] = NEAR,
                                                    [TL_CAUSE_ONE_STATE] = STATE,
                                                    [TL_CAUSE_EVENTS] = FAR};
    if (which == TL_CAUSE_EVENTS && trial->elsewhere == NULL) {
        return TL_OK;
    }
    return which == TL_CAUSE_UNSTEADY ? take_steps(trial, same, error) : lead_back(trial, ways[which], same, error);
}

tl_status tl_restore_cause_find(const tl_restore_trial *trial, tl_restore_cause *cause, tl_error *error) {
    tl_error ignored;
    *cause = TL_CAUSE_UNKNOWN;
    tl_status status = take_steps(trial, NULL, error);
    bool failed = status == TL_FMU_FAILED; /* which says nothing of a restore */
    status = status == TL_FMU_FATAL ? status : come_back(trial, error);
    for (tl_restore_cause which = TL_CAUSE_UNSTEADY;
         which <= TL_CAUSE_EVENTS && status == TL_OK && !failed && *cause == TL_CAUSE_UNKNOWN; which++) {
        bool same = true;
        tl_status tried = try(trial, which, &same, &ignored);
        *cause = same && tried == TL_OK ? TL_CAUSE_UNKNOWN : which;
        status = tried == TL_FMU_FATAL ? tl_fail(error, tried, "%s", ignored.text) : come_back(trial, error);
    }
    return status;
}
