/* One instance of an FMU: legal calls only, values by base type, saved states.
 *
 * Purpose: the co-simulation's view of an FMU. It knows the exchanged variables (its ports), calls
 *          the FMU in the order that FMI 2.0 allows, and maps every fmi2Status to a tl_status.
 * Source:  FMI 2.0.4, section 4.2.4 (state machine of calling sequence).
 * Status:  fmi2OK and fmi2Warning are success. fmi2Discard, fmi2Pending and fmi2Error are
 *          TL_FMU_FAILED: a saved state may be restored and the FMU used again. fmi2Fatal is
 *          TL_FMU_FATAL: no function of the FMU is called any more.
 * Owner:   the graph places components; ports and their values are in the graph's arena. The caller
 *          decides when a state is saved, restored and freed, and must free every handle
 *          (tl_component_forget()). The memory of a state belongs to the FMU or to the guard in
 *          front of it.
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

/* The exchanged variables of one direction, grouped by base type so that each group is one FMI
 * call. Enumerations are integers. */
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

/* All values of one direction as bytes: returns their size; copies them from the ports; copies them
 * to the ports. Equal values have equal bytes, except −0 and 0. */
size_t tl_ports_size(const tl_ports *ports);
void tl_ports_read(const tl_ports *ports, unsigned char *bytes);
void tl_ports_write(const tl_ports *ports, const unsigned char *bytes);

/* True if all are finite. */
bool tl_reals_are_finite(const fmi2Real *values, size_t count);

typedef enum tl_component_mode {
    TL_MODE_ABSENT, /* not instantiated, or freed */
    TL_MODE_INSTANTIATED,
    TL_MODE_INITIALIZING,
    TL_MODE_STEPPING,
    TL_MODE_FAILED, /* after fmi2Error: only restore and free are allowed */
    TL_MODE_DEAD    /* after fmi2Fatal: no call is allowed */
} tl_component_mode;

/* A start value, of the variable's own type. */
typedef struct tl_start_value {
    const tl_variable *variable;
    tl_value value;
} tl_start_value;

typedef struct tl_component {
    const char *name;
    const tl_model *model;
    const tl_fmi2 *fmi;
    const fmi2CallbackFunctions *callbacks; /* argument of fmi2Instantiate */
    const char *resources;                  /* argument of fmi2Instantiate */
    const tl_start_value *starts;
    size_t start_count;
    fmi2Component instance;
    tl_component_mode mode;
    tl_ports inputs;      /* connected inputs and adjusted variables: set before each step */
    tl_ports outputs;     /* connected and matched outputs: read after each step */
    bool logging;         /* fmi2Instantiate: loggingOn */
    bool replaces_states; /* the FMU returns a new handle instead of reusing the given one */
    bool reads_late;      /* the FMU gives no values in initialisation mode: outputs are read after it */
    bool gave_up_states;  /* its first rollback method was wrong: tl_component_restore_copy() has replaced it */
    bool hides_variables; /* the FMU has rejected to give an internal variable */
    bool says_final;   /* each step is reported as final, also if the caller passes false: for tests of the rollback */
    bool prefers_copy; /* tl_component_prefer_copy() is in effect */
    size_t reals_run;  /* number of components, from this one on, that one step_reals() can execute; 0: none */
    uint64_t executions; /* fmi2DoStep calls */
    double start_s;      /* the FMU's time at t = 0, s; the times of the calls below count from it */
    double stop_s;       /* the FMU's stop time, s; not above start_s: none */
} tl_component;

/* fmi2Instantiate; then start values may be set. If the FMU rejects it, it is called once more with
 * logging on, because some FMUs give the reason only then. */
tl_status tl_component_instantiate(tl_component *component, const fmi2CallbackFunctions *callbacks,
                                   const char *resources, tl_error *error);

/* Sets one variable before initialisation, in the variable's own type. */
tl_status tl_component_set_start(tl_component *component, const tl_variable *variable, const tl_value *value,
                                 tl_error *error);

/* Between steps: set and read a Real parameter that is tunable. */
tl_status tl_component_set_parameter(tl_component *component, const tl_variable *parameter, double value,
                                     tl_error *error);
tl_status tl_component_get_parameter(tl_component *component, const tl_variable *parameter, double *value,
                                     tl_error *error);

/* Sets all of `starts`. */
tl_status tl_component_set_starts(tl_component *component, tl_error *error);

/* Resets the FMU: fmi2Reset, and `starts` again. The caller initialises it then. Saved states still
 * belong to the FMU: free their handles or reuse them. TL_FMU_FAILED: use tl_component_renew(). */
tl_status tl_component_reset(tl_component *component, tl_error *error);

/* The same for an FMU that rejects fmi2Reset: fmi2FreeInstance, fmi2Instantiate, and `starts`
 * again. All its states must have been freed. */
tl_status tl_component_renew(tl_component *component, tl_error *error);

/* fmi2SetupExperiment (from start_s + `start`, s, to stop_s; no tolerance) and
 * fmi2EnterInitializationMode. */
tl_status tl_component_enter_initialization(tl_component *component, double start, tl_error *error);

/* fmi2ExitInitializationMode. */
tl_status tl_component_exit_initialization(tl_component *component, tl_error *error);

