/* Last inputs of an FMU, see last_inputs.h. */
#include "firmware/fmu/last_inputs.h"

#include <stdlib.h>
#include <string.h>

static fmi2Integer *integers_in(const tl_ports *ports, double *values) {
    return (fmi2Integer *)(void *)(values + ports->real_count);
}

static fmi2Boolean *booleans_in(const tl_ports *ports, double *values) {
    return integers_in(ports, values) + ports->integer_count; /* fmi2Boolean is the same C type */
}

tl_last_inputs *tl_last_inputs_open(const tl_ports *ports) {
    size_t bytes = tl_ports_size(ports);
    tl_last_inputs *last_inputs = malloc(sizeof *last_inputs + bytes);
    if (last_inputs != NULL) {
        *last_inputs = (tl_last_inputs){.ports = ports, .bytes = bytes};
        tl_ports_read(ports, (unsigned char *)last_inputs->values);
    }
    return last_inputs;
}

void tl_last_inputs_note(tl_last_inputs *last_inputs, tl_fmu_prologue_kind kind, const fmi2ValueReference *references,
                         const void *values) {
    const tl_ports *ports = last_inputs->ports;
    if (kind == TL_PROLOGUE_SET_REAL && references == ports->real_references) {
        memcpy(last_inputs->values, values, ports->real_count * sizeof(double));
    } else if (kind == TL_PROLOGUE_SET_INTEGER && references == ports->integer_references) {
        memcpy(integers_in(ports, last_inputs->values), values, ports->integer_count * sizeof(fmi2Integer));
    } else if (kind == TL_PROLOGUE_SET_BOOLEAN && references == ports->boolean_references) {
        memcpy(booleans_in(ports, last_inputs->values), values, ports->boolean_count * sizeof(fmi2Boolean));
    }
}

tl_last_inputs_state *tl_last_inputs_save(const tl_last_inputs *last_inputs, tl_last_inputs_state *state) {
    tl_last_inputs_state *kept = state != NULL ? state : malloc(sizeof *state + last_inputs->bytes);
    if (kept == NULL) {
        return NULL;
    }
    kept->own = state != NULL ? state->own : NULL;
    memcpy(kept->values, last_inputs->values, last_inputs->bytes);
    return kept;
}

fmi2Status tl_last_inputs_restore(tl_last_inputs *last_inputs, const tl_last_inputs_state *state, const tl_fmi2 *fmi,
                                  fmi2Component instance) {
    const tl_ports *ports = last_inputs->ports;
    fmi2Status status = fmi2OK;
    memcpy(last_inputs->values, state->values, last_inputs->bytes);
    if (ports->real_count != 0) {
        status = fmi->set_real(instance, ports->real_references, ports->real_count, last_inputs->values);
    }
    if (status <= fmi2Warning && ports->integer_count != 0) {
        status = fmi->set_integer(instance, ports->integer_references, ports->integer_count,
                                  integers_in(ports, last_inputs->values));
    }
    if (status <= fmi2Warning && ports->boolean_count != 0) {
        status = fmi->set_boolean(instance, ports->boolean_references, ports->boolean_count,
                                  booleans_in(ports, last_inputs->values));
    }
    return status;
}
