/* Co-simulation: values, initialisation, Jacobi macro steps of candidates, the committed step.
 *
 * Purpose: algorithms 1, 2 and 4 of the thesis. In step i every component steps once with its
 *          present inputs, then all outputs are read, then all inputs are assigned through the
 *          connections. A candidate starts with the committed values of t_i and runs over the
 *          horizon; the committed step advances t_i.
 * Saving:  saves executions by two approaches. By structure (approach 1), component k takes part
 *          only in the first reach[k] = Γ_k steps of a candidate. By sequences (approach 2), each
 *          component has a cache of its results. Neither changes a committed value by a bit.
 * NaN:     a Real output that is not finite becomes NaN and is not delivered: the inputs that read
 *          it keep their last value. These inputs are port values too. So each candidate starts
 *          with the inputs of the committed instant.
 * Memory:  all port values lie in one block, so that they are saved by one copy.
 * Errors:  functions that call FMUs return TL_FMU_FAILED or TL_FMU_FATAL from the first component
 *          that failed; the text names it. Components after it were not called.
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
    fmi2Real *adjusted; /* the input that a cut connection (graph.h) sets only during initialisation; else NULL */
} tl_real_copy;

typedef struct tl_integer_copy {
    fmi2Integer *to; /* fmi2Boolean is the same C type */
    const fmi2Integer *from;
    fmi2Integer *adjusted; /* as above */
} tl_integer_copy;

/* Input of an adjusted variable: addresses of its u and û in the exchange. */
typedef struct tl_adjusted_input {
    fmi2Real *real;                       /* u; NULL: the input is Boolean */
    fmi2Boolean *boolean;                 /* u; NULL: the input is Real */
    const fmi2Real *delivered_real;       /* û that a cut connection delivers */
    const fmi2Boolean *delivered_boolean; /* both NULL: no connection delivers û */
    double nominal;                       /* û if no connection delivers it */
} tl_adjusted_input;

/* Buffers of the verifier, as bytes of ports (tl_ports_read()): inputs and outputs of one component
 * in a committed step, and its inputs in the last candidate. */
typedef struct tl_exchange_note {
    size_t component;
    unsigned char *inputs;
    unsigned char *outputs;
    unsigned char *tried; /* inputs in the candidate: tried_bytes for each depth below tried_most */
    size_t tried_bytes;
    uint32_t tried_most;
    uint32_t tried_count; /* entries that have been set */
} tl_exchange_note;

typedef struct tl_exchange {
    tl_component *components;
    size_t component_count;
    tl_plant plant;
    tl_time step;                /* T_S, ns */
    double step_s;               /* T_S, s */
    uint32_t *reach;             /* Γ_k of each component, then of the plant; NULL: all take part in all steps */
    tl_cached_component *cached; /* one per component; NULL: nothing is saved by sequences */
    uint32_t extra_states;       /* states per component that other modules keep; they count towards the memory bound */
    uint32_t optional_states; /* as extra_states, for released twins; 0 after tl_exchange_start(): no room for them */
    tl_state_room *rooms;     /* one per component, for its cache; filled by tl_exchange_start() */
    bool whole;               /* no executions of components are saved: all execute in one call */
    tl_costs costs;           /* of executions */
    uint64_t executions;      /* number of executions of all components, without the plant */
    size_t failed;            /* index of the component at which the last macro step failed */
    unsigned char *values;    /* reals, then integers, then booleans of all ports; then û of cut connections */
    tl_snapshot home;         /* start of candidates: values and states; with caches, only the values */
    bool *is_kept;            /* of each component: a full copy exists during a proof */
    int64_t begun;            /* first macro step since initialisation or reset */
    tl_exchange_note *note;   /* each committed step is copied to it; NULL: no copy */
    bool is_kept_from;        /* a module keeps a state from before the committed instant: no step is final */
    bool is_kept_always;      /* is_kept_from stays true for the whole run */
    const fmi2Real *outputs;  /* the Real outputs of all components, contiguous */
    size_t output_count;
    bool was_finite; /* all of `outputs` were finite in the committed step, and have not changed since */
    size_t values_size;
    size_t real_count;    /* number of reals at the start of `values` */
    tl_real_copy *copies; /* connections without unit conversion */
    size_t copy_count;
    tl_real_copy *conversions;
    size_t conversion_count;
    tl_integer_copy *integer_copies;
    size_t integer_copy_count;
    tl_adjusted_input adjusted[TL_MAX_ADJUST]; /* index: adjusted variable */
} tl_exchange;

/* Allocates all port values and builds the tables of copies. The graph must be complete. `window`:
 * number of plant samples to keep. */
