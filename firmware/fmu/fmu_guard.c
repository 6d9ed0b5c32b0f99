/* The guard in front of an FMU's functions: see fmu_guard.h. */
#include "firmware/fmu/fmu_guard.h"

#include <ctype.h>
#include <locale.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>

#include "firmware/fmu/fmu_guarded.h"
#include "firmware/fmu/fmu_ladder.h"
#include "firmware/process/fp_control.h"
#include "firmware/process/host_state.h"
#include "master/fmi/component.h"

typedef tl_fmu_guarded guarded;

/* ---- what was changed ---- */

/* `told`: what was said before, of the same instance or file. `where`: in which call. */
static void say_changes(tl_fmu_guard *guard, unsigned *told, unsigned changes, const char *where) {
    char names[TL_HOST_CHANGE_TEXT];
    char text[TL_HOST_CHANGE_TEXT + 160];
    tl_fmu_call call = {.fmu = ""};
    unsigned fresh = changes & ~*told;
    if (fresh == 0) {
        return;
    }
    *told |= fresh;
    (void)tl_fmu_calls_look(tl_fmu_calls_here(), &call);
    tl_host_state_describe(fresh, names);
    (void)snprintf(text, sizeof text, "changed %s of the whole process in %s; that was put back, and is said once",
                   names, where != NULL ? where : call.function);
    tl_fmu_logger_say(&guard->logger, TL_LOG_WARNING, call.fmu, text);
}

/* Out of line: it hardly ever happens. */
static void __attribute__((noinline, cold)) put_back_some(guarded *self, const char *where) {
    unsigned changes = 0;
    if (tl_fp_control_get() != self->control) {
        tl_fp_control_set(self->control);
        changes |= TL_HOST_ROUNDING;
    }
    if (uselocale((locale_t)0) != self->locale) {
        (void)uselocale(self->locale);
        changes |= TL_HOST_LOCALE;
    }
    say_changes(self->guard, &self->told, changes, where);
}

/* ---- around a call ---- */

static bool holds_all(const guarded *self) {
    return tl_fp_control_get() == self->control && uselocale((locale_t)0) == self->locale;
}

static inline void enter(const guarded *self, tl_fmu_function function) {
    tl_fmu_call_begin(self->name, function);
    if (self->heap != NULL) {
        tl_fmu_memory_enter(&self->guard->memory);
    }
}

/* First of all after a call: what comes then is not the FMU's. */
static inline void leave_memory(const guarded *self) {
    if (self->heap != NULL) {
        tl_fmu_memory_leave(&self->guard->memory);
    }
}

/* After an ordinary call: no system call. */
static inline fmi2Status leave(guarded *self, fmi2Status status) {
    leave_memory(self);
    if (!holds_all(self)) {
        put_back_some(self, NULL);
    }
    tl_fmu_call_end();
    return status;
}

/* After a call in which much may have been set up. */
static fmi2Status leave_slowly(guarded *self, fmi2Status status) {
    leave_memory(self);
    say_changes(self->guard, &self->told, tl_host_state_put_back(), NULL);
    tl_fmu_call_end();
    return status;
}

void tl_fmu_guard_enter(tl_fmu_guard *guard, tl_fmu_function function) {
    tl_fmu_call_begin(guard->name, function);
    if (guard->memory.heap != NULL) {
        tl_fmu_memory_enter(&guard->memory);
    }
}

void tl_fmu_guard_leave(tl_fmu_guard *guard) {
    if (guard->memory.heap != NULL) {
        tl_fmu_memory_leave(&guard->memory);
    }
    say_changes(guard, &guard->told, tl_host_state_put_back(), NULL);
    tl_fmu_call_end();
}

/* ---- what it is given, to give it again ---- */

static inline fmi2Status noted(guarded *self, tl_fmu_prologue_kind kind, const fmi2ValueReference references[],
                               size_t count, const void *values, fmi2Status status) {
    if (self->replay != NULL) {
        tl_fmu_replay_note(self->replay, kind, references, count, values, status);
    }
    if (self->given != NULL) {
        tl_fmu_given_note(self->given, kind, references, values);
    }
    return status;
}

