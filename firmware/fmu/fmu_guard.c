/* FMU guard, see fmu_guard.h. */
#include "firmware/fmu/fmu_guard.h"

#include <ctype.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "firmware/fmu/last_inputs.h"
#include "firmware/fmu/rollback_method.h"
#include "firmware/process/crash.h"
#include "firmware/process/host_state.h"

/* ---- changes of the process ---- */

/* `reported`: changes already logged for this instance or file. `where`: the call; NULL: the
 * present one. */
static void log_changes(tl_fmu_guard *guard, unsigned *reported, unsigned changes, const char *where) {
    char names[TL_HOST_CHANGE_TEXT];
    char text[TL_HOST_CHANGE_TEXT + 160];
    tl_fmu_call call = {.fmu = ""};
    unsigned unreported = changes & ~*reported;
    if (unreported == 0) {
        return;
    }
    *reported |= unreported;
    (void)tl_fmu_calls_poll(tl_fmu_calls_in_use(), &call);
    tl_host_state_describe(unreported, names);
    (void)snprintf(text, sizeof text, "changed %s of the whole process in %s: restored (reported once)", names,
                   where != NULL ? where : call.function);
    tl_fmu_logger_log(&guard->logger, TL_LOG_NOTICE, text);
}

/* Not inlined because it is rarely needed. */
static void __attribute__((noinline, cold)) restore_thread(tl_fmu_guarded *self, const char *where) {
    unsigned changes = 0;
    if (tl_fp_control_get() != self->control) {
        tl_fp_control_set(self->control);
        changes |= TL_HOST_ROUNDING;
    }
    if (uselocale((locale_t)0) != self->locale) {
        (void)uselocale(self->locale);
        changes |= TL_HOST_LOCALE;
    }
    log_changes(self->guard, &self->logged_changes, changes, where);
}

/* ---- around a call ---- */

static bool is_unchanged(const tl_fmu_guarded *self) {
    return tl_fp_control_get() == self->control && uselocale((locale_t)0) == self->locale;
}

static inline void enter(const tl_fmu_guarded *self, tl_fmu_function function) {
    tl_fmu_call_begin(self->name, function);
    if (self->memory != NULL) {
        tl_fmu_memory_enter(self->memory);
    }
}

/* Must be the first action after a call, because later allocations do not belong to the FMU. */
static inline void leave_heap(const tl_fmu_guarded *self) {
    if (self->memory != NULL) {
        tl_fmu_memory_leave(self->memory);
    }
}

static inline void end_call(fmi2Status status) {
    if (status > fmi2Warning) {
        tl_fmu_call_fail();
    }
    tl_fmu_call_end();
}

/* After an ordinary call: must not need a system call. */
static inline fmi2Status leave_guard(tl_fmu_guarded *self, fmi2Status status) {
    leave_heap(self);
    if (!is_unchanged(self)) {
        restore_thread(self, NULL);
    }
    end_call(status);
    return status;
}

/* After a call that may change any process state. */
static fmi2Status leave_fully(tl_fmu_guarded *self, fmi2Status status) {
    leave_heap(self);
    log_changes(self->guard, &self->logged_changes, tl_host_state_restore(), NULL);
    end_call(status);
    return status;
}

void tl_fmu_guard_enter(tl_fmu_guard *guard, tl_fmu_function function) {
    tl_fmu_call_begin(guard->name, function);
    if (guard->memory != NULL) {
        tl_fmu_memory_enter(guard->memory);
    }
}

void tl_fmu_guard_leave(tl_fmu_guard *guard) {
    if (guard->memory != NULL) {
        tl_fmu_memory_leave(guard->memory);
    }
    log_changes(guard, &guard->logged_changes, tl_host_state_restore(), NULL);
    tl_fmu_call_end();
}

/* ---- noting calls ---- */

static inline fmi2Status note_call(tl_fmu_guarded *self, tl_fmu_prologue_kind kind,
                                   const fmi2ValueReference references[], size_t count, const void *values,
                                   fmi2Status status) {
    if (self->replay != NULL) {
        tl_fmu_replay_note(self->replay, kind, references, count, values, status);
    }
    if (self->last_inputs != NULL) {
        tl_last_inputs_note(self->last_inputs, kind, references, values);
    }
    return status;
}

