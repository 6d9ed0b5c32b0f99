/* Resume points from the record queue of a dead twin: from which tick, and why none is found.
 * A twin that resumes is bit-identical to one that was never interrupted, also after kill -9. */
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/wait.h>
#include <unistd.h>

#include <unity.h>

#include "firmware/base/log.h"
#include "firmware/base/os.h"
#include "firmware/twin/resume.h"
#include "tests/support/course.h"
#include "tests/support/message.h"
#include "tests/support/random_numbers.h"

enum { OLDER = 60, NEWER = 100, KILLED = 150, TOLD = 32, CHECKPOINT_BYTES = 256 * 1024 };

static tl_course course;
static tl_record_queue_settings settings;
static unsigned char *memory;
static size_t memory_bytes;
static tl_record_queue_taken taken;
static tl_record_queue queue; /* of the live twin */
static tl_resume_queue *left;
static tl_resume resume;
static tl_error error;
static char events[TOLD][TL_RESUME_TEXT];
static tl_severity severities[TOLD];
static size_t event_count;

static void make_memory(void) {
    memory_bytes = tl_record_queue_bytes(&settings);
    /* cppcheck-suppress invalidFunctionArg ; an anonymous mapping has no file, which is -1 */
    memory = mmap(NULL, memory_bytes, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    TEST_ASSERT_TRUE(memory != MAP_FAILED);
    taken = (tl_record_queue_taken){0};
}

static void open_course(tl_pairing measurements) {
    tl_course_open(&course, TL_SOURCE_DIR "/tests/support/motor_lock.json", measurements);
    settings = (tl_record_queue_settings){
        .shape = {.plant = course.assembly.config.signal_count,
                  .match = course.assembly.config.match_count,
                  .adjust = course.assembly.config.adjust_count,
                  .components = course.account.components},
        .checkpoint_bytes = CHECKPOINT_BYTES,
    };
    settings.ring_bytes = tl_record_queue_ring_bytes(&settings.shape, course.assembly.config.step);
    make_memory();
}

void setUp(void) {
    event_count = 0;
    left = NULL;
    memory = NULL;
}

static void close_left(void) {
    tl_resume_queue_close(left);
    left = NULL;
}

void tearDown(void) {
    close_left();
    tl_course_close(&course);
    if (memory != NULL) {
        (void)munmap(memory, memory_bytes);
        memory = NULL;
    }
}

static void expect_ok(tl_status status) {
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, status, error.text);
}

/* ---- twins and their successors ---- */

/* Makes a successor: a new twin with the record queue of its predecessor. */
static void be_born(void) {
    tl_record_queue_open(&settings, memory, &taken, &queue);
    tl_course_anew(&course);
    const tl_run_tuning configured = tl_course_configured(&course);
    tl_record_queue_name_configuration(&queue, &configured);
}

static void put_start(const tl_resumption *resumption) {
    static tl_record_queue_start start;
    start = (tl_record_queue_start){.resumption = *resumption, .account = course.account};
    TEST_ASSERT_TRUE(tl_record_queue_put_start(&queue, &start));
}

static void begin_run(void) {
    const tl_resumption restarted = {.from = TL_RESUMED_NOT, .start = course.start, .started = 1700000000000};
    put_start(&restarted);
}

static void put_checkpoint(int64_t tick, const unsigned char *bytes, size_t size) {
    size_t capacity = 0;
    TEST_ASSERT_TRUE(tl_record_queue_reserve_checkpoint(&queue, size));
    memcpy(tl_record_queue_checkpoint_room(&queue, &capacity), bytes, size);
    tl_record_queue_put_checkpoint(&queue, tick, size);
}

static void save_checkpoint(void) {
    tl_course_save(&course);
    put_checkpoint(course.checkpoint_tick, course.checkpoint, course.checkpoint_size);
}

static void live_to(int64_t tick) {
    tl_course_search(&course, tick, &queue);
}

/* Makes a twin that dies after tick KILLED, and its successor. */
static void make(tl_pairing measurements) {
    open_course(measurements);
    be_born();
    begin_run();
    live_to(OLDER);
    save_checkpoint();
    live_to(NEWER);
    save_checkpoint();
    live_to(KILLED);
    tl_course_forget(&course);
    be_born();
}

/* ---- search ---- */

