/* A twin whose FMUs are reset during its run: it behaves as one that starts there, at a known cost,
 * also if FMUs fail. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include <unity.h>

#include "tests/support/message.h"
#include "tests/support/random_network.h"
#include "tests/support/random_numbers.h"
#include "tests/support/test_scene.h"

enum { TICKS = 240, RESETS = 7, ANEW = 150 /* between two strokes */ };

static tl_test_scene scene;
static tl_test_run *const run = &scene.run;

/* Resets before these ticks: two in a row, one at a missed tick (155), and one after a long time
 * without good signals. */
static const int64_t resets[RESETS] = {30, 31, 75, 112, 155, 190, 203};

/* By step: the reference run, and the run under test. */
static tl_record wanted[TICKS], found[TICKS];
static bool in_wanted[TICKS], in_found[TICKS];

/* ---- a random network, which fills the caches of the FMUs ---- */

static tl_test_log network_log;
static tl_test_plan network_plan;
static tl_test_network network;

static void (*before_tick)(int64_t tick); /* NULL: none */
static bool unsearched;

void setUp(void) {
    scene.forgetful = false;
    scene.unsaved = false;
    scene.good = false;
    scene.still = false;
    scene.shortest = false;
    before_tick = NULL;
    unsearched = false;
    memset(in_wanted, 0, sizeof in_wanted);
    memset(in_found, 0, sizeof in_found);
}

void tearDown(void) {
    tl_test_scene_end(&scene);
    tl_test_network_end(&network);
}

static bool is_reset(int64_t tick) {
    bool is = false;
    for (size_t i = 0; i < RESETS; i++) {
        is = is || resets[i] == tick;
    }
    return is;
}

static void reset_often(int64_t tick) {
    if (is_reset(tick)) {
        tl_twin_reset(run->twin);
    }
}

static void keep(tl_record *records, bool *there) {
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, run->status, run->error.text);
    if (run->ready) {
        records[run->record.step] = run->record;
        there[run->record.step] = true;
    }
}

/* If `unsearched`, all ticks from ANEW on are missed. */
static bool is_missed(int64_t tick) {
    return tick % 13 == 12 || (unsearched && tick >= ANEW);
}

static void tick_once(tl_record *records, bool *there) {
    int64_t tick = run->sample.tick;
    tl_test_scene_show(&scene);
    if (before_tick != NULL) {
        before_tick(tick);
    }
    if (is_missed(tick)) {
        tl_test_run_catch_up(run);
    } else {
        tl_test_run_step(run);
    }
    keep(records, there);
}

static void run_to(int64_t last, tl_record *records, bool *there) {
    while (run->sample.tick <= last) {
        tick_once(records, there);
    }
}

static void expect_exact_ledger(void) {
    TEST_ASSERT_TRUE(tl_twin_ledger_is_complete(run->twin));
    for (size_t k = 0; k < tl_twin_get_facts(run->twin).components; k++) {
        TEST_ASSERT_EQUAL_INT64_MESSAGE(0, tl_twin_get_ledger(run->twin, k).difference, tl_test_scene_name(scene.kind));
    }
}

static void expect_same_bits(const double *a, const double *b, size_t count, const char *what) {
    TEST_ASSERT_TRUE_MESSAGE(memcmp(a, b, count * sizeof *a) == 0, what);
}

/* Compares the committed values, and the search if `searched`. */
static void expect_same_step(int64_t step, bool searched, bool measured) {
    const tl_record *a = &wanted[step];
    const tl_record *b = &found[step];
    char what[64];
    (void)snprintf(what, sizeof what, "%s, step %d", tl_test_scene_name(scene.kind), (int)step);
    expect_same_bits(a->y, b->y, TL_SCENE_MATCHES, what);
    expect_same_bits(a->u, b->u, scene.plan.plan.adjust_count, what);
    expect_same_bits(a->nominal, b->nominal, scene.plan.plan.adjust_count, what);
    if (measured) {
        expect_same_bits(a->measured, b->measured, TL_SCENE_MATCHES, what);
    }
    if (searched) {
        expect_same_bits(&a->objective, &b->objective, 1, what);
        TEST_ASSERT_EQUAL_INT_MESSAGE(a->outcome, b->outcome, what);
        TEST_ASSERT_EQUAL_UINT32_MESSAGE(a->evaluations, b->evaluations, what);
    }
}

