/* Benchmark: what the twin costs beyond the FMUs' own work. README.md says what is measured and how
 * to read it.
 *
 * usage: bench FOLDER                                        the table; FOLDER holds lag.fmu and
 *        van_der_pol.fmu bench FOLDER --cases                                the names of the cases
 *        that can be counted bench FOLDER --count CASE SIDE STEPS EVALUATIONS    one side (floor,
 *        twin) of one case, for callgrind
 *
 * Blocks of floor and twin alternate in one process, at least 10 ms each. The result is the fastest
 * of many blocks. Times are processor times of the thread, so that other programs have little
 * influence.
 */
#include <sched.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "firmware/fmu/fmu_store.h"
#include "tests/bench/bench_floor.h"
#include "tests/bench/bench_twin.h"

enum { ROUNDS = 40, MOST_STEPS = 1 << 20, BUDGET = 20, SMALL_BUDGET = 2 };

static const double SHORTEST_BLOCK = 10e6; /* ns */

typedef enum bench_kind { FREE, LOCKED, CHAIN, LIVE } bench_kind;

typedef struct bench_case {
    const char *name;
    bench_kind kind;
    const char *model;
    size_t count;
    const char *solver;
    double most; /* target of the ratio; 0: none */
} bench_case;

static const bench_case cases[] = {
    {"free/lag/3", FREE, "lag", 3, NULL, 1.5},
    {"free/lag/10", FREE, "lag", 10, NULL, 1.5},
    {"free/lag/30", FREE, "lag", 30, NULL, 1.5},
    {"free/van_der_pol/2", FREE, "van_der_pol", 2, NULL, 1.05},
    {"free/van_der_pol/10", FREE, "van_der_pol", 10, NULL, 1.05},
    {"locked/lag/secant", LOCKED, "lag", 2, "secant", 1.5},
    {"locked/lag/nelder-mead", LOCKED, "lag", 2, "nelder-mead", 0.0},
    {"locked/lag/bobyqa", LOCKED, "lag", 2, "bobyqa", 0.0},
    {"locked/lag/l-bfgs", LOCKED, "lag", 2, "l-bfgs", 0.0},
    {"locked/lag/sbplx", LOCKED, "lag", 2, "sbplx", 0.0},
    {"locked/van_der_pol/secant", LOCKED, "van_der_pol", 2, "secant", 1.4},
    {"locked/van_der_pol/nelder-mead", LOCKED, "van_der_pol", 2, "nelder-mead", 1.4},
    {"locked/van_der_pol/bobyqa", LOCKED, "van_der_pol", 2, "bobyqa", 1.4},
    {"locked/van_der_pol/l-bfgs", LOCKED, "van_der_pol", 2, "l-bfgs", 1.4},
    {"locked/van_der_pol/sbplx", LOCKED, "van_der_pol", 2, "sbplx", 1.4},
    {"chain/lag/2", CHAIN, "lag", 2, "nelder-mead", 0.0},
    {"chain/lag/4", CHAIN, "lag", 4, "nelder-mead", 0.0},
    {"chain/lag/8", CHAIN, "lag", 8, "nelder-mead", 0.0},
    {"chain/lag/16", CHAIN, "lag", 16, "nelder-mead", 0.0},
    {"chain/lag/32", CHAIN, "lag", 32, "nelder-mead", 0.0},
    {"chain/van_der_pol/2", CHAIN, "van_der_pol", 2, "nelder-mead", 0.0},
    {"chain/van_der_pol/4", CHAIN, "van_der_pol", 4, "nelder-mead", 0.0},
    {"live/lag/32", LIVE, "lag", 32, "nelder-mead", 2.5},
    {"live/lag/2", LIVE, "lag", 2, "secant", 0.0},
    {"live/van_der_pol/2", LIVE, "van_der_pol", 2, "secant", 0.0},
};

enum { CASES = sizeof cases / sizeof cases[0] };

static uint32_t evaluations[MOST_STEPS];

/* ---- Time ---- */

static double processor_ns(void) {
    struct timespec now;
    (void)clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
    return (double)now.tv_sec * 1e9 + (double)now.tv_nsec;
}

/* Pins the thread to one processor, so that both sides have the same caches and clock. If that
 * fails, the times are noisier. */
static void pin(void) {
    cpu_set_t set;
    int processor = sched_getcpu();
    CPU_ZERO(&set);
    if (processor >= 0) {
        CPU_SET((size_t)processor, &set);
        (void)sched_setaffinity(0, sizeof set, &set);
    }
}

static double smaller(double a, double b) {
    return b < a ? b : a;
}

/* ---- Blocks ---- */

static double time_twin(bench_twin *twin, int64_t steps, uint32_t *counts) {
    bench_twin_prepare(twin, steps);
    double begun = processor_ns();
    bench_twin_run(twin, steps, counts);
    return processor_ns() - begun;
}

