/* A sink: where what is followed goes, so that it is the new run's as well.
 *
 * Purpose: who leads a twin along (past_follow.h) need not know whether a recorder is in this process or reads an outbox.
 * Waiting: nobody is late while a twin goes on, so a put may wait for room, for PATIENCE in all; then what has none is lost.
 * Owner:   a sink is plain, and points to its recorder.
 * Thread:  that of who puts.
 */
#ifndef TL_FIRMWARE_PAST_PAST_SINK_H
#define TL_FIRMWARE_PAST_PAST_SINK_H

#include <stddef.h>
#include <stdint.h>

#include "firmware/record/recorder.h"
#include "firmware/record/run_types.h"
#include "master/base/signal.h"
#include "master/twin/twin.h"

typedef struct tl_past_sink {
    void *context;
    void (*begin)(void *context, const tl_resumption *resumption);
    /* The checkpoint that the run begins with. It may be left out. */
    void (*keep)(void *context, int64_t tick, const unsigned char *bytes, size_t size);
    /* Until a sample and a step have room. */
    void (*wait)(void *context);
    void (*put_sample)(void *context, const tl_sample *sample);
    void (*put_step)(void *context, const tl_record *record, const tl_recorder_component *ledger);
} tl_past_sink;

/* Its run has not begun. It waits from now on until tl_recorder_go_live(). */
tl_past_sink tl_past_sink_of_recorder(tl_recorder *recorder);

#endif
