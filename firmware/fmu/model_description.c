/* Model description of an FMU, see model_description.h. */
#include "firmware/fmu/model_description.h"

#include <errno.h>
#include <expat.h>
#include <fcntl.h>
#include <iconv.h>
#include <limits.h>
#include <math.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>
#include <unistd.h>
#include <wchar.h>

#include "firmware/base/os.h"
#include "firmware/base/text.h"
#include "master/base/arena.h"
#include "master/base/status.h"
#include "master/fmi/model.h"

/* ---- The model as written in its description, before types are inherited and units are resolved.
 * Lists are on the heap during parsing; texts are in the arena from the start. */

/* Attributes of <Real>, <Integer>, … in a SimpleType or a ScalarVariable. NaN and NULL: not given.
 */
typedef struct tl_draft_declaration {
    bool is_given;
    tl_type type;
    const char *unit;
    double minimum;
    double maximum;
    double nominal;
    uint64_t items;                /* of an Enumeration: bit k: least_item + k */
    int64_t least_item, most_item; /* most_item < least_item: there are none */
} tl_draft_declaration;

/* First fields of units, types and variables. */
typedef struct tl_draft_item {
    const char *name;
    unsigned long line; /* IMPLIED: a unit that is used but not defined */
} tl_draft_item;

#define IMPLIED ULONG_MAX

typedef struct tl_draft_unit {
    tl_draft_item item;
    tl_unit unit; /* all fields except its name */
} tl_draft_unit;

typedef struct tl_draft_type {
    tl_draft_item item;
    tl_draft_declaration declaration;
} tl_draft_type;

typedef struct tl_draft_variable {
    tl_draft_item item;
    tl_variable variable; /* all fields except the inherited ones */
    tl_draft_declaration declaration;
    const char *declared_type; /* NULL: none */
    bool has_variability;
    bool has_initial;
    bool is_repeated; /* declared before with the same attributes: this one is dropped */
    size_t index;     /* position in the document */
} tl_draft_variable;

/* A list of items of one size. */
typedef struct tl_draft_list {
    void *items;
    size_t size; /* bytes of an item */
    size_t count;
    size_t capacity;
} tl_draft_list;

/* ---- Attribute texts to values: the characters are checked, then the C library parses the number.
 */

#define SPACE " \t\n\r"

typedef struct span {
    const char *start;
    size_t length;
} span;

static span trimmed(const char *text) {
    const char *start = text + strspn(text, SPACE);
    size_t length = strlen(start);
    while (length > 0 && strchr(SPACE, start[length - 1]) != NULL) {
        length--;
    }
    return (span){start, length};
}

static bool equals(span text, const char *word) {
    return strlen(word) == text.length && memcmp(text.start, word, text.length) == 0;
}

/* Returns true if the text is not empty and contains only these characters. */
static bool is_made_of(span text, const char *characters) {
    return text.length > 0 && strspn(text.start, characters) >= text.length;
}

bool tl_xml_double(const char *text, double *value) {
    static const struct {
        const char *word;
        double value;
    } words[] = {
        {"INF", (double)INFINITY}, {"+INF", (double)INFINITY}, {"-INF", -(double)INFINITY}, {"NaN", (double)NAN}};
    span number = trimmed(text);
    for (size_t i = 0; i < sizeof words / sizeof words[0]; i++) {
        if (equals(number, words[i].word)) {
            *value = words[i].value;
            return true;
        }
    }
    char *end = NULL;
    double result = strtod(number.start, &end);
    if (!is_made_of(number, "+-.0123456789eE") || end != number.start + number.length) {
        return false; /* also if the locale of this thread has no decimal point: see os.h */
    }
    *value = result;
    return true;
}

bool tl_xml_integer(const char *text, int64_t lowest, int64_t highest, int64_t *value) {
    span number = trimmed(text);
    char *end = NULL;
    long long result = strtoll(number.start, &end, 10); /* saturates if the value is out of range */
    if (!is_made_of(number, "+-0123456789") || end != number.start + number.length || result < lowest ||
        result > highest) {
        return false;
    }
    *value = result;
    return true;
}

bool tl_xml_boolean(const char *text, bool *value) {
    static const char *const words[] = {"false", "true", "0", "1"};
    span word = trimmed(text);
    for (size_t i = 0; i < sizeof words / sizeof words[0]; i++) {
        if (equals(word, words[i])) {
            *value = i % 2 == 1;
            return true;
        }
    }
    return false;
}

/* ---- Parses modelDescription.xml with expat. Each start tag is looked up in a table by its parent
 * and its name; unknown elements are skipped with their contents. Tags are checked when they are
 * read, so that errors have a line. Checks that need the whole document (declared types, units,
 * duplicate names) come last. */

#if XML_MAJOR_VERSION == 2 && XML_MINOR_VERSION < 9 /* deprecated from 2.9 on */
#define CURRENT_LINE XML_GetCurrentLineNumber
#define CURRENT_COLUMN XML_GetCurrentColumnNumber
#else
#define CURRENT_LINE XML_GetCurrentLineNumber64
#define CURRENT_COLUMN XML_GetCurrentColumnNumber64
#endif

typedef enum element {
    DOCUMENT,
    DESCRIPTION,
    CAPABILITIES, /* ModelExchange, CoSimulation */
    UNITS,
    UNIT,
    TYPES,
    SIMPLE_TYPE,
    ITEMS, /* Enumeration of a type */
    VARIABLES,
    VARIABLE,
    LEAF,   /* known, but its children are skipped */
    IGNORED /* not known */
} element;