static void on_event(void *context, tl_severity severity, const char *text) {
    TEST_ASSERT_EQUAL_PTR(&course, context);
    TEST_ASSERT_LESS_THAN_size_t(TOLD, event_count);
    severities[event_count] = severity;
    (void)snprintf(events[event_count++], TL_RESUME_TEXT, "%s", text);
}

static void look(void) {
    close_left();
    left = tl_resume_queue_open(&queue, &course.assembly, on_event, &course);
}

static void expect_past(tl_resumed_from from, int64_t first, int64_t last) {
    TEST_ASSERT_TRUE_MESSAGE(tl_resume_queue_next(left, &resume), event_count > 0 ? events[event_count - 1] : "");
    TEST_ASSERT_EQUAL_INT(from, resume.from);
    TEST_ASSERT_EQUAL_INT64(TL_RESUME_UNNUMBERED, resume.run);
    TEST_ASSERT_EQUAL_INT64(first, resume.first);
    TEST_ASSERT_EQUAL_INT64(last, resume.last);
    TEST_ASSERT_EQUAL_INT64(course.start, resume.start);
    TEST_ASSERT_EQUAL_INT64(1700000000000, resume.started);
}

static void expect_told(size_t count, tl_severity severity, const char *parts) {
    TEST_ASSERT_EQUAL_size_t_MESSAGE(count, event_count, events[0]);
    TL_EXPECT_PARTS(parts, events[count - 1]);
    TEST_ASSERT_EQUAL_INT(severity, severities[count - 1]);
}

static void expect_none(const char *parts) {
    look();
    event_count = 0;
    TEST_ASSERT_FALSE(tl_resume_queue_next(left, &resume));
    TEST_ASSERT_FALSE(tl_resume_queue_next(left, &resume));
    expect_told(1, TL_EVENT_INFO, parts);
}

/* ---- bit-identical ---- */

static tl_resume_outcome follow_into(tl_record_queue *into) {
    tl_summary summary;
    tl_resume_outcome outcome = TL_RESUME_FAILED;
    const tl_resume_follow_settings following = {
        .assembly = &course.assembly, .queue = into, .report = on_event, .context = &course};
    expect_ok(tl_resume_follow(&following, &resume, &summary, &outcome, &error));
    course.next = resume.last + 1;
    return outcome;
}

/* Follows into the same record queue. */
static void go_on(void) {
    TEST_ASSERT_EQUAL_INT(TL_RESUME_FOLLOWED, follow_into(&queue));
    close_left();
}

/* Follows into another record queue, and reads that. */
static void follow_beside(void) {
    TEST_ASSERT_EQUAL_INT(TL_RESUME_FOLLOWED, follow_into(tl_course_queue(&course)));
    tl_course_read(&course);
}

static void test_the_newest_checkpoint_in_every_mode(void) {
    static const tl_pairing modes[] = {TL_LAG, TL_HOLD, TL_AHEAD};
    for (size_t i = 0; i < sizeof modes / sizeof modes[0]; i++) {
        make(modes[i]);
        look();
        expect_past(TL_RESUMED_CHECKPOINT, NEWER + 1, modes[i] == TL_AHEAD ? KILLED - 1 : KILLED);
        follow_beside();
        char parts[32];
        (void)snprintf(parts, sizeof parts, "tick %lld", (long long)(resume.last + 1));
        expect_told(1, TL_EVENT_INFO, parts);
        TEST_ASSERT_EQUAL_INT64(NEWER, course.kept_tick);
        tl_course_search(&course, TL_COURSE_TICKS - 1, NULL);
        tl_course_expect_same(&course, TL_COURSE_TICKS - NEWER - 6);
        tearDown();
        setUp();
    }
}

/* Several twins die, one after the other. Each has the record queue of its predecessor. */
static void test_many_successors(void) {
    make(TL_LAG);
    for (int64_t tick = KILLED + 10; tick < TL_COURSE_TICKS; tick += 10) {
        look();
        expect_past(TL_RESUMED_CHECKPOINT, NEWER + 1, tick - 10);
        go_on();
        live_to(tick);
        be_born();
    }
    look();
    TEST_ASSERT_TRUE(tl_resume_queue_next(left, &resume));
    go_on();
    tl_course_search(&course, TL_COURSE_TICKS - 1, NULL);
    tl_course_expect_same(&course, TL_COURSE_TICKS - KILLED - 10);
}

