/* Rollback by replay, see fmu_replay.h. */
#include "firmware/rollback/fmu_replay.h"

#include <stdlib.h>
#include <string.h>

#include "firmware/base/os.h"

/* ---- prologue ---- */

/* A call to be repeated; `value_buffer` is the buffer for values that it reads. */
typedef struct played {
    tl_fmu_prologue_kind kind;
    size_t count;
    const void *values;
    const fmi2ValueReference *references;
    void *value_buffer;
} played;

struct tl_fmu_prologue_call {
    struct tl_fmu_prologue_call *next;
    played call;
    double bytes[]; /* buffer or pointers to texts; then values; then references */
};

void tl_fmu_prologue_end(tl_fmu_prologue *prologue) {
    for (struct tl_fmu_prologue_call *call = prologue->first, *next = NULL; call != NULL; call = next) {
        next = call->next;
        free(call);
    }
    *prologue = (tl_fmu_prologue){0};
}

static size_t aligned(size_t size) {
    return (size + sizeof(double) - 1) / sizeof(double) * sizeof(double);
}

static size_t bytes_of_values(tl_fmu_prologue_kind kind, size_t count) {
    bool is_real = kind == TL_PROLOGUE_SET_REAL || kind == TL_PROLOGUE_GET_REAL;
    return count * (is_real ? sizeof(fmi2Real) : sizeof(fmi2Integer)); /* fmi2Boolean has the same C type */
}

/* Bytes of the values that are stored. */
static size_t size_of_values(tl_fmu_prologue_kind kind, size_t count, const void *values) {
    const fmi2String *texts = values;
    size_t size = 0;
    if (kind <= TL_PROLOGUE_SET_BOOLEAN) {
        return bytes_of_values(kind, count);
    }
    for (size_t i = 0; kind == TL_PROLOGUE_SET_STRING && i < count; i++) {
        size += strlen(texts[i]) + 1;
    }
    return kind == TL_PROLOGUE_SETUP ? sizeof(tl_fmu_setup) : size;
}

static void copy_texts(fmi2String *copies, char *to, const fmi2String *texts, size_t count) {
    for (size_t i = 0; i < count; i++) {
        copies[i] = to;
        to = stpcpy(to, texts[i]) + 1;
    }
}

void tl_fmu_prologue_add(tl_fmu_prologue *prologue, tl_fmu_prologue_kind kind, const fmi2ValueReference *references,
                         size_t count, const void *values) {
    size_t size = size_of_values(kind, count, values);
    size_t named = references == NULL ? 0 : count * sizeof *references;
    size_t value_buffer = kind < TL_PROLOGUE_SET_STRING ? 0 : count;
    struct tl_fmu_prologue_call *made = malloc(sizeof *made + value_buffer * sizeof(double) + aligned(size) + named);
    if (made == NULL) {
        prologue->is_cut = true;
        return;
    }
    char *at = (char *)(made->bytes + value_buffer);
    void *references_at = at + aligned(size);
    *made = (struct tl_fmu_prologue_call){.call = {kind, count, at, references_at, made->bytes}};
    if (kind == TL_PROLOGUE_SET_STRING) {
        copy_texts((void *)made->bytes, at, values, count);
        made->call.values = made->bytes;
    } else if (size != 0) {
        memcpy(at, values, size);
    }
    if (named != 0) {
        memcpy(references_at, references, named);
    }
    *(prologue->last != NULL ? &prologue->last->next : &prologue->first) = made;
    prologue->last = made;
}

static fmi2Status call_again(const played *call, const tl_fmi2 *functions, fmi2Component instance) {
    const tl_fmu_setup *setup = call->values;
    switch (call->kind) {
    case TL_PROLOGUE_SET_REAL:
        return functions->set_real(instance, call->references, call->count, call->values);
    case TL_PROLOGUE_SET_INTEGER:
        return functions->set_integer(instance, call->references, call->count, call->values);
    case TL_PROLOGUE_SET_BOOLEAN:
        return functions->set_boolean(instance, call->references, call->count, call->values);
    case TL_PROLOGUE_SET_STRING:
        return functions->set_string(instance, call->references, call->count, call->values);
    case TL_PROLOGUE_GET_REAL:
        return functions->get_real(instance, call->references, call->count, call->value_buffer);
    case TL_PROLOGUE_GET_INTEGER:
        return functions->get_integer(instance, call->references, call->count, call->value_buffer);
    case TL_PROLOGUE_GET_BOOLEAN:
        return functions->get_boolean(instance, call->references, call->count, call->value_buffer);
    case TL_PROLOGUE_SETUP:
        return functions->setup_experiment(instance, setup->has_tolerance, setup->tolerance, setup->start,
                                           setup->has_stop, setup->stop);
    case TL_PROLOGUE_ENTER_INITIALIZATION:
        return functions->enter_initialization_mode(instance);
    case TL_PROLOGUE_EXIT_INITIALIZATION:
        return functions->exit_initialization_mode(instance);
    }
    return fmi2Error;
}

