/* Pasts out of a database: see past_history.h. */
#include "firmware/twin/past_history.h"

#include <inttypes.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "firmware/base/identity.h"
#include "firmware/base/os.h"
#include "firmware/base/text.h"
#include "firmware/store/history.h"
#include "firmware/twin/past.h"

enum {
    CHECKPOINTS_MOST = 8,              /* that are looked at; a run keeps three */
    CHECKPOINT_BYTES = 8 * 1024 * 1024 /* more are in no database that the recorder writes */
};

static const tl_time CLOCKS_APART = 10 * TL_SECOND;

/* How far the search has come. */
typedef enum stage { FRESH, AT_CHECKPOINTS, AT_INPUTS, OVER } stage;

struct tl_past_history {
    tl_past_history_settings settings;
    tl_history *history;
    stage stage;
    const tl_history_run *run; /* gone on with */
    int64_t last;              /* its last tick that has a step */
    tl_time start;             /* its t_start on the clock of now */
    tl_time gap;               /* since `last` */
    tl_time ended;             /* of a run that is not gone on with: when its last tick was; 0: not known */
    int64_t most;              /* ticks that can be followed */
    int looked;                /* checkpoints looked at, */
    int64_t before;            /* all of them of this tick or later */
    tl_past_ticks ticks;
    const tl_history_tuning *taken; /* by the run */
    size_t taken_count;
    tl_run_tuning tunings[TL_PAST_TUNINGS];
    tl_past found;
    char why[TL_PAST_WHY]; /* the twin begins anew; "": nothing worth saying */
};

static void tell(const tl_past_history *self, tl_severity severity, const char *format, ...) TL_PRINTF(3, 4);

static void tell(const tl_past_history *self, tl_severity severity, const char *format, ...) {
    char text[TL_PAST_TEXT];
    va_list arguments;
    va_start(arguments, format);
    (void)vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    self->settings.tell(self->settings.context, severity, text);
}

static void tell_unreadable(const tl_past_history *self, const tl_error *error) {
    tell(self, TL_EVENT_WARNING, "begins anew: %.200s", error->text);
}

static const tl_config *config_of(const tl_past_history *self) {
    return self->settings.config;
}

/* ---- which run ---- */

/* The last tick whose step is there; −1: none. */
static tl_status last_tick(tl_past_history *self, const tl_history_run *run, int64_t *tick, tl_error *error) {
    int64_t step = -1;
    tl_status status = tl_history_last_step(self->history, run, &step, error);
    *tick = step < 0 ? -1 : step + (int64_t)run->lead;
    if (status == TL_OK && *tick > tl_history_last_possible(run)) {
        status =
            tl_fail(error, TL_BAD_DATA, "%s: it is damaged: the steps of run %" PRId64 " are later than there is time",
                    self->settings.path, run->run);
    }
    return status;
}

/* One that was ended before it had a step of its own has nothing that the run before it has not. */
static tl_status is_fruitless(tl_past_history *self, const tl_history_run *run, bool *without, tl_error *error) {
    int64_t own = run->resumption.from == TL_RESUMED_NOT ? 0 : run->resumption.tick;
    int64_t last = -1;
    tl_status status = last_tick(self, run, &last, error);
    *without = last < own;
    return status;
}

/* The newest run before ours that got anywhere. */
static tl_status find_run(tl_past_history *self, tl_error *error) {
    const tl_history_run *runs = NULL;
    size_t count = 0;
    int fruitless = 0;
    tl_status status = tl_history_runs(self->history, &runs, &count, error);
    for (size_t i = count; status == TL_OK && i-- > 0 && self->run == NULL && fruitless < TL_PAST_FRUITLESS;) {
        if (runs[i].run >= self->settings.before || strcmp(runs[i].verb, "run") != 0) {
            continue;
        }
        bool without = false;
        status = is_fruitless(self, &runs[i], &without, error);
        fruitless += without ? 1 : 0;
        self->run = without ? NULL : &runs[i];
    }
    if (status == TL_OK && self->run == NULL && fruitless == TL_PAST_FRUITLESS) {
        (void)tl_past_refuse(self->why, "%d runs in a row have got nowhere", TL_PAST_FRUITLESS);
    }
    return status;
}

