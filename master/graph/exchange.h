/* The running co-simulation: values, initialisation, Jacobi macro steps of candidates, the committed step.
 *
 * Purpose: algorithms 1, 2 and 4 of the thesis. In step i every component steps once with the inputs it holds, all
 *          outputs are read, then all inputs are assigned through the connections. A candidate begins at the committed
 *          values of t_i and walks over the horizon; the committed step moves t_i on.
 * Saving:  by structure (approach 1) component k takes part in a candidate only for its first reach[k] = Γ_k steps; by
 *          sequences (approach 2) components stand behind their caches. Neither changes a committed value by a bit.
 * Memory:  all port values lie in one block, so that to keep them is one copy.
 * Errors:  of all that calls FMUs: TL_FMU_FAILED or TL_FMU_FATAL as the first one answered that was not well; the text names it.
 *          Those after it were not called.
 * Thread:  the twin's.
 */
#ifndef TL_MASTER_GRAPH_EXCHANGE_H
#define TL_MASTER_GRAPH_EXCHANGE_H

#include <stdbool.h>
#include <stdint.h>

#include "master/base/arena.h"
#include "master/base/status.h"
#include "master/cache/cached_component.h"
#include "master/graph/costs.h"
#include "master/graph/graph.h"
#include "master/graph/plant.h"
#include "master/graph/snapshot.h"

typedef struct tl_real_copy {
    fmi2Real *to;
    const fmi2Real *from;
    tl_conversion conversion;
    fmi2Real *adjusted; /* the input that a cut connection no longer drives, but while initialising; else NULL */
} tl_real_copy;

typedef struct tl_integer_copy {
    fmi2Integer *to; /* fmi2Boolean is the same C type */
    const fmi2Integer *from;
    fmi2Integer *adjusted; /* as above */
} tl_integer_copy;

/* The input of an adjusted variable: where the exchange has u, and where û is delivered, as its type says. */
typedef struct tl_adjusted_input {
    fmi2Real *real;                       /* u; NULL: it is Boolean */
    fmi2Boolean *boolean;                 /* u; NULL: it is Real */
    const fmi2Real *delivered_real;       /* û, of a connection that is cut; */
    const fmi2Boolean *delivered_boolean; /* both NULL: nothing delivers it, */
    double nominal;                       /* and it is this */
} tl_adjusted_input;

/* What one component was given in a committed step, and what it gave, as bytes of its ports (tl_ports_read()). */
typedef struct tl_exchange_note {
    size_t component;
    unsigned char *inputs;
    unsigned char *outputs;
} tl_exchange_note;

typedef struct tl_exchange {
    tl_component *components;
    size_t component_count;
    tl_plant plant;
    tl_time step;                 /* T_S */
    double step_s;                /* the same, s */
    uint32_t *reach;              /* Γ_k of each component, the plant last; NULL: all take part in all steps */
    tl_cached_component *cached;  /* one per component; NULL: everything is executed */
    uint32_t beside;              /* states of each component that somebody else keeps, within the same bound */
    tl_state_room *rooms;         /* one per component, of its cache; filled by tl_exchange_start() */
    bool whole;                   /* nothing is saved: all components execute in one go */
    tl_costs costs;               /* what executions take */
    uint64_t executions;          /* of all components, the plant not counted */
    size_t failed;                /* the component at which the last macro step failed */
    unsigned char *values;        /* reals, then integers, then booleans, of all ports; then û of cut connections */
    tl_snapshot home;             /* where candidates begin; of caches, its values only */
    bool *is_kept;                /* of each component: all that it knows, while a proof goes on */
    int64_t begun;                /* step at which the FMUs have begun */
    const tl_exchange_note *note; /* each committed step is noted there; NULL: nobody looks */
    bool is_kept_from;            /* somebody keeps a state from before the committed instant: no step is final */
    bool is_kept_always;          /* and does so for good */
    const fmi2Real *outputs;      /* the Real outputs of all components lie together */
    size_t output_count;
    size_t values_size;
    size_t real_count;    /* of `values`, at its front */
    tl_real_copy *copies; /* unit conversion is the identity */
    size_t copy_count;
    tl_real_copy *conversions;
    size_t conversion_count;
    tl_integer_copy *integer_copies;
    size_t integer_copy_count;
    tl_adjusted_input adjusted[TL_MAX_ADJUST]; /* by variable */
} tl_exchange;

