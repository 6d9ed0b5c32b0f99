/* Checks whether the rollback of an FMU is exact, bit by bit: for script/fmus, and tests.
 *
 *   rollback_probe FMU state|memory|fork|replay|copy|library STEP STEPS
 *
 * Runs the FMU twice with the same inputs, in two processes. The first run only steps. The second
 * one is saved again and again, steps with other inputs, and is restored. The values of all steps
 * are compared. "copy" and "library" save nothing: before the second run, another instance in the
 * same process makes all these steps; "copy": with its own copy of the library, "library": with the
 * same library. Prints a JSON object:
 *   way      as requested, or "none": the FMU does not support it
 *   steps    steps of the first run; the FMU may refuse further ones
 *   steady   false: a second run without rollback differs too, so there is no result
 *   differs  null, or the first step after which a value differs
 *   bytes, save_us, restore_us   of a state: its size if that is known, medians
 *   step_us  of a step after restoring, a median
 *   error    what failed, or null
 * Exit code: 2 if the arguments are wrong, else 0. The FMU may end this process or hang; the caller
 * must handle that. */
#include <errno.h>
#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/wait.h>
#include <unistd.h>

#include "firmware/base/log.h"
#include "firmware/base/os.h"
#include "firmware/fmu/fmu_store.h"
#include "firmware/fmu/fmu_thread.h"
#include "master/fmi/component.h"

typedef enum trial {
    STRAIGHT,
    SAVED,
    SAVED_RENEWED, /* by replay: frees and instantiates the FMU instead of a reset */
    BESIDE_COPY,
    BESIDE_LIBRARY
} trial;

enum { MOST_STEPS = 400, MOST_VALUES = 2000, SAVES = 5, ASTRAY = 6, TRIALS = 51 };

/* Results of a run, in memory that outlives its process. */
typedef struct findings {
    int steps;
    tl_rollback way;
    size_t bytes;
    double save_us, restore_us, step_us;
    char error[sizeof(tl_error)];
    uint64_t digest[MOST_STEPS]; /* of all values after each step */
} findings;

typedef struct probe {
    tl_fmu fmu;
    const tl_fmi2 *fmi;
    fmi2Component instance;
    double step;
    int steps;
    fmi2ValueReference reals[MOST_VALUES], integers[MOST_VALUES], booleans[MOST_VALUES], inputs[MOST_VALUES];
    double starts[MOST_VALUES];
    size_t real_count, integer_count, boolean_count, input_count;
    tl_ports set, read; /* as a rollback by replay knows them */
} probe;

/* Steps before which the FMU is saved. */
static const int instants[SAVES] = {0, 1, 7, 40, 120};

/* ---- values ---- */

static bool is_read(const tl_variable *variable) {
    return variable->causality == TL_OUTPUT || variable->causality == TL_LOCAL;
}

static void add(fmi2ValueReference *list, size_t *count, uint32_t reference) {
    if (*count < MOST_VALUES) {
        list[(*count)++] = reference;
    }
}

static void find_variables(probe *self) {
    const tl_model *model = &self->fmu.model;
    for (size_t i = 0; i < model->variable_count; i++) {
        const tl_variable *variable = &model->variables[i];
        if (variable->causality == TL_INPUT && variable->type == TL_REAL && self->input_count < MOST_VALUES) {
            self->starts[self->input_count] = variable->has_start ? variable->start.real : 0.0;
            add(self->inputs, &self->input_count, variable->reference);
        } else if (is_read(variable) && variable->type == TL_REAL) {
            add(self->reals, &self->real_count, variable->reference);
        } else if (is_read(variable) && (variable->type == TL_INTEGER || variable->type == TL_ENUMERATION)) {
            add(self->integers, &self->integer_count, variable->reference);
        } else if (is_read(variable) && variable->type == TL_BOOLEAN) {
            add(self->booleans, &self->boolean_count, variable->reference);
        }
    }
}

/* FNV-1a. */
static uint64_t digest_of(uint64_t digest, const void *bytes, size_t size) {
    const unsigned char *at = bytes;
    for (size_t i = 0; i < size; i++) {
        digest = (digest ^ at[i]) * 1099511628211U;
    }
    return digest;
}

