/* An FMU without state functions, whose state is in all kinds of memory: on the heap, which changes
 * in each step; in globals; in thread-local variables; in the random numbers of the C library; in
 * the floating-point exception flags. Its variables are those of fmus/lag.
 *
 * LARGE       bytes of further state on the heap, and in each of two global arrays. A step writes
 * to
 *             1 or DIRTY places in each; y depends on them.
 * EXCEPTIONS  0: it does not use the exception flags, because other code in its thread changes
 * them,
 *             except with rollback by memory.
 * LIBRARY     from this step on it uses state of the C library: environment, time zone, locales,
 *             atexit() functions, users.
 * THREAD, FILE_OPEN, MAPPED, CHILD
 *             in this step it gets a thread, an open file, a shared mapping or a child process,
 *             which a copy of its memory cannot undo.
 * RESETS      it can reset its state, and then removes these four: 1: in fmi2Reset, 2: in
 *             fmi2Instantiate.
 * OWN_STATE   it has state functions, but their state contains only y.
 */
#include <fcntl.h>
#include <fenv.h>
#include <fmi2Functions.h>
#include <locale.h>
#include <math.h>
#include <pthread.h>
#include <pwd.h>
#include <signal.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/syscall.h>
#include <sys/types.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#ifndef THREAD
#define THREAD -1
#endif
#ifndef FILE_OPEN
#define FILE_OPEN -1
#endif
#ifndef MAPPED
#define MAPPED -1
#endif
#ifndef LIBRARY
#define LIBRARY -1
#endif
#ifndef CHILD
#define CHILD -1
#endif
#ifndef EXCEPTIONS
#define EXCEPTIONS 1
#endif
#ifndef RESETS
#define RESETS 0
#endif

#ifndef LARGE
#define LARGE 0
#endif
#ifndef DIRTY
#define DIRTY 63
#endif

enum { U = 0, Y = 1, T = 2, LONGEST = 7 };

typedef struct entry {
    struct entry *next;
    double *values; /* `count` of them: blocks of many sizes */
    size_t count;
} entry;

typedef struct keeper {
    double u, t, y;
    entry *first;
    double *large;
} keeper;

static int steps;             /* .bss */
static double factor = 0.875; /* .data */
static __thread double thread_sum = 0.125;
static __thread double *thread_own; /* allocated in the third step */
static double *late;                /* allocated in the fifth step */
static volatile double seen;
static double large_globals[LARGE / sizeof(double) + 1];
static double large_values[LARGE / sizeof(double) + 1] = {1.0}; /* .data */

/* ---- what a copy of the memory cannot undo ---- */

static void *wait_for_ever(void *context) {
    for (;;) {
        (void)pause();
    }
    return context;
}

static pthread_t thread;
static bool has_thread;
static int file = -1;
static double *mapped = MAP_FAILED;
static pid_t child;

