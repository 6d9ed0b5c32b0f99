/* Track of the last candidate: see track.h. */
#include "master/graph/track.h"

#include <string.h>

/* Connections from one component. */
typedef struct tl_fan {
    size_t first; /* index in `copies` */
    size_t count;
} tl_fan;

/* One connection of the exchange. */
typedef struct tl_track_copy {
    const tl_real_copy *real;       /* a Real connection; NULL: `integer` */
    const tl_integer_copy *integer; /* the other kind */
    size_t reader;                  /* the component that reads the value; SIZE_MAX: none that steps */
} tl_track_copy;

struct tl_track {
    tl_exchange *exchange;
    uint32_t depth;        /* steps that are known */
    uint32_t walked;       /* steps of the present candidate so far */
    unsigned char *blocks; /* values before each step; [(depth) · values_size] */
    uint32_t *places;      /* node of each component before each step; [depth · components + k] */
    bool *awake;           /* differs from the track in this step */
    bool *next;            /* in the next one */
    bool *adjusted;        /* has inputs that every candidate sets */
    bool *always;          /* active in every step of this candidate: `adjusted`, or `lost` in the candidate before */
    bool *lost;            /* beyond its cache: its positions cannot be restored */
    tl_fan *fans;          /* of each component */
    tl_track_copy *copies; /* by the component they come from */
};

/* ---- build ---- */

static void add_copies(tl_track *track, const tl_graph *graph, size_t component, size_t *count) {
    const tl_exchange *exchange = track->exchange;
    size_t real = 0;
    size_t conversion = 0;
    size_t integer = 0;
    track->fans[component].first = *count;
    /* In the order in which the exchange has made its tables. */
    for (size_t i = 0; i < graph->connection_count; i++) {
        const tl_connection *connection = &graph->connections[i];
        tl_track_copy copy = {.reader = connection->cut ? SIZE_MAX : connection->to->node};
        if (connection->to->type != TL_REAL) {
            copy.integer = &exchange->integer_copies[integer++];
        } else if (tl_conversion_is_identity(&connection->conversion)) {
            copy.real = &exchange->copies[real++];
        } else {
            copy.real = &exchange->conversions[conversion++];
        }
        if (connection->from->node == component) {
            track->copies[(*count)++] = copy;
        }
    }
    track->fans[component].count = *count - track->fans[component].first;
}

static void find_adjusted(tl_track *track, const tl_graph *graph) {
    for (size_t i = 0; i < graph->port_count; i++) {
        const tl_port *port = &graph->ports[i];
        if (port->adjusted) {
            track->adjusted[port->node] = true;
        }
    }
}

tl_track *tl_track_create(tl_arena *arena, tl_exchange *exchange, const tl_graph *graph, uint32_t prediction) {
    size_t components = exchange->component_count;
    size_t steps = (size_t)prediction + 1;
    tl_track *track = tl_arena_take(arena, 1, sizeof *track);
    if (track == NULL) {
        return NULL;
    }
    track->exchange = exchange;
    if (exchange->cached == NULL) {
        return track;
    }
    track->blocks = tl_arena_take(arena, steps, exchange->values_size);
    track->places = tl_arena_take(arena, steps * components, sizeof *track->places);
    track->awake = tl_arena_take(arena, components, sizeof *track->awake);
    track->next = tl_arena_take(arena, components, sizeof *track->next);
    track->adjusted = tl_arena_take(arena, components, sizeof *track->adjusted);
    track->always = tl_arena_take(arena, components, sizeof *track->always);
    track->lost = tl_arena_take(arena, components, sizeof *track->lost);
    track->fans = tl_arena_take(arena, components, sizeof *track->fans);
    track->copies = tl_arena_take(arena, graph->connection_count, sizeof *track->copies);
    if (track->blocks == NULL || track->places == NULL || track->awake == NULL || track->next == NULL ||
        track->adjusted == NULL || track->always == NULL || track->lost == NULL || track->fans == NULL ||
        track->copies == NULL) {
        return NULL;
    }
    size_t count = 0;
    for (size_t k = 0; k < components; k++) {
        add_copies(track, graph, k, &count);
    }
    find_adjusted(track, graph);
    return track;
}

/* ---- candidate ---- */

static unsigned char *block_at(const tl_track *track, uint32_t depth) {
    return track->blocks + (size_t)depth * track->exchange->values_size;
}

static uint32_t *places_at(const tl_track *track, uint32_t depth) {
    return track->places + (size_t)depth * track->exchange->component_count;
}

/* Address in a block of the track for an address in the exchange's block. */
static void *in_block(const tl_track *track, unsigned char *block, const void *value) {
    return block + ((const unsigned char *)value - track->exchange->values);
}

/* Starts a candidate at the committed values. */
static void start_candidate(tl_track *track) {
    const tl_exchange *exchange = track->exchange;
    size_t components = exchange->component_count;
    if (track->walked < track->depth) {
        track->depth = track->walked; /* the candidate before failed or was aborted: later steps are of an older one */
    }
    track->walked = 0;
    for (size_t k = 0; k < components; k++) {
        places_at(track, 0)[k] = exchange->cached[k].root;
        track->always[k] = track->adjusted[k] || track->lost[k];
        track->awake[k] = track->always[k];
        track->lost[k] = false;
    }
}

