/* The writer: see recorder_writer.h.
 *
 * A batch is formed in `next`, a copy of the mark of what is committed: positions, totals and the run move on in it with each thing that is written,
 * and become the mark when the transaction is committed. What fails is forgotten with it. */
#include "firmware/record/recorder_writer.h"

#include <assert.h>
#include <inttypes.h>
#include <sqlite3.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "firmware/base/clock.h"
#include "firmware/base/log.h"
#include "firmware/database/database_fault.h"
#include "firmware/database/database_instead.h"
#include "firmware/database/database_sql.h"
#include "firmware/outbox/outbox_reader.h"
#include "firmware/text/utc.h"

enum {
    FATE_TEXT = 80,    /* of one file */
    EVENT_BYTES = 256, /* what an event counts in a batch */
    MENDS = 3,         /* of a file, in one go */
    STALLS = 8, /* batches of events alone: who puts them out faster than they are written does not keep the caller */
    REFUSED_TO_OPEN = 1 << 16 /* among SQLite's codes: no file could be opened, for that fault */
};

static const tl_time PATIENCE = 2 * TL_SECOND; /* for what keeps a file from being opened, if that is an error */
static const tl_time PATIENCE_RUNNING = TL_SECOND / 10; /* for other programs, while entries wait */
static const tl_time LOSS_PAUSE = 10 * TL_SECOND;       /* between two events that say what a slow disk has cost */
static const tl_time OPEN_PAUSE = TL_SECOND / 10;       /* between two tries to open a file */
static const tl_time MEND_PAUSE = TL_SECOND;            /* between two looks at an outbox that is damaged */
static const tl_time CLOSE_PAUSE = TL_SECOND / 20;      /* between two tries when it closes */
static const tl_time CUT_PAUSE = TL_SECOND / 4;         /* until a file that is too short is looked at again */

#define LOST_MOST (UINT64_C(1) << 60)

typedef struct source {
    const char *name;
    const void *memory;
    tl_outbox_settings settings;
    tl_outbox_reader reader;
    bool is_damaged; /* and that was said */
} source;

struct tl_recorder_writer {
    tl_recorder_settings record;
    tl_recorder_writer_state *state;
    tl_heart *heart;
    source outboxes[TL_WRITER_OUTBOXES];
    size_t count;
    unsigned char *checkpoint; /* of the first outbox; NULL: it has none */

    tl_database_file file;
    tl_recorder_database *database; /* NULL: no file is open */
    bool goes_on;                   /* with a run that another writer began */
    bool is_kept;                   /* what that one wrote is still in its file, as far as we know */
    char fate[FATE_TEXT];           /* of the file before, as long as it is not said; "": nothing has happened to it */
    tl_time opened_at;              /* when that was tried the last time */
    tl_time mended_at;

    tl_recorder_mark next;   /* of the batch */
    tl_recorder_entry entry; /* too large for a small stack */
    bool is_over;            /* the next entry is for another batch */
    bool ends;               /* the run does, with this batch */

    tl_error failure;   /* the last one, with the file */
    char reason[192];   /* and without */
    int refusal;        /* its kind; 0: nothing is refused */
    uint64_t lost_said; /* of totals.lost, what an event has said */
    tl_time lost_said_at;
    tl_log_limiter limiter;
};

/* ---- What it says ------------------------------------------------------------------------------------------------ */

const char *tl_recorder_writer_path(const tl_recorder_writer *writer) {
    return writer->file.path[0] != '\0' ? writer->file.path : writer->record.path;
}

static void say(tl_recorder_writer *writer, tl_severity severity, const char *text) {
    tl_log_level level = severity == TL_EVENT_ERROR     ? TL_LOG_ERROR
                         : severity == TL_EVENT_WARNING ? TL_LOG_WARNING
                                                        : TL_LOG_NOTICE;
    tl_log_limited(&writer->limiter, level, "recorder: %s: %s", tl_recorder_writer_path(writer), text);
    tl_recorder_state_say(writer->state, severity, text);
}

static void say_loss(tl_recorder_writer *writer, const char *why) {
    char text[TL_EVENT_TEXT];
    uint64_t lost = tl_recorder_state_mark(writer->state)->totals.lost;
    if (lost > writer->lost_said) {
        (void)snprintf(text, sizeof text, "%" PRIu64 " samples, steps or events were lost: %s",
                       lost - writer->lost_said, why);
        writer->lost_said_at = tl_clock_now(NULL);
        say(writer, TL_EVENT_WARNING, text);
    }
    writer->lost_said = lost;
}

/* Once, as long as it is for the same reason. */
static void note_refusal(tl_recorder_writer *writer, int kind) {
    char text[TL_EVENT_TEXT];
    if (writer->refusal == 0) {
        tl_recorder_state_refuse(writer->state, tl_clock_now(NULL));
    }
    if (writer->refusal != kind) {
        (void)snprintf(text, sizeof text, "cannot write: %.160s; trying again", writer->reason);
        say(writer, TL_EVENT_ERROR, text);
    }
    writer->refusal = kind;
}

