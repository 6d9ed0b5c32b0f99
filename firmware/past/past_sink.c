/* Sinks: see past_sink.h. */
#include "firmware/past/past_sink.h"

#include <string.h>

#include "firmware/base/clock.h"

static const tl_time PATIENCE = 2 * TL_SECOND;

/* ---- a recorder ---- */

static void begin_recorder(const tl_past_sink *sink, const tl_resumption *resumption) {
    tl_recorder_resume(sink->place, resumption);
}

static void keep_in_recorder(const tl_past_sink *sink, int64_t tick, const unsigned char *bytes, size_t size) {
    size_t capacity = 0;
    if (tl_recorder_reserve_checkpoint(sink->place, size)) {
        memcpy(tl_recorder_checkpoint_room(sink->place, &capacity), bytes, size);
        tl_recorder_put_checkpoint(sink->place, tick, size);
    }
}

/* Its puts do. */
static void wait_for_recorder(const tl_past_sink *sink) {
    (void)sink;
}

static void put_sample_to_recorder(const tl_past_sink *sink, const tl_sample *sample) {
    tl_recorder_put_sample(sink->place, sample);
}

static void put_step_to_recorder(const tl_past_sink *sink, const tl_record *record,
                                 const tl_recorder_component *ledger) {
    tl_recorder_put_step(sink->place, record, ledger);
}

tl_past_sink tl_past_sink_of_recorder(tl_recorder *recorder) {
    return (tl_past_sink){
        .begin = begin_recorder,
        .keep = keep_in_recorder,
        .wait = wait_for_recorder,
        .put_sample = put_sample_to_recorder,
        .put_step = put_step_to_recorder,
        .place = recorder,
    };
}

/* ---- an outbox ---- */

static void wait_for_outbox(const tl_past_sink *sink) {
    (void)tl_outbox_wait_for_room(sink->place, sink->until);
}

static void begin_outbox(const tl_past_sink *sink, const tl_resumption *resumption) {
    tl_outbox_start start = {.resumption = *resumption};
    tl_account_take(sink->assembly->twin, &start.account);
    if (!tl_outbox_put_start(sink->place, &start)) {
        wait_for_outbox(sink); /* for its room too: it goes in before the first sample */
    }
}

static void keep_in_outbox(const tl_past_sink *sink, int64_t tick, const unsigned char *bytes, size_t size) {
    size_t capacity = 0;
    if (tl_outbox_reserve_checkpoint(sink->place, size)) {
        memcpy(tl_outbox_checkpoint_room(sink->place, &capacity), bytes, size);
        tl_outbox_put_checkpoint(sink->place, tick, size);
    }
}

static void put_sample_to_outbox(const tl_past_sink *sink, const tl_sample *sample) {
    (void)tl_outbox_put_sample(sink->place, sample); /* what is lost is counted there */
}

static void put_step_to_outbox(const tl_past_sink *sink, const tl_record *record, const tl_recorder_component *ledger) {
    (void)tl_outbox_put_step(sink->place, record, ledger);
}

tl_past_sink tl_past_sink_of_outbox(tl_outbox *outbox, const tl_assembly *assembly) {
    return (tl_past_sink){
        .begin = begin_outbox,
        .keep = keep_in_outbox,
        .wait = wait_for_outbox,
        .put_sample = put_sample_to_outbox,
        .put_step = put_step_to_outbox,
        .place = outbox,
        .assembly = assembly,
        .until = tl_clock_now(NULL) + PATIENCE,
    };
}