typedef struct description_parser {
    XML_Parser expat;
    const char *label;
    tl_arena *arena;
    tl_model *model;
    tl_error *error;
    tl_status status; /* of the first failure; parsing stops there */
    element path[TL_MODEL_DESCRIPTION_DEPTH + 1];
    size_t depth;
    bool has_model_exchange;
    bool has_co_simulation;
    bool has_variables;
    tl_draft_list units;     /* tl_draft_unit */
    tl_draft_list types;     /* tl_draft_type */
    tl_draft_list variables; /* tl_draft_variable */
} description_parser;

/* ---- Failures -------------------------------------------------------------------------------- */

static void fail_at(description_parser *parser, unsigned long line, const char *format, ...) TL_PRINTF(3, 4);

static void fail_at(description_parser *parser, unsigned long line, const char *format, ...) {
    if (parser->status != TL_OK) {
        return;
    }
    char text[TL_ERROR_TEXT];
    char clean[TL_ERROR_TEXT]; /* a cleaned name: an error has one line */
    va_list arguments;
    va_start(arguments, format);
    (void)vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    (void)tl_clean_text(text, strlen(text), clean, sizeof clean);
    parser->status =
        tl_fail(parser->error, TL_BAD_DATA, "%s: modelDescription.xml, line %lu: %s", parser->label, line, clean);
    (void)XML_StopParser(parser->expat, XML_FALSE);
}

static unsigned long current_line(const description_parser *parser) {
    return (unsigned long)CURRENT_LINE(parser->expat);
}

static void fail_memory(description_parser *parser) {
    if (parser->status == TL_OK) {
        parser->status =
            tl_fail(parser->error, TL_TRY_AGAIN,
                    "%s: modelDescription.xml: not enough memory; free memory and try again", parser->label);
        (void)XML_StopParser(parser->expat, XML_FALSE);
    }
}

/* ---- Lists ----------------------------------------------------------------------------------- */

static void *item_at(const tl_draft_list *list, size_t index) {
    return (char *)list->items + index * list->size;
}

/* Returns the newest item. The list must not be empty. */
static void *last_item(const tl_draft_list *list) {
    return item_at(list, list->count - 1);
}

/* Appends a zeroed item with this name. Returns NULL if memory is out (reported by fail_memory()).
 */
static void *append(description_parser *parser, tl_draft_list *list, const char *name, unsigned long line) {
    if (list->count == list->capacity) {
        size_t capacity = list->capacity == 0 ? 64 : 2 * list->capacity;
        void *grown = realloc(list->items, capacity * list->size);
        if (grown == NULL) {
            fail_memory(parser);
            return NULL;
        }
        list->items = grown;
        list->capacity = capacity;
    }
    list->count++;
    tl_draft_item *item = memset(last_item(list), 0, list->size);
    *item = (tl_draft_item){name, line};
    return item;
}

/* Order: by name, then by line. */
static int compare_items(const void *left, const void *right) {
    const tl_draft_item *a = left;
    const tl_draft_item *b = right;
    int order = strcmp(a->name, b->name);
    return order != 0 ? order : (a->line > b->line) - (a->line < b->line);
}

static int compare_name(const void *name, const void *item) {
    return strcmp(name, ((const tl_draft_item *)item)->name);
}

/* Returns NULL if the sorted list does not contain the name. */
static void *find_item(const tl_draft_list *list, const char *name) {
    return list->count == 0 ? NULL : bsearch(name, list->items, list->count, list->size, compare_name);
}

/* Sorts the items and reports duplicate names. Drops implied units that exist already. */
static void sort_names(description_parser *parser, tl_draft_list *list, const char *what) {
    size_t kept = 0;
    if (list->count > 1) {
        qsort(list->items, list->count, list->size, compare_items);
    }
    for (size_t i = 0; i < list->count; i++) {
        const tl_draft_item *item = item_at(list, i);
        const tl_draft_item *before = kept > 0 ? item_at(list, kept - 1) : NULL;
        if (before == NULL || strcmp(before->name, item->name) != 0) {
            memmove(item_at(list, kept++), item, list->size);
        } else if (item->line != IMPLIED) {
            fail_at(parser, item->line, "%s \"%.100s\" is declared twice, first in line %lu; each name may occur once",
                    what, item->name, before->line);
            return;
        }
    }
    list->count = kept;
}

/* ---- Attributes ------------------------------------------------------------------------------ */

/* Attributes from expat (names and values in turn), and their element. */
typedef struct xml_tag {
    const char *name;
    const char **attributes;
} xml_tag;

/* Returns NULL if the attribute is missing. */
static const char *attribute(const xml_tag *tag, const char *name) {
    for (const char **pair = tag->attributes; pair[0] != NULL; pair += 2) {
        if (strcmp(pair[0], name) == 0) {
            return pair[1];
        }
    }
    return NULL;
}

static const char *keep(description_parser *parser, const char *text) {
    const char *copy = tl_arena_text(parser->arena, text);
    if (copy == NULL) {
        fail_memory(parser);
        return "";
    }
    return copy;
}

/* Returns a copy of the attribute in the arena, or `standard` if it is missing. */
static const char *text_or(description_parser *parser, const xml_tag *tag, const char *name, const char *standard) {
    const char *text = attribute(tag, name);
    return text == NULL ? standard : keep(parser, text);
}

/* Reports an error if the attribute is missing. It may be empty: some exporters write an empty unit
 * name for "1". */
static const char *mandatory(description_parser *parser, const xml_tag *tag, const char *name) {
    const char *text = attribute(tag, name);
    if (text == NULL) {
        fail_at(parser, current_line(parser),
                "<%.60s> has no attribute %s, which FMI 2.0 requires; export the FMU again", tag->name, name);
        return "";
    }
    return keep(parser, text);
}

static void fail_value(description_parser *parser, const xml_tag *tag, const char *name, const char *text,
                       const char *expected) {
    fail_at(parser, current_line(parser), "%s=\"%.60s\" of <%.60s> is not %s", name, text, tag->name, expected);
}

