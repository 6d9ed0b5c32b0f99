/* Fewer executions with the same result: table 4.2, chains, small pools, and failing candidates,
 * against the ledger. */
#include <stdio.h>
#include <string.h>
#include <unity.h>

#include "tests/support/random_numbers.h"
#include "tests/support/test_network.h"
#include "tests/support/test_rig.h"

static tl_test_log call_log;
static tl_test_plan plan;
static tl_test_network network;
static tl_test_rig rig;

void setUp(void) {
    tl_test_log_clear(&call_log);
    memset(&rig, 0, sizeof rig);
    memset(&network, 0, sizeof network);
}

static void end(void) {
    tl_test_rig_end(&rig);
    for (size_t k = 0; k < network.count; k++) {
        TEST_ASSERT_EQUAL_UINT64(0, network.fmus[k].states);
        TEST_ASSERT_EQUAL_UINT64(0, network.fmus[k].living);
    }
    tl_test_network_end(&network);
    TEST_ASSERT_EQUAL_STRING("", call_log.first_violation);
}

void tearDown(void) {
    tl_test_network_end(&network);
    TEST_ASSERT_EQUAL_STRING("", call_log.first_violation);
}

/* ---- the graphs of Fig. 4.4 ---- */

static void make_chain(size_t length) {
    tl_test_network_init(&network, &plan, &call_log, length);
    TEST_ASSERT_NOT_NULL(tl_test_network_adjust(&network, 0));
    for (size_t k = 0; k + 1 < length; k++) {
        TEST_ASSERT_NOT_NULL(tl_test_network_edge(&network, (int)k, k + 1));
    }
    (void)tl_test_network_match(&network, length - 1);
}

static void make_a(void) {
    make_chain(3);
    tl_test_network_build(&network);
}

static void make_b(void) {
    tl_test_network_init(&network, &plan, &call_log, 5);
    (void)tl_test_network_adjust(&network, 0);
    for (size_t k = 1; k <= 3; k++) {
        (void)tl_test_network_edge(&network, 0, k);
        (void)tl_test_network_edge(&network, (int)k, 4);
    }
    (void)tl_test_network_match(&network, 4);
    tl_test_network_build(&network);
}

static void make_c(void) {
    tl_test_network_init(&network, &plan, &call_log, 2);
    (void)tl_test_network_edge(&network, 0, 1);
    (void)tl_test_network_adjust(&network, 1);
    (void)tl_test_network_match(&network, 1);
    tl_test_network_build(&network);
}

static void make_d(void) {
    make_chain(3);
    (void)tl_test_network_edge(&network, 2, 1);
    tl_test_network_build(&network);
}

/* Table 4.2; for approach 1 alone also the text of 4.4.1 (3 + 2 + 1). The numbers are executions
 * of one evaluation with T_P = T_D, without the plant. The arrow before 3 and 5 means: from the
 * second evaluation on; the first one costs as much as with approach 1. Without kept states, FMUs
 * must catch up skipped steps (table 4.1, left column), so nothing is saved beyond approach 1. */
typedef struct thesis_row {
    void (*make)(void);
    uint32_t distance;
    uint64_t without;
    uint64_t structure;
    uint64_t both;
    uint64_t outputs;  /* both, without kept states */
    uint64_t reach[5]; /* executions of each component with approach 1 (eq. 4.5) */
} thesis_row;

static const thesis_row TABLE[] = {{make_a, 3, 9, 6, 3, 6, {1, 2, 3}},
                                   {make_b, 3, 15, 10, 5, 10, {1, 2, 2, 2, 3}},
                                   {make_c, 1, 2, 1, 1, 1, {0, 1}},
                                   {make_d, 3, 9, 6, 3, 6, {1, 2, 3}}};

enum { ROWS = sizeof TABLE / sizeof TABLE[0], EVALUATIONS = 6 };

/* The value of the n-th evaluation; all differ. */
static double nth(size_t n) {
    return 1.0 + 0.25 * (double)n;
}

/* Per component: T_P, or Γ_k with approach 1. From the second evaluation on, one for each
 * component between u and y. */
static void assert_components(const thesis_row *row, bool structure, bool later) {
    for (size_t k = 0; k < network.count; k++) {
        uint64_t reach = structure ? row->reach[k] : row->distance;
        uint64_t expected = later && reach > 1 ? 1 : reach;
        TEST_ASSERT_EQUAL_UINT64(expected, tl_test_rig_done(&rig, k));
        TEST_ASSERT_EQUAL_UINT64(expected, tl_test_rig_predicted(&rig, k));
    }
}

