/* No allocation in the cycle: counts each allocation in 10,000 steps of a locked twin, by caller.
 *
 * The allocator functions are defined here and call those of the C library, so all objects of the
 * process use them. The return address tells the caller. All calls during a call of an FMU count as
 * the FMU's, also those of our callbacks. A sanitizer replaces the allocator; there the test is
 * skipped.
 */
#include <stdio.h>

enum { SKIPPED = 77 };

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)

int main(void) {
    printf("skipped: not with a sanitizer\n");
    return SKIPPED;
}

#else

#include <dlfcn.h>
#include <errno.h>
#include <math.h>
#include <nlopt.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <unity.h>

#include "firmware/fmu/fmu_store.h"
#include "tests/support/test_plan.h"

enum { CALLERS = 8, NAME = 64, STEPS = 10000, STEPS_OF_NLOPT = 2000, WARM_UP = 100 };

/* ---- the tally ---- */

typedef struct tally {
    char name[NAME]; /* "": unused */
    uint64_t taken;
    uint64_t given_back;
} tally;

static tally tallies[CALLERS];
static bool counting;
static bool in_fmu;
static const char *own; /* file name of this program: twinlock and the test are linked into it */

static const char *file_name(const char *path) {
    const char *slash = strrchr(path, '/');
    return slash == NULL ? path : slash + 1;
}

static const char *object_of(const void *address) {
    Dl_info info;
    return dladdr(address, &info) != 0 ? file_name(info.dli_fname) : "?";
}

static tally *tally_of(const char *name) {
    for (size_t i = 0; i < CALLERS; i++) {
        if (tallies[i].name[0] == '\0') {
            strncpy(tallies[i].name, name, NAME - 1);
        }
        if (strcmp(tallies[i].name, name) == 0) {
            return &tallies[i];
        }
    }
    return &tallies[CALLERS - 1];
}

static tally *tally_of_caller(const void *address) {
    return tally_of(in_fmu ? "FMU" : object_of(address));
}

static void note_taken(const void *address) {
    if (counting) {
        tally_of_caller(address)->taken++;
    }
}

static void note_given_back(const void *address) {
    if (counting) {
        tally_of_caller(address)->given_back++;
    }
}

/* ---- the allocator ---- */

/* dlsym() may allocate before it has found the allocator. This memory is never freed. */
static unsigned char early[4096];
static size_t early_used;

static void *take_early(size_t size) {
    void *block = early + early_used;
    early_used += (size + 15) / 16 * 16;
    return early_used <= sizeof early ? block : NULL;
}

static bool is_early(const void *block) {
    return (uintptr_t)block - (uintptr_t)early < sizeof early;
}

static struct {
    void *(*malloc)(size_t);
    void *(*calloc)(size_t, size_t);
    void *(*realloc)(void *, size_t);
    void (*free)(void *);
    int (*posix_memalign)(void **, size_t, size_t);
    void *(*aligned_alloc)(size_t, size_t);
} real;

/* Stores the address in a function pointer, as POSIX recommends. */
static void find(void *function, const char *name) {
    *(void **)function = dlsym(RTLD_NEXT, name);
}

/* False during the search for the allocator. */
static bool is_found(void) {
    static bool finding;
    if (real.aligned_alloc == NULL && !finding) {
        finding = true;
        find(&real.malloc, "malloc");
        find(&real.calloc, "calloc");
        find(&real.realloc, "realloc");
        find(&real.free, "free");
        find(&real.posix_memalign, "posix_memalign");
        find(&real.aligned_alloc, "aligned_alloc");
        finding = false;
    }
    return real.aligned_alloc != NULL;
}

// NOLINTBEGIN(readability-inconsistent-declaration-parameter-name): the C library's own are reserved
void *malloc(size_t size) {
    note_taken(__builtin_return_address(0));
    return is_found() ? real.malloc(size) : take_early(size);
}

void *calloc(size_t count, size_t size) {
    note_taken(__builtin_return_address(0));
    return is_found() ? real.calloc(count, size) : take_early(count * size);
}

void *realloc(void *block, size_t size) {
    note_taken(__builtin_return_address(0));
    return is_found() ? real.realloc(block, size) : NULL;
}

