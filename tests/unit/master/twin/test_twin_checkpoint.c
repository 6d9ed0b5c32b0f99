/* A twin as bytes, and led along the u of an earlier run: the same to the bit as one that was never interrupted. */
#include <stdlib.h>
#include <string.h>
#include <unity.h>

#include "tests/support/random_numbers.h"
#include "tests/support/test_scene.h"

enum { TICKS = 240 };

static tl_test_scene scene;
static tl_test_run *const run = &scene.run;

/* By step; of the run that was not interrupted, and of the one that is looked at. */
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

/* Searches to tick `to`, of which every thirteenth was missed. */
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

/* The u of the whole run, to tick `to`. */
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
    bytes = calloc(size + 1, 1); /* one more, to be one too many */
    TEST_ASSERT_NOT_NULL(bytes);
    if (size != 0) {
        size_t needed = size;
        TEST_ASSERT_EQUAL_INT(TL_OK, tl_twin_save(run->twin, bytes, size, &size, &run->error));
        TEST_ASSERT_EQUAL_size_t(needed, size);
    }
}

/* A new twin with the bytes of `tick`. */
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

/* ---- the same ---- */

/* In an event horizon the winner of a search takes the twin's place: only one that follows as well can be the same. */
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

static void test_loaded_and_led_along(void) {
    static const int64_t ticks[] = {8, 9, 30, 60, 77, 131, 199};
    for (tl_test_scene_kind of = TL_SCENE_LAG; of < TL_SCENES; of++) {
        for (size_t i = 0; i < sizeof ticks / sizeof ticks[0]; i++) {
            run_whole(of, ticks[i]);
            if (size == 0) {
                TEST_ASSERT_EQUAL_INT(TL_SCENE_LONG, of); /* an FMU would have to be executed again */
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

static void test_led_along_from_the_start(void) {
    for (tl_test_scene_kind of = TL_SCENE_LAG; of < TL_SCENE_STROKES; of++) {
        run_whole(of, 20);
        tl_test_scene_build(&scene, of);
        follow_to(TICKS - 1, part, in_part);
        tl_test_scene_end(&scene);
        expect_same_course(of, true);
    }
}

/* Loaded, and searched on at once, with solvers that begin every search with an empty head anyway: nothing shows that it was
 * interrupted. Of strokes only between two of them. */
static void test_loaded_and_searched_on(void) {
    static const int64_t ticks[] = {9, 24, 60, 78, 131, 158}; /* the one after 24 is missed */
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
            TEST_ASSERT_TRUE(of != TL_SCENE_MEASURED || whole[TICKS - 20].delay != 0); /* it has been found */
            for (int64_t step = ticks[i] + 1; step < TICKS; step++) {
                bool both = in_part[step] && in_whole[step];
                TEST_ASSERT_TRUE_MESSAGE(!both || whole[step].evaluations == part[step].evaluations,
                                         tl_test_scene_name(of));
                TEST_ASSERT_TRUE_MESSAGE(!both || whole[step].outcome == part[step].outcome, tl_test_scene_name(of));
            }
        }
    }
}

/* After it was led along it searches on; to do so twice gives the same twice, effort included, and as much as the ledger says. */
static void test_it_goes_on_and_repeats(void) {
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

/* Whoever saves all the time has the same twin, and executes as much. */
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
        for (int64_t step = 0; step < TICKS && of != TL_SCENE_LONG;
             step++) { /* there an FMU may have a longer way to catch up */
            TEST_ASSERT_EQUAL_UINT32(whole[step].executions * in_part[step], part[step].executions * in_part[step]);
        }
    }
}

/* ---- in the middle, from start values ---- */

static void test_begun_at_a_tick(void) {
    for (tl_test_scene_kind of = TL_SCENE_LAG; of < TL_SCENES; of++) {
        int64_t age = tl_test_scene_age(of);
        forget();
        tl_test_scene_build(&scene, of);
        tl_twin_begin_at(run->twin, 100);
        tl_test_scene_move(&scene, 100);
        TEST_ASSERT_EQUAL_INT64(100 + age, tl_twin_get_facts(run->twin).first);
        search_to(TICKS - 1, part, in_part);
        for (int64_t step = 0; step < 180; step++) { /* of a lead of a few ticks */
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

/* Where older samples are looked up, that which is shown at the first instant is not the newest. */
static void test_it_begins_with_what_the_plant_shows_then(void) {
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

/* ---- what is not right ---- */

static void expect_not_loaded(tl_status status, const char *words) {
    TEST_ASSERT_EQUAL_INT(status, tl_twin_load(run->twin, 20, bytes, size, &run->error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(run->error.text, words), run->error.text);
    tl_test_run_step(run);
    TEST_ASSERT_EQUAL_INT(status, run->status); /* it is of no use any more */
}

static void test_bytes_that_end_too_soon_or_too_late(void) {
    run_whole(TL_SCENE_LAG, 20);
    size_t all = size;
    for (size = 0; size < all; size += size + 64 < all ? 37 : 1) {
        tl_test_scene_build(&scene, TL_SCENE_LAG);
        TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, tl_twin_load(run->twin, 20, bytes, size, &run->error));
        tl_test_scene_end(&scene);
    }
    size = all + 1;
    tl_test_scene_build(&scene, TL_SCENE_LAG);
    expect_not_loaded(TL_BAD_DATA, "bytes where");
    tl_test_scene_end(&scene);
}

static void test_bytes_of_another_twin(void) {
    run_whole(TL_SCENE_LAG, 20);
    tl_test_scene_build(&scene, TL_SCENE_FREE);
    expect_not_loaded(TL_BAD_DATA, "is not of this twin");
    tl_test_scene_end(&scene);
    tl_test_scene_build(&scene, TL_SCENE_LAG);
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, tl_twin_load(run->twin, 21, bytes, size, &run->error));
    tl_test_scene_end(&scene);
    bytes[0] ^= 1;
    tl_test_scene_build(&scene, TL_SCENE_LAG);
    expect_not_loaded(TL_BAD_DATA, "is not of this twin at tick 20");
    tl_test_scene_end(&scene);
}

/* Somewhere in the bytes: a bit, a byte, or a word of eight that is the worst there is. */
static void damage(tl_test_random *random) {
    static const uint64_t words[] = {0,
                                     1,
                                     UINT64_MAX,
                                     INT64_MAX,
                                     (uint64_t)INT64_MIN,
                                     UINT64_C(0x7FF0000000000000), /* infinite */
                                     UINT64_C(0x7FF8000000000000), /* no number */
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

/* Whoever can write the bytes can write their hash too. They are refused, or the twin goes on in some state of its own: nothing is
 * read or written beside what is there, and no flag is neither true nor false (the sanitizers look). */
static void test_bytes_that_were_made_to_do_harm(void) {
    enum { DAMAGED = 150, MORE = 12 };
    tl_test_random random = {20261122};
    size_t refused = 0;
    for (tl_test_scene_kind of = TL_SCENE_LAG; of < TL_SCENES; of++) {
        run_whole(of, 60);
        if (size == 0) {
            continue; /* TL_SCENE_LONG: an FMU would have to be executed again */
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
            tl_test_log_clear(&scene.log); /* an FMU whose own state was damaged says what it likes */
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
    expect_not_loaded(TL_FMU_FAILED, "fmi2DeSerializeFMUstate");
    tl_test_scene_end(&scene);
    tl_test_scene_build(&scene, TL_SCENE_LAG);
    tl_test_fmu_fail(&scene.fmus[0], TL_TEST_DESERIALIZE, TL_TEST_FATAL, 1, 1);
    expect_not_loaded(TL_FMU_FATAL, "fmi2DeSerializeFMUstate");
}

/* It says so, and goes on as if it had not been asked. */
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

/* One that goes another way than by its own states has no bytes any more; it is found out when the twin has begun. */
static void lose_bytes(tl_test_fmu *fmu) {
    fmu->functions.serialized_fmu_state_size = NULL;
    fmu->functions.serialize_fmu_state = NULL;
    fmu->functions.deserialize_fmu_state = NULL;
}

static void test_an_fmu_that_has_no_bytes_any_more(void) {
    run_whole(TL_SCENE_PLAIN, 20);
    tl_test_scene_build(&scene, TL_SCENE_PLAIN);
    search_to(50, part, in_part);
    lose_bytes(&scene.fmus[1]);
    size_t needed = 0;
    TEST_ASSERT_EQUAL_INT(TL_FMU_FAILED, tl_twin_save(run->twin, bytes, size, &needed, &run->error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(run->error.text, "only these can be turned into bytes"), run->error.text);
    search_to(TICKS - 1, part, in_part);
    tl_test_scene_end(&scene);
    expect_same_course(TL_SCENE_PLAIN, true);
    tl_test_scene_build(&scene, TL_SCENE_PLAIN);
    lose_bytes(&scene.fmus[1]);
    expect_not_loaded(TL_FMU_FAILED, "only these can be turned into bytes");
}

static void test_what_can_be_saved(void) {
    tl_test_scene_build(&scene, TL_SCENE_LAG);
    TEST_ASSERT_TRUE(tl_twin_can_save(run->twin));
    save();
    TEST_ASSERT_EQUAL_size_t(0, size); /* nothing has begun */
    scene.fmus[1].model.capabilities.can_serialize_state = false;
    TEST_ASSERT_FALSE(tl_twin_can_save(run->twin));
    scene.fmus[1].model.capabilities.can_serialize_state = true;
    scene.fmus[1].functions.deserialize_fmu_state = NULL;
    TEST_ASSERT_FALSE(tl_twin_can_save(run->twin));
    tl_test_scene_end(&scene);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_loaded_and_led_along);
    RUN_TEST(test_led_along_from_the_start);
    RUN_TEST(test_loaded_and_searched_on);
    RUN_TEST(test_it_goes_on_and_repeats);
    RUN_TEST(test_saving_changes_nothing);
    RUN_TEST(test_begun_at_a_tick);
    RUN_TEST(test_it_begins_with_what_the_plant_shows_then);
    RUN_TEST(test_bytes_that_end_too_soon_or_too_late);
    RUN_TEST(test_bytes_of_another_twin);
    RUN_TEST(test_bytes_that_were_made_to_do_harm);
    RUN_TEST(test_an_fmu_that_refuses_bytes);
    RUN_TEST(test_an_fmu_that_refuses_to_be_saved);
    RUN_TEST(test_an_fmu_that_has_no_bytes_any_more);
    RUN_TEST(test_what_can_be_saved);
    return UNITY_END();
}