/* Evaluations of one step: the first costs at most as much as with approach 1, each other exactly
 * `later`. */
static void assert_row(const thesis_row *row, bool structure, bool sequences, tl_keep keep, uint64_t later) {
    row->make();
    plan.plan.saving = (tl_plan_saving){.structure = structure, .sequences = sequences};
    for (size_t k = 0; k < network.count; k++) {
        plan.components[k].keep = keep;
    }
    tl_test_rig_start(&rig, &plan, 64);
    TEST_ASSERT_EQUAL_UINT32(row->distance, rig.horizon.distance);
    TEST_ASSERT_EQUAL_UINT32(row->distance, rig.horizon.prediction);
    for (size_t n = 0; n < EVALUATIONS; n++) {
        double u = nth(n);
        TEST_ASSERT_NOT_EQUAL_UINT64(0, tl_test_rig_try(&rig, &u));
        uint64_t first = structure ? row->structure : row->without;
        TEST_ASSERT_EQUAL_UINT64(n == 0 ? first : later, tl_test_rig_executions(&rig));
        assert_components(row, structure, sequences && n > 0);
    }
    end();
}

static void table_4_2_without_anything(void) {
    for (size_t i = 0; i < ROWS; i++) {
        assert_row(&TABLE[i], false, false, TL_KEEP_STATES, TABLE[i].without);
    }
}

static void table_4_2_with_approach_1_alone(void) {
    for (size_t i = 0; i < ROWS; i++) {
        assert_row(&TABLE[i], true, false, TL_KEEP_STATES, TABLE[i].structure);
    }
}

static void table_4_2_with_both_from_the_second_evaluation_on(void) {
    for (size_t i = 0; i < ROWS; i++) {
        assert_row(&TABLE[i], true, true, TL_KEEP_STATES, TABLE[i].both);
    }
}

static void table_4_2_with_both_and_outputs_only(void) {
    for (size_t i = 0; i < ROWS; i++) {
        assert_row(&TABLE[i], true, true, TL_KEEP_OUTPUTS, TABLE[i].outputs);
    }
}

/* The commit executes all components with structure alone, and only unknown steps with both. */
static void the_committing_step_runs_what_is_not_known(void) {
    make_b();
    plan.plan.saving = (tl_plan_saving){.structure = true, .sequences = true};
    tl_test_rig_start(&rig, &plan, 64);
    double u = 1.0;
    double v = 2.0;
    (void)tl_test_rig_try(&rig, &u);
    (void)tl_test_rig_commit(&rig, &v);
    TEST_ASSERT_EQUAL_UINT64(1, tl_test_rig_executions(&rig)); /* u reaches only this one in the first step */
    (void)tl_test_rig_try(&rig, &u);
    (void)tl_test_rig_commit(&rig, &u);
    TEST_ASSERT_EQUAL_UINT64(0, tl_test_rig_executions(&rig));
    end();
    make_b();
    plan.plan.saving = (tl_plan_saving){.structure = true, .sequences = false};
    tl_test_rig_start(&rig, &plan, 64);
    (void)tl_test_rig_try(&rig, &u);
    (void)tl_test_rig_commit(&rig, &u);
    TEST_ASSERT_EQUAL_UINT64(5, tl_test_rig_executions(&rig));
    end();
}

/* The overlap of horizons and unaffected components are known from the sequences. */
static void horizons_overlap(void) {
    make_chain(2);
    tl_test_network_build(&network);
    plan.plan.prediction = 6;
    plan.plan.saving = (tl_plan_saving){.structure = true, .sequences = true};
    tl_test_rig_start(&rig, &plan, 64);
    double u = 1.0;
    (void)tl_test_rig_try(&rig, &u);
    TEST_ASSERT_EQUAL_UINT64(5 + 6, tl_test_rig_executions(&rig));
    for (size_t step = 0; step < 20; step++) {
        (void)tl_test_rig_commit(&rig, &u);
        TEST_ASSERT_EQUAL_UINT64(0, tl_test_rig_executions(&rig));
        (void)tl_test_rig_try(&rig, &u);
        TEST_ASSERT_EQUAL_UINT64(2, tl_test_rig_executions(&rig)); /* the newest step of each */
        TEST_ASSERT_EQUAL_UINT64(1, tl_test_rig_predicted(&rig, 0));
        TEST_ASSERT_EQUAL_UINT64(1, tl_test_rig_predicted(&rig, 1));
    }
    end();
}

