/* Interface between a model and the common FMI 2.0 code: GUID, start values, table of variables,
 * two functions, and three more functions if the model reads external data.
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

/* When a variable may be set. All variables can be read from initialisation on. */
typedef enum tl_fmu_role {
    TL_FMU_FIXED,   /* parameter: until the end of initialisation */
    TL_FMU_TUNABLE, /* parameter: until the instance terminates or a step fails */
    TL_FMU_INPUT,   /* as a tunable parameter */
    TL_FMU_RESULT   /* output or local variable: never */
} tl_fmu_role;

/* One row for each ScalarVariable of modelDescription.xml. Variables of different types may have
 * the same reference. */
typedef struct tl_fmu_variable {
    tl_fmu_type type;
    fmi2ValueReference reference;
    tl_fmu_role role;
    size_t offset; /* of the member in the model's struct, bytes */
} tl_fmu_variable;

/* t_step of a model without an integration: each macro step of any size is one inner step. So an
 * event lasts for one macro step. */
#define TL_FMU_WHOLE_STEPS SIZE_MAX

/* External data of a model outside its struct, for example an open file. The model defines the
 * type; each instance has its own data. They are not saved with a state. So a step that is repeated
 * from a restored state must give the same result. */
typedef struct tl_fmu_outside tl_fmu_outside;

typedef struct tl_fmu_look {
    double time;     /* time of the wanted results, s */
    bool may_forget; /* no state from before this step will be restored, so older data can be dropped */
    char *why;       /* buffer that receives the reason if the update fails */
    size_t why_size; /* bytes of the buffer */
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

    /* Advances states and results by `h` seconds with constant inputs. h > 0: near t_step, or the
     * whole macro step if that is shorter. */
    void (*step)(void *model, double h);

    /* All three or none. `open` allocates the external data without reading anything; returns NULL
     * if memory is out. `look` updates the results to look->time, without waiting. It is called
     * after the inner steps of each macro step, at the end of initialisation, and if a result is
     * read before. If it returns false, the FMI call fails with fmi2Error. */
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

/* The same for a model that has variables in arrays, for example. Its file must define `defaults`
 * and `variables`. */
#define TL_FMU_MODEL_WITH_TABLE(type, ...)                                                                             \
    const tl_fmu_model tl_fmu_model_of_this_fmu = {.guid = TL_FMU_GUID,                                                \
                                                   .size = sizeof(type),                                               \
                                                   .defaults = &defaults,                                              \
                                                   .variables = variables,                                             \
                                                   .variable_count = sizeof variables / sizeof variables[0],           \
                                                   __VA_ARGS__}

#endif