/* What was in force when it ended. */
static const char *hash_at_end(const tl_past_history *self) {
    return self->taken_count != 0 ? self->taken[self->taken_count - 1].hash : self->run->configuration_hash;
}

static bool is_same(tl_past_history *self) {
    const tl_history_run *run = self->run;
    if (run->fmus[0] == '\0' || run->boot[0] == '\0' || !run->has_start) {
        return tl_past_refuse(self->why, "run %" PRId64 " does not tell what it takes to go on with it", run->run);
    }
    if (strcmp(hash_at_end(self), config_of(self)->hash) != 0) {
        return tl_past_refuse(self->why, "the configuration is not that of run %" PRId64, run->run);
    }
    return strcmp(run->fmus, self->settings.fmus) == 0 ||
           tl_past_refuse(self->why, "the FMUs are not those of run %" PRId64, run->run);
}

/* ---- when it was ---- */

/* How long ago the last tick was by UTC. t_start was kept to the ms, unless the clock was set while the run ran: then the last
 * commit counts, which was soon after the last tick. */
static bool find_gap_by_utc(const tl_past_history *self, tl_time *gap) {
    static const tl_time ms = TL_SECOND / 1000;
    int64_t started = 0;
    int64_t committed = 0;
    if (!tl_utc_parse(self->run->started, &started) || !tl_utc_parse(self->run->committed, &committed)) {
        return false;
    }
    int64_t last = started + tl_time_of_step(0, self->run->step, self->last) / ms;
    bool set = committed < last - CLOCKS_APART / ms || committed > last + CLOCKS_APART / ms;
    int64_t since = tl_utc_now() - (set ? committed : last);
    bool fits = since > -INT64_MAX / ms && since < INT64_MAX / ms;
    *gap = fits ? since * ms : -INT64_MAX;
    return true;
}

/* For how long nobody ran. False: that cannot be told. */
static bool find_gap(tl_past_history *self, tl_time now) {
    if (strcmp(self->settings.boot, self->run->boot) == 0) {
        self->gap = now - tl_time_of_step(self->run->start, self->run->step, self->last);
        return self->run->has_start;
    }
    return find_gap_by_utc(self, &self->gap);
}

/* And t_start on our clock. */
static bool find_time(tl_past_history *self) {
    tl_time now = tl_clock_now(NULL);
    if (!find_gap(self, now)) {
        return tl_past_refuse(self->why, "run %" PRId64 " does not tell when it was", self->run->run);
    }
    if (!tl_past_is_recent(self->run->run, config_of(self), self->gap, self->why)) {
        return false;
    }
    self->start = now - self->gap - tl_time_of_step(0, self->run->step, self->last);
    return true;
}

/* Whether there is a run to go on with; if not, `why` may say why. */
static tl_status find(tl_past_history *self, bool *found, tl_error *error) {
    tl_status status = find_run(self, error);
    const tl_history_run *run = self->run;
    *found = false;
    if (status != TL_OK || run == NULL) {
        return status;
    }
    status = last_tick(self, run, &self->last, error);
    if (status == TL_OK) {
        status = tl_history_tunings(self->history, run, &self->taken, &self->taken_count, error);
    }
    bool goes_on = status == TL_OK && tl_past_was_interrupted(run->run, run->ended_reason, self->why) && is_same(self);
    tl_time now = tl_clock_now(NULL);
    if (status == TL_OK && !goes_on && find_gap(self, now) && self->gap >= 0) {
        self->ended = now - self->gap;
    }
    *found = goes_on && find_time(self) &&
             tl_past_is_under_way(run->run, config_of(self), self->last, self->gap, run->lead, self->why);
    self->most =
        tl_past_most_followed(*found ? tl_history_execution_cost(self->history, run) : 0, self->settings.components);
    return status;
}

/* ---- from where ---- */

/* The ticks from `from` on, up to a hole. Looks at no more than it takes to see that there are more than can be followed. */
static tl_status survey(tl_past_history *self, int64_t from, tl_error *error) {
    return tl_past_ticks_read(&self->ticks, self->history, self->run, from, self->most + 1, error);
}

