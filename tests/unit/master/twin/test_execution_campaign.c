/* Random co-simulations: saving executions changes no bit of a result. The executions equal those
 * that the graph predicts (eq. 4.5 to 4.13), and those that an oracle counts. The oracle knows
 * neither graph nor cache: it counts the different input sequences of the FMUs in a run that saves
 * nothing.
 * TL_TEST_GRAPHS is the number of graphs, TL_TEST_SEED the first seed. */
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <unity.h>

#include "master/sync/proof.h"
#include "tests/support/random_network.h"
#include "tests/support/random_numbers.h"
#include "tests/support/test_network.h"
#include "tests/support/test_rig.h"

enum { TICKS = 30, EVALUATIONS = 8, MOST_SIGNALS = 24 };

static tl_test_log call_log;
static tl_test_plan plan;
static tl_test_network network;
static uint64_t seed;
static char where[96]; /* seed and setting, for messages */

/* The behaviour of the plant of one graph. */
static size_t patience[MOST_SIGNALS]; /* ticks for which each signal keeps a value */
static size_t missed;                 /* per hundred ticks */
static size_t bad;                    /* per hundred values */

/* What a campaign has covered. */
typedef struct census {
    size_t booleans;
    size_t modes[3];
    size_t dynamic;
    size_t several; /* several adjusted variables and matched outputs */
    size_t longer;  /* T_P > T_D */
    uint64_t repeated;
    uint64_t uncached;
    uint64_t finals; /* final steps of cached FMUs; the test FMU checks that it is not restored to before one */
} census;

static census seen;

void setUp(void) {
    tl_test_log_clear(&call_log);
    memset(&seen, 0, sizeof seen);
}

void tearDown(void) {
    tl_test_network_end(&network);
}

/* ---- random plans ---- */

static void choose_search(tl_test_random *random) {
    static const char *const solvers[] = {"nelder-mead", "secant", "bobyqa", "l-bfgs", "sbplx"};
    size_t first = tl_test_random_below(random, 5);
    size_t second = tl_test_random_below(random, 5);
    plan.plan.algorithm = network.booleans ? "boolean" : solvers[first];
    plan.plan.fallback = tl_test_random_chance(random, 70) ? NULL : network.booleans ? "boolean" : solvers[second];
    plan.plan.stagnation = tl_test_random_chance(random, 30) ? 3 : 0;
    plan.plan.margin = tl_test_random_chance(random, 30) ? 0.1 : 0.0;
    plan.plan.noise_floor = tl_test_random_chance(random, 20) ? 0.01 : 0.0;
    plan.plan.evaluations = EVALUATIONS;
    for (size_t i = 0; i < plan.plan.adjust_count; i++) {
        plan.adjust[i].rate_penalty = tl_test_random_chance(random, 20) ? 0.01 : 0.0;
        plan.adjust[i].dwell = tl_test_random_chance(random, 30) && network.booleans ? 3 * plan.plan.step : 0;
    }
    for (size_t i = 0; i < plan.plan.match_count; i++) {
    }
}

static void make_plan(void) {
    static const tl_pairing modes[] = {TL_LAG, TL_AHEAD, TL_HOLD};
    tl_test_random random = {tl_test_mix(seed)};
    tl_test_random_network(&network, &plan, &call_log, &random, true);
    plan.plan.prediction = tl_test_network_least(&network) + (uint32_t)tl_test_random_below(&random, 7);
    plan.plan.shape = tl_test_random_chance(&random, 50) ? TL_DYNAMIC : TL_STATIC;
    plan.plan.measurements = modes[tl_test_random_below(&random, 3)];
    choose_search(&random);
    for (size_t s = 0; s < MOST_SIGNALS; s++) {
        patience[s] = tl_test_random_chance(&random, 50) ? 1 : tl_test_random_between(&random, 2, 9);
    }
    missed = tl_test_random_chance(&random, 30) ? 10 : 0;
    bad = tl_test_random_chance(&random, 30) ? 10 : 0;
    seen.booleans += network.booleans;
    seen.modes[plan.plan.measurements]++;
    seen.dynamic += plan.plan.shape == TL_DYNAMIC;
    seen.several += plan.plan.adjust_count > 1 && plan.plan.match_count > 1;
    seen.longer += plan.plan.prediction > tl_test_network_distance(&network);
}