static size_t expect_same_steps(int64_t from, bool searched, bool measured) {
    size_t compared = 0;
    for (int64_t step = from; step < TICKS; step++) {
        if (in_wanted[step] && in_found[step]) {
            expect_same_step(step, searched, measured);
            compared++;
        }
    }
    return compared;
}

/* ---- compared with a twin that starts there ---- */

static void reset_once(int64_t tick) {
    if (tick == ANEW) {
        tl_twin_reset(run->twin);
    }
}

/* Runs a twin that is reset at ANEW, and one that starts with that step. */
static void run_both(tl_test_scene_kind of) {
    before_tick = reset_once;
    tl_test_scene_build(&scene, of);
    int64_t first = ANEW - (int64_t)tl_twin_get_facts(run->twin).lead;
    run_to(TICKS - 1, found, in_found);
    expect_exact_ledger();
    tl_test_scene_end(&scene);
    before_tick = NULL;
    tl_test_scene_build(&scene, of);
    tl_twin_begin_at(run->twin, first - tl_test_scene_age(of));
    tl_test_scene_move(&scene, first - tl_test_scene_age(of));
    TEST_ASSERT_EQUAL_INT64(first, tl_twin_get_facts(run->twin).first);
    run_to(TICKS - 1, wanted, in_wanted);
    tl_test_scene_end(&scene);
    for (int64_t step = 0; step < TICKS; step++) {
        bool flagged = in_found[step] && (found[step].flags & TL_FLAG_RESET) != 0;
        TEST_ASSERT_EQUAL_INT_MESSAGE(step == first, flagged, tl_test_scene_name(of));
    }
}

/* The number of steps that are compared and equal. */
static size_t count_same(tl_test_scene_kind of, bool searched) {
    memset(in_found, 0, sizeof in_found);
    memset(in_wanted, 0, sizeof in_wanted);
    run_both(of);
    return expect_same_steps(0, searched, of != TL_SCENE_MEASURED);
}

/* All signals are good; otherwise the values held for bad signals would differ. */
static void test_equal_without_a_search(void) {
    scene.good = true;
    unsearched = true;
    for (tl_test_scene_kind of = TL_SCENE_LAG; of < TL_SCENES; of++) {
        TEST_ASSERT_GREATER_OR_EQUAL_size_t(TICKS - ANEW - 1, count_same(of, false));
    }
}

static void test_equal_with_a_solver_without_memory(void) {
    scene.good = true;
    scene.forgetful = true;
    for (tl_test_scene_kind of = TL_SCENE_LAG; of < TL_SCENES; of++) {
        TEST_ASSERT_GREATER_OR_EQUAL_size_t(TICKS - ANEW - 1, count_same(of, true));
    }
}

/* Without noise, because the noise estimates of the two runs would differ. */
static void test_equal_with_a_solver_with_memory(void) {
    scene.good = true;
    scene.still = true;
    for (int i = 0; i < 2; i++) {
        scene.shortest = i == 1;
        for (tl_test_scene_kind of = TL_SCENE_LAG; of < TL_SCENES; of++) {
            TEST_ASSERT_GREATER_OR_EQUAL_size_t(TICKS - ANEW - 1, count_same(of, true));
        }
    }
}

/* FMUs with feed-through settle from their start values, not from the values before the reset. The
 * plant changes u at this instant. */
static void test_feed_through_settles_from_the_start_values(void) {
    double y[2] = {0.0, 0.0};
    for (size_t i = 0; i < 2; i++) {
        tl_test_scene_build(&scene, TL_SCENE_FREE);
        int64_t lead = tl_twin_get_facts(run->twin).lead;
        for (size_t k = 0; k < TL_SCENE_FMUS; k++) {
            scene.fmus[k].control.feed_through = true;
            scene.fmus[k].control.telling = false;
        }
        if (i == 1) {
            tl_twin_begin_at(run->twin, ANEW - lead);
            tl_test_scene_move(&scene, ANEW - lead);
        }
        while (run->sample.tick <= ANEW) {
            run->sample.values[0] = run->sample.tick < ANEW - lead ? 0.0 : 2.0;
            reset_once(i == 0 ? run->sample.tick : 0);
            tl_test_run_step(run);
        }
        TEST_ASSERT_EQUAL_INT64(ANEW - lead, run->record.step);
        y[i] = run->record.y[0];
        tl_test_scene_end(&scene);
    }
    TEST_ASSERT_EQUAL_DOUBLE(2.0, y[1]);
    TEST_ASSERT_EQUAL_DOUBLE(2.0, y[0]);
}

