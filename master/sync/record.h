/* One step: what it may spend, and the record of how it came about.
 *
 * Purpose: what goes into and comes out of the search of one step; fixed size, so that records can go through rings.
 * Thread:  plain data.
 */
#ifndef TL_MASTER_SYNC_RECORD_H
#define TL_MASTER_SYNC_RECORD_H

#include <stdbool.h>
#include <stdint.h>

#include "master/base/signal.h"
#include "master/base/simtime.h"

/* How much one step may spend on its search. */
typedef struct tl_budget {
    uint32_t evaluations;          /* default: 60; objective values per step, the nominal one included; ≥ 1 */
    tl_time time;                  /* default: 6/10 of T_S; ns since `now` read `started`; ignored if now is NULL */
    tl_time started;               /* what `now` read when this tick began */
    tl_time (*now)(void *context); /* a monotonic clock; NULL in a replay, so that it is repeatable */
    void *context;
    bool repeated;        /* a step that time cut short is repeated: `evaluations` are those it had, which may be 0, */
    bool without_nominal; /* and nominal's was not among them; else false */
    uint64_t executions;  /* of such a step, where it is one of an event horizon's search */
} tl_budget;

/* The default budget for macro steps of `step` ns, without a clock. */
tl_budget tl_budget_defaults(tl_time step);

/* How a step came about. */
typedef enum tl_outcome {
    TL_FREE,        /* nothing is adjusted */
    TL_FIRST_GUESS, /* the first guess was within tolerance */
    TL_OPTIMISED,   /* the search found a u within tolerance */
    TL_BEST_SO_FAR, /* the search ended outside the tolerance, yet better than nominal by the margin */
    TL_NOMINAL,     /* nothing found was better than nominal: nominal u committed */
    TL_FREE_RUN,    /* no matched signal was good, or TL_FLAG_NO_WAY_BACK: nominal u committed, nothing evaluated */
    TL_MADE_UP,     /* a missed tick: nominal plus the last Δu (a Boolean: the last u), nothing evaluated */
    TL_HELD, /* event horizon: the u found last; the outcomes above are those of a stroke, when its search is over */
    TL_SEARCHING, /* event horizon: the same, while a stroke is searched */
    TL_FOLLOWED   /* the u that an earlier run has committed, so as to go on from where that one ended */
} tl_outcome;

enum { TL_OUTCOMES = TL_FOLLOWED + 1 };

/* Why the search ended. */
typedef enum tl_stop {
    TL_STOP_NONE, /* there was no search */
    TL_STOP_TOLERANCE,
    TL_STOP_SOLVER, /* the solver found no better point */
    TL_STOP_EVALUATIONS,
    TL_STOP_TIME
} tl_stop;

/* What else happened in a step; bits. */
typedef enum tl_flag {
    TL_FLAG_FALLBACK = 1,        /* the second solver took over */
    TL_FLAG_STAGNATED = 2,       /* a solver made no progress and was ended */
    TL_FLAG_WITHOUT_NOMINAL = 4, /* time cut the step short, and nominal was not evaluated */
    TL_FLAG_PLATEAU = 8,         /* event horizon: with the first guess the event fell outside the window */
    TL_FLAG_ABANDONED = 16,      /* event horizon: a stroke was not searched, or not to the end */
    TL_FLAG_RESET = 32,          /* the FMUs began anew before it, with their start values (tl_twin_reset()) */
    TL_FLAG_DIFFERED =
        64, /* before it an FMU was found not to come back to where it was (sync/verifier.h), or is known not to */
    TL_FLAG_NO_WAY_BACK = 128, /* an FMU that is led back by replay is too far from its beginning: the twin runs free */
    TL_FLAG_RESTS =
        256, /* nothing was searched: the twin that is left alone predicts better (sync/free_twin.h), and u rests at nominal */
    TL_LAST_FLAG = TL_FLAG_RESTS
} tl_flag;

/* What is known of a measured delay. */
typedef enum tl_delay_state {
    TL_DELAY_UNKNOWN, /* nothing yet, or it is not measured */
    TL_DELAY_KNOWN,
    TL_DELAY_LOST /* it was known; what is measured now is not sure */
} tl_delay_state;

