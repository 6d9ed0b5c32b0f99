/* Ways in which an FMU is led back, one below the other: see fmu_ladder.h. */
#include "firmware/fmu/fmu_ladder.h"

#include <stdlib.h>

#include "firmware/fmu/fmu_bytes.h"
#include "firmware/process/fmu_call.h"

/* ---- states that are its memory: no call of the FMU ---- */

/* While the rollback is proved. */
static bool may_descend(const tl_fmu_guarded *self) {
    return self->replay != NULL && !self->guard->was_proved && !(self->by_replay && self->guard->renews);
}

/* Why it cannot be; if there is another way, that is no error. */
static void say_why_not(tl_fmu_guarded *self, const char *text) {
    tl_log_level level = may_descend(self) ? TL_LOG_WARNING : TL_LOG_ERROR;
    tl_fmu_logger_say(&self->guard->logger, level, "", text);
}

/* It has what is in no copy, since it was saved or before. Said once, and not of one that is proved by its own states: nobody needs a copy of it. */
static fmi2Status refuse_to_copy(tl_fmu_guarded *self) {
    tl_error error;
    bool was_exact = self->guard->is_by_choice && self->guard->was_proved;
    (void)tl_fail(&error, TL_FMU_FAILED, "has %s, which no copy of its memory takes back%s",
                  tl_fmu_memory_left(&self->guard->memory),
                  was_exact ? "; its own states may: \"rollback\": \"state\"" : "");
    bool matters = self->guard->by_memory || !self->guard->was_proved;
    if (matters && !self->guard->was_left_told) {
        say_why_not(self, error.text);
        self->guard->was_left_told = true;
    }
    return fmi2Error;
}

static fmi2Status save_memory(fmi2Component component, fmi2FMUstate *state) {
    tl_fmu_guarded *self = component;
    tl_error error;
    if (tl_fmu_memory_left(&self->guard->memory) != NULL) {
        return refuse_to_copy(self);
    }
    if (tl_fmu_memory_save(&self->guard->memory, state, &error) != TL_OK) {
        say_why_not(self, error.text);
        return fmi2Error;
    }
    return fmi2OK;
}

static fmi2Status restore_memory(fmi2Component component, fmi2FMUstate state) {
    tl_fmu_guarded *self = component;
    if (tl_fmu_memory_left(&self->guard->memory) != NULL) {
        return refuse_to_copy(self);
    }
    tl_fmu_memory_restore(&self->guard->memory, state);
    return fmi2OK;
}

static fmi2Status forget_memory(fmi2Component component, fmi2FMUstate *state) {
    (void)component;
    tl_fmu_memory_forget(*state);
    *state = NULL;
    return fmi2OK;
}

static fmi2Status reserve_memory(fmi2Component component, size_t states) {
    tl_fmu_guarded *self = component;
    tl_error error;
    if (tl_fmu_memory_reserve(&self->guard->memory, states, &error) != TL_OK) {
        tl_fmu_logger_say(&self->guard->logger, TL_LOG_ERROR, "", error.text);
        return fmi2Error;
    }
    return fmi2OK;
}

static size_t memory_size(fmi2Component component) {
    const tl_fmu_guarded *self = component;
    return tl_fmu_memory_size(&self->guard->memory);
}

/* ---- states that are positions in what it was given; another instance may still have its own ---- */

static fmi2Status keep_position(fmi2Component component, fmi2FMUstate *state) {
    tl_fmu_guarded *self = component;
    return self->by_replay ? tl_fmu_replay_keep(self->replay, state)
                           : self->guard->by_states.get_fmu_state(component, state);
}

static fmi2Status go_to_position(fmi2Component component, fmi2FMUstate state) {
    tl_fmu_guarded *self = component;
    return self->by_replay ? tl_fmu_replay_lead(self->replay, state)
                           : self->guard->by_states.set_fmu_state(component, state);
}

static fmi2Status forget_position(fmi2Component component, fmi2FMUstate *state) {
    tl_fmu_guarded *self = component;
    if (!self->by_replay) {
        return self->guard->by_states.free_fmu_state(component, state);
    }
    tl_fmu_replay_give_back(self->replay, state);
    return fmi2OK;
}

/* ---- states of its own, with what it was given before them ---- */