/* ---- with each kind of saving ---- */

static void test_saving_changes_no_bit(void) {
    before_tick = reset_often;
    for (tl_test_scene_kind of = TL_SCENE_LAG; of < TL_SCENE_STROKES; of++) {
        scene.unsaved = false;
        tl_test_scene_build(&scene, of);
        run_to(TICKS - 1, found, in_found);
        expect_exact_ledger();
        tl_test_scene_end(&scene);
        scene.unsaved = true;
        tl_test_scene_build(&scene, of);
        run_to(TICKS - 1, wanted, in_wanted);
        expect_exact_ledger();
        tl_test_scene_end(&scene);
        TEST_ASSERT_GREATER_THAN_size_t(TICKS - 20, expect_same_steps(0, true, true));
    }
}

enum { NETWORKS = 40, NETWORK_TICKS = 30 };

static double fit(double value, tl_type type) {
    return type == TL_REAL ? value : type == TL_INTEGER ? floor(4.0 * value) : (double)(value > 0.5);
}

/* Runs a random network; returns a hash of its outputs. */
static uint64_t run_network(uint64_t seed, const tl_plan_saving *saving) {
    static const tl_pairing modes[] = {TL_LAG, TL_AHEAD, TL_HOLD};
    tl_test_random random = {tl_test_mix(seed)};
    tl_test_run one = {0};
    uint64_t sum = 0;
    tl_test_random_network(&network, &network_plan, &network_log, &random, true);
    network_plan.plan.prediction = tl_test_network_least(&network) + (uint32_t)tl_test_random_below(&random, 5);
    network_plan.plan.shape = tl_test_random_chance(&random, 50) ? TL_DYNAMIC : TL_STATIC;
    network_plan.plan.measurements = modes[tl_test_random_below(&random, 3)];
    network_plan.plan.algorithm = network.booleans ? "boolean" : "secant";
    network_plan.plan.evaluations = 8;
    network_plan.plan.saving = *saving;
    tl_test_run_build(&one, &network_plan);
    one.budget.evaluations = 8;
    while (one.sample.tick < NETWORK_TICKS) {
        for (size_t s = 0; s < network.signals; s++) {
            double value = tl_test_random_number(&random, -1.0, 2.0);
            one.sample.values[s] = fit(value, network.types[s]);
        }
        if (tl_test_random_chance(&random, 20)) {
            tl_twin_reset(one.twin);
        }
        tl_test_run_step(&one);
        TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, one.status, one.error.text);
        for (size_t i = 0; one.ready && i < network_plan.plan.match_count; i++) {
            uint64_t bits = 0;
            memcpy(&bits, &one.record.y[i], sizeof bits);
            sum = tl_test_mix(sum + bits);
        }
    }
    for (size_t k = 0; k < tl_twin_get_facts(one.twin).components; k++) {
        TEST_ASSERT_EQUAL_INT64(0, tl_twin_get_ledger(one.twin, k).difference);
    }
    tl_test_run_end(&one, &network_plan);
    return sum;
}

static void test_networks_at_random(void) {
    static const tl_plan_saving ways[] = {
        {.structure = true, .sequences = true}, {.sequences = true}, {.structure = true}};
    static const tl_plan_saving none = {0};
    for (uint64_t seed = 1; seed <= NETWORKS; seed++) {
        uint64_t plain = run_network(seed, &none);
        for (size_t i = 0; i < sizeof ways / sizeof ways[0]; i++) {
            TEST_ASSERT_TRUE(plain == run_network(seed, &ways[i]));
        }
    }
}

/* ---- cost ---- */

static size_t calls_of(tl_test_call call) {
    return (size_t)(scene.fmus[0].calls[call] + scene.fmus[1].calls[call]);
}

/* Each reset costs one fmi2Reset and one initialisation per FMU. States are neither allocated nor
 * freed. */
