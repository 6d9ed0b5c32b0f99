/* Writer: reads record queues and writes their entries in batches: see recorder_writer.h.
 *
 * Batch:   built in `next`, a copy of the committed mark. Each written entry advances the
 *          positions, totals and run in `next`. When the transaction is committed, `next` becomes
 *          the mark; if it fails, `next` is discarded. A batch contains one run only.
 * Order:   the writer's own events, then entries, then the events that were put before the last of
 *          these entries.
 * Samples: come through the ring, because a replay must use exactly what the twin has read. A
 *          sample that is missing in the ring is made from io's readings: before a later sample, at
 *          the end of the run, or before io overwrites its readings. If the sample arrives later,
 *          it replaces that one.
 * Runs:    entries before the first START belong to no run and are dropped.
 * Handover: an END with the reason `hand_over` means that a run of another ring follows. The
 *           entries behind it belong to a run after that, and are read only after that run. If no
 *           process may continue, they are never read. If the reason was announced without cause,
 *           `continues` returns true.
 */
#include "firmware/store/recorder_writer.h"

#include <assert.h>
#include <inttypes.h>
#include <sqlite3.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "firmware/base/os.h"
#include "firmware/base/text.h"
#include "firmware/store/database.h"
#include "firmware/store/recorder_entry.h"
#include "firmware/store/recorder_file.h"

enum {
    EVENT_BYTES = 256,        /* size of an event for the batch limit */
    MENDS = 3,                /* replacements of the file in one call */
    STALLS = 8,               /* batches without ring entries: endless events must not block */
    REFUSED_TO_OPEN = 1 << 16 /* added to a fault, beside SQLite's codes: no file could be opened */
};

static const tl_time MEND_PAUSE = TL_SECOND;       /* between two checks of a damaged queue */
static const tl_time LOSS_PAUSE = 10 * TL_SECOND;  /* between two reports of losses by a slow disk */
static const tl_time CLOSE_PAUSE = TL_SECOND / 20; /* between two tries during closing */

/* A record queue and its reader. An absent queue has no reader: it is empty and never damaged. */
typedef struct source {
    tl_recorder_writer_queue queue;
    tl_record_queue_reader reader;
    bool is_reported;   /* damage was reported */
    tl_time damaged_at; /* not before this time; 0: not damaged */
} source;

struct tl_recorder_writer {
    tl_recorder_writer_settings settings;
    tl_recorder_settings record;
    tl_recorder_writer_state *state;
    tl_recorder_file file;
    source sources[TL_WRITER_QUEUES];
    tl_time mended_at;         /* time of the last check of damaged queues */
    bool is_reopened;          /* the ring was reopened because it was damaged */
    unsigned char *checkpoint; /* copy of a checkpoint of the queue with the ring; NULL: it has none */
    int refusal;               /* kind of the last failure; 0: writing works */
    tl_time lost_said_at;
    bool was_corrupted; /* a queue, since the last reported loss */
    /* of the batch: */
    tl_recorder_mark next;
    tl_recorder_entry entry; /* too large for a small stack */
    bool is_over;            /* the next entry belongs to another batch */
    bool ends;               /* the run ends with this batch */
    bool is_behind_end;      /* the batch stores changes of a run that has ended, and keeps its last instant */
    bool is_stray;           /* the newest sample was of a run whose beginning was not read */
    bool is_last;            /* the producer of samples has ended */
    /* of the observer: */
    tl_record_queue_reader observer; /* of the ring; it reads ahead of the writer */
    uint64_t observed;               /* end of what was observed */
    uint64_t observed_end;           /* end of a run that hands over; the rest waits until it is written */
    bool is_observing;               /* the observer knows the run */
};

static const tl_recorder_mark *mark_of(const tl_recorder_writer *writer) {
    return tl_recorder_state_mark(writer->state);
}

static tl_record_queue_reader *ring_of(tl_recorder_writer *writer) {
    return &writer->sources[writer->settings.ring].reader;
}

static const tl_record_queue_settings *settings_of_ring(const tl_recorder_writer *writer) {
    return &writer->sources[writer->settings.ring].queue.settings;
}

/* Progress in the queue with the ring: of the batch, and of the last commit. */
static tl_record_queue_taken *taken_of(tl_recorder_writer *writer) {
    return &writer->next.taken[writer->settings.ring];
}

static uint64_t taken_of_ring(const tl_recorder_writer *writer) {
    return mark_of(writer)->taken[writer->settings.ring].ring;
}

static bool take_entry(tl_recorder_writer *writer, uint64_t *position, uint64_t end) {
    return tl_record_queue_reader_entry(ring_of(writer), position, end, &writer->entry);
}

const char *tl_recorder_writer_path(const tl_recorder_writer *writer) {
    return tl_recorder_file_path(&writer->file);
}

/* ---- Reports ---- */

static const char *why_lost(const tl_recorder_writer *writer) {
    return writer->was_corrupted || mark_of(writer)->is_cut ? "their queue was corrupted"
                                                            : "they came faster than the recorder could write them";
}

static void report_loss(tl_recorder_writer *writer, const char *why) {
    char text[TL_EVENT_TEXT];
    uint64_t lost = mark_of(writer)->totals.lost;
    if (lost > writer->file.lost_said) {
        uint64_t more = lost - writer->file.lost_said;
        (void)snprintf(text, sizeof text, "%" PRIu64 " %s lost: %s", more,
                       more == 1 ? "sample, step or event was" : "samples, steps or events were", why);
        writer->lost_said_at = tl_clock_now(NULL);
        writer->was_corrupted = false;
        tl_recorder_file_report_event(&writer->file, TL_EVENT_WARNING, text);
    }
    writer->file.lost_said = lost;
}

/* Reports a failure only once while its kind is the same. */
static void report_refusal(tl_recorder_writer *writer, int kind) {
    char text[TL_EVENT_TEXT];
    if (writer->refusal == 0) {
        __atomic_store_n(&writer->state->refused_since, tl_clock_now(NULL), __ATOMIC_RELAXED);
    }
    if (writer->refusal != kind) {
        (void)snprintf(text, sizeof text, "cannot write: %.160s; trying again", writer->file.reason);
        tl_recorder_file_report_event(&writer->file, TL_EVENT_ERROR, text);
    }
    writer->refusal = kind;
}

