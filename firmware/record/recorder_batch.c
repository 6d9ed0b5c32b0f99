/* A batch: see recorder_batch.h. */
#include "firmware/record/recorder_batch.h"

#include <sqlite3.h>
#include <stdio.h>
#include <string.h>

#include "firmware/record/recorder_database.h"
#include "firmware/text/utc.h"

enum { EVENT_BYTES = 256 }; /* what an event counts in a batch */

static const tl_recorder_mark *mark_of(const tl_recorder_batch *batch) {
    return tl_recorder_state_mark(batch->settings.state);
}

static tl_recorder_database *database_of(const tl_recorder_batch *batch) {
    return batch->settings.file->database;
}

static size_t ring_of(const tl_recorder_batch *batch) {
    return batch->settings.inbox->ring;
}

/* Of the outbox with the ring. */
static tl_outbox_taken *taken_of(tl_recorder_batch *batch) {
    return &batch->next.taken[ring_of(batch)];
}

static bool take_entry(tl_recorder_batch *batch, uint64_t *position, uint64_t end) {
    return tl_recorder_inbox_entry(batch->settings.inbox, position, end, &batch->entry);
}

static size_t count_events(tl_recorder_batch *batch, uint64_t written, size_t most) {
    return tl_recorder_inbox_count_events(batch->settings.inbox, batch->next.taken, written, most);
}

/* ---- Beginning and ending ---------------------------------------------------------------------------------------- */

static void begin_batch(tl_recorder_batch *batch) {
    tl_heart_beat(batch->settings.heart);
    batch->next = *mark_of(batch);
    batch->next.number++;
    batch->ends = false;
}

/* The mark moves on without a transaction: nothing is written by it. */
static void settle(tl_recorder_batch *batch) {
    tl_recorder_state_try(batch->settings.state, &batch->next);
    tl_recorder_state_settle(batch->settings.state);
}

static int write_row(tl_recorder_batch *batch) {
    tl_recorder_mark *next = &batch->next;
    int code = SQLITE_OK;
    if (next->run == 0) {
        code = tl_recorder_database_begin_run(database_of(batch), &next->start, !next->is_untimed, &next->run);
    } else if (batch->settings.file->goes_on && !next->has_ended) {
        code = tl_recorder_database_go_on(database_of(batch));
    }
    return code;
}

/* Bytes of texts that may be written with the batch. */
static size_t configurations(const tl_recorder_batch *batch) {
    const tl_recorder_settings *record = batch->settings.file->record;
    size_t bytes = batch->next.run == 0 ? strlen(record->configuration) : 0;
    for (size_t i = 0; i < record->known_count; i++) {
        const tl_recorder_known *known = &record->known[i];
        bytes += known->number > batch->next.tuning.number ? strlen(known->text) : 0;
    }
    return bytes;
}

static int begin_transaction(tl_recorder_batch *batch, size_t bytes) {
    int code = tl_recorder_database_begin(database_of(batch), batch->next.run, bytes + configurations(batch));
    return code == SQLITE_OK ? write_row(batch) : code;
}

/* The batch is whole: it is tried, and is the mark if the database takes it. */
static int commit(tl_recorder_batch *batch) {
    tl_recorder_mark *next = &batch->next;
    tl_utc_text(tl_utc_now(), next->totals.committed);
    (void)snprintf(next->path, sizeof next->path, "%s", tl_recorder_file_path(batch->settings.file));
    next->identity = tl_database_identify(&batch->settings.file->file);
    tl_recorder_state_try(batch->settings.state, next);
    return tl_recorder_database_commit(database_of(batch), &next->totals, batch->ends ? batch->entry.reason : NULL);
}

static int end_batch(tl_recorder_batch *batch, int code) {
    tl_recorder_file *file = batch->settings.file;
    if (code == SQLITE_OK) {
        code = commit(batch);
    }
    if (code != SQLITE_OK) {
        tl_recorder_file_keep_words(file, code);
        tl_recorder_database_rollback(file->database);
        return code;
    }
    tl_recorder_state_settle(batch->settings.state);
    file->goes_on = false;
    code = tl_recorder_database_tidy(file->database);
    if (code != SQLITE_OK) {
        tl_recorder_file_keep_words(file, code);
    }
    return code;
}

/* ---- Runs -------------------------------------------------------------------------------------------------------- */

/* What lies behind is of a run that comes after one in another ring. */
static bool is_handed_over(const tl_recorder_batch *batch) {
    const tl_recorder_batch_settings *settings = &batch->settings;
    const tl_recorder_mark *mark = &batch->next;
    return mark->hands_over && mark->ring == ring_of(batch) && !settings->goes_on(settings->context);
}

