/* One instance of an FMU: legal calls only, values by base type, snapshots.
 *
 * Purpose: the co-simulation's view of an FMU. It knows which variables are exchanged (its ports), calls the FMU
 *          in the order FMI 2.0 allows, and turns every fmi2Status into one of ours.
 * Source:  FMI 2.0.4, section 4.2.4 (state machine of calling sequence).
 * Status:  fmi2OK and fmi2Warning are success. fmi2Discard, fmi2Pending and fmi2Error are TL_FMU_FAILED: a saved state may
 *          be restored and the FMU used again. fmi2Fatal is TL_FMU_FATAL: nothing of the FMU is called ever after.
 * Owner:   placed by the graph; ports and their values live in the graph's arena.
 * Thread:  one thread at a time.
 */
#ifndef TL_MASTER_FMI_COMPONENT_H
#define TL_MASTER_FMI_COMPONENT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "master/base/simtime.h"
#include "master/base/status.h"
#include "master/fmi/fmi2.h"
#include "master/fmi/model.h"

/* The exchanged variables of one direction, grouped by base type so that each group is one FMI call. Enumerations
 * are integers. */
typedef struct tl_ports {
    size_t real_count;
    size_t integer_count;
    size_t boolean_count;
    fmi2ValueReference *real_references;
    fmi2ValueReference *integer_references;
    fmi2ValueReference *boolean_references;
    fmi2Real *reals;
    fmi2Integer *integers;
    fmi2Boolean *booleans;
} tl_ports;

/* All values of one direction as bytes: size, out of the ports, into the ports. Equal values have equal bytes but for
 * −0 and 0. */
size_t tl_ports_size(const tl_ports *ports);
void tl_ports_read(const tl_ports *ports, unsigned char *bytes);
void tl_ports_write(const tl_ports *ports, const unsigned char *bytes);

typedef enum tl_component_mode {
    TL_MODE_ABSENT, /* not instantiated, or freed */
    TL_MODE_INSTANTIATED,
    TL_MODE_INITIALIZING,
    TL_MODE_STEPPING,
    TL_MODE_FAILED, /* after fmi2Error: only restore and free */
    TL_MODE_DEAD    /* after fmi2Fatal: nothing */
} tl_component_mode;

/* A value that a variable gets before initialisation, of the variable's own type. */
typedef struct tl_start_value {
    const tl_variable *variable;
    tl_value value;
} tl_start_value;

typedef struct tl_component {
    const char *name;
    const tl_model *model;
    const tl_fmi2 *fmi;
    const fmi2CallbackFunctions *callbacks; /* as it was instantiated with, */
    const char *resources;                  /* and this */
    const tl_start_value *starts;
    size_t start_count;
    fmi2Component instance;
    tl_component_mode mode;
    tl_ports inputs;      /* connected inputs and adjusted variables: set before each step */
    tl_ports outputs;     /* connected and matched outputs: read after each step */
    bool logging;         /* fmi2Instantiate: loggingOn */
    bool replaces_states; /* a handle to be reused is not: the FMU made another one */
    bool gave_up_states;  /* tl_component_come_back() with a reason */
    bool says_final;      /* of each step, whatever its caller says: for a proof */
    bool prefers_copy;    /* tl_component_prefer_copy(), and has not gone back */
    bool reals_only;      /* no other ports: set by the exchange, once they are placed */
    uint64_t executions;  /* fmi2DoStep calls */
} tl_component;

/* fmi2Instantiate; then start values may be set. An FMU that refuses is asked a second time with its logging on, because some say
 * why only then. */
tl_status tl_component_instantiate(tl_component *component, const fmi2CallbackFunctions *callbacks,
                                   const char *resources, tl_error *error);

/* Sets one variable before initialisation. `value` has the variable's own type. */
tl_status tl_component_set_start(tl_component *component, const tl_variable *variable, const tl_value *value,
                                 tl_error *error);

/* Sets all of `starts`. */
tl_status tl_component_set_starts(tl_component *component, tl_error *error);

/* Begins anew: fmi2Reset, and `starts` again. What comes next is initialisation. States that were saved stay the FMU's until they are given
 * back, and their handles may be reused. TL_FMU_FAILED: tl_component_renew() is what is left. */
tl_status tl_component_reset(tl_component *component, tl_error *error);

/* The same for an FMU that refuses it: fmi2FreeInstance, fmi2Instantiate, and `starts` again. All its states must have been given back. */
tl_status tl_component_renew(tl_component *component, tl_error *error);

