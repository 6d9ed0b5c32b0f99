/* The image of a resume point: written and read again. Invalid images are rejected. */
#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <unity.h>

#include "firmware/twin/resume.h"
#include "tests/support/made_run.h"
#include "tests/support/message.h"
#include "tests/support/random_numbers.h"

enum { TICKS = 40, CHECKPOINT = 100, RESET_EVERY = 7, HEAD = (16 + TL_RESUME_PLAIN + 15) / 16 * 16 };

static const tl_time NOW = 5000 * TL_SECOND;

static tl_config config;
static tl_config_signal signals[TL_MADE_PLANT];
static tl_run_tuning tunings[2];
static tl_resume_ticks ticks;
static tl_resume resume; /* as it is made */
static tl_resume read;   /* as it is read */
static unsigned char checkpoint[CHECKPOINT];
static unsigned char *image;
static size_t size;
static tl_error error;

static void make_ticks(int64_t first, size_t count) {
    tl_sample sample;
    tl_record record;
    tl_resume_ticks_begin(&ticks, first);
    for (size_t i = 0; i < count; i++) {
        tl_made_sample(first + (int64_t)i, &sample);
        tl_made_record(first + (int64_t)i, &record);
        TEST_ASSERT_TRUE(tl_resume_ticks_add(&ticks, &sample));
        if (i >= 3) {
            tl_resume_ticks_set_step(&ticks, first + (int64_t)i, record.u, i % RESET_EVERY == 0);
        }
    }
    resume.first = first;
    resume.last = first + (int64_t)count - 1;
    resume.ticks = ticks.bytes;
}

/* One tuning applies at the first tick, the other one from a later tick on. */
static void make_tunings(void) {
    for (size_t i = 0; i < 2; i++) {
        tunings[i] = (tl_run_tuning){.tick = i == 0 ? 900 : 1010, .number = 2, .values = {.evaluations = 60}};
        memset(tunings[i].hash, 'a' + (int)i, sizeof tunings[i].hash - 1);
        tunings[i].values.matches = 1;
        tunings[i].values.match[0] = (tl_tuning_match){.tolerance = 1.0 + (double)i, .weight = 1.0};
    }
    resume.tunings = (const unsigned char *)tunings;
    resume.tuning_count = 2;
}

static void write(void) {
    free(image);
    size = tl_resume_size(&resume);
    image = malloc(size); /* exactly this size, so that sanitizers find overruns */
    TEST_ASSERT_NOT_NULL(image);
    tl_resume_write(&resume, image);
}

void setUp(void) {
    for (size_t i = 0; i < TL_MADE_PLANT; i++) {
        signals[i].plan.name = i == 0 ? "first" : "other";
    }
    config = (tl_config){.signals = signals,
                         .signal_count = TL_MADE_PLANT,
                         .adjust_count = TL_MADE_ADJUST,
                         .step = TL_SECOND / 100,
                         .record_resume = 60 * TL_SECOND};
    ticks = (tl_resume_ticks){.shape = tl_recorder_shape_of(&config)};
    for (size_t i = 0; i < CHECKPOINT; i++) {
        checkpoint[i] = (unsigned char)(i * 7);
    }
    resume = (tl_resume){
        .from = TL_RESUMED_CHECKPOINT,
        .run = 7,
        .step = config.step,
        .started = 1700000000123,
        .checkpoint = checkpoint,
        .checkpoint_size = CHECKPOINT,
        .shape = ticks.shape,
    };
    tl_resume_identify(&config, resume.signals);
    make_tunings();
    make_ticks(1001, TICKS);
    resume.start = NOW - tl_time_of_step(0, resume.step, resume.last) - TL_SECOND;
    write();
}

void tearDown(void) {
    tl_resume_ticks_free(&ticks);
    free(image);
    image = NULL;
}

static void expect_read(void) {
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_resume_read(image, size, &config, NOW, &read, &error), error.text);
}

/* `part`: the object that is wrong. Messages name no other object of the list. */
static void expect_refused(const char *part) {
    static const char *const objects[] = {"size", "head", "signals"};
    error.text[0] = '\0';
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_BAD_DATA, tl_resume_read(image, size, &config, NOW, &read, &error), part);
    TL_EXPECT_PARTS("damaged", error.text);
    TL_EXPECT_PARTS(part, error.text);
    for (size_t i = 0; i < sizeof objects / sizeof objects[0]; i++) {
        bool is_wanted = strcmp(objects[i], part) == 0;
        TEST_ASSERT_EQUAL_INT_MESSAGE(is_wanted, tl_test_has_parts(error.text, objects[i]), error.text);
    }
    TEST_ASSERT_EQUAL_INT(TL_RESUMED_NOT, read.from);
}

