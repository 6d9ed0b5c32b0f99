/* Execution ledger: see ledger.h. Steps are absolute here: a candidate that started earlier is
 * compared with the values committed since. */
#include "master/sync/ledger.h"

#include <string.h>

/* Most doubles for remembered candidates: 8 MB. */
static const size_t MOST_VALUES = (size_t)1 << 20;

/* There is no difference. */
static const int64_t FOREVER = INT64_MAX / 2;

static size_t most_entries(const tl_horizon *horizon, uint32_t evaluations) {
    size_t wanted = (size_t)evaluations * horizon->prediction;
    size_t room = MOST_VALUES / ((size_t)horizon->prediction * horizon->variables);
    return wanted < room ? wanted : room;
}

bool tl_ledger_init(tl_ledger *ledger, tl_arena *arena, const tl_horizon *horizon, const tl_plant *plant,
                    const tl_plan *plan, uint32_t evaluations) {
    *ledger = (tl_ledger){.horizon = horizon, .plant = plant, .saving = plan->saving};
    ledger->signal_count = plan->signal_count;
    ledger->ahead = plan->measurements == TL_AHEAD;
    ledger->known = tl_arena_take(arena, horizon->nodes, sizeof *ledger->known);
    ledger->saved = tl_arena_take(arena, horizon->nodes, sizeof *ledger->saved);
    ledger->until = tl_arena_take(arena, horizon->nodes, sizeof *ledger->until);
    ledger->settled = tl_arena_take(arena, horizon->nodes, sizeof *ledger->settled);
    ledger->executes = tl_arena_take(arena, horizon->nodes, sizeof *ledger->executes);
    if (ledger->known == NULL || ledger->until == NULL || ledger->settled == NULL || ledger->saved == NULL ||
        ledger->executes == NULL) {
        return false;
    }
    for (size_t k = 0; k < plan->component_count; k++) {
        ledger->executes[k] = plan->components[k].keep == TL_KEEP_NONE;
    }
    if (horizon->variables == 0 || !plan->saving.sequences) {
        return true;
    }
    size_t sequence = (size_t)horizon->prediction * horizon->variables;
    ledger->capacity = most_entries(horizon, evaluations);
    ledger->entries = tl_arena_take(arena, ledger->capacity, sizeof *ledger->entries);
    ledger->sequences = tl_arena_take(arena, ledger->capacity * sequence, sizeof *ledger->sequences);
    ledger->committed = tl_arena_take(arena, sequence, sizeof *ledger->committed);
    ledger->current = tl_arena_take(arena, sequence, sizeof *ledger->current);
    return ledger->entries != NULL && ledger->sequences != NULL && ledger->committed != NULL && ledger->current != NULL;
}

void tl_ledger_drop_candidates(tl_ledger *ledger) {
    ledger->saving.sequences = false;
    ledger->capacity = 0;
}

static size_t slot_of(const tl_ledger *ledger, size_t index) {
    return (ledger->oldest + index) % ledger->capacity;
}

/* u at an absolute step: of the committed steps; and of the current candidate, from i on. */
static const double *committed_value(const tl_ledger *ledger, int64_t step, size_t variable) {
    const tl_horizon *horizon = ledger->horizon;
    return &ledger->committed[(size_t)(step % horizon->prediction) * horizon->variables + variable];
}

static const double *candidate_value(const tl_ledger *ledger, int64_t step, size_t variable) {
    return &ledger->current[(size_t)(step - ledger->step) * ledger->horizon->variables + variable];
}

/* Comparable steps of an entry and of the candidate: up to `length` of the candidate. */
static int64_t last_compared(const tl_ledger *ledger, const tl_ledger_entry *entry, uint32_t length) {
    int64_t end = entry->first + ledger->horizon->prediction;
    int64_t present = ledger->step + length;
    return end < present ? end : present;
}

/* u of an entry at an absolute step. */
static const double *entry_value(const tl_ledger *ledger, size_t slot, int64_t step, size_t variable) {
    const tl_horizon *horizon = ledger->horizon;
    const double *sequence = &ledger->sequences[slot * horizon->prediction * horizon->variables];
    return &sequence[(size_t)(step - ledger->entries[slot].first) * horizon->variables + variable];
}

/* Compares an entry with the steps committed since its last comparison: the result for these steps
 * is final. */
