/* Feed: see twin_child.h. */
#include "firmware/twin/twin_child.h"

#include <stdlib.h>

/* Most ticks under way, and size of the ring. The ring also holds the tick that was read ahead and
 * the one that was taken last. */
enum { AHEAD = TL_CHANNEL_DEPTH, HALF = AHEAD / 2, ENTRIES = 2 * AHEAD };

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
    tl_error error;    /* of the recording; returned after the earlier results */
    uint64_t read;     /* ticks read so far */
    uint64_t sent;     /* of these, sent to the twin */
    uint64_t received; /* and returned */
    tl_twin_result result;
    wanted ring[ENTRIES];
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
        feed->read = feed->sent;
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
    wanted *entry = &feed->ring[feed->read % ENTRIES];
    if (!feed->begun) {
        feed->begun = true;
        feed->has_next = read_tick(feed, &entry->tick);
    }
    if (!feed->has_next) {
        feed->ended = true;
        return;
    }
    feed->has_next = read_tick(feed, &feed->ring[(feed->read + 1) % ENTRIES].tick);
    bool beyond = !feed->settings.plant && entry->tick.sample.tick > feed->last_tick;
    if (feed->status != TL_OK) {
        feed->ended = true;
        return;
    }
    entry->last =
        !feed->settings.plant && feed->settings.config->measurements == TL_AHEAD && (!feed->has_next || beyond);
    feed->ended = entry->last || beyond;
    feed->read += entry->last || !beyond ? 1 : 0;
}

const tl_recording_tick *tl_twin_feed_poll(tl_twin_feed *feed) {
    if (feed->read == feed->sent && !feed->ended) {
        want_next(feed);
    }
    return feed->read != feed->sent ? &feed->ring[feed->sent % ENTRIES].tick : NULL;
}

/* ---- sending and taking ---- */

/* Sends as many ticks as may be under way. If the ring is more than half full it sends none, so
 * that neither side wakes the other at each tick. */
static tl_status send_ticks(tl_twin_feed *feed, tl_error *error) {
    uint64_t most = feed->settings.paced ? 1 : AHEAD;
    if (feed->sent - feed->received > HALF) {
        return TL_OK;
    }
    tl_status status = TL_OK;
    while (status == TL_OK && feed->sent - feed->received < most && tl_twin_feed_poll(feed) != NULL) {
        const wanted *entry = &feed->ring[feed->sent % ENTRIES];
        status = tl_twin_child_enqueue(feed->settings.child, &entry->tick, entry->last, error);
        feed->sent += status == TL_OK ? 1 : 0;
    }
    if (status == TL_OK) {
        tl_twin_child_push(feed->settings.child);
    }
    return status;
}

tl_status tl_twin_feed_next(tl_twin_feed *feed, tl_twin_fed *fed, bool *end, tl_error *error) {
    *end = false;
    tl_status status = send_ticks(feed, error);
    if (status != TL_OK) {
        return status;
    }
    if (feed->received == feed->sent) { /* end of the recording, or its error */
        *end = true;
        if (feed->status != TL_OK) {
            *error = feed->error;
        }
        return feed->status;
    }
    const wanted *entry = &feed->ring[feed->received % ENTRIES];
    bool stopped = false;
    feed->result.tick = TL_TWIN_NO_TICK;
    uint64_t results = feed->settings.paced ? 1 : (feed->sent - feed->received + 1) / 2;
    status = tl_twin_child_take(feed->settings.child, entry->tick.sample.tick, (unsigned)results, &feed->result,
                                &stopped, error);
    if (feed->result.tick != TL_TWIN_NO_TICK) {
        *fed = (tl_twin_fed){&entry->tick, &feed->result, entry->last};
    }
    *end = stopped;
    feed->received++;
    return status;
}
