/* Between ticks, a twin verifies that its FMUs still restore their states. That changes no value,
 * and detects wrong states. */
#include <math.h>
#include <string.h>
#include <unity.h>

#include "master/sync/verifier.h"
#include "tests/support/test_plan.h"

enum { TICKS = 200, EVERY = 7, WRONG_FROM = 60 };

static tl_test_log call_log;
static tl_test_fmu fmus[2];
static tl_test_plan plan;
static tl_test_run run;

/* Results of a run of TICKS. */
typedef struct outcome {
    tl_record records[TICKS];
    size_t count;
    size_t found;
    int64_t found_at; /* tick of the first finding */
    tl_twin_finding finding;
} outcome;

static outcome with, without;

static tl_plan_component *add(const char *name, size_t width) {
    tl_test_fmu *fmu = &fmus[plan.plan.component_count];
    tl_test_fmu_init(fmu, width, true, &call_log);
    tl_plan_component *component = tl_test_plan_component(&plan, name, fmu);
    tl_test_plan_set(&plan, "lag", 0.4);
    tl_test_plan_set(&plan, "u0", 1.0);
    tl_test_plan_set(&plan, "count", 1.0);
    tl_test_plan_set(&plan, "mode", 1.0);
    return component;
}

/* A drive with an input from the plant, and a motor with a searched offset. */
void setUp(void) {
    tl_test_plan_init(&plan, TL_SECOND / 10);
    (void)add("drive", 1);
    tl_test_plan_set_value(&plan, "flag", (tl_value){.type = TL_BOOLEAN, .integer = 1});
    (void)add("motor", 1);
    tl_test_plan_signal(&plan, "y", TL_REAL, "");
    tl_test_plan_connect(&plan, "plant.y", "drive.u0");
    tl_test_plan_connect(&plan, "drive.y0", "motor.u0");
    tl_test_plan_connect(&plan, "drive.flag_out", "motor.flag");
    tl_test_plan_adjust(&plan, "motor.offset", 1.0);
    tl_test_plan_match(&plan, "motor.y0", "plant.y", 0.01);
    plan.plan.verify_every = EVERY;
}

void tearDown(void) {
    tl_test_run_end(&run, &plan);
}

static void tick(int64_t number) {
    run.sample.values[0] = sin(0.2 * (double)number) + (number % 3 == 0 ? 0.3 : 0.0);
    tl_test_run_step(&run);
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, run.status, run.error.text);
}

/* Runs the present plan. From WRONG_FROM on, states of `liar` are wrong. */
static void lead(outcome *seen, tl_test_fmu *liar) {
    memset(seen, 0, sizeof *seen);
    tl_test_run_build(&run, &plan);
    for (int64_t i = 0; i < TICKS; i++) {
        bool found = false;
        tl_twin_finding finding;
        tick(i);
        if (run.ready) {
            seen->records[seen->count++] = run.record;
        }
        if (liar != NULL && i == WRONG_FROM) {
            liar->control.state_lies = true;
        }
        TEST_ASSERT_EQUAL_INT(TL_OK, tl_twin_verify(run.twin, &run.budget, &finding, &found, &run.error));
        if (found && seen->found++ == 0) {
            seen->found_at = i;
            seen->finding = finding;
        }
    }
}

static void begin_anew(void) {
    tearDown();
    setUp();
}

/* ---- it changes nothing ---- */

static void assert_same(void) {
    TEST_ASSERT_EQUAL_UINT64(without.count, with.count);
    for (size_t i = 0; i < with.count; i++) {
        const tl_record *a = &without.records[i];
        const tl_record *b = &with.records[i];
        TEST_ASSERT_EQUAL_MEMORY(a->y, b->y, sizeof a->y[0]);
        TEST_ASSERT_EQUAL_MEMORY(a->u, b->u, sizeof a->u[0]);
        TEST_ASSERT_EQUAL_UINT32(a->evaluations, b->evaluations);
        TEST_ASSERT_EQUAL_UINT32(a->executions, b->executions);
        TEST_ASSERT_EQUAL_UINT32(a->flags, b->flags);
    }
}

