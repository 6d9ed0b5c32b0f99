/* A twin that is saved, loaded, and follows the u of an earlier run: bit for bit as one without
 * interruption. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unity.h>

#include "tests/support/message.h"
#include "tests/support/random_numbers.h"
#include "tests/support/test_scene.h"

enum { TICKS = 240 };

static tl_test_scene scene;
static tl_test_run *const run = &scene.run;

/* By step: the run without interruption, and the run under test. */
static tl_record whole[TICKS], part[TICKS];
static bool in_whole[TICKS], in_part[TICKS];

static unsigned char *bytes;
static size_t size;

void setUp(void) {
    scene.forgetful = false;
    scene.good = false;
}

void tearDown(void) {
    tl_test_scene_end(&scene);
    free(bytes);
    bytes = NULL;
}

static void keep(tl_record *records, bool *there) {
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, run->status, run->error.text);
    if (run->ready && run->record.step < TICKS) {
        records[run->record.step] = run->record;
        there[run->record.step] = true;
    }
}

/* Searches until tick `to`; every thirteenth tick is missed. */
static void search_to(int64_t to, tl_record *records, bool *there) {
    while (run->sample.tick <= to) {
        tl_test_scene_show(&scene);
        if (run->sample.tick % 13 == 12) {
            tl_test_run_catch_up(run);
        } else {
            tl_test_run_step(run);
        }
        keep(records, there);
    }
}

/* Follows the u of the whole run until tick `to`. */
static void follow_to(int64_t to, tl_record *records, bool *there) {
    while (run->sample.tick <= to) {
        int64_t step = run->sample.tick - tl_twin_get_facts(run->twin).lead;
        tl_test_scene_show(&scene);
        tl_test_run_follow(run, step < 0 ? NULL : whole[step].u);
        keep(records, there);
    }
}

static void forget(void) {
    memset(in_whole, 0, sizeof in_whole);
    memset(in_part, 0, sizeof in_part);
}

static void save(void) {
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_twin_save(run->twin, NULL, 0, &size, &run->error));
    free(bytes);
    bytes = calloc(size + 1, 1); /* one more, for a test with one too many */
    TEST_ASSERT_NOT_NULL(bytes);
    if (size != 0) {
        size_t needed = size;
        TEST_ASSERT_EQUAL_INT(TL_OK, tl_twin_save(run->twin, bytes, size, &size, &run->error));
        TEST_ASSERT_EQUAL_size_t(needed, size);
    }
}

/* A new twin, loaded from the checkpoint of `tick`. */
static void load(tl_test_scene_kind of, int64_t tick) {
    tl_test_scene_build(&scene, of);
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_twin_load(run->twin, tick, bytes, size, &run->error), run->error.text);
    tl_test_scene_move(&scene, tick + 1);
}

static void expect_same_bits(const double *wanted, const double *found, size_t count, const char *what) {
    TEST_ASSERT_TRUE_MESSAGE(memcmp(wanted, found, count * sizeof *wanted) == 0, what);
}

static void expect_same_course(tl_test_scene_kind of, bool with_measurement) {
    size_t compared = 0;
    for (int64_t step = 0; step < TICKS; step++) {
        if (!in_part[step] || !in_whole[step]) {
            continue;
        }
        const char *what = tl_test_scene_name(of);
        compared++;
        expect_same_bits(whole[step].y, part[step].y, TL_SCENE_MATCHES, what);
        expect_same_bits(whole[step].u, part[step].u, scene.plan.plan.adjust_count, what);
        expect_same_bits(whole[step].nominal, part[step].nominal, scene.plan.plan.adjust_count, what);
        if (with_measurement) {
            expect_same_bits(whole[step].measured, part[step].measured, TL_SCENE_MATCHES, what);
            TEST_ASSERT_EQUAL_UINT8_MESSAGE(whole[step].measured_quality[0], part[step].measured_quality[0], what);
            TEST_ASSERT_EQUAL_INT64_MESSAGE(whole[step].delay, part[step].delay, what);
        }
    }
    TEST_ASSERT_GREATER_THAN_size_t_MESSAGE(20, compared, tl_test_scene_name(of));
}

/* ---- equal runs ---- */

/* With an event horizon the winner of a search replaces the twin, so the whole run must follow
 * too. */
