/* The co-simulation at one instant: see snapshot.h. */
#include "master/graph/snapshot.h"

#include <string.h>

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
