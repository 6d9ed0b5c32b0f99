/* Activations in place and by a restart: accepted and refused changes, problems that a trial finds,
 * access rights, and the versions on disk. The run is simulated, see played_run.h. */
#include <errno.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include <unity.h>

#include "firmware/base/os.h"
#include "firmware/process/role.h"
#include "tests/support/message.h"
#include "tests/support/played_run.h"

static tl_played *run;

void setUp(void) {
    tl_played_set();
}

void tearDown(void) {
    tl_played_clear();
}

static void test_in_place(void) {
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_DONE, tl_played_take("0.5", 1, 0));
    TEST_ASSERT_EQUAL_UINT64(2, run->versions.active);
    TEST_ASSERT_EQUAL_UINT64(1, run->versions.probation.return_to);
    TEST_ASSERT_EQUAL_STRING(tl_versions_get(&run->versions, 2)->hash, run->active_hash);
    TEST_ASSERT_FALSE(run->has_restarted);
    TEST_ASSERT_EQUAL_UINT(TL_ACTIVATION_PROBATION_S, tl_activation_remaining_s(&run->activation));
}

/* The text of the active version is damaged on disk: it is copied from the run's memory. The change
 * fails if the run's memory has another text. */
static void test_a_damaged_text(void) {
    char file[PATH_MAX + TL_SHA256_TEXT + 8];
    char *text = NULL;
    (void)snprintf(file, sizeof file, "%s/%s.json", run->folder.folder, tl_versions_get(&run->versions, 1)->hash);
    for (int i = 0; i < 2; i++) {
        TEST_ASSERT_EQUAL_INT(0, truncate(file, 3));
        TEST_ASSERT_EQUAL_INT(i == 0 ? TL_CONTROL_FAILED : TL_CONTROL_DONE, tl_played_take("0.5", 1, 0));
        (void)tl_played_write(run->in_memory, "1", 1);
    }
    TEST_ASSERT_EQUAL_UINT64(2, run->versions.active);
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_versions_read(&run->versions, 1, &text, &run->error));
    TEST_ASSERT_EQUAL_STRING(run->in_memory, text);
    free(text);
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA,
                          tl_versions_repair(&run->versions, 2, run->in_memory, strlen(run->in_memory), &run->error));
}

/* Returns the run time of the trial in s if the reply names it and the limit of 180 s, otherwise
 * 0. */
static long told_seconds(const tl_control_reply *reply) {
    const char *text = reply->as.progress.text;
    const char *number = text + strcspn(text, "0123456789");
    return tl_test_has_parts(text, "180 s") ? strtol(number, NULL, 10) : 0;
}

/* Expected after 10 s and 20 s, but later on a busy machine. */
static bool is_told_twice(void) {
    long first = run->count > 1 ? told_seconds(&run->said[run->count - 2]) : 0;
    return first >= 10 && told_seconds(&run->said[run->count - 1]) >= first + 10;
}

/* FMUs that load forever: the client gets a reply every 10 s. */
static void test_a_trial_that_hangs(void) {
    (void)setenv("TRIAL", "hang", 1);
    tl_played_offer("1", 3, TL_CONTROL_MAY_RESTART);
    while (!is_told_twice()) {
        run->activation.polled_at -= run->activation.step == TL_CONTROL_TRY ? TL_SECOND : 0;
        tl_activation_poll(&run->activation);
        TEST_ASSERT_FALSE(tl_played_is_ended());
        tl_clock_sleep_until(tl_clock_now(NULL) + TL_SECOND / 200);
    }
}

static const tl_control_problem *next_problem(size_t *i) {
    while (*i < run->count && run->said[*i].kind != TL_CONTROL_PROBLEM) {
        (*i)++;
    }
    TEST_ASSERT_LESS_THAN_size_t(run->count, *i);
    return &run->said[(*i)++].as.problem;
}

/* The problems name lines of the text that was sent, not of the run's file. */
static void test_problems_of_a_trial(void) {
    size_t i = 0;
    (void)setenv("TRIAL", "problem", 1);
    (void)setenv("TRIAL_PATH", run->path, 1);
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_INVALID, tl_played_take("1", 3, TL_CONTROL_MAY_RESTART));
    const tl_control_problem *problem = next_problem(&i);
    TEST_ASSERT_EQUAL_UINT32(7, problem->line);
    TEST_ASSERT_EQUAL_STRING("a.b", problem->path);
    TEST_ASSERT_EQUAL_STRING("found 1, expected 2: no more", problem->text);
    problem = next_problem(&i);
    TEST_ASSERT_EQUAL_UINT32(0, problem->line);
    TEST_ASSERT_EQUAL_STRING("", problem->path);
    TEST_ASSERT_EQUAL_STRING("x y: z", problem->text);
    TEST_ASSERT_FALSE(tl_played_was_said(TL_CONTROL_TRY, "another")); /* only in the final reply */
    TL_EXPECT_PARTS("another", tl_played_last_word());
    (void)setenv("TRIAL", "problems", 1);
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_INVALID, tl_played_take("1", 3, TL_CONTROL_MAY_RESTART));
    TL_EXPECT_PARTS("2 problems", tl_played_last_word());
}

