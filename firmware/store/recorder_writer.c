/* The writer: see recorder_writer.h. What it reads is the inbox, what it writes a batch, and where to the file: each has its own source. */
#include "firmware/store/recorder_writer.h"

#include <inttypes.h>
#include <sqlite3.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#include "firmware/base/os.h"
#include "firmware/store/database_sql.h"
#include "firmware/store/recorder_batch.h"
#include "firmware/store/recorder_file.h"

enum {
    MENDS = 3,  /* of a file, in one go */
    STALLS = 8, /* batches of events alone: who puts them out faster than they are written does not keep the caller */
    REFUSED_TO_OPEN = 1 << 16 /* among SQLite's codes: no file could be opened, for that fault */
};

static const tl_time LOSS_PAUSE = 10 * TL_SECOND;  /* between two events that say what a slow disk has cost */
static const tl_time CLOSE_PAUSE = TL_SECOND / 20; /* between two tries when it closes */

struct tl_recorder_writer {
    tl_recorder_settings record;
    tl_recorder_writer_state *state;
    tl_heart *heart;
    bool is_last;
    tl_recorder_inbox inbox;
    tl_recorder_file file;
    tl_recorder_batch batch;
    unsigned char *checkpoint; /* of the outbox with the ring; NULL: it has none */
    int refusal;               /* the kind of the last failure; 0: nothing is refused */
    tl_time lost_said_at;
    bool was_corrupted; /* an outbox, since the last loss that was said */
};

const char *tl_recorder_writer_path(const tl_recorder_writer *writer) {
    return tl_recorder_file_path(&writer->file);
}

static uint64_t taken_of_ring(const tl_recorder_writer *writer) {
    return tl_recorder_state_mark(writer->state)->taken[writer->inbox.ring].ring;
}

/* ---- What it says ------------------------------------------------------------------------------------------------ */

static const char *why_lost(const tl_recorder_writer *writer) {
    return writer->was_corrupted || tl_recorder_state_mark(writer->state)->is_cut
               ? "their queue was corrupted"
               : "they came faster than the recorder could write them";
}

static void say_loss(tl_recorder_writer *writer, const char *why) {
    char text[TL_EVENT_TEXT];
    uint64_t lost = tl_recorder_state_mark(writer->state)->totals.lost;
    if (lost > writer->file.lost_said) {
        uint64_t more = lost - writer->file.lost_said;
        (void)snprintf(text, sizeof text, "%" PRIu64 " %s lost: %s", more,
                       more == 1 ? "sample, step or event was" : "samples, steps or events were", why);
        writer->lost_said_at = tl_clock_now(NULL);
        writer->was_corrupted = false;
        tl_recorder_file_say(&writer->file, TL_EVENT_WARNING, text);
    }
    writer->file.lost_said = lost;
}

/* Once, as long as it is for the same reason. */
static void note_refusal(tl_recorder_writer *writer, int kind) {
    char text[TL_EVENT_TEXT];
    if (writer->refusal == 0) {
        tl_recorder_state_refuse(writer->state, tl_clock_now(NULL));
    }
    if (writer->refusal != kind) {
        (void)snprintf(text, sizeof text, "cannot write: %.160s; trying again", writer->file.reason);
        tl_recorder_file_say(&writer->file, TL_EVENT_ERROR, text);
    }
    writer->refusal = kind;
}

static void note_refusal_to_open(tl_recorder_writer *writer) {
    tl_recorder_file *file = &writer->file;
    (void)snprintf(file->reason, sizeof file->reason, "%.180s", file->failure.text);
    note_refusal(writer, REFUSED_TO_OPEN + (int)tl_database_get_fault());
}

static void note_success(tl_recorder_writer *writer) {
    char text[TL_EVENT_TEXT];
    if (writer->refusal != 0) {
        tl_time pause = tl_clock_now(NULL) - tl_recorder_state_get(writer->state).refused_since;
        writer->refusal = 0;
        tl_recorder_state_refuse(writer->state, 0);
        (void)snprintf(text, sizeof text, "writes again after %.1f s", tl_seconds(pause));
        tl_recorder_file_say(&writer->file, TL_EVENT_INFO, text);
        say_loss(writer, "the database could not be written");
    } else if (tl_clock_now(NULL) - writer->lost_said_at >= LOSS_PAUSE) {
        say_loss(writer, why_lost(writer));
    }
}

static void say_damage(tl_recorder_writer *writer) {
    char text[TL_EVENT_TEXT];
    while (tl_recorder_inbox_tell(&writer->inbox, text, sizeof text)) {
        writer->was_corrupted = true;
        tl_recorder_file_say(&writer->file, TL_EVENT_ERROR, text);
    }
}