fmi2Status tl_fmu_prologue_play(const tl_fmu_prologue *prologue, const tl_fmi2 *functions, fmi2Component instance) {
    fmi2Status status = prologue->is_cut ? fmi2Error : fmi2OK;
    for (const struct tl_fmu_prologue_call *at = prologue->first; at != NULL && status <= fmi2Warning; at = at->next) {
        status = call_again(&at->call, functions, instance);
    }
    return status;
}

/* ---- history ---- */

#define NONE TL_FMU_HISTORY_NONE

/* ---- memory ---- */

static size_t count_calls(uint32_t most, uint32_t calls) {
    return ((size_t)most + TL_FMU_HISTORY_BRANCHES) * calls + 1;
}

/* Bytes that tl_fmu_history_open() allocates. */
static size_t count_bytes(uint32_t most, uint32_t calls, size_t size) {
    return count_calls(most, calls) * (sizeof(tl_fmu_history_call) + size);
}

tl_status tl_fmu_history_open(tl_fmu_history *history, uint32_t most, uint32_t calls, size_t size, tl_error *error) {
    size_t call_count = count_calls(most, calls);
    *history = (tl_fmu_history){.most = most, .size = size};
    if (call_count < NONE / 2) {
        history->calls = calloc(call_count, sizeof *history->calls);
        history->values = calloc(call_count, size + 1);
    }
    if (history->calls == NULL || history->values == NULL) {
        tl_fmu_history_close(history);
        return tl_fail(
            error, TL_TRY_AGAIN,
            "not enough memory to record the inputs of %u steps: %zu bytes; lower \"replay_steps\" of the component",
            (unsigned)most, count_bytes(most, calls, size));
    }
    history->call_count = (uint32_t)call_count;
    tl_fmu_history_begin(history);
    return TL_OK;
}

void tl_fmu_history_close(tl_fmu_history *history) {
    free(history->calls);
    free(history->values);
    *history = (tl_fmu_history){0};
}

static uint32_t take_call(tl_fmu_history *history) {
    uint32_t call = history->free_call;
    if (call != NONE) {
        history->free_call = history->calls[call].next;
        history->calls[call] = (tl_fmu_history_call){.parent = NONE, .next = NONE};
    }
    return call;
}

/* Frees the call and its parents as long as they are not needed. */
static void free_branch(tl_fmu_history *history, uint32_t call) {
    while (call != NONE && call != history->root && call != history->at && history->calls[call].children == 0 &&
           history->calls[call].kept == 0) {
        uint32_t parent = history->calls[call].parent;
        history->calls[call].next = history->free_call;
        history->free_call = call;
        if (parent != NONE) {
            history->calls[parent].children--;
        }
        call = parent;
    }
}

/* ---- present position ---- */

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

/* Saved positions keep their entries until they are freed, but cannot be restored any more. */
void tl_fmu_history_begin(tl_fmu_history *history) {
    uint32_t kept = 0;
    history->free_call = NONE;
    for (uint32_t i = history->call_count; i-- > 0;) {
        tl_fmu_history_call *call = &history->calls[i];
        call->children = 0;
        call->parent = NONE;
        call->steps = 0;
        if (call->kept == 0) {
            call->next = history->free_call;
            history->free_call = i;
        } else {
            kept++;
        }
    }
    history->has_run_over = kept == history->call_count;
    history->root = take_call(history);
    history->at = history->root;
    history->off++;
}