/* The probation continues until its end can be written to disk. One event reports that. */
static void test_a_disk_that_refuses_the_end(void) {
    char moved[PATH_MAX + 8];
    bool is_done = true;
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_DONE, tl_played_take("0.5", 1, 0));
    (void)snprintf(moved, sizeof moved, "%s.moved", run->folder.folder);
    TEST_ASSERT_EQUAL_INT(0, rename(run->folder.folder, moved));
    int before = run->events;
    for (int i = 0; i < 3; i++) {
        TEST_ASSERT_TRUE(tl_activation_confirm(&run->activation, "ann", &is_done));
        TEST_ASSERT_FALSE(is_done);
        TEST_ASSERT_EQUAL_INT(before + 1, run->events);
        TEST_ASSERT_EQUAL_UINT64(2, run->versions.probation.version);
    }
    TEST_ASSERT_EQUAL_INT(0, rename(moved, run->folder.folder));
    TEST_ASSERT_TRUE(tl_activation_confirm(&run->activation, "ann", &is_done));
    TEST_ASSERT_TRUE(is_done);
    TEST_ASSERT_EQUAL_INT(before + 3, run->events);
}

/* The old version is active again, both on disk and in the run. */
static void test_a_twin_that_refuses(void) {
    char before[TL_SHA256_TEXT];
    memcpy(before, run->active_hash, sizeof before);
    run->answer = TL_ACTIVATION_REFUSED;
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_FAILED, tl_played_take("0.5", 1, 0));
    TEST_ASSERT_EQUAL_UINT64(1, run->versions.active);
    TEST_ASSERT_EQUAL_UINT64(0, run->versions.probation.version);
    TL_EXPECT_PARTS("no room", tl_played_last_word());
    TEST_ASSERT_EQUAL_STRING(before, run->active_hash);
}

/* The activation process ends before it sees that the twin has the new version. The next one
 * applies the version on disk. */
static void test_what_was_not_finished(void) {
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_DONE, tl_played_take("0.5", 1, 0));
    tl_activation_end(&run->activation);
    memcpy(run->active_hash, tl_versions_get(&run->versions, 1)->hash, sizeof run->active_hash);
    run->given[0] = '\0';
    tl_played_begin();
    tl_played_poll_until(tl_played_is_quiet);
    TEST_ASSERT_EQUAL_STRING(tl_versions_get(&run->versions, 2)->hash, run->active_hash);
    TEST_ASSERT_EQUAL_UINT64(2, run->versions.probation.version);
}

static void test_a_failure_of_the_twin(void) {
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_DONE, tl_played_take("0.5", 1, 0));
    run->view.figures.twin_failures = 1;
    tl_activation_poll(&run->activation);
    tl_played_poll_until(tl_played_is_quiet);
    TEST_ASSERT_EQUAL_UINT64(1, run->versions.active);
    TEST_ASSERT_EQUAL_STRING(tl_versions_get(&run->versions, 1)->hash, run->active_hash);
    TEST_ASSERT_EQUAL_INT(TL_VERSION_ROLLED_BACK, tl_versions_get(&run->versions, 2)->result);
}

static void test_what_takes_a_restart(void) {
    run->step_s = "0.02";
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_RESTART, tl_played_take("1", 1, 0));
    TL_EXPECT_PARTS("step_s|--restart", tl_played_last_word());
    TEST_ASSERT_EQUAL_UINT64(1, run->versions.active);
    TEST_ASSERT_EQUAL_INT(0, setenv("TRIAL", "65", 1));
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_INVALID, tl_played_take("1", 1, TL_CONTROL_MAY_RESTART));
    TEST_ASSERT_FALSE(run->has_restarted);
    TEST_ASSERT_EQUAL_INT(0, setenv("TRIAL", "crash", 1));
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_INVALID, tl_played_take("1", 1, TL_CONTROL_MAY_RESTART));
    TL_EXPECT_PARTS("signal 9", tl_played_last_word());
    TEST_ASSERT_EQUAL_INT(0, unsetenv("TRIAL"));
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_DONE, tl_played_take("1", 1, TL_CONTROL_MAY_RESTART));
    TEST_ASSERT_TRUE(run->has_restarted);
    TEST_ASSERT_EQUAL_UINT64(2, run->versions.active);
    TEST_ASSERT_EQUAL_STRING("", run->given);
    TEST_ASSERT_EQUAL_STRING("", run->other);
}

