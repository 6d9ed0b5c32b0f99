/* The plan of a twin: components, connections, delays, matches.
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

/* ---- Delays: how long a signal is on its way through dead times and cycles that know nothing of each other.
 *
 * Purpose: Δi and Δo (eq. 4.14, 4.15) from the model of asynchronous cycles (eq. 4.16).
 * Model:   a signal passes a chain of participants. Participants on one time base are synchronous; those of them that follow
 *          each other form a group, and every dead time in a group of two or more counts once. A link from one time base
 *          to another waits for the target's next cycle: uniform over its cycle time, and no dead time. The densities of
 *          the links convolve.
 * Exact:   a sum of uniforms has a density that is a polynomial between the sums of its parts, which are whole
 *          nanoseconds. It is kept as these parts, and evaluated by the recurrence of box splines, in which no term is negative:
 *          nothing cancels, however different the cycles are.
 * Mode:    the density of a sum of uniforms is symmetric, and falls from its middle on. The largest cycle L, spread over the
 *          density g of the others, gives (G(t) − G(t − L))/L with G = ∫g: constant 1/L from the sum of the others to L, where L is more
 *          than that sum: a plateau, and its right end is L. Else it grows while g(t) > g(t − L), and as g is symmetric,
 *          falls from its middle on and has no plateau as wide as L, that is up to the middle: half the sum of all.
 * Units:   ns; densities in 1/s. Thread: plain data.
 */

enum {
    TL_DELAY_CHAIN = 16, /* participants of a chain */
    TL_DELAY_LINKS = 7   /* asynchronous links of a chain */
};

/* A part of a chain: a bus, a controller, the simulation. */
typedef struct tl_delay_participant {
    tl_time dead;  /* τ, ≥ 0 */
    tl_time cycle; /* θ, > 0 */
    size_t base;   /* its time base: participants of the same one are synchronous */
} tl_delay_participant;

/* The delay of a chain: a constant, and a sum of uniforms. No uniform: the delay is the constant. */
typedef struct tl_delay_density {
    tl_time dead;
    size_t count;
    tl_time cycles[TL_DELAY_LINKS]; /* each is uniform from 0 to this */
} tl_delay_density;

/* The delay of the chain of `length` indices into `participants`. false: it has more than TL_DELAY_LINKS asynchronous links. */
bool tl_delay_of_chain(const tl_delay_participant *participants, const size_t *chain, size_t length,
                       tl_delay_density *density);

/* The rightmost mode (half a nanosecond is left out), and the longest delay there can be. */
tl_time tl_delay_mode(const tl_delay_density *density);
tl_time tl_delay_longest(const tl_delay_density *density);

/* The density at a delay, in 1/s; 0 of a delay that is constant. Bound: O(3^count · count). */
double tl_delay_density_at(const tl_delay_density *density, tl_time delay);

/* A look-up at an instant that lies `shift` after t_j (before it where that is < 0), from samples that are taken once a tick. */
typedef struct tl_delay_lookup {
    int32_t ticks;     /* it is in the sample of tick j + ticks, … */
    tl_time look_back; /* … which holds what was seen so long before its own instant, ≥ 0 */
} tl_delay_lookup;

/* The same at least `wait` later: so long may a sample wait for the next reading. |shift| + wait is less than 2^31 steps. */
tl_delay_lookup tl_delay_look_up(tl_time shift, tl_time wait, tl_time step);

/* The ticks, to the nearest whole one, by which a look-up moves so that ŷ is `delay` before y, where samples look back so far. */
int32_t tl_delay_ticks(tl_time look_back, tl_time delay, tl_time step);

/* ---- The plan of a twin: everything a twin is built from, names not yet resolved.
 *
 * Purpose: the one description that a configuration becomes and that tests write by hand. twin.h checks it
 *          (names, types, units, paths, horizon) and builds the twin from it.
 * Owner:   the caller; everything a plan points to must outlive the twin (models, functions, texts).
 * Names:   "component.variable" for a variable of an FMU, "plant.signal" for a signal of the plant.
 * Where:   each item carries `where`, its JSON path ("synchronise.adjust.motor.d"), so that a problem can be reported
 *          where the user wrote it; NULL stands for "".
 * Default: 0 or NULL, unless the comment names another value, or "required". tl_plan_defaults(), tl_plan_adjust_defaults() and
 *          tl_plan_match_defaults() fill in every default; a caller starts with them and sets what differs.
 */