/* How far of that the ring may be read. */
static uint64_t end_of(tl_recorder_batch *batch, uint64_t end) {
    return is_handed_over(batch) ? taken_of(batch)->ring : end;
}

/* Up to which position of the ring its events are ours. */
static uint64_t reach_of(tl_recorder_batch *batch) {
    return end_of(batch, UINT64_MAX);
}

/* What comes next, if it is the beginning of another run: then the entry is that. */
static bool is_beginning(tl_recorder_batch *batch, uint64_t end, uint64_t *position) {
    *position = taken_of(batch)->ring;
    return *position != end && take_entry(batch, position, end) && batch->entry.kind == TL_ENTRY_START;
}

static tl_outbox_start start_of(const tl_recorder_batch *batch) {
    tl_outbox_start start = {.holds = batch->entry.holds, .resumption = batch->entry.beginning};
    if (!start.holds) {
        start.account = batch->entry.account;
        memcpy(start.fmus, batch->entry.fmus, sizeof start.fmus);
        start.configured = batch->entry.tuning;
    }
    if (start.resumption.run < 0) {
        start.resumption.run = batch->next.run; /* the one before */
    }
    return start;
}

/* The entry begins a run, whatever became of the one before. */
static void take_beginning(tl_recorder_batch *batch, uint64_t position) {
    tl_recorder_mark *next = &batch->next;
    next->start = start_of(batch);
    next->totals = (tl_recorder_totals){.lost = next->run != 0 ? 0 : next->totals.lost}; /* not said in any row yet */
    next->run = 0;
    next->has_ended = false;
    next->hands_over = false;
    next->ring = (uint32_t)ring_of(batch);
    next->is_again = false;
    next->own = 0;
    next->has_begun = true;
    next->is_untimed = false;
    next->tuning = (tl_run_tuning){.number = next->tuning.number};
    next->taken[ring_of(batch)].ring = position;
    batch->settings.file->goes_on = false;
}

void tl_recorder_batch_begin_run(tl_recorder_batch *batch, const tl_outbox_start *start) {
    begin_batch(batch);
    batch->next.start = *start;
    batch->next.has_begun = true;
    batch->next.is_untimed = true;
    batch->next.ring = (uint32_t)ring_of(batch);
    settle(batch);
}

/* ---- What is lost ------------------------------------------------------------------------------------------------ */

/* What producers have lost since the last batch is lost of this run. */
static void count_lost(tl_recorder_batch *batch) {
    tl_recorder_mark *next = &batch->next;
    for (size_t i = 0; i < batch->settings.inbox->count; i++) {
        uint64_t lost = tl_recorder_inbox_lost(batch->settings.inbox, i, next->lost[i]);
        tl_recorder_mark_lose(next, lost > next->lost[i] ? lost - next->lost[i] : 0);
        next->lost[i] = lost;
    }
}

static void drop(tl_recorder_batch *batch) {
    batch->next.dropped++;
    tl_recorder_mark_lose(&batch->next, 1);
}

/* Entries that belong to no run: there is nothing to write them to. */
static void drop_entries(tl_recorder_batch *batch, uint64_t end) {
    uint64_t position = taken_of(batch)->ring;
    while (position != end && take_entry(batch, &position, end) && batch->entry.kind != TL_ENTRY_START) {
        taken_of(batch)->ring = position;
        drop(batch);
    }
    if (taken_of(batch)->ring != mark_of(batch)->taken[ring_of(batch)].ring) {
        settle(batch);
    }
}

/* ---- What is written --------------------------------------------------------------------------------------------- */

static int write_own_events(tl_recorder_batch *batch) {
    const tl_recorder_writer_state *state = batch->settings.state;
    tl_recorder_mark *next = &batch->next;
    int code = SQLITE_OK;
    for (; next->said < state->own_said && code == SQLITE_OK; next->said++) {
        code = tl_recorder_database_event(database_of(batch), &state->own[next->said % TL_WRITER_OWN_EVENTS]);
        next->totals.events++;
        next->own++;
    }
    return code;
}

static int write_events(tl_recorder_batch *batch, size_t most) {
    tl_recorder_inbox *inbox = batch->settings.inbox;
    tl_recorder_mark *next = &batch->next;
    uint64_t written = next->taken[ring_of(batch)].ring;
    tl_recorder_event_entry event = {.at = 0};
    bool skip = false;
    int code = SQLITE_OK;
    for (size_t n = 0; n < most && code == SQLITE_OK; n++) {
        size_t from = tl_recorder_inbox_oldest_event(inbox, next->taken, written, &event, &skip);
        if (from == inbox->count) {
            break;
        }
        code = skip ? SQLITE_OK : tl_recorder_database_event(database_of(batch), &event);
        next->totals.events += skip ? 0 : 1;
        next->written += skip ? 0 : 1;
        next->taken[from].events++;
    }
    return code;
}

