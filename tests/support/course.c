/* The course of a run: see course.h. */
#include "tests/support/course.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include <unity.h>

#include "firmware/base/os.h"
#include "firmware/twin/twin_recorder.h"
#include "tests/support/config_text.h"
#include "tests/support/random_numbers.h"
#include "tests/support/read_assembly.h"

enum { MISSED = 13, CHECKPOINT = 256 * 1024, PAGE = 4096 };

void tl_course_anew(tl_course *course) {
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_assembly_rebuild(&course->assembly));
    course->next = 0;
}

void tl_course_forget(tl_course *course) {
    memset(&course->part, 0, sizeof course->part);
}

/* Another tolerance, another nominal. */
static void make_other(tl_course *course) {
    tl_error error;
    const tl_config *config = &course->assembly.config;
    char *text = tl_test_replaced(config->text, "\"tolerance\": 1.0", "\"tolerance\": 0.4, \"weight\": 2");
    TEST_ASSERT_NOT_NULL(text);
    course->other = tl_test_replaced(text, "\"nominal\": 0.0031, \"step\": 0.12, \"min\": -100",
                                     "\"nominal\": 0.02, \"step\": 0.12, \"min\": 0.001");
    free(text);
    TEST_ASSERT_NOT_NULL(course->other);
    tl_sha256(course->other, strlen(course->other), course->other_hash);
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_config_tuning_of(config, course->other, &course->other_values, &error));
}

tl_run_tuning tl_course_configured(const tl_course *course) {
    tl_run_tuning configured = {.values = course->assembly.tuning};
    memcpy(configured.hash, course->assembly.config.hash, sizeof configured.hash);
    return configured;
}

void tl_course_open(tl_course *course, const char *path, tl_pairing measurements) {
    tl_config *config = &course->assembly.config;
    memset(course, 0, sizeof *course);
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_test_read_assembly(path, &course->assembly));
    config->algorithm = "nelder-mead";
    config->measurements = measurements;
    config->prediction = 3;
    config->duration = 0;
    config->record_resume = 3600 * TL_SECOND;
    config->record_commit = TL_SECOND / 100;
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_assembly_build(&course->assembly));
    make_other(course);
    tl_account_take(course->assembly.twin, &course->account);
    course->start = tl_clock_now(NULL) - TL_COURSE_TICKS * config->step;
    tl_course_search(course, TL_COURSE_TICKS - 1, NULL);
    course->whole = course->part;
    tl_course_forget(course);
    tl_course_anew(course);
}

void tl_course_close(tl_course *course) {
    tl_assembly_free(&course->assembly);
    free(course->checkpoint);
    free(course->memory);
    free(course->other);
    memset(course, 0, sizeof *course);
}

void tl_course_sample(const tl_course *course, int64_t tick, tl_sample *sample) {
    double at = (double)tick;
    memset(sample, 0, sizeof *sample);
    uint64_t bits = tl_test_mix((uint64_t)tick);
    sample->tick = tick;
    sample->instant = tl_time_of_step(course->start, course->assembly.config.step, tick);
    sample->values[0] = 0.8 * sin(0.31 * at);
    sample->values[1] = 60.0 + 9.0 * cos(0.07 * at) + 0.3 * sin(1.7 * at);
    sample->quality[0] = (uint8_t)(bits % 7 == 0 ? TL_STALE : TL_GOOD);
    sample->quality[1] = (uint8_t)(bits % 11 == 0 ? TL_NO_LINK : TL_GOOD);
    sample->stamps[0] = tick == 0 ? TL_TIME_NEVER : sample->instant - (tl_time)(bits % 5000000);
    sample->stamps[1] = sample->instant - (tl_time)(bits % 3000000);
}

/* The FMUs are reset once before the checkpoint from which tests resume, once between it and the
 * end of the interrupted run (in a missed tick), and once later. */
static bool is_reset(int64_t tick) {
    return tick == 90 || tick == 116 || tick == 170;
}

/* The tuning changes to the other one, back, and to the other one again: before the checkpoint from
 * which tests resume, between it and the end of the interrupted run, and later. */
