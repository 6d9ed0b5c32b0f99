/* A twin that is matched at the end of each stroke. y[0] of the test FMU creeps to gain·cmd; its
 * flag is set from 0.5 on. */
#include <math.h>
#include <string.h>
#include <unity.h>

#include "tests/support/message.h"
#include "tests/support/random_numbers.h"
#include "tests/support/test_plan.h"

enum { MOVE, CMD, THERE }; /* signals */
enum { TICKS = 1100, MOST = 60, WINDOW = 16, LONGEST = 250 };

static const tl_time STEP = TL_SECOND / 100;
static const double NOMINAL = 0.8;

static tl_test_log call_log;
static tl_test_fmu fmu;
static tl_test_plan plan;
static tl_test_run run;
static tl_record records[TICKS]; /* index: the tick that the twin has reached */
static bool caught_up[TICKS];

/* The plant, as recorded. */
static bool moves[TICKS];
static bool there[TICKS];

static struct {
    tl_time now;
    tl_time longest; /* longest tick */
} watch;

void setUp(void) {
    tl_test_fmu_init(&fmu, 1, true, &call_log);
    fmu.control.ends = true;
    memset(&watch, 0, sizeof watch);
    memset(caught_up, 0, sizeof caught_up);
    tl_test_plan_init(&plan, STEP);
    tl_test_plan_component(&plan, "axis", &fmu);
    tl_test_plan_set(&plan, "lag", 1.0);
    tl_test_plan_set(&plan, "gain", NOMINAL);
    tl_test_plan_set(&plan, "count", 0.0);
    tl_test_plan_set(&plan, "mode", 0.0);
    tl_test_plan_set_value(&plan, "flag", (tl_value){.type = TL_BOOLEAN});
    tl_test_plan_signal(&plan, "move", TL_BOOLEAN, "");
    tl_test_plan_signal(&plan, "cmd", TL_REAL, "");
    tl_test_plan_signal(&plan, "there", TL_BOOLEAN, "");
    tl_test_plan_connect(&plan, "plant.cmd", "axis.u0");
    tl_test_plan_adjust(&plan, "axis.gain", 0.1)->lower = 0.1;
    plan.adjust[0].upper = 20.0;
    tl_test_plan_match(&plan, "axis.flag_out", "plant.there", 1.0);
    plan.plan.event = (tl_plan_event){.where = "synchronise.horizon.event",
                                      .start = {"plant.move", false},
                                      .end = {"plant.there", false},
                                      .window = WINDOW * STEP,
                                      .longest = LONGEST * STEP};
    plan.plan.evaluations = MOST;
    plan.plan.margin = 0.01;
}

void tearDown(void) {
    tl_test_run_end(&run, &plan);
}

/* ---- the plant ---- */

/* Moves out from tick `from` on for 200 ticks, every 800 ticks, with this gain. */
static void make_plant(int64_t from, double gain) {
    double y = 0.0;
    for (int64_t tick = 0; tick < TICKS; tick++) {
        moves[tick] = tick >= from && (tick - from) % 800 < 200;
        there[tick] = y >= 0.5;
        y += 0.01 * ((moves[tick] ? gain : 0.0) - y); /* one step */
    }
}

/* Tick of the n-th rise, counted from 1; −1: there is none. */
static int64_t rise(const bool *signal, int number) {
    for (int64_t tick = 1; tick < TICKS; tick++) {
        number -= signal[tick] && !signal[tick - 1] ? 1 : 0;
        if (number == 0) {
            return tick;
        }
    }
    return -1;
}

/* ---- the run ---- */

static void build(void) {
    tl_test_run_build(&run, &plan);
    run.budget.evaluations = MOST;
}

static bool at(const bool *signal, int64_t tick) {
    return signal[tick < 0 ? 0 : tick >= TICKS ? TICKS - 1 : tick];
}

