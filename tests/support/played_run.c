/* See played_run.h. */
#include "tests/support/played_run.h"

#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <unity.h>

#include "firmware/base/os.h"
#include "firmware/retune/worker.h"
#include "tests/support/message.h"

static tl_played the_run;
static tl_played *const run = &the_run;

/* ---- host of the activation ---- */

static void read_view(void *context, tl_activation_view *seen) {
    (void)context;
    *seen = run->view;
}

static void get_active_hash(void *context, char hash[TL_SHA256_TEXT]) {
    (void)context;
    memcpy(hash, run->active_hash, sizeof run->active_hash);
}

static void use_tolerances(void *context, const tl_lock_tolerances *tolerances) {
    (void)context;
    run->tolerances = *tolerances;
}

static bool tune(void *context, const tl_version *version, const char *why, const char *text, const tl_tuning *tuning) {
    (void)context;
    (void)why;
    (void)tuning;
    TEST_ASSERT_EQUAL_size_t(version->size, strlen(text));
    memcpy(run->given, version->hash, sizeof run->given);
    if (run->answer == TL_ACTIVATION_STARTED) {
        memcpy(run->active_hash, run->given, sizeof run->active_hash);
    }
    return true;
}

static tl_activation_answer tuning_result(void *context, char why[TL_ACTIVATION_WHY]) {
    (void)context;
    (void)snprintf(why, TL_ACTIVATION_WHY, "there is no room");
    return run->answer;
}

static bool begin_shadow(void *context, const tl_activation_candidate *candidate) {
    (void)context;
    if (run->is_slow) {
        run->is_slow = false;
        return false;
    }
    run->needs = candidate->needs;
    TEST_ASSERT_EQUAL_size_t(candidate->size, strlen(candidate->text));
    (void)snprintf(run->other, sizeof run->other, "%s", candidate->hash);
    return true;
}

void tl_played_add(tl_run_status *sum, const tl_run_status *more) {
    sum->ticks += more->ticks;
    sum->steps += more->steps;
    sum->skipped += more->skipped;
    sum->gaps += more->gaps;
    sum->deadline_misses += more->deadline_misses;
    sum->lock.steps[TL_LOCK_LOCKED] += more->lock.steps[TL_LOCK_LOCKED];
    sum->lock.steps[TL_LOCK_FREE] += more->lock.steps[TL_LOCK_FREE];
    sum->lock.steps[TL_LOCK_LOST] += more->lock.steps[TL_LOCK_LOST];
}

/* Adds ten pairs of the output that both configurations match. */
static void add_output(tl_run_status *work, double difference, double tolerance) {
    tl_run_output *output = &work->output[0];
    work->outputs = 1;
    (void)snprintf(output->name, sizeof output->name, "motor.omega");
    output->pairs += 10;
    output->sum_of_squares += 10.0 * difference * difference;
    output->tolerance = tolerance;
}

static void read_shadow(void *context, tl_activation_shadow *seen) {
    (void)context;
    tl_played_add(&run->shadow.work, &run->each);
    tl_played_add(&run->shadow.beside, &run->beside);
    add_output(&run->shadow.work, run->off, 1e6);
    add_output(&run->shadow.beside, run->off_beside, 1.0);
    *seen = run->shadow;
    memcpy(seen->hash, run->other, sizeof seen->hash);
    seen->phase = run->other[0] == '\0' ? TL_ACTIVATION_NO_SHADOW : run->shadow.phase;
}

static void end_shadow(void *context) {
    (void)context;
    run->other[0] = '\0';
    run->ends++;
}

static bool handover(void *context) {
    char hash[TL_SHA256_TEXT];
    (void)context;
    run->handovers++;
    if (run->handed_over == TL_ACTIVATION_STARTED) {
        memcpy(hash, run->active_hash, sizeof hash);
        memcpy(run->active_hash, run->other, sizeof run->active_hash);
        memcpy(run->other, hash, sizeof run->other);
    }
    return true;
}

static tl_activation_answer handover_result(void *context, char why[TL_ACTIVATION_WHY]) {
    (void)context;
    (void)snprintf(why, TL_ACTIVATION_WHY, "it has died");
    return run->handed_over;
}

