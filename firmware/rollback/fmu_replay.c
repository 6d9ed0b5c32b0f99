/* A rollback that needs nothing of an FMU: see fmu_replay.h. */
#include "firmware/rollback/fmu_replay.h"

#include <stdlib.h>
#include <string.h>

#include "firmware/base/clock.h"

/* Kind of a call in the history: those of the prologue, and a step. */
enum { STEP = TL_PROLOGUE_EXIT_INITIALIZATION + 1 };

void tl_fmu_replay_end(tl_fmu_replay *replay) {
    tl_fmu_prologue_end(&replay->prologue);
    tl_fmu_history_close(&replay->history);
    free(replay->scratch);
    free(replay->place);
    replay->scratch = NULL;
    replay->place = NULL;
}

/* ---- what steps set and read ---- */

static size_t count_ports(const tl_ports *ports) {
    return ports->real_count + ports->integer_count + ports->boolean_count;
}

/* One of the six groups of ports. */
typedef struct port_group {
    const fmi2ValueReference *references;
    size_t count;
    size_t first; /* of its values in the history */
    bool is_set;
} port_group;

static port_group group_of(const tl_fmu_replay *replay, tl_fmu_prologue_kind kind) {
    const tl_ports *in = replay->inputs;
    const tl_ports *out = replay->outputs;
    switch (kind) {
    case TL_PROLOGUE_SET_REAL:
        return (port_group){in->real_references, in->real_count, 0, true};
    case TL_PROLOGUE_SET_INTEGER:
        return (port_group){in->integer_references, in->integer_count, in->real_count, true};
    case TL_PROLOGUE_SET_BOOLEAN:
        return (port_group){in->boolean_references, in->boolean_count, in->real_count + in->integer_count, true};
    case TL_PROLOGUE_GET_REAL:
        return (port_group){.references = out->real_references, .count = out->real_count};
    case TL_PROLOGUE_GET_INTEGER:
        return (port_group){.references = out->integer_references, .count = out->integer_count};
    case TL_PROLOGUE_GET_BOOLEAN:
        return (port_group){.references = out->boolean_references, .count = out->boolean_count};
    case TL_PROLOGUE_SET_STRING:
    case TL_PROLOGUE_SETUP:
    case TL_PROLOGUE_ENTER_INITIALIZATION:
    case TL_PROLOGUE_EXIT_INITIALIZATION:
        break;
    }
    return (port_group){.references = NULL};
}

/* All values in the way of the history. */
static void read_values(tl_fmu_prologue_kind kind, const void *values, size_t count, uint64_t *to) {
    if (kind == TL_PROLOGUE_SET_REAL || kind == TL_PROLOGUE_GET_REAL) {
        if (count != 0) {
            memcpy(to, values, count * sizeof *to);
        }
        return;
    }
    const fmi2Integer *integers = values; /* fmi2Boolean is the same C type */
    for (size_t i = 0; i < count; i++) {
        to[i] = (uint32_t)integers[i];
    }
}

static void write_values(tl_fmu_prologue_kind kind, const uint64_t *from, size_t count, void *values) {
    if (kind == TL_PROLOGUE_SET_REAL) {
        memcpy(values, from, count * sizeof *from);
        return;
    }
    fmi2Integer *integers = values;
    for (size_t i = 0; i < count; i++) {
        integers[i] = (fmi2Integer)(uint32_t)from[i];
    }
}

/* What cannot be told from other values, but by chance. */
static uint64_t mark(const uint64_t *values, size_t count) {
    uint64_t sum = 14695981039346656037U; /* FNV-1a, by words */
    for (size_t i = 0; i < count; i++) {
        sum = (sum ^ values[i]) * 1099511628211U;
        sum ^= sum >> 29;
    }
    return sum;
}

/* ---- phases ---- */

void tl_fmu_replay_begin(tl_fmu_replay *replay) {
    tl_fmu_prologue_begin(&replay->prologue);
    if (replay->history.calls != NULL) {
        tl_fmu_history_begin(&replay->history);
        replay->told->is_over = false;
    }
    replay->phase = TL_FMU_REPLAY_BEGINS;
}

void tl_fmu_replay_wait(tl_fmu_replay *replay) {
    if (replay->phase == TL_FMU_REPLAY_BEGINS) {
        replay->phase = TL_FMU_REPLAY_WAITS;
    }
}

