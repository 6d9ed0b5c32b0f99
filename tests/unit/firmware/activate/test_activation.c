/* Activations beside a run that is played here: what its twin takes, refuses, or cannot take, and what is on disk then. Validators are real processes; a
 * trial is one that says what this file wants of it. */
#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <unity.h>

#include "firmware/activate/activation.h"
#include "firmware/activate/trial.h"
#include "firmware/activate/validator.h"
#include "firmware/base/clock.h"
#include "firmware/process/role.h"
#include "tests/support/scratch.h"

enum { SAID = 64 };

static tl_scratch scratch;
static tl_scratch folder; /* of the versions */
static char path[PATH_MAX + 32];
static tl_versions versions;
static tl_activation activation;
static tl_error error;

/* The run. */
static tl_activation_view view;
static char in_force[TL_SHA256_TEXT];
static char given[TL_SHA256_TEXT]; /* of the newest tuning; "": none */
static tl_activation_news answer;
static bool has_restarted;
static int events;

/* What was said to who has asked. */
static tl_control_reply said[SAID];
static size_t count;

/* ---- the run that is played ---- */

static void look(void *context, tl_activation_view *seen) {
    (void)context;
    *seen = view;
}

static void tell_in_force(void *context, char hash[TL_SHA256_TEXT]) {
    (void)context;
    memcpy(hash, in_force, sizeof in_force);
}

static bool tune(void *context, const tl_activation_tuning *tuning) {
    (void)context;
    memcpy(given, tuning->hash, sizeof given);
    if (answer == TL_ACTIVATION_TAKEN) {
        memcpy(in_force, given, sizeof in_force);
    }
    return true;
}

static tl_activation_news was_taken(void *context, char why[TL_ACTIVATION_WHY]) {
    (void)context;
    (void)snprintf(why, TL_ACTIVATION_WHY, "there is no room");
    return answer;
}

static void restart(void *context) {
    (void)context;
    has_restarted = true;
}

static void tell(void *context, tl_severity severity, const char *text) {
    (void)context;
    (void)severity;
    TEST_ASSERT_NOT_EQUAL_INT(0, text[0]);
    events++;
}

static const tl_activation_host host = {
    .look = look, .in_force = tell_in_force, .tune = tune, .was_taken = was_taken, .restart = restart, .tell = tell};

static void hear(void *listener, const tl_control_reply *reply) {
    (void)listener;
    TEST_ASSERT_LESS_THAN_size_t(SAID, count);
    said[count++] = *reply;
}

/* What is to come of a trial is in the environment. */
static int be_trial(void) {
    const char *wanted = getenv("TRIAL");
    if (wanted != NULL && strcmp(wanted, "crash") == 0) {
        (void)raise(SIGKILL); /* which no sanitizer catches */
    }
    return wanted == NULL ? 0 : (int)strtol(wanted, NULL, 10);
}

static int be(const char *title, void *context) {
    (void)context;
    return strncmp(title, TL_TRIAL, strlen(TL_TRIAL)) == 0 ? be_trial() : tl_validator_role_run();
}

static void begin(void) {
    const tl_activation_settings settings = {
        .host = &host, .versions = &versions, .plant = "motor", .path = path, .be = be, .say = hear};
    tl_activation_begin(&activation, &settings);
}

/* ---- configurations ---- */

static size_t write_configuration(char text[2048], const char *tolerance, int prediction) {
    int length = snprintf(
        text, 2048,
        "{\"twinlock\": 1, \"name\": \"motor\", \"step_s\": 0.01,"
        " \"components\": {\"motor\": {\"fmu\": \"motor.fmu\"}},"
        " \"plant\": {\"omega\": {\"unit\": \"rad/s\"}}, \"recording\": {\"file\": \"r.csv\"},"
        " \"synchronise\": {\"adjust\": {\"motor.d\": {\"step\": 0.1}},"
        " \"match\": {\"motor.omega\": {\"to\": \"plant.omega\", \"tolerance\": %s}}, \"horizon\": {\"prediction\": %d}}}",
        tolerance, prediction);
    return (size_t)length;
}

/* The file, as the start takes it. */
static void take_first(void) {
    char text[2048];
    uint64_t number = 0;
    size_t size = write_configuration(text, "1", 1);
    const tl_version_news news = {.text = text, .size = size, .who = "the file", .why = "", .kind = TL_CHANGE_RESTART};
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_versions_open(scratch.folder, &versions, &error), error.text);
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_versions_add(&versions, &news, &number, &error), error.text);
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_versions_activate(&versions, number, NULL, &error), error.text);
    tl_sha256(text, size, in_force);
}

