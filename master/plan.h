/* The plan of a twin: everything a twin is built from, names not yet resolved.
 *
 * Purpose: the one description that a configuration becomes and that tests write by hand. twin.h checks it
 *          (names, types, units, paths, horizon) and builds the twin from it.
 * Owner:   the caller; everything a plan points to must outlive the twin (models, functions, texts).
 * Names:   "component.variable" for a variable of an FMU, "plant.signal" for a signal of the plant.
 * Where:   each item carries `where`, its JSON path ("synchronise.adjust.motor.d"), so that a problem can be reported
 *          where the user wrote it; "" is allowed.
 */
#ifndef TL_MASTER_PLAN_H
#define TL_MASTER_PLAN_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "master/base/signal.h"
#include "master/base/simtime.h"
#include "master/base/status.h"
#include "master/fmi/fmi2.h"
#include "master/fmi/model.h"

/* A variable that gets a value before the FMU is initialised. */
typedef struct tl_plan_set {
    const char *where;
    const char *variable;
    tl_value value; /* TL_REAL for any number (also for an Integer or Enumeration variable), TL_BOOLEAN or TL_STRING */
} tl_plan_set;

typedef struct tl_plan_component {
    const char *where;
    const char *name; /* unique; not "plant" */
    const tl_model *model;
    const tl_fmi2 *functions;
    const fmi2CallbackFunctions *callbacks;
    const char *resources; /* file:/// URI of the unpacked resources folder */
    const tl_plan_set *set;
    size_t set_count;
} tl_plan_component;

/* A signal of the plant: an output of the component "plant". */
typedef struct tl_plan_signal {
    const char *where;
    const char *name;
    tl_type type;     /* TL_REAL, TL_INTEGER or TL_BOOLEAN */
    const char *unit; /* "" where none is given */
    bool has_initial;
    double initial; /* delivered until there is a first good reading; else the start value of what it drives */
} tl_plan_signal;

typedef struct tl_plan_connection {
    const char *where;
    const char *from;
    const char *to;
} tl_plan_connection;

/* A variable the optimiser may change: a Real input, or a tunable Real parameter. */
typedef struct tl_plan_adjust {
    const char *where;
    const char *variable;
    bool has_nominal;
    double nominal; /* used where no connection delivers û; default: the start value */
    double step;    /* first step of the search, > 0, in the variable's unit */
    double lower;   /* −infinity: none; the variable's declared minimum holds as well */
    double upper;
} tl_plan_adjust;

/* A simulated output and the plant signal it is compared with. */
typedef struct tl_plan_match {
    const char *where;
    const char *variable; /* "component.variable" */
    const char *to;       /* "plant.signal" */
    double tolerance;     /* > 0, in the variable's unit; may be 1 where weight is 0 */
    double weight;        /* 0: compared and reported, not matched */
} tl_plan_match;

/* An output that is only read, by tl_twin_output(). */
typedef struct tl_plan_output {
    const char *where;
    const char *variable; /* "component.variable" */
} tl_plan_output;

/* Which measurements a step uses (METHOD decision 4, see DESIGN.md "Time"). */
typedef enum tl_measurements {
    TL_LAG,  /* step i → i+1 is computed at the tick t_(i+T_P), all measurements are known */
    TL_AHEAD /* step i → i+1 is computed at t_i, the newest measurement stands for the later ones */
} tl_measurements;

typedef struct tl_plan {
    tl_time step; /* T_S, ns, > 0 */
    const tl_plan_component *components;
    size_t component_count;
    const tl_plan_signal *signals;
    size_t signal_count;
    const tl_plan_connection *connections;
    size_t connection_count;
    const tl_plan_adjust *adjust; /* none: the twin runs free and only compares */
    size_t adjust_count;
    const tl_plan_match *match;
    size_t match_count;
    const tl_plan_output *outputs;
    size_t output_count; /* at most TL_MAX_SIGNALS */
    uint32_t prediction; /* T_P ≥ T_D ≥ 1; 0: as short as possible, T_P = T_D */
    tl_measurements measurements;
    const char *algorithm; /* "nelder-mead" */
    double margin;         /* a correction must lower J to at most (1 − margin) of the nominal's, [0, 1) */
} tl_plan;

/* Reports numbers that are out of their ranges. false: there is more of something than a twin has room for, and
 * nothing may be built from the plan. */
bool tl_plan_check(const tl_plan *plan, tl_report *report);

#endif
