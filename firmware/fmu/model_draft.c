/* From a draft to a model. Everything is found by sorting once and searching after, so that a description of a hundred
 * thousand variables is still read in a moment. */
#include "firmware/fmu/model_draft.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

void *tl_draft_append(tl_draft_list *list, size_t size) {
    if (list->count == list->capacity) {
        size_t capacity = list->capacity == 0 ? 64 : 2 * list->capacity;
        void *grown = realloc(list->items, capacity * size);
        if (grown == NULL) {
            return NULL;
        }
        list->items = grown;
        list->capacity = capacity;
    }
    void *item = (char *)list->items + list->count * size;
    list->count++;
    memset(item, 0, size);
    return item;
}

void tl_model_draft_free(tl_model_draft *draft) {
    free(draft->units.items);
    free(draft->types.items);
    free(draft->variables.items);
    *draft = (tl_model_draft){0};
}

static tl_draft_unit *unit_at(const tl_model_draft *draft, size_t index) {
    return (tl_draft_unit *)draft->units.items + index;
}

static tl_draft_type *type_at(const tl_model_draft *draft, size_t index) {
    return (tl_draft_type *)draft->types.items + index;
}

static tl_draft_variable *variable_at(const tl_model_draft *draft, size_t index) {
    return (tl_draft_variable *)draft->variables.items + index;
}

tl_draft_unit *tl_draft_last_unit(const tl_model_draft *draft) {
    return unit_at(draft, draft->units.count - 1);
}

tl_draft_type *tl_draft_last_type(const tl_model_draft *draft) {
    return type_at(draft, draft->types.count - 1);
}

tl_draft_variable *tl_draft_last_variable(const tl_model_draft *draft) {
    return variable_at(draft, draft->variables.count - 1);
}

/* ---- Order: by name, the same names by line ------------------------------------------------------------ */

static int compare(const char *left, unsigned long left_line, const char *right, unsigned long right_line) {
    int order = strcmp(left, right);
    return order != 0 ? order : (left_line > right_line) - (left_line < right_line);
}

static int compare_units(const void *left, const void *right) {
    const tl_draft_unit *a = left;
    const tl_draft_unit *b = right;
    return compare(a->unit.name, a->line, b->unit.name, b->line);
}

static int compare_types(const void *left, const void *right) {
    const tl_draft_type *a = left;
    const tl_draft_type *b = right;
    return compare(a->name, a->line, b->name, b->line);
}

static int compare_variables(const void *left, const void *right) {
    const tl_draft_variable *a = *(tl_draft_variable *const *)left;
    const tl_draft_variable *b = *(tl_draft_variable *const *)right;
    return compare(a->variable.name, a->line, b->variable.name, b->line);
}

static int compare_units_of_variables(const void *left, const void *right) {
    const tl_draft_variable *a = *(tl_draft_variable *const *)left;
    const tl_draft_variable *b = *(tl_draft_variable *const *)right;
    return compare(a->declaration.unit, a->line, b->declaration.unit, b->line);
}

static int find_unit(const void *name, const void *unit) {
    return strcmp(name, ((const tl_draft_unit *)unit)->unit.name);
}

static int find_type(const void *name, const void *type) {
    return strcmp(name, ((const tl_draft_type *)type)->name);
}

static void sort(tl_draft_list *list, size_t size, int (*order)(const void *left, const void *right)) {
    if (list->count > 1) {
        qsort(list->items, list->count, size, order);
    }
}

static void *search(const tl_draft_list *list, size_t size, const char *name,
                    int (*order)(const void *name, const void *item)) {
    return list->count == 0 ? NULL : bsearch(name, list->items, list->count, size, order);
}

/* ---- Names that may be given once ---------------------------------------------------------------------- */

static tl_status fail_twice(tl_error *error, const char *what, const char *name, unsigned long first) {
    return tl_fail(error, TL_BAD_DATA, "%s \"%.100s\" is declared twice, first in line %lu; each name may occur once",
                   what, name, first);
}

