/* Feed: see twin_child.h. */
#include "firmware/twin/twin_child.h"

#include <stdlib.h>

/* Most ticks under way, and size of the ring. The ring also holds the tick that was read ahead and
 * the one that was taken last. */
enum { AHEAD = TL_CHANNEL_DEPTH, HALF = AHEAD / 2, PLACES = 2 * AHEAD };

/* A tick that was read. `last`: it only completes the last record. */
typedef struct wanted {
    tl_recording_tick tick;
    bool last;
} wanted;

struct tl_twin_feed {
    tl_twin_feed_settings settings;
    int64_t last_tick;
    bool has_next; /* the ring entry after the wanted ticks holds a tick */
    bool begun;
    bool ended; /* no further ticks */
    tl_status status;
    tl_error error; /* of the recording; returned after the earlier results */
    uint64_t read;  /* ticks read so far */
    uint64_t given; /* of these, sent to the twin */
    uint64_t taken; /* and returned */
    tl_twin_result result;
    wanted ring[PLACES];
};

int64_t tl_twin_feed_last_tick(const tl_config *config, const tl_account *account) {
    return config->duration == 0 ? INT64_MAX : config->duration / config->step + account->lead;
}

tl_status tl_twin_feed_open(const tl_twin_feed_settings *settings, tl_twin_feed **feed, tl_error *error) {
    tl_twin_feed *made = calloc(1, sizeof *made);
    if (made == NULL) {
        return tl_fail(error, TL_TRY_AGAIN, "not enough memory to read the recording ahead");
    }
    made->settings = *settings;
    made->last_tick = tl_twin_feed_last_tick(settings->config, settings->account);
    *feed = made;
    return TL_OK;
}

void tl_twin_feed_close(tl_twin_feed *feed) {
    free(feed);
}

void tl_twin_feed_stop(tl_twin_feed *feed) {
    if (!feed->ended) {
        feed->ended = true;
        feed->read = feed->given;
    }
    tl_twin_child_stop(feed->settings.child);
}

/* ---- reading ---- */

/* Returns false at the end or after an error. */
static bool read_tick(tl_twin_feed *feed, tl_recording_tick *tick) {
    bool end = false;
    feed->status = tl_recording_next(feed->settings.recording, tick, &end, &feed->error);
    return feed->status == TL_OK && !end;
}

/* Reads one tick ahead into the ring: in mode ahead a step is computed only if its measurement will
 * come. */
static void want_next(tl_twin_feed *feed) {
    wanted *place = &feed->ring[feed->read % PLACES];
    if (!feed->begun) {
        feed->begun = true;
        feed->has_next = read_tick(feed, &place->tick);
    }
    if (!feed->has_next) {
        feed->ended = true;
        return;
    }
    feed->has_next = read_tick(feed, &feed->ring[(feed->read + 1) % PLACES].tick);
    bool beyond = !feed->settings.plant && place->tick.sample.tick > feed->last_tick;
    if (feed->status != TL_OK) {
        feed->ended = true;
        return;
    }
    place->last =
        !feed->settings.plant && feed->settings.config->measurements == TL_AHEAD && (!feed->has_next || beyond);
    feed->ended = place->last || beyond;
    feed->read += place->last || !beyond ? 1 : 0;
}

const tl_recording_tick *tl_twin_feed_look(tl_twin_feed *feed) {
    if (feed->read == feed->given && !feed->ended) {
        want_next(feed);
    }
    return feed->read != feed->given ? &feed->ring[feed->given % PLACES].tick : NULL;
}

/* ---- sending and taking ---- */

/* Sends as many ticks as may be under way. If the ring is more than half full it sends none, so
 * that neither side wakes the other at each tick. */
static tl_status give(tl_twin_feed *feed, tl_error *error) {
    uint64_t most = feed->settings.paced ? 1 : AHEAD;
    if (feed->given - feed->taken > HALF) {
        return TL_OK;
    }
    tl_status status = TL_OK;
    while (status == TL_OK && feed->given - feed->taken < most && tl_twin_feed_look(feed) != NULL) {
        const wanted *place = &feed->ring[feed->given % PLACES];
        status = tl_twin_child_give(feed->settings.child, &place->tick, place->last, error);
        feed->given += status == TL_OK ? 1 : 0;
    }
    if (status == TL_OK) {
        tl_twin_child_push(feed->settings.child);
    }
    return status;
}

tl_status tl_twin_feed_next(tl_twin_feed *feed, tl_twin_fed *fed, bool *end, tl_error *error) {
    *end = false;
    tl_status status = give(feed, error);
    if (status != TL_OK) {
        return status;
    }
    if (feed->taken == feed->given) { /* end of the recording, or its error */
        *end = true;
        if (feed->status != TL_OK) {
            *error = feed->error;
        }
        return feed->status;
    }
    const wanted *place = &feed->ring[feed->taken % PLACES];
    bool stopped = false;
    feed->result.tick = TL_TWIN_NO_TICK;
    uint64_t results = feed->settings.paced ? 1 : (feed->given - feed->taken + 1) / 2;
    status = tl_twin_child_take(feed->settings.child, place->tick.sample.tick, (unsigned)results, &feed->result,
                                &stopped, error);
    if (feed->result.tick != TL_TWIN_NO_TICK) {
        *fed = (tl_twin_fed){&place->tick, &feed->result, place->last};
    }
    *end = stopped;
    feed->taken++;
    return status;
}
