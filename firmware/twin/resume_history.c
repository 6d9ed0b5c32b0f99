/* Resume points from the database: see resume.h. */
#include "firmware/twin/resume.h"

#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "firmware/base/identity.h"
#include "firmware/base/os.h"
#include "firmware/base/text.h"

enum {
    CHECKPOINTS_MOST = 8,              /* most that are tried; a run keeps three */
    CHECKPOINT_BYTES = 8 * 1024 * 1024 /* the recorder writes no larger ones to a database */
};

static const tl_time CLOCKS_APART = 10 * TL_SECOND;

/* Progress of the search. */
typedef enum handover_block { FRESH, AT_CHECKPOINTS, AT_INPUTS, OVER } handover_block;

struct tl_resume_history {
    tl_resume_history_settings settings;
    tl_history *history;
    handover_block handover_block;
    const tl_history_run *run; /* the run to resume */
    int64_t last;              /* its last tick that has a step */
    tl_time start;             /* its t_start on the present clock */
    tl_time gap;               /* ns since `last` */
    tl_time ended;             /* last tick of a run that is not resumed; 0: unknown */
    int64_t most;              /* most ticks that can be followed */
    int tried;                 /* number of checkpoints tried */
    int64_t before;            /* all of them at this tick or later */
    tl_resume_ticks ticks;
    const tl_history_tuning *applied; /* tunings applied by the run */
    size_t applied_count;
    tl_run_tuning tunings[TL_RESUME_TUNINGS];
    tl_resume found;
    char why[TL_RESUME_WHY]; /* why a new run begins; "": not worth reporting */
};

/* ---- choice of the run ---- */

/* The last tick whose step is recorded; −1: none. */
static tl_status last_tick(tl_resume_history *self, const tl_history_run *run, int64_t *tick, tl_error *error) {
    int64_t step = -1;
    tl_status status = tl_history_last_step(self->history, run, &step, error);
    *tick = step < 0 ? -1 : step + (int64_t)run->lead;
    if (status == TL_OK && *tick > tl_history_last_possible(run)) {
        status = tl_fail(error, TL_BAD_DATA, "%s: is damaged: the step numbers of run %" PRId64 " are impossible",
                         self->settings.path, run->run);
    }
    return status;
}

/* Finds the newest run with a step of its own. A run that ended before that contains nothing that
 * the run before it does not. */
static tl_status find_run(tl_resume_history *self, tl_error *error) {
    const tl_history_run *runs = NULL;
    size_t count = 0;
    int fruitless = 0;
    tl_status status = tl_history_runs(self->history, &runs, &count, error);
    for (size_t i = count; status == TL_OK && i-- > 0 && self->run == NULL && fruitless < TL_RESUME_FRUITLESS;) {
        int64_t own = runs[i].resumption.from == TL_RESUMED_NOT ? 0 : runs[i].resumption.tick;
        if (strcmp(runs[i].verb, "run") != 0) {
            continue;
        }
        status = last_tick(self, &runs[i], &self->last, error);
        if (self->last < own) {
            fruitless++;
        } else {
            self->run = &runs[i];
        }
    }
    if (status == TL_OK && self->run == NULL && fruitless == TL_RESUME_FRUITLESS) {
        (void)tl_resume_refuse(self->why, "the last %d runs ended before their first own step", TL_RESUME_FRUITLESS);
    }
    return status;
}

static bool is_same(tl_resume_history *self) {
    const tl_history_run *run = self->run;
    const char *at_end =
        self->applied_count != 0 ? self->applied[self->applied_count - 1].hash : run->configuration_hash;
    const char *missing = run->fmus[0] == '\0'   ? "the hash of its FMU files"
                          : run->boot[0] == '\0' ? "its boot ID"
                          : !run->has_start      ? "its start time"
                                                 : NULL;
    if (missing != NULL) {
        return tl_resume_refuse(self->why, "the record of run %" PRId64 " is incomplete: %s is missing", run->run,
                                missing);
    }
    if (strcmp(at_end, self->settings.config->hash) != 0) {
        return tl_resume_refuse(self->why, "the configuration has changed since run %" PRId64, run->run);
    }
    return strcmp(run->fmus, self->settings.fmus) == 0 ||
           tl_resume_refuse(self->why, "the FMU files have changed since run %" PRId64, run->run);
}