static void test_without_checkpoints(void) {
    open_course(TL_LAG);
    be_born();
    begin_run();
    live_to(KILLED);
    tl_course_forget(&course);
    be_born();
    look();
    expect_past(TL_RESUMED_START, 0, KILLED);
    follow_beside();
    tl_course_search(&course, TL_COURSE_TICKS - 1, NULL);
    tl_course_expect_same(&course, TL_COURSE_TICKS - 12);
    TEST_ASSERT_FALSE(tl_resume_queue_next(left, &resume));
}

/* FMUs that cannot be saved have marks instead of checkpoints. Entries after a mark are kept. */
static void test_marks_without_bytes(void) {
    open_course(TL_LAG);
    be_born();
    begin_run();
    live_to(OLDER);
    tl_record_queue_put_checkpoint(&queue, OLDER, 0);
    live_to(NEWER);
    tl_record_queue_put_checkpoint(&queue, NEWER, 0);
    live_to(KILLED);
    be_born();
    look();
    expect_past(TL_RESUMED_INPUTS, OLDER + 1, KILLED);
    go_on();
    expect_told(1, TL_EVENT_INFO, "newest inputs");
    live_to(KILLED + 20);
    be_born();
    look();
    expect_past(TL_RESUMED_INPUTS, OLDER + 1, KILLED + 20);
}

/* ---- older resume points ---- */

static void test_older_resume_points(void) {
    make(TL_LAG);
    look();
    expect_past(TL_RESUMED_CHECKPOINT, NEWER + 1, KILLED);
    expect_past(TL_RESUMED_CHECKPOINT, OLDER + 1, KILLED);
    expect_past(TL_RESUMED_INPUTS, OLDER + 1, KILLED);
    expect_past(TL_RESUMED_INPUTS, NEWER + 1, KILLED);
    TEST_ASSERT_EQUAL_size_t(0, event_count);
    TEST_ASSERT_FALSE(tl_resume_queue_next(left, &resume));
    expect_told(1, TL_EVENT_INFO, "resume point");
}

/* The newest checkpoint is damaged; the other one leads to the same tick. */
static void test_a_damaged_checkpoint(void) {
    make(TL_LAG);
    tl_record_queue_saved newest;
    TEST_ASSERT_TRUE(tl_record_queue_saved_checkpoint(&queue, 0, &newest));
    memory[newest.bytes - memory + 50] ^= 1;
    be_born();
    look();
    expect_past(TL_RESUMED_CHECKPOINT, OLDER + 1, KILLED);
    course.checkpoint_size = resume.checkpoint_size;
    memcpy(course.checkpoint, resume.checkpoint, resume.checkpoint_size);
    follow_beside();
    tl_course_search(&course, TL_COURSE_TICKS - 1, NULL);
    tl_course_expect_same(&course, TL_COURSE_TICKS - OLDER - 6);
}

/* The newest checkpoint is complete, but not a state of this twin. The older one is used. */
static void test_a_checkpoint_that_cannot_be_loaded(void) {
    size_t capacity = 0;
    make(TL_LAG);
    begin_run();
    live_to(20);
    save_checkpoint();
    live_to(30);
    tl_course_save(&course);
    TEST_ASSERT_TRUE(tl_record_queue_reserve_checkpoint(&queue, course.checkpoint_size));
    unsigned char *room = tl_record_queue_checkpoint_room(&queue, &capacity);
    memset(room, 7, course.checkpoint_size);
    tl_record_queue_put_checkpoint(&queue, 30, course.checkpoint_size);
    live_to(40);
    be_born();
    look();
    expect_past(TL_RESUMED_CHECKPOINT, 31, 40);
    uint64_t written = queue.written;
    TEST_ASSERT_EQUAL_INT(TL_RESUME_REFUSED, follow_into(&queue));
    expect_told(1, TL_EVENT_WARNING, "checkpoint|tick 30");
    TEST_ASSERT_EQUAL_UINT64(written, queue.written);
    expect_past(TL_RESUMED_CHECKPOINT, 21, 40);
    go_on();
}

/* ---- several runs ---- */

/* The newest run counts, although its predecessor has the checkpoints. */
static void test_a_run_that_began_since(void) {
    make(TL_LAG);
    begin_run();
    live_to(40);
    be_born();
    look();
    expect_past(TL_RESUMED_START, 0, 40);
}