/* Returns a hash of all values. A value that the FMU does not return counts as 0. */
static uint64_t look(const probe *self) {
    static fmi2Real reals[MOST_VALUES];
    static fmi2Integer integers[MOST_VALUES];
    static fmi2Boolean booleans[MOST_VALUES];
    uint64_t digest = 14695981039346656037U;
    memset(reals, 0, sizeof reals);
    memset(integers, 0, sizeof integers);
    memset(booleans, 0, sizeof booleans);
    if (self->real_count != 0) {
        (void)self->fmi->get_real(self->instance, self->reals, self->real_count, reals);
    }
    if (self->integer_count != 0) {
        (void)self->fmi->get_integer(self->instance, self->integers, self->integer_count, integers);
    }
    if (self->boolean_count != 0) {
        (void)self->fmi->get_boolean(self->instance, self->booleans, self->boolean_count, booleans);
    }
    digest = digest_of(digest, reals, self->real_count * sizeof *reals);
    digest = digest_of(digest, integers, self->integer_count * sizeof *integers);
    return digest_of(digest, booleans, self->boolean_count * sizeof *booleans);
}

/* ---- runs ---- */

static bool initialise(probe *self, findings *found) {
    self->instance = self->fmi->instantiate("probe", fmi2CoSimulation, self->fmu.model.guid, self->fmu.resources,
                                            &self->fmu.guard.callbacks, fmi2False, fmi2False);
    if (self->instance != NULL && self->fmi->announce_ports != NULL) {
        self->set = (tl_ports){.real_count = self->input_count, .real_references = self->inputs, .reals = self->starts};
        self->read = (tl_ports){.real_count = self->real_count,
                                .integer_count = self->integer_count,
                                .boolean_count = self->boolean_count,
                                .real_references = self->reals,
                                .integer_references = self->integers,
                                .boolean_references = self->booleans};
        self->fmi->announce_ports(self->instance, &self->set, &self->read);
    }
    if (self->instance == NULL ||
        self->fmi->setup_experiment(self->instance, fmi2False, 0.0, 0.0, fmi2False, 0.0) > fmi2Warning ||
        self->fmi->enter_initialization_mode(self->instance) > fmi2Warning ||
        self->fmi->exit_initialization_mode(self->instance) > fmi2Warning) {
        (void)snprintf(found->error, sizeof found->error, "it cannot be initialised");
        return false;
    }
    return true;
}

static bool begin(probe *self, const char *path, tl_rollback way, double step, findings *found) {
    tl_error error;
    if (tl_fmu_load(path, -1, way, &self->fmu, &error) != TL_OK) {
        (void)snprintf(found->error, sizeof found->error, "%s", error.text);
        return false;
    }
    self->fmi = &self->fmu.guard.functions;
    self->step = step;
    found->way = tl_fmu_rollback(&self->fmu);
    find_variables(self);
    return initialise(self, found);
}

/* Executes a step. `other`: deviation of the inputs from those of the first run. */
static bool do_step(const probe *self, int number, double other) {
    static fmi2Real values[MOST_VALUES];
    for (size_t i = 0; i < self->input_count; i++) {
        double size = 0.01 * fmax(1.0, fabs(self->starts[i]));
        values[i] = self->starts[i] + size * (1.0 + 0.5 * sin(0.3 * number + (double)i) + other);
    }
    if (self->input_count != 0 &&
        self->fmi->set_real(self->instance, self->inputs, self->input_count, values) > fmi2Warning) {
        return false;
    }
    return self->fmi->do_step(self->instance, number * self->step, self->step, fmi2False) <= fmi2Warning;
}

static void go_straight(probe *self, findings *found) {
    while (found->steps < self->steps && do_step(self, found->steps, 0.0)) {
        found->digest[found->steps++] = look(self);
    }
}

static int compare_times(const void *a, const void *b) {
    double x = *(const double *)a;
    double y = *(const double *)b;
    return (x > y) - (x < y);
}

static double median(double times[TRIALS]) {
    qsort(times, TRIALS, sizeof *times, compare_times);
    return times[TRIALS / 2];
}