static void report_open_failure(tl_recorder_writer *writer) {
    tl_recorder_file *file = &writer->file;
    (void)snprintf(file->reason, sizeof file->reason, "%.180s", file->failure.text);
    report_refusal(writer, REFUSED_TO_OPEN + (int)tl_database_get_fault());
}

static void report_success(tl_recorder_writer *writer) {
    char text[TL_EVENT_TEXT];
    if (writer->refusal != 0) {
        tl_time pause = tl_clock_now(NULL) - writer->state->refused_since;
        writer->refusal = 0;
        __atomic_store_n(&writer->state->refused_since, 0, __ATOMIC_RELAXED);
        (void)snprintf(text, sizeof text, "writes again after %.1f s", tl_seconds(pause));
        tl_recorder_file_report_event(&writer->file, TL_EVENT_INFO, text);
        report_loss(writer, "the database could not be written");
    } else if (tl_clock_now(NULL) - writer->lost_said_at >= LOSS_PAUSE) {
        report_loss(writer, why_lost(writer));
    }
}

/* ---- Events of the record queues ---- */

/* Reads the event of this number if all entries that were put before it are written; *skip: it was
 * left incomplete. */
static bool read_event(tl_recorder_writer *writer, size_t queue, uint64_t number, uint64_t written,
                       tl_recorder_event_entry *event, bool *skip) {
    source *from = &writer->sources[queue];
    return from->queue.memory != NULL && tl_record_queue_reader_event(&from->reader, number, event, skip) &&
           (queue != writer->settings.ring || *skip || event->position <= written);
}

/* Finds the oldest event that may be written when the ring is written up to `written`. Of events of
 * the same time, the later queue's event is first, because an event of io is often the cause of the
 * twin's event. Returns the index of the queue, or the number of queues if there is no event. */
static size_t find_oldest_event(tl_recorder_writer *writer, uint64_t written, tl_recorder_event_entry *oldest,
                                bool *skip) {
    size_t found = writer->settings.queue_count;
    tl_recorder_event_entry event;
    bool skips = false;
    for (size_t i = 0; i < writer->settings.queue_count; i++) {
        if (read_event(writer, i, writer->next.taken[i].events, written, &event, &skips) &&
            (found == writer->settings.queue_count || skips || event.at <= oldest->at)) {
            found = i;
            *oldest = event;
            *skip = skips;
        }
    }
    return found;
}

/* Counts the events that can be written when the ring is written up to `written`, at most `most` of
 * each queue. */
static size_t count_events(tl_recorder_writer *writer, uint64_t written, size_t most) {
    tl_recorder_event_entry event;
    size_t events = 0;
    bool skip = false;
    for (size_t i = 0; i < writer->settings.queue_count; i++) {
        uint64_t number = writer->next.taken[i].events;
        for (size_t n = 0; n < most && read_event(writer, i, number, written, &event, &skip); n++) {
            number++;
            events++;
        }
    }
    return events;
}

/* ---- Damage of the record queues ---- */

static void reopen_queue(source *from) {
    bool is_left = from->reader.is_left;
    tl_record_queue_reader_open(&from->queue.settings, from->queue.memory, &from->reader);
    from->reader.is_left = is_left;
}

static bool is_broken(const source *from) {
    return from->reader.fault[0] != '\0';
}

/* Reopens damaged queues once a second; at once if the damage was found since the last call. */
static void mend_queues(tl_recorder_writer *writer) {
    tl_time now = tl_clock_now(NULL);
    bool again = now - writer->mended_at >= MEND_PAUSE;
    writer->mended_at = again ? now : writer->mended_at;
    writer->is_reopened =
        again && ring_of(writer)->is_ring_broken && writer->sources[writer->settings.ring].damaged_at != 0;
    for (size_t i = 0; i < writer->settings.queue_count; i++) {
        source *from = &writer->sources[i];
        if (is_broken(from) && (again || from->damaged_at == 0)) {
            reopen_queue(from);
            from->damaged_at = 0;
        } else if (!is_broken(from) && again) {
            from->is_reported = false;
        }
    }
}

/* Call after reading; `began_at`: when the reading began. */
static void report_damage(tl_recorder_writer *writer, tl_time began_at) {
    for (size_t i = 0; i < writer->settings.queue_count; i++) {
        char text[TL_EVENT_TEXT];
        source *from = &writer->sources[i];
        from->damaged_at = !is_broken(from) ? 0 : from->damaged_at != 0 ? from->damaged_at : began_at;
        if (is_broken(from) && !from->is_reported) {
            from->is_reported = true;
            writer->was_corrupted = true;
            (void)snprintf(text, sizeof text, "the record queue of %s was corrupted%s: it %.120s", from->queue.name,
                           i == writer->settings.ring ? " by the process of the FMUs" : "", from->reader.fault);
            tl_recorder_file_report_event(&writer->file, TL_EVENT_ERROR, text);
        }
    }
}

tl_time tl_recorder_writer_damage(const tl_recorder_writer *writer, size_t queue) {
    return writer->sources[queue].damaged_at;
}

/* ---- Beginning and ending a batch ---- */

static void begin_batch(tl_recorder_writer *writer) {
    tl_thread_heartbeat_beat(writer->settings.heartbeat);
    writer->next = *mark_of(writer);
    writer->next.number++;
    writer->ends = false;
}

/* Advances the mark without a transaction, because nothing is written to the database. */
static void advance_mark(tl_recorder_writer *writer) {
    tl_recorder_state_try(writer->state, &writer->next);
    tl_recorder_state_commit(writer->state);
}

/* Bytes of configuration texts that the batch may have to write. */
static size_t count_configurations(const tl_recorder_writer *writer) {
    const tl_recorder_settings *record = &writer->record;
    size_t bytes = writer->next.run == 0 ? strlen(record->configuration) : 0;
    for (size_t i = 0; i < record->known_count; i++) {
        const tl_recorder_known *known = &record->known[i];
        bytes += known->number > writer->next.tuning.number ? strlen(known->text) : 0;
    }
    return bytes;
}

