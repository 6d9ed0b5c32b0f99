/* Ticks and results, packed: see twin_pack.h. */
#include "firmware/twin/twin_pack.h"

#include <assert.h>
#include <string.h>

enum { WORD = sizeof(uint64_t) };

/* How a tick's step comes about; bits. */
enum { MADE_UP = 1, CUT_SHORT = 2, WITHOUT_NOMINAL = 4, FOLLOWED = 8, RESETS = 16 };

/* What is of one size in every tick. */
typedef struct tick_head {
    int64_t tick;
    tl_time instant;
    uint64_t executions;
    uint32_t evaluations;
    uint32_t how;
} tick_head;

/* What is of one size in every result. */
typedef struct result_head {
    int64_t tick;
    int32_t status;
    uint32_t ready;
    int64_t step;
    tl_time used;
    tl_time delay;
    double objective;
    double objective_nominal;
    uint32_t outcome;
    uint32_t stop;
    uint32_t evaluations;
    uint32_t executions;
    uint32_t predicted;
    uint32_t flags;
    uint32_t held;
    uint32_t delay_state;
} result_head;

/* Arrays are short, mostly of one or two: a loop takes less than a call. Each element is of eight bytes. */
static inline unsigned char *put_words(unsigned char *place, const void *from, size_t count) {
    for (size_t i = 0; i < count; i++) {
        memcpy(place + i * WORD, (const unsigned char *)from + i * WORD, WORD);
    }
    return place + count * WORD;
}

static inline const unsigned char *get_words(const unsigned char *place, void *to, size_t count) {
    for (size_t i = 0; i < count; i++) {
        memcpy((unsigned char *)to + i * WORD, place + i * WORD, WORD);
    }
    return place + count * WORD;
}

static inline void put_bytes(unsigned char *place, const uint8_t *from, size_t count) {
    for (size_t i = 0; i < count; i++) {
        place[i] = from[i];
    }
}

static inline void get_bytes(const unsigned char *place, uint8_t *to, size_t count) {
    for (size_t i = 0; i < count; i++) {
        to[i] = place[i];
    }
}

/* ---- ticks ---- */

size_t tl_twin_packed_tick_size(const tl_config *config) {
    return sizeof(tick_head) + config->signal_count * (sizeof(double) + sizeof(tl_time) + sizeof(uint8_t)) +
           config->adjust_count * sizeof(double);
}

void tl_twin_pack_tick(const tl_config *config, const tl_recording_tick *tick, unsigned char *bytes) {
    const tl_sample *sample = &tick->sample;
    const tick_head head = {
        .tick = sample->tick,
        .instant = sample->instant,
        .executions = tick->executions,
        .evaluations = tick->evaluations,
        .how = (tick->made_up ? MADE_UP : 0U) | (tick->cut_short ? CUT_SHORT : 0U) |
               (tick->without_nominal ? WITHOUT_NOMINAL : 0U) | (tick->followed ? FOLLOWED : 0U) |
               (tick->resets ? RESETS : 0U),
    };
    memcpy(bytes, &head, sizeof head);
    bytes += sizeof head;
    bytes = put_words(bytes, sample->values, config->signal_count);
    bytes = put_words(bytes, sample->stamps, config->signal_count);
    bytes = put_words(bytes, tick->u, config->adjust_count);
    put_bytes(bytes, sample->quality, config->signal_count);
}

void tl_twin_unpack_tick(const tl_config *config, const unsigned char *bytes, tl_recording_tick *tick) {
    tl_sample *sample = &tick->sample;
    tick_head head;
    memcpy(&head, bytes, sizeof head);
    bytes += sizeof head;
    bytes = get_words(bytes, sample->values, config->signal_count);
    bytes = get_words(bytes, sample->stamps, config->signal_count);
    bytes = get_words(bytes, tick->u, config->adjust_count);
    get_bytes(bytes, sample->quality, config->signal_count);
    sample->tick = head.tick;
    sample->instant = head.instant;
    tick->executions = head.executions;
    tick->evaluations = head.evaluations;
    tick->made_up = (head.how & MADE_UP) != 0;
    tick->cut_short = (head.how & CUT_SHORT) != 0;
    tick->without_nominal = (head.how & WITHOUT_NOMINAL) != 0;
    tick->followed = (head.how & FOLLOWED) != 0;
    tick->resets = (head.how & RESETS) != 0;
}