static double time_floor(bench_chain *chain, bench_kind kind, int64_t steps) {
    double begun = processor_ns();
    if (kind == FREE) {
        bench_floor_free(chain, 0, steps);
    } else {
        bench_floor_locked(chain, 0, steps, evaluations);
    }
    return processor_ns() - begun;
}

static uint64_t sum_of_evaluations(int64_t steps) {
    uint64_t sum = 0;
    for (int64_t i = 0; i < steps; i++) {
        sum += evaluations[i];
    }
    return sum;
}

static void set_evaluations(int64_t steps, uint32_t count) {
    for (int64_t i = 0; i < steps; i++) {
        evaluations[i] = count;
    }
}

/* Returns the number of steps of a block of this twin. */
static int64_t block_of_twin(bench_twin *twin) {
    int64_t steps = 1;
    while (steps < MOST_STEPS && time_twin(twin, steps, NULL) < SHORTEST_BLOCK) {
        steps *= 2;
    }
    return steps;
}

static int64_t block_of_floor(bench_chain *chain, bench_kind kind) {
    int64_t steps = 16;
    while (steps < MOST_STEPS && time_floor(chain, kind, steps) < SHORTEST_BLOCK) {
        steps *= 2;
    }
    return steps;
}

/* ---- Tables ---- */

static bench_setup setup_of(const bench_case *c, const tl_fmu *fmu, uint32_t budget) {
    bench_setup setup = {
        .fmu = fmu, .count = c->count, .solver = c->solver, .evaluations = budget, .saving = c->kind == CHAIN};
    return setup;
}

static void print_limit(double most) {
    if (most > 0.0) {
        (void)printf("   <= %.2f", most);
    }
    (void)printf("\n");
}

static void bench_free(const bench_case *c, const tl_fmu *fmu) {
    bench_chain chain;
    bench_twin twin;
    bench_setup setup = setup_of(c, fmu, 1);
    bench_chain_open(&chain, fmu, c->count);
    (void)bench_twin_open(&twin, &setup);
    int64_t steps = block_of_floor(&chain, FREE);
    double floor_best = 1e300;
    double twin_best = 1e300;
    for (int round = 0; round < ROUNDS; round++) {
        floor_best = smaller(floor_best, time_floor(&chain, FREE, steps));
        twin_best = smaller(twin_best, time_twin(&twin, steps, NULL));
    }
    bench_twin_check(&twin);
    double component_steps = (double)steps * (double)c->count;
    (void)printf("%-32s %9.2f %9.2f %7.2f", c->name, floor_best / component_steps, twin_best / component_steps,
                 twin_best / floor_best);
    print_limit(c->most);
    bench_twin_close(&twin);
    bench_chain_close(&chain);
}

/* First ratio: in each step the floor makes as many evaluations as the twin. Both times are per
 * evaluation, so that a round with longer searches does not count as slower. Second ratio: the
 * floor uses the whole budget of evaluations, so that a solver that needs fewer counts as
 * faster. */
static void bench_locked(const bench_case *c, const tl_fmu *fmu) {
    bench_chain chain;
    bench_twin twin;
    bench_setup setup = setup_of(c, fmu, BUDGET);
    if (!bench_twin_open(&twin, &setup)) {
        (void)printf("%-32s the master has no such solver\n", c->name);
        return;
    }
    bench_chain_open(&chain, fmu, c->count);
    int64_t steps = block_of_twin(&twin);
    double floor_best = 1e300;
    double twin_best = 1e300;
    double full_best = 1e300;
    uint64_t all = 0;
    for (int round = 0; round < ROUNDS; round++) {
        double took = time_twin(&twin, steps, evaluations);
        uint64_t sum = sum_of_evaluations(steps);
        all += sum;
        twin_best = smaller(twin_best, took / (double)sum);
        floor_best = smaller(floor_best, time_floor(&chain, LOCKED, steps) / (double)sum);
        set_evaluations(steps, BUDGET);
        full_best = smaller(full_best, time_floor(&chain, LOCKED, steps) / (double)steps);
    }
    double each = (double)all / (double)(steps * ROUNDS);
    (void)printf("%-32s %11.2f %9.1f %9.1f %7.2f %8.2f", c->name, each, floor_best * each, twin_best * each,
                 twin_best / floor_best, twin_best * each / full_best);
    print_limit(c->most);
    bench_twin_close(&twin);
    bench_chain_close(&chain);
}

/* The last column is the cost of each execution that a longer chain adds; it is constant if the
 * cost is linear. The column before it includes the solver's cost of an evaluation, divided by the
 * number of executions. */