/* ---- what was in force ---- */

/* A text that is no configuration any more is passed over: nothing is searched with it. */
static bool read_tuning(tl_past_history *self, const char *hash, int64_t tick, tl_run_tuning *tuning) {
    const char *text = NULL;
    tl_error error;
    *tuning = (tl_run_tuning){.tick = tick};
    (void)snprintf(tuning->hash, sizeof tuning->hash, "%s", hash);
    return tl_history_text(self->history, hash, &text, &error) == TL_OK &&
           tl_config_tuning_of(config_of(self), text, &tuning->values, &error) == TL_OK;
}

/* In force at `first`, and the newest that were taken up to `last`. */
static size_t read_tunings(tl_past_history *self, int64_t first, int64_t last) {
    size_t from = 0; /* of those after the one in force */
    size_t to = 0;
    for (size_t i = 0; i < self->taken_count; i++) {
        from = self->taken[i].tick <= first ? i + 1 : from;
        to = self->taken[i].tick <= last ? i + 1 : to;
    }
    bool own = from == 0;
    const char *hash = own ? self->run->configuration_hash : self->taken[from - 1].hash;
    size_t count = read_tuning(self, hash, own ? 0 : self->taken[from - 1].tick, &self->tunings[0]) ? 1 : 0;
    from = to > from + TL_PAST_TUNINGS - 1 ? to - (TL_PAST_TUNINGS - 1) : from;
    for (size_t i = from; i < to; i++) {
        count += read_tuning(self, self->taken[i].hash, self->taken[i].tick, &self->tunings[count]) ? 1 : 0;
    }
    return count;
}

/* The past from the ticks that were looked at, up to `last`. */
static void take(tl_past_history *self, tl_resumed_from from, int64_t last, const tl_history_checkpoint *checkpoint) {
    int64_t started = 0;
    size_t tunings = self->taken_count != 0 ? read_tunings(self, self->ticks.first, last) : 0;
    (void)tl_utc_parse(self->run->started, &started);
    self->found = (tl_past){
        .from = from,
        .run = self->run->run,
        .first = self->ticks.first,
        .last = last,
        .step = self->run->step,
        .start = self->start,
        .started = started,
        .checkpoint = checkpoint != NULL ? checkpoint->bytes : NULL,
        .checkpoint_size = checkpoint != NULL ? checkpoint->size : 0,
        .tunings = (const unsigned char *)self->tunings,
        .tuning_count = tunings,
        .shape = self->ticks.shape,
        .ticks = self->ticks.bytes,
    };
}

/* Why nobody can load it; NULL: that may be tried. */
static const char *find_fault(const tl_history_checkpoint *checkpoint) {
    char format[TL_IDENTITY_TEXT];
    tl_identity_format(format);
    if (!checkpoint->whole) {
        return "its bytes are damaged";
    }
    if (strcmp(checkpoint->format, format) != 0) {
        return "another version of twinlock, or another machine, has saved it";
    }
    return checkpoint->size == 0                 ? "it is empty"
           : checkpoint->size > CHECKPOINT_BYTES ? "it is larger than any that is saved"
                                                 : NULL;
}

/* Where one checkpoint leads to. Of mode ahead that may be one tick more. */
static tl_status try_checkpoint(tl_past_history *self, const tl_history_checkpoint *checkpoint, bool *found,
                                tl_error *error) {
    tl_status status = survey(self, checkpoint->tick + 1, error);
    int64_t last = tl_past_ticks_last(&self->ticks);
    if (status != TL_OK || last < self->last || last - checkpoint->tick > self->most) {
        return status;
    }
    const char *fault = find_fault(checkpoint);
    if (fault != NULL) {
        tell(self, TL_EVENT_WARNING, "the checkpoint of tick %" PRId64 " of run %" PRId64 " is of no use: %s",
             checkpoint->tick, self->run->run, fault);
        return TL_OK;
    }
    take(self, TL_RESUMED_CHECKPOINT, last, checkpoint);
    *found = true;
    return TL_OK;
}