static void note_success(tl_recorder_writer *writer) {
    char text[TL_EVENT_TEXT];
    if (writer->refusal != 0) {
        tl_time pause = tl_clock_now(NULL) - tl_recorder_state_get(writer->state).refused_since;
        writer->refusal = 0;
        tl_recorder_state_refuse(writer->state, 0);
        (void)snprintf(text, sizeof text, "writes again after %.1f s", tl_seconds(pause));
        say(writer, TL_EVENT_INFO, text);
        say_loss(writer, "the database could not be written");
    } else if (tl_clock_now(NULL) - writer->lost_said_at >= LOSS_PAUSE) {
        say_loss(writer, "they came faster than the disk takes them");
    }
}

static void note_refusal_to_open(tl_recorder_writer *writer) {
    (void)snprintf(writer->reason, sizeof writer->reason, "%.180s", writer->failure.text);
    note_refusal(writer, REFUSED_TO_OPEN + (int)tl_database_get_fault());
}

/* Before the roll-back, which has words of its own. */
static void keep_words(tl_recorder_writer *writer, int code) {
    tl_database_text(writer->file.connection, code, writer->reason, sizeof writer->reason);
    (void)tl_database_fail(writer->file.connection, code, &writer->failure);
}

/* ---- A batch ----------------------------------------------------------------------------------------------------- */

/* What comes next, if it is the beginning of another run: then the entry is that. */
static bool is_beginning(tl_recorder_writer *writer, uint64_t end, uint64_t *position) {
    *position = writer->next.taken[0].ring;
    return *position != end && tl_outbox_reader_entry(&writer->outboxes[0].reader, position, end, &writer->entry) &&
           writer->entry.kind == TL_ENTRY_START && !writer->next.is_untimed;
}

static tl_outbox_start start_of(const tl_recorder_writer *writer) {
    tl_outbox_start start = {.holds = writer->entry.holds, .resumption = writer->entry.beginning};
    if (!start.holds) {
        start.account = writer->entry.account;
    }
    if (start.resumption.run < 0) {
        start.resumption.run = writer->next.run; /* the one before */
    }
    return start;
}

/* The entry begins a run, whatever became of the one before. */
static void take_beginning(tl_recorder_writer *writer, uint64_t position) {
    tl_recorder_mark *next = &writer->next;
    next->start = start_of(writer);
    next->totals = (tl_recorder_totals){.lost = next->run != 0 ? 0 : next->totals.lost}; /* not said in any row yet */
    next->run = 0;
    next->has_ended = false;
    next->is_again = false;
    next->own = 0;
    next->has_begun = true;
    next->taken[0].ring = position;
    writer->goes_on = false;
}

static uint64_t more_of(uint64_t now, uint64_t before) {
    return now > before ? now - before : 0;
}

/* A row takes no count that is larger. */
static uint64_t lose(uint64_t lost, uint64_t more) {
    return more > LOST_MOST - lost ? LOST_MOST : lost + more;
}

/* What producers have lost since the last batch is lost of this run. */
static void count_lost(tl_recorder_writer *writer) {
    tl_recorder_mark *next = &writer->next;
    for (size_t i = 0; i < writer->count; i++) {
        uint64_t lost = tl_outbox_reader_lost(&writer->outboxes[i].reader);
        next->totals.lost = lose(next->totals.lost, more_of(lost, next->lost[i]));
        next->lost[i] = lost;
    }
}

static void drop(tl_recorder_writer *writer) {
    writer->next.dropped++;
    writer->next.totals.lost = lose(writer->next.totals.lost, 1);
}

static int write_row(tl_recorder_writer *writer) {
    tl_recorder_mark *next = &writer->next;
    int code = SQLITE_OK;
    if (next->run == 0) {
        code = tl_recorder_database_begin_run(writer->database, &next->start, !next->is_untimed, &next->run);
    } else if (writer->goes_on && !next->has_ended) {
        code = tl_recorder_database_go_on(writer->database);
    }
    return code;
}

static int write_own_events(tl_recorder_writer *writer) {
    tl_recorder_mark *next = &writer->next;
    int code = SQLITE_OK;
    for (; next->said < writer->state->own_said && code == SQLITE_OK; next->said++) {
        code = tl_recorder_database_event(writer->database, &writer->state->own[next->said % TL_WRITER_OWN_EVENTS]);
        next->totals.events++;
        next->own++;
    }
    return code;
}

/* The event of this number, if all entries are written that were put before it; *skip: it is none. */
static bool read_event(tl_recorder_writer *writer, size_t i, uint64_t number, uint64_t written,
                       tl_recorder_event_entry *event, bool *skip) {
    return tl_outbox_reader_event(&writer->outboxes[i].reader, number, event, skip) &&
           (i != 0 || *skip || event->position <= written);
}

/* The oldest event of all outboxes that may be written now; of two of the same instant that of the later outbox, since what io says is
 * often why the twin says something. The outbox, or `count`: there is none. */
static size_t oldest_event(tl_recorder_writer *writer, uint64_t written, tl_recorder_event_entry *oldest, bool *skip) {
    size_t found = writer->count;
    tl_recorder_event_entry event;
    bool skips = false;
    for (size_t i = 0; i < writer->count; i++) {
        if (read_event(writer, i, writer->next.taken[i].events, written, &event, &skips) &&
            (found == writer->count || skips || event.at <= oldest->at)) {
            found = i;
            *oldest = event;
            *skip = skips;
        }
    }
    return found;
}