static void free_fmu(tl_fmu_guarded *self) {
    if (self->instance != NULL) { /* NULL if a new instance could not be created */
        enter(self, TL_FMU_FREE_INSTANCE);
        self->own->free_instance(self->instance);
        (void)leave_fully(self, fmi2OK);
    }
}

/* The size estimate is frozen, because initialisation changes much after this copy. */
static void keep_instantiated(tl_fmu_guarded *self) {
    tl_fmu_guard *guard = self->guard;
    tl_error ignored;
    if (guard->memory == &guard->own_memory) {
        tl_fmu_memory_freeze_estimate(guard->memory, true);
        (void)tl_fmu_memory_save(guard->memory, &guard->instantiated, &ignored);
        tl_fmu_memory_freeze_estimate(guard->memory, false);
    }
}

/* fmi2Reset is incomplete in many FMUs (with libcosim's Wheel, 158 of 258 steps differed), but a
 * copy from after fmi2Instantiate is exact. Returns false if there is no copy, or if it is
 * incomplete. */
static bool restore_instantiated(const tl_fmu_guarded *self) {
    const tl_fmu_guard *guard = self->guard;
    bool is_possible = guard->by_memory && guard->instantiated != NULL &&
                       !tl_fmu_memory_has_new_library(guard->memory, guard->instantiated) &&
                       tl_fmu_memory_obstacle(guard->memory, guard->instantiated) == NULL;
    if (is_possible) {
        tl_fmu_memory_freeze_estimate(guard->memory, true);
        tl_fmu_memory_restore(guard->memory, guard->instantiated);
        tl_fmu_memory_freeze_estimate(guard->memory, false);
    }
    return is_possible;
}

/* Frees the FMU's instance and creates a new one. */
static fmi2Status replace_instance(tl_fmu_guarded *self) {
    const struct begun *begun = &self->begun;
    tl_rollback_method_forget_instantiated(self->guard);
    free_fmu(self);
    enter(self, TL_FMU_INSTANTIATE);
    self->instance = self->own->instantiate(begun->name, begun->type, begun->guid, begun->resources,
                                            &self->guard->fmu_callbacks, begun->visible, begun->logging);
    fmi2Status status = leave_fully(self, self->instance != NULL ? fmi2OK : fmi2Error);
    keep_instantiated(self);
    return status;
}

static fmi2Status call_reset(tl_fmu_guarded *self) {
    enter(self, TL_FMU_RESET);
    return leave_fully(self, self->own->reset(self->instance));
}

/* Resets the FMU so that it can be initialised. If fmi2Reset fails once, a new instance is created
 * from then on. */
static fmi2Status reset_to_start(fmi2Component component) {
    tl_fmu_guarded *self = component;
    if (!self->guard->renews && self->own->reset != NULL) {
        fmi2Status status = call_reset(self);
        if (status <= fmi2Warning || status == fmi2Fatal) {
            return status;
        }
    }
    self->guard->renews = true;
    return replace_instance(self);
}

static bool begin_recording(tl_fmu_guarded *self) {
    self->replay = calloc(1, sizeof *self->replay);
    if (self->replay == NULL) {
        return false;
    }
    self->by_replay = self->guard->by_replay;
    *self->replay = (tl_fmu_replay){.most = self->guard->most,
                                    .results = &self->guard->functions.replay,
                                    .functions = &self->guard->functions,
                                    .instance = self,
                                    .reset = reset_to_start};
    return true;
}

static void note_ports(fmi2Component component, const tl_ports *inputs, const tl_ports *outputs) {
    tl_fmu_guarded *self = component;
    if (self->replay != NULL) {
        self->replay->inputs = inputs;
        self->replay->outputs = outputs;
    }
    /* The ports are known now, so their values can be noted and set again after a restore. */
    if (self->guard->may_replay && !self->guard->was_proved && self->own->get_fmu_state != NULL &&
        self->last_inputs == NULL) {
        self->last_inputs = tl_last_inputs_open(inputs);
    }
}

