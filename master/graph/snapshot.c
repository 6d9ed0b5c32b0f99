/* Snapshots and the number of states: see snapshot.h. */
#include "master/graph/snapshot.h"

#include <string.h>

/* ---- state room ---- */

static uint64_t need_of(const tl_state_room *room) {
    return (uint64_t)room->size * room->most;
}

/* Returns what the components that need at most `share` leave of the bound. *larger: number of the
 * other components. */
static uint64_t left_by_others(const tl_state_room *rooms, size_t count, uint64_t share, uint64_t bytes,
                               size_t *larger) {
    *larger = 0;
    for (size_t k = 0; k < count; k++) {
        uint64_t need = need_of(&rooms[k]);
        if (need > share) {
            (*larger)++;
        } else {
            bytes -= need;
        }
    }
    return bytes;
}

/* The share of each component that needs more than its share. It grows by what the other components
 * leave. */
static uint64_t find_share(const tl_state_room *rooms, size_t count, uint64_t bytes) {
    uint64_t share = count != 0 ? bytes / count : 0;
    size_t larger = count;
    size_t before = count + 1;
    while (larger != 0 && larger < before) {
        before = larger;
        uint64_t left = left_by_others(rooms, count, share, bytes, &larger);
        share = larger != 0 ? left / larger : share;
    }
    return share;
}

void tl_state_room_share(tl_state_room *rooms, size_t count, uint64_t bytes) {
    uint64_t share = find_share(rooms, count, bytes);
    for (size_t k = 0; k < count; k++) {
        tl_state_room *room = &rooms[k];
        room->kept = room->most;
        if (bytes != 0 && need_of(room) > share) {
            uint64_t fitting = share / room->size;
            room->kept = fitting > TL_STATES_LEAST ? (uint32_t)fitting : TL_STATES_LEAST;
        }
    }
}

uint64_t tl_state_room_bytes(const tl_state_room *rooms, size_t count) {
    uint64_t sum = 0;
    for (size_t k = 0; k < count; k++) {
        sum += (uint64_t)rooms[k].size * rooms[k].kept;
    }
    return sum;
}

/* ---- snapshot ---- */

bool tl_snapshot_init(tl_snapshot *snapshot, tl_arena *arena, tl_component *components, size_t component_count,
                      unsigned char *live, size_t values_size) {
    snapshot->components = components;
    snapshot->component_count = component_count;
    snapshot->live = live;
    snapshot->values_size = values_size;
    snapshot->values = tl_arena_take(arena, values_size, 1);
    snapshot->states = tl_arena_take(arena, component_count, sizeof *snapshot->states);
    return snapshot->values != NULL && snapshot->states != NULL;
}

tl_status tl_snapshot_take(tl_snapshot *snapshot, tl_error *error) {
    tl_status status = TL_OK;
    memcpy(snapshot->values, snapshot->live, snapshot->values_size);
    for (size_t i = 0; i < snapshot->component_count && status == TL_OK; i++) {
        status = tl_component_save(&snapshot->components[i], &snapshot->states[i], error);
    }
    return status;
}

tl_status tl_snapshot_restore(const tl_snapshot *snapshot, tl_error *error) {
    tl_status status = TL_OK;
    memcpy(snapshot->live, snapshot->values, snapshot->values_size);
    for (size_t i = 0; i < snapshot->component_count && status == TL_OK; i++) {
        status = tl_component_restore(&snapshot->components[i], snapshot->states[i], error);
    }
    return status;
}

void tl_snapshot_forget(tl_snapshot *snapshot, size_t component) {
    if (snapshot->states != NULL) {
        tl_component_forget(&snapshot->components[component], &snapshot->states[component]);
    }
}

static tl_status save_state(tl_component *component, fmi2FMUstate state, tl_archive *archive, tl_error *error) {
    uint64_t size = 0;
    size_t bytes = 0;
    tl_status status = tl_component_serialized_size(component, state, &bytes, error);
    if (status != TL_OK) {
        return status;
    }
    size = bytes;
    tl_archive_part(archive, &size, sizeof size);
    unsigned char *room = tl_archive_room(archive, bytes);
    return room != NULL ? tl_component_serialize(component, state, room, bytes, error) : TL_OK;
}

static tl_status load_state(tl_component *component, fmi2FMUstate *state, tl_archive *archive, tl_error *error) {
    uint64_t size = 0;
    tl_archive_part(archive, &size, sizeof size);
    const unsigned char *bytes = tl_archive_bytes(archive, size <= SIZE_MAX ? (size_t)size : SIZE_MAX);
    if (bytes == NULL) {
        return tl_fail(error, TL_BAD_DATA, "%s: its serialised state is incomplete", component->name);
    }
    return tl_component_deserialize(component, bytes, (size_t)size, state, error);
}

tl_status tl_snapshot_archive(tl_snapshot *snapshot, tl_archive *archive, tl_error *error) {
    tl_status status = TL_OK;
    for (size_t i = 0; i < snapshot->component_count && status == TL_OK; i++) {
        tl_component *component = &snapshot->components[i];
        status = tl_archive_is_loading(archive) ? load_state(component, &snapshot->states[i], archive, error)
                                                : save_state(component, snapshot->states[i], archive, error);
    }
    tl_archive_part(archive, snapshot->values, snapshot->values_size);
    return status;
}
