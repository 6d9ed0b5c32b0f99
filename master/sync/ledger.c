/* Execution ledger: see ledger.h. Steps are absolute here: a candidate that started earlier is
 * compared with the values committed since. */
#include "master/sync/ledger.h"

#include <string.h>

/* Limits the remembered candidates: a longest sequence of each takes 8 MB together. */
static const size_t MOST_VALUES = (size_t)1 << 20;

/* There is no difference; and no step. */
static const int64_t FOREVER = INT64_MAX / 2;
static const int64_t NO_STEP = -1;

/* One more than are remembered: the newest one waits to be compared with them. */
static size_t most_entries(const tl_horizon *horizon, uint32_t evaluations) {
    size_t wanted = (size_t)evaluations * horizon->prediction;
    size_t room = MOST_VALUES / ((size_t)horizon->prediction * horizon->variables);
    return (wanted < room ? wanted : room) + 1;
}

bool tl_ledger_init(tl_ledger *ledger, tl_arena *arena, const tl_horizon *horizon, const tl_plant *plant,
                    const tl_plan *plan, uint32_t evaluations) {
    *ledger = (tl_ledger){.horizon = horizon, .plant = plant, .saving = plan->saving};
    ledger->signal_count = plan->signal_count;
    ledger->ahead = plan->measurements == TL_AHEAD;
    ledger->known.step = NO_STEP;
    ledger->samples.step = NO_STEP;
    int64_t **const ends[] = {&ledger->known.any, &ledger->known.candidate, &ledger->until, &ledger->settled};
    for (size_t i = 0; i < sizeof ends / sizeof ends[0]; i++) {
        *ends[i] = tl_arena_take(arena, horizon->nodes, sizeof **ends[i]);
        if (*ends[i] == NULL) {
            return false;
        }
    }
    ledger->saved = tl_arena_take(arena, horizon->nodes, sizeof *ledger->saved);
    ledger->executes = tl_arena_take(arena, horizon->nodes, sizeof *ledger->executes);
    if (ledger->saved == NULL || ledger->executes == NULL) {
        return false;
    }
    for (size_t k = 0; k < plan->component_count; k++) {
        ledger->executes[k] = plan->components[k].keep == TL_KEEP_NONE;
    }
    if (horizon->variables == 0 || !plan->saving.sequences) {
        return true;
    }
    ledger->capacity = most_entries(horizon, evaluations);
    ledger->entries = tl_arena_take(arena, ledger->capacity, sizeof *ledger->entries);
    ledger->unknowns = tl_arena_take(arena, ledger->capacity * horizon->count, sizeof *ledger->unknowns);
    ledger->samples.differs = tl_arena_take(arena, plan->signal_count + 1, sizeof *ledger->samples.differs);
    return ledger->entries != NULL && ledger->unknowns != NULL && ledger->samples.differs != NULL;
}

static int64_t lesser(int64_t a, int64_t b) {
    return a < b ? a : b;
}

void tl_ledger_drop_candidates(tl_ledger *ledger) {
    ledger->saving.sequences = false;
    ledger->capacity = 0;
}

static size_t slot_of(const tl_ledger *ledger, size_t index) {
    size_t slot = ledger->oldest + index;
    return slot < ledger->capacity ? slot : slot - ledger->capacity;
}

/* End of the horizon of an entry. */
static int64_t end_of(const tl_ledger *ledger, const tl_ledger_entry *entry) {
    return entry->first + (int64_t)ledger->horizon->prediction;
}

/* ---- differences of u ---- */

/* u of an entry from an absolute step on: its remaining unknowns of one variable. The last one
 * applies to the rest of the horizon. */
static const double *remaining_unknowns(const tl_ledger *ledger, size_t slot, int64_t step, size_t variable) {
    const tl_horizon *horizon = ledger->horizon;
    int64_t index = lesser(step - ledger->entries[slot].first, (int64_t)horizon->length[variable] - 1);
    return &ledger->unknowns[slot * horizon->count + horizon->offset[variable] + (size_t)index];
}

static bool is_same(const double *a, const double *b) {
    uint64_t bits[2];
    memcpy(&bits[0], a, sizeof *a);
    memcpy(&bits[1], b, sizeof *b);
    return bits[0] == bits[1];
}

/* The first absolute step at which a variable's u of an entry differs: from the committed steps
 * before i, from the candidate from i on. */