/* fmi2SetupExperiment (from `start`, s of simulated time; no stop time, no tolerance) and fmi2EnterInitializationMode. */
tl_status tl_component_enter_initialization(tl_component *component, double start, tl_error *error);

/* fmi2ExitInitializationMode. */
tl_status tl_component_exit_initialization(tl_component *component, tl_error *error);

/* Port values to the FMU, and from it. Outputs that are not finite are TL_FMU_FAILED. */
tl_status tl_component_set_inputs(tl_component *component, tl_error *error);
tl_status tl_component_get_outputs(tl_component *component, tl_error *error);

/* Sets the inputs, steps from `now` by `step` (both s of simulated time), reads the outputs.
 * final: no earlier state will be restored any more. An FMU that is led back in a way that it cannot know of (tl_fmi2.is_unaware) is told so in each step, as in a run that never goes back: there are some
 * whose outputs go by it. */
tl_status tl_component_step(tl_component *component, double now, double step, bool final, tl_error *error);

/* The same for `count` components one after the other, in one go. Where one fails, *failed is its index and those after it were
 * not stepped. Whether Real outputs are finite is not looked at: see tl_component_check_outputs(). */
tl_status tl_component_step_all(tl_component *components, size_t count, double now, double step, bool final,
                                size_t *failed, tl_error *error);

/* TL_FMU_FAILED where a Real output is not finite. */
tl_status tl_component_check_outputs(const tl_component *component, tl_error *error);

/* Snapshot of the FMU's hidden state; needs canGetAndSetFMUstate. Port values are the graph's business. A handle that is
 * not NULL is reused; one that is no longer wanted is given back by tl_component_forget(). An FMU that was once seen to answer
 * with another handle than the one it was to reuse has each freed first: some make a new state and lose the old one, which
 * in a twin that runs for weeks is all of the memory. */
tl_status tl_component_save(tl_component *component, fmi2FMUstate *state, tl_error *error);
tl_status tl_component_restore(tl_component *component, fmi2FMUstate state, tl_error *error);

/* Of an FMU whose own states may be wrong (tl_fmi2_aside): all that it knows is kept, besides its states. False: there is no way for it, and nothing is kept. */
bool tl_component_keep(tl_component *component);

/* Bytes that this would take now; 0: not known, or there is no way. */
size_t tl_component_keeping_takes(const tl_component *component);

/* Back to what was kept. Its states that were made since are none: they are to be forgotten before. With `why`, which says in which way its states are wrong and may be "", states are made and
 * restored in this other way from now on. False: the FMU cannot, and has said why. */
bool tl_component_come_back(tl_component *component, const char *why);

/* Of one that was kept: whether a copy of its memory would do in place of its own states; and that it does from now on, since it is faster. None of its states is there, and it stands
 * where it was kept. False: it cannot. */
bool tl_component_has_choice(const tl_component *component);
bool tl_component_prefer_copy(tl_component *component, const tl_fmi2_times *times);

/* What was kept is not needed any more. */
void tl_component_let_go(const tl_component *component);

/* So many states more will be had at a time, beside those that there are. TL_TRY_AGAIN: there is no memory for them. */
tl_status tl_component_reserve_states(const tl_component *component, size_t states, tl_error *error);

/* Bytes that one state more takes; 0: nobody knows without looking. */
size_t tl_component_state_size(const tl_component *component);

/* Whether the FMU says that it can turn a saved state into bytes and back. */
bool tl_component_can_serialize(const tl_component *component);

/* A saved state as bytes: how many there are, the bytes, and a state from bytes. Bytes are for the same FMU binary only. A handle
 * that is not NULL is reused. */
tl_status tl_component_serialized_size(tl_component *component, fmi2FMUstate state, size_t *size, tl_error *error);
tl_status tl_component_serialize(tl_component *component, fmi2FMUstate state, unsigned char *bytes, size_t size,
                                 tl_error *error);
tl_status tl_component_deserialize(tl_component *component, const unsigned char *bytes, size_t size,
                                   fmi2FMUstate *state, tl_error *error);

/* Frees a handle and makes it NULL; nothing where it is NULL or the FMU may not be called any more. */
void tl_component_forget(tl_component *component, fmi2FMUstate *state);

/* Ends the instance as its mode allows. May be called in any mode. The caller sees to it that no other instance of the
 * same FMU has answered fmi2Fatal: that is for all of them. */
void tl_component_free(tl_component *component);

#endif
