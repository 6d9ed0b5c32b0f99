/* Plan of a twin: components, connections, delays, matches.
 *
 * Thread:  any; it is only read.
 */
#ifndef TL_MASTER_PLAN_PLAN_H
#define TL_MASTER_PLAN_PLAN_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "master/base/signal.h"
#include "master/base/simtime.h"
#include "master/base/status.h"
#include "master/fmi/fmi2.h"
#include "master/fmi/model.h"
#include "master/fmi/rollback.h"
#include "master/fmi/units.h"

/* ---- Delays of signals through dead times and asynchronous cycles.
 *
 * Purpose: computes Δi and Δo, the delays of inputs and outputs (eq. 4.14, 4.15), from the model of
 *          asynchronous cycles (eq. 4.16).
 * Model:   a signal passes a chain of participants. Participants with the same time base are
 *          synchronous. Consecutive synchronous participants form a group. In a group of two or
 *          more, each dead time counts once. A link to another time base waits for the next cycle
 *          of its target. This delay is uniform over the target's cycle time, without dead time.
 *          The densities of the links are convolved.
 * Exact:   only the cycle times are stored, in whole nanoseconds. The density of a sum of uniforms
 *          is a piecewise polynomial; its breakpoints are sums of cycle times. It is evaluated by
 *          the recurrence of box splines. This recurrence has no negative term, so no digits cancel
 *          even if the cycles differ widely.
 * Mode:    the density of a sum of uniforms is symmetric and falls from its middle on. The largest
 *          cycle L, convolved with the density g of the others, gives (G(t) − G(t − L))/L with
 *          G = ∫g. S is the sum of the others. If L > S, this density has a plateau of 1/L from S
 *          to L, so the rightmost mode is L. Otherwise the density grows while g(t) > g(t − L), up
 *          to its middle (L + S)/2, which is the mode.
 * Units:   ns; densities in 1/s. Thread: plain data.
 */

enum {
    TL_DELAY_CHAIN = 16, /* participants of a chain */
    TL_DELAY_LINKS = 7   /* asynchronous links of a chain */
};

/* A part of a chain: a bus, a controller, the simulation. */
typedef struct tl_delay_participant {
    tl_time dead;  /* dead time τ, ns, ≥ 0 */
    tl_time cycle; /* cycle time θ, ns, > 0 */
    size_t base;   /* participants with the same time base are synchronous */
} tl_delay_participant;

/* Delay of a chain: a constant plus a sum of uniforms. */
typedef struct tl_delay_density {
    tl_time dead;                   /* the constant, ns */
    size_t count;                   /* number of uniforms */
    tl_time cycles[TL_DELAY_LINKS]; /* ns: each uniform is from 0 to its cycle time */
} tl_delay_density;

/* Computes the delay of a chain: `length` indices into `participants`. Returns false if the chain
 * has more than TL_DELAY_LINKS asynchronous links. */
bool tl_delay_of_chain(const tl_delay_participant *participants, const size_t *chain, size_t length,
                       tl_delay_density *density);

/* Return the rightmost mode (exact to half a nanosecond) and the longest possible delay, ns. */
tl_time tl_delay_mode(const tl_delay_density *density);
tl_time tl_delay_longest(const tl_delay_density *density);

/* The density at a delay, in 1/s; 0 if the delay is constant. Bound: O(3^count · count). */
double tl_delay_density_at(const tl_delay_density *density, tl_time delay);

/* Look-up of the value at t_j + `shift` in samples that are taken once per tick. `shift` may be
 * negative. */
typedef struct tl_delay_lookup {
    int32_t ticks;     /* the look-up uses the sample of tick j + ticks */
    tl_time look_back; /* ns, ≥ 0: the values in this sample are this much older than its instant */
} tl_delay_lookup;

/* Returns the look-up for `shift`. `wait`: the sample is at least this much later than the wanted
 * instant, so that the next reading can arrive. `step`: T_S. All in ns. |shift| + wait must be less
 * than 2^31 steps. */
tl_delay_lookup tl_delay_look_up(tl_time shift, tl_time wait, tl_time step);

/* Returns the `ticks` of a look-up (rounded to the nearest) so that ŷ is `delay` before y.
 * `look_back`: as in tl_delay_lookup. `step`: T_S. All in ns. */