/* Leaves *value unchanged if the attribute is missing. Infinite values are allowed, NaN is not. */
static void read_real(description_parser *parser, const xml_tag *tag, const char *name, double *value) {
    const char *text = attribute(tag, name);
    double number;
    if (text == NULL) {
        return;
    }
    if (!tl_xml_double(text, &number) || isnan(number)) {
        fail_value(parser, tag, name, text, "a number");
        return;
    }
    *value = number;
}

static void read_finite(description_parser *parser, const xml_tag *tag, const char *name, double *value) {
    double number = *value;
    read_real(parser, tag, name, &number);
    if (isinf(number)) {
        fail_value(parser, tag, name, attribute(tag, name), "a finite number");
        return;
    }
    *value = number;
}

static void read_int(description_parser *parser, const xml_tag *tag, const char *name, int32_t *value) {
    const char *text = attribute(tag, name);
    int64_t number = *value;
    if (text != NULL && !tl_xml_integer(text, INT32_MIN, INT32_MAX, &number)) {
        fail_value(parser, tag, name, text, "an integer of 32 bits");
    }
    *value = (int32_t)number;
}

static void read_boolean(description_parser *parser, const xml_tag *tag, const char *name, bool *value) {
    const char *text = attribute(tag, name);
    if (text != NULL && !tl_xml_boolean(text, value)) {
        fail_value(parser, tag, name, text, "true or false");
    }
}

/* Reads one of `count` keywords. Leaves *value unchanged if the attribute is missing. Returns true
 * if it is present. */
static bool read_word(description_parser *parser, const xml_tag *tag, const char *name, const char *(*word)(int),
                      int count, int *value) {
    const char *text = attribute(tag, name);
    if (text == NULL) {
        return false;
    }
    char expected[128] = "one of";
    for (int i = 0; i < count; i++) {
        if (strcmp(word(i), text) == 0) {
            *value = i;
            return true;
        }
        size_t length = strlen(expected);
        (void)snprintf(expected + length, sizeof expected - length, "%s %s", i == 0 ? "" : ",", word(i));
    }
    fail_value(parser, tag, name, text, expected);
    return false;
}

/* ---- The root, CoSimulation ------------------------------------------------------------------ */

static void begin_description(description_parser *parser, const xml_tag *tag) {
    tl_model *model = parser->model;
    const char *version = mandatory(parser, tag, "fmiVersion");
    if (parser->status == TL_OK && strcmp(version, "2.0") != 0) {
        fail_at(parser, current_line(parser),
                "this is FMI %.20s, but twinlock runs only FMI 2.0: export the model as FMI 2.0 for Co-Simulation",
                version);
        return;
    }
    model->name = mandatory(parser, tag, "modelName");
    model->guid = mandatory(parser, tag, "guid");
    model->generation_tool = text_or(parser, tag, "generationTool", "");
}

static void begin_model_exchange(description_parser *parser, const xml_tag *tag) {
    (void)tag;
    parser->has_model_exchange = true;
}

/* The identifier becomes a file name, so it must not contain a path. */
static bool is_file_name(const char *text) {
    for (const char *c = text; *c != '\0'; c++) {
        if (*c == '/' || *c == '\\' || (unsigned char)*c < ' ') {
            return false;
        }
    }
    return text[0] != '\0' && text[0] != '.' && strlen(text) <= 200;
}

static void begin_co_simulation(description_parser *parser, const xml_tag *tag) {
    tl_model *model = parser->model;
    tl_capabilities *capabilities = &model->capabilities;
    if (parser->has_co_simulation) {
        fail_at(parser, current_line(parser), "a second <CoSimulation>; FMI 2.0 allows one");
        return;
    }
    parser->has_co_simulation = true;
    model->identifier = mandatory(parser, tag, "modelIdentifier");
    if (!is_file_name(model->identifier)) {
        fail_value(parser, tag, "modelIdentifier", model->identifier, "the name of a file");
    }
    read_boolean(parser, tag, "canBeInstantiatedOnlyOncePerProcess", &capabilities->can_be_instantiated_only_once);
    read_boolean(parser, tag, "canGetAndSetFMUstate", &capabilities->can_get_and_set_state);
    read_boolean(parser, tag, "canSerializeFMUstate", &capabilities->can_serialize_state);
}

/* Leaves *time unchanged if the attribute is missing or not finite: most models do not need it. */
static void read_time(const xml_tag *tag, const char *name, double *time) {
    const char *text = attribute(tag, name);
    double found = 0.0;
    if (text != NULL && tl_xml_double(text, &found) && isfinite(found)) {
        *time = found + 0.0; /* not −0 */
    }
}

static void begin_default_experiment(description_parser *parser, const xml_tag *tag) {
    read_time(tag, "startTime", &parser->model->start_time);
    read_time(tag, "stopTime", &parser->model->stop_time);
}

/* ---- Units ----------------------------------------------------------------------------------- */

static void begin_unit(description_parser *parser, const xml_tag *tag) {
    tl_draft_unit *entry = append(parser, &parser->units, mandatory(parser, tag, "name"), current_line(parser));
    if (entry != NULL) {
        entry->unit.factor = 1;
    }
}

static void begin_base_unit(description_parser *parser, const xml_tag *tag) {
    static const char *const names[] = {"kg", "m", "s", "A", "K", "mol", "cd", "rad"};
    tl_draft_unit *entry = last_item(&parser->units);
    tl_unit *unit = &entry->unit;
    if (unit->has_base) {
        fail_at(parser, current_line(parser), "a second <BaseUnit> for unit \"%.60s\"", entry->item.name);
        return;
    }
    unit->has_base = true;
    for (size_t i = 0; i < sizeof names / sizeof names[0]; i++) {
        int32_t exponent = 0;
        read_int(parser, tag, names[i], &exponent);
        unit->exponents[i] = (int)exponent;
    }
    read_finite(parser, tag, "factor", &unit->factor);
    read_finite(parser, tag, "offset", &unit->offset);
    if (unit->factor == 0) {
        fail_value(parser, tag, "factor", attribute(tag, "factor"), "other than 0");
    }
}

