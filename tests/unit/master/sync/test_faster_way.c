/* The choice between two exact rollback methods of a component: its own states, or copies of its
 * memory.
 *
 * The calls of the FMU advance the clock. The tests check the choice and its cost, and that it
 * changes no result.
 */
#include <stdio.h>
#include <string.h>
#include <unity.h>

#include "master/sync/proof.h"
#include "tests/support/message.h"
#include "tests/support/test_plan.h"

enum { TICKS = 20, STEP = 1000, SLOW = 50000, FAST = 10000, EXCURSIONS = 5 };

static tl_test_log call_log;
static tl_test_fmu fmu;
static tl_test_plan plan;
static tl_test_run run;
static tl_time now;

/* Times to save or to restore with own states and with copies, and what the twin did. */
static struct ways {
    tl_time by_states, by_copy;
    bool is_there;   /* a copy is possible */
    bool is_inexact; /* a copy restores nothing */
    bool refuses;    /* fails to restore the kept state */
    bool is_by_copy;
    bool was_final;
    bool sees_final;  /* y depends on the final flag of a step */
    bool lacks_mode;  /* own states lack a mode; the first step enters it, and it shows only if u is not nominal */
    bool mode;        /* entered, and not restored */
    bool is_complete; /* restored by a copy */
    bool is_shown;    /* y shows the mode */
    double offset;    /* set last */
    int kept, preferred, given_up;
    int noted, compared; /* memory */
    int differs_at;      /* number of the comparison that finds a difference */
    tl_fmi2_times times;
    fmi2FMUstate full_copy, beginning;
    char why[120];
    tl_fmi2 own;
} ways;

static tl_time read_clock(void *context) {
    (void)context;
    return now;
}

/* ---- both methods; each really uses the states of the test FMU ---- */

static fmi2Status save(fmi2Component instance, fmi2FMUstate *state) {
    now += ways.is_by_copy ? ways.by_copy : ways.by_states;
    return ways.own.get_fmu_state(instance, state);
}

static fmi2Status restore(fmi2Component instance, fmi2FMUstate state) {
    ways.is_complete = ways.is_by_copy;
    now += ways.is_by_copy ? ways.by_copy : ways.by_states;
    fmu.control.state_lies = ways.is_by_copy && ways.is_inexact;
    fmi2Status status = ways.own.set_fmu_state(instance, state);
    fmu.control.state_lies = false;
    return status;
}

static fmi2Status keep(fmi2Component instance) {
    ways.kept++;
    now += ways.by_copy;
    return ways.own.get_fmu_state(instance, &ways.full_copy);
}

static fmi2Status restore_start(fmi2Component instance) {
    ways.is_complete = true;
    now += ways.by_copy;
    return ways.refuses ? fmi2Error : ways.own.set_fmu_state(instance, ways.full_copy);
}

/* Switches to the other method. */
static fmi2Status next_method(fmi2Component instance, const char *why) {
    (void)snprintf(ways.why, sizeof ways.why, "%s", why);
    ways.given_up++;
    if (ways.refuses) {
        return fmi2Error;
    }
    fmi2FMUstate beginning = ways.is_by_copy ? ways.beginning : ways.full_copy;
    ways.is_by_copy = !ways.is_by_copy;
    fmu.functions.always_final = ways.is_by_copy;
    return ways.own.set_fmu_state(instance, beginning);
}

static void end_proof(fmi2Component instance) {
    if (ways.full_copy != NULL) {
        (void)ways.own.free_fmu_state(instance, &ways.full_copy);
    }
    if (ways.beginning != NULL) {
        (void)ways.own.free_fmu_state(instance, &ways.beginning);
    }
}

/* Hides the final flag from the call checker, because a copy can be restored to before a final
 * step. */
static fmi2Status do_step(fmi2Component instance, fmi2Real point, fmi2Real step, fmi2Boolean final) {
    fmi2Status status = ways.own.do_step(instance, point, step, fmi2False);
    ways.was_final = final != fmi2False;
    ways.is_shown =
        ways.lacks_mode && (ways.is_complete ? point > 0.0 : ways.mode) && (ways.offset < 0.0 || ways.offset > 0.0);
    ways.mode = true;
    return status;
}

