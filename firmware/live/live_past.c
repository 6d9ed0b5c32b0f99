/* What a live twin goes on from: see live_past.h. */
#include "firmware/live/live_past.h"

#include <stdlib.h>
#include <string.h>

#include "firmware/base/os.h"
#include "firmware/process/interrupt.h"
#include "firmware/twin/past.h"
#include "firmware/twin/past_outbox.h"

static const tl_time LOOK = TL_SECOND / 1000;

/* Ticks that a twin has followed with a state that it was given as bytes: what is wrong with those shows in a step. */
enum { SOUND_AFTER = 3 };

/* Wishes for what has this number, and waits for the answer; a copy of it. False: it does not come. */
static bool ask(const tl_live_memory *memory, uint32_t number, tl_heart *heart, tl_live_past_answer *answer) {
    tl_live_wish wish = tl_live_wish_of(memory->twin, number);
    tl_time until = tl_clock_now(NULL) + TL_LIVE_PAST_PATIENCE;
    __atomic_store_n(&memory->pulse->past, wish, __ATOMIC_RELEASE);
    const tl_live_past_answer *given = &memory->recorder->answer[memory->place];
    while (__atomic_load_n(&given->wish, __ATOMIC_ACQUIRE) != wish) {
        if (tl_clock_now(NULL) > until || tl_interrupt_requested() != NULL) {
            return false;
        }
        tl_heart_beat(heart);
        tl_clock_sleep_until(tl_clock_now(NULL) + LOOK);
    }
    *answer = *given;
    for (size_t i = 0; i < TL_LIVE_PAST_WORDS; i++) {
        answer->words[i].text[TL_PAST_TEXT - 1] = '\0';
    }
    return true;
}

/* ---- following, in the thread of the FMUs ---- */

/* A job of the FMUs' thread, and what came of it. */
typedef struct follow_job {
    const tl_past_follow_settings *settings;
    const tl_past *past;
    tl_summary *summary;
    tl_past_outcome outcome;
    tl_error *error;
    tl_status status;
} follow_job;

static void do_follow(void *context) {
    follow_job *job = context;
    job->status = tl_past_follow(job->settings, job->past, job->summary, &job->outcome, job->error);
}

static void tell(void *context, tl_severity severity, const char *text) {
    tl_journal_event(context, -1, severity, "resume", "%s", text);
}

/* The number of the newest run in the database; 0: there is none. */
static int64_t newest_run(const tl_live_past_settings *settings) {
    const tl_live_recorder_pulse *recorder = settings->memory->recorder;
    return recorder == NULL ? 0 : tl_recorder_state_get(&recorder->state).run;
}

/* What is noted here outlives this process: the FMUs are given bytes that another one has made. */
static void note_load(const tl_live_past_settings *settings, bool loads) {
    __atomic_store_n(&settings->memory->pulse->loads, loads ? 1 : 0, __ATOMIC_RELEASE);
}

/* Once it was followed; before that only its own steps can show whether the state that was loaded does harm. */
static bool is_loaded_well(const tl_past *past, const follow_job *job) {
    return job->status != TL_FMU_FATAL &&
           (job->outcome != TL_PAST_FOLLOWED || past->last - past->first + 1 >= SOUND_AFTER);
}

/* *refused: it is of no use, and an older one may be. */
static tl_status follow(const tl_live_past_settings *settings, const tl_past *past, tl_summary *summary, bool *refused,
                        tl_error *error) {
    const int64_t last = newest_run(settings); /* before this one begins */
    const tl_past_follow_settings following = {
        .assembly = settings->assembly, .outbox = settings->outbox, .tell = tell, .context = settings->journal};
    follow_job job = {.settings = &following, .past = past, .summary = summary, .error = error};
    *refused = settings->no_checkpoints && past->checkpoint != NULL;
    if (*refused) {
        return TL_OK;
    }
    note_load(settings, past->checkpoint != NULL);
    tl_fmu_thread_call(settings->thread, do_follow, &job);
    if (is_loaded_well(past, &job)) {
        note_load(settings, false);
    }
    *refused = job.status == TL_OK && job.outcome == TL_PAST_REFUSED;
    if (job.status == TL_OK && job.outcome == TL_PAST_FAILED) {
        (void)tl_outbox_put_end(settings->outbox, "could not go on with an earlier run");
    }
    if (summary->resumption.from != TL_RESUMED_NOT && summary->resumption.run < 0) {
        summary->resumption.run = last;
    }
    return job.status;
}

/* ---- what a predecessor has left ---- */

/* *any: somebody has begun a run in it. */
static tl_status follow_outbox(const tl_live_past_settings *settings, tl_summary *summary, bool *any, tl_error *error) {
    tl_past_outbox *left = tl_past_outbox_open(settings->outbox, settings->assembly, tell, settings->journal);
    tl_past past;
    bool refused = true;
    tl_status status = TL_OK;
    *any = left != NULL;
    while (status == TL_OK && refused && tl_past_outbox_next(left, &past)) {
        status = follow(settings, &past, summary, &refused, error);
    }
    tl_past_outbox_close(left);
    return status;
}