static bool takes_tuning(const tl_course *course, int64_t tick, tl_run_tuning *tuning) {
    *tuning = tl_course_configured(course);
    tuning->tick = tick;
    if (tick == 85 || tick == 180) {
        memcpy(tuning->hash, course->other_hash, sizeof tuning->hash);
        tuning->values = course->other_values;
    }
    return tick == 85 || tick == 120 || tick == 180;
}

static void put_sample(tl_record_queue *queue, const tl_sample *sample, const tl_run_tuning *tuning) {
    if (tuning != NULL) {
        TEST_ASSERT_TRUE(tl_record_queue_put_tuning(queue, tuning));
    }
    TEST_ASSERT_TRUE(tl_record_queue_put_sample(queue, sample));
}

static void keep(tl_course *course, const tl_record *record, tl_record_queue *queue) {
    course->part.records[record->step] = *record;
    course->part.there[record->step] = true;
    if (queue != NULL) {
        tl_twin_recorder_put(queue, record, course->assembly.twin);
    }
}

void tl_course_search(tl_course *course, int64_t last, tl_record_queue *queue) {
    const tl_budget budget = {.evaluations = 15};
    for (; course->next <= last; course->next++) {
        tl_sample sample;
        tl_record record;
        tl_error error;
        bool ready = false;
        tl_run_tuning taken;
        tl_course_sample(course, course->next, &sample);
        const tl_run_tuning *tuning = takes_tuning(course, course->next, &taken) ? &taken : NULL;
        if (tuning != NULL) {
            TEST_ASSERT_EQUAL_INT(TL_OK, tl_assembly_retune(&course->assembly, &tuning->values, &error));
        }
        bool ahead = course->assembly.config.measurements == TL_AHEAD; /* the step before comes before the sample */
        if (queue != NULL && !ahead) {
            put_sample(queue, &sample, tuning);
        }
        tl_twin *twin = course->assembly.twin;
        if (is_reset(course->next)) {
            tl_twin_reset(twin);
        }
        tl_status status = course->next % MISSED == MISSED - 1
                               ? tl_twin_catch_up(twin, &sample, &record, &ready, &error)
                               : tl_twin_step(twin, &sample, &budget, &record, &ready, &error);
        TEST_ASSERT_EQUAL_INT(TL_OK, status);
        if (ready) {
            keep(course, &record, queue);
        }
        if (queue != NULL && ahead) {
            put_sample(queue, &sample, tuning);
        }
    }
}

void tl_course_save(tl_course *course) {
    tl_error error;
    size_t needed = 0;
    tl_twin *twin = course->assembly.twin;
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_twin_save(twin, NULL, 0, &course->checkpoint_size, &error));
    TEST_ASSERT_NOT_EQUAL_size_t(0, course->checkpoint_size);
    free(course->checkpoint);
    course->checkpoint = malloc(course->checkpoint_size);
    TEST_ASSERT_NOT_NULL(course->checkpoint);
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_twin_save(twin, course->checkpoint, course->checkpoint_size, &needed, &error));
    course->checkpoint_tick = course->next - 1;
}

/* ---- a record queue ---- */

tl_record_queue *tl_course_queue(tl_course *course) {
    const tl_config *config = &course->assembly.config;
    tl_record_queue_settings settings = {.shape = {.plant = config->signal_count,
                                                   .match = config->match_count,
                                                   .adjust = config->adjust_count,
                                                   .components = course->account.components},
                                         .checkpoint_bytes = CHECKPOINT};
    settings.ring_bytes = tl_record_queue_ring_bytes(&settings.shape, config->step);
    size_t bytes = tl_record_queue_bytes(&settings);
    free(course->memory);
    TEST_ASSERT_EQUAL_INT(0, posix_memalign(&course->memory, PAGE, bytes));
    memset(course->memory, 0, bytes);
    tl_record_queue_open(&settings, course->memory, NULL, &course->queue);
    return &course->queue;
}