/* ---- valid images ---- */

static void expect_tick(int64_t tick) {
    tl_resume_tick found;
    tl_sample sample;
    tl_record record;
    tl_made_sample(tick, &sample);
    tl_made_record(tick, &record);
    TEST_ASSERT_TRUE(tl_resume_tick_at(&read, tick, &found));
    TEST_ASSERT_EQUAL_INT64(tick, found.sample.tick);
    TEST_ASSERT_EQUAL_INT64(read.start + tick * config.step, found.sample.instant);
    TEST_ASSERT_EQUAL_MEMORY(sample.values, found.sample.values, TL_MADE_PLANT * sizeof(double));
    TEST_ASSERT_EQUAL_MEMORY(sample.quality, found.sample.quality, TL_MADE_PLANT);
    for (size_t i = 0; i < TL_MADE_PLANT; i++) {
        tl_time stamp = sample.stamps[i] == TL_TIME_NEVER ? TL_TIME_NEVER : sample.stamps[i] + read.start;
        TEST_ASSERT_EQUAL_INT64(stamp, found.sample.stamps[i]);
    }
    TEST_ASSERT_EQUAL_UINT8(TL_NO_LINK, found.sample.quality[TL_MADE_PLANT]);
    TEST_ASSERT_EQUAL_INT64(TL_TIME_NEVER, found.sample.stamps[TL_MADE_PLANT]);
    bool has_u = tick >= read.first + 3;
    const double none[TL_MADE_ADJUST] = {0};
    TEST_ASSERT_EQUAL_INT(has_u, found.has_u);
    TEST_ASSERT_EQUAL_INT(has_u && (tick - read.first) % RESET_EVERY == 0, found.resets);
    TEST_ASSERT_EQUAL_MEMORY(has_u ? record.u : none, found.u, sizeof none);
}

static void test_all_of_it(void) {
    tl_resume_tick tick;
    expect_read();
    TEST_ASSERT_EQUAL_INT(TL_RESUMED_CHECKPOINT, read.from);
    TEST_ASSERT_EQUAL_INT64(7, read.run);
    TEST_ASSERT_EQUAL_INT64(1001, read.first);
    TEST_ASSERT_EQUAL_INT64(1000 + TICKS, read.last);
    TEST_ASSERT_EQUAL_INT64(config.step, read.step);
    TEST_ASSERT_EQUAL_INT64(resume.start, read.start);
    TEST_ASSERT_EQUAL_INT64(1700000000123, read.started);
    TEST_ASSERT_EQUAL_INT64(TL_SECOND, read.gap);
    TEST_ASSERT_EQUAL_INT64(TICKS * config.step, read.age);
    TEST_ASSERT_EQUAL_INT64(1000, read.checkpoint_tick);
    TEST_ASSERT_EQUAL_size_t(CHECKPOINT, read.checkpoint_size);
    TEST_ASSERT_EQUAL_MEMORY(checkpoint, read.checkpoint, CHECKPOINT);
    for (int64_t i = read.first; i <= read.last; i++) {
        expect_tick(i);
    }
    TEST_ASSERT_FALSE(tl_resume_tick_at(&read, read.first - 1, &tick));
    TEST_ASSERT_FALSE(tl_resume_tick_at(&read, read.last + 1, &tick));
}

static void test_a_checkpoint_without_ticks(void) {
    make_ticks(1041, 0);
    write();
    expect_read();
    TEST_ASSERT_EQUAL_INT64(1040, read.last);
    TEST_ASSERT_EQUAL_INT64(0, read.age);
}

static void test_inputs_without_a_checkpoint(void) {
    resume.checkpoint_size = 0;
    resume.from = TL_RESUMED_INPUTS;
    resume.run = TL_RESUME_UNNUMBERED;
    write();
    expect_read();
    TEST_ASSERT_NULL(read.checkpoint);
    TEST_ASSERT_EQUAL_INT64(-1, read.run);
    expect_tick(1020);
    make_ticks(0, TICKS);
    resume.from = TL_RESUMED_START;
    resume.start = NOW - resume.last * config.step;
    write();
    expect_read();
    TEST_ASSERT_EQUAL_INT64(0, read.gap);
    expect_tick(0);
}