static fmi2Status get_real(fmi2Component instance, const fmi2ValueReference references[], size_t count,
                           fmi2Real values[]) {
    fmi2Status status = ways.own.get_real(instance, references, count, values);
    for (size_t i = 0; i < count && ways.sees_final && ways.was_final; i++) {
        values[i] += 1e-9;
    }
    for (size_t i = 0; i < count && ways.is_shown; i++) {
        values[i] += 1e-9;
    }
    return status;
}

static fmi2Status set_real(fmi2Component instance, const fmi2ValueReference references[], size_t count,
                           const fmi2Real values[]) {
    ways.offset = values[0];
    return ways.own.set_real(instance, references, count, values);
}

static size_t size(fmi2Component instance) {
    (void)instance;
    return 100;
}

static bool has_choice(fmi2Component instance) {
    (void)instance;
    return ways.is_there && !ways.is_by_copy;
}

static fmi2Status prefer_copy(fmi2Component instance, const tl_fmi2_times *times) {
    ways.preferred++;
    ways.times = *times;
    ways.is_by_copy = true;
    fmu.functions.always_final = true;
    return ways.own.get_fmu_state(instance, &ways.beginning);
}

static fmi2Status note_memory(fmi2Component instance) {
    (void)instance;
    ways.noted++;
    return fmi2OK;
}

static bool is_memory_same(fmi2Component instance) {
    (void)instance;
    return ++ways.compared != ways.differs_at;
}

static const tl_fmi2_fallback full_copy = {keep,       restore_start, next_method, end_proof,     size,
                                           has_choice, prefer_copy,   note_memory, is_memory_same};

/* ---- a twin with one FMU ---- */

void setUp(void) {
    now = 0;
    tl_test_plan_init(&plan, TL_SECOND / 10);
    tl_test_fmu_init(&fmu, 1, true, &call_log);
    ways = (struct ways){.by_states = SLOW, .by_copy = FAST, .is_there = true, .own = fmu.functions};
    fmu.functions.get_fmu_state = save;
    fmu.functions.set_fmu_state = restore;
    fmu.functions.do_step = do_step;
    fmu.functions.get_real = get_real;
    fmu.functions.set_real = set_real;
    fmu.functions.fallback = &full_copy;
    fmu.control.clock = &now;
    fmu.control.cost = STEP;
    (void)tl_test_plan_component(&plan, "motor", &fmu);
    tl_test_plan_set(&plan, "lag", 0.4);
    tl_test_plan_set(&plan, "u0", 1.0);
    tl_test_plan_set(&plan, "count", 1.0);
    tl_test_plan_set(&plan, "mode", 1.0);
    tl_test_plan_set_value(&plan, "flag", (tl_value){.type = TL_BOOLEAN, .integer = 1});
    tl_test_plan_signal(&plan, "y", TL_REAL, "");
    tl_test_plan_adjust(&plan, "motor.offset", 1.0);
    tl_test_plan_match(&plan, "motor.y0", "plant.y", 0.01);
    plan.plan.now = read_clock;
}

void tearDown(void) {
    tl_test_run_end(&run, &plan);
    TEST_ASSERT_EQUAL_size_t_MESSAGE(0, call_log.violations, call_log.first_violation);
}

static void tick(void) {
    tl_test_run_step(&run);
}

static void lead(tl_record *records) {
    tl_test_run_build(&run, &plan);
    for (int i = 0; i < TICKS; i++) {
        tick();
        TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, run.status, run.error.text);
        records[i] = run.record;
    }
}

static tl_record with[TICKS], without[TICKS];

static void lead_without(void) {
    plan.plan.now = NULL;
    lead(without);
    TEST_ASSERT_EQUAL_INT(0, ways.preferred);
    tearDown();
    setUp();
}

/* ---- tests ---- */