static void compare_with_committed(const tl_ledger *ledger, size_t slot) {
    tl_ledger_entry *entry = &ledger->entries[slot];
    int64_t end = entry->first + ledger->horizon->prediction;
    for (; entry->compared < end && entry->compared < ledger->step; entry->compared++) {
        for (size_t v = 0; v < ledger->horizon->variables; v++) {
            const double *was = entry_value(ledger, slot, entry->compared, v);
            if (entry->parted[v] == FOREVER &&
                memcmp(was, committed_value(ledger, entry->compared, v), sizeof *was) != 0) {
                entry->parted[v] = entry->compared;
            }
        }
    }
}

/* The first absolute step at which a variable's u of an entry differs: from the committed steps
 * before i, from the candidate from i on. */
static int64_t variable_differs(const tl_ledger *ledger, size_t slot, size_t variable, uint32_t length) {
    const tl_ledger_entry *entry = &ledger->entries[slot];
    int64_t end = last_compared(ledger, entry, length);
    if (entry->parted[variable] != FOREVER) {
        return entry->parted[variable];
    }
    for (int64_t step = ledger->step; step < end; step++) {
        const double *was = entry_value(ledger, slot, step, variable);
        if (memcmp(was, candidate_value(ledger, step, variable), sizeof *was) != 0) {
            return step;
        }
    }
    return FOREVER;
}

static int64_t lesser(int64_t a, int64_t b) {
    return a < b ? a : b;
}

/* The sample delivered at t_(step + after). For a committed step: the sample that its commit used.
 * In mode ahead the newest sample was then that of the step's own tick. */
static int64_t present_sample(const tl_ledger *ledger, int64_t step, int64_t after) {
    int64_t newest = step < ledger->step && ledger->ahead ? step : ledger->plant->newest;
    return tl_plant_shown(ledger->plant, step + after, newest);
}

/* The first absolute step at which a plant signal has another value than when the entry was
 * simulated. At that time the newest sample replaced one that had not arrived. */
static int64_t signal_differs(const tl_ledger *ledger, const tl_ledger_entry *entry, size_t signal, uint32_t length) {
    int64_t end = last_compared(ledger, entry, length);
    int64_t first = entry->newest - ledger->plant->shift;
    first = first > entry->first ? first : entry->first;
    for (int64_t step = lesser(first, end); step < end; step++) {
        int64_t present = present_sample(ledger, step, 0);
        int64_t then = tl_plant_shown(ledger->plant, step, entry->newest);
        double was = tl_plant_sample(ledger->plant, then)->values[signal];
        double is = tl_plant_sample(ledger->plant, present)->values[signal];
        if (memcmp(&was, &is, sizeof is) != 0) {
            return step;
        }
    }
    return FOREVER;
}

/* The first absolute step at which the plant delivers the sample of another tick than for the
 * entry. Samples that had arrived then are delivered again, except in mode ahead, where fewer
 * samples were known at the commit. */
static int64_t plant_differs(const tl_ledger *ledger, const tl_ledger_entry *entry, uint32_t length) {
    int64_t end = last_compared(ledger, entry, length);
    int64_t stood_for = entry->newest - ledger->plant->shift;
    int64_t first = !ledger->ahead && stood_for > entry->first ? stood_for : entry->first;
    for (int64_t step = first; step < end; step++) {
        if (tl_plant_shown(ledger->plant, step + 1, entry->newest) != present_sample(ledger, step, 1)) {
            return step;
        }
    }
    return FOREVER;
}

/* A difference of a source reaches node k `way` steps later. */
static void limit_agreement(int64_t *until, int64_t differs, const uint32_t *distances, size_t nodes) {
    for (size_t k = 0; k + 1 < nodes && differs != FOREVER; k++) {
        if (distances[k] != TL_NEVER) {
            until[k] = lesser(until[k], differs + distances[k]);
        }
    }
}

/* The steps at which the variables differ. */
static void find_differences(const tl_ledger *ledger, size_t slot, uint32_t length) {
    compare_with_committed(ledger, slot);
    for (size_t v = 0; v < ledger->horizon->variables; v++) {
        ledger->entries[slot].differs[v] = variable_differs(ledger, slot, v, length);
    }
}

/* Last absolute step up to which each node agrees with an earlier candidate with known differences.
 */
