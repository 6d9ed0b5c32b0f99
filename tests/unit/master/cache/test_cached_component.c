/* One component with a cache: table 4.1, commits, catching up, failures, full pools. TL_TEST_WALKS
 * is the number of random walks. */
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <unity.h>

#include "master/cache/cached_component.h"
#include "tests/support/random_numbers.h"
#include "tests/support/test_fmu.h"

enum { WIDTH = 2, PREDICTION = 3, ROOM = 64, READY = 256 /* handles made at the start */ };

static const double CIRCLE = 1.0; /* o and * of the thesis */
static const double STAR = 2.0;

/* Target of the pointers of ports without integers. */
static fmi2Integer none;

/* A component with its ports. */
typedef struct unit {
    tl_component component;
    fmi2ValueReference references[2 * WIDTH];
    fmi2Real values[2 * WIDTH]; /* u0, u1, y0, y1 */
} unit;

static tl_test_log call_log;
static tl_test_fmu fmu;
static tl_arena arena;
static unit behind;  /* with a cache */
static unit without; /* without a cache, as the reference */
static fmi2FMUstate without_state;
static tl_cached_component cached;
static tl_error error;
static int64_t step; /* of the root */
static uint32_t depth;
static char where[64];

/* Sets the ports. References come from the FMU; the names do not matter. */
static void place(unit *self) {
    static const char *const names[] = {"u0", "u1", "y0", "y1"};
    memset(self, 0, sizeof *self);
    for (size_t i = 0; i < 4; i++) {
        self->references[i] = tl_test_fmu_variable(&fmu, names[i])->reference;
    }
    self->component = (tl_component){.name = "m",
                                     .model = &fmu.model,
                                     .fmi = &fmu.functions,
                                     .inputs = {.real_count = 2,
                                                .real_references = self->references,
                                                .reals = self->values,
                                                .integers = &none,
                                                .booleans = &none},
                                     .outputs = {.real_count = 2,
                                                 .real_references = self->references + 2,
                                                 .reals = self->values + 2,
                                                 .integers = &none,
                                                 .booleans = &none}};
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_component_instantiate(&self->component, &fmu.callbacks, "", &error));
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_component_enter_initialization(&self->component, 0.0, &error));
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_component_exit_initialization(&self->component, &error));
}

static void start(tl_keep keep, uint32_t spacing, uint32_t capacity) {
    tl_arena_init(&arena);
    tl_test_fmu_init(&fmu, WIDTH, false, &call_log);
    tl_test_fmu_variable(&fmu, "lag")->start.real = 0.15;
    fmu.control.telling = true;
    place(&behind);
    place(&without);
    TEST_ASSERT_TRUE(
        tl_cached_component_init(&cached, &arena, &behind.component, keep, TL_SECOND / 10, spacing, capacity));
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_cached_component_start(&cached, &error));
    step = 0;
    depth = 0;
}

static void finish(void) {
    tl_cached_component_end(&cached);
    tl_component_forget(&without.component, &without_state);
    TEST_ASSERT_EQUAL_UINT64(0, fmu.states);
    tl_component_free(&behind.component);
    tl_component_free(&without.component);
    TEST_ASSERT_EQUAL_UINT64(0, fmu.living);
    tl_arena_release(&arena);
    TEST_ASSERT_EQUAL_STRING("", call_log.first_violation);
}

void setUp(void) {
    tl_test_log_clear(&call_log);
    where[0] = '\0';
}

void tearDown(void) {
    tl_test_fmu_end(&fmu);
    tl_arena_release(&arena);
    TEST_ASSERT_EQUAL_STRING("", call_log.first_violation);
}

static void set_inputs(double u) {
    behind.values[0] = u;
    behind.values[1] = -u;
}

/* One step of the candidate. Returns the number of executions. */
static uint64_t advance(double u) {
    uint64_t before = behind.component.executions;
    set_inputs(u);
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_cached_component_step(&cached, step + depth, &error), error.text);
    TEST_ASSERT_TRUE(behind.values[0] == u && behind.values[1] == -u);
    depth++;
    return behind.component.executions - before;
}

static void rewind_candidate(void) {
    tl_cached_component_rewind(&cached);
    depth = 0;
}

static uint64_t commit(double u) {
    rewind_candidate();
    set_inputs(u);
    tl_cached_component_make_room(&cached);
    uint64_t executions = advance(u);
    tl_cached_component_commit(&cached);
    step++;
    depth = 0;
    return executions;
}

