/* Twin: the public interface of the master. Live run, replay, shadow and tests use this same code.
 *
 * Purpose: takes a sample of the plant and a budget, returns a committed step and its record.
 * Method:  algorithm 3 of the thesis, with the decisions in docs/decisions/README.md.
 * Ticks:   the sample of tick m is the plant at t_m. Tick 0 is t_start and initialises the FMUs.
 *            lag:   tick m ≥ T_P + D computes step i = m − T_P − D; its record is complete at once.
 *                   D is the delay of conditioned measurements, 0 without any.
 *            hold:  tick m ≥ 1 + D computes step i = m − 1 − D; complete at once.
 *            ahead: tick m computes step i = m; its record is complete when the sample m + 1 has
 *                   come.
 *          D grows by the larger of the plan's input_ticks and output_ticks, if they are positive.
 *          The FMUs are then initialised at tick input_ticks, with the plant at t_0 (in mode ahead
 *          at tick 0). If Δo is measured, a step waits for the longest possible delay.
 * Memory:  tl_twin_build() allocates everything; our code allocates nothing afterwards.
 * Thread:  one thread at a time uses a twin.
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
    uint32_t prediction;                /* T_P in use; of an event horizon, the largest */
    uint32_t distance;                  /* T_D: the smallest of all pairs; 0 if nothing is adjusted */
    uint32_t lead;                      /* step i is computed at tick i + lead */
    tl_experiment experiment;           /* in use: stop_s is above start_s */
    int64_t first;                      /* first step, past or future: 0, or later after tl_twin_begin_at() */
    size_t unknowns;                    /* of a search */
    const char *algorithm;              /* the solver in use; "" if nothing is adjusted */
    const char *fallback;               /* "" if there is none */
    size_t memory;                      /* bytes of ours, all allocated at start-up */
    uint64_t state_memory;              /* most bytes of the FMUs' saved states; 0: not started, or not known */
    uint64_t executions_per_step;       /* K: of a step without search */
    uint64_t executions_per_evaluation; /* K·T_P: if nothing were saved */
    bool returns;                       /* started, and the rollback of all FMUs was proved */
    bool cannot_return;                 /* the rollback of an FMU was found not to be exact */
    const char *astray;                 /* the component in question; NULL: none, or not known */
    uint64_t proved_executions;         /* executions of the proof; no other count includes them */
    const char *
        runs_free; /* the component that cannot be rolled back by replay any more, so that the twin runs free; NULL: none */
    uint64_t verified;            /* number of verifications (tl_twin_verify()) */
    uint64_t verified_executions; /* executions for them; no other count includes them */
    uint64_t differed;            /* verifications that found a difference */
    bool has_free_twin;           /* the free-run check is on, or configured if not started */
    tl_free_twin_counts free_twin;
    bool structure; /* kinds of saving in use */
    bool sequences;
} tl_twin_facts;

/* One component in the ledger; the plant is the last one. */
typedef struct tl_twin_ledger {
    const char *name;
    uint32_t reach;       /* Γ_k (eq. 4.5) */
    bool reads_late;      /* it refuses to be read in initialisation mode */
    bool on_a_way;        /* on a path from an adjusted variable to a matched output */
    uint32_t longer;      /* C_k, on such a path */
    uint32_t first_need;  /* most executions of a step's first evaluation, as saved */
    uint32_t next_need;   /* of each later one (eq. 4.13) */
    uint32_t nodes;       /* of its cache; 0: none */
    uint64_t nodes_worst; /* that could be needed at once */
    uint32_t nodes_peak;  /* most used so far */
    size_t memory;        /* bytes of ours for them, part of the facts' memory; the FMU's states come on top */
    size_t
        state_size; /* bytes of one saved state of the FMU, and the number of nodes that may have one; 0: not started, or not known */
    uint32_t states;
    uint64_t plain;        /* executions if nothing were saved */
    uint64_t predicted;    /* by the graph for the same evaluations */
    uint64_t executions;   /* done */
    uint64_t repeated;     /* executions repeated so that an FMU catches up (TL_KEEP_OUTPUTS) */
    tl_fmi2_replay replay; /* rollback by replay: no other count includes its steps; zeroed: not used */
    uint64_t uncached;     /* results that found no room; their repetition is not predicted */
    int64_t
        difference; /* executions that were neither predicted nor to catch up. Positive: results found no room, or a failed committed step was repeated. Negative: another u gave the same inputs, or the ledger is not complete. Else 0 */
    tl_time
        cost; /* ns of one execution, including the save of its state: the last, or a longer earlier one, decaying; 0 without a clock */
} tl_twin_ledger;