static int64_t variable_differs(const tl_ledger *ledger, size_t slot, size_t candidate, size_t variable) {
    const tl_ledger_entry *entry = &ledger->entries[slot];
    int64_t constant = ledger->step + (int64_t)ledger->horizon->length[variable];
    int64_t end = lesser(end_of(ledger, entry), constant);
    if (entry->parted[variable] != FOREVER) {
        return entry->parted[variable];
    }
    for (int64_t step = ledger->step; step < end; step++) {
        if (!is_same(remaining_unknowns(ledger, slot, step, variable),
                     remaining_unknowns(ledger, candidate, step, variable))) {
            return step;
        }
    }
    return FOREVER;
}

/* ---- differences of samples ---- */

/* True if all samples of an entry's horizon had arrived when it was simulated. */
static bool has_all_samples(const tl_ledger *ledger, const tl_ledger_entry *entry) {
    return entry->newest >= end_of(ledger, entry) + ledger->plant->shift;
}

/* The sample delivered at t_(step + after). For a committed step: the sample that its commit used.
 * In mode ahead the newest sample was then that of the step's own tick. */
static int64_t present_sample(const tl_ledger *ledger, int64_t step, int64_t after) {
    int64_t newest = step < ledger->step && ledger->ahead ? step : ledger->plant->newest;
    return tl_plant_shown(ledger->plant, step + after, newest);
}

/* The first absolute step at which a plant signal has another value than when the entry was
 * simulated. At that time the newest sample replaced one that had not arrived. */