/* The limit has a margin, because the search takes time. In mode ahead the last tick may be
 * in the future. */
static void test_just_now(void) {
    resume.start = NOW - resume.last * config.step + config.step / 2;
    write();
    expect_read();
    TEST_ASSERT_EQUAL_INT64(0, read.gap);
    resume.start = NOW - resume.last * config.step - config.record_resume - 10 * TL_SECOND;
    write();
    expect_read();
    TEST_ASSERT_EQUAL_INT64(config.record_resume + 10 * TL_SECOND, read.gap);
}

/* A device may report any stamp; it must not prevent a resume. */
static void test_stamps_that_are_far_away(void) {
    tl_sample sample;
    tl_resume_tick tick;
    tl_made_sample(1001, &sample);
    sample.stamps[0] = INT64_MAX;
    sample.stamps[1] = INT64_MIN + 1;
    tl_resume_ticks_begin(&ticks, 1001);
    TEST_ASSERT_TRUE(tl_resume_ticks_add(&ticks, &sample));
    resume.last = 1001;
    resume.start = NOW - resume.last * config.step;
    write();
    expect_read();
    TEST_ASSERT_TRUE(tl_resume_tick_at(&read, 1001, &tick));
    TEST_ASSERT_EQUAL_INT64(TL_RESUME_FAR + resume.start, tick.sample.stamps[0]);
    TEST_ASSERT_EQUAL_INT64(resume.start - TL_RESUME_FAR, tick.sample.stamps[1]);
}

static void test_tunings(void) {
    tl_run_tuning found[2];
    expect_read();
    TEST_ASSERT_EQUAL_size_t(2, read.tuning_count);
    memcpy(found, read.tunings, sizeof found);
    TEST_ASSERT_EQUAL_MEMORY(tunings, found, sizeof found);
    resume.tuning_count = 0;
    write();
    expect_read();
    TEST_ASSERT_EQUAL_size_t(0, read.tuning_count);
    expect_tick(1020);
}

/* Only the tunings that apply to the followed ticks are chosen. */
static void test_tunings_that_matter(void) {
    static const int64_t ticks_of[] = {0, 5, 10, 20, 30};
    tl_run_tuning taken[5];
    for (size_t i = 0; i < 5; i++) {
        taken[i] = (tl_run_tuning){.tick = ticks_of[i]};
    }
    TEST_ASSERT_EQUAL_size_t(3, tl_resume_choose_tunings(taken, 5, 7, 20));
    TEST_ASSERT_EQUAL_INT64(5, taken[0].tick);
    TEST_ASSERT_EQUAL_INT64(20, taken[2].tick);
    TEST_ASSERT_EQUAL_size_t(1, tl_resume_choose_tunings(taken, 3, 25, 24)); /* no tick is followed */
    TEST_ASSERT_EQUAL_INT64(20, taken[0].tick);
    TEST_ASSERT_EQUAL_size_t(0, tl_resume_choose_tunings(taken, 0, 25, 30));
}

/* ---- invalid images ---- */

static void test_another_size(void) {
    size_t whole = size;
    unsigned char *longer = calloc(whole + 1, 1);
    TEST_ASSERT_NOT_NULL(longer);
    memcpy(longer, image, whole);
    free(image);
    image = longer;
    for (size = 0; size < whole; size++) {
        expect_refused(size < HEAD ? "size" : "head");
    }
    size = whole + 1;
    expect_refused("head");
    size = TL_RESUME_MOST + 1;
    expect_refused("size");
}

static void test_another_configuration(void) {
    config.signal_count--;
    expect_refused("signals");
    config.signal_count++;
    config.adjust_count++;
    expect_refused("signals");
    config.adjust_count--;
    config.step++;
    expect_refused("signals");
    config.step--;
    signals[1].plan.name = "another";
    expect_refused("signals");
}

typedef struct damage {
    size_t at; /* in the image */
    size_t size;
    uint64_t value;
    const char *part;
} damage;

#define MAGIC 0, 8
#define SIZE 8, 8
#define FIELD(name) 16 + offsetof(tl_resume, name), sizeof((tl_resume *)NULL)->name

