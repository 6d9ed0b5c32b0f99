/* What an FMU was given last: see fmu_given.h. */
#include "firmware/fmu/fmu_given.h"

#include <stdlib.h>
#include <string.h>

static size_t bytes_of(const tl_ports *ports) {
    return ports->real_count * sizeof(double) + ports->integer_count * sizeof(fmi2Integer) +
           ports->boolean_count * sizeof(fmi2Boolean);
}

static fmi2Integer *integers_in(const tl_ports *ports, double *values) {
    return (fmi2Integer *)(void *)(values + ports->real_count);
}

static fmi2Boolean *booleans_in(const tl_ports *ports, double *values) {
    return integers_in(ports, values) + ports->integer_count; /* the same C type */
}

static void copy(void *to, const void *from, size_t size) {
    if (size != 0) {
        memcpy(to, from, size);
    }
}

bool tl_fmu_given_open(tl_fmu_given *given, const tl_ports *ports) {
    *given = (tl_fmu_given){.ports = ports, .bytes = bytes_of(ports)};
    given->values = malloc(given->bytes + sizeof(double));
    if (given->values == NULL) {
        return false;
    }
    copy(given->values, ports->reals, ports->real_count * sizeof(double));
    copy(integers_in(ports, given->values), ports->integers, ports->integer_count * sizeof(fmi2Integer));
    copy(booleans_in(ports, given->values), ports->booleans, ports->boolean_count * sizeof(fmi2Boolean));
    return true;
}

void tl_fmu_given_close(tl_fmu_given *given) {
    free(given->values);
    *given = (tl_fmu_given){.values = NULL};
}

void tl_fmu_given_note(tl_fmu_given *given, tl_fmu_prologue_kind kind, const fmi2ValueReference *references,
                       const void *values) {
    const tl_ports *ports = given->ports;
    if (kind == TL_PROLOGUE_SET_REAL && references == ports->real_references) {
        copy(given->values, values, ports->real_count * sizeof(double));
    } else if (kind == TL_PROLOGUE_SET_INTEGER && references == ports->integer_references) {
        copy(integers_in(ports, given->values), values, ports->integer_count * sizeof(fmi2Integer));
    } else if (kind == TL_PROLOGUE_SET_BOOLEAN && references == ports->boolean_references) {
        copy(booleans_in(ports, given->values), values, ports->boolean_count * sizeof(fmi2Boolean));
    }
}

tl_fmu_given_state *tl_fmu_given_make_state(const tl_fmu_given *given) {
    tl_fmu_given_state *state = malloc(sizeof *state + given->bytes);
    if (state != NULL) {
        state->own = NULL;
        tl_fmu_given_keep(given, state);
    }
    return state;
}

void tl_fmu_given_keep(const tl_fmu_given *given, tl_fmu_given_state *state) {
    copy(state->values, given->values, given->bytes);
}

fmi2Status tl_fmu_given_give_again(const tl_fmu_given *given, const tl_fmu_given_state *state, const tl_fmi2 *fmi,
                                   fmi2Component instance) {
    const tl_ports *ports = given->ports;
    fmi2Status status = fmi2OK;
    copy(given->values, state->values, given->bytes);
    if (ports->real_count != 0) {
        status = fmi->set_real(instance, ports->real_references, ports->real_count, given->values);
    }
    if (status <= fmi2Warning && ports->integer_count != 0) {
        status = fmi->set_integer(instance, ports->integer_references, ports->integer_count,
                                  integers_in(ports, given->values));
    }
    if (status <= fmi2Warning && ports->boolean_count != 0) {
        status = fmi->set_boolean(instance, ports->boolean_references, ports->boolean_count,
                                  booleans_in(ports, given->values));
    }
    return status;
}