void tl_fmu_history_add(tl_fmu_history *history, const tl_fmu_history_call *call, const void *values, size_t size) {
    uint32_t parent = history->at;
    uint32_t steps = parent == NONE ? 0 : history->calls[parent].steps + (call->is_step ? 1 : 0);
    uint32_t made = parent == NONE || steps > history->most ? NONE : take_call(history);
    history->has_run_over = history->has_run_over || (parent != NONE && steps <= history->most && made == NONE);
    if (made == NONE) {
        tl_fmu_history_lose(history);
        return;
    }
    tl_fmu_history_call *value_buffer = &history->calls[made];
    *value_buffer = *call;
    value_buffer->steps = steps;
    value_buffer->parent = parent;
    value_buffer->next = NONE;
    if (size != 0) {
        memcpy(history->values + made * history->size, values, size);
    }
    history->calls[parent].children++;
    history->at = made;
}

/* ---- saved positions ---- */

/* A handle is a number: even if it is on the tree, odd if it is off the tree; never 0. */
static void *handle_of(uint32_t number, bool is_off) {
    return (void *)((((uintptr_t)number + 1) << 1) | (is_off ? 1U : 0U)); // NOLINT(performance-no-int-to-ptr)
}

static bool is_off(const void *kept) {
    return ((uintptr_t)kept & 1U) != 0;
}

static uint32_t number_of(const void *kept) {
    return (uint32_t)(((uintptr_t)kept >> 1) - 1);
}

/* Limited to the bits that fit into a handle on a 32-bit machine. */
static uint32_t place_off(const tl_fmu_history *history) {
    return history->off & (UINT32_MAX >> 2);
}

void *tl_fmu_history_save(tl_fmu_history *history) {
    if (history->at == NONE) {
        return handle_of(place_off(history), true);
    }
    history->calls[history->at].kept++;
    return handle_of(history->at, false);
}

void tl_fmu_history_forget(tl_fmu_history *history, void *kept) {
    if (kept != NULL && !is_off(kept)) {
        history->calls[number_of(kept)].kept--;
        free_branch(history, number_of(kept));
    }
}

bool tl_fmu_history_is_at(const tl_fmu_history *history, const void *kept) {
    return is_off(kept) ? history->at == NONE && number_of(kept) == place_off(history) : history->at == number_of(kept);
}

/* ---- restore ---- */

bool tl_fmu_history_find_path(tl_fmu_history *history, const void *kept, uint32_t *first, bool *restarted) {
    *first = NONE;
    *restarted = false;
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
            return false; /* it was saved before the history was restarted */
        }
        history->calls[parent].next = call;
        *first = call;
        call = parent;
    }
    *restarted = call != history->at;
    return true;
}

uint32_t tl_fmu_history_follow(const tl_fmu_history *history, uint32_t call, const tl_fmu_history_call **made,
                               const void **values) {
    *made = &history->calls[call];
    *values = history->values + call * history->size;
    return (*made)->next;
}

void tl_fmu_history_arrive(tl_fmu_history *history, const void *kept) {
    if (!is_off(kept)) {
        stand(history, number_of(kept));
    }
}

/* ---- replay ---- */

/* Kinds of calls in the history: those of the prologue, and STEP. */
enum { STEP = TL_PROLOGUE_EXIT_INITIALIZATION + 1 };

void tl_fmu_replay_end(tl_fmu_replay *replay) {
    tl_fmu_prologue_end(&replay->prologue);
    tl_fmu_history_close(&replay->history);
    free(replay->value_buffer);
    replay->value_buffer = NULL;
}

/* ---- ports that steps set and read ---- */

static size_t count_ports(const tl_ports *ports) {
    return ports->real_count + ports->integer_count + ports->boolean_count;
}

/* One of the six groups of ports. */
typedef struct port_group {
    const fmi2ValueReference *references;
    size_t count;
    bool is_set;
} port_group;

static port_group group_of(const tl_fmu_replay *replay, tl_fmu_prologue_kind kind) {
    const tl_ports *in = replay->inputs;
    const tl_ports *out = replay->outputs;
    const port_group groups[] = {
        [TL_PROLOGUE_SET_REAL] = {in->real_references, in->real_count, true},
        [TL_PROLOGUE_SET_INTEGER] = {in->integer_references, in->integer_count, true},
        [TL_PROLOGUE_SET_BOOLEAN] = {in->boolean_references, in->boolean_count, true},
        [TL_PROLOGUE_SET_STRING] = {.references = NULL},
        [TL_PROLOGUE_GET_REAL] = {out->real_references, out->real_count, false},
        [TL_PROLOGUE_GET_INTEGER] = {out->integer_references, out->integer_count, false},
        [TL_PROLOGUE_GET_BOOLEAN] = {out->boolean_references, out->boolean_count, false},
    };
    return groups[kind <= TL_PROLOGUE_GET_BOOLEAN ? kind : TL_PROLOGUE_SET_STRING];
}

