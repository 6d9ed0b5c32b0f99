/* Change of a configuration: finds the differences, their rights, and how they take effect: see
 * config_change.h. */
#include "firmware/config/config_change.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "firmware/base/os.h"
#include "firmware/config/drivers.h"
#include "master/plan/tuning.h"

/* ---- allowed names ---- */

struct tl_allowed_name {
    tl_change_named kind;
    char *text;
};

static tl_status add(tl_allowed_names *allowed, tl_change_named kind, const char *text, size_t length,
                     tl_error *error) {
    struct tl_allowed_name *names = tl_array_grown(allowed->names, allowed->count, sizeof *names);
    char *copy = names != NULL ? strndup(text, length) : NULL;
    allowed->names = names != NULL ? names : allowed->names;
    if (copy == NULL) {
        return tl_fail(error, TL_TRY_AGAIN,
                       "not enough memory for the list of allowed names; free memory and try again");
    }
    allowed->names[allowed->count++] = (struct tl_allowed_name){kind, copy};
    return TL_OK;
}

/* ---- a list ---- */

/* Parses "file NAME" or "library NAME"; the name may contain blanks. */
static tl_status add_line(tl_allowed_names *allowed, const char *line, size_t length, unsigned number,
                          tl_error *error) {
    static const struct {
        const char *word;
        tl_change_named kind;
    } kinds[] = {{"file", TL_NAMES_FILE}, {"library", TL_NAMES_LIBRARY}};
    while (length > 0 && strchr(" \t\r", line[length - 1]) != NULL) {
        length--;
    }
    if (length == 0 || line[0] == '#') {
        return TL_OK;
    }
    size_t letters = strcspn(line, " \t\n");
    size_t name = letters + strspn(line + letters, " \t");
    for (size_t i = 0; i < sizeof kinds / sizeof kinds[0]; i++) {
        bool is_kind = strlen(kinds[i].word) == letters && strncmp(line, kinds[i].word, letters) == 0;
        if (is_kind && name < length) {
            return add(allowed, kinds[i].kind, line + name, length - name, error);
        }
    }
    return tl_fail(error, TL_BAD_DATA, "line %u: found \"%.*s\", expected \"file NAME\" or \"library NAME\"", number,
                   (int)(length < 80 ? length : 80), line);
}

tl_status tl_allowed_names_add_list(tl_allowed_names *allowed, const char *text, tl_error *error) {
    tl_status status = TL_OK;
    const char *line = text;
    for (unsigned number = 1; line[0] != '\0' && status == TL_OK; number++) {
        size_t length = strcspn(line, "\n");
        status = add_line(allowed, line, length, number, error);
        line += length + (line[length] == '\n' ? 1 : 0);
    }
    return status;
}

/* ---- a configuration ---- */

typedef struct name_collection {
    tl_allowed_names *allowed;
    tl_status status;
    tl_error error;
} name_collection;

static void collect(const tl_json_difference *difference, void *context) {
    name_collection *c = context;
    tl_change_needs needs = tl_change_needs_of(difference);
    if (c->status == TL_OK && needs.names != TL_NAMES_NOTHING && cJSON_IsString(difference->after)) {
        const char *text = difference->after->valuestring;
        c->status = add(c->allowed, needs.names, text, strlen(text), &c->error);
    }
}

tl_status tl_allowed_names_add_configuration(tl_allowed_names *allowed, const char *text, tl_error *error) {
    const tl_json_source nothing = {"{}", strlen("{}"), "nothing"};
    const tl_json_source all = {text, strlen(text), "a configuration"};
    name_collection c = {.allowed = allowed, .status = TL_OK};
    tl_status status = tl_json_compare(&nothing, &all, collect, &c, error);
    return status != TL_OK ? status : c.status == TL_OK ? TL_OK : tl_fail(error, c.status, "%s", c.error.text);
}

/* ---- queries ---- */