static int begin_transaction(tl_recorder_writer *writer, size_t bytes) {
    tl_recorder_mark *next = &writer->next;
    int code = tl_recorder_database_begin(writer->file.database, next->run, bytes + count_configurations(writer));
    if (code == SQLITE_OK && next->run == 0) {
        code = tl_recorder_database_begin_run(writer->file.database, &next->start, !next->is_untimed, &next->run);
    } else if (code == SQLITE_OK && writer->file.continues && !next->has_ended) {
        code = tl_recorder_database_resume_run(writer->file.database);
    }
    const int64_t moved = tl_recorder_database_moved(writer->file.database);
    if (code == SQLITE_OK && moved != 0) {
        char text[TL_EVENT_TEXT];
        (void)snprintf(text, sizeof text,
                       "the system clock was set by %+.3f s: the recorded times of this boot are moved",
                       (double)moved / 1e3);
        tl_recorder_state_add_event(writer->state, -1, TL_EVENT_INFO, "recorder", text);
    }
    return code;
}

/* The mark is stored before the commit, so that a successor can check whether the commit has
 * happened. */
static int commit_batch(tl_recorder_writer *writer) {
    tl_recorder_mark *next = &writer->next;
    if (!writer->is_behind_end) {
        tl_recorder_database_now(writer->file.database, next->totals.committed);
    }
    (void)snprintf(next->path, sizeof next->path, "%s", tl_recorder_file_path(&writer->file));
    next->identity = tl_database_identify(&writer->file.file);
    tl_recorder_state_try(writer->state, next);
    return tl_recorder_database_commit(writer->file.database, &next->totals,
                                       writer->ends ? writer->entry.reason : NULL);
}

static int end_batch(tl_recorder_writer *writer, int code) {
    tl_recorder_file *file = &writer->file;
    code = code == SQLITE_OK ? commit_batch(writer) : code;
    if (code != SQLITE_OK) {
        tl_recorder_file_keep_reason(file, code);
        tl_recorder_database_rollback(file->database);
        return code;
    }
    tl_recorder_state_commit(writer->state);
    file->continues = false;
    code = tl_recorder_database_tidy(file->database);
    if (code != SQLITE_OK) {
        tl_recorder_file_keep_reason(file, code);
    }
    return code;
}

/* ---- Runs ---- */

/* Returns whether the next entries of the ring belong to a run after one in another ring. */
static bool is_handed_over(const tl_recorder_writer *writer) {
    const tl_recorder_writer_settings *settings = &writer->settings;
    const tl_recorder_mark *mark = &writer->next;
    return mark->hands_over && mark->ring == settings->ring && !settings->continues(settings->context);
}

/* Returns up to where the ring may be read. */
static uint64_t limit_end(tl_recorder_writer *writer, uint64_t end) {
    return is_handed_over(writer) ? taken_of(writer)->ring : end;
}

/* Sets `next` to the committed mark and returns the end of what may be read. */
static uint64_t readable_end(tl_recorder_writer *writer) {
    writer->next = *mark_of(writer);
    return limit_end(writer, tl_record_queue_reader_end(ring_of(writer), taken_of(writer)->ring));
}

/* Returns whether the next entry is the beginning of another run; then `entry` holds it. */
static bool is_beginning(tl_recorder_writer *writer, uint64_t end, uint64_t *position) {
    *position = taken_of(writer)->ring;
    return *position != end && take_entry(writer, position, end) && writer->entry.kind == TL_ENTRY_START;
}

/* Begins the run of `entry`, also if the previous run has no end. */
static void take_beginning(tl_recorder_writer *writer, uint64_t position) {
    tl_recorder_mark *next = &writer->next;
    next->start = writer->entry.start;
    if (next->start.resumption.run < 0) {
        next->start.resumption.run = next->run; /* the previous run */
    }
    next->totals = (tl_recorder_totals){.lost = next->run != 0 ? 0 : next->totals.lost}; /* in no row yet */
    next->run = 0;
    next->has_ended = false;
    next->hands_over = false;
    next->ring = (uint32_t)writer->settings.ring;
    next->is_again = false;
    next->own = 0;
    next->has_begun = true;
    next->is_untimed = false;
    next->tuning = (tl_run_tuning){.number = next->tuning.number};
    next->id = writer->entry.id;
    next->sampled = 0;
    next->is_cut = false;
    writer->is_stray = false;
    taken_of(writer)->ring = position;
    writer->file.continues = false;
}

/* ---- Observing ---- */

static bool ends_with_handover(const tl_recorder_writer *writer) {
    const char *hand_over = writer->settings.hand_over;
    return writer->entry.kind == TL_ENTRY_END && hand_over != NULL && strcmp(writer->entry.reason, hand_over) == 0;
}

/* The run may have begun before this writer. */
static void observe_run(tl_recorder_writer *writer) {
    const tl_recorder_mark *mark = mark_of(writer);
    if (!writer->is_observing && mark->has_begun && !mark->has_ended && !mark->is_untimed) {
        writer->entry.kind = TL_ENTRY_START;
        writer->entry.start = mark->start;
        writer->entry.id = mark->id;
        writer->settings.observe(writer->settings.context, &writer->entry);
    }
    writer->is_observing = true;
}

/* Passes on the new entries of the ring, whether or not a file can be written. */
static void observe_entries(tl_recorder_writer *writer) {
    const tl_recorder_writer_settings *settings = &writer->settings;
    uint64_t taken = taken_of_ring(writer);
    if (settings->observe == NULL) {
        return;
    }
    observe_run(writer);
    bool was_skipped = writer->observed < taken; /* damaged bytes */
    bool is_mended = writer->observer.is_ring_broken && !ring_of(writer)->is_ring_broken;
    writer->observed = was_skipped ? taken : writer->observed;
    if (was_skipped || is_mended) {
        tl_record_queue_reader_open(settings_of_ring(writer), writer->sources[settings->ring].queue.memory,
                                    &writer->observer);
    }
    uint64_t end = writer->observed_end > taken ? writer->observed : readable_end(writer);
    while (writer->observed < end &&
           tl_record_queue_reader_entry(&writer->observer, &writer->observed, end, &writer->entry)) {
        settings->observe(settings->context, &writer->entry);
        if (ends_with_handover(writer)) {
            writer->observed_end = writer->observed;
            end = writer->observed;
        }
    }
}