/* ---- life of an instance ---- */

static void free_instance(fmi2Component component) {
    tl_fmu_guarded *self = component;
    tl_fmu_guarded **link = &self->guard->instances;
    free_fmu(self);
    while (*link != self) {
        link = &(*link)->next;
    }
    *link = self->next;
    tl_rollback_method_end_recording(self);
    free(self);
}

static fmi2Component instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                                 const fmi2CallbackFunctions *callbacks, fmi2Boolean visible, fmi2Boolean logging) {
    tl_fmu_guard *guard = callbacks->componentEnvironment;
    tl_fmu_guarded *self = calloc(1, sizeof *self);
    if (self == NULL) {
        return NULL;
    }
    *self =
        (tl_fmu_guarded){.own = &guard->own, .name = tl_fmu_calls_name(name), .memory = guard->memory, .guard = guard};
    self->begun = (struct begun){name, guid, resources, type, visible, logging};
    self->is_noted = guard->memory != NULL || guard->may_replay;
    self->set_real = guard->own.set_real;
    self->do_step = guard->own.do_step;
    self->get_real = guard->own.get_real;
    self->control = tl_fp_control_get();
    self->locale = uselocale((locale_t)0);
    self->characters = (const unsigned short *const *)__ctype_b_loc();
    self->table = *self->characters;
    if (replace_instance(self) != fmi2OK) {
        free(self);
        return NULL;
    }
    self->next = guard->instances;
    guard->instances = self;
    if (guard->may_replay && !begin_recording(self)) {
        free_instance(self);
        return NULL;
    }
    return self;
}

/* Some FMUs can only start at 0. A run that resumes, or resets its FMUs, starts them later. */
static fmi2Status setup_at_0(tl_fmu_guarded *self, const tl_fmu_setup *setup) {
    tl_error text;
    enter(self, TL_FMU_SETUP_EXPERIMENT);
    fmi2Status status = leave_fully(
        self, self->own->setup_experiment(self->instance, setup->has_tolerance, setup->tolerance, 0.0, setup->has_stop,
                                          setup->has_stop != fmi2False ? setup->stop - setup->start : setup->stop));
    if (status <= fmi2Warning) {
        self->shift = setup->start;
        (void)tl_fail(&text, TL_OK, "refuses to start at %g s: it starts at 0 s, and its time stays %g s behind",
                      setup->start, setup->start);
        tl_fmu_logger_log(&self->guard->logger, TL_LOG_WARNING, text.text);
    }
    return status;
}

/* Steps of FMUs by older versions of OpenModelica take longer, the later the stop time is: minutes
 * if a run has no end. They need no stop time. */
static bool omits_stop(const tl_fmu_guarded *self, fmi2Real start, fmi2Real stop) {
    return self->guard->is_by_openmodelica && stop - start >= TL_EXPERIMENT_FAR;
}

static fmi2Status setup_experiment(fmi2Component component, fmi2Boolean has_tolerance, fmi2Real tolerance,
                                   fmi2Real start, fmi2Boolean stops, fmi2Real stop) {
    tl_fmu_guarded *self = component;
    fmi2Boolean has_stop = stops != fmi2False && !omits_stop(self, start, stop) ? fmi2True : fmi2False;
    const tl_fmu_setup setup = {tolerance, start, stop, has_tolerance, has_stop};
    self->shift = 0.0;
    enter(self, TL_FMU_SETUP_EXPERIMENT);
    fmi2Status status =
        leave_fully(self, self->own->setup_experiment(self->instance, has_tolerance, tolerance, start, has_stop, stop));
    if ((status == fmi2Error || status == fmi2Discard) && fabs(start) > 0.0) {
        status = setup_at_0(self, &setup);
    }
    return note_call(self, TL_PROLOGUE_SETUP, NULL, 1, &setup, status);
}