tl_status tl_exchange_init(tl_exchange *exchange, tl_arena *arena, tl_graph *graph, size_t window, tl_error *error);

/* Address of a port's value: a double, an fmi2Integer or an fmi2Boolean by its type. The second
 * function returns the value of any port as double. */
const void *tl_exchange_output(const tl_exchange *exchange, const tl_port *port);
double tl_exchange_value(const tl_exchange *exchange, const tl_port *port);

/* Defines the input of an adjusted variable. `connection` is the cut one that delivers û; NULL: û
 * is `nominal`. */
void tl_exchange_place_adjusted(tl_exchange *exchange, size_t variable, const tl_port *port,
                                const tl_connection *connection, double nominal);

/* Sets u of an adjusted variable for the next macro steps. A Boolean is true if u is not 0. */
static inline void tl_exchange_set_adjusted(tl_exchange *exchange, size_t variable, double u) {
    const tl_adjusted_input *input = &exchange->adjusted[variable];
    if (input->real != NULL) {
        *input->real = u;
    } else {
        *input->boolean = u != 0.0 ? fmi2True : fmi2False;
    }
}

/* Changes û of a variable whose û no connection delivers. Does not change u. */
void tl_exchange_set_nominal(tl_exchange *exchange, size_t variable, double nominal);

/* Return the present u and the present û. */
double tl_exchange_adjusted(const tl_exchange *exchange, size_t variable);
double tl_exchange_nominal(const tl_exchange *exchange, size_t variable);

/* Sets all port values to those before the first initialisation. */
void tl_exchange_clear(tl_exchange *exchange, const tl_graph *graph);

/* Initialises all components at the instant of macro step `first`: fmi2SetupExperiment …
 * fmi2ExitInitializationMode, with outputs and inputs exchanged in between until they agree. First
 * delivers `plant`, a value of each signal of the plant. Some FMUs reject reading in
 * initialisation mode and then fail. In this case all FMUs are instantiated again, and these FMUs
 * are read only after that mode. */
tl_status tl_exchange_initialize(tl_exchange *exchange, int64_t first, const double *plant, tl_error *error);

/* Assigns outputs to the inputs that read them. Outputs that are NaN are skipped. */
void tl_exchange_deliver(tl_exchange *exchange);

/* True if all Real outputs of the FMUs are finite. */
bool tl_exchange_is_finite(const tl_exchange *exchange);

/* Enables saving of executions. Call it before initialisation. Returns false if memory is out.
 * `keep`:     one entry per component.
 * `reach`:    Γ_k of each component, then of the plant; NULL: no saving by structure.
 * `capacity`: number of nodes of each component's cache; NULL: no saving by sequences.
 * `reach` and `capacity` must outlive the exchange. `prediction`: T_P. */
bool tl_exchange_save_executions(tl_exchange *exchange, tl_arena *arena, const tl_keep *keep, uint32_t *reach,
                                 const uint32_t *capacity, uint32_t prediction);

/* Call before tl_exchange_start(): nothing is saved by sequences from now on. */
void tl_exchange_drop_caches(tl_exchange *exchange, uint32_t prediction);

/* Expected cost of `steps` macro steps of all components, ns. */
tl_time tl_exchange_cost(const tl_exchange *exchange, tl_time steps);

/* Call after initialisation: makes t_0 the committed instant and, with caches, saves the first
 * states. `bytes`: bound for all states together at their present size; 0: no bound. Each component
 * gets at least two states, even beyond the bound. `heap`: see tl_cached_component_measure(). */
tl_status tl_exchange_start(tl_exchange *exchange, uint64_t bytes, size_t (*heap)(void), tl_error *error);

/* Call after all FMUs were reset and initialised at the instant of macro step `step`: makes it the
 * committed instant and drops all saved results. */
tl_status tl_exchange_reset(tl_exchange *exchange, int64_t step, tl_error *error);

/* Between steps, before macro step `step`: empties the caches and counts all executions from 0. If
 * an FMU would have to be executed again for this, does nothing and sets *done to false. */
tl_status tl_exchange_forget(tl_exchange *exchange, int64_t step, bool *done, tl_error *error);

/* Makes the committed values and states the start of candidates. Call it once per step, before the
 * first candidate. Without caches it saves all states. With caches it calls no FMU and cannot fail.
 */
tl_status tl_exchange_begin(tl_exchange *exchange, tl_error *error);

/* Parts of tl_exchange_try(), for track.h.
 * takes_part(): true if a component (the plant is the last one) executes the step at this depth.
 * advance():    executes this step of one component, from the position of its cache.
 * convert():    returns the converted value of a connection's source; if it is not finite, the
 *               present value of the input. */