/* A variable that gets a value before the FMU is initialised. */
typedef struct tl_plan_set {
    const char *where;
    const char *variable;
    tl_value value; /* TL_REAL for any number (also for an Integer or Enumeration variable), TL_BOOLEAN or TL_STRING */
} tl_plan_set;

/* How the executions of a component are saved (approach 2, see cache/cached_component.h). */
typedef enum tl_keep {
    TL_KEEP_STATES, /* outputs and states of every input prefix: nothing is ever executed twice */
    TL_KEEP_OUTPUTS /* outputs only, and a state now and then: for FMUs whose state costs more than a step */
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
    double initial; /* delivered until there is a first good reading; else the start value of what it drives */
} tl_plan_signal;

typedef struct tl_plan_connection {
    const char *where;
    const char *from;
    const char *to;
} tl_plan_connection;

/* A variable the optimiser may change: an input or a tunable parameter, Real or Boolean. Of a Boolean, step, bounds and
 * penalties are not used. */
typedef struct tl_plan_adjust {
    const char *where;
    const char *variable; /* required */
    bool has_nominal;
    double nominal;           /* used where no connection delivers û; default: the start value; Boolean: 0 or 1 */
    double step;              /* first step of the search, in the variable's unit; > 0; required for a Real */
    double lower;             /* default: −infinity, no bound; the variable's declared minimum holds as well */
    double upper;             /* default: +infinity, no bound; the variable's declared maximum holds as well */
    double deviation_penalty; /* ≥ 0: J grows by this times ((u − û)/step)² at each unknown */
    double rate_penalty;      /* ≥ 0: J grows by this times ((u − the u before it)/step)² */
    tl_time dwell;            /* Boolean: after it has changed it stays for at least this long; ns, 0: no limit */
} tl_plan_adjust;

/* A simulated output and the plant signal it is compared with. */
typedef struct tl_plan_match {
    const char *where;
    const char *variable; /* required; "component.variable" */
    const char *to;       /* required; "plant.signal" */
    const char *reading;  /* the signal that shows its readings as they come; NULL: that is `to`; "": none does */
    double tolerance;     /* required; > 0, in the variable's unit; may be 1 if weight is 0 */
    double weight;        /* default: 1; 0: compared and reported, not matched */
    double huber;         /* > 0: differences beyond this many tolerances count linearly; 0: all quadratically */
} tl_plan_match;

/* An output that is only read, by tl_twin_output(). */
typedef struct tl_plan_output {
    const char *where;
    const char *variable; /* "component.variable" */
} tl_plan_output;

/* Which measurements a step uses (METHOD decision 4, see DESIGN.md "Time"). */
typedef enum tl_measurements {
    TL_LAG,   /* step i → i+1 is computed at the tick t_(i+T_P), all measurements are known */
    TL_AHEAD, /* step i → i+1 is computed at t_i, the newest measurement stands for the later ones */
    TL_HOLD   /* step i → i+1 is computed at t_(i+1), the newest measurement stands for the later ones */
} tl_measurements;

/* What is searched over a horizon that is longer than T_D. */
typedef enum tl_shape {
    TL_STATIC, /* one u, held over the horizon (eq. 4.3) */
    TL_DYNAMIC /* T_P − T_D + 1 values of u, one after the other (eq. 4.4); the first is committed */
} tl_shape;

/* Which executions are saved. None of it changes a result by a bit. All zero: none. */
typedef struct tl_plan_saving {
    bool structure; /* approach 1: no execution that cannot reach a matched output (Γ_k, eq. 4.5); default: true */
    bool sequences; /* approach 2: no execution whose input prefix is known; default: true */
    uint32_t nodes; /* most prefixes kept per component; 0: as many as the horizon and the budget can need, ≤ 4096 */
} tl_plan_saving;

/* A Boolean signal of the plant becomes true, or false. */
typedef struct tl_plan_edge {
    const char *signal; /* "plant.signal"; NULL: none */
    bool falls;
} tl_plan_edge;

/* The longest stroke of an event horizon, in macro steps: its samples are kept twice. */
enum { TL_LONGEST_STROKE = 10000 };