static fmi2Status enter_initialization_mode(fmi2Component component) {
    tl_fmu_guarded *self = component;
    enter(self, TL_FMU_ENTER_INITIALIZATION_MODE);
    fmi2Status status = leave_fully(self, self->own->enter_initialization_mode(self->instance));
    return note_call(self, TL_PROLOGUE_ENTER_INITIALIZATION, NULL, 0, NULL, status);
}

static fmi2Status exit_initialization_mode(fmi2Component component) {
    tl_fmu_guarded *self = component;
    enter(self, TL_FMU_EXIT_INITIALIZATION_MODE);
    fmi2Status status = leave_fully(self, self->own->exit_initialization_mode(self->instance));
    return note_call(self, TL_PROLOGUE_EXIT_INITIALIZATION, NULL, 0, NULL, status);
}

static fmi2Status terminate(fmi2Component component) {
    tl_fmu_guarded *self = component;
    enter(self, TL_FMU_TERMINATE);
    return leave_fully(self, self->own->terminate(self->instance));
}

static fmi2Status reset(fmi2Component component) {
    tl_fmu_guarded *self = component;
    fmi2Status status = restore_instantiated(self) ? fmi2OK : call_reset(self);
    if (self->replay != NULL && status <= fmi2Warning) {
        tl_fmu_replay_begin(self->replay);
    }
    return status;
}

/* ---- values ---- */

#define VALUE_FUNCTION(name, values_type, function, kind)                                                              \
    static fmi2Status name(fmi2Component component, const fmi2ValueReference references[], size_t count,               \
                           values_type values[]) {                                                                     \
        tl_fmu_guarded *self = component;                                                                              \
        enter(self, (function));                                                                                       \
        fmi2Status status = leave_guard(self, self->own->name(self->instance, references, count, values));             \
        return note_call(self, (kind), references, count, values, status);                                             \
    }

VALUE_FUNCTION(get_real, fmi2Real, TL_FMU_GET_REAL, TL_PROLOGUE_GET_REAL)
VALUE_FUNCTION(get_integer, fmi2Integer, TL_FMU_GET_INTEGER, TL_PROLOGUE_GET_INTEGER)
VALUE_FUNCTION(get_boolean, fmi2Boolean, TL_FMU_GET_BOOLEAN, TL_PROLOGUE_GET_BOOLEAN)
VALUE_FUNCTION(set_real, const fmi2Real, TL_FMU_SET_REAL, TL_PROLOGUE_SET_REAL)
VALUE_FUNCTION(set_integer, const fmi2Integer, TL_FMU_SET_INTEGER, TL_PROLOGUE_SET_INTEGER)
VALUE_FUNCTION(set_boolean, const fmi2Boolean, TL_FMU_SET_BOOLEAN, TL_PROLOGUE_SET_BOOLEAN)
VALUE_FUNCTION(set_string, const fmi2String, TL_FMU_SET_STRING, TL_PROLOGUE_SET_STRING)

/* ---- steps ---- */

/* The prologue ends at the first step, even if no state was saved there. */
static void note_step(const tl_fmu_guarded *self, const tl_fmi2_step *step, fmi2Status status) {
    if (self->replay == NULL) {
        return;
    }
    if (self->by_replay && self->replay->phase == TL_FMU_REPLAY_BEGINS) {
        self->guard->functions.replay.is_disabled = tl_fmu_replay_start(self->replay) != fmi2OK;
    }
    tl_fmu_replay_note_step(self->replay, step, status);
}

/* PythonFMU returns fmi2Fatal if a script raises an exception. A restore of its memory undoes this
 * too, so only the step has failed. */
static inline fmi2Status step_status(const tl_fmu_guarded *self, fmi2Status status) {
    bool is_undone = self->guard->by_memory && self->guard->functions.prefers_copies;
    return status == fmi2Fatal && is_undone ? fmi2Error : status;
}

static fmi2Status do_step(fmi2Component component, fmi2Real now, fmi2Real step, fmi2Boolean final) {
    tl_fmu_guarded *self = component;
    enter(self, TL_FMU_DO_STEP);
    fmi2Status status = leave_guard(self, self->own->do_step(self->instance, now - self->shift, step, final));
    status = step_status(self, status);
    const tl_fmi2_step made = {.now = now, .size = step, .final = final};
    note_step(self, &made, status);
    return status;
}

