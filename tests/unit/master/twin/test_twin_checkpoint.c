/* A twin as bytes, and led along the u of an earlier run: the same to the bit as one that was never interrupted. */
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unity.h>

#include "tests/support/random_numbers.h"
#include "tests/support/test_plan.h"

enum { TICKS = 240, MATCHES = 1, FMUS = 2 };

static tl_test_log call_log;
static tl_test_fmu fmus[FMUS];
static tl_test_plan plan;
static tl_test_run run;

/* By step; of the run that was not interrupted, and of the one that is looked at. */
static tl_record whole[TICKS], part[TICKS];
static bool in_whole[TICKS], in_part[TICKS];

static bool forgetful; /* no solver that remembers */
static unsigned char *bytes;
static size_t size;

typedef enum scene {
    LAG,
    HOLD,
    AHEAD,
    DELAYS,
    AHEAD_OF_TIME, /* samples from before the instant are looked up */
    LONG,          /* a dynamic horizon; nothing but outputs is kept in its cache */
    PLAIN,         /* nothing is saved of executions */
    CONDITIONED,
    FLAG, /* a Boolean is adjusted */
    MEASURED,
    FREE, /* nothing is adjusted */
    STROKES,
    SCENES
} scene;

static const char *const SCENE_NAMES[SCENES] = {"lag",           "hold",     "ahead", "delays",
                                                "ahead of time", "long",     "plain", "conditioned",
                                                "flag",          "measured", "free",  "strokes"};

void setUp(void) {
    forgetful = false;
}

void tearDown(void) {
    tl_test_run_end(&run, &plan);
    free(bytes);
    bytes = NULL;
}

/* ---- scenes ---- */

static void vary_timing(scene of) {
    plan.plan.measurements = of == HOLD ? TL_HOLD : of == AHEAD ? TL_AHEAD : TL_LAG;
    plan.plan.input_ticks = of == DELAYS ? 2 : of == AHEAD_OF_TIME ? -3 : 0;
    plan.plan.output_ticks = of == DELAYS ? 4 : of == AHEAD_OF_TIME ? -2 : 0;
    if (of == MEASURED) {
        plan.plan.measure = (tl_plan_measure){.lags = 5, .range = 4 * plan.plan.step};
    }
}

static void vary_search(scene of) {
    plan.plan.saving = (tl_plan_saving){.structure = of != PLAIN, .sequences = of != PLAIN};
    bool black_box = forgetful || of == STROKES || of == PLAIN;
    plan.plan.algorithm = of == FLAG ? "boolean" : black_box ? "nelder-mead" : "secant";
    plan.plan.prediction = of == LONG ? 6 : 3;
    plan.plan.shape = of == LONG ? TL_DYNAMIC : TL_STATIC;
    plan.components[0].keep = of == LONG ? TL_KEEP_OUTPUTS : TL_KEEP_STATES;
    if (of == CONDITIONED) {
        plan.match[0].condition = (tl_plan_condition){.median = 5, .low_pass = TL_SECOND / 2, .gate = 2.5};
    }
}