static tl_status next_checkpoint(tl_past_history *self, bool *found, tl_error *error) {
    const tl_history_checkpoint *checkpoint = NULL;
    tl_status status = TL_OK;
    if (self->looked < CHECKPOINTS_MOST) {
        status = tl_history_checkpoint_before(self->history, self->run, self->before, &checkpoint, error);
    }
    if (status != TL_OK || checkpoint == NULL) {
        self->stage = AT_INPUTS;
        return status;
    }
    self->looked++;
    self->before = checkpoint->tick;
    return try_checkpoint(self, checkpoint, found, error);
}

/* Without one: all of the run if there is time for it, else the newest of it. */
static tl_status find_inputs(tl_past_history *self, bool *found, tl_error *error) {
    int64_t range[2] = {0};
    bool any = false;
    tl_status status = tl_history_range(self->history, self->run, TL_HISTORY_SAMPLES, INT64_MIN, range, &any, error);
    if (status == TL_OK && any) {
        bool long_ago = self->last - range[0] + 1 > self->most;
        status = survey(self, long_ago ? self->last - self->most + 1 : range[0], error);
    }
    *found = status == TL_OK && any && tl_past_ticks_last(&self->ticks) == self->last;
    if (*found) {
        take(self, self->ticks.first == 0 ? TL_RESUMED_START : TL_RESUMED_INPUTS, self->last, NULL);
    } else if (status == TL_OK) {
        (void)tl_past_refuse(self->why, "what run %" PRId64 " has recorded of its last ticks has a hole",
                             self->run->run);
    }
    return status;
}

/* ---- one after the other ---- */

static tl_status search(tl_past_history *self, bool *found, tl_error *error) {
    bool any = false;
    tl_status status = TL_OK;
    if (self->stage == FRESH) {
        status = find(self, &any, error);
        self->stage = any ? AT_CHECKPOINTS : OVER;
    }
    while (status == TL_OK && !*found && self->stage == AT_CHECKPOINTS) {
        status = next_checkpoint(self, found, error);
    }
    if (status == TL_OK && self->stage == AT_INPUTS) {
        self->stage = OVER;
        status = find_inputs(self, found, error);
    }
    return status;
}

bool tl_past_history_next(tl_past_history *history, size_t *size) {
    tl_error error;
    bool found = false;
    *size = 0;
    if (history == NULL) {
        return false;
    }
    tl_status status = search(history, &found, &error);
    if (status != TL_OK) {
        history->stage = OVER;
        tell_unreadable(history, &error);
        return false;
    }
    if (found) {
        const tl_past *past = &history->found;
        *size = tl_past_image_bytes(&past->shape, (size_t)(past->last - past->first + 1), past->checkpoint_size,
                                    past->tuning_count);
    } else if (history->why[0] != '\0') {
        tell(history, TL_EVENT_INFO, "begins anew: %s", history->why);
        history->why[0] = '\0';
    }
    return found;
}

tl_time tl_past_history_ended(const tl_past_history *history) {
    return history == NULL ? 0 : history->ended;
}

void tl_past_history_write(const tl_past_history *history, void *image) {
    tl_past_write(&history->found, image);
}

tl_past_history *tl_past_history_open(const tl_past_history_settings *settings) {
    tl_error error;
    if (settings->config->record_resume == 0) {
        return NULL;
    }
    tl_past_history *opened = calloc(1, sizeof *opened);
    if (opened == NULL) {
        settings->tell(settings->context, TL_EVENT_WARNING,
                       "begins anew: not enough memory to look for an earlier run");
        return NULL;
    }
    opened->settings = *settings;
    opened->before = INT64_MAX;
    opened->ticks.shape = tl_recorder_shape_of(settings->config);
    if (tl_history_open(settings->path, &opened->history, &error) != TL_OK) {
        tell_unreadable(opened, &error);
        tl_past_history_close(opened);
        return NULL;
    }
    return opened;
}

void tl_past_history_close(tl_past_history *history) {
    if (history != NULL) {
        tl_history_close(history->history);
        tl_past_ticks_free(&history->ticks);
        free(history);
    }
}