static int write_events(tl_recorder_writer *writer, size_t most) {
    tl_recorder_mark *next = &writer->next;
    uint64_t written = next->taken[0].ring;
    tl_recorder_event_entry event = {.at = 0};
    bool skip = false;
    int code = SQLITE_OK;
    for (size_t n = 0; n < most && code == SQLITE_OK; n++) {
        size_t from = oldest_event(writer, written, &event, &skip);
        if (from == writer->count) {
            break;
        }
        code = skip ? SQLITE_OK : tl_recorder_database_event(writer->database, &event);
        next->totals.events += skip ? 0 : 1;
        next->written += skip ? 0 : 1;
        next->taken[from].events++;
    }
    return code;
}

static int write_sample_or_step(tl_recorder_writer *writer) {
    tl_recorder_mark *next = &writer->next;
    bool impossible = next->has_ended;
    int code = SQLITE_OK;
    if (!impossible) {
        code = tl_recorder_database_entry(writer->database, &writer->entry, &impossible);
    }
    if (impossible) {
        drop(writer);
        return SQLITE_OK;
    }
    next->written++;
    if (writer->entry.kind == TL_ENTRY_STEP) {
        next->totals.steps++;
        return code;
    }
    next->totals.samples++;
    if (next->is_again && code == SQLITE_OK) {
        code = tl_recorder_database_begin_at(writer->database, writer->entry.sample.tick);
        next->is_again = false;
    }
    return code;
}

/* A beginning that only tells when it was; any other one is for another batch. */
static int write_start(tl_recorder_writer *writer) {
    tl_recorder_mark *next = &writer->next;
    if (!next->is_untimed) {
        writer->is_over = true;
        return SQLITE_OK;
    }
    next->is_untimed = false;
    next->start.resumption = start_of(writer).resumption;
    return tl_recorder_database_start(writer->database, &next->start.resumption);
}

static int write_entry(tl_recorder_writer *writer) {
    switch (writer->entry.kind) {
    case TL_ENTRY_START:
        return write_start(writer);
    case TL_ENTRY_END:
        writer->ends = !writer->next.has_ended;
        writer->next.has_ended = true;
        return SQLITE_OK;
    default:
        return write_sample_or_step(writer);
    }
}

/* Up to the end of a run, the beginning of another, or so many bytes. */
static int write_entries(tl_recorder_writer *writer, uint64_t end, size_t limit) {
    uint64_t *taken = &writer->next.taken[0].ring;
    uint64_t first = *taken;
    int code = SQLITE_OK;
    writer->is_over = false;
    while (*taken != end && *taken - first < limit && code == SQLITE_OK && !writer->ends) {
        uint64_t position = *taken;
        if (!tl_outbox_reader_entry(&writer->outboxes[0].reader, &position, end, &writer->entry)) {
            break;
        }
        code = write_entry(writer);
        if (writer->is_over) {
            break;
        }
        *taken = position;
    }
    return code;
}

/* The batch is whole: it is tried, and is the mark if the database takes it. */
static int commit(tl_recorder_writer *writer) {
    tl_recorder_mark *next = &writer->next;
    tl_utc_text(tl_utc_now(), next->totals.committed);
    (void)snprintf(next->path, sizeof next->path, "%s", writer->file.path);
    next->identity = tl_database_identify(&writer->file);
    tl_recorder_state_try(writer->state, next);
    return tl_recorder_database_commit(writer->database, &next->totals, writer->ends ? writer->entry.reason : NULL);
}

static int end_batch(tl_recorder_writer *writer, int code) {
    if (code == SQLITE_OK) {
        code = commit(writer);
    }
    if (code != SQLITE_OK) {
        keep_words(writer, code);
        tl_recorder_database_rollback(writer->database);
        return code;
    }
    tl_recorder_state_settle(writer->state);
    writer->goes_on = false;
    code = tl_recorder_database_tidy(writer->database);
    if (code != SQLITE_OK) {
        keep_words(writer, code);
    }
    return code;
}

static void begin_batch(tl_recorder_writer *writer) {
    tl_heart_beat(writer->heart);
    writer->next = *tl_recorder_state_mark(writer->state);
    writer->next.number++;
    writer->ends = false;
}

static int begin_transaction(tl_recorder_writer *writer, size_t bytes) {
    size_t configuration = writer->next.run == 0 ? strlen(writer->record.configuration) : 0;
    int code = tl_recorder_database_begin(writer->database, writer->next.run, bytes + configuration);
    return code == SQLITE_OK ? write_row(writer) : code;
}

/* Those that can be written once the ring is as far, of each outbox at most so many. */
static size_t count_events(tl_recorder_writer *writer, uint64_t written, size_t most) {
    tl_recorder_event_entry event;
    size_t events = 0;
    bool skip = false;
    for (size_t i = 0; i < writer->count; i++) {
        uint64_t number = writer->next.taken[i].events;
        for (size_t n = 0; n < most && read_event(writer, i, number, written, &event, &skip); n++) {
            number++;
            events++;
        }
    }
    return events;
}

/* Entries that belong to no run: there is nothing to write them to. */
static void drop_entries(tl_recorder_writer *writer, uint64_t end) {
    uint64_t position = writer->next.taken[0].ring;
    while (position != end && tl_outbox_reader_entry(&writer->outboxes[0].reader, &position, end, &writer->entry) &&
           writer->entry.kind != TL_ENTRY_START) {
        writer->next.taken[0].ring = position;
        drop(writer);
    }
    if (writer->next.taken[0].ring != tl_recorder_state_mark(writer->state)->taken[0].ring) {
        tl_recorder_state_try(writer->state, &writer->next);
        tl_recorder_state_settle(writer->state);
    }
}