/* A long campaign must have covered everything. */
static void assert_census(size_t graphs) {
    if (graphs >= 200) {
        TEST_ASSERT_TRUE(seen.booleans > 10 && seen.dynamic > 50 && seen.several > 50 && seen.longer > 50);
        TEST_ASSERT_TRUE(seen.modes[TL_LAG] > 20 && seen.modes[TL_HOLD] > 20 && seen.modes[TL_AHEAD] > 20);
        TEST_ASSERT_TRUE(seen.repeated > 100 && seen.finals > 1000);
    }
}

static double fit(double value, tl_type type) {
    return type == TL_REAL ? value : type == TL_INTEGER ? floor(4.0 * value) : (double)(value > 0.5);
}

/* The sample of a tick, the same in all runs. */
static void fill_sample(tl_sample *sample, int64_t tick) {
    for (size_t s = 0; s < network.signals; s++) {
        tl_test_random value = {tl_test_mix(seed + 1000003 * s) + (uint64_t)tick / patience[s]};
        tl_test_random quality = {tl_test_mix(seed + 1000033 * s) + (uint64_t)tick};
        sample->values[s] = fit(tl_test_random_number(&value, -1.0, 2.0), network.types[s]);
        sample->quality[s] = tl_test_random_chance(&quality, bad) ? TL_STALE : TL_GOOD;
    }
}

static bool is_missed(int64_t tick) {
    tl_test_random random = {tl_test_mix(seed + 5) + (uint64_t)tick};
    return tl_test_random_chance(&random, missed);
}

/* ---- the oracle ---- */

enum { STRUCTURE, SEQUENCES, BOTH, WAYS, SLOTS = 1 << 18 };

/* Counts of one component in a run that saves nothing. */
typedef struct step_counts {
    uint64_t steps;
    int64_t committed;
    uint64_t needed[WAYS]; /* executions that each way of saving needs at least */
} step_counts;

static step_counts counts[TL_TEST_COMPONENTS];
static uint64_t lineages[SLOTS]; /* hash table; 0: free */
static size_t lineage_count;
static uint64_t uncounted; /* steps of the rollback check, at the beginning */

static void reset_counts(uint64_t first) {
    memset(counts, 0, sizeof counts);
    memset(lineages, 0, sizeof lineages);
    lineage_count = 0;
    uncounted = first;
}

/* Returns true if it is new. */
static bool add_lineage(uint64_t lineage) {
    size_t slot = (size_t)lineage % SLOTS;
    while (lineages[slot] != 0 && lineages[slot] != lineage) {
        slot = (slot + 1) % SLOTS;
    }
    bool added = lineages[slot] == 0;
    lineages[slot] = lineage;
    lineage_count += added;
    TEST_ASSERT_TRUE(lineage_count < SLOTS / 2);
    return added;
}

/* Eq. 4.5 by the paths of the test network. */
static uint32_t reach_of(size_t k) {
    uint32_t way = tl_test_network_to_y(&network, k);
    return way < plan.plan.prediction ? plan.plan.prediction - way : 0;
}

/* Called for each step of each FMU. Only the first instance belongs to the run that saves
 * nothing. */