/* One tick; false if the twin has failed. */
static bool step(void) {
    int64_t tick = run.sample.tick;
    run.sample.values[MOVE] = at(moves, tick - plan.plan.input_ticks);
    run.sample.values[CMD] = at(moves, tick - plan.plan.input_ticks);
    run.sample.values[THERE] = at(there, tick - plan.plan.output_ticks);
    run.budget.started = watch.now;
    if (caught_up[tick]) {
        tl_test_run_catch_up(&run);
    } else {
        tl_test_run_step(&run);
    }
    if (run.ready) {
        int64_t lead = tl_twin_get_facts(run.twin).lead;
        TEST_ASSERT_EQUAL_INT64(tick - lead, run.record.step);
        /* a search that continues reports nothing that depends on its time */
        TEST_ASSERT_FALSE(run.record.outcome == TL_SEARCHING && (run.record.flags & TL_FLAG_PLATEAU) != 0);
        records[run.record.step + 1] = run.record;
        watch.longest = run.record.used > watch.longest ? run.record.used : watch.longest;
    }
    return run.status == TL_OK;
}

static void run_to(int64_t tick) {
    while (run.sample.tick <= tick) {
        TEST_ASSERT_TRUE_MESSAGE(step(), run.error.text);
    }
}

static void run_all(void) {
    build();
    run_to(TICKS - 1);
}

/* The first tick from `from` on at which a search has ended; −1: none. */
static int64_t search_end(int64_t from) {
    for (int64_t tick = from; tick < TICKS; tick++) {
        if (records[tick].outcome != TL_HELD && records[tick].outcome != TL_SEARCHING &&
            records[tick].outcome != TL_CAUGHT_UP) {
            return tick;
        }
    }
    return -1;
}

static void assert_locked(int64_t from, int64_t to) {
    for (int64_t tick = from; tick < to; tick++) {
        TEST_ASSERT_EQUAL_INT(there[tick], records[tick].y[0] > 0.5);
    }
}

/* The next stroke starts almost like the first, so an error of u may show as one wrong tick. */
static void assert_next_stroke(void) {
    int wrong = 0;
    for (int64_t tick = 810; tick < 1010; tick++) {
        wrong += there[tick] != (records[tick].y[0] > 0.5) ? 1 : 0;
    }
    TEST_ASSERT_TRUE(wrong <= 1);
}

/* ---- results ---- */

static void the_winner_becomes_the_twin_and_the_next_stroke_is_right(void) {
    static const tl_pairing modes[] = {TL_LAG, TL_HOLD};
    tl_test_random chance = {3};
    int at_once = 0;
    for (int i = 0; i < 120; i++) {
        tearDown();
        setUp();
        double gain = exp(tl_test_random_number(&chance, -0.2, 2.0));
        plan.adjust[0].step = exp(tl_test_random_number(&chance, -6.0, 1.0));
        plan.plan.measurements = modes[i % 2];
        make_plant(10, gain);
        run_all();
        int64_t event = rise(there, 1);
        int64_t found = event + (modes[i % 2] == TL_LAG ? WINDOW / 2 : 0);
        TEST_ASSERT_EQUAL_INT64(found, search_end(1));
        TEST_ASSERT_TRUE(records[found].outcome == TL_OPTIMISED || records[found].outcome == TL_FIRST_GUESS);
        TEST_ASSERT_TRUE(records[found].objective < 1.0);
        assert_locked(found, 210); /* until the stroke back */
        int64_t again = search_end(found + 1);
        TEST_ASSERT_TRUE(records[again].objective < 1.0);
        at_once += records[again].outcome == TL_FIRST_GUESS ? 1 : 0;
        assert_next_stroke();
        TEST_ASSERT_TRUE(records[TICKS - 1].nominal[0] == NOMINAL);
    }
    /* the others differ by a tick, because the start of the stroke differs */
    TEST_ASSERT_TRUE(at_once > 60);
}

/* The live twin is the first candidate. Its past steps are known, so only the rest of the window is
 * executed. */