/* As if it had just been instantiated. */
static fmi2Status renew(fmi2Component component) {
    guarded *self = component;
    const struct begun *begun = &self->begun;
    if (self->instance != NULL) {
        enter(self, TL_FMU_FREE_INSTANCE);
        self->own->free_instance(self->instance);
        (void)leave_slowly(self, fmi2OK);
    }
    enter(self, TL_FMU_INSTANTIATE);
    self->instance = self->own->instantiate(begun->name, begun->type, begun->guid, begun->resources,
                                            &self->guard->given, begun->visible, begun->logging);
    return leave_slowly(self, self->instance != NULL ? fmi2OK : fmi2Error);
}

/* To where it can be initialised. One that refuses is not asked again. */
static fmi2Status lead_to_start(fmi2Component component) {
    guarded *self = component;
    if (!self->guard->renews && self->own->reset != NULL) {
        enter(self, TL_FMU_RESET);
        fmi2Status status = leave_slowly(self, self->own->reset(self->instance));
        if (status <= fmi2Warning || status == fmi2Fatal) {
            return status;
        }
    }
    self->guard->renews = true;
    return renew(component);
}

static bool begin_notes(guarded *self) {
    self->replay = calloc(1, sizeof *self->replay);
    if (self->replay == NULL) {
        return false;
    }
    self->by_replay = self->guard->by_replay;
    *self->replay = (tl_fmu_replay){.most = self->guard->most,
                                    .told = &self->guard->functions.replay,
                                    .functions = &self->guard->functions,
                                    .instance = self,
                                    .reset = lead_to_start};
    return true;
}

static void know_ports(fmi2Component component, const tl_ports *inputs, const tl_ports *outputs) {
    guarded *self = component;
    if (self->replay != NULL) {
        self->replay->inputs = inputs;
        self->replay->outputs = outputs;
    }
    tl_fmu_ladder_know_ports(self, inputs);
}

/* ---- life of an instance ---- */

static void forget(guarded *self) {
    guarded **link = &self->guard->instances;
    while (*link != NULL && *link != self) {
        link = &(*link)->next;
    }
    if (*link == self) {
        *link = self->next;
    }
    tl_fmu_ladder_end_notes(self);
    free(self);
}

static void free_instance(fmi2Component component) {
    guarded *self = component;
    if (self->instance != NULL) { /* or it could not be made anew */
        enter(self, TL_FMU_FREE_INSTANCE);
        self->own->free_instance(self->instance);
        (void)leave_slowly(self, fmi2OK);
    }
    forget(self);
}

static fmi2Component instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                                 const fmi2CallbackFunctions *callbacks, fmi2Boolean visible, fmi2Boolean logging) {
    tl_fmu_guard *guard = callbacks->componentEnvironment;
    guarded *self = calloc(1, sizeof *self);
    if (self == NULL) {
        return NULL;
    }
    *self = (guarded){.own = &guard->own, .name = tl_fmu_calls_name(name), .heap = guard->memory.heap, .guard = guard};
    self->begun = (struct begun){name, guid, resources, type, visible, logging};
    self->set_real = guard->own.set_real;
    self->do_step = guard->own.do_step;
    self->get_real = guard->own.get_real;
    self->control = tl_fp_control_get();
    self->locale = uselocale((locale_t)0);
    self->characters = (const unsigned short *const *)__ctype_b_loc();
    self->table = *self->characters;
    enter(self, TL_FMU_INSTANTIATE);
    self->instance = guard->own.instantiate(name, type, guid, resources, &guard->given, visible, logging);
    (void)leave_slowly(self, fmi2OK);
    if (self->instance == NULL) {
        free(self);
        return NULL;
    }
    self->next = guard->instances;
    guard->instances = self;
    if (guard->may_replay && !begin_notes(self)) {
        free_instance(self);
        return NULL;
    }
    return self;
}

static fmi2Status setup_experiment(fmi2Component component, fmi2Boolean has_tolerance, fmi2Real tolerance,
                                   fmi2Real start, fmi2Boolean has_stop, fmi2Real stop) {
    guarded *self = component;
    enter(self, TL_FMU_SETUP_EXPERIMENT);
    fmi2Status status = leave_slowly(
        self, self->own->setup_experiment(self->instance, has_tolerance, tolerance, start, has_stop, stop));
    const tl_fmu_setup setup = {tolerance, start, stop, has_tolerance, has_stop};
    return noted(self, TL_PROLOGUE_SETUP, NULL, 1, &setup, status);
}