static void test_calls_of_a_reset(void) {
    for (tl_test_scene_kind of = TL_SCENE_LAG; of < TL_SCENES; of++) {
        tl_test_scene_build(&scene, of);
        run_to(100, found, in_found);
        size_t states = scene.fmus[0].states + scene.fmus[1].states;
        size_t values = calls_of(TL_TEST_SET_REAL);
        /* by the rollback check at the start */
        size_t freed = tl_test_log_count(&scene.log, NULL, TL_TEST_FREE_STATE);
        for (size_t times = 1; times <= 50; times++) {
            tl_twin_reset(run->twin);
            tl_twin_reset(run->twin); /* the second call has no effect */
            tick_once(found, in_found);
            TEST_ASSERT_EQUAL_size_t(2 * times, calls_of(TL_TEST_RESET));
            TEST_ASSERT_EQUAL_size_t(2 * times + 2, calls_of(TL_TEST_SETUP_EXPERIMENT));
            TEST_ASSERT_EQUAL_size_t(2 * times + 2, calls_of(TL_TEST_EXIT_INITIALIZATION));
        }
        TEST_ASSERT_GREATER_THAN_size_t(values, calls_of(TL_TEST_SET_REAL));
        TEST_ASSERT_EQUAL_size_t(2, calls_of(TL_TEST_INSTANTIATE));
        TEST_ASSERT_EQUAL_size_t_MESSAGE(states, scene.fmus[0].states + scene.fmus[1].states, tl_test_scene_name(of));
        TEST_ASSERT_EQUAL_size_t(freed, tl_test_log_count(&scene.log, NULL, TL_TEST_FREE_STATE));
        tl_test_scene_end(&scene);
    }
}

/* The FMUs start at the instant of the step, not of the tick that computes it. */
static void test_fmus_start_at_the_instant_of_the_step(void) {
    for (tl_test_scene_kind of = TL_SCENE_LAG; of < TL_SCENES; of++) {
        tl_test_scene_build(&scene, of);
        tl_twin_set_start(run->twin, of == TL_SCENE_LAG ? 64800.0 : 0.0);
        run_to(100, found, in_found);
        tl_test_log_clear(&scene.log);
        tl_twin_reset(run->twin);
        int64_t step = run->sample.tick - (int64_t)tl_twin_get_facts(run->twin).lead;
        tick_once(found, in_found);
        size_t begun = 0;
        for (size_t i = 0; i < scene.log.count && i < TL_TEST_ENTRIES; i++) {
            const tl_test_entry *entry = &scene.log.entries[i];
            if (entry->call == TL_TEST_SETUP_EXPERIMENT) {
                TEST_ASSERT_EQUAL_DOUBLE((of == TL_SCENE_LAG ? 64800.0 : 0.0) + 0.1 * (double)step, entry->time);
                TEST_ASSERT_TRUE(entry->final);
                begun++;
            }
        }
        TEST_ASSERT_EQUAL_size_t(2, begun);
        tl_test_scene_end(&scene);
    }
}

/* ---- effects on the twin ---- */

static void test_before_any_step_nothing_happens(void) {
    for (tl_test_scene_kind of = TL_SCENE_LAG; of < TL_SCENES; of++) {
        for (size_t i = 0; i < 2; i++) {
            tl_test_scene_build(&scene, of);
            int64_t first = tl_twin_get_facts(run->twin).first;
            int64_t due = first + (int64_t)tl_twin_get_facts(run->twin).lead;
            while (run->sample.tick < due + (int64_t)i) {
                tl_twin_reset(run->twin);
                tick_once(found, in_found);
            }
            /* in mode ahead the record follows with the next tick */
            run_to(due + 1, found, in_found);
            TEST_ASSERT_EQUAL_size_t(2 * i, calls_of(TL_TEST_RESET));
            TEST_ASSERT_TRUE(in_found[first]);
            TEST_ASSERT_EQUAL_UINT32(i == 0 ? 0U : TL_FLAG_RESET, found[first].flags & TL_FLAG_RESET);
            tl_test_scene_end(&scene);
        }
    }
}