bool tl_allowed_names_have(const tl_allowed_names *allowed, tl_change_named kind, const char *name) {
    for (size_t i = 0; i < allowed->count; i++) {
        if (allowed->names[i].kind == kind && strcmp(allowed->names[i].text, name) == 0) {
            return true;
        }
    }
    return false;
}

void tl_allowed_names_free(tl_allowed_names *allowed) {
    for (size_t i = 0; i < allowed->count; i++) {
        free(allowed->names[i].text);
    }
    free(allowed->names);
    *allowed = (tl_allowed_names){.count = 0};
}

/* ---- The table of rules, and the search of a rule for a path. */

/* ---- values ---- */

static bool is_path(const cJSON *value) {
    return cJSON_IsString(value) && strchr(value->valuestring, '/') != NULL;
}

static void name(const cJSON *after, tl_change_named what, tl_change_needs *needs) {
    needs->right = TL_RIGHT_COMMISSION; /* if the value is removed */
    needs->names = TL_NAMES_NOTHING;
    if (after != NULL) {
        needs->right = TL_RIGHT_BOX;
        needs->names = what;
    }
}

/* A text in `set` may be the name of a file, which the FMU could then read. */
static void needs_of_set(const cJSON *before, const cJSON *after, tl_change_needs *needs) {
    (void)before;
    if (is_path(after)) {
        name(after, TL_NAMES_FILE, needs);
    } else if (cJSON_IsString(after)) {
        needs->right = TL_RIGHT_COMMISSION;
    }
}

/* A plain name is searched among the installed FMUs, and its hash identifies the file. A path could
 * be any file. */
static void needs_of_fmu(const cJSON *before, const cJSON *after, tl_change_needs *needs) {
    (void)before;
    if (is_path(after) || !tl_json_has_sibling(after, "sha256")) {
        name(after, TL_NAMES_FMU, needs);
    }
}

/* If the key is left out, the value comes from the FMU, and only a new twin reads it. */
static void needs_of_presence(const cJSON *before, const cJSON *after, tl_change_needs *needs) {
    if (before == NULL || after == NULL) {
        needs->kind = TL_CHANGE_NEW_TWIN;
    }
}

static double number_of(const cJSON *value, double standard) {
    if (value == NULL) {
        return standard;
    }
    return cJSON_IsNumber(value) ? value->valuedouble : (double)NAN;
}

/* A weight of 0 removes an output from the match, which may change the necessary length of the
 * horizon. */
static void needs_of_weight(const cJSON *before, const cJSON *after, tl_change_needs *needs) {
    const double standard = 1.0;
    if (!(number_of(before, standard) > 0.0 && number_of(after, standard) > 0.0)) {
        needs->kind = TL_CHANGE_NEW_TWIN;
    }
}

/* With a huber of at least 1 tolerance, J is below 1 for the same errors as without it. A smaller
 * one would count larger errors as within tolerance. */
static void needs_of_huber(const cJSON *before, const cJSON *after, tl_change_needs *needs) {
    const double least = 1.0;
    (void)before;
    if (!(number_of(after, least) >= least)) {
        needs->right = TL_RIGHT_COMMISSION;
    }
}

/* A twin has memory for its initial number of evaluations, and at least for TL_TUNING_ROOM. */
static void needs_of_evaluations(const cJSON *before, const cJSON *after, tl_change_needs *needs) {
    const double standard = TL_TUNING_ROOM;
    double most = fmax(standard, number_of(before, standard));
    if (!(number_of(after, standard) <= most)) {
        needs->kind = TL_CHANGE_NEW_TWIN;
    }
}

static bool has_sibling(const cJSON *before, const cJSON *after, const char *key) {
    return tl_json_has_sibling(before, key) || tl_json_has_sibling(after, key);
}

/* io detects repeated polls with this value (tl_config_repeats()), so io must restart. */
static void needs_of_polled(const cJSON *before, const cJSON *after, tl_change_needs *needs) {
    for (const tl_driver *const *row = tl_drivers; *row != NULL; row++) {
        if ((*row)->is_polled && has_sibling(before, after, (*row)->signal_key)) {
            needs->kind = TL_CHANGE_RESTART;
        }
    }
}