static void on_event(void *context, const tl_test_fmu *fmu, const tl_test_entry *step, uint64_t lineage) {
    (void)context;
    size_t k = (size_t)(fmu - network.fmus);
    step_counts *count = &counts[k];
    seen.finals += step->final && plan.plan.saving.sequences;
    if (step->instance != 0 || count->steps++ < uncounted) {
        return;
    }
    int64_t depth = llround(step->time / 0.1) - count->committed;
    bool kept = step->status == fmi2OK; /* failed steps are repeated each time */
    count->committed += step->final && kept;
    bool matters = step->final || depth < (int64_t)reach_of(k);
    uint64_t own = tl_test_mix(lineage + k);
    count->needed[STRUCTURE] += matters;
    count->needed[SEQUENCES] += !kept || add_lineage(tl_test_mix(own + SEQUENCES));
    count->needed[BOTH] += matters && (!kept || add_lineage(tl_test_mix(own + BOTH)));
}

static void listen(void) {
    for (size_t k = 0; k < network.count; k++) {
        network.fmus[k].control.trace = on_event;
    }
}

/* ---- runs of the twin ---- */

typedef struct result {
    tl_record record;
    bool ready;
} result;

typedef struct results {
    result ticks[TICKS];
    uint64_t evaluations;
    uint64_t steps;
} results;

static results reference;
static results current;
static tl_test_run run;

static void note(const char *what) {
    (void)snprintf(where, sizeof where, "seed %llu, %s", (unsigned long long)seed, what);
}

static bool same_bits(const void *a, const void *b, size_t size) {
    return memcmp(a, b, size) == 0;
}

static bool same_record(const tl_record *a, const tl_record *b) {
    size_t u = plan.plan.adjust_count * sizeof(double);
    size_t y = plan.plan.match_count * sizeof(double);
    return a->step == b->step && a->outcome == b->outcome && a->stop == b->stop && a->evaluations == b->evaluations &&
           a->flags == b->flags && a->held == b->held && same_bits(a->u, b->u, u) &&
           same_bits(a->nominal, b->nominal, u) && same_bits(a->y, b->y, y) &&
           same_bits(&a->objective, &b->objective, sizeof a->objective) &&
           same_bits(&a->objective_nominal, &b->objective_nominal, sizeof a->objective_nominal);
}

static void assert_same_results(void) {
    for (size_t i = 0; i < TICKS; i++) {
        TEST_ASSERT_EQUAL_INT_MESSAGE(reference.ticks[i].ready, current.ticks[i].ready, where);
        TEST_ASSERT_TRUE_MESSAGE(
            !reference.ticks[i].ready || same_record(&reference.ticks[i].record, &current.ticks[i].record), where);
    }
}

static uint64_t done(size_t k) {
    tl_twin_ledger entry = tl_twin_get_ledger(run.twin, k);
    return entry.executions - entry.repeated;
}

static uint64_t most_of_first(size_t k) {
    return plan.plan.saving.structure ? reach_of(k) : plan.plan.prediction;
}

/* Most executions of a candidate after the first one of a step. */
static uint64_t most_of_later(size_t k) {
    return plan.components[k].keep == TL_KEEP_NONE ? most_of_first(k)
                                                   : tl_test_network_most(&network, k, plan.plan.prediction);
}

/* The way that saves a component's executions, with both ways enabled. */
static int way_of(size_t k) {
    return plan.components[k].keep == TL_KEEP_NONE ? STRUCTURE : BOTH;
}

/* The executions of a tick, except catching up, are at most those of eq. 4.13 and of the commit.
 * In mode ahead the record of this tick's step comes with the next tick. */
static void assert_bound(const uint64_t *before, uint64_t evaluations) {
    for (size_t k = 0; k < network.count; k++) {
        uint64_t most = evaluations == 0 ? 0 : most_of_first(k) + (evaluations - 1) * most_of_later(k);
        TEST_ASSERT_TRUE_MESSAGE(done(k) - before[k] <= most + 1, where);
    }
}

static bool is_bounded(void) {
    tl_plan_saving saving = plan.plan.saving;
    return saving.structure && saving.sequences && saving.nodes == 0 && plan.plan.measurements != TL_AHEAD;
}