/* ---- time of its end ---- */

/* Finds the time without a running twin. Returns false if it is unknown. After a reboot it is
 * computed from UTC: t_start was stored to the ms. If the clock was set during the run, the last
 * commit counts instead, because it came soon after the last tick. */
static bool find_gap(tl_resume_history *self, tl_time now) {
    static const tl_time ms = TL_SECOND / 1000;
    const tl_history_run *run = self->run;
    int64_t started = 0;
    int64_t committed = 0;
    if (strcmp(self->settings.boot, run->boot) == 0) {
        self->gap = now - tl_time_of_step(run->start, run->step, self->last);
        return run->has_start;
    }
    if (!tl_utc_parse(run->started, &started) || !tl_utc_parse(run->committed, &committed)) {
        return false;
    }
    int64_t last = started + tl_time_of_step(0, run->step, self->last) / ms;
    bool set = committed < last - CLOCKS_APART / ms || committed > last + CLOCKS_APART / ms;
    int64_t since = tl_utc_now() - (set ? committed : last);
    bool fits = since > -INT64_MAX / ms && since < INT64_MAX / ms;
    self->gap = fits ? since * ms : -INT64_MAX;
    return true;
}

/* Checks if there is a run to resume; if not, `why` may contain the reason. */
static tl_status find_resume(tl_resume_history *self, bool *found, tl_error *error) {
    tl_status status = find_run(self, error);
    const tl_history_run *run = self->run;
    *found = false;
    if (status == TL_OK && run != NULL) {
        status = tl_history_tunings(self->history, run, &self->applied, &self->applied_count, error);
    }
    if (status != TL_OK || run == NULL) {
        return status;
    }
    tl_time now = tl_clock_now(NULL);
    bool can_resume = tl_resume_was_interrupted(run->run, run->ended_reason, self->why) && is_same(self);
    bool is_known = find_gap(self, now);
    if (!can_resume && is_known && self->gap >= 0) {
        self->ended = now - self->gap;
    }
    if (can_resume && !is_known) {
        can_resume =
            tl_resume_refuse(self->why, "the record of run %" PRId64 " is incomplete: its time is missing", run->run);
    }
    *found = can_resume &&
             tl_resume_is_in_time(run->run, self->settings.config, self->last, self->gap, run->lead, self->why);
    if (*found) {
        self->start = now - self->gap - tl_time_of_step(0, run->step, self->last);
        self->most = tl_resume_most_followed(tl_history_execution_cost(self->history, run), self->settings.components);
    }
    return status;
}

/* Reads the ticks from `from` on, up to a gap. Reads one more than can be followed, to detect that
 * there are too many. */
static tl_status read_ticks(tl_resume_history *self, int64_t from, tl_error *error) {
    return tl_resume_ticks_read(&self->ticks, self->history, self->run, from, self->most + 1, error);
}

/* ---- tunings ---- */

/* A text that is not a valid configuration any more is skipped: nothing is searched with it. */
static bool read_tuning(tl_resume_history *self, const char *hash, int64_t tick, tl_run_tuning *tuning) {
    const char *text = NULL;
    tl_error error;
    *tuning = (tl_run_tuning){.tick = tick};
    (void)snprintf(tuning->hash, sizeof tuning->hash, "%s", hash);
    return tl_history_configuration_text(self->history, hash, &text, &error) == TL_OK &&
           tl_config_tuning_of(self->settings.config, text, &tuning->values, &error) == TL_OK;
}

