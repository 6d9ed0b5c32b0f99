/* FMUs inside the test process: a tl_model and a tl_fmi2 in C, whose faults the test sets.
 *
 * Purpose: the master under test calls them like loaded FMI 2.0 binaries. An FMU can fail at a
 *          chosen call, restore a wrong state, feed through during initialisation, and cost time on
 *          a fake clock. It records each call with its arguments, and checks it against the state
 *          machine of the standard. A call that FMI 2.0 forbids is a violation; tests assert that
 *          there is none.
 * Model:   per channel c: drive = gain·u[c] + offset. A step of h sets y[c] to drive if `lag` is 0,
 *          and else adds h/lag·(drive − y[c]). `sum` is the sum of all y. A step copies Integers,
 *          Booleans and the enumeration to outputs. Before the first step y[c] is `start`, or drive
 *          if the FMU feeds through. With `telling`, a step adds a small value to each y and sets
 *          `count_out`. Both depend on every bit of all inputs of all steps. A true `flag` then
 *          raises the drives by 0.25. With `ends`, `flag_out` is true if y[0] has reached a limit.
 *            u0 … u3      Real input           y0 … y3, sum  Real output
 *            gain, offset Real parameter, tunable            lag, start  Real parameter, fixed
 *            and if `discrete`: count, mode, flag (Integer, Enumeration, Boolean inputs),
 *            count_out, mode_out, flag_out (outputs), label (String parameter), label_out (String
 *            output)
 *          Value references start at 0 for each base type, to detect a wrong type.
 * Checked: each call is legal in the state of its instance; no call follows fmi2Fatal on any
 *          instance of the FMU; only inputs and tunable parameters are set between steps; a step
 *          lies between Set and Get; communication points are continuous; all inputs are set again
 *          after fmi2SetFMUstate; no restored state lies before the start of a final step, or before
 *          a reset; state handles belong to the instance and do not leak, also over a reset; the
 *          GUID is right.
 * Source:  FMI 2.0.4, sections 2.1 and 4.2.4.
 * Owner:   the caller owns all structures. An instance allocates memory, and frees it with the
 *          instance or by tl_test_fmu_end().
 * Thread:  one at a time for all FMUs of one log.
 */
#ifndef TL_TESTS_SUPPORT_TEST_FMU_H
#define TL_TESTS_SUPPORT_TEST_FMU_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "master/base/simtime.h"
#include "master/fmi/fmi2.h"
#include "master/fmi/model.h"

enum {
    TL_TEST_WIDTH = 4,        /* channels at most */
    TL_TEST_VARIABLES = 24,   /* variables at most */
    TL_TEST_ENTRIES = 1 << 14 /* calls in a log; later ones are only checked and counted */
};

typedef enum tl_test_call {
    TL_TEST_INSTANTIATE,
    TL_TEST_SETUP_EXPERIMENT,
    TL_TEST_ENTER_INITIALIZATION,
    TL_TEST_EXIT_INITIALIZATION,
    TL_TEST_SET_REAL,
    TL_TEST_SET_INTEGER,
    TL_TEST_SET_BOOLEAN,
    TL_TEST_SET_STRING,
    TL_TEST_GET_REAL,
    TL_TEST_GET_INTEGER,
    TL_TEST_GET_BOOLEAN,
    TL_TEST_GET_STRING,
    TL_TEST_GET_STATE,
    TL_TEST_SET_STATE,
    TL_TEST_FREE_STATE,
    TL_TEST_SERIALIZED_SIZE,
    TL_TEST_SERIALIZE,
    TL_TEST_DESERIALIZE,
    TL_TEST_DO_STEP,
    TL_TEST_TERMINATE,
    TL_TEST_RESET,
    TL_TEST_FREE_INSTANCE,
    TL_TEST_CALLS /* number of kinds */
} tl_test_call;

typedef struct tl_test_fmu tl_test_fmu;

/* One call with its arguments and its results. */
typedef struct tl_test_entry {
    const tl_test_fmu *fmu;
    size_t instance; /* 0: the first of this FMU */
    tl_test_call call;
    fmi2Status status;
    const void *handle; /* state calls: the handle after the call */
    double time;        /* step: communication point, s */
    double step;        /* step: its size, s */
    bool final;         /* step: noSetFMUStatePriorToCurrentPoint; set-up: stopTimeDefined */
    double u[TL_TEST_WIDTH];
    double gain;
    double offset; /* step: values of its inputs and parameters */
} tl_test_entry;