static void take_tick(size_t tick, results *kept) {
    uint64_t before[TL_TEST_COMPONENTS] = {0};
    for (size_t k = 0; k < network.count; k++) {
        before[k] = done(k);
    }
    fill_sample(&run.sample, (int64_t)tick);
    if (tick > 0 && is_missed((int64_t)tick)) {
        tl_test_run_catch_up(&run);
    } else {
        tl_test_run_step(&run);
    }
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, run.status, where);
    kept->ticks[tick].ready = run.ready;
    kept->ticks[tick].record = run.record;
    if (run.ready && is_bounded()) {
        assert_bound(before, run.record.evaluations);
    }
}

static void count_up(results *kept) {
    kept->evaluations = 0;
    kept->steps = 0;
    for (size_t i = 0; i < TICKS; i++) {
        kept->evaluations += kept->ticks[i].ready ? kept->ticks[i].record.evaluations : 0;
        kept->steps += kept->ticks[i].ready;
    }
}

/* Builds the twin and runs it. The twin stays. */
static void drive(const char *what, tl_plan_saving saving, results *kept) {
    note(what);
    plan.plan.saving = saving;
    tl_twin *twin = tl_test_plan_build(&plan);
    TEST_ASSERT_EQUAL_STRING_MESSAGE("", plan.problems[0].text, where);
    tl_test_run_init(&run, twin);
    run.budget.evaluations = EVALUATIONS;
    for (size_t i = 0; i < TICKS; i++) {
        take_tick(i, kept);
    }
    if (plan.plan.measurements == TL_AHEAD) { /* the last evaluations are known when the record is complete */
        fill_sample(&run.sample, TICKS);
        tl_twin_finish(run.twin, &run.sample, &run.record, &run.ready);
        kept->ticks[0] = (result){run.record, run.ready}; /* index 0 had no record */
    }
    count_up(kept);
}

static void finish(void) {
    tl_twin_destroy(run.twin);
    for (size_t k = 0; k < network.count; k++) {
        TEST_ASSERT_EQUAL_UINT64_MESSAGE(0, network.fmus[k].states, where);
    }
    TEST_ASSERT_EQUAL_STRING_MESSAGE("", call_log.first_violation, where);
}

/* Exact if everything fitted into the caches. */
static void assert_ledger(void) {
    TEST_ASSERT_TRUE_MESSAGE(tl_twin_ledger_is_complete(run.twin), where);
    for (size_t k = 0; k <= network.count; k++) {
        tl_twin_ledger entry = tl_twin_get_ledger(run.twin, k);
        bool exact = entry.uncached == 0;
        TEST_ASSERT_TRUE_MESSAGE(exact || plan.plan.saving.nodes != 0, where);
        TEST_ASSERT_TRUE_MESSAGE(exact ? done(k) == entry.predicted : done(k) >= entry.predicted, where);
        seen.repeated += entry.repeated;
        seen.uncached += entry.uncached;
        TEST_ASSERT_EQUAL_UINT64_MESSAGE(reference.steps + plan.plan.prediction * reference.evaluations, entry.plain,
                                         where);
    }
}

/* The executions equal those of the oracle, if everything fitted into the caches. */
static void assert_oracle(tl_plan_saving saving) {
    for (size_t k = 0; k < network.count && saving.nodes == 0; k++) {
        int way = !saving.sequences ? STRUCTURE : saving.structure ? way_of(k) : SEQUENCES;
        TEST_ASSERT_EQUAL_UINT64_MESSAGE(counts[k].needed[way], done(k), where);
    }
}

/* Each record is exact too, without catching up and without lack of room. */
static void assert_records(void) {
    for (size_t i = 0; i < TICKS; i++) {
        const tl_record *record = &current.ticks[i].record;
        TEST_ASSERT_TRUE_MESSAGE(!current.ticks[i].ready || record->executions == record->predicted, where);
    }
}

