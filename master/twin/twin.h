/* Twin: the public interface of the master. Live run, replay, shadow and tests use this same code.
 *
 * Purpose: takes a sample of the plant and a budget per tick, commits a step and returns its
 *          record.
 * Method:  algorithm 3 of the thesis, with the decisions in docs/decisions/README.md.
 * Ticks:   the sample of tick m is the plant at t_m. Tick 0 is t_start and initialises the FMUs.
 *            lag:   tick m ≥ T_P + D computes step i = m − T_P − D; its record is complete at once.
 *            hold:  tick m ≥ 1 + D computes step i = m − 1 − D; complete at once. So does mode lag
 *                   with an event horizon.
 *            ahead: tick m computes step i = m; its record is complete at tick m + 1.
 *          D is the number of ticks until the inputs (tl_plan.input_ticks) and the measurements
 *          (output_ticks, which includes the delay of filters) of an instant have arrived: the
 *          larger of the two, at least 0. If the delay of the outputs (Δo) is measured and used, D
 *          is large enough for the longest possible delay. If input_ticks > 0, the FMUs are
 *          initialised at tick input_ticks; otherwise, and in mode ahead, at tick 0.
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

/* Facts of a built twin, for `check`, `--json` and the recorder. Texts are valid as long as the
 * twin. */
typedef struct tl_twin_facts {
    size_t components;                  /* K, the plant included */
    uint32_t prediction;                /* T_P in use; with an event horizon (event_horizon.h) the largest T_P */
    uint32_t distance;                  /* T_D: the smallest of all pairs; 0 if nothing is adjusted */
    uint32_t lead;                      /* step i is computed at tick i + lead */
    tl_experiment experiment;           /* the times in use; stop_s is above start_s, also if none was configured */
    int64_t first;                      /* first step of this twin: 0, or later after tl_twin_begin_at() */
    size_t unknowns;                    /* number of unknowns of a search */
    const char *algorithm;              /* the solver in use; "" if nothing is adjusted */
    const char *fallback;               /* "" if there is none */
    size_t memory;                      /* bytes of the master, all allocated at start-up */
    uint64_t state_memory;              /* bound for the FMUs' saved states, bytes; 0: not started, or not known */
    uint64_t executions_per_step;       /* of a step without search: K */
    uint64_t executions_per_evaluation; /* without saving: K·T_P */
    bool returns;                       /* started, and the rollback of all FMUs was proved */
    bool rollback_inexact;              /* the proof has failed: the rollback of an FMU is not exact */
    const char *inexact_component;      /* the component for which it failed; NULL: none, or not known */
    uint64_t proved_executions;         /* executions of the proof; no other count includes them */
    const char
        *runs_free; /* the twin runs free, because this component cannot be rolled back; NULL: it does not run free */
    uint64_t verified;            /* number of verifications (tl_twin_verify()) */
    uint64_t verified_executions; /* executions for them; no other count includes them */
    uint64_t differed;            /* verifications that found a difference */
    bool has_free_twin;           /* the free-run check is on; before the start: it is configured */
    tl_free_twin_counts free_twin;
    tl_released_state released_state; /* may change during the first steps */
    uint32_t released_steps;          /* R: steps of a release */
    tl_time released_time; /* ns per step for both released twins, measured in their first steps; 0: not known */
    tl_released_counts released;
    bool structure; /* does not execute what cannot reach a matched output (approach 1 of the dissertation) */
    bool sequences; /* does not execute an input sequence whose result is cached (its approach 2) */
} tl_twin_facts;

/* One component in the execution ledger, which predicts and counts executions (ledger.h). The plant
 * is the last one. */