/* ---- Types and variables --------------------------------------------------------------------- */

static void read_declaration(description_parser *parser, const xml_tag *tag, tl_draft_declaration *declaration) {
    static const tl_type types[] = {TL_REAL, TL_INTEGER, TL_BOOLEAN, TL_STRING};
    if (declaration->is_given) {
        fail_at(parser, current_line(parser), "<%.60s> is the second type of one variable or type; FMI 2.0 allows one",
                tag->name);
        return;
    }
    declaration->is_given = true;
    declaration->type = TL_ENUMERATION; /* the table of tags allows no other element */
    for (size_t i = 0; i < sizeof types / sizeof types[0]; i++) {
        declaration->type = strcmp(tl_type_name(types[i]), tag->name) == 0 ? types[i] : declaration->type;
    }
    declaration->minimum = (double)NAN;
    declaration->maximum = (double)NAN;
    declaration->nominal = (double)NAN;
    declaration->most_item = -1;
    if (declaration->type == TL_REAL) {
        declaration->unit = text_or(parser, tag, "unit", NULL);
        read_finite(parser, tag, "nominal", &declaration->nominal);
    }
    if (declaration->type != TL_BOOLEAN && declaration->type != TL_STRING) {
        read_real(parser, tag, "min", &declaration->minimum);
        read_real(parser, tag, "max", &declaration->maximum);
    }
}

static void begin_simple_type(description_parser *parser, const xml_tag *tag) {
    (void)append(parser, &parser->types, mandatory(parser, tag, "name"), current_line(parser));
}

static void begin_type_of_type(description_parser *parser, const xml_tag *tag) {
    tl_draft_type *entry = last_item(&parser->types);
    read_declaration(parser, tag, &entry->declaration);
}

/* Values may come in any order. If they span more than 64 values, there is no list of items. */
static void begin_item(description_parser *parser, const xml_tag *tag) {
    tl_draft_type *entry = last_item(&parser->types);
    tl_draft_declaration *type = &entry->declaration;
    int32_t value = 0;
    (void)mandatory(parser, tag, "value");
    read_int(parser, tag, "value", &value);
    bool is_first = type->most_item < type->least_item;
    int64_t least = is_first || value < type->least_item ? value : type->least_item;
    int64_t most = is_first || value > type->most_item ? value : type->most_item;
    bool fits = most - least < 64 && (is_first || type->items != 0);
    type->items = !fits ? 0 : is_first ? 1 : type->items << (type->least_item - least) | UINT64_C(1) << (value - least);
    type->least_item = least;
    type->most_item = most;
}

static void end_simple_type(description_parser *parser) {
    const tl_draft_type *entry = last_item(&parser->types);
    if (!entry->declaration.is_given) {
        fail_at(parser, entry->item.line,
                "type \"%.100s\" has none of <Real>, <Integer>, <Boolean>, <String>, <Enumeration>", entry->item.name);
    }
}

static void begin_variables(description_parser *parser, const xml_tag *tag) {
    (void)tag;
    parser->has_variables = true;
}

static const char *causality_word(int value) {
    return tl_causality_name((tl_causality)value);
}

static const char *variability_word(int value) {
    return tl_variability_name((tl_variability)value);
}

static const char *initial_word(int value) {
    return tl_initial_name((tl_initial)(value + 1)); /* skips "none" */
}

static void begin_variable(description_parser *parser, const xml_tag *tag) {
    const char *name = mandatory(parser, tag, "name");
    if (parser->variables.count == TL_MODEL_DESCRIPTION_VARIABLES) {
        fail_at(parser, current_line(parser), "more than %d variables; export fewer", TL_MODEL_DESCRIPTION_VARIABLES);
        return;
    }
    tl_draft_variable *entry = append(parser, &parser->variables, name, current_line(parser));
    if (entry == NULL) {
        return;
    }
    entry->index = parser->variables.count - 1;
    tl_variable *variable = &entry->variable;
    int causality = TL_LOCAL;
    int variability = TL_CONTINUOUS;
    int64_t number = 0;
    int initial = 0;
    variable->name = name;
    variable->description = text_or(parser, tag, "description", "");
    const char *reference = attribute(tag, "valueReference");
    if (reference == NULL) {
        (void)mandatory(parser, tag, "valueReference");
    } else if (!tl_xml_integer(reference, 0, UINT32_MAX, &number)) {
        fail_value(parser, tag, "valueReference", reference, "an unsigned integer of 32 bits");
    }
    variable->reference = (uint32_t)number;
    (void)read_word(parser, tag, "causality", causality_word, TL_INDEPENDENT + 1, &causality);
    entry->has_variability = read_word(parser, tag, "variability", variability_word, TL_CONTINUOUS + 1, &variability);
    entry->has_initial = read_word(parser, tag, "initial", initial_word, TL_INITIAL_CALCULATED, &initial);
    variable->causality = (tl_causality)causality;
    variable->variability = (tl_variability)variability;
    variable->initial = (tl_initial)(initial + 1);
}

/* PythonFMU writes "nan" for an attribute without a value. */
static bool has_start(const xml_tag *tag, tl_type type) {
    const char *text = attribute(tag, "start");
    return text != NULL && !(type == TL_REAL && strcasecmp(text, "nan") == 0);
}