static void print_growth(const bench_case *c, double executions, double ns, double floors) {
    static double executions_before;
    static double floors_before;
    (void)printf("%-32s %11.4f %9.2f %9.2f", c->name, executions, ns / executions, floors / executions);
    if (c->count > 2) {
        (void)printf(" %9.2f", (floors - floors_before) / (executions - executions_before));
    }
    (void)printf("\n");
    executions_before = executions;
    floors_before = floors;
}

static int compare(const void *a, const void *b) {
    double x = *(const double *)a;
    double y = *(const double *)b;
    return (x > y) - (x < y);
}

static double median(double values[ROUNDS]) {
    qsort(values, ROUNDS, sizeof values[0], compare);
    return values[ROUNDS / 2];
}

/* Measures the cost of one more evaluation. In each round it times a twin with a small budget, one
 * with a large budget, and the floor, and computes the difference of the twins, in ns and in
 * component steps of the floor. The result is the median, because the smallest difference would be
 * an outlier. */
static void measure_growth(const bench_case *c, bench_twin twins[2], bench_chain *chain) {
    double ns[ROUNDS];
    double floors[ROUNDS];
    uint64_t evaluations_done[2] = {0, 0};
    int64_t steps = block_of_twin(&twins[0]);
    int64_t floor_steps = block_of_floor(chain, FREE);
    uint64_t before[2] = {bench_twin_executions(&twins[0]), bench_twin_executions(&twins[1])};
    for (int round = 0; round < ROUNDS; round++) {
        double took[2];
        uint64_t sums[2];
        for (size_t i = 0; i < 2; i++) {
            took[i] = time_twin(&twins[i], steps, evaluations);
            sums[i] = sum_of_evaluations(steps);
            evaluations_done[i] += sums[i];
        }
        ns[round] = (took[1] - took[0]) / ((double)sums[1] - (double)sums[0]);
        floors[round] = ns[round] / time_floor(chain, FREE, floor_steps) * (double)floor_steps * (double)c->count;
    }
    double executions =
        (double)(bench_twin_executions(&twins[1]) - before[1]) - (double)(bench_twin_executions(&twins[0]) - before[0]);
    double more = (double)evaluations_done[1] - (double)evaluations_done[0];
    print_growth(c, executions / more, median(ns), median(floors));
}

static void bench_growth(const bench_case *c, const tl_fmu *fmu) {
    static const uint32_t budgets[2] = {SMALL_BUDGET, BUDGET};
    bench_twin twins[2];
    for (size_t i = 0; i < 2; i++) {
        bench_setup setup = setup_of(c, fmu, budgets[i]);
        if (!bench_twin_open(&twins[i], &setup)) {
            bench_fail(c->name, "the master has no such solver");
        }
    }
    bench_chain chain;
    bench_chain_open(&chain, fmu, c->count);
    measure_growth(c, twins, &chain);
    bench_chain_close(&chain);
    bench_twin_close(&twins[0]);
    bench_twin_close(&twins[1]);
}

/* Returns the time of one execution of the twin, divided by `floor`: the time of a component step
 * of the floor, measured just before. */
static double floors_of(bench_twin *twin, int64_t steps, double floor) {
    uint64_t before = bench_twin_executions(twin);
    double took = time_twin(twin, steps, NULL);
    return took / (double)(bench_twin_executions(twin) - before) / floor;
}

/* Compares the same search without and with a clock. No execution is reused, so that only the clock
 * differs. */
static void bench_live(const bench_case *c, const tl_fmu *fmu) {
    bench_twin twins[2];
    double floors[2][ROUNDS];
    bench_chain chain;
    for (size_t i = 0; i < 2; i++) {
        bench_setup setup = setup_of(c, fmu, BUDGET);
        setup.live = i == 1;
        if (!bench_twin_open(&twins[i], &setup)) {
            bench_fail(c->name, "the master has no such solver");
        }
    }
    bench_chain_open(&chain, fmu, c->count);
    int64_t steps = block_of_twin(&twins[0]);
    int64_t floor_steps = block_of_floor(&chain, FREE);
    for (int round = 0; round < ROUNDS; round++) {
        double floor = time_floor(&chain, FREE, floor_steps) / (double)floor_steps / (double)c->count;
        for (size_t i = 0; i < 2; i++) {
            floors[i][round] = floors_of(&twins[i], steps, floor);
        }
    }
    (void)printf("%-32s %13.2f %9.2f", c->name, median(floors[0]), median(floors[1]));
    print_limit(c->most);
    bench_chain_close(&chain);
    bench_twin_close(&twins[0]);
    bench_twin_close(&twins[1]);
}