static fmi2Status keep_given(fmi2Component component, fmi2FMUstate *state) {
    tl_fmu_guarded *self = component;
    tl_fmu_given_state *kept = *state != NULL ? *state : tl_fmu_given_make_state(self->given);
    if (kept == NULL) {
        return fmi2Error;
    }
    tl_fmu_given_keep(self->given, kept);
    *state = kept;
    return self->guard->by_states.get_fmu_state(component, &kept->own);
}

static fmi2Status give_again(fmi2Component component, fmi2FMUstate state) {
    tl_fmu_guarded *self = component;
    const tl_fmu_given_state *kept = state;
    fmi2Status status = self->guard->by_states.set_fmu_state(component, kept->own);
    return status <= fmi2Warning ? tl_fmu_given_give_again(self->given, kept, &self->guard->functions, component)
                                 : status;
}

static fmi2Status forget_given(fmi2Component component, fmi2FMUstate *state) {
    const tl_fmu_guarded *self = component;
    tl_fmu_given_state *kept = *state;
    fmi2Status status = kept->own != NULL ? self->guard->by_states.free_fmu_state(component, &kept->own) : fmi2OK;
    free(kept);
    *state = NULL;
    return status;
}

void tl_fmu_ladder_know_ports(tl_fmu_guarded *self, const tl_ports *inputs) {
    bool may_need_it = self->guard->may_replay && !self->guard->was_proved && self->own->get_fmu_state != NULL;
    if (!may_need_it || self->given != NULL) {
        return;
    }
    self->given = malloc(sizeof *self->given);
    if (self->given != NULL && !tl_fmu_given_open(self->given, inputs)) {
        free(self->given);
        self->given = NULL;
    }
}

void tl_fmu_ladder_end_notes(tl_fmu_guarded *self) {
    if (self->given != NULL) {
        tl_fmu_given_close(self->given);
        free(self->given);
        self->given = NULL;
    }
    if (self->replay != NULL) {
        tl_fmu_replay_end(self->replay);
        free(self->replay);
        self->replay = NULL;
    }
}

/* ---- the ladder: which way is next if one is wrong ---- */

static void roll_back_by_states(tl_fmu_guard *guard);
static void roll_back_by_memory(tl_fmu_guard *guard);
static void roll_back_by_replay(tl_fmu_guard *guard);
static void give_all_again(tl_fmu_guard *guard);

/* Where a proof begins. By replay that is the end of its prologue, which needs no keeping. */
static fmi2Status keep_aside(fmi2Component component) {
    tl_fmu_guarded *self = component;
    tl_fmu_guard *guard = self->guard;
    if (self->replay != NULL && !guard->was_proved) {
        tl_fmu_replay_wait(self->replay);
    }
    bool has_copy = guard->memory.heap != NULL && !self->by_replay && !guard->gives_again &&
                    (guard->by_memory ? tl_fmu_memory_left(&guard->memory) == NULL : true) &&
                    save_memory(component, &guard->aside) == fmi2OK;
    return has_copy || may_descend(self) ? fmi2OK : fmi2Error;
}

static void drop_copy(tl_fmu_guard *guard) {
    tl_fmu_memory_forget(guard->aside);
    guard->aside = NULL;
}

static size_t size_aside(fmi2Component component) {
    const tl_fmu_guarded *self = component;
    return self->guard->memory.heap != NULL && !self->by_replay && !self->guard->gives_again
               ? tl_fmu_memory_size(&self->guard->memory)
               : 0;
}

static fmi2Status replay_from_beginning(tl_fmu_guarded *self) {
    return self->replay != NULL && tl_fmu_replay_start(self->replay) == fmi2OK
               ? tl_fmu_replay_lead_to_beginning(self->replay)
               : fmi2Error;
}

static fmi2Status come_back(fmi2Component component) {
    tl_fmu_guarded *self = component;
    tl_fmu_guard *guard = self->guard;
    if (guard->aside != NULL && !self->by_replay) {
        return restore_memory(component, guard->aside);
    }
    fmi2Status status = guard->was_proved ? fmi2Error : replay_from_beginning(self);
    if (self->replay != NULL && !self->by_replay && !guard->was_proved) {
        self->replay->phase = TL_FMU_REPLAY_WAITS;
    }
    return status;
}