/* "a" passes the plant's u on to "b", whose y[0] is matched by its offset, or by its flag. */
static void make(scene of) {
    bool strokes = of == STROKES;
    tl_test_plan_init(&plan, TL_SECOND / 10);
    for (size_t i = 0; i < FMUS; i++) {
        tl_test_fmu_init(&fmus[i], 1, true, &call_log);
        fmus[i].model.capabilities.can_serialize_state = true;
        fmus[i].control.ends = strokes && i == 1;
        fmus[i].control.telling = !strokes;
        tl_test_plan_component(&plan, i == 0 ? "a" : "b", &fmus[i]);
        tl_test_plan_set(&plan, "lag", strokes && i == 1 ? 1.0 : 0.3);
        tl_test_plan_set(&plan, "count", 0.0);
        tl_test_plan_set(&plan, "mode", 0.0);
        if (i == 0 || of != FLAG) {
            tl_test_plan_set_value(&plan, "flag", (tl_value){.type = TL_BOOLEAN});
        }
    }
    tl_test_plan_signal(&plan, "u", TL_REAL, "");
    tl_test_plan_signal(&plan, "y", strokes ? TL_BOOLEAN : TL_REAL, "");
    tl_test_plan_signal(&plan, "move", TL_BOOLEAN, "");
    tl_test_plan_connect(&plan, "plant.u", "a.u0");
    tl_test_plan_connect(&plan, "a.y0", "b.u0");
    tl_test_plan_match(&plan, strokes ? "b.flag_out" : "b.y0", "plant.y", strokes ? 1.0 : 0.01);
    if (of != FREE && of != MEASURED) {
        tl_test_plan_adjust(&plan, strokes ? "b.gain" : of == FLAG ? "b.flag" : "b.offset", of == FLAG ? 0.0 : 0.5);
    }
    if (strokes) {
        plan.adjust[0].lower = 0.1;
        plan.adjust[0].upper = 20.0;
        plan.plan.event = (tl_plan_event){.where = "event",
                                          .start = {"plant.move", false},
                                          .end = {"plant.y", false},
                                          .window = 8 * plan.plan.step,
                                          .longest = 60 * plan.plan.step};
    }
    vary_timing(of);
    vary_search(of);
    if (strokes) {
        plan.plan.prediction = 0;
    }
}

static void build(scene of) {
    make(of);
    tl_twin *twin = tl_test_plan_build(&plan);
    TEST_ASSERT_EQUAL_STRING_MESSAGE("", plan.problems[0].text, SCENE_NAMES[of]);
    tl_test_run_init(&run, twin);
    run.budget.evaluations = 20;
}

/* It looks like itself at no other time. */
static double wave(double at) {
    return sin(0.31 * at) + sin(0.173 * at + 1.0) + sin(0.057 * at);
}

/* What the plant shows: the same at any time, now and then not good, also for longer than any horizon. */
static void show_plant(scene of) {
    int64_t tick = run.sample.tick;
    double at = (double)tick;
    bool moves = tick % 80 >= 10 && tick % 80 < 60;
    run.sample.values[0] = of == STROKES ? (double)moves : of == MEASURED ? wave(at) : sin(0.9 * at);
    run.sample.values[1] = of == STROKES    ? (double)(moves && tick % 80 >= 22)
                           : of == MEASURED ? wave(at - 7.0)
                                            : 2.0 * cos(0.13 * at);
    run.sample.values[2] = (double)moves;
    uint64_t bits = tl_test_mix((uint64_t)tick);
    run.sample.quality[0] =
        (uint8_t)(of != MEASURED && (bits % 7 == 0 || (tick > 50 && tick < 75)) ? TL_STALE : TL_GOOD);
    run.sample.quality[1] = (uint8_t)(of != STROKES && of != MEASURED && bits % 11 == 0 ? TL_NO_LINK : TL_GOOD);
    run.sample.stamps[0] = run.sample.instant;
    run.sample.stamps[1] = run.sample.instant;
    run.sample.stamps[2] = run.sample.instant;
}

static void keep(tl_record *records, bool *there) {
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, run.status, run.error.text);
    if (run.ready && run.record.step < TICKS) {
        records[run.record.step] = run.record;
        there[run.record.step] = true;
    }
}

/* Searches to tick `to`, of which every thirteenth was missed. */
static void search_to(scene of, int64_t to, tl_record *records, bool *there) {
    while (run.sample.tick <= to) {
        show_plant(of);
        if (run.sample.tick % 13 == 12) {
            tl_test_run_make_up(&run);
        } else {
            tl_test_run_step(&run);
        }
        keep(records, there);
    }
}