/* A candidate from the root; `inputs` consists of o and *. Returns the number of executions. */
static uint64_t candidate(const char *inputs) {
    uint64_t executions = 0;
    rewind_candidate();
    for (const char *at = inputs; *at != '\0'; at++) {
        executions += advance(*at == 'o' ? CIRCLE : STAR);
    }
    return executions;
}

/* ---- table 4.1 ----
 * Left column: only the state of t_1 is kept, from which each candidate starts. Known steps deliver
 * their outputs, but are executed if a later input differs. Right column: all states are kept. */

static const char *const SEQUENCES[] = {"ooo", "***", "ooo", "o**", "*o*", "**o"};

static void assert_table(tl_keep keep, const uint64_t *expected) {
    start(keep, PREDICTION, ROOM);
    for (size_t i = 0; i < 6; i++) {
        TEST_ASSERT_EQUAL_UINT64_MESSAGE(expected[i], candidate(SEQUENCES[i]), SEQUENCES[i]);
    }
    for (size_t i = 0; i < 6; i++) {
        TEST_ASSERT_EQUAL_UINT64_MESSAGE(0, candidate(SEQUENCES[i]), SEQUENCES[i]);
    }
    finish();
}

static void table_4_1_with_outputs_stored(void) {
    static const uint64_t expected[] = {3, 3, 0, 3, 3, 3};
    assert_table(TL_KEEP_OUTPUTS, expected);
}

static void table_4_1_with_states_stored_too(void) {
    static const uint64_t expected[] = {3, 3, 0, 2, 2, 1};
    assert_table(TL_KEEP_STATES, expected);
}

/* A state is saved when the FMU leaves it, once, and loaded only for an execution from there. */
static void states_are_saved_and_loaded_only_where_needed(void) {
    start(TL_KEEP_STATES, PREDICTION, ROOM);
    uint64_t saves = fmu.calls[TL_TEST_GET_STATE];
    TEST_ASSERT_EQUAL_UINT64(ROOM, saves);
    (void)candidate("ooo");
    TEST_ASSERT_EQUAL_UINT64(saves + 3, fmu.calls[TL_TEST_GET_STATE]); /* t0, t1, t2 */
    TEST_ASSERT_EQUAL_UINT64(0, fmu.calls[TL_TEST_SET_STATE]);
    (void)candidate("ooo");
    (void)candidate("oo");
    TEST_ASSERT_EQUAL_UINT64(0, fmu.calls[TL_TEST_SET_STATE]);
    (void)candidate("o*");
    TEST_ASSERT_EQUAL_UINT64(saves + 4, fmu.calls[TL_TEST_GET_STATE]); /* the end of the first candidate */
    TEST_ASSERT_EQUAL_UINT64(1, fmu.calls[TL_TEST_SET_STATE]);
    (void)candidate("o**"); /* continues from the FMU's state */
    TEST_ASSERT_EQUAL_UINT64(1, fmu.calls[TL_TEST_SET_STATE]);
    (void)candidate("oooo");
    TEST_ASSERT_EQUAL_UINT64(2, fmu.calls[TL_TEST_SET_STATE]);
    TEST_ASSERT_EQUAL_UINT64(ROOM, fmu.states);
    finish();
}

static void outputs_only_keeps_few_states(void) {
    start(TL_KEEP_OUTPUTS, PREDICTION, ROOM);
    TEST_ASSERT_EQUAL_UINT64(0, fmu.states);
    for (size_t i = 0; i < 6; i++) {
        (void)candidate(SEQUENCES[i]);
    }
    TEST_ASSERT_EQUAL_UINT64(1, fmu.states);
    TEST_ASSERT_EQUAL_UINT64(1, fmu.calls[TL_TEST_GET_STATE]);
    TEST_ASSERT_EQUAL_UINT64(4, fmu.calls[TL_TEST_SET_STATE]);
    TEST_ASSERT_EQUAL_UINT64(1 + 1 + 2, cached.repeated);
    finish();
}

static void a_distant_candidate_saves_a_state_every_spacing(void) {
    start(TL_KEEP_OUTPUTS, PREDICTION, ROOM);
    TEST_ASSERT_EQUAL_UINT64(10, candidate("oooooooooo"));
    TEST_ASSERT_EQUAL_UINT64(4, fmu.states);            /* t0, t3, t6, t9 */
    TEST_ASSERT_EQUAL_UINT64(2, candidate("ooooooo*")); /* from t6 */
    TEST_ASSERT_EQUAL_UINT64(1, cached.repeated);
    finish();
}

