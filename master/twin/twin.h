/* The twin: the façade of the master. Live, replay, shadow and tests all run this same code.
 *
 * Purpose: give it a sample of the plant and a budget, get a committed step and a record of it.
 * Method:  algorithm 3 of the thesis, with the decisions of DESIGN.md ("The method, as we decided it").
 * Ticks:   the sample of tick m is the plant at t_m. Tick 0 is t_start and initialises the FMUs.
 *            lag:   tick m ≥ T_P + D computes step i = m − T_P − D; its record is complete at once. D is the delay of the
 *                   conditioned measurements, 0 without any.
 *            hold:  tick m ≥ 1 + D computes step i = m − 1 − D; complete at once.
 *            ahead: tick m computes step i = m; its record is complete when the sample m + 1 has come.
 *          D grows by what the plan's input_ticks and output_ticks are above 0, whichever waits longer; the FMUs are then
 *          initialised at tick input_ticks, with what the plant shows at t_0 (in mode ahead at tick 0). Where Δo is measured
 *          a step waits for the longest delay that can come out.
 * Memory:  everything is taken in tl_twin_build(); nothing of ours allocates afterwards.
 * Thread:  one twin belongs to one thread at a time.
 */
#ifndef TL_MASTER_TWIN_TWIN_H
#define TL_MASTER_TWIN_TWIN_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "master/base/signal.h"
#include "master/base/status.h"
#include "master/plan/plan.h"
#include "master/plan/tuning.h"
#include "master/sync/record.h"
#include "master/twin/metrics.h"

typedef struct tl_twin tl_twin;

/* Facts of a built twin, for `check`, `--json` and the recorder. Texts live as long as the twin. */
typedef struct tl_twin_facts {
    size_t components;                  /* K, the plant included */
    uint32_t prediction;                /* T_P in force; of an event horizon, at most */
    uint32_t distance;                  /* T_D: the smallest over all pairs; 0 where nothing is adjusted */
    uint32_t lead;                      /* step i is computed at tick i + lead */
    int64_t first;                      /* the first step that was, or will be: 0, or later after tl_twin_begin_at() */
    size_t unknowns;                    /* of a search */
    const char *algorithm;              /* the solver in force; "" where nothing is adjusted */
    const char *fallback;               /* "" where there is none */
    size_t memory;                      /* bytes of ours, all taken at start-up */
    uint64_t state_memory;              /* bytes of the FMUs' saved states at most; 0: not begun, or not known */
    uint64_t executions_per_step;       /* K: of a step that runs free */
    uint64_t executions_per_evaluation; /* K·T_P: if nothing were saved */
    bool returns;                       /* begun, and the rollback of all FMUs was found to hold */
    bool cannot_return;                 /* or that of an FMU was found not to: */
    const char *astray;                 /* of this component; NULL: it holds, or that is not known */
    uint64_t proved_executions;         /* that this took, which no other count has */
    const char *
        runs_free; /* the component that can no longer be led back by replay, so that nothing is synchronised; NULL: none */
    uint64_t verified;            /* how often an FMU was led back and executed again (tl_twin_verify()), */
    uint64_t verified_executions; /* with so many executions, which no other count has, */
    uint64_t differed;            /* and how often it did not come back to where it was */
    bool has_free_twin;           /* one is led beside; begun, else it is only asked for */
    tl_free_twin_counts free_twin;
    bool structure; /* what is saved */
    bool sequences;
} tl_twin_facts;