static void needs_of_stale(const cJSON *before, const cJSON *after, tl_change_needs *needs) {
    if (has_sibling(before, after, "every_s")) {
        needs_of_polled(before, after, needs);
    }
}

/* ---- the table ---- */

#define IN_PLACE                                                                                                       \
    { TL_CHANGE_IN_PLACE, TL_RIGHT_RETUNE, TL_NAMES_NOTHING }
#define NEW_TWIN                                                                                                       \
    { TL_CHANGE_NEW_TWIN, TL_RIGHT_RETUNE, TL_NAMES_NOTHING }
#define NEW_TWIN_COMMISSIONED                                                                                          \
    { TL_CHANGE_NEW_TWIN, TL_RIGHT_COMMISSION, TL_NAMES_NOTHING }
#define NEW_TWIN_ON_THE_BOX                                                                                            \
    { TL_CHANGE_NEW_TWIN, TL_RIGHT_BOX, TL_NAMES_NOTHING }
#define RESTART_ON_THE_BOX                                                                                             \
    { TL_CHANGE_RESTART, TL_RIGHT_BOX, TL_NAMES_NOTHING }
#define RESTART TL_RULE_RETUNE
#define RESTART_COMMISSIONED TL_RULE_COMMISSION

/* An object that is added or removed as a whole needs what its own rule and the rules of all its
 * parts require. A rule with "**" covers a whole part, including keys that are added to the format
 * later. */