/* All is within tolerance, but the solver has no memory of the twin, so it searches once. */
static void test_the_solver_loses_its_memory(void) {
    tl_test_scene_build(&scene, TL_SCENE_LAG);
    int64_t lead = tl_twin_get_facts(run->twin).lead;
    while (run->sample.tick < 60) {
        if (run->sample.tick == 30) {
            tl_twin_reset(run->twin);
        }
        tl_test_run_step(run);
        keep(found, in_found);
    }
    for (int64_t step = 0; step < 60 - lead; step++) {
        bool meets = step == 0 || step == 30 - lead;
        TEST_ASSERT_EQUAL_INT(meets ? TL_OPTIMISED : TL_FIRST_GUESS, found[step].outcome);
    }
}

/* Metrics, counts and the measured delay survive a reset. */
static void test_what_survives_a_reset(void) {
    scene.good = true;
    tl_test_scene_build(&scene, TL_SCENE_LAG);
    run_to(150, found, in_found);
    uint64_t pairs = tl_twin_metrics(run->twin, 0)->pairs;
    uint64_t executions = tl_twin_executions(run->twin, 0);
    tl_twin_reset(run->twin);
    run_to(152, found, in_found);
    TEST_ASSERT_EQUAL_UINT64(pairs + 2, tl_twin_metrics(run->twin, 0)->pairs);
    TEST_ASSERT_GREATER_THAN_UINT64(executions, tl_twin_executions(run->twin, 0));
    TEST_ASSERT_EQUAL_INT64(0, tl_twin_get_facts(run->twin).first);
    tl_test_scene_end(&scene);
    tl_test_scene_build(&scene, TL_SCENE_MEASURED);
    run_to(180, found, in_found);
    tl_time delay = tl_twin_get_delay(run->twin).delay;
    TEST_ASSERT_NOT_EQUAL_INT64(0, delay);
    tl_twin_reset(run->twin);
    run_to(181, found, in_found);
    TEST_ASSERT_EQUAL_INT64(delay, tl_twin_get_delay(run->twin).delay);
    TEST_ASSERT_EQUAL_INT(TL_DELAY_KNOWN, tl_twin_get_delay(run->twin).state);
}

/* The jump of y at a reset must not disturb the measurement of the delay. */
static void test_the_delay_is_not_measured_across_a_reset(void) {
    tl_test_scene_build(&scene, TL_SCENE_MEASURED);
    run_to(TICKS - 1, wanted, in_wanted);
    double sure = tl_twin_get_delay(run->twin).confidence;
    tl_test_scene_end(&scene);
    tl_test_scene_build(&scene, TL_SCENE_MEASURED);
    before_tick = reset_often;
    run_to(TICKS - 1, found, in_found);
    TEST_ASSERT_EQUAL_INT64(wanted[200].delay, found[200].delay);
    TEST_ASSERT_DOUBLE_WITHIN(0.1, sure, tl_twin_get_delay(run->twin).confidence);
}

/* A reset clears Δu, so a missed tick after it uses nominal. */
static void test_a_made_up_step_after_it_is_nominal(void) {
    static const tl_test_scene_kind kinds[] = {TL_SCENE_LAG, TL_SCENE_AHEAD, TL_SCENE_FLAG};
    for (size_t i = 0; i < sizeof kinds / sizeof kinds[0]; i++) {
        tl_test_scene_build(&scene, kinds[i]);
        run_to(154, found, in_found);
        tl_twin_reset(run->twin);
        run_to(156, found, in_found); /* 155 is missed */
        int64_t step = 155 - (int64_t)tl_twin_get_facts(run->twin).lead;
        TEST_ASSERT_EQUAL_INT(TL_CAUGHT_UP, found[step].outcome);
        TEST_ASSERT_EQUAL_UINT32(TL_FLAG_RESET, found[step].flags);
        expect_same_bits(found[step].nominal, found[step].u, 1, "nominal");
        TEST_ASSERT_TRUE(found[step - 1].u[0] != found[step - 1].nominal[0]);
        tl_test_scene_end(&scene);
    }
}

/* ---- an event horizon ---- */

enum { RISE = 2 * TL_SCENE_PERIOD + 10 };