void free(void *block) {
    if (block != NULL && !is_early(block) && is_found()) {
        note_given_back(__builtin_return_address(0));
        real.free(block);
    }
}

int posix_memalign(void **block, size_t alignment, size_t size) {
    note_taken(__builtin_return_address(0));
    return is_found() ? real.posix_memalign(block, alignment, size) : ENOMEM;
}

void *aligned_alloc(size_t alignment, size_t size) {
    note_taken(__builtin_return_address(0));
    return is_found() ? real.aligned_alloc(alignment, size) : NULL;
}
// NOLINTEND(readability-inconsistent-declaration-parameter-name)

/* ---- searches of NLopt ---- */

static const char *nlopt; /* file name of the library */
static uint64_t searches;
static uint64_t least; /* fewest blocks per search */
static uint64_t most;
static uint64_t taken_before;
static int64_t most_beyond; /* most blocks of a step beyond its evaluations */

static void note_search(void) {
    uint64_t taken = tally_of(nlopt)->taken;
    uint64_t of_search = taken - taken_before;
    taken_before = taken;
    searches++;
    least = of_search < least ? of_search : least;
    most = of_search > most ? of_search : most;
}

/* Replaces the function of the library and calls it. */
nlopt_result nlopt_optimize(nlopt_opt opt, double *x, double *value) {
    nlopt_result (*optimize)(nlopt_opt, double *, double *) = NULL;
    *(void **)&optimize = dlsym(RTLD_NEXT, "nlopt_optimize");
    nlopt = object_of(*(void **)&optimize);
    nlopt_result result = optimize(opt, x, value);
    if (counting) {
        note_search();
    }
    return result;
}

/* ---- the twin ---- */

static tl_fmu lag;
static tl_fmi2 of_lag;
static tl_test_log call_log;
static tl_test_fmu discrete;
static tl_test_plan plan;
static tl_test_run run;
static bool wasteful; /* the FMU allocates and frees memory in each step */

static fmi2Status fmu_step(fmi2Component component, fmi2Real time, fmi2Real step, fmi2Boolean final) {
    in_fmu = true;
    void *block = wasteful ? lag.guard.callbacks.allocateMemory(3, 8) : NULL;
    fmi2Status status = of_lag.do_step(component, time, step, final);
    lag.guard.callbacks.freeMemory(block);
    in_fmu = false;
    return status;
}

static fmi2Status fmu_get_state(fmi2Component component, fmi2FMUstate *state) {
    in_fmu = true;
    fmi2Status status = of_lag.get_fmu_state(component, state);
    in_fmu = false;
    return status;
}

static fmi2Status fmu_set_state(fmi2Component component, fmi2FMUstate state) {
    in_fmu = true;
    fmi2Status status = of_lag.set_fmu_state(component, state);
    in_fmu = false;
    return status;
}

void setUp(void) {
    tl_error error = {TL_OK, ""};
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        TL_OK, tl_fmu_load(TL_BINARY_DIR "/fmus/lag.fmu", -1, TL_ROLLBACK_STATE, &lag, &error), error.text);
    of_lag = lag.guard.functions;
    lag.guard.functions.do_step = fmu_step;
    lag.guard.functions.get_fmu_state = fmu_get_state;
    lag.guard.functions.set_fmu_state = fmu_set_state;
    lag.guard.functions.step_reals = NULL; /* so that do_step is called */
    wasteful = false;
    tl_test_plan_init(&plan, TL_SECOND / 100);
    tl_test_fmu_init(&discrete, 1, true, &call_log);
}

void tearDown(void) {
    tl_test_run_end(&run, &plan);
    tl_fmu_unload(&lag);
}

static void add_lag(const char *name) {
    tl_plan_component *component = tl_test_plan_component(&plan, name, &discrete);
    component->model = &lag.model;
    component->functions = &lag.guard.functions;
    component->callbacks = &lag.guard.callbacks;
    component->resources = lag.resources;
}

typedef struct setting {
    const char *algorithm;
    size_t variables; /* 1 or 2 */
    uint32_t prediction;
    tl_shape shape;
    bool saving;
    tl_keep keep;
} setting;