/* ---- Losses ---- */

/* Adds what the producers have lost since the last batch to this run. */
static void count_lost(tl_recorder_writer *writer) {
    enum { ENTRIES = 4, EVENTS = 1 << 16 }; /* upper limits: per tick; since the last batch */
    tl_recorder_mark *next = &writer->next;
    tl_time now = tl_clock_now(NULL);
    uint64_t most = EVENTS + ENTRIES * (uint64_t)((now - next->counted) / writer->record.step);
    next->counted = now;
    for (size_t i = 0; i < writer->settings.queue_count; i++) {
        const source *from = &writer->sources[i];
        uint64_t lost = from->queue.memory != NULL ? tl_record_queue_reader_lost(&from->reader) : next->lost[i];
        uint64_t more = lost - next->lost[i];
        tl_recorder_mark_lose(next, more <= most ? more : 0); /* else the count was corrupted */
        next->lost[i] = lost;
    }
}

static void drop_entry(tl_recorder_writer *writer) {
    writer->next.dropped++;
    tl_recorder_mark_lose(&writer->next, 1);
}

/* Drops entries that belong to no run. */
static void drop_entries(tl_recorder_writer *writer, uint64_t end) {
    uint64_t position = taken_of(writer)->ring;
    while (position != end && take_entry(writer, &position, end) && writer->entry.kind != TL_ENTRY_START) {
        taken_of(writer)->ring = position;
        drop_entry(writer);
    }
    if (taken_of(writer)->ring != taken_of_ring(writer)) {
        advance_mark(writer);
    }
}

/* ---- Writing events and entries ---- */

static int write_own_events(tl_recorder_writer *writer) {
    const tl_recorder_writer_state *state = writer->state;
    tl_recorder_mark *next = &writer->next;
    int code = SQLITE_OK;
    for (; next->said < state->own_next && code == SQLITE_OK; next->said++) {
        code = tl_recorder_database_event(writer->file.database, &state->own[next->said % TL_WRITER_OWN_EVENTS]);
        next->totals.events++;
        next->own++;
    }
    return code;
}

static int write_events(tl_recorder_writer *writer, size_t most) {
    tl_recorder_mark *next = &writer->next;
    uint64_t written = taken_of(writer)->ring;
    tl_recorder_event_entry event = {.at = 0};
    bool skip = false;
    int code = SQLITE_OK;
    for (size_t n = 0; n < most && code == SQLITE_OK; n++) {
        size_t from = find_oldest_event(writer, written, &event, &skip);
        if (from == writer->settings.queue_count) {
            break;
        }
        code = skip ? SQLITE_OK : tl_recorder_database_event(writer->file.database, &event);
        next->totals.events += skip ? 0 : 1;
        next->written += skip ? 0 : 1;
        next->taken[from].events++;
    }
    return code;
}

/* First tick of the run at this instant or later; 0 if the run has no clock of this system. */
static int64_t tick_at(const tl_recorder_writer *writer, tl_time instant) {
    tl_time since = 0;
    tl_time step = writer->record.step;
    bool fits = !__builtin_sub_overflow(instant, writer->next.start.resumption.start, &since);
    return fits && since > 0 && since < INT64_MAX - step ? (since - 1) / step + 1 : 0;
}

/* Writes the entry. Drops it if it belongs to no open run or is invalid. */
static int write_part(tl_recorder_writer *writer, bool *written) {
    /* A tick in the future is invalid. With the pairing "ahead" the last tick is one step early. */
    bool is_of_the_future =
        writer->settings.plant.take != NULL && !writer->next.is_untimed && writer->entry.kind != TL_ENTRY_TUNING &&
        (writer->entry.kind == TL_ENTRY_SAMPLE ? writer->entry.sample.tick : writer->entry.record.step) >
            tick_at(writer, tl_clock_now(NULL)) + 1;
    bool impossible = writer->next.has_ended || is_of_the_future;
    int code = SQLITE_OK;
    if (!impossible) {
        code = tl_recorder_database_entry(writer->file.database, &writer->entry, &impossible);
    }
    *written = !impossible;
    if (impossible) {
        drop_entry(writer);
        return SQLITE_OK;
    }
    writer->next.written++;
    return code;
}

/* Continues the run in a new file, beginning at this tick: an earlier tuning is written again for
 * it. */
static int continue_at(tl_recorder_writer *writer, int64_t tick) {
    tl_recorder_database *database = writer->file.database;
    int code = tl_recorder_database_begin_at(database, tick);
    bool impossible = false;
    if (code == SQLITE_OK && writer->next.tuning.hash[0] != '\0' && writer->next.tuning.tick < tick) {
        tl_run_tuning again = writer->next.tuning;
        again.tick = tick;
        code = tl_recorder_database_tuning(database, &again, &impossible);
    }
    return code;
}

/* Also writes a tuning. */
static int write_sample_or_step(tl_recorder_writer *writer) {
    tl_recorder_mark *next = &writer->next;
    int64_t tick = writer->entry.sample.tick;
    bool written = false;
    int code = write_part(writer, &written);
    if (!written) {
        return code;
    }
    if (writer->entry.kind == TL_ENTRY_TUNING) {
        next->tuning = writer->entry.tuning;
    } else if (writer->entry.kind == TL_ENTRY_STEP) {
        next->totals.steps++;
    } else if (tick < next->sampled) { /* this sample replaces one made from io's readings */
        next->written--;
    } else {
        next->totals.samples++;
        next->sampled = tick + 1;
        if (next->is_again && code == SQLITE_OK) {
            code = continue_at(writer, tick);
            next->is_again = false;
        }
    }
    return code;
}

/* ---- Samples that are missing in the ring ---- */

/* First own tick of a run; a resumed run replays the ticks before it, which belong to the earlier
 * run. */