static void keep_more(void) {
    if (steps == THREAD) {
        has_thread = pthread_create(&thread, NULL, wait_for_ever, NULL) == 0;
    }
    if (steps == FILE_OPEN) {
        file = open("keeper.txt", O_RDWR | O_CREAT, 0600);
    }
    if (steps == MAPPED) {
        mapped = mmap(NULL, 4096, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
        seen = mapped == MAP_FAILED ? 0.0 : mapped[0];
    }
    if (steps == CHILD) {
        child = fork();
        if (child == 0) { /* the child only waits, until its parent ends */
            (void)prctl(PR_SET_PDEATHSIG, SIGKILL);
            (void)pause();
            _exit(0);
        }
    }
}

static void end_proof(void) {
    if (has_thread) {
        (void)pthread_cancel(thread);
        (void)pthread_join(thread, NULL);
        has_thread = false;
    }
    if (file >= 0) {
        (void)close(file);
        file = -1;
    }
    if (mapped != MAP_FAILED) {
        (void)munmap(mapped, 4096);
        mapped = MAP_FAILED;
    }
    if (child > 0) {
        (void)kill(child, SIGKILL);
        (void)waitpid(child, NULL, 0);
        child = 0;
    }
}

/* ---- a step ---- */

static void push(keeper *self) {
    entry *made = malloc(sizeof *made);
    made->count = 1 + (size_t)steps * 37 % 500;
    made->values = calloc(made->count, sizeof *made->values);
    made->values[made->count - 1] = self->u * factor + (double)(rand() % 100) / 1e3 + drand48() / 1e3;
    made->next = self->first;
    self->first = made;
}

static void pop_oldest(keeper *self) {
    entry **last = &self->first;
    size_t length = 1;
    while (*last != NULL && (*last)->next != NULL) {
        last = &(*last)->next;
        length++;
    }
    if (length > LONGEST) {
        free((*last)->values);
        free(*last);
        *last = NULL;
    }
}

static double sum(const keeper *self) {
    double result = 0.0;
    for (const entry *at = self->first; at != NULL; at = at->next) {
        result += at->values[at->count - 1] / (double)at->count;
    }
    return result;
}

static void keep_late(void) {
    if (steps == 3) {
        thread_own = calloc(2, sizeof *thread_own);
        thread_own[1] = 0.5;
    }
    if (steps == 5) {
        late = aligned_alloc(64, 64);
        late[0] = 0.25;
    }
    if (thread_own != NULL) {
        thread_own[1] *= -0.75;
    }
    if (late != NULL) {
        late = realloc(late, 64 + (size_t)steps % 9 * 100);
        late[0] = late[0] * 0.5 + 0.01;
    }
}

static void at_exit(void) {}

/* Uses the C library's state. The result is wrong if the variable KEEPER is lost. */
static double ask_library(void) {
    time_t time = 1000000000;
    struct tm parts;
    char text[32];
    locale_t made = newlocale(LC_ALL_MASK, "C.UTF-8", (locale_t)0);
    (void)setenv("KEEPER", "17", 1);
    (void)setenv("TZ", steps % 2 == 0 ? "EST5EDT" : "CET-1CEST", 1);
    (void)localtime_r(&time, &parts);
    (void)snprintf(text, sizeof text, "KEEPER_%d", steps);
    (void)setenv(text, "1", 1);
    (void)atexit(at_exit);
    if (made != (locale_t)0) {
        freelocale(made);
    }
    const char *seen_value = getenv("KEEPER");
    return (seen_value == NULL ? 1e9 : atof(seen_value)) + parts.tm_hour + (getpwuid(0) != NULL ? 1.0 : 0.0);
}

static double odd(void) {
    if (EXCEPTIONS == 0) {
        return 0.0;
    }
    double result = fetestexcept(FE_DIVBYZERO) != 0 ? 0.01 : 0.0;
    (void)feclearexcept(FE_ALL_EXCEPT);
    if (steps % 3 == 0) {
        (void)feraiseexcept(FE_DIVBYZERO);
    }
    return result;
}

/* Writes to DIRTY places in one of 16 steps, else to one place: on the heap and in both arrays. */
static double write_here_and_there(keeper *self) {
    const size_t count = LARGE / sizeof(double);
    double result = 0.0;
    for (size_t i = 0; count > 0 && i < (steps % 16 == 5 ? DIRTY : 1); i++) {
        size_t place = ((size_t)steps / 4 * 7919 + i * 104729) % count;
        self->large[place] += self->u * factor + 1e-3;
        large_globals[place] = large_globals[place] * 0.5 + self->large[place];
        large_values[place / 2] += large_globals[place] * 1e-3;
        result += large_values[place / 2] + large_globals[place];
    }
    return result * 1e-3;
}

static void step(keeper *self) {
    steps++;
    push(self);
    pop_oldest(self);
    keep_late();
    thread_sum = thread_sum * 0.9 + self->u;
    factor = factor * 0.99 + 0.001 * steps;
    self->y = self->y * (1.0 - self->t) + self->t * (sum(self) + 0.1 * thread_sum) + odd() +
              (LIBRARY >= 0 && steps >= LIBRARY ? 1e-3 * ask_library() : 0.0) + write_here_and_there(self) +
              (thread_own == NULL ? 0.0 : thread_own[1]) + (late == NULL ? 0.0 : late[0]);
    keep_more();
}

/* ---- start and reset ---- */

static void forget_all(keeper *self) {
    while (self->first != NULL) {
        entry *next = self->first->next;
        free(self->first->values);
        free(self->first);
        self->first = next;
    }
    self->u = 0.0;
    self->t = 0.1;
    self->y = 0.0;
}

/* Resets all state that is not in the instance. */
static void begin_anew(void) {
    unsigned short first[3] = {1, 2, 3};
    end_proof();
    steps = 0;
    factor = 0.875;
    thread_sum = 0.125;
    free(thread_own);
    thread_own = NULL;
    free(late);
    late = NULL;
    srand(1);
    (void)seed48(first);
    (void)feclearexcept(FE_ALL_EXCEPT);
}

/* ---- FMI ---- */

const char *fmi2GetTypesPlatform(void) {
    return fmi2TypesPlatform;
}

const char *fmi2GetVersion(void) {
    return fmi2Version;
}

fmi2Status fmi2SetDebugLogging(fmi2Component component, fmi2Boolean on, size_t count, const fmi2String categories[]) {
    (void)component, (void)on, (void)count, (void)categories;
    return fmi2OK;
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean logging) {
    (void)name, (void)type, (void)guid, (void)resources, (void)visible, (void)logging;
    keeper *self = functions->allocateMemory(1, sizeof *self);
    forget_all(self);
    if (RESETS != 0) {
        begin_anew();
    }
    self->large = functions->allocateMemory(LARGE + sizeof(double), 1);
    return self;
}

void fmi2FreeInstance(fmi2Component component) {
    keeper *self = component;
    forget_all(self);
    free(self->large);
    free(self);
}

fmi2Status fmi2SetupExperiment(fmi2Component component, fmi2Boolean has_tolerance, fmi2Real tolerance, fmi2Real start,
                               fmi2Boolean has_stop, fmi2Real stop) {
    (void)component, (void)has_tolerance, (void)tolerance, (void)start, (void)has_stop, (void)stop;
    return fmi2OK;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component component) {
    (void)component;
    return fmi2OK;
}

fmi2Status fmi2ExitInitializationMode(fmi2Component component) {
    (void)component;
    return fmi2OK;
}

fmi2Status fmi2Terminate(fmi2Component component) {
    (void)component;
    return fmi2OK;
}

fmi2Status fmi2Reset(fmi2Component component) {
    if (RESETS != 1) {
        return fmi2Error;
    }
    forget_all(component);
    begin_anew();
    return fmi2OK;
}

fmi2Status fmi2SetReal(fmi2Component component, const fmi2ValueReference references[], size_t count,
                       const fmi2Real values[]) {
    keeper *self = component;
    for (size_t i = 0; i < count; i++) {
        self->u = references[i] == U ? values[i] : self->u;
        self->t = references[i] == T ? values[i] : self->t;
    }
    return fmi2OK;
}

fmi2Status fmi2GetReal(fmi2Component component, const fmi2ValueReference references[], size_t count,
                       fmi2Real values[]) {
    const keeper *self = component;
    for (size_t i = 0; i < count; i++) {
        values[i] = references[i] == Y ? self->y : references[i] == T ? self->t : self->u;
    }
    return fmi2OK;
}

#define NONE(Name, Type)                                                                                               \
    fmi2Status fmi2Get##Name(fmi2Component component, const fmi2ValueReference references[], size_t count,             \
                             Type values[]) {                                                                          \
        (void)component, (void)references, (void)values;                                                               \
        return count == 0 ? fmi2OK : fmi2Error;                                                                        \
    }                                                                                                                  \
    fmi2Status fmi2Set##Name(fmi2Component component, const fmi2ValueReference references[], size_t count,             \
                             const Type values[]) {                                                                    \
        (void)component, (void)references, (void)values;                                                               \
        return count == 0 ? fmi2OK : fmi2Error;                                                                        \
    }