static void read_start(description_parser *parser, const xml_tag *tag, tl_variable *variable) {
    tl_value *start = &variable->start;
    bool flag = false;
    start->type = variable->type;
    variable->has_start = has_start(tag, variable->type);
    if (!variable->has_start && variable->type != TL_STRING) {
        return;
    }
    switch (variable->type) {
    case TL_REAL:
        read_finite(parser, tag, "start", &start->real);
        return;
    case TL_INTEGER:
    case TL_ENUMERATION:
        read_int(parser, tag, "start", &start->integer);
        return;
    case TL_BOOLEAN:
        read_boolean(parser, tag, "start", &flag);
        start->integer = flag ? 1 : 0;
        return;
    case TL_STRING:
        start->text = text_or(parser, tag, "start", "");
        return;
    }
}

static void begin_type_of_variable(description_parser *parser, const xml_tag *tag) {
    tl_draft_variable *entry = last_item(&parser->variables);
    read_declaration(parser, tag, &entry->declaration);
    if (parser->status != TL_OK) {
        return;
    }
    entry->variable.type = entry->declaration.type;
    entry->declared_type = entry->variable.type == TL_ENUMERATION ? mandatory(parser, tag, "declaredType")
                                                                  : text_or(parser, tag, "declaredType", NULL);
    read_start(parser, tag, &entry->variable);
}

static void end_variable(description_parser *parser) {
    tl_draft_variable *entry = last_item(&parser->variables);
    tl_variable *variable = &entry->variable;
    if (!entry->declaration.is_given) {
        fail_at(parser, entry->item.line,
                "variable \"%.100s\" has no type, one of <Real>, <Integer>, <Boolean>, <String>, <Enumeration>",
                variable->name);
        return;
    }
    bool is_fixed = variable->causality == TL_PARAMETER || variable->causality == TL_CALCULATED_PARAMETER;
    if (!entry->has_variability) {
        variable->variability = is_fixed ? TL_FIXED : variable->type == TL_REAL ? TL_CONTINUOUS : TL_DISCRETE;
    }
    /* Source: FMI 2.0.4, table in section 2.2.7: default of `initial`. */
    if (variable->causality == TL_INPUT || variable->causality == TL_INDEPENDENT) {
        variable->initial = TL_INITIAL_NONE;
    } else if (!entry->has_initial) {
        bool is_exact = variable->causality == TL_PARAMETER || variable->variability == TL_CONSTANT;
        variable->initial = is_exact ? TL_INITIAL_EXACT : TL_INITIAL_CALCULATED;
    }
}

/* ---- Tags ------------------------------------------------------------------------------------ */

typedef struct tag_rule {
    element parent;
    const char *name;
    element kind;
    void (*begin)(description_parser *parser, const xml_tag *tag); /* may be NULL */
} tag_rule;

static const tag_rule *find_rule(element parent, const char *name) {
    static const tag_rule rules[] = {
        {VARIABLES, "ScalarVariable", VARIABLE, begin_variable},
        {VARIABLE, "Real", LEAF, begin_type_of_variable},
        {VARIABLE, "Integer", LEAF, begin_type_of_variable},
        {VARIABLE, "Boolean", LEAF, begin_type_of_variable},
        {VARIABLE, "String", LEAF, begin_type_of_variable},
        {VARIABLE, "Enumeration", LEAF, begin_type_of_variable},
        {DOCUMENT, "fmiModelDescription", DESCRIPTION, begin_description},
        {DESCRIPTION, "ModelExchange", CAPABILITIES, begin_model_exchange},
        {DESCRIPTION, "CoSimulation", CAPABILITIES, begin_co_simulation},
        {DESCRIPTION, "DefaultExperiment", LEAF, begin_default_experiment},
        {DESCRIPTION, "UnitDefinitions", UNITS, NULL},
        {UNITS, "Unit", UNIT, begin_unit},
        {UNIT, "BaseUnit", LEAF, begin_base_unit},
        {DESCRIPTION, "TypeDefinitions", TYPES, NULL},
        {TYPES, "SimpleType", SIMPLE_TYPE, begin_simple_type},
        {SIMPLE_TYPE, "Real", LEAF, begin_type_of_type},
        {SIMPLE_TYPE, "Integer", LEAF, begin_type_of_type},
        {SIMPLE_TYPE, "Boolean", LEAF, begin_type_of_type},
        {SIMPLE_TYPE, "String", LEAF, begin_type_of_type},
        {SIMPLE_TYPE, "Enumeration", ITEMS, begin_type_of_type},
        {ITEMS, "Item", LEAF, begin_item},
        {DESCRIPTION, "ModelVariables", VARIABLES, begin_variables},
    };
    for (size_t i = 0; i < sizeof rules / sizeof rules[0]; i++) {
        if (rules[i].parent == parent && strcmp(rules[i].name, name) == 0) {
            return &rules[i];
        }
    }
    return NULL;
}

static void XMLCALL on_begin(void *context, const XML_Char *name, const XML_Char **attributes) {
    description_parser *parser = context;
    if (parser->status != TL_OK) {
        return;
    }
    if (parser->depth == TL_MODEL_DESCRIPTION_DEPTH) {
        fail_at(parser, current_line(parser), "<%.60s> is nested deeper than %d elements", name,
                (int)TL_MODEL_DESCRIPTION_DEPTH);
        return;
    }
    element parent = parser->path[parser->depth];
    const tag_rule *rule = find_rule(parent, name);
    if (rule == NULL && parent == DOCUMENT) {
        fail_at(parser, current_line(parser), "the root is <%.60s>, not <fmiModelDescription>: this is not an FMU",
                name);
        return;
    }
    parser->depth++;
    parser->path[parser->depth] = rule == NULL ? IGNORED : rule->kind;
    if (rule != NULL && rule->begin != NULL) {
        xml_tag tag = {name, attributes};
        rule->begin(parser, &tag);
    }
}

