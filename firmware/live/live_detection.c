/* Change detection of a live run: see live_detection.h. */
#include "firmware/live/live_detection.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "firmware/base/log.h"
#include "firmware/base/os.h"
#include "firmware/monitor/change_detector.h"
#include "firmware/monitor/change_storage.h"
#include "firmware/twin/explanation.h"

/* Interval of storing: at most this, and at most a part of the learning time. */
static const tl_time INTERVAL = 3600 * TL_SECOND;
enum { PARTS_OF_LEARNING = 24 };

static const tl_time ACCEPTING = TL_SECOND;

struct tl_live_detection {
    const tl_config *config;
    tl_recorder_writer_state *state;
    tl_change_detector *detector; /* NULL: no run yet, or memory is out */
    tl_account account;           /* of the present run */
    tl_change_storage storage;
    int64_t started; /* t_start of the present run, ms since 1970 UTC */
    uint64_t run;    /* its id in the record queue */
    int64_t tick;    /* of the newest sample */
    tl_time stored;  /* when it was stored last */
    tl_time interval;
    tl_time accepted; /* when it was asked last what a user has accepted */
    double checked;   /* instant of the last check for due explanations, s since t_start; NaN: none yet */
    bool is_watched;  /* the present run has a twin */
    bool is_stray;    /* the newest sample was of another run */
    bool is_read;     /* what was learnt before was read, or there is nothing */
    bool is_due;      /* a finding has changed */
    bool is_new;      /* learning has begun at zero */
    bool is_removed;  /* a user has removed it, and no row was stored since then */
};

/* Findings are warnings; what follows needs no attention. */
static void report_finding(void *context, int64_t tick, const tl_finding *finding, tl_finding_turn turn) {
    tl_live_detection *self = context;
    char sentence[TL_FINDING_TEXT];
    char cause[TL_FINDING_TEXT];
    char text[2 * TL_FINDING_TEXT + 16];
    bool is_new = turn == TL_FINDING_FOUND;
    tl_finding_write(finding, finding->found, self->started, sentence);
    tl_finding_write_cause(finding, cause);
    (void)snprintf(text, sizeof text, "%s%s%s", sentence, cause[0] == '\0' ? "" : "; cause: ", cause);
    tl_log(is_new ? TL_LOG_WARNING : TL_LOG_NOTICE, "finding: %s", text);
    tl_recorder_state_add_event(self->state, tick, is_new ? TL_EVENT_WARNING : TL_EVENT_INFO, "finding", text);
    self->is_due = true;
}

static void report_notice(tl_live_detection *self, const char *text) {
    tl_log(TL_LOG_NOTICE, "finding: %s", text);
    tl_recorder_state_add_event(self->state, -1, TL_EVENT_INFO, "finding", text);
}

tl_live_detection *tl_live_detection_create(const tl_config *config, tl_recorder_writer_state *state) {
    tl_live_detection *self = calloc(1, sizeof *self);
    if (self != NULL) {
        self->config = config;
        self->state = state;
        self->stored = tl_clock_now(NULL);
        self->interval = config->detect_learn / PARTS_OF_LEARNING;
        self->interval = self->interval < INTERVAL ? self->interval : INTERVAL;
    }
    return self;
}

static void begin_run(tl_live_detection *self, const tl_recorder_entry *entry) {
    self->run = entry->id;
    self->is_watched = !entry->start.holds;
    self->is_stray = false;
    self->checked = (double)NAN;
    if (!self->is_watched) {
        return;
    }
    self->account = entry->start.account;
    self->started = entry->start.resumption.started;
    if (self->detector == NULL) {
        self->detector = tl_change_detector_create(self->config, &self->account, report_finding, self);
    }
    if (self->detector != NULL) {
        tl_change_detector_begin(self->detector, &self->account, self->started);
    }
}

/* The process of the FMUs may have written any number. */
static bool is_possible(const tl_live_detection *self, const tl_recorder_entry *entry) {
    int64_t most = INT64_MAX / 4 / self->config->step;
    int64_t tick = entry->kind == TL_ENTRY_SAMPLE ? entry->sample.tick : entry->record.step;
    return (entry->kind == TL_ENTRY_SAMPLE || entry->kind == TL_ENTRY_STEP) && tick >= 0 && tick < most;
}

void tl_live_detection_observe(tl_live_detection *self, const tl_recorder_entry *entry) {
    if (entry->kind == TL_ENTRY_START) {
        begin_run(self, entry);
    }
    if (self->detector == NULL || !self->is_watched || !is_possible(self, entry)) {
        return;
    }
    if (entry->kind == TL_ENTRY_SAMPLE) {
        self->is_stray = entry->id != self->run;
        self->tick = entry->sample.tick;
    }
    if (entry->kind == TL_ENTRY_SAMPLE && !self->is_stray) {
        tl_change_detector_sample(self->detector, &entry->sample);
    } else if (entry->kind == TL_ENTRY_STEP && !self->is_stray) {
        tl_change_detector_step(self->detector, self->tick, &entry->record);
    }
}

/* Continues with what was learnt before; what was learnt since this process began is dropped.
 * Returns false if the bytes are of another configuration. */