/* All calls of all FMUs of one test, in order. */
typedef struct tl_test_log {
    size_t count;      /* number of calls, also of those without an entry */
    size_t violations; /* calls that FMI 2.0 forbids */
    char first_violation[160];
    tl_test_entry entries[TL_TEST_ENTRIES];
} tl_test_log;

typedef enum tl_test_fault_kind { TL_TEST_DISCARD, TL_TEST_ERROR, TL_TEST_FATAL, TL_TEST_NAN } tl_test_fault_kind;

/* A fault of an FMU. NAN makes a step succeed with outputs that are no numbers. */
typedef struct tl_test_fault {
    tl_test_fault_kind kind;
    tl_test_call call;
    uint64_t first; /* first call of that kind that fails, from 1; 0: none */
    uint64_t last;
    double above; /* a step also fails if a drive (gain·u + offset) is larger; +infinity: never */
} tl_test_fault;

/* Behaviour of an FMU. The test may change it at any time. */
typedef struct tl_test_control {
    tl_test_fault fault;
    size_t ballast;    /* additional bytes of each state handle, all of them written */
    bool state_lies;   /* fmi2SetFMUstate returns OK and restores only the time */
    bool feed_through; /* outputs follow inputs during initialisation */
    bool raw_true;     /* a true Boolean output is 7 */
    bool ends;         /* `flag_out` is true if y[0] has reached 0.5, like an end switch */
    bool telling;      /* outputs differ for any difference of inputs */
    /* Called after each step with a hash of all inputs of its successful steps since the start.
     * NULL: no call. */
    void (*trace)(void *context, const tl_test_fmu *fmu, const tl_test_entry *step, uint64_t lineage);
    void *context;
    tl_time *clock;    /* a step adds `cost`, saving a state `save_cost`; NULL: no clock */
    tl_time cost;      /* ns */
    tl_time save_cost; /* ns */
} tl_test_control;

struct tl_test_fmu {
    tl_model model;
    tl_variable variables[TL_TEST_VARIABLES]; /* of the model; a test may change them before it makes a twin */
    tl_fmi2 functions;                        /* NULL: never called; it can serialise, but only a test declares it */
    fmi2CallbackFunctions callbacks;          /* for fmi2Instantiate; contains a pointer to this FMU */
    tl_test_control control;
    tl_test_log *log;
    uint64_t calls[TL_TEST_CALLS]; /* by kind */
    size_t instances;              /* ever made */
    size_t living;                 /* instances not freed */
    size_t states;                 /* state handles not freed */
    bool dead;                     /* has returned fmi2Fatal */
    size_t width;
    struct tl_test_instance *alive; /* newest first */
};

/* Makes an FMU with `width` channels (1 … TL_TEST_WIDTH), with or without the discrete variables.
 * It records its calls in `log`. */
void tl_test_fmu_init(tl_test_fmu *fmu, size_t width, bool discrete, tl_test_log *log);

/* Frees the instances and states that the caller could not free after fmi2Fatal. */
void tl_test_fmu_end(tl_test_fmu *fmu);

/* Makes the calls `first` to `last` of a kind fail, counted from 1 over the FMU's whole life. */
void tl_test_fmu_fail(tl_test_fmu *fmu, tl_test_call call, tl_test_fault_kind kind, uint64_t first, uint64_t last);

/* Makes a step fail if a drive is above `above`. */
void tl_test_fmu_fail_above(tl_test_fmu *fmu, tl_test_fault_kind kind, double above);

/* Returns the variable of that name, which must exist. */
tl_variable *tl_test_fmu_variable(tl_test_fmu *fmu, const char *name);

/* Deletes all calls and violations from the log. The FMUs do not change. */
void tl_test_log_clear(tl_test_log *log);

/* Returns the n-th step of an FMU in the log, from 0; NULL if there is none. */
const tl_test_entry *tl_test_log_step(const tl_test_log *log, const tl_test_fmu *fmu, size_t n);

/* Number of calls of one kind in the log, of one FMU or of all (NULL). */
size_t tl_test_log_count(const tl_test_log *log, const tl_test_fmu *fmu, tl_test_call call);

/* "fmi2DoStep" … */
const char *tl_test_call_name(tl_test_call call);

#endif