/* Places all values and copies; the graph must be complete. `window` is the plant's, in samples. */
tl_status tl_exchange_init(tl_exchange *exchange, tl_arena *arena, tl_graph *graph, size_t window, tl_error *error);

/* Where the value of a port is: a double, an fmi2Integer or an fmi2Boolean, as its type says. For any port, its value as
 * double. */
const void *tl_exchange_output(const tl_exchange *exchange, const tl_port *port);
double tl_exchange_value(const tl_exchange *exchange, const tl_port *port);

/* The input of an adjusted variable is that of this port, and has its nominal value. `connection` is the cut one that leads
 * there; NULL: nothing delivers û, which is `nominal`. */
void tl_exchange_place_adjusted(tl_exchange *exchange, size_t variable, const tl_port *port,
                                const tl_connection *connection, double nominal);

/* u: the input of an adjusted variable in the macro steps that follow. A Boolean is on where it is not 0. */
static inline void tl_exchange_set_adjusted(tl_exchange *exchange, size_t variable, double u) {
    const tl_adjusted_input *input = &exchange->adjusted[variable];
    if (input->real != NULL) {
        *input->real = u;
    } else {
        *input->boolean = u != 0.0 ? fmi2True : fmi2False;
    }
}

/* Another û of a variable that no connection delivers it to; u stays. */
void tl_exchange_set_nominal(tl_exchange *exchange, size_t variable, double nominal);

/* The u that is set; and û, as it is delivered now. */
double tl_exchange_adjusted(const tl_exchange *exchange, size_t variable);
double tl_exchange_nominal(const tl_exchange *exchange, size_t variable);

/* All values as they were before the first initialisation. */
void tl_exchange_clear(tl_exchange *exchange, const tl_graph *graph);

/* fmi2SetupExperiment … fmi2ExitInitializationMode of all components at the instant of macro step `first`, outputs and inputs
 * exchanged in between until they agree. The plant must have a sample; that of tick `shown` is delivered first. */
tl_status tl_exchange_initialize(tl_exchange *exchange, int64_t first, int64_t shown, tl_error *error);

/* Inputs from outputs. */
void tl_exchange_deliver(tl_exchange *exchange);

/* From now on executions are saved: `reach` has an entry for each component and the plant, or is NULL; `capacity` gives the
 * nodes of each component's cache, or is NULL. Both must stay. Before initialisation. */
bool tl_exchange_save_executions(tl_exchange *exchange, tl_arena *arena, const tl_keep *keep, uint32_t *reach,
                                 const uint32_t *capacity, uint32_t prediction);

/* What `steps` macro steps of everything take, ns. */
tl_time tl_exchange_cost(const tl_exchange *exchange, tl_time steps);

/* After initialisation: t_0 is the committed instant. Saves first states where there are caches; all their states together, as large as
 * they are now, stay within `bytes` (0: there is no bound), but for the two that each component must have. `heap` as in
 * tl_cached_component_measure(). */
tl_status tl_exchange_start(tl_exchange *exchange, uint64_t bytes, size_t (*heap)(void), tl_error *error);

/* The same after all FMUs have begun anew and are initialised at the instant of macro step `step`: nothing that was saved is known any
 * more. */
tl_status tl_exchange_begin_anew(tl_exchange *exchange, int64_t step, tl_error *error);

/* Between steps, before macro step `step`: what the caches know is given up, and all executions are counted from 0. False in *done: an FMU would have
 * to be executed again for it, and nothing is given up. */
tl_status tl_exchange_forget(tl_exchange *exchange, int64_t step, bool *done, tl_error *error);

/* The values and states as committed are where candidates begin. Once per step, before the first candidate. Saves all
 * states where there are no caches; else no FMU is called, and nothing can fail. */
tl_status tl_exchange_begin(tl_exchange *exchange, tl_error *error);