/* It was killed while it resumed; the run that it resumed has more ticks. */
static void test_a_successor_without_progress(void) {
    make(TL_LAG);
    look();
    expect_past(TL_RESUMED_CHECKPOINT, NEWER + 1, KILLED);
    resume.last = NEWER + 10; /* its progress */
    const tl_resumption wanted = {.from = TL_RESUMED_CHECKPOINT,
                                  .run = TL_RESUME_UNNUMBERED,
                                  .tick = KILLED + 1,
                                  .start = course.start,
                                  .started = resume.started};
    tl_resume_tick tick;
    put_start(&wanted);
    put_checkpoint(NEWER, resume.checkpoint, resume.checkpoint_size);
    for (int64_t i = resume.first; tl_resume_tick_at(&resume, i, &tick); i++) {
        TEST_ASSERT_TRUE(tl_record_queue_put_sample(&queue, &tick.sample));
    }
    be_born();
    look();
    expect_past(TL_RESUMED_CHECKPOINT, NEWER + 1, KILLED); /* of its predecessor */
    go_on();
    live_to(KILLED + 5);
    be_born();
    look();
    expect_past(TL_RESUMED_CHECKPOINT, NEWER + 1, KILLED + 5);
}

/* Their checkpoints have replaced those of the run that they resumed. */
static void test_successors_without_progress(void) {
    make(TL_LAG);
    for (int i = 0; i < 2; i++) {
        look();
        expect_past(TL_RESUMED_CHECKPOINT, NEWER + 1, KILLED);
        const tl_resumption wanted = {.from = TL_RESUMED_CHECKPOINT, .tick = KILLED + 1, .start = course.start};
        put_start(&wanted);
        put_checkpoint(NEWER, resume.checkpoint, resume.checkpoint_size);
        be_born();
    }
    expect_none("2 runs");
}

/* Only one run is left, without progress; it is used. */
static void test_only_a_run_without_progress(void) {
    open_course(TL_LAG);
    be_born();
    live_to(NEWER);
    const tl_resumption wanted = {
        .from = TL_RESUMED_CHECKPOINT, .tick = KILLED + 1, .start = course.start, .started = 1700000000000};
    put_start(&wanted);
    save_checkpoint();
    live_to(NEWER + 10);
    be_born();
    look();
    expect_past(TL_RESUMED_CHECKPOINT, NEWER + 1, NEWER + 10);
}

static void put_hold(void) {
    static tl_record_queue_start hold;
    tl_sample sample;
    hold = (tl_record_queue_start){.holds = true, .resumption = {.start = course.start, .started = 1}};
    TEST_ASSERT_TRUE(tl_record_queue_put_start(&queue, &hold));
    for (int64_t tick = 0; tick < 10; tick++) {
        tl_course_sample(&course, tick, &sample);
        TEST_ASSERT_TRUE(tl_record_queue_put_sample(&queue, &sample));
    }
}

static void test_safe_hold_in_between(void) {
    make(TL_LAG);
    put_hold();
    be_born();
    look();
    expect_past(TL_RESUMED_CHECKPOINT, NEWER + 1, KILLED);
}

/* Then the database is searched. */
static void test_only_a_hold_before(void) {
    open_course(TL_LAG);
    be_born();
    put_hold();
    TEST_ASSERT_TRUE(tl_record_queue_put_end(&queue, "SIGTERM"));
    be_born();
    look();
    TEST_ASSERT_NULL(left);
    TEST_ASSERT_EQUAL_size_t(0, event_count);
}

/* ---- no resume point ---- */

static void test_nothing_is_left(void) {
    open_course(TL_LAG);
    be_born();
    look();
    TEST_ASSERT_NULL(left);
    TEST_ASSERT_FALSE(tl_resume_queue_next(left, &resume));
    begin_run();
    live_to(50);
    course.assembly.config.record_resume = 0;
    look();
    TEST_ASSERT_NULL(left);
    TEST_ASSERT_EQUAL_size_t(0, event_count);
}

static void test_how_it_ended(void) {
    make(TL_LAG);
    TEST_ASSERT_TRUE(tl_record_queue_put_end(&queue, "SIGTERM"));
    look();
    expect_past(TL_RESUMED_CHECKPOINT, NEWER + 1, KILLED);
    TEST_ASSERT_TRUE(tl_record_queue_put_end(&queue, "reason 17"));
    expect_none("reason 17");
}

