/* One FMU instance as the glue's own files see it: where it is in its life, and what a saved state holds.
 *
 * Purpose: shared by life.c, values.c, state.c and instance.c; a model never includes this.
 * Errors:  a call that FMI forbids here, or with wrong arguments, is refused: it changes nothing, is told to
 *          the logger and returns fmi2Error. Only a step whose result is not finite, or that does not find
 *          outside what it needs, ends in TL_FMU_FAILED.
 * Thread:  one thread at a time for each instance.
 */
#ifndef TL_FMUS_COMMON_INSTANCE_H
#define TL_FMUS_COMMON_INSTANCE_H

#include <stdbool.h>
#include <stdint.h>

#include <fmi2Functions.h>

#include "fmus/common/model.h"

/* Where an instance is in the state machine of FMI 2.0 (4.2.4); bits, so that a call can name several. */
typedef enum tl_fmu_mode {
    TL_FMU_INSTANTIATED = 1,
    TL_FMU_INITIALISING = 2,
    TL_FMU_STEPPING = 4, /* "stepComplete" */
    TL_FMU_FAILED = 8,   /* "error": left by fmi2Reset, fmi2SetFMUstate or fmi2FreeInstance */
    TL_FMU_TERMINATED = 16
} tl_fmu_mode;

enum {
    TL_FMU_ANY_MODE = 31,
    TL_FMU_SETTABLE = TL_FMU_INSTANTIATED | TL_FMU_INITIALISING | TL_FMU_STEPPING,
    TL_FMU_GETTABLE = TL_FMU_INITIALISING | TL_FMU_STEPPING | TL_FMU_FAILED | TL_FMU_TERMINATED
};

/* All that fmi2GetFMUstate saves. No pointers, so that serialising is copying. The model's struct follows. */
typedef struct tl_fmu_state {
    char guid[TL_FMU_GUID_SIZE]; /* whose state this is */
    int64_t mode;                /* tl_fmu_mode */
    double time;                 /* s, where the last step ended */
    double stop_time;            /* s, HUGE_VAL where none is defined */
    double model[];              /* as double for its alignment */
} tl_fmu_state;

typedef struct tl_fmu_instance {
    char *name;                /* own copy */
    fmi2CallbackLogger logger; /* may be NULL */
    fmi2ComponentEnvironment environment;
    bool log_events;
    tl_fmu_state *state;
    tl_fmu_outside *outside; /* NULL for a model that has none */
} tl_fmu_instance;

/* The instance behind `component` if `function` is legal in its present mode (one of `modes`); else NULL. */
tl_fmu_instance *tl_fmu_enter(fmi2Component component, const char *function, int modes);

/* Tells the logger why a call is refused. Always fmi2Error. `format` as for printf. */
fmi2Status tl_fmu_refuse(const tl_fmu_instance *instance, const char *format, ...)
    __attribute__((format(printf, 2, 3)));

/* Tells the logger about a life-cycle event, where the category logEvents is on. */
void tl_fmu_log_event(const tl_fmu_instance *instance, const char *text);

/* A zeroed instance with the model's defaults, or NULL when memory is out. Released by tl_fmu_release(). */
tl_fmu_instance *tl_fmu_create(fmi2String name, const fmi2CallbackFunctions *functions);
void tl_fmu_release(tl_fmu_instance *instance);

/* Back to the model's defaults and to TL_FMU_INSTANTIATED. What the model has outside is as it was. */
void tl_fmu_set_defaults(tl_fmu_instance *instance);

/* Lets the model look outside, where it does such things, for its results at the instance's time plus `ahead`
 * seconds. fmi2Error, told to the logger, where it cannot. */
fmi2Status tl_fmu_look_outside(const tl_fmu_instance *instance, const char *function, double ahead, bool may_forget);

/* Bytes of a whole saved state, model included. */
size_t tl_fmu_state_size(void);

/* True if all real results are finite. */
bool tl_fmu_results_finite(const tl_fmu_instance *instance);

#endif
