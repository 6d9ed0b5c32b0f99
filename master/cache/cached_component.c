/* Cached component: see cached_component.h. */
#include "master/cache/cached_component.h"

bool tl_cached_component_init(tl_cached_component *cached, tl_arena *arena, tl_component *component, tl_keep keep,
                              tl_time size, uint32_t spacing, uint32_t capacity) {
    *cached = (tl_cached_component){
        .component = component, .keep = keep, .size = size, .spacing = spacing, .states = capacity};
    size_t key_size = tl_ports_size(&component->inputs);
    size_t value_size = tl_ports_size(&component->outputs);
    cached->key = tl_arena_take(arena, key_size + 1, 1);
    cached->value = tl_arena_take(arena, value_size + 1, 1);
    return cached->key != NULL && cached->value != NULL &&
           tl_sequence_cache_init(&cached->tree, arena, key_size, value_size, capacity);
}

/* State handles created at start-up with TL_KEEP_STATES: more than a search usually needs. The pool
 * is sized for the worst case and may be thousands; an FMU may need a megabyte for each. */
enum { READY_STATES = 256 };

/* States created to measure their size: other allocations hardly happen in each of them. */
enum { MEASURED_STATES = 3 };

static tl_status make_state(tl_cached_component *cached, fmi2FMUstate *state, tl_error *error) {
    *state = NULL;
    tl_status status = tl_component_save(cached->component, state, error);
    cached->made += *state != NULL ? 1 : 0;
    return status;
}

static tl_status make_spare(tl_cached_component *cached, tl_error *error) {
    fmi2FMUstate state;
    tl_status status = make_state(cached, &state, error);
    tl_sequence_cache_put_spare(&cached->tree, state);
    return status;
}

tl_status tl_cached_component_measure(tl_cached_component *cached, size_t (*heap)(void), size_t *size,
                                      tl_error *error) {
    tl_status status = TL_OK;
    size_t least = SIZE_MAX;
    size_t serialised = 0;
    bool can_serialise = tl_component_can_serialize(cached->component);
    for (int i = 0; i < MEASURED_STATES && (heap != NULL || can_serialise) && status == TL_OK; i++) {
        size_t before = heap != NULL ? heap() : 0;
        status = make_spare(cached, error);
        size_t after = heap != NULL ? heap() : 0;
        size_t grown = after > before ? after - before : 0;
        least = grown < least ? grown : least;
    }
    size_t known = tl_component_state_size(cached->component);
    if (can_serialise && known == 0 && status == TL_OK) {
        status = tl_component_serialized_size(cached->component, cached->tree.spare[0], &serialised, error);
        if (status == TL_FMU_FAILED &&
            cached->component->mode == TL_MODE_STEPPING) { /* fmi2Discard: it can still step */
            serialised = 0;
            status = TL_OK;
        }
    }
    *size = known != 0 ? known : heap != NULL && least > serialised ? least : serialised;
    return status;
}

void tl_cached_component_limit(tl_cached_component *cached, uint32_t states) {
    cached->states = states;
    while (cached->tree.spare_count > states) {
        fmi2FMUstate spare = tl_sequence_cache_take_spare(&cached->tree);
        tl_component_forget(cached->component, &spare);
        cached->made--;
    }
}

tl_status tl_cached_component_start(tl_cached_component *cached, tl_error *error) {
    tl_status status = TL_OK;
    uint32_t ready = cached->states < READY_STATES ? cached->states : READY_STATES;
    ready = cached->keep == TL_KEEP_OUTPUTS ? 0 : cached->keep == TL_KEEP_NONE ? 1 : ready;
    while (cached->made < ready && status == TL_OK) {
        status = make_spare(cached, error);
    }
    cached->root = tl_sequence_cache_create_root(&cached->tree);
    cached->position = cached->root;
    cached->at = cached->root;
    return status;
}

tl_status tl_cached_component_reset(tl_cached_component *cached, tl_error *error) {
    tl_sequence_cache_clear(&cached->tree);
    return tl_cached_component_start(cached, error);
}

void tl_cached_component_end(tl_cached_component *cached) {
    tl_sequence_cache *tree = &cached->tree;
    cached->made = 0;
    for (uint32_t i = 0; i < tree->capacity; i++) {
        tl_component_forget(cached->component, &tree->nodes[i].state);
    }
    while (tree->spare_count != 0) {
        tl_component_forget(cached->component, &tree->spare[--tree->spare_count]);
    }
}

void tl_cached_component_rewind(tl_cached_component *cached) {
    cached->position = cached->root;
    cached->commits = false;
}

/* Steps from the nearest saved state at or above a node to that node; UINT32_MAX if there is none.
 */
