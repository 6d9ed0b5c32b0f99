/* What an FMU was given since its first step: see fmu_history.h. */
#include "firmware/rollback/fmu_history.h"

#include <stdlib.h>
#include <string.h>

#define NONE TL_FMU_HISTORY_NONE

/* ---- memory ---- */

static size_t count_calls(uint32_t most, uint32_t calls) {
    return ((size_t)most + TL_FMU_HISTORY_BRANCHES) * calls + 1;
}

/* A value changes in one call of a step at most. */
static size_t count_changes(uint32_t most, size_t values) {
    return ((size_t)most + TL_FMU_HISTORY_BRANCHES) * values + 1;
}

size_t tl_fmu_history_bytes(uint32_t most, uint32_t calls, size_t values) {
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
