/* The conditioned readings of one signal: see reading_stream.h. */
#include "firmware/plant/reading_stream.h"

#include <stdlib.h>

struct tl_reading_stream {
    tl_conditioner conditioner;
    const tl_mailbox_slot *from; /* the mailbox that is read; NULL: none yet */
    uint64_t next;               /* its post */
    tl_reading last;             /* that was taken, as it came; its stamp is TL_TIME_NEVER if none was */
    tl_reading shown;            /* see tl_reading_stream_newest() */
    bool has_rejected;
    uint64_t count, smooth_count; /* of these: */
    tl_mailbox out, smooth;
    tl_mailbox_slot slots[];
};

tl_reading_stream *tl_reading_stream_make(const tl_condition *condition, tl_time stale, uint32_t depth) {
    tl_reading_stream *stream = calloc(1, sizeof *stream + 2 * (size_t)depth * sizeof stream->slots[0]);
    if (stream != NULL) {
        tl_conditioner_init(&stream->conditioner, condition, stale);
        stream->last.stamp = TL_TIME_NEVER;
        stream->out = (tl_mailbox){.slots = stream->slots, .count = &stream->count, .depth = depth};
        stream->smooth = (tl_mailbox){.slots = stream->slots + depth, .count = &stream->smooth_count, .depth = depth};
    }
    return stream;
}

void tl_reading_stream_begin(tl_reading_stream *stream) {
    stream->has_rejected = false;
}

bool tl_reading_stream_next(tl_reading_stream *stream, const tl_mailbox *mailbox, tl_time until, tl_reading *reading) {
    if (stream->from != mailbox->slots) {
        stream->from = mailbox->slots;
        stream->next = 0;
    }
    bool any = tl_mailbox_next(mailbox, until, &stream->next, reading);
    for (uint32_t i = 0; any && reading->stamp <= stream->last.stamp; i++) {
        any = i < mailbox->depth && tl_mailbox_next(mailbox, until, &stream->next, reading);
    }
    return any;
}

void tl_reading_stream_put(tl_reading_stream *stream, const tl_reading *reading) {
    tl_conditioned out[TL_CONDITIONER_LEVEL];
    bool is_rejected = false;
    size_t count = tl_conditioner_take(&stream->conditioner, reading, &is_rejected, out);
    for (size_t i = 0; i < count; i++) {
        tl_mailbox_post(&stream->out, &out[i].reading);
        out[i].reading.value = out[i].smooth;
        tl_mailbox_post(&stream->smooth, &out[i].reading);
    }
    stream->last = *reading;
    if (is_rejected || !stream->has_rejected) {
        stream->shown = *reading;
        stream->shown.quality = is_rejected ? TL_OUTLIER : reading->quality;
    }
    stream->has_rejected = stream->has_rejected || is_rejected;
}

const tl_mailbox *tl_reading_stream_out(const tl_reading_stream *stream) {
    return &stream->out;
}

const tl_mailbox *tl_reading_stream_smooth(const tl_reading_stream *stream) {
    return &stream->smooth;
}

tl_time tl_reading_stream_low_pass(const tl_reading_stream *stream) {
    return stream->conditioner.condition.low_pass;
}

bool tl_reading_stream_newest(const tl_reading_stream *stream, tl_reading *reading) {
    *reading = stream->shown;
    return stream->last.stamp != TL_TIME_NEVER;
}