/* Search range of an adjusted variable. */
typedef struct tl_twin_adjusted {
    bool is_real; /* else Boolean, and the values below are undefined */
    bool is_fed;  /* a connection delivers û: `nominal` is undefined */
    double nominal;
    double step;
    double lower;
    double upper;
    double least; /* declared by the FMU; the bounds are within */
    double most;
} tl_twin_adjusted;

/* Measured delay: of the first matched output with a confident one. */
typedef struct tl_twin_delay {
    tl_delay_state state;
    tl_time delay;     /* in use: ŷ is looked up this long before y, in whole steps; 0 if not known */
    double confidence; /* 0 … 1, of the present measurement */
} tl_twin_delay;

/* The name of a solver, found by name or by its number in the thesis (1, 100, 1000); valid for
 * ever; NULL: there is none. The third function lists all names for messages. */
const char *tl_twin_solver_named(const char *name);
const char *tl_twin_solver_numbered(int number);
const char *tl_twin_solver_names(void);

/* Checks the plan, reports every problem, and builds the twin: instantiates the FMUs and sets their
 * parameters. NULL if anything was reported. The plan itself need not outlive the call. */
tl_twin *tl_twin_build(const tl_plan *plan, tl_report *report);

/* Terminates and frees the FMUs and the twin. NULL is allowed. */
void tl_twin_destroy(tl_twin *twin);

/* Executes one tick. `sample->tick` must be one more than in the call before (0 at first). Sets
 * *ready and fills `record` if a step's record is complete.
 * Errors: TL_FMU_FAILED or TL_FMU_FATAL if initialisation or the committed step failed, or if an
 *         FMU could not be rolled back. Then every later call fails in the same way and calls no
 *         FMU. In mode ahead the record of the step before may still be ready. */
tl_status tl_twin_step(tl_twin *twin, const tl_sample *sample, const tl_budget *budget, tl_record *record, bool *ready,
                       tl_error *error);

/* As tl_twin_step() for a missed tick: one step without search, with nominal plus the last Δu (a
 * Boolean: the last u). */
tl_status tl_twin_catch_up(tl_twin *twin, const tl_sample *sample, tl_record *record, bool *ready, tl_error *error);

/* As tl_twin_catch_up() for a tick of an earlier run with its committed u: a value for each
 * adjusted variable, undefined if no step is due at this tick; NULL if nothing is adjusted. The
 * outcome is TL_RESUMED. */
tl_status tl_twin_follow(tl_twin *twin, const tl_sample *sample, const double *u, tl_record *record, bool *ready,
                         tl_error *error);

/* Resets a lost twin: before the step of the next tick, of any kind, all FMUs restart with their
 * start values at that step's instant, with the plant's sample and nominal u. The solver starts
 * empty, the last Δu is dropped, and a stroke or search of an event horizon is abandoned
 * (TL_FLAG_ABANDONED). Samples, filters, the measured delay, metrics, ledger and step numbers
 * continue. The step's record has TL_FLAG_RESET. If no step is due at the next tick, the FMUs still
 * have their start values: then nothing happens.
 * Calls:  of each FMU fmi2Reset and its initialisation. If an FMU rejects fmi2Reset, its states are
 *         freed and it is instantiated again; so are all if their initialisation then fails. No
 *         budget applies to this tick.
 * Errors: none here. The next tick returns TL_FMU_FAILED if that fails as well, or TL_FMU_FATAL. */
void tl_twin_reset(tl_twin *twin);