/* Is it one of the run, and can it be written? Else it is dropped. */
static int write_part(tl_recorder_batch *batch, bool *written) {
    tl_recorder_mark *next = &batch->next;
    bool impossible = next->has_ended;
    int code = SQLITE_OK;
    if (!impossible) {
        code = tl_recorder_database_entry(database_of(batch), &batch->entry, &impossible);
    }
    *written = !impossible;
    if (impossible) {
        drop(batch);
        return SQLITE_OK;
    }
    next->written++;
    return code;
}

static int write_tuning(tl_recorder_batch *batch) {
    bool written = false;
    int code = write_part(batch, &written);
    batch->next.tuning = written ? batch->entry.tuning : batch->next.tuning;
    return code;
}

/* The run's beginning is in another file, and with it what was taken before this tick. */
static int begin_at(tl_recorder_batch *batch, int64_t tick) {
    tl_recorder_database *database = database_of(batch);
    int code = tl_recorder_database_begin_at(database, tick);
    bool impossible = false;
    if (code == SQLITE_OK && batch->next.tuning.hash[0] != '\0' && batch->next.tuning.tick < tick) {
        tl_run_tuning again = batch->next.tuning;
        again.tick = tick;
        code = tl_recorder_database_tuning(database, &again, &impossible);
    }
    return code;
}

static int write_sample_or_step(tl_recorder_batch *batch) {
    tl_recorder_mark *next = &batch->next;
    bool written = false;
    int code = write_part(batch, &written);
    if (!written) {
        return code;
    }
    if (batch->entry.kind == TL_ENTRY_STEP) {
        next->totals.steps++;
        return code;
    }
    next->totals.samples++;
    if (next->is_again && code == SQLITE_OK) {
        code = begin_at(batch, batch->entry.sample.tick);
        next->is_again = false;
    }
    return code;
}

static void take_end(tl_recorder_batch *batch) {
    const char *hand_over = batch->settings.hand_over;
    batch->ends = !batch->next.has_ended;
    batch->next.has_ended = true;
    batch->next.hands_over = hand_over != NULL && strcmp(batch->entry.reason, hand_over) == 0;
}

static int write_entry(tl_recorder_batch *batch) {
    switch (batch->entry.kind) {
    case TL_ENTRY_START:
        batch->is_over = true;
        return SQLITE_OK;
    case TL_ENTRY_END:
        take_end(batch);
        return SQLITE_OK;
    case TL_ENTRY_TUNING:
        return write_tuning(batch);
    default:
        return write_sample_or_step(batch);
    }
}

/* Up to the end of a run, the beginning of another, or so many bytes. A sample and its step are in one batch: so no power cut leaves half a tick. */
static int write_entries(tl_recorder_batch *batch, uint64_t end, size_t limit) {
    const size_t step =
        tl_recorder_entry_size(&batch->settings.inbox->outboxes[ring_of(batch)].settings.shape, TL_ENTRY_STEP);
    uint64_t *taken = &taken_of(batch)->ring;
    uint64_t first = *taken;
    int code = SQLITE_OK;
    batch->is_over = false;
    while (*taken != end && *taken - first < limit && code == SQLITE_OK && !batch->ends) {
        uint64_t position = *taken;
        if (!take_entry(batch, &position, end)) {
            break;
        }
        if (batch->entry.kind == TL_ENTRY_SAMPLE && *taken != first && position - first + step > limit) {
            break;
        }
        code = write_entry(batch);
        if (batch->is_over) {
            break;
        }
        *taken = position;
    }
    return code;
}

/* Within the transaction. */
static int write_all(tl_recorder_batch *batch, uint64_t end, size_t limit) {
    int code = write_own_events(batch);
    if (code == SQLITE_OK) {
        code = write_entries(batch, end, limit);
    }
    return code == SQLITE_OK ? write_events(batch, limit / EVENT_BYTES) : code;
}

/* Whether there is more of the ring behind what is committed. */
static bool has_more(const tl_recorder_batch *batch, uint64_t end) {
    return mark_of(batch)->taken[ring_of(batch)].ring != end && tl_recorder_inbox_is_whole(batch->settings.inbox);
}

