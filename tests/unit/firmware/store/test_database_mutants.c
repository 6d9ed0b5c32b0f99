/* Databases with random damage and with malicious values: a reader reads them or reports the
 * damage. A warm restart rejects the damaged run with an event. Nothing crashes, and nothing
 * takes long. */
#include <sqlite3.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include <unity.h>

#include "firmware/base/log.h"
#include "firmware/base/os.h"
#include "firmware/plant/recording.h"
#include "firmware/report/show.h"
#include "firmware/twin/resume.h"
#include "firmware/twin/twin_recorder.h"
#include "tests/support/kept_file.h"
#include "tests/support/random_numbers.h"
#include "tests/support/read_assembly.h"
#include "tests/support/scratch.h"
#include "tests/support/sql.h"
#include "tests/support/test_record_queue.h"

enum { TICKS = 120, SAVED_AT = 60, PAGE = 4096, MUTANTS = 150, CHECKPOINT_BYTES = 256 * 1024 };

static tl_scratch scratch;
static char path[PATH_MAX];
static tl_assembly assembly;
static tl_test_queue box;
static tl_twin_record recorded;
static tl_error error;

/* Copy of the undamaged database. */
static tl_kept_file whole;

void setUp(void) {
    (void)snprintf(path, sizeof path, "%s", tl_scratch_path(&scratch, "run.db"));
    error = (tl_error){TL_OK, ""};
}

void tearDown(void) {
    (void)tl_test_queue_try_close(&box, NULL);
    tl_assembly_free(&assembly);
    assembly = (tl_assembly){0};
    tl_kept_file_free(&whole);
    tl_scratch_empty(&scratch);
}

static void expect_ok(tl_status status) {
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, status, error.text);
}

/* ---- A run that was ended by a signal just now ---- */

static void load_assembly(void) {
    expect_ok(tl_test_load_assembly(TL_SOURCE_DIR "/tests/support/motor_lock.json", &assembly));
    assembly.config.record_resume = 3600 * TL_SECOND;
    assembly.config.duration = 0;
}

static void open_writer(void) {
    tl_twin_recorder_describe(&assembly.config, path, &recorded);
    recorded.settings.open_policy = TL_DATABASE_ANYHOW;
    tl_test_queue_open(&box, &recorded.settings, CHECKPOINT_BYTES);
}

static void close_run(const char *reason) {
    TEST_ASSERT_TRUE(tl_record_queue_put_end(&box.queue, reason));
    tl_test_queue_close(&box);
}

static void save_checkpoint(int64_t tick) {
    size_t capacity = 0;
    size_t needed = 0;
    expect_ok(tl_twin_save(assembly.twin, NULL, 0, &capacity, &error));
    TEST_ASSERT_TRUE(tl_record_queue_reserve_checkpoint(&box.queue, capacity));
    unsigned char *room = tl_record_queue_checkpoint_room(&box.queue, &capacity);
    expect_ok(tl_twin_save(assembly.twin, room, capacity, &needed, &error));
    tl_record_queue_put_checkpoint(&box.queue, tick, needed);
}

static void record_run(void) {
    static tl_sample sample;
    tl_record record;
    bool ready = false;
    const tl_budget budget = {.evaluations = assembly.config.budget_evaluations};
    open_writer();
    tl_twin_recorder_start(&box.queue, assembly.twin, tl_clock_now(NULL) - TICKS * assembly.config.step);
    for (int64_t tick = 0; tick < TICKS; tick++) {
        sample.tick = tick;
        sample.values[0] = 0.01 * (double)(tick % 17);
        sample.values[1] = 60.0 + 0.1 * (double)(tick % 23);
        TEST_ASSERT_TRUE(tl_record_queue_put_sample(&box.queue, &sample));
        expect_ok(tl_twin_step(assembly.twin, &sample, &budget, &record, &ready, &error));
        if (ready) {
            tl_twin_recorder_put(&box.queue, &record, assembly.twin);
        }
        if (tick == SAVED_AT) {
            save_checkpoint(tick);
        }
    }
    tl_record_queue_event(&box.queue, 5, TL_EVENT_WARNING, "plant", "the drive does not answer");
    close_run("SIGTERM");
    tl_kept_file_read(&whole, path);
}

/* ---- Readers ---- */