/* Writes the inputs to the FMU; reads the outputs from it. A Real output that is not finite is
 * replaced by NaN, always with the same bits. If the FMU rejects reading in initialisation mode (as
 * FMUs of ControlBuild do), the outputs keep their values. They are then not read again in that
 * mode. */
tl_status tl_component_set_inputs(tl_component *component, tl_error *error);
tl_status tl_component_get_outputs(tl_component *component, tl_error *error);

/* Sets the inputs, steps from start_s + `now` by `step` (both s), reads the outputs. If the FMU has
 * terminated itself, the error text says this, with the time.
 * `final`: no earlier state will be restored any more. An FMU that is rolled back by a copy or by
 * replay (tl_fmi2.always_final) always gets final steps, as in a run without rollback. The outputs
 * of some FMUs depend on `final`. */
tl_status tl_component_step(tl_component *component, double now, double step, bool final, tl_error *error);

/* The same for `count` components in one call. If one fails, *failed is its index, and those after
 * it were not stepped. Real outputs stay as the FMU gives them: see tl_component_mark_outputs(). */
tl_status tl_component_step_all(tl_component *components, size_t count, double now, double step, bool final,
                                size_t *failed, tl_error *error);

/* Whether a step counts as final for this FMU, if the caller says `final`. */
static inline fmi2Boolean tl_component_is_final(const tl_component *component, fmi2Boolean final) {
    return final != fmi2False || component->fmi->always_final || component->says_final ? fmi2True : fmi2False;
}

/* The step of one component in a step of many. */
static inline tl_fmi2_step tl_component_own_step(const tl_component *component, const tl_fmi2_step *step) {
    return (tl_fmi2_step){.now = component->start_s + step->now,
                          .size = step->size,
                          .final = tl_component_is_final(component, step->final)};
}

/* Hash of the FMU's outputs and internal variables (not String; the first TL_HASHED_VARIABLES), to
 * test a rollback. A difference may be in an internal variable long before an output shows it.
 * Returns 0 after an FMU has rejected to give one of them; it is not asked again. */
enum { TL_HASHED_VARIABLES = 4096 };
uint64_t tl_component_hash(tl_component *component);

/* Sets each Real output that is not finite to NaN, always with the same bits. */
void tl_component_mark_outputs(const tl_component *component);

/* Saves and restores the FMU's hidden state; needs canGetAndSetFMUstate. Port values belong to the
 * graph. A handle that is not NULL is reused; tl_component_forget() frees it. If an FMU has once
 * returned another handle than the given one, each handle is freed before the next save. Otherwise
 * some FMUs leak the old state, which would consume all memory within weeks. */
tl_status tl_component_save(tl_component *component, fmi2FMUstate *state, tl_error *error);
tl_status tl_component_restore(tl_component *component, fmi2FMUstate state, tl_error *error);

/* Makes and keeps a full copy of an FMU besides its own states (tl_fmi2_fallback), in case its
 * states are wrong. It replaces an earlier copy. Returns false if no copy could be made. */
bool tl_component_save_copy(tl_component *component);

/* Bytes that such a copy would take now; 0: unknown, or no copy can be made. */
size_t tl_component_copy_size(const tl_component *component);

/* Restores the kept copy. States saved after the copy are invalid: free them with
 * tl_component_forget() before this call. `why` NULL: the rollback method stays. Else: what is
 * wrong with it (may be ""); from now on the FMU has its next method (tl_fmi2_fallback). Returns
 * false if this is not possible; then the reason was logged. */
bool tl_component_restore_copy(tl_component *component, const char *why);

/* For an FMU with a kept copy: true if a copy of its memory could replace its own states. The
 * second function switches to copies because they are faster. The FMU must have no saved states and
 * be at the instant of the kept copy. `times`: the measured durations. Returns false
 * if it cannot switch. */
bool tl_component_has_choice(const tl_component *component);
bool tl_component_prefer_copy(tl_component *component, const tl_fmi2_times *times);

/* Frees the kept copy. */
void tl_component_drop_copy(const tl_component *component);

/* Reserves memory for `states` states at the same time, in addition to existing ones. TL_TRY_AGAIN
 * if memory is out. */
tl_status tl_component_reserve_states(const tl_component *component, size_t states, tl_error *error);

/* Bytes of one more state; 0: not known in advance. */
size_t tl_component_state_size(const tl_component *component);

/* True if the FMU declares that it can serialise a saved state. */
bool tl_component_can_serialize(const tl_component *component);

/* A saved state as bytes: returns their number; writes them; makes a state from them. Bytes are
 * valid only for the same FMU binary. A handle that is not NULL is reused. */
tl_status tl_component_serialized_size(tl_component *component, fmi2FMUstate state, size_t *size, tl_error *error);
tl_status tl_component_serialize(tl_component *component, fmi2FMUstate state, unsigned char *bytes, size_t size,
                                 tl_error *error);
tl_status tl_component_deserialize(tl_component *component, const unsigned char *bytes, size_t size,
                                   fmi2FMUstate *state, tl_error *error);

/* Frees a handle and sets it to NULL. Does nothing if it is NULL or if the FMU may not be called
 * any more. */
void tl_component_forget(tl_component *component, fmi2FMUstate *state);

/* Ends the instance as its mode allows; allowed in any mode. The caller checks that no other
 * instance of the same FMU has returned fmi2Fatal, because that forbids calls of all of them. */
void tl_component_free(tl_component *component);

#endif
