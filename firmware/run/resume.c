/* A warm restart: see resume.h. */
#include "firmware/run/resume.h"

#include <inttypes.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include "firmware/base/clock.h"
#include "firmware/base/identity.h"
#include "firmware/record/history.h"
#include "firmware/text/utc.h"
#include "firmware/twin/twin_recorder.h"

enum {
    FRUITLESS_MOST = 3,   /* restarts in a row that got no further than the run they went on with */
    CHECKPOINTS_MOST = 8, /* that are looked at; a run keeps three */
    FOLLOWED_MOST = 5000  /* ticks; what records them takes some 0.1 ms each */
};

static const tl_time FOLLOW_TIME = TL_SECOND / 2; /* for as many ticks as are led along again */
static const tl_time CLOCKS_APART = 10 * TL_SECOND;

typedef struct resume {
    const tl_resume_settings *settings;
    const tl_resume_source *source;
    tl_history *history;
    const tl_history_run *run; /* gone on with */
    int64_t last;              /* its last tick that can be followed */
    tl_time start;             /* its t_start on the clock of now */
    tl_time gap;               /* since `last` */
    int64_t from;              /* first tick to be followed */
    tl_resumed_from origin;
    tl_time age;   /* of the checkpoint, when the run ended */
    char why[160]; /* the twin begins anew; "": nothing worth saying */
} resume;

static bool refuse(resume *self, const char *format, ...) TL_PRINTF(2, 3);

static bool refuse(resume *self, const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    (void)vsnprintf(self->why, sizeof self->why, format, arguments);
    va_end(arguments);
    return false;
}

static const tl_config *config_of(const resume *self) {
    return &self->settings->assembly->config;
}

/* ---- which run ---- */

/* The last tick whose step is there; −1: none. */
static tl_status last_tick(resume *self, const tl_history_run *run, int64_t *tick, tl_error *error) {
    int64_t step = -1;
    tl_status status = tl_history_last_step(self->history, run, &step, error);
    *tick = step < 0 ? -1 : step + (int64_t)run->lead;
    return status;
}

/* One that was ended before it had a step of its own has nothing that the run before it has not. */
static tl_status is_fruitless(resume *self, const tl_history_run *run, bool *without, tl_error *error) {
    int64_t own = run->resumption.from == TL_RESUMED_NOT ? 0 : run->resumption.tick;
    int64_t last = -1;
    tl_status status = last_tick(self, run, &last, error);
    *without = last < own;
    return status;
}

/* The newest run before ours that got anywhere. */
static tl_status find_run(resume *self, tl_error *error) {
    const tl_history_run *runs = NULL;
    size_t count = 0;
    int fruitless = 0;
    int64_t own = tl_recorder_get_counts(self->settings->recorder).run;
    tl_status status = tl_history_runs(self->history, &runs, &count, error);
    for (size_t i = count; status == TL_OK && i-- > 0 && self->run == NULL && fruitless < FRUITLESS_MOST;) {
        if (runs[i].run >= own || strcmp(runs[i].verb, "run") != 0) {
            continue;
        }
        bool without = false;
        status = is_fruitless(self, &runs[i], &without, error);
        fruitless += without ? 1 : 0;
        self->run = without ? NULL : &runs[i];
    }
    if (status == TL_OK && self->run == NULL && fruitless == FRUITLESS_MOST) {
        (void)refuse(self, "%d runs in a row have got nowhere", FRUITLESS_MOST);
    }
    return status;
}

/* A run that came to its end, or failed, is not gone on with: it would come to the same end. */
static bool was_interrupted(resume *self) {
    const char *reason = self->run->ended_reason != NULL ? self->run->ended_reason : "not ended cleanly";
    bool interrupted = strcmp(reason, "not ended cleanly") == 0 || strncmp(reason, "SIG", 3) == 0;
    return interrupted || refuse(self, "run %" PRId64 " ended: %.100s", self->run->run, reason);
}