static uint32_t distance_to_state(const tl_sequence_cache *tree, uint32_t node) {
    uint32_t distance = 0;
    while (node != TL_NO_NODE && tree->nodes[node].state == NULL) {
        node = tree->nodes[node].parent;
        distance++;
    }
    return node == TL_NO_NODE ? UINT32_MAX : distance;
}

/* Whether the state of the FMU's node must be saved, or may be. A node below a saved state can be
 * reached by catching up; the last handle is reserved for nodes that cannot. */
static bool is_to_be_saved(const tl_cached_component *cached, bool onwards) {
    uint32_t distance = distance_to_state(&cached->tree, cached->at);
    uint32_t free = cached->tree.spare_count + (cached->states - cached->made);
    if (distance == UINT32_MAX) {
        return true;
    }
    bool wanted = cached->keep == TL_KEEP_STATES || (onwards && distance >= cached->spacing);
    return wanted && (cached->states == cached->tree.capacity || free > 1);
}

/* Saves the state of the node that the FMU is leaving, if it will be needed. */
static tl_status save_left(tl_cached_component *cached, bool onwards, tl_error *error) {
    if (cached->at == TL_NO_NODE || cached->tree.nodes[cached->at].state != NULL || !is_to_be_saved(cached, onwards)) {
        return TL_OK;
    }
    bool is_new = cached->tree.spare_count == 0;
    fmi2FMUstate state = tl_sequence_cache_take_spare(&cached->tree);
    tl_status status = tl_component_save(cached->component, &state, error);
    cached->made += is_new && state != NULL ? 1 : 0;
    if (status == TL_OK) {
        cached->tree.nodes[cached->at].state = state;
    } else {
        tl_sequence_cache_put_spare(&cached->tree, state);
    }
    return status;
}

/* Restores the state of a node. */
static tl_status load_node(tl_cached_component *cached, uint32_t node, tl_error *error) {
    tl_status status = save_left(cached, false, error);
    if (status != TL_OK) {
        return status;
    }
    cached->at = TL_NO_NODE;
    status = tl_component_restore(cached->component, cached->tree.nodes[node].state, error);
    cached->at = status == TL_OK ? node : TL_NO_NODE;
    return status;
}

bool tl_cached_component_can_stand(const tl_cached_component *cached) {
    return cached->at == cached->root || cached->tree.nodes[cached->root].state != NULL;
}

/* Moves the FMU to another node, and back. */
static tl_status copy_elsewhere(tl_component *component, fmi2FMUstate root, fmi2FMUstate *state,
                                fmi2FMUstate *full_copy, tl_error *error) {
    tl_status status = tl_component_save(component, full_copy, error);
    if (status != TL_OK) {
        return status;
    }
    status = tl_component_restore(component, root, error);
    status = status == TL_OK ? tl_component_save(component, state, error) : status;
    tl_status back = status == TL_FMU_FATAL ? status : tl_component_restore(component, *full_copy, error);
    return back != TL_OK ? back : status;
}

tl_status tl_cached_component_copy_root(tl_cached_component *cached, fmi2FMUstate *state, fmi2FMUstate *full_copy,
                                        bool *taken, tl_error *error) {
    fmi2FMUstate root = cached->tree.nodes[cached->root].state;
    bool is_at_root = cached->at == cached->root;
    *taken = cached->component->mode == TL_MODE_STEPPING && (is_at_root || root != NULL);
    if (!*taken) {
        return TL_OK;
    }
    return is_at_root ? tl_component_save(cached->component, state, error)
                      : copy_elsewhere(cached->component, root, state, full_copy, error);
}

/* Whether no state before that of this node will be needed: it is saved, and every candidate passes
 * it. */
static bool is_final(const tl_cached_component *cached, uint32_t node) {
    const tl_sequence_cache *tree = &cached->tree;
    if (cached->is_kept_from) {
        return false;
    }
    uint32_t above = cached->root;
    while (above != node && above != TL_NO_NODE) {
        above = tree->nodes[above].parent;
    }
    return above != TL_NO_NODE && tree->nodes[above].state != NULL;
}

/* Executes one step from the FMU's node with the inputs in the ports. Afterwards the FMU is at no
 * node yet. */
static tl_status execute_step(tl_cached_component *cached, int64_t step, tl_error *error) {
    tl_status status = save_left(cached, true, error);
    if (status != TL_OK) {
        return status;
    }
    bool final = is_final(cached, cached->at);
    cached->at = TL_NO_NODE;
    return tl_component_step(cached->component, tl_seconds(tl_time_of_step(0, cached->size, step)),
                             tl_seconds(cached->size), final, error);
}