static void a_stroke_that_agrees_costs_nothing_or_half_the_window(void) {
    for (int hold = 0; hold < 2; hold++) {
        tearDown();
        setUp();
        plan.plan.measurements = hold != 0 ? TL_HOLD : TL_LAG;
        make_plant(10, NOMINAL);
        run_all();
        int64_t found = search_end(1);
        TEST_ASSERT_EQUAL_INT(TL_FIRST_GUESS, records[found].outcome);
        TEST_ASSERT_EQUAL_UINT32(2 + (hold != 0 ? WINDOW / 2 * 2 : 0), records[found].executions);
        TEST_ASSERT_EQUAL_INT(0, records[found].flags);
    }
}

/* An event horizon saves no executions; the ledger predicts that. */
static void what_is_executed_is_predicted(void) {
    make_plant(10, 2.0);
    run_all();
    uint64_t sum = 0;
    for (int64_t tick = 1; tick < TICKS; tick++) {
        TEST_ASSERT_EQUAL_UINT32(records[tick].predicted, records[tick].executions);
        sum += records[tick].executions;
    }
    for (size_t k = 0; k < 2; k++) {
        TEST_ASSERT_EQUAL_INT64(0, tl_twin_get_ledger(run.twin, k).difference);
    }
    TEST_ASSERT_EQUAL_UINT64(sum, tl_twin_executions(run.twin, 0) + tl_twin_executions(run.twin, 1));
}

static tl_record first[TICKS];

/* With delays of inputs or outputs the twin computes the same values at other ticks. */
static void delays_only_shift_the_ticks(void) {
    static const int32_t shifts[][2] = {{0, 0}, {3, 0}, {0, 4}, {-2, 0}, {0, -3}, {5, -4}, {-4, 5}, {4, 4}};
    for (size_t i = 0; i < sizeof shifts / sizeof shifts[0]; i++) {
        tearDown();
        setUp();
        make_plant(10, 2.0);
        plan.plan.measurements = TL_LAG;
        plan.plan.input_ticks = shifts[i][0];
        plan.plan.output_ticks = shifts[i][1];
        run_all();
        if (i == 0) {
            memcpy(first, records, sizeof first);
        }
        for (int64_t tick = 20; tick < TICKS - 10; tick++) {
            TEST_ASSERT_EQUAL_INT(first[tick].outcome, records[tick].outcome);
            TEST_ASSERT_EQUAL_MEMORY(first[tick].u, records[tick].u, sizeof first[tick].u[0]);
            TEST_ASSERT_EQUAL_MEMORY(first[tick].y, records[tick].y, sizeof first[tick].y[0]);
            TEST_ASSERT_EQUAL_UINT32(first[tick].executions, records[tick].executions);
        }
    }
}

/* ---- time limits ---- */

static tl_time read_clock(void *context) {
    (void)context;
    return watch.now;
}

static void use_clock(tl_time cost, tl_time budget) {
    fmu.control.clock = &watch.now;
    fmu.control.cost = cost;
    run.budget.now = read_clock;
    run.budget.time = budget;
}

/* The search finds the same u as without a clock, only later. No tick exceeds its budget. */
static void a_search_spans_cycles_and_none_is_late(void) {
    make_plant(10, 2.0);
    run_all();
    double u = records[TICKS - 1].u[0];
    for (tl_time steps = 2; steps < 200; steps = steps * 3 / 2 + 1) {
        tearDown();
        setUp();
        watch.longest = 0;
        make_plant(10, 2.0);
        build();
        use_clock(STEP / 1000, steps * (STEP / 1000));
        run_to(TICKS - 1);
        TEST_ASSERT_TRUE(watch.longest <= run.budget.time);
        if (steps > 4) {
            TEST_ASSERT_TRUE(records[TICKS - 1].u[0] == u);
            assert_next_stroke();
        }
    }
}

/* The repetition uses what the database records: the ticks that ran out of time, and their
 * executions. */
