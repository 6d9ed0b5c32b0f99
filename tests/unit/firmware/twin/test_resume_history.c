/* Resume points from a real database: which run, from which tick, and why none is found.
 * A twin that resumes is bit-identical to one that was never interrupted. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <unity.h>

#include "firmware/base/identity.h"
#include "firmware/base/os.h"
#include "firmware/twin/resume.h"
#include "firmware/twin/twin_recorder.h"
#include "tests/support/course.h"
#include "tests/support/kept_file.h"
#include "tests/support/message.h"
#include "tests/support/scratch.h"
#include "tests/support/sql.h"
#include "tests/support/test_record_queue.h"

enum { OLDER = 60, NEWER = 100, KILLED = 150, TOLD = 8, CHECKPOINT_BYTES = 256 * 1024 };

static tl_scratch scratch;
static char path[PATH_MAX];
static tl_course course;
static tl_test_queue box;
static tl_twin_record recorded;
static tl_recorder_known known; /* the other configuration of the course */
static tl_resume_history *history;
static unsigned char *image;
static tl_resume resume;
static tl_error error;
static char events[TOLD][TL_RESUME_TEXT];
static tl_severity severities[TOLD];
static size_t event_count;

void setUp(void) {
    (void)snprintf(path, sizeof path, "%s", tl_scratch_path(&scratch, "run.db"));
    event_count = 0;
    image = NULL;
    history = NULL;
}

static void close_history(void) {
    tl_resume_history_close(history);
    history = NULL;
    free(image);
    image = NULL;
}

void tearDown(void) {
    tl_test_queue_close(&box);
    close_history();
    tl_course_close(&course);
    tl_scratch_empty(&scratch);
}

static void expect_ok(tl_status status) {
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, status, error.text);
}

/* ---- a run that was killed ---- */

static void open_run(void) {
    tl_twin_recorder_describe(&course.assembly.config, path, &recorded);
    known = (tl_recorder_known){
        .hash = course.other_hash, .text = course.other, .who = "ann", .origin = "test", .why = "to see"};
    recorded.settings.known = &known;
    recorded.settings.known_count = 1;
    tl_test_queue_open(&box, &recorded.settings, CHECKPOINT_BYTES);
    tl_twin_recorder_start(&box.queue, course.assembly.twin, course.start);
}

static void close_run(const char *reason) {
    TEST_ASSERT_TRUE(tl_record_queue_put_end(&box.queue, reason));
    tl_test_queue_close(&box);
}

static void save_checkpoint(void) {
    size_t capacity = 0;
    tl_course_save(&course);
    TEST_ASSERT_TRUE(tl_record_queue_reserve_checkpoint(&box.queue, course.checkpoint_size));
    memcpy(tl_record_queue_checkpoint_room(&box.queue, &capacity), course.checkpoint, course.checkpoint_size);
    tl_record_queue_put_checkpoint(&box.queue, course.checkpoint_tick, course.checkpoint_size);
    tl_test_queue_write(&box);
}

/* Adds a run to the database; its last tick is now. */
static void make_run(void) {
    course.start = tl_clock_now(NULL) - (KILLED + 1) * course.assembly.config.step;
    open_run();
    tl_course_search(&course, OLDER, &box.queue);
    save_checkpoint();
    tl_course_search(&course, NEWER, &box.queue);
    save_checkpoint();
    tl_course_search(&course, KILLED, &box.queue);
    close_run("SIGTERM");
    tl_course_anew(&course);
    tl_course_forget(&course);
}

static void make(tl_pairing measurements) {
    tl_course_open(&course, TL_SOURCE_DIR "/tests/support/motor_lock.json", measurements);
    make_run();
}

/* ---- search ---- */

static void on_event(void *context, tl_severity severity, const char *text) {
    TEST_ASSERT_EQUAL_PTR(&course, context);
    TEST_ASSERT_LESS_THAN_size_t(TOLD, event_count);
    severities[event_count] = severity;
    (void)snprintf(events[event_count++], TL_RESUME_TEXT, "%s", text);
}

