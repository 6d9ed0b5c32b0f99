/* Errands: see errand.h. */
#include "firmware/retune/errand.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "firmware/base/log.h"
#include "firmware/base/os.h"
#include "firmware/process/interrupt.h"

/* Beside nothing, and what is printed. */
enum { JOB = 3, ANSWER = 4 };

enum { PATH, IN_FORCE, KEPT, COMMISSIONED, CANDIDATE, ON_THE_BOX, LIST, LIST_PATH, TEXTS };

/* Then come the texts, each with its NUL. */
typedef struct job_head {
    size_t bytes[TEXTS]; /* with the NUL */
    uint64_t memory_limit;
    uint64_t unconfined;
} job_head;

/* ---- sending ---- */

static tl_status make_job(const tl_errand_job *job, tl_block *block, tl_error *error) {
    const char *const given[TEXTS] = {[PATH] = job->path,           [IN_FORCE] = job->in_force,
                                      [KEPT] = job->kept,           [COMMISSIONED] = job->commissioned,
                                      [CANDIDATE] = job->candidate, [ON_THE_BOX] = job->on_the_box,
                                      [LIST] = job->list,           [LIST_PATH] = job->list_path};
    job_head head = {.memory_limit = job->memory_limit, .unconfined = job->unconfined ? 1 : 0};
    size_t size = sizeof head;
    for (size_t i = 0; i < TEXTS; i++) {
        head.bytes[i] = given[i] == NULL ? 1 : strlen(given[i]) + 1;
        size += head.bytes[i];
    }
    char *bytes = malloc(size);
    if (bytes == NULL) {
        return tl_fail(error, TL_TRY_AGAIN, "not enough memory for the configuration");
    }
    char *at = bytes + sizeof head;
    memcpy(bytes, &head, sizeof head);
    for (size_t i = 0; i < TEXTS; i++) {
        memcpy(at, given[i] == NULL ? "" : given[i], head.bytes[i]);
        at += head.bytes[i];
    }
    tl_status status = tl_block_make_of("twinlock errand", bytes, size, block, error);
    free(bytes);
    return status;
}

static void pass_over(void *context, const char *line) {
    (void)context;
    (void)line;
}

static tl_status start(tl_errand *errand, const tl_errand_settings *settings, const tl_block *job, int output,
                       int nothing, tl_error *error) {
    tl_role_settings role = {.title = settings->title, .fallback = settings->be, .context = settings->context};
    for (size_t i = 0; i < TL_ROLE_DESCRIPTORS; i++) {
        role.descriptors[i] = -1;
    }
    role.descriptors[0] = nothing;
    role.descriptors[1] = output;
    role.descriptors[2] = output;
    role.descriptors[JOB] = job->descriptor;
    role.descriptors[ANSWER] = errand->answer.size == 0 ? -1 : errand->answer.descriptor;
    return tl_role_start(&role, &errand->role, error);
}

/* With a pipe for what it prints, which is at its end here once the process is. */
static tl_status start_heard(tl_errand *errand, const tl_errand_settings *settings, const tl_block *job,
                             tl_error *error) {
    int output[2] = {-1, -1};
    int nothing = open("/dev/null", O_RDWR | O_CLOEXEC);
    if (nothing < 0 || pipe2(output, O_CLOEXEC) != 0) {
        tl_status status = tl_fail(error, TL_TRY_AGAIN, "no pipe for \"%s\": %s", settings->title, strerror(errno));
        if (nothing >= 0) {
            (void)close(nothing);
        }
        return status;
    }
    tl_status status = start(errand, settings, job, output[1], nothing, error);
    (void)close(nothing);
    (void)close(output[1]);
    if (status == TL_OK) {
        tl_relay_open(&errand->relay, output[0], settings->hear != NULL ? settings->hear : pass_over,
                      settings->context);
    } else {
        (void)close(output[0]);
    }
    return status;
}