static void run_whole(tl_test_scene_kind of, int64_t saved_at) {
    forget();
    tl_test_scene_build(&scene, of);
    search_to(saved_at, whole, in_whole);
    save();
    search_to(TICKS - 1, whole, in_whole);
    tl_test_scene_end(&scene);
    if (of == TL_SCENE_STROKES) {
        tl_test_scene_build(&scene, of);
        search_to(saved_at, part, in_part);
        follow_to(TICKS - 1, whole, in_whole);
        tl_test_scene_end(&scene);
        memset(in_part, 0, sizeof in_part);
    }
}

static void test_a_loaded_twin_follows(void) {
    static const int64_t ticks[] = {8, 9, 30, 60, 77, 131, 199};
    for (tl_test_scene_kind of = TL_SCENE_LAG; of < TL_SCENES; of++) {
        for (size_t i = 0; i < sizeof ticks / sizeof ticks[0]; i++) {
            run_whole(of, ticks[i]);
            if (size == 0) {
                TEST_ASSERT_EQUAL_INT(TL_SCENE_LONG, of); /* an FMU would have to repeat steps */
                continue;
            }
            load(of, ticks[i]);
            follow_to(TICKS - 1, part, in_part);
            tl_test_scene_end(&scene);
            expect_same_course(of, true);
            TEST_ASSERT_EQUAL_INT(TL_RESUMED, part[TICKS - 12].outcome);
        }
    }
}

static void test_a_new_twin_follows(void) {
    for (tl_test_scene_kind of = TL_SCENE_LAG; of < TL_SCENE_STROKES; of++) {
        run_whole(of, 20);
        tl_test_scene_build(&scene, of);
        follow_to(TICKS - 1, part, in_part);
        tl_test_scene_end(&scene);
        expect_same_course(of, true);
    }
}

/* A loaded twin searches at once, with solvers without memory: the run is equal. Strokes: only
 * between two of them. */
static void test_a_loaded_twin_searches(void) {
    static const int64_t ticks[] = {9, 24, 60, 78, 131, 158}; /* tick 25 is missed */
    scene.forgetful = true;
    for (tl_test_scene_kind of = TL_SCENE_LAG; of < TL_SCENES; of++) {
        for (size_t i = 0; i < sizeof ticks / sizeof ticks[0]; i++) {
            if ((of == TL_SCENE_STROKES && ticks[i] % 80 != 78) || of == TL_SCENE_LONG) {
                continue;
            }
            forget();
            tl_test_scene_build(&scene, of);
            search_to(ticks[i], whole, in_whole);
            save();
            search_to(TICKS - 1, whole, in_whole);
            tl_test_scene_end(&scene);
            load(of, ticks[i]);
            search_to(TICKS - 1, part, in_part);
            tl_test_scene_end(&scene);
            expect_same_course(of, true);
            /* the delay has been measured */
            TEST_ASSERT_TRUE(of != TL_SCENE_MEASURED || whole[TICKS - 20].delay != 0);
            for (int64_t step = ticks[i] + 1; step < TICKS; step++) {
                bool both = in_part[step] && in_whole[step];
                TEST_ASSERT_TRUE_MESSAGE(!both || whole[step].evaluations == part[step].evaluations,
                                         tl_test_scene_name(of));
                TEST_ASSERT_TRUE_MESSAGE(!both || whole[step].outcome == part[step].outcome, tl_test_scene_name(of));
            }
        }
    }
}

/* A loaded twin follows, then searches. A repetition gives the same values and executions, as the
 * ledger predicts. */
static void test_following_and_searching_repeats(void) {
    for (tl_test_scene_kind of = TL_SCENE_LAG; of < TL_SCENES; of++) {
        static tl_record first[TICKS];
        run_whole(of, 77);
        for (int again = 0; again < 2 && size != 0; again++) {
            memcpy(first, part, sizeof first);
            memset(in_part, 0, sizeof in_part);
            load(of, 77);
            follow_to(130, part, in_part);
            search_to(TICKS - 1, part, in_part);
            for (size_t k = 0; k < tl_twin_get_facts(run->twin).components; k++) {
                TEST_ASSERT_EQUAL_INT64_MESSAGE(0, tl_twin_get_ledger(run->twin, k).difference, tl_test_scene_name(of));
            }
            tl_test_scene_end(&scene);
        }
        for (int64_t step = 0; step < TICKS && size != 0; step++) {
            if (in_part[step]) {
                expect_same_bits(first[step].y, part[step].y, TL_SCENE_MATCHES, tl_test_scene_name(of));
                TEST_ASSERT_EQUAL_UINT32(first[step].executions, part[step].executions);
                TEST_ASSERT_EQUAL_UINT32(first[step].evaluations, part[step].evaluations);
            }
        }
    }
}