static void test_when_it_was(void) {
    make(TL_LAG);
    course.assembly.config.record_resume = 1;
    expect_none("record.resume_s");
    course.assembly.config.record_resume = 3600 * TL_SECOND;
    course.assembly.config.duration = TL_SECOND;
    expect_none("duration");
    course.assembly.config.duration = 0;
    course.start += 7200 * TL_SECOND;
    be_born();
    begin_run();
    live_to(40);
    be_born();
    expect_none("clock");
    course.start = INT64_MAX;
    begin_run();
    be_born();
    expect_none("run"); /* a run without progress, at an impossible time */
}

/* Entries for which the ring had no space are missing. */
static void test_a_gap(void) {
    make(TL_LAG);
    course.next = KILLED + 1;
    tl_course_search(&course, KILLED, NULL);
    tl_sample sample;
    tl_record record = course.whole.records[KILLED];
    tl_execution_counts ledger[TL_RECORDER_COMPONENTS] = {{0}};
    tl_course_sample(&course, KILLED + 2, &sample);
    TEST_ASSERT_TRUE(tl_record_queue_put_sample(&queue, &sample));
    record.step = KILLED + 2 - course.account.lead;
    TEST_ASSERT_TRUE(tl_record_queue_put_step(&queue, &record, ledger));
    expect_none("ticks");
}

/* Steps without a sample, and impossible ticks. */
static void test_impossible_entries(void) {
    make(TL_LAG);
    tl_execution_counts ledger[TL_RECORDER_COMPONENTS] = {{0}};
    tl_record record = course.whole.records[100];
    tl_sample sample;
    tl_course_sample(&course, 3, &sample);
    for (int i = 0; i < 4; i++) {
        static const int64_t numbers[] = {INT64_MIN, -1, INT64_MAX, TL_RESUME_FAR};
        record.step = numbers[i];
        sample.tick = numbers[i];
        TEST_ASSERT_TRUE(tl_record_queue_put_step(&queue, &record, ledger));
        TEST_ASSERT_TRUE(tl_record_queue_put_sample(&queue, &sample));
    }
    look();
    expect_past(TL_RESUMED_CHECKPOINT, NEWER + 1, KILLED);
    record.step = KILLED + 1000000;
    TEST_ASSERT_TRUE(tl_record_queue_put_step(&queue, &record, ledger));
    expect_none("clock");
}

/* The ring is full and has no reader. The resume does not wait; the recorder loses entries. */
static void test_a_full_ring(void) {
    make(TL_LAG);
    tl_sample sample;
    tl_course_sample(&course, KILLED, &sample);
    TEST_ASSERT_TRUE(tl_record_queue_put_end(&queue, "SIGTERM"));
    while (tl_record_queue_put_sample(&queue, &sample)) {
    }
    be_born();
    look();
    bool found = tl_resume_queue_next(left, &resume);
    if (found) { /* if the ring reaches back far enough */
        tl_time began = tl_clock_now(NULL);
        go_on();
        TEST_ASSERT_LESS_THAN_INT64(5 * TL_SECOND, tl_clock_now(NULL) - began);
        TEST_ASSERT_GREATER_THAN_UINT64(1, tl_record_queue_lost(&queue));
    }
    TEST_ASSERT_LESS_OR_EQUAL_size_t(1, event_count);
}

/* ---- random damage ---- */

static void test_mutants(void) {
    tl_test_random random = {20261123};
    size_t mutants = tl_test_campaign("TL_MUTANTS", 400);
    size_t found = 0;
    make(TL_LAG);
    unsigned char *whole = malloc(memory_bytes);
    TEST_ASSERT_NOT_NULL(whole);
    memcpy(whole, memory, memory_bytes);
    size_t used = (size_t)(queue.ring - memory) + (size_t)queue.written;
    tl_log_set_level(TL_LOG_ERROR - 1);
    for (size_t i = 0; i < mutants; i++) {
        memcpy(memory, whole, memory_bytes);
        for (size_t k = tl_test_random_between(&random, 1, 3); k > 0; k--) {
            size_t from = tl_test_random_chance(&random, 70) ? (size_t)(queue.ring - memory) : 0;
            memory[from + tl_test_random_below(&random, used - from)] ^=
                (unsigned char)(1U << tl_test_random_below(&random, 8));
        }
        tl_record_queue_open(&settings, memory, &taken, &queue);
        look();
        event_count = 0;
        for (int any = 0; any < 10 && tl_resume_queue_next(left, &resume); any++) {
            tl_resume_tick tick;
            found++;
            TEST_ASSERT_TRUE(resume.last < resume.first || tl_resume_tick_at(&resume, resume.last, &tick));
        }
        TEST_ASSERT_FALSE(tl_resume_queue_next(left, &resume));
    }
    tl_log_set_level(TL_LOG_NOTICE);
    free(whole);
    TEST_ASSERT_GREATER_THAN_size_t(mutants / 16, found);
}

