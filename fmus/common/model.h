/* Interface between a model and the common FMI 2.0 code: GUID, start values, a table of variables,
 * two functions, and three more if the model reads external data.
 *
 * Purpose: fmus/<model>/model.c contains equations only; fmus/common implements FMI. description.py
 *          generates description.h from modelDescription.xml, so both agree.
 * Values:  a model is one plain struct of fmi2Real, fmi2Integer, fmi2Boolean and tl_fmu_text
 *          members. It owns no memory and has no pointers. So a copy of the struct saves the model
 *          with its hidden states.
 * Thread:  constant data; a model has no globals, so instances are independent.
 */
#ifndef TL_FMUS_COMMON_MODEL_H
#define TL_FMUS_COMMON_MODEL_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include <fmi2TypesPlatform.h>

typedef enum tl_fmu_type { TL_FMU_REAL, TL_FMU_INTEGER, TL_FMU_BOOLEAN, TL_FMU_STRING } tl_fmu_type;

/* Type of the member for a TL_FMU_STRING, which must be a parameter: UTF-8 with its terminating
 * NUL. */
typedef char tl_fmu_text[512];

/* When a variable may be set. All variables can be read. */
typedef enum tl_fmu_role {
    TL_FMU_FIXED,   /* parameter: until the end of initialisation */
    TL_FMU_TUNABLE, /* parameter: at any time until the end, also while stepping */
    TL_FMU_INPUT,   /* at any time until the end, also while stepping */
    TL_FMU_RESULT   /* output or local variable: never */
} tl_fmu_role;

/* One row for each ScalarVariable of modelDescription.xml. References are unique within a type
 * only. */
typedef struct tl_fmu_variable {
    tl_fmu_type type;
    fmi2ValueReference reference;
    tl_fmu_role role;
    size_t offset; /* of the member in the model's struct, bytes */
} tl_fmu_variable;

/* For a model that integrates nothing: its step is the macro step, whatever its size. So an event
 * lasts for one macro step. */
#define TL_FMU_WHOLE_STEPS SIZE_MAX

/* External data of a model outside its struct, for example an open file. The model defines the
 * type; each instance has one. It is not saved with a state. So the result of a step must depend
 * only on the struct and the time. */
typedef struct tl_fmu_outside tl_fmu_outside;

typedef struct tl_fmu_look {
    double time;     /* s: instant of the wanted results */
    bool may_forget; /* no state from before the present one will be restored */
    char *why;       /* receives the reason if the update fails */
    size_t why_size; /* bytes, including the terminating NUL */
} tl_fmu_look;

enum { TL_FMU_GUID_SIZE = 40 }; /* including the terminating NUL */

typedef struct tl_fmu_model {
    char guid[TL_FMU_GUID_SIZE];
    size_t size;          /* of the model's struct, bytes */
    const void *defaults; /* the struct with the start values of modelDescription.xml */
    const tl_fmu_variable *variables;
    size_t variable_count;
    size_t t_step; /* offset of the fmi2Real with the inner step in s, which must be > 0; or TL_FMU_WHOLE_STEPS */

    /* Computes the start state and all results from parameters and inputs; may be called
     * repeatedly. */
    void (*start)(void *model);

    /* Advances states and results by `h` seconds with constant inputs; h > 0, close to t_step if
     * there is one. */
    void (*step)(void *model, double h);

    /* All three or none. `open` allocates the external data without reading anything; returns NULL
     * if memory is out. `look` updates the results to look->time: after start() at the start time,
     * and after the inner steps of each macro step. It must not wait. If it returns false, the FMI
     * call fails with fmi2Error. */
    tl_fmu_outside *(*open)(void);
    bool (*look)(void *model, tl_fmu_outside *outside, const tl_fmu_look *look);
    void (*close)(tl_fmu_outside *outside);
} tl_fmu_model;

/* Each FMU defines it once, in its model.c. */
extern const tl_fmu_model tl_fmu_model_of_this_fmu;

/* Defines tl_fmu_model_of_this_fmu, in a file that includes description.h. `type`: the model's
 * struct, with one member of the same name for each variable. `...`: the other fields of
 * tl_fmu_model, by name. */
#define TL_FMU_MODEL(type, ...)                                                                                        \
    static const type defaults = {TL_FMU_START_VALUES};                                                                \
    static const tl_fmu_variable variables[] = {TL_FMU_VARIABLES(type)};                                               \
    TL_FMU_MODEL_WITH_TABLE(type, __VA_ARGS__)

/* The same for a model whose variables are not all members of their own: its file defines
 * `defaults` and `variables`. */
#define TL_FMU_MODEL_WITH_TABLE(type, ...)                                                                             \
    const tl_fmu_model tl_fmu_model_of_this_fmu = {.guid = TL_FMU_GUID,                                                \
                                                   .size = sizeof(type),                                               \
                                                   .defaults = &defaults,                                              \
                                                   .variables = variables,                                             \
                                                   .variable_count = sizeof variables / sizeof variables[0],           \
                                                   __VA_ARGS__}

#endif
