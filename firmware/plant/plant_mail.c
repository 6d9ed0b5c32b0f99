/* The mail: see plant_mail.h. */
#include "firmware/plant/plant_mail.h"

#include <stdlib.h>

/* A count has a cache line of its own, since the threads of different sources write them. */
enum { LINE = 64, COUNTS = TL_MAX_SIGNALS * LINE };

/* Beside hang_s: to notice that the twin is gone, to end it, and to make a new one. */
static const tl_time RESTART = 10 * TL_SECOND;

static const tl_time FINEST = TL_SECOND / 1000;

/* Time between two readings of a signal; one without a live source has none, and gets what a plain source would. */
static tl_time period_of(const tl_config *config, const tl_config_signal *signal) {
    tl_time period = config->step;
    if (signal->source < config->source_count) {
        tl_time configured = tl_time_of_seconds(config->sources[signal->source].period_s);
        period = configured < period ? configured : period;
    }
    return period > FINEST ? period : FINEST;
}

tl_time tl_plant_mail_kept(const tl_config *config) {
    return config->realtime_hang + RESTART;
}

void tl_plant_mail_shape_of(const tl_config *config, tl_plant_mail_shape *shape) {
    *shape = (tl_plant_mail_shape){.signals = config->signal_count};
    for (size_t i = 0; i < config->signal_count; i++) {
        shape->of[i] = config->signals[i].of;
        tl_time readings = tl_plant_mail_kept(config) / period_of(config, &config->signals[i]) + 1;
        uint32_t depth = TL_PLANT_MAIL_LEAST;
        while (depth < readings && depth < TL_PLANT_MAIL_MOST) {
            depth *= 2;
        }
        shape->depth[i] = depth;
    }
}

size_t tl_plant_mail_bytes(const tl_plant_mail_shape *shape) {
    size_t bytes = COUNTS;
    for (size_t i = 0; i < shape->signals; i++) {
        bytes += shape->of[i] == i ? shape->depth[i] * sizeof(tl_mailbox_slot) : 0;
    }
    return bytes;
}

void tl_plant_mail_open(const tl_plant_mail_shape *shape, void *memory, tl_mailbox mailboxes[TL_MAX_SIGNALS]) {
    unsigned char *counts = memory;
    unsigned char *slots = counts + COUNTS;
    for (size_t i = 0; i < shape->signals; i++) {
        if (shape->of[i] != i) {
            mailboxes[i] = mailboxes[shape->of[i]];
            continue;
        }
        mailboxes[i] = (tl_mailbox){
            .slots = (tl_mailbox_slot *)(void *)slots,
            .count = (uint64_t *)(void *)(counts + i * LINE),
            .depth = shape->depth[i],
        };
        slots += shape->depth[i] * sizeof(tl_mailbox_slot);
    }
}

void *tl_plant_mail_make_least(size_t signals, tl_mailbox mailboxes[TL_MAX_SIGNALS]) {
    tl_plant_mail_shape shape = {.signals = signals};
    for (size_t i = 0; i < signals; i++) {
        shape.depth[i] = TL_PLANT_MAIL_LEAST;
        shape.of[i] = i;
    }
    void *memory = calloc(1, tl_plant_mail_bytes(&shape));
    if (memory != NULL) {
        tl_plant_mail_open(&shape, memory, mailboxes);
    }
    return memory;
}