/* cmd → a → b, with penalties, bounds and a Huber limit. */
static void add_chain(const setting *set) {
    add_lag("a");
    add_lag("b");
    plan.components[0].keep = set->keep;
    plan.components[1].keep = set->keep;
    tl_test_plan_connect(&plan, "plant.cmd", "a.u");
    tl_test_plan_connect(&plan, "a.y", "b.u");
    tl_plan_adjust *adjust = tl_test_plan_adjust(&plan, "b.u", 0.1);
    adjust->deviation_penalty = 1e-6;
    adjust->rate_penalty = 1e-6;
    if (set->variables > 1) {
        adjust = tl_test_plan_adjust(&plan, "b.T", 0.01);
        adjust->lower = 0.02;
        adjust->upper = 0.5;
    }
    tl_plan_match *match = tl_test_plan_match(&plan, "b.y", "plant.y", 0.001);
    match->huber = 3.0;
}

static void add_booleans(void) {
    tl_test_plan_component(&plan, "d", &discrete);
    tl_test_plan_set(&plan, "u0", 0.0);
    tl_test_plan_set(&plan, "count", 0.0);
    tl_test_plan_set(&plan, "mode", 0.0);
    tl_test_plan_adjust(&plan, "d.flag", 0.0)->dwell = TL_SECOND / 50;
    tl_test_plan_match(&plan, "d.flag_out", "plant.on", 0.1);
}

static void build(const setting *set) {
    tl_test_run_end(&run, &plan);
    tl_test_plan_init(&plan, TL_SECOND / 100);
    tl_test_plan_signal(&plan, "cmd", TL_REAL, "");
    tl_test_plan_signal(&plan, "y", TL_REAL, "");
    tl_test_plan_signal(&plan, "on", TL_BOOLEAN, "");
    if (strcmp(set->algorithm, "boolean") == 0) {
        add_booleans();
    } else {
        add_chain(set);
    }
    plan.plan.algorithm = set->algorithm;
    plan.plan.prediction = set->prediction;
    plan.plan.shape = set->shape;
    plan.plan.saving = (tl_plan_saving){set->saving, set->saving, 0};
    plan.plan.noise_floor = 1e-9;
    tl_test_run_build(&run, &plan);
    run.budget.evaluations = 40;
    plan.plan.evaluations = 40;
}

static tl_time no_time(void *context) {
    (void)context;
    return 0;
}

static uint64_t outcomes[TL_OUTCOMES];

static uint64_t taken_in_all(void) {
    uint64_t sum = 0;
    for (size_t i = 0; i < CALLERS; i++) {
        sum += tallies[i].taken;
    }
    return sum;
}

static void forget_tallies(void) {
    memset(tallies, 0, sizeof tallies);
    searches = 0;
    least = UINT64_MAX;
    most = 0;
    taken_before = 0;
    most_beyond = 0;
}

/* One tick. Most are searched; some are timed, missed, or without a good measurement; a few reset
 * the FMUs. */
static void tick(void) {
    int64_t number = run.sample.tick;
    double t = (double)number;
    run.sample.values[0] = sin(0.05 * t);
    run.sample.values[1] = 1.3 * sin(0.05 * t - 1.0) + 0.2 * sin(0.9 * t) + (number % 50 == 0 ? 20.0 : 0.0);
    run.sample.values[2] = number / 5 % 2 != 0 ? 1.0 : 0.0;
    run.sample.quality[1] = number % 71 < 9 ? TL_STALE : TL_GOOD;
    run.sample.quality[2] = run.sample.quality[1];
    run.budget.now = number % 3 == 0 ? no_time : NULL;
    run.budget.time = TL_SECOND;
    if (number % 997 == 996) {
        tl_twin_reset(run.twin);
    }
    if (number % 97 == 96) {
        tl_test_run_catch_up(&run);
    } else {
        tl_test_run_step(&run);
    }
    outcomes[run.record.outcome] += run.ready ? 1 : 0;
}

/* FMUs allocate states if a search needs more than ever before, and keep them. */
static uint64_t taken_outside_fmus(void) {
    return taken_in_all() - tally_of("FMU")->taken;
}

