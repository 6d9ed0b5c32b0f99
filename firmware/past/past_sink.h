/* A sink: where what is followed goes, so that it is the new run's as well.
 *
 * Purpose: who leads a twin along (past_follow.h) need not know whether a recorder is in this process or reads an outbox.
 * Waiting: nobody is late while a twin goes on, so room is waited for, for two seconds in all; what finds none after that is lost.
 * Owner:   a sink is plain, is used right after it was made, and points to what it was made of.
 * Thread:  that of the FMUs.
 */
#ifndef TL_FIRMWARE_PAST_PAST_SINK_H
#define TL_FIRMWARE_PAST_PAST_SINK_H

#include <stddef.h>
#include <stdint.h>

#include "firmware/outbox/outbox.h"
#include "firmware/outbox/run_types.h"
#include "firmware/record/recorder.h"
#include "firmware/twin/assembly.h"
#include "master/base/signal.h"
#include "master/base/simtime.h"
#include "master/twin/twin.h"

typedef struct tl_past_sink tl_past_sink;

struct tl_past_sink {
    void (*begin)(const tl_past_sink *sink, const tl_resumption *resumption);
    /* The checkpoint that the run begins with. It may be left out. */
    void (*keep)(const tl_past_sink *sink, int64_t tick, const unsigned char *bytes, size_t size);
    /* Until a sample and a step have room. */
    void (*wait)(const tl_past_sink *sink);
    void (*put_sample)(const tl_past_sink *sink, const tl_sample *sample);
    void (*put_step)(const tl_past_sink *sink, const tl_record *record, const tl_recorder_component *ledger);
    void *place; /* where it goes */
    const tl_assembly *assembly;
    tl_time until; /* CLOCK_MONOTONIC: nobody waits for longer */
};

/* Its run has not begun. Its puts wait from then on until tl_recorder_go_live(). */
tl_past_sink tl_past_sink_of_recorder(tl_recorder *recorder);

/* The run's account is that of the assembly's twin when it begins. */
tl_past_sink tl_past_sink_of_outbox(tl_outbox *outbox, const tl_assembly *assembly);

#endif