/* ---- commits ---- */

static void a_committed_root_moves(void) {
    start(TL_KEEP_STATES, PREDICTION, ROOM);
    (void)candidate("ooo");
    (void)candidate("***");
    TEST_ASSERT_EQUAL_UINT64(0, commit(CIRCLE));
    TEST_ASSERT_EQUAL_UINT32(3, cached.tree.count); /* sequences with * first are dropped */
    TEST_ASSERT_EQUAL_UINT64(0, candidate("oo"));
    TEST_ASSERT_EQUAL_UINT64(1, candidate("ooo"));
    TEST_ASSERT_EQUAL_UINT64(1, candidate("*"));
    TEST_ASSERT_EQUAL_UINT64(0, commit(STAR));
    TEST_ASSERT_EQUAL_UINT32(1, cached.tree.count);
    TEST_ASSERT_EQUAL_UINT64(1, commit(STAR));
    finish();
}

static void commits_without_candidates_cost_one_execution_and_no_node(void) {
    static const tl_keep keeps[] = {TL_KEEP_STATES, TL_KEEP_OUTPUTS, TL_KEEP_NONE};
    for (size_t i = 0; i < 3; i++) {
        start(keeps[i], PREDICTION, keeps[i] == TL_KEEP_NONE ? TL_NODES_OF_NONE : ROOM);
        for (size_t k = 0; k < 50; k++) {
            TEST_ASSERT_EQUAL_UINT64(1, commit(k % 2 == 0 ? CIRCLE : STAR));
            TEST_ASSERT_TRUE(cached.tree.count <= (keeps[i] == TL_KEEP_OUTPUTS ? PREDICTION + 1 : 1));
        }
        TEST_ASSERT_EQUAL_UINT64(0, cached.repeated);
        finish();
    }
}

/* The path back to the last state is kept while it is needed; the FMU catches up along it. */
static void outputs_only_catches_up_over_commits(void) {
    start(TL_KEEP_OUTPUTS, 5, ROOM);
    TEST_ASSERT_EQUAL_UINT64(1, commit(CIRCLE));
    TEST_ASSERT_EQUAL_UINT64(1, commit(STAR));
    TEST_ASSERT_EQUAL_UINT64(1, candidate("o"));
    TEST_ASSERT_EQUAL_UINT64(3, candidate("*")); /* from t0: o * * */
    TEST_ASSERT_EQUAL_UINT64(2, cached.repeated);
    TEST_ASSERT_EQUAL_UINT64(0, commit(CIRCLE));
    TEST_ASSERT_EQUAL_UINT64(4, candidate("o")); /* the FMU was in a dropped state: o * o o */
    TEST_ASSERT_EQUAL_UINT64(5, cached.repeated);
    TEST_ASSERT_EQUAL_UINT64(1, fmu.states);
    finish();
}

/* ---- keys ---- */

enum { KEYED = 5 };

/* A component with inputs of all types, one of them an adjusted tunable parameter. */
typedef struct keyed {
    tl_component component;
    fmi2ValueReference reals[3]; /* u0, gain; y0 */
    fmi2ValueReference integers[2];
    fmi2ValueReference boolean;
    fmi2Real real_values[3];
    fmi2Integer integer_values[2]; /* count, mode */
    fmi2Boolean boolean_value;     /* flag */
} keyed;

static keyed typed;

static void place_typed(void) {
    static const char *const reals[] = {"u0", "gain", "y0"};
    static const char *const integers[] = {"count", "mode"};
    memset(&typed, 0, sizeof typed);
    for (size_t i = 0; i < 3; i++) {
        typed.reals[i] = tl_test_fmu_variable(&fmu, reals[i])->reference;
    }
    for (size_t i = 0; i < 2; i++) {
        typed.integers[i] = tl_test_fmu_variable(&fmu, integers[i])->reference;
    }
    typed.boolean = tl_test_fmu_variable(&fmu, "flag")->reference;
    typed.component = (tl_component){.name = "t", .model = &fmu.model, .fmi = &fmu.functions};
    typed.component.inputs = (tl_ports){.real_count = 2,
                                        .integer_count = 2,
                                        .boolean_count = 1,
                                        .real_references = typed.reals,
                                        .integer_references = typed.integers,
                                        .boolean_references = &typed.boolean,
                                        .reals = typed.real_values,
                                        .integers = typed.integer_values,
                                        .booleans = &typed.boolean_value};
    typed.component.outputs = (tl_ports){.real_count = 1,
                                         .real_references = &typed.reals[2],
                                         .reals = &typed.real_values[2],
                                         .integers = &none,
                                         .booleans = &none};
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_component_instantiate(&typed.component, &fmu.callbacks, "", &error));
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_component_enter_initialization(&typed.component, 0.0, &error));
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_component_exit_initialization(&typed.component, &error));
}