typedef struct tl_twin_ledger {
    const char *name;
    uint32_t reach;  /* Γ_k: number of steps of an evaluation in which it can reach a matched output (eq. 4.5) */
    bool reads_late; /* its outputs cannot be read in initialisation mode, so they are read after it */
    bool on_path;    /* on a path from an adjusted variable to a matched output */
    uint32_t longer; /* C_k: extra length of the path through it over the shortest path; 0: on no path */
    tl_keep keep;    /* results that its cache keeps; without a cache TL_KEEP_NONE, but TL_KEEP_AUTO before the start */
    uint32_t first_need;   /* maximum executions of a step's first evaluation, with the configured saving */
    uint32_t next_need;    /* maximum executions of each later evaluation (eq. 4.13) */
    uint32_t nodes;        /* nodes of its cache; 0: no cache */
    uint64_t nodes_worst;  /* maximum number of nodes that could be needed at once */
    uint32_t nodes_peak;   /* maximum number of nodes used at once so far */
    size_t memory;         /* bytes of the nodes, part of the facts' memory; without the FMU's states */
    size_t state_size;     /* bytes of one saved state of the FMU; 0: not started, or not known */
    uint32_t states;       /* maximum number of nodes with a state; 0: not started */
    uint64_t plain;        /* executions if nothing were saved */
    uint64_t predicted;    /* executions that the ledger predicts for the same evaluations */
    uint64_t executions;   /* executions done */
    uint64_t repeated;     /* executions repeated so that an FMU catches up (TL_KEEP_OUTPUTS) */
    tl_fmi2_replay replay; /* rollback by replay: no other count includes its steps; zeroed: not used */
    uint64_t uncached;     /* results that the full cache did not store; their repetition is not predicted */
    /* executions − predicted − repeated. Positive: the cache was full, or a failed committed step
     * was repeated. Negative: another u gave the same inputs, or the ledger is not complete. Else
     * 0. */
    int64_t difference;
    /* ns of one execution, including the save of its state: the longest recent one, decaying; 0
     * without a clock. */
    tl_time cost;
} tl_twin_ledger;

/* Search range of an adjusted variable. */
typedef struct tl_twin_adjusted {
    bool is_real; /* else Boolean, and the values below are undefined */
    bool is_fed;  /* a connection delivers û: `nominal` is undefined */
    double nominal;
    double step;
    double lower; /* bounds of the search, within those of the FMU */
    double upper;
    double least; /* bounds that the FMU declares; ∓infinity: none */
    double most;
    double size; /* usual size that the FMU declares (its attribute `nominal`); 1: none */
} tl_twin_adjusted;

/* Measured delay: that of the first matched output whose delay is known. */
typedef struct tl_twin_delay {
    tl_delay_state state;
    tl_time delay;     /* ns, in use: y(t) is compared with ŷ(t − delay), in whole steps; 0 if not known */
    double confidence; /* 0 … 1, of the present measurement */
} tl_twin_delay;

/* Find a solver by name, or by its number in the thesis (1, 100, 1000). Return its name, a static
 * text, or NULL if there is none. tl_twin_solver_names() returns all names for messages. */
const char *tl_twin_solver_named(const char *name);
const char *tl_twin_solver_numbered(int number);
const char *tl_twin_solver_names(void);

/* Checks the plan, reports every problem, and builds the twin: instantiates the FMUs and sets their
 * parameters. Returns NULL if a problem was reported. The plan itself may be freed afterwards, but
 * not the models, functions and texts that it points to (see plan.h). */
tl_twin *tl_twin_build(const tl_plan *plan, tl_report *report);

/* Terminates and frees the FMUs and the twin. NULL is allowed. */
void tl_twin_destroy(tl_twin *twin);

/* Executes one tick. `sample->tick` must be one more than in the call before (0 at first). Sets
 * *ready and fills `record` if a step's record is complete.
 * Errors: TL_FMU_FAILED or TL_FMU_FATAL if initialisation or the committed step failed, or if an
 *         FMU could not be rolled back. Then every later call fails in the same way and calls no
 *         FMU. In mode ahead, *ready may be true with an error: the record of the step before. */
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