const tl_change_rule tl_change_rules[] = {
    /* the whole configuration */
    {"$schema", IN_PLACE, NULL},
    {"fill_in", IN_PLACE, NULL}, /* no run has entries */
    {"fill_in.*", IN_PLACE, NULL},
    {"twinlock", RESTART, NULL},
    {"name", RESTART, NULL},                /* summaries and the database contain it */
    {"step_s", RESTART_COMMISSIONED, NULL}, /* the lock monitor counts steps */
    {"duration_s", RESTART_COMMISSIONED, NULL},
    {"start_s", RESTART_COMMISSIONED, NULL}, /* a run begins once */
    {"stop_s", RESTART_COMMISSIONED, NULL},
    /* FMUs */
    {"components", NEW_TWIN_COMMISSIONED, NULL},
    {"components.*", NEW_TWIN_COMMISSIONED, NULL},
    {"components.*.fmu", NEW_TWIN_COMMISSIONED, needs_of_fmu},
    {"components.*.sha256", NEW_TWIN_COMMISSIONED, NULL},
    {"components.*.set", NEW_TWIN, NULL},
    {"components.*.set.*", NEW_TWIN, needs_of_set},
    {"components.*.keep", NEW_TWIN, NULL},
    {"components.*.rollback", NEW_TWIN, NULL},
    {"components.*.replay_steps", NEW_TWIN, NULL},
    {"components.*.libraries", NEW_TWIN_COMMISSIONED, NULL},
    {"components.*.libraries[]", {TL_CHANGE_NEW_TWIN, TL_RIGHT_COMMISSION, TL_NAMES_LIBRARY}, NULL},
    {"components.*.read", NEW_TWIN_COMMISSIONED, NULL},
    {"components.*.read[]", {TL_CHANGE_NEW_TWIN, TL_RIGHT_COMMISSION, TL_NAMES_FILE}, NULL},
    {"components.*.unconfined", NEW_TWIN_ON_THE_BOX, NULL},
    {"components.*.logging", NEW_TWIN, NULL},
    /* Sources of live signals: io opens other ones only in a new run. The rules for the keys of
     * each driver are in its row.
     */
    {"sources", RESTART_COMMISSIONED, NULL},
    {"sources.*", RESTART_COMMISSIONED, NULL},
    /* Signals: a change of the measurements changes what the twin is matched with. */
    {"plant", RESTART_COMMISSIONED, NULL},
    {"plant.*", RESTART_COMMISSIONED, NULL},
    {"plant.*.type", RESTART_COMMISSIONED, NULL},
    {"plant.*.unit", NEW_TWIN, NULL},
    {"plant.*.min", NEW_TWIN_COMMISSIONED, NULL}, /* a value out of range is not compared */
    {"plant.*.max", NEW_TWIN_COMMISSIONED, NULL},
    {"plant.*.stale_s", NEW_TWIN_COMMISSIONED, needs_of_stale},
    {"plant.*.between", NEW_TWIN, NULL},
    {"plant.*.every_s", NEW_TWIN, needs_of_polled},
    {"plant.*.initial", NEW_TWIN, NULL},
    {"recording", RESTART, NULL},
    {"recording.file", RESTART_COMMISSIONED, NULL},
    {"recording.time_column", RESTART, NULL},
    /* the twin */
    {"connect.**", NEW_TWIN, NULL},
    {"compare.**", NEW_TWIN, NULL},
    {"synchronise", NEW_TWIN, NULL},
    {"synchronise.adjust", NEW_TWIN, NULL},
    {"synchronise.adjust.*", NEW_TWIN, NULL},
    {"synchronise.adjust.*.step", NEW_TWIN, NULL},
    {"synchronise.adjust.*.nominal", IN_PLACE, needs_of_presence},
    {"synchronise.adjust.*.min", IN_PLACE, NULL},
    {"synchronise.adjust.*.max", IN_PLACE, NULL},
    {"synchronise.adjust.*.approved", IN_PLACE, NULL},
    {"synchronise.adjust.*.penalty", IN_PLACE, NULL},
    {"synchronise.adjust.*.penalty.deviation", IN_PLACE, NULL},
    {"synchronise.adjust.*.penalty.rate", IN_PLACE, NULL},
    {"synchronise.adjust.*.dwell_s", NEW_TWIN, NULL},
    {"synchronise.start.**", NEW_TWIN, NULL},
    {"synchronise.match", NEW_TWIN, NULL},
    {"synchronise.match.*", NEW_TWIN, NULL},
    {"synchronise.match.*.to", NEW_TWIN, NULL},
    {"synchronise.match.*.between", NEW_TWIN, NULL},
    {"synchronise.match.*.tolerance", IN_PLACE, needs_of_presence},
    {"synchronise.match.*.weight", IN_PLACE, needs_of_weight},
    {"synchronise.match.*.huber", IN_PLACE, needs_of_huber},
    {"synchronise.match.*.condition.**", NEW_TWIN_COMMISSIONED, NULL}, /* a filter changes the measurement */
    {"synchronise.epsilon", NEW_TWIN, NULL},
    {"synchronise.horizon.event.**", NEW_TWIN_COMMISSIONED, NULL},
    {"synchronise.horizon.**", NEW_TWIN, NULL},
    {"synchronise.algorithm", NEW_TWIN, NULL},
    {"synchronise.fallback", NEW_TWIN, NULL},
    {"synchronise.stagnation", NEW_TWIN, NULL},
    {"synchronise.noise_floor", IN_PLACE, NULL},
    {"synchronise.verify_every", NEW_TWIN_COMMISSIONED, NULL},
    {"synchronise.free_twin", NEW_TWIN, NULL},
    {"synchronise.rest", NEW_TWIN, NULL},
    {"synchronise.release_s", NEW_TWIN, NULL},
    {"synchronise.saving.**", NEW_TWIN, NULL},
    {"synchronise.margin", IN_PLACE, NULL},
    {"synchronise.budget", IN_PLACE, NULL},
    {"synchronise.budget.evaluations", IN_PLACE, needs_of_evaluations},
    {"synchronise.budget.time_s", IN_PLACE, NULL},
    {"delays.**", NEW_TWIN, NULL},
    /* the database, the process, the emulated plant */
    {"record", RESTART_COMMISSIONED, NULL},
    {"record.file", RESTART_ON_THE_BOX, NULL},
    {"record.max_mb", RESTART_COMMISSIONED, NULL},
    {"record.commit_s", RESTART, NULL},
    {"record.resume_s", RESTART, NULL},
    {"detect.**", RESTART, NULL},
    {"realtime.**", RESTART_COMMISSIONED, NULL},
    {"emulate.**", RESTART, NULL},
    {NULL, RESTART_COMMISSIONED, NULL},
};