int32_t tl_delay_ticks(tl_time look_back, tl_time delay, tl_time step);

/* ---- Plan: everything that a twin is built from, with names not yet resolved.
 *
 * Purpose: the parser of configurations fills a plan; tests fill one by hand. tl_twin_build()
 *          checks it (names, types, units, paths, horizon) and builds the twin.
 * Owner:   the caller; everything that a plan points to must outlive the twin (models, functions,
 *          texts).
 * Names:   "component.variable" for a variable of an FMU, "plant.signal" for a signal of the plant.
 * Where:   each item has `where`, its JSON path ("synchronise.adjust.motor.d"), so that a problem
 *          is reported where the user wrote it; NULL stands for "".
 * Default: 0 or NULL, unless the comment names another value or "required". tl_plan_defaults(),
 *          tl_plan_adjust_defaults() and tl_plan_match_defaults() set every default; a caller
 *          starts with them.
 */

/* A value that is set before the FMU is initialised. */
typedef struct tl_plan_set {
    const char *where;
    const char *variable;
    /* TL_REAL for any number (also for an Integer or Enumeration variable), TL_BOOLEAN or TL_STRING.
     * For a Real, a text names the signal of the plant that has the value ("plant.level"). */
    tl_value value;
} tl_plan_set;

/* A start value that is found in the first steps (twin/start_values.h). */
typedef struct tl_plan_find {
    const char *where;
    const char *variable; /* required; "component.variable", a Real that can be set before the initialisation */
    double lower;         /* required, as upper: finite; the declared bounds apply as well */
    double upper;
} tl_plan_find;

/* How the executions of a component are saved (approach 2, see cache/cached_component.h). */
typedef enum tl_keep {
    TL_KEEP_STATES,  /* outputs and states of every input sequence: no step is executed twice */
    TL_KEEP_OUTPUTS, /* all outputs, but few states: for FMUs whose save takes longer than a step */
    TL_KEEP_NONE,    /* only the committed state: executes all steps, for FMUs with the fastest steps */
    TL_KEEP_AUTO     /* states or none, whichever is faster as measured at the start */
} tl_keep;

typedef struct tl_plan_component {
    const char *where;
    const char *name;                       /* required; unique; not "plant" */
    const tl_model *model;                  /* required */
    const tl_fmi2 *functions;               /* required */
    const fmi2CallbackFunctions *callbacks; /* required */
    const char *resources;                  /* file:/// URI of the unpacked resources folder; NULL: none */
    const tl_plan_set *set;
    size_t set_count;
    tl_keep keep;
    bool logging; /* the FMU's debug logging is on */
} tl_plan_component;

/* A signal of the plant: an output of the component "plant". */
typedef struct tl_plan_signal {
    const char *where;
    const char *name; /* required */
    tl_type type;     /* TL_REAL, TL_INTEGER or TL_BOOLEAN */
    const char *unit; /* NULL or "": none is given */
    bool has_initial;
    double initial; /* value until the first good reading; default: the start value of the connected input */
} tl_plan_signal;

typedef struct tl_plan_connection {
    const char *where;
    const char *from; /* required; "component.variable" or "plant.signal" */
    const char *to;   /* required; "component.variable", an input */
} tl_plan_connection;

/* A variable that the optimiser changes: an input or a tunable parameter, Real or Boolean. Step,
 * bounds and penalties are not used for a Boolean. */
typedef struct tl_plan_adjust {
    const char *where;
    const char *variable; /* required */
    bool has_nominal;
    double nominal;  /* û if no connection delivers it; default: the start value; Boolean: 0 or 1 */
    double step;     /* first step of the search, in the variable's unit; > 0; required for a Real */
    double lower;    /* default: −infinity, no bound; the declared minimum of the variable applies as well */
    double upper;    /* default: +infinity, no bound; the declared maximum of the variable applies as well */
    double approved; /* accepted u − û, finite: released twins run with û + this, within the bounds; default: 0 */
    double deviation_penalty; /* ≥ 0: for each unknown, J grows by this times ((u − û)/step)² */
    double rate_penalty;      /* ≥ 0: J grows by this times ((u − u of the step before)/step)² */
    tl_time dwell;            /* Boolean: shortest time between two changes; ns, 0: no limit */
} tl_plan_adjust;

