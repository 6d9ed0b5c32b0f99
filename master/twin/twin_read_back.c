/* Test of serialised states in another process: see twin_read_back.h. */
#include "master/twin/twin_read_back.h"

#include <math.h>
#include <string.h>

#include "master/base/archive.h"
#include "master/twin/twin_parts.h"

/* Data of a component: this, its state, and of each step its inputs, then its outputs. Not aligned.
 */
typedef struct saved_head {
    uint64_t state; /* bytes */
    uint64_t steps;
    int64_t first;
} saved_head;

/* Addresses of one component's data. */
typedef struct saved_part {
    saved_head head;
    const unsigned char *state;
    const unsigned char *inputs;
    const unsigned char *outputs;
} saved_part;

/* ---- outputs ---- */

static bool is_output_of(const tl_port *port, size_t component) {
    return port->variable != NULL && !port->input && port->node == component;
}

/* As doubles, one for each port. */
static size_t outputs_size(const tl_twin *twin, size_t component) {
    size_t size = 0;
    for (size_t i = 0; i < twin->graph.port_count; i++) {
        size += is_output_of(&twin->graph.ports[i], component) ? sizeof(double) : 0;
    }
    return size;
}

static void note_outputs(const tl_twin *twin, size_t component, unsigned char *to) {
    for (size_t i = 0; i < twin->graph.port_count; i++) {
        const tl_port *port = &twin->graph.ports[i];
        if (is_output_of(port, component)) {
            const double value = tl_exchange_value(&twin->exchange, port);
            memcpy(to, &value, sizeof value);
            to += sizeof value;
        }
    }
}

/* True: one differs from the noted value. */
static bool outputs_differ(const tl_twin *twin, size_t component, const unsigned char *noted, tl_read_back *read) {
    for (size_t i = 0; i < twin->graph.port_count; i++) {
        const tl_port *port = &twin->graph.ports[i];
        if (!is_output_of(port, component)) {
            continue;
        }
        read->again = tl_exchange_value(&twin->exchange, port);
        memcpy(&read->first, noted, sizeof read->first);
        if (memcmp(&read->again, &read->first, sizeof read->again) != 0) {
            read->variable = port->variable->name;
            return true;
        }
        noted += sizeof read->first;
    }
    return false;
}

/* ---- execution ---- */

static int64_t next_step(const tl_twin *twin) {
    return twin->exchange.plant.newest + 1 - (int64_t)twin->lead;
}

/* From its present state. */
static void repeat_steps(const tl_twin *twin, size_t index, const saved_part *saved, tl_read_back *read) {
    const tl_exchange *exchange = &twin->exchange;
    tl_component *component = &exchange->components[index];
    for (uint64_t i = 0; i < saved->head.steps && read->outcome == TL_READ_BACK_EXACT; i++) {
        const tl_time now = tl_time_of_step(0, exchange->step, saved->head.first + (int64_t)i);
        tl_ports_write(&component->inputs, saved->inputs + i * tl_ports_size(&component->inputs));
        if (tl_component_step(component, tl_seconds(now), exchange->step_s, false, &read->error) != TL_OK) {
            read->outcome = TL_READ_BACK_REFUSED;
        } else if (outputs_differ(twin, index, saved->outputs + i * outputs_size(twin, index), read)) {
            read->outcome = TL_READ_BACK_DIFFERS;
        }
        read->after = (unsigned)i + 1;
    }
}

/* ---- the bytes ---- */

static size_t steps_size(const tl_twin *twin, size_t component) {
    return TL_READ_BACK_STEPS *
           (tl_ports_size(&twin->exchange.components[component].inputs) + outputs_size(twin, component));
}

