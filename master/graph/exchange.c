/* Co-simulation: see exchange.h. */
#include "master/graph/exchange.h"

#include <math.h>
#include <string.h>

/* Depth of the committed step: all components take part, whatever their reach. */
#define TL_ALL_DEPTHS UINT32_MAX

static double keep_finite(const tl_real_copy *copy, double value) {
    return isfinite(value) ? value : *copy->to;
}

static double convert(const tl_real_copy *copy) {
    return keep_finite(copy, copy->conversion.factor * *copy->from + copy->conversion.offset);
}

double tl_exchange_convert(const tl_real_copy *copy) {
    return tl_conversion_is_identity(&copy->conversion) ? keep_finite(copy, *copy->from) : convert(copy);
}

double tl_exchange_adjusted(const tl_exchange *exchange, size_t variable) {
    const tl_adjusted_input *input = &exchange->adjusted[variable];
    return input->real != NULL ? *input->real : (double)*input->boolean;
}

double tl_exchange_nominal(const tl_exchange *exchange, size_t variable) {
    const tl_adjusted_input *input = &exchange->adjusted[variable];
    return input->delivered_real != NULL      ? *input->delivered_real
           : input->delivered_boolean != NULL ? (double)*input->delivered_boolean
                                              : input->nominal;
}

void tl_exchange_set_nominal(tl_exchange *exchange, size_t variable, double nominal) {
    exchange->adjusted[variable].nominal = nominal;
}

/* If all outputs are finite: the values of the plant always are. */
static void copy_reals(const tl_exchange *exchange) {
    for (size_t i = 0; i < exchange->copy_count; i++) {
        *exchange->copies[i].to = *exchange->copies[i].from;
    }
}

static void copy_finite_reals(const tl_exchange *exchange) {
    for (size_t i = 0; i < exchange->copy_count; i++) {
        *exchange->copies[i].to = keep_finite(&exchange->copies[i], *exchange->copies[i].from);
    }
}

static void deliver_others(const tl_exchange *exchange) {
    for (size_t i = 0; i < exchange->conversion_count; i++) {
        const tl_real_copy *copy = &exchange->conversions[i];
        *copy->to = convert(copy);
    }
    for (size_t i = 0; i < exchange->integer_copy_count; i++) {
        *exchange->integer_copies[i].to = *exchange->integer_copies[i].from;
    }
}

void tl_exchange_deliver(tl_exchange *exchange) {
    copy_finite_reals(exchange);
    deliver_others(exchange);
}

bool tl_exchange_save_executions(tl_exchange *exchange, tl_arena *arena, const tl_keep *keep, uint32_t *reach,
                                 const uint32_t *capacity, uint32_t prediction) {
    exchange->reach = reach;
    exchange->whole = reach == NULL && capacity == NULL;
    if (capacity == NULL) {
        return true;
    }
    exchange->cached = tl_arena_take(arena, exchange->component_count, sizeof *exchange->cached);
    exchange->rooms = tl_arena_take(arena, exchange->component_count, sizeof *exchange->rooms);
    bool placed = exchange->cached != NULL && exchange->rooms != NULL &&
                  tl_plant_save_executions(&exchange->plant, arena, prediction);
    for (size_t i = 0; placed && i < exchange->component_count; i++) {
        placed = tl_cached_component_init(&exchange->cached[i], arena, &exchange->components[i], keep[i],
                                          exchange->step, prediction, capacity[i]);
    }
    return placed;
}

void tl_exchange_drop_caches(tl_exchange *exchange, uint32_t prediction) {
    exchange->cached = NULL;
    exchange->rooms = NULL;
    exchange->plant.delivered = NULL;
    exchange->whole = true;
    for (size_t i = 0; i < exchange->component_count && exchange->reach != NULL; i++) {
        exchange->whole = exchange->whole && exchange->reach[i] >= prediction;
    }
}

/* Drops the optional states if all extra states would need more than a quarter of the bound. */
static void settle_optional_states(tl_exchange *exchange, uint64_t bytes) {
    uint64_t sizes = 0;
    for (size_t i = 0; i < exchange->component_count && exchange->cached != NULL; i++) {
        sizes += exchange->rooms[i].size;
    }
    uint32_t states = exchange->extra_states + exchange->optional_states;
    exchange->optional_states = bytes == 0 || states * sizes <= bytes / 4 ? exchange->optional_states : 0;
    exchange->extra_states += exchange->optional_states;
}