static void a_repetition_without_a_clock_is_the_same_to_the_bit(void) {
    for (tl_time steps = 2; steps < 100; steps += 7) {
        tearDown();
        setUp();
        plan.plan.measurements = steps % 2 != 0 ? TL_HOLD : TL_LAG;
        make_plant(10, 2.0);
        build();
        use_clock(STEP / 1000, steps * (STEP / 1000));
        for (int64_t tick = 0; tick < TICKS; tick++) {
            caught_up[tick] = tick % 97 == 13;
        }
        run_to(TICKS - 1);
        memcpy(first, records, sizeof first);
        tl_test_run_end(&run, &plan);
        tl_twin *twin = tl_test_plan_build(&plan);
        tl_test_run_init(&run, twin);
        for (int64_t tick = 0; tick < TICKS; tick++) {
            run.budget.repeated = first[tick].stop == TL_STOP_TIME;
            run.budget.executions = first[tick].executions;
            TEST_ASSERT_TRUE(step());
            TEST_ASSERT_EQUAL_INT(first[tick].outcome, records[tick].outcome);
            TEST_ASSERT_EQUAL_UINT32(first[tick].evaluations, records[tick].evaluations);
            TEST_ASSERT_EQUAL_UINT32(first[tick].executions, records[tick].executions);
            TEST_ASSERT_EQUAL_MEMORY(first[tick].y, records[tick].y, sizeof first[tick].y[0]);
            TEST_ASSERT_EQUAL_MEMORY(first[tick].u, records[tick].u, sizeof first[tick].u[0]);
        }
    }
}

/* There is time for the live step only. The search starts, gets no executions, and is abandoned at
 * the next stroke. */
static void without_time_the_twin_runs_on_as_it_was(void) {
    make_plant(10, 2.0);
    build();
    run_to(1); /* so that the cost of a step is known */
    use_clock(STEP / 1000, STEP / 1000);
    run_to(TICKS - 1);
    TEST_ASSERT_EQUAL_INT64(-1, search_end(1));
    TEST_ASSERT_EQUAL_INT(TL_STOP_TIME, records[rise(there, 1) + WINDOW].stop);
    TEST_ASSERT_EQUAL_INT(TL_SEARCHING, records[rise(there, 1) + WINDOW].outcome);
    int64_t abandoned = 1;
    while (abandoned < TICKS - 1 && (records[abandoned].flags & TL_FLAG_ABANDONED) == 0) {
        abandoned++;
    }
    /* the buffer no longer holds its samples */
    TEST_ASSERT_EQUAL_INT64(10 + 2 * LONGEST + WINDOW + 2, abandoned);
    TEST_ASSERT_TRUE(records[TICKS - 1].u[0] == NOMINAL);
}

/* ---- bad signals ---- */

static void a_stroke_that_lasts_too_long_is_not_searched(void) {
    make_plant(10, 2.0);
    memset(there, 0, sizeof there);
    plan.plan.event.longest = 100 * STEP;
    run_all();
    TEST_ASSERT_EQUAL_INT64(-1, search_end(1));
    TEST_ASSERT_TRUE((records[10 + 101].flags & TL_FLAG_ABANDONED) != 0);
    TEST_ASSERT_EQUAL_INT(0, records[10 + 102].flags);
}

static void run_with_gap(size_t signal, int64_t from, int64_t to) {
    build();
    while (run.sample.tick < TICKS) {
        bool gap = run.sample.tick >= from && run.sample.tick < to;
        run.sample.quality[signal] = gap ? TL_STALE : TL_GOOD;
        TEST_ASSERT_TRUE(step());
    }
}