static void a_copy_that_is_faster_is_taken(void) {
    lead_without();
    lead(with);
    TEST_ASSERT_EQUAL_INT(1, ways.preferred);
    TEST_ASSERT_EQUAL_INT(0, ways.given_up);
    TEST_ASSERT_EQUAL_INT64(2 * SLOW + STEP, ways.times.by_states);
    TEST_ASSERT_EQUAL_INT64(2 * FAST + STEP, ways.times.by_copy);
    TEST_ASSERT_EQUAL_MEMORY(without, with, sizeof with);
    TEST_ASSERT_EQUAL_UINT64(tl_twin_executions(run.twin, 0),
                             fmu.calls[TL_TEST_DO_STEP] - tl_twin_get_facts(run.twin).proved_executions);
}

static void expect_states(void) {
    lead(with);
    TEST_ASSERT_EQUAL_INT(0, ways.preferred);
    TEST_ASSERT_EQUAL_INT(1, ways.noted);
    TEST_ASSERT_EQUAL_INT(EXCURSIONS, ways.compared);
}

static void a_copy_that_is_slower_is_not(void) {
    ways.by_copy = 2 * SLOW;
    expect_states();
}

/* The memory is compared at the start, or after a step if copies are far slower. */
static void far_slower_copies_need_the_same_memory_after_a_step(void) {
    uint64_t executions[2];
    for (int i = 0; i < 2; i++) {
        ways.by_copy = (i == 0 ? 29 : 31) * SLOW;
        expect_states();
        executions[i] = tl_twin_get_facts(run.twin).proved_executions;
        tearDown();
        setUp();
    }
    TEST_ASSERT_EQUAL_UINT64(executions[0] + EXCURSIONS + 1, executions[1]);
}

/* Own states lack memory that any of the excursions has changed. */
static void a_copy_that_is_slower_is_taken_if_states_lack_memory(void) {
    for (int i = 1; i <= EXCURSIONS; i++) {
        ways.by_copy = 20 * SLOW;
        ways.differs_at = i;
        lead(with);
        TEST_ASSERT_EQUAL_INT(1, ways.preferred);
        TEST_ASSERT_EQUAL_INT(0, ways.given_up);
        TEST_ASSERT_EQUAL_INT(i, ways.compared);
        tearDown();
        setUp();
    }
}

static void expect_copy(void) {
    lead(with);
    TEST_ASSERT_EQUAL_INT(1, ways.preferred);
    TEST_ASSERT_EQUAL_INT(0, ways.given_up);
}

static void a_copy_that_is_a_little_slower_is_taken(void) {
    ways.by_copy = SLOW + SLOW / 5;
    expect_copy();
}

/* More than ten times as slow, but the absolute loss is small. */
static void a_loss_of_microseconds_is_too_small(void) {
    fmu.control.cost = 0;
    ways.by_states = 450;
    ways.by_copy = 5400;
    expect_copy();
}

/* The step dominates the time. */
static void the_time_of_a_step_counts(void) {
    fmu.control.cost = 100 * SLOW;
    ways.by_copy = 2 * SLOW;
    expect_copy();
}

/* Own states are kept because they are fast. They lack a mode that only excursions enter, but
 * repeat their values exactly. */
static void fast_states_must_agree_with_copies(void) {
    ways.by_copy = 4 * SLOW;
    ways.lacks_mode = true;
    lead(with);
    TEST_ASSERT_EQUAL_INT(0, ways.preferred);
    TEST_ASSERT_EQUAL_INT(1, ways.given_up);
    TEST_ASSERT_TRUE(ways.is_by_copy);
}

static void without_a_choice_nothing_is_timed(void) {
    ways.is_there = false;
    lead(with);
    TEST_ASSERT_EQUAL_INT(1, ways.kept); /* for the rollback check */
    TEST_ASSERT_EQUAL_INT(0, ways.preferred);
}

static void a_slow_method_is_timed_only_briefly(void) {
    ways.by_states = TL_SECOND / 10;
    lead(with);
    TEST_ASSERT_EQUAL_INT(1, ways.preferred);
    TEST_ASSERT_LESS_THAN_INT64(5 * TL_SECOND, now); /* 3.5 s of these are the proof's */
}