/* The u of the whole run, to tick `to`. */
static void follow_to(scene of, int64_t to, tl_record *records, bool *there) {
    while (run.sample.tick <= to) {
        int64_t step = run.sample.tick - tl_twin_get_facts(run.twin).lead;
        show_plant(of);
        tl_test_run_follow(&run, step < 0 ? NULL : whole[step].u);
        keep(records, there);
    }
}

static void forget(void) {
    memset(in_whole, 0, sizeof in_whole);
    memset(in_part, 0, sizeof in_part);
}

static void save(void) {
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_twin_save(run.twin, NULL, 0, &size, &run.error));
    free(bytes);
    bytes = calloc(size + 1, 1); /* one more, to be one too many */
    TEST_ASSERT_NOT_NULL(bytes);
    if (size != 0) {
        size_t needed = size;
        TEST_ASSERT_EQUAL_INT(TL_OK, tl_twin_save(run.twin, bytes, size, &size, &run.error));
        TEST_ASSERT_EQUAL_size_t(needed, size);
    }
}

/* A new twin with the bytes of `tick`. */
static void load(scene of, int64_t tick) {
    build(of);
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_twin_load(run.twin, tick, bytes, size, &run.error), run.error.text);
    run.sample.tick = tick + 1;
    run.sample.instant = (tick + 1) * plan.plan.step;
}

static void expect_same_bits(const double *wanted, const double *found, size_t count, const char *what) {
    TEST_ASSERT_TRUE_MESSAGE(memcmp(wanted, found, count * sizeof *wanted) == 0, what);
}

static void expect_same_course(scene of, bool with_measurement) {
    size_t compared = 0;
    for (int64_t step = 0; step < TICKS; step++) {
        if (!in_part[step] || !in_whole[step]) {
            continue;
        }
        const char *what = SCENE_NAMES[of];
        compared++;
        expect_same_bits(whole[step].y, part[step].y, MATCHES, what);
        expect_same_bits(whole[step].u, part[step].u, plan.plan.adjust_count, what);
        expect_same_bits(whole[step].u_hat, part[step].u_hat, plan.plan.adjust_count, what);
        if (with_measurement) {
            expect_same_bits(whole[step].y_hat, part[step].y_hat, MATCHES, what);
            TEST_ASSERT_EQUAL_UINT8_MESSAGE(whole[step].y_hat_quality[0], part[step].y_hat_quality[0], what);
            TEST_ASSERT_EQUAL_INT64_MESSAGE(whole[step].delay, part[step].delay, what);
        }
    }
    TEST_ASSERT_GREATER_THAN_size_t_MESSAGE(20, compared, SCENE_NAMES[of]);
}

/* ---- the same ---- */

/* In an event horizon the winner of a search takes the twin's place: only one that follows as well can be the same. */
static void run_whole(scene of, int64_t saved_at) {
    forget();
    build(of);
    search_to(of, saved_at, whole, in_whole);
    save();
    search_to(of, TICKS - 1, whole, in_whole);
    tl_test_run_end(&run, &plan);
    if (of == STROKES) {
        build(of);
        search_to(of, saved_at, part, in_part);
        follow_to(of, TICKS - 1, whole, in_whole);
        tl_test_run_end(&run, &plan);
        memset(in_part, 0, sizeof in_part);
    }
}

static void test_loaded_and_led_along(void) {
    static const int64_t ticks[] = {8, 9, 30, 60, 77, 131, 199};
    for (scene of = LAG; of < SCENES; of++) {
        for (size_t i = 0; i < sizeof ticks / sizeof ticks[0]; i++) {
            run_whole(of, ticks[i]);
            if (size == 0) {
                TEST_ASSERT_EQUAL_INT(LONG, of); /* an FMU would have to be executed again */
                continue;
            }
            load(of, ticks[i]);
            follow_to(of, TICKS - 1, part, in_part);
            tl_test_run_end(&run, &plan);
            expect_same_course(of, true);
            TEST_ASSERT_EQUAL_INT(TL_FOLLOWED, part[TICKS - 12].outcome);
        }
    }
}

