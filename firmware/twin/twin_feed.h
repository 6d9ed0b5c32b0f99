/* The feed: a recording read ahead, tick by tick, into a twin, and its results in the same order.
 *
 * Purpose: a twin in another process costs little only if neither side waits for the other at each tick. So ticks are given to it
 *          ahead of time, and results are taken as they come.
 * Ends:    where the recording does, at the configured duration, or when it is told to stop. In mode ahead a step is computed only if its
 *          measurement will come, so the last tick only completes the record before it.
 * Thread:  one.
 */
#ifndef TL_FIRMWARE_TWIN_TWIN_FEED_H
#define TL_FIRMWARE_TWIN_TWIN_FEED_H

#include <stdbool.h>

#include "firmware/twin/twin_child.h"
#include "firmware/twin/twin_step.h"
#include "master/twin/account.h"

typedef struct tl_twin_feed tl_twin_feed;

typedef struct tl_twin_feed_settings {
    const tl_config *config;
    const tl_account *account; /* of the built twin */
    tl_recording *recording;   /* read by nobody else while it feeds */
    tl_twin_child *child;      /* the twin */
    bool plant;                /* every tick of the recording is a step, whatever the configuration says of an end */
    bool paced;                /* a tick is given when it is wanted, and not before */
} tl_twin_feed_settings;

/* One tick and what came of it; valid until the next one. */
typedef struct tl_twin_fed {
    const tl_recording_tick *tick;
    const tl_twin_result *result;
    bool last; /* no step was computed: its sample only completed the record before */
} tl_twin_fed;

/* Settings are copied; what they point to must outlive the feed. Errors: TL_TRY_AGAIN. */
tl_status tl_twin_feed_open(const tl_twin_feed_settings *settings, tl_twin_feed **feed, tl_error *error);

/* The tick that will be given next, so that a paced feed can wait for its instant; NULL: there is none. */
const tl_recording_tick *tl_twin_feed_look(tl_twin_feed *feed);

/* The next tick with its result; *end: there is none. A status that is not TL_OK is that of the recording, of the step (`fed` is filled then too,
 * and may have a record), or of the process with the twin (it is not); nothing comes after it. */
tl_status tl_twin_feed_next(tl_twin_feed *feed, tl_twin_fed *fed, bool *end, tl_error *error);

/* No further tick is given; what has been computed still comes. */
void tl_twin_feed_stop(tl_twin_feed *feed);

/* The tick after which nothing is computed any more. */
int64_t tl_twin_feed_last_tick(const tl_config *config, const tl_account *account);

/* NULL is allowed. */
void tl_twin_feed_close(tl_twin_feed *feed);

#endif