static void look_until(bool (*is_done)(void)) {
    tl_time until = tl_clock_now(NULL) + 60 * TL_SECOND;
    while (!is_done()) {
        TEST_ASSERT_TRUE_MESSAGE(tl_clock_now(NULL) < until, "waited in vain");
        tl_activation_look(&activation);
        tl_clock_sleep_until(tl_clock_now(NULL) + TL_SECOND / 500);
    }
}

static bool is_ended(void) {
    return count > 0 && said[count - 1].kind == TL_CONTROL_END;
}

static bool is_quiet(void) {
    return !tl_activation_is_busy(&activation);
}

static tl_control_result take(const char *tolerance, int prediction, unsigned flags) {
    char text[2048];
    tl_control_request request;
    size_t size = write_configuration(text, tolerance, prediction);
    memset(&request, 0, sizeof request);
    request.right = TL_CONTROL_MAY_COMMISSION;
    request.require_lock = -1.0;
    request.flags = flags;
    (void)snprintf(request.who, sizeof request.who, "ann");
    tl_sha256(text, size, request.hash);
    count = 0;
    tl_activation_take(&activation, &request, text, size);
    look_until(is_ended);
    return (tl_control_result)said[count - 1].as.end.result;
}

void setUp(void) {
    tl_scratch_empty(&folder);
    (void)rmdir(folder.folder);
    tl_scratch_empty(&scratch);
    (void)snprintf(path, sizeof path, "%s/motor.json", scratch.folder);
    view = (tl_activation_view){.step_s = 0.01, .figures = {.twin_alive = true}};
    given[0] = '\0';
    answer = TL_ACTIVATION_TAKEN;
    has_restarted = false;
    events = 0;
    (void)unsetenv("TRIAL");
    take_first();
    begin();
}

void tearDown(void) {
    tl_activation_end(&activation);
    tl_versions_close(&versions);
}

/* ---- tests ---- */

static void test_in_place(void) {
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_DONE, take("0.5", 1, 0));
    TEST_ASSERT_EQUAL_UINT64(2, versions.active);
    TEST_ASSERT_EQUAL_UINT64(1, versions.probation.return_to);
    TEST_ASSERT_EQUAL_STRING(tl_versions_get(&versions, 2)->hash, in_force);
    TEST_ASSERT_FALSE(has_restarted);
    TEST_ASSERT_EQUAL_UINT(TL_ACTIVATION_PROBATION_S, tl_activation_left_s(&activation));
}

/* The disk says the old one again, and so does the block, for whoever looks at it next. */
static void test_a_twin_that_refuses(void) {
    char before[TL_SHA256_TEXT];
    memcpy(before, in_force, sizeof before);
    answer = TL_ACTIVATION_REFUSED;
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_FAILED, take("0.5", 1, 0));
    TEST_ASSERT_EQUAL_UINT64(1, versions.active);
    TEST_ASSERT_EQUAL_UINT64(0, versions.probation.version);
    TEST_ASSERT_NOT_NULL(strstr(said[count - 1].as.end.text, "there is no room"));
    TEST_ASSERT_EQUAL_STRING(before, in_force);
}

/* Its twin had the new one, and this process ended before it could see that: the next one brings the run to what the disk says. */
static void test_what_was_not_finished(void) {
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_DONE, take("0.5", 1, 0));
    tl_activation_end(&activation);
    tl_sha256("another", 7, in_force);
    given[0] = '\0';
    begin();
    look_until(is_quiet);
    TEST_ASSERT_EQUAL_STRING(tl_versions_get(&versions, 2)->hash, in_force);
    TEST_ASSERT_EQUAL_UINT64(2, versions.probation.version); /* which goes on */
}

static void test_a_failure_of_the_twin(void) {
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_DONE, take("0.5", 1, 0));
    view.figures.twin_failures = 1;
    tl_activation_look(&activation);
    look_until(is_quiet);
    TEST_ASSERT_EQUAL_UINT64(1, versions.active);
    TEST_ASSERT_EQUAL_STRING(tl_versions_get(&versions, 1)->hash, in_force);
    TEST_ASSERT_EQUAL_INT(TL_VERSION_RETURNED, tl_versions_get(&versions, 2)->result);
}