static bool remember_text(void *context, const char *hash, char *text, size_t *size) {
    char own[TL_SHA256_TEXT];
    (void)context;
    tl_sha256(run->in_memory, strlen(run->in_memory), own);
    *size = strlen(run->in_memory);
    memcpy(text, run->in_memory, *size + 1);
    return strcmp(own, hash) == 0;
}

static bool has_other_fmus(void *context, const char *text, size_t size) {
    (void)context;
    TEST_ASSERT_EQUAL_size_t(size, strlen(text));
    return run->are_others;
}

static void restart(void *context) {
    (void)context;
    run->has_restarted = true;
}

static void report_event(void *context, tl_severity severity, const char *text) {
    (void)context;
    (void)severity;
    TEST_ASSERT_NOT_EQUAL_INT(0, text[0]);
    run->events++;
}

static const tl_activation_host host = {.read_view = read_view,
                                        .active_hash = get_active_hash,
                                        .text = remember_text,
                                        .has_other_fmus = has_other_fmus,
                                        .use_tolerances = use_tolerances,
                                        .tune = tune,
                                        .tuning_result = tuning_result,
                                        .begin_shadow = begin_shadow,
                                        .read_shadow = read_shadow,
                                        .end_shadow = end_shadow,
                                        .handover = handover,
                                        .handover_result = handover_result,
                                        .restart = restart,
                                        .report = report_event};

static void on_event(void *listener, const tl_control_reply *reply) {
    (void)listener;
    TEST_ASSERT_LESS_THAN_size_t(TL_PLAYED_SAID, run->count);
    run->said[run->count++] = *reply;
}

/* ---- a trial ---- */

/* Returns a number from the environment. */
static int64_t number_of(const char *name, int64_t otherwise) {
    const char *value = getenv(name);
    return value == NULL ? otherwise : strtoll(value, NULL, 10);
}

static int answer_trial(void) {
    tl_worker_job job;
    tl_worker_result *result = NULL;
    if (tl_worker_begin(&job, &run->error) != TL_OK || tl_worker_open_result(&result, &run->error) != TL_OK) {
        return 1;
    }
    result->trial = (tl_trial_answer){.needs = {.match = 1, .adjust = 2, .components = 3, .signals = 1},
                                      .memory = (uint64_t)number_of("TRIAL_MEMORY", 1 << 20),
                                      .step = TL_SECOND / 100,
                                      .least = number_of("TRIAL_LEAST", TL_SECOND / 1000)};
    result->is_complete = (uint32_t)number_of("TRIAL_ANSWERS", 1);
    return 0;
}

static int be_trial(void) {
    const char *wanted = getenv("TRIAL");
    if (wanted != NULL && strcmp(wanted, "crash") == 0) {
        (void)raise(SIGKILL); /* no sanitizer can catch it */
    }
    if (wanted != NULL && strcmp(wanted, "hang") == 0) {
        (void)sleep(3600);
    }
    if (wanted != NULL && strncmp(wanted, "problem", 7) == 0) { /* as lines of the twin's log */
        (void)fprintf(stderr, "<3>%s: line 7: a.b: found 1, expected 2: no more\n<3>%s: x y: z\n%s",
                      getenv("TRIAL_PATH"), getenv("TRIAL_PATH"), wanted[7] == 's' ? "" : "<3>another\n");
        return 65;
    }
    return wanted == NULL ? answer_trial() : (int)strtol(wanted, NULL, 10);
}

int tl_played_be(const char *title, void *context) {
    (void)context;
    return strstr(title, "trial") != NULL ? be_trial() : tl_worker_role_run(NULL);
}

/* ---- configurations ---- */

void tl_played_begin(void) {
    const tl_activation_settings settings = {.host = &host,
                                             .versions = &run->versions,
                                             .refusals = &run->refusals,
                                             .plant = "motor",
                                             .path = run->path,
                                             .allowed = run->allowed,
                                             .run_role = tl_played_be,
                                             .reply = on_event};
    tl_activation_begin(&run->activation, &settings);
}