/* Measures the times of save, restore and step in µs, with an existing state. */
static void measure(const probe *self, fmi2FMUstate *state, findings *found) {
    static double saves[TRIALS];
    static double restores[TRIALS];
    static double steps[TRIALS];
    for (int i = 0; i < TRIALS; i++) {
        tl_time begun = tl_clock_now(NULL);
        (void)self->fmi->get_fmu_state(self->instance, state);
        tl_time between = tl_clock_now(NULL);
        (void)self->fmi->set_fmu_state(self->instance, *state);
        saves[i] = (double)(between - begun) / 1e3;
        tl_time restored = tl_clock_now(NULL);
        restores[i] = (double)(restored - between) / 1e3;
        (void)do_step(self, found->steps, 0.0);
        steps[i] = (double)(tl_clock_now(NULL) - restored) / 1e3;
        (void)self->fmi->set_fmu_state(self->instance, *state);
    }
    found->save_us = median(saves);
    found->restore_us = median(restores);
    found->step_us = median(steps);
    found->bytes = self->fmu.guard.memory != NULL ? tl_fmu_memory_size(self->fmu.guard.memory) : 0;
}

/* Saves, and then twice makes steps with other inputs and restores: a state must stay valid after a
 * restore. */
static bool go_astray(const probe *self, int from, fmi2FMUstate *state) {
    bool is_well = self->fmi->get_fmu_state(self->instance, state) <= fmi2Warning;
    for (int time = 1; time <= 2 && is_well; time++) {
        for (int i = 0; i < ASTRAY * time && do_step(self, from + i, time); i++) {
            (void)look(self);
        }
        is_well = self->fmi->set_fmu_state(self->instance, *state) <= fmi2Warning;
    }
    return is_well;
}

static void go_back_and_forth(probe *self, findings *found) {
    fmi2FMUstate states[SAVES] = {NULL};
    int next = 0;
    while (found->steps < self->steps) {
        if (next < SAVES && found->steps == instants[next]) {
            if (!go_astray(self, found->steps, &states[next])) {
                (void)snprintf(found->error, sizeof found->error, "cannot be saved and restored before step %d",
                               found->steps);
                return;
            }
            next++;
        }
        if (!do_step(self, found->steps, 0.0)) {
            return;
        }
        found->digest[found->steps++] = look(self);
    }
    if (next > 0) {
        measure(self, &states[0], found);
    }
}

/* Runs an instance, and then a second one while the first one still exists. */
static void go_beside(probe *self, const char *path, bool has_copy, findings *found) {
    static probe second;
    probe *next = self;
    go_straight(self, found);
    found->steps = 0;
    bool is_well = true;
    if (has_copy) {
        next = &second;
        second.steps = self->steps;
        is_well = begin(&second, path, TL_ROLLBACK_AUTO, self->step, found);
    } else {
        is_well = initialise(self, found);
    }
    if (is_well) {
        go_straight(next, found);
    }
}

/* ---- processes ---- */

static void run(const char *path, tl_rollback way, double step, int steps, trial tried, findings *found) {
    static probe self;
    int how = 0;
    pid_t child = fork();
    if (child == 0) {
        self.steps = steps;
        if (begin(&self, path, way, step, found)) {
            if (tried == STRAIGHT) {
                go_straight(&self, found);
            } else if (tried == BESIDE_COPY || tried == BESIDE_LIBRARY) {
                go_beside(&self, path, tried == BESIDE_COPY, found);
            } else if (self.fmi->get_fmu_state != NULL) {
                self.fmu.guard.renews = tried == SAVED_RENEWED;
                go_back_and_forth(&self, found);
            }
            tl_fmu_unload(&self.fmu);
        }
        _exit(0);
    }
    if (child > 0 && waitpid(child, &how, 0) == child && WIFSIGNALED(how)) {
        (void)snprintf(found->error, sizeof found->error, "ended by signal %d after %d steps", WTERMSIG(how),
                       found->steps);
    }
}

