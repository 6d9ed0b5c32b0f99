/* Private data of a twin.
 *
 * Purpose: shared by the .c files of a twin: ticks, build, checkpoint, test of saved states
 *          (twin_read_back.h), timing, re-runs, counts (account.h).
 * Owner:   the twin; everything is freed by tl_twin_destroy().
 */
#ifndef TL_MASTER_TWIN_TWIN_PARTS_H
#define TL_MASTER_TWIN_TWIN_PARTS_H

#include "master/base/arena.h"
#include "master/event/event_horizon.h"
#include "master/graph/exchange.h"
#include "master/graph/graph.h"
#include "master/measure/delay_meter.h"
#include "master/sync/free_twin.h"
#include "master/sync/proof.h"
#include "master/sync/released_twin.h"
#include "master/sync/synchroniser.h"
#include "master/sync/verifier.h"
#include "master/twin/reading_meter.h"
#include "master/twin/start_values.h"
#include "master/twin/twin.h"

struct tl_twin {
    tl_arena arena;
    tl_graph graph;
    tl_exchange exchange;
    bool rollback_inexact; /* the rollback proof has failed */
    tl_synchroniser synchroniser;
    tl_event_horizon *event; /* searches after an event, not in each step; NULL: the synchroniser searches */
    tl_objective_term terms[TL_MAX_MATCH];
    const tl_port *match_ports[TL_MAX_MATCH];
    const tl_port *adjust_ports[TL_MAX_ADJUST];
    uint32_t *capacity; /* nodes of each component's cache; NULL: no caches */
    uint64_t *worst;    /* maximum number of nodes that each cache could need at once */
    const tl_port *outputs[TL_MAX_SIGNALS];
    tl_metrics metrics[TL_MAX_MATCH];
    tl_metrics released[TL_MAX_MATCH];       /* see tl_twin_released() */
    tl_metrics readings[TL_MAX_MATCH];       /* see tl_twin_readings() */
    tl_metrics due[TL_MAX_MATCH];            /* the part of `readings` that is not in a record yet */
    tl_reading_meter *readers[TL_MAX_MATCH]; /* NULL: y is not Real, event horizon, or no readings */
    size_t reading_signals[TL_MAX_MATCH];    /* index of the plant signal with these readings */
    tl_time look_back;                       /* ns: age of matched values in a sample (tl_delay_lookup) */
    tl_pairing measurements;                 /* samples that a step is compared with: lag, hold or ahead */
    tl_plan_measure measure;                 /* how Δo is measured */
    tl_delay_meter *meters[TL_MAX_MATCH];    /* NULL: the output delay Δo is not measured */
    tl_time offsets[TL_MAX_MATCH];           /* ns: measured delay minus delay in use, at the first measurement */
    bool has_offset[TL_MAX_MATCH];
    uint32_t measured_age; /* release_age of the last y that `meters` got; 0: no y of a released twin */
    tl_twin_delay delay;
    tl_time step;             /* T_S, ns */
    tl_experiment experiment; /* in use */
    uint32_t lead;            /* ticks from the start of a step to its computation: step i at tick i + lead */
    uint32_t age;             /* ticks: values for t_j are looked up in samples of tick j − age and later */
    int64_t first;            /* number of the first step: the FMUs' time begins at its instant */
    int64_t begin;            /* tick of the initialisation: its sample has the inputs of step `first`; −1: loaded */
    uint64_t state_bytes;     /* bound for saved states, bytes; 0: no bound */
    size_t (*heap)(void);     /* bytes allocated in this process */
    tl_time (*now)(void *clock);
    tl_tuning built;  /* the tuning that the twin was built with */
    tl_tuning tuning; /* in use */
    tl_proof proof;
    uint64_t bad_at_start; /* as in a record: outputs that were not finite after the initialisation */
    tl_start_values starts;
    bool resets;      /* the FMUs must be reset before the next step */
    uint64_t unsaved; /* as tl_twin_unsaved() */
    const char
        *runs_free; /* the twin runs free, because this component cannot be rolled back; NULL: it does not run free */
    tl_verifier verifier;
    tl_free_twin free_twin;
    tl_released_twin released_twin;
    tl_snapshot mark;        /* state for re-runs (tl_twin_mark()); without components unless plan->may_rerun */
    int64_t mark_step;       /* first step after `mark` */
    bool is_marked;          /* `mark` is valid */
    tl_twin_finding finding; /* the newest finding; component NULL: none */
    uint32_t marks;          /* tl_flag bits for the next record only; unrelated to `mark` */
    uint32_t lasting;        /* tl_flag bits for all later records */
    tl_status ended;         /* not TL_OK: a step has failed, and no further step is allowed */
    bool has_pending;        /* mode ahead: `pending` is a computed step without its measurement */
    tl_record pending;
};