static void test_led_along_from_the_start(void) {
    for (scene of = LAG; of < STROKES; of++) {
        run_whole(of, 20);
        build(of);
        follow_to(of, TICKS - 1, part, in_part);
        tl_test_run_end(&run, &plan);
        expect_same_course(of, true);
    }
}

/* Loaded, and searched on at once, with solvers that begin every search with an empty head anyway: nothing shows that it was
 * interrupted. Of strokes only between two of them. */
static void test_loaded_and_searched_on(void) {
    static const int64_t ticks[] = {9, 24, 60, 78, 131, 158}; /* the one after 24 is missed */
    forgetful = true;
    for (scene of = LAG; of < SCENES; of++) {
        for (size_t i = 0; i < sizeof ticks / sizeof ticks[0]; i++) {
            if ((of == STROKES && ticks[i] % 80 != 78) || of == LONG) {
                continue;
            }
            forget();
            build(of);
            search_to(of, ticks[i], whole, in_whole);
            save();
            search_to(of, TICKS - 1, whole, in_whole);
            tl_test_run_end(&run, &plan);
            load(of, ticks[i]);
            search_to(of, TICKS - 1, part, in_part);
            tl_test_run_end(&run, &plan);
            expect_same_course(of, true);
            TEST_ASSERT_TRUE(of != MEASURED || whole[TICKS - 20].delay != 0); /* it has been found */
            for (int64_t step = ticks[i] + 1; step < TICKS; step++) {
                bool both = in_part[step] && in_whole[step];
                TEST_ASSERT_TRUE_MESSAGE(!both || whole[step].evaluations == part[step].evaluations, SCENE_NAMES[of]);
                TEST_ASSERT_TRUE_MESSAGE(!both || whole[step].outcome == part[step].outcome, SCENE_NAMES[of]);
            }
        }
    }
}

/* After it was led along it searches on; to do so twice gives the same twice, effort included, and as much as the ledger says. */
static void test_it_goes_on_and_repeats(void) {
    for (scene of = LAG; of < SCENES; of++) {
        static tl_record first[TICKS];
        run_whole(of, 77);
        for (int again = 0; again < 2 && size != 0; again++) {
            memcpy(first, part, sizeof first);
            memset(in_part, 0, sizeof in_part);
            load(of, 77);
            follow_to(of, 130, part, in_part);
            search_to(of, TICKS - 1, part, in_part);
            for (size_t k = 0; k < tl_twin_get_facts(run.twin).components; k++) {
                TEST_ASSERT_EQUAL_INT64_MESSAGE(0, tl_twin_get_ledger(run.twin, k).difference, SCENE_NAMES[of]);
            }
            tl_test_run_end(&run, &plan);
        }
        for (int64_t step = 0; step < TICKS && size != 0; step++) {
            if (in_part[step]) {
                expect_same_bits(first[step].y, part[step].y, MATCHES, SCENE_NAMES[of]);
                TEST_ASSERT_EQUAL_UINT32(first[step].executions, part[step].executions);
                TEST_ASSERT_EQUAL_UINT32(first[step].evaluations, part[step].evaluations);
            }
        }
    }
}

/* Whoever saves all the time has the same twin, and executes as much. */
static void test_saving_changes_nothing(void) {
    for (scene of = LAG; of < SCENES; of++) {
        run_whole(of, 20);
        bool follows = of == STROKES;
        build(of);
        while (run.sample.tick < TICKS) {
            int64_t tick = run.sample.tick;
            if (follows && tick > 20) {
                follow_to(of, tick, part, in_part);
            } else {
                search_to(of, tick, part, in_part);
            }
            save();
        }
        tl_test_run_end(&run, &plan);
        expect_same_course(of, true);
        for (int64_t step = 0; step < TICKS && of != LONG;
             step++) { /* there an FMU may have a longer way to catch up */
            TEST_ASSERT_EQUAL_UINT32(whole[step].executions * in_part[step], part[step].executions * in_part[step]);
        }
    }
}