/* Remaining bound for the caches; minimal, but not "no bound", if other modules use all of it. */
static uint64_t leave_beside(const tl_exchange *exchange, uint64_t bytes) {
    uint64_t extra_states = 0;
    for (size_t i = 0; i < exchange->component_count && exchange->cached != NULL; i++) {
        extra_states += (uint64_t)exchange->extra_states * exchange->rooms[i].size;
    }
    return bytes == 0 || extra_states == 0 ? bytes : extra_states < bytes ? bytes - extra_states : 1;
}

tl_status tl_exchange_start(tl_exchange *exchange, uint64_t bytes, size_t (*heap)(void), tl_error *error) {
    size_t count = exchange->cached != NULL ? exchange->component_count : 0;
    tl_status status = TL_OK;
    for (size_t i = 0; i < count && status == TL_OK; i++) {
        tl_cached_component *cached = &exchange->cached[i];
        exchange->rooms[i].most = cached->keep == TL_KEEP_NONE ? TL_NODES_OF_NONE : cached->tree.capacity;
        status = tl_cached_component_measure(cached, heap, &exchange->rooms[i].size, error);
    }
    settle_optional_states(exchange, bytes);
    tl_state_room_share(exchange->rooms, count, leave_beside(exchange, bytes));
    for (size_t i = 0; i < count && status == TL_OK; i++) {
        size_t states = (size_t)exchange->rooms[i].kept + exchange->extra_states;
        tl_cached_component_limit(&exchange->cached[i], exchange->rooms[i].kept);
        status = tl_component_reserve_states(&exchange->components[i], states, error);
        status = status == TL_OK ? tl_cached_component_start(&exchange->cached[i], error) : status;
    }
    return status;
}

tl_status tl_exchange_reset(tl_exchange *exchange, int64_t step, tl_error *error) {
    tl_status status = TL_OK;
    if (exchange->cached == NULL) {
        return TL_OK;
    }
    tl_plant_forget(&exchange->plant, step);
    for (size_t i = 0; i < exchange->component_count && status == TL_OK; i++) {
        status = tl_cached_component_reset(&exchange->cached[i], error);
    }
    return status;
}

void tl_exchange_end_component(tl_exchange *exchange, size_t component) {
    if (exchange->cached != NULL) {
        tl_cached_component_end(&exchange->cached[component]);
    }
    tl_snapshot_forget(&exchange->home, component);
}

bool tl_exchange_takes_part(const tl_exchange *exchange, size_t component, uint32_t depth) {
    return exchange->reach == NULL || depth == TL_ALL_DEPTHS || depth < exchange->reach[component];
}

bool tl_exchange_is_finite(const tl_exchange *exchange) {
    return exchange->was_finite || tl_reals_are_finite(exchange->outputs, exchange->output_count);
}

static void mark_outputs(const tl_exchange *exchange) {
    for (size_t i = 0; i < exchange->component_count; i++) {
        tl_component_mark_outputs(&exchange->components[i]);
    }
}

/* Without caches only the committed step is final, and not while a module keeps an older state. */
static bool is_final(const tl_exchange *exchange, uint32_t depth) {
    return depth == TL_ALL_DEPTHS && !exchange->is_kept_from;
}

/* Executes all components in one call and tests all outputs at once. */
static tl_status execute_all(tl_exchange *exchange, int64_t step, uint32_t depth, bool *is_finite, tl_error *error) {
    double now = tl_seconds(tl_time_of_step(0, exchange->step, step));
    exchange->failed = exchange->component_count - 1;
    tl_status status = tl_component_step_all(exchange->components, exchange->component_count, now, exchange->step_s,
                                             is_final(exchange, depth), &exchange->failed, error);
    exchange->executions += exchange->failed + 1;
    if (status == TL_OK) {
        tl_costs_ran_all(&exchange->costs);
    }
    *is_finite = tl_reals_are_finite(exchange->outputs, exchange->output_count);
    if (status == TL_OK && !*is_finite) {
        mark_outputs(exchange);
    }
    return status;
}

/* Executes one component through its cache, or directly. */
static tl_status advance(tl_exchange *exchange, size_t index, int64_t step, uint32_t depth, tl_error *error) {
    if (exchange->cached != NULL) {
        return tl_cached_component_step(&exchange->cached[index], step, error);
    }
    double now = tl_seconds(tl_time_of_step(0, exchange->step, step));
    return tl_component_step(&exchange->components[index], now, exchange->step_s, is_final(exchange, depth), error);
}

