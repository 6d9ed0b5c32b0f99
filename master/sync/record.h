/* One step: its budget and its record.
 *
 * Purpose: input and output of the search of one step; fixed size, so that records can go through
 *          queues.
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
    tl_time started;               /* reading of `now` at the start of this tick */
    tl_time (*now)(void *context); /* a monotonic clock; NULL in a replay, so that it is repeatable */
    void *context;
    bool
        repeated; /* a step that ran out of time is repeated: `evaluations` is the number that it had, which may be 0 */
    bool without_nominal; /* nominal was not evaluated in it; else false */
    uint64_t executions;  /* executions of such a step in the search of an event horizon */
} tl_budget;

/* Default budget for macro steps of `step` ns, without a clock. */
tl_budget tl_budget_defaults(tl_time step);

/* Outcome of a step. */
typedef enum tl_outcome {
    TL_FREE,        /* nothing is adjusted */
    TL_FIRST_GUESS, /* the first guess was within tolerance */
    TL_OPTIMISED,   /* the search found a u within tolerance */
    TL_BEST_SO_FAR, /* the search ended outside the tolerance, but better than nominal by the margin */
    TL_NOMINAL,     /* the search found nothing better than nominal: nominal u committed */
    TL_FREE_RUN,    /* no matched signal was good, or TL_FLAG_NO_ROLLBACK: nominal u committed, nothing evaluated */
    TL_CAUGHT_UP,   /* a missed tick: nominal plus the last Δu (a Boolean: the last u), nothing evaluated */
    TL_HELD, /* event horizon: the last u is held; the outcomes above are those of a stroke, when its search has ended */
    TL_SEARCHING, /* event horizon: the same, while a stroke is searched */
    TL_RESUMED    /* the u of an earlier run, to resume where that run ended */
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
    TL_FLAG_PLATEAU = 8,         /* event horizon: with the first guess the event fell outside the window */
    TL_FLAG_ABANDONED = 16,      /* event horizon: a stroke was not searched, or not completely */
    TL_FLAG_RESET = 32,          /* before this step the FMUs were reset to their start values (tl_twin_reset()) */
    TL_FLAG_DIFFERED =
        64, /* before this step the rollback of an FMU was found not to be exact (sync/verifier.h), or is known not to be */
    TL_FLAG_NO_ROLLBACK = 128, /* an FMU that is rolled back by replay is too far from its start: the twin runs free */
    TL_FLAG_RESTS =
        256, /* nothing was searched: the free-running twin predicts better (sync/free_twin.h), and u rests at nominal */
    TL_FLAG_REFUSED = 512,     /* candidates of this step could not be evaluated (tl_record_refused) */
    TL_FLAG_NOT_FINITE = 1024, /* an output of an FMU was not finite (bad_outputs) */
    TL_LAST_FLAG = TL_FLAG_NOT_FINITE
} tl_flag;

/* State of a measured delay. */
typedef enum tl_delay_state {
    TL_DELAY_UNKNOWN, /* not known yet, or not measured */
    TL_DELAY_KNOWN,
    TL_DELAY_LOST /* it was known, but the measurement is no longer reliable */
} tl_delay_state;

/* Readings of the plant within a step, compared with an output (twin/reading_meter.h). */
typedef struct tl_record_readings {
    uint32_t count;
    uint32_t rejected; /* rejected readings since the record before; not in `count` */
    double squares;    /* Σ(y − ŷ)² at the instants of the readings, in the output's unit squared */
} tl_record_readings;

/* Candidates of a step that could not be evaluated, because an FMU failed or a matched output was
 * not finite. The first of them is described; `count` 0: none, and the rest is undefined. */
typedef struct tl_record_refused {
    uint32_t count;
    uint32_t by_output; /* 0: an FMU failed; 1: an output was not finite */
    uint32_t index;     /* of this component or matched output, in the order of the plan */
    uint32_t variable;  /* the adjusted variable that was furthest from nominal, in first steps of a search */
    double u;           /* its value */
} tl_record_refused;

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
    uint32_t predicted;  /* executions that the ledger predicts for the same evaluations (sync/ledger.h) */
    uint32_t flags;      /* tl_flag */
    uint32_t held;       /* bit v: adjusted variable v was not identifiable and was held at nominal */
    /* Bit k: output k of an FMU was not finite at t_(i+1); for the first step after an
     * initialisation also at t_i. The outputs are those of `match`, then the sources of
     * `connections` of the plan; the last bit stands for any further one. */
    uint64_t bad_outputs;
    tl_record_refused refused;
    tl_time used;           /* ns by the budget's clock, 0 without one; set by tl_twin_step */
    double y[TL_MAX_MATCH]; /* NaN: not finite */
    double measured[TL_MAX_MATCH];
    uint8_t measured_quality
        [TL_MAX_MATCH]; /* tl_quality; `measured` is never NaN: a bad one is replaced by the last good one */
    tl_record_readings readings[TL_MAX_MATCH];
    double u[TL_MAX_ADJUST];
    double nominal[TL_MAX_ADJUST]; /* nominal */
    tl_delay_state delay_state;
    tl_time delay; /* measured; ŷ of later steps is looked up this long before y; 0 if not known */
} tl_record;

/* Initialises the record of a step: nothing evaluated or held, both objectives NaN. */
void tl_record_begin(tl_record *record, int64_t step);

/* Text names for records and messages: "free", "first guess", … and "tolerance", "evaluations", ….
 */
const char *tl_outcome_name(tl_outcome outcome);
const char *tl_stop_name(tl_stop stop);
const char *tl_flag_name(tl_flag flag);

/* Why the rollback of an FMU is not exact (verifier.h). */
typedef enum tl_restore_cause {
    TL_CAUSE_UNKNOWN, /* not examined, or not reproducible here */
    TL_CAUSE_UNSTEADY, /* two runs from one full copy differ: it depends on a clock, a file, or something outside of the copy */
    TL_CAUSE_COLD,       /* values differ although nothing happened between save and restore: a solver restarts */
    TL_CAUSE_PARAMETERS, /* values differ only if something was set in between: its states do not hold what is set */
    TL_CAUSE_INCOMPLETE, /* values differ if steps were executed in between: its states do not hold all that steps change */
    TL_CAUSE_ONE_STATE, /* values differ if a second state was saved in between: it can hold only one */
    TL_CAUSE_EVENTS, /* values differ if steps with extreme inputs were executed in between: its states do not hold what an event changes */
    TL_CAUSE_LATE,    /* it was saved and restored once, and rejects it later */
    TL_CAUSE_REFUSES, /* after a restore it fails in a step that it had executed */
    TL_CAUSE_FINAL    /* values differ if the FMU learns that no earlier state will be restored */
} tl_restore_cause;

enum { TL_RESTORE_CAUSES = TL_CAUSE_FINAL + 1 };

/* Effort and effect of a free-running twin (free_twin.h). */
typedef struct tl_free_twin_counts {
    uint64_t executions; /* of FMUs and of the plant; no other count includes them */
    uint64_t rested;     /* committed steps with u resting at nominal */
    uint64_t turns;      /* how often that started */
    uint64_t adopted;    /* how often the twin continued from its state */
    uint64_t renewed;    /* how often it restarted from the twin's state */
} tl_free_twin_counts;

#endif