/* ---- in the middle, from start values ---- */

static void test_begun_at_a_tick(void) {
    for (scene of = LAG; of < SCENES; of++) {
        int64_t age = of == AHEAD_OF_TIME ? 3 : of == MEASURED ? 4 : 0;
        forget();
        build(of);
        tl_twin_begin_at(run.twin, 100);
        run.sample.tick = 100;
        run.sample.instant = 100 * plan.plan.step;
        TEST_ASSERT_EQUAL_INT64(100 + age, tl_twin_get_facts(run.twin).first);
        search_to(of, TICKS - 1, part, in_part);
        for (int64_t step = 0; step < 180; step++) { /* of a lead of a few ticks */
            TEST_ASSERT_EQUAL_INT_MESSAGE(step >= 100 + age, in_part[step], SCENE_NAMES[of]);
        }
        bool set_up = false;
        for (size_t i = 0; i < call_log.count && i < TL_TEST_ENTRIES; i++) {
            const tl_test_entry *entry = &call_log.entries[i];
            if (entry->call == TL_TEST_SETUP_EXPERIMENT) {
                set_up = true;
                TEST_ASSERT_EQUAL_DOUBLE(0.1 * (double)(100 + age), entry->time);
            }
        }
        TEST_ASSERT_TRUE(set_up);
        tl_test_run_end(&run, &plan);
        tl_test_log_clear(&call_log);
    }
}

/* ---- what is not right ---- */

static void expect_not_loaded(tl_status status, const char *words) {
    TEST_ASSERT_EQUAL_INT(status, tl_twin_load(run.twin, 20, bytes, size, &run.error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(run.error.text, words), run.error.text);
    tl_test_run_step(&run);
    TEST_ASSERT_EQUAL_INT(status, run.status); /* it is of no use any more */
}

static void test_bytes_that_end_too_soon_or_too_late(void) {
    run_whole(CONDITIONED, 20);
    size_t all = size;
    for (size = 0; size < all; size += size + 64 < all ? 37 : 1) {
        build(CONDITIONED);
        TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, tl_twin_load(run.twin, 20, bytes, size, &run.error));
        tl_test_run_end(&run, &plan);
    }
    size = all + 1;
    build(CONDITIONED);
    expect_not_loaded(TL_BAD_DATA, "bytes where");
    tl_test_run_end(&run, &plan);
}

static void test_bytes_of_another_twin(void) {
    run_whole(LAG, 20);
    build(FREE);
    expect_not_loaded(TL_BAD_DATA, "is not of this twin");
    tl_test_run_end(&run, &plan);
    build(LAG);
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, tl_twin_load(run.twin, 21, bytes, size, &run.error));
    tl_test_run_end(&run, &plan);
    bytes[0] ^= 1;
    build(LAG);
    expect_not_loaded(TL_BAD_DATA, "is not of this twin at tick 20");
    tl_test_run_end(&run, &plan);
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
    for (scene of = LAG; of < SCENES; of++) {
        run_whole(of, 60);
        if (size == 0) {
            continue; /* LONG: an FMU would have to be executed again */
        }
        unsigned char *whole_bytes = malloc(size);
        TEST_ASSERT_NOT_NULL(whole_bytes);
        memcpy(whole_bytes, bytes, size);
        for (int i = 0; i < DAMAGED; i++) {
            memcpy(bytes, whole_bytes, size);
            for (size_t k = tl_test_random_below(&random, 4) + 1; k > 0; k--) {
                damage(&random);
            }
            build(of);
            tl_status status = tl_twin_load(run.twin, 60, bytes, size, &run.error);
            refused += status == TL_BAD_DATA ? 1 : 0;
            TEST_ASSERT_NOT_EQUAL_INT(TL_BAD_USAGE, status);
            run.sample.tick = 61;
            run.sample.instant = 61 * plan.plan.step;
            for (int k = 0; k < MORE && status == TL_OK && run.status == TL_OK; k++) {
                show_plant(of);
                tl_test_run_step(&run);
            }
            tl_test_log_clear(&call_log); /* an FMU whose own state was damaged says what it likes */
            tl_test_run_end(&run, &plan);
        }
        free(whole_bytes);
    }
    TEST_ASSERT_GREATER_THAN_size_t(SCENES * DAMAGED / 8, refused);
}