/* `why`: "", or in which way it was wrong. */
static fmi2Status descend(tl_fmu_guarded *self, const char *otherwise, const char *why, const char *instead) {
    tl_fmu_call call = {.fmu = ""};
    tl_error text;
    bool is_known = why[0] != '\0';
    (void)tl_fmu_calls_look(tl_fmu_calls_here(), &call);
    (void)tl_fail(&text, TL_FMU_FAILED, "does not come back to where it was %s%s%s%s: %s", otherwise,
                  is_known ? " (" : "", why, is_known ? ")" : "", instead);
    tl_fmu_logger_say(&self->guard->logger, TL_LOG_WARNING, call.fmu, text.text);
    return fmi2OK;
}

static void forget_beginning(tl_fmu_guarded *self) {
    if (self->guard->beginning != NULL) {
        (void)self->guard->by_states.free_fmu_state(self, &self->guard->beginning);
        self->guard->beginning = NULL;
    }
}

/* Copies are proved. What this changes in its memory is the same in all that are to come. */
static void end_choice(tl_fmu_guarded *self) {
    tl_fmu_guard *guard = self->guard;
    void *copy = NULL;
    tl_fmu_memory_pass(&guard->memory, true);
    forget_beginning(self);
    (void)save_memory(self, &copy);
    tl_fmu_memory_forget(copy);
    tl_fmu_memory_pass(&guard->memory, false);
}

static void let_go(fmi2Component component) {
    tl_fmu_guarded *self = component;
    tl_fmu_guard *guard = self->guard;
    if (guard->beginning != NULL) {
        end_choice(self);
    }
    if (guard->gives_again && !guard->was_proved) {
        (void)descend(self, "by its states alone", "parameters kept",
                      "it is given again after each restore what it had been given");
    }
    drop_copy(guard);
    guard->was_proved = true;
    guard->functions.replay.steps = 0;
    if (!self->by_replay && !guard->gives_again) {
        tl_fmu_ladder_end_notes(self);
    }
}

/* By replay, or that in its other way. */
static fmi2Status give_up_all_else(tl_fmu_guarded *self, const char *why) {
    tl_fmu_guard *guard = self->guard;
    if (!may_descend(self)) {
        return fmi2Error;
    }
    if (self->given != NULL && !self->by_replay && !guard->gives_again) {
        drop_copy(guard);
        give_all_again(guard);
        return come_back(self);
    }
    guard->gives_again = false;
    drop_copy(guard);
    guard->renews = guard->renews || self->by_replay;
    if (!self->by_replay) {
        self->by_replay = true;
        roll_back_by_replay(guard);
        (void)descend(self, "otherwise", why, "it is reset and given its inputs again instead, which is called replay");
    }
    return replay_from_beginning(self);
}

/* While copies are proved it is where the proof began; later the copy that was kept is all there is. */
static fmi2Status return_to_states(tl_fmu_guarded *self, const char *why) {
    tl_fmu_guard *guard = self->guard;
    fmi2Status status =
        guard->beginning != NULL ? guard->by_states.set_fmu_state(self, guard->beginning) : come_back(self);
    if (status > fmi2Warning) {
        return status;
    }
    forget_beginning(self);
    roll_back_by_states(guard);
    return descend(self, "by its memory", why, "it is rolled back by its own states, which are slower");
}

static fmi2Status give_up_states(fmi2Component component, const char *why) {
    tl_fmu_guarded *self = component;
    tl_fmu_guard *guard = self->guard;
    if (guard->is_by_choice) {
        return return_to_states(self, why);
    }
    bool may_be_by_memory = guard->aside != NULL && !guard->by_memory && !self->by_replay;
    if (!may_be_by_memory || come_back(component) != fmi2OK) {
        return give_up_all_else(self, why);
    }
    roll_back_by_memory(guard);
    return descend(self, "by its own states", why, "it is rolled back by its memory instead");
}

/* ---- two that are exact ---- */

static bool has_choice(fmi2Component component) {
    const tl_fmu_guarded *self = component;
    const tl_fmu_guard *guard = self->guard;
    return guard->aside != NULL && tl_fmu_memory_left(&guard->memory) == NULL && !guard->was_proved &&
           !guard->by_memory && !guard->gives_again && !self->by_replay;
}