/* ---- looking up ---- */

/* Length of the next part of a pattern: "[]", or a key. */
static size_t part_length(const char *pattern) {
    return pattern[0] == '[' ? 2 : strcspn(pattern, ".[");
}

static bool fits(const char *part, size_t length, const tl_json_step *step) {
    if (step->key == NULL) {
        return part[0] == '[';
    }
    return (length == 1 && part[0] == '*') || (strlen(step->key) == length && strncmp(part, step->key, length) == 0);
}

static bool matches(const char *pattern, const tl_json_step *way, size_t depth) {
    for (size_t i = 0; i < depth && strcmp(pattern, "**") != 0; i++) {
        size_t length = part_length(pattern);
        if (length == 0 || !fits(pattern, length, &way[i])) {
            return false;
        }
        pattern += length;
        pattern += pattern[0] == '.' ? 1 : 0;
    }
    return depth > 0 && (pattern[0] == '\0' || strcmp(pattern, "**") == 0);
}

static const tl_change_rule *find_rule(const tl_change_rule *rule, const tl_json_step *way, size_t depth) {
    while (rule->pattern != NULL && !matches(rule->pattern, way, depth)) {
        rule++;
    }
    return rule->pattern != NULL ? rule : NULL;
}

const tl_change_rule *tl_change_rule_of(const tl_json_step *way, size_t depth) {
    const tl_change_rule *rule = find_rule(tl_change_rules, way, depth);
    for (const tl_driver *const *row = tl_drivers; rule == NULL && *row != NULL; row++) {
        rule = find_rule((*row)->rules, way, depth);
    }
    return rule;
}

/* A tuning identifies values by the index of their variable, and the sample memory identifies
 * signals by their index. */
static tl_change_needs needs_of_order(const tl_change_rule *rule) {
    static const struct {
        const char *pattern;
        tl_change_kind kind;
    } order_kinds[] = {{"synchronise.match", TL_CHANGE_NEW_TWIN},
                       {"synchronise.adjust", TL_CHANGE_NEW_TWIN},
                       {"plant", TL_CHANGE_RESTART}};
    tl_change_needs needs = {TL_CHANGE_NONE, TL_RIGHT_RETUNE, TL_NAMES_NOTHING};
    for (size_t i = 0; rule != NULL && i < sizeof order_kinds / sizeof order_kinds[0]; i++) {
        needs.kind = strcmp(rule->pattern, order_kinds[i].pattern) == 0 ? order_kinds[i].kind : needs.kind;
    }
    return needs;
}

tl_change_needs tl_change_needs_of(const tl_json_difference *difference) {
    tl_change_needs needs = RESTART_COMMISSIONED;
    const tl_change_rule *rule = tl_change_rule_of(difference->way, difference->depth);
    if (difference->is_order) {
        return needs_of_order(rule);
    }
    if (rule != NULL) {
        needs = rule->needs;
        if (needs.names != TL_NAMES_NOTHING) {
            name(difference->after, rule->needs.names, &needs);
        }
        if (rule->check != NULL) {
            rule->check(difference->before, difference->after, &needs);
        }
    }
    return needs;
}

/* ---- The differences of two texts, each with its requirements. */

typedef struct collection {
    tl_config_change *change;
    const tl_allowed_names *allowed;
    tl_config_edit edit; /* the last edit; differences within it may follow */
    bool has_edit;
} collection;

static void raise_needs(tl_change_needs *needs, tl_change_needs other) {
    needs->kind = other.kind > needs->kind ? other.kind : needs->kind;
    needs->right = other.right > needs->right ? other.right : needs->right;
}

