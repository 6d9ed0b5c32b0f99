/* Benchmark: cost of rollback, by method. README.md says how to read it.
 *
 * usage: bench_rollback FOLDER [KIB]     FOLDER contains sized_1.fmu, sized_16.fmu, …; KIB: only
 *        this size
 *
 * A pair is a save and a restore with a step after each, without the steps: {save, step, restore,
 * step} minus {step, step}. An execution is {restore, step, save} minus {step}, as in a search over
 * several steps. Both contain what the step itself loses, such as page faults; faults are printed
 * per execution. Blocks of at least 2 ms alternate; the median of their differences is printed.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <time.h>

#include "firmware/fmu/fmu_store.h"

enum { ROUNDS = 25, SIZES = 5 };

static const double SHORTEST_BLOCK = 2e6; /* ns */

static const struct {
    const char *name;
    tl_rollback way;
} ways[] = {{"own get/set", TL_ROLLBACK_STATE}, {"memory", TL_ROLLBACK_MEMORY}};

enum { WAYS = sizeof ways / sizeof ways[0] };

typedef struct bench {
    tl_fmu fmu;
    const tl_fmi2 *fmi;
    fmi2Component instance;
    fmi2FMUstate state;
    fmi2FMUstate next;
} bench;

static double now_ns(void) {
    struct timespec now;
    (void)clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec * 1e9 + (double)now.tv_nsec;
}

static void need(bool is_well, const char *what) {
    if (!is_well) {
        (void)fprintf(stderr, "bench_rollback: %s\n", what);
        exit(1);
    }
}

static void step(const bench *self) {
    need(self->fmi->do_step(self->instance, 0.0, 0.01, fmi2False) == fmi2OK, "a step failed");
}

static double time_steps(const bench *self, int count) {
    double begun = now_ns();
    for (int i = 0; i < count; i++) {
        step(self);
        step(self);
    }
    return (now_ns() - begun) / count;
}

static double time_pairs(bench *self, int count) {
    double begun = now_ns();
    for (int i = 0; i < count; i++) {
        need(self->fmi->get_fmu_state(self->instance, &self->state) == fmi2OK, "a state was not saved");
        step(self);
        need(self->fmi->set_fmu_state(self->instance, self->state) == fmi2OK, "a state was not restored");
        step(self);
    }
    return (now_ns() - begun) / count;
}

static double time_executions(bench *self, int count) {
    double begun = now_ns();
    for (int i = 0; i < count; i++) {
        need(self->fmi->set_fmu_state(self->instance, self->state) == fmi2OK, "a state was not restored");
        step(self);
        need(self->fmi->get_fmu_state(self->instance, &self->next) == fmi2OK, "a state was not saved");
    }
    return (now_ns() - begun) / count;
}

static long count_faults(void) {
    struct rusage used;
    (void)getrusage(RUSAGE_SELF, &used);
    return used.ru_minflt;
}

static int compare(const void *a, const void *b) {
    double x = *(const double *)a;
    double y = *(const double *)b;
    return (x > y) - (x < y);
}

static void begin(bench *self, const char *path, tl_rollback way) {
    tl_error error;
    need(tl_fmu_load(path, -1, way, &self->fmu, &error) == TL_OK, path);
    self->fmi = &self->fmu.guard.functions;
    self->instance = self->fmi->instantiate("sized", fmi2CoSimulation, self->fmu.model.guid, self->fmu.resources,
                                            &self->fmu.guard.callbacks, fmi2False, fmi2False);
    need(self->instance != NULL, "an FMU was not instantiated");
    (void)self->fmi->setup_experiment(self->instance, fmi2False, 0.0, 0.0, fmi2False, 0.0);
    (void)self->fmi->enter_initialization_mode(self->instance);
    (void)self->fmi->exit_initialization_mode(self->instance);
    (void)time_steps(self, 100); /* the guard checks the first calls for side effects */
}

static void print_row(const char *path, int kibibytes, size_t way) {
    static double pairs[ROUNDS];
    static double executions[ROUNDS];
    bench self = {.state = NULL};
    int count = 1;
    long faults = 0;
    begin(&self, path, ways[way].way);
    (void)time_pairs(&self, 3);
    while (time_pairs(&self, count) * count < SHORTEST_BLOCK) {
        count *= 2;
    }
    for (int i = 0; i < ROUNDS; i++) {
        double steps = time_steps(&self, count);
        pairs[i] = time_pairs(&self, count) - steps;
        (void)time_executions(&self, 3);
        long before = count_faults();
        executions[i] = time_executions(&self, count) - steps / 2;
        faults += count_faults() - before;
    }
    qsort(pairs, ROUNDS, sizeof *pairs, compare);
    qsort(executions, ROUNDS, sizeof *executions, compare);
    printf("%8d kB  %-12s %10.3f %10.3f %10.3f %10.2f\n", kibibytes, ways[way].name, pairs[ROUNDS / 2] / 1e3,
           executions[ROUNDS / 2] / 1e3, executions[ROUNDS - 1] / 1e3, (double)faults / ROUNDS / count);
    (void)self.fmi->free_fmu_state(self.instance, &self.state);
    (void)self.fmi->free_fmu_state(self.instance, &self.next);
    self.fmi->free_instance(self.instance);
    tl_fmu_unload(&self.fmu);
}

int main(int argc, char **argv) {
    static const int sizes[SIZES] = {1, 16, 1024, 2048, 51200};
    need(argc == 2 || argc == 3, "usage: bench_rollback FOLDER [KIB]");
    bool is_locked = mlockall(MCL_CURRENT | MCL_FUTURE) == 0;
    printf("Rollback, \302\265s (memory %s)\n%24s %10s %10s %10s %10s\n", is_locked ? "locked" : "not locked: refused",
           "", "pair", "execution", "most", "faults");
    for (size_t i = 0; i < SIZES; i++) {
        bool is_wanted = argc == 2 || strtol(argv[2], NULL, 10) == sizes[i];
        for (size_t way = 0; way < WAYS && is_wanted; way++) {
            char path[4096];
            (void)snprintf(path, sizeof path, "%s/sized_%d.fmu", argv[1], sizes[i]);
            print_row(path, sizes[i], way);
        }
    }
    return 0;
}