static void open_history(void) {
    static char fmus[TL_SHA256_TEXT];
    static char boot[TL_IDENTITY_TEXT];
    tl_twin_recorder_identify(&course.assembly.config, fmus);
    tl_identity_boot(boot);
    const tl_resume_history_settings settings = {
        .config = &course.assembly.config,
        .path = path,
        .fmus = fmus,
        .boot = boot,
        .components = course.account.components,
        .report = on_event,
        .context = &course,
    };
    history = tl_resume_history_open(&settings);
}

static bool next(void) {
    free(image);
    image = NULL;
    const tl_resume *found = tl_resume_history_next(history);
    if (found == NULL) {
        return false;
    }
    size_t size = tl_resume_size(found);
    TEST_ASSERT_LESS_OR_EQUAL_size_t(TL_RESUME_MOST, size);
    image = malloc(size);
    TEST_ASSERT_NOT_NULL(image);
    tl_resume_write(found, image);
    expect_ok(tl_resume_read(image, size, &course.assembly.config, tl_clock_now(NULL), &resume, &error));
    return true;
}

static void expect_told(size_t count, tl_severity severity, const char *parts) {
    TEST_ASSERT_EQUAL_size_t_MESSAGE(count, event_count, events[0]);
    TL_EXPECT_PARTS(parts, events[count - 1]);
    TEST_ASSERT_EQUAL_INT(severity, severities[count - 1]);
}

static void expect_past(tl_resumed_from from, int64_t first) {
    TEST_ASSERT_EQUAL_INT(from, resume.from);
    TEST_ASSERT_EQUAL_INT64(1, resume.run);
    TEST_ASSERT_EQUAL_INT64(first, resume.first);
    TEST_ASSERT_EQUAL_INT64(course.start, resume.start);
    TEST_ASSERT_GREATER_THAN_INT64(0, resume.gap);
}

/* ---- bit-identical ---- */

static void follow(tl_resume_outcome wanted) {
    tl_summary summary;
    tl_resume_outcome outcome = TL_RESUME_FAILED;
    const tl_resume_follow_settings settings = {
        .assembly = &course.assembly, .queue = tl_course_queue(&course), .report = on_event, .context = &course};
    expect_ok(tl_resume_follow(&settings, &resume, &summary, &outcome, &error));
    tl_course_read(&course);
    TEST_ASSERT_EQUAL_INT(wanted, outcome);
    bool followed = outcome == TL_RESUME_FOLLOWED;
    TEST_ASSERT_EQUAL_INT(followed ? resume.from : TL_RESUMED_NOT, summary.resumption.from);
    TEST_ASSERT_EQUAL_UINT64(followed ? (uint64_t)(resume.last - resume.first + 1) : 0, summary.samples);
    if (followed) {
        TEST_ASSERT_EQUAL_INT64(resume.last + 1, course.begun.tick);
        TEST_ASSERT_EQUAL_INT64(course.start, course.begun.start);
        TEST_ASSERT_EQUAL_size_t(summary.samples, course.samples);
        TEST_ASSERT_EQUAL_size_t(resume.checkpoint_size, course.kept_size);
        course.next = resume.last + 1;
    }
}

static void test_the_newest_checkpoint_in_every_mode(void) {
    static const tl_pairing modes[] = {TL_LAG, TL_HOLD, TL_AHEAD};
    for (size_t i = 0; i < sizeof modes / sizeof modes[0]; i++) {
        make(modes[i]);
        open_history();
        TEST_ASSERT_TRUE(next());
        expect_past(TL_RESUMED_CHECKPOINT, NEWER + 1);
        TEST_ASSERT_EQUAL_INT64(modes[i] == TL_AHEAD ? KILLED - 1 : KILLED, resume.last);
        TEST_ASSERT_EQUAL_INT64((resume.last - NEWER) * course.assembly.config.step, resume.age);
        follow(TL_RESUME_FOLLOWED);
        char parts[64];
        (void)snprintf(parts, sizeof parts, "run 1|tick %lld", (long long)(resume.last + 1));
        expect_told(1, TL_EVENT_INFO, parts);
        TEST_ASSERT_EQUAL_INT64(NEWER, course.kept_tick);
        tl_course_search(&course, TL_COURSE_TICKS - 1, NULL);
        tl_course_expect_same(&course, TL_COURSE_TICKS - NEWER - 6);
        tearDown();
        setUp();
    }
}