/* Resets a lost twin at the next tick, before the step of that tick (also if it has no search). All
 * FMUs restart with their start values at the step's instant, with the plant's sample and nominal
 * u. The solver starts without learned data, and the last Δu is dropped. With an event horizon, the
 * stroke (motion up to the event) or search in progress is abandoned (TL_FLAG_ABANDONED). Samples,
 * filters, the measured delay, metrics, ledger and step numbers continue. Otherwise the twin
 * computes the same bits as one that starts there. The step's record has TL_FLAG_RESET. If no step
 * is due at the next tick, the FMUs still have their start values: then nothing happens.
 * Calls:  fmi2Reset of each FMU, and its initialisation. If an FMU rejects fmi2Reset, its states
 *         are freed, and it is instantiated again. If the initialisation then fails, all FMUs are
 *         instantiated again. No budget applies to this tick.
 * Errors: none here. The next tick returns TL_FMU_FAILED or TL_FMU_FATAL if the reset failed. */
void tl_twin_reset(tl_twin *twin);

/* True until the FMUs have their start values from the plant (twin/start_values.h): one of the next
 * ticks may reset the FMUs, or execute the first steps many times. */
bool tl_twin_is_starting(const tl_twin *twin);

/* `rests` true: from the next step on u stays at nominal, and nothing is searched. This ends with a
 * call with false, a reset, another tuning, or a finding of tl_twin_verify(). No effect with an
 * event horizon. */
void tl_twin_rest(tl_twin *twin, bool rests);

/* In a replay, before each tick: `end` is TL_FLAG_RELEASED_SLOW of the recorded step of this tick.
 * True: the released twins end for good after this step. */
void tl_twin_end_released(tl_twin *twin, bool end);

/* How an FMU is rolled back after a finding of tl_twin_verify(). */
typedef enum tl_twin_repaired {
    TL_REPAIRED_NOT,       /* by the same method as before */
    TL_REPAIRED_BY_MEMORY, /* by a copy of its memory, not by its own states any more */
    TL_REPAIRED_BY_STATES, /* by its own states, which the copy had replaced because it was faster */
    TL_REPAIRED_COUNT      /* number of values */
} tl_twin_repaired;

/* A finding of tl_twin_verify(): the rollback of an FMU is not exact. */
typedef struct tl_twin_finding {
    const char *component;
    const char *variable;   /* the output that differs; NULL: an internal one, or the FMU failed */
    const char *unit;       /* of the output; "": none is declared */
    int64_t step;           /* the step that was executed again */
    unsigned after;         /* number of steps since the restored state */
    double committed;       /* value of the committed step */
    double again;           /* value of the repeated step */
    double tolerances;      /* difference of the two values in tolerances, if the output is matched; else NaN */
    tl_restore_cause cause; /* TL_CAUSE_UNKNOWN if not determined */
    tl_twin_repaired mended;
} tl_twin_finding;

/* Between two ticks, in the remaining time: continues the verification of rollbacks
 * (sync/verifier.h). `budget`: `time` ns from `started` on, by the clock `now`; NULL: no limit.
 * *found: there is a finding. Then the record of the next step has TL_FLAG_DIFFERED. All later
 * records have it too, unless the FMU is now rolled back by another method (`mended`) or the
 * difference is less than a hundredth of a tolerance.
 * Cause:  without a clock, the cause is determined too if there is a full copy of the FMU. This
 *         takes additional calls.
 * Calls:  of one FMU at most five fmi2SetFMUstate, three fmi2GetFMUstate, and
 *         TL_VERIFIED_EXECUTIONS steps, which do not count as executions. Results do not change.
 * Errors: TL_FMU_FAILED or TL_FMU_FATAL if an FMU could not be restored; then the twin has
 *         ended. */
tl_status tl_twin_verify(tl_twin *twin, const tl_budget *budget, tl_twin_finding *finding, bool *found,
                         tl_error *error);

/* Description of a cause: "incomplete state: …"; "" if it is unknown. */
const char *tl_twin_cause_text(tl_restore_cause cause);