static void XMLCALL on_end(void *context, const XML_Char *name) {
    description_parser *parser = context;
    (void)name;
    if (parser->status != TL_OK) {
        return;
    }
    element kind = parser->path[parser->depth];
    parser->depth--;
    if (kind == VARIABLE) {
        end_variable(parser);
    } else if (kind == SIMPLE_TYPE) {
        end_simple_type(parser);
    }
}

/* Only a DTD can define entities, so without a DTD none can expand. */
static void XMLCALL on_doctype(void *context, const XML_Char *name, const XML_Char *system_id,
                               const XML_Char *public_id, int has_internal_subset) {
    description_parser *parser = context;
    (void)system_id;
    (void)public_id;
    (void)has_internal_subset;
    fail_at(parser, current_line(parser),
            "<!DOCTYPE %.60s> is rejected, because a DTD can hide an attack: export the FMU again", name);
}

/* ---- The whole document ---------------------------------------------------------------------- */

static double first_number(double own, double inherited, double standard) {
    double value = isnan(own) ? inherited : own;
    return isnan(value) ? standard : value;
}

static void inherit_items(tl_variable *variable, const tl_draft_declaration *type) {
    double least = (double)type->least_item;
    double most = (double)type->most_item;
    if (variable->type != TL_ENUMERATION || type->most_item < type->least_item || variable->minimum > most ||
        variable->maximum < least) {
        return;
    }
    double skipped = variable->minimum > least ? ceil(variable->minimum) - least : 0.0;
    variable->minimum = least + skipped;
    variable->maximum = variable->maximum < most ? variable->maximum : most;
    variable->items = skipped < 64.0 ? type->items >> (unsigned)skipped : 0;
}

/* Attributes that the variable does not have are inherited from its declared type. */
static void inherit(description_parser *parser, tl_draft_variable *entry) {
    static const tl_draft_declaration none = {
        .minimum = (double)NAN, .maximum = (double)NAN, .nominal = (double)NAN, .most_item = -1};
    tl_draft_declaration *own = &entry->declaration;
    tl_variable *variable = &entry->variable;
    const tl_draft_declaration *inherited = &none;
    if (entry->declared_type != NULL) {
        const tl_draft_type *type = find_item(&parser->types, entry->declared_type);
        if (type == NULL || type->declaration.type != own->type) {
            fail_at(parser, entry->item.line, "declaredType=\"%.100s\" of variable \"%.100s\" is %s",
                    entry->declared_type, variable->name,
                    type == NULL ? "not in <TypeDefinitions>" : "of another type than the variable");
            return;
        }
        inherited = &type->declaration;
    }
    own->unit = own->unit == NULL ? inherited->unit : own->unit;
    variable->minimum = first_number(own->minimum, inherited->minimum, -(double)INFINITY);
    variable->maximum = first_number(own->maximum, inherited->maximum, (double)INFINITY);
    inherit_items(variable, inherited);
    variable->nominal = fabs(first_number(own->nominal, inherited->nominal, 1));
    if (variable->nominal == 0) {
        variable->nominal = 1;
    }
    if (variable->minimum > variable->maximum) {
        fail_at(parser, entry->item.line, "variable \"%.100s\" has min %g above max %g; correct one of them",
                variable->name, variable->minimum, variable->maximum);
    }
    if (own->unit != NULL && own->unit[0] != '\0') {
        tl_draft_unit *implied = append(parser, &parser->units, own->unit, IMPLIED);
        if (implied != NULL) {
            implied->unit.factor = 1;
        }
    }
}

/* ---- variables of one name ---- */

static int compare_index(const void *left, const void *right) {
    const tl_draft_variable *a = left;
    const tl_draft_variable *b = right;
    return (a->index > b->index) - (a->index < b->index);
}

static int compare_variables(const void *left, const void *right) {
    const tl_draft_variable *a = left;
    const tl_draft_variable *b = right;
    int order = strcmp(a->item.name, b->item.name);
    return order != 0 ? order : compare_index(left, right);
}

static bool are_same(const tl_variable *a, const tl_variable *b) {
    return a->reference == b->reference && a->type == b->type && a->causality == b->causality;
}

/* `count` variables of one name, in the order of the document. */
static void mark_group(tl_draft_variable *group, size_t count) {
    bool is_ambiguous = false;
    for (size_t i = 1; i < count; i++) {
        is_ambiguous = is_ambiguous || !are_same(&group[i].variable, &group[0].variable);
    }
    for (size_t i = 0; i < count; i++) {
        group[i].variable.is_ambiguous = is_ambiguous;
        group[i].is_repeated = !is_ambiguous && i > 0;
    }
}

/* Names must be unique, but some exporters write a variable twice, often one that no connection
 * needs. Drops equal ones and marks different ones. */
static void find_repeated(tl_draft_list *list) {
    tl_draft_variable *variables = list->items;
    size_t kept = 0;
    if (list->count == 0) {
        return;
    }
    qsort(variables, list->count, sizeof *variables, compare_variables);
    for (size_t first = 0, end = 0; first < list->count; first = end) {
        while (end < list->count && strcmp(variables[end].item.name, variables[first].item.name) == 0) {
            end++;
        }
        mark_group(&variables[first], end - first);
    }
    qsort(variables, list->count, sizeof *variables, compare_index);
    for (size_t i = 0; i < list->count; i++) {
        variables[kept] = variables[i];
        kept += variables[i].is_repeated ? 0 : 1;
    }
    list->count = kept;
}

