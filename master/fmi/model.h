/* Contents of a modelDescription.xml: variables, units and capabilities of one FMU.
 *
 * Purpose: read-only facts, shared by every instance of the FMU.
 * Owner:   the module that parsed the file owns the memory of all texts and arrays.
 * Source:  FMI 2.0.4, section 2.2 and 4.3.
 */
#ifndef TL_MASTER_FMI_MODEL_H
#define TL_MASTER_FMI_MODEL_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "master/base/signal.h"

typedef enum tl_causality {
    TL_PARAMETER,
    TL_CALCULATED_PARAMETER,
    TL_INPUT,
    TL_OUTPUT,
    TL_LOCAL,
    TL_INDEPENDENT
} tl_causality;

typedef enum tl_variability { TL_CONSTANT, TL_FIXED, TL_TUNABLE, TL_DISCRETE, TL_CONTINUOUS } tl_variability;

/* Attribute `initial` of FMI: how the start value is used. Inputs and the independent variable have
 * no such attribute; inputs may have a start value. Exact and approximate start values may be set
 * before initialisation, unless constant; calculated ones may not. */
typedef enum tl_initial { TL_INITIAL_NONE, TL_INITIAL_EXACT, TL_INITIAL_APPROX, TL_INITIAL_CALCULATED } tl_initial;

/* A unit: value in base units = factor · (value in this unit) + offset. */
typedef struct tl_unit {
    const char *name;
    bool has_base;    /* exponents, factor and offset were given */
    int exponents[8]; /* kg, m, s, A, K, mol, cd, rad */
    double factor;
    double offset;
} tl_unit;

/* A value of any base type; Boolean as 0 or 1, Enumeration as integer. */
typedef struct tl_value {
    tl_type type;
    double real;
    int32_t integer;  /* Integer, Enumeration, Boolean */
    const char *text; /* String */
} tl_value;

typedef struct tl_variable {
    const char *name;
    const char *description; /* "" if there is none */
    uint32_t reference;      /* unique only within a base type */
    tl_type type;
    tl_causality causality;
    tl_variability variability;
    const tl_unit *unit; /* NULL if none is declared; Real only; may have no base */
    bool has_start;
    tl_value start;
    double minimum; /* −infinity if none is declared */
    double maximum; /* +infinity if none is declared */
    double nominal; /* > 0; 1 if none is declared */
    uint64_t items; /* Enumeration: bit k is set if minimum + k exists; 0: not known, or more than 64 values */
    tl_initial initial;
    bool is_ambiguous; /* another variable has the same name: neither can be used */
} tl_variable;

typedef struct tl_capabilities {
    bool can_be_instantiated_only_once;
    bool can_get_and_set_state;
    bool can_serialize_state;
} tl_capabilities;

typedef struct tl_model {
    const char *name;
    const char *identifier; /* modelIdentifier of CoSimulation: name of the binary */
    const char *guid;
    const char *generation_tool; /* "" if there is none */
    tl_capabilities capabilities;
    double start_time; /* of DefaultExperiment, s; NaN: not declared */
    double stop_time;  /* of DefaultExperiment, s; NaN: not declared */
    const tl_variable *variables;
    size_t variable_count;
    const tl_unit *units; /* of UnitDefinitions; then those that only variables mention, without a base */
    size_t unit_count;
} tl_model;

/* Largest number of variables that tl_model_nearest() compares. */
enum { TL_MODEL_COMPARED = 10000 };

/* The variable of that name, or NULL. O(variable_count). */
const tl_variable *tl_model_variable(const tl_model *model, const char *name);

/* For a misspelt name: the most similar name of a variable; NULL if none is near (text.h: at most 2
 * edits). Compares only the first TL_MODEL_COMPARED variables. */
const char *tl_model_nearest(const tl_model *model, const char *name);

/* The unit of that name, or NULL. */
const tl_unit *tl_model_unit(const tl_model *model, const char *name);

/* "parameter", "input", … as FMI 2.0 writes them; "none" for TL_INITIAL_NONE. */
const char *tl_causality_name(tl_causality causality);
const char *tl_variability_name(tl_variability variability);
const char *tl_initial_name(tl_initial initial);

#endif