typedef struct way {
    uint32_t prediction;
    bool structure, sequences;
    tl_keep keep;
    tl_pairing measurements;
} way;

static void use_way(const way *of) {
    plan.plan.prediction = of->prediction;
    plan.plan.saving.structure = of->structure;
    plan.plan.saving.sequences = of->sequences;
    plan.plan.measurements = of->measurements;
    plan.components[0].keep = plan.components[1].keep = of->keep;
}

static void assert_way(const way *of) {
    use_way(of);
    plan.plan.verify_every = 0;
    lead(&without, NULL);
    TEST_ASSERT_EQUAL_UINT64(0, tl_twin_get_facts(run.twin).verified);
    begin_anew();
    use_way(of);
    lead(&with, NULL);
    tl_twin_facts facts = tl_twin_get_facts(run.twin);
    TEST_ASSERT_GREATER_OR_EQUAL_UINT64(8, facts.verified);
    TEST_ASSERT_EQUAL_UINT64(TL_VERIFIED_EXECUTIONS * facts.verified, facts.verified_executions);
    TEST_ASSERT_EQUAL_UINT64(0, facts.differed + with.found);
    assert_same();
    begin_anew();
}

static void an_honest_twin_is_the_same_to_the_bit(void) {
    static const way ways[] = {
        {1, true, true, TL_KEEP_STATES, TL_LAG},   {4, true, true, TL_KEEP_STATES, TL_LAG},
        {4, true, true, TL_KEEP_OUTPUTS, TL_LAG},  {3, true, false, TL_KEEP_STATES, TL_LAG},
        {3, false, true, TL_KEEP_STATES, TL_HOLD}, {2, false, false, TL_KEEP_STATES, TL_AHEAD},
        {3, true, true, TL_KEEP_STATES, TL_AHEAD},
    };
    for (size_t i = 0; i < sizeof ways / sizeof ways[0]; i++) {
        assert_way(&ways[i]);
    }
}

static void nothing_is_looked_at_if_nothing_is_adjusted(void) {
    plan.plan.adjust_count = 0;
    lead(&with, NULL);
    TEST_ASSERT_EQUAL_UINT64(0, tl_twin_get_facts(run.twin).verified);
    TEST_ASSERT_EQUAL_size_t(0, tl_test_log_count(&call_log, NULL, TL_TEST_GET_STATE));
}

/* ---- what it finds ---- */

static size_t flagged(const outcome *seen) {
    size_t count = 0;
    for (size_t i = 0; i < seen->count; i++) {
        count += (seen->records[i].flags & TL_FLAG_DIFFERED) != 0 ? 1 : 0;
    }
    return count;
}

static void states_that_are_wrong_later_are_found(void) {
    lead(&with, &fmus[1]);
    TEST_ASSERT_EQUAL_size_t(1, with.found); /* without another method it is not verified again */
    TEST_ASSERT_LESS_OR_EQUAL_INT64(WRONG_FROM + 3 * EVERY + 8, with.found_at);
    TEST_ASSERT_EQUAL_STRING("motor", with.finding.component);
    TEST_ASSERT_EQUAL_STRING("y0", with.finding.variable);
    TEST_ASSERT_TRUE(fabs(with.finding.again - with.finding.committed) / 0.01 == with.finding.tolerances);
    TEST_ASSERT_FALSE(with.finding.mended);
    TEST_ASSERT_EQUAL_INT(TL_CAUSE_UNKNOWN, with.finding.cause);
    TEST_ASSERT_EQUAL_size_t((size_t)(TICKS - 1 - with.found_at), flagged(&with)); /* all records since the finding */
    TEST_ASSERT_EQUAL_UINT64(1, tl_twin_get_facts(run.twin).differed);
}