/* Reads the tuning that applied at `first`, and the newest later ones up to `last`. */
static size_t read_tunings(tl_resume_history *self, int64_t first, int64_t last) {
    size_t from = 0; /* first tuning after that one */
    size_t to = 0;
    for (size_t i = 0; i < self->applied_count; i++) {
        from = self->applied[i].tick <= first ? i + 1 : from;
        to = self->applied[i].tick <= last ? i + 1 : to;
    }
    bool own = from == 0;
    const char *hash = own ? self->run->configuration_hash : self->applied[from - 1].hash;
    size_t count = read_tuning(self, hash, own ? 0 : self->applied[from - 1].tick, &self->tunings[0]) ? 1 : 0;
    from = to > from + TL_RESUME_TUNINGS - 1 ? to - (TL_RESUME_TUNINGS - 1) : from;
    for (size_t i = from; i < to; i++) {
        count += read_tuning(self, self->applied[i].hash, self->applied[i].tick, &self->tunings[count]) ? 1 : 0;
    }
    return count;
}

/* Makes the resume point from the ticks that were read, up to `last`. */
static void make_point(tl_resume_history *self, tl_resumed_from from, int64_t last,
                       const tl_history_checkpoint *checkpoint) {
    int64_t started = 0;
    size_t tunings = self->applied_count != 0 ? read_tunings(self, self->ticks.first, last) : 0;
    (void)tl_utc_parse(self->run->started, &started);
    self->found = (tl_resume){
        .from = from,
        .run = self->run->run,
        .first = self->ticks.first,
        .last = last,
        .step = self->run->step,
        .start_s = self->run->experiment.start_s,
        .start = self->start,
        .started = started,
        .checkpoint = checkpoint != NULL ? checkpoint->bytes : NULL,
        .checkpoint_size = checkpoint != NULL ? checkpoint->size : 0,
        .tunings = (const unsigned char *)self->tunings,
        .tuning_count = tunings,
        .shape = self->ticks.shape,
        .ticks = self->ticks.bytes,
    };
    tl_resume_identify(self->settings.config, self->found.signals);
}

/* Returns why the checkpoint cannot be loaded; NULL: try it. */
static const char *find_fault(const tl_history_checkpoint *checkpoint) {
    char format[TL_IDENTITY_TEXT];
    tl_identity_format(format);
    if (!checkpoint->whole) {
        return "its bytes are damaged";
    }
    if (strcmp(checkpoint->format, format) != 0) {
        return "another version of twinlock, or another machine, saved it";
    }
    return checkpoint->size == 0 ? "it is empty" : checkpoint->size > CHECKPOINT_BYTES ? "it is too large" : NULL;
}

/* Checks how far the ticks after a checkpoint reach. In mode ahead that may be one tick more. */
static tl_status try_checkpoint(tl_resume_history *self, const tl_history_checkpoint *checkpoint, bool *found,
                                tl_error *error) {
    tl_status status = read_ticks(self, checkpoint->tick + 1, error);
    int64_t last = tl_resume_ticks_last(&self->ticks, self->ticks.first);
    if (status != TL_OK || last < self->last || last - checkpoint->tick > self->most) {
        return status;
    }
    const char *fault = find_fault(checkpoint);
    if (fault != NULL) {
        tl_resume_report(self->settings.report, self->settings.context, TL_EVENT_WARNING,
                         "the checkpoint of tick %" PRId64 " of run %" PRId64 " cannot be loaded: %s", checkpoint->tick,
                         self->run->run, fault);
        return TL_OK;
    }
    make_point(self, TL_RESUMED_CHECKPOINT, last, checkpoint);
    *found = true;
    return TL_OK;
}

/* Without a checkpoint: the whole run if there is time to follow it, else its newest ticks. */
static tl_status find_inputs(tl_resume_history *self, bool *found, tl_error *error) {
    int64_t range[2] = {0};
    bool any = false;
    tl_status status = tl_history_range(self->history, self->run, TL_HISTORY_SAMPLES, INT64_MIN, range, &any, error);
    if (status == TL_OK && any) {
        bool long_ago = self->last - range[0] + 1 > self->most;
        status = read_ticks(self, long_ago ? self->last - self->most + 1 : range[0], error);
    }
    *found = status == TL_OK && any && tl_resume_ticks_last(&self->ticks, self->ticks.first) == self->last;
    if (*found) {
        make_point(self, self->ticks.first == 0 ? TL_RESUMED_START : TL_RESUMED_INPUTS, self->last, NULL);
    } else if (status == TL_OK) {
        bool has_checkpoint = self->before != INT64_MAX; /* one was found, but it could not be used */
        (void)tl_resume_refuse(
            self->why, "run %" PRId64 " has no %s, and its last recorded ticks have a gap", self->run->run,
            has_checkpoint ? "usable checkpoint" : "checkpoint (usually because an FMU cannot save its state)");
    }
    return status;
}