static void expect_error(tl_status status, const char *what) {
    bool is_reported = status == TL_OK || (status == TL_BAD_DATA && error.text[0] != '\0');
    TEST_ASSERT_TRUE_MESSAGE(is_reported, error.text[0] != '\0' ? error.text : what);
}

static void show(void) {
    tl_show_request request = {.path = path, .all_events = true};
    FILE *file = fopen("/dev/null", "w");
    TEST_ASSERT_NOT_NULL(file);
    tl_status status = tl_history_open(path, &request.history, &error);
    if (status == TL_OK) {
        status = tl_history_find(request.history, 0, &request.run, &error);
    }
    expect_error(status, "run");
    if (status == TL_OK) {
        expect_error(tl_show_text(&request, file, &error), "page");
        expect_error(tl_show_json(&request, file, &error), "json");
        for (int table = TL_SHOW_OUTPUTS; table <= TL_SHOW_EVENTS; table++) {
            expect_error(tl_show_csv(&request, (tl_show_csv_table)table, file, &error), "csv");
        }
        expect_error(tl_show_report(&request, tl_scratch_path(&scratch, "report.html"), &error), "report");
    }
    tl_history_close(request.history);
    (void)fclose(file);
}

static tl_status replay(void) {
    tl_recording *recording = NULL;
    tl_recording_tick tick;
    bool end = false;
    tl_status status = tl_recording_open(path, &assembly.config, &recording, &error);
    expect_error(status, "open");
    while (status == TL_OK && !end) {
        status = tl_recording_next(recording, &tick, &end, &error);
    }
    expect_error(status, "next");
    tl_recording_close(recording);
    return status;
}

static void on_event(void *context, tl_severity severity, const char *text) {
    (void)context;
    tl_record_queue_event(&box.queue, -1, severity, "resume", text);
}

static tl_resume_outcome try_past(const tl_resume *found, tl_summary *summary) {
    const tl_resume_follow_settings following = {.assembly = &assembly, .queue = &box.queue, .report = on_event};
    tl_resume resume;
    tl_resume_outcome outcome = TL_RESUME_FAILED;
    void *image = malloc(tl_resume_size(found));
    TEST_ASSERT_NOT_NULL(image);
    tl_resume_write(found, image);
    expect_ok(tl_resume_read(image, tl_resume_size(found), &assembly.config, tl_clock_now(NULL), &resume, &error));
    expect_ok(tl_resume_follow(&following, &resume, summary, &outcome, &error));
    free(image);
    if (outcome == TL_RESUME_FAILED) {
        TEST_ASSERT_TRUE(tl_record_queue_put_end(&box.queue, "resume failed"));
    }
    return outcome;
}

/* Restarts as a twin and its recorder do. */
static void restart(tl_summary *summary) {
    tl_resume_outcome outcome = TL_RESUME_REFUSED;
    *summary = (tl_summary){0};
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_assembly_rebuild(&assembly));
    open_writer();
    const tl_resume_history_settings settings = {
        .config = &assembly.config,
        .path = tl_recorder_writer_path(box.writer),
        .fmus = recorded.fmus,
        .boot = recorded.boot,
        .components = tl_twin_get_facts(assembly.twin).components,
        .report = on_event,
    };
    tl_resume_history *history = tl_resume_history_open(&settings);
    const tl_resume *found = NULL;
    while (outcome == TL_RESUME_REFUSED && (found = tl_resume_history_next(history)) != NULL) {
        outcome = try_past(found, summary);
    }
    tl_resume_history_close(history);
    if (outcome != TL_RESUME_FOLLOWED) {
        tl_twin_recorder_start(&box.queue, assembly.twin, tl_clock_now(NULL));
    }
}

/* ---- Tests ---- */

/* Reference: the undamaged run is resumed. */
static void test_an_undamaged_run(void) {
    tl_summary summary;
    load_assembly();
    record_run();
    show();
    TEST_ASSERT_EQUAL_INT(TL_OK, replay());
    restart(&summary);
    TEST_ASSERT_EQUAL_INT(TL_RESUMED_CHECKPOINT, summary.resumption.from);
    TEST_ASSERT_EQUAL_INT64(TICKS, summary.resumption.tick);
    close_run("end");
}