/* The run's configuration is unknown, so that the changes are, too: only a restart applies the
 * version. */
static void test_a_run_of_what_is_no_version(void) {
    tl_activation_end(&run->activation);
    tl_sha256("another", 7, run->active_hash);
    tl_played_begin();
    TEST_ASSERT_TRUE(run->has_restarted);
    TEST_ASSERT_EQUAL_STRING("", run->given);
}

/* A full disk is detected before the shadow starts. A check alone needs no disk. */
static void test_a_disk_without_room(void) {
    const struct rlimit little = {4096, RLIM_INFINITY};
    struct rlimit before;
    TEST_ASSERT_EQUAL_INT(0, getrlimit(RLIMIT_FSIZE, &before));
    (void)signal(SIGXFSZ, SIG_IGN);
    TEST_ASSERT_EQUAL_INT(0, setrlimit(RLIMIT_FSIZE, &little));
    tl_played_offer("1", 2, 0);
    TEST_ASSERT_EQUAL_INT(0, setrlimit(RLIMIT_FSIZE, &before));
    TEST_ASSERT_TRUE(tl_played_is_ended());
    tl_played_expect_refused(TL_CONTROL_FAILED, strerror(EFBIG));
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_DONE, tl_played_take("1", 2, TL_CONTROL_ONLY_CHECK));
}

/* A reason of blanks is stored as an empty reason. */
static void test_a_why_of_blanks(void) {
    char text[TL_PLAYED_TEXT];
    tl_control_request request;
    size_t size = tl_played_write(text, "0.5", 1);
    memset(&request, 0, sizeof request);
    request.right = TL_RIGHT_COMMISSION;
    (void)snprintf(request.why, sizeof request.why, " \t ");
    tl_sha256(text, size, request.hash);
    run->count = 0;
    tl_activation_start(&run->activation, &request, text, size);
    tl_played_poll_until(tl_played_is_ended);
    TEST_ASSERT_EQUAL_STRING("", tl_versions_get(&run->versions, 2)->why);
}

/* In safe hold no twin can accept a change. */
static void test_in_safe_hold(void) {
    run->view.holds = true;
    run->view.figures.twin_alive = false;
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_RESTART, tl_played_take("0.5", 1, 0));
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_DONE, tl_played_take("0.5", 1, TL_CONTROL_MAY_RESTART));
    TEST_ASSERT_TRUE(run->has_restarted);
    TEST_ASSERT_EQUAL_UINT64(2, run->versions.active);
}

/* Sends the configuration with another text in place of its FMU's name. */
static tl_control_result take_fmu(const char *fmu, tl_change_origin origin) {
    char text[TL_PLAYED_TEXT];
    char edited[TL_PLAYED_TEXT];
    tl_control_request request;
    (void)tl_played_write(text, "1", 1);
    char *at = strstr(text, "\"motor.fmu\"");
    int size = snprintf(edited, sizeof edited, "%.*s%s%s", (int)(at - text), text, fmu, at + strlen("\"motor.fmu\""));
    memset(&request, 0, sizeof request);
    request.right = TL_RIGHT_COMMISSION;
    request.flags = TL_CONTROL_MAY_RESTART | TL_CONTROL_ONLY_CHECK;
    request.origin = (uint32_t)origin;
    request.shadow_s = 5;
    tl_sha256(edited, (size_t)size, request.hash);
    run->count = 0;
    tl_activation_start(&run->activation, &request, edited, (size_t)size);
    tl_played_poll_until(tl_played_is_ended);
    return (tl_control_result)run->said[run->count - 1].as.end.result;
}

static void expect_problem(const char *path, const char *parts) {
    size_t i = 0;
    const tl_control_problem *problem = next_problem(&i);
    TEST_ASSERT_EQUAL_STRING(path, problem->path);
    TL_EXPECT_PARTS(parts, problem->text);
}