static void test_the_start(void) {
    make(TL_LAG);
    tl_sql_execute(path, "DELETE FROM checkpoints");
    open_history();
    TEST_ASSERT_TRUE(next());
    expect_past(TL_RESUMED_START, 0);
    TEST_ASSERT_EQUAL_INT64(KILLED, resume.last);
    follow(TL_RESUME_FOLLOWED);
    expect_told(1, TL_EVENT_INFO, "run 1|tick 151|first|151 ticks");
    tl_course_search(&course, TL_COURSE_TICKS - 1, NULL);
    tl_course_expect_same(&course, TL_COURSE_TICKS - 12);
}

/* The twin died in its last step. The next twin computes that tick again. */
static void test_a_last_sample_without_its_step(void) {
    make(TL_LAG);
    tl_sql_execute(path, "INSERT INTO samples SELECT run, tick + 1, signal, value, quality, stamp_ns FROM samples WHERE"
                         " tick = (SELECT max(tick) FROM samples)");
    open_history();
    TEST_ASSERT_TRUE(next());
    expect_past(TL_RESUMED_CHECKPOINT, NEWER + 1);
    TEST_ASSERT_EQUAL_INT64(KILLED, resume.last);
    TEST_ASSERT_TRUE(next());
    TEST_ASSERT_TRUE(next());
    expect_past(TL_RESUMED_START, 0);
    TEST_ASSERT_EQUAL_INT64(KILLED, resume.last);
}

/* ---- older resume points ---- */

static void test_older_resume_points(void) {
    make(TL_LAG);
    open_history();
    TEST_ASSERT_TRUE(next());
    expect_past(TL_RESUMED_CHECKPOINT, NEWER + 1);
    TEST_ASSERT_TRUE(next());
    expect_past(TL_RESUMED_CHECKPOINT, OLDER + 1);
    TEST_ASSERT_TRUE(next());
    expect_past(TL_RESUMED_START, 0);
    TEST_ASSERT_FALSE(next());
    TEST_ASSERT_FALSE(next());
    TEST_ASSERT_EQUAL_size_t(0, event_count);
}

/* If a checkpoint cannot be loaded, the twin is built again, and an older checkpoint is tried. */
static void test_a_checkpoint_that_cannot_be_loaded(void) {
    make(TL_LAG);
    tl_sql_execute(path, "UPDATE checkpoints SET tick = 110 WHERE tick = 100");
    open_history();
    TEST_ASSERT_TRUE(next());
    expect_past(TL_RESUMED_CHECKPOINT, 111);
    follow(TL_RESUME_REFUSED);
    TEST_ASSERT_EQUAL_INT64(-1, course.begun.tick);
    expect_told(1, TL_EVENT_WARNING, "checkpoint|tick 110|run 1");
    TEST_ASSERT_TRUE(next());
    tl_course_search(&course, TL_COURSE_TICKS - 1, NULL);
    tl_course_expect_same(&course, TL_COURSE_TICKS - 12);
}

static void test_unusable_checkpoints(void) {
    make(TL_LAG);
    tl_sql_execute(path, "UPDATE checkpoints SET bytes = zeroblob(100) WHERE tick = 100;"
                         "UPDATE checkpoints SET format = 'twinlock 0' WHERE tick = 60");
    open_history();
    TEST_ASSERT_TRUE(next());
    expect_past(TL_RESUMED_START, 0);
    TEST_ASSERT_EQUAL_size_t(2, event_count);
    TL_EXPECT_PARTS("checkpoint|tick 100|run 1|damaged", events[0]);
    TL_EXPECT_PARTS("checkpoint|tick 60|run 1|version", events[1]);
    close_history();
    tl_sql_execute(path, "UPDATE checkpoints SET bytes = zeroblob(0), sha256 ="
                         " 'e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855'");
    event_count = 0;
    open_history();
    TEST_ASSERT_TRUE(next());
    expect_past(TL_RESUMED_START, 0);
    expect_told(2, TL_EVENT_WARNING, "tick 60|version");
    TL_EXPECT_PARTS("checkpoint|tick 100|run 1|empty", events[0]);
}