static void what_is_not_matched_is_found_too(void) {
    lead(&with, &fmus[0]);
    TEST_ASSERT_EQUAL_size_t(1, with.found);
    TEST_ASSERT_EQUAL_STRING("drive", with.finding.component);
    TEST_ASSERT_TRUE(isnan(with.finding.tolerances));
    TEST_ASSERT_GREATER_THAN_size_t(0, flagged(&with));
}

static void less_than_a_hundredth_of_a_tolerance_is_told_once(void) {
    plan.match[0].tolerance = 1e6;
    lead(&with, &fmus[1]);
    TEST_ASSERT_EQUAL_size_t(1, with.found);
    TEST_ASSERT_TRUE(with.finding.tolerances < 0.01);
    TEST_ASSERT_EQUAL_size_t(1, flagged(&with));
}

/* ---- another rollback method ---- */

static fmi2FMUstate kept[2];
static int given_up;

static size_t fmu_of(fmi2Component instance) {
    return (const void *)fmus[0].alive == instance ? 0 : 1;
}

static fmi2Status keep_aside(fmi2Component instance) {
    size_t i = fmu_of(instance);
    return fmus[i].functions.get_fmu_state(instance, &kept[i]);
}

/* Restores the right state. */
static fmi2Status restore_start(fmi2Component instance) {
    size_t i = fmu_of(instance);
    bool lies = fmus[i].control.state_lies;
    fmus[i].control.state_lies = false;
    fmi2Status status = fmus[i].functions.set_fmu_state(instance, kept[i]);
    fmus[i].control.state_lies = lies;
    return status;
}

static fmi2Status next_method(fmi2Component instance, const char *why) {
    (void)why;
    given_up++;
    fmus[fmu_of(instance)].control.state_lies = false;
    return restore_start(instance);
}

static void end_proof(fmi2Component instance) {
    size_t i = fmu_of(instance);
    if (kept[i] != NULL) {
        (void)fmus[i].functions.free_fmu_state(instance, &kept[i]);
    }
}

static size_t size_aside(fmi2Component instance) {
    (void)instance;
    return 100;
}

static bool has_choice(fmi2Component instance) {
    (void)instance;
    return false;
}

static const tl_fmi2_fallback other_way = {keep_aside, restore_start, next_method, end_proof, size_aside,
                                           has_choice, NULL,          NULL,        NULL};

static void use_other_way(void) {
    given_up = 0;
    fmus[0].functions.fallback = fmus[1].functions.fallback = &other_way;
}

/* With one unknown and a right guess, only the verification restores states. So the values equal
 * those of a correct FMU. */
static void a_liar_with_another_way_goes_it(void) {
    plan.match[0].tolerance = 1e6;
    use_other_way();
    lead(&without, NULL);
    begin_anew();
    plan.match[0].tolerance = 1e6;
    use_other_way();
    lead(&with, &fmus[1]);
    TEST_ASSERT_EQUAL_size_t(1, with.found);
    TEST_ASSERT_TRUE(with.finding.mended);
    TEST_ASSERT_EQUAL_INT(TL_CAUSE_INCOMPLETE, with.finding.cause); /* a wrong state restores nothing */
    TEST_ASSERT_EQUAL_INT(1, given_up);
    TEST_ASSERT_EQUAL_size_t(1, flagged(&with));
    for (size_t i = 0; i < with.count; i++) {
        with.records[i].flags = 0;
        with.records[i].executions = without.records[i].executions; /* executions after the caches were emptied */
    }
    assert_same();
    TEST_ASSERT_GREATER_THAN_UINT64((uint64_t)with.found_at / EVERY / 2, tl_twin_get_facts(run.twin).verified);
    for (size_t k = 0; k < 3; k++) {
        TEST_ASSERT_EQUAL_INT64(0, tl_twin_get_ledger(run.twin, k).difference);
    }
}

static fmi2Status no_method(fmi2Component instance, const char *why) {
    (void)instance;
    (void)why;
    return fmi2Error;
}

