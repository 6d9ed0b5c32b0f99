/* The checkpointer: saves the running twin now and then, so that a restart has little to run again.
 *
 * Purpose: after a tick, in the cycle's own thread, where the budget has time for it; the bytes go to the recorder without
 *          waiting.
 * When:    after the first tick, which also measures what it costs; from then on every 10 s of plant time, or 2000 ticks where
 *          that is less. Where a checkpoint does not fit into the budget, or an FMU cannot be turned into bytes, an event
 *          says so, once; a restart then runs the recorded inputs again.
 * Thread:  the cycle's. Memory: taken after the first tick.
 */
#ifndef TL_FIRMWARE_RUN_CHECKPOINTER_H
#define TL_FIRMWARE_RUN_CHECKPOINTER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "firmware/record/recorder.h"
#include "firmware/run/journal.h"
#include "firmware/twin/assembly.h"

typedef struct tl_checkpointer {
    tl_twin *twin;
    tl_recorder *recorder;
    tl_journal *journal;
    int64_t interval; /* ticks */
    int64_t next;     /* tick after which one is due */
    tl_time cost;     /* ns, as measured last */
    bool is_ready;    /* there is room, and its cost is known */
    bool is_off;
    bool has_told;
} tl_checkpointer;

/* `recorder` may be NULL: nothing is saved then. */
void tl_checkpointer_init(tl_checkpointer *self, const tl_assembly *assembly, tl_recorder *recorder,
                          tl_journal *journal);

/* After a tick that was computed within `budget`; NULL: it was made up, and there is no time for anything else. */
void tl_checkpointer_after(tl_checkpointer *self, int64_t tick, const tl_budget *budget);

#endif