/* ---- iteration ---- */

static tl_status search_next(tl_resume_history *self, bool *found, tl_error *error) {
    bool any = false;
    tl_status status = TL_OK;
    if (self->handover_block == FRESH) {
        status = find_resume(self, &any, error);
        self->handover_block = any ? AT_CHECKPOINTS : OVER;
    }
    while (status == TL_OK && !*found && self->handover_block == AT_CHECKPOINTS) {
        const tl_history_checkpoint *checkpoint = NULL;
        if (self->tried++ < CHECKPOINTS_MOST) {
            status = tl_history_checkpoint_before(self->history, self->run, self->before, &checkpoint, error);
        }
        if (status == TL_OK && checkpoint != NULL) {
            self->before = checkpoint->tick;
            status = try_checkpoint(self, checkpoint, found, error);
        } else {
            self->handover_block = AT_INPUTS;
        }
    }
    if (status == TL_OK && self->handover_block == AT_INPUTS) {
        self->handover_block = OVER;
        status = find_inputs(self, found, error);
    }
    return status;
}

const tl_resume *tl_resume_history_next(tl_resume_history *history) {
    tl_error error;
    bool found = false;
    if (history == NULL) {
        return NULL;
    }
    const tl_resume_history_settings *settings = &history->settings;
    if (search_next(history, &found, &error) != TL_OK) {
        history->handover_block = OVER;
        tl_resume_report(settings->report, settings->context, TL_EVENT_WARNING, "starts a new run: %.200s", error.text);
        return NULL;
    }
    if (!found && history->why[0] != '\0') {
        tl_resume_report(settings->report, settings->context, TL_EVENT_INFO, "starts a new run: %s", history->why);
        history->why[0] = '\0';
    }
    return found ? &history->found : NULL;
}

tl_time tl_resume_history_ended(const tl_resume_history *history) {
    return history == NULL ? 0 : history->ended;
}

tl_resume_history *tl_resume_history_open(const tl_resume_history_settings *settings) {
    tl_error error;
    if (settings->config->record_resume == 0) {
        return NULL;
    }
    tl_resume_history *opened = calloc(1, sizeof *opened);
    if (opened == NULL) {
        tl_resume_report(settings->report, settings->context, TL_EVENT_WARNING,
                         "starts a new run: not enough memory to search for an earlier one");
        return NULL;
    }
    opened->settings = *settings;
    opened->before = INT64_MAX;
    opened->ticks.shape = tl_recorder_shape_of(settings->config);
    if (tl_history_open(settings->path, &opened->history, &error) != TL_OK) {
        tl_resume_report(settings->report, settings->context, TL_EVENT_WARNING, "starts a new run: %.200s", error.text);
        tl_resume_history_close(opened);
        return NULL;
    }
    return opened;
}

void tl_resume_history_close(tl_resume_history *history) {
    if (history != NULL) {
        tl_history_close(history->history);
        tl_resume_ticks_free(&history->ticks);
        free(history);
    }
}

/* ---- samples of the present run ---- */

/* State of the search. */
typedef struct sample_search {
    tl_history *history;
    const char *boot;
    const tl_history_run *run; /* run whose ticks are read */
    tl_resume_ticks found;
} sample_search;

static bool is_of_boot(const sample_search *self, const tl_history_run *run) {
    return strcmp(run->verb, "run") == 0 && run->has_start && strcmp(run->boot, self->boot) == 0;
}

/* The run that this one continues, after a resume or a handover. It has the same t_start and the
 * same signals, because neither a handover nor a resume changes them. */