/* Measures a close step: cached results say nothing about the cost. */
tl_status tl_exchange_advance(tl_exchange *exchange, size_t component, int64_t step, uint32_t depth, tl_error *error) {
    uint64_t before = exchange->components[component].executions;
    tl_status status = advance(exchange, component, step, depth, error);
    uint64_t made = exchange->components[component].executions - before;
    exchange->executions += made;
    if (made != 0) {
        tl_costs_ran(&exchange->costs, component);
    }
    return status;
}

static tl_status walk_components(tl_exchange *exchange, int64_t step, uint32_t depth, tl_error *error) {
    for (size_t i = 0; i < exchange->component_count; i++) {
        if (tl_exchange_takes_part(exchange, i, depth)) {
            tl_status status = tl_exchange_advance(exchange, i, step, depth, error);
            if (status != TL_OK) {
                exchange->failed = i;
                return status;
            }
        }
    }
    return TL_OK;
}

/* Executes one macro step of the components that take part at `depth`. */
static tl_status step_components(tl_exchange *exchange, int64_t step, uint32_t depth, tl_error *error) {
    const tl_costs *costs = &exchange->costs;
    bool unsaved = depth == TL_ALL_DEPTHS && exchange->cached == NULL && costs->now == NULL;
    bool in_one_go = (exchange->whole && !costs->is_close) || unsaved;
    bool is_finite = false;
    tl_status status = in_one_go ? execute_all(exchange, step, depth, &is_finite, error)
                                 : walk_components(exchange, step, depth, error);
    exchange->was_finite = is_finite && depth == TL_ALL_DEPTHS;
    if (status != TL_OK) {
        return status;
    }
    if (tl_exchange_takes_part(exchange, exchange->component_count, depth)) {
        tl_plant_step(&exchange->plant, step);
    }
    if (is_finite) {
        copy_reals(exchange);
    } else {
        copy_finite_reals(exchange);
    }
    deliver_others(exchange);
    return TL_OK;
}

tl_time tl_exchange_cost(const tl_exchange *exchange, tl_time steps) {
    tl_time sum = 0;
    if (exchange->whole) {
        return tl_cost_of(&exchange->costs.all, steps);
    }
    for (size_t k = 0; k < exchange->component_count; k++) {
        sum += tl_cost_of(&exchange->costs.each[k], steps);
    }
    return sum;
}

tl_status tl_exchange_begin(tl_exchange *exchange, tl_error *error) {
    if (exchange->cached == NULL) {
        return tl_exchange_save(exchange, error);
    }
    memcpy(exchange->home.values, exchange->values, exchange->values_size);
    return TL_OK;
}

tl_status tl_exchange_rewind(tl_exchange *exchange, tl_error *error) {
    if (exchange->cached == NULL) {
        return tl_exchange_restore(exchange, error);
    }
    memcpy(exchange->values, exchange->home.values, exchange->values_size);
    for (size_t i = 0; i < exchange->component_count; i++) {
        tl_cached_component_rewind(&exchange->cached[i]);
    }
    return TL_OK;
}

/* Not inlined, because a candidate is noted rarely. */
static void __attribute__((noinline, cold)) note_tried(const tl_exchange *exchange, uint32_t depth) {
    tl_exchange_note *note = exchange->note;
    if (depth < note->tried_most && depth <= note->tried_count) {
        tl_ports_read(&exchange->components[note->component].inputs, note->tried + depth * note->tried_bytes);
        note->tried_count = depth == note->tried_count ? depth + 1 : note->tried_count;
    }
}

tl_status tl_exchange_try(tl_exchange *exchange, int64_t step, uint32_t depth, tl_error *error) {
    if (exchange->note != NULL) {
        note_tried(exchange, depth);
    }
    return step_components(exchange, step, depth, error);
}

static tl_status gather(tl_exchange *exchange, size_t component, int64_t step, tl_error *error) {
    uint64_t before = exchange->components[component].executions;
    tl_status status = tl_cached_component_gather(&exchange->cached[component], step, error);
    uint64_t made = exchange->components[component].executions - before;
    exchange->executions += made;
    if (made != 0) {
        tl_costs_ran(&exchange->costs, component);
    }
    exchange->failed = component;
    return status;
}