static void assert_variant(const char *what, tl_plan_saving saving) {
    drive(what, saving, &current);
    assert_same_results();
    assert_ledger();
    assert_oracle(saving);
    finish();
}

/* Steps of each FMU in the rollback check: the start, one excursion and the middle; then each
 * excursion and the start after it, and each excursion again. A Boolean has one excursion, a Real
 * four (up and down by 1 and 4 steps), and all together have one more. */
static uint64_t count_proof_steps(void) {
    uint64_t excursions = 1;
    for (size_t i = 0; i < plan.plan.adjust_count; i++) {
        excursions += network.booleans ? 1 : 4;
    }
    excursions = excursions < TL_PROOF_EXCURSIONS ? excursions : TL_PROOF_EXCURSIONS;
    return (3 + 3 * excursions) * TL_PROOF_STEPS - TL_PROOF_MIDST;
}

/* Nothing saved: K·steps + K·T_P·E. */
static void assert_plain(void) {
    reset_counts(count_proof_steps());
    listen();
    drive("nothing saved", (tl_plan_saving){.structure = false}, &reference);
    assert_ledger();
    for (size_t k = 0; k <= network.count; k++) {
        TEST_ASSERT_EQUAL_UINT64_MESSAGE(reference.steps + plan.plan.prediction * reference.evaluations, done(k),
                                         where);
    }
    finish();
}

static void assert_other_variant(void) {
    static const tl_plan_saving structure = {.structure = true};
    static const tl_plan_saving sequences = {.sequences = true};
    tl_plan_saving both = {.structure = true, .sequences = true};
    tl_test_random random = {tl_test_mix(seed + 9)};
    switch (seed % 4) {
    case 0:
        assert_variant("structure", structure);
        return;
    case 1:
        assert_variant("sequences", sequences);
        return;
    case 2:
        both.nodes = (uint32_t)tl_test_random_between(&random, 1, 60);
        break;
    default:
        break;
    }
    for (size_t k = 0; k < network.count; k++) {
        plan.components[k].keep = (tl_keep)tl_test_random_below(&random, 3);
    }
    assert_variant(both.nodes != 0 ? "a small pool" : "any keep", both);
}

static void random_runs_are_the_same_whatever_is_saved(void) {
    static const tl_plan_saving both = {.structure = true, .sequences = true};
    size_t graphs = tl_test_campaign("TL_TEST_GRAPHS", 200);
    size_t first = tl_test_campaign("TL_TEST_SEED", 1);
    for (seed = first; seed < first + graphs; seed++) {
        make_plan();
        assert_plain();
        assert_variant("both", both);
        assert_records();
        assert_other_variant();
    }
    assert_census(graphs);
    TEST_ASSERT_TRUE(graphs < 200 || seen.uncached > 100);
}

/* ---- candidates chosen by the test ---- */

static tl_test_rig saving_rig;
static tl_test_rig plain_rig; /* saves nothing; with failing components by structure only, which avoids some failures */
static bool fragile;          /* some components fail beyond a limit of their input */
static size_t failed;         /* failed candidates */

static void push_both(int64_t lead) {
    while (saving_rig.sample.tick < saving_rig.step + lead) {
        tl_sample sample = {0};
        fill_sample(&sample, saving_rig.sample.tick + 1);
        tl_test_rig_push(&saving_rig, sample.values);
        tl_test_rig_push(&plain_rig, sample.values);
    }
}

static double known[4][TL_MAX_UNKNOWNS]; /* sequences that may be repeated */

/* The next candidate: a new one, a known one, or a known one with another value. */
static void vary(tl_test_random *random, double *u) {
    size_t count = saving_rig.horizon.count;
    memcpy(u, known[tl_test_random_below(random, 4)], count * sizeof *u);
    size_t way = tl_test_random_below(random, 3);
    if (way == 0) {
        u[tl_test_random_below(random, count)] = tl_test_random_value(&network, random);
    }
    for (size_t i = 0; way == 1 && i < count; i++) {
        u[i] = tl_test_random_value(&network, random);
    }
    memcpy(known[tl_test_random_below(random, 4)], u, count * sizeof *u);
}