static void test_damaged_runs_are_not_resumed(void) {
    static const char *const damages[] = {
        "UPDATE runs SET step_ns = -1",
        "UPDATE runs SET started = 'x'",
        "UPDATE runs SET lead = 9e15",
        "UPDATE steps SET step = 4e18 WHERE step = (SELECT max(step) FROM steps)",
        "UPDATE steps SET outcome = 77 WHERE step > 100",
        "UPDATE samples SET value = 9e999 WHERE tick > 100",
        "UPDATE samples SET stamp_ns = 9223372036854775807 WHERE tick > 100",
        "UPDATE samples SET signal = 60 WHERE tick > 100 AND signal = 1",
        "UPDATE adjustments SET applied = x'00' WHERE step > 100",
        "UPDATE beginnings SET start_ns = 9223372036854775807",
        "UPDATE checkpoints SET tick = -1",
        "UPDATE checkpoints SET bytes = 'text'",
        "DELETE FROM signals WHERE signal = 0",
    };
    load_assembly();
    record_run();
    for (size_t i = 0; i < sizeof damages / sizeof damages[0]; i++) {
        tl_summary summary;
        tl_kept_file_write(&whole, path);
        tl_sql_execute(path, damages[i]);
        restart(&summary);
        TEST_ASSERT_EQUAL_INT_MESSAGE(TL_RESUMED_NOT, summary.resumption.from, damages[i]);
        close_run("end");
        TEST_ASSERT_EQUAL_INT64_MESSAGE(1,
                                        tl_sql_integer(path,
                                                       "SELECT count(*) FROM events WHERE events.run > 1 AND source ="
                                                       " 'resume' AND text LIKE '%damaged%'"),
                                        damages[i]);
        tl_scratch_empty(&scratch);
    }
}

/* Damages one to six bytes of any page, half of them in its header and its cell pointers. */
static void write_mutant(tl_test_random *random) {
    static const unsigned char worst[] = {0, 1, 0x7F, 0x80, 0xFF};
    size_t size = whole.size;
    tl_kept_file mutant = {malloc(size), size};
    TEST_ASSERT_NOT_NULL(mutant.bytes);
    memcpy(mutant.bytes, whole.bytes, size);
    for (size_t k = tl_test_random_between(random, 1, 6); k > 0; k--) {
        size_t page = tl_test_random_below(random, size / PAGE) * PAGE;
        size_t at = page + tl_test_random_below(random, tl_test_random_chance(random, 50) ? 120 : PAGE);
        at = at < 100 ? at + 100 : at; /* not the header of the file */
        if (tl_test_random_chance(random, 50)) {
            mutant.bytes[at] = worst[tl_test_random_below(random, sizeof worst)];
        } else {
            mutant.bytes[at] ^= (unsigned char)(1U << tl_test_random_below(random, 8));
        }
    }
    tl_kept_file_write(&mutant, path);
    tl_kept_file_free(&mutant);
}

static void test_mutants(void) {
    tl_test_random random = {20261122};
    size_t mutants = tl_test_campaign("TL_MUTANTS", MUTANTS);
    size_t refused = 0;
    load_assembly();
    record_run();
    tl_log_set_level(TL_LOG_ERROR - 1);
    for (size_t i = 0; i < mutants; i++) {
        tl_summary summary;
        tl_time began = tl_clock_now(NULL);
        tl_scratch_empty(&scratch);
        write_mutant(&random);
        show();
        error = (tl_error){TL_OK, ""};
        refused += replay() == TL_BAD_DATA ? 1 : 0;
        error = (tl_error){TL_OK, ""};
        restart(&summary);
        (void)tl_record_queue_put_end(&box.queue, "end");
        (void)tl_test_queue_try_close(&box, NULL); /* some cannot be written */
        TEST_ASSERT_TRUE(tl_clock_now(NULL) - began < 60 * TL_SECOND);
    }
    tl_log_set_level(TL_LOG_NOTICE);
    TEST_ASSERT_GREATER_THAN_size_t(mutants / 10, refused);
}

int main(void) {
    if (setenv("TWINLOCK_FMU_PATH", TL_BINARY_DIR "/fmus", 1) != 0) {
        return EXIT_FAILURE;
    }
    tl_scratch_make(&scratch, access("/dev/shm", W_OK) == 0 ? "/dev/shm" : TL_BINARY_DIR, "test_database_mutants");
    UNITY_BEGIN();
    RUN_TEST(test_an_undamaged_run);
    RUN_TEST(test_damaged_runs_are_not_resumed);
    RUN_TEST(test_mutants);
    return tl_scratch_finish(&scratch, UNITY_END());
}