/* Whether a component (the plant is the last one) takes part at a depth; its step as in tl_exchange_try(), from where its cache
 * stands; and what a connection makes of its source. */
bool tl_exchange_takes_part(const tl_exchange *exchange, size_t component, uint32_t depth);
tl_status tl_exchange_advance(tl_exchange *exchange, size_t component, int64_t step, uint32_t depth, tl_error *error);
double tl_exchange_convert(const tl_real_copy *copy);

/* Back to where candidates begin. Restores all states where there are no caches; else nothing can fail. */
tl_status tl_exchange_rewind(tl_exchange *exchange, tl_error *error);

/* A candidate's macro step, from t_step to t_(step+1); `depth` counts from 0 at the committed instant. Where it fails, `failed`
 * says at which component; tl_exchange_rewind() leads back, unless that was fatal. */
tl_status tl_exchange_try(tl_exchange *exchange, int64_t step, uint32_t depth, tl_error *error);

/* The committed macro step: all components take part. No state before t_step will be wanted any more. Where it fails,
 * tl_exchange_rewind() leads back, if tl_exchange_begin() was called or executions are saved. */
tl_status tl_exchange_commit(tl_exchange *exchange, int64_t step, tl_error *error);

/* Before macro step `step`: whether a component cannot be led back any more, or not from `ahead` steps later: the first such; NULL: there is none. It can still be stepped. */
const tl_component *tl_exchange_find_free(const tl_exchange *exchange, int64_t step, uint32_t ahead);

/* Between steps: a component's state at the committed instant, as tl_cached_component_copy_root(). And from now on, until it is told otherwise: somebody keeps
 * such a state for longer. */
tl_status tl_exchange_copy_state(tl_exchange *exchange, size_t component, fmi2FMUstate *state, fmi2FMUstate *aside,
                                 bool *taken, tl_error *error);
void tl_exchange_keep_from(tl_exchange *exchange, size_t component, bool is_kept_from);

/* The same of all components, and for good. */
void tl_exchange_keep_always(tl_exchange *exchange);

/* Keeps all components and values beside all caches, for the proof at start, where candidates begin else. */
tl_status tl_exchange_save(tl_exchange *exchange, tl_error *error);
tl_status tl_exchange_restore(tl_exchange *exchange, tl_error *error);

/* Beside all caches, too: every component executes macro step `step` from where it stands, with the inputs in the ports; then the sample that is shown after it is delivered. */
tl_status tl_exchange_step(tl_exchange *exchange, int64_t step, tl_error *error);

/* For the proof at start: what components can keep besides their states, as a whole. tl_exchange_keep() comes before tl_exchange_save().
 * tl_exchange_come_back() leads there, of which this component must be able to. With `why`, which may be "", its states are wrong: it makes none of its own any more.
 * Others come back by what was kept, or go their next way, too, if that is of no use any more. False: it cannot be. */
void tl_exchange_keep(tl_exchange *exchange);
bool tl_exchange_come_back(tl_exchange *exchange, size_t component, const char *why);
void tl_exchange_let_go(tl_exchange *exchange);

/* Between steps, before macro step `step`: a component does not come back to where it was. From now on it is saved and restored in the other way
 * (tl_fmi2_aside), from where it stands; what the caches know of all is given up. False in *done: there is none, or not now. */
tl_status tl_exchange_give_up_states(tl_exchange *exchange, size_t component, int64_t step, bool *done,
                                     tl_error *error);

/* The committed instant, which is before macro step `step`, into `home`. Between steps only. Not can_take: some FMU has to catch up there. And from what was loaded
 * into `home` to it: everything stands there, before tl_exchange_start(). */
bool tl_exchange_can_take(const tl_exchange *exchange);
tl_status tl_exchange_take(tl_exchange *exchange, int64_t step, tl_error *error);
tl_status tl_exchange_return(tl_exchange *exchange, tl_error *error);

/* Gives back what a component's cache holds of its FMU, before the component is freed. Not for one whose FMU may not be called
 * any more. */
void tl_exchange_end_component(tl_exchange *exchange, size_t component);

#endif