static void test_an_fmu_that_refuses_bytes(void) {
    run_whole(LAG, 20);
    build(LAG);
    tl_test_fmu_fail(&fmus[1], TL_TEST_DESERIALIZE, TL_TEST_ERROR, 1, 1);
    expect_not_loaded(TL_FMU_FAILED, "fmi2DeSerializeFMUstate");
    tl_test_run_end(&run, &plan);
    build(LAG);
    tl_test_fmu_fail(&fmus[0], TL_TEST_DESERIALIZE, TL_TEST_FATAL, 1, 1);
    expect_not_loaded(TL_FMU_FATAL, "fmi2DeSerializeFMUstate");
}

/* It says so, and goes on as if it had not been asked. */
static void test_an_fmu_that_refuses_to_be_saved(void) {
    static const tl_test_call calls[] = {TL_TEST_SERIALIZED_SIZE, TL_TEST_SERIALIZE};
    for (size_t i = 0; i < 2; i++) {
        run_whole(PLAIN, 20);
        build(PLAIN);
        search_to(PLAIN, 50, part, in_part);
        tl_test_fmu_fail(&fmus[1], calls[i], TL_TEST_ERROR, 1, 1);
        size_t needed = 0;
        TEST_ASSERT_EQUAL_INT(TL_FMU_FAILED, tl_twin_save(run.twin, bytes, size, &needed, &run.error));
        TEST_ASSERT_EQUAL_size_t(0, needed);
        search_to(PLAIN, TICKS - 1, part, in_part);
        tl_test_run_end(&run, &plan);
        expect_same_course(PLAIN, true);
    }
    build(LAG);
    search_to(LAG, 20, part, in_part);
    tl_test_fmu_fail(&fmus[1], TL_TEST_SERIALIZE, TL_TEST_FATAL, 1, 1);
    TEST_ASSERT_EQUAL_INT(TL_FMU_FATAL, tl_twin_save(run.twin, bytes, size, &size, &run.error));
    tl_test_run_step(&run);
    TEST_ASSERT_EQUAL_INT(TL_FMU_FATAL, run.status);
}

static void test_what_can_be_saved(void) {
    build(LAG);
    TEST_ASSERT_TRUE(tl_twin_can_save(run.twin));
    save();
    TEST_ASSERT_EQUAL_size_t(0, size); /* nothing has begun */
    fmus[1].model.capabilities.can_serialize_state = false;
    TEST_ASSERT_FALSE(tl_twin_can_save(run.twin));
    fmus[1].model.capabilities.can_serialize_state = true;
    fmus[1].functions.deserialize_fmu_state = NULL;
    TEST_ASSERT_FALSE(tl_twin_can_save(run.twin));
    tl_test_run_end(&run, &plan);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_loaded_and_led_along);
    RUN_TEST(test_led_along_from_the_start);
    RUN_TEST(test_loaded_and_searched_on);
    RUN_TEST(test_it_goes_on_and_repeats);
    RUN_TEST(test_saving_changes_nothing);
    RUN_TEST(test_begun_at_a_tick);
    RUN_TEST(test_bytes_that_end_too_soon_or_too_late);
    RUN_TEST(test_bytes_of_another_twin);
    RUN_TEST(test_bytes_that_were_made_to_do_harm);
    RUN_TEST(test_an_fmu_that_refuses_bytes);
    RUN_TEST(test_an_fmu_that_refuses_to_be_saved);
    RUN_TEST(test_what_can_be_saved);
    return UNITY_END();
}