static const tl_history_run *find_parent(const sample_search *self) {
    const tl_history_run *run = self->run;
    const tl_history_run *parent = NULL;
    tl_error error;
    bool is_there = run->resumption.from != TL_RESUMED_NOT && run->resumption.run > 0 &&
                    tl_history_find(self->history, run->resumption.run, &parent, &error) == TL_OK;
    return is_there && is_of_boot(self, parent) && parent->start == run->start && parent->step == run->step ? parent
                                                                                                            : NULL;
}

/* 0 and −1 if there are no samples. */
static tl_status range_of(const sample_search *self, int64_t range[2], tl_error *error) {
    bool any = false;
    range[0] = 0;
    range[1] = -1;
    return tl_history_range(self->history, self->run, TL_HISTORY_SAMPLES, INT64_MIN, range, &any, error);
}

/* Chooses the first tick and its run. */
static tl_status choose_first(sample_search *self, int64_t *from, tl_error *error) {
    int64_t range[2];
    tl_status status = range_of(self, range, error);
    if (status == TL_OK && *from < 0) {
        *from = range[1] + 1 - TL_RESUME_SAMPLES_BEFORE / self->run->step;
        *from = *from > 0 ? *from : 0;
    }
    const tl_history_run *parent = status == TL_OK && *from < range[0] ? find_parent(self) : NULL;
    if (parent != NULL) {
        self->run = parent;
        status = range_of(self, range, error);
    }
    *from = *from > range[0] ? *from : range[0];
    return status;
}

static size_t write_image(const sample_search *self, const tl_recorder_signal *signals, void *image) {
    tl_resume resume = {
        .from = TL_RESUMED_NOT,
        .run = self->run->run,
        .first = self->found.first,
        .last = self->found.first + (int64_t)self->found.count - 1,
        .step = self->run->step,
        .start_s = self->run->experiment.start_s,
        .start = self->run->start,
        .shape = self->found.shape,
        .ticks = self->found.bytes,
    };
    if (self->found.count == 0) {
        return 0;
    }
    tl_resume_identify_recorded(signals, resume.shape.plant, resume.signals);
    tl_resume_write(&resume, image);
    return tl_resume_size(&resume);
}

/* Fills the image from the newest run if it is still being recorded, up to `room` bytes. */
static tl_status fill_image(sample_search *self, int64_t from, void *image, size_t room, size_t *size,
                            tl_error *error) {
    const tl_history_run *runs = NULL;
    const tl_recorder_signal *signals = NULL;
    size_t count = 0;
    tl_status status = tl_history_runs(self->history, &runs, &count, error);
    if (status != TL_OK || count == 0 || runs[count - 1].ended != NULL || !is_of_boot(self, &runs[count - 1])) {
        return status;
    }
    self->run = &runs[count - 1];
    status = choose_first(self, &from, error);
    if (status == TL_OK) {
        status = tl_history_signals(self->history, self->run, TL_HISTORY_PLANT, &signals, &count, error);
    }
    const tl_recorder_shape shape = {.plant = count};
    size_t head = tl_resume_image_bytes(&shape, 0, 0, 0);
    if (status == TL_OK && count <= TL_MAX_SIGNALS && room > head) {
        self->found.shape = shape;
        size_t most = (room - head) / tl_resume_tick_bytes(&shape);
        most = most < TL_RESUME_TICKS ? most : TL_RESUME_TICKS;
        status = tl_resume_ticks_read(&self->found, self->history, self->run, from, (int64_t)most, error);
        *size = status == TL_OK ? write_image(self, signals, image) : 0;
    }
    return status;
}

tl_status tl_resume_samples_find(const char *path, const char *boot, int64_t from, void *image, size_t room,
                                 size_t *size, tl_error *error) {
    sample_search self = {.boot = boot};
    *size = 0;
    tl_status status = tl_history_open(path, &self.history, error);
    if (status == TL_OK) {
        status = fill_image(&self, from, image, room, size, error);
    }
    tl_history_close(self.history);
    tl_resume_ticks_free(&self.found);
    return status;
}