/* Saving after each tick changes neither values nor executions. */
static void test_saving_changes_nothing(void) {
    for (tl_test_scene_kind of = TL_SCENE_LAG; of < TL_SCENES; of++) {
        run_whole(of, 20);
        bool follows = of == TL_SCENE_STROKES;
        tl_test_scene_build(&scene, of);
        while (run->sample.tick < TICKS) {
            int64_t tick = run->sample.tick;
            if (follows && tick > 20) {
                follow_to(tick, part, in_part);
            } else {
                search_to(tick, part, in_part);
            }
            save();
        }
        tl_test_scene_end(&scene);
        expect_same_course(of, true);
        /* in TL_SCENE_LONG an FMU may have more steps to repeat */
        for (int64_t step = 0; step < TICKS && of != TL_SCENE_LONG; step++) {
            TEST_ASSERT_EQUAL_UINT32(whole[step].executions * in_part[step], part[step].executions * in_part[step]);
        }
    }
}

/* ---- start in the middle, with start values ---- */

static void test_a_twin_starts_at_a_tick(void) {
    for (tl_test_scene_kind of = TL_SCENE_LAG; of < TL_SCENES; of++) {
        int64_t age = tl_test_scene_age(of);
        forget();
        tl_test_scene_build(&scene, of);
        tl_twin_begin_at(run->twin, 100);
        tl_test_scene_move(&scene, 100);
        TEST_ASSERT_EQUAL_INT64(100 + age, tl_twin_get_facts(run->twin).first);
        search_to(TICKS - 1, part, in_part);
        for (int64_t step = 0; step < 180; step++) { /* the lead is a few ticks */
            TEST_ASSERT_EQUAL_INT_MESSAGE(step >= 100 + age, in_part[step], tl_test_scene_name(of));
        }
        bool set_up = false;
        for (size_t i = 0; i < scene.log.count && i < TL_TEST_ENTRIES; i++) {
            const tl_test_entry *entry = &scene.log.entries[i];
            if (entry->call == TL_TEST_SETUP_EXPERIMENT) {
                set_up = true;
                TEST_ASSERT_EQUAL_DOUBLE(0.1 * (double)(100 + age), entry->time);
            }
        }
        TEST_ASSERT_TRUE(set_up);
        tl_test_scene_end(&scene);
        tl_test_log_clear(&scene.log);
    }
}

/* With delays, the sample of the first instant is not the newest one. */
static void test_the_first_step_uses_the_sample_of_its_instant(void) {
    scene.good = true;
    for (tl_test_scene_kind of = TL_SCENE_LAG; of < TL_SCENE_STROKES; of++) {
        tl_test_scene_build(&scene, of);
        tl_twin_begin_at(run->twin, 100);
        tl_test_scene_move(&scene, 100);
        int64_t first = tl_twin_get_facts(run->twin).first;
        int64_t shown = first + scene.plan.plan.input_ticks;
        double u = 0.0;
        while (run->sample.tick <= 120) {
            tl_test_scene_show(&scene);
            u = run->sample.tick == shown ? run->sample.values[0] : u;
            tl_test_run_step(run);
        }
        const tl_test_entry *step = tl_test_log_step(&scene.log, &scene.fmus[0], 0);
        TEST_ASSERT_EQUAL_DOUBLE_MESSAGE(0.1 * (double)first, step->time, tl_test_scene_name(of));
        TEST_ASSERT_EQUAL_DOUBLE_MESSAGE(u, step->u[0], tl_test_scene_name(of));
        tl_test_scene_end(&scene);
    }
}

/* ---- wrong checkpoints ---- */

static void expect_not_loaded(tl_status status, const char *parts) {
    TEST_ASSERT_EQUAL_INT(status, tl_twin_load(run->twin, 20, bytes, size, &run->error));
    TL_EXPECT_PARTS(parts, run->error.text);
    tl_test_run_step(run);
    TEST_ASSERT_EQUAL_INT(status, run->status); /* the twin stays unusable */
}

static void test_bytes_that_end_too_soon_or_too_late(void) {
    char parts[64];
    run_whole(TL_SCENE_LAG, 20);
    size_t all = size;
    for (size = 0; size < all; size += size + 64 < all ? 37 : 1) {
        tl_test_scene_build(&scene, TL_SCENE_LAG);
        TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, tl_twin_load(run->twin, 20, bytes, size, &run->error));
        tl_test_scene_end(&scene);
    }
    size = all + 1;
    tl_test_scene_build(&scene, TL_SCENE_LAG);
    (void)snprintf(parts, sizeof parts, "checkpoint|%zu|%zu", size, all);
    expect_not_loaded(TL_BAD_DATA, parts);
    tl_test_scene_end(&scene);
}