/* ---- recorded candidates ---- */

/* Starts row `make_b` with a ledger that remembers at most `capacity` candidates. */
static void start_b(size_t capacity) {
    make_b();
    plan.plan.saving = (tl_plan_saving){.structure = true, .sequences = true};
    tl_test_rig_start(&rig, &plan, 64);
    TEST_ASSERT_TRUE(capacity <= rig.ledger.capacity);
    rig.ledger.capacity = capacity;
}

static void record_candidate(double u) {
    tl_ledger_walked(&rig.ledger, &u, rig.horizon.prediction, SIZE_MAX);
}

static uint64_t predicted_by_ledger(void) {
    uint64_t sum = 0;
    for (size_t k = 0; k < network.count; k++) {
        sum += tl_ledger_predicted(&rig.ledger, k);
    }
    return sum;
}

static void candidates_count_when_they_are_evaluated(void) {
    double u = 1.0;
    start_b(EVALUATIONS);
    record_candidate(u);
    record_candidate(2.0);
    record_candidate(u);
    tl_ledger_commit(&rig.ledger, &u);
    TEST_ASSERT_EQUAL_UINT64(0, tl_ledger_total(&rig.ledger));
    uint64_t executions = tl_ledger_evaluate(&rig.ledger);
    TEST_ASSERT_EQUAL_UINT64(10 + 5, predicted_by_ledger());
    TEST_ASSERT_EQUAL_UINT64(tl_ledger_total(&rig.ledger), executions);
    TEST_ASSERT_EQUAL_UINT64(0, tl_ledger_evaluate(&rig.ledger));
    end();
}

static void a_reset_evaluates_what_is_recorded(void) {
    double u = 1.0;
    start_b(EVALUATIONS);
    for (uint64_t round = 1; round <= 2; round++) {
        record_candidate(u);
        record_candidate(u);
        tl_ledger_commit(&rig.ledger, &u);
        tl_ledger_reset(&rig.ledger);
        TEST_ASSERT_EQUAL_UINT64(10 * round, predicted_by_ledger());
        TEST_ASSERT_EQUAL_INT64((int64_t)round, rig.ledger.step);
    }
    record_candidate(u);
    tl_ledger_forget(&rig.ledger);
    TEST_ASSERT_EQUAL_UINT64(0, tl_ledger_evaluate(&rig.ledger));
    end();
}

static void a_full_ring_predicts_too_much(void) {
    for (size_t capacity = 3; capacity <= 4; capacity++) {
        bool is_full = capacity == 3;
        start_b(capacity);
        for (size_t n = 0; n < 4; n++) {
            record_candidate(nth(n % 3));
        }
        (void)tl_ledger_evaluate(&rig.ledger);
        TEST_ASSERT_EQUAL(is_full, rig.ledger.incomplete);
        TEST_ASSERT_EQUAL_UINT64(10 + 2 * 5 + (is_full ? 5 : 0), predicted_by_ledger());
        end();
    }
}

/* Of each step whose horizon has not ended, only different candidates remain. */
static void alike_candidates_are_dropped_after_the_commit(void) {
    start_b(EVALUATIONS);
    for (size_t step = 0; step < 20; step++) {
        double u = nth(step);
        for (size_t n = 1; n <= 3; n++) {
            record_candidate(u + (double)n);
        }
        tl_ledger_commit(&rig.ledger, &u);
        (void)tl_ledger_evaluate(&rig.ledger);
        TEST_ASSERT_TRUE(rig.ledger.count < rig.horizon.prediction);
    }
    TEST_ASSERT_FALSE(rig.ledger.incomplete);
    end();
}

/* ---- chains ---- */

static uint64_t predicted_of_all(void) {
    uint64_t sum = 0;
    for (size_t k = 0; k < network.count; k++) {
        sum += tl_test_rig_predicted(&rig, k);
    }
    return sum;
}

/* With T_P = n, an evaluation of a chain of n costs n·n, with approach 1 n·(n + 1)/2 (Γ_k = k +
 * 1). With both it costs n from the second one on, one per component. If T_P is `more` steps
 * longer, each component costs `more` executions more. */
static uint64_t chain_cost(uint64_t length, uint64_t more, bool structure, bool sequences) {
    if (sequences) {
        return length * (1 + more);
    }
    return structure ? length * (length + 1) / 2 + length * more : length * (length + more);
}