static void an_edge_in_a_gap_is_not_trusted(void) {
    make_plant(10, 2.0);
    int64_t event = rise(there, 1);
    run_with_gap(THERE, event - 2, event + 2);
    TEST_ASSERT_TRUE((records[event + 2].flags & TL_FLAG_ABANDONED) != 0);
    /* the next stroke is searched */
    TEST_ASSERT_EQUAL_INT64(rise(there, 2) + WINDOW / 2, search_end(1));
    tearDown();
    setUp();
    run_with_gap(MOVE, 8, 14);
    TEST_ASSERT_EQUAL_INT64(rise(there, 2) + WINDOW / 2, search_end(1));
}

/* Bad samples in the window, but not at the event, have no weight. */
static void a_gap_within_the_window_is_left_out(void) {
    make_plant(10, 2.0);
    int64_t event = rise(there, 1);
    run_with_gap(THERE, event + 2, event + 5);
    TEST_ASSERT_EQUAL_INT64(event + WINDOW / 2, search_end(1));
    assert_next_stroke();
}

static void a_signal_that_goes_back_is_searched_again(void) {
    plan.plan.measurements = TL_HOLD;
    make_plant(10, 2.0);
    int64_t event = rise(there, 1);
    there[event - 3] = true; /* the signal bounces */
    run_all();
    TEST_ASSERT_EQUAL_INT64(event - 3, search_end(1));
    TEST_ASSERT_EQUAL_INT64(event - 3 + WINDOW / 2, search_end(event - 2));
    TEST_ASSERT_TRUE(isfinite(records[event - 3 + WINDOW / 2].objective));
    assert_locked(event - 3 + WINDOW / 2, 210);
}

/* One sample shows the end of the stroke too early. With the complete window the search finds the
 * earlier u again. */
static void a_false_sample_does_not_lose_what_was_found(void) {
    plan.plan.measurements = TL_HOLD;
    make_plant(10, 2.0);
    there[820] = true; /* in the second stroke */
    run_all();
    int64_t first_found = search_end(1);
    TEST_ASSERT_TRUE(records[820 + WINDOW / 2].u[0] == records[first_found].u[0]);
}

/* ---- never worse ---- */

static void bounds_that_are_too_narrow_leave_nominal(void) {
    make_plant(10, 2.0);
    plan.adjust[0].lower = 0.7;
    plan.adjust[0].upper = 0.9;
    run_all();
    int64_t found = search_end(1);
    TEST_ASSERT_EQUAL_INT(TL_NOMINAL, records[found].outcome);
    TEST_ASSERT_TRUE((records[found].flags & TL_FLAG_PLATEAU) != 0);
    TEST_ASSERT_TRUE(records[found].u[0] == NOMINAL);
    TEST_ASSERT_TRUE(records[found].objective_nominal > 1.0);
}

static void the_last_evaluation_is_kept_for_nominal(void) {
    make_plant(10, 2.0);
    plan.plan.evaluations = 4;
    plan.adjust[0].step = 0.3;
    run_all();
    int64_t found = search_end(1);
    TEST_ASSERT_EQUAL_INT(TL_STOP_EVALUATIONS, records[found].stop);
    TEST_ASSERT_TRUE(isfinite(records[found].objective_nominal));
    TEST_ASSERT_TRUE(records[found].objective <= records[found].objective_nominal);
}

static void a_candidate_that_fails_is_the_worst(void) {
    make_plant(10, 2.0);
    plan.adjust[0].step = 3.0;
    build();
    tl_test_fmu_fail_above(&fmu, TL_TEST_DISCARD, 3.0);
    run_to(TICKS - 1);
    assert_next_stroke();
    for (size_t k = 0; k < 2; k++) {
        TEST_ASSERT_EQUAL_INT64(0, tl_twin_get_ledger(run.twin, k).difference);
    }
}