static void find_until(tl_ledger *ledger, size_t slot, uint32_t length) {
    const tl_horizon *horizon = ledger->horizon;
    const tl_ledger_entry *entry = &ledger->entries[slot];
    int64_t *until = ledger->until;
    for (size_t k = 0; k < horizon->nodes; k++) {
        until[k] = entry->first + (int64_t)entry->depth + (k < entry->partial ? 1 : 0);
        if (ledger->saving.structure) {
            until[k] = lesser(until[k], entry->first + (int64_t)horizon->reach[k]);
        }
    }
    for (size_t v = 0; v < horizon->variables; v++) {
        limit_agreement(until, entry->differs[v], &horizon->from_adjust[v * horizon->nodes], horizon->nodes);
    }
    for (size_t s = 0; s < ledger->signal_count; s++) {
        limit_agreement(until, signal_differs(ledger, entry, s, length), &horizon->from_signal[s * horizon->nodes],
                        horizon->nodes);
    }
    size_t plant = horizon->nodes - 1;
    until[plant] = lesser(until[plant], plant_differs(ledger, entry, length));
}

/* Whether two candidates leave the same results. */
static bool are_alike(const tl_ledger *ledger, const tl_ledger_entry *a, const tl_ledger_entry *b) {
    return a->first == b->first && a->newest == b->newest && a->depth == b->depth && a->partial == b->partial &&
           memcmp(a->differs, b->differs, ledger->horizon->variables * sizeof *a->differs) == 0;
}

/* Executions that the current candidate does not need, up to `length`. */
static void compare_all(tl_ledger *ledger, uint32_t length) {
    const tl_ledger_entry *before = NULL;
    for (size_t k = 0; k < ledger->horizon->nodes; k++) {
        int64_t left = ledger->settled[k] - ledger->step;
        ledger->known[k] = left > 0 && !ledger->executes[k] ? (uint32_t)left : 0;
    }
    for (size_t i = 0; i < ledger->count; i++) {
        size_t slot = slot_of(ledger, i);
        find_differences(ledger, slot, length);
        if (before != NULL && are_alike(ledger, before, &ledger->entries[slot])) {
            continue;
        }
        before = &ledger->entries[slot];
        find_until(ledger, slot, length);
        for (size_t k = 0; k < ledger->horizon->nodes; k++) {
            if (!ledger->executes[k] && ledger->until[k] - ledger->step > (int64_t)ledger->known[k]) {
                ledger->known[k] = (uint32_t)(ledger->until[k] - ledger->step);
            }
        }
    }
}

void tl_ledger_expect(tl_ledger *ledger, const double *u) {
    const tl_horizon *horizon = ledger->horizon;
    if (!ledger->saving.sequences) {
        return;
    }
    double *value = ledger->current;
    for (uint32_t depth = 0; depth < horizon->prediction; depth++) {
        for (size_t v = 0; v < horizon->variables; v++) {
            *value++ = tl_horizon_value(horizon, u, v, depth);
        }
    }
    compare_all(ledger, horizon->prediction);
}

static uint32_t reach_of(const tl_ledger *ledger, size_t node) {
    return ledger->saving.structure ? ledger->horizon->reach[node] : ledger->horizon->prediction;
}

tl_time tl_ledger_cost(const tl_ledger *ledger, const tl_cost *cost, uint32_t depth) {
    tl_time sum = 0;
    for (size_t k = 0; k + 1 < ledger->horizon->nodes; k++) {
        uint32_t from = ledger->known[k] > depth ? ledger->known[k] : depth;
        uint32_t reach = reach_of(ledger, k);
        sum += reach > from ? tl_cost_of(&cost[k], reach - from) : 0;
    }
    return sum;
}

static void save(tl_ledger *ledger, size_t node, uint64_t executions) {
    ledger->saved[node] += executions;
    ledger->saved_in_all += executions;
}

/* Executions of a node that the candidate needs in its first `depth` steps. */
static uint32_t needed_steps(const tl_ledger *ledger, size_t node, uint32_t depth) {
    uint32_t reach = reach_of(ledger, node);
    uint32_t until = reach < depth ? reach : depth;
    return until > ledger->known[node] ? until - ledger->known[node] : 0;
}

static void add_entry(tl_ledger *ledger, uint32_t depth, size_t partial) {
    const tl_horizon *horizon = ledger->horizon;
    if (ledger->count == ledger->capacity) {
        ledger->incomplete = true;
        ledger->oldest = (ledger->oldest + 1) % ledger->capacity;
        ledger->count--;
    }
    size_t slot = slot_of(ledger, ledger->count++);
    size_t sequence = (size_t)horizon->prediction * horizon->variables;
    tl_ledger_entry *entry = &ledger->entries[slot];
    *entry = (tl_ledger_entry){.first = ledger->step,
                               .newest = ledger->plant->newest,
                               .depth = depth,
                               .partial = partial,
                               .compared = ledger->step};
    for (size_t v = 0; v < horizon->variables; v++) {
        entry->parted[v] = FOREVER;
    }
    memcpy(&ledger->sequences[slot * sequence], ledger->current, sequence * sizeof *ledger->current);
}