/* Between two instances of one macro step only a quick check is possible: the full check would take
 * as long as a step of a small FMU. It checks the effect of the control bits (host_state.h), and
 * the character table, which changes with the locale unless the new locale was made from ours. */
static inline void check_thread(tl_fmu_guarded *self) {
    if (!tl_fp_control_check(&self->control) || *self->characters != self->table) {
        restore_thread(self, "a step");
    }
}

/* Notes the calls set, step and get; the last one made may have failed. */
static void note_reals(tl_fmu_guarded *self, const tl_ports *inputs, const tl_ports *outputs, const tl_fmi2_step *step,
                       unsigned done, fmi2Status status) {
    (void)note_call(self, TL_PROLOGUE_SET_REAL, inputs->real_references, inputs->real_count, inputs->reals,
                    done > 0 ? fmi2OK : status);
    if (done > 0) {
        note_step(self, step, done > 1 ? fmi2OK : status);
    }
    if (done > 1) {
        (void)note_call(self, TL_PROLOGUE_GET_REAL, outputs->real_references, outputs->real_count, outputs->reals,
                        status);
    }
}

/* The three calls of one instance. *done is set only if a call fails. */
static inline fmi2Status call_reals(tl_fmu_calls *calls, const tl_fmu_guarded *self, tl_component *component,
                                    const tl_fmi2_step *step, unsigned *done) {
    const tl_ports *inputs = &component->inputs;
    const tl_ports *outputs = &component->outputs;
    tl_fmu_call_begin_in(calls, self->name, TL_FMU_SET_REAL);
    fmi2Status status = self->set_real(self->instance, inputs->real_references, inputs->real_count, inputs->reals);
    if (status > fmi2Warning) {
        *done = 0;
        return status;
    }
    component->executions++;
    tl_fmu_call_continue(calls, self->name, TL_FMU_DO_STEP);
    status = self->do_step(self->instance, component->start_s + step->now - self->shift, step->size,
                           tl_component_is_final(component, step->final));
    if (status > fmi2Warning) {
        *done = 1;
        return step_status(self, status);
    }
    tl_fmu_call_continue(calls, self->name, TL_FMU_GET_REAL);
    return self->get_real(self->instance, outputs->real_references, outputs->real_count, outputs->reals);
}

/* After the calls of an instance with memory of its own, or whose calls are noted. Computes nothing
 * before the thread is checked. */
static void __attribute__((noinline)) note_calls(tl_fmu_guarded *self, const tl_component *component,
                                                 const tl_fmi2_step *step, unsigned done, fmi2Status status) {
    leave_heap(self);
    if (!is_unchanged(self)) {
        restore_thread(self, "a step");
    }
    const tl_fmi2_step own = tl_component_own_step(component, step);
    note_reals(self, &component->inputs, &component->outputs, &own, done, status);
}

static tl_fmi2_end step_reals(tl_component *components, size_t count, const tl_fmi2_step *step) {
    tl_fmu_calls *calls = tl_fmu_calls_block;
    tl_component *component = components;
    tl_fmu_guarded *self = component->instance;
    fmi2Status status = fmi2OK;
    unsigned done = 2;
    for (;;) {
        if (self->is_noted && self->memory != NULL) {
            tl_fmu_memory_enter(self->memory);
        }
        status = call_reals(calls, self, component, step, &done);
        if (self->is_noted) {
            note_calls(self, component, step, done, status);
        }
        if (status > fmi2Warning || ++component == components + count || component->mode != TL_MODE_STEPPING) {
            break;
        }
        check_thread(self);
        self = component->instance;
    }
    if (!is_unchanged(self)) { /* the last one keeps its exception flags, which the quick check would clear */
        restore_thread(self, "a step");
    }
    end_call(status);
    return (tl_fmi2_end){.stepped = (size_t)(component - components), .status = status, .done = done};
}

/* ---- states ---- */