bool tl_exchange_takes_part(const tl_exchange *exchange, size_t component, uint32_t depth);
tl_status tl_exchange_advance(tl_exchange *exchange, size_t component, int64_t step, uint32_t depth, tl_error *error);
double tl_exchange_convert(const tl_real_copy *copy);

/* Returns to the start of candidates. Without caches it restores all states; with caches it cannot
 * fail. */
tl_status tl_exchange_rewind(tl_exchange *exchange, tl_error *error);

/* Executes a candidate's macro step i = `step`, from t_i to t_(i+1). `depth`: number of steps since
 * the committed instant. If it fails, `exchange->failed` is the component's index. Then call
 * tl_exchange_rewind(), unless the error was fatal. */
tl_status tl_exchange_try(tl_exchange *exchange, int64_t step, uint32_t depth, tl_error *error);

/* Executes the committed macro step i = `step` of all components. States from before t_i cannot be
 * restored afterwards. After a failure, tl_exchange_rewind() can roll back if tl_exchange_begin()
 * was called or if executions are saved. */
tl_status tl_exchange_commit(tl_exchange *exchange, int64_t step, tl_error *error);

/* Call before macro step `step`: returns the first component that cannot be rolled back at this
 * step or `ahead` steps later; NULL: all components can. The component can still execute steps. */
const tl_component *tl_exchange_find_not_restorable(const tl_exchange *exchange, int64_t step, uint32_t ahead);

/* Between steps: copies a component's state at the committed instant, as
 * tl_cached_component_copy_root(). A module that keeps such a state beyond the next committed step
 * calls tl_exchange_keep_from() with true. When the module does not need the state any more, it
 * calls the function with false.
 */
tl_status tl_exchange_copy_state(tl_exchange *exchange, size_t component, fmi2FMUstate *state, fmi2FMUstate *full_copy,
                                 bool *taken, tl_error *error);
void tl_exchange_keep_from(tl_exchange *exchange, size_t component, bool is_kept_from);

/* As tl_exchange_keep_from() with true, for all components and the whole run. */
void tl_exchange_keep_always(tl_exchange *exchange);

/* For the rollback proof: save and restore all components and values, without the caches. The state
 * is saved in `home`, in place of the start of candidates. */
tl_status tl_exchange_save(tl_exchange *exchange, tl_error *error);
tl_status tl_exchange_restore(tl_exchange *exchange, tl_error *error);

/* For the rollback proof: every component executes macro step `step` from its present state with
 * the inputs in the ports. Then delivers the next sample of the plant. Does not use the caches. */
tl_status tl_exchange_step(tl_exchange *exchange, int64_t step, tl_error *error);

/* As tl_exchange_step(), but delivers these values of the plant's signals. */
tl_status tl_exchange_step_with(tl_exchange *exchange, int64_t step, const double *plant, tl_error *error);

/* For the rollback proof: keep_copies() saves a full copy of each component in addition to its
 * states. Call it before tl_exchange_save(). drop_copies() frees the copies.
 * restore_copy() restores every component from its copy or, if it has none, from its state. It
 * returns false if the given component has no copy, or if a restore fails.
 * `why`: NULL: the rollback methods stay. Else the text is the cause, or "". The given component
 *        then gets its next rollback method, because its states are wrong. So does every other
 *        component that cannot be restored. */
void tl_exchange_keep_copies(tl_exchange *exchange);
bool tl_exchange_restore_copy(tl_exchange *exchange, size_t component, const char *why);
void tl_exchange_drop_copies(tl_exchange *exchange);

/* Call it between steps, before macro step `step`, if the rollback of a component is not exact.
 * From now on the component is rolled back by its other method (tl_fmi2_fallback), starting with
 * its present state. If no other method can be used now, its gave_up_states remains false.
 * *emptied: all caches were emptied, also if the component has rejected the other method. */
tl_status tl_exchange_give_up_states(tl_exchange *exchange, size_t component, int64_t step, bool *emptied,
                                     tl_error *error);

/* Between steps, before macro step `step`: tl_exchange_take() saves the committed instant to
 * `home`. It is possible without an additional execution if can_take() is true.
 * tl_exchange_return() restores an instant that was loaded into `home`; call it before
 * tl_exchange_start(). */
bool tl_exchange_can_take(const tl_exchange *exchange);
tl_status tl_exchange_take(tl_exchange *exchange, int64_t step, tl_error *error);
tl_status tl_exchange_return(tl_exchange *exchange, tl_error *error);

/* Frees the states in a component's cache. Call it before the component is freed, but not after the
 * FMU returned fmi2Fatal. */
void tl_exchange_end_component(tl_exchange *exchange, size_t component);

#endif