/* Counts so many steps after the warm-up. */
static void count_steps(const setting *set, int steps) {
    build(set);
    for (int i = 0; i < WARM_UP; i++) {
        tick();
    }
    forget_tallies();
    memset(outcomes, 0, sizeof outcomes);
    counting = true;
    for (int i = 0; i < steps; i++) {
        uint64_t before = taken_outside_fmus();
        tick();
        int64_t beyond = (int64_t)(taken_outside_fmus() - before) - (int64_t)run.record.evaluations;
        most_beyond = beyond > most_beyond ? beyond : most_beyond;
    }
    counting = false;
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, run.status, run.error.text);
    /* the twin is locked */
    TEST_ASSERT_TRUE(outcomes[TL_OPTIMISED] + outcomes[TL_BEST_SO_FAR] > (uint64_t)steps / 10);
    TEST_ASSERT_TRUE(outcomes[TL_CAUGHT_UP] > (uint64_t)steps / 200);
    TEST_ASSERT_TRUE(outcomes[TL_FREE_RUN] > 0 || set->prediction > 1);
}

/* Prints all counts. */
static void print_tallies(const setting *set) {
    for (size_t i = 0; i < CALLERS && tallies[i].name[0] != '\0'; i++) {
        printf("%s, %zu unknowns, %s took %llu blocks, gave back %llu", set->algorithm,
               tl_twin_get_facts(run.twin).unknowns, tallies[i].name, (unsigned long long)tallies[i].taken,
               (unsigned long long)tallies[i].given_back);
        if (searches > 0 && strcmp(tallies[i].name, nlopt) == 0) {
            printf(": %llu to %llu per search", (unsigned long long)least, (unsigned long long)most);
        }
        printf("\n");
    }
}

/* ---- tests ---- */

static void the_allocator_is_watched(void) {
    forget_tallies();
    counting = true;
    void *volatile blocks[5] = {malloc(1), calloc(1, 1), realloc(NULL, 1), aligned_alloc(64, 64), NULL};
    void *aligned = NULL;
    int status = posix_memalign(&aligned, 64, 64);
    blocks[4] = aligned;
    for (size_t i = 0; i < 5; i++) {
        free(blocks[i]);
    }
    counting = false;
    TEST_ASSERT_EQUAL_INT(0, status);
    TEST_ASSERT_EQUAL_UINT64(5, tally_of(own)->taken);
    TEST_ASSERT_EQUAL_UINT64(5, tally_of(own)->given_back);
    TEST_ASSERT_EQUAL_UINT64(5, taken_in_all());
}

static void our_solver_takes_nothing(void) {
    for (uint32_t number = 0; number < 8; number++) {
        const setting set = {.algorithm = "secant",
                             .variables = 1 + number % 2,
                             .prediction = number / 2 % 2 == 0 ? 1 : 4,
                             .shape = number % 4 == 2 ? TL_DYNAMIC : TL_STATIC,
                             .saving = number / 4 > 0};
        count_steps(&set, STEPS);
        TEST_ASSERT_EQUAL_UINT64(0, taken_in_all());
    }
}

static void the_boolean_solver_takes_nothing(void) {
    const setting set = {.algorithm = "boolean", .prediction = 1};
    count_steps(&set, STEPS);
    TEST_ASSERT_EQUAL_UINT64(0, taken_in_all());
}

/* The FMU allocates a state when it is first needed, once per cache slot. */
static void if_outputs_are_kept_only_fmus_allocate_states(void) {
    const setting set = {
        .algorithm = "secant", .variables = 1, .prediction = 4, .saving = true, .keep = TL_KEEP_OUTPUTS};
    count_steps(&set, STEPS);
    print_tallies(&set);
    uint64_t places = tl_twin_get_ledger(run.twin, 0).nodes + tl_twin_get_ledger(run.twin, 1).nodes;
    TEST_ASSERT_TRUE(tally_of("FMU")->taken <= places && places < STEPS / 10);
    TEST_ASSERT_EQUAL_UINT64(tally_of("FMU")->taken, taken_in_all());
}