/* Sets one input (0 … KEYED − 1) to an unusual value; KEYED: none. */
static void set_typed(size_t other) {
    typed.real_values[0] = other == 0 ? 0.5 : 0.0;
    typed.real_values[1] = other == 1 ? 0.5 : 1.0;
    typed.integer_values[0] = other == 2 ? 1 : 0;
    typed.integer_values[1] = other == 3 ? 1 : 0;
    typed.boolean_value = other == 4 ? fmi2True : fmi2False;
}

static uint64_t step_typed(size_t other) {
    uint64_t before = typed.component.executions;
    set_typed(other);
    tl_cached_component_rewind(&cached);
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_cached_component_step(&cached, 0, &error), error.text);
    return typed.component.executions - before;
}

static void start_typed(void) {
    tl_arena_init(&arena);
    tl_test_fmu_init(&fmu, WIDTH, true, &call_log);
    fmu.control.telling = true;
    place_typed();
    TEST_ASSERT_TRUE(
        tl_cached_component_init(&cached, &arena, &typed.component, TL_KEEP_STATES, TL_SECOND / 10, PREDICTION, ROOM));
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_cached_component_start(&cached, &error));
}

static void finish_typed(void) {
    tl_cached_component_end(&cached);
    TEST_ASSERT_EQUAL_UINT64(0, fmu.states);
    tl_component_free(&typed.component);
    TEST_ASSERT_EQUAL_UINT64(0, fmu.living);
    tl_arena_release(&arena);
}

static void every_input_is_in_the_key(void) {
    double y[KEYED + 1];
    start_typed();
    for (size_t i = 0; i <= KEYED; i++) {
        TEST_ASSERT_EQUAL_UINT64(1, step_typed(i));
        y[i] = typed.real_values[2];
        for (size_t k = 0; k < i; k++) {
            TEST_ASSERT_TRUE(y[k] != y[i]);
        }
    }
    for (size_t i = 0; i <= KEYED; i++) {
        TEST_ASSERT_EQUAL_UINT64(0, step_typed(i));
        TEST_ASSERT_TRUE(typed.real_values[2] == y[i]);
    }
    finish_typed();
}

static void zeros_of_different_sign_are_executed_both(void) {
    start(TL_KEEP_STATES, PREDICTION, ROOM);
    TEST_ASSERT_EQUAL_UINT64(1, advance(0.0)); /* u1 is the negative of u0 */
    double y = behind.values[2];
    rewind_candidate();
    TEST_ASSERT_EQUAL_UINT64(1, advance(-0.0));
    TEST_ASSERT_TRUE(y != behind.values[2]);
    rewind_candidate();
    TEST_ASSERT_EQUAL_UINT64(0, advance(0.0));
    TEST_ASSERT_TRUE(y == behind.values[2]);
    finish();
}

/* An output that is not finite is cached like others: as NaN with the same bits, without a second
 * execution. */
static void not_a_number_is_stored(void) {
    static const double nan_bits = (double)NAN;
    start(TL_KEEP_STATES, PREDICTION, ROOM);
    tl_test_fmu_fail_above(&fmu, TL_TEST_NAN, 1.5);
    for (uint64_t i = 1; i <= 3; i++) {
        rewind_candidate();
        set_inputs(STAR);
        TEST_ASSERT_EQUAL_INT(TL_OK, tl_cached_component_step(&cached, 0, &error));
        TEST_ASSERT_EQUAL_UINT64(1, behind.component.executions);
        TEST_ASSERT_EQUAL_MEMORY(&nan_bits, &behind.component.outputs.reals[0], sizeof nan_bits);
    }
    finish();
}

/* A long run uses no more handles than the pool has; with outputs only, as many as states are kept
 * at a time. */