/* Its own state is made first, so that each copy knows of it. */
static fmi2Status prefer_copy(fmi2Component component, const tl_fmi2_times *times) {
    tl_fmu_guarded *self = component;
    tl_fmu_guard *guard = self->guard;
    guard->beginning = NULL;
    if (guard->by_states.get_fmu_state(component, &guard->beginning) > fmi2Warning ||
        save_memory(component, &guard->aside) != fmi2OK) {
        forget_beginning(self);
        return fmi2Error;
    }
    guard->is_by_choice = true;
    guard->times = *times;
    roll_back_by_memory(guard);
    return fmi2OK;
}

/* ---- what stands in the table ---- */

static void roll_back_by_states(tl_fmu_guard *guard) {
    tl_fmi2 *functions = &guard->functions;
    guard->by_memory = false;
    guard->is_by_choice = false;
    guard->memory.has_flags = false;
    functions->is_unaware = false;
    functions->get_fmu_state = guard->by_states.get_fmu_state;
    functions->set_fmu_state = guard->by_states.set_fmu_state;
    functions->free_fmu_state = guard->by_states.free_fmu_state;
    functions->state_size = guard->by_states.state_size;
    functions->reserve_states = guard->by_states.reserve_states;
    functions->serialized_fmu_state_size = guard->by_states.serialized_fmu_state_size;
    functions->serialize_fmu_state = guard->by_states.serialize_fmu_state;
    functions->deserialize_fmu_state = guard->by_states.deserialize_fmu_state;
}

/* A copy is made its own state for it. */
static void own_bytes_of_copies(tl_fmu_guard *guard) {
    if (guard->by_states.serialize_fmu_state != NULL) {
        guard->functions.serialized_fmu_state_size = tl_fmu_bytes_size;
        guard->functions.serialize_fmu_state = tl_fmu_bytes_write;
        guard->functions.deserialize_fmu_state = tl_fmu_bytes_read;
    }
}

static void own_no_bytes(tl_fmi2 *functions) {
    functions->serialized_fmu_state_size = NULL;
    functions->serialize_fmu_state = NULL;
    functions->deserialize_fmu_state = NULL;
}

/* Its own functions are used only to make bytes, if they are exact. */
static void roll_back_by_memory(tl_fmu_guard *guard) {
    tl_fmi2 *functions = &guard->functions;
    guard->by_memory = true;
    guard->memory.has_flags = true;
    functions->is_unaware = true;
    tl_fmu_memory_measure_anew(&guard->memory);
    functions->get_fmu_state = save_memory;
    functions->set_fmu_state = restore_memory;
    functions->free_fmu_state = forget_memory;
    functions->state_size = memory_size;
    functions->reserve_states = reserve_memory;
    own_no_bytes(functions);
    if (guard->is_by_choice) {
        own_bytes_of_copies(guard);
    }
}

static void give_all_again(tl_fmu_guard *guard) {
    tl_fmi2 *functions = &guard->functions;
    guard->by_memory = false;
    guard->gives_again = true;
    guard->memory.has_flags = false;
    functions->is_unaware = false;
    functions->get_fmu_state = keep_given;
    functions->set_fmu_state = give_again;
    functions->free_fmu_state = forget_given;
    functions->state_size = NULL;
    functions->reserve_states = NULL;
    own_no_bytes(functions);
}

static void roll_back_by_replay(tl_fmu_guard *guard) {
    tl_fmi2 *functions = &guard->functions;
    guard->by_memory = false;
    guard->by_replay = true;
    guard->memory.has_flags = false;
    functions->is_unaware = true;
    functions->get_fmu_state = keep_position;
    functions->set_fmu_state = go_to_position;
    functions->free_fmu_state = forget_position;
    functions->state_size = NULL;
    functions->reserve_states = NULL;
    functions->replay.most = guard->most;
    own_no_bytes(functions);
}

/* ---- the first of them ---- */

void tl_fmu_ladder_begin(tl_fmu_guard *guard) {
    static const tl_fmi2_aside aside = {.keep = keep_aside,
                                        .come_back = come_back,
                                        .give_up_states = give_up_states,
                                        .let_go = let_go,
                                        .size = size_aside,
                                        .has_choice = has_choice,
                                        .prefer_copy = prefer_copy};
    guard->by_states = guard->functions;
    if (guard->by_memory) {
        roll_back_by_memory(guard);
    } else if (guard->by_replay) {
        roll_back_by_replay(guard);
    }
    if (guard->may_replay || (guard->memory.heap != NULL && !guard->by_memory)) {
        guard->functions.aside = &aside;
    }
}