/* The caches are emptied before the FMU rejects the other method: the ledger must know that. */
static void the_ledger_holds_without_another_way(void) {
    static const tl_fmi2_fallback no_way = {keep_aside, restore_start, no_method, end_proof, size_aside,
                                            has_choice, NULL,          NULL,      NULL};
    static const way saving = {4, true, true, TL_KEEP_STATES, TL_LAG};
    use_way(&saving);
    fmus[0].functions.fallback = fmus[1].functions.fallback = &no_way;
    lead(&with, &fmus[1]);
    TEST_ASSERT_EQUAL_size_t(1, with.found);
    TEST_ASSERT_FALSE(with.finding.mended);
    for (size_t k = 0; k < 3; k++) {
        TEST_ASSERT_EQUAL_INT64(0, tl_twin_get_ledger(run.twin, k).difference);
    }
    tl_test_log_clear(&call_log); /* the search for the cause steps the FMU from the time of a candidate */
}

/* ---- calls that fail ---- */

/* Runs until FMU `which` is about to be repeated: the next tl_twin_verify() does that. */
static void lead_to_repetition(size_t which) {
    bool found = false;
    tl_twin_finding finding;
    tl_test_run_build(&run, &plan);
    for (int64_t i = 0; i < TICKS; i++) {
        tick(i);
        uint64_t fails =
            fmus[which].calls[TL_TEST_DO_STEP] + 2 * TL_VERIFIED_STEPS + 2; /* after the candidate, both times */
        tl_test_fmu_fail(&fmus[which], TL_TEST_DO_STEP, TL_TEST_ERROR, fails, fails);
        TEST_ASSERT_EQUAL_INT(TL_OK, tl_twin_verify(run.twin, &run.budget, &finding, &found, &run.error));
        tl_test_fmu_fail(&fmus[which], TL_TEST_DO_STEP, TL_TEST_ERROR, 0, 0);
        if (found) {
            with.finding = finding;
            with.found_at = i;
            return;
        }
    }
    TEST_FAIL_MESSAGE("it has never been executed again");
}

static void a_step_that_fails_when_it_is_repeated_is_found(void) {
    lead_to_repetition(1);
    TEST_ASSERT_NULL(with.finding.variable);
    TEST_ASSERT_EQUAL_INT(TL_CAUSE_REFUSES, with.finding.cause);
    TEST_ASSERT_EQUAL_STRING("motor", with.finding.component);
    TEST_ASSERT_EQUAL_UINT(2, with.finding.after);
    tick(with.found_at + 1); /* the twin continues */
    TEST_ASSERT_EQUAL_UINT32(TL_FLAG_DIFFERED, run.record.flags & TL_FLAG_DIFFERED);
}

/* The next call of this kind during verification fails or is fatal; the twin must end. */
static void assert_ends(tl_test_call call, tl_test_fault_kind kind, tl_status expected) {
    bool found = false;
    tl_twin_finding finding;
    tl_status status = TL_OK;
    tl_test_run_build(&run, &plan);
    for (int64_t i = 0; i < TICKS && status == TL_OK; i++) {
        tick(i);
        uint64_t before = fmus[1].calls[call];
        tl_test_fmu_fail(&fmus[1], call, kind, before + 1, before + 3);
        status = tl_twin_verify(run.twin, &run.budget, &finding, &found, &run.error);
        tl_test_fmu_fail(&fmus[1], call, kind, 0, 0);
    }
    TEST_ASSERT_EQUAL_INT(expected, status);
    tl_test_run_step(&run);
    TEST_ASSERT_EQUAL_INT(expected, run.status);
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_twin_verify(run.twin, &run.budget, &finding, &found, &run.error));
    TEST_ASSERT_FALSE(found);
    begin_anew();
}

