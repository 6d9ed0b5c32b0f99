/* A model as its description says it, before types are inherited and units are found.
 *
 * Purpose: what model_description.c collects tag by tag, and how it becomes a tl_model once the whole document is read.
 * Bound:   settling is O(n log n) in the number of units, types and variables.
 * Owner:   lists live in the heap until tl_model_draft_free(); texts live in the arena from the start.
 * Thread:  one thread.
 */
#ifndef TL_FIRMWARE_FMU_MODEL_DRAFT_H
#define TL_FIRMWARE_FMU_MODEL_DRAFT_H

#include <stdbool.h>
#include <stddef.h>

#include "master/base/arena.h"
#include "master/base/status.h"
#include "master/fmi/model.h"

/* What <Real>, <Integer>, … says, within a SimpleType or a ScalarVariable. NaN and NULL: not given. */
typedef struct tl_draft_declaration {
    bool is_given;
    tl_type type;
    const char *unit;
    double minimum;
    double maximum;
    double nominal;
} tl_draft_declaration;

typedef struct tl_draft_unit {
    tl_unit unit;
    unsigned long line;
} tl_draft_unit;

typedef struct tl_draft_type {
    const char *name;
    tl_draft_declaration declaration;
    unsigned long line;
} tl_draft_type;

typedef struct tl_draft_variable {
    tl_variable variable; /* all but what is inherited */
    tl_draft_declaration declaration;
    const char *declared_type; /* NULL: none */
    bool has_variability;
    bool has_initial;
    unsigned long line;
    size_t unit; /* private: index into the units */
} tl_draft_variable;

/* `items` of one size; zeroed is empty. */
typedef struct tl_draft_list {
    void *items;
    size_t count;
    size_t capacity;
} tl_draft_list;

typedef struct tl_model_draft {
    tl_draft_list units;     /* tl_draft_unit */
    tl_draft_list types;     /* tl_draft_type */
    tl_draft_list variables; /* tl_draft_variable */
} tl_model_draft;

/* A new zeroed item at the end, valid until the next one is appended; NULL when memory is out. */
void *tl_draft_append(tl_draft_list *list, size_t size);

/* The newest item. The list is not empty. */
tl_draft_unit *tl_draft_last_unit(const tl_model_draft *draft);
tl_draft_type *tl_draft_last_type(const tl_model_draft *draft);
tl_draft_variable *tl_draft_last_variable(const tl_model_draft *draft);

/* Inherits, finds units, checks names, and puts variables and units into the model. On TL_BAD_DATA the error's text
 * has no line in it; *line is that of the item that is wrong. The draft is used up. */
tl_status tl_model_draft_settle(tl_model_draft *draft, tl_arena *arena, tl_model *model, unsigned long *line,
                                tl_error *error);

/* Frees the lists. */
void tl_model_draft_free(tl_model_draft *draft);

#endif