/* The u that was found fails in a later live step. The twin uses nominal again and continues. */
static void a_live_step_that_fails_falls_back_to_nominal(void) {
    make_plant(10, 2.0);
    build();
    run_to(900);
    TEST_ASSERT_TRUE(records[800].u[0] > 1.5);
    tl_test_fmu_fail_above(&fmu, TL_TEST_DISCARD, 1.0);
    run_to(TICKS - 1);
    TEST_ASSERT_TRUE(records[901].u[0] == NOMINAL);
    TEST_ASSERT_EQUAL_INT(TL_NOMINAL, records[901].outcome);
    for (size_t k = 0; k < 2; k++) {
        TEST_ASSERT_EQUAL_INT64(0, tl_twin_get_ledger(run.twin, k).difference);
    }
}

/* The live twin is the best candidate and then fails. Its state is lost; the twin repeats the
 * stroke from its start. */
static void a_lost_winner_is_computed_again(void) {
    static double wanted[TICKS];
    for (int fails = 0; fails < 2; fails++) {
        tearDown();
        setUp();
        tl_test_plan_match(&plan, "axis.y0", "plant.cmd", 1.0)->weight = 0.0;
        plan.plan.evaluations = 2;
        plan.adjust[0].step = 2.0 - NOMINAL; /* the second trial is right */
        make_plant(10, 2.0);
        int64_t event = rise(there, 2) - 3; /* in the second stroke, where u is slightly wrong */
        there[event] = there[event + 1] = there[event + 2] = true;
        build();
        run_to(event + WINDOW / 2 - 1);
        use_clock(STEP / 1000, 8 * (STEP / 1000));
        run_to(event + WINDOW / 2);
        TEST_ASSERT_EQUAL_INT(TL_SEARCHING, records[event + WINDOW / 2].outcome);
        if (fails != 0) {
            uint64_t next = fmu.calls[TL_TEST_DO_STEP] + 1;
            tl_test_fmu_fail(&fmu, TL_TEST_DO_STEP, TL_TEST_DISCARD, next, next);
        }
        run_to(TICKS - 1);
        for (int64_t tick = 980; tick < 1010; tick++) {
            wanted[tick] = fails == 0 ? records[tick].y[1] : wanted[tick];
            TEST_ASSERT_TRUE(records[tick].u[0] == 2.0);
            TEST_ASSERT_TRUE(records[tick].y[1] == wanted[tick]);
        }
    }
}

static void fatal_is_the_end(void) {
    make_plant(10, 2.0);
    plan.adjust[0].step = 3.0;
    build();
    tl_test_fmu_fail_above(&fmu, TL_TEST_FATAL, 3.0);
    while (step()) {
    }
    TEST_ASSERT_EQUAL_INT(TL_FMU_FATAL, run.status);
    TEST_ASSERT_EQUAL_INT64(rise(there, 1) + WINDOW / 2, run.sample.tick - 1);
}

static void a_missed_tick_is_made_up_and_its_edges_are_seen(void) {
    make_plant(10, 2.0);
    caught_up[10] = true;
    caught_up[rise(there, 1)] = true;
    run_all();
    TEST_ASSERT_EQUAL_INT(TL_CAUGHT_UP, records[10].outcome);
    TEST_ASSERT_EQUAL_INT64(rise(there, 1) + WINDOW / 2, search_end(1));
    assert_next_stroke();
}

/* The past steps of the live twin stay known, also if the search starts late. */
static void a_search_may_begin_late(void) {
    for (int missed = 0; missed < 2 * WINDOW; missed++) {
        tearDown();
        setUp();
        make_plant(10, NOMINAL);
        int64_t last = rise(there, 1) + WINDOW / 2;
        for (int i = 0; i < missed; i++) {
            caught_up[last + i] = true;
        }
        run_all();
        TEST_ASSERT_EQUAL_INT64(last + missed, search_end(1));
        TEST_ASSERT_EQUAL_INT(TL_FIRST_GUESS, records[last + missed].outcome);
        TEST_ASSERT_EQUAL_INT(0, records[last + missed].flags);
    }
}

/* If saving the twin fails once, the twin keeps its state or the run ends. It never continues from
 * another state. */