/* Returns the first step that differs, also if only one run has it; -1: none. */
static int compare(const findings *a, const findings *b) {
    int steps = a->steps < b->steps ? a->steps : b->steps;
    for (int i = 0; i < steps; i++) {
        if (a->digest[i] != b->digest[i]) {
            return i;
        }
    }
    return a->steps == b->steps ? -1 : steps;
}

static void print_text(const char *text) {
    (void)putchar('"');
    for (; *text != '\0'; text++) {
        if ((unsigned char)*text < ' ' || *text == '"' || *text == '\\') {
            (void)printf("\\u%04x", (unsigned)(unsigned char)*text);
        } else {
            (void)putchar(*text);
        }
    }
    (void)putchar('"');
}

static const char *const ways[] = {[TL_ROLLBACK_NONE] = "none",
                                   [TL_ROLLBACK_STATE] = "state",
                                   [TL_ROLLBACK_MEMORY] = "memory",
                                   [TL_ROLLBACK_REPLAY] = "replay"};

static void print(const findings *found, const char *beside) {
    const findings *straight = &found[0];
    const findings *saved = &found[2];
    int differs = compare(straight, saved);
    const char *error = straight->error[0] != '\0' ? straight->error : saved->error;
    (void)printf("{\"way\": \"%s\", \"steps\": %d, \"steady\": %s, ", beside != NULL ? beside : ways[saved->way],
                 straight->steps, compare(straight, &found[1]) < 0 ? "true" : "false");
    if (differs < 0) {
        (void)printf("\"differs\": null, ");
    } else {
        (void)printf("\"differs\": %d, ", differs);
    }
    (void)printf("\"bytes\": %zu, \"save_us\": %.3g, \"restore_us\": %.3g, \"step_us\": %.3g, \"error\": ",
                 saved->bytes, saved->save_us, saved->restore_us, saved->step_us);
    if (error[0] == '\0') {
        (void)printf("null");
    } else {
        print_text(error);
    }
    (void)printf("}\n");
}

static bool find_way(const char *name, tl_rollback *way, trial *tried) {
    *tried = strcmp(name, "copy") == 0 ? BESIDE_COPY : strcmp(name, "library") == 0 ? BESIDE_LIBRARY : SAVED;
    for (size_t i = TL_ROLLBACK_NONE + 1; i < sizeof ways / sizeof *ways; i++) {
        if (ways[i] != NULL && strcmp(name, ways[i]) == 0) {
            *way = (tl_rollback)i;
        }
    }
    *way = *tried == BESIDE_COPY ? TL_ROLLBACK_AUTO : *way; /* as in a twin: with random numbers of its own, too */
    return *tried != SAVED || *way != TL_ROLLBACK_NONE;
}

int main(int argc, char **argv) {
    double step = argc == 5 ? strtod(argv[3], NULL) : 0.0;
    long steps = argc == 5 ? strtol(argv[4], NULL, 10) : 0;
    tl_rollback way = TL_ROLLBACK_NONE;
    trial tried = SAVED;
    bool is_known = argc == 5 && find_way(argv[2], &way, &tried);
    /* cppcheck-suppress invalidFunctionArg ; an anonymous mapping has no file, which is -1 */
    findings *found = mmap(NULL, 3 * sizeof *found, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    if (!is_known || !(step > 0.0) || steps < 1 || steps > MOST_STEPS || found == MAP_FAILED) {
        (void)fprintf(stderr,
                      "usage: rollback_probe FMU state|memory|fork|replay|copy|library STEP STEPS, 1 ... %d of them\n",
                      MOST_STEPS);
        return 2;
    }
    tl_log_set_level(TL_LOG_ERROR - 1);
    for (int i = 0; i < 3; i++) {
        run(argv[1], i < 2 ? TL_ROLLBACK_NONE : way, step, (int)steps, i < 2 ? STRAIGHT : tried, &found[i]);
    }
    if (way == TL_ROLLBACK_REPLAY && compare(&found[0], &found[2]) >= 0) { /* as a twin's proof does */
        found[2] = (findings){.steps = 0};
        run(argv[1], way, step, (int)steps, SAVED_RENEWED, &found[2]);
    }
    print(found, tried != SAVED ? argv[2] : NULL);
    return 0;
}