static int64_t first_tick(const tl_resumption *resumption) {
    return resumption->from == TL_RESUMED_NOT ? 0 : resumption->tick;
}

/* The next tick without a sample. */
static int64_t next_tick(const tl_recorder_writer *writer) {
    int64_t own = first_tick(&writer->next.start.resumption);
    return writer->next.sampled > own ? writer->next.sampled : own;
}

/* Number of missing ticks below `end`, without those in the future. */
static int64_t count_missing(const tl_recorder_writer *writer, int64_t end) {
    const tl_recorder_mark *next = &writer->next;
    int64_t present = tick_at(writer, tl_clock_now(NULL));
    bool can = writer->settings.plant.take != NULL && next->has_begun && !next->is_untimed && !next->has_ended &&
               next->ring == writer->settings.ring; /* a run of another ring may have another plant */
    end = end < present ? end : present;
    return can && end > next_tick(writer) ? end - next_tick(writer) : 0;
}

/* Returns the tick below which no sample may be missing any more. The twin or its successor will
 * still put the later ones. At the end (`is_last`) there is no producer, so nothing is awaited. */
static int64_t oldest_awaited(const tl_recorder_writer *writer) {
    static const tl_time margin = 2 * TL_SECOND;
    tl_time lag = writer->settings.plant.kept - writer->record.commit - margin;
    lag = writer->is_last ? 0 : lag > TL_SECOND ? lag : TL_SECOND;
    return tick_at(writer, tl_clock_now(NULL) - lag);
}

static int write_missing_sample(tl_recorder_writer *writer, int64_t tick) {
    const tl_recorder_plant *plant = &writer->settings.plant;
    tl_time start = writer->next.start.resumption.start;
    tl_sample *sample = &writer->entry.sample;
    plant->take(plant->context, tick, tl_time_of_step(start, writer->record.step, tick), sample);
    for (size_t i = 0; i < writer->record.plant_count; i++) {
        sample->stamps[i] = tl_recorder_entry_stamp(start, sample->stamps[i]);
    }
    writer->entry.kind = TL_ENTRY_SAMPLE;
    tl_recorder_mark_lose(&writer->next, writer->next.is_cut ? 1 : 0); /* its step */
    int code = write_sample_or_step(writer);
    writer->next.sampled = tick + 1; /* also if it cannot be written */
    return code;
}

static size_t size_of(const tl_recorder_writer *writer, tl_recorder_kind kind) {
    return tl_recorder_entry_size(&settings_of_ring(writer)->shape, kind);
}

/* Most samples for one batch. */
static size_t most_samples(const tl_recorder_writer *writer, size_t limit) {
    return limit / size_of(writer, TL_ENTRY_SAMPLE) + 1;
}

static size_t bytes_of_missing(const tl_recorder_writer *writer, int64_t end, size_t limit) {
    int64_t missing = count_missing(writer, end);
    size_t most = most_samples(writer, limit);
    return size_of(writer, TL_ENTRY_SAMPLE) * ((uint64_t)missing < most ? (size_t)missing : most);
}

/* Writes missing samples below tick `end`, as many as the batch allows. Samples whose readings io
 * has overwritten count as lost. Overwrites `entry`. */
static int write_missing(tl_recorder_writer *writer, int64_t end, size_t limit) {
    tl_recorder_mark *next = &writer->next;
    int64_t missing = count_missing(writer, end);
    int64_t kept = tick_at(writer, tl_clock_now(NULL) - writer->settings.plant.kept);
    int code = SQLITE_OK;
    if (missing > 0 && next_tick(writer) < kept) {
        int64_t gone = kept - next_tick(writer) < missing ? kept - next_tick(writer) : missing;
        next->sampled = next_tick(writer) + gone;
        missing -= gone;
        tl_recorder_mark_lose(next, (uint64_t)gone);
    }
    for (size_t room = most_samples(writer, limit); missing > 0 && room > 0 && code == SQLITE_OK; room--) {
        code = write_missing_sample(writer, next_tick(writer));
        missing--;
    }
    return code;
}

/* First tick of this run that belongs to the other run, if `entry` begins one. */
static int64_t tick_of_other(const tl_recorder_writer *writer) {
    const tl_resumption *other = &writer->entry.start.resumption;
    tl_time resume = 0;
    tl_time first = 0;
    bool fits = !__builtin_mul_overflow(first_tick(other), writer->record.step, &resume) &&
                !__builtin_add_overflow(other->start, resume, &first);
    return fits ? tick_at(writer, first) : 0;
}

/* ---- Entries ---- */

/* Returns whether the entry belongs to another run than the present one. Without that run's
 * beginning its clock is unknown. */
static bool is_stray(tl_recorder_writer *writer) {
    if (writer->entry.kind == TL_ENTRY_SAMPLE) {
        writer->is_stray = writer->entry.id != writer->next.id;
        writer->next.is_cut = writer->next.is_cut && writer->is_stray;
    }
    return writer->is_stray && writer->entry.kind != TL_ENTRY_START;
}

static int write_entry(tl_recorder_writer *writer) {
    if (is_stray(writer)) {
        drop_entry(writer);
        return SQLITE_OK;
    }
    switch (writer->entry.kind) {
    case TL_ENTRY_START:
        writer->is_over = true;
        return SQLITE_OK;
    case TL_ENTRY_END:
        writer->ends = !writer->next.has_ended;
        writer->next.has_ended = true;
        writer->next.hands_over = ends_with_handover(writer);
        return SQLITE_OK;
    default:
        return write_sample_or_step(writer);
    }
}

/* Returns the tick below which all samples must exist before this entry is written. At the end of a
 * run the last samples may have been skipped with a damaged part of the ring. */
static int64_t end_of_missing(const tl_recorder_writer *writer) {
    bool ends = writer->entry.kind == TL_ENTRY_END && writer->next.is_cut && !writer->is_stray;
    bool is_own = writer->entry.kind == TL_ENTRY_SAMPLE && writer->entry.id == writer->next.id;
    return is_own ? writer->entry.sample.tick : ends ? tick_at(writer, tl_clock_now(NULL) - writer->record.step) : 0;
}

/* Writes the missing samples first, then the entry. *is_more: not all missing samples fit into the
 * batch. */