/* Only `twinlock reload` on the box may name a file, also for the right to commission. */
static void test_what_does_not_come_by_the_network(void) {
    for (unsigned i = 0; i < TL_ORIGIN_START; i++) {
        tl_control_result result = i == TL_ORIGIN_RELOAD ? TL_CONTROL_DONE : TL_CONTROL_FORBIDDEN;
        TEST_ASSERT_EQUAL_INT(result, take_fmu("\"/a/b.fmu\"", (tl_change_origin)i));
        TEST_ASSERT_EQUAL_INT(result, take_fmu("\"other.fmu\"", (tl_change_origin)i));
    }
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_FORBIDDEN, take_fmu("\"/a/b.fmu\"", TL_ORIGIN_NETWORK));
    expect_problem("components.motor.fmu", "\"/a/b.fmu\"|installed|\"sha256\"");
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_FORBIDDEN, take_fmu("\"other.fmu\"", TL_ORIGIN_NETWORK));
    expect_problem("components.motor.fmu", "\"other.fmu\"|\"sha256\"");
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_FORBIDDEN, take_fmu("\"motor.fmu\", \"unconfined\": true", TL_ORIGIN_NETWORK));
    expect_problem("components.motor.unconfined", "true|twinlock reload|--right");
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_DONE,
                          take_fmu("\"other.fmu\", \"sha256\": "
                                   "\"0123456789012345678901234567890123456789012345678901234567890123\"",
                                   TL_ORIGIN_NETWORK));
}

static void write_file(const char *path, const char *text) {
    FILE *file = fopen(path, "w");
    TEST_ASSERT_NOT_NULL(file);
    TEST_ASSERT_GREATER_OR_EQUAL_INT(0, fputs(text, file));
    TEST_ASSERT_EQUAL_INT(0, fclose(file));
    TEST_ASSERT_EQUAL_INT(0, chmod(path, 0644));
}

/* A name is allowed if the administrator's list or the configuration file on the box has it. */
static void test_names_that_are_allowed(void) {
    static const char *const library = "\"motor.fmu\", \"libraries\": [\"/lib/l.so\"]";
    static const char *const file = "\"motor.fmu\", \"read\": [\"/srv/r\"]";
    (void)snprintf(run->allowed, sizeof run->allowed, "%s/allowed", run->scratch.folder);
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_FORBIDDEN, take_fmu(library, TL_ORIGIN_NETWORK));
    expect_problem("components.motor.libraries[0]", "/allowed|library");
    write_file(run->allowed, "file /lib/l.so\nfile /srv/r\n");
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_FORBIDDEN, take_fmu(library, TL_ORIGIN_NETWORK));
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_DONE, take_fmu(file, TL_ORIGIN_NETWORK));
    write_file(run->allowed, "library /lib/l.so\n");
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_DONE, take_fmu(library, TL_ORIGIN_NETWORK));
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_FORBIDDEN, take_fmu(file, TL_ORIGIN_NETWORK));
    expect_problem("components.motor.read[0]", "/allowed|file");
    write_file(run->path, "{\"components\": {\"motor\": {\"read\": [\"/srv/r\"]}}}");
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_DONE, take_fmu(file, TL_ORIGIN_NETWORK));
    TEST_ASSERT_EQUAL_INT(0, chmod(run->allowed, 0666));
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_FORBIDDEN, take_fmu(library, TL_ORIGIN_NETWORK));
    TEST_ASSERT_TRUE(tl_played_was_said(TL_CONTROL_VALIDATE, "/allowed|root"));
}

static void test_who_may_not(void) {
    char text[TL_PLAYED_TEXT];
    tl_control_request request;
    size_t size = tl_played_write(text, "0.5", 1);
    memset(&request, 0, sizeof request);
    request.right = TL_RIGHT_READ;
    tl_sha256(text, size, request.hash);
    run->count = 0;
    tl_activation_start(&run->activation, &request, text, size);
    TEST_ASSERT_TRUE(tl_played_is_ended());
    TEST_ASSERT_EQUAL_UINT(TL_CONTROL_FORBIDDEN, run->said[run->count - 1].as.end.result);
    TEST_ASSERT_EQUAL_INT(1, run->events);
    TEST_ASSERT_EQUAL_UINT64(1, run->versions.active);
}

static tl_control_result retune(const char *tolerance) {
    run->right = TL_RIGHT_RETUNE;
    tl_control_result result = tl_played_take(tolerance, 1, 0);
    run->right = TL_RIGHT_COMMISSION;
    return result;
}

static void keep(void) {
    bool is_done = false;
    TEST_ASSERT_TRUE(tl_activation_confirm(&run->activation, "ann", &is_done));
    TEST_ASSERT_TRUE(is_done);
}