static void test_a_damaged_head(void) {
    static const damage damages[] = {
        {MAGIC, 0, "head"},
        {SIZE, 0, "head"},
        {SIZE, UINT64_MAX, "head"},
        {FIELD(run), (uint64_t)-2, "head"},
        {FIELD(run), INT64_MAX, "head"},
        {FIELD(first), (uint64_t)-1, "head"},
        {FIELD(first), 0, "head"},
        {FIELD(first), 1042, "head"},
        {FIELD(first), INT64_MAX, "head"},
        {FIELD(first), (uint64_t)INT64_MIN, "head"},
        {FIELD(last), INT64_MAX, "head"},
        {FIELD(last), (uint64_t)INT64_MIN, "head"},
        {FIELD(last), 1001 + TL_RESUME_TICKS, "head"},
        {FIELD(last), 1000 + TL_RESUME_TICKS, "head"},
        {FIELD(step), 0, "signals"},
        {FIELD(start), INT64_MAX, "head"},
        {FIELD(start), (uint64_t)INT64_MIN, "head"},
        {FIELD(start), 0, "damaged"},
        {FIELD(start), 6000 * (uint64_t)TL_SECOND, "damaged"},
        {FIELD(started), INT64_MAX, "head"},
        {FIELD(started), (uint64_t)INT64_MIN, "head"},
        {FIELD(checkpoint_size), 0, "head"},
        {FIELD(checkpoint_size), CHECKPOINT + 1, "head"},
        {FIELD(checkpoint_size), UINT64_MAX - 50, "head"},
        {FIELD(tuning_count), 0, "head"},
        {FIELD(tuning_count), 3, "head"},
        {FIELD(tuning_count), TL_RESUME_TUNINGS + 1, "head"},
        {FIELD(tuning_count), UINT64_MAX, "head"},
        {FIELD(shape.plant), 0, "signals"},
        {FIELD(shape.plant), UINT64_MAX, "signals"},
        {FIELD(shape.match), 9, "signals"},
        {FIELD(shape.adjust), 9, "signals"},
        {FIELD(shape.components), 9, "signals"},
        {FIELD(signals[0]), 0, "signals"},
        {16 + offsetof(tl_resume, signals) + 64, 1, 'x', "signals"}, /* the terminating 0 */
        {FIELD(from), TL_RESUMED_NOT, "signals"},                    /* samples without u */
        {FIELD(from), TL_RESUMED_START, "head"},
        {FIELD(from), TL_RESUMED_INPUTS, "head"},
        {FIELD(from), 4, "head"},
        {FIELD(from), UINT32_MAX, "head"},
    };
    for (size_t i = 0; i < sizeof damages / sizeof damages[0]; i++) {
        write();
        memcpy(image + damages[i].at, &damages[i].value, damages[i].size);
        expect_refused(damages[i].part);
    }
}

static void refuse_tuning(size_t index, const tl_run_tuning *bad) {
    tl_run_tuning good = tunings[index];
    tunings[index] = *bad;
    write();
    expect_refused("damaged");
    tunings[index] = good;
}

static void test_damaged_tunings(void) {
    tl_run_tuning bad = tunings[1];
    bad.tick = 899;
    refuse_tuning(1, &bad);
    bad.tick = -1;
    refuse_tuning(0, &bad);
    bad.tick = INT64_MAX;
    refuse_tuning(1, &bad);
    bad = tunings[1];
    bad.hash[0] = '\0';
    refuse_tuning(1, &bad);
    bad.hash[0] = 'g';
    refuse_tuning(1, &bad);
    bad = tunings[1];
    bad.values.match[0].tolerance = -1.0;
    refuse_tuning(1, &bad);
    bad.values.matches = UINT32_MAX;
    refuse_tuning(0, &bad);
}

static void write_tick(size_t index, size_t at, const void *bytes, size_t count) {
    size_t tick = tl_resume_tick_bytes(&resume.shape);
    write();
    memcpy(image + size - (TICKS - index) * tick + at, bytes, count);
}