static fmi2Status enter_initialization_mode(fmi2Component component) {
    guarded *self = component;
    enter(self, TL_FMU_ENTER_INITIALIZATION_MODE);
    fmi2Status status = leave_slowly(self, self->own->enter_initialization_mode(self->instance));
    return noted(self, TL_PROLOGUE_ENTER_INITIALIZATION, NULL, 0, NULL, status);
}

static fmi2Status exit_initialization_mode(fmi2Component component) {
    guarded *self = component;
    enter(self, TL_FMU_EXIT_INITIALIZATION_MODE);
    fmi2Status status = leave_slowly(self, self->own->exit_initialization_mode(self->instance));
    return noted(self, TL_PROLOGUE_EXIT_INITIALIZATION, NULL, 0, NULL, status);
}

static fmi2Status terminate(fmi2Component component) {
    guarded *self = component;
    enter(self, TL_FMU_TERMINATE);
    return leave_slowly(self, self->own->terminate(self->instance));
}

static fmi2Status reset(fmi2Component component) {
    guarded *self = component;
    enter(self, TL_FMU_RESET);
    fmi2Status status = leave_slowly(self, self->own->reset(self->instance));
    if (self->replay != NULL && status <= fmi2Warning) {
        tl_fmu_replay_begin(self->replay);
    }
    return status;
}

/* ---- values ---- */

static fmi2Status get_real(fmi2Component component, const fmi2ValueReference references[], size_t count,
                           fmi2Real values[]) {
    guarded *self = component;
    enter(self, TL_FMU_GET_REAL);
    fmi2Status status = leave(self, self->own->get_real(self->instance, references, count, values));
    return noted(self, TL_PROLOGUE_GET_REAL, references, count, values, status);
}

static fmi2Status get_integer(fmi2Component component, const fmi2ValueReference references[], size_t count,
                              fmi2Integer values[]) {
    guarded *self = component;
    enter(self, TL_FMU_GET_INTEGER);
    fmi2Status status = leave(self, self->own->get_integer(self->instance, references, count, values));
    return noted(self, TL_PROLOGUE_GET_INTEGER, references, count, values, status);
}

static fmi2Status get_boolean(fmi2Component component, const fmi2ValueReference references[], size_t count,
                              fmi2Boolean values[]) {
    guarded *self = component;
    enter(self, TL_FMU_GET_BOOLEAN);
    fmi2Status status = leave(self, self->own->get_boolean(self->instance, references, count, values));
    return noted(self, TL_PROLOGUE_GET_BOOLEAN, references, count, values, status);
}

static fmi2Status set_real(fmi2Component component, const fmi2ValueReference references[], size_t count,
                           const fmi2Real values[]) {
    guarded *self = component;
    enter(self, TL_FMU_SET_REAL);
    fmi2Status status = leave(self, self->own->set_real(self->instance, references, count, values));
    return noted(self, TL_PROLOGUE_SET_REAL, references, count, values, status);
}

static fmi2Status set_integer(fmi2Component component, const fmi2ValueReference references[], size_t count,
                              const fmi2Integer values[]) {
    guarded *self = component;
    enter(self, TL_FMU_SET_INTEGER);
    fmi2Status status = leave(self, self->own->set_integer(self->instance, references, count, values));
    return noted(self, TL_PROLOGUE_SET_INTEGER, references, count, values, status);
}

static fmi2Status set_boolean(fmi2Component component, const fmi2ValueReference references[], size_t count,
                              const fmi2Boolean values[]) {
    guarded *self = component;
    enter(self, TL_FMU_SET_BOOLEAN);
    fmi2Status status = leave(self, self->own->set_boolean(self->instance, references, count, values));
    return noted(self, TL_PROLOGUE_SET_BOOLEAN, references, count, values, status);
}

static fmi2Status set_string(fmi2Component component, const fmi2ValueReference references[], size_t count,
                             const fmi2String values[]) {
    guarded *self = component;
    enter(self, TL_FMU_SET_STRING);
    fmi2Status status = leave(self, self->own->set_string(self->instance, references, count, values));
    return noted(self, TL_PROLOGUE_SET_STRING, references, count, values, status);
}

/* ---- steps ---- */