void tl_ledger_walked(tl_ledger *ledger, uint32_t depth, size_t failed) {
    const tl_plan_saving *saving = &ledger->saving;
    bool whole = failed == SIZE_MAX;
    uint32_t begun = whole ? depth : depth + 1;
    ledger->plain += begun;
    if (whole && !saving->structure && !saving->sequences) {
        return;
    }
    for (size_t k = 0; k < ledger->horizon->nodes; k++) {
        save(ledger, k, begun - needed_steps(ledger, k, whole || k <= failed ? begun : depth));
    }
    if (saving->sequences) {
        add_entry(ledger, depth, whole ? 0 : failed);
    }
}

/* True if the committed steps differ from a candidate in every variable, and all its samples had
 * arrived. Then later candidates do not change which of its results can be reused. */
static bool is_settled(const tl_ledger *ledger, const tl_ledger_entry *entry) {
    bool settled = entry->newest >= entry->first + (int64_t)ledger->horizon->prediction + ledger->plant->shift;
    for (size_t v = 0; v < ledger->horizon->variables && settled; v++) {
        settled = entry->differs[v] < ledger->step;
    }
    return settled;
}

static void settle(tl_ledger *ledger, size_t slot) {
    find_until(ledger, slot, 0);
    for (size_t k = 0; k < ledger->horizon->nodes; k++) {
        if (ledger->until[k] > ledger->settled[k]) {
            ledger->settled[k] = ledger->until[k];
        }
    }
}

/* Whether an entry has ended, or has nothing more to contribute. */
static bool is_done(tl_ledger *ledger, size_t slot) {
    const tl_ledger_entry *entry = &ledger->entries[slot];
    if (entry->first + (int64_t)ledger->horizon->prediction <= ledger->step) {
        return true;
    }
    find_differences(ledger, slot, 0);
    bool settled = is_settled(ledger, entry);
    if (settled) {
        settle(ledger, slot);
    }
    return settled;
}

static void move_entry(tl_ledger *ledger, size_t to, size_t from) {
    size_t sequence = (size_t)ledger->horizon->prediction * ledger->horizon->variables;
    ledger->entries[to] = ledger->entries[from];
    memcpy(&ledger->sequences[to * sequence], &ledger->sequences[from * sequence],
           sequence * sizeof *ledger->sequences);
}

/* After a commit. Mostly the oldest entries are removed, so that the others need not move. */
static void drop_settled(tl_ledger *ledger) {
    while (ledger->count != 0 && is_done(ledger, ledger->oldest)) {
        ledger->oldest = (ledger->oldest + 1) % ledger->capacity;
        ledger->count--;
    }
    size_t kept = ledger->count != 0 ? 1 : 0;
    for (size_t i = 1; i < ledger->count; i++) {
        size_t from = slot_of(ledger, i);
        if (!is_done(ledger, from)) {
            size_t to = slot_of(ledger, kept++);
            if (to != from) {
                move_entry(ledger, to, from);
            }
        }
    }
    ledger->count = kept;
}

void tl_ledger_commit(tl_ledger *ledger, const double *values) {
    const tl_horizon *horizon = ledger->horizon;
    ledger->plain++;
    if (ledger->capacity == 0) {
        return; /* no candidate is remembered: every component executes */
    }
    size_t size = horizon->variables * sizeof *values;
    memcpy(ledger->current, values, size);
    compare_all(ledger, 1);
    memcpy(&ledger->committed[(size_t)(ledger->step % horizon->prediction) * horizon->variables], values, size);
    for (size_t k = 0; k < horizon->nodes; k++) {
        if (ledger->known[k] != 0) {
            save(ledger, k, 1);
        }
    }
    ledger->step++;
    drop_settled(ledger);
}

void tl_ledger_reset(tl_ledger *ledger) {
    ledger->count = 0;
    memset(ledger->settled, 0, ledger->horizon->nodes * sizeof *ledger->settled);
}

void tl_ledger_forget(tl_ledger *ledger) {
    tl_ledger_reset(ledger);
    memset(ledger->saved, 0, ledger->horizon->nodes * sizeof *ledger->saved);
    ledger->saved_in_all = 0;
    ledger->plain = 0;
    ledger->incomplete = false;
}

uint64_t tl_ledger_predicted(const tl_ledger *ledger, size_t node) {
    return ledger->plain - ledger->saved[node];
}

uint64_t tl_ledger_total(const tl_ledger *ledger) {
    return ledger->plain * ledger->horizon->nodes - ledger->saved_in_all;
}