/* An FMU may return fmi2OK without a state. Without this check, only a later restore would fail. */
static fmi2Status expect_state(tl_fmu_guarded *self, const fmi2FMUstate *state, fmi2Status status) {
    if (status <= fmi2Warning && *state == NULL) {
        tl_fmu_logger_log(
            &self->guard->logger, TL_LOG_ERROR,
            "returned fmi2OK without a state (NULL), which counts as fmi2Error; set \"rollback\": \"memory\" in its "
            "component");
        return fmi2Error;
    }
    return status;
}

/* fmi2Discard if rollback does not need the function: the FMU can still be stepped. */
static fmi2Status crash_status(const tl_fmu_guarded *self, bool is_serializing) {
    return is_serializing || self->guard->is_free ? fmi2Discard : fmi2Error;
}

/* After a crash in one of its own state functions. */
static fmi2Status report_caught(tl_fmu_guarded *self, bool is_serializing) {
    char text[160];
    tl_fmu_call call = {.function = ""};
    (void)tl_fmu_calls_poll(tl_fmu_calls_in_use(), &call);
    self->guard->has_crashed = self->guard->has_crashed || !is_serializing;
    (void)snprintf(text, sizeof text, "crashed in %s: %s; %s", call.function, tl_crash_caught(),
                   is_serializing ? "its states are not serialised" : "its own states are not used any more");
    tl_fmu_logger_log(&self->guard->logger, TL_LOG_WARNING, text);
    return leave_guard(self, crash_status(self, is_serializing));
}

/* CALL calls one of the FMU's own state functions; unfinished ones crash in their first call.
 * After the proof a crash is caught only while serialising, because otherwise it has another
 * cause. */
#define STATE_CALL(self, function, is_serializing, CALL)                                                               \
    do {                                                                                                               \
        if ((self)->guard->has_crashed) {                                                                              \
            return crash_status(self, (is_serializing));                                                               \
        }                                                                                                              \
        enter(self, (function));                                                                                       \
        if (((is_serializing) || !(self)->guard->was_proved) && TL_CRASH_CATCH()) {                                    \
            return report_caught(self, (is_serializing));                                                              \
        }                                                                                                              \
        fmi2Status status = (CALL);                                                                                    \
        tl_crash_catch_end();                                                                                          \
        return leave_guard(self, status);                                                                              \
    } while (0)

static fmi2Status get_fmu_state(fmi2Component component, fmi2FMUstate *state) {
    tl_fmu_guarded *self = component;
    STATE_CALL(self, TL_FMU_GET_STATE, false,
               expect_state(self, state, self->own->get_fmu_state(self->instance, state)));
}

static fmi2Status set_fmu_state(fmi2Component component, fmi2FMUstate state) {
    tl_fmu_guarded *self = component;
    STATE_CALL(self, TL_FMU_SET_STATE, false, self->own->set_fmu_state(self->instance, state));
}

static fmi2Status free_fmu_state(fmi2Component component, fmi2FMUstate *state) {
    tl_fmu_guarded *self = component;
    STATE_CALL(self, TL_FMU_FREE_STATE, false, self->own->free_fmu_state(self->instance, state));
}

static fmi2Status serialized_fmu_state_size(fmi2Component component, fmi2FMUstate state, size_t *size) {
    tl_fmu_guarded *self = component;
    STATE_CALL(self, TL_FMU_SERIALIZED_SIZE, true, self->own->serialized_fmu_state_size(self->instance, state, size));
}

static fmi2Status serialize_fmu_state(fmi2Component component, fmi2FMUstate state, fmi2Byte bytes[], size_t size) {
    tl_fmu_guarded *self = component;
    STATE_CALL(self, TL_FMU_SERIALIZE, true, self->own->serialize_fmu_state(self->instance, state, bytes, size));
}

static fmi2Status deserialize_fmu_state(fmi2Component component, const fmi2Byte bytes[], size_t size,
                                        fmi2FMUstate *state) {
    tl_fmu_guarded *self = component;
    enter(self, TL_FMU_DESERIALIZE);
    return leave_guard(self,
                       expect_state(self, state, self->own->deserialize_fmu_state(self->instance, bytes, size, state)));
}