static uint32_t ancestor(const tl_sequence_cache *tree, uint32_t node, uint32_t generations) {
    for (uint32_t i = 0; i < generations; i++) {
        node = tree->nodes[node].parent;
    }
    return node;
}

/* Moves the FMU to the candidate's node, which is before macro step `step`. */
static tl_status move_to_candidate(tl_cached_component *cached, int64_t step, tl_error *error) {
    const tl_sequence_cache *tree = &cached->tree;
    uint32_t from = cached->position;
    uint32_t missing = 0;
    while (from != cached->at && tree->nodes[from].state == NULL) {
        from = tree->nodes[from].parent;
        missing++;
    }
    tl_status status = from == cached->at ? TL_OK : load_node(cached, from, error);
    for (; missing > 0 && status == TL_OK; missing--) {
        uint32_t next = ancestor(tree, cached->position, missing - 1);
        tl_ports_write(&cached->component->inputs, tl_sequence_cache_key(tree, next));
        status = execute_step(cached, step - (int64_t)missing, error);
        cached->at = status == TL_OK ? next : TL_NO_NODE;
        cached->repeated++;
    }
    tl_ports_write(&cached->component->inputs, cached->key);
    return status;
}

tl_status tl_cached_component_stand(tl_cached_component *cached, int64_t step, tl_error *error) {
    cached->position = cached->root;
    tl_ports_read(&cached->component->inputs, cached->key);
    return move_to_candidate(cached, step, error);
}

tl_status tl_cached_component_gather(tl_cached_component *cached, int64_t step, tl_error *error) {
    tl_sequence_cache *tree = &cached->tree;
    tl_status status = TL_OK;
    if (cached->states == tree->capacity || tree->nodes[cached->root].state != NULL ||
        distance_to_state(tree, cached->root) < cached->spacing) {
        return TL_OK;
    }
    if (cached->at != cached->root) {
        status = tl_cached_component_stand(cached, step, error);
    }
    if (status == TL_OK) {
        tl_sequence_cache_keep_only(tree, cached->root, cached->root);
    }
    return status;
}

/* Stores the result of a step. Without room the candidate continues outside of the tree, and the
 * FMU with it. */
static void store_result(tl_cached_component *cached) {
    uint32_t added = TL_NO_NODE;
    bool is_kept = cached->keep != TL_KEEP_NONE || cached->commits;
    if (cached->position != TL_NO_NODE && is_kept) {
        tl_ports_read(&cached->component->outputs, cached->value);
        added = tl_sequence_cache_add(&cached->tree, cached->position, cached->key, cached->value);
    }
    cached->uncached += is_kept && added == TL_NO_NODE;
    cached->position = added;
    cached->at = added;
}

tl_status tl_cached_component_step(tl_cached_component *cached, int64_t step, tl_error *error) {
    tl_status status = TL_OK;
    if (cached->position != TL_NO_NODE) {
        tl_ports_read(&cached->component->inputs, cached->key);
        uint32_t known = tl_sequence_cache_find(&cached->tree, cached->position, cached->key);
        if (known != TL_NO_NODE) {
            tl_ports_write(&cached->component->outputs, tl_sequence_cache_value(&cached->tree, known));
            cached->position = known;
            return TL_OK;
        }
        status = move_to_candidate(cached, step, error);
    }
    status = status == TL_OK ? execute_step(cached, step, error) : status;
    if (status == TL_OK) {
        store_result(cached);
    }
    return status;
}

void tl_cached_component_make_room(tl_cached_component *cached) {
    cached->commits = true;
    tl_ports_read(&cached->component->inputs, cached->key);
    if (cached->tree.free != TL_NO_NODE ||
        tl_sequence_cache_find(&cached->tree, cached->root, cached->key) != TL_NO_NODE) {
        return;
    }
    tl_sequence_cache_prune(&cached->tree, cached->root);
    if (cached->at != TL_NO_NODE && !cached->tree.nodes[cached->at].used) {
        cached->at = TL_NO_NODE;
    }
}

void tl_cached_component_commit(tl_cached_component *cached) {
    const tl_sequence_cache *tree = &cached->tree;
    uint32_t first = cached->position;
    cached->commits = false;
    if (cached->at != first || cached->keep == TL_KEEP_OUTPUTS) {
        while (tree->nodes[first].state == NULL && tree->nodes[first].parent != TL_NO_NODE) {
            first = tree->nodes[first].parent;
        }
    }
    cached->root = cached->position;
    tl_sequence_cache_keep_only(&cached->tree, first, cached->root);
    if (cached->at != TL_NO_NODE && !tree->nodes[cached->at].used) {
        cached->at = TL_NO_NODE;
    }
}