static void handles_are_pooled(void) {
    static const tl_keep keeps[] = {TL_KEEP_STATES, TL_KEEP_OUTPUTS};
    static const size_t most[] = {40, 3};
    for (size_t i = 0; i < 2; i++) {
        start(keeps[i], PREDICTION, 40);
        for (size_t k = 0; k < 100; k++) {
            (void)candidate(k % 3 == 0 ? "o*o" : "**o");
            (void)candidate("*oo");
            (void)commit(k % 2 == 0 ? STAR : CIRCLE);
            TEST_ASSERT_TRUE(fmu.states <= most[i]);
        }
        TEST_ASSERT_EQUAL_UINT64(0, fmu.calls[TL_TEST_FREE_STATE]);
        finish();
    }
}

/* The pool is sized for the worst case. Only some handles exist at the start; others are created
 * when needed. */
static void handles_beyond_those_of_the_start_are_made_as_needed(void) {
    char longest[READY + 8] = "";
    start(TL_KEEP_STATES, PREDICTION, 10 * READY);
    TEST_ASSERT_EQUAL_UINT64(READY, fmu.states);
    memset(longest, 'o', READY);
    (void)candidate(longest);
    TEST_ASSERT_EQUAL_UINT64(READY, fmu.states); /* t_0 … t_255; the FMU is at t_256 */
    memset(longest, '*', READY + 7);
    (void)candidate(longest);
    TEST_ASSERT_EQUAL_UINT64(READY + 7 + READY, fmu.states);
    for (size_t i = 0; i < 20; i++) {
        (void)commit(STAR);
        (void)candidate(i % 2 == 0 ? longest : "o*o*o*o*o*");
    }
    TEST_ASSERT_EQUAL_UINT64(READY + 7 + READY, fmu.states);
    finish();
}

/* ---- final steps ---- */

/* Of the logged steps from `first` on, exactly those that began at `time` (s) were final. Returns
 * their number. */
static size_t assert_final_at(size_t first, double time) {
    size_t finals = 0;
    const tl_test_entry *entry = tl_test_log_step(&call_log, &fmu, first);
    for (size_t n = first; entry != NULL; entry = tl_test_log_step(&call_log, &fmu, ++n)) {
        TEST_ASSERT_EQUAL_INT_MESSAGE(fabs(entry->time - time) < 0.01, entry->final, where);
        finals += entry->final;
    }
    return finals;
}

static size_t steps_logged(void) {
    return tl_test_log_count(&call_log, &fmu, TL_TEST_DO_STEP);
}

/* Unknown steps are executed: o and * once from each root, and the committed step. */
static void a_step_from_the_root_is_final(void) {
    start(TL_KEEP_STATES, PREDICTION, ROOM);
    for (size_t i = 0; i < 20; i++) {
        size_t first = steps_logged();
        (void)candidate("oo*");
        (void)candidate("*oo"); /* restores the root */
        (void)candidate("o**");
        TEST_ASSERT_EQUAL_UINT64(1, commit(3.0)); /* unknown */
        TEST_ASSERT_EQUAL_size_t(3, assert_final_at(first, 0.1 * (double)(step - 1)));
    }
    finish();
}

/* With outputs only, a step from the newest saved state on the path to the root is final. Later
 * steps are not: the FMU may be restored to that state again. */
static void with_outputs_only_a_step_from_the_last_state_above_the_root_is_final(void) {
    start(TL_KEEP_OUTPUTS, 5, ROOM);
    (void)candidate("oo");
    (void)candidate("**");
    TEST_ASSERT_EQUAL_size_t(2, assert_final_at(0, 0.0));
    (void)commit(STAR);
    size_t first = steps_logged();
    (void)candidate("o"); /* the FMU is restored to t_0 and catches up */
    TEST_ASSERT_EQUAL_size_t(first + 2, steps_logged());
    TEST_ASSERT_EQUAL_size_t(1, assert_final_at(first, 0.0));
    (void)commit(CIRCLE);
    first = steps_logged();
    for (size_t i = 0; i < 20; i++) {
        (void)commit(STAR);
    }
    size_t finals = 0;
    for (size_t n = first; n < steps_logged(); n++) {
        finals += tl_test_log_step(&call_log, &fmu, n)->final;
    }
    TEST_ASSERT_EQUAL_size_t(20 / 5, finals); /* one for each state that is saved on the path */
    finish();
}