/* What comes before the first one is the beginning, also if nobody kept a state there. */
static void note_step(const guarded *self, const tl_fmi2_step *step, fmi2Status status) {
    if (self->replay == NULL) {
        return;
    }
    if (self->by_replay && self->replay->phase == TL_FMU_REPLAY_BEGINS) {
        self->guard->functions.replay.is_over = tl_fmu_replay_start(self->replay) != fmi2OK;
    }
    tl_fmu_replay_note_step(self->replay, step, status);
}

static fmi2Status do_step(fmi2Component component, fmi2Real now, fmi2Real step, fmi2Boolean final) {
    guarded *self = component;
    enter(self, TL_FMU_DO_STEP);
    fmi2Status status = leave(self, self->own->do_step(self->instance, now, step, final));
    if (self->replay != NULL) {
        const tl_fmi2_step made = {.now = now, .size = step, .final = final};
        note_step(self, &made, status);
    }
    return status;
}

/* Between two instances of one macro step a glance must do, since for a small FMU more would take as long as its step: at what the control
 * bits do (fp_control.h), and at the table of characters, which another locale brings with it unless it was made from ours. */
static inline fmi2Status leave_step(guarded *self, bool last, fmi2Status status) {
    leave_memory(self);
    bool holds = last ? holds_all(self) : tl_fp_control_holds(self->control) && *self->characters == self->table;
    if (!holds) {
        put_back_some(self, "a step");
    }
    tl_fmu_call_end();
    return status;
}

/* Three calls, of which the last one may have failed. */
static void note_reals(guarded *self, const tl_ports *inputs, const tl_ports *outputs, const tl_fmi2_step *step,
                       unsigned done, fmi2Status status) {
    (void)noted(self, TL_PROLOGUE_SET_REAL, inputs->real_references, inputs->real_count, inputs->reals,
                done > 0 ? fmi2OK : status);
    if (done > 0) {
        note_step(self, step, done > 1 ? fmi2OK : status);
    }
    if (done > 1) {
        (void)noted(self, TL_PROLOGUE_GET_REAL, outputs->real_references, outputs->real_count, outputs->reals, status);
    }
}

static fmi2Status step_reals(fmi2Component component, const tl_ports *inputs, const tl_ports *outputs,
                             const tl_fmi2_step *step, unsigned *done) {
    guarded *self = component;
    fmi2Component instance = self->instance;
    *done = 0;
    enter(self, TL_FMU_SET_REAL);
    fmi2Status status = self->set_real(instance, inputs->real_references, inputs->real_count, inputs->reals);
    if (status <= fmi2Warning) {
        *done = 1;
        tl_fmu_call_go_on(self->name, TL_FMU_DO_STEP);
        status = self->do_step(instance, step->now, step->size, step->final);
    }
    if (status <= fmi2Warning) {
        *done = 2;
        tl_fmu_call_go_on(self->name, TL_FMU_GET_REAL);
        status = self->get_real(instance, outputs->real_references, outputs->real_count, outputs->reals);
    }
    status = leave_step(self, step->last, status);
    if (self->replay != NULL || self->given != NULL) {
        note_reals(self, inputs, outputs, step, *done, status);
    }
    return status;
}

/* All three in one message: the FMU is elsewhere, with a guard of its own. */
static fmi2Status step_elsewhere(fmi2Component component, const tl_ports *inputs, const tl_ports *outputs,
                                 const tl_fmi2_step *step, unsigned *done) {
    guarded *self = component;
    enter(self, TL_FMU_DO_STEP);
    fmi2Status status = self->own->step_reals(self->instance, inputs, outputs, step, done);
    tl_fmu_call_end();
    return status;
}

/* ---- states ---- */

/* Claimed success without a state would be found when the twin is to go back to it. */
static fmi2Status expect_state(guarded *self, const fmi2FMUstate *state, fmi2Status status) {
    tl_fmu_call call = {.fmu = ""};
    if (status <= fmi2Warning && *state == NULL) {
        (void)tl_fmu_calls_look(tl_fmu_calls_here(), &call);
        tl_fmu_logger_say(&self->guard->logger, TL_LOG_ERROR, call.fmu,
                          "answered fmi2OK and gave no state (NULL), which is taken for fmi2Error");
        return fmi2Error;
    }
    return status;
}