/* One transaction, of entries up to `end` of the ring, or to where another run begins, and events as far as they fit. *more says whether it should be
 * followed by another one. */
static int write_batch(tl_recorder_writer *writer, uint64_t end, bool *more) {
    uint64_t position = 0;
    begin_batch(writer);
    *more = false;
    bool has_early = writer->next.run != 0 && count_events(writer, writer->next.taken[0].ring, 1) > 0;
    if (!has_early && is_beginning(writer, end, &position)) { /* else there are events of the run before */
        take_beginning(writer, position);
    } else if (!writer->next.has_begun) {
        drop_entries(writer, end);
        *more =
            tl_recorder_state_mark(writer->state)->taken[0].ring != end && writer->outboxes[0].reader.fault[0] == '\0';
        return SQLITE_OK;
    }
    size_t limit = tl_recorder_database_batch(writer->database);
    uint64_t left = end - writer->next.taken[0].ring;
    size_t bytes = left < limit ? (size_t)left : limit;
    size_t events = count_events(writer, end, limit / EVENT_BYTES);
    bool has_own = writer->next.said != writer->state->own_said;
    if (bytes == 0 && events == 0 && !has_own && writer->next.run != 0) {
        return SQLITE_OK;
    }
    count_lost(writer);
    int code = begin_transaction(writer, bytes + events * (size_t)EVENT_BYTES);
    if (code == SQLITE_OK) {
        code = write_own_events(writer);
    }
    if (code == SQLITE_OK) {
        code = write_entries(writer, end, limit);
    }
    if (code == SQLITE_OK) {
        code = write_events(writer, limit / EVENT_BYTES);
    }
    uint64_t before = tl_recorder_state_mark(writer->state)->number;
    code = end_batch(writer, code);
    const tl_recorder_mark *mark = tl_recorder_state_mark(writer->state);
    *more = mark->number != before && mark->taken[0].ring != end && writer->outboxes[0].reader.fault[0] == '\0';
    return code;
}

/* In a transaction of its own, once all that came before it is there. *any: there was one. */
static int write_checkpoint(tl_recorder_writer *writer, bool *any) {
    size_t size = 0;
    int64_t tick = 0;
    const tl_recorder_mark *mark = tl_recorder_state_mark(writer->state);
    tl_outbox_taken taken = mark->taken[0];
    *any = writer->checkpoint != NULL && mark->run != 0 &&
           tl_outbox_reader_checkpoint(&writer->outboxes[0].reader, taken.checkpoint, taken.ring, writer->checkpoint,
                                       &size, &tick, &taken.checkpoint);
    if (!*any) {
        return SQLITE_OK;
    }
    begin_batch(writer);
    writer->next.taken[0].checkpoint = taken.checkpoint;
    int code = begin_transaction(writer, size);
    if (code == SQLITE_OK) {
        code = tl_recorder_database_checkpoint(writer->database, tick, writer->checkpoint, size);
    }
    return end_batch(writer, code);
}

/* An outbox has two; who puts them without end is looked at again later. */
static int write_checkpoints(tl_recorder_writer *writer) {
    enum { AT_ONCE = 2 };
    bool any = true;
    int code = SQLITE_OK;
    for (int i = 0; i < AT_ONCE && any && code == SQLITE_OK; i++) {
        code = write_checkpoint(writer, &any);
    }
    return code;
}

/* ---- Files ------------------------------------------------------------------------------------------------------- */

static uint64_t entries_of(const tl_recorder_mark *mark) {
    return mark->totals.samples + mark->totals.steps + more_of(mark->totals.events, mark->own);
}

/* The run is in a file that is not written any more: it begins again in the next one. `gone`: and that one is no more. */
static void leave_run(tl_recorder_writer *writer, bool gone) {
    tl_recorder_mark *next = &writer->next;
    begin_batch(writer);
    if (gone) {
        next->dropped += entries_of(next);
        next->written = more_of(next->written, entries_of(next));
        next->totals.lost = lose(next->totals.lost, entries_of(next));
        writer->lost_said += entries_of(next); /* with its fate */
    }
    next->is_again = next->is_again || next->totals.samples > 0;
    next->has_begun = next->has_begun && !next->has_ended;
    next->has_ended = false;
    next->run = 0;
    next->own = 0;
    next->totals = (tl_recorder_totals){.lost = next->has_begun ? next->totals.lost : 0};
    tl_recorder_state_try(writer->state, next);
    tl_recorder_state_settle(writer->state);
}

/* What has become of the file that the run was in; not said yet. */
static void note_fate(tl_recorder_writer *writer, const char *fate) {
    (void)snprintf(writer->fate, sizeof writer->fate, "%s with %" PRIu64 " samples, steps and events of this run", fate,
                   entries_of(tl_recorder_state_mark(writer->state)));
}

static void tell_fate(tl_recorder_writer *writer, const char *end) {
    char text[TL_EVENT_TEXT];
    if (writer->fate[0] != '\0') {
        (void)snprintf(text, sizeof text, "was %s%s", writer->fate, end);
        say(writer, TL_EVENT_ERROR, text);
    }
    writer->fate[0] = '\0';
}