/* ---- kill -9 ---- */

/* Resumes, and runs until it is killed or the course is over. */
static void live(unsigned pause) {
    while (course.next < TL_COURSE_TICKS) {
        live_to(course.next);
        if (course.next % 20 == 0 && course.next < TL_COURSE_TICKS - 30) {
            save_checkpoint();
        }
        (void)usleep(pause);
    }
    _exit(0);
}

static void test_killed_at_any_moment(void) {
    tl_test_random random = {20261123};
    unsigned deaths = 0;
    open_course(TL_LAG);
    int status = 1;
    for (int i = 0; i < 200 && !(WIFEXITED(status) && status == 0); i++) {
        pid_t child = fork();
        TEST_ASSERT_TRUE(child >= 0);
        if (child == 0) {
            be_born();
            left = tl_resume_queue_open(&queue, &course.assembly, on_event, &course);
            if (tl_resume_queue_next(left, &resume)) {
                go_on();
            } else {
                begin_run();
            }
            live(500);
        }
        (void)usleep((useconds_t)tl_test_random_between(&random, 2000, 40000 + 4000 * (size_t)i)); /* a slow machine */
        (void)kill(child, SIGKILL);
        TEST_ASSERT_EQUAL_INT(child, waitpid(child, &status, 0));
        TEST_ASSERT_TRUE(WIFSIGNALED(status) || (WIFEXITED(status) && WEXITSTATUS(status) == 0));
        deaths += WIFSIGNALED(status) ? 1 : 0;
    }
    TEST_ASSERT_TRUE(WIFEXITED(status) && deaths > 2);
    tl_course_forget(&course);
    be_born();
    look();
    TEST_ASSERT_TRUE(tl_resume_queue_next(left, &resume));
    TEST_ASSERT_EQUAL_INT64(TL_COURSE_TICKS - 1, resume.last);
    course.checkpoint_size = resume.checkpoint_size;
    free(course.checkpoint);
    course.checkpoint = malloc(resume.checkpoint_size + 1);
    TEST_ASSERT_NOT_NULL(course.checkpoint);
    memcpy(course.checkpoint, resume.checkpoint, resume.checkpoint_size);
    follow_beside();
    tl_course_expect_same(&course, 20);
}

int main(void) {
    if (setenv("TWINLOCK_FMU_PATH", TL_BINARY_DIR "/fmus", 1) != 0) {
        return EXIT_FAILURE;
    }
    UNITY_BEGIN();
    RUN_TEST(test_the_newest_checkpoint_in_every_mode);
    RUN_TEST(test_many_successors);
    RUN_TEST(test_without_checkpoints);
    RUN_TEST(test_marks_without_bytes);
    RUN_TEST(test_older_resume_points);
    RUN_TEST(test_a_damaged_checkpoint);
    RUN_TEST(test_a_checkpoint_that_cannot_be_loaded);
    RUN_TEST(test_a_run_that_began_since);
    RUN_TEST(test_a_successor_without_progress);
    RUN_TEST(test_successors_without_progress);
    RUN_TEST(test_only_a_run_without_progress);
    RUN_TEST(test_safe_hold_in_between);
    RUN_TEST(test_only_a_hold_before);
    RUN_TEST(test_nothing_is_left);
    RUN_TEST(test_how_it_ended);
    RUN_TEST(test_when_it_was);
    RUN_TEST(test_a_gap);
    RUN_TEST(test_impossible_entries);
    RUN_TEST(test_a_full_ring);
    RUN_TEST(test_mutants);
    RUN_TEST(test_killed_at_any_moment);
    return UNITY_END();
}
