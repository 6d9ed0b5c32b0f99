/* The course of a run: see course.h. */
#include "tests/support/course.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include <unity.h>

#include "firmware/base/clock.h"
#include "firmware/twin/twin_recorder.h"
#include "tests/support/random_numbers.h"

enum { MISSED = 13 };

void tl_course_anew(tl_course *course) {
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_assembly_rebuild(&course->assembly));
    course->next = 0;
}

void tl_course_forget(tl_course *course) {
    memset(&course->part, 0, sizeof course->part);
}

void tl_course_open(tl_course *course, const char *path, tl_measurements measurements) {
    tl_config *config = &course->assembly.config;
    memset(course, 0, sizeof *course);
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_assembly_read(path, &course->assembly));
    config->algorithm = "nelder-mead";
    config->measurements = measurements;
    config->prediction = 3;
    config->match[0].condition = (tl_plan_condition){.median = 5, .low_pass = TL_SECOND / 20};
    config->duration = 0;
    config->record_resume = 3600 * TL_SECOND;
    config->record_commit = TL_SECOND / 100;
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_assembly_build(&course->assembly));
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

static void keep(tl_course *course, const tl_record *record, const tl_past_sink *sink) {
    tl_recorder_component counts[TL_RECORDER_COMPONENTS];
    course->part.records[record->step] = *record;
    course->part.there[record->step] = true;
    if (sink != NULL) {
        (void)tl_twin_recorder_count(course->assembly.twin, counts);
        sink->put_step(sink, record, counts);
    }
}

void tl_course_search(tl_course *course, int64_t last, const tl_past_sink *sink) {
    const tl_budget budget = {.evaluations = 15};
    for (; course->next <= last; course->next++) {
        tl_sample sample;
        tl_record record;
        tl_error error;
        bool ready = false;
        tl_course_sample(course, course->next, &sample);
        bool ahead = course->assembly.config.measurements == TL_AHEAD; /* the step before comes before the sample */
        if (sink != NULL && !ahead) {
            sink->put_sample(sink, &sample);
        }
        tl_twin *twin = course->assembly.twin;
        tl_status status = course->next % MISSED == MISSED - 1
                               ? tl_twin_make_up(twin, &sample, &record, &ready, &error)
                               : tl_twin_step(twin, &sample, &budget, &record, &ready, &error);
        TEST_ASSERT_EQUAL_INT(TL_OK, status);
        if (ready) {
            keep(course, &record, sink);
        }
        if (sink != NULL && ahead) {
            sink->put_sample(sink, &sample);
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

/* ---- a sink ---- */

static void begin(const tl_past_sink *sink, const tl_resumption *resumption) {
    tl_course *course = sink->place;
    course->begun = *resumption;
    course->samples = 0;
    course->kept_size = 0;
}

static void keep_checkpoint(const tl_past_sink *sink, int64_t tick, const unsigned char *bytes, size_t size) {
    tl_course *course = sink->place;
    TEST_ASSERT_EQUAL_size_t(course->checkpoint_size, size);
    TEST_ASSERT_EQUAL_MEMORY(course->checkpoint, bytes, size);
    course->kept_tick = tick;
    course->kept_size = size;
}

static void wait_for_nothing(const tl_past_sink *sink) {
    (void)sink;
}

static void put_sample(const tl_past_sink *sink, const tl_sample *sample) {
    tl_course *course = sink->place;
    const size_t signals = course->assembly.config.signal_count;
    tl_sample wanted;
    tl_course_sample(course, sample->tick, &wanted);
    TEST_ASSERT_EQUAL_INT64(wanted.instant, sample->instant);
    TEST_ASSERT_EQUAL_MEMORY(wanted.values, sample->values, signals * sizeof wanted.values[0]);
    TEST_ASSERT_EQUAL_MEMORY(wanted.stamps, sample->stamps, signals * sizeof wanted.stamps[0]);
    TEST_ASSERT_EQUAL_MEMORY(wanted.quality, sample->quality, signals);
    course->samples++;
}

static void put_step(const tl_past_sink *sink, const tl_record *record, const tl_recorder_component *ledger) {
    tl_course *course = sink->place;
    (void)ledger;
    TEST_ASSERT_EQUAL_INT(TL_FOLLOWED, record->outcome);
    course->part.records[record->step] = *record;
    course->part.there[record->step] = true;
}

tl_past_sink tl_course_sink(tl_course *course) {
    return (tl_past_sink){.begin = begin,
                          .keep = keep_checkpoint,
                          .wait = wait_for_nothing,
                          .put_sample = put_sample,
                          .put_step = put_step,
                          .place = course};
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
        expect_same_bits(wanted->u_hat, found->u_hat, config->adjust_count, "nominal u");
        expect_same_bits(wanted->y, found->y, config->match_count, "y");
        expect_same_bits(wanted->y_hat, found->y_hat, config->match_count, "measured y");
        TEST_ASSERT_EQUAL_UINT8(wanted->y_hat_quality[0], found->y_hat_quality[0]);
        compared++;
        last = step;
    }
    TEST_ASSERT_GREATER_OR_EQUAL_size_t(least, compared);
    TEST_ASSERT_TRUE(last >= 0 && course->whole.there[last] &&
                     (last == TL_COURSE_TICKS - 1 || !course->whole.there[last + 1]));
}