static void copy_to_model(description_parser *parser) {
    tl_model *model = parser->model;
    tl_unit *units = tl_arena_take(parser->arena, parser->units.count, sizeof(tl_unit));
    tl_variable *variables = tl_arena_take(parser->arena, parser->variables.count, sizeof(tl_variable));
    if (units == NULL || variables == NULL) {
        fail_memory(parser);
        return;
    }
    const tl_draft_unit *drafts = parser->units.items;
    for (size_t i = 0; i < parser->units.count; i++) {
        units[i] = drafts[i].unit;
        units[i].name = drafts[i].item.name;
    }
    for (size_t i = 0; i < parser->variables.count; i++) {
        const tl_draft_variable *entry = item_at(&parser->variables, i);
        const char *unit = entry->declaration.unit;
        const tl_draft_unit *found = unit != NULL ? find_item(&parser->units, unit) : NULL;
        variables[i] = entry->variable;
        variables[i].unit = found != NULL && unit[0] != '\0' ? &units[found - drafts] : NULL;
    }
    model->units = units;
    model->unit_count = parser->units.count;
    model->variables = variables;
    model->variable_count = parser->variables.count;
}

/* Checks that need the whole document. Lists are sorted once and then searched, so that
 * descriptions with a hundred thousand variables are read quickly. */
static void finish_description(description_parser *parser) {
    sort_names(parser, &parser->types, "type");
    for (size_t i = 0; i < parser->variables.count && parser->status == TL_OK; i++) {
        inherit(parser, item_at(&parser->variables, i));
    }
    if (parser->status == TL_OK) {
        sort_names(parser, &parser->units, "unit");
    }
    if (parser->status == TL_OK) {
        find_repeated(&parser->variables);
        copy_to_model(parser);
    }
}

static void check_document(description_parser *parser) {
    unsigned long line = current_line(parser);
    if (!parser->has_co_simulation) {
        fail_at(parser, line, "%s; export the model as FMI 2.0 for Co-Simulation",
                parser->has_model_exchange ? "the FMU is for Model Exchange only" : "there is no <CoSimulation>");
    } else if (!parser->has_variables) {
        fail_at(parser, line, "there is no <ModelVariables>, which FMI 2.0 requires; export the FMU again");
    } else {
        finish_description(parser);
    }
}

/* ---- Encodings that expat does not know ---- */

/* For one parser. length: bytes of a character that begins with this byte. */
typedef struct decoder {
    iconv_t iconv;
    unsigned char length[256];
} decoder;

enum { INVALID = -1, INCOMPLETE = -2, MOST_BYTES = 3 };

/* Returns the code point of one character, INVALID or INCOMPLETE. */
static long decode(iconv_t converter, const char *bytes, size_t size) {
    wchar_t points[4] = {0};
    char copy[MOST_BYTES];
    char *in = memcpy(copy, bytes, size);
    char *out = (char *)points;
    size_t out_left = sizeof points;
    (void)iconv(converter, NULL, NULL, NULL, NULL);
    if (iconv(converter, &in, &size, &out, &out_left) == (size_t)-1) {
        return errno == EINVAL ? INCOMPLETE : INVALID;
    }
    (void)iconv(converter, NULL, NULL, &out, &out_left); /* flushes a character that an accent could follow */
    return out_left == sizeof points - sizeof points[0] ? (long)points[0] : INVALID;
}

static int XMLCALL decode_character(void *data, const char *bytes) {
    decoder *own = data;
    long point = decode(own->iconv, bytes, own->length[(unsigned char)bytes[0]]);
    return point >= 0 && point <= 0xFFFF ? (int)point : INVALID;
}

static void XMLCALL close_decoder(void *data) {
    decoder *own = data;
    (void)iconv_close(own->iconv);
    free(own);
}

/* Describes a first byte as expat requires: the character, INVALID, or the negative length. */
static int describe_byte(iconv_t converter, unsigned char first) {
    char bytes[2] = {(char)first, 0};
    long point = decode(converter, bytes, 1);
    if (point != INCOMPLETE) {
        return point <= 0xFFFF ? (int)point : INVALID;
    }
    for (int second = 0x30; second < 0xFF; second++) {
        bytes[1] = (char)second;
        if (decode(converter, bytes, 2) >= 0) {
            return -2;
        }
    }
    return -MOST_BYTES;
}

static iconv_t no_converter(void) {
    return (iconv_t)-1; // NOLINT(performance-no-int-to-ptr): what iconv_open() returns
}

/* Accepts only stateless encodings whose bytes below 0x80 are ASCII, except a currency sign. */
static iconv_t open_encoding(const char *name) {
    static const char *const families[] = {"windows-", "cp12", "cp9",  "iso-8859-", "iso8859-", "latin",    "koi8-",
                                           "gb",       "big5", "euc-", "shift",     "sjis",     "macintosh"};
    static const char windows[] = "windows-";
    char page[32];
    iconv_t converter = no_converter();
    for (size_t i = 0; i < sizeof families / sizeof families[0]; i++) {
        if (strncasecmp(name, families[i], strlen(families[i])) == 0) {
            converter = iconv_open("WCHAR_T", name);
            break;
        }
    }
    if (converter == no_converter() && strncasecmp(name, windows, strlen(windows)) == 0) {
        (void)snprintf(page, sizeof page, "CP%.20s", name + strlen(windows));
        converter = iconv_open("WCHAR_T", page);
    }
    return converter;
}

static int XMLCALL on_encoding(void *context, const XML_Char *name, XML_Encoding *encoding) {
    (void)context;
    decoder *own = calloc(1, sizeof *own);
    iconv_t converter = own != NULL ? open_encoding(name) : no_converter();
    if (converter == no_converter()) {
        free(own);
        return XML_STATUS_ERROR;
    }
    own->iconv = converter;
    for (int i = 0; i < 256; i++) {
        int described = i < 0x80 ? i : describe_byte(converter, (unsigned char)i);
        encoding->map[i] = described;
        own->length[i] = (unsigned char)(described < INVALID ? -described : 1);
    }
    encoding->data = own;
    encoding->convert = decode_character;
    encoding->release = close_decoder;
    return XML_STATUS_OK;
}