/* A horizon around an event of the plant (event/event_horizon.h) in place of one of T_P steps. */
typedef struct tl_plan_event {
    const char *where;
    tl_plan_edge start; /* of a stroke; its signal NULL: there is no event horizon */
    tl_plan_edge end;   /* the event; the signal is matched by a Boolean output */
    tl_time window;     /* T_F, ns: J counts half of it before the event and half after */
    tl_time longest;    /* ns; a stroke that lasts longer is not searched */
} tl_plan_event;

/* The most lags, in macro steps to either side, for which a delay is looked for. */
enum { TL_DELAY_LAGS = 32 };

/* Whether and how Δo is measured (measure/delay_meter.h). */
typedef struct tl_plan_measure {
    uint32_t lags;     /* N of the meters, at most TL_DELAY_LAGS; 0: Δo is not measured */
    tl_time range;     /* the delays left to be shifted that are used: −range … range, less than (N − 1)·T_S */
    tl_time look_back; /* of the samples of matched signals */
} tl_plan_measure;

/* The default of `evaluations`, also of a budget's. */
enum { TL_PLAN_EVALUATIONS = 60 };

typedef struct tl_plan {
    tl_time step; /* required; T_S, ns, > 0 */
    const tl_plan_component *components;
    size_t component_count;
    const tl_plan_signal *signals;
    size_t signal_count;
    const tl_plan_connection *connections;
    size_t connection_count;
    const tl_plan_adjust *adjust; /* none: the twin runs free and only compares */
    size_t adjust_count;
    const tl_plan_match *match;
    size_t match_count;
    const tl_plan_output *outputs;
    size_t output_count; /* at most TL_MAX_SIGNALS */
    uint32_t prediction; /* T_P ≥ T_D ≥ 1; 0: as short as possible, T_P = T_D */
    tl_shape shape;
    tl_measurements measurements;
    tl_plan_event event;
    int32_t input_ticks; /* what feeds inputs at t_i is in the sample of tick i + this (Δi; base/signal.h) */
    tl_plan_measure measure;
    int32_t output_ticks;     /* and the ŷ of t_j in that of tick j + this (Δo), */
    tl_time output_look_back; /* which shows what was seen so long before its own instant */
    /* See tl_twin_solver_names(). NULL: "secant"; "boolean" for Booleans; "nelder-mead" with an event horizon. */
    const char *algorithm;
    const char *fallback; /* takes over where the first one fails or stagnates; NULL: none */
    uint32_t stagnation;  /* evaluations without progress that end a solver; 0: never */
    /* A correction must lower J to at most (1 − margin) of the nominal's, [0, 1). Default: 0.01. */
    double margin;
    /* ≥ 0: a variable whose `step` moves no matched output by this many tolerances is not identifiable and held at nominal for
     * the step; 0: never. Default: 0.001. */
    double noise_floor;
    uint32_t evaluations; /* the most a step's budget will allow: sizes caches and ledger, for at least 60; 0: 60 */
    tl_plan_saving saving;
    uint32_t verify_every; /* committed steps from one check by tl_twin_verify() to the next; 0: none; default: 400 */
    uint32_t
        free_twin; /* a twin that is left alone is led beside (sync/free_twin.h): steps until a prediction has outrun what its beginning has used; 0: there is none. Not with an event
                           horizon */
    uint64_t state_bytes; /* memory for states saved by sequences, of all FMUs; 0: no bound; default: 128 MiB */
    size_t (*heap)(void); /* bytes allocated in this process, to see how large states are; NULL: nobody knows */
    tl_time (*now)(
        void *
            clock); /* ns, of a clock that never goes back: two exact ways to lead an FMU back are timed by it at the start; NULL: none is */
} tl_plan;

/* Settings with all defaults. The arguments are what is required. */
tl_plan tl_plan_defaults(tl_time step);
tl_plan_adjust tl_plan_adjust_defaults(const char *variable, double step);
tl_plan_match tl_plan_match_defaults(const char *variable, const char *to, double tolerance);

/* Reports numbers that are out of their ranges. false: there is more of something than a twin has room for, and
 * nothing may be built from the plan. */
bool tl_plan_check(const tl_plan *plan, tl_report *report);

#endif