/* The FMU fails with the damaged inputs, so the resume fails and a new run begins. */
static void test_inputs_with_which_an_fmu_fails(void) {
    make(TL_LAG);
    tl_sql_execute(path, "UPDATE samples SET value = 1e308 WHERE signal = 0 AND tick > 110");
    open_history();
    TEST_ASSERT_TRUE(next());
    tl_summary summary;
    tl_resume_outcome outcome = TL_RESUME_FOLLOWED;
    const tl_resume_follow_settings settings = {
        .assembly = &course.assembly, .queue = tl_course_queue(&course), .report = on_event, .context = &course};
    expect_ok(tl_resume_follow(&settings, &resume, &summary, &outcome, &error));
    TEST_ASSERT_EQUAL_INT(TL_RESUME_FAILED, outcome);
    TEST_ASSERT_EQUAL_INT(TL_RESUMED_NOT, summary.resumption.from);
    expect_told(1, TL_EVENT_WARNING, "run 1|motor");
    course.next = 0;
    tl_course_search(&course, TL_COURSE_TICKS - 1, NULL); /* a new twin */
    tl_course_expect_same(&course, TL_COURSE_TICKS - 12);
}

/* ---- no resume point ---- */

/* The message names the nouns in `parts`, and no other one of the list. */
static void expect_nouns(const char *parts, const char *message) {
    static const char *const nouns[] = {"configuration", "tunings", "FMU", "clock", "duration", "ticks", "damaged"};
    for (size_t i = 0; i < sizeof nouns / sizeof nouns[0]; i++) {
        bool is_wanted = tl_test_has_parts(parts, nouns[i]);
        TEST_ASSERT_EQUAL_INT_MESSAGE(is_wanted, tl_test_has_parts(message, nouns[i]), message);
    }
}

static void expect_none(const char *statements, tl_severity severity, const char *parts) {
    tl_kept_file whole = {NULL, 0};
    tl_kept_file_read(&whole, path);
    tl_sql_execute(path, statements);
    event_count = 0;
    open_history();
    while (next()) {
        TEST_ASSERT_LESS_THAN_size_t_MESSAGE(1, event_count, parts);
    }
    expect_told(1, severity, parts);
    expect_nouns(parts, events[0]);
    close_history();
    tl_kept_file_write(&whole, path);
    tl_kept_file_free(&whole);
}

/* The first time in seconds; -1: none. */
static double seconds_in(const char *text) {
    for (const char *at = text; *at != '\0'; at++) {
        char *end = NULL;
        double value = strtod(at, &end);
        if (*at >= '0' && *at <= '9' && strncmp(end, " s", 2) == 0) {
            return value;
        }
    }
    return -1;
}

static void test_why_no_resume_point_is_found(void) {
    make(TL_LAG);
    expect_none("UPDATE main.runs SET ended_reason = 'reason 17'", TL_EVENT_INFO, "run 1|reason 17");
    expect_none("DELETE FROM tunings; UPDATE runs SET configuration = 'x'", TL_EVENT_INFO, "configuration|run 1");
    expect_none("DELETE FROM main.tunings WHERE tick = 120", TL_EVENT_INFO, /* ended with the other one */
                "configuration|run 1");
    expect_none("UPDATE tunings SET tick = -1 WHERE tick = 120", TL_EVENT_WARNING, "run.db|damaged|tunings|run 1");
    expect_none("UPDATE beginnings SET fmus = 'x'", TL_EVENT_INFO, "FMU|run 1");
    expect_none("UPDATE beginnings SET boot = ''", TL_EVENT_INFO, "run 1|boot ID");
    expect_none("UPDATE beginnings SET start_ns = start_ns - 4000000000000", TL_EVENT_INFO, "run 1|record.resume_s");
    TEST_ASSERT_DOUBLE_WITHIN(60, 4010, seconds_in(events[0]));
    expect_none("UPDATE beginnings SET start_ns = start_ns + 4000000000000", TL_EVENT_INFO, "clock|run 1");
    expect_none("DELETE FROM checkpoints; DELETE FROM main.samples WHERE tick = 140", TL_EVENT_INFO,
                "run 1|checkpoint|FMU|ticks");
    expect_none("UPDATE runs SET lead = 2147483647, step_ns = 3600000000000", TL_EVENT_WARNING, "run.db|damaged|run 1");
    course.assembly.config.duration = TL_SECOND;
    expect_none("", TL_EVENT_INFO, "duration|run 1");
}