static tl_status sort_units(tl_model_draft *draft, unsigned long *line, tl_error *error) {
    sort(&draft->units, sizeof(tl_draft_unit), compare_units);
    for (size_t i = 1; i < draft->units.count; i++) {
        const tl_draft_unit *first = unit_at(draft, i - 1);
        if (strcmp(first->unit.name, unit_at(draft, i)->unit.name) == 0) {
            *line = unit_at(draft, i)->line;
            return fail_twice(error, "unit", first->unit.name, first->line);
        }
    }
    return TL_OK;
}

static tl_status sort_types(tl_model_draft *draft, unsigned long *line, tl_error *error) {
    sort(&draft->types, sizeof(tl_draft_type), compare_types);
    for (size_t i = 1; i < draft->types.count; i++) {
        const tl_draft_type *first = type_at(draft, i - 1);
        if (strcmp(first->name, type_at(draft, i)->name) == 0) {
            *line = type_at(draft, i)->line;
            return fail_twice(error, "type", first->name, first->line);
        }
    }
    return TL_OK;
}

/* The variables keep their order; `pointers` has room for all of them. */
static tl_status check_names(const tl_model_draft *draft, tl_draft_variable **pointers, unsigned long *line,
                             tl_error *error) {
    size_t count = draft->variables.count;
    for (size_t i = 0; i < count; i++) {
        pointers[i] = variable_at(draft, i);
    }
    qsort(pointers, count, sizeof(tl_draft_variable *), compare_variables);
    for (size_t i = 1; i < count; i++) {
        const tl_draft_variable *first = pointers[i - 1];
        if (strcmp(first->variable.name, pointers[i]->variable.name) == 0) {
            *line = pointers[i]->line;
            return fail_twice(error, "variable", first->variable.name, first->line);
        }
    }
    return TL_OK;
}

/* ---- Inheritance --------------------------------------------------------------------------------------- */

static double first_given(double own, double inherited, double otherwise) {
    double value = isnan(own) ? inherited : own;
    return isnan(value) ? otherwise : value;
}

/* What the variable does not say itself comes from its declared type. */
static tl_status inherit(const tl_model_draft *draft, tl_draft_variable *entry, tl_error *error) {
    static const tl_draft_declaration none = {.minimum = (double)NAN, .maximum = (double)NAN, .nominal = (double)NAN};
    tl_draft_declaration *own = &entry->declaration;
    tl_variable *variable = &entry->variable;
    const tl_draft_declaration *inherited = &none;
    if (entry->declared_type != NULL) {
        const tl_draft_type *type = search(&draft->types, sizeof(tl_draft_type), entry->declared_type, find_type);
        if (type == NULL || type->declaration.type != own->type) {
            return tl_fail(error, TL_BAD_DATA, "declaredType=\"%.100s\" of variable \"%.100s\" is %s",
                           entry->declared_type, variable->name,
                           type == NULL ? "not in <TypeDefinitions>" : "a type of another kind than the variable");
        }
        inherited = &type->declaration;
    }
    own->unit = own->unit == NULL ? inherited->unit : own->unit;
    variable->minimum = first_given(own->minimum, inherited->minimum, -(double)INFINITY);
    variable->maximum = first_given(own->maximum, inherited->maximum, (double)INFINITY);
    variable->nominal = fabs(first_given(own->nominal, inherited->nominal, 1));
    if (variable->nominal == 0) {
        variable->nominal = 1;
    }
    if (variable->minimum > variable->maximum) {
        return tl_fail(error, TL_BAD_DATA, "variable \"%.100s\" has min %g above max %g; correct one of them",
                       variable->name, variable->minimum, variable->maximum);
    }
    return TL_OK;
}

/* ---- Units --------------------------------------------------------------------------------------------- */