/* Calls of a step: each group at most once. */
static uint32_t calls_of_step(const tl_fmu_replay *replay) {
    const tl_ports *in = replay->inputs;
    const tl_ports *out = replay->outputs;
    const size_t counts[] = {in->real_count,  in->integer_count,  in->boolean_count,
                             out->real_count, out->integer_count, out->boolean_count};
    uint32_t calls = 1;
    bool is_of_reals = count_ports(in) == in->real_count && count_ports(out) == out->real_count;
    for (size_t i = 0; i < sizeof counts / sizeof counts[0]; i++) {
        calls += counts[i] != 0 ? 1 : 0;
    }
    return is_of_reals ? 3 : calls; /* in one go no group is left out */
}

static fmi2Status take_memory(tl_fmu_replay *replay) {
    tl_error error;
    size_t in = replay->inputs == NULL ? 0 : count_ports(replay->inputs);
    size_t out = replay->outputs == NULL ? 0 : count_ports(replay->outputs);
    size_t most = (in > out ? in : out) + 1;
    if (replay->inputs == NULL || replay->outputs == NULL) {
        return fmi2Error;
    }
    replay->scratch = calloc(most, sizeof *replay->scratch);
    replay->place = calloc(most, sizeof *replay->place);
    if (replay->scratch == NULL || replay->place == NULL ||
        tl_fmu_history_open(&replay->history, replay->most, calls_of_step(replay), in, &error) != TL_OK) {
        tl_fmu_replay_end(replay);
        return fmi2Error;
    }
    replay->told->bytes = tl_fmu_history_bytes(replay->most, calls_of_step(replay), in);
    return fmi2OK;
}

fmi2Status tl_fmu_replay_start(tl_fmu_replay *replay) {
    if (replay->phase == TL_FMU_REPLAY_NOTES || replay->phase == TL_FMU_REPLAY_PLAYS) {
        return fmi2OK;
    }
    if (replay->history.calls == NULL && take_memory(replay) != fmi2OK) {
        return fmi2Error;
    }
    replay->phase = TL_FMU_REPLAY_NOTES;
    return fmi2OK;
}

/* ---- notes ---- */

/* No room, or an unknown call: it cannot be led back to where it goes from here, if that was not its last step anyway. */
static void look_for_end(tl_fmu_replay *replay) {
    replay->told->is_over = replay->told->is_over || replay->history.has_run_over;
}

static void note(tl_fmu_replay *replay, tl_fmu_prologue_kind kind, const fmi2ValueReference *references, size_t count,
                 const void *values) {
    const port_group known = group_of(replay, kind);
    if (known.count != count || (count != 0 && known.references != references)) {
        tl_fmu_history_lose(&replay->history);
        replay->told->is_over = true;
        return;
    }
    read_values(kind, values, count, replay->scratch);
    const tl_fmu_history_call call = {.kind = (uint8_t)kind, .gave = known.is_set ? 0 : mark(replay->scratch, count)};
    tl_fmu_history_add(&replay->history, &call, replay->scratch, known.first, known.is_set ? count : 0);
    look_for_end(replay);
}

void tl_fmu_replay_note(tl_fmu_replay *replay, tl_fmu_prologue_kind kind, const fmi2ValueReference *references,
                        size_t count, const void *values, fmi2Status status) {
    if (replay->phase == TL_FMU_REPLAY_BEGINS && status <= fmi2Warning) {
        tl_fmu_prologue_add(&replay->prologue, kind, references, count, values);
    } else if (replay->phase == TL_FMU_REPLAY_NOTES && status <= fmi2Warning) {
        note(replay, kind, references, count, values);
    } else if (replay->phase == TL_FMU_REPLAY_NOTES) {
        tl_fmu_history_lose(&replay->history);
    }
}

void tl_fmu_replay_note_step(tl_fmu_replay *replay, const tl_fmi2_step *step, fmi2Status status) {
    if (replay->phase != TL_FMU_REPLAY_NOTES) {
        return;
    }
    if (status > fmi2Warning) {
        tl_fmu_history_lose(&replay->history);
        return;
    }
    const tl_fmu_history_call call = {
        .kind = STEP, .is_step = true, .is_final = step->final != fmi2False, .now = step->now, .size = step->size};
    tl_fmu_history_add(&replay->history, &call, replay->scratch, 0, 0);
    look_for_end(replay);
}

/* ---- states ---- */

fmi2Status tl_fmu_replay_keep(tl_fmu_replay *replay, fmi2FMUstate *state) {
    if (tl_fmu_replay_start(replay) != fmi2OK) {
        return fmi2Error;
    }
    tl_fmu_replay_give_back(replay, state);
    *state = tl_fmu_history_keep(&replay->history);
    return fmi2OK;
}