/* Allocations of an FMU are counted for the FMU. */
static void allocations_of_an_fmu_are_counted_separately(void) {
    const setting set = {.algorithm = "secant", .variables = 1, .prediction = 1};
    wasteful = true;
    count_steps(&set, STEPS);
    print_tallies(&set);
    TEST_ASSERT_TRUE(tally_of("FMU")->taken >= 2 * STEPS);
    TEST_ASSERT_EQUAL_UINT64(tally_of("FMU")->taken, tally_of("FMU")->given_back);
    TEST_ASSERT_EQUAL_UINT64(tally_of("FMU")->taken, taken_in_all());
}

/* FMUs allocate only states beyond those of the start, and keep them. */
static void assert_states_are_kept(const setting *set) {
    uint64_t places = tl_twin_get_ledger(run.twin, 0).nodes_peak + tl_twin_get_ledger(run.twin, 1).nodes_peak;
    TEST_ASSERT_TRUE(tally_of("FMU")->taken <= (set->saving ? places : 0) && places < STEPS_OF_NLOPT);
    TEST_ASSERT_EQUAL_UINT64(0, tally_of("FMU")->given_back);
}

/* Only NLopt allocates, and it frees all. */
static void count_nlopt(const char *algorithm, size_t variables, uint32_t prediction) {
    const setting set = {
        .algorithm = algorithm, .variables = variables, .prediction = prediction, .shape = TL_DYNAMIC, .saving = true};
    count_steps(&set, STEPS_OF_NLOPT);
    print_tallies(&set);
    TEST_ASSERT_TRUE(searches > STEPS_OF_NLOPT / 4);
    TEST_ASSERT_EQUAL_UINT64(0, tally_of(own)->taken);
    TEST_ASSERT_EQUAL_UINT64(taken_outside_fmus(), tally_of(nlopt)->taken);
    assert_states_are_kept(&set);
    TEST_ASSERT_EQUAL_UINT64(tally_of(nlopt)->taken, tally_of(nlopt)->given_back);
}

static void bobyqa_takes_five_blocks_for_a_search(void) {
    for (size_t variables = 1; variables <= 2; variables++) {
        for (uint32_t prediction = 1; prediction <= 3; prediction += 2) {
            count_nlopt("bobyqa", variables, prediction);
            TEST_ASSERT_EQUAL_UINT64(5, least);
            TEST_ASSERT_EQUAL_UINT64(5, most);
        }
    }
}

static void lbfgs_takes_two_blocks_for_a_search(void) {
    for (size_t variables = 1; variables <= 2; variables++) {
        for (uint32_t prediction = 1; prediction <= 3; prediction += 2) {
            count_nlopt("l-bfgs", variables, prediction);
            TEST_ASSERT_EQUAL_UINT64(2, least);
            TEST_ASSERT_EQUAL_UINT64(2, most);
        }
    }
}

/* Not a constant number: NLopt allocates a node per corner of a simplex, and again if a simplex
 * shrinks or restarts. */
static void nelder_mead_and_sbplx_take_at_most_a_block_per_evaluation(void) {
    static const char *const algorithms[] = {"nelder-mead", "sbplx"};
    for (size_t i = 0; i < 2; i++) {
        for (size_t variables = 1; variables <= 2; variables++) {
            for (uint32_t prediction = 1; prediction <= 3; prediction += 2) {
                count_nlopt(algorithms[i], variables, prediction);
                TEST_ASSERT_TRUE(most_beyond <= 1);
            }
        }
    }
}

int main(void) {
    own = object_of(tallies);
    UNITY_BEGIN();
    RUN_TEST(the_allocator_is_watched);
    RUN_TEST(our_solver_takes_nothing);
    RUN_TEST(the_boolean_solver_takes_nothing);
    RUN_TEST(if_outputs_are_kept_only_fmus_allocate_states);
    RUN_TEST(allocations_of_an_fmu_are_counted_separately);
    RUN_TEST(bobyqa_takes_five_blocks_for_a_search);
    RUN_TEST(lbfgs_takes_two_blocks_for_a_search);
    RUN_TEST(nelder_mead_and_sbplx_take_at_most_a_block_per_evaluation);
    return UNITY_END();
}

#endif
