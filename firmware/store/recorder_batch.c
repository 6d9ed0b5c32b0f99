/* A batch: see recorder_batch.h. */
#include "firmware/store/recorder_batch.h"

#include <sqlite3.h>
#include <stdio.h>
#include <string.h>

#include "firmware/base/os.h"
#include "firmware/base/text.h"
#include "firmware/store/recorder_database.h"

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
    next->id = batch->entry.id;
    next->sampled = 0;
    next->is_cut = false;
    batch->is_stray = false;
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
    enum { ENTRIES = 4, EVENTS = 1 << 16 }; /* at most: in a tick; since the last batch */
    tl_recorder_mark *next = &batch->next;
    tl_time now = tl_clock_now(NULL);
    uint64_t most = EVENTS + ENTRIES * (uint64_t)((now - next->counted) / batch->settings.file->record->step);
    next->counted = now;
    for (size_t i = 0; i < batch->settings.inbox->count; i++) {
        uint64_t lost = tl_recorder_inbox_lost(batch->settings.inbox, i, next->lost[i]);
        uint64_t more = lost - next->lost[i];
        tl_recorder_mark_lose(next, more <= most ? more : 0); /* else somebody has written over the count */
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

static tl_time step_of(const tl_recorder_batch *batch) {
    return batch->settings.file->record->step;
}

/* The first tick of the run at this instant or later; 0: the run is on no clock of ours. */
static int64_t tick_at(const tl_recorder_batch *batch, tl_time instant) {
    tl_time since = 0;
    bool fits = !__builtin_sub_overflow(instant, batch->next.start.resumption.start, &since);
    return fits && since > 0 && since < INT64_MAX - step_of(batch) ? (since - 1) / step_of(batch) + 1 : 0;
}

/* Its tick is later than now. In mode ahead the last one is a period early. */
static bool is_of_the_future(const tl_recorder_batch *batch) {
    return batch->settings.plant.take != NULL && !batch->next.is_untimed && batch->entry.kind == TL_ENTRY_SAMPLE &&
           batch->entry.sample.tick > tick_at(batch, tl_clock_now(NULL)) + 1;
}

/* Is it one of the run, and can it be written? Else it is dropped. */
static int write_part(tl_recorder_batch *batch, bool *written) {
    tl_recorder_mark *next = &batch->next;
    bool impossible = next->has_ended || is_of_the_future(batch);
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
    int64_t tick = batch->entry.sample.tick;
    bool written = false;
    int code = write_part(batch, &written);
    if (!written) {
        return code;
    }
    if (batch->entry.kind == TL_ENTRY_STEP) {
        next->totals.steps++;
        return code;
    }
    if (tick < next->sampled) { /* it was taken from what io has read */
        next->written--;
        return code;
    }
    next->totals.samples++;
    next->sampled = tick + 1;
    if (next->is_again && code == SQLITE_OK) {
        code = begin_at(batch, batch->entry.sample.tick);
        next->is_again = false;
    }
    return code;
}

/* ---- Samples that do not come by the ring ---- */

/* The next one that has to come. What a run follows at its beginning is the run's before. */
static int64_t next_tick(const tl_recorder_batch *batch) {
    const tl_recorder_mark *next = &batch->next;
    const tl_resumption *resumption = &next->start.resumption;
    int64_t own = resumption->from == TL_RESUMED_NOT ? 0 : resumption->tick;
    return next->sampled > own ? next->sampled : own;
}

/* How many ticks below this one are missing, of those of the past. */
static int64_t count_missing(const tl_recorder_batch *batch, int64_t end) {
    const tl_recorder_mark *next = &batch->next;
    int64_t present = tick_at(batch, tl_clock_now(NULL));
    bool can = batch->settings.plant.take != NULL && next->has_begun && !next->is_untimed && !next->has_ended &&
               next->ring == ring_of(batch); /* a run of another ring has another plant */
    end = end < present ? end : present;
    return can && end > next_tick(batch) ? end - next_tick(batch) : 0;
}

/* Below which tick none may be missing any more: the twin, or its successor, will put the others. In the end no writer is left. */
static int64_t oldest_awaited(const tl_recorder_batch *batch) {
    static const tl_time margin = 2 * TL_SECOND;
    tl_time lag = batch->settings.plant.kept - batch->settings.file->record->commit - margin;
    lag = batch->is_last ? 0 : lag > TL_SECOND ? lag : TL_SECOND;
    return tick_at(batch, tl_clock_now(NULL) - lag);
}

static int write_missing_sample(tl_recorder_batch *batch, int64_t tick) {
    const tl_recorder_plant *plant = &batch->settings.plant;
    tl_time start = batch->next.start.resumption.start;
    tl_sample *sample = &batch->entry.sample;
    plant->take(plant->context, tick, tl_time_of_step(start, step_of(batch), tick), sample);
    for (size_t i = 0; i < batch->settings.file->record->plant_count; i++) {
        sample->stamps[i] = tl_recorder_entry_stamp(start, sample->stamps[i]);
    }
    batch->entry.kind = TL_ENTRY_SAMPLE;
    tl_recorder_mark_lose(&batch->next, batch->next.is_cut ? 1 : 0); /* its step */
    int code = write_sample_or_step(batch);
    batch->next.sampled = tick + 1; /* also if it cannot be written */
    return code;
}

static size_t size_of_sample(const tl_recorder_batch *batch) {
    return tl_recorder_entry_size(&batch->settings.inbox->outboxes[ring_of(batch)].settings.shape, TL_ENTRY_SAMPLE);
}

static size_t bytes_of_missing(const tl_recorder_batch *batch, int64_t end, size_t limit) {
    int64_t missing = count_missing(batch, end);
    size_t most = limit / size_of_sample(batch) + 1;
    return size_of_sample(batch) * ((uint64_t)missing < most ? (size_t)missing : most);
}

/* Those below this tick, as many as fit. What io's memory has lost already is lost. Changes the entry. */
static int write_missing(tl_recorder_batch *batch, int64_t end, size_t limit) {
    tl_recorder_mark *next = &batch->next;
    int64_t missing = count_missing(batch, end);
    int64_t kept = tick_at(batch, tl_clock_now(NULL) - batch->settings.plant.kept);
    int code = SQLITE_OK;
    if (missing > 0 && next_tick(batch) < kept) {
        int64_t gone = kept - next_tick(batch) < missing ? kept - next_tick(batch) : missing;
        next->sampled = next_tick(batch) + gone;
        missing -= gone;
        tl_recorder_mark_lose(next, (uint64_t)gone);
    }
    for (size_t room = limit / size_of_sample(batch) + 1; missing > 0 && room > 0 && code == SQLITE_OK; room--) {
        code = write_missing_sample(batch, next_tick(batch));
        missing--;
    }
    return code;
}

/* The first tick of the run that will be another's, if the entry begins one. */
static int64_t tick_of_other(const tl_recorder_batch *batch) {
    const tl_resumption *other = &batch->entry.beginning;
    int64_t own = other->from == TL_RESUMED_NOT ? 0 : other->tick;
    tl_time past = 0;
    tl_time first = 0;
    bool fits =
        !__builtin_mul_overflow(own, step_of(batch), &past) && !__builtin_add_overflow(other->start, past, &first);
    return fits ? tick_at(batch, first) : 0;
}

/* ---- Entries ---- */

static void take_end(tl_recorder_batch *batch) {
    const char *hand_over = batch->settings.hand_over;
    batch->ends = !batch->next.has_ended;
    batch->next.has_ended = true;
    batch->next.hands_over = hand_over != NULL && strcmp(batch->entry.reason, hand_over) == 0;
}

/* Is it of another run than ours? Its clock is unknown without its beginning. */
static bool is_stray(tl_recorder_batch *batch) {
    if (batch->entry.kind == TL_ENTRY_SAMPLE) {
        batch->is_stray = batch->entry.id != batch->next.id;
        batch->next.is_cut = batch->next.is_cut && batch->is_stray;
    }
    return batch->is_stray && batch->entry.kind != TL_ENTRY_START;
}

static int write_entry(tl_recorder_batch *batch) {
    if (is_stray(batch)) {
        drop(batch);
        return SQLITE_OK;
    }
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

/* Which ticks have to be there before the entry: all below this one. At the end of a run the last ones may have been skipped. */
static int64_t end_of_missing(const tl_recorder_batch *batch) {
    bool ends = batch->entry.kind == TL_ENTRY_END && batch->next.is_cut && !batch->is_stray;
    bool is_own = batch->entry.kind == TL_ENTRY_SAMPLE && batch->entry.id == batch->next.id;
    return is_own ? batch->entry.sample.tick : ends ? tick_at(batch, tl_clock_now(NULL) - step_of(batch)) : 0;
}

/* After the samples that are missing before it. *is_more: there are more of those than fit. */
static int write_entry_in_turn(tl_recorder_batch *batch, uint64_t *position, uint64_t end, size_t limit,
                               bool *is_more) {
    int64_t awaited = end_of_missing(batch);
    int code = SQLITE_OK;
    if (count_missing(batch, awaited) > 0) {
        code = write_missing(batch, awaited, limit);
        *position = taken_of(batch)->ring;
        *is_more = count_missing(batch, awaited) > 0 || !take_entry(batch, position, end);
    }
    return code == SQLITE_OK && !*is_more ? write_entry(batch) : code;
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
        bool is_more = false;
        code = write_entry_in_turn(batch, &position, end, limit, &is_more);
        if (batch->is_over || is_more) {
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
    if (code == SQLITE_OK && !batch->is_over) {
        code = write_missing(batch, oldest_awaited(batch), limit);
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
    size_t missing = bytes_of_missing(batch, oldest_awaited(batch), limit);
    if (bytes == 0 && events == 0 && missing == 0 && !has_own && batch->next.run != 0) {
        return SQLITE_OK;
    }
    count_lost(batch);
    int code = begin_transaction(batch, bytes + missing + events * (size_t)EVENT_BYTES);
    if (code == SQLITE_OK) {
        code = write_all(batch, end, limit);
    }
    code = end_batch(batch, code);
    *more = mark_of(batch)->number != before &&
            (has_more(batch, end) || bytes_of_missing(batch, oldest_awaited(batch), limit) > missing);
    return code;
}

/* What is missing of the run before, in a transaction of its own. */
static int write_rest(tl_recorder_batch *batch, int64_t end, bool *more) {
    size_t limit = tl_recorder_database_batch(database_of(batch));
    int code = begin_transaction(batch, bytes_of_missing(batch, end, limit));
    if (code == SQLITE_OK) {
        code = write_missing(batch, end, limit);
    }
    code = end_batch(batch, code);
    *more = code == SQLITE_OK;
    return code;
}

int tl_recorder_batch_write(tl_recorder_batch *batch, uint64_t end, bool *more) {
    uint64_t position = 0;
    begin_batch(batch);
    *more = false;
    end = end_of(batch, end);
    bool has_early = batch->next.run != 0 && count_events(batch, taken_of(batch)->ring, 1) > 0;
    if (!has_early && is_beginning(batch, end, &position)) { /* else there are events of the run before */
        if (count_missing(batch, tick_of_other(batch)) > 0) {
            return write_rest(batch, tick_of_other(batch), more);
        }
        take_beginning(batch, position);
    } else if (!batch->next.has_begun) {
        drop_entries(batch, end);
        *more = has_more(batch, end);
        return SQLITE_OK;
    }
    return write_transaction(batch, end, more);
}

/* ---- Damage ------------------------------------------------------------------------------------------------------ */

void tl_recorder_batch_skip(tl_recorder_batch *batch, uint64_t position) {
    begin_batch(batch);
    if (!is_handed_over(batch) && position != taken_of(batch)->ring) {
        taken_of(batch)->ring = position;
        batch->next.is_cut = true;
        settle(batch);
    }
}

bool tl_recorder_batch_has_beginning(tl_recorder_batch *batch) {
    batch->next = *mark_of(batch);
    uint64_t position = taken_of(batch)->ring;
    return is_beginning(batch, end_of(batch, tl_recorder_inbox_end(batch->settings.inbox, position)), &position);
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
