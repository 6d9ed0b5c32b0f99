/* A warm restart: see resume.h. */
#include "firmware/run/resume.h"

#include <inttypes.h>
#include <stdlib.h>
#include <string.h>

#include "firmware/base/clock.h"
#include "firmware/base/identity.h"
#include "firmware/past/past.h"
#include "firmware/past/past_follow.h"
#include "firmware/past/past_history.h"
#include "firmware/twin/twin_recorder.h"

static void tell(void *context, tl_severity severity, const char *text) {
    tl_journal_event(context, -1, severity, "resume", "%s", text);
}

/* A job of the FMUs' thread, and what came of it. */
typedef struct follow_job {
    const tl_past_follow_settings *settings;
    const tl_past *past;
    tl_summary *summary;
    tl_past_outcome outcome;
    tl_status status;
    tl_error *error;
} follow_job;

static void do_follow(void *context) {
    follow_job *job = context;
    job->status = tl_past_follow(job->settings, job->past, job->summary, &job->outcome, job->error);
}

static tl_status follow(const tl_resume_settings *settings, const tl_past *past, tl_summary *summary,
                        tl_past_outcome *outcome, tl_error *error) {
    const tl_past_sink sink = tl_past_sink_of_recorder(settings->recorder);
    const tl_past_follow_settings following = {
        .assembly = settings->assembly, .sink = &sink, .tell = tell, .context = settings->journal};
    follow_job job = {.settings = &following, .past = past, .summary = summary, .error = error};
    tl_fmu_thread_call(settings->thread, do_follow, &job);
    *outcome = job.outcome;
    return job.status;
}

/* One past of the history, of `size` bytes. What cannot be read is told, and is the last one. */
static tl_status try_past(const tl_resume_settings *settings, const tl_past_history *history, size_t size,
                          tl_summary *summary, tl_past_outcome *outcome, tl_error *error) {
    tl_past past;
    *outcome = TL_PAST_FOLLOWED;
    void *image = malloc(size);
    tl_status status = TL_OK;
    if (image == NULL) {
        status = tl_fail(error, TL_TRY_AGAIN, "not enough memory for what an earlier run has recorded");
    } else {
        tl_past_history_write(history, image);
        status = tl_past_read(image, size, &settings->assembly->config, tl_clock_now(NULL), &past, error);
    }
    if (status == TL_OK) {
        status = follow(settings, &past, summary, outcome, error);
    } else {
        tl_journal_event(settings->journal, -1, TL_EVENT_WARNING, "resume", "begins anew: %.200s", error->text);
        status = TL_OK;
    }
    free(image);
    return status;
}

tl_status tl_resume(const tl_resume_settings *settings, tl_summary *summary, bool *spoilt, tl_error *error) {
    char fmus[TL_SHA256_TEXT];
    char boot[TL_IDENTITY_TEXT];
    *summary = (tl_summary){0};
    *spoilt = false;
    if (settings->recorder == NULL || settings->assembly->config.record_resume == 0) {
        return TL_OK;
    }
    tl_twin_recorder_identify(&settings->assembly->config, fmus);
    tl_identity_boot(boot);
    const tl_past_history_settings looking = {
        .config = &settings->assembly->config,
        .path = settings->path,
        .before = tl_recorder_get_counts(settings->recorder).run,
        .fmus = fmus,
        .boot = boot,
        .components = tl_twin_get_facts(settings->assembly->twin).components,
        .tell = tell,
        .context = settings->journal,
    };
    size_t size = 0;
    tl_status status = TL_OK;
    tl_past_outcome outcome = TL_PAST_REFUSED;
    tl_past_history *history = tl_past_history_open(&looking);
    while (status == TL_OK && outcome == TL_PAST_REFUSED && tl_past_history_next(history, &size)) {
        status = try_past(settings, history, size, summary, &outcome, error);
    }
    tl_past_history_close(history);
    *spoilt = outcome == TL_PAST_FAILED;
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