/* How an FMU is rolled back after a finding. */
typedef enum tl_twin_mended {
    TL_MENDED_NOT,         /* as before */
    TL_REPAIRED_BY_MEMORY, /* by a copy of its memory, not by its own states any more */
    TL_REPAIRED_BY_STATES, /* by its own states, which the copy had replaced because it was faster */
    TL_MENDED              /* number of values */
} tl_twin_mended;

/* A finding of tl_twin_verify(): the rollback of an FMU is not exact. */
typedef struct tl_twin_finding {
    const char *component;
    const char *variable;   /* the output that differs; NULL: the FMU failed */
    const char *unit;       /* of the output; "": none is declared */
    int64_t step;           /* the step that was executed again */
    unsigned after;         /* number of steps since the restored state */
    double committed;       /* value of the committed step */
    double again;           /* value of the repeated step */
    double tolerances;      /* their distance in tolerances, for a matched output; else NaN */
    tl_restore_cause cause; /* TL_CAUSE_UNKNOWN if not determined */
    tl_twin_mended mended;
} tl_twin_finding;

/* Between two ticks, in the remaining time: continues the verification of rollbacks
 * (sync/verifier.h). `budget`: time from `started` by the clock `now` (NULL: no limit). *found:
 * there is a finding. Then the record of the next step has TL_FLAG_DIFFERED. All later records have
 * it too, unless the finding is mended or is less than a hundredth of a tolerance.
 * Cause:  without a clock the cause is determined too, if there is a full copy of the FMU; this
 *         takes additional calls.
 * Calls:  of one FMU at most fmi2SetFMUstate twice, fmi2GetFMUstate twice, and TL_VERIFIED_STEPS
 *         steps, which do not count as executions. Results do not change.
 * Errors: TL_FMU_FAILED, TL_FMU_FATAL if an FMU could not be restored; then the twin has ended. */
tl_status tl_twin_verify(tl_twin *twin, const tl_budget *budget, tl_twin_finding *finding, bool *found,
                         tl_error *error);

/* Description of a cause: "incomplete state: …"; "" if it is unknown. */
const char *tl_twin_cause_text(tl_restore_cause cause);

/* Applies a tuning from the next tick on, of any kind. All that FMUs and solver know, u, filters,
 * metrics and ledger stay. The next search brings a u outside of new bounds into them; the declared
 * bounds of the FMU still apply. A search of an event horizon restarts. Before the first tick it is
 * as if the twin had been built with the tuning; applying the same tuning again changes nothing.
 * Its time is for the caller's budget. Calls no FMU.
 * Errors: TL_BAD_DATA, without any change: an invalid number (tl_tuning_check()), or a twin that
 *         was built differently (tl_tuning_fits()). */
tl_status tl_twin_retune(tl_twin *twin, const tl_tuning *tuning, tl_error *error);

/* The tuning in use. */
void tl_twin_get_tuning(const tl_twin *twin, tl_tuning *tuning);

/* ---- Start where an earlier run ended: before the first tick, one of the two. */

/* The first sample is that of `tick` ≥ 0. The FMUs start with their start values at that instant,
 * or later by the ticks that a look-up goes back; so does the first step. */
void tl_twin_begin_at(tl_twin *twin, int64_t tick);

/* Before one of the two: the FMUs' time at tick 0, s, as it was in the run that is continued. The
 * stop time moves with it. */
void tl_twin_set_start(tl_twin *twin, double start_s);

/* Loads the twin as saved after `tick`: FMUs, values, samples, filters of the measurements, u. The
 * solver starts empty. The next tick is tick + 1. Initialises the FMUs.
 * Errors: TL_BAD_DATA if the bytes are not of such a twin at that tick; TL_FMU_FAILED, TL_FMU_FATAL
 *         if an FMU rejects its state. After any error the twin can only be destroyed. */
tl_status tl_twin_load(tl_twin *twin, int64_t tick, const unsigned char *bytes, size_t size, tl_error *error);

/* True if all FMUs declare that they can serialise their state. */
bool tl_twin_can_save(const tl_twin *twin);