static int64_t signal_differs(const tl_ledger *ledger, const tl_ledger_entry *entry, size_t signal) {
    int64_t end = end_of(ledger, entry);
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
static int64_t plant_differs(const tl_ledger *ledger, const tl_ledger_entry *entry) {
    int64_t end = end_of(ledger, entry);
    int64_t stood_for = entry->newest - ledger->plant->shift;
    int64_t first = !ledger->ahead && stood_for > entry->first ? stood_for : entry->first;
    for (int64_t step = first; step < end; step++) {
        if (tl_plant_shown(ledger->plant, step + 1, entry->newest) != present_sample(ledger, step, 1)) {
            return step;
        }
    }
    return FOREVER;
}

/* The differences of all signals, and last of the plant's ticks. All candidates of a step have the
 * same. */
static const int64_t *find_sample_differences(tl_ledger *ledger, const tl_ledger_entry *entry) {
    tl_ledger_samples *samples = &ledger->samples;
    if (samples->step == ledger->step && samples->present == ledger->plant->newest && samples->first == entry->first &&
        samples->newest == entry->newest) {
        return samples->differs;
    }
    for (size_t s = 0; s < ledger->signal_count; s++) {
        samples->differs[s] = signal_differs(ledger, entry, s);
    }
    samples->differs[ledger->signal_count] = plant_differs(ledger, entry);
    samples->step = ledger->step;
    samples->present = ledger->plant->newest;
    samples->first = entry->first;
    samples->newest = entry->newest;
    return samples->differs;
}

/* ---- known steps ---- */

/* A difference of a source reaches node k `way` steps later. */
static void limit_agreement(int64_t *until, int64_t differs, const uint32_t *distances, size_t nodes) {
    for (size_t k = 0; k + 1 < nodes && differs != FOREVER; k++) {
        if (distances[k] != TL_NEVER) {
            until[k] = lesser(until[k], differs + distances[k]);
        }
    }
}

/* Last absolute step up to which each node agrees with an entry. `differs`: the step at which each
 * variable differs. Raises `known` to it. */
static void learn_entry(tl_ledger *ledger, const tl_ledger_entry *entry, const int64_t *differs, int64_t *known) {
    const tl_horizon *horizon = ledger->horizon;
    const int64_t *samples = find_sample_differences(ledger, entry);
    int64_t *until = ledger->until;
    bool failed = entry->failed != SIZE_MAX;
    for (size_t k = 0; k < horizon->nodes; k++) {
        until[k] = entry->first + (int64_t)entry->depth + (failed && k < entry->failed ? 1 : 0);
        if (ledger->saving.structure) {
            until[k] = lesser(until[k], entry->first + (int64_t)horizon->reach[k]);
        }
    }
    for (size_t v = 0; v < horizon->variables; v++) {
        limit_agreement(until, differs[v], &horizon->from_adjust[v * horizon->nodes], horizon->nodes);
    }
    for (size_t s = 0; s < ledger->signal_count; s++) {
        limit_agreement(until, samples[s], &horizon->from_signal[s * horizon->nodes], horizon->nodes);
    }
    size_t plant = horizon->nodes - 1;
    until[plant] = lesser(until[plant], samples[ledger->signal_count]);
    for (size_t k = 0; k < horizon->nodes; k++) {
        known[k] = !ledger->executes[k] && until[k] > known[k] ? until[k] : known[k];
    }
}

/* Steps that are known from an entry whatever the candidate is. */
static void learn_for_any(tl_ledger *ledger, const tl_ledger_entry *entry) {
    int64_t differs[TL_MAX_ADJUST];
    for (size_t v = 0; v < ledger->horizon->variables; v++) {
        differs[v] = lesser(entry->parted[v], ledger->step);
    }
    learn_entry(ledger, entry, differs, ledger->known.any);
}

/* From all evaluated entries, for the present step and samples. */
static void update_known(tl_ledger *ledger) {
    tl_ledger_known *known = &ledger->known;
    if (known->step == ledger->step && known->present == ledger->plant->newest) {
        return;
    }
    memcpy(known->any, ledger->settled, ledger->horizon->nodes * sizeof *known->any);
    for (size_t i = 0; i < ledger->evaluated; i++) {
        learn_for_any(ledger, &ledger->entries[slot_of(ledger, i)]);
    }
    known->step = ledger->step;
    known->present = ledger->plant->newest;
}

/* The longest agreement with the candidate so far: the step at which a variable differs, and the
 * candidate's u there. */
typedef struct longest {
    int64_t step;
    const double *u;
} longest;

/* True if some variable may agree with the candidate for longer. */
static bool may_improve(const tl_ledger *ledger, size_t slot, const longest *best) {
    const tl_ledger_entry *entry = &ledger->entries[slot];
    for (size_t v = 0; v < ledger->horizon->variables; v++) {
        if (entry->parted[v] == FOREVER && best[v].step < end_of(ledger, entry) &&
            is_same(remaining_unknowns(ledger, slot, best[v].step, v), best[v].u)) {
            return true;
        }
    }
    return false;
}

/* True if an older entry cannot agree in more steps, unless some variable agrees for longer. */
static bool is_whole(const tl_ledger *ledger, const tl_ledger_entry *entry) {
    bool has_present = entry->first == ledger->step && entry->newest == ledger->plant->newest;
    return entry->depth == ledger->horizon->prediction && entry->failed == SIZE_MAX &&
           (has_present || has_all_samples(ledger, entry));
}

static void raise_best(const tl_ledger *ledger, size_t candidate, const int64_t *differs, longest *best) {
    bool longer = true;
    for (size_t v = 0; v < ledger->horizon->variables; v++) {
        longer = longer && differs[v] >= best[v].step;
    }
    for (size_t v = 0; v < ledger->horizon->variables && longer; v++) {
        best[v] = (longest){differs[v], remaining_unknowns(ledger, candidate, differs[v], v)};
    }
}

/* Compares the candidate with the entries before it. The newest ones come first, because they agree
 * for longest. */
static void compare_candidate(tl_ledger *ledger, size_t index) {
    size_t candidate = slot_of(ledger, index);
    int64_t differs[TL_MAX_ADJUST];
    longest best[TL_MAX_ADJUST];
    update_known(ledger);
    memcpy(ledger->known.candidate, ledger->known.any, ledger->horizon->nodes * sizeof *ledger->known.any);
    for (size_t v = 0; v < ledger->horizon->variables; v++) {
        differs[v] = ledger->step;
        best[v].step = 0;
    }
    raise_best(ledger, candidate, differs, best);
    for (size_t i = index; i-- > 0;) {
        size_t slot = slot_of(ledger, i);
        if (!may_improve(ledger, slot, best)) {
            continue;
        }
        for (size_t v = 0; v < ledger->horizon->variables; v++) {
            differs[v] = variable_differs(ledger, slot, candidate, v);
        }
        learn_entry(ledger, &ledger->entries[slot], differs, ledger->known.candidate);
        if (is_whole(ledger, &ledger->entries[slot])) {
            raise_best(ledger, candidate, differs, best);
        }
    }
}

/* ---- counts ---- */

static uint32_t reach_of(const tl_ledger *ledger, size_t node) {
    return ledger->saving.structure ? ledger->horizon->reach[node] : ledger->horizon->prediction;
}

static void save(tl_ledger *ledger, size_t node, uint64_t executions) {
    ledger->saved[node] += executions;
    ledger->saved_in_all += executions;
}

/* Executions of a node that a candidate needs in its first `depth` steps. */
static uint64_t needed_steps(const tl_ledger *ledger, size_t node, uint32_t depth) {
    uint32_t reach = reach_of(ledger, node);
    uint32_t until = reach < depth ? reach : depth;
    int64_t left = ledger->step + (int64_t)until - ledger->known.candidate[node];
    return left > (int64_t)until ? until : left > 0 ? (uint64_t)left : 0;
}

static void count_candidate(tl_ledger *ledger, uint32_t depth, size_t failed) {
    bool whole = failed == SIZE_MAX;
    uint32_t begun = whole ? depth : depth + 1;
    ledger->plain += begun;
    if (whole && !ledger->saving.structure && ledger->capacity == 0) {
        return;
    }
    for (size_t k = 0; k < ledger->horizon->nodes; k++) {
        save(ledger, k, begun - needed_steps(ledger, k, whole || k <= failed ? begun : depth));
    }
}

/* Whether two candidates of a step had the same samples and executed the same steps. */
static bool has_same_steps(const tl_ledger_entry *a, const tl_ledger_entry *b) {
    return a->first == b->first && a->newest == b->newest && a->depth == b->depth && a->failed == b->failed;
}

static void evaluate_candidates(tl_ledger *ledger) {
    while (ledger->evaluated < ledger->count) {
        size_t index = ledger->evaluated;
        const tl_ledger_entry *entry = &ledger->entries[slot_of(ledger, index)];
        compare_candidate(ledger, index);
        count_candidate(ledger, entry->depth, entry->failed);
        if (index == 0 || !has_same_steps(entry, &ledger->entries[slot_of(ledger, index - 1)])) {
            learn_for_any(ledger, entry);
        }
        ledger->evaluated++;
    }
}

static void drop_oldest(tl_ledger *ledger) {
    ledger->oldest = slot_of(ledger, 1);
    ledger->count--;
    ledger->evaluated--;
}

void tl_ledger_walked(tl_ledger *ledger, const double *u, uint32_t depth, size_t failed) {
    size_t unknowns = ledger->horizon->count;
    if (ledger->capacity == 0) {
        count_candidate(ledger, depth, failed);
        return;
    }
    if (ledger->count == ledger->capacity) {
        evaluate_candidates(ledger);
        ledger->incomplete = true;
        drop_oldest(ledger);
    }
    size_t slot = slot_of(ledger, ledger->count++);
    tl_ledger_entry *entry = &ledger->entries[slot];
    *entry =
        (tl_ledger_entry){.first = ledger->step, .newest = ledger->plant->newest, .depth = depth, .failed = failed};
    for (size_t v = 0; v < ledger->horizon->variables; v++) {
        entry->parted[v] = FOREVER;
    }
    memcpy(&ledger->unknowns[slot * unknowns], u, unknowns * sizeof *u);
}

/* ---- entries after a commit ---- */

/* Notes the variables whose u differs from the step committed now. */
static void compare_with_committed(tl_ledger *ledger, size_t slot) {
    tl_ledger_entry *entry = &ledger->entries[slot];
    for (size_t v = 0; v < ledger->horizon->variables; v++) {
        const double *was = remaining_unknowns(ledger, slot, ledger->step, v);
        if (entry->parted[v] == FOREVER && !is_same(was, &ledger->committed[v])) {
            entry->parted[v] = ledger->step;
        }
    }
}

/* True if the committed steps differ from a candidate in every variable, and all its samples had
 * arrived. Then later candidates do not change which of its results can be reused. */
static bool is_settled(const tl_ledger *ledger, const tl_ledger_entry *entry) {
    bool settled = has_all_samples(ledger, entry);
    for (size_t v = 0; v < ledger->horizon->variables && settled; v++) {
        settled = entry->parted[v] != FOREVER;
    }
    return settled;
}

/* Whether every later candidate shares the same steps with two entries. */
static bool are_alike(const tl_ledger *ledger, size_t slot, size_t other) {
    const tl_horizon *horizon = ledger->horizon;
    const tl_ledger_entry *a = &ledger->entries[slot];
    const tl_ledger_entry *b = &ledger->entries[other];
    bool alike = has_same_steps(a, b) && memcmp(a->parted, b->parted, horizon->variables * sizeof *a->parted) == 0;
    for (size_t v = 0; v < horizon->variables && alike; v++) {
        const double *rest = remaining_unknowns(ledger, slot, ledger->step, v);
        size_t used = (size_t)(rest - &ledger->unknowns[slot * horizon->count + horizon->offset[v]]);
        alike = a->parted[v] != FOREVER || memcmp(rest, remaining_unknowns(ledger, other, ledger->step, v),
                                                  (horizon->length[v] - used) * sizeof *rest) == 0;
    }
    return alike;
}

static void keep_entry(tl_ledger *ledger, size_t to, size_t from) {
    size_t unknowns = ledger->horizon->count;
    size_t slots[2] = {slot_of(ledger, to), slot_of(ledger, from)};
    if (to != from) {
        ledger->entries[slots[0]] = ledger->entries[slots[1]];
        memcpy(&ledger->unknowns[slots[0] * unknowns], &ledger->unknowns[slots[1] * unknowns],
               unknowns * sizeof *ledger->unknowns);
    }
}

/* Drops entries that are like the one before: mostly the newest ones, so that few others move. */
static void drop_alike(tl_ledger *ledger) {
    size_t kept = ledger->count != 0 ? 1 : 0;
    for (size_t i = 1; i < ledger->count; i++) {
        if (!are_alike(ledger, slot_of(ledger, kept - 1), slot_of(ledger, i))) {
            keep_entry(ledger, kept++, i);
        }
    }
    ledger->count = kept;
    ledger->evaluated = kept;
}

/* Whether an entry has ended, or has nothing more to contribute. */
static bool is_done(tl_ledger *ledger, const tl_ledger_entry *entry) {
    if (end_of(ledger, entry) <= ledger->step) {
        return true;
    }
    bool settled = is_settled(ledger, entry);
    if (settled) {
        learn_entry(ledger, entry, entry->parted, ledger->settled);
    }
    return settled;
}

/* Mostly the oldest entries are done, so that the others need not move. */
static void drop_done(tl_ledger *ledger) {
    while (ledger->count != 0 && is_done(ledger, &ledger->entries[ledger->oldest])) {
        drop_oldest(ledger);
    }
    size_t kept = 0;
    for (size_t i = 0; i < ledger->count; i++) {
        if (i == 0 || !is_done(ledger, &ledger->entries[slot_of(ledger, i)])) {
            keep_entry(ledger, kept++, i);
        }
    }
    ledger->count = kept;
    ledger->evaluated = kept;
}

/* A node needs no execution in the committed step if it is known in every step that starts with
 * it. */
static void evaluate_commit(tl_ledger *ledger) {
    ledger->plain++;
    for (size_t i = 0; i < ledger->count; i++) {
        compare_with_committed(ledger, slot_of(ledger, i));
    }
    ledger->step++;
    drop_alike(ledger);
    update_known(ledger);
    for (size_t k = 0; k < ledger->horizon->nodes; k++) {
        if (ledger->known.any[k] >= ledger->step) {
            save(ledger, k, 1);
        }
    }
    drop_done(ledger);
}

void tl_ledger_commit(tl_ledger *ledger, const double *values) {
    if (ledger->capacity == 0) {
        ledger->plain++; /* no candidate is remembered: every component executes */
        return;
    }
    memcpy(ledger->committed, values, ledger->horizon->variables * sizeof *values);
    ledger->has_committed = true;
}

static void evaluate_recorded(tl_ledger *ledger) {
    evaluate_candidates(ledger);
    if (ledger->has_committed) {
        evaluate_commit(ledger);
        ledger->has_committed = false;
    }
}

uint64_t tl_ledger_evaluate(tl_ledger *ledger) {
    evaluate_recorded(ledger);
    uint64_t before = ledger->total;
    ledger->total = tl_ledger_total(ledger);
    return ledger->total - before;
}

void tl_ledger_reset(tl_ledger *ledger) {
    evaluate_recorded(ledger);
    ledger->count = 0;
    ledger->evaluated = 0;
    ledger->known.step = NO_STEP;
    ledger->samples.step = NO_STEP;
    memset(ledger->settled, 0, ledger->horizon->nodes * sizeof *ledger->settled);
}

void tl_ledger_forget(tl_ledger *ledger) {
    tl_ledger_reset(ledger);
    memset(ledger->saved, 0, ledger->horizon->nodes * sizeof *ledger->saved);
    ledger->saved_in_all = 0;
    ledger->plain = 0;
    ledger->total = 0;
    ledger->incomplete = false;
}

uint64_t tl_ledger_predicted(const tl_ledger *ledger, size_t node) {
    return ledger->plain - ledger->saved[node];
}

uint64_t tl_ledger_total(const tl_ledger *ledger) {
    return ledger->plain * ledger->horizon->nodes - ledger->saved_in_all;
}
