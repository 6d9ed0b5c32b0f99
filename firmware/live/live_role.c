/* Common part of the roles: see live_role.h. */
#include "firmware/live/live_role.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "firmware/base/log.h"
#include "firmware/base/os.h"
#include "firmware/process/interrupt.h"

static void put_event(void *context, int64_t tick, tl_severity severity, const char *source, const char *text) {
    tl_record_queue_event(context, tick, severity, source, text);
}

void tl_live_role_open_journal(tl_journal *journal, tl_record_queue *queue) {
    tl_journal_init(journal, NULL);
    tl_journal_listen(journal, put_event, queue);
}

/* Without a recorder the queue is not read; events are logged anyway. */
static void open_events(tl_live_kind kind, tl_live_setup *setup) {
    const tl_record_queue_settings events = tl_live_event_queue();
    const tl_live_recorder_status *recorder = setup->blocks[TL_LIVE_RECORDER_STATUS].bytes;
    const bool is_io = kind == TL_LIVE_IS_IO;
    const size_t number = is_io ? TL_LIVE_QUEUE_IO : TL_LIVE_QUEUE_CONFIG_MANAGER;
    tl_record_queue_open(&events, setup->blocks[is_io ? TL_LIVE_IO_EVENTS : TL_LIVE_CONFIG_MANAGER_EVENTS].bytes,
                         recorder != NULL ? &recorder->state.taken[number] : NULL, &setup->queue);
    tl_live_role_open_journal(&setup->journal, &setup->queue);
}

tl_status tl_live_role_begin(tl_live_kind kind, tl_live_setup *setup) {
    tl_error error;
    tl_log_use_levels();
    tl_role_enter();
    tl_locale_use();
    tl_interrupt_install();
    tl_status status = tl_live_job_take(TL_LIVE_JOB, &setup->job_block, &setup->job, &setup->config, &error);
    if (status == TL_OK) {
        status = tl_live_blocks_take(kind, &setup->job, &setup->config, setup->blocks, &error);
    }
    if (status != TL_OK) {
        tl_log(TL_LOG_ERROR, "%s", error.text);
    } else if (kind == TL_LIVE_IS_IO || kind == TL_LIVE_IS_CONFIG_MANAGER) {
        open_events(kind, setup);
    }
    return status;
}

int tl_live_role_end(tl_heartbeats *beats, bool was_ready, int code) {
    if (code != 0) {
        tl_heartbeats_announce(beats, was_ready ? TL_END_CAUSE_FAILED : TL_END_CAUSE_REFUSED, code);
    } else {
        tl_heartbeats_announce(beats, tl_interrupt_requested() != NULL ? TL_END_CAUSE_REQUESTED : TL_END_CAUSE_OVER, 0);
    }
    return code;
}

tl_status tl_live_role_start(const tl_live_role_settings *settings, tl_role *role, tl_error *error) {
    static const char *const names[] = {TL_LIVE_IO, TL_LIVE_RECORDER, TL_LIVE_CONFIG_MANAGER, TL_LIVE_EXPLAINER};
    char title[TL_ROLE_TITLE];
    tl_role_settings own = {.title = title, .fallback = settings->run_role};
    int *descriptors = own.descriptors;
    tl_block job = {.descriptor = -1};
    size_t size = 0;
    (void)snprintf(title, sizeof title, "%s [%s]", names[settings->kind], settings->name);
    *role = (tl_role){.pid = 0};
    unsigned char *bytes = tl_live_job_pack(settings->job, settings->path, settings->text, &size);
    tl_status status = bytes != NULL ? tl_block_make_of("twinlock job", bytes, size, &job, error)
                                     : tl_fail(error, TL_TRY_AGAIN, "not enough memory for the job of \"%s\"", title);
    free(bytes);
    tl_live_blocks_pass(settings->kind, settings->job, settings->blocks, descriptors);
    descriptors[0] = open("/dev/null", O_RDWR | O_CLOEXEC);
    if (status == TL_OK) {
        descriptors[1] = fcntl(settings->output, F_DUPFD_CLOEXEC, 0);
        descriptors[2] = fcntl(settings->output, F_DUPFD_CLOEXEC, 0);
        descriptors[TL_LIVE_JOB] = fcntl(job.descriptor, F_DUPFD_CLOEXEC, 0);
        descriptors[TL_LIVE_CLIENT] = settings->client >= 0 ? fcntl(settings->client, F_DUPFD_CLOEXEC, 0) : -1;
        bool is_short = descriptors[0] < 0 || descriptors[2] < 0 || descriptors[TL_LIVE_JOB] < 0;
        status = is_short ? tl_fail(error, TL_TRY_AGAIN, "no file descriptors for \"%s\": %s", title, strerror(errno))
                          : tl_role_start(&own, role, error);
    }
    tl_live_blocks_close_passed(descriptors);
    tl_block_close(&job);
    return status;
}