/* The run is known: its transaction, if there is anything for one. */
static int write_transaction(tl_recorder_batch *batch, uint64_t end, bool *more) {
    uint64_t before = mark_of(batch)->number;
    size_t limit = tl_recorder_database_batch(database_of(batch));
    uint64_t left = end - taken_of(batch)->ring;
    size_t bytes = left < limit ? (size_t)left : limit;
    size_t events = count_events(batch, end, limit / EVENT_BYTES);
    bool has_own = batch->next.said != batch->settings.state->own_said;
    if (bytes == 0 && events == 0 && !has_own && batch->next.run != 0) {
        return SQLITE_OK;
    }
    count_lost(batch);
    int code = begin_transaction(batch, bytes + events * (size_t)EVENT_BYTES);
    if (code == SQLITE_OK) {
        code = write_all(batch, end, limit);
    }
    code = end_batch(batch, code);
    *more = mark_of(batch)->number != before && has_more(batch, end);
    return code;
}

int tl_recorder_batch_write(tl_recorder_batch *batch, uint64_t end, bool *more) {
    uint64_t position = 0;
    begin_batch(batch);
    *more = false;
    end = end_of(batch, end);
    bool has_early = batch->next.run != 0 && count_events(batch, taken_of(batch)->ring, 1) > 0;
    if (!has_early && is_beginning(batch, end, &position)) { /* else there are events of the run before */
        take_beginning(batch, position);
    } else if (!batch->next.has_begun) {
        drop_entries(batch, end);
        *more = has_more(batch, end);
        return SQLITE_OK;
    }
    return write_transaction(batch, end, more);
}

/* ---- Checkpoints ------------------------------------------------------------------------------------------------- */

/* In a transaction of its own, once all that came before it is there. *any: there was one. */
static int write_checkpoint(tl_recorder_batch *batch, bool *any) {
    unsigned char *bytes = batch->settings.checkpoint;
    const tl_recorder_mark *mark = mark_of(batch);
    size_t size = 0;
    int64_t tick = 0;
    uint64_t number = 0;
    *any =
        bytes != NULL && mark->run != 0 && mark->ring == ring_of(batch) &&
        tl_recorder_inbox_checkpoint(batch->settings.inbox, &mark->taken[ring_of(batch)], bytes, &size, &tick, &number);
    if (!*any) {
        return SQLITE_OK;
    }
    begin_batch(batch);
    taken_of(batch)->checkpoint = number;
    int code = begin_transaction(batch, size);
    if (code == SQLITE_OK) {
        code = tl_recorder_database_checkpoint(database_of(batch), tick, bytes, size);
    }
    return end_batch(batch, code);
}

/* An outbox has two; who puts them without end is looked at again later. */
int tl_recorder_batch_write_checkpoints(tl_recorder_batch *batch) {
    enum { AT_ONCE = 2 };
    bool any = true;
    int code = SQLITE_OK;
    for (int i = 0; i < AT_ONCE && any && code == SQLITE_OK; i++) {
        code = write_checkpoint(batch, &any);
    }
    return code;
}

/* ---- What is left ------------------------------------------------------------------------------------------------ */

uint64_t tl_recorder_batch_count_left(tl_recorder_batch *batch) {
    batch->next = *mark_of(batch);
    uint64_t position = taken_of(batch)->ring;
    uint64_t end = end_of(batch, tl_recorder_inbox_end(batch->settings.inbox, position));
    uint64_t left = 0;
    while (position != end && take_entry(batch, &position, end)) {
        left += batch->entry.kind != TL_ENTRY_START && batch->entry.kind != TL_ENTRY_END ? 1 : 0;
    }
    return left + (batch->next.has_begun ? count_events(batch, reach_of(batch), TL_RECORDER_EVENTS) : 0);
}

/* Of the ring. */
static bool is_read(tl_recorder_batch *batch) {
    batch->next = *mark_of(batch);
    uint64_t taken = taken_of(batch)->ring;
    uint64_t end = end_of(batch, tl_recorder_inbox_end(batch->settings.inbox, taken));
    return taken == end || !tl_recorder_inbox_is_whole(batch->settings.inbox);
}

bool tl_recorder_batch_has_drained(tl_recorder_batch *batch) {
    return is_read(batch) && !tl_recorder_inbox_has_event_of_ring(batch->settings.inbox, taken_of(batch));
}

bool tl_recorder_batch_is_empty(tl_recorder_batch *batch) {
    bool has_none_of_ring = is_read(batch);
    bool needs_row = batch->next.has_begun && batch->next.run == 0;
    return has_none_of_ring && !needs_row && (!batch->next.has_begun || count_events(batch, reach_of(batch), 1) == 0);
}