/* What of the plant's readings fell into a step, held against an output (twin/reading_meter.h). */
typedef struct tl_record_readings {
    uint32_t count;
    uint32_t rejected; /* seen since the record before; not among them */
    double squares;    /* Σ(y − ŷ)² at their own instants, in the output's unit, squared */
} tl_record_readings;

/* One committed step. Arrays are in the order of the plan's `match` and `adjust`, and filled as far as the plan has
 * entries: records are copied often, and cleared never. */
typedef struct tl_record {
    int64_t step; /* i; y and y_hat belong to the instant t_(i+1) */
    tl_outcome outcome;
    tl_stop stop;
    double objective;         /* J of the committed u; NaN where none was evaluated */
    double objective_nominal; /* J of the nominal u; NaN where it was not evaluated */
    uint32_t evaluations;
    uint32_t executions; /* fmi2DoStep calls and plant steps, trials included */
    uint32_t predicted;  /* executions that the graph predicts for the same evaluations (sync/ledger.h) */
    uint32_t flags;      /* tl_flag */
    uint32_t held;       /* bit v: adjusted variable v was not identifiable and held at nominal */
    tl_time used;        /* ns of the budget's clock, 0 without one; set by tl_twin_step */
    double y[TL_MAX_MATCH];
    double y_hat[TL_MAX_MATCH];
    uint8_t y_hat_quality[TL_MAX_MATCH]; /* tl_quality; NaN never appears: a bad y_hat holds the last good one */
    tl_record_readings readings[TL_MAX_MATCH];
    double u[TL_MAX_ADJUST];
    double u_hat[TL_MAX_ADJUST]; /* nominal */
    tl_delay_state delay_state;
    tl_time delay; /* measured, by which ŷ of later steps is looked up before their y; 0 where it is not known */
} tl_record;

/* Begins the record of a step: nothing was evaluated or held, both objectives are NaN. What the step finds is filled in later. */
void tl_record_begin(tl_record *record, int64_t step);

/* Text names for records and people: "free", "first guess", … and "tolerance", "evaluations", …. */
const char *tl_outcome_name(tl_outcome outcome);
const char *tl_stop_name(tl_stop stop);
const char *tl_flag_name(tl_flag flag);

/* Why an FMU does not come back to where it was (verifier.h). */
typedef enum tl_restore_cause {
    TL_CAUSE_UNKNOWN,  /* nobody has looked, or it does not show here */
    TL_CAUSE_UNSTEADY, /* it goes two ways from one copy of all that it knows: by a clock, a file, or what no copy has */
    TL_CAUSE_COLD,     /* other values though nothing lay between save and restore: what computes them begins anew */
    TL_CAUSE_PARAMETERS, /* the same values then, and others if something was set in between: what is set is not in its states */
    TL_CAUSE_INCOMPLETE, /* others if steps lay between: its states do not hold all that steps change */
    TL_CAUSE_ONE_STATE,  /* others if a second state was saved in between: it has room for one */
    TL_CAUSE_EVENTS, /* others if steps lay between with inputs that went far, and not if they went near: its states do not hold what an event has changed */
    TL_CAUSE_LATE,   /* it was saved and led back once, and refuses it later */
    TL_CAUSE_REFUSES, /* led back, it fails in a step that it had done */
    TL_CAUSE_FINAL    /* other values if it is said that no earlier state will be restored */
} tl_restore_cause;

enum { TL_RESTORE_CAUSES = TL_CAUSE_FINAL + 1 };

/* What a free twin that is led beside has cost and done (free_twin.h). */
typedef struct tl_free_twin_counts {
    uint64_t executions; /* of FMUs and of the plant, which no other count has */
    uint64_t rested;     /* committed steps with u at nominal because of it, */
    uint64_t turns;      /* how often that began, */
    uint64_t adopted;    /* how often the twin went on from its state, */
    uint64_t renewed;    /* and how often it began anew from the twin's */
} tl_free_twin_counts;

#endif