/* Beyond the pool, a candidate is always after t_i. */
static void beyond_the_pool_nothing_is_final(void) {
    start(TL_KEEP_STATES, PREDICTION, 3);
    (void)candidate("oo*o*");
    TEST_ASSERT_EQUAL_size_t(5, steps_logged());
    TEST_ASSERT_EQUAL_size_t(1, assert_final_at(0, 0.0));
    finish();
}

/* ---- full pools ---- */

static void a_full_pool_executes_counts_and_gives_the_same(void) {
    double expected[2];
    start(TL_KEEP_STATES, PREDICTION, ROOM);
    (void)candidate("oo*o");
    memcpy(expected, behind.values + 2, sizeof expected);
    finish();
    start(TL_KEEP_STATES, PREDICTION, 3);
    (void)candidate("oo");
    TEST_ASSERT_EQUAL_UINT64(0, cached.uncached);
    for (uint64_t i = 1; i <= 3; i++) {
        TEST_ASSERT_EQUAL_UINT64(2, candidate("oo*o"));
        TEST_ASSERT_EQUAL_MEMORY(expected, behind.values + 2, sizeof expected);
        TEST_ASSERT_EQUAL_UINT64(2 * i, cached.uncached);
    }
    TEST_ASSERT_EQUAL_UINT32(3, cached.tree.peak);
    TEST_ASSERT_EQUAL_UINT64(0, candidate("oo"));
    finish();
}

static void the_committed_step_finds_room(void) {
    start(TL_KEEP_STATES, PREDICTION, 4);
    (void)candidate("ooo");
    TEST_ASSERT_EQUAL_UINT64(1, commit(STAR)); /* all known sequences are dropped for it */
    TEST_ASSERT_EQUAL_UINT64(0, cached.uncached);
    TEST_ASSERT_EQUAL_UINT64(3, candidate("ooo"));
    TEST_ASSERT_EQUAL_UINT64(0, commit(CIRCLE)); /* known: nothing is dropped */
    TEST_ASSERT_EQUAL_UINT64(0, candidate("oo"));
    finish();
}

/* ---- failures ---- */

enum { FAILING_CALLS = 40 };

/* Walks as a search does; a failing step ends the candidate. Returns the sum of the committed
 * outputs. */
static uint64_t walk_with_failures(size_t *failures) {
    static const char *const walks[] = {"ooo", "*o*", "oo*", "***", "o*o"};
    uint64_t sum = 0;
    for (size_t i = 0; i < 3 * sizeof walks / sizeof walks[0]; i++) {
        bool walking = true;
        rewind_candidate();
        for (const char *at = walks[i % 5]; *at != '\0' && walking; at++) {
            set_inputs(*at == 'o' ? CIRCLE : STAR);
            walking = tl_cached_component_step(&cached, step + depth++, &error) == TL_OK;
        }
        *failures += !walking;
        for (size_t again = 0; again < 3; again++) { /* synchroniser.c repeats a commit, too */
            rewind_candidate();
            set_inputs(i % 2 == 0 ? CIRCLE : STAR);
            tl_cached_component_make_room(&cached);
            if (tl_cached_component_step(&cached, step, &error) == TL_OK) {
                break;
            }
            *failures += 1;
            TEST_ASSERT_TRUE_MESSAGE(again < 2, where);
        }
        tl_cached_component_commit(&cached);
        step++;
        for (size_t k = 0; k < 2; k++) {
            uint64_t bits = 0;
            memcpy(&bits, behind.values + 2 + k, sizeof bits);
            sum = tl_test_mix(sum + bits);
        }
    }
    return sum;
}

/* If an FMU answers fmi2Error while its state is saved, it keeps that state. The next candidate
 * that continues from there may be the first to fail. */
static void assert_failed(tl_test_call call, tl_test_fault_kind kind, bool reached, size_t failures) {
    size_t most = call == TL_TEST_GET_STATE && kind == TL_TEST_ERROR ? 2 : 1;
    TEST_ASSERT_TRUE_MESSAGE(reached ? failures >= 1 && failures <= most : failures == 0, where);
}

