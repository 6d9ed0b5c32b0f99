/* One step: its budget and its record.
 *
 * Purpose: input and output of the search of one step. A record has a fixed size and no pointers,
 *          so that it can be copied through queues and between processes.
 * Thread:  plain data.
 */
#ifndef TL_MASTER_SYNC_RECORD_H
#define TL_MASTER_SYNC_RECORD_H

#include <stdbool.h>
#include <stdint.h>

#include "master/base/signal.h"
#include "master/base/simtime.h"

/* Budget of the search of one step. */
typedef struct tl_budget {
    uint32_t evaluations;          /* default: 60; evaluations of J per step, nominal included; ≥ 1 */
    tl_time time;                  /* default: 6/10 of T_S; ns from `started` on; ignored if `now` is NULL */
    tl_time started;               /* reading of `now` at the start of this tick, ns */
    tl_time (*now)(void *context); /* monotonic clock, ns; NULL in a replay, so that its results are repeatable */
    void *context;
    bool unrecorded;      /* no replay repeats this tick, so the clock must not decide anything lasting */
    bool repeated;        /* repeats a recorded step that ran out of time after `evaluations`, which may be 0 */
    bool without_nominal; /* only if `repeated`: nominal was not evaluated in that step */
    uint64_t executions;  /* only if `repeated`: executions of that step in the search of an event horizon */
} tl_budget;

/* Default budget for macro steps of `step` ns, without a clock. */
tl_budget tl_budget_defaults(tl_time step);

/* Outcome of a step. */
typedef enum tl_outcome {
    TL_FREE,        /* nothing is adjusted */
    TL_FIRST_GUESS, /* the first guess of u was within tolerance */
    TL_OPTIMISED,   /* the search found a u within tolerance */
    TL_BEST_SO_FAR, /* the search ended outside the tolerance, but better than nominal by the margin */
    TL_NOMINAL,     /* nominal u committed: the search found nothing better, the found u failed, or TL_FLAG_RESTS */
    TL_FREE_RUN,    /* nominal u committed, nothing evaluated: no matched signal was good, or TL_FLAG_NO_ROLLBACK */
    TL_CAUGHT_UP,   /* a missed tick: nominal plus the last Δu (a Boolean: the last u), nothing evaluated */
    TL_HELD,        /* event horizon: the last u is held; a step that ends a search has an outcome from above */
    TL_SEARCHING,   /* event horizon: the last u is held while a stroke is searched */
    TL_RESUMED      /* committed with the u of the earlier run that this run resumes */
} tl_outcome;

enum { TL_OUTCOMES = TL_RESUMED + 1 };

/* Why the search ended. */
typedef enum tl_stop {
    TL_STOP_NONE, /* there was no search */
    TL_STOP_TOLERANCE,
    TL_STOP_SOLVER, /* the solver found no better point */
    TL_STOP_EVALUATIONS,
    TL_STOP_TIME
} tl_stop;

/* Other events of a step, as bits. */
typedef enum tl_flag {
    TL_FLAG_FALLBACK = 1,        /* the second solver took over */
    TL_FLAG_STAGNATED = 2,       /* a solver made no progress and was stopped */
    TL_FLAG_WITHOUT_NOMINAL = 4, /* time ran out before nominal was evaluated */
    TL_FLAG_PLATEAU = 8,         /* event horizon: with the first guess, the event was outside the window */
    TL_FLAG_ABANDONED = 16,      /* event horizon: a stroke was not searched, or not completely */
    TL_FLAG_RESET = 32,          /* before this step the FMUs were reset to their start values (tl_twin_reset()) */
    TL_FLAG_DIFFERED =
        64, /* the rollback of an FMU is not exact: found just before this step (sync/verifier.h), or earlier */
    TL_FLAG_NO_ROLLBACK = 128, /* an FMU that is rolled back by replay is too far from its start: the twin runs free */
    TL_FLAG_RESTS =
        256, /* nothing was searched, u rests at nominal: the free-running twin predicts better, or tl_twin_rest() */
    TL_FLAG_REFUSED = 512,        /* candidates of this step could not be evaluated (tl_record_refused) */
    TL_FLAG_NOT_FINITE = 1024,    /* an output of an FMU was not finite (bad_outputs) */
    TL_FLAG_RELEASED_SLOW = 2048, /* after this step the released twins ended (TL_RELEASED_SLOW) */
    TL_FLAG_STARTS =
        4096, /* with TL_FLAG_RESET: the twin itself reset the FMUs, for start values of the plant (`found`) */
    TL_LAST_FLAG = TL_FLAG_STARTS
} tl_flag;