static void a_state_that_cannot_be_saved_is_not_left(void) {
    for (uint64_t call = 1; call < 1000; call += 1 + call / 8) {
        tearDown();
        setUp();
        make_plant(10, 2.0);
        build();
        run_to(20);
        use_clock(STEP / 1000, 10 * (STEP / 1000));
        uint64_t number = fmu.calls[TL_TEST_GET_STATE] + call;
        fmu.control.fault = (tl_test_fault){TL_TEST_DISCARD, TL_TEST_GET_STATE, number, number, HUGE_VAL};
        while (run.sample.tick < TICKS && step()) {
        }
        TEST_ASSERT_EQUAL_STRING("", call_log.first_violation);
        tl_test_run_end(&run, &plan);
    }
}

/* In one tick, leaving a candidate takes 50 ms, more than any budget. */
static uint64_t restored;
static uint64_t stepped;
static bool stalled;

static tl_time read_stalling_clock(void *context) {
    (void)context;
    if (run.sample.tick == 49 && fmu.calls[TL_TEST_SET_STATE] > restored && fmu.calls[TL_TEST_DO_STEP] == stepped) {
        watch.now += TL_SECOND / 20;
        stalled = true;
    }
    restored = fmu.calls[TL_TEST_SET_STATE];
    stepped = fmu.calls[TL_TEST_DO_STEP];
    return watch.now;
}

static void one_stall_does_not_end_all_searches(void) {
    make_plant(10, 2.0);
    build();
    use_clock(STEP / 1000, 20 * (STEP / 1000));
    run.budget.now = read_stalling_clock;
    stalled = false;
    run_to(TICKS - 1);
    TEST_ASSERT_TRUE(stalled);
    TEST_ASSERT_TRUE(search_end(1) > 0);
    assert_next_stroke();
}

/* ---- falling edges ---- */

/* A stroke back ends with the falling edge of the end signal. */
static void an_edge_may_fall(void) {
    make_plant(10, 2.0);
    for (int64_t tick = 0; tick < TICKS; tick++) {
        moves[tick] = !moves[tick]; /* the falling edge starts the stroke */
    }
    plan.plan.event.start.falls = true;
    tl_test_plan_signal(&plan, "unused", TL_REAL, "");
    build();
    while (run.sample.tick < TICKS) {
        int64_t tick = run.sample.tick;
        run.sample.values[MOVE] = moves[tick];
        run.sample.values[CMD] = !moves[tick];
        run.sample.values[THERE] = there[tick];
        tl_test_run_step(&run);
        TEST_ASSERT_EQUAL_INT(TL_OK, run.status);
        records[tick] = run.record;
    }
    TEST_ASSERT_EQUAL_INT(TL_OPTIMISED, records[rise(there, 1) + WINDOW / 2].outcome);
    assert_next_stroke();
}

/* ---- plans ---- */

static void assert_problem(const char *where, const char *parts) {
    tl_twin *twin = tl_test_plan_build(&plan);
    TEST_ASSERT_NULL(twin);
    bool is_found = false;
    for (size_t i = 0; i < plan.report.count && i < TL_TEST_PROBLEMS; i++) {
        const tl_test_problem *problem = &plan.problems[i];
        is_found = is_found || (strcmp(problem->where, where) == 0 && tl_test_has_parts(problem->text, parts));
    }
    TEST_ASSERT_TRUE_MESSAGE(is_found, parts);
    tearDown();
    setUp();
}