/* Applies a tuning from the next tick on, also if that tick has no search. States of the FMUs, data
 * of the solver, u, filters, metrics and ledger stay. If u is outside of new bounds, the next
 * search moves it inside. The declared bounds of the FMU still apply. A search of an event horizon
 * restarts. A call before the first tick has the same effect as building the twin with the tuning.
 * Applying the same tuning again changes nothing. The twin does not use `time` of the tuning: the
 * caller puts it into its budgets. Calls no FMU.
 * Errors: TL_BAD_DATA, without any change: an invalid number (tl_tuning_check()), or a twin that
 *         was built differently (tl_tuning_fits()). */
tl_status tl_twin_retune(tl_twin *twin, const tl_tuning *tuning, tl_error *error);

/* The tuning in use. */
void tl_twin_get_tuning(const tl_twin *twin, tl_tuning *tuning);

/* ---- Start where an earlier run ended. Before the first tick, call tl_twin_begin_at() or
 * tl_twin_load(). */

/* Cold start: the first sample will be that of `tick` ≥ 0. The FMUs start with their start values
 * at the instant of that tick. If `tick` > 0 and the twin uses samples of up to n ticks earlier
 * (negative input_ticks or output_ticks), the FMUs and the first step start n ticks later. */
void tl_twin_begin_at(tl_twin *twin, int64_t tick);

/* Call before tl_twin_begin_at() or tl_twin_load(): sets the FMUs' time at tick 0, s, to that of
 * the earlier run. The stop time moves by the same amount. */
void tl_twin_set_start(tl_twin *twin, double start_s);

/* Loads a twin that was saved after `tick`: FMUs, values, samples, filters of the measurements, u.
 * The solver starts without learned data. The next tick is `tick` + 1. Initialises the FMUs before
 * their states are loaded.
 * Errors: TL_BAD_DATA if the bytes are not of such a twin at that tick; TL_FMU_FAILED, TL_FMU_FATAL
 *         if an FMU rejects its state. After any error the twin can only be destroyed. */
tl_status tl_twin_load(tl_twin *twin, int64_t tick, const unsigned char *bytes, size_t size, tl_error *error);

/* Returns true if all FMUs declare that they can serialise their state. */
bool tl_twin_can_save(const tl_twin *twin);

/* Saves the twin after the newest tick to `bytes`; NULL: only computes the size. *size: number of
 * bytes; if it is above `capacity`, the bytes are invalid. 0: not possible at this tick, because an
 * FMU would have to be executed again (TL_KEEP_OUTPUTS) or because the twin has not started. The
 * bytes are valid only for the same program, machine and FMUs. The caller must check this, and that
 * the bytes are undamaged. Saving changes no result.
 * Errors: TL_FMU_FAILED or TL_FMU_FATAL if an FMU rejects the call, or is not rolled back by its
 *         own states any more. The twin can continue, unless an FMU's state was lost or the error
 *         was fatal. */
tl_status tl_twin_save(tl_twin *twin, unsigned char *bytes, size_t capacity, size_t *size, tl_error *error);

/* Between two ticks: drops all data that tl_twin_save() does not save. From then on every result is
 * bit-identical to that of a new twin that loads the present state. This includes executions,
 * ledger and metrics. So a recording can start here with a checkpoint, and a replay gives the same
 * results. Measured costs of executions stay. *done is false if the twin could not be saved at this
 * tick. Then nothing was dropped.
 * Calls:  of each FMU at most one fmi2SetFMUstate, and no step. FMUs that cannot serialise their
 *         states are allowed.
 * Errors: TL_FMU_FAILED or TL_FMU_FATAL if an FMU rejects the call; then the twin has ended. */
tl_status tl_twin_forget(tl_twin *twin, bool *done, tl_error *error);

/* Only for mode ahead, at the end of a run: completes the last record with the next sample and
 * executes no step. *ready is true if there was such a record. */
void tl_twin_finish(tl_twin *twin, const tl_sample *sample, tl_record *record, bool *ready);