static bool continue_with(tl_live_detection *self, const unsigned char *bytes, size_t size) {
    tl_change_detector *earlier = tl_change_detector_create(self->config, &self->account, report_finding, self);
    if (earlier == NULL) {
        return false;
    }
    if (tl_change_detector_load(earlier, bytes, size)) {
        tl_change_detector_begin(earlier, &self->account, self->started);
        tl_change_detector_destroy(self->detector);
        self->detector = earlier;
        return true;
    }
    report_notice(self, "the variables, the step or the cycle have changed: learning begins at zero");
    tl_change_detector_destroy(earlier);
    return false;
}

static void read_earlier(tl_live_detection *self, tl_recorder_writer *writer) {
    unsigned char *bytes = NULL;
    size_t size = 0;
    uint32_t last = 0;
    if (!tl_recorder_writer_read_learned(writer, &bytes, &size, &last)) {
        return;
    }
    if (bytes == NULL && size != 0) {
        report_notice(self, "what was learnt is damaged in the database: learning begins at zero");
    }
    bool continues = bytes != NULL && continue_with(self, bytes, size);
    self->is_new = self->is_new || !continues;
    self->is_due = true; /* the row may say that it was removed */
    free(bytes);
    tl_change_detector_number_from(self->detector, last, !continues);
    self->is_read = true;
}

/* A user has asked for it (finding_notes.h). */
static void learn_again(tl_live_detection *self) {
    tl_change_detector *other = tl_change_detector_create(self->config, &self->account, report_finding, self);
    if (other == NULL) {
        return;
    }
    tl_change_detector_begin(other, &self->account, self->started);
    tl_change_detector_destroy(self->detector);
    self->detector = other;
    self->is_read = false; /* for the numbers of the next findings */
    self->is_removed = true;
    report_notice(self, "what was learnt was removed: learning begins at zero");
}

/* What a user has accepted as normal (finding_notes.h). */
static void accept_findings(tl_live_detection *self, tl_recorder_writer *writer) {
    char text[TL_EVENT_TEXT];
    uint32_t number = 0;
    while (tl_recorder_writer_next_normal(writer, number, &number)) {
        const tl_change_acceptance acceptance = tl_change_detector_accept(self->detector, number);
        if (acceptance != TL_ACCEPTANCE_NONE) {
            (void)snprintf(text, sizeof text, "the level of finding %" PRIu32 " %s", number,
                           acceptance == TL_ACCEPTANCE_DONE
                               ? "counts as normal from now on"
                               : "is not known any more: if it returns, accept the new finding");
            report_notice(self, text);
            self->is_due = true;
        }
    }
}

void tl_live_detection_store(tl_live_detection *self, tl_recorder_writer *writer, bool at_end) {
    tl_time now = tl_clock_now(NULL);
    if (self->detector == NULL || !self->is_watched) { /* a run in safe hold has no findings */
        return;
    }
    if (self->is_read && !self->is_removed && tl_recorder_writer_is_removed(writer)) {
        learn_again(self);
    }
    if (!self->is_read) {
        read_earlier(self, writer);
    }
    if (self->is_read && now - self->accepted >= ACCEPTING) {
        accept_findings(self, writer);
        self->accepted = now;
    }
    if (!self->is_read || !(at_end || self->is_due || now - self->stored >= self->interval) ||
        !tl_change_storage_fill(&self->storage, self->config, self->detector)) {
        return;
    }
    self->storage.changes.is_new = self->is_new;
    if (tl_recorder_writer_keep(writer, &self->storage.changes)) {
        self->is_due = self->is_new = self->is_removed = false;
        self->stored = now;
    }
}

uint32_t tl_live_detection_count_open(const tl_live_detection *self) {
    uint32_t open = 0;
    if (self->detector != NULL) {
        const tl_changes changes = tl_change_detector_get(self->detector);
        for (size_t i = 0; i < changes.count; i++) {
            open += tl_finding_is_open(&changes.finding[i]) ? 1 : 0;
        }
    }
    return open;
}

/* Only what the present run has recorded can be explained. A frozen signal explains itself. */
uint32_t tl_live_detection_take_due(tl_live_detection *self) {
    uint32_t number = 0;
    if (self->detector == NULL || !self->is_watched) {
        return 0;
    }
    const tl_changes changes = tl_change_detector_get(self->detector);
    const double step = tl_seconds(self->config->step);
    const double reaction = (double)tl_explanation_reaction(self->config->released_steps) * step;
    const double now = (double)self->tick * step;
    for (size_t i = 0; i < changes.count; i++) {
        const tl_finding *finding = &changes.finding[i];
        const double due[] = {finding->found + reaction, finding->onset + TL_EXPLANATION_AFTER * reaction};
        bool is_usable = tl_finding_is_open(finding) && finding->kind != TL_FINDING_FREEZE && finding->onset > 0.0;
        for (size_t k = 0; k < sizeof due / sizeof due[0] && is_usable; k++) {
            number = self->checked < due[k] && due[k] <= now ? finding->number : number;
        }
    }
    self->checked = now;
    return number;
}

void tl_live_detection_close(tl_live_detection *self) {
    if (self != NULL) {
        tl_change_storage_release(&self->storage);
        tl_change_detector_destroy(self->detector);
        free(self);
    }
}