/* ---- what the recorder finds ---- */

static void tell_answer(const tl_live_past_settings *settings, const tl_live_past_answer *answer) {
    for (size_t i = 0; i < TL_LIVE_PAST_WORDS && answer->words[i].text[0] != '\0'; i++) {
        const tl_live_past_word *word = &answer->words[i];
        bool is_known = word->severity >= TL_EVENT_INFO && word->severity <= TL_EVENT_ERROR;
        tell(settings->journal, is_known ? (tl_severity)word->severity : TL_EVENT_WARNING, word->text);
    }
}

/* Follows the image, of which nobody else has a copy. */
static tl_status follow_image(const tl_live_past_settings *settings, size_t size, tl_summary *summary, bool *refused,
                              tl_error *error) {
    tl_past past;
    void *image = malloc(size);
    if (image == NULL) {
        return tl_fail(error, TL_TRY_AGAIN, "not enough memory for the past");
    }
    memcpy(image, settings->memory->past->bytes, size);
    tl_status status = tl_past_read(image, size, &settings->assembly->config, tl_clock_now(NULL), &past, error);
    if (status == TL_OK) {
        status = follow(settings, &past, summary, refused, error);
    } else {
        tl_journal_event(settings->journal, -1, TL_EVENT_WARNING, "resume", "begins anew: %.180s", error->text);
        status = TL_OK;
        *refused = false;
    }
    free(image);
    return status;
}

static tl_status follow_recorder(const tl_live_past_settings *settings, tl_summary *summary, tl_error *error) {
    tl_live_past_answer answer;
    bool refused = true;
    tl_status status = TL_OK;
    for (uint32_t number = 1; status == TL_OK && refused; number++) {
        if (!ask(settings->memory, number, settings->heart, &answer)) {
            if (tl_interrupt_requested() != NULL) { /* who is told to end needs no answer */
                return TL_OK;
            }
            tl_journal_event(settings->journal, -1, TL_EVENT_WARNING, "resume",
                             "begins anew: the recorder does not say what was recorded before");
            return TL_OK;
        }
        tell_answer(settings, &answer);
        settings->memory->ended = answer.ended;
        refused = answer.size > 0 && answer.size <= TL_LIVE_PAST_BYTES;
        if (refused) {
            status = follow_image(settings, (size_t)answer.size, summary, &refused, error);
        }
    }
    return status;
}

tl_status tl_live_past_follow(const tl_live_past_settings *settings, tl_summary *summary, tl_error *error) {
    bool any = false;
    *summary = (tl_summary){0};
    if (settings->assembly->config.record_resume == 0) {
        return TL_OK;
    }
    tl_status status = follow_outbox(settings, summary, &any, error);
    if (status == TL_OK && !any && settings->memory->recorder != NULL) {
        status = follow_recorder(settings, summary, error);
    }
    tl_block_close(settings->memory->past);
    return status;
}

/* ---- a shadow ---- */

/* What it has asked for so far, and the last answer. */
typedef struct samples {
    const tl_live_past_settings *settings;
    uint32_t asked;
    void *image; /* a copy, of which nobody else has one */
} samples;

static size_t fetch_samples(void *context, int64_t from, const void **image) {
    samples *self = context;
    const tl_live_memory *memory = self->settings->memory;
    tl_live_past_answer answer = {.size = 0};
    if (memory->recorder == NULL) {
        return 0;
    }
    __atomic_store_n(&memory->pulse->past_from, from, __ATOMIC_RELAXED);
    if (!ask(memory, ++self->asked, self->settings->heart, &answer) || answer.size > TL_LIVE_PAST_BYTES) {
        return 0;
    }
    tell_answer(self->settings, &answer);
    free(self->image);
    self->image = malloc((size_t)answer.size + 1);
    if (self->image == NULL) {
        return 0;
    }
    memcpy(self->image, memory->past->bytes, (size_t)answer.size);
    *image = self->image;
    return (size_t)answer.size;
}

tl_status tl_live_past_begin_shadow(const tl_live_past_settings *settings, tl_time start, int64_t *next,
                                    tl_error *error) {
    samples self = {.settings = settings};
    const tl_recorded_course course = {
        .assembly = settings->assembly,
        .thread = settings->thread,
        .journal = settings->journal,
        .heart = settings->heart,
        .start = start,
        .run = settings->run,
        .fetch = fetch_samples,
        .context = &self,
        .show = settings->show,
        .shown_to = settings->context,
    };
    tl_status status = tl_recorded_course_take(&course, next, error);
    free(self.image);
    tl_block_close(settings->memory->past);
    return status;
}