void tl_fmu_replay_give_back(tl_fmu_replay *replay, fmi2FMUstate *state) {
    tl_fmu_history_give_back(&replay->history, *state);
    *state = NULL;
}

static fmi2Status play_values(tl_fmu_replay *replay, tl_fmu_prologue_kind kind) {
    const port_group known = group_of(replay, kind);
    const tl_fmi2 *fmi = replay->functions;
    write_values(kind, &replay->history.value[known.first], known.count, replay->place);
    const void *values = replay->place;
    switch (kind) {
    case TL_PROLOGUE_SET_REAL:
        return fmi->set_real(replay->instance, known.references, known.count, values);
    case TL_PROLOGUE_SET_INTEGER:
        return fmi->set_integer(replay->instance, known.references, known.count, values);
    default:
        return fmi->set_boolean(replay->instance, known.references, known.count, values);
    }
}

/* Other values than then: from here on it is not what it was. */
static fmi2Status play_get(tl_fmu_replay *replay, tl_fmu_prologue_kind kind, uint64_t gave) {
    const port_group known = group_of(replay, kind);
    const tl_fmi2 *fmi = replay->functions;
    void *values = replay->place;
    fmi2Status status =
        kind == TL_PROLOGUE_GET_REAL      ? fmi->get_real(replay->instance, known.references, known.count, values)
        : kind == TL_PROLOGUE_GET_INTEGER ? fmi->get_integer(replay->instance, known.references, known.count, values)
                                          : fmi->get_boolean(replay->instance, known.references, known.count, values);
    if (status <= fmi2Warning) {
        read_values(kind, values, known.count, replay->scratch);
        replay->told->differs = replay->told->differs || mark(replay->scratch, known.count) != gave;
    }
    return status;
}

static fmi2Status play(tl_fmu_replay *replay, const tl_fmu_history_call *call) {
    if (call->is_step) {
        replay->told->steps++;
        return replay->functions->do_step(replay->instance, call->now, call->size,
                                          call->is_final ? fmi2True : fmi2False);
    }
    tl_fmu_prologue_kind kind = (tl_fmu_prologue_kind)call->kind;
    return kind <= TL_PROLOGUE_SET_BOOLEAN ? play_values(replay, kind) : play_get(replay, kind, call->gave);
}

/* Reset, and its prologue. */
static fmi2Status begin_anew(tl_fmu_replay *replay) {
    tl_time begun = tl_clock_now(NULL);
    fmi2Status status = replay->reset(replay->instance);
    if (status <= fmi2Warning) {
        status = tl_fmu_prologue_play(&replay->prologue, replay->functions, replay->instance);
    }
    tl_time took = tl_clock_now(NULL) - begun;
    replay->told->beginning = took > replay->told->beginning ? took : replay->told->beginning;
    return status;
}

static fmi2Status go(tl_fmu_replay *replay, uint32_t first, bool anew) {
    fmi2Status status = anew ? begin_anew(replay) : fmi2OK;
    for (uint32_t at = first; at != TL_FMU_HISTORY_NONE && status <= fmi2Warning;) {
        const tl_fmu_history_call *call;
        at = tl_fmu_history_follow(&replay->history, at, &call);
        status = play(replay, call);
    }
    return status;
}

fmi2Status tl_fmu_replay_lead(tl_fmu_replay *replay, fmi2FMUstate state) {
    uint32_t first = TL_FMU_HISTORY_NONE;
    bool anew = false;
    if (replay->phase != TL_FMU_REPLAY_NOTES || !tl_fmu_history_find_way(&replay->history, state, &first, &anew)) {
        return fmi2Error;
    }
    replay->phase = TL_FMU_REPLAY_PLAYS;
    fmi2Status status = go(replay, first, anew);
    replay->phase = TL_FMU_REPLAY_NOTES;
    if (status > fmi2Warning) {
        tl_fmu_history_lose(&replay->history);
        return status;
    }
    tl_fmu_history_arrive(&replay->history, state);
    return fmi2OK;
}

fmi2Status tl_fmu_replay_lead_to_beginning(tl_fmu_replay *replay) {
    if (replay->phase != TL_FMU_REPLAY_NOTES) {
        return fmi2Error;
    }
    tl_fmu_history_begin(&replay->history);
    replay->told->is_over = false;
    replay->told->differs = false;
    replay->phase = TL_FMU_REPLAY_PLAYS;
    fmi2Status status = begin_anew(replay);
    replay->phase = TL_FMU_REPLAY_NOTES;
    return status <= fmi2Warning ? fmi2OK : status;
}