/* Gives each variable the index of its unit. Units that nobody defined are appended, without base. */
static tl_status find_units(tl_model_draft *draft, tl_draft_variable **pointers) {
    size_t count = 0;
    for (size_t i = 0; i < draft->variables.count; i++) {
        tl_draft_variable *entry = variable_at(draft, i);
        entry->unit = SIZE_MAX;
        if (entry->declaration.unit != NULL && entry->declaration.unit[0] != '\0') {
            pointers[count] = entry;
            count++;
        }
    }
    qsort(pointers, count, sizeof(tl_draft_variable *), compare_units_of_variables);
    tl_draft_list defined = draft->units; /* the sorted ones; `items` may move below */
    for (size_t i = 0; i < count; i++) {
        const char *name = pointers[i]->declaration.unit;
        if (i > 0 && strcmp(name, pointers[i - 1]->declaration.unit) == 0) {
            pointers[i]->unit = pointers[i - 1]->unit;
            continue;
        }
        defined.items = draft->units.items;
        const tl_draft_unit *unit = search(&defined, sizeof(tl_draft_unit), name, find_unit);
        if (unit != NULL) {
            pointers[i]->unit = (size_t)(unit - unit_at(draft, 0));
            continue;
        }
        tl_draft_unit *added = tl_draft_append(&draft->units, sizeof(tl_draft_unit));
        if (added == NULL) {
            return TL_TRY_AGAIN;
        }
        added->unit.name = name;
        added->unit.factor = 1;
        pointers[i]->unit = draft->units.count - 1;
    }
    return TL_OK;
}

/* ---- All of it ----------------------------------------------------------------------------------------- */

static tl_status copy_to_model(const tl_model_draft *draft, tl_arena *arena, tl_model *model) {
    tl_unit *units = tl_arena_take(arena, draft->units.count, sizeof(tl_unit));
    tl_variable *variables = tl_arena_take(arena, draft->variables.count, sizeof(tl_variable));
    if (units == NULL || variables == NULL) {
        return TL_TRY_AGAIN;
    }
    for (size_t i = 0; i < draft->units.count; i++) {
        units[i] = unit_at(draft, i)->unit;
    }
    for (size_t i = 0; i < draft->variables.count; i++) {
        const tl_draft_variable *entry = variable_at(draft, i);
        variables[i] = entry->variable;
        variables[i].unit = entry->unit == SIZE_MAX ? NULL : &units[entry->unit];
    }
    model->units = units;
    model->unit_count = draft->units.count;
    model->variables = variables;
    model->variable_count = draft->variables.count;
    return TL_OK;
}

static tl_status settle(tl_model_draft *draft, tl_draft_variable **pointers, unsigned long *line, tl_error *error) {
    tl_status status = sort_units(draft, line, error);
    if (status == TL_OK) {
        status = sort_types(draft, line, error);
    }
    for (size_t i = 0; i < draft->variables.count && status == TL_OK; i++) {
        *line = variable_at(draft, i)->line;
        status = inherit(draft, variable_at(draft, i), error);
    }
    if (status == TL_OK) {
        status = check_names(draft, pointers, line, error);
    }
    return status;
}

tl_status tl_model_draft_settle(tl_model_draft *draft, tl_arena *arena, tl_model *model, unsigned long *line,
                                tl_error *error) {
    *line = 0;
    tl_draft_variable **pointers = malloc((draft->variables.count + 1) * sizeof(tl_draft_variable *));
    if (pointers == NULL) {
        return tl_fail(error, TL_TRY_AGAIN, "out of memory");
    }
    tl_status status = settle(draft, pointers, line, error);
    if (status == TL_OK) {
        status = find_units(draft, pointers);
        if (status == TL_OK) {
            status = copy_to_model(draft, arena, model);
        }
        if (status != TL_OK) {
            (void)tl_fail(error, status, "out of memory");
        }
    }
    free(pointers);
    return status;
}
