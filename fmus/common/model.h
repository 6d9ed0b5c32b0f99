/* What a model tells the FMI 2.0 glue about itself: its GUID, start values, a table of variables, two functions, and three
 * more where it reads something outside.
 *
 * Purpose: fmus/<model>/model.c holds equations only; everything FMI asks of a slave is in fmus/common, and what
 *          modelDescription.xml says of the model comes from there, in the description.h that description.py makes of it.
 * Values:  a model is one plain struct of fmi2Real, fmi2Integer, fmi2Boolean and tl_fmu_text members that owns nothing
 *          and points nowhere, so copying the struct saves the model, hidden states included.
 * Thread:  plain constant data; a model has no globals, so instances are independent of each other.
 */
#ifndef TL_FMUS_COMMON_MODEL_H
#define TL_FMUS_COMMON_MODEL_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include <fmi2TypesPlatform.h>

typedef enum tl_fmu_type { TL_FMU_REAL, TL_FMU_INTEGER, TL_FMU_BOOLEAN, TL_FMU_STRING } tl_fmu_type;

/* The member behind a TL_FMU_STRING, which must be a parameter: UTF-8, with its terminating NUL. */
typedef char tl_fmu_text[512];

/* When a variable may be set. All of them can be read. */
typedef enum tl_fmu_role {
    TL_FMU_FIXED,   /* parameter: until initialisation ends */
    TL_FMU_TUNABLE, /* parameter: until the end, while stepping too */
    TL_FMU_INPUT,   /* until the end, while stepping too */
    TL_FMU_RESULT   /* output or local variable: never */
} tl_fmu_role;

/* One row for each ScalarVariable of modelDescription.xml; references are unique for each type only. */
typedef struct tl_fmu_variable {
    tl_fmu_type type;
    fmi2ValueReference reference;
    tl_fmu_role role;
    size_t offset; /* of the member in the model's struct */
} tl_fmu_variable;

/* For a model that integrates nothing: its step is a macro step, whatever the size. So an event lasts for one. */
#define TL_FMU_WHOLE_STEPS SIZE_MAX

/* What a model has outside its struct, such as an open file: a type of the model's own, one for each instance. It is
 * not saved with a state, so what a step takes from it must depend on the struct and the time only. */
typedef struct tl_fmu_outside tl_fmu_outside;

typedef struct tl_fmu_look {
    double time;     /* s: the instant whose results are wanted */
    bool may_forget; /* no state from before the present one will come back */
    char *why;       /* where a sentence goes that tells why a look failed */
    size_t why_size; /* bytes, with the terminating NUL */
} tl_fmu_look;

enum { TL_FMU_GUID_SIZE = 40 }; /* with the terminating NUL */

typedef struct tl_fmu_model {
    char guid[TL_FMU_GUID_SIZE];
    size_t size;          /* of the model's struct, bytes */
    const void *defaults; /* the struct with the start values of modelDescription.xml */
    const tl_fmu_variable *variables;
    size_t variable_count;
    size_t t_step; /* offset of the fmi2Real with the inner step, s; must be > 0. Or TL_FMU_WHOLE_STEPS */

    /* Computes the start state and all results from parameters and inputs; may be called repeatedly. */
    void (*start)(void *model);

    /* Advances states and results by `h` seconds with the inputs as they are; h > 0, about t_step where there is one. */
    void (*step)(void *model, double h);

    /* All three or none. `open` makes an outside, which does nothing yet, or returns NULL when memory is out. `look`
     * brings the results up to look->time: after start() at the start time, and after the inner steps of each macro
     * step. It must not wait. False is the end of the call that needed it, with fmi2Error. */
    tl_fmu_outside *(*open)(void);
    bool (*look)(void *model, tl_fmu_outside *outside, const tl_fmu_look *look);
    void (*close)(tl_fmu_outside *outside);
} tl_fmu_model;

/* Defined once in each FMU, by its model.c. */
extern const tl_fmu_model tl_fmu_model_of_this_fmu;

/* That definition, in a file that includes description.h. `type` is the model's struct, with a member of its name for each
 * variable; what else there is to say of the model follows, by name. */
#define TL_FMU_MODEL(type, ...)                                                                                        \
    static const type defaults = {TL_FMU_START_VALUES};                                                                \
    static const tl_fmu_variable variables[] = {TL_FMU_VARIABLES(type)};                                               \
    TL_FMU_MODEL_WITH_TABLE(type, __VA_ARGS__)

/* The same for a model whose variables are not each a member of their own: it has `defaults` and `variables` by hand. */
#define TL_FMU_MODEL_WITH_TABLE(type, ...)                                                                             \
    const tl_fmu_model tl_fmu_model_of_this_fmu = {.guid = TL_FMU_GUID,                                                \
                                                   .size = sizeof(type),                                               \
                                                   .defaults = &defaults,                                              \
                                                   .variables = variables,                                             \
                                                   .variable_count = sizeof variables / sizeof variables[0],           \
                                                   __VA_ARGS__}

#endif