static size_t write_event(char text[TL_PLAYED_TEXT], const char *tolerance, int prediction) {
    int length =
        snprintf(text, TL_PLAYED_TEXT,
                 "{\"twinlock\": 1, \"name\": \"motor\", \"step_s\": %s,"
                 " \"components\": {\"motor\": {\"fmu\": \"motor.fmu\"}},"
                 " \"plant\": {\"go\": {\"type\": \"boolean\"}, \"there\": {\"type\": \"boolean\"}},"
                 " \"recording\": {\"file\": \"r.csv\"}, \"synchronise\": {\"adjust\": {\"motor.d\": {\"step\": 0.1}},"
                 " \"match\": {\"motor.there\": {\"to\": \"plant.there\", \"tolerance\": %s}}, \"horizon\": {\"event\":"
                 " {\"start\": \"plant.go\", \"end\": \"plant.there\", \"window_s\": 0.1, \"longest_s\": %d}}}}",
                 run->step_s, tolerance, prediction);
    return (size_t)length;
}

size_t tl_played_write(char text[TL_PLAYED_TEXT], const char *tolerance, int prediction) {
    if (run->by_strokes) {
        return write_event(text, tolerance, prediction);
    }
    int length = snprintf(
        text, TL_PLAYED_TEXT,
        "{\"twinlock\": 1, \"name\": \"motor\", \"step_s\": %s,"
        " \"components\": {\"motor\": {\"fmu\": \"motor.fmu\"}},"
        " \"plant\": {\"omega\": {\"unit\": \"rad/s\"}}, \"recording\": {\"file\": \"r.csv\"},"
        " \"synchronise\": {\"adjust\": {\"motor.d\": {\"step\": 0.1}},"
        " \"match\": {\"motor.omega\": {\"to\": \"plant.omega\", \"tolerance\": %s}}, \"horizon\": {\"prediction\": %d}}}",
        run->step_s, tolerance, prediction);
    return (size_t)length;
}

/* Makes the file version 1, as a start of the run does. */
static void take_first(void) {
    char text[TL_PLAYED_TEXT];
    uint64_t number = 0;
    size_t size = tl_played_write(text, "1", 1);
    const tl_version_candidate answer_code = {.text = text,
                                              .size = size,
                                              .who = "the file",
                                              .why = "",
                                              .origin = TL_ORIGIN_START,
                                              .right = TL_RIGHT_COMMISSION,
                                              .kind = TL_CHANGE_RESTART};
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_versions_open(run->scratch.folder, &run->versions, &run->error),
                                  run->error.text);
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_versions_add(&run->versions, &answer_code, &number, &run->error),
                                  run->error.text);
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_versions_activate(&run->versions, number, NULL, &run->error),
                                  run->error.text);
    tl_sha256(text, size, run->active_hash);
    tl_refused_changes_open(&run->refusals, &run->versions);
}

void tl_played_begin_anew(void) {
    tl_activation_end(&run->activation);
    tl_versions_close(&run->versions);
    tl_scratch_empty(&run->folder);
    take_first();
    tl_played_begin();
}

void tl_played_poll_until(bool (*is_done)(void)) {
    tl_time until = tl_clock_now(NULL) + 60 * TL_SECOND;
    while (!is_done()) {
        TEST_ASSERT_TRUE_MESSAGE(tl_clock_now(NULL) < until, "timed out after 60 s");
        run->activation.polled_at -= run->activation.step != TL_CONTROL_SHADOW ? 0
                                     : tl_played_is_live()                     ? TL_SECOND / 10
                                                                               : 5 * TL_SECOND; /* fast-forward */
        tl_activation_poll(&run->activation);
        tl_clock_sleep_until(tl_clock_now(NULL) + TL_SECOND / 500);
    }
}

bool tl_played_is_ended(void) {
    return run->count > 0 && run->said[run->count - 1].kind == TL_CONTROL_END;
}

bool tl_played_is_quiet(void) {
    return !tl_activation_is_busy(&run->activation);
}

bool tl_played_is_live(void) {
    return run->activation.row == TL_ACTIVATION_ROW_LIVE;
}