/* ---- results ---- */

static size_t besides_size(const tl_config *config, tl_twin_tells tells) {
    switch (tells) {
    case TL_TELLS_RECORDS:
        break;
    case TL_TELLS_COUNTS:
        return (config->component_count + 1) * sizeof(tl_recorder_component);
    case TL_TELLS_OUTPUTS:
        return config->emulated_count * sizeof(double);
    }
    return 0;
}

size_t tl_twin_packed_result_size(const tl_config *config, tl_twin_tells tells) {
    size_t each = 2 * sizeof(double) + sizeof(tl_record_readings) + sizeof(uint8_t);
    size_t size = sizeof(result_head) + config->match_count * each + config->adjust_count * 2 * sizeof(double) +
                  besides_size(config, tells);
    assert(size <= TL_TWIN_PACKED);
    return size;
}

void tl_twin_pack_result(const tl_config *config, tl_twin_tells tells, const tl_twin_result *result,
                         unsigned char *bytes) {
    const tl_record *record = &result->record;
    const result_head head = {
        .tick = result->tick,
        .status = result->status,
        .ready = result->ready,
        .step = record->step,
        .used = record->used,
        .delay = record->delay,
        .objective = record->objective,
        .objective_nominal = record->objective_nominal,
        .outcome = record->outcome,
        .stop = record->stop,
        .evaluations = record->evaluations,
        .executions = record->executions,
        .predicted = record->predicted,
        .flags = record->flags,
        .held = record->held,
        .delay_state = record->delay_state,
    };
    memcpy(bytes, &head, sizeof head);
    bytes += sizeof head;
    bytes = put_words(bytes, record->y, config->match_count);
    bytes = put_words(bytes, record->y_hat, config->match_count);
    bytes = put_words(bytes, record->u, config->adjust_count);
    bytes = put_words(bytes, record->u_hat, config->adjust_count);
    bytes = put_words(bytes, record->readings, config->match_count * (sizeof record->readings[0] / WORD));
    bytes = put_words(bytes, &result->besides, besides_size(config, tells) / WORD);
    put_bytes(bytes, record->y_hat_quality, config->match_count);
}

void tl_twin_unpack_result(const tl_config *config, tl_twin_tells tells, const unsigned char *bytes,
                           tl_twin_result *result) {
    tl_record *record = &result->record;
    result_head head;
    memcpy(&head, bytes, sizeof head);
    bytes += sizeof head;
    bytes = get_words(bytes, record->y, config->match_count);
    bytes = get_words(bytes, record->y_hat, config->match_count);
    bytes = get_words(bytes, record->u, config->adjust_count);
    bytes = get_words(bytes, record->u_hat, config->adjust_count);
    bytes = get_words(bytes, record->readings, config->match_count * (sizeof record->readings[0] / WORD));
    bytes = get_words(bytes, &result->besides, besides_size(config, tells) / WORD);
    get_bytes(bytes, record->y_hat_quality, config->match_count);
    result->tick = head.tick;
    result->status = head.status;
    result->ready = head.ready;
    record->step = head.step;
    record->used = head.used;
    record->delay = head.delay;
    record->objective = head.objective;
    record->objective_nominal = head.objective_nominal;
    record->outcome = (tl_outcome)head.outcome;
    record->stop = (tl_stop)head.stop;
    record->evaluations = head.evaluations;
    record->executions = head.executions;
    record->predicted = head.predicted;
    record->flags = head.flags;
    record->held = head.held;
    record->delay_state = (tl_delay_state)head.delay_state;
}