static void test_what_takes_a_restart(void) {
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_RESTART, take("1", 2, 0));
    TEST_ASSERT_EQUAL_UINT64(1, versions.active);
    TEST_ASSERT_EQUAL_INT(0, setenv("TRIAL", "65", 1));
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_INVALID, take("1", 2, TL_CONTROL_MAY_RESTART));
    TEST_ASSERT_FALSE(has_restarted);
    TEST_ASSERT_EQUAL_INT(0, setenv("TRIAL", "crash", 1));
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_INVALID, take("1", 2, TL_CONTROL_MAY_RESTART));
    TEST_ASSERT_NOT_NULL(strstr(said[count - 1].as.end.text, "died of signal"));
    TEST_ASSERT_EQUAL_INT(0, unsetenv("TRIAL"));
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_DONE, take("1", 2, TL_CONTROL_MAY_RESTART));
    TEST_ASSERT_TRUE(has_restarted);
    TEST_ASSERT_EQUAL_UINT64(2, versions.active);
    TEST_ASSERT_EQUAL_STRING("", given);
}

/* There is no twin that could take anything. */
static void test_in_safe_hold(void) {
    view.holds = true;
    view.figures.twin_alive = false;
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_RESTART, take("0.5", 1, 0));
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_DONE, take("0.5", 1, TL_CONTROL_MAY_RESTART));
    TEST_ASSERT_TRUE(has_restarted);
    TEST_ASSERT_EQUAL_UINT64(2, versions.active);
}

/* Whoever sends it: what names a file comes from the box. */
static void test_what_does_not_come_by_the_network(void) {
    char text[2048];
    tl_control_request request;
    size_t size = write_configuration(text, "1", 1);
    char *fmu = strstr(text, "motor.fmu");
    memcpy(fmu, "/a/b.fmu ", strlen("motor.fmu"));
    memset(&request, 0, sizeof request);
    request.right = TL_CONTROL_MAY_COMMISSION;
    request.flags = TL_CONTROL_MAY_RESTART;
    for (unsigned i = 0; i < TL_CONTROL_ORIGINS; i++) {
        unsigned origin = TL_CONTROL_ORIGINS - 1 - i; /* the network first */
        request.origin = origin;
        tl_sha256(text, size, request.hash);
        count = 0;
        tl_activation_take(&activation, &request, text, size);
        look_until(is_ended);
        TEST_ASSERT_EQUAL_UINT(origin == TL_CONTROL_BY_NETWORK ? TL_CONTROL_FORBIDDEN : TL_CONTROL_DONE,
                               said[count - 1].as.end.result);
    }
}

static void test_who_may_not(void) {
    char text[2048];
    tl_control_request request;
    size_t size = write_configuration(text, "0.5", 1);
    memset(&request, 0, sizeof request);
    request.right = TL_CONTROL_MAY_READ;
    tl_sha256(text, size, request.hash);
    count = 0;
    tl_activation_take(&activation, &request, text, size);
    TEST_ASSERT_TRUE(is_ended());
    TEST_ASSERT_EQUAL_UINT(TL_CONTROL_FORBIDDEN, said[count - 1].as.end.result);
    TEST_ASSERT_EQUAL_INT(1, events);
    TEST_ASSERT_EQUAL_UINT64(1, versions.active);
}

int main(int argc, char **argv) {
    (void)argc;
    const char *title = tl_role_begin(argv);
    if (title != NULL) {
        return be(title, NULL);
    }
    tl_scratch_make(&scratch, TL_BINARY_DIR, "activation");
    (void)snprintf(folder.folder, sizeof folder.folder, "%.*s/versions", PATH_MAX - 16, scratch.folder);
    UNITY_BEGIN();
    RUN_TEST(test_in_place);
    RUN_TEST(test_a_twin_that_refuses);
    RUN_TEST(test_what_was_not_finished);
    RUN_TEST(test_a_failure_of_the_twin);
    RUN_TEST(test_what_takes_a_restart);
    RUN_TEST(test_in_safe_hold);
    RUN_TEST(test_what_does_not_come_by_the_network);
    RUN_TEST(test_who_may_not);
    setUp();
    tearDown();
    tl_scratch_empty(&folder);
    (void)rmdir(folder.folder);
    return tl_scratch_finish(&scratch, UNITY_END());
}