/* False: there is no data, or it is invalid. */
static bool find_part(const tl_twin *twin, const unsigned char *bytes, size_t size, size_t component,
                      saved_part *found) {
    tl_archive archive = tl_archive_loading(bytes, size);
    for (size_t i = 0; i <= component; i++) {
        *found = (saved_part){.head = {.state = UINT64_MAX}};
        tl_archive_part(&archive, &found->head, sizeof found->head);
        tl_archive_require(&archive, found->head.state < SIZE_MAX && found->head.steps <= TL_READ_BACK_STEPS);
        found->state = tl_archive_bytes(&archive, (size_t)found->head.state);
        found->inputs = tl_archive_bytes(&archive, steps_size(twin, i));
    }
    if (!tl_archive_is_whole(&archive)) {
        return false;
    }
    found->outputs = found->inputs + TL_READ_BACK_STEPS * tl_ports_size(&twin->exchange.components[component].inputs);
    return true;
}

/* ---- writer ---- */

/* Its state, and zeros for the rest. */
static tl_status write_state(const tl_twin *twin, size_t index, tl_archive *archive, tl_error *error) {
    tl_component *component = &twin->exchange.components[index];
    fmi2FMUstate state = twin->exchange.home.states[index];
    size_t size = 0;
    tl_status status = tl_component_serialized_size(component, state, &size, error);
    if (status != TL_OK) {
        return status;
    }
    saved_head own = {.state = size, .first = next_step(twin)};
    tl_archive_part(archive, &own, sizeof own);
    unsigned char *room = tl_archive_room(archive, size);
    unsigned char *steps = tl_archive_room(archive, steps_size(twin, index));
    if (steps == NULL) {
        return TL_OK;
    }
    memset(steps, 0, steps_size(twin, index));
    return tl_component_serialize(component, state, room, size, error);
}

/* Up and down around the present values; Booleans false and true. */
static void move_inputs(tl_twin *twin, const double *now, uint64_t step) {
    for (size_t v = 0; v < twin->synchroniser.horizon.variables; v++) {
        const tl_adjusted *adjusted = &twin->synchroniser.adjusted[v];
        double moved = now[v] + (step % 4 < 2 ? adjusted->step : -adjusted->step);
        moved = adjusted->is_boolean ? (step % 2 == 0 ? 1.0 - now[v] : now[v]) : moved;
        tl_exchange_set_adjusted(&twin->exchange, v, fmin(fmax(moved, adjusted->lower), adjusted->upper));
    }
}

/* Inputs or outputs of all components in a step; then it counts. */
static void note_ports(const tl_twin *twin, unsigned char *bytes, size_t size, uint64_t step, bool inputs) {
    unsigned char *at = bytes;
    saved_part saved;
    for (size_t k = 0; k < twin->exchange.component_count && find_part(twin, bytes, size, k, &saved); k++) {
        const tl_ports *ports = &twin->exchange.components[k].inputs;
        unsigned char *of_inputs = bytes + (saved.inputs - bytes);
        if (inputs) {
            tl_ports_read(ports, of_inputs + step * tl_ports_size(ports));
        } else {
            note_outputs(twin, k, bytes + (saved.outputs - bytes) + step * outputs_size(twin, k));
            saved.head.steps = step + 1;
            memcpy(at, &saved.head, sizeof saved.head);
        }
        at = of_inputs + steps_size(twin, k);
    }
}

/* All together, as they are connected. */
static tl_status write_steps(tl_twin *twin, unsigned char *bytes, size_t size, tl_error *error) {
    double now[TL_MAX_ADJUST] = {0.0};
    tl_status status = TL_OK;
    for (size_t v = 0; v < twin->synchroniser.horizon.variables; v++) {
        now[v] = tl_exchange_adjusted(&twin->exchange, v);
    }
    for (uint64_t i = 0; i < TL_READ_BACK_STEPS && status == TL_OK; i++) {
        move_inputs(twin, now, i);
        note_ports(twin, bytes, size, i, true);
        status = tl_exchange_step(&twin->exchange, next_step(twin) + (int64_t)i, error);
        if (status == TL_OK) {
            note_ports(twin, bytes, size, i, false);
        }
    }
    return status == TL_FMU_FATAL ? status : TL_OK;
}