/* One component in the ledger; the plant is the last one. */
typedef struct tl_twin_ledger {
    const char *name;
    uint32_t reach;       /* Γ_k (eq. 4.5) */
    bool on_a_way;        /* between an adjusted variable and a matched output */
    uint32_t longer;      /* C_k, where it is */
    uint32_t first_need;  /* executions of a step's first evaluation at most, as saved */
    uint32_t next_need;   /* and of each later one (eq. 4.13) */
    uint32_t nodes;       /* room in the cache; 0: none */
    uint64_t nodes_worst; /* that could be needed at once */
    uint32_t nodes_peak;  /* used at most, so far */
    size_t memory;        /* bytes of ours for them, in those of the facts; the FMU's states are beside them */
    size_t
        state_size; /* bytes of one saved state of the FMU, and how many of the nodes may have one; 0: not begun, or not known */
    uint32_t states;
    uint64_t plain;        /* executions if nothing were saved */
    uint64_t predicted;    /* by the graph for the same evaluations */
    uint64_t executions;   /* done */
    uint64_t caught_up;    /* executions done again to bring an FMU to a place (TL_KEEP_OUTPUTS) */
    tl_fmi2_replay replay; /* how it is led back by replay: steps for that are in no other count; zeroed: it is not */
    uint64_t unstored;     /* results that found no room: what they cost again is not predicted */
    int64_t difference; /* executions that were neither predicted nor to catch up. Above 0: results found no room, or a
                            committed step that failed was repeated. Below: inputs came out the same for another u, or
                            the ledger is not complete. Else 0 */
    tl_time cost;       /* ns of one execution, saving its state included: the last, or an earlier one that was longer,
                            fading; 0 where none ran under a budget with a clock */
} tl_twin_ledger;

/* What an adjusted variable is searched from, and within. */
typedef struct tl_twin_adjusted {
    bool is_real; /* else Boolean, and nothing below means anything */
    bool is_fed;  /* a connection delivers û: `nominal` is not known */
    double nominal;
    double step;
    double lower;
    double upper;
    double least; /* that the FMU declares: the bounds are within */
    double most;
} tl_twin_adjusted;

/* A measured delay: of the first matched output that is sure of one. */
typedef struct tl_twin_delay {
    tl_delay_state state;
    tl_time delay;     /* in force: ŷ is looked up so long before y, in whole steps; 0 where not known */
    double confidence; /* 0 … 1, of what the measurements say now */
} tl_twin_delay;

/* A solver that a plan can have, by its name or by its number in the thesis (1, 100, 1000): its name, which stays; NULL: there is
 * none. And all names, as a list for people. */
const char *tl_twin_solver_named(const char *name);
const char *tl_twin_solver_numbered(int number);
const char *tl_twin_solver_names(void);

/* Checks the plan, reports every problem, and builds the twin: instantiates the FMUs and sets their
 * parameters. NULL when anything was reported. The plan itself need not outlive the call. */
tl_twin *tl_twin_build(const tl_plan *plan, tl_report *report);

/* Ends and frees the FMUs and the twin. NULL is allowed. */
void tl_twin_destroy(tl_twin *twin);

/* One tick. `sample->tick` must be one more than at the call before (0 at the first).
 * Sets *ready and fills `record` where a step's record has become complete.
 * Errors: TL_FMU_FAILED or TL_FMU_FATAL where initialisation or the committing step itself failed, or an FMU could not be
 *         rolled back; the twin is then over: every later call fails the same way and calls no FMU. In mode ahead the
 *         record of the step before may be ready all the same. */
tl_status tl_twin_step(tl_twin *twin, const tl_sample *sample, const tl_budget *budget, tl_record *record, bool *ready,
                       tl_error *error);

/* As tl_twin_step() for a tick that was missed: one step with nominal plus the last Δu (a Boolean: the last u), no
 * search. */
tl_status tl_twin_make_up(tl_twin *twin, const tl_sample *sample, tl_record *record, bool *ready, tl_error *error);

/* As tl_twin_make_up() for a tick of an earlier run, of whose step this u was committed: a value for each adjusted variable, of no
 * meaning where none is due at this tick; NULL where nothing is adjusted. The outcome is TL_FOLLOWED. */
tl_status tl_twin_follow(tl_twin *twin, const tl_sample *sample, const double *u, tl_record *record, bool *ready,
                         tl_error *error);