static void tell_beside(tl_recorder_writer *writer, const char *why) {
    char text[TL_EVENT_TEXT + 2 * FATE_TEXT];
    bool has_fate = writer->fate[0] != '\0';
    (void)snprintf(text, sizeof text, "is recorded into instead%s%s: %.180s", has_fate ? " of one that was " : "",
                   writer->fate, why);
    say(writer, TL_EVENT_ERROR, text);
    writer->fate[0] = '\0';
}

static void tell_aside(tl_recorder_writer *writer, const tl_database_aside *aside) {
    char text[TL_EVENT_TEXT + 2 * FATE_TEXT];
    const char *name = strrchr(aside->name, '/');
    bool has_fate = writer->fate[0] != '\0';
    (void)snprintf(text, sizeof text, "was %s%sdamaged, is called %.60s now, and was made anew: %.100s", writer->fate,
                   has_fate ? "; what took its place was " : "", name == NULL ? aside->name : name + 1, aside->why);
    say(writer, TL_EVENT_ERROR, text);
    writer->fate[0] = '\0';
}

/* Of the file that is open now, and why it is another one. */
static void tell_news(tl_recorder_writer *writer, const tl_database_news *news) {
    if (news->aside.name[0] != '\0') {
        tell_aside(writer, &news->aside);
    }
    if (news->beside[0] != '\0') {
        tell_beside(writer, news->beside);
    }
    tell_fate(writer, ", and is made anew");
}

static bool is_same(const tl_recorder_totals *totals, const tl_recorder_totals *other) {
    return totals->samples == other->samples && totals->steps == other->steps && totals->events == other->events &&
           totals->lost == other->lost && strcmp(totals->committed, other->committed) == 0;
}

/* Is the run in this file as the mark says? */
static int is_there(tl_recorder_writer *writer, const tl_recorder_mark *mark, bool *there) {
    tl_recorder_totals totals = {.lost = 0};
    *there = false;
    if (mark->run == 0 || strcmp(mark->path, writer->file.path) != 0) {
        return SQLITE_OK;
    }
    int code = tl_recorder_database_find(writer->database, mark->run, there, &totals);
    *there = *there && is_same(&totals, &mark->totals);
    return code;
}

/* The writer before us wrote another file. What is in that is lost unless it is still there, only not for us to write, or was put aside. */
static void leave_kept(tl_recorder_writer *writer, const tl_database_news *news) {
    bool is_aside = news->aside.name[0] != '\0';
    bool is_here = strcmp(tl_recorder_state_mark(writer->state)->path, writer->file.path) == 0 && !is_aside;
    bool gone = !writer->is_kept || is_here;
    if (gone) {
        note_fate(writer, "gone");
    }
    leave_run(writer, gone);
}

/* How far the writer before us came; and whether what it wrote is here. */
static int find_run(tl_recorder_writer *writer, const tl_database_news *news) {
    const tl_recorder_mark *mark = tl_recorder_state_mark(writer->state);
    const tl_recorder_mark *tried = tl_recorder_state_tried(writer->state);
    bool there = false;
    int code = SQLITE_OK;
    if (tried != NULL && (tried->run != mark->run || !is_same(&tried->totals, &mark->totals))) {
        code = is_there(writer, tried, &there);
        if (there) {
            tl_recorder_state_settle(writer->state);
        }
    }
    mark = tl_recorder_state_mark(writer->state);
    if (code == SQLITE_OK && !there && mark->run != 0) {
        code = is_there(writer, mark, &there);
        if (code == SQLITE_OK && !there) {
            leave_kept(writer, news);
        }
    }
    writer->goes_on = there;
    return code;
}

static int begin_use(void *context, sqlite3 *connection) {
    tl_recorder_writer *writer = context;
    return tl_recorder_database_open(connection, &writer->record, &writer->database);
}

static void end_use(void *context) {
    tl_recorder_writer *writer = context;
    tl_recorder_database_close(writer->database);
    writer->database = NULL;
}

static void close_file(tl_recorder_writer *writer) {
    end_use(writer);
    tl_database_file_close(&writer->file);
}

/* Logs of ours beside files that are not: they would be played into those. */
static void remove_stray_logs(const tl_recorder_writer *writer) {
    const tl_recorder_mark *mark = tl_recorder_state_mark(writer->state);
    const tl_recorder_mark *tried = tl_recorder_state_tried(writer->state);
    tl_database_remove_stray_log(mark->path, &mark->identity);
    if (tried != NULL) {
        tl_database_remove_stray_log(tried->path, &tried->identity);
    }
}

/* A file that the writer before us was writing, though another one was asked for. */
static tl_status open_kept(tl_recorder_writer *writer) {
    const tl_database_user user = {begin_use, end_use, writer};
    const tl_recorder_mark *mark = tl_recorder_state_mark(writer->state);
    writer->is_kept = !tl_database_is_gone(mark->path, &mark->identity);
    if (mark->run == 0 || access(mark->path, F_OK) != 0) {
        return TL_BAD_DATA;
    }
    tl_status status = tl_database_file_open(mark->path, 0, &user, &writer->file, NULL, NULL);
    if (status != TL_OK && tl_database_get_fault() == TL_DATABASE_FOREIGN) { /* somebody has written into it */
        writer->is_kept = false;
    }
    return status;
}