/* Executions of the plant by brute force: all sequences of sample numbers. */
static uint64_t plant_lineage;   /* as committed */
static uint64_t plant_sequences; /* number of different ones */

static void hear_plant(uint64_t *lineage, int64_t step) {
    int64_t newest = saving_rig.sample.tick;
    *lineage = tl_test_mix(*lineage + (uint64_t)(step + 1 < newest ? step + 1 : newest) + 1);
    plant_sequences += add_lineage(tl_test_mix(*lineage + 7));
}

static void hear_plants_candidate(uint32_t steps) {
    uint32_t way = TL_TEST_FAR;
    for (size_t i = 0; i < network.link_count; i++) {
        const tl_test_link *link = &network.links[i];
        uint32_t own = link->from < 0 && link->adjusted == 0 ? tl_test_network_to_y(&network, link->to) + 1 : way;
        way = own < way ? own : way;
    }
    uint64_t lineage = plant_lineage;
    for (uint32_t depth = 0; depth < steps && depth + way < plan.plan.prediction; depth++) {
        hear_plant(&lineage, saving_rig.step + depth);
    }
}

/* The executions equal those of the ledger and of the oracle, and keep the bound of eq. 4.13. */
static void assert_cost(const uint64_t *before, uint64_t plant_before) {
    for (size_t k = 0; k < network.count; k++) {
        uint64_t executions = tl_test_rig_done(&saving_rig, k);
        TEST_ASSERT_EQUAL_UINT64_MESSAGE(tl_test_rig_predicted(&saving_rig, k), executions, where);
        TEST_ASSERT_EQUAL_UINT64_MESSAGE(counts[k].needed[way_of(k)] - before[k], executions, where);
    }
    uint64_t executions = tl_test_rig_done(&saving_rig, network.count);
    TEST_ASSERT_EQUAL_UINT64_MESSAGE(tl_test_rig_predicted(&saving_rig, network.count), executions, where);
    TEST_ASSERT_EQUAL_UINT64_MESSAGE(plant_sequences - plant_before, executions, where);
}

/* A candidate may have to execute what an earlier failed one left out. */
static void assert_most(bool first, uint32_t steps) {
    for (size_t k = 0; k < network.count && !fragile; k++) {
        TEST_ASSERT_EQUAL_UINT64_MESSAGE(steps, tl_test_rig_done(&plain_rig, k), where);
        uint64_t most = first ? most_of_first(k) : most_of_later(k);
        TEST_ASSERT_TRUE_MESSAGE(tl_test_rig_done(&saving_rig, k) <= most, where);
    }
}

static void note_needs(uint64_t *needs) {
    for (size_t k = 0; k < network.count; k++) {
        needs[k] = counts[k].needed[way_of(k)];
    }
}

static void try_candidate(tl_test_random *random, bool first, uint32_t steps) {
    double u[TL_MAX_UNKNOWNS];
    uint64_t before[TL_TEST_COMPONENTS] = {0};
    uint64_t plant_before = plant_sequences;
    note_needs(before);
    vary(random, u);
    uint64_t wanted = tl_test_rig_walk(&plain_rig, u, steps);
    TEST_ASSERT_EQUAL_UINT64_MESSAGE(wanted, tl_test_rig_walk(&saving_rig, u, steps), where);
    TEST_ASSERT_EQUAL_INT_MESSAGE(plain_rig.status, saving_rig.status, where);
    TEST_ASSERT_TRUE_MESSAGE(fragile || saving_rig.status == TL_OK, where);
    failed += saving_rig.status != TL_OK;
    hear_plants_candidate(saving_rig.walked);
    assert_cost(before, plant_before);
    assert_most(first, steps);
}