NONE(Integer, fmi2Integer)
NONE(Boolean, fmi2Boolean)
NONE(String, fmi2String)

fmi2Status fmi2DoStep(fmi2Component component, fmi2Real point, fmi2Real size, fmi2Boolean no_set_state_prior) {
    (void)point, (void)size, (void)no_set_state_prior;
    step(component);
    return fmi2OK;
}

fmi2Status fmi2CancelStep(fmi2Component component) {
    (void)component;
    return fmi2Error;
}

fmi2Status fmi2GetStatus(fmi2Component component, const fmi2StatusKind kind, fmi2Status *value) {
    (void)component, (void)kind, (void)value;
    return fmi2Discard;
}

fmi2Status fmi2GetBooleanStatus(fmi2Component component, const fmi2StatusKind kind, fmi2Boolean *value) {
    (void)component, (void)kind, (void)value;
    return fmi2Discard;
}

#ifdef OWN_STATE
fmi2Status fmi2GetFMUstate(fmi2Component component, fmi2FMUstate *state) {
    if (*state == NULL) {
        *state = malloc(sizeof(double));
    }
    memcpy(*state, &((keeper *)component)->y, sizeof(double));
    return fmi2OK;
}

fmi2Status fmi2SetFMUstate(fmi2Component component, fmi2FMUstate state) {
    memcpy(&((keeper *)component)->y, state, sizeof(double));
    return fmi2OK;
}

fmi2Status fmi2FreeFMUstate(fmi2Component component, fmi2FMUstate *state) {
    (void)component;
    free(*state);
    *state = NULL;
    return fmi2OK;
}
#endif