static void test_a_stroke_is_abandoned(void) {
    tl_test_scene_build(&scene, TL_SCENE_STROKES);
    run_to(RISE + 5, found, in_found);
    double nominal = found[RISE].nominal[0];
    TEST_ASSERT_TRUE(found[RISE].u[0] != nominal); /* two strokes have been searched */
    int64_t lead = tl_twin_get_facts(run->twin).lead;
    tl_twin_reset(run->twin);
    run_to(RISE + 40, found, in_found);
    int64_t step = RISE + 6 - lead;
    TEST_ASSERT_EQUAL_UINT32(TL_FLAG_RESET | TL_FLAG_ABANDONED, found[step].flags);
    for (; step < RISE + 40 - lead; step++) {
        TEST_ASSERT_TRUE(found[step].u[0] == nominal && found[step].evaluations == 0);
        TEST_ASSERT_TRUE(found[step].outcome == TL_HELD || found[step].outcome == TL_CAUGHT_UP);
    }
    tl_test_scene_end(&scene);
}

/* The reset stops a search in the middle of a candidate. */
static void test_a_search_is_abandoned(void) {
    tl_test_scene_build(&scene, TL_SCENE_STROKES);
    run->budget.repeated = true;
    run->budget.executions = 40; /* per tick */
    run_to(3 * TL_SCENE_PERIOD - 1, found, in_found);
    int64_t step = 0;
    while (step + 2 < TICKS && found[step].outcome != TL_SEARCHING) {
        step++;
    }
    int64_t tick = step + 2 + (int64_t)tl_twin_get_facts(run->twin).lead;
    TEST_ASSERT_EQUAL_INT(TL_SEARCHING, found[step + 1].outcome);
    tl_test_scene_end(&scene);
    tl_test_scene_build(&scene, TL_SCENE_STROKES);
    run->budget.repeated = true;
    run->budget.executions = 40;
    run_to(tick - 1, found, in_found);
    tl_twin_reset(run->twin);
    run_to(TICKS - 1, found, in_found);
    const tl_record *given_up = &found[tick - (int64_t)tl_twin_get_facts(run->twin).lead];
    TEST_ASSERT_EQUAL_UINT32(TL_FLAG_RESET | TL_FLAG_ABANDONED, given_up->flags);
    TEST_ASSERT_EQUAL_INT(TL_HELD, given_up->outcome);
    expect_exact_ledger();
}

/* ---- saved and followed ---- */

static unsigned char bytes[1 << 16];

/* The checkpoint is from before a reset or just after it. The loaded twin follows, with the resets
 * at the same ticks. */
static void test_a_loaded_twin_follows(void) {
    static const int64_t ticks[] = {28, 30, 31, 74, 75, 76, 154, 155, 156};
    for (tl_test_scene_kind of = TL_SCENE_LAG; of < TL_SCENES; of++) {
        for (size_t i = 0; of != TL_SCENE_LONG && i < sizeof ticks / sizeof ticks[0]; i++) {
            size_t size = 0;
            before_tick = reset_often;
            tl_test_scene_build(&scene, of);
            run_to(ticks[i], wanted, in_wanted);
            TEST_ASSERT_EQUAL_INT(TL_OK, tl_twin_save(run->twin, bytes, sizeof bytes, &size, &run->error));
            TEST_ASSERT_TRUE(size != 0 && size <= sizeof bytes);
            int64_t lead = tl_twin_get_facts(run->twin).lead;
            /* a checkpoint does not contain the state of a search in progress */
            int64_t last = of == TL_SCENE_STROKES ? ticks[i] : TICKS - 1;
            run_to(last, wanted, in_wanted);
            tl_test_scene_end(&scene);
            tl_test_scene_build(&scene, of);
            TEST_ASSERT_EQUAL_INT(TL_OK, tl_twin_load(run->twin, ticks[i], bytes, size, &run->error));
            tl_test_scene_move(&scene, ticks[i] + 1);
            while (run->sample.tick <= last) {
                int64_t step = run->sample.tick - lead;
                tl_test_scene_show(&scene);
                reset_often(run->sample.tick);
                tl_test_run_follow(run, wanted[step].u);
                keep(found, in_found);
                uint32_t flags = run->ready && run->record.step > ticks[i] - lead ? TL_FLAG_RESET : 0U;
                TEST_ASSERT_EQUAL_UINT32(wanted[run->record.step].flags & flags, run->record.flags & flags);
            }
            tl_test_scene_end(&scene);
            TEST_ASSERT_TRUE(expect_same_steps(0, false, true) != 0 || of == TL_SCENE_STROKES);
            memset(in_found, 0, sizeof in_found);
            memset(in_wanted, 0, sizeof in_wanted);
        }
    }
}

/* ---- FMUs that refuse or fail ---- */