/* ---- Parsing ---- */

/* A text in memory, or a file that is read in parts. */
typedef struct description_source {
    const char *xml; /* NULL: a file */
    size_t size;
    int file;
} description_source;

/* expat scans an unfinished token again with each part, so a long comment would be slow with small
 * parts. */
enum { PART = 16 * 1024 * 1024 };

static enum XML_Status feed_file(description_parser *parser, int file) {
    enum XML_Status result = XML_STATUS_OK;
    ssize_t got = PART;
    while (got == PART && result == XML_STATUS_OK) {
        void *part = XML_GetBuffer(parser->expat, PART);
        if (part == NULL) {
            fail_memory(parser);
            return XML_STATUS_ERROR;
        }
        got = tl_file_bytes_read(file, part, PART);
        if (got < 0) {
            parser->status = tl_fail(parser->error, TL_TRY_AGAIN, "%s: modelDescription.xml cannot be read: %s",
                                     parser->label, strerror(errno));
            return XML_STATUS_ERROR;
        }
        result = XML_ParseBuffer(parser->expat, (int)got, got < PART ? XML_TRUE : XML_FALSE);
    }
    return result;
}

static void fail_xml(description_parser *parser) {
    enum XML_Error code = XML_GetErrorCode(parser->expat);
    if (code == XML_ERROR_NO_MEMORY) {
        fail_memory(parser);
        return;
    }
    const char *advice = "";
    if (code == XML_ERROR_UNKNOWN_ENCODING) {
        advice = "; save the file as UTF-8 in the FMU, and declare that in its first line";
    } else if (code == XML_ERROR_INVALID_TOKEN) {
        advice =
            "; if there are letters in another encoding than the declared one (UTF-8 if none is), save it as UTF-8";
    }
    fail_at(parser, current_line(parser), "not well-formed XML, column %lu: %s%s",
            (unsigned long)CURRENT_COLUMN(parser->expat) + 1, XML_ErrorString(code), advice);
}

static void parse(description_parser *parser, const description_source *from) {
    XML_SetUserData(parser->expat, parser);
    XML_SetElementHandler(parser->expat, on_begin, on_end);
    XML_SetStartDoctypeDeclHandler(parser->expat, on_doctype);
    XML_SetUnknownEncodingHandler(parser->expat, on_encoding, NULL);
    enum XML_Status result = from->xml != NULL ? XML_Parse(parser->expat, from->xml, (int)from->size, XML_TRUE)
                                               : feed_file(parser, from->file);
    if (parser->status == TL_OK && result != XML_STATUS_OK) {
        fail_xml(parser);
    }
    if (parser->status == TL_OK) {
        check_document(parser);
    }
}

static tl_status fail_size(const char *label, tl_error *error) {
    return tl_fail(error, TL_BAD_DATA, "%s: modelDescription.xml is larger than %d MiB; export fewer variables", label,
                   TL_MODEL_DESCRIPTION_BYTES / (1024 * 1024));
}

static tl_status parse_source(const description_source *from, const char *label, tl_arena *arena, tl_model *model,
                              tl_error *error) {
    *model = (tl_model){.name = "",
                        .identifier = "",
                        .guid = "",
                        .generation_tool = "",
                        .start_time = (double)NAN,
                        .stop_time = (double)NAN};
    if (from->size > TL_MODEL_DESCRIPTION_BYTES) {
        return fail_size(label, error);
    }
    description_parser *parser = calloc(1, sizeof *parser);
    XML_Parser expat = XML_ParserCreate(NULL);
    if (parser == NULL || expat == NULL) {
        free(parser);
        XML_ParserFree(expat);
        return tl_fail(error, TL_TRY_AGAIN, "%s: not enough memory; free memory and try again", label);
    }
    parser->expat = expat;
    parser->label = label;
    parser->arena = arena;
    parser->model = model;
    parser->error = error;
    parser->path[0] = DOCUMENT;
    parser->units.size = sizeof(tl_draft_unit);
    parser->types.size = sizeof(tl_draft_type);
    parser->variables.size = sizeof(tl_draft_variable);
    parse(parser, from);
    tl_status status = parser->status;
    XML_ParserFree(expat);
    free(parser->units.items);
    free(parser->types.items);
    free(parser->variables.items);
    free(parser);
    return status;
}

tl_status tl_model_description_parse(const char *xml, size_t size, const char *label, tl_arena *arena, tl_model *model,
                                     tl_error *error) {
    const description_source from = {.xml = xml, .size = size};
    return parse_source(&from, label, arena, model, error);
}

tl_status tl_model_description_read(const char *path, const char *label, tl_arena *arena, tl_model *model,
                                    tl_error *error) {
    struct stat facts;
    tl_status status = TL_OK;
    int file = open(path, O_RDONLY | O_CLOEXEC);
    if (file < 0) {
        return errno == ENOENT
                   ? tl_fail(error, TL_BAD_DATA,
                             "%s: there is no modelDescription.xml in it: this is not an FMU; export it again", label)
                   : tl_fail(error, TL_TRY_AGAIN, "%s: modelDescription.xml cannot be opened: %s", label,
                             strerror(errno));
    }
    if (fstat(file, &facts) != 0 || !S_ISREG(facts.st_mode)) {
        status = tl_fail(error, TL_BAD_DATA, "%s: modelDescription.xml is not a file: this is not an FMU", label);
    } else {
        const description_source from = {.size = (size_t)facts.st_size, .file = file};
        status = parse_source(&from, label, arena, model, error);
    }
    (void)close(file);
    return status;
}