static void assert_failures(tl_test_call call, tl_test_fault_kind kind, tl_keep keep) {
    size_t failures = 0;
    start(keep, PREDICTION, 20);
    uint64_t wanted = walk_with_failures(&failures);
    TEST_ASSERT_EQUAL_UINT64(0, failures);
    uint64_t calls = fmu.calls[call];
    finish();
    for (uint64_t n = 1; n <= calls; n++) {
        (void)snprintf(where, sizeof where, "%s %u, kind %u, keep %u", tl_test_call_name(call), (unsigned)n,
                       (unsigned)kind, (unsigned)keep);
        start(keep, PREDICTION, 20);
        if (n <= fmu.calls[call]) { /* during the start */
            finish();
            continue;
        }
        tl_test_fmu_fail(&fmu, call, kind, n, n);
        failures = 0;
        TEST_ASSERT_EQUAL_UINT64_MESSAGE(wanted, walk_with_failures(&failures), where);
        assert_failed(call, kind, fmu.calls[call] >= n, failures);
        finish();
    }
}

static void one_failing_call_fails_one_candidate_and_no_more(void) {
    static const tl_test_call calls[] = {TL_TEST_DO_STEP, TL_TEST_GET_STATE, TL_TEST_SET_STATE, TL_TEST_SET_REAL,
                                         TL_TEST_GET_REAL};
    static const tl_test_fault_kind kinds[] = {TL_TEST_DISCARD, TL_TEST_ERROR};
    for (size_t i = 0; i < 5; i++) {
        for (size_t k = 0; k < 2; k++) {
            assert_failures(calls[i], kinds[k], TL_KEEP_STATES);
            assert_failures(calls[i], kinds[k], TL_KEEP_OUTPUTS);
        }
    }
}

static void a_step_that_always_fails_is_tried_each_time(void) {
    start(TL_KEEP_STATES, PREDICTION, ROOM);
    tl_test_fmu_fail_above(&fmu, TL_TEST_DISCARD, 1.5);
    (void)candidate("oo");
    for (size_t i = 0; i < 3; i++) {
        rewind_candidate();
        (void)advance(CIRCLE);
        set_inputs(STAR);
        uint64_t before = behind.component.executions;
        TEST_ASSERT_EQUAL_INT(TL_FMU_FAILED, tl_cached_component_step(&cached, step + 1, &error));
        TEST_ASSERT_EQUAL_UINT64(before + 1, behind.component.executions);
    }
    TEST_ASSERT_EQUAL_UINT64(1, candidate("ooo"));
    finish();
}

static void a_start_that_fails_can_be_ended(void) {
    for (uint64_t n = 1; n <= 5; n++) {
        tl_arena_init(&arena);
        tl_test_fmu_init(&fmu, WIDTH, false, &call_log);
        place(&behind);
        place(&without);
        TEST_ASSERT_TRUE(
            tl_cached_component_init(&cached, &arena, &behind.component, TL_KEEP_STATES, TL_SECOND / 10, 1, 5));
        tl_test_fmu_fail(&fmu, TL_TEST_GET_STATE, TL_TEST_ERROR, n, n);
        TEST_ASSERT_EQUAL_INT(TL_FMU_FAILED, tl_cached_component_start(&cached, &error));
        TEST_ASSERT_EQUAL_UINT64(n - 1, fmu.states);
        finish();
    }
}

static void nothing_is_called_after_fatal(void) {
    start(TL_KEEP_STATES, PREDICTION, ROOM);
    (void)candidate("oo");
    tl_test_fmu_fail(&fmu, TL_TEST_DO_STEP, TL_TEST_FATAL, 3, 3);
    set_inputs(CIRCLE);
    TEST_ASSERT_EQUAL_INT(TL_FMU_FATAL, tl_cached_component_step(&cached, 2, &error));
    rewind_candidate();
    set_inputs(STAR);
    TEST_ASSERT_EQUAL_INT(TL_FMU_FATAL, tl_cached_component_step(&cached, 0, &error));
    tl_cached_component_end(&cached);
    tl_component_free(&behind.component);
    tl_arena_release(&arena);
}

/* ---- compared with executing everything ---- */

static void assert_same_step(double u) {
    double now = 0.1 * (double)(step + depth);
    without.values[0] = u;
    without.values[1] = -u;
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_component_step(&without.component, now, 0.1, false, &error));
    (void)advance(u);
    TEST_ASSERT_TRUE_MESSAGE(memcmp(without.values, behind.values, sizeof without.values) == 0, where);
}

static void restore_without(void) {
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_component_restore(&without.component, without_state, &error));
}

