/* Sinks: see past_sink.h. */
#include "firmware/past/past_sink.h"

#include <string.h>

/* ---- a recorder ---- */

static void begin_recorder(void *context, const tl_resumption *resumption) {
    tl_recorder_resume(context, resumption);
}

static void keep_in_recorder(void *context, int64_t tick, const unsigned char *bytes, size_t size) {
    size_t capacity = 0;
    if (tl_recorder_reserve_checkpoint(context, size)) {
        memcpy(tl_recorder_checkpoint_room(context, &capacity), bytes, size);
        tl_recorder_put_checkpoint(context, tick, size);
    }
}

/* Its puts do. */
static void wait_for_recorder(void *context) {
    (void)context;
}

static void put_sample_to_recorder(void *context, const tl_sample *sample) {
    tl_recorder_put_sample(context, sample);
}

static void put_step_to_recorder(void *context, const tl_record *record, const tl_recorder_component *ledger) {
    tl_recorder_put_step(context, record, ledger);
}

tl_past_sink tl_past_sink_of_recorder(tl_recorder *recorder) {
    return (tl_past_sink){
        .context = recorder,
        .begin = begin_recorder,
        .keep = keep_in_recorder,
        .wait = wait_for_recorder,
        .put_sample = put_sample_to_recorder,
        .put_step = put_step_to_recorder,
    };
}