static void assert_chain(uint32_t length, uint32_t more, bool structure, bool sequences) {
    make_chain(length);
    tl_test_network_build(&network);
    plan.plan.prediction = length + more;
    plan.plan.saving = (tl_plan_saving){.structure = structure, .sequences = sequences};
    tl_test_rig_start(&rig, &plan, 1024);
    TEST_ASSERT_EQUAL_UINT32(length, rig.horizon.distance);
    for (size_t step = 0; step < 3; step++) {
        for (size_t n = 0; n < 4; n++) {
            double u = nth(4 * step + n);
            (void)tl_test_rig_try(&rig, &u);
            bool first = step == 0 && n == 0;
            uint64_t each = chain_cost(length, more, structure, sequences && n > 0);
            TEST_ASSERT_TRUE(!first || tl_test_rig_executions(&rig) == each);
            TEST_ASSERT_TRUE(n == 0 || tl_test_rig_executions(&rig) == each);
            TEST_ASSERT_EQUAL_UINT64(tl_test_rig_executions(&rig), predicted_of_all());
        }
        double u = nth(4 * step);
        (void)tl_test_rig_commit(&rig, &u);
    }
    end();
}

static void a_chain_costs_its_length_not_its_square(void) {
    for (uint32_t length = 2; length <= 32; length *= 2) {
        for (uint32_t more = 0; more <= 3; more += 3) {
            assert_chain(length, more, true, true);
            assert_chain(length, more, true, false);
            assert_chain(length, more, false, false);
        }
    }
}

/* ---- whole runs ---- */

typedef struct result {
    double u[3];
    double y[3];
    double objective;
    double nominal;
    uint32_t evaluations;
    uint32_t executions;
    uint32_t predicted;
    tl_outcome outcome;
    bool ready;
} result;

enum { TICKS = 40 };

static tl_test_run run;
static result results[TICKS];
static result references[TICKS];

static void fill_sample(int64_t tick) {
    tl_test_random random = {(uint64_t)tick + 77};
    for (size_t s = 0; s < network.signals; s++) {
        run.sample.values[s] = tl_test_random_number(&random, 0.2, 1.8);
    }
}

static void keep_result(result *kept) {
    memset(kept, 0, sizeof *kept);
    kept->ready = run.ready;
    if (run.ready) {
        memcpy(kept->u, run.record.u, plan.plan.adjust_count * sizeof(double));
        memcpy(kept->y, run.record.y, plan.plan.match_count * sizeof(double));
        kept->objective = run.record.objective;
        kept->nominal = run.record.objective_nominal;
        kept->evaluations = run.record.evaluations;
        kept->executions = run.record.executions;
        kept->predicted = run.record.predicted;
        kept->outcome = run.record.outcome;
    }
}

static bool same_bits(const double *a, const double *b) {
    return memcmp(a, b, sizeof *a) == 0 || (*a != *a && *b != *b);
}

static void assert_same_results(void) {
    for (size_t i = 0; i < TICKS; i++) {
        TEST_ASSERT_EQUAL_INT(references[i].ready, results[i].ready);
        TEST_ASSERT_EQUAL_UINT32(references[i].evaluations, results[i].evaluations);
        TEST_ASSERT_EQUAL_INT(references[i].outcome, results[i].outcome);
        TEST_ASSERT_EQUAL_MEMORY(references[i].u, results[i].u, sizeof results[i].u);
        TEST_ASSERT_EQUAL_MEMORY(references[i].y, results[i].y, sizeof results[i].y);
        TEST_ASSERT_TRUE(same_bits(&references[i].objective, &results[i].objective));
        TEST_ASSERT_TRUE(same_bits(&references[i].nominal, &results[i].nominal));
    }
}

/* Runs a twin of the network and the plan. The twin stays. */
static void drive(tl_plan_saving saving) {
    plan.plan.saving = saving;
    plan.plan.evaluations = 12;
    tl_twin *twin = tl_test_plan_build(&plan);
    TEST_ASSERT_EQUAL_STRING("", plan.problems[0].text);
    tl_test_run_init(&run, twin);
    run.budget.evaluations = 12;
    for (size_t i = 0; i < TICKS; i++) {
        fill_sample((int64_t)i);
        tl_test_run_step(&run);
        TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, run.status, run.error.text);
        keep_result(&results[i]);
    }
    TEST_ASSERT_EQUAL_STRING("", call_log.first_violation);
}