/* A simulated output and the plant signal it is compared with. */
typedef struct tl_plan_match {
    const char *where;
    const char *variable; /* required; "component.variable" */
    const char *to;       /* required; "plant.signal" */
    const char *reading;  /* plant signal whose raw readings are compared too (reading_meter.h); NULL: `to`; "": none */
    double tolerance;     /* required; > 0, in the variable's unit; may be 1 if weight is 0 */
    double weight;        /* ≥ 0; default: 1; 0: compared and reported, but not part of J */
    double huber;         /* > 0: errors above this many tolerances count linearly; 0: all quadratically */
} tl_plan_match;

/* An output that is only read, by tl_twin_output(). */
typedef struct tl_plan_output {
    const char *where;
    const char *variable; /* "component.variable" */
} tl_plan_output;

/* Pairing: which measurements a step uses (docs/decisions/009-time-and-pairing.md). */
typedef enum tl_pairing {
    TL_LAG,   /* step i → i+1 is computed at t_(i+T_P), with all measurements of its horizon */
    TL_AHEAD, /* step i → i+1 is computed at t_i; the newest measurement is used in place of later ones */
    TL_HOLD   /* step i → i+1 is computed at t_(i+1); the newest measurement is used in place of later ones */
} tl_pairing;

/* Unknowns of a search over a horizon that is longer than T_D. */
typedef enum tl_shape {
    TL_STATIC, /* one u, held over the horizon (eq. 4.3) */
    TL_DYNAMIC /* T_P − T_D + 1 values of u, one after the other (eq. 4.4); the first is committed */
} tl_shape;

/* Saving of executions. It changes no result by a bit. All zero: none. */
typedef struct tl_plan_saving {
    bool structure; /* approach 1: executes nothing that cannot reach a matched output (Γ_k, eq. 4.5); default: true */
    bool sequences; /* approach 2: executes nothing whose input sequence is known; default: true */
    uint32_t
        nodes; /* maximum number of input sequences per component; 0: as many as horizon and budget can need, ≤ 4096 */
} tl_plan_saving;

/* Edge of a Boolean signal of the plant; rising, unless `falls`. */
typedef struct tl_plan_edge {
    const char *signal; /* "plant.signal"; NULL: none */
    bool falls;
} tl_plan_edge;

/* Longest stroke of an event horizon, in macro steps. The twin stores its samples twice. */
enum { TL_LONGEST_STROKE = 10000 };

/* Event horizon (event/event_horizon.h): J is computed around an event of the plant, and not over
 * T_P steps. A stroke is the motion from the edge `start` to the event. */
typedef struct tl_plan_event {
    const char *where;
    tl_plan_edge start; /* start of a stroke; signal NULL: there is no event horizon */
    tl_plan_edge end;   /* the event; a Boolean output must be matched with this signal */
    tl_time window;     /* T_F, ns: J covers one half of it before the event and one half after it */
    tl_time longest;    /* ns; a longer stroke is not searched */
} tl_plan_event;

/* Largest lag, in macro steps in both directions, of a measured delay. */
enum { TL_DELAY_LAGS = 32 };

/* Measurement of Δo (measure/delay_meter.h), in lock by the released twins. They also lag if the
 * model is slower than the plant. So with `has_start`, their first measured value counts as
 * `start`, and only its later changes are used. */
typedef struct tl_plan_measure {
    uint32_t lags;     /* N of the meters, at most TL_DELAY_LAGS; 0: Δo is not measured */
    tl_time range;     /* ns: a measured delay is limited to −range … range; less than (N − 1)·T_S */
    tl_time look_back; /* ns: as in tl_delay_lookup, of matched signals */
    bool is_unused;    /* Δo is only reported (records, account): it shifts no look-up and is in no checkpoint */
    bool has_start;    /* Δo at the start is known */
    tl_time start;     /* ns: this Δo; if the inputs are shifted, minus their delay Δi */
} tl_plan_measure;

/* Most steps in which start values are found; and for n values, the most times that they are
 * executed for it. */
enum { TL_FIND_STEPS = 2000, TL_FIND_ROUNDS = 10, TL_FIND_TRIES = 4 };
#define TL_FIND_RUNS(n) (2 + TL_FIND_ROUNDS * ((n) + TL_FIND_TRIES))