/* Stamps are relative to the start of the run. */
static void expect_sample(const tl_course *course, const tl_sample *found) {
    const size_t signals = course->assembly.config.signal_count;
    tl_sample wanted;
    tl_course_sample(course, found->tick, &wanted);
    TEST_ASSERT_EQUAL_MEMORY(wanted.values, found->values, signals * sizeof wanted.values[0]);
    TEST_ASSERT_EQUAL_MEMORY(wanted.quality, found->quality, signals);
    for (size_t i = 0; i < signals; i++) {
        bool never = wanted.stamps[i] == TL_TIME_NEVER;
        TEST_ASSERT_EQUAL_INT64(never ? TL_TIME_NEVER : wanted.stamps[i] - course->begun.start, found->stamps[i]);
    }
}

static void take_entry(tl_course *course, const tl_recorder_entry *entry) {
    switch (entry->kind) {
    case TL_ENTRY_START:
        TEST_ASSERT_EQUAL_UINT32(course->account.components, entry->start.account.components);
        course->begun = entry->start.resumption;
        break;
    case TL_ENTRY_SAMPLE:
        expect_sample(course, &entry->sample);
        course->samples++;
        break;
    case TL_ENTRY_STEP:
        TEST_ASSERT_EQUAL_INT(TL_RESUMED, entry->record.outcome);
        course->part.records[entry->record.step] = entry->record;
        course->part.there[entry->record.step] = true;
        break;
    case TL_ENTRY_TUNING:
        TEST_ASSERT_TRUE(strcmp(entry->tuning.hash, course->other_hash) == 0 ||
                         strcmp(entry->tuning.hash, course->assembly.config.hash) == 0);
        course->tunings++;
        break;
    default:
        TEST_FAIL_MESSAGE("the run was ended");
    }
}

void tl_course_read(tl_course *course) {
    static tl_recorder_entry entry; /* too large for a small stack */
    tl_record_queue_saved left;
    uint64_t position = 0;
    course->begun = (tl_resumption){.tick = -1};
    course->samples = 0;
    course->tunings = 0;
    course->kept_size = 0;
    while (tl_record_queue_saved_entry(&course->queue, &position, &entry)) {
        take_entry(course, &entry);
    }
    TEST_ASSERT_EQUAL_UINT64(course->queue.written, position);
    if (tl_record_queue_saved_checkpoint(&course->queue, 0, &left)) {
        TEST_ASSERT_EQUAL_size_t(course->checkpoint_size, left.size);
        TEST_ASSERT_EQUAL_MEMORY(course->checkpoint, left.bytes, left.size);
        course->kept_tick = left.tick;
        course->kept_size = left.size;
    }
}

/* ---- the same ---- */

static void expect_same_bits(const double *wanted, const double *found, size_t count, const char *what) {
    TEST_ASSERT_TRUE_MESSAGE(memcmp(wanted, found, count * sizeof *wanted) == 0, what);
}

void tl_course_expect_same(const tl_course *course, size_t least) {
    const tl_config *config = &course->assembly.config;
    size_t compared = 0;
    int64_t last = -1;
    for (int64_t step = 0; step < TL_COURSE_TICKS; step++) {
        const tl_record *wanted = &course->whole.records[step];
        const tl_record *found = &course->part.records[step];
        if (!course->part.there[step]) {
            continue;
        }
        TEST_ASSERT_TRUE(course->whole.there[step]);
        expect_same_bits(wanted->u, found->u, config->adjust_count, "u");
        expect_same_bits(wanted->nominal, found->nominal, config->adjust_count, "nominal u");
        expect_same_bits(wanted->y, found->y, config->match_count, "y");
        expect_same_bits(wanted->measured, found->measured, config->match_count, "measured y");
        TEST_ASSERT_EQUAL_UINT8(wanted->measured_quality[0], found->measured_quality[0]);
        TEST_ASSERT_EQUAL_UINT32(wanted->flags & TL_FLAG_RESET, found->flags & TL_FLAG_RESET);
        compared++;
        last = step;
    }
    TEST_ASSERT_GREATER_OR_EQUAL_size_t(least, compared);
    TEST_ASSERT_TRUE(last >= 0 && course->whole.there[last] &&
                     (last == TL_COURSE_TICKS - 1 || !course->whole.there[last + 1]));
}