static void finish(void) {
    tl_twin_destroy(run.twin);
    for (size_t k = 0; k < network.count; k++) {
        TEST_ASSERT_EQUAL_UINT64(0, network.fmus[k].states);
        TEST_ASSERT_EQUAL_UINT64(0, network.fmus[k].living);
    }
    TEST_ASSERT_EQUAL_STRING("", call_log.first_violation);
}

/* The executions equal the prediction of the ledger, per component and per record. */
static void assert_ledger_is_exact(void) {
    TEST_ASSERT_TRUE(tl_twin_ledger_is_complete(run.twin));
    uint64_t executions = 0;
    for (size_t k = 0; k <= network.count; k++) {
        tl_twin_ledger entry = tl_twin_get_ledger(run.twin, k);
        TEST_ASSERT_EQUAL_UINT64(0, entry.uncached);
        TEST_ASSERT_EQUAL_UINT64_MESSAGE(entry.predicted, entry.executions - entry.repeated, entry.name);
        executions += entry.executions;
    }
    uint64_t recorded = 0;
    for (size_t i = 0; i < TICKS; i++) {
        recorded += results[i].executions;
    }
    TEST_ASSERT_EQUAL_UINT64(executions, recorded);
}

static void take_reference(void) {
    drive((tl_plan_saving){.structure = false});
    memcpy(references, results, sizeof references);
    assert_ledger_is_exact();
    finish();
}

static const tl_plan_saving BOTH = {.structure = true, .sequences = true};

/* A cycle with a side branch, two signals, and T_P longer than T_D. */
static void make_mixed(tl_shape shape) {
    tl_test_network_init(&network, &plan, &call_log, 5);
    (void)tl_test_network_adjust(&network, 0);
    (void)tl_test_network_edge(&network, 0, 1);
    (void)tl_test_network_edge(&network, 1, 2);
    (void)tl_test_network_edge(&network, 2, 1);
    (void)tl_test_network_edge(&network, 3, 2);
    (void)tl_test_network_edge(&network, 1, 4); /* without effect on y */
    (void)tl_test_network_edge(&network, -1, 3);
    (void)tl_test_network_edge(&network, -2, 0);
    (void)tl_test_network_match(&network, 2);
    tl_test_network_build(&network);
    plan.plan.prediction = 5;
    plan.plan.shape = shape;
}

static void a_small_pool_changes_nothing_but_executions(void) {
    static const uint32_t nodes[] = {1, 18, 19, 25, 40};
    make_mixed(TL_DYNAMIC);
    take_reference();
    for (size_t i = 0; i < sizeof nodes / sizeof nodes[0]; i++) {
        tl_plan_saving saving = BOTH;
        saving.nodes = nodes[i];
        drive(saving);
        assert_same_results();
        uint64_t uncached = 0;
        for (size_t k = 0; k < network.count; k++) {
            tl_twin_ledger entry = tl_twin_get_ledger(run.twin, k);
            uncached += entry.uncached;
            TEST_ASSERT_TRUE(entry.executions - entry.repeated >= entry.predicted);
            TEST_ASSERT_TRUE(entry.executions - entry.repeated == entry.predicted || entry.uncached > 0);
            TEST_ASSERT_TRUE(entry.nodes_peak <= entry.nodes);
            TEST_ASSERT_TRUE(entry.uncached == 0 || entry.nodes_peak == entry.nodes);
            TEST_ASSERT_EQUAL_UINT32(nodes[i] > 18 ? nodes[i] : 18, entry.nodes > nodes[i] ? entry.nodes : nodes[i]);
        }
        TEST_ASSERT_TRUE(uncached > 0);
        finish();
    }
    drive(BOTH);
    assert_same_results();
    assert_ledger_is_exact();
    finish();
}

/* FMUs without kept states catch up: more executions, counted separately, and the same bits. */
static void outputs_only_catches_up_and_changes_nothing(void) {
    static const tl_shape shapes[] = {TL_STATIC, TL_DYNAMIC};
    for (size_t i = 0; i < 2; i++) {
        make_mixed(shapes[i]);
        take_reference();
        for (size_t k = 0; k < network.count; k++) {
            plan.components[k].keep = TL_KEEP_OUTPUTS;
        }
        drive(BOTH);
        assert_same_results();
        assert_ledger_is_exact();
        uint64_t repeated = 0;
        for (size_t k = 0; k < network.count; k++) {
            tl_twin_ledger entry = tl_twin_get_ledger(run.twin, k);
            repeated += entry.repeated;
            TEST_ASSERT_TRUE(entry.executions <= entry.plain);
            TEST_ASSERT_TRUE(network.fmus[k].states <= entry.nodes);
        }
        TEST_ASSERT_TRUE(repeated > 0);
        finish();
    }
}

