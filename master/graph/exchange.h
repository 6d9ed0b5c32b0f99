/* Co-simulation: values, initialisation, Jacobi macro steps of candidates, the committed step.
 *
 * Purpose: algorithms 1, 2 and 4 of the thesis. In step i every component steps once with its
 *          present inputs, then all outputs are read, then all inputs are assigned through the
 *          connections. A candidate starts with the committed values of t_i and runs over the
 *          horizon; the committed step advances t_i.
 * Saving:  by structure (approach 1) component k takes part only in the first reach[k] = Γ_k steps
 *          of a candidate; by sequences (approach 2) each component has a cache. Neither changes a
 *          committed value by a bit.
 * NaN:     a Real output that is not finite is NaN and is not delivered: the inputs that read it
 *          keep their last value. They belong to the port values, so each candidate starts with
 *          those of the committed instant.
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
    fmi2Real *adjusted; /* the input that a cut connection drives only during initialisation; else NULL */
} tl_real_copy;

typedef struct tl_integer_copy {
    fmi2Integer *to; /* fmi2Boolean is the same C type */
    const fmi2Integer *from;
    fmi2Integer *adjusted; /* as above */
} tl_integer_copy;

/* Input of an adjusted variable: where the exchange holds u and û, by its type. */
typedef struct tl_adjusted_input {
    fmi2Real *real;                       /* u; NULL: it is Boolean */
    fmi2Boolean *boolean;                 /* u; NULL: it is Real */
    const fmi2Real *delivered_real;       /* û of a connection that is cut */
    const fmi2Boolean *delivered_boolean; /* both NULL: no connection delivers û */
    double nominal;                       /* û in that case */
} tl_adjusted_input;

/* Inputs and outputs of one component in a committed step, and its inputs in the last candidate, as
 * bytes of its ports (tl_ports_read()). */
typedef struct tl_exchange_note {
    size_t component;
    unsigned char *inputs;
    unsigned char *outputs;
    unsigned char *tried; /* one entry of tried_bytes for each depth below tried_most */
    size_t tried_bytes;
    uint32_t tried_most;
    uint32_t tried_count; /* entries that have been set */
} tl_exchange_note;

typedef struct tl_exchange {
    tl_component *components;
    size_t component_count;
    tl_plant plant;
    tl_time step;                /* T_S */
    double step_s;               /* the same, s */
    uint32_t *reach;             /* Γ_k of each component, the plant is the last; NULL: all take part in all steps */
    tl_cached_component *cached; /* one per component; NULL: nothing is saved by sequences */
    uint32_t beside;             /* states of each component that other modules keep, within the same bound */
    tl_state_room *rooms;        /* one per component, for its cache; filled by tl_exchange_start() */
    bool whole;                  /* nothing is saved: all components execute in one call */
    tl_costs costs;              /* of executions */
    uint64_t executions;         /* of all components without the plant */
    size_t failed;               /* the component at which the last macro step failed */
    unsigned char *values;       /* reals, then integers, then booleans of all ports; then û of cut connections */
    tl_snapshot home;            /* where candidates start; with caches, its values only */
    bool *is_kept;               /* of each component: a full copy exists during a proof */
    int64_t begun;               /* first step of the FMUs */
    tl_exchange_note *note;      /* the committed step is noted there; NULL: it is not */
    bool is_kept_from;           /* a module keeps a state from before the committed instant: no step is final */
    bool is_kept_always;         /* the same for the whole run */
    const fmi2Real *outputs;     /* the Real outputs of all components, contiguous */
    size_t output_count;
    size_t values_size;
    size_t real_count;    /* of `values`, at its start */
    tl_real_copy *copies; /* connections without unit conversion */
    size_t copy_count;
    tl_real_copy *conversions;
    size_t conversion_count;
    tl_integer_copy *integer_copies;
    size_t integer_copy_count;
    tl_adjusted_input adjusted[TL_MAX_ADJUST]; /* by variable */
} tl_exchange;

/* Places all values and copies; the graph must be complete. `window`: samples of the plant that are
 * kept. */
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

/* Changes û of a variable that no connection delivers; u stays. */
void tl_exchange_set_nominal(tl_exchange *exchange, size_t variable, double nominal);

/* The present u; and the present û. */
double tl_exchange_adjusted(const tl_exchange *exchange, size_t variable);
double tl_exchange_nominal(const tl_exchange *exchange, size_t variable);

/* Sets all values to those before the first initialisation. */
void tl_exchange_clear(tl_exchange *exchange, const tl_graph *graph);

/* Initialises all components at the instant of macro step `first`: fmi2SetupExperiment …
 * fmi2ExitInitializationMode, with outputs and inputs exchanged in between until they agree. The
 * plant must have a sample; that of tick `shown` is delivered first. If FMUs reject reading in
 * initialisation mode and then fail, all are instantiated again, and those are not read in it. */
tl_status tl_exchange_initialize(tl_exchange *exchange, int64_t first, int64_t shown, tl_error *error);

/* Assigns all inputs from the outputs, except from those that are NaN. */
void tl_exchange_deliver(tl_exchange *exchange);

/* True if all Real outputs of the FMUs are finite. */
bool tl_exchange_is_finite(const tl_exchange *exchange);

/* Enables saving of executions, before initialisation: `reach` has an entry per component and for
 * the plant, or is NULL; `capacity` has the nodes of each cache, or is NULL. Both must stay valid.
 */
