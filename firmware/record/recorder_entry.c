/* Packing and unpacking of entries. What put appends and take reads must agree field by field. */
#include "firmware/record/recorder_entry.h"

#include <string.h>

/* The fields of a tl_record before its arrays. */
typedef struct step_head {
    int64_t step;
    tl_time used;
    double objective;
    double objective_nominal;
    uint32_t evaluations;
    uint32_t executions;
    uint32_t predicted;
    uint32_t flags;
    uint32_t held;
    uint8_t outcome;
    uint8_t stop;
    uint8_t unused[2]; /* so that no byte of it is indeterminate */
} step_head;

size_t tl_recorder_entry_size(const tl_recorder_shape *shape, tl_recorder_kind kind) {
    switch (kind) {
    case TL_ENTRY_START:
        return 1 + sizeof(tl_resumption);
    case TL_ENTRY_SAMPLE:
        return 1 + sizeof(int64_t) + shape->plant * (sizeof(double) + sizeof(tl_time) + 1);
    case TL_ENTRY_STEP:
        return 1 + sizeof(step_head) + shape->match * (2 * sizeof(double) + 1) + shape->adjust * 2 * sizeof(double) +
               shape->components * sizeof(tl_recorder_component);
    }
    return 0;
}

/* Room for the entry, and its first byte. */
static bool begin_entry(tl_recorder_ring *ring, const tl_recorder_shape *shape, tl_recorder_kind kind) {
    unsigned char byte = (unsigned char)kind;
    if (!tl_recorder_ring_has_room(ring, tl_recorder_entry_size(shape, kind))) {
        return false;
    }
    tl_recorder_ring_append(ring, &byte, 1);
    return true;
}

bool tl_recorder_entry_put_start(tl_recorder_ring *ring, const tl_recorder_shape *shape,
                                 const tl_resumption *beginning) {
    if (!begin_entry(ring, shape, TL_ENTRY_START)) {
        return false;
    }
    tl_recorder_ring_append(ring, beginning, sizeof *beginning);
    tl_recorder_ring_publish(ring);
    return true;
}

bool tl_recorder_entry_put_sample(tl_recorder_ring *ring, const tl_recorder_shape *shape, const tl_sample *sample,
                                  tl_time start) {
    if (!begin_entry(ring, shape, TL_ENTRY_SAMPLE)) {
        return false;
    }
    tl_recorder_ring_append(ring, &sample->tick, sizeof sample->tick);
    tl_recorder_ring_append(ring, sample->values, shape->plant * sizeof(double));
    for (size_t i = 0; i < shape->plant; i++) {
        tl_time stamp = sample->stamps[i] == TL_TIME_NEVER ? TL_TIME_NEVER : sample->stamps[i] - start;
        tl_recorder_ring_append(ring, &stamp, sizeof stamp);
    }
    tl_recorder_ring_append(ring, sample->quality, shape->plant);
    tl_recorder_ring_publish(ring);
    return true;
}

bool tl_recorder_entry_put_step(tl_recorder_ring *ring, const tl_recorder_shape *shape, const tl_record *record,
                                const tl_recorder_component *ledger) {
    step_head head = {.step = record->step,
                      .used = record->used,
                      .objective = record->objective,
                      .objective_nominal = record->objective_nominal,
                      .evaluations = record->evaluations,
                      .executions = record->executions,
                      .predicted = record->predicted,
                      .flags = record->flags,
                      .held = record->held,
                      .outcome = (uint8_t)record->outcome,
                      .stop = (uint8_t)record->stop};
    if (!begin_entry(ring, shape, TL_ENTRY_STEP)) {
        return false;
    }
    tl_recorder_ring_append(ring, &head, sizeof head);
    tl_recorder_ring_append(ring, record->y, shape->match * sizeof(double));
    tl_recorder_ring_append(ring, record->y_hat, shape->match * sizeof(double));
    tl_recorder_ring_append(ring, record->y_hat_quality, shape->match);
    tl_recorder_ring_append(ring, record->u, shape->adjust * sizeof(double));
    tl_recorder_ring_append(ring, record->u_hat, shape->adjust * sizeof(double));
    tl_recorder_ring_append(ring, ledger, shape->components * sizeof *ledger);
    tl_recorder_ring_publish(ring);
    return true;
}

static void take_sample(const tl_recorder_ring *ring, const tl_recorder_shape *shape, size_t *cursor,
                        tl_sample *sample) {
    tl_recorder_ring_read(ring, cursor, &sample->tick, sizeof sample->tick);
    tl_recorder_ring_read(ring, cursor, sample->values, shape->plant * sizeof(double));
    tl_recorder_ring_read(ring, cursor, sample->stamps, shape->plant * sizeof(tl_time));
    tl_recorder_ring_read(ring, cursor, sample->quality, shape->plant);
}

static void take_step(const tl_recorder_ring *ring, const tl_recorder_shape *shape, size_t *cursor, tl_record *record) {
    step_head head;
    tl_recorder_ring_read(ring, cursor, &head, sizeof head);
    record->step = head.step;
    record->outcome = (tl_outcome)head.outcome;
    record->stop = (tl_stop)head.stop;
    record->objective = head.objective;
    record->objective_nominal = head.objective_nominal;
    record->evaluations = head.evaluations;
    record->executions = head.executions;
    record->predicted = head.predicted;
    record->flags = head.flags;
    record->held = head.held;
    record->used = head.used;
    tl_recorder_ring_read(ring, cursor, record->y, shape->match * sizeof(double));
    tl_recorder_ring_read(ring, cursor, record->y_hat, shape->match * sizeof(double));
    tl_recorder_ring_read(ring, cursor, record->y_hat_quality, shape->match);
    tl_recorder_ring_read(ring, cursor, record->u, shape->adjust * sizeof(double));
    tl_recorder_ring_read(ring, cursor, record->u_hat, shape->adjust * sizeof(double));
}

void tl_recorder_entry_take(const tl_recorder_ring *ring, const tl_recorder_shape *shape, size_t *cursor,
                            tl_recorder_entry *entry) {
    unsigned char byte = 0;
    tl_recorder_ring_read(ring, cursor, &byte, 1);
    entry->kind = (tl_recorder_kind)byte;
    switch (entry->kind) {
    case TL_ENTRY_START:
        tl_recorder_ring_read(ring, cursor, &entry->beginning, sizeof entry->beginning);
        break;
    case TL_ENTRY_SAMPLE:
        take_sample(ring, shape, cursor, &entry->sample);
        break;
    case TL_ENTRY_STEP:
        take_step(ring, shape, cursor, &entry->record);
        tl_recorder_ring_read(ring, cursor, entry->ledger, shape->components * sizeof *entry->ledger);
        break;
    }
}