/* Outputs only also needs states, at least the one at the start of the horizon. */
static void an_fmu_without_states_is_refused_whatever_is_kept(void) {
    static const tl_keep keeps[] = {TL_KEEP_STATES, TL_KEEP_OUTPUTS};
    for (size_t i = 0; i < 2; i++) {
        make_mixed(TL_STATIC);
        plan.plan.saving = BOTH;
        plan.components[1].keep = keeps[i];
        network.fmus[1].functions.get_fmu_state = NULL;
        TEST_ASSERT_NULL(tl_test_plan_build(&plan));
        TEST_ASSERT_NOT_NULL(tl_test_plan_problem(&plan, "components.k1", "canGetAndSetFMUstate"));
        TEST_ASSERT_EQUAL_UINT64(1, plan.report.count);
        TEST_ASSERT_EQUAL_UINT64(0, network.fmus[1].calls[TL_TEST_INSTANTIATE]);
    }
}

static void without_anything_executions_are_k_times_steps_and_horizons(void) {
    make_mixed(TL_STATIC);
    take_reference();
    for (size_t i = 0; i < TICKS; i++) {
        TEST_ASSERT_EQUAL_UINT32(references[i].ready ? 6 * (1 + 5 * references[i].evaluations) : 0,
                                 references[i].executions);
    }
}

/* Counts the failed steps in the log. */
static size_t count_failed_steps(void) {
    size_t count = 0;
    for (size_t i = 0; i < call_log.count && i < TL_TEST_ENTRIES; i++) {
        const tl_test_entry *entry = &call_log.entries[i];
        count += entry->call == TL_TEST_DO_STEP && entry->status != fmi2OK;
    }
    return count;
}

/* Component `failing` rejects inputs above a limit that candidates reach. */
static void assert_failing(size_t failing, tl_test_fault_kind kind, double above) {
    static const tl_plan_saving sequences = {.structure = false, .sequences = true};
    static const tl_plan_saving structure = {.structure = true, .sequences = false};
    tl_test_fmu_fail_above(&network.fmus[failing], kind, above);
    take_reference();
    TEST_ASSERT_TRUE(count_failed_steps() > 0);
    drive(sequences);
    assert_same_results();
    assert_ledger_is_exact();
    finish();
    drive(structure);
    memcpy(references, results, sizeof references);
    finish();
    drive(BOTH);
    assert_same_results();
    assert_ledger_is_exact();
    finish();
}

static void failing_candidates_keep_ledger_and_results_exact(void) {
    static const tl_shape shapes[] = {TL_STATIC, TL_DYNAMIC};
    for (size_t i = 0; i < 2; i++) {
        for (size_t failing = 0; failing < 3; failing++) {
            make_mixed(shapes[i]);
            assert_failing(failing, TL_TEST_DISCARD, failing == 0 ? 1.0 : 0.75);
            make_mixed(shapes[i]);
            assert_failing(failing, TL_TEST_ERROR, failing == 0 ? 1.0 : 0.75);
        }
    }
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(table_4_2_without_anything);
    RUN_TEST(table_4_2_with_approach_1_alone);
    RUN_TEST(table_4_2_with_both_from_the_second_evaluation_on);
    RUN_TEST(table_4_2_with_both_and_outputs_only);
    RUN_TEST(the_committing_step_runs_what_is_not_known);
    RUN_TEST(horizons_overlap);
    RUN_TEST(candidates_count_when_they_are_evaluated);
    RUN_TEST(a_reset_evaluates_what_is_recorded);
    RUN_TEST(a_full_ring_predicts_too_much);
    RUN_TEST(alike_candidates_are_dropped_after_the_commit);
    RUN_TEST(a_chain_costs_its_length_not_its_square);
    RUN_TEST(without_anything_executions_are_k_times_steps_and_horizons);
    RUN_TEST(outputs_only_catches_up_and_changes_nothing);
    RUN_TEST(an_fmu_without_states_is_refused_whatever_is_kept);
    RUN_TEST(a_small_pool_changes_nothing_but_executions);
    RUN_TEST(failing_candidates_keep_ledger_and_results_exact);
    return UNITY_END();
}