static void expect_course_of_good_ones(tl_test_scene_kind of) {
    run_to(TICKS - 1, found, in_found);
    expect_exact_ledger();
    TEST_ASSERT_EQUAL_size_t(1, scene.fmus[0].living);
    TEST_ASSERT_EQUAL_size_t(1, scene.fmus[1].living);
    tl_test_scene_end(&scene);
    tl_test_scene_build(&scene, of);
    run_to(TICKS - 1, wanted, in_wanted);
    tl_test_scene_end(&scene);
    TEST_ASSERT_GREATER_THAN_size_t(TICKS - 20, expect_same_steps(0, true, true));
}

/* The twin frees the instance with its states and creates a new one. No value changes. */
static void test_an_fmu_that_refuses_gets_a_new_instance(void) {
    static const tl_test_fault_kind kinds[] = {TL_TEST_ERROR, TL_TEST_DISCARD};
    before_tick = reset_often;
    for (tl_test_scene_kind of = TL_SCENE_LAG; of < TL_SCENES; of++) {
        for (size_t i = 0; i < 2; i++) {
            tl_test_scene_build(&scene, of);
            tl_test_fmu_fail(&scene.fmus[i], TL_TEST_RESET, kinds[i], 1, RESETS);
            run_to(100, found, in_found);
            size_t states = scene.fmus[i].states;
            run_to(TICKS - 1, found, in_found);
            TEST_ASSERT_EQUAL_size_t(RESETS + 1, scene.fmus[i].instances);
            TEST_ASSERT_EQUAL_size_t(1, scene.fmus[1 - i].instances);
            TEST_ASSERT_LESS_OR_EQUAL_size_t(states, scene.fmus[i].states);
            expect_course_of_good_ones(of);
        }
    }
}

/* The FMU accepts the reset, but its initialisation fails. All FMUs get new instances. */
static void test_an_fmu_that_cannot_start_after_a_reset(void) {
    static const tl_test_call calls[] = {TL_TEST_SETUP_EXPERIMENT, TL_TEST_ENTER_INITIALIZATION,
                                         TL_TEST_EXIT_INITIALIZATION};
    before_tick = reset_once;
    for (size_t i = 0; i < sizeof calls / sizeof calls[0]; i++) {
        tl_test_scene_build(&scene, TL_SCENE_LAG);
        tl_test_fmu_fail(&scene.fmus[1], calls[i], TL_TEST_ERROR, 2, 2);
        run_to(ANEW, found, in_found);
        TEST_ASSERT_EQUAL_size_t(4, scene.fmus[0].instances + scene.fmus[1].instances);
        expect_course_of_good_ones(TL_SCENE_LAG);
    }
    tl_test_scene_build(&scene, TL_SCENE_LAG);
    tl_test_fmu_fail(&scene.fmus[1], TL_TEST_SET_BOOLEAN, TL_TEST_ERROR, 2, 2); /* a start value */
    tl_twin_reset(run->twin);
    run_to(ANEW - 1, found, in_found);
    tl_test_fmu_fail(&scene.fmus[1], TL_TEST_SET_BOOLEAN, TL_TEST_ERROR, scene.fmus[1].calls[TL_TEST_SET_BOOLEAN] + 1,
                     scene.fmus[1].calls[TL_TEST_SET_BOOLEAN] + 1);
    run_to(ANEW, found, in_found);
    TEST_ASSERT_EQUAL_size_t(2, scene.fmus[1].instances);
    expect_course_of_good_ones(TL_SCENE_LAG);
}

/* The tick fails. The test FMUs check that the twin makes no forbidden calls afterwards. */
static void expect_end(tl_status status, const char *parts) {
    run_to(ANEW - 1, found, in_found);
    reset_once(ANEW);
    tl_test_scene_show(&scene);
    tl_test_run_step(run);
    TEST_ASSERT_EQUAL_INT(status, run->status);
    TL_EXPECT_PARTS(parts, run->error.text);
    TEST_ASSERT_FALSE(run->ready);
    tl_test_run_step(run);
    TEST_ASSERT_EQUAL_INT(status, run->status);
    TL_EXPECT_PARTS("twin", run->error.text);
    tl_test_scene_end(&scene);
}