/* Executes one component from its position; afterwards *place is its new position. */
static tl_status step_component(tl_track *track, size_t k, int64_t step, uint32_t depth, uint32_t *place,
                                tl_error *error) {
    tl_exchange *exchange = track->exchange;
    tl_cached_component *cached = &exchange->cached[k];
    if (!track->lost[k]) {
        cached->position = places_at(track, depth)[k];
    }
    tl_status status = tl_exchange_advance(exchange, k, step, depth, error);
    *place = cached->position;
    track->lost[k] = track->lost[k] || cached->position == TL_NO_NODE;
    if (status != TL_OK) {
        exchange->failed = k;
    }
    return status;
}

/* Executes all components that take part, in a step that is not on the track. */
static tl_status step_whole(tl_track *track, int64_t step, uint32_t depth, tl_error *error) {
    tl_exchange *exchange = track->exchange;
    uint32_t *before = places_at(track, depth);
    uint32_t *after = places_at(track, depth + 1);
    for (size_t k = 0; k < exchange->component_count; k++) {
        after[k] = before[k];
        if (tl_exchange_takes_part(exchange, k, depth)) {
            tl_status status = step_component(track, k, step, depth, &after[k], error);
            if (status != TL_OK) {
                return status;
            }
        }
    }
    if (tl_exchange_takes_part(exchange, exchange->component_count, depth)) {
        tl_plant_step(&exchange->plant, step);
    }
    tl_exchange_deliver(exchange);
    memcpy(block_at(track, depth + 1), exchange->values, exchange->values_size);
    track->depth = depth + 1;
    return TL_OK;
}

/* Copies values of one type into the block; returns whether they differ. */
static bool write_changed(const tl_track *track, unsigned char *block, const void *values, size_t size) {
    void *old = in_block(track, block, values);
    bool differ = memcmp(old, values, size) != 0;
    memcpy(old, values, size);
    return differ;
}

/* The same for a component's outputs. */
static bool write_outputs(const tl_track *track, unsigned char *block, const tl_ports *out) {
    bool reals = write_changed(track, block, out->reals, out->real_count * sizeof *out->reals);
    bool integers = write_changed(track, block, out->integers, out->integer_count * sizeof *out->integers);
    bool booleans = write_changed(track, block, out->booleans, out->boolean_count * sizeof *out->booleans);
    return reals || integers || booleans;
}

/* Copies the value of one connection to the values and the track; its reader is active in the next
 * step. */
static void pass_on(tl_track *track, unsigned char *block, const tl_track_copy *copy) {
    if (copy->real != NULL) {
        double value = tl_exchange_convert(copy->real);
        memcpy(in_block(track, block, copy->real->to), &value, sizeof value);
    } else {
        memcpy(in_block(track, block, copy->integer->to), copy->integer->from, sizeof *copy->integer->from);
    }
    if (copy->reader < track->exchange->component_count) {
        track->next[copy->reader] = true;
    }
}

/* Executes one active component and updates the track. */
static tl_status step_awake(tl_track *track, size_t k, int64_t step, uint32_t depth, tl_error *error) {
    unsigned char *block = block_at(track, depth + 1);
    uint32_t place = TL_NO_NODE;
    tl_status status = step_component(track, k, step, depth, &place, error);
    if (status != TL_OK) {
        return status;
    }
    track->next[k] = track->next[k] || place != places_at(track, depth + 1)[k];
    places_at(track, depth + 1)[k] = place;
    const tl_ports *outputs = &track->exchange->components[k].outputs;
    if (write_outputs(track, block, outputs) || !tl_reals_are_finite(outputs->reals, outputs->real_count)) {
        for (size_t i = 0; i < track->fans[k].count; i++) {
            pass_on(track, block, &track->copies[track->fans[k].first + i]);
        }
    }
    return TL_OK;
}

/* Executes only components that differ from the track. */
static tl_status step_changed(tl_track *track, int64_t step, uint32_t depth, tl_error *error) {
    tl_exchange *exchange = track->exchange;
    size_t components = exchange->component_count;
    memcpy(track->next, track->always, components * sizeof *track->next);
    for (size_t k = 0; k < components; k++) {
        if (track->awake[k] && tl_exchange_takes_part(exchange, k, depth)) {
            tl_status status = step_awake(track, k, step, depth, error);
            if (status != TL_OK) {
                return status;
            }
        }
    }
    memcpy(exchange->values, block_at(track, depth + 1), exchange->values_size);
    bool *awake = track->awake;
    track->awake = track->next;
    track->next = awake;
    return TL_OK;
}

tl_status tl_track_begin(tl_track *track, tl_error *error) {
    tl_status status = tl_exchange_begin(track->exchange, error);
    if (track->exchange->cached != NULL) {
        track->depth = 0;
        start_candidate(track);
    }
    return status;
}

tl_status tl_track_rewind(tl_track *track, tl_error *error) {
    tl_status status = tl_exchange_rewind(track->exchange, error);
    if (track->exchange->cached != NULL) {
        start_candidate(track);
    }
    return status;
}

tl_status tl_track_try(tl_track *track, int64_t step, uint32_t depth, tl_error *error) {
    if (track->exchange->cached == NULL) {
        return tl_exchange_try(track->exchange, step, depth, error);
    }
    bool known = depth < track->depth;
    tl_status status = known ? step_changed(track, step, depth, error) : step_whole(track, step, depth, error);
    if (status == TL_OK) {
        track->walked = depth + 1;
    }
    return status;
}