static tl_status __attribute__((noinline)) commit_cached(tl_exchange *exchange, int64_t step, tl_error *error) {
    tl_status status = TL_OK;
    for (size_t i = 0; i < exchange->component_count && status == TL_OK; i++) {
        status = gather(exchange, i, step, error);
        tl_cached_component_make_room(&exchange->cached[i]);
    }
    status = status == TL_OK ? step_components(exchange, step, TL_ALL_DEPTHS, error) : status;
    for (size_t i = 0; i < exchange->component_count && status == TL_OK; i++) {
        tl_cached_component_commit(&exchange->cached[i]);
    }
    return status;
}

static tl_status commit(tl_exchange *exchange, int64_t step, tl_error *error) {
    return exchange->cached != NULL ? commit_cached(exchange, step, error)
                                    : step_components(exchange, step, TL_ALL_DEPTHS, error);
}

const tl_component *tl_exchange_find_not_restorable(const tl_exchange *exchange, int64_t step, uint32_t ahead) {
    for (size_t i = 0; i < exchange->component_count; i++) {
        const tl_fmi2_replay *replay = &exchange->components[i].fmi->replay;
        bool is_far = step - exchange->begun + (int64_t)ahead > (int64_t)replay->most;
        if (replay->most != 0 && (replay->is_disabled || replay->differs || is_far)) {
            return &exchange->components[i];
        }
    }
    return NULL;
}

static tl_status __attribute__((noinline)) commit_and_note(tl_exchange *exchange, int64_t step, tl_error *error) {
    const tl_exchange_note *note = exchange->note;
    const tl_component *component = &exchange->components[note->component];
    tl_ports_read(&component->inputs, note->inputs);
    tl_status status = commit(exchange, step, error);
    tl_ports_read(&component->outputs, note->outputs);
    return status;
}

tl_status tl_exchange_commit(tl_exchange *exchange, int64_t step, tl_error *error) {
    return exchange->note != NULL ? commit_and_note(exchange, step, error) : commit(exchange, step, error);
}

static tl_status execute_each(const tl_exchange *exchange, int64_t step, tl_error *error) {
    double now = tl_seconds(tl_time_of_step(0, exchange->step, step));
    for (size_t i = 0; i < exchange->component_count; i++) {
        tl_status status = tl_component_step(&exchange->components[i], now, exchange->step_s, false, error);
        if (status != TL_OK) {
            return status;
        }
    }
    return TL_OK;
}

tl_status tl_exchange_step(tl_exchange *exchange, int64_t step, tl_error *error) {
    tl_plant *plant = &exchange->plant;
    tl_status status = execute_each(exchange, step, error);
    if (status == TL_OK) {
        tl_plant_deliver(plant, tl_plant_shown(plant, step + 1, plant->newest));
        tl_exchange_deliver(exchange);
    }
    return status;
}

tl_status tl_exchange_step_with(tl_exchange *exchange, int64_t step, const double *plant, tl_error *error) {
    tl_status status = execute_each(exchange, step, error);
    if (status == TL_OK) {
        tl_plant_deliver_values(&exchange->plant, plant);
        tl_exchange_deliver(exchange);
    }
    return status;
}

tl_status tl_exchange_save(tl_exchange *exchange, tl_error *error) {
    return tl_snapshot_take(&exchange->home, error);
}

tl_status tl_exchange_restore(tl_exchange *exchange, tl_error *error) {
    return tl_snapshot_restore(&exchange->home, error);
}

void tl_exchange_keep_copies(tl_exchange *exchange) {
    for (size_t i = 0; i < exchange->component_count; i++) {
        exchange->is_kept[i] = tl_component_save_copy(&exchange->components[i]);
    }
}

/* Restores components that have no copy by their states. */
static bool restore_component(tl_exchange *exchange, size_t component, const char *why) {
    tl_error error;
    tl_component *one = &exchange->components[component];
    if (!exchange->is_kept[component]) {
        return tl_component_restore(one, exchange->home.states[component], &error) == TL_OK;
    }
    tl_snapshot_forget(&exchange->home, component);
    return tl_component_restore_copy(one, why);
}

/* Switches to the next rollback method: the kept copy is not used any more. */
static bool use_next_method(tl_exchange *exchange, size_t component) {
    tl_component *one = &exchange->components[component];
    bool is_restored = tl_component_restore_copy(one, "");
    exchange->is_kept[component] = is_restored && tl_component_save_copy(one);
    return is_restored;
}