static void test_bytes_of_another_twin(void) {
    run_whole(TL_SCENE_LAG, 20);
    tl_test_scene_build(&scene, TL_SCENE_FREE);
    expect_not_loaded(TL_BAD_DATA, "checkpoint|20");
    tl_test_scene_end(&scene);
    tl_test_scene_build(&scene, TL_SCENE_LAG);
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, tl_twin_load(run->twin, 21, bytes, size, &run->error));
    tl_test_scene_end(&scene);
    bytes[0] ^= 1;
    tl_test_scene_build(&scene, TL_SCENE_LAG);
    expect_not_loaded(TL_BAD_DATA, "checkpoint|20");
    tl_test_scene_end(&scene);
}

/* Changes a bit, a byte, or a word of eight bytes at a random place. */
static void damage(tl_test_random *random) {
    static const uint64_t words[] = {0,
                                     1,
                                     UINT64_MAX,
                                     INT64_MAX,
                                     (uint64_t)INT64_MIN,
                                     UINT64_C(0x7FF0000000000000), /* infinite */
                                     UINT64_C(0x7FF8000000000000), /* NaN */
                                     UINT64_C(0x7FEFFFFFFFFFFFFF),
                                     UINT64_C(0x0202020202020202),
                                     1000000};
    size_t at = tl_test_random_below(random, size);
    switch (tl_test_random_below(random, 3)) {
    case 0:
        bytes[at] ^= (unsigned char)(1U << tl_test_random_below(random, 8));
        break;
    case 1:
        bytes[at] = (unsigned char)tl_test_random_below(random, 256);
        break;
    default:
        at -= at % 8;
        if (at + 8 <= size) {
            memcpy(bytes + at, &words[tl_test_random_below(random, sizeof words / sizeof words[0])], 8);
        }
        break;
    }
}

/* An attacker can write the hash too. The twin rejects damaged bytes or continues in some state of
 * its own. Sanitizers check that it accesses no memory outside its buffers, and that flags are true
 * or false. */
static void test_damaged_bytes_do_no_harm(void) {
    enum { DAMAGED = 150, MORE = 12 };
    tl_test_random random = {20261122};
    size_t refused = 0;
    for (tl_test_scene_kind of = TL_SCENE_LAG; of < TL_SCENES; of++) {
        run_whole(of, 60);
        if (size == 0) {
            continue; /* TL_SCENE_LONG: an FMU would have to repeat steps */
        }
        unsigned char *whole_bytes = malloc(size);
        TEST_ASSERT_NOT_NULL(whole_bytes);
        memcpy(whole_bytes, bytes, size);
        for (int i = 0; i < DAMAGED; i++) {
            memcpy(bytes, whole_bytes, size);
            for (size_t k = tl_test_random_below(&random, 4) + 1; k > 0; k--) {
                damage(&random);
            }
            tl_test_scene_build(&scene, of);
            tl_status status = tl_twin_load(run->twin, 60, bytes, size, &run->error);
            refused += status == TL_BAD_DATA ? 1 : 0;
            TEST_ASSERT_NOT_EQUAL_INT(TL_BAD_USAGE, status);
            tl_test_scene_move(&scene, 61);
            for (int k = 0; k < MORE && status == TL_OK && run->status == TL_OK; k++) {
                tl_test_scene_show(&scene);
                tl_test_run_step(run);
            }
            tl_test_log_clear(&scene.log); /* an FMU with a damaged state may report violations */
            tl_test_scene_end(&scene);
        }
        free(whole_bytes);
    }
    TEST_ASSERT_GREATER_THAN_size_t(TL_SCENES * DAMAGED / 8, refused);
}

static void test_an_fmu_that_refuses_bytes(void) {
    run_whole(TL_SCENE_LAG, 20);
    tl_test_scene_build(&scene, TL_SCENE_LAG);
    tl_test_fmu_fail(&scene.fmus[1], TL_TEST_DESERIALIZE, TL_TEST_ERROR, 1, 1);
    expect_not_loaded(TL_FMU_FAILED, "b|fmi2DeSerializeFMUstate|fmi2Error");
    tl_test_scene_end(&scene);
    tl_test_scene_build(&scene, TL_SCENE_LAG);
    tl_test_fmu_fail(&scene.fmus[0], TL_TEST_DESERIALIZE, TL_TEST_FATAL, 1, 1);
    expect_not_loaded(TL_FMU_FATAL, "fmi2DeSerializeFMUstate|fmi2Fatal");
}