static tl_status open_file(tl_recorder_writer *writer, tl_database_insistence insistence, tl_database_news *news,
                           bool *waits) {
    const tl_database_user user = {begin_use, end_use, writer};
    const tl_database_wanted wanted = {.path = writer->record.path,
                                       .patience = insistence == TL_DATABASE_ANYHOW ? 0 : PATIENCE,
                                       .insistence = insistence,
                                       .user = &user};
    *news = (tl_database_news){.beside = ""};
    *waits = false;
    remove_stray_logs(writer);
    tl_status status = open_kept(writer);
    return status == TL_OK ? TL_OK : tl_database_instead_open(&wanted, &writer->file, news, waits, &writer->failure);
}

static bool replace_damaged(tl_recorder_writer *writer) {
    const tl_database_user user = {begin_use, end_use, writer};
    tl_database_news news = {.beside = ""};
    tl_error why = writer->failure;
    end_use(writer);
    leave_run(writer, false);
    tl_status status = tl_database_file_renew(&writer->file, why.text, &user, &news.aside, &writer->failure);
    if (status != TL_OK && tl_database_get_fault() == TL_DATABASE_FOREIGN) { /* it stays where it is */
        status =
            tl_database_instead_beside(writer->record.path, why.text, &user, &writer->file, &news, &writer->failure);
    }
    tell_news(writer, &news);
    return status == TL_OK;
}

/* What was in it is no more, or somewhere else. That is said with what is written instead. */
static void leave_file(tl_recorder_writer *writer, tl_database_whereabouts found) {
    bool gone = found != TL_DATABASE_MOVED;
    note_fate(writer, found == TL_DATABASE_MOVED     ? "moved away"
                      : found == TL_DATABASE_REMOVED ? "removed"
                                                     : "overwritten");
    leave_run(writer, gone);
    if (gone) {
        end_use(writer);
        tl_database_file_abandon(&writer->file);
    } else {
        close_file(writer);
    }
    writer->opened_at = 0;
}

/* What it holds is known to us still: it is brought into the file, which is opened anew, with a log that has a name. */
static bool restore_log(tl_recorder_writer *writer) {
    if (!tl_database_file_write_back(&writer->file)) {
        return false;
    }
    say(writer, TL_EVENT_WARNING, "its log, -wal, was removed: what it held is written back, and it is made anew");
    close_file(writer);
    writer->opened_at = 0;
    return true;
}

/* It may look well again when it is opened: so it is not. */
static bool replace_denied(tl_recorder_writer *writer) {
    const tl_database_user user = {begin_use, end_use, writer};
    tl_database_news news = {.beside = ""};
    tl_error why = writer->failure;
    close_file(writer);
    tl_status status =
        tl_database_instead_beside(writer->record.path, why.text, &user, &writer->file, &news, &writer->failure);
    if (status != TL_OK) {
        return false;
    }
    leave_run(writer, false);
    tell_news(writer, &news);
    return true;
}

/* Something else can be done about it than to try again; true: at once. */
static bool mend(tl_recorder_writer *writer, int code) {
    switch (tl_database_fault_of(code, 0)) {
    case TL_DATABASE_DAMAGED:
        return replace_damaged(writer);
    case TL_DATABASE_DENIED:
        return replace_denied(writer);
    default:
        return false;
    }
}

/* Whoever overwrites a file empties it first: what is put aside then would be theirs. */
static tl_database_whereabouts look(tl_recorder_writer *writer) {
    tl_database_whereabouts found = tl_database_file_look(&writer->file);
    if (found == TL_DATABASE_CUT) {
        tl_clock_sleep_until(tl_clock_now(NULL) + CUT_PAUSE);
        found = tl_database_file_look(&writer->file);
    }
    return found;
}

/* What others have done to the file, which SQLite would go on to write. True: something was done about it, and perhaps none is open. */
static bool look_after_file(tl_recorder_writer *writer) {
    tl_database_whereabouts found = look(writer);
    switch (found) {
    case TL_DATABASE_IN_PLACE:
        return false;
    case TL_DATABASE_WITHOUT_LOG:
        return restore_log(writer);
    case TL_DATABASE_CUT:
        (void)tl_fail(&writer->failure, TL_BAD_DATA, "%s: was cut off", writer->file.path);
        (void)replace_damaged(writer);
        return true;
    default:
        leave_file(writer, found);
        return true;
    }
}

/* Is there a file to write into? Tries to open one every now and then. */
static bool is_open(tl_recorder_writer *writer) {
    tl_database_news news;
    bool waits = false;
    if (writer->database != NULL) {
        return true;
    }
    if (tl_clock_now(NULL) - writer->opened_at < OPEN_PAUSE) {
        return false;
    }
    writer->opened_at = tl_clock_now(NULL);
    if (open_file(writer, TL_DATABASE_ANYHOW, &news, &waits) != TL_OK) {
        tell_fate(writer, "");
        note_refusal_to_open(writer);
        return false;
    }
    tl_database_file_set_patience(&writer->file, PATIENCE_RUNNING);
    int code = find_run(writer, &news);
    tell_news(writer, &news);
    if (code != SQLITE_OK) {
        keep_words(writer, code);
    }
    if (code != SQLITE_OK && !mend(writer, code)) {
        note_refusal(writer, code & 0xFF);
        close_file(writer);
    }
    return writer->database != NULL;
}