/* True if tl_twin_reset() must be called to repeat the step: the twin does not reset itself. */
static inline bool tl_record_was_reset(uint32_t flags) {
    return (flags & (TL_FLAG_RESET | TL_FLAG_STARTS)) == TL_FLAG_RESET;
}

/* State of a measured delay. */
typedef enum tl_delay_state {
    TL_DELAY_UNKNOWN, /* not known yet, or not measured */
    TL_DELAY_KNOWN,
    TL_DELAY_LOST /* it was known, but the measurement is no longer reliable */
} tl_delay_state;

/* Readings of the plant within a step, compared with an output (twin/reading_meter.h). */
typedef struct tl_record_readings {
    uint32_t count;
    uint32_t rejected; /* readings rejected since the record before; not in `count` */
    double squares;    /* Σ(y − ŷ)² at the instants of the readings, in the output's unit squared */
} tl_record_readings;

/* Candidates of a step that could not be evaluated, because an FMU failed or a matched output was
 * not finite. The first of them is described; `count` 0: none, and the rest is undefined. */
typedef struct tl_record_refused {
    uint32_t count;
    uint32_t by_output; /* 0: an FMU failed; 1: an output was not finite */
    uint32_t index;     /* of this component or this matched output, in the order of the plan */
    uint32_t variable;  /* the adjusted variable that was furthest from nominal, in multiples of its `step` */
    double u;           /* value of this variable */
} tl_record_refused;

/* Start values that were found before a step (twin/start_values.h). */
typedef struct tl_record_found {
    uint32_t evaluations;         /* 0: none were found, and the rest is undefined */
    double values[TL_MAX_ADJUST]; /* in the order of the plan's `find` */
    double before, after; /* rms of the matched errors, in tolerances, with the values of before and with these */
} tl_record_found;

/* One committed step. Arrays are in the order of the plan's `match` and `adjust`; only that many
 * entries are filled, since records are copied often and never cleared. */
typedef struct tl_record {
    int64_t step; /* i; y and `measured` belong to the instant t_(i+1) */
    tl_outcome outcome;
    tl_stop stop;
    double objective;         /* J of the committed u; NaN if not evaluated */
    double objective_nominal; /* J of the nominal u; NaN if not evaluated */
    uint32_t evaluations;
    uint32_t executions; /* fmi2DoStep calls and plant steps, candidates included */
    uint32_t predicted;  /* as `executions`: prediction by the ledger for the same evaluations (sync/ledger.h) */
    uint32_t flags;      /* tl_flag */
    uint32_t held;       /* bit v: adjusted variable v was not identifiable and was held at nominal */
    /* Bit k: output k of an FMU was not finite at t_(i+1); for the first step after an
     * initialisation also at t_i. The outputs are those of `match`, then the sources of
     * `connections` of the plan; the last bit stands for any further one. */
    uint64_t bad_outputs;
    tl_record_refused refused;
    tl_time used;           /* duration of the step, ns; 0 without a clock; set by tl_twin_step() */
    double y[TL_MAX_MATCH]; /* NaN: not finite */
    double measured[TL_MAX_MATCH];
    uint8_t measured_quality
        [TL_MAX_MATCH]; /* tl_quality; a bad `measured` is replaced by the last good one, and is never NaN */
    tl_record_readings readings[TL_MAX_MATCH];
    double released[TL_MAX_MATCH]; /* y of the older released twin (sync/released_twin.h); NaN: not finite */
    uint32_t release_age;          /* steps since its release; 0: there is none, and `released` is undefined */
    double u[TL_MAX_ADJUST];
    double nominal[TL_MAX_ADJUST]; /* û */
    tl_record_found found;         /* valid with TL_FLAG_STARTS */
    tl_delay_state delay_state;
    tl_time delay; /* measured, ns; ŷ of later steps is looked up this long before y; 0 if not known */
} tl_record;