/* ---- Writing ----------------------------------------------------------------------------------------------------- */

/* Is there a file to write into? Tries to open one every now and then. */
static bool is_open(tl_recorder_writer *writer) {
    tl_recorder_file *file = &writer->file;
    tl_database_news news;
    bool waits = false;
    if (file->database != NULL) {
        return true;
    }
    if (!tl_recorder_file_is_due(file)) {
        return false;
    }
    if (tl_recorder_file_open(file, TL_DATABASE_ANYHOW, &news, &waits) != TL_OK) {
        tl_recorder_file_tell_none(file);
        note_refusal_to_open(writer);
        return false;
    }
    tl_recorder_file_hurry(file);
    int code = tl_recorder_file_find_run(file, &news);
    tl_recorder_file_tell(file, &news);
    if (code != SQLITE_OK) {
        tl_recorder_file_keep_words(file, code);
    }
    if (code != SQLITE_OK && !tl_recorder_file_mend(file, code)) {
        note_refusal(writer, code & 0xFF);
        tl_recorder_file_close(file);
    }
    return file->database != NULL;
}

/* What is there now. */
static int write_all(tl_recorder_writer *writer) {
    uint64_t end = tl_recorder_inbox_end(&writer->inbox, taken_of_ring(writer));
    bool more = true;
    int stalls = 0;
    int code = SQLITE_OK;
    while (more && code == SQLITE_OK && stalls < STALLS) {
        uint64_t before = taken_of_ring(writer);
        code = tl_recorder_batch_write(&writer->batch, end, &more);
        stalls += taken_of_ring(writer) == before ? 1 : 0;
        if (code == SQLITE_OK) {
            code = tl_recorder_batch_write_checkpoints(&writer->batch);
        }
    }
    if (code == SQLITE_OK) {
        note_success(writer);
        code = tl_recorder_batch_write(&writer->batch, taken_of_ring(writer), &more);
    }
    return code;
}

static int write_and_note(tl_recorder_writer *writer) {
    unsigned before = tl_recorder_database_writings_back(writer->file.database);
    int code = write_all(writer);
    if (tl_recorder_database_writings_back(writer->file.database) != before) {
        tl_database_file_note(&writer->file.file);
    }
    return code;
}

void tl_recorder_writer_write(tl_recorder_writer *writer) {
    int code = SQLITE_OK;
    int mends = 0;
    bool again = true;
    tl_time begun = tl_clock_now(NULL);
    tl_heart_beat(writer->heart);
    tl_recorder_inbox_mend(&writer->inbox);
    tl_recorder_batch_skip(&writer->batch, tl_recorder_inbox_skip(&writer->inbox, taken_of_ring(writer)));
    while (again && is_open(writer)) {
        if (mends < MENDS && tl_recorder_file_look_after(&writer->file)) {
            mends++;
            tl_heart_beat(writer->heart);
            continue;
        }
        code = write_and_note(writer);
        again = code != SQLITE_OK && mends++ < MENDS && tl_recorder_file_mend(&writer->file, code);
        if (code != SQLITE_OK && !again) {
            note_refusal(writer, code & 0xFF);
        }
    }
    tl_recorder_inbox_note_damage(&writer->inbox, begun);
    say_damage(writer);
}

tl_time tl_recorder_writer_damage(const tl_recorder_writer *writer, size_t outbox) {
    return tl_recorder_inbox_damage(&writer->inbox, outbox);
}

void tl_recorder_writer_leave(tl_recorder_writer *writer) {
    tl_recorder_inbox_leave(&writer->inbox);
}

bool tl_recorder_writer_has_drained(tl_recorder_writer *writer) {
    return tl_recorder_batch_has_drained(&writer->batch);
}

bool tl_recorder_writer_is_pressed(tl_recorder_writer *writer) {
    uint64_t taken = taken_of_ring(writer);
    uint64_t end = tl_recorder_inbox_end(&writer->inbox, taken);
    bool is_full = end - taken > writer->inbox.outboxes[writer->inbox.ring].settings.ring_bytes / 2;
    return writer->refusal == 0 && (is_full || tl_recorder_batch_has_beginning(&writer->batch));
}

/* ---- Opening and closing ----------------------------------------------------------------------------------------- */