/* ---- Writing ----------------------------------------------------------------------------------------------------- */

/* What is there now. */
static int write_all(tl_recorder_writer *writer) {
    uint64_t end =
        tl_outbox_reader_end(&writer->outboxes[0].reader, tl_recorder_state_mark(writer->state)->taken[0].ring);
    bool more = true;
    int stalls = 0;
    int code = SQLITE_OK;
    while (more && code == SQLITE_OK && stalls < STALLS) {
        uint64_t before = tl_recorder_state_mark(writer->state)->taken[0].ring;
        code = write_batch(writer, end, &more);
        stalls += tl_recorder_state_mark(writer->state)->taken[0].ring == before ? 1 : 0;
        if (code == SQLITE_OK) {
            code = write_checkpoints(writer);
        }
    }
    if (code == SQLITE_OK) {
        note_success(writer);
        code = write_batch(writer, tl_recorder_state_mark(writer->state)->taken[0].ring, &more);
    }
    return code;
}

static int write_and_note(tl_recorder_writer *writer) {
    unsigned before = tl_recorder_database_writings_back(writer->database);
    int code = write_all(writer);
    if (tl_recorder_database_writings_back(writer->database) != before) {
        tl_database_file_note(&writer->file);
    }
    return code;
}

/* A damaged outbox may have been mended by its producer's successor. */
static void look_after_outboxes(tl_recorder_writer *writer) {
    bool again = tl_clock_now(NULL) - writer->mended_at >= MEND_PAUSE;
    writer->mended_at = again ? tl_clock_now(NULL) : writer->mended_at;
    for (size_t i = 0; i < writer->count && again; i++) {
        source *outbox = &writer->outboxes[i];
        if (outbox->reader.fault[0] != '\0') {
            tl_outbox_reader_open(&outbox->settings, outbox->memory, &outbox->reader);
        } else {
            outbox->is_damaged = false;
        }
    }
}

static void say_damaged_outboxes(tl_recorder_writer *writer) {
    char text[TL_EVENT_TEXT];
    for (size_t i = 0; i < writer->count; i++) {
        source *outbox = &writer->outboxes[i];
        if (outbox->reader.fault[0] != '\0' && !outbox->is_damaged) {
            outbox->is_damaged = true;
            (void)snprintf(text, sizeof text, "what %s has put out cannot be read on: %.160s", outbox->name,
                           outbox->reader.fault);
            say(writer, TL_EVENT_ERROR, text);
        }
    }
}

void tl_recorder_writer_write(tl_recorder_writer *writer) {
    int code = SQLITE_OK;
    int mends = 0;
    bool again = true;
    tl_heart_beat(writer->heart);
    look_after_outboxes(writer);
    while (again && is_open(writer)) {
        if (mends < MENDS && look_after_file(writer)) {
            mends++;
            continue;
        }
        code = write_and_note(writer);
        again = code != SQLITE_OK && mends++ < MENDS && mend(writer, code);
        if (code != SQLITE_OK && !again) {
            note_refusal(writer, code & 0xFF);
        }
    }
    say_damaged_outboxes(writer);
}

bool tl_recorder_writer_is_pressed(tl_recorder_writer *writer) {
    uint64_t taken = tl_recorder_state_mark(writer->state)->taken[0].ring;
    uint64_t end = tl_outbox_reader_end(&writer->outboxes[0].reader, taken);
    return end - taken > writer->outboxes[0].settings.ring_bytes / 2;
}

/* Entries and events that are not written. */
static uint64_t count_left(tl_recorder_writer *writer) {
    const tl_recorder_mark *mark = tl_recorder_state_mark(writer->state);
    uint64_t position = mark->taken[0].ring;
    uint64_t end = tl_outbox_reader_end(&writer->outboxes[0].reader, position);
    uint64_t left = 0;
    writer->next = *mark;
    while (position != end && tl_outbox_reader_entry(&writer->outboxes[0].reader, &position, end, &writer->entry)) {
        left += writer->entry.kind == TL_ENTRY_SAMPLE || writer->entry.kind == TL_ENTRY_STEP ? 1 : 0;
    }
    return left + (mark->has_begun ? count_events(writer, UINT64_MAX, TL_RECORDER_EVENTS) : 0);
}

bool tl_recorder_writer_is_empty(tl_recorder_writer *writer) {
    const tl_recorder_mark *mark = tl_recorder_state_mark(writer->state);
    uint64_t end = tl_outbox_reader_end(&writer->outboxes[0].reader, mark->taken[0].ring);
    bool is_read = mark->taken[0].ring == end || writer->outboxes[0].reader.fault[0] != '\0';
    bool needs_row = mark->has_begun && mark->run == 0;
    writer->next = *mark;
    return is_read && !needs_row && (!mark->has_begun || count_events(writer, UINT64_MAX, 1) == 0);
}

/* ---- Opening and closing ----------------------------------------------------------------------------------------- */