tl_status tl_errand_send(tl_errand *errand, const tl_errand_settings *settings, tl_error *error) {
    tl_block job = {.descriptor = -1};
    *errand = (tl_errand){.answer = {.descriptor = -1}};
    tl_status status = make_job(&settings->job, &job, error);
    if (status == TL_OK && settings->answer != 0) {
        status = tl_block_make("twinlock answer", settings->answer, TL_BLOCK_THEY_WRITE, &errand->answer, error);
    }
    if (status == TL_OK) {
        status = start_heard(errand, settings, &job, error);
    }
    tl_block_close(&job);
    if (status != TL_OK) {
        tl_block_close(&errand->answer);
        return status;
    }
    errand->until = tl_clock_now(NULL) + settings->limit;
    errand->is_sent = true;
    return TL_OK;
}

/* ---- what comes of it ---- */

tl_errand_state tl_errand_look(tl_errand *errand) {
    bool has_ended = tl_role_watch(&errand->role);
    (void)tl_relay_drain(&errand->relay);
    if (!has_ended && tl_clock_now(NULL) > errand->until) {
        errand->is_late = true;
        tl_role_kill(&errand->role);
        return TL_ERRAND_FAILED;
    }
    if (!has_ended) {
        return TL_ERRAND_GOES_ON;
    }
    return errand->role.signal == 0 && errand->role.code == 0 ? TL_ERRAND_DONE : TL_ERRAND_FAILED;
}

void tl_errand_why(const tl_errand *errand, char why[TL_ERRAND_WHY]) {
    if (errand->is_late) {
        (void)snprintf(why, TL_ERRAND_WHY, "it took too long, and was ended");
    } else if (errand->role.signal != 0) {
        (void)snprintf(why, TL_ERRAND_WHY, "its process died of signal %d (%s)", errand->role.signal,
                       strsignal(errand->role.signal));
    } else {
        (void)snprintf(why, TL_ERRAND_WHY, "its process ended with exit code %d", errand->role.code);
    }
}

const void *tl_errand_answer(const tl_errand *errand) {
    return errand->answer.bytes;
}

void tl_errand_close(tl_errand *errand) {
    if (!errand->is_sent) {
        return;
    }
    tl_role_kill(&errand->role);
    (void)tl_relay_drain(&errand->relay);
    tl_relay_close(&errand->relay);
    tl_block_close(&errand->answer);
    errand->is_sent = false;
}

/* ---- in its process ---- */

/* Each text ends where it is said to. */
static bool find_texts(const tl_block *block, const job_head *head, const char *texts[TEXTS]) {
    const char *at = (const char *)block->bytes + sizeof *head;
    size_t left = block->size - sizeof *head;
    bool fits = true;
    for (size_t i = 0; i < TEXTS && fits; i++) {
        fits = head->bytes[i] - 1 < left && at[head->bytes[i] - 1] == '\0';
        texts[i] = at;
        at += fits ? head->bytes[i] : 0;
        left -= fits ? head->bytes[i] : 0;
    }
    return fits && left == 0;
}

tl_status tl_errand_begin(tl_errand_job *job, tl_error *error) {
    static tl_block block; /* as long as the process */
    const char *texts[TEXTS];
    job_head head;
    tl_log_use_levels();
    tl_role_enter();
    tl_locale_use();
    tl_interrupt_install();
    tl_status status = tl_block_take(JOB, 0, TL_BLOCK_IS_WRITTEN, &block, error);
    if (status != TL_OK) {
        return status;
    }
    if (block.size <= sizeof head) {
        return tl_fail(error, TL_BAD_DATA, "the job of the process is none");
    }
    memcpy(&head, block.bytes, sizeof head);
    if (!find_texts(&block, &head, texts)) {
        return tl_fail(error, TL_BAD_DATA, "the job of the process is none");
    }
    *job = (tl_errand_job){
        .path = texts[PATH],
        .in_force = texts[IN_FORCE],
        .kept = texts[KEPT],
        .commissioned = texts[COMMISSIONED],
        .candidate = texts[CANDIDATE],
        .on_the_box = texts[ON_THE_BOX],
        .list = texts[LIST],
        .list_path = texts[LIST_PATH],
        .memory_limit = head.memory_limit,
        .unconfined = head.unconfined != 0,
    };
    return TL_OK;
}

tl_status tl_errand_take_answer(size_t size, void **answer, tl_error *error) {
    static tl_block block;
    tl_status status = tl_block_take(ANSWER, size, TL_BLOCK_THEY_WRITE, &block, error);
    *answer = block.bytes;
    return status;
}
