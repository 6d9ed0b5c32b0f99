/* FMUs of the test process itself: a tl_model and a tl_fmi2 in C, that do as told and watch their caller.
 *
 * Purpose: the master under test believes it drives loaded FMI 2.0 binaries. Each of these can be made to fail at a
 *          chosen call, to lie about its state, to feed through while initialising, and to cost time on a fake clock. Each
 *          call is recorded with its arguments, and judged against the standard's state machine: a call that FMI 2.0
 *          forbids is a violation, which a test asserts there are none of.
 * Model:   per channel c: drive = gain·u[c] + offset; a step of h moves y[c] to drive where `lag` is 0, else by
 *          h/lag·(drive − y[c]). `sum` is the sum of all y. Integers, booleans and the enumeration are passed on by a step.
 *          Before the first step y[c] is `start`, or drive where the FMU feeds through. One that is `telling` adds a little
 *          to each y after a step, and gives a `count_out`, that depend on every bit of all inputs of all steps so far;
 *          and a true `flag` raises its drives by 0.25. One that `ends` has its y[0] watched by `flag_out`.
 *            u0 … u3      Real input           y0 … y3, sum  Real output
 *            gain, offset Real parameter, tunable            lag, start  Real parameter, fixed
 *            and if `discrete`: count, mode, flag (Integer, Enumeration, Boolean inputs), count_out, mode_out, flag_out
 *            (outputs), label (String parameter), label_out (String output)
 *          Value references start at 0 for each base type, so that a mixed-up type shows.
 * Judged:  which call is legal in which state; nothing at all after fmi2Fatal, on any instance of the same FMU; only inputs
 *          and tunable parameters set while stepping; no Get after Set without a step between; communication points
 *          that continue; all inputs set again after fmi2SetFMUstate; no return to a point before one that was said to
 *          be final, nor behind a reset; state handles of this instance only, reused rather than leaked, also over a reset; equal
 *          GUID.
 * Source:  FMI 2.0.4, sections 2.1 and 4.2.4.
 * Owner:   the caller places everything; an instance takes memory of the process and gives it back when freed, or by
 *          tl_test_fmu_end().
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
    TL_TEST_ENTRIES = 1 << 14 /* calls a log keeps; later ones are judged and counted only */
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
    TL_TEST_CALLS /* how many there are */
} tl_test_call;

typedef struct tl_test_fmu tl_test_fmu;

/* One call as it came and as it was answered. */
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
    double offset; /* step: the values it was taken with */
} tl_test_entry;

/* What happened to all FMUs of one test, in order. */
typedef struct tl_test_log {
    size_t count;      /* calls so far, also those that had no room */
    size_t violations; /* calls that FMI 2.0 forbids */
    char first_violation[160];
    tl_test_entry entries[TL_TEST_ENTRIES];
} tl_test_log;

typedef enum tl_test_fault_kind { TL_TEST_DISCARD, TL_TEST_ERROR, TL_TEST_FATAL, TL_TEST_NAN } tl_test_fault_kind;

/* What an FMU does wrong, and when. NAN makes a step succeed with outputs that are not numbers. */
typedef struct tl_test_fault {
    tl_test_fault_kind kind;
    tl_test_call call;
    uint64_t first; /* the first call of that kind to fail, counted from 1; 0: none fails by its number */
    uint64_t last;
    double above; /* a step also fails where a drive (gain·u + offset) is larger; +infinity: never */
} tl_test_fault;

/* How an FMU behaves; may be changed at any time. */
typedef struct tl_test_control {
    tl_test_fault fault;
    size_t ballast;    /* bytes by which each of its state handles is larger, all of them written to */
    bool state_lies;   /* fmi2SetFMUstate says OK and brings nothing back but the time */
    bool feed_through; /* outputs follow inputs while initialising */
    bool raw_true;     /* booleans that are true are given as 7 */
    bool ends;         /* `flag_out` says whether y[0] has reached 0.5, as an end position does */
    bool telling; /* outputs tell different inputs apart, whatever their channel and however small the difference */
    /* Called after each step, with a number that is the same for the same inputs since the start only (of steps that
     * succeeded);
     * NULL: nobody listens. */
    void (*trace)(void *context, const tl_test_fmu *fmu, const tl_test_entry *step, uint64_t lineage);
    void *context;
    tl_time *clock; /* a step moves this on by `cost`; NULL: no clock */
    tl_time cost;   /* ns */
} tl_test_control;

struct tl_test_fmu {
    tl_model model;
    tl_variable variables[TL_TEST_VARIABLES]; /* the model's; a test may change them before the twin is built */
    tl_fmi2
        functions; /* what no master of ours calls is NULL; it can serialise, but does not say so unless a test does */
    fmi2CallbackFunctions callbacks; /* to be given to fmi2Instantiate: leads back to this FMU */
    tl_test_control control;
    tl_test_log *log;
    uint64_t calls[TL_TEST_CALLS]; /* by kind */
    size_t instances;              /* ever made */
    size_t living;                 /* instances not freed */
    size_t states;                 /* state handles not freed */
    bool dead;                     /* has answered fmi2Fatal */
    size_t width;
    struct tl_test_instance *alive; /* newest first */
};

/* An FMU of `width` channels (1 … TL_TEST_WIDTH), with the discrete variables or without; its calls go to `log`. */
void tl_test_fmu_init(tl_test_fmu *fmu, size_t width, bool discrete, tl_test_log *log);

/* Gives back what instances and states that nobody could free any more (after fmi2Fatal) hold, as the end of a process
 * would. Harmless otherwise. */
void tl_test_fmu_end(tl_test_fmu *fmu);

/* Makes a call of kind `call` fail from its number `first` to its number `last`, counted from the FMU's very first call. */
void tl_test_fmu_fail(tl_test_fmu *fmu, tl_test_call call, tl_test_fault_kind kind, uint64_t first, uint64_t last);

/* Makes steps fail whose drive is above a limit. */
void tl_test_fmu_fail_above(tl_test_fmu *fmu, tl_test_fault_kind kind, double above);

/* The variable of that name; it must exist. */
tl_variable *tl_test_fmu_variable(tl_test_fmu *fmu, const char *name);

/* Forgets all calls and violations; the FMUs stay as they are. */
void tl_test_log_clear(tl_test_log *log);

/* The n-th step of an FMU in the log, counted from 0; NULL where there is none. */
const tl_test_entry *tl_test_log_step(const tl_test_log *log, const tl_test_fmu *fmu, size_t n);

/* How many calls of one kind the log has of an FMU; any FMU where it is NULL. */
size_t tl_test_log_count(const tl_test_log *log, const tl_test_fmu *fmu, tl_test_call call);

/* "fmi2DoStep" … */
const char *tl_test_call_name(tl_test_call call);

#endif