/* Restores each component alone and repeats the steps, in the writing process. */
static tl_status check_here(const tl_twin *twin, const unsigned char *bytes, size_t size, tl_read_back *here,
                            tl_error *error) {
    tl_status status = TL_OK;
    saved_part saved;
    for (size_t i = 0; i < twin->exchange.component_count && status == TL_OK; i++) {
        tl_component *component = &twin->exchange.components[i];
        here[i] = (tl_read_back){.outcome = TL_READ_BACK_EXACT};
        status = tl_component_restore(component, twin->exchange.home.states[i], error);
        if (status == TL_OK && find_part(twin, bytes, size, i, &saved)) {
            repeat_steps(twin, i, &saved, &here[i]);
        }
    }
    return status;
}

static tl_status write_all(tl_twin *twin, tl_archive *archive, unsigned char *bytes, tl_read_back *here,
                           tl_error *error) {
    tl_exchange *exchange = &twin->exchange;
    tl_status status = tl_exchange_take(exchange, exchange->plant.newest, error);
    for (size_t i = 0; i < exchange->component_count && status == TL_OK; i++) {
        status = write_state(twin, i, archive, error);
    }
    if (status != TL_OK || !tl_archive_is_whole(archive)) {
        return status;
    }
    status = write_steps(twin, bytes, archive->at, error);
    status = status == TL_OK ? check_here(twin, bytes, archive->at, here, error) : status;
    return status == TL_OK ? tl_exchange_return(exchange, error) : status;
}

tl_status tl_twin_write_states(tl_twin *twin, unsigned char *bytes, size_t capacity, size_t *size, tl_read_back *here,
                               tl_error *error) {
    tl_archive archive = tl_archive_saving(bytes, capacity);
    *size = 0;
    if (twin->ended != TL_OK || twin->exchange.plant.newest < twin->begin || !tl_exchange_can_take(&twin->exchange)) {
        return TL_OK;
    }
    tl_status status = write_all(twin, &archive, bytes, here, error);
    if (status != TL_OK) {
        tl_error ignored;
        twin->ended = status == TL_FMU_FATAL ? status : tl_exchange_return(&twin->exchange, &ignored);
        return status;
    }
    *size = archive.at;
    return TL_OK;
}

/* ---- reader ---- */

tl_status tl_twin_prepare_reader(tl_twin *twin, tl_error *error) {
    tl_plant *plant = &twin->exchange.plant;
    tl_sample nothing = {.tick = 0};
    memset(nothing.quality, TL_NO_LINK, sizeof nothing.quality);
    while (plant->newest < twin->begin) {
        nothing.tick = plant->newest + 1;
        tl_plant_push(plant, &nothing);
    }
    tl_status status =
        tl_twin_start(twin, tl_plant_sample(plant, tl_plant_shown(plant, twin->first, plant->newest)), error);
    tl_proof_end(&twin->proof);
    return status;
}

void tl_twin_read_state(tl_twin *twin, const unsigned char *bytes, size_t size, size_t component, tl_read_back *read) {
    tl_component *one = &twin->exchange.components[component];
    fmi2FMUstate state = NULL;
    saved_part saved = {.state = NULL};
    *read = (tl_read_back){.outcome = TL_READ_BACK_EXACT};
    tl_status status = TL_OK;
    if (!tl_component_can_serialize(one) || !find_part(twin, bytes, size, component, &saved)) {
        status = tl_fail(&read->error, TL_BAD_DATA,
                         "%s: its serialised state is missing, or cannot be loaded in this process", one->name);
    }
    status = status == TL_OK
                 ? tl_component_deserialize(one, saved.state, (size_t)saved.head.state, &state, &read->error)
                 : status;
    status = status == TL_OK ? tl_component_restore(one, state, &read->error) : status;
    if (status != TL_OK) {
        read->outcome = TL_READ_BACK_REFUSED;
    } else {
        repeat_steps(twin, component, &saved, read);
    }
    tl_component_forget(one, &state);
}