/* The limit refers to the commissioned tolerance, not to the active one. */
static void test_how_far_a_tolerance_may_be_widened(void) {
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_FORBIDDEN, retune("1e300"));
    expect_problem("synchronise.match.motor.omega", "1e+300|at most 3");
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_FORBIDDEN, retune("3.001"));
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_FORBIDDEN, retune("1, \"weight\": 0.1"));
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_FORBIDDEN, retune("1, \"huber\": 0.1"));
    for (int i = 0; i < 2; i++) {
        TEST_ASSERT_EQUAL_INT(TL_CONTROL_DONE, retune(i == 0 ? "2" : "3"));
        keep();
    }
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_FORBIDDEN, retune("4"));
    expect_problem("synchronise.match.motor.omega", "at most 3");
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_DONE, tl_played_take("4", 1, 0));
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_FORBIDDEN, retune("5")); /* 4 is not kept yet */
    keep();
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_DONE, retune("12"));
}

/* On probation, the lock is also judged by the tolerances of the version to return to, also if a
 * second version replaces the first one. After the probation it is not. */
static void test_what_it_is_judged_by(void) {
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_DONE, retune("2"));
    TEST_ASSERT_EQUAL_DOUBLE(1.0, run->tolerances.match[0].tolerance);
    TEST_ASSERT_EQUAL_STRING("motor.omega: tolerance 1 → 2", run->activation.probation.account.widened);
    TEST_ASSERT_EQUAL_INT(TL_CONTROL_DONE, retune("3"));
    TEST_ASSERT_EQUAL_DOUBLE(1.0, run->tolerances.match[0].tolerance);
    tl_activation_end(&run->activation);
    memset(&run->tolerances, 0, sizeof run->tolerances);
    tl_played_begin();
    tl_activation_poll(&run->activation);
    TEST_ASSERT_EQUAL_DOUBLE(1.0, run->tolerances.match[0].tolerance);
    run->view.figures.lock_before.state = TL_LOCK_LOST;
    tl_activation_poll(&run->activation);
    TEST_ASSERT_TRUE(tl_activation_was_lost_before(&run->activation));
    keep();
    TEST_ASSERT_FALSE(tl_activation_was_lost_before(&run->activation));
    tl_activation_poll(&run->activation);
    TEST_ASSERT_FALSE(tl_lock_tolerances_have_weight(&run->tolerances));
}

/* The right to retune cannot ask for a probation that is too short to judge the lock. */
static void test_how_short_a_probation_may_be(void) {
    char text[TL_PLAYED_TEXT];
    for (unsigned right = TL_RIGHT_RETUNE; right <= TL_RIGHT_COMMISSION; right++) {
        tl_control_request request;
        size_t size = tl_played_write(text, right == TL_RIGHT_RETUNE ? "0.5" : "0.6", 1);
        memset(&request, 0, sizeof request);
        request.right = right;
        request.probation_s = 1;
        tl_sha256(text, size, request.hash);
        run->count = 0;
        tl_activation_start(&run->activation, &request, text, size);
        tl_played_poll_until(tl_played_is_ended);
        TEST_ASSERT_EQUAL_UINT32(right == TL_RIGHT_RETUNE ? 3 : 1, run->activation.probation.account.terms.given_s);
    }
}

int main(int argc, char **argv) {
    (void)argc;
    const char *title = tl_role_begin(argv);
    if (title != NULL) {
        return tl_played_be(title, NULL);
    }
    run = tl_played_open(TL_BINARY_DIR, "test_activation");
    UNITY_BEGIN();
    RUN_TEST(test_in_place);
    RUN_TEST(test_a_damaged_text);
    RUN_TEST(test_a_trial_that_hangs);
    RUN_TEST(test_problems_of_a_trial);
    RUN_TEST(test_a_disk_that_refuses_the_end);
    RUN_TEST(test_a_twin_that_refuses);
    RUN_TEST(test_what_was_not_finished);
    RUN_TEST(test_a_failure_of_the_twin);
    RUN_TEST(test_what_takes_a_restart);
    RUN_TEST(test_a_run_of_what_is_no_version);
    RUN_TEST(test_a_disk_without_room);
    RUN_TEST(test_a_why_of_blanks);
    RUN_TEST(test_in_safe_hold);
    RUN_TEST(test_what_does_not_come_by_the_network);
    RUN_TEST(test_names_that_are_allowed);
    RUN_TEST(test_who_may_not);
    RUN_TEST(test_how_far_a_tolerance_may_be_widened);
    RUN_TEST(test_what_it_is_judged_by);
    RUN_TEST(test_how_short_a_probation_may_be);
    return tl_played_close(UNITY_END());
}