/* Prints the absolute time of the floor, to which the ratios refer. */
static void print_floor(const tl_fmu *fmu, const char *model) {
    bench_chain chain;
    bench_chain_open(&chain, fmu, 2);
    set_evaluations(MOST_STEPS, BUDGET);
    int64_t steps = block_of_floor(&chain, LOCKED);
    double best = 1e300;
    for (int round = 0; round < ROUNDS; round++) {
        best = smaller(best, time_floor(&chain, LOCKED, steps));
    }
    (void)printf("floor of the synchronised step, 20 evaluations, %s: %.0f ns\n", model, best / (double)steps);
    bench_chain_close(&chain);
}

static void load(const char *folder, const char *model, tl_fmu *fmu) {
    char path[4096];
    tl_error error;
    (void)snprintf(path, sizeof path, "%s/%s.fmu", folder, model);
    if (tl_fmu_load(path, -1, TL_ROLLBACK_STATE, fmu, &error) != TL_OK) {
        bench_fail("cannot load", error.text);
    }
}

static void print_table(const char *folder) {
    static const char *const titles[] = {
        "A free step: ns per component step\n"
        "                                     floor      twin   ratio",
        "A synchronised step: 2 components, T_P = T_D = 2, nothing saved; ns per step\n"
        "                                 evaluations     floor      twin   ratio    of 20",
        "One more evaluation of a chain of 2 ... 32, T_P = T_D, saved by structure and by sequences\n"
        "                                  executions   ns each    floors   further",
        "A search in time: T_P = T_D, nothing saved; floors of a free step for each execution\n"
        "                                without clock      with",
    };
    static void (*const benches[])(const bench_case *, const tl_fmu *) = {bench_free, bench_locked, bench_growth,
                                                                          bench_live};
    static const char *const models[] = {"lag", "van_der_pol"};
    tl_fmu fmus[2];
    pin();
    for (size_t i = 0; i < 2; i++) {
        load(folder, models[i], &fmus[i]);
    }
    for (size_t i = 0; i < CASES; i++) {
        if (i == 0 || cases[i].kind != cases[i - 1].kind) {
            (void)printf("%s%s\n", i == 0 ? "" : "\n", titles[cases[i].kind]);
        }
        benches[cases[i].kind](&cases[i], &fmus[strcmp(cases[i].model, models[0]) == 0 ? 0 : 1]);
        (void)fflush(stdout);
    }
    (void)printf("\n");
    for (size_t i = 0; i < 2; i++) {
        print_floor(&fmus[i], models[i]);
        tl_fmu_unload(&fmus[i]);
    }
}

/* ---- Counts ---- */

/* Runs the twin, and the floor if `floor`, with as many evaluations; callgrind counts one side
 * only. */
static void count(const bench_case *c, const tl_fmu *fmu, bool floor, int64_t steps, uint32_t budget) {
    bench_chain chain;
    bench_twin twin;
    bench_setup setup = setup_of(c, fmu, budget);
    if (!bench_twin_open(&twin, &setup)) {
        return;
    }
    uint64_t executions = bench_twin_executions(&twin);
    (void)time_twin(&twin, steps, evaluations);
    executions = bench_twin_executions(&twin) - executions;
    if (floor) {
        bench_chain_open(&chain, fmu, c->count);
        (void)time_floor(&chain, c->kind, steps);
        bench_chain_close(&chain);
    }
    (void)printf("evaluations %llu executions %llu\n", (unsigned long long)sum_of_evaluations(steps),
                 (unsigned long long)executions);
    bench_twin_close(&twin);
}

static int count_case(char **arguments) {
    int64_t steps = strtol(arguments[5], NULL, 10);
    uint32_t budget = (uint32_t)strtoul(arguments[6], NULL, 10);
    if (steps < 1 || steps > MOST_STEPS || budget < 1) {
        return 2;
    }
    for (size_t i = 0; i < CASES; i++) {
        if (strcmp(cases[i].name, arguments[3]) == 0) {
            tl_fmu fmu;
            load(arguments[1], cases[i].model, &fmu);
            count(&cases[i], &fmu, strcmp(arguments[4], "floor") == 0, steps, budget);
            tl_fmu_unload(&fmu);
            return 0;
        }
    }
    return 2;
}

int main(int argc, char **argv) {
    if (argc == 2) {
        print_table(argv[1]);
        return 0;
    }
    if (argc == 3 && strcmp(argv[2], "--cases") == 0) {
        for (size_t i = 0; i < CASES; i++) {
            if (cases[i].kind != LIVE) { /* an instruction count does not show the cost of a clock */
                (void)printf("%s\n", cases[i].name);
            }
        }
        return 0;
    }
    if (argc == 7 && strcmp(argv[2], "--count") == 0 && count_case(argv) == 0) {
        return 0;
    }
    (void)fputs("usage: bench FOLDER [--cases | --count CASE floor|twin STEPS EVALUATIONS]\n", stderr);
    return 2;
}