/* Initialises the record of a step: nothing evaluated, no variable held, both objectives NaN. */
void tl_record_begin(tl_record *record, int64_t step);

/* Text names for records and messages: "free", "first guess", … and "tolerance", "evaluations", ….
 */
const char *tl_outcome_name(tl_outcome outcome);
const char *tl_stop_name(tl_stop stop);
const char *tl_flag_name(tl_flag flag);

/* Why the rollback of an FMU is not exact (verifier.h). */
typedef enum tl_restore_cause {
    TL_CAUSE_UNKNOWN,    /* not examined, or not reproducible here */
    TL_CAUSE_UNSTEADY,   /* two runs from one full copy differ: the FMU depends on a clock or other outside data */
    TL_CAUSE_COLD,       /* values differ although nothing happened between save and restore: a solver restarts */
    TL_CAUSE_PARAMETERS, /* values differ only if a value was set in between: states lack values that were set */
    TL_CAUSE_INCOMPLETE, /* values differ if steps were executed in between: states lack data that steps change */
    TL_CAUSE_ONE_STATE,  /* values differ if a second state was saved in between: the FMU can hold only one */
    TL_CAUSE_EVENTS,     /* values differ after steps with extreme inputs: states lack data that an event changes */
    TL_CAUSE_LATE,       /* the FMU accepted save and restore at first, and rejects them later */
    TL_CAUSE_REFUSES,    /* after a restore the FMU fails in a step that it had executed before */
    TL_CAUSE_FINAL       /* values differ if the FMU learns that no earlier state will be restored */
} tl_restore_cause;

enum { TL_RESTORE_CAUSES = TL_CAUSE_FINAL + 1 };

/* Whether there are released twins (released_twin.h), or why there are none. */
typedef enum tl_released_state {
    TL_RELEASED_OFF, /* not wanted, or nothing is adjusted */
    TL_RELEASED_ON,
    TL_RELEASED_EVENT,   /* not with an event horizon */
    TL_RELEASED_OUTPUTS, /* a component keeps only outputs: its state would have to be computed again in each step */
    TL_RELEASED_REPLAY,  /* a component is rolled back by replay */
    TL_RELEASED_MEMORY,  /* their states need more than a quarter of the memory bound */
    TL_RELEASED_SLOW     /* they took more than a tenth of T_S per step */
} tl_released_state;

enum { TL_RELEASED_STATES = TL_RELEASED_SLOW + 1 };

/* For messages: "on", or the reason. */
const char *tl_released_state_text(tl_released_state state);

/* Ages of released twins (steps since the release) by powers of two: index k stands for 2^k …
 * 2^(k+1) − 1 steps, the last one also for more. */
enum { TL_RELEASED_AGES = 16 };

/* Largest square of an error in tolerances that is added up, so that one outlier cannot decide. */
#define TL_RELEASED_MOST 1e4

/* Effort of the two released twins, and their errors by age. */
typedef struct tl_released_counts {
    uint64_t executions; /* of FMUs and of the plant; no other count includes them */
    uint64_t releases;
    double squares[TL_RELEASED_AGES]; /* sum of Σ weight·((y − ŷ)/tolerance)² over steps */
    uint64_t steps[TL_RELEASED_AGES]; /* number of these steps; each has at least one good ŷ */
} tl_released_counts;

/* Effort and effect of a free-running twin (free_twin.h). */
typedef struct tl_free_twin_counts {
    uint64_t executions; /* of FMUs and of the plant; no other count includes them */
    uint64_t rested;     /* committed steps with u resting at nominal */
    uint64_t turns;      /* number of times that u started to rest */
    uint64_t adopted;    /* number of times that the twin continued from the free-running twin's state */
    uint64_t renewed;    /* number of times that the free-running twin restarted from the twin's state */
} tl_free_twin_counts;

#endif