/* Invariants after any walk. */
static void assert_sound(void) {
    const tl_sequence_cache *tree = &cached.tree;
    uint32_t used = 0;
    for (uint32_t i = 0; i < tree->capacity; i++) {
        used += tree->nodes[i].used;
    }
    TEST_ASSERT_EQUAL_UINT32_MESSAGE(used, tree->count, where);
    TEST_ASSERT_TRUE_MESSAGE(tree->nodes[cached.root].used, where);
    TEST_ASSERT_TRUE_MESSAGE(cached.at == TL_NO_NODE || tree->nodes[cached.at].used, where);
    TEST_ASSERT_TRUE_MESSAGE(tree->peak >= used && tree->peak <= tree->capacity, where);
}

static void walk_at_random(uint64_t seed) {
    static const double inputs[] = {0.0, -0.0, 1.0, 2.0};
    tl_test_random random = {tl_test_mix(seed)};
    tl_keep keep = (tl_keep)tl_test_random_below(&random, 3);
    uint32_t spacing = (uint32_t)tl_test_random_between(&random, 1, 5);
    uint32_t least = keep == TL_KEEP_NONE ? TL_NODES_OF_NONE : 2 * spacing + 2;
    uint32_t room = least + (uint32_t)(tl_test_random_chance(&random, 50) ? tl_test_random_below(&random, 4)
                                                                          : tl_test_random_below(&random, 100));
    size_t choices = tl_test_random_between(&random, 1, 4);
    start(keep, spacing, room);
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_component_save(&without.component, &without_state, &error));
    for (size_t i = 0; i < 40; i++) {
        size_t length = tl_test_random_between(&random, 0, spacing);
        for (size_t k = 0; k < length; k++) {
            assert_same_step(inputs[tl_test_random_below(&random, choices)]);
        }
        rewind_candidate();
        restore_without();
        if (tl_test_random_chance(&random, 30)) {
            double u = inputs[tl_test_random_below(&random, choices)];
            set_inputs(u);
            tl_cached_component_make_room(&cached);
            assert_same_step(u);
            tl_cached_component_commit(&cached);
            TEST_ASSERT_EQUAL_INT(TL_OK, tl_component_save(&without.component, &without_state, &error));
            step++;
            depth = 0;
        }
        assert_sound();
    }
    TEST_ASSERT_EQUAL_STRING_MESSAGE("", call_log.first_violation, where);
    TEST_ASSERT_TRUE_MESSAGE(keep == TL_KEEP_OUTPUTS || cached.repeated == 0, where);
    finish();
}

static void random_walks_give_the_same_bits_as_executing_everything(void) {
    size_t walks = tl_test_campaign("TL_TEST_WALKS", 1000);
    for (uint64_t seed = 1; seed <= walks; seed++) {
        (void)snprintf(where, sizeof where, "seed %llu", (unsigned long long)seed);
        walk_at_random(seed);
    }
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(table_4_1_with_outputs_stored);
    RUN_TEST(table_4_1_with_states_stored_too);
    RUN_TEST(states_are_saved_and_loaded_only_where_needed);
    RUN_TEST(outputs_only_keeps_few_states);
    RUN_TEST(a_distant_candidate_saves_a_state_every_spacing);
    RUN_TEST(a_committed_root_moves);
    RUN_TEST(commits_without_candidates_cost_one_execution_and_no_node);
    RUN_TEST(outputs_only_catches_up_over_commits);
    RUN_TEST(every_input_is_in_the_key);
    RUN_TEST(zeros_of_different_sign_are_executed_both);
    RUN_TEST(not_a_number_is_stored);
    RUN_TEST(handles_are_pooled);
    RUN_TEST(handles_beyond_those_of_the_start_are_made_as_needed);
    RUN_TEST(a_step_from_the_root_is_final);
    RUN_TEST(with_outputs_only_a_step_from_the_last_state_above_the_root_is_final);
    RUN_TEST(beyond_the_pool_nothing_is_final);
    RUN_TEST(a_full_pool_executes_counts_and_gives_the_same);
    RUN_TEST(the_committed_step_finds_room);
    RUN_TEST(one_failing_call_fails_one_candidate_and_no_more);
    RUN_TEST(a_step_that_always_fails_is_tried_each_time);
    RUN_TEST(a_start_that_fails_can_be_ended);
    RUN_TEST(nothing_is_called_after_fatal);
    RUN_TEST(random_walks_give_the_same_bits_as_executing_everything);
    return UNITY_END();
}