void tl_played_offer(const char *tolerance, int prediction, unsigned flags) {
    char text[TL_PLAYED_TEXT];
    tl_control_request request;
    size_t size = tl_played_write(text, tolerance, prediction);
    memset(&request, 0, sizeof request);
    request.right = run->right;
    request.origin = run->right == TL_RIGHT_COMMISSION ? TL_ORIGIN_RELOAD : TL_ORIGIN_NETWORK;
    request.require_lock = -1.0;
    request.flags = flags;
    request.shadow_s = 5;
    (void)snprintf(request.who, sizeof request.who, "ann");
    tl_sha256(text, size, request.hash);
    run->count = 0;
    tl_activation_start(&run->activation, &request, text, size);
}

tl_control_result tl_played_take(const char *tolerance, int prediction, unsigned flags) {
    tl_played_offer(tolerance, prediction, flags);
    tl_played_poll_until(tl_played_is_ended);
    return (tl_control_result)run->said[run->count - 1].as.end.result;
}

bool tl_played_was_said(tl_control_step step, const char *parts) {
    for (size_t i = 0; i < run->count; i++) {
        if (run->said[i].kind == TL_CONTROL_STEP && run->said[i].as.progress.step == (uint32_t)step &&
            tl_test_has_parts(run->said[i].as.progress.text, parts)) {
            return true;
        }
    }
    return false;
}

const char *tl_played_last_word(void) {
    return run->said[run->count - 1].as.end.text;
}

void tl_played_fail(void) {
    run->count = 0;
    run->view.figures.twin_failures++;
    tl_activation_poll(&run->activation);
    tl_played_poll_until(tl_played_is_quiet);
}

void tl_played_expect_refused(tl_control_result result, const char *parts) {
    TEST_ASSERT_EQUAL_UINT(result, run->said[run->count - 1].as.end.result);
    TL_EXPECT_PARTS(parts, tl_played_last_word());
    TEST_ASSERT_EQUAL_INT(0, run->handovers);
    TEST_ASSERT_EQUAL_STRING("", run->other);
    TEST_ASSERT_EQUAL_UINT64(1, run->versions.active);
    TEST_ASSERT_FALSE(run->has_restarted);
    TEST_ASSERT_TRUE(tl_activation_is_idle(&run->activation));
}

/* ---- a test ---- */

tl_played *tl_played_open(const char *parent, const char *name) {
    tl_scratch_make(&run->scratch, parent, name);
    (void)snprintf(run->folder.folder, sizeof run->folder.folder, "%.*s/versions", PATH_MAX - 16, run->scratch.folder);
    return run;
}

int tl_played_close(int failures) {
    tl_scratch_empty(&run->folder);
    (void)rmdir(run->folder.folder);
    return tl_scratch_finish(&run->scratch, failures);
}

void tl_played_set(void) {
    tl_scratch_empty(&run->folder);
    (void)rmdir(run->folder.folder);
    tl_scratch_empty(&run->scratch);
    (void)snprintf(run->path, sizeof run->path, "%s/motor.json", run->scratch.folder);
    run->view = (tl_activation_view){.step_s = 0.01, .figures = {.twin_alive = true}};
    run->given[0] = '\0';
    run->answer = TL_ACTIVATION_STARTED;
    run->has_restarted = false;
    run->events = 0;
    run->step_s = "0.01";
    run->by_strokes = false;
    run->right = TL_RIGHT_COMMISSION;
    run->in_memory[0] = '\0';
    memset(&run->shadow, 0, sizeof run->shadow);
    run->shadow.phase = TL_ACTIVATION_SHADOW_LIVE;
    run->each = (tl_run_status){.ticks = 10, .steps = 10, .lock.steps[TL_LOCK_LOCKED] = 10};
    run->beside = run->each;
    run->other[0] = '\0';
    run->handed_over = TL_ACTIVATION_STARTED;
    run->is_slow = false;
    run->are_others = false;
    run->off = run->off_beside = 0.25;
    run->handovers = 0;
    (void)unsetenv("TRIAL");
    (void)unsetenv("TRIAL_ANSWERS");
    (void)unsetenv("TRIAL_MEMORY");
    (void)unsetenv("TRIAL_LEAST");
    take_first();
    tl_played_begin();
    run->ends = 0;
}

void tl_played_clear(void) {
    tl_activation_end(&run->activation);
    tl_versions_close(&run->versions);
}
