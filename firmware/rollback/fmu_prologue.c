/* What an FMU was given until its first step: see fmu_prologue.h. */
#include "firmware/rollback/fmu_prologue.h"

#include <stdint.h>
#include <stdlib.h>
#include <string.h>

/* One call; behind it its values, then its references, each to a multiple of 8 bytes. Texts are as many, one behind the other, each with its end. */
typedef struct call_head {
    uint32_t kind;
    uint32_t count;
    uint64_t size; /* bytes of the values */
} call_head;

enum { FIRST_ROOM = 4096, ALIGNED = 8 };

void tl_fmu_prologue_begin(tl_fmu_prologue *prologue) {
    prologue->used = 0;
    prologue->is_cut = false;
}

void tl_fmu_prologue_end(tl_fmu_prologue *prologue) {
    free(prologue->bytes);
    free(prologue->place);
    *prologue = (tl_fmu_prologue){0};
}

static size_t aligned(size_t size) {
    return (size + ALIGNED - 1) / ALIGNED * ALIGNED;
}

static bool make_place(tl_fmu_prologue *prologue, size_t count) {
    if (count <= prologue->most) {
        return true;
    }
    double *place = realloc(prologue->place, count * sizeof *place);
    if (place == NULL) {
        prologue->is_cut = true;
        return false;
    }
    prologue->place = place;
    prologue->most = count;
    return true;
}

static bool make_room(tl_fmu_prologue *prologue, size_t need) {
    if (prologue->room - prologue->used >= need) {
        return true;
    }
    size_t room = 2 * prologue->room + FIRST_ROOM + need;
    unsigned char *bytes = realloc(prologue->bytes, room);
    if (bytes == NULL) {
        prologue->is_cut = true;
        return false;
    }
    prologue->bytes = bytes;
    prologue->room = room;
    return true;
}

static size_t size_of_values(tl_fmu_prologue_kind kind, size_t count, const void *values) {
    switch (kind) {
    case TL_PROLOGUE_SET_REAL:
        return count * sizeof(fmi2Real);
    case TL_PROLOGUE_SET_INTEGER:
        return count * sizeof(fmi2Integer);
    case TL_PROLOGUE_SET_BOOLEAN:
        return count * sizeof(fmi2Boolean);
    case TL_PROLOGUE_SETUP:
        return sizeof(tl_fmu_setup);
    case TL_PROLOGUE_SET_STRING: {
        const fmi2String *texts = values;
        size_t size = 0;
        for (size_t i = 0; i < count; i++) {
            size += strlen(texts[i]) + 1;
        }
        return size;
    }
    case TL_PROLOGUE_GET_REAL:
    case TL_PROLOGUE_GET_INTEGER:
    case TL_PROLOGUE_GET_BOOLEAN:
    case TL_PROLOGUE_ENTER_INITIALIZATION:
    case TL_PROLOGUE_EXIT_INITIALIZATION:
        break;
    }
    return 0;
}

static void put_texts(unsigned char *to, const fmi2String *texts, size_t count) {
    for (size_t i = 0; i < count; i++) {
        size_t size = strlen(texts[i]) + 1;
        memcpy(to, texts[i], size);
        to += size;
    }
}

void tl_fmu_prologue_add(tl_fmu_prologue *prologue, tl_fmu_prologue_kind kind, const fmi2ValueReference *references,
                         size_t count, const void *values) {
    const call_head made = {
        .kind = (uint32_t)kind, .count = (uint32_t)count, .size = size_of_values(kind, count, values)};
    size_t named = references == NULL ? 0 : count * sizeof *references;
    size_t need = sizeof made + aligned((size_t)made.size) + aligned(named);
    if (!make_room(prologue, need) || !make_place(prologue, count)) {
        return;
    }
    unsigned char *at = prologue->bytes + prologue->used;
    memcpy(at, &made, sizeof made);
    at += sizeof made;
    if (kind == TL_PROLOGUE_SET_STRING) {
        put_texts(at, values, count);
    } else if (made.size != 0) {
        memcpy(at, values, (size_t)made.size);
    }
    if (named != 0) {
        memcpy(at + aligned((size_t)made.size), references, named);
    }
    prologue->used += need;
}

/* A call that is played: where its parts are, and a place for what is got. */
typedef struct played {
    tl_fmu_prologue_kind kind;
    size_t count;
    const void *values;
    const fmi2ValueReference *references;
    void *place;
} played;

static fmi2Status set_strings(const played *call, const tl_fmi2 *functions, fmi2Component instance) {
    fmi2String *texts = call->place;
    const char *text = call->values;
    for (size_t i = 0; i < call->count; i++) {
        texts[i] = text;
        text += strlen(text) + 1;
    }
    return functions->set_string(instance, call->references, call->count, texts);
}

static fmi2Status play(const played *call, const tl_fmi2 *functions, fmi2Component instance) {
    const tl_fmu_setup *setup = call->values;
    switch (call->kind) {
    case TL_PROLOGUE_SET_REAL:
        return functions->set_real(instance, call->references, call->count, call->values);
    case TL_PROLOGUE_SET_INTEGER:
        return functions->set_integer(instance, call->references, call->count, call->values);
    case TL_PROLOGUE_SET_BOOLEAN:
        return functions->set_boolean(instance, call->references, call->count, call->values);
    case TL_PROLOGUE_SET_STRING:
        return set_strings(call, functions, instance);
    case TL_PROLOGUE_GET_REAL:
        return functions->get_real(instance, call->references, call->count, call->place);
    case TL_PROLOGUE_GET_INTEGER:
        return functions->get_integer(instance, call->references, call->count, call->place);
    case TL_PROLOGUE_GET_BOOLEAN:
        return functions->get_boolean(instance, call->references, call->count, call->place);
    case TL_PROLOGUE_SETUP:
        return functions->setup_experiment(instance, setup->has_tolerance, setup->tolerance, setup->start,
                                           setup->has_stop, setup->stop);
    case TL_PROLOGUE_ENTER_INITIALIZATION:
        return functions->enter_initialization_mode(instance);
    case TL_PROLOGUE_EXIT_INITIALIZATION:
        return functions->exit_initialization_mode(instance);
    }
    return fmi2Error;
}

/* The next call, from `at` on, which goes behind it. */
static void read_next(const tl_fmu_prologue *prologue, size_t *at, played *next) {
    call_head made;
    const unsigned char *bytes = prologue->bytes + *at;
    memcpy(&made, bytes, sizeof made);
    next->kind = (tl_fmu_prologue_kind)made.kind;
    next->count = made.count;
    next->values = bytes + sizeof made;
    next->references = (const void *)(bytes + sizeof made + aligned((size_t)made.size));
    bool is_of_values = next->kind <= TL_PROLOGUE_GET_BOOLEAN;
    *at +=
        sizeof made + aligned((size_t)made.size) + (is_of_values ? aligned(made.count * sizeof *next->references) : 0);
}

fmi2Status tl_fmu_prologue_play(const tl_fmu_prologue *prologue, const tl_fmi2 *functions, fmi2Component instance) {
    fmi2Status status = prologue->is_cut ? fmi2Error : fmi2OK;
    played next = {.place = prologue->place};
    for (size_t at = 0; at < prologue->used && status <= fmi2Warning;) {
        read_next(prologue, &at, &next);
        status = play(&next, functions, instance);
    }
    return status;
}