static void what_cannot_be_brought_back_is_the_end(void) {
    assert_ends(TL_TEST_DO_STEP, TL_TEST_FATAL, TL_FMU_FATAL);
    assert_ends(TL_TEST_GET_STATE, TL_TEST_FATAL, TL_FMU_FATAL);
    assert_ends(TL_TEST_SET_STATE, TL_TEST_FATAL, TL_FMU_FATAL);
    assert_ends(TL_TEST_GET_STATE, TL_TEST_ERROR, TL_FMU_FAILED);
    assert_ends(TL_TEST_SET_STATE, TL_TEST_ERROR, TL_FMU_FAILED);
}

/* ---- time ---- */

static tl_time now;

static tl_time read_now(void *context) {
    (void)context;
    return now;
}

/* Runs with a clock; `left` of the time remains after each tick. */
static uint64_t verified_with(tl_time left) {
    static const tl_time cost = TL_SECOND / 1000;
    bool found = false;
    tl_twin_finding finding;
    run.budget.now = read_now;
    for (size_t i = 0; i < 2; i++) {
        fmus[i].control.clock = &now;
        fmus[i].control.cost = cost;
    }
    tl_test_run_build(&run, &plan);
    run.budget.now = read_now;
    run.budget.time = TL_SECOND;
    for (int64_t i = 0; i < TICKS; i++) {
        run.budget.started = now;
        tick(i);
        const tl_budget rest = {.now = read_now, .started = now, .time = left};
        TEST_ASSERT_EQUAL_INT(TL_OK, tl_twin_verify(run.twin, &rest, &finding, &found, &run.error));
        TEST_ASSERT_TRUE(now - rest.started <= (left > 0 ? left : 0));
        now += TL_SECOND;
    }
    return tl_twin_get_facts(run.twin).verified;
}

static void nothing_is_begun_that_there_is_no_time_for(void) {
    TEST_ASSERT_EQUAL_UINT64(0, verified_with(0));
    begin_anew();
    TEST_ASSERT_EQUAL_UINT64(0, verified_with(TL_SECOND / 1000 * 3)); /* three steps only */
    begin_anew();
    TEST_ASSERT_GREATER_OR_EQUAL_UINT64(8, verified_with(TL_SECOND / 2));
}

/* ---- the FMUs are reset ---- */

static void what_was_noted_is_of_no_use_then(void) {
    bool found = false;
    tl_twin_finding finding;
    tl_test_run_build(&run, &plan);
    for (int64_t i = 0; i < TICKS; i++) {
        if (i % 11 == 10) {
            fmus[i % 2].control.fault.kind = TL_TEST_ERROR;
            tl_test_fmu_fail(&fmus[i % 2], TL_TEST_RESET, TL_TEST_ERROR, 1, i % 22 == 10 ? UINT64_MAX : 0);
            tl_twin_reset(run.twin);
        }
        tick(i);
        TEST_ASSERT_EQUAL_INT(TL_OK, tl_twin_verify(run.twin, &run.budget, &finding, &found, &run.error));
        TEST_ASSERT_FALSE(found);
    }
    TEST_ASSERT_GREATER_OR_EQUAL_UINT64(1, tl_twin_get_facts(run.twin).verified);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(an_honest_twin_is_the_same_to_the_bit);
    RUN_TEST(nothing_is_looked_at_if_nothing_is_adjusted);
    RUN_TEST(states_that_are_wrong_later_are_found);
    RUN_TEST(what_is_not_matched_is_found_too);
    RUN_TEST(less_than_a_hundredth_of_a_tolerance_is_told_once);
    RUN_TEST(a_liar_with_another_way_goes_it);
    RUN_TEST(the_ledger_holds_without_another_way);
    RUN_TEST(a_step_that_fails_when_it_is_repeated_is_found);
    RUN_TEST(what_cannot_be_brought_back_is_the_end);
    RUN_TEST(nothing_is_begun_that_there_is_no_time_for);
    RUN_TEST(what_was_noted_is_of_no_use_then);
    return UNITY_END();
}