static int write_entry_in_turn(tl_recorder_writer *writer, uint64_t *position, uint64_t end, size_t limit,
                               bool *is_more) {
    int64_t awaited = end_of_missing(writer);
    int code = SQLITE_OK;
    if (count_missing(writer, awaited) > 0) {
        code = write_missing(writer, awaited, limit);
        *position = taken_of(writer)->ring;
        *is_more = count_missing(writer, awaited) > 0 || !take_entry(writer, position, end);
    }
    return code == SQLITE_OK && !*is_more ? write_entry(writer) : code;
}

/* Stops at the end of a run, at the beginning of another, or after `limit` bytes. A sample and its
 * step are in one batch, so that a power cut never leaves half a tick. */
static int write_entries(tl_recorder_writer *writer, uint64_t end, size_t limit) {
    const size_t step = size_of(writer, TL_ENTRY_STEP);
    uint64_t *taken = &taken_of(writer)->ring;
    uint64_t first = *taken;
    int code = SQLITE_OK;
    writer->is_over = false;
    while (*taken != end && *taken - first < limit && code == SQLITE_OK && !writer->ends) {
        uint64_t position = *taken;
        if (!take_entry(writer, &position, end)) {
            break;
        }
        if (writer->entry.kind == TL_ENTRY_SAMPLE && *taken != first && position - first + step > limit) {
            break;
        }
        bool is_more = false;
        code = write_entry_in_turn(writer, &position, end, limit, &is_more);
        if (writer->is_over || is_more) {
            break;
        }
        *taken = position;
    }
    return code;
}

/* Returns whether the ring has entries after the committed ones. */
static bool has_more(tl_recorder_writer *writer, uint64_t end) {
    return taken_of_ring(writer) != end && !ring_of(writer)->is_ring_broken;
}

/* Writes one transaction of the present run, if there is anything to write. */
static int write_transaction(tl_recorder_writer *writer, uint64_t end, bool *more) {
    uint64_t before = mark_of(writer)->number;
    size_t limit = tl_recorder_database_batch(writer->file.database);
    uint64_t remaining = end - taken_of(writer)->ring;
    size_t bytes = remaining < limit ? (size_t)remaining : limit;
    size_t events = count_events(writer, end, limit / EVENT_BYTES);
    bool has_own = writer->next.said != writer->state->own_next;
    size_t missing = bytes_of_missing(writer, oldest_awaited(writer), limit);
    if (bytes == 0 && events == 0 && missing == 0 && !has_own && writer->next.run != 0) {
        return SQLITE_OK;
    }
    count_lost(writer);
    int code = begin_transaction(writer, bytes + missing + events * (size_t)EVENT_BYTES);
    code = code == SQLITE_OK ? write_own_events(writer) : code;
    code = code == SQLITE_OK ? write_entries(writer, end, limit) : code;
    if (code == SQLITE_OK && !writer->is_over) {
        code = write_missing(writer, oldest_awaited(writer), limit);
    }
    code = code == SQLITE_OK ? write_events(writer, limit / EVENT_BYTES) : code;
    code = end_batch(writer, code);
    *more = mark_of(writer)->number != before &&
            (has_more(writer, end) || bytes_of_missing(writer, oldest_awaited(writer), limit) > missing);
    return code;
}

/* Writes one transaction: entries up to `end` of the ring or to the beginning of another run, and
 * as many events as fit. *more: another batch should follow. */
static int write_batch(tl_recorder_writer *writer, uint64_t end, bool *more) {
    uint64_t position = 0;
    observe_entries(writer);
    begin_batch(writer);
    *more = false;
    end = limit_end(writer, end);
    bool has_early = writer->next.run != 0 && count_events(writer, taken_of(writer)->ring, 1) > 0;
    if (!has_early && is_beginning(writer, end, &position)) { /* else events of the previous run wait */
        int64_t rest = tick_of_other(writer);
        if (count_missing(writer, rest) > 0) { /* in a transaction of their own */
            size_t limit = tl_recorder_database_batch(writer->file.database);
            int code = begin_transaction(writer, bytes_of_missing(writer, rest, limit));
            code = end_batch(writer, code == SQLITE_OK ? write_missing(writer, rest, limit) : code);
            *more = code == SQLITE_OK;
            return code;
        }
        take_beginning(writer, position);
    } else if (!writer->next.has_begun) {
        drop_entries(writer, end);
        *more = has_more(writer, end);
        return SQLITE_OK;
    }
    return write_transaction(writer, end, more);
}

/* Writes a checkpoint in its own transaction, after all entries that precede it. *any: there was
 * one. */
static int write_checkpoint(tl_recorder_writer *writer, bool *any) {
    const tl_recorder_mark *mark = mark_of(writer);
    const tl_record_queue_taken *taken = &mark->taken[writer->settings.ring];
    size_t size = 0;
    int64_t tick = 0;
    uint64_t number = 0;
    *any = writer->checkpoint != NULL && mark->run != 0 && mark->ring == writer->settings.ring &&
           tl_record_queue_reader_checkpoint(ring_of(writer), taken->checkpoint, taken->ring, writer->checkpoint, &size,
                                             &tick, &number);
    if (!*any) {
        return SQLITE_OK;
    }
    begin_batch(writer);
    taken_of(writer)->checkpoint = number;
    int code = begin_transaction(writer, size);
    if (code == SQLITE_OK) {
        code = tl_recorder_database_checkpoint(writer->file.database, tick, writer->checkpoint, size);
    }
    return end_batch(writer, code);
}

/* ---- Remaining entries ---- */

/* Counts the samples, steps and events that are not written. */
static uint64_t count_remaining(tl_recorder_writer *writer) {
    uint64_t end = readable_end(writer);
    uint64_t position = taken_of(writer)->ring;
    uint64_t remaining = 0;
    while (position != end && take_entry(writer, &position, end)) {
        remaining += writer->entry.kind != TL_ENTRY_START && writer->entry.kind != TL_ENTRY_END ? 1 : 0;
    }
    return remaining +
           (writer->next.has_begun ? count_events(writer, limit_end(writer, UINT64_MAX), TL_RECORDER_EVENTS) : 0);
}

