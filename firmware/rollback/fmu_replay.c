/* Rollback by replay: an FMU is reset and gets its inputs again: see fmu_replay.h. */
#include "firmware/rollback/fmu_replay.h"

#include <stdlib.h>
#include <string.h>

#include "firmware/base/os.h"

/* ---- fmu history ---- */

#define NONE TL_FMU_HISTORY_NONE

/* ---- memory ---- */

static size_t count_calls(uint32_t most, uint32_t calls) {
    return ((size_t)most + TL_FMU_HISTORY_BRANCHES) * calls + 1;
}

/* A value changes in one call of a step at most. */
static size_t count_changes(uint32_t most, size_t values) {
    return ((size_t)most + TL_FMU_HISTORY_BRANCHES) * values + 1;
}

/* Bytes that it takes for that; what tl_fmu_history_open() takes. */
static size_t tl_fmu_history_bytes(uint32_t most, uint32_t calls, size_t values) {
    return count_calls(most, calls) * sizeof(tl_fmu_history_call) +
           count_changes(most, values) * sizeof(tl_fmu_history_change) + values * sizeof(uint64_t);
}

static void link_all(tl_fmu_history *history) {
    for (uint32_t i = 0; i < history->call_count; i++) {
        history->calls[i].next = i + 1 < history->call_count ? i + 1 : NONE;
    }
    for (uint32_t i = 0; i < history->change_count; i++) {
        history->changes[i].next = i + 1 < history->change_count ? i + 1 : NONE;
    }
    history->free_call = 0;
    history->free_change = 0;
}

tl_status tl_fmu_history_open(tl_fmu_history *history, uint32_t most, uint32_t calls, size_t values, tl_error *error) {
    size_t call_count = count_calls(most, calls);
    size_t change_count = count_changes(most, values);
    *history = (tl_fmu_history){.most = most, .value_count = values, .root = NONE, .at = NONE};
    if (call_count < NONE / 2 && change_count < NONE / 2) {
        history->calls = calloc(call_count, sizeof *history->calls);
        history->changes = calloc(change_count, sizeof *history->changes);
        history->value = calloc(values + 1, sizeof *history->value);
    }
    if (history->calls == NULL || history->changes == NULL || history->value == NULL) {
        tl_fmu_history_close(history);
        return tl_fail(error, TL_TRY_AGAIN, "not enough memory to keep what an FMU is given in %u steps: %zu bytes",
                       (unsigned)most, tl_fmu_history_bytes(most, calls, values));
    }
    history->call_count = (uint32_t)call_count;
    history->change_count = (uint32_t)change_count;
    link_all(history);
    tl_fmu_history_begin(history);
    return TL_OK;
}

void tl_fmu_history_close(tl_fmu_history *history) {
    free(history->calls);
    free(history->changes);
    free(history->value);
    *history = (tl_fmu_history){0};
}

static uint32_t take_call(tl_fmu_history *history) {
    uint32_t call = history->free_call;
    if (call != NONE) {
        history->free_call = history->calls[call].next;
        history->calls[call] = (tl_fmu_history_call){.parent = NONE, .next = NONE, .change = NONE};
    }
    return call;
}

static void free_changes(tl_fmu_history *history, uint32_t call) {
    uint32_t change = history->calls[call].change;
    while (change != NONE) {
        uint32_t next = history->changes[change].next;
        history->changes[change].next = history->free_change;
        history->free_change = change;
        change = next;
    }
    history->calls[call].change = NONE;
}

/* And those above it that nobody needs any more. */
static void free_branch(tl_fmu_history *history, uint32_t call) {
    while (call != NONE && call != history->root && call != history->at && history->calls[call].children == 0 &&
           history->calls[call].kept == 0) {
        uint32_t parent = history->calls[call].parent;
        free_changes(history, call);
        history->calls[call].next = history->free_call;
        history->free_call = call;
        if (parent != NONE) {
            history->calls[parent].children--;
        }
        call = parent;
    }
}

/* ---- where it stands ---- */

static void stand(tl_fmu_history *history, uint32_t call) {
    uint32_t before = history->at;
    history->at = call;
    if (before != call) {
        free_branch(history, before);
    }
}

void tl_fmu_history_lose(tl_fmu_history *history) {
    history->off++;
    stand(history, NONE);
}

/* What is kept stays as a place that leads nowhere. */
void tl_fmu_history_begin(tl_fmu_history *history) {
    for (uint32_t i = 0; i < history->call_count; i++) {
        tl_fmu_history_call *call = &history->calls[i];
        call->children = 0;
        call->parent = NONE;
        call->steps = 0;
    }
    uint32_t kept = 0;
    history->free_call = NONE;
    for (uint32_t i = history->call_count; i-- > 0;) {
        tl_fmu_history_call *call = &history->calls[i];
        call->change = NONE;
        if (call->kept == 0) {
            call->next = history->free_call;
            history->free_call = i;
        } else {
            kept++;
        }
    }
    for (uint32_t i = 0; i < history->change_count; i++) {
        history->changes[i].next = i + 1 < history->change_count ? i + 1 : NONE;
    }
    history->free_change = 0;
    history->has_run_over = kept == history->call_count;
    history->root = take_call(history);
    history->at = history->root;
    history->off++;
    memset(history->value, 0, history->value_count * sizeof *history->value);
}