bool tl_exchange_restore_copy(tl_exchange *exchange, size_t component, const char *why) {
    bool is_restored = exchange->is_kept[component];
    for (size_t i = 0; i < exchange->component_count && is_restored; i++) {
        is_restored = restore_component(exchange, i, i == component ? why : NULL) ||
                      (why != NULL && i != component && use_next_method(exchange, i));
    }
    if (is_restored) {
        memcpy(exchange->home.live, exchange->home.values, exchange->home.values_size);
        if (why != NULL) {
            exchange->is_kept[component] = tl_component_save_copy(&exchange->components[component]);
        }
    }
    return is_restored;
}

void tl_exchange_drop_copies(tl_exchange *exchange) {
    for (size_t i = 0; i < exchange->component_count; i++) {
        tl_component_drop_copy(&exchange->components[i]);
        exchange->is_kept[i] = false;
    }
}

static bool can_stand(const tl_exchange *exchange) {
    bool can = true;
    for (size_t i = 0; exchange->cached != NULL && i < exchange->component_count; i++) {
        can = can && tl_cached_component_can_stand(&exchange->cached[i]);
    }
    return can;
}

static tl_status stand(const tl_exchange *exchange, int64_t step, tl_error *error) {
    tl_status status = TL_OK;
    for (size_t i = 0; exchange->cached != NULL && i < exchange->component_count && status == TL_OK; i++) {
        status = tl_cached_component_stand(&exchange->cached[i], step, error);
    }
    return status;
}

bool tl_exchange_can_take(const tl_exchange *exchange) {
    return can_stand(exchange);
}

tl_status tl_exchange_take(tl_exchange *exchange, int64_t step, tl_error *error) {
    tl_status status = stand(exchange, step, error);
    return status == TL_OK ? tl_snapshot_take(&exchange->home, error) : status;
}

static void count_from_0(tl_exchange *exchange) {
    exchange->executions = 0;
    exchange->plant.executions = 0;
    for (size_t i = 0; i < exchange->component_count; i++) {
        exchange->components[i].executions = 0;
        if (exchange->cached != NULL) {
            exchange->cached[i].repeated = 0;
            exchange->cached[i].uncached = 0;
        }
    }
}

tl_status tl_exchange_forget(tl_exchange *exchange, int64_t step, bool *done, tl_error *error) {
    *done = can_stand(exchange);
    tl_status status = *done ? stand(exchange, step, error) : TL_OK;
    if (*done && status == TL_OK) {
        status = tl_exchange_reset(exchange, step, error);
        count_from_0(exchange);
    }
    return status;
}

tl_status tl_exchange_copy_state(tl_exchange *exchange, size_t component, fmi2FMUstate *state, fmi2FMUstate *full_copy,
                                 bool *taken, tl_error *error) {
    tl_component *one = &exchange->components[component];
    if (exchange->cached != NULL) {
        return tl_cached_component_copy_root(&exchange->cached[component], state, full_copy, taken, error);
    }
    *taken = one->mode == TL_MODE_STEPPING;
    return *taken ? tl_component_save(one, state, error) : TL_OK;
}

void tl_exchange_keep_from(tl_exchange *exchange, size_t component, bool is_kept_from) {
    bool is_kept = is_kept_from || exchange->is_kept_always;
    exchange->is_kept_from = is_kept;
    if (exchange->cached != NULL) {
        exchange->cached[component].is_kept_from = is_kept;
    }
}

void tl_exchange_keep_always(tl_exchange *exchange) {
    exchange->is_kept_always = true;
    for (size_t i = 0; i < exchange->component_count; i++) {
        tl_exchange_keep_from(exchange, i, true);
    }
}

tl_status tl_exchange_give_up_states(tl_exchange *exchange, size_t component, int64_t step, bool *emptied,
                                     tl_error *error) {
    tl_component *one = &exchange->components[component];
    *emptied = false;
    if (one->gave_up_states || !can_stand(exchange)) {
        return TL_OK;
    }
    tl_status status = stand(exchange, step, error);
    if (status != TL_OK || !tl_component_save_copy(one)) {
        return status;
    }
    tl_exchange_end_component(exchange, component);
    (void)tl_component_restore_copy(one, "");
    tl_component_drop_copy(one);
    *emptied = true;
    return tl_exchange_reset(exchange, step, error);
}

tl_status tl_exchange_return(tl_exchange *exchange, tl_error *error) {
    return tl_snapshot_restore(&exchange->home, error);
}