static void settings_that_an_event_forbids_are_reported(void) {
    static const char *const event = "synchronise.horizon.event";
    plan.plan.event.start.signal = "plant.nothing";
    assert_problem(event, "\"start\"|plant.nothing");
    plan.plan.event.end.signal = "there";
    assert_problem(event, "\"end\"|\"there\"");
    plan.plan.event.start.signal = "plant.cmd";
    assert_problem(event, "\"start\"|plant.cmd|Real|Boolean");
    plan.match[0].weight = 0.0;
    assert_problem(event, "plant.there|weight");
    plan.plan.event.window = STEP;
    assert_problem(event, "\"window_s\"|0.01 s|0.02 s");
    plan.plan.event.longest = 10 * STEP;
    assert_problem(event, "\"window_s\"|0.16 s|\"longest_s\"");
    plan.plan.event.longest = (TL_LONGEST_STROKE + 1) * STEP;
    assert_problem(event, "\"longest_s\"");
    plan.plan.prediction = 3;
    assert_problem(event, "\"prediction\" and \"shape\"");
    plan.plan.shape = TL_DYNAMIC;
    assert_problem(event, "\"prediction\" and \"shape\"");
    plan.plan.measurements = TL_AHEAD;
    assert_problem("synchronise.horizon.measurements", "\"ahead\"|\"lag\"|\"hold\"");
    plan.plan.algorithm = "secant";
    assert_problem("synchronise.algorithm", "\"secant\"|\"nelder-mead\"|\"bobyqa\"|\"sbplx\"");
    plan.plan.fallback = "bobyqa";
    assert_problem("synchronise.fallback", "horizon.event");
    plan.plan.measure = (tl_plan_measure){.lags = 8, .range = STEP, .look_back = STEP};
    assert_problem("delays", "horizon.event");
    tl_test_plan_adjust(&plan, "axis.offset", 0.1);
    assert_problem("synchronise.adjust", "2");
    plan.adjust[0].variable = "axis.u0";
    assert_problem(plan.adjust[0].where, "axis.u0|Real");
    plan.adjust[0].variable = "axis.flag";
    assert_problem(plan.adjust[0].where, "axis.flag|Real");
}

static void the_default_solver_is_nelder_mead(void) {
    plan.plan.algorithm = NULL;
    make_plant(10, 2.0);
    build();
    TEST_ASSERT_EQUAL_STRING("nelder-mead", tl_twin_get_facts(run.twin).algorithm);
    TEST_ASSERT_EQUAL_UINT32(LONGEST + WINDOW / 2, tl_twin_get_facts(run.twin).prediction);
    TEST_ASSERT_EQUAL_UINT32(1, tl_twin_get_facts(run.twin).lead);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(the_winner_becomes_the_twin_and_the_next_stroke_is_right);
    RUN_TEST(a_stroke_that_agrees_costs_nothing_or_half_the_window);
    RUN_TEST(what_is_executed_is_predicted);
    RUN_TEST(delays_only_shift_the_ticks);
    RUN_TEST(a_search_spans_cycles_and_none_is_late);
    RUN_TEST(a_repetition_without_a_clock_is_the_same_to_the_bit);
    RUN_TEST(without_time_the_twin_runs_on_as_it_was);
    RUN_TEST(a_stroke_that_lasts_too_long_is_not_searched);
    RUN_TEST(an_edge_in_a_gap_is_not_trusted);
    RUN_TEST(a_gap_within_the_window_is_left_out);
    RUN_TEST(a_signal_that_goes_back_is_searched_again);
    RUN_TEST(bounds_that_are_too_narrow_leave_nominal);
    RUN_TEST(the_last_evaluation_is_kept_for_nominal);
    RUN_TEST(a_candidate_that_fails_is_the_worst);
    RUN_TEST(a_live_step_that_fails_falls_back_to_nominal);
    RUN_TEST(a_false_sample_does_not_lose_what_was_found);
    RUN_TEST(a_lost_winner_is_computed_again);
    RUN_TEST(fatal_is_the_end);
    RUN_TEST(a_missed_tick_is_made_up_and_its_edges_are_seen);
    RUN_TEST(a_search_may_begin_late);
    RUN_TEST(a_state_that_cannot_be_saved_is_not_left);
    RUN_TEST(one_stall_does_not_end_all_searches);
    RUN_TEST(an_edge_may_fall);
    RUN_TEST(settings_that_an_event_forbids_are_reported);
    RUN_TEST(the_default_solver_is_nelder_mead);
    return UNITY_END();
}