/* Saves the twin after the newest tick to `bytes` (NULL: only the size). *size is the size; if it
 * is above `capacity`, nothing is written. 0: not possible at this tick, because an FMU would have
 * to be executed again for it (TL_KEEP_OUTPUTS), or because nothing has started. The bytes are
 * valid only for the same program, machine and FMUs; the caller checks that and their integrity.
 * Saving changes no result.
 * Errors: TL_FMU_FAILED, TL_FMU_FATAL if an FMU rejects it, or is not rolled back by its own states
 *         any more. The twin continues, unless an FMU's state was lost or the error was fatal. */
tl_status tl_twin_save(tl_twin *twin, unsigned char *bytes, size_t capacity, size_t *size, tl_error *error);

/* Between two ticks: drops all that tl_twin_save() does not keep. From then on every result, with
 * effort, ledger and metrics, is to the bit that of a new twin that loads the present state. So a
 * record can start here with a checkpoint, and a replay repeats it. Measured costs of executions
 * stay. *done is false if nothing could be saved at this tick; then nothing was dropped.
 * Calls:  of each FMU at most fmi2SetFMUstate, no step. An FMU that cannot serialise its state is
 *         not affected.
 * Errors: TL_FMU_FAILED, TL_FMU_FATAL if an FMU rejects it; then the twin has ended. */
tl_status tl_twin_forget(tl_twin *twin, bool *done, tl_error *error);

/* Completes the last record in mode ahead with the sample that follows, without a step. */
void tl_twin_finish(tl_twin *twin, const tl_sample *sample, tl_record *record, bool *ready);

tl_twin_facts tl_twin_get_facts(const tl_twin *twin);

/* Values of a signal of the plant that the inputs fed by it declare, in the signal's unit: their
 * intersection; least > most if they have no common value. */
typedef struct tl_twin_bounds {
    double least, most;            /* ∓infinity: none */
    double scale;                  /* the largest nominal value of these inputs; 0: no input declares a bound */
    uint64_t items;                /* of Enumerations: bit k: `least` + k is an item; 0: all values within the bounds */
    const char *component, *input; /* the first input that declares one; NULL: none */
} tl_twin_bounds;

tl_twin_bounds tl_twin_get_bounds(const tl_twin *twin, size_t signal);

/* Executions of component k so far, and its name; the plant is the last one. */
uint64_t tl_twin_executions(const tl_twin *twin, size_t component);
const char *tl_twin_component_name(const tl_twin *twin, size_t component);

/* Predicted and counted executions of component k. If nothing is adjusted, the prediction is one
 * per step. */
tl_twin_ledger tl_twin_get_ledger(const tl_twin *twin, size_t component);

/* False: there were more candidates than the ledger holds, and its prediction is too high. */
bool tl_twin_ledger_is_complete(const tl_twin *twin);

tl_twin_adjusted tl_twin_get_adjusted(const tl_twin *twin, size_t adjust);

/* The measured Δo, minus Δi if inputs are shifted. */
tl_twin_delay tl_twin_get_delay(const tl_twin *twin);

/* MSE and MAX of match m over the records so far (eq. 5.2, 5.3). */
const tl_metrics *tl_twin_metrics(const tl_twin *twin, size_t match);

/* The same at the plant's readings as they came, with the twin between its steps (reading_meter.h);
 * `left_out` were rejected. There are no pairs if the output is no Real, with an event horizon, or
 * without readings. */
const tl_metrics *tl_twin_readings(const tl_twin *twin, size_t match);

/* The value of output i of the plan's `outputs` in the newest committed step. */
double tl_twin_output(const tl_twin *twin, size_t output);

/* An output of an FMU in the newest committed step: connected, matched or read. */
typedef struct tl_twin_value {
    const char *component;
    const char *variable;
    double value; /* integers and Booleans as numbers */
} tl_twin_value;

/* Value i < tl_twin_value_count(). Returns false if no FMU gives it. */
size_t tl_twin_value_count(const tl_twin *twin);
bool tl_twin_get_value(const tl_twin *twin, size_t i, tl_twin_value *value);

/* Units as the FMU declares them; "" if there is none. */
const char *tl_twin_match_unit(const tl_twin *twin, size_t match);
const char *tl_twin_adjust_unit(const tl_twin *twin, size_t adjust);

#endif