tl_twin_facts tl_twin_get_facts(const tl_twin *twin);

/* Permitted values of a plant signal, in the signal's unit: the intersection of the ranges that the
 * inputs reading it declare. least > most if there is no common value. */
typedef struct tl_twin_bounds {
    double least, most;            /* ∓infinity: none */
    double scale;                  /* largest nominal value of the inputs that declare a bound; 0: no input does */
    uint64_t items;                /* Enumeration: bit k: `least` + k is an item; 0: all values within the bounds */
    const char *component, *input; /* the first input that declares a bound; NULL: none */
} tl_twin_bounds;

tl_twin_bounds tl_twin_get_bounds(const tl_twin *twin, size_t signal);

/* Return the executions of a component so far (candidates included), and its name; the plant is the
 * last component. */
uint64_t tl_twin_executions(const tl_twin *twin, size_t component);
const char *tl_twin_component_name(const tl_twin *twin, size_t component);

/* Returns predicted and counted executions of a component. If nothing is adjusted, the prediction
 * is one per step. */
tl_twin_ledger tl_twin_get_ledger(const tl_twin *twin, size_t component);

/* Adjusted variables that cannot be identified, over the last TL_SENSITIVITY_TESTS searches
 * (sync/sensitivity.h). Bits by adjusted variable. */
typedef struct tl_twin_identifiability {
    uint32_t unseen; /* no matched output reacts */
    uint32_t alike;  /* their effects on the matched outputs are parallel: only a sum is known */
    int64_t since;   /* step from which `alike` holds */
} tl_twin_identifiability;

tl_twin_identifiability tl_twin_get_identifiability(const tl_twin *twin);

/* Returns bit k = 1 if component k keeps no results, by its configuration (`keep`) or by the
 * measured choice. Is 0 before the start, and for components from TL_TWIN_UNSAVED on, which keep
 * states if they have the choice. */
enum { TL_TWIN_UNSAVED = 64 };
uint64_t tl_twin_unsaved(const tl_twin *twin);

/* Returns false if there were more candidates than the ledger can store: then its prediction is too
 * high. */
bool tl_twin_ledger_is_complete(const tl_twin *twin);

tl_twin_adjusted tl_twin_get_adjusted(const tl_twin *twin, size_t adjust);

/* The measured delay of the outputs (Δo); if the inputs are shifted, minus their delay Δi. */
tl_twin_delay tl_twin_get_delay(const tl_twin *twin);

/* Returns MSE and MAX of output `match` over the records so far (eq. 5.2, 5.3). */
const tl_metrics *tl_twin_metrics(const tl_twin *twin, size_t match);

/* The same of the older released twin (sync/released_twin.h). */
const tl_metrics *tl_twin_released(const tl_twin *twin, size_t match);

/* The same at the instants of the plant's readings, with y interpolated between the twin's steps
 * (reading_meter.h). `left_out` counts rejected readings. Nothing is compared (`pairs` is 0) if the
 * output is not Real, if there is an event horizon, or if there are no readings. */
const tl_metrics *tl_twin_readings(const tl_twin *twin, size_t match);

/* The value of output i of the plan's `outputs` in the newest committed step. */
double tl_twin_output(const tl_twin *twin, size_t output);

/* An output of an FMU in the newest committed step: connected, matched or read. */
typedef struct tl_twin_value {
    const char *component;
    const char *variable;
    double value; /* integers and Booleans as numbers */
} tl_twin_value;

/* Returns value i, i < tl_twin_value_count(). Returns false if it is not an output of an FMU. */
size_t tl_twin_value_count(const tl_twin *twin);
bool tl_twin_get_value(const tl_twin *twin, size_t i, tl_twin_value *value);

/* Units as the FMU declares them; "" if there is none. */
const char *tl_twin_match_unit(const tl_twin *twin, size_t match);
const char *tl_twin_adjust_unit(const tl_twin *twin, size_t adjust);

#endif