static void a_copy_that_is_not_exact_is_given_up(void) {
    lead_without();
    ways.is_inexact = true;
    lead(with);
    TEST_ASSERT_EQUAL_INT(1, ways.preferred);
    TEST_ASSERT_EQUAL_INT(1, ways.given_up);
    TEST_ASSERT_FALSE(ways.is_by_copy);
    TEST_ASSERT_EQUAL_MEMORY(without, with, sizeof with);
}

/* The check finds this before it times the methods, also without a clock. */
static void an_fmu_that_depends_on_the_final_flag_is_copied(void) {
    for (int i = 0; i < 2; i++) {
        plan.plan.now = i == 0 ? read_clock : NULL;
        ways.sees_final = true;
        lead(i == 0 ? with : without);
        TEST_ASSERT_EQUAL_INT(1, ways.given_up);
        TEST_ASSERT_EQUAL_INT(0, ways.preferred);
        TEST_ASSERT_TRUE(ways.is_by_copy && ways.was_final);
        TL_EXPECT_PARTS("final", ways.why);
        if (i == 0) {
            tearDown();
            setUp();
        }
    }
    TEST_ASSERT_EQUAL_MEMORY(without, with, sizeof with);
}

static uint64_t steps_until_timed; /* of the rollback check before it */

/* Notes the first timed step. */
static fmi2Status keep_and_count(fmi2Component instance) {
    steps_until_timed = fmu.calls[TL_TEST_DO_STEP];
    return keep(instance);
}

static void find_steps_until_timed(void) {
    static const tl_fmi2_fallback counting = {keep_and_count, restore_start, next_method, end_proof,     size,
                                              has_choice,     prefer_copy,   note_memory, is_memory_same};
    fmu.functions.fallback = &counting;
    lead(with);
    steps_until_timed -= 2 * TL_ROLLBACK_TIMING_ROUNDS + 1; /* the last round begins with a copy */
    tearDown();
    setUp();
}

static void a_method_with_a_failed_step_is_not_chosen(void) {
    find_steps_until_timed();
    tl_test_fmu_fail(&fmu, TL_TEST_DO_STEP, TL_TEST_ERROR, steps_until_timed + 3, steps_until_timed + 3);
    lead(with);
    TEST_ASSERT_EQUAL_INT(0, ways.preferred);
}

static void a_fatal_step_ends_the_twin(void) {
    find_steps_until_timed();
    tl_test_fmu_fail(&fmu, TL_TEST_DO_STEP, TL_TEST_FATAL, steps_until_timed + 3, steps_until_timed + 3);
    tl_test_run_build(&run, &plan);
    tick();
    TEST_ASSERT_EQUAL_INT(TL_FMU_FATAL, run.status);
}

static void an_fmu_that_cannot_return_to_the_start_ends_the_twin(void) {
    ways.refuses = true;
    tl_test_run_build(&run, &plan);
    tick();
    TEST_ASSERT_EQUAL_INT(TL_FMU_FAILED, run.status);
    TL_EXPECT_PARTS("motor", run.error.text);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(a_copy_that_is_faster_is_taken);
    RUN_TEST(a_copy_that_is_slower_is_not);
    RUN_TEST(far_slower_copies_need_the_same_memory_after_a_step);
    RUN_TEST(a_copy_that_is_slower_is_taken_if_states_lack_memory);
    RUN_TEST(a_copy_that_is_a_little_slower_is_taken);
    RUN_TEST(a_loss_of_microseconds_is_too_small);
    RUN_TEST(the_time_of_a_step_counts);
    RUN_TEST(fast_states_must_agree_with_copies);
    RUN_TEST(without_a_choice_nothing_is_timed);
    RUN_TEST(a_slow_method_is_timed_only_briefly);
    RUN_TEST(a_copy_that_is_not_exact_is_given_up);
    RUN_TEST(an_fmu_that_depends_on_the_final_flag_is_copied);
    RUN_TEST(a_method_with_a_failed_step_is_not_chosen);
    RUN_TEST(a_fatal_step_ends_the_twin);
    RUN_TEST(an_fmu_that_cannot_return_to_the_start_ends_the_twin);
    return UNITY_END();
}