/* Default number of evaluations in a plan and in a budget. */
enum { TL_PLAN_EVALUATIONS = 60 };

/* Time of the FMUs, s. */
typedef struct tl_experiment {
    double start_s; /* time of the FMUs at tick 0; finite */
    double stop_s;  /* stop time for fmi2SetupExperiment; ≤ start_s: none was configured */
} tl_experiment;

typedef struct tl_plan {
    tl_time step; /* required; T_S, ns, > 0 */
    tl_experiment experiment;
    tl_time length; /* length of the run, ns; without stop_s, the stop time is start + length + T_P; 0: no end */
    const tl_plan_component *components;
    size_t component_count;
    const tl_plan_signal *signals;
    size_t signal_count;
    const tl_plan_connection *connections;
    size_t connection_count;
    const tl_plan_adjust *adjust; /* if there are none, the twin runs free and only compares */
    size_t adjust_count;
    const tl_plan_match *match;
    size_t match_count;
    const tl_plan_find *find; /* start values to find; not with an event horizon */
    size_t find_count;        /* at most TL_MAX_ADJUST */
    uint32_t find_steps;      /* number of first steps for it: 1 … TL_FIND_STEPS */
    const tl_plan_output *outputs;
    size_t output_count; /* at most TL_MAX_SIGNALS */
    uint32_t prediction; /* T_P ≥ T_D ≥ 1; 0: as short as possible, T_P = T_D */
    tl_shape shape;
    tl_pairing measurements;
    tl_plan_event event;
    int32_t input_ticks; /* the inputs of t_i come from the sample of tick i + this (Δi; base/signal.h) */
    tl_plan_measure measure;
    int32_t output_ticks;     /* ŷ of t_j comes from the sample of tick j + this (Δo) */
    tl_time output_look_back; /* ns: as in tl_delay_lookup */
    /* See tl_twin_solver_names(). NULL: "secant"; "boolean" for Booleans; "nelder-mead" with an
     * event horizon. */
    const char *algorithm;
    const char *fallback; /* the solver to use if the first one fails or stagnates; NULL: none */
    uint32_t stagnation;  /* evaluations without progress that stop a solver; 0: never */
    /* [0, 1): a corrected u outside the tolerance is used only if its J is at most (1 − margin)
     * times the J of nominal. Default: 0.01. */
    double margin;
    /* ≥ 0, in tolerances: a variable is not identifiable if its `step` moves no matched output by
     * this much. It is then held at nominal in this step. 0: no such check. Default: 0.001. */
    double noise_floor;
    uint32_t
        evaluations; /* maximum number of evaluations per step; 0: 60; caches and ledger have room for at least 60 */
    tl_plan_saving saving;
    uint32_t verify_every; /* committed steps between two verifications by tl_twin_verify(); 0: none; default: 400 */
    uint32_t free_twin;    /* free-run check: `guard` of tl_free_twin_init(); 0: no check; not with an event horizon */
    uint32_t released_steps; /* R: steps of a release (sync/released_twin.h), ≥ 2; 0: no released twins */
    bool may_rerun;          /* twin_rerun.h is used */
    uint64_t state_bytes;    /* bytes for saved states of all FMUs; 0: no bound; default: 128 MiB */
    /* Converts between units with names that FMI's definitions do not convert (units.h). False: they
     * have no conversion. NULL: there are none. */
    bool (*convert_units)(const tl_unit *from, const tl_unit *to, tl_conversion *conversion);
    size_t (*heap)(void); /* returns the bytes allocated in this process, to measure states; NULL: not known */
    tl_time (*now)(
        void *clock); /* monotonic clock, ns, to choose the faster rollback method (sync/proof.h); NULL: no choice */
} tl_plan;

/* Return settings with all defaults. The arguments are required numbers and names. */
tl_plan tl_plan_defaults(tl_time step);
tl_plan_adjust tl_plan_adjust_defaults(const char *variable, double step);
tl_plan_match tl_plan_match_defaults(const char *variable, const char *to, double tolerance);

/* Reports numbers that are out of range. Returns false if the plan has more items than a twin can
 * hold. Then no twin may be built from it. */
bool tl_plan_check(const tl_plan *plan, tl_report *report);

#endif