static bool is_worse(tl_change_needs needs, tl_change_needs other) {
    return needs.kind != other.kind ? needs.kind > other.kind : needs.right > other.right;
}

/* Index of the last edit with the mildest requirements. */
static size_t find_least(const tl_config_change *change) {
    size_t mildest = 0;
    for (size_t i = 1; i < change->listed; i++) {
        mildest = is_worse(change->edits[i].needs, change->edits[mildest].needs) ? mildest : i;
    }
    return mildest;
}

static void add_edit(tl_config_change *change, const tl_config_edit *edit) {
    change->count++;
    if (change->listed == TL_CONFIG_EDITS) {
        size_t at = find_least(change);
        if (!is_worse(edit->needs, change->edits[at].needs)) {
            return;
        }
        change->listed--;
        memmove(&change->edits[at], &change->edits[at + 1], (change->listed - at) * sizeof change->edits[at]);
    }
    change->edits[change->listed++] = *edit;
}

static void add_last_edit(collection *c) {
    if (c->has_edit) {
        add_edit(c->change, &c->edit);
    }
    c->has_edit = false;
}

static void add_barred(tl_config_change *change, const tl_json_difference *difference, tl_change_named names) {
    size_t number = change->privileged_count++;
    if (number < TL_CONFIG_PRIVILEGED) {
        tl_config_privileged *privileged = &change->privileged[number];
        *privileged = (tl_config_privileged){.names = names};
        privileged->lacks_hash =
            names == TL_NAMES_FMU && cJSON_IsString(difference->after) && !is_path(difference->after);
        tl_json_steps_path(privileged->path, difference->way, difference->depth);
        tl_json_show(difference->after, privileged->found, sizeof privileged->found);
    }
}

static tl_change_needs needs_of(collection *c, const tl_json_difference *difference) {
    tl_change_needs needs = tl_change_needs_of(difference);
    if (needs.right != TL_RIGHT_BOX) {
        return needs;
    }
    bool is_allowed = needs.names != TL_NAMES_NOTHING && cJSON_IsString(difference->after) &&
                      tl_allowed_names_have(c->allowed, needs.names, difference->after->valuestring);
    if (is_allowed) {
        needs.right = TL_RIGHT_COMMISSION;
    } else {
        add_barred(c->change, difference, needs.names);
    }
    return needs;
}

static void collect_change(const tl_json_difference *difference, void *context) {
    collection *c = context;
    tl_change_needs needs = needs_of(c, difference);
    if (needs.kind == TL_CHANGE_NONE) {
        return;
    }
    raise_needs(&c->change->needs, needs);
    if (difference->within) {
        raise_needs(&c->edit.needs, needs);
        return;
    }
    add_last_edit(c);
    c->has_edit = true;
    c->edit.needs = needs;
    tl_json_steps_path(c->edit.path, difference->way, difference->depth);
    if (difference->is_order) {
        (void)snprintf(c->edit.before, sizeof c->edit.before, "entries");
        (void)snprintf(c->edit.after, sizeof c->edit.after, "entries in another order");
    } else {
        tl_json_show(difference->before, c->edit.before, sizeof c->edit.before);
        tl_json_show(difference->after, c->edit.after, sizeof c->edit.after);
    }
}

tl_status tl_config_change_find(const char *active_text, size_t active_size, const char *candidate,
                                size_t candidate_size, const tl_allowed_names *allowed, tl_config_change *change,
                                tl_error *error) {
    collection c = {.change = change, .allowed = allowed};
    tl_json_source before = {active_text, active_size, "the running configuration"};
    tl_json_source after = {candidate, candidate_size, "the new configuration"};
    *change = (tl_config_change){.needs = {.right = TL_RIGHT_RETUNE}};
    tl_status status = tl_json_compare(&before, &after, collect_change, &c, error);
    if (status == TL_OK) {
        add_last_edit(&c);
    } else {
        *change = (tl_config_change){.needs = {.right = TL_RIGHT_RETUNE}};
    }
    return status;
}