/* Hash of the values; equal hashes of different values are very unlikely. */
static uint64_t mark(const void *values, size_t size) {
    uint64_t sum = 14695981039346656037U; /* FNV-1a on 64-bit values, with an extra shift */
    for (size_t i = 0; i < size; i += sizeof sum) {
        uint64_t word = 0;
        memcpy(&word, (const unsigned char *)values + i, size - i < sizeof word ? size - i : sizeof word);
        sum = (sum ^ word) * 1099511628211U;
        sum ^= sum >> 29;
    }
    return sum;
}

/* ---- phases ---- */

void tl_fmu_replay_begin(tl_fmu_replay *replay) {
    tl_fmu_prologue_end(&replay->prologue);
    if (replay->history.calls != NULL) {
        tl_fmu_history_begin(&replay->history);
        replay->results->is_disabled = false;
    }
    replay->phase = TL_FMU_REPLAY_BEGINS;
}

void tl_fmu_replay_wait(tl_fmu_replay *replay) {
    if (replay->phase == TL_FMU_REPLAY_BEGINS) {
        replay->phase = TL_FMU_REPLAY_WAITS;
    }
}

/* Most calls per step: each group once. */
static uint32_t calls_of_step(const tl_fmu_replay *replay) {
    uint32_t calls = 1;
    bool is_of_reals = count_ports(replay->inputs) == replay->inputs->real_count &&
                       count_ports(replay->outputs) == replay->outputs->real_count;
    for (int kind = TL_PROLOGUE_SET_REAL; kind <= TL_PROLOGUE_GET_BOOLEAN; kind++) {
        calls += group_of(replay, (tl_fmu_prologue_kind)kind).count != 0 ? 1 : 0;
    }
    return is_of_reals ? 3 : calls; /* step_reals() calls both groups, even if one is empty */
}