/* Returns whether the ring is written completely or up to a handover. */
static bool is_ring_read(tl_recorder_writer *writer) {
    uint64_t end = readable_end(writer);
    return taken_of(writer)->ring == end || ring_of(writer)->is_ring_broken;
}

/* Returns whether nothing remains that could be written. */
static bool is_empty(tl_recorder_writer *writer) {
    bool is_ring_empty = is_ring_read(writer);
    const tl_recorder_mark *next = &writer->next;
    return is_ring_empty &&
           (!next->has_begun || (next->run != 0 && count_events(writer, limit_end(writer, UINT64_MAX), 1) == 0));
}

bool tl_recorder_writer_has_drained(tl_recorder_writer *writer) {
    tl_recorder_event_entry event;
    bool skip = false;
    return is_ring_read(writer) &&
           !read_event(writer, writer->settings.ring, taken_of(writer)->events, taken_of(writer)->ring, &event, &skip);
}

bool tl_recorder_writer_is_pressed(tl_recorder_writer *writer) {
    uint64_t position = taken_of_ring(writer);
    bool is_full =
        tl_record_queue_reader_end(ring_of(writer), position) - position > settings_of_ring(writer)->ring_bytes / 2;
    return writer->refusal == 0 && (is_full || is_beginning(writer, readable_end(writer), &position));
}

void tl_recorder_writer_finish_ring(tl_recorder_writer *writer) {
    tl_record_queue_reader_finish(ring_of(writer));
}

/* ---- Writing ---- */

/* Returns whether a file is open; if not, tries to open one every 0.1 s. */
static bool is_open(tl_recorder_writer *writer) {
    tl_recorder_file *file = &writer->file;
    tl_database_report report;
    bool waits = false;
    if (file->database != NULL) {
        return true;
    }
    if (!tl_recorder_file_is_due(file)) {
        return false;
    }
    if (tl_recorder_file_open(file, TL_DATABASE_ANYHOW, &report, &waits) != TL_OK) {
        tl_recorder_file_report_fate(file, NULL);
        report_open_failure(writer);
        return false;
    }
    tl_recorder_file_set_short_wait(file);
    int code = tl_recorder_file_find_run(file, &report);
    tl_recorder_file_report_fate(file, &report);
    if (code != SQLITE_OK) {
        tl_recorder_file_keep_reason(file, code);
    }
    if (code != SQLITE_OK && !tl_recorder_file_repair(file, code)) {
        report_refusal(writer, code & 0xFF);
        tl_recorder_file_close(file);
    }
    return file->database != NULL;
}

/* Writes what the queues hold now. Reads at most two checkpoints per batch, because a producer
 * might put them without end. */
static int write_all(tl_recorder_writer *writer) {
    uint64_t end = tl_record_queue_reader_end(ring_of(writer), taken_of_ring(writer));
    bool more = true;
    int stalls = 0;
    int code = SQLITE_OK;
    while (more && code == SQLITE_OK && stalls < STALLS) {
        uint64_t before = taken_of_ring(writer);
        bool any = true;
        code = write_batch(writer, end, &more);
        stalls += taken_of_ring(writer) == before ? 1 : 0;
        for (int i = 0; i < TL_RECORD_QUEUE_CHECKPOINTS && any && code == SQLITE_OK; i++) {
            code = write_checkpoint(writer, &any);
        }
    }
    if (code == SQLITE_OK) {
        report_success(writer);
        code = write_batch(writer, taken_of_ring(writer), &more);
    }
    return code;
}

/* Continues at the end of a damaged ring; the entries in between are lost. Does nothing if a
 * handover forbids to read the ring. */
static void skip_damage(tl_recorder_writer *writer) {
    uint64_t taken = taken_of_ring(writer);
    uint64_t to = writer->is_reopened ? tl_record_queue_reader_skip(ring_of(writer), taken) : taken;
    if (to != taken) {
        reopen_queue(&writer->sources[writer->settings.ring]);
        begin_batch(writer);
        if (!is_handed_over(writer)) {
            taken_of(writer)->ring = to;
            writer->next.is_cut = true;
            advance_mark(writer);
        }
    }
}

void tl_recorder_writer_write(tl_recorder_writer *writer) {
    int mends = 0;
    bool again = true;
    tl_time began_at = tl_clock_now(NULL);
    tl_thread_heartbeat_beat(writer->settings.heartbeat);
    mend_queues(writer);
    skip_damage(writer);
    observe_entries(writer);
    while (again && is_open(writer)) {
        if (mends < MENDS && tl_recorder_file_check(&writer->file)) {
            mends++;
            tl_thread_heartbeat_beat(writer->settings.heartbeat);
            continue;
        }
        unsigned before = tl_recorder_database_writings_back(writer->file.database);
        int code = write_all(writer);
        if (tl_recorder_database_writings_back(writer->file.database) != before) {
            tl_database_file_note(&writer->file.file);
        }
        again = code != SQLITE_OK && mends++ < MENDS && tl_recorder_file_repair(&writer->file, code);
        if (code != SQLITE_OK && !again) {
            report_refusal(writer, code & 0xFF);
        }
    }
    report_damage(writer, began_at);
}

/* ---- Changes ---- */

bool tl_recorder_writer_keep(tl_recorder_writer *writer, const tl_run_changes *changes) {
    const tl_recorder_mark *mark = mark_of(writer);
    if (writer->file.database == NULL || mark->run == 0) {
        return false;
    }
    begin_batch(writer);
    writer->is_behind_end = writer->next.has_ended;
    int code = begin_transaction(writer, changes->size + changes->count * (size_t)EVENT_BYTES);
    code = code == SQLITE_OK ? tl_recorder_database_changes(writer->file.database, changes) : code;
    code = end_batch(writer, code);
    writer->is_behind_end = false;
    if (code != SQLITE_OK) {
        (void)tl_recorder_file_repair(&writer->file, code);
    }
    return code == SQLITE_OK;
}