/* Brings a twin back that is lost: before the step of the next tick, however that comes about, all FMUs begin anew with their start values at
 * that step's instant, with what the plant shows then and with nominal u; the solver knows nothing, no Δu is left, and an event horizon's
 * stroke or search under way is given up (TL_FLAG_ABANDONED). Samples, what the filters of the measurements know, the measured delay, metrics,
 * ledger and the numbers of steps go on. The step's record has TL_FLAG_RESET. If no step is due at the next tick, the FMUs have their start
 * values: then nothing happens.
 * Calls:  of each FMU fmi2Reset and what initialises it, as at the start. One that refuses fmi2Reset gives back its saved states, is freed and
 *         instantiated anew, and so are all if their initialisation fails then. No budget is for it: the tick takes as long as that takes.
 * Errors: none here. The next tick's are TL_FMU_FAILED where that fails as well, TL_FMU_FATAL where an FMU was fatal. */
void tl_twin_reset(tl_twin *twin);

/* What has become of it: how it is led back from now on. */
typedef enum tl_twin_mended {
    TL_MENDED_NOT,       /* as before */
    TL_MENDED_BY_MEMORY, /* by a copy of its memory, and not by its own states */
    TL_MENDED_BY_STATES, /* by its own states, which a copy was faster than */
    TL_MENDED            /* how many there are */
} tl_twin_mended;

/* What tl_twin_verify() has found: an FMU does not come back to where it was. */
typedef struct tl_twin_finding {
    const char *component;
    const char *variable;   /* the output that is not the same; NULL: the FMU failed when it executed the step again */
    const char *unit;       /* of it; "": none is declared */
    int64_t step;           /* that was executed again, */
    unsigned after;         /* the how manieth since the state that it was led back to */
    double committed;       /* value then, */
    double again;           /* and when it was executed again */
    double tolerances;      /* that these are apart, of a match; NaN: the variable is not matched */
    tl_restore_cause cause; /* as far as it was found out */
    tl_twin_mended mended;
} tl_twin_finding;

/* Between two ticks, in the time that is left: goes on with looking whether the FMUs still come back to where they were (sync/verifier.h). `budget`: time from `started`
 * on within which it must be done, by the clock `now` (NULL: there is none, and time enough). *found: `finding` says what. Then the next step's record has
 * TL_FLAG_DIFFERED; and those of all after it, unless the finding is mended or makes less than a hundredth of a tolerance.
 * Cause:  without a clock it is also found out in which way that FMU does not come back, if there is a copy of all that it knows; with the calls that this takes.
 * Calls:  of one FMU at most fmi2SetFMUstate twice, fmi2GetFMUstate twice, and TL_VERIFIED_STEPS steps, which are not among the executions. Results are
 *         the same as without.
 * Errors: TL_FMU_FAILED, TL_FMU_FATAL if an FMU could not be brought to where it was; the twin is then over. */
tl_status tl_twin_verify(tl_twin *twin, const tl_budget *budget, tl_twin_finding *finding, bool *found,
                         tl_error *error);

/* In which way an FMU does not come back, for people: "incomplete state: …"; "": that is not known. */
const char *tl_twin_cause_text(tl_restore_cause cause);

/* Another tuning, from the next tick on, however that comes about: what the FMUs and the solver know, u, filters, metrics and ledger stay. A u that is
 * outside of new bounds is brought into them by the next search, as at a start; the bounds that the FMU declares hold as before. Of an event horizon a
 * search under way begins again. Before the first tick it is as if the twin had been built with it; the same tuning again changes nothing. Its time is
 * for who makes the budget. Costs no call of an FMU.
 * Errors: TL_BAD_DATA, and nothing is changed: a number that cannot be (tl_tuning_check()), or a twin that was built otherwise (tl_tuning_fits()). */
tl_status tl_twin_retune(tl_twin *twin, const tl_tuning *tuning, tl_error *error);

/* The one in force. */
void tl_twin_get_tuning(const tl_twin *twin, tl_tuning *tuning);

/* ---- to begin where an earlier run has ended: before the first tick, one of the two ---- */

/* The first sample is that of `tick` ≥ 0. The FMUs begin with their start values at that instant, or as many ticks later as older
 * values are looked up; so does the first step. */
void tl_twin_begin_at(tl_twin *twin, int64_t tick);

/* The twin as it was saved after `tick`: FMUs, values, samples, what the filters of the measurements know, u. The solver's head is
 * empty. The next tick is tick + 1. The FMUs are initialised for it.
 * Errors: TL_BAD_DATA where the bytes are not of such a twin at that tick; TL_FMU_FAILED, TL_FMU_FATAL where an FMU refuses.
 *         In any case the twin is of no use then but to be destroyed. */