static bool is_same(resume *self) {
    if (self->run->fmus[0] == '\0' || self->run->boot[0] == '\0' || !self->run->has_start) {
        return refuse(self, "run %" PRId64 " does not tell what it takes to go on with it", self->run->run);
    }
    if (strcmp(self->run->configuration_hash, config_of(self)->hash) != 0) {
        return refuse(self, "the configuration is not that of run %" PRId64, self->run->run);
    }
    return strcmp(self->run->fmus, self->source->fmus) == 0 ||
           refuse(self, "the FMUs are not those of run %" PRId64, self->run->run);
}

/* ---- when it was ---- */

/* How long ago the last tick was by UTC. t_start was kept to the ms, unless the clock was set while the run ran: then the last
 * commit counts, which was soon after the last tick. */
static bool find_gap_by_utc(resume *self, tl_time *gap) {
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

/* t_start on our clock, and for how long nobody ran. */
static bool find_time(resume *self) {
    tl_time now = tl_clock_now(NULL);
    if (strcmp(self->source->boot, self->run->boot) == 0) {
        self->gap = now - tl_time_of_step(self->run->start, self->run->step, self->last);
    } else if (!find_gap_by_utc(self, &self->gap)) {
        return refuse(self, "run %" PRId64 " does not tell when it was", self->run->run);
    }
    if (self->gap < 0) {
        return refuse(self, "by the clock run %" PRId64 " has not happened yet", self->run->run);
    }
    if (self->gap > config_of(self)->record_resume) {
        return refuse(self, "nobody ran since run %" PRId64 " for %.1f s, which is more than record.resume_s",
                      self->run->run, tl_seconds(self->gap));
    }
    self->start = now - self->gap - tl_time_of_step(0, self->run->step, self->last);
    return true;
}

/* Has the run, as it is asked for now, anything left to do? */
static bool is_under_way(resume *self) {
    const tl_config *config = config_of(self);
    int64_t now = self->last + self->gap / config->step;
    return config->duration == 0 || now < config->duration / config->step + (int64_t)self->run->lead ||
           refuse(self, "the duration of run %" PRId64 " is over", self->run->run);
}

/* ---- from where ---- */

static bool has_u(const resume *self, const tl_history_tick *tick) {
    return tick->has_step && tick->adjusted == config_of(self)->adjust_count;
}

/* The last tick that can be followed from `from` on without a hole; from − 1: none. Looks at no more than it takes to see
 * that there are more than `most`. */
static tl_status survey(resume *self, int64_t from, int64_t most, int64_t *last, tl_error *error) {
    tl_history_ticks *ticks = NULL;
    tl_history_tick tick;
    bool end = false;
    bool stepped = false;
    *last = from - 1;
    tl_status status = tl_history_ticks_begin(self->history, self->run, &ticks, error);
    if (status == TL_OK) {
        tl_history_ticks_seek(ticks, from);
        status = tl_history_ticks_next(ticks, &tick, &end, error);
    }
    while (status == TL_OK && !end && *last - from <= most && tick.sample.tick == *last + 1 &&
           (has_u(self, &tick) || !stepped)) {
        stepped = has_u(self, &tick);
        *last = tick.sample.tick;
        status = tl_history_ticks_next(ticks, &tick, &end, error);
    }
    tl_history_ticks_end(ticks);
    *last = stepped || *last < from ? *last : from - 1;
    return status;
}

/* How many ticks can be followed in the time for it, by what their steps took the run. */
static int64_t most_followed(resume *self) {
    size_t components = tl_twin_get_facts(self->settings->assembly->twin).components;
    tl_time each = tl_history_execution_cost(self->history, self->run) * (tl_time)components;
    tl_time most = each > 0 ? FOLLOW_TIME / each : FOLLOWED_MOST;
    return most < 1 ? 1 : most < FOLLOWED_MOST ? most : FOLLOWED_MOST;
}

static tl_status build_anew(const resume *self, tl_error *error) {
    tl_assembly *assembly = self->settings->assembly;
    tl_status status = tl_assembly_rebuild(assembly);
    return status == TL_OK ? TL_OK : tl_fail(error, status, "the twin could not be built a second time");
}

/* Into the twin; where that fails, it is a new one again. */
static tl_status load(resume *self, const tl_history_checkpoint *checkpoint, bool *loaded, tl_error *error) {
    char format[TL_IDENTITY_TEXT];
    const char *why = "its bytes are damaged";
    tl_status status = TL_BAD_DATA;
    *loaded = false;
    tl_identity_format(format);
    if (checkpoint->whole && strcmp(checkpoint->format, format) != 0) {
        why = "another version of twinlock, or another machine, has saved it";
    } else if (checkpoint->whole) {
        status =
            tl_twin_load(self->settings->assembly->twin, checkpoint->tick, checkpoint->bytes, checkpoint->size, error);
        why = error->text;
    }
    *loaded = status == TL_OK;
    if (*loaded || status == TL_FMU_FATAL) {
        return status;
    }
    tl_journal_event(self->settings->journal, -1, TL_EVENT_WARNING, "resume",
                     "the checkpoint of tick %" PRId64 " of run %" PRId64 " is of no use: %.120s", checkpoint->tick,
                     self->run->run, why);
    return build_anew(self, error);
}

/* The same checkpoint is that of the new run. */
static void keep(const resume *self, const tl_history_checkpoint *checkpoint) {
    size_t capacity = 0;
    tl_recorder *recorder = self->settings->recorder;
    if (tl_recorder_reserve_checkpoint(recorder, checkpoint->size)) {
        memcpy(tl_recorder_checkpoint_room(recorder, &capacity), checkpoint->bytes, checkpoint->size);
        tl_recorder_put_checkpoint(recorder, checkpoint->tick, checkpoint->size);
    }
}

/* Where one checkpoint leads to. */
static tl_status try_checkpoint(resume *self, const tl_history_checkpoint *checkpoint, bool *loaded, tl_error *error) {
    int64_t last = 0;
    int64_t most = most_followed(self);
    *loaded = false;
    tl_status status = survey(self, checkpoint->tick + 1, most, &last, error);
    if (status != TL_OK || last < self->last || last - checkpoint->tick > most) {
        return status;
    }
    status = load(self, checkpoint, loaded, error);
    if (*loaded) {
        self->gap -=
            tl_time_of_step(0, self->run->step, last - self->last); /* of mode ahead it may have one step more */
        self->last = last;
        self->from = checkpoint->tick + 1;
        self->origin = TL_RESUMED_CHECKPOINT;
        self->age = tl_time_of_step(0, self->run->step, self->last - checkpoint->tick);
    }
    return status;
}

/* The newest checkpoint that can be used, if there is one; *used is that one. */
static tl_status find_checkpoint(resume *self, const tl_history_checkpoint **used, tl_error *error) {
    const tl_history_checkpoint *checkpoint = NULL;
    bool loaded = false;
    int64_t before = INT64_MAX;
    tl_status status = TL_OK;
    *used = NULL;
    for (int i = 0; i < CHECKPOINTS_MOST && status == TL_OK && !loaded; i++) {
        status = tl_history_checkpoint_before(self->history, self->run, before, &checkpoint, error);
        if (status != TL_OK || checkpoint == NULL) {
            return status;
        }
        before = checkpoint->tick;
        status = try_checkpoint(self, checkpoint, &loaded, error);
    }
    *used = loaded ? checkpoint : NULL;
    return status;
}

/* Without one: all of the run where there is time for it, else the newest of it. */
static tl_status find_inputs(resume *self, bool *found, tl_error *error) {
    tl_history_ticks *ticks = NULL;
    int64_t first = 0;
    int64_t newest = 0;
    int64_t last = -1;
    int64_t most = most_followed(self);
    tl_status status = tl_history_ticks_begin(self->history, self->run, &ticks, error);
    bool any = false;
    if (status == TL_OK) {
        status = tl_history_ticks_range(ticks, &any, &first, &newest, error);
    }
    tl_history_ticks_end(ticks);
    if (status == TL_OK && any) {
        self->from = self->last - first + 1 > most ? self->last - most + 1 : first;
        self->origin = self->from == 0 ? TL_RESUMED_START : TL_RESUMED_INPUTS;
        status = survey(self, self->from, most, &last, error);
    }
    *found = status == TL_OK && any && last == self->last;
    if (*found) {
        tl_twin_begin_at(self->settings->assembly->twin, self->from);
    } else if (status == TL_OK) {
        (void)refuse(self, "what run %" PRId64 " has recorded of its last ticks has a hole", self->run->run);
    }
    return status;
}

/* ---- following ---- */

static tl_status follow_tick(const resume *self, const tl_history_tick *tick, tl_summary *summary, tl_error *error) {
    const tl_assembly *assembly = self->settings->assembly;
    tl_sample sample = tick->sample;
    tl_record record;
    bool ready = false;
    sample.instant = tl_time_of_step(self->start, self->run->step, sample.tick);
    for (size_t i = 0; i < assembly->config.signal_count; i++) {
        sample.stamps[i] += sample.stamps[i] == TL_TIME_NEVER ? 0 : self->start;
    }
    tl_summary_sample(summary, &assembly->config, &sample);
    tl_recorder_put_sample(self->settings->recorder, &sample);
    tl_status status = tl_twin_follow(assembly->twin, &sample, tick->u, &record, &ready, error);
    if (ready) {
        tl_summary_add(summary, &assembly->config, &record);
        tl_twin_recorder_put(self->settings->recorder, &record, assembly->twin);
    }
    return status;
}

static tl_status follow(const resume *self, tl_summary *summary, tl_error *error) {
    tl_history_ticks *ticks = NULL;
    tl_history_tick tick;
    bool end = false;
    tl_status status = tl_history_ticks_begin(self->history, self->run, &ticks, error);
    if (status == TL_OK) {
        tl_history_ticks_seek(ticks, self->from);
    }
    for (int64_t number = self->from; number <= self->last && status == TL_OK; number++) {
        status = tl_history_ticks_next(ticks, &tick, &end, error);
        if (status == TL_OK) {
            status =
                end || tick.sample.tick != number
                    ? tl_fail(error, TL_BAD_DATA, "tick %" PRId64 " of run %" PRId64 " is gone", number, self->run->run)
                    : follow_tick(self, &tick, summary, error);
        }
    }
    tl_history_ticks_end(ticks);
    return status;
}

static void tell(const resume *self, tl_time took) {
    char from[64];
    int64_t followed = self->last - self->from + 1;
    if (self->origin == TL_RESUMED_CHECKPOINT) {
        (void)snprintf(from, sizeof from, "a checkpoint %.1f s old", tl_seconds(self->age));
    } else {
        (void)snprintf(from, sizeof from, "%s",
                       self->origin == TL_RESUMED_START ? "the start of its recorded inputs" : "its newest inputs");
    }
    tl_journal_event(self->settings->journal, -1, TL_EVENT_INFO, "resume",
                     "goes on with run %" PRId64 " at tick %" PRId64 " from %s, %" PRId64
                     " ticks run again in %.0f ms; nobody ran for %.2f s (%" PRId64 " ticks)",
                     self->run->run, self->last + 1, from, followed, tl_seconds(took) * 1e3, tl_seconds(self->gap),
                     self->gap / self->run->step);
}

/* From where the twin stands now. A failure leaves a new twin, and a run that is of no use. */
static tl_status go_on(const resume *self, const tl_history_checkpoint *checkpoint, tl_summary *summary, bool *spoilt,
                       tl_error *error) {
    tl_time begun = tl_clock_now(NULL);
    const tl_resumption resumption = {
        .from = self->origin, .run = self->run->run, .tick = self->last + 1, .start = self->start};
    summary->resumption = resumption;
    (void)tl_utc_parse(self->run->started, &summary->resumption.started);
    tl_recorder_resume(self->settings->recorder, &summary->resumption);
    if (checkpoint != NULL) {
        keep(self, checkpoint);
    }
    tl_status status = follow(self, summary, error);
    if (status == TL_OK) {
        tell(self, tl_clock_now(NULL) - begun);
        return TL_OK;
    }
    tl_recorder_go_live(self->settings->recorder);
    *spoilt = true;
    *summary = (tl_summary){0};
    if (status == TL_FMU_FATAL) {
        return status;
    }
    tl_journal_event(self->settings->journal, -1, TL_EVENT_WARNING, "resume",
                     "begins anew: to go on with run %" PRId64 " has failed: %.140s", self->run->run, error->text);
    return build_anew(self, error);
}

/* Whether there is a run to go on with; if not, `why` may say why. */
static tl_status find(resume *self, bool *found, tl_error *error) {
    tl_status status = find_run(self, error);
    *found = false;
    if (status != TL_OK || self->run == NULL) {
        return status;
    }
    status = last_tick(self, self->run, &self->last, error);
    *found = status == TL_OK && was_interrupted(self) && is_same(self) && find_time(self) && is_under_way(self);
    return status;
}

static tl_status resume_run(resume *self, tl_summary *summary, bool *spoilt, tl_error *error) {
    const tl_history_checkpoint *checkpoint = NULL;
    bool found = false;
    tl_status status = find(self, &found, error);
    if (status == TL_OK && found) {
        status = find_checkpoint(self, &checkpoint, error);
    }
    if (status == TL_OK && found && checkpoint == NULL) {
        status = find_inputs(self, &found, error);
    }
    if (status == TL_OK && found) {
        status = go_on(self, checkpoint, summary, spoilt, error);
    }
    if (status == TL_OK && self->why[0] != '\0') {
        tl_journal_event(self->settings->journal, -1, TL_EVENT_INFO, "resume", "begins anew: %s", self->why);
    }
    return status;
}

static void tell_unreadable(const tl_resume_settings *settings, const tl_error *error) {
    tl_journal_event(settings->journal, -1, TL_EVENT_WARNING, "resume", "begins anew: %.200s", error->text);
}

/* SQLite opens what lies beside a database only when it is read. */
static tl_status open_history(const tl_resume_settings *settings, tl_history **history, tl_error *error) {
    const tl_history_run *runs = NULL;
    size_t count = 0;
    tl_status status = tl_history_open(settings->path, history, error);
    return status == TL_OK ? tl_history_runs(*history, &runs, &count, error) : status;
}

void tl_resume_open(const tl_resume_settings *settings, tl_resume_source *source) {
    tl_error error;
    *source = (tl_resume_source){.history = NULL};
    if (settings->recorder == NULL || settings->assembly->config.record_resume == 0) {
        return;
    }
    tl_twin_recorder_identify(&settings->assembly->config, source->fmus);
    tl_identity_boot(source->boot);
    if (open_history(settings, &source->history, &error) != TL_OK) {
        tl_resume_close(source);
        tell_unreadable(settings, &error);
    }
}

void tl_resume_close(tl_resume_source *source) {
    tl_history_close(source->history);
    source->history = NULL;
}

tl_status tl_resume(const tl_resume_settings *settings, const tl_resume_source *source, tl_summary *summary,
                    bool *spoilt, tl_error *error) {
    resume self = {.settings = settings, .source = source, .history = source->history};
    *summary = (tl_summary){0};
    *spoilt = false;
    if (source->history == NULL) {
        return TL_OK;
    }
    tl_status status = resume_run(&self, summary, spoilt, error);
    if (status == TL_BAD_DATA || status == TL_TRY_AGAIN) {
        tell_unreadable(settings, error);
        status = TL_OK;
    }
    return status;
}

/* ---- replay ---- */

tl_status tl_resume_check(const tl_config *config, const tl_recording_beginning *beginning, tl_error *error) {
    char text[TL_IDENTITY_TEXT];
    if (!beginning->follows) {
        return TL_OK;
    }
    tl_twin_recorder_identify(config, text);
    if (strcmp(text, beginning->fmus) != 0) {
        return tl_fail(error, TL_BAD_DATA,
                       "run %" PRId64 " goes on with run %" PRId64
                       ", and the FMUs are not those of these runs any more",
                       beginning->run, beginning->resumption.run);
    }
    tl_identity_format(text);
    if (beginning->resumption.from == TL_RESUMED_CHECKPOINT && strcmp(text, beginning->checkpoint->format) != 0) {
        return tl_fail(error, TL_BAD_DATA,
                       "run %" PRId64 " begins with a checkpoint that only %s can read, and this is %s", beginning->run,
                       beginning->checkpoint->format, text);
    }
    return TL_OK;
}