/* Saving fails, and the twin continues unchanged. */
static void test_an_fmu_that_refuses_to_be_saved(void) {
    static const tl_test_call calls[] = {TL_TEST_SERIALIZED_SIZE, TL_TEST_SERIALIZE};
    for (size_t i = 0; i < 2; i++) {
        run_whole(TL_SCENE_PLAIN, 20);
        tl_test_scene_build(&scene, TL_SCENE_PLAIN);
        search_to(50, part, in_part);
        tl_test_fmu_fail(&scene.fmus[1], calls[i], TL_TEST_ERROR, 1, 1);
        size_t needed = 0;
        TEST_ASSERT_EQUAL_INT(TL_FMU_FAILED, tl_twin_save(run->twin, bytes, size, &needed, &run->error));
        TEST_ASSERT_EQUAL_size_t(0, needed);
        search_to(TICKS - 1, part, in_part);
        tl_test_scene_end(&scene);
        expect_same_course(TL_SCENE_PLAIN, true);
    }
    tl_test_scene_build(&scene, TL_SCENE_LAG);
    search_to(20, part, in_part);
    tl_test_fmu_fail(&scene.fmus[1], TL_TEST_SERIALIZE, TL_TEST_FATAL, 1, 1);
    TEST_ASSERT_EQUAL_INT(TL_FMU_FATAL, tl_twin_save(run->twin, bytes, size, &size, &run->error));
    tl_test_run_step(run);
    TEST_ASSERT_EQUAL_INT(TL_FMU_FATAL, run->status);
}

/* An FMU that is not rolled back by its own states cannot be serialised. The twin finds that after
 * its start. */
static void lose_bytes(tl_test_fmu *fmu) {
    fmu->functions.serialized_fmu_state_size = NULL;
    fmu->functions.serialize_fmu_state = NULL;
    fmu->functions.deserialize_fmu_state = NULL;
}

static void test_an_fmu_that_cannot_be_serialised(void) {
    run_whole(TL_SCENE_PLAIN, 20);
    tl_test_scene_build(&scene, TL_SCENE_PLAIN);
    search_to(50, part, in_part);
    lose_bytes(&scene.fmus[1]);
    size_t needed = 0;
    TEST_ASSERT_EQUAL_INT(TL_FMU_FAILED, tl_twin_save(run->twin, bytes, size, &needed, &run->error));
    TL_EXPECT_PARTS("b|states", run->error.text);
    search_to(TICKS - 1, part, in_part);
    tl_test_scene_end(&scene);
    expect_same_course(TL_SCENE_PLAIN, true);
    tl_test_scene_build(&scene, TL_SCENE_PLAIN);
    lose_bytes(&scene.fmus[1]);
    expect_not_loaded(TL_FMU_FAILED, "b|states");
}

static void test_which_twins_can_be_saved(void) {
    tl_test_scene_build(&scene, TL_SCENE_LAG);
    TEST_ASSERT_TRUE(tl_twin_can_save(run->twin));
    save();
    TEST_ASSERT_EQUAL_size_t(0, size); /* no step yet */
    scene.fmus[1].model.capabilities.can_serialize_state = false;
    TEST_ASSERT_FALSE(tl_twin_can_save(run->twin));
    scene.fmus[1].model.capabilities.can_serialize_state = true;
    scene.fmus[1].functions.deserialize_fmu_state = NULL;
    TEST_ASSERT_FALSE(tl_twin_can_save(run->twin));
    tl_test_scene_end(&scene);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_a_loaded_twin_follows);
    RUN_TEST(test_a_new_twin_follows);
    RUN_TEST(test_a_loaded_twin_searches);
    RUN_TEST(test_following_and_searching_repeats);
    RUN_TEST(test_saving_changes_nothing);
    RUN_TEST(test_a_twin_starts_at_a_tick);
    RUN_TEST(test_the_first_step_uses_the_sample_of_its_instant);
    RUN_TEST(test_bytes_that_end_too_soon_or_too_late);
    RUN_TEST(test_bytes_of_another_twin);
    RUN_TEST(test_damaged_bytes_do_no_harm);
    RUN_TEST(test_an_fmu_that_refuses_bytes);
    RUN_TEST(test_an_fmu_that_refuses_to_be_saved);
    RUN_TEST(test_an_fmu_that_cannot_be_serialised);
    RUN_TEST(test_which_twins_can_be_saved);
    return UNITY_END();
}