/* False: no room; what was added of it is free again. */
static bool add_changes(tl_fmu_history *history, uint32_t call, const uint64_t *values, size_t first, size_t count) {
    for (size_t i = 0; i < count; i++) {
        if (values[i] == history->value[first + i]) {
            continue;
        }
        uint32_t change = history->free_change;
        if (change == NONE) {
            free_changes(history, call);
            return false;
        }
        history->free_change = history->changes[change].next;
        history->changes[change] = (tl_fmu_history_change){
            .next = history->calls[call].change, .index = (uint32_t)(first + i), .value = values[i]};
        history->calls[call].change = change;
    }
    if (count != 0) {
        memcpy(&history->value[first], values, count * sizeof *values);
    }
    return true;
}

void tl_fmu_history_add(tl_fmu_history *history, const tl_fmu_history_call *call, const uint64_t *values, size_t first,
                        size_t count) {
    uint32_t parent = history->at;
    uint32_t steps = parent == NONE ? 0 : history->calls[parent].steps + (call->is_step ? 1 : 0);
    uint32_t made = parent == NONE || steps > history->most ? NONE : take_call(history);
    history->has_run_over = history->has_run_over || (parent != NONE && steps <= history->most && made == NONE);
    if (made == NONE) {
        tl_fmu_history_lose(history);
        return;
    }
    tl_fmu_history_call *place = &history->calls[made];
    *place = (tl_fmu_history_call){.kind = call->kind,
                                   .is_step = call->is_step,
                                   .is_final = call->is_final,
                                   .now = call->now,
                                   .size = call->size,
                                   .gave = call->gave,
                                   .steps = steps,
                                   .parent = parent,
                                   .next = NONE,
                                   .change = NONE};
    history->calls[parent].children++;
    if (!add_changes(history, made, values, first, count)) {
        history->has_run_over = true;
        tl_fmu_history_lose(history);
        free_branch(history, made);
        return;
    }
    history->at = made;
}

/* ---- what is kept ---- */

/* A handle is a number: even on the tree, odd off it; never 0. */
static void *handle_of(uint32_t number, bool is_off) {
    return (void *)((((uintptr_t)number + 1) << 1) | (is_off ? 1U : 0U)); // NOLINT(performance-no-int-to-ptr)
}

static bool is_off(const void *kept) {
    return ((uintptr_t)kept & 1U) != 0;
}

static uint32_t number_of(const void *kept) {
    return (uint32_t)(((uintptr_t)kept >> 1) - 1);
}

/* What fits into a handle of this machine. */
static uint32_t place_off(const tl_fmu_history *history) {
    return history->off & (UINT32_MAX >> 2);
}

void *tl_fmu_history_keep(tl_fmu_history *history) {
    if (history->at == NONE) {
        return handle_of(place_off(history), true);
    }
    history->calls[history->at].kept++;
    return handle_of(history->at, false);
}

void tl_fmu_history_give_back(tl_fmu_history *history, void *kept) {
    if (kept != NULL && !is_off(kept)) {
        history->calls[number_of(kept)].kept--;
        free_branch(history, number_of(kept));
    }
}

bool tl_fmu_history_is_at(const tl_fmu_history *history, const void *kept) {
    return is_off(kept) ? history->at == NONE && number_of(kept) == place_off(history) : history->at == number_of(kept);
}

/* ---- the way back ---- */

bool tl_fmu_history_find_way(tl_fmu_history *history, const void *kept, uint32_t *first, bool *anew) {
    *first = NONE;
    *anew = false;
    if (tl_fmu_history_is_at(history, kept)) {
        return true;
    }
    if (is_off(kept)) {
        return false;
    }
    uint32_t call = number_of(kept);
    history->calls[call].next = NONE;
    while (call != history->root && call != history->at) {
        uint32_t parent = history->calls[call].parent;
        if (parent == NONE) {
            return false; /* it was kept before another beginning */
        }
        history->calls[parent].next = call;
        *first = call;
        call = parent;
    }
    *anew = call != history->at;
    if (*anew) {
        memset(history->value, 0, history->value_count * sizeof *history->value);
    }
    return true;
}

uint32_t tl_fmu_history_follow(tl_fmu_history *history, uint32_t call, const tl_fmu_history_call **made) {
    *made = &history->calls[call];
    for (uint32_t change = (*made)->change; change != NONE; change = history->changes[change].next) {
        history->value[history->changes[change].index] = history->changes[change].value;
    }
    return (*made)->next;
}

void tl_fmu_history_arrive(tl_fmu_history *history, const void *kept) {
    if (!is_off(kept)) {
        stand(history, number_of(kept));
    }
}

/* ---- fmu replay ---- */

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
