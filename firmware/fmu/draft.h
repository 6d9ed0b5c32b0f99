/* Draft: a configuration made from FMUs and the known signals of the plant, for `init`.
 *
 * Purpose: connects by name, finds the outputs to match and what can be adjusted, and writes the
 *          configuration. What the program cannot know becomes an entry of `fill_in`.
 * Names:   equal if their letters and digits are, whatever their case. A signal is compared with
 *          component and variable together, the variable, the last part of a structured name, and
 *          the description, in this order. A name that fits several variables connects none.
 * Guess:   what remains is connected if the name of a signal is a word of one description only, if
 *          an output and an input of two FMUs are the only ones with their unit, or if one signal
 *          and one input are left.
 * Order:   fill fmus and signals; tl_draft_link(); then the figures of a recording, if there is
 *          one; tl_draft_propose(); then the reactions; tl_draft_choose(); tl_draft_text().
 * Owner:   the caller owns models and texts, which must outlive the draft, and frees the text.
 * Thread:  one.
 */
#ifndef TL_FIRMWARE_FMU_DRAFT_H
#define TL_FIRMWARE_FMU_DRAFT_H

#include <stdbool.h>
#include <stddef.h>

#include "firmware/config/json_document.h"
#include "firmware/fmu/model_description.h"
#include "master/base/signal.h"

enum {
    TL_DRAFT_FMUS = 62,
    TL_DRAFT_NAME = 64,       /* bytes of a component's or signal's name */
    TL_DRAFT_PATH = 320,      /* bytes of "component.variable"; longer variables are left out */
    TL_DRAFT_PORTS = 512,     /* inputs and outputs of all FMUs; further ones are left out */
    TL_DRAFT_CANDIDATES = 64, /* variables whose reaction is tried */
    TL_DRAFT_COLUMN = 256,    /* bytes of a column's name */
    TL_DRAFT_SIGNALS = 256,   /* before tl_draft_link(); after it at most TL_MAX_SIGNALS */
    TL_DRAFT_FILL_IN = 320    /* bytes of an entry of `fill_in` */
};

typedef struct tl_draft_fmu {
    char name[TL_DRAFT_NAME]; /* of the component; see tl_draft_name() */
    const char *file;         /* as the configuration names it */
    const tl_model *model;
} tl_draft_fmu;

/* A signal of the plant. */
typedef struct tl_draft_signal {
    char name[TL_DRAFT_NAME];
    char column[TL_DRAFT_COLUMN]; /* of the recording; "": none */
    char unit[TL_DRAFT_NAME];     /* as the plant states it; "": unknown */
    const cJSON *entry;           /* its description in a given configuration; NULL: none */
    size_t port;                  /* private: what it is connected to or matched with; SIZE_MAX: nothing */
    /* of a recording, in its unit; NaN: unknown */
    double least, most, middle; /* `middle`: a value in the middle of the recording */
    double sigma;               /* standard deviation of the noise */
} tl_draft_signal;

/* An input or output of an FMU. Private. */
typedef struct tl_draft_port {
    size_t fmu;
    const tl_variable *variable;
    size_t from;   /* of an input: port of another FMU's output; SIZE_MAX: none */
    bool is_guess; /* `from` or `signal` was found without a name: `fill_in` asks */
    size_t signal; /* signal that feeds or measures it; SIZE_MAX: none */
} tl_draft_port;

/* A variable that may be adjusted, and how the matched outputs react to it. */
typedef struct tl_draft_candidate {
    size_t fmu;
    const tl_variable *variable;
    size_t port;               /* of an input; SIZE_MAX: a parameter */
    double step, lower, upper; /* in its unit; bounds ∓infinity: not known, or the FMU declares them */
    bool is_tried;
    bool is_chosen;
    bool is_left_out; /* another one of its match keeps the twin closer to the recording: see tl_draft_replace() */
    size_t match;     /* index of the matched output that reacts most */
    double most;      /* movement of this output by one step of the variable, in its unit */
    double half_s;    /* time to half of it, s */
} tl_draft_candidate;

typedef struct tl_draft_match {
    size_t port, signal;
    double tolerance;  /* in the unit of the output */
    bool is_estimated; /* from the noise of a recording */
} tl_draft_match;

typedef struct tl_draft {
    const char *name; /* of the configuration */
    double step_s;
    bool is_step_known;      /* false: `step_s` is a guess */
    const char *host;        /* of a Modbus device, without the port; NULL: none */
    unsigned port;           /* 0: the default */
    const char *recording;   /* file as the configuration names it; NULL: none */
    const char *time_column; /* of the recording */
    const cJSON *sources;    /* of a given configuration; NULL: none */
    tl_draft_fmu fmus[TL_DRAFT_FMUS];
    size_t fmu_count;
    tl_draft_signal signals[TL_DRAFT_SIGNALS];
    size_t signal_count;
    /* filled here: */
    tl_draft_port ports[TL_DRAFT_PORTS];
    size_t port_count;
    tl_draft_match matches[TL_MAX_MATCH];
    size_t match_count;
    tl_draft_candidate candidates[TL_DRAFT_CANDIDATES];
    size_t candidate_count;
} tl_draft;

/* What the written configuration adjusts. */
typedef enum tl_draft_kind {
    TL_DRAFT_COMPARED, /* nothing: outputs are only compared */
    TL_DRAFT_TRIED,    /* one candidate, near the middle of the recording */
    TL_DRAFT_FINAL     /* the chosen candidates; with `fill_in` */
} tl_draft_kind;

/* Makes a valid name of a text that differs from `taken` names, which `count` calls of `name_of`
 * return: other characters become "_". */
void tl_draft_name(const char *text, const char *(*name_of)(const tl_draft *draft, size_t index), const tl_draft *draft,
                   size_t count, char name[TL_DRAFT_NAME]);
const char *tl_draft_fmu_name(const tl_draft *draft, size_t index);
const char *tl_draft_signal_name(const tl_draft *draft, size_t index);

/* Finds connections and matches. Without any signal, makes one for each input without connection
 * and each Real output, as far as there is room. Removes signals without use if no input lacks a
 * source, and those for which there is no room. */
void tl_draft_link(tl_draft *draft);

/* Proposes tolerances, and the variables that may be adjusted, with step and bounds: inputs and
 * tunable parameters of FMUs from which a chain of connections leads to a matched output. */
void tl_draft_propose(tl_draft *draft);

/* Chooses what to adjust: for each match the variable to which it reacts most. Inputs that have a
 * source, and variables of other FMUs than that of the match, are chosen only if there is nothing
 * else: what nothing measures, near the output, is more probably wrong. At most TL_MAX_ADJUST. */
void tl_draft_choose(tl_draft *draft);

/* Returns the next candidate to try instead of a chosen one of its match: the best, as in
 * tl_draft_choose(), that is neither chosen nor left out. SIZE_MAX: none. */
size_t tl_draft_find_next(const tl_draft *draft);

/* Chooses a candidate of tl_draft_find_next() instead of the one of its match, which is left out.
 * Returns the one that it replaced, with which a second call undoes this. */
size_t tl_draft_replace(tl_draft *draft, size_t candidate);

/* Writes "component.variable". */
void tl_draft_variable(const tl_draft *draft, size_t fmu, const tl_variable *variable, char path[TL_DRAFT_PATH]);

/* Returns the configuration as text, which the caller frees; NULL if memory is out. `tried`: index
 * of the candidate, for TL_DRAFT_TRIED. */
char *tl_draft_text(const tl_draft *draft, tl_draft_kind kind, size_t tried);

#endif