static void test_an_fmu_that_is_fatal(void) {
    for (tl_test_scene_kind of = TL_SCENE_LAG; of < TL_SCENES; of++) {
        if (of == TL_SCENE_AHEAD) {
            continue; /* the record of the step before is ready */
        }
        tl_test_scene_build(&scene, of);
        tl_test_fmu_fail(&scene.fmus[1], TL_TEST_RESET, TL_TEST_FATAL, 1, 1);
        expect_end(TL_FMU_FATAL, "b|fmi2Reset|fmi2Fatal");
    }
}

static void test_an_fmu_that_cannot_be_initialised(void) {
    tl_test_scene_build(&scene, TL_SCENE_LAG);
    tl_test_fmu_fail(&scene.fmus[0], TL_TEST_ENTER_INITIALIZATION, TL_TEST_ERROR, 2, 3);
    expect_end(TL_FMU_FAILED, "a:|fmi2EnterInitializationMode|fmi2Error");
    TEST_ASSERT_EQUAL_size_t(2, scene.fmus[0].instances);
    tl_test_scene_build(&scene, TL_SCENE_LAG);
    tl_test_fmu_fail(&scene.fmus[1], TL_TEST_ENTER_INITIALIZATION, TL_TEST_FATAL, 2, 2);
    expect_end(TL_FMU_FATAL, "b|fmi2EnterInitializationMode|fmi2Fatal");
}

/* Refuses a new instance after a refused reset. */
static fmi2Component refuse_to_instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                                           const fmi2CallbackFunctions *callbacks, fmi2Boolean visible,
                                           fmi2Boolean logging) {
    (void)name;
    (void)type;
    (void)guid;
    (void)resources;
    (void)callbacks;
    (void)visible;
    (void)logging;
    return NULL;
}

static void test_an_fmu_that_is_not_instantiated_a_second_time(void) {
    tl_test_scene_build(&scene, TL_SCENE_LAG);
    scene.fmus[1].functions.instantiate = refuse_to_instantiate;
    tl_test_fmu_fail(&scene.fmus[1], TL_TEST_RESET, TL_TEST_ERROR, 1, 1);
    expect_end(TL_FMU_FAILED, "b|fmi2Instantiate");
}

static fmi2Status refuse_to_reset(fmi2Component component) {
    (void)component;
    return fmi2Error;
}

/* Fatal when it frees its states. The first call of fmi2FreeFMUstate() belongs to the check at the
 * start. */
static void test_an_fmu_that_is_fatal_with_its_states(void) {
    tl_test_scene_build(&scene, TL_SCENE_LAG);
    scene.fmus[1].functions.reset = refuse_to_reset;
    tl_test_fmu_fail(&scene.fmus[1], TL_TEST_FREE_STATE, TL_TEST_FATAL, 2, 2);
    expect_end(TL_FMU_FATAL, "b|fmi2Fatal");
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_equal_without_a_search);
    RUN_TEST(test_equal_with_a_solver_without_memory);
    RUN_TEST(test_equal_with_a_solver_with_memory);
    RUN_TEST(test_feed_through_settles_from_the_start_values);
    RUN_TEST(test_saving_changes_no_bit);
    RUN_TEST(test_networks_at_random);
    RUN_TEST(test_calls_of_a_reset);
    RUN_TEST(test_fmus_start_at_the_instant_of_the_step);
    RUN_TEST(test_before_any_step_nothing_happens);
    RUN_TEST(test_the_solver_loses_its_memory);
    RUN_TEST(test_what_survives_a_reset);
    RUN_TEST(test_the_delay_is_not_measured_across_a_reset);
    RUN_TEST(test_a_made_up_step_after_it_is_nominal);
    RUN_TEST(test_a_stroke_is_abandoned);
    RUN_TEST(test_a_search_is_abandoned);
    RUN_TEST(test_a_loaded_twin_follows);
    RUN_TEST(test_an_fmu_that_refuses_gets_a_new_instance);
    RUN_TEST(test_an_fmu_that_cannot_start_after_a_reset);
    RUN_TEST(test_an_fmu_that_is_fatal);
    RUN_TEST(test_an_fmu_that_cannot_be_initialised);
    RUN_TEST(test_an_fmu_that_is_not_instantiated_a_second_time);
    RUN_TEST(test_an_fmu_that_is_fatal_with_its_states);
    return UNITY_END();
}