bool tl_exchange_save_executions(tl_exchange *exchange, tl_arena *arena, const tl_keep *keep, uint32_t *reach,
                                 const uint32_t *capacity, uint32_t prediction);

/* Expected cost of `steps` macro steps of all components, ns. */
tl_time tl_exchange_cost(const tl_exchange *exchange, tl_time steps);

/* After initialisation: t_0 is the committed instant. With caches, saves the first states. All
 * states together, at their present size, stay within `bytes` (0: no bound), except the two that
 * each component must have. `heap` as in tl_cached_component_measure(). */
tl_status tl_exchange_start(tl_exchange *exchange, uint64_t bytes, size_t (*heap)(void), tl_error *error);

/* The same after all FMUs were reset and initialised at the instant of macro step `step`: drops all
 * saved results. */
tl_status tl_exchange_reset(tl_exchange *exchange, int64_t step, tl_error *error);

/* Between steps, before macro step `step`: empties the caches and counts all executions from 0.
 * *done is false, and nothing is dropped, if an FMU would have to be executed again for it. */
tl_status tl_exchange_forget(tl_exchange *exchange, int64_t step, bool *done, tl_error *error);

/* Makes the committed values and states the start of candidates. Once per step, before the first
 * candidate. Without caches it saves all states; with caches it calls no FMU and cannot fail. */
tl_status tl_exchange_begin(tl_exchange *exchange, tl_error *error);

/* True if a component (the plant is the last one) takes part at a depth. Then: its step as in
 * tl_exchange_try(), from the position of its cache; and the converted value of a connection's
 * source, or the input's present value if that is not finite. */
bool tl_exchange_takes_part(const tl_exchange *exchange, size_t component, uint32_t depth);
tl_status tl_exchange_advance(tl_exchange *exchange, size_t component, int64_t step, uint32_t depth, tl_error *error);
double tl_exchange_convert(const tl_real_copy *copy);

/* Returns to the start of candidates. Without caches it restores all states; with caches it cannot
 * fail. */
tl_status tl_exchange_rewind(tl_exchange *exchange, tl_error *error);

/* Executes a candidate's macro step, from t_step to t_(step+1); `depth` counts from 0 at the
 * committed instant. If it fails, `failed` is the component, and tl_exchange_rewind() rolls back
 * unless the error was fatal. */
tl_status tl_exchange_try(tl_exchange *exchange, int64_t step, uint32_t depth, tl_error *error);

/* Executes the committed macro step of all components. No state before t_step will be needed any
 * more. If it fails, tl_exchange_rewind() rolls back, if tl_exchange_begin() was called or
 * executions are saved. */
tl_status tl_exchange_commit(tl_exchange *exchange, int64_t step, tl_error *error);

/* Before macro step `step`: the first component that cannot be rolled back any more, or not `ahead`
 * steps later; NULL: all can. It can still be stepped. */
const tl_component *tl_exchange_find_free(const tl_exchange *exchange, int64_t step, uint32_t ahead);

/* Between steps: copies a component's state at the committed instant, as
 *                tl_cached_component_copy_root(). The second function tells whether a module keeps
 *                such a state for longer. */
tl_status tl_exchange_copy_state(tl_exchange *exchange, size_t component, fmi2FMUstate *state, fmi2FMUstate *full_copy,
                                 bool *taken, tl_error *error);
void tl_exchange_keep_from(tl_exchange *exchange, size_t component, bool is_kept_from);

/* The same for all components and the whole run. */
void tl_exchange_keep_always(tl_exchange *exchange);

/* Saves and restores all components and values without the caches, for the rollback proof. Uses the
 * place where candidates start. */
tl_status tl_exchange_save(tl_exchange *exchange, tl_error *error);
tl_status tl_exchange_restore(tl_exchange *exchange, tl_error *error);

/* Without the caches: every component executes macro step `step` from its present state with the
 * inputs in the ports; then the following sample is delivered. */
tl_status tl_exchange_step(tl_exchange *exchange, int64_t step, tl_error *error);

/* For the rollback proof: keeps a full copy of each component besides its states, before
 * tl_exchange_save(). tl_exchange_restore_copy() restores this copy, which the given component must
 * have. With `why`, which may be "", the states of that component are wrong and are not used any
 * more. Other components are restored from their copies too, or get their next rollback method.
 * Returns false if that is not possible. */
void tl_exchange_keep_copies(tl_exchange *exchange);
bool tl_exchange_restore_copy(tl_exchange *exchange, size_t component, const char *why);
void tl_exchange_drop_copies(tl_exchange *exchange);

/* Between steps, before macro step `step`: the rollback of a component is not exact. From now on it
 * is saved and restored by its other method (tl_fmi2_fallback), from its present state; all caches
 * are emptied. *done is false if there is no such method, or not now. */
tl_status tl_exchange_give_up_states(tl_exchange *exchange, size_t component, int64_t step, bool *done,
                                     tl_error *error);

/* Saves the committed instant, before macro step `step`, to `home`; between steps only. If
 * can_take() is false, an FMU would have to catch up for it. tl_exchange_return() restores what was
 * loaded into `home`, before tl_exchange_start(). */
bool tl_exchange_can_take(const tl_exchange *exchange);
tl_status tl_exchange_take(tl_exchange *exchange, int64_t step, tl_error *error);
tl_status tl_exchange_return(tl_exchange *exchange, tl_error *error);

/* Frees the states in a component's cache, before the component is freed. Not for an FMU that may
 * not be called any more. */
void tl_exchange_end_component(tl_exchange *exchange, size_t component);

#endif