tl_status tl_twin_load(tl_twin *twin, int64_t tick, const unsigned char *bytes, size_t size, tl_error *error);

/* Whether all FMUs say that they can turn their state into bytes. */
bool tl_twin_can_save(const tl_twin *twin);

/* The twin after the newest tick, to `bytes` (NULL: only how many there are). *size is how many it takes; above `capacity` they are
 * not written. 0: not at this tick, since an FMU would have to be executed again for it (TL_KEEP_OUTPUTS), or nothing has
 * begun. They are for the same program, machine and FMUs only; whoever keeps them sees to that, and to their integrity. Results of
 * the twin are the same as without saving.
 * Errors: TL_FMU_FAILED, TL_FMU_FATAL where an FMU refuses, or is not rolled back by its own states any more; the twin goes on, unless an FMU's state was lost or it was fatal. */
tl_status tl_twin_save(tl_twin *twin, unsigned char *bytes, size_t capacity, size_t *size, tl_error *error);

/* Between two ticks: forgets all that tl_twin_save() does not keep, so that every result from here on, effort, ledger and metrics included, is to the
 * bit that of a new twin which has loaded what is saved now. So a record can begin here, with a checkpoint, that a replay repeats. What executions take
 * is remembered. *done is false if nothing could be saved at this tick; then nothing was forgotten.
 * Calls:  of each FMU fmi2SetFMUstate at most, no step. An FMU that cannot turn its state into bytes is none the worse.
 * Errors: TL_FMU_FAILED, TL_FMU_FATAL if an FMU refuses; the twin is then over. */
tl_status tl_twin_forget(tl_twin *twin, bool *done, tl_error *error);

/* Completes the last record in mode ahead with the sample that follows, without a step. */
void tl_twin_finish(tl_twin *twin, const tl_sample *sample, tl_record *record, bool *ready);

tl_twin_facts tl_twin_get_facts(const tl_twin *twin);

/* Executions of component k so far, and its name; the plant is the last one. */
uint64_t tl_twin_executions(const tl_twin *twin, size_t component);
const char *tl_twin_component_name(const tl_twin *twin, size_t component);

/* Executions predicted and done of component k. Where nothing is adjusted, all that is predicted is one a step. */
tl_twin_ledger tl_twin_get_ledger(const tl_twin *twin, size_t component);

/* False: more candidates were tried than the ledger remembers, and what it predicted is too high. */
bool tl_twin_ledger_is_complete(const tl_twin *twin);

tl_twin_adjusted tl_twin_get_adjusted(const tl_twin *twin, size_t adjust);

/* What is measured of Δo, less Δi where inputs are shifted. */
tl_twin_delay tl_twin_get_delay(const tl_twin *twin);

/* MSE and MAX of match m over the records so far (eq. 5.2, 5.3). */
const tl_metrics *tl_twin_metrics(const tl_twin *twin, size_t match);

/* The same of the twin between its steps against the plant's readings as they came (reading_meter.h): `left_out` were rejected. Without pairs if the output is
 * no Real, of an event horizon, or if nothing shows the readings. */
const tl_metrics *tl_twin_readings(const tl_twin *twin, size_t match);

/* The value of output i of the plan's `outputs`, as of the newest committed step. */
double tl_twin_output(const tl_twin *twin, size_t output);

/* What an FMU has given in the newest committed step: an output that is connected, matched or read. */
typedef struct tl_twin_value {
    const char *component;
    const char *variable;
    double value; /* whole numbers and Booleans as such */
} tl_twin_value;

/* Of value i < tl_twin_value_count(); false: it is one that no FMU gives. */
size_t tl_twin_value_count(const tl_twin *twin);
bool tl_twin_get_value(const tl_twin *twin, size_t i, tl_twin_value *value);

/* Units as the FMU declares them, "" where it does not. */
const char *tl_twin_match_unit(const tl_twin *twin, size_t match);
const char *tl_twin_adjust_unit(const tl_twin *twin, size_t adjust);

#endif
