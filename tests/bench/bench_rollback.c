/* Benchmark: what it costs to lead an FMU back, by each of the ways. README.md says how to read it.
 *
 * usage: bench_rollback FOLDER     FOLDER holds sized_1.fmu, sized_16.fmu, …
 *
 * A pair is a save and a restore with a step between them, as a search has them, less that step: {save, step, restore, step} beside {step, step}. So it holds what the
 * step loses by it, too: the first write to a page that is taken note of. Blocks of at least 2 ms take turns; the median of their differences counts.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <time.h>

#include "firmware/fmu/fmu_store.h"

enum { ROUNDS = 25, SIZES = 4 };

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
    (void)time_steps(self, 100); /* what is watched in the first calls only is over */
}

static void print_row(const char *path, int kibibytes, size_t way) {
    static double pairs[ROUNDS];
    bench self = {.state = NULL};
    int count = 1;
    begin(&self, path, ways[way].way);
    (void)time_pairs(&self, 3);
    while (time_pairs(&self, count) * count < SHORTEST_BLOCK) {
        count *= 2;
    }
    for (int i = 0; i < ROUNDS; i++) {
        double steps = time_steps(&self, count);
        pairs[i] = time_pairs(&self, count) - steps;
    }
    qsort(pairs, ROUNDS, sizeof *pairs, compare);
    printf("%8d kB  %-12s %10.3f %10.3f\n", kibibytes, ways[way].name, pairs[ROUNDS / 2] / 1e3,
           pairs[ROUNDS - 1] / 1e3);
    (void)self.fmi->free_fmu_state(self.instance, &self.state);
    self.fmi->free_instance(self.instance);
    tl_fmu_unload(&self.fmu);
}

int main(int argc, char **argv) {
    static const int sizes[SIZES] = {1, 16, 1024, 51200};
    need(argc == 2, "usage: bench_rollback FOLDER");
    bool is_locked = mlockall(MCL_CURRENT | MCL_FUTURE) == 0;
    printf("A save and a restore, \302\265s (memory %s)\n%24s %10s %10s\n",
           is_locked ? "locked" : "not locked: refused", "", "median", "most");
    for (size_t i = 0; i < SIZES; i++) {
        for (size_t way = 0; way < WAYS; way++) {
            char path[4096];
            (void)snprintf(path, sizeof path, "%s/sized_%d.fmu", argv[1], sizes[i]);
            print_row(path, sizes[i], way);
        }
    }
    return 0;
}