static fmi2Status get_boolean_status(fmi2Component component, const fmi2StatusKind kind, fmi2Boolean *value) {
    tl_fmu_guarded *self = component;
    enter(self, TL_FMU_GET_BOOLEAN_STATUS);
    return leave_guard(self, self->own->get_boolean_status(self->instance, kind, value));
}

/* ---- the guard ---- */

void tl_fmu_guard_open(tl_fmu_guard *guard, const char *name, const char *generator) {
    *guard = (tl_fmu_guard){.name = tl_fmu_calls_name(name),
                            .is_by_openmodelica = strncmp(generator, "OpenModelica", strlen("OpenModelica")) == 0};
    tl_host_state_save();
    tl_fmu_logger_open(&guard->logger, name, generator);
    guard->callbacks = (fmi2CallbackFunctions){tl_fmu_logger_take, calloc, free, NULL, guard};
    guard->fmu_callbacks = (fmi2CallbackFunctions){tl_fmu_logger_take, calloc, free, NULL, &guard->logger};
}

void tl_fmu_guard_front(tl_fmu_guard *guard, const tl_fmi2 *own) {
    guard->own = *own;
    guard->functions = (tl_fmi2){
        .instantiate = instantiate,
        .free_instance = free_instance,
        .setup_experiment = setup_experiment,
        .enter_initialization_mode = enter_initialization_mode,
        .exit_initialization_mode = exit_initialization_mode,
        .terminate = terminate,
        .reset = reset,
        .get_real = get_real,
        .get_integer = get_integer,
        .get_boolean = get_boolean,
        .set_real = set_real,
        .set_integer = set_integer,
        .set_boolean = set_boolean,
        .set_string = set_string,
        .get_fmu_state = own->get_fmu_state != NULL ? get_fmu_state : NULL,
        .set_fmu_state = own->set_fmu_state != NULL ? set_fmu_state : NULL,
        .free_fmu_state = own->free_fmu_state != NULL ? free_fmu_state : NULL,
        .serialized_fmu_state_size = own->serialized_fmu_state_size != NULL ? serialized_fmu_state_size : NULL,
        .serialize_fmu_state = own->serialize_fmu_state != NULL ? serialize_fmu_state : NULL,
        .deserialize_fmu_state = own->deserialize_fmu_state != NULL ? deserialize_fmu_state : NULL,
        .get_boolean_status = own->get_boolean_status != NULL ? get_boolean_status : NULL,
        .do_step = do_step,
        .step_reals = step_reals,
    };
    guard->by_states = guard->functions;
    tl_rollback_method_choose(guard);
    if (guard->may_replay) {
        guard->functions.announce_ports = note_ports;
    }
}

void tl_fmu_guard_close(tl_fmu_guard *guard) {
    tl_fmu_memory_forget(guard->full_copy);
    guard->full_copy = NULL;
    tl_rollback_method_forget_instantiated(guard);
    if (guard->memory != NULL) {
        tl_fmu_memory_free_reserve(guard->memory);
    }
    for (tl_fmu_guarded *self = guard->instances, *next = NULL; self != NULL; self = next) {
        next = self->next;
        tl_rollback_method_end_recording(self);
        free(self);
    }
    guard->instances = NULL;
    tl_fmu_logger_close(&guard->logger);
}

void tl_fmu_guard_tick(bool whole) {
    static unsigned reported; /* per process, because the changes affect the process */
    char names[TL_HOST_CHANGE_TEXT];
    unsigned changes = whole ? tl_host_state_restore() : tl_host_state_restore_part();
    unsigned unreported = changes & ~reported;
    if (unreported != 0) {
        static tl_log_limiter limiter = TL_LOG_LIMITER(1);
        reported |= unreported;
        tl_host_state_describe(unreported, names);
        tl_log_limited(&limiter, TL_LOG_NOTICE,
                       "an FMU changed %s of the whole process in its steps: restored with the ticks, but not by a "
                       "rollback; if its results depend on this, they may be wrong (reported once)",
                       names);
    }
}