static fmi2Status get_fmu_state(fmi2Component component, fmi2FMUstate *state) {
    guarded *self = component;
    enter(self, TL_FMU_GET_STATE);
    return leave(self, expect_state(self, state, self->own->get_fmu_state(self->instance, state)));
}

static fmi2Status set_fmu_state(fmi2Component component, fmi2FMUstate state) {
    guarded *self = component;
    enter(self, TL_FMU_SET_STATE);
    return leave(self, self->own->set_fmu_state(self->instance, state));
}

static fmi2Status free_fmu_state(fmi2Component component, fmi2FMUstate *state) {
    guarded *self = component;
    enter(self, TL_FMU_FREE_STATE);
    return leave(self, self->own->free_fmu_state(self->instance, state));
}

static fmi2Status serialized_fmu_state_size(fmi2Component component, fmi2FMUstate state, size_t *size) {
    guarded *self = component;
    enter(self, TL_FMU_SERIALIZED_SIZE);
    return leave(self, self->own->serialized_fmu_state_size(self->instance, state, size));
}

static fmi2Status serialize_fmu_state(fmi2Component component, fmi2FMUstate state, fmi2Byte bytes[], size_t size) {
    guarded *self = component;
    enter(self, TL_FMU_SERIALIZE);
    return leave(self, self->own->serialize_fmu_state(self->instance, state, bytes, size));
}

static fmi2Status deserialize_fmu_state(fmi2Component component, const fmi2Byte bytes[], size_t size,
                                        fmi2FMUstate *state) {
    guarded *self = component;
    enter(self, TL_FMU_DESERIALIZE);
    return leave(self, expect_state(self, state, self->own->deserialize_fmu_state(self->instance, bytes, size, state)));
}

/* ---- the guard ---- */

void tl_fmu_guard_open(tl_fmu_guard *guard, const char *name, const char *generator) {
    *guard = (tl_fmu_guard){.name = tl_fmu_calls_name(name)};
    tl_host_state_keep();
    tl_fmu_logger_open(&guard->logger, name, generator);
    guard->callbacks = (fmi2CallbackFunctions){tl_fmu_logger_take, calloc, free, NULL, guard};
    guard->given = (fmi2CallbackFunctions){tl_fmu_logger_take, calloc, free, NULL, &guard->logger};
}

tl_status tl_fmu_guard_use_memory(tl_fmu_guard *guard, const char *folder, bool at_once, tl_error *error) {
    guard->by_memory = at_once;
    return tl_fmu_memory_open(folder, &guard->memory, error);
}

void tl_fmu_guard_use_replay(tl_fmu_guard *guard, uint32_t most, bool at_once) {
    guard->may_replay = true;
    guard->by_replay = at_once;
    guard->most = most;
}

void tl_fmu_guard_use_fork(tl_fmu_guard *guard, tl_forked_line *line) {
    guard->given.componentEnvironment = line;
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
        .do_step = do_step,
        .step_reals = own->step_reals != NULL ? step_elsewhere : step_reals,
        .is_unaware = own->is_unaware,
        .most_states = own->most_states,
    };
    tl_fmu_ladder_begin(guard);
    if (guard->may_replay) {
        guard->functions.know_ports = know_ports;
    }
}

void tl_fmu_guard_close(tl_fmu_guard *guard) {
    tl_fmu_memory_forget(guard->aside);
    guard->aside = NULL;
    tl_fmu_memory_give_up_reserve(&guard->memory);
    for (guarded *self = guard->instances, *next = NULL; self != NULL; self = next) {
        next = self->next;
        tl_fmu_ladder_end_notes(self);
        free(self);
    }
    guard->instances = NULL;
    tl_fmu_logger_close(&guard->logger);
}

void tl_fmu_guard_tick(void) {
    static unsigned told; /* of the process, as what was changed is */
    char names[TL_HOST_CHANGE_TEXT];
    unsigned fresh = tl_host_state_put_back() & ~told;
    if (fresh != 0) {
        static tl_log_limiter limiter = TL_LOG_LIMITER(1);
        told |= fresh;
        tl_host_state_describe(fresh, names);
        tl_log_limited(&limiter, TL_LOG_WARNING,
                       "an FMU changed %s of the whole process in its steps; that was put back, and is said once",
                       names);
    }
}