/* For a message about the length of the gap. */
static void test_when_another_run_ended(void) {
    make(TL_LAG);
    tl_sql_execute(path, "UPDATE main.runs SET ended_reason = 'reason 17'");
    open_history();
    TEST_ASSERT_EQUAL_INT64(0, tl_resume_history_ended(history));
    TEST_ASSERT_FALSE(next());
    const int64_t last = tl_sql_integer(path, "SELECT max(step) + lead FROM steps, runs");
    TEST_ASSERT_EQUAL_INT64(course.start + last * course.assembly.config.step, tl_resume_history_ended(history));
    close_history();
    TEST_ASSERT_EQUAL_INT64(0, tl_resume_history_ended(NULL));
}

static void test_nothing_to_report(void) {
    make(TL_LAG);
    tl_sql_execute(path, "UPDATE runs SET verb = 'replay'");
    open_history();
    TEST_ASSERT_FALSE(next());
    close_history();
    course.assembly.config.record_resume = 0;
    open_history();
    TEST_ASSERT_NULL(history);
    TEST_ASSERT_FALSE(next());
    TEST_ASSERT_EQUAL_size_t(0, event_count);
}

static void test_no_database(void) {
    tl_course_open(&course, TL_SOURCE_DIR "/tests/support/motor_lock.json", TL_LAG);
    FILE *file = fopen(path, "w");
    TEST_ASSERT_NOT_NULL(file);
    (void)fputs("not a database, but long enough so that a check of the size alone would accept the file .............",
                file);
    (void)fclose(file);
    open_history();
    TEST_ASSERT_FALSE(next());
    expect_told(1, TL_EVENT_WARNING, "run.db");
}

/* Runs that were killed during a resume have no data of their own. */
static void test_runs_without_progress(void) {
    make(TL_LAG);
    for (int i = 0; i < 2; i++) {
        open_run();
        close_run("SIGKILL");
    }
    open_history();
    TEST_ASSERT_TRUE(next());
    expect_past(TL_RESUMED_CHECKPOINT, NEWER + 1);
    close_history();
    open_run();
    close_run("SIGKILL");
    open_history();
    TEST_ASSERT_FALSE(next());
    expect_told(1, TL_EVENT_INFO, "3 runs");
}

int main(void) {
    if (setenv("TWINLOCK_FMU_PATH", TL_BINARY_DIR "/fmus", 1) != 0) {
        return EXIT_FAILURE;
    }
    tl_scratch_make(&scratch, access("/dev/shm", W_OK) == 0 ? "/dev/shm" : TL_BINARY_DIR, "test_past_history");
    UNITY_BEGIN();
    RUN_TEST(test_the_newest_checkpoint_in_every_mode);
    RUN_TEST(test_the_start);
    RUN_TEST(test_a_last_sample_without_its_step);
    RUN_TEST(test_older_resume_points);
    RUN_TEST(test_a_checkpoint_that_cannot_be_loaded);
    RUN_TEST(test_unusable_checkpoints);
    RUN_TEST(test_inputs_with_which_an_fmu_fails);
    RUN_TEST(test_why_no_resume_point_is_found);
    RUN_TEST(test_when_another_run_ended);
    RUN_TEST(test_nothing_to_report);
    RUN_TEST(test_no_database);
    RUN_TEST(test_runs_without_progress);
    return tl_scratch_finish(&scratch, UNITY_END());
}
