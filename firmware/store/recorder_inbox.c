/* The inbox: see recorder_inbox.h. */
#include "firmware/store/recorder_inbox.h"

#include <assert.h>
#include <stdio.h>

#include "firmware/base/os.h"

static const tl_time MEND_PAUSE = TL_SECOND; /* between two looks at an outbox that is damaged */

/* One that is not there has no reader: nothing is in it, and it is never damaged. */
static bool is_there(const tl_recorder_inbox *inbox, size_t outbox) {
    return inbox->outboxes[outbox].memory != NULL;
}

void tl_recorder_inbox_open(tl_recorder_inbox *inbox, const tl_recorder_writer_outbox *outboxes, size_t count,
                            size_t ring) {
    assert(count >= 1 && count <= TL_WRITER_OUTBOXES && ring < count && outboxes[ring].memory != NULL);
    *inbox = (tl_recorder_inbox){.count = count, .ring = ring};
    for (size_t i = 0; i < count; i++) {
        inbox->outboxes[i] = outboxes[i];
        if (is_there(inbox, i)) {
            tl_outbox_reader_open(&outboxes[i].settings, outboxes[i].memory, &inbox->readers[i]);
        }
    }
}

/* ---- The ring ---------------------------------------------------------------------------------------------------- */

uint64_t tl_recorder_inbox_end(tl_recorder_inbox *inbox, uint64_t taken) {
    return tl_outbox_reader_end(&inbox->readers[inbox->ring], taken);
}

void tl_recorder_inbox_leave(tl_recorder_inbox *inbox) {
    tl_outbox_reader_leave(&inbox->readers[inbox->ring]);
}

bool tl_recorder_inbox_is_whole(const tl_recorder_inbox *inbox) {
    return !inbox->readers[inbox->ring].is_ring_broken;
}

bool tl_recorder_inbox_entry(tl_recorder_inbox *inbox, uint64_t *position, uint64_t end, tl_recorder_entry *entry) {
    return tl_outbox_reader_entry(&inbox->readers[inbox->ring], position, end, entry);
}

bool tl_recorder_inbox_checkpoint(tl_recorder_inbox *inbox, const tl_outbox_taken *taken, unsigned char *bytes,
                                  size_t *size, int64_t *tick, uint64_t *number) {
    return tl_outbox_reader_checkpoint(&inbox->readers[inbox->ring], taken->checkpoint, taken->ring, bytes, size, tick,
                                       number);
}

static void reopen(tl_recorder_inbox *inbox, size_t outbox) {
    tl_outbox_reader *reader = &inbox->readers[outbox];
    bool is_left = reader->is_left;
    tl_outbox_reader_open(&inbox->outboxes[outbox].settings, inbox->outboxes[outbox].memory, reader);
    reader->is_left = is_left;
}

uint64_t tl_recorder_inbox_skip(tl_recorder_inbox *inbox, uint64_t taken) {
    uint64_t to = inbox->is_reopened ? tl_outbox_reader_skip(&inbox->readers[inbox->ring], taken) : taken;
    if (to != taken) {
        reopen(inbox, inbox->ring);
    }
    return to;
}

/* ---- Events ------------------------------------------------------------------------------------------------------ */

/* The event of this number, if all entries are written that were put before it; *skip: it is none. */
static bool read_event(tl_recorder_inbox *inbox, size_t outbox, uint64_t number, uint64_t written,
                       tl_recorder_event_entry *event, bool *skip) {
    return is_there(inbox, outbox) && tl_outbox_reader_event(&inbox->readers[outbox], number, event, skip) &&
           (outbox != inbox->ring || *skip || event->position <= written);
}

size_t tl_recorder_inbox_oldest_event(tl_recorder_inbox *inbox, const tl_outbox_taken *taken, uint64_t written,
                                      tl_recorder_event_entry *oldest, bool *skip) {
    size_t found = inbox->count;
    tl_recorder_event_entry event;
    bool skips = false;
    for (size_t i = 0; i < inbox->count; i++) {
        if (read_event(inbox, i, taken[i].events, written, &event, &skips) &&
            (found == inbox->count || skips || event.at <= oldest->at)) {
            found = i;
            *oldest = event;
            *skip = skips;
        }
    }
    return found;
}

size_t tl_recorder_inbox_count_events(tl_recorder_inbox *inbox, const tl_outbox_taken *taken, uint64_t written,
                                      size_t most) {
    tl_recorder_event_entry event;
    size_t events = 0;
    bool skip = false;
    for (size_t i = 0; i < inbox->count; i++) {
        uint64_t number = taken[i].events;
        for (size_t n = 0; n < most && read_event(inbox, i, number, written, &event, &skip); n++) {
            number++;
            events++;
        }
    }
    return events;
}

bool tl_recorder_inbox_has_event_of_ring(tl_recorder_inbox *inbox, const tl_outbox_taken *taken) {
    tl_recorder_event_entry event;
    bool skip = false;
    return read_event(inbox, inbox->ring, taken->events, taken->ring, &event, &skip);
}

uint64_t tl_recorder_inbox_lost(const tl_recorder_inbox *inbox, size_t outbox, uint64_t known) {
    return is_there(inbox, outbox) ? tl_outbox_reader_lost(&inbox->readers[outbox]) : known;
}

/* ---- Damage ------------------------------------------------------------------------------------------------------ */

void tl_recorder_inbox_mend(tl_recorder_inbox *inbox) {
    tl_time now = tl_clock_now(NULL);
    bool again = now - inbox->mended_at >= MEND_PAUSE;
    inbox->mended_at = again ? now : inbox->mended_at;
    inbox->is_reopened = again && !tl_recorder_inbox_is_whole(inbox) && inbox->damaged_at[inbox->ring] != 0;
    for (size_t i = 0; i < inbox->count; i++) {
        bool is_broken = inbox->readers[i].fault[0] != '\0';
        if (is_broken && (again || inbox->damaged_at[i] == 0)) { /* or it was found between two writings */
            reopen(inbox, i);
            inbox->damaged_at[i] = 0;
        } else if (!is_broken && again) {
            inbox->is_told[i] = false;
        }
    }
}

void tl_recorder_inbox_note_damage(tl_recorder_inbox *inbox, tl_time begun) {
    for (size_t i = 0; i < inbox->count; i++) {
        bool is_broken = inbox->readers[i].fault[0] != '\0';
        tl_time since = inbox->damaged_at[i] != 0 ? inbox->damaged_at[i] : begun;
        inbox->damaged_at[i] = is_broken ? since : 0;
    }
}

tl_time tl_recorder_inbox_damage(const tl_recorder_inbox *inbox, size_t outbox) {
    return inbox->damaged_at[outbox];
}

bool tl_recorder_inbox_tell(tl_recorder_inbox *inbox, char *text, size_t size) {
    for (size_t i = 0; i < inbox->count; i++) {
        const char *fault = inbox->readers[i].fault;
        if (fault[0] != '\0' && !inbox->is_told[i]) {
            inbox->is_told[i] = true;
            (void)snprintf(text, size, "the queue of %s was corrupted%s: it %.120s", inbox->outboxes[i].name,
                           i == inbox->ring ? " by the process of the FMUs" : "", fault);
            return true;
        }
    }
    return false;
}