/* The run that begins at once, in a file that is new to us. */
static tl_status begin_first(tl_recorder_writer *writer, const tl_outbox_start *first,
                             tl_database_insistence insistence) {
    bool more = false;
    begin_batch(writer);
    writer->next.start = *first;
    writer->next.has_begun = true;
    writer->next.is_untimed = true;
    tl_recorder_state_try(writer->state, &writer->next);
    tl_recorder_state_settle(writer->state);
    if (writer->database == NULL) {
        return TL_OK;
    }
    int code = write_batch(writer, writer->next.taken[0].ring, &more);
    return code != SQLITE_OK && insistence == TL_DATABASE_ALL_OR_NOTHING ? writer->failure.status : TL_OK;
}

static tl_status open_all(tl_recorder_writer *writer, const tl_recorder_writer_settings *settings) {
    tl_database_news news;
    bool waits = false;
    bool is_new = tl_recorder_state_mark(writer->state)->number == 0 && tl_recorder_state_tried(writer->state) == NULL;
    tl_database_insistence insistence = is_new ? settings->record->insistence : TL_DATABASE_ANYHOW;
    if (!is_new) {
        (void)is_open(writer); /* and if it is not, it will be */
        return TL_OK;
    }
    tl_status status = open_file(writer, insistence, &news, &waits);
    if (status != TL_OK && !waits) {
        return status;
    }
    if (status == TL_OK) {
        tell_news(writer, &news);
    } else {
        note_refusal_to_open(writer);
    }
    status = settings->first == NULL ? TL_OK : begin_first(writer, settings->first, insistence);
    if (writer->database != NULL) {
        tl_database_file_set_patience(&writer->file, PATIENCE_RUNNING);
    }
    return status;
}

static tl_recorder_writer *make(const tl_recorder_writer_settings *settings) {
    assert(settings->outbox_count >= 1 && settings->outbox_count <= TL_WRITER_OUTBOXES);
    tl_recorder_writer *writer = calloc(1, sizeof *writer);
    if (writer == NULL) {
        return NULL;
    }
    writer->record = *settings->record;
    writer->record.component_count = settings->outboxes[0].settings.shape.components;
    writer->state = settings->state;
    writer->heart = settings->heart;
    writer->count = settings->outbox_count;
    writer->file = (tl_database_file)TL_DATABASE_FILE_NONE;
    writer->lost_said_at = tl_clock_now(NULL) - LOSS_PAUSE;
    writer->lost_said = tl_recorder_state_mark(writer->state)->totals.lost;
    writer->limiter = (tl_log_limiter)TL_LOG_LIMITER(5);
    for (size_t i = 0; i < writer->count; i++) {
        const tl_recorder_writer_outbox *given = &settings->outboxes[i];
        writer->outboxes[i] = (source){.name = given->name, .memory = given->memory, .settings = given->settings};
        tl_outbox_reader_open(&given->settings, given->memory, &writer->outboxes[i].reader);
    }
    return writer;
}

static void destroy(tl_recorder_writer *writer) {
    close_file(writer);
    tl_log_limiter_end(&writer->limiter);
    free(writer->checkpoint);
    free(writer);
}

tl_status tl_recorder_writer_open(const tl_recorder_writer_settings *settings, tl_recorder_writer **writer,
                                  tl_error *error) {
    const char *path = settings->record->path;
    size_t checkpoint = settings->outboxes[0].settings.checkpoint_bytes;
    tl_recorder_writer *opened = make(settings);
    *writer = NULL;
    if (opened == NULL) {
        return tl_fail(error, TL_TRY_AGAIN, "%s: out of memory", path);
    }
    opened->checkpoint = checkpoint == 0 ? NULL : malloc(checkpoint);
    if (checkpoint != 0 && opened->checkpoint == NULL) {
        destroy(opened);
        return tl_fail(error, TL_TRY_AGAIN, "%s: out of memory", path);
    }
    tl_recorder_state_show(opened->state);
    tl_status status = open_all(opened, settings);
    if (status != TL_OK) {
        (void)tl_fail(error, status, "%s", opened->failure.text);
        destroy(opened);
        return status;
    }
    *writer = opened;
    return TL_OK;
}

/* Entries, events, or words of its own. */
static bool has_more(tl_recorder_writer *writer) {
    const tl_recorder_mark *mark = tl_recorder_state_mark(writer->state);
    bool has_words = mark->has_begun && mark->said != writer->state->own_said;
    return has_words || !tl_recorder_writer_is_empty(writer);
}

tl_status tl_recorder_writer_close(tl_recorder_writer *writer, tl_time patience, tl_error *error) {
    const struct timespec pause = {.tv_nsec = (long)CLOSE_PAUSE};
    tl_time began = tl_clock_now(NULL);
    tl_status status = TL_OK;
    if (writer == NULL) {
        return TL_OK;
    }
    say_loss(writer, "they came faster than the disk takes them");
    tl_recorder_writer_write(writer);
    while (has_more(writer) && tl_clock_now(NULL) - began < patience) {
        (void)nanosleep(&pause, NULL);
        tl_recorder_writer_write(writer);
    }
    if (!tl_recorder_writer_is_empty(writer)) {
        uint64_t left = count_left(writer);
        tl_recorder_state_drop(writer->state, left);
        status =
            tl_fail(error, TL_TRY_AGAIN, "%s: the run's end and its last %" PRIu64 " entries could not be written: %s",
                    tl_recorder_writer_path(writer), left, writer->reason);
    }
    destroy(writer);
    return status;
}