static fmi2Status take_memory(tl_fmu_replay *replay) {
    tl_error error;
    const tl_ports *in = replay->inputs;
    if (in == NULL || replay->outputs == NULL) {
        return fmi2Error;
    }
    size_t integers = in->integer_count > in->boolean_count ? in->integer_count : in->boolean_count;
    size_t size = in->real_count * sizeof(fmi2Real);
    size = size > integers * sizeof(fmi2Integer) ? size : aligned(integers * sizeof(fmi2Integer));
    size_t values = count_ports(replay->outputs) > count_ports(in) ? count_ports(replay->outputs) : count_ports(in);
    replay->value_buffer = calloc(values + 1, sizeof *replay->value_buffer);
    if (replay->value_buffer == NULL ||
        tl_fmu_history_open(&replay->history, replay->most, calls_of_step(replay), size, &error) != TL_OK) {
        tl_fmu_replay_end(replay);
        return fmi2Error;
    }
    replay->results->bytes = count_bytes(replay->most, calls_of_step(replay), size);
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

/* ---- noting calls ---- */

/* Ends the replay if memory for a call was missing; reaching the limit of steps does not end it. */
static void look_for_end(tl_fmu_replay *replay) {
    replay->results->is_disabled = replay->results->is_disabled || replay->history.has_run_over;
}

static void note(tl_fmu_replay *replay, tl_fmu_prologue_kind kind, const fmi2ValueReference *references, size_t count,
                 const void *values) {
    const port_group known = group_of(replay, kind);
    if (known.count != count || (count != 0 && known.references != references)) {
        tl_fmu_history_lose(&replay->history);
        replay->results->is_disabled = true;
        return;
    }
    size_t size = bytes_of_values(kind, count);
    const tl_fmu_history_call call = {.kind = (uint8_t)kind, .result_hash = known.is_set ? 0 : mark(values, size)};
    tl_fmu_history_add(&replay->history, &call, values, known.is_set ? size : 0);
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
    tl_fmu_history_add(&replay->history, &call, NULL, 0);
    look_for_end(replay);
}

/* ---- save and restore ---- */

fmi2Status tl_fmu_replay_save(tl_fmu_replay *replay, fmi2FMUstate *state) {
    if (tl_fmu_replay_start(replay) != fmi2OK) {
        return fmi2Error;
    }
    tl_fmu_replay_forget(replay, state);
    *state = tl_fmu_history_save(&replay->history);
    return fmi2OK;
}

void tl_fmu_replay_forget(tl_fmu_replay *replay, fmi2FMUstate *state) {
    tl_fmu_history_forget(&replay->history, *state);
    *state = NULL;
}

/* Repeats a call. If it reads other values than before, `differs` is set: the FMU is no longer in
 * the original state. */
static fmi2Status play(tl_fmu_replay *replay, const tl_fmu_history_call *call, const void *values) {
    if (call->is_step) {
        replay->results->steps++;
        return replay->functions->do_step(replay->instance, call->now, call->size,
                                          call->is_final ? fmi2True : fmi2False);
    }
    tl_fmu_prologue_kind kind = (tl_fmu_prologue_kind)call->kind;
    const port_group known = group_of(replay, kind);
    if (known.is_set) { /* a copy, because an FMU may write to it */
        memcpy(replay->value_buffer, values, bytes_of_values(kind, known.count));
        values = replay->value_buffer;
    }
    const played made = {kind, known.count, values, known.references, replay->value_buffer};
    fmi2Status status = call_again(&made, replay->functions, replay->instance);
    if (status <= fmi2Warning && !known.is_set) {
        uint64_t gives = mark(replay->value_buffer, bytes_of_values(kind, known.count));
        replay->results->differs = replay->results->differs || gives != call->result_hash;
    }
    return status;
}

/* Resets the FMU and repeats its prologue. */
static fmi2Status reset_instance(tl_fmu_replay *replay) {
    tl_time started_at = tl_clock_now(NULL);
    fmi2Status status = replay->reset(replay->instance);
    if (status <= fmi2Warning) {
        status = tl_fmu_prologue_play(&replay->prologue, replay->functions, replay->instance);
    }
    tl_time took = tl_clock_now(NULL) - started_at;
    replay->results->longest_reset = took > replay->results->longest_reset ? took : replay->results->longest_reset;
    return status;
}

static fmi2Status replay_calls(tl_fmu_replay *replay, uint32_t first, bool restarted) {
    fmi2Status status = restarted ? reset_instance(replay) : fmi2OK;
    for (uint32_t at = first; at != TL_FMU_HISTORY_NONE && status <= fmi2Warning;) {
        const tl_fmu_history_call *call;
        const void *values;
        at = tl_fmu_history_follow(&replay->history, at, &call, &values);
        status = play(replay, call, values);
    }
    return status;
}

fmi2Status tl_fmu_replay_restore(tl_fmu_replay *replay, fmi2FMUstate state) {
    uint32_t first = TL_FMU_HISTORY_NONE;
    bool restarted = false;
    if (replay->phase != TL_FMU_REPLAY_NOTES ||
        !tl_fmu_history_find_path(&replay->history, state, &first, &restarted)) {
        return fmi2Error;
    }
    replay->phase = TL_FMU_REPLAY_PLAYS;
    fmi2Status status = replay_calls(replay, first, restarted);
    replay->phase = TL_FMU_REPLAY_NOTES;
    if (status > fmi2Warning) {
        tl_fmu_history_lose(&replay->history);
        return status;
    }
    tl_fmu_history_arrive(&replay->history, state);
    return fmi2OK;
}

fmi2Status tl_fmu_replay_restore_start(tl_fmu_replay *replay) {
    if (replay->phase != TL_FMU_REPLAY_NOTES) {
        return fmi2Error;
    }
    tl_fmu_history_begin(&replay->history);
    replay->results->is_disabled = false;
    replay->results->differs = false;
    replay->phase = TL_FMU_REPLAY_PLAYS;
    fmi2Status status = reset_instance(replay);
    replay->phase = TL_FMU_REPLAY_NOTES;
    if (status > fmi2Warning) {
        tl_fmu_history_lose(&replay->history);
        return status;
    }
    return fmi2OK;
}
