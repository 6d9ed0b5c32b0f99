/* One FMU instance, as the common FMI code sees it: its mode and the content of a saved state.
 *
 * Purpose: shared by life.c, values.c, state.c and instance.c; a model never includes this file.
 * Errors:  a call that FMI forbids in this mode, or one with wrong arguments, is rejected: it
 *          changes nothing, logs the reason and returns fmi2Error. Only two errors lead to
 *          TL_FMU_FAILED: a step with a result that is not finite, and a step whose external data
 *          is missing.
 * Thread:  one thread at a time for each instance.
 */
#ifndef TL_FMUS_COMMON_INSTANCE_H
#define TL_FMUS_COMMON_INSTANCE_H

#include <stdbool.h>
#include <stdint.h>

#include <fmi2Functions.h>

#include "fmus/common/model.h"

/* Modes of an instance in the state machine of FMI 2.0 (4.2.4). They are bits, so that a set of
 * modes is their sum. */
typedef enum tl_fmu_mode {
    TL_FMU_INSTANTIATED = 1,
    TL_FMU_INITIALISING = 2,
    TL_FMU_STEPPING = 4, /* "stepComplete" */
    TL_FMU_FAILED = 8,   /* "error": only fmi2Reset, fmi2SetFMUstate or fmi2FreeInstance leave it */
    TL_FMU_TERMINATED = 16
} tl_fmu_mode;

enum {
    TL_FMU_ANY_MODE = 31,
    TL_FMU_SETTABLE = TL_FMU_INSTANTIATED | TL_FMU_INITIALISING | TL_FMU_STEPPING,
    TL_FMU_GETTABLE = TL_FMU_INITIALISING | TL_FMU_STEPPING | TL_FMU_FAILED | TL_FMU_TERMINATED
};

/* All data that fmi2GetFMUstate saves. It has no pointers, so a copy of its bytes is the serialised
 * state. */
typedef struct tl_fmu_state {
    char guid[TL_FMU_GUID_SIZE]; /* of the FMU that saved the state */
    int64_t mode;                /* tl_fmu_mode */
    double time;                 /* s, end of the last step */
    double stop_time;            /* s; HUGE_VAL if it is not defined */
    double model[];              /* the model's struct; the type double is for its alignment */
} tl_fmu_state;

typedef struct tl_fmu_instance {
    char *name;                /* a copy owned by the instance */
    fmi2CallbackLogger logger; /* may be NULL */
    fmi2ComponentEnvironment environment;
    bool log_events;
    tl_fmu_state *state;
    tl_fmu_outside *outside; /* NULL if the model has none */
} tl_fmu_instance;

/* Returns the instance of `component` if its present mode is one of `modes`. Otherwise logs that
 * `function` is not allowed and returns NULL. If `component` is NULL, returns NULL without a log.
 */
tl_fmu_instance *tl_fmu_enter(fmi2Component component, const char *function, int modes);

/* Logs why a call is rejected. `format`: as for printf. Returns fmi2Error in all cases. */
fmi2Status tl_fmu_refuse(const tl_fmu_instance *instance, const char *format, ...)
    __attribute__((format(printf, 2, 3)));

/* Logs a life-cycle event, if the category logEvents is on. */
void tl_fmu_log_event(const tl_fmu_instance *instance, const char *text);

/* Creates an instance with the model's defaults. Returns NULL if memory is out. Free it with
 * tl_fmu_release(). */
tl_fmu_instance *tl_fmu_create(fmi2String name, const fmi2CallbackFunctions *functions);

/* Frees an instance with its external data. */
void tl_fmu_release(tl_fmu_instance *instance);

/* Resets the state to the model's defaults and to TL_FMU_INSTANTIATED. Does not change the model's
 * external data. */
void tl_fmu_set_defaults(tl_fmu_instance *instance);

/* If the model uses external data, updates its results to the time of the state plus `ahead`
 * seconds. `function`: FMI function, for the log. `may_forget`: see tl_fmu_look. If the update
 * fails, logs the reason and returns fmi2Error. */
fmi2Status tl_fmu_look_outside(const tl_fmu_instance *instance, const char *function, double ahead, bool may_forget);

/* Returns the size of a saved state in bytes, including the model. */
size_t tl_fmu_state_size(void);

/* Returns true if all Real results are finite. */
bool tl_fmu_results_finite(const tl_fmu_instance *instance);

#endif