bool tl_recorder_writer_read_learned(tl_recorder_writer *writer, unsigned char **bytes, size_t *size,
                                     uint32_t *last_finding) {
    *bytes = NULL;
    return writer->file.database != NULL &&
           tl_recorder_database_learned(writer->file.database, bytes, size, last_finding) == SQLITE_OK;
}

bool tl_recorder_writer_is_removed(tl_recorder_writer *writer) {
    bool is_removed = false;
    return writer->file.database != NULL &&
           tl_recorder_database_is_removed(writer->file.database, &is_removed) == SQLITE_OK && is_removed;
}

bool tl_recorder_writer_next_normal(tl_recorder_writer *writer, uint32_t number, uint32_t *next) {
    return writer->file.database != NULL &&
           tl_recorder_database_next_normal(writer->file.database, number, next) == SQLITE_OK && *next > number;
}

/* ---- Opening and closing ---- */

/* Begins the run that needs no START entry, in a file that is new to this writer. */
static tl_status begin_first(tl_recorder_writer *writer, tl_database_policy open_policy) {
    bool more = false;
    begin_batch(writer);
    writer->next.start = *writer->settings.first;
    writer->next.has_begun = true;
    writer->next.is_untimed = true;
    writer->next.ring = (uint32_t)writer->settings.ring;
    advance_mark(writer);
    if (writer->file.database == NULL) {
        return TL_OK;
    }
    int code = write_batch(writer, taken_of_ring(writer), &more);
    return code != SQLITE_OK && open_policy == TL_DATABASE_ALL_OR_NOTHING ? writer->file.failure.status : TL_OK;
}

static tl_status open_all(tl_recorder_writer *writer) {
    tl_database_report report;
    bool waits = false;
    tl_database_policy open_policy = writer->record.open_policy;
    if (mark_of(writer)->number != 0 || tl_recorder_state_tried(writer->state) != NULL) {
        (void)is_open(writer); /* if no file can be opened now, a later write opens one */
        return TL_OK;
    }
    tl_status status = tl_recorder_file_open(&writer->file, open_policy, &report, &waits);
    if (status != TL_OK && !waits) {
        return status;
    }
    if (status == TL_OK) {
        tl_recorder_file_report_fate(&writer->file, &report);
    } else {
        report_open_failure(writer);
    }
    status = writer->settings.first == NULL ? TL_OK : begin_first(writer, open_policy);
    if (writer->file.database != NULL) {
        tl_recorder_file_set_short_wait(&writer->file);
    }
    return status;
}

static void open_queues(tl_recorder_writer *writer) {
    const tl_recorder_writer_settings *settings = &writer->settings;
    assert(settings->queue_count <= TL_WRITER_QUEUES && settings->ring < settings->queue_count &&
           settings->queues[settings->ring].memory != NULL);
    for (size_t i = 0; i < settings->queue_count; i++) {
        source *from = &writer->sources[i];
        from->queue = settings->queues[i];
        if (from->queue.memory != NULL) {
            tl_record_queue_reader_open(&from->queue.settings, from->queue.memory, &from->reader);
        }
    }
    writer->observer = *ring_of(writer);
    writer->observed = taken_of_ring(writer);
    writer->settings.queues = NULL; /* owned by the caller */
}

static void free_writer(tl_recorder_writer *writer) {
    tl_recorder_file_end(&writer->file);
    free(writer->checkpoint);
    free(writer);
}

tl_status tl_recorder_writer_open(const tl_recorder_writer_settings *settings, tl_recorder_writer **writer,
                                  tl_error *error) {
    const tl_record_queue_settings *ring = &settings->queues[settings->ring].settings;
    tl_recorder_writer *opened = calloc(1, sizeof *opened);
    unsigned char *checkpoint = ring->checkpoint_bytes == 0 ? NULL : malloc(ring->checkpoint_bytes);
    *writer = NULL;
    if (opened == NULL || (checkpoint == NULL && ring->checkpoint_bytes != 0)) {
        free(opened);
        free(checkpoint);
        return tl_fail(error, TL_TRY_AGAIN, "%s: out of memory", settings->record->path);
    }
    opened->settings = *settings;
    opened->record = *settings->record;
    opened->record.component_count = ring->shape.components;
    opened->state = settings->state;
    opened->checkpoint = checkpoint;
    opened->lost_said_at = tl_clock_now(NULL) - LOSS_PAUSE;
    open_queues(opened);
    tl_recorder_file_begin(&opened->file, &opened->record, opened->state);
    opened->file.lost_said = mark_of(opened)->totals.lost;
    tl_recorder_state_publish(opened->state);
    tl_status status = open_all(opened);
    if (status != TL_OK) {
        (void)tl_fail(error, status, "%s", opened->file.failure.text);
        free_writer(opened);
        return status;
    }
    *writer = opened;
    return TL_OK;
}

tl_status tl_recorder_writer_close(tl_recorder_writer *writer, tl_time patience, tl_error *error) {
    tl_time began = tl_clock_now(NULL);
    tl_status status = TL_OK;
    if (writer == NULL) {
        return TL_OK;
    }
    writer->is_last = writer->settings.is_last;
    if (writer->is_last) {
        tl_recorder_writer_finish_ring(writer);
    }
    report_loss(writer, why_lost(writer));
    tl_recorder_writer_write(writer);
    while (((mark_of(writer)->has_begun && mark_of(writer)->said != writer->state->own_next) || !is_empty(writer)) &&
           tl_clock_now(NULL) - began < patience) {
        tl_clock_sleep_until(tl_clock_now(NULL) + CLOSE_PAUSE);
        tl_recorder_writer_write(writer);
    }
    if (!is_empty(writer)) {
        uint64_t remaining = count_remaining(writer);
        (void)__atomic_add_fetch(&writer->state->dropped, remaining, __ATOMIC_RELAXED);
        status =
            tl_fail(error, TL_TRY_AGAIN, "%s: the run's end and its last %" PRIu64 " entries could not be written: %s",
                    tl_recorder_writer_path(writer), remaining, writer->file.reason);
    } else if (writer->is_last && writer->file.database != NULL) {
        (void)tl_recorder_database_end_killed(writer->file.database); /* or the next writer does it */
    }
    free_writer(writer);
    return status;
}