static void test_damaged_ticks(void) {
    static const double numbers[] = {(double)NAN, (double)INFINITY, -(double)INFINITY};
    static const tl_time stamps[] = {TL_RESUME_FAR + 1, -TL_RESUME_FAR - 1, INT64_MAX, INT64_MIN + 1};
    const unsigned char three = 3;
    const unsigned char quality = TL_LAST_QUALITY + 1;
    const size_t words = TL_MADE_PLANT * 8;
    for (size_t i = 0; i < sizeof numbers / sizeof numbers[0]; i++) {
        write_tick(5, 1 + 8, &numbers[i], 8);
        expect_refused("tick 1006");
        write_tick(TICKS - 1, 1 + 2 * words + TL_MADE_PLANT + 8, &numbers[i], 8);
        expect_refused("tick 1040");
    }
    for (size_t i = 0; i < sizeof stamps / sizeof stamps[0]; i++) {
        write_tick(0, 1 + words, &stamps[i], 8);
        expect_refused("tick 1001");
    }
    write_tick(9, 0, &three, 1);
    expect_refused("tick 1010");
    write_tick(9, 1 + 2 * words + 2, &quality, 1);
    expect_refused("tick 1010");
}

/* A random change is rejected, or all values that are read are valid. */
static void test_mutants(void) {
    tl_test_random random = {20261123};
    size_t refused = 0;
    for (int i = 0; i < 20000; i++) {
        write();
        for (size_t k = tl_test_random_between(&random, 1, 4); k > 0; k--) {
            size_t at = tl_test_random_below(&random, tl_test_random_chance(&random, 50) ? 96 : size);
            image[at] ^= (unsigned char)(1U << tl_test_random_below(&random, 8));
        }
        if (tl_resume_read(image, size, &config, NOW, &read, &error) != TL_OK) {
            refused++;
            continue;
        }
        tl_resume_tick tick;
        for (int64_t number = read.first; number <= read.last; number++) {
            TEST_ASSERT_TRUE(tl_resume_tick_at(&read, number, &tick));
            TEST_ASSERT_TRUE(isfinite(tick.sample.values[0]) && tick.sample.quality[1] <= TL_LAST_QUALITY);
        }
    }
    TEST_ASSERT_GREATER_THAN_size_t(1000, refused);
}

/* ---- which ticks can be followed ---- */

static void expect_last(const char *with_u, int64_t last) {
    tl_sample sample;
    const double u[TL_MADE_ADJUST] = {1.0, 2.0};
    tl_resume_ticks_begin(&ticks, 10);
    for (int64_t i = 0; with_u[i] != '\0'; i++) {
        tl_made_sample(10 + i, &sample);
        TEST_ASSERT_TRUE(tl_resume_ticks_add(&ticks, &sample));
        if (with_u[i] == 'u') {
            tl_resume_ticks_set_step(&ticks, 10 + i, u, false);
        }
    }
    TEST_ASSERT_EQUAL_INT64_MESSAGE(last, tl_resume_ticks_last(&ticks, 10), with_u);
}

static void test_how_far_they_can_be_followed(void) {
    expect_last("", 9);
    expect_last("....", 9);
    expect_last("u", 10);
    expect_last("..uuu", 14);
    expect_last("..uu..", 13);
    expect_last("..uu.uuu", 13);
}

static void test_a_later_part_of_a_row(void) {
    const double u[TL_MADE_ADJUST] = {1.0, 2.0};
    expect_last("uu.u", 11);
    TEST_ASSERT_EQUAL_INT64(13, tl_resume_ticks_last(&ticks, 12));
    TEST_ASSERT_EQUAL_INT64(13, tl_resume_ticks_last(&ticks, 14));
    tl_resume_ticks_set_step(&ticks, 9, u, true); /* not in the list */
    tl_resume_ticks_set_step(&ticks, 14, u, true);
    TEST_ASSERT_EQUAL_INT64(11, tl_resume_ticks_last(&ticks, 10));
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_all_of_it);
    RUN_TEST(test_a_checkpoint_without_ticks);
    RUN_TEST(test_inputs_without_a_checkpoint);
    RUN_TEST(test_just_now);
    RUN_TEST(test_stamps_that_are_far_away);
    RUN_TEST(test_tunings);
    RUN_TEST(test_tunings_that_matter);
    RUN_TEST(test_damaged_tunings);
    RUN_TEST(test_another_size);
    RUN_TEST(test_another_configuration);
    RUN_TEST(test_a_damaged_head);
    RUN_TEST(test_damaged_ticks);
    RUN_TEST(test_mutants);
    RUN_TEST(test_how_far_they_can_be_followed);
    RUN_TEST(test_a_later_part_of_a_row);
    return UNITY_END();
}