/* Initialises the FMUs at the instant of step `first` with this sample. If something is adjusted,
 * also proves their rollback. Does not start the caches (tl_exchange_start()).
 * Errors: TL_FMU_FAILED or TL_FMU_FATAL if an FMU fails, or if its rollback is not exact. */
tl_status tl_twin_start(tl_twin *twin, const tl_sample *sample, tl_error *error);

/* Defined in twin_reset.c: resets all FMUs (tl_twin_reset()) and initialises them at the instant of
 * `step` with `plant`, a value of each signal. States of side twins that cannot be kept end. */
tl_status tl_twin_restart(tl_twin *twin, int64_t step, const double *plant, tl_error *error);

/* Defined in twin_reset.c: frees a component's states that are kept beside those of the search. */
void tl_twin_end_other_states(tl_twin *twin, size_t component);

/* Defined in twin_timing.c. After the rollback proof and before tl_exchange_start(): replaces
 * TL_KEEP_AUTO of each component by TL_KEEP_STATES or TL_KEEP_NONE. If all components have
 * TL_KEEP_NONE, drops the caches; then the execution ledger (ledger.h) no longer compares
 * candidates. To measure a component, repeats the first step at most 16 times within 5 ms. Chooses
 * TL_KEEP_STATES without a measurement in three cases: there is no clock; the component is rolled
 * back by replay; some component can hold only one state. Errors: TL_FMU_FAILED or TL_FMU_FATAL if
 * a component cannot be restored. */
tl_status tl_twin_choose_keep(tl_twin *twin, tl_error *error);

/* Start values from the plant, defined in twin_starts.c. This one fills the component's list of
 * start values. The plan must be sound. Returns false if memory is out. */
bool tl_start_values_place(tl_twin *twin, const tl_plan *plan, size_t component);

/* Allocates the buffers, after the exchange is built. Returns false if memory is out. */
bool tl_start_values_create(tl_twin *twin, const tl_plan *plan);

/* Before the FMUs are initialised at the instant of `step` with this sample. `sets`: also passes
 * the values to the FMUs, which a reset does itself. */
tl_status tl_start_values_begin(tl_twin *twin, int64_t step, const tl_sample *sample, bool sets, tl_error *error);

/* After a checkpoint was loaded, with its `waits`. A search needs all steps from the start on, so
 * there is none until the next reset. */
void tl_start_values_loaded(tl_twin *twin, bool waits);

/* Call it once before each step while tl_twin_is_starting(). */
tl_start_due tl_start_values_look(tl_twin *twin, int64_t step);

/* Finds the values. Then all FMUs are at the instant of `step`, with these values and nominal u.
 * Errors: TL_FMU_FAILED if they fail also with the values of before; TL_FMU_FATAL. */
tl_status tl_start_values_find(tl_twin *twin, int64_t step, tl_record_found *found, tl_error *error);

/* Defined in twin_rerun.c: frees a component's state at the mark and makes the mark invalid. */
void tl_twin_end_mark(tl_twin *twin, size_t component);

/* True if some instance of this component's FMU has returned fmi2Fatal. By FMI, no instance of this
 * FMU may be called any more. */
bool tl_twin_has_dead_fmu(const tl_twin *twin, const tl_component *component);

#endif