/* The run that begins at once, in a file that is new to us. */
static tl_status begin_first(tl_recorder_writer *writer, const tl_outbox_start *first,
                             tl_database_insistence insistence) {
    bool more = false;
    tl_recorder_batch_begin_run(&writer->batch, first);
    if (writer->file.database == NULL) {
        return TL_OK;
    }
    int code = tl_recorder_batch_write(&writer->batch, taken_of_ring(writer), &more);
    return code != SQLITE_OK && insistence == TL_DATABASE_ALL_OR_NOTHING ? writer->file.failure.status : TL_OK;
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
    tl_status status = tl_recorder_file_open(&writer->file, insistence, &news, &waits);
    if (status != TL_OK && !waits) {
        return status;
    }
    if (status == TL_OK) {
        tl_recorder_file_tell(&writer->file, &news);
    } else {
        note_refusal_to_open(writer);
    }
    status = settings->first == NULL ? TL_OK : begin_first(writer, settings->first, insistence);
    if (writer->file.database != NULL) {
        tl_recorder_file_hurry(&writer->file);
    }
    return status;
}

static tl_recorder_writer *make(const tl_recorder_writer_settings *settings) {
    tl_recorder_writer *writer = calloc(1, sizeof *writer);
    if (writer == NULL) {
        return NULL;
    }
    writer->record = *settings->record;
    writer->record.component_count = settings->outboxes[settings->ring].settings.shape.components;
    writer->state = settings->state;
    writer->heart = settings->heart;
    writer->is_last = settings->is_last;
    writer->lost_said_at = tl_clock_now(NULL) - LOSS_PAUSE;
    tl_recorder_inbox_open(&writer->inbox, settings->outboxes, settings->outbox_count, settings->ring);
    tl_recorder_file_begin(&writer->file, &writer->record, writer->state);
    writer->file.lost_said = tl_recorder_state_mark(writer->state)->totals.lost;
    writer->batch.settings = (tl_recorder_batch_settings){.file = &writer->file,
                                                          .inbox = &writer->inbox,
                                                          .state = writer->state,
                                                          .heart = writer->heart,
                                                          .hand_over = settings->hand_over,
                                                          .goes_on = settings->goes_on,
                                                          .plant = settings->plant,
                                                          .context = settings->context};
    return writer;
}

static bool make_checkpoint(tl_recorder_writer *writer, size_t size) {
    writer->checkpoint = size == 0 ? NULL : malloc(size);
    writer->batch.settings.checkpoint = writer->checkpoint;
    return size == 0 || writer->checkpoint != NULL;
}

static void destroy(tl_recorder_writer *writer) {
    tl_recorder_file_end(&writer->file);
    free(writer->checkpoint);
    free(writer);
}

tl_status tl_recorder_writer_open(const tl_recorder_writer_settings *settings, tl_recorder_writer **writer,
                                  tl_error *error) {
    const char *path = settings->record->path;
    tl_recorder_writer *opened = make(settings);
    *writer = NULL;
    if (opened == NULL) {
        return tl_fail(error, TL_TRY_AGAIN, "%s: out of memory", path);
    }
    if (!make_checkpoint(opened, settings->outboxes[settings->ring].settings.checkpoint_bytes)) {
        destroy(opened);
        return tl_fail(error, TL_TRY_AGAIN, "%s: out of memory", path);
    }
    tl_recorder_state_show(opened->state);
    tl_status status = open_all(opened, settings);
    if (status != TL_OK) {
        (void)tl_fail(error, status, "%s", opened->file.failure.text);
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
    return has_words || !tl_recorder_batch_is_empty(&writer->batch);
}

tl_status tl_recorder_writer_close(tl_recorder_writer *writer, tl_time patience, tl_error *error) {
    const struct timespec pause = {.tv_nsec = (long)CLOSE_PAUSE};
    tl_time began = tl_clock_now(NULL);
    tl_status status = TL_OK;
    if (writer == NULL) {
        return TL_OK;
    }
    if (writer->is_last) {
        tl_recorder_inbox_leave(&writer->inbox);
    }
    writer->batch.is_last = writer->is_last;
    say_loss(writer, why_lost(writer));
    tl_recorder_writer_write(writer);
    while (has_more(writer) && tl_clock_now(NULL) - began < patience) {
        (void)nanosleep(&pause, NULL);
        tl_recorder_writer_write(writer);
    }
    if (!tl_recorder_batch_is_empty(&writer->batch)) {
        uint64_t left = tl_recorder_batch_count_left(&writer->batch);
        tl_recorder_state_drop(writer->state, left);
        status =
            tl_fail(error, TL_TRY_AGAIN, "%s: the run's end and its last %" PRIu64 " entries could not be written: %s",
                    tl_recorder_writer_path(writer), left, writer->file.reason);
    } else if (writer->is_last && writer->file.database != NULL) {
        (void)tl_recorder_database_give_up(writer->file.database); /* else the next writer does that */
    }
    destroy(writer);
    return status;
}