/* Returns false if the step fails; then no step may follow. */
static bool try_and_commit(tl_test_random *random) {
    double u[TL_MAX_UNKNOWNS];
    uint64_t before[TL_TEST_COMPONENTS] = {0};
    size_t candidates = tl_test_random_between(random, 0, 5);
    for (size_t i = 0; i < candidates; i++) {
        try_candidate(random, i == 0, plan.plan.prediction);
    }
    if (tl_test_random_chance(random, 10)) { /* as if time ran out */
        try_candidate(random, candidates == 0, (uint32_t)tl_test_random_below(random, plan.plan.prediction));
    }
    vary(random, u);
    uint64_t plant_before = plant_sequences;
    note_needs(before);
    hear_plant(&plant_lineage, saving_rig.step);
    uint64_t wanted = tl_test_rig_commit(&plain_rig, u);
    TEST_ASSERT_EQUAL_UINT64_MESSAGE(wanted, tl_test_rig_commit(&saving_rig, u), where);
    TEST_ASSERT_EQUAL_INT_MESSAGE(plain_rig.status, saving_rig.status, where);
    if (saving_rig.status == TL_OK) {
        assert_cost(before, plant_before);
    }
    return saving_rig.status == TL_OK;
}

static void make_fragile(tl_test_random *random) {
    for (size_t k = 0; k < network.count; k++) {
        if (tl_test_random_chance(random, 30)) {
            tl_test_fault_kind kind = tl_test_random_chance(random, 50) ? TL_TEST_DISCARD : TL_TEST_ERROR;
            tl_test_fmu_fail_above(&network.fmus[k], kind, tl_test_random_number(random, 0.8, 1.6));
        }
    }
}

static void start_rigs(tl_test_random *random) {
    memset(known, 0, sizeof known);
    reset_counts(0);
    listen();
    plant_lineage = 0;
    plant_sequences = 0;
    fragile = tl_test_random_chance(random, 33);
    if (fragile) {
        make_fragile(random);
    }
    plan.plan.saving = (tl_plan_saving){.structure = fragile};
    tl_test_rig_start(&plain_rig, &plan, 0);
    plan.plan.saving = (tl_plan_saving){.structure = true, .sequences = true};
    for (size_t k = 0; k < network.count; k++) {
        plan.components[k].keep = (tl_keep)tl_test_random_below(random, 3);
    }
    tl_test_rig_start(&saving_rig, &plan, 1024);
}

static void random_candidates_cost_what_the_graph_says(void) {
    size_t graphs = tl_test_campaign("TL_TEST_GRAPHS", 200);
    size_t first = tl_test_campaign("TL_TEST_SEED", 1);
    failed = 0;
    for (seed = first; seed < first + graphs; seed++) {
        tl_test_random random = {tl_test_mix(seed + 3)};
        make_plan();
        bad = 0;
        note("candidates");
        start_rigs(&random);
        TEST_ASSERT_EQUAL_UINT32_MESSAGE(tl_test_network_distance(&network), saving_rig.horizon.distance, where);
        int64_t prediction = saving_rig.horizon.prediction;
        int64_t lead = plan.plan.measurements == TL_AHEAD ? 0 : plan.plan.measurements == TL_HOLD ? 1 : prediction;
        bool going = true;
        for (size_t step = 0; step < 12 && going; step++) {
            push_both(lead);
            going = try_and_commit(&random);
        }
        for (size_t k = 0; k < network.count; k++) {
            seen.repeated += saving_rig.exchange.cached[k].repeated;
        }
        tl_test_rig_end(&plain_rig);
        tl_test_rig_end(&saving_rig);
        TEST_ASSERT_EQUAL_STRING_MESSAGE("", call_log.first_violation, where);
    }
    assert_census(graphs);
    TEST_ASSERT_TRUE(graphs < 200 || failed > 30);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(random_runs_are_the_same_whatever_is_saved);
    RUN_TEST(random_candidates_cost_what_the_graph_says);
    return UNITY_END();
}
