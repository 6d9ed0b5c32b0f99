/* Reads `compare` and `synchronise`. */
#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "firmware/config/config.h"
#include "firmware/config/config_reader.h"
#include "firmware/config/json_document.h"
#include "master/twin/twin.h"

/* ---- `synchronise.horizon`: T_P steps, or a stroke around an event. */

const char *const tl_pairing_names[] = {[TL_LAG] = "lag", [TL_AHEAD] = "ahead", [TL_HOLD] = "hold", NULL};

tl_pairing tl_pairing_named(const char *name) {
    for (int i = TL_LAG; name != NULL && i <= TL_HOLD; i++) {
        if (strcmp(name, tl_pairing_names[i]) == 0) {
            return (tl_pairing)i;
        }
    }
    return TL_LAG;
}

/* Reads "plant.signal", or "not plant.signal" for the instant at which it becomes false. */
static void read_edge(tl_config_object *object, const char *key, const char *example, tl_plan_edge *edge) {
    static const char *const negation = "not ";
    const char *text = NULL;
    if (tl_config_get_text(object, key, TL_CONFIG_REQUIRED, example, &text)) {
        edge->falls = strncmp(text, negation, strlen(negation)) == 0;
        edge->signal = edge->falls ? text + strlen(negation) : text;
        tl_config_check_reference_of(object, key, edge->signal, TL_CONFIG_SIGNAL);
    }
}

static void read_event(tl_config_object *horizon, tl_config *config) {
    tl_config_object event;
    if (!tl_config_member(horizon, "event", TL_CONFIG_OPTIONAL,
                          "{\"start\": \"plant.move_out\", \"end\": \"plant.extended\", \"window_s\": 0.08, "
                          "\"longest_s\": 2}",
                          &event)) {
        return;
    }
    config->event.where = tl_config_copy_path(horizon->reader, event.path);
    read_edge(&event, "start", "\"plant.move_out\"", &config->event.start);
    read_edge(&event, "end", "\"plant.extended\"", &config->event.end);
    (void)tl_config_get_duration(&event, "window_s", TL_CONFIG_REQUIRED, "0.08", &config->event.window);
    (void)tl_config_get_duration(&event, "longest_s", TL_CONFIG_REQUIRED, "2", &config->event.longest);
    tl_config_done(&event);
}

static void read_horizon(tl_config_object *object, tl_config *config) {
    static const tl_config_number rule = {.whole = true, .minimum = 1, .maximum = 1000, .example = "2"};
    static const char *const shapes[] = {[TL_STATIC] = "static", [TL_DYNAMIC] = "dynamic", NULL};
    tl_config_object horizon;
    size_t shape = TL_STATIC;
    size_t measurements = TL_LAG;
    (void)tl_config_member(object, "horizon", TL_CONFIG_OPTIONAL, "{\"prediction\": 2}", &horizon);
    (void)tl_config_get_count(&horizon, "prediction", &rule, &config->prediction);
    (void)tl_config_get_choice(&horizon, "shape", TL_CONFIG_OPTIONAL, shapes, &shape);
    (void)tl_config_get_choice(&horizon, "measurements", TL_CONFIG_OPTIONAL, tl_pairing_names, &measurements);
    config->shape = (tl_shape)shape;
    config->measurements = (tl_pairing)measurements;
    read_event(&horizon, config);
    tl_config_done(&horizon);
}

/* ---- `compare` and `synchronise`: outputs that are compared, and how the twin is corrected. */

static const tl_config_map MATCH = {.need = TL_CONFIG_REQUIRED,
                                    .least = 1,
                                    .most = TL_MAX_MATCH,
                                    .example = "{\"motor.omega\": {\"to\": \"plant.omega\", \"tolerance\": 1.0}}"};
static const tl_config_map COMPARE = {.need = TL_CONFIG_OPTIONAL,
                                      .least = 1,
                                      .most = TL_MAX_MATCH,
                                      .example = "{\"motor.omega\": {\"to\": \"plant.omega\"}}"};
static const tl_config_map ADJUST = {
    .need = TL_CONFIG_REQUIRED, .least = 1, .most = TL_MAX_ADJUST, .example = "{\"motor.d\": {\"step\": 0.05}}"};

/* ---- match and compare ---- */

/* Opens an entry whose key is a variable. */
static void begin_variable(const tl_config_object *map, const cJSON *item, const char *example,
                           tl_config_object *entry) {
    (void)tl_config_entry(map, item, example, entry);
    tl_config_check_reference(map->reader, entry->path, tl_json_line(item), item->string, TL_CONFIG_VARIABLE);
}

/* `general` > 0: tolerance of all matches; then a match must not have its own. */
static void read_tolerance(tl_config_object *entry, double general, tl_plan_match *match) {
    static const tl_config_number weight = {.maximum = HUGE_VAL, .example = "1"};
    tl_config_number tolerance = {.above = true, .maximum = HUGE_VAL, .example = "0.5"};
    (void)tl_config_get_number(entry, "weight", &weight, &match->weight);
    if (general > 0 && tl_config_get(entry, "tolerance", TL_CONFIG_OPTIONAL, NULL, NULL) != NULL) {
        tl_config_wrong(entry, "tolerance", "a tolerance together with synchronise.epsilon",
                        "only one of them (epsilon is the square of every match's tolerance)", NULL);
    } else if (general > 0) {
        match->tolerance = general;
    } else {
        tolerance.need = match->weight > 0 ? TL_CONFIG_REQUIRED : TL_CONFIG_OPTIONAL;
        (void)tl_config_get_number(entry, "tolerance", &tolerance, &match->tolerance);
    }
}

static void read_condition(tl_config_object *entry, tl_time step, tl_condition *condition) {
    static const tl_config_number median_rule = {
        .whole = true, .minimum = 1, .maximum = 99, .expected = "an odd whole number from 1 to 99", .example = "5"};
    static const tl_config_number gate = {.above = true, .maximum = HUGE_VAL, .example = "10"};
    static const char *const outliers[] = {"reject", "keep", NULL};
    size_t keeps = 0;
    char expected[96];
    tl_config_object object;
    (void)tl_config_member(entry, "condition", TL_CONFIG_OPTIONAL, "{\"median\": 5}", &object);
    if (tl_config_get_count(&object, "median", &median_rule, &condition->median) && condition->median % 2 == 0) {
        tl_config_wrong(&object, "median", NULL, median_rule.expected, median_rule.example);
    }
    (void)tl_config_get_duration(&object, "low_pass_s", TL_CONFIG_OPTIONAL, "0.05", &condition->low_pass);
    if (step > 0 &&
        condition->low_pass > TL_CONFIG_LONGEST_SHIFT * step) { /* a step waits this long for the measurement */
        (void)snprintf(expected, sizeof expected, "at most %d times step_s, which is %.15g s", TL_CONFIG_LONGEST_SHIFT,
                       tl_seconds(TL_CONFIG_LONGEST_SHIFT * step));
        tl_config_wrong(&object, "low_pass_s", NULL, expected, NULL);
    }
    (void)tl_config_get_number(&object, "gate", &gate, &condition->gate);
    if (tl_config_get_choice(&object, "outliers", TL_CONFIG_OPTIONAL, outliers, &keeps)) {
        condition->keeps_outliers = keeps == 1;
    }
    tl_config_done(&object);
}

/* Target and rules of a list of matched or compared outputs. */
typedef struct match_list {
    tl_config *config;
    const char *example; /* of an entry */
    bool weighted;       /* synchronise.match; else `compare`, with all weights 0 */
    double tolerance;    /* as in read_tolerance() */
} match_list;

static void read_output(const tl_config_object *map, const cJSON *item, size_t index, void *context) {
    static const tl_config_number huber = {.above = true, .maximum = HUGE_VAL, .example = "3"};
    static const char *const choices[] = {[TL_BETWEEN_LAST] = "last", [TL_BETWEEN_LINE] = "line", NULL};
    const match_list *list = context;
    size_t between = TL_BETWEEN_LAST;
    tl_plan_match *match = &list->config->match[index];
    tl_config_object entry;
    begin_variable(map, item, list->example, &entry);
    *match = tl_plan_match_defaults(item->string, NULL, 1);
    match->weight = list->weighted ? match->weight : 0;
    match->where = tl_config_copy_path(map->reader, entry.path);
    if (tl_config_get_text(&entry, "to", TL_CONFIG_REQUIRED, "\"plant.omega\"", &match->to)) {
        tl_config_check_reference_of(&entry, "to", match->to, TL_CONFIG_SIGNAL);
    }
    (void)tl_config_get_choice(&entry, "between", TL_CONFIG_OPTIONAL, choices, &between);
    list->config->matched_between[index] = (tl_between)between;
    if (list->weighted) { /* keys of matched outputs only */
        read_tolerance(&entry, list->tolerance, match);
        (void)tl_config_get_number(&entry, "huber", &huber, &match->huber);
        read_condition(&entry, list->config->step, &list->config->conditions[index]);
    }
    tl_config_done(&entry);
}

static void read_match(tl_config_object *parent, const char *key, const tl_config_map *rule, match_list *list) {
    tl_config *config = list->config;
    tl_config_object map;
    config->match = tl_config_take_entries(parent, key, rule, sizeof *config->match, &map, &config->match_count);
    config->matched_between = tl_config_allocate(parent->reader, config->match_count, sizeof *config->matched_between);
    config->conditions = tl_config_allocate(parent->reader, config->match_count, sizeof *config->conditions);
    if (config->matched_between != NULL && config->conditions != NULL) {
        tl_config_each(&map, read_output, list);
    }
}

void tl_config_read_compare(tl_config_object *root, tl_config *config) {
    bool both = cJSON_GetObjectItemCaseSensitive(root->json, "compare") != NULL &&
                cJSON_GetObjectItemCaseSensitive(root->json, "synchronise") != NULL;
    if (both) {
        tl_config_wrong(root, "compare", "compare together with synchronise",
                        "only one of them (in synchronise.match, weight 0 compares without correcting)", NULL);
    }
    match_list list = {.config = config, .example = "{\"to\": \"plant.omega\"}"};
    read_match(root, "compare", &COMPARE, &list);
}

/* ---- synchronise ---- */

static void read_nominal(tl_config_object *entry, tl_plan_adjust *adjust) {
    static const char *const expected = "a number, true or false";
    const cJSON *item = tl_config_get(entry, "nominal", TL_CONFIG_OPTIONAL, expected, "0");
    adjust->has_nominal = cJSON_IsNumber(item) || cJSON_IsBool(item);
    if (adjust->has_nominal) {
        adjust->nominal = cJSON_IsNumber(item) ? item->valuedouble : cJSON_IsTrue(item) ? 1 : 0;
    } else if (item != NULL) {
        tl_config_wrong(entry, "nominal", NULL, expected, "0");
    }
}

static void read_bounds(tl_config_object *entry, const tl_config_number *rule, double *lower, double *upper) {
    bool low = tl_config_get_number(entry, "min", rule, lower);
    bool high = tl_config_get_number(entry, "max", rule, upper);
    if (low && high && *lower >= *upper) {
        char expected[64];
        (void)snprintf(expected, sizeof expected, "more than min, which is %.15g", *lower);
        tl_config_wrong(entry, "max", NULL, expected, NULL);
    }
}

/* If û comes from the FMU or a connection, û + approved is limited to the bounds later. */
static void read_approved(tl_config_object *entry, tl_plan_adjust *adjust) {
    static const tl_config_number any = {.minimum = -HUGE_VAL, .maximum = HUGE_VAL, .example = "0"};
    (void)tl_config_get_number(entry, "approved", &any, &adjust->approved);
    double u = adjust->nominal + adjust->approved;
    bool counts = (adjust->approved < 0.0 || adjust->approved > 0.0) && adjust->has_nominal;
    if (counts && adjust->lower < adjust->upper && (u < adjust->lower || u > adjust->upper)) {
        char expected[96];
        (void)snprintf(expected, sizeof expected, "nominal + approved, which is %.15g, within min and max", u);
        tl_config_wrong(entry, "approved", NULL, expected, NULL);
    }
}

static void read_penalty(tl_config_object *entry, tl_plan_adjust *adjust) {
    static const tl_config_number rule = {.maximum = HUGE_VAL, .example = "0.01"};
    tl_config_object penalty;
    (void)tl_config_member(entry, "penalty", TL_CONFIG_OPTIONAL, "{\"rate\": 0.01}", &penalty);
    (void)tl_config_get_number(&penalty, "deviation", &rule, &adjust->deviation_penalty);
    (void)tl_config_get_number(&penalty, "rate", &rule, &adjust->rate_penalty);
    tl_config_done(&penalty);
}

static void read_variable(const tl_config_object *map, const cJSON *item, size_t index, void *context) {
    static const tl_config_number step = {.above = true, .maximum = HUGE_VAL, .example = "0.05"};
    static const tl_config_number any = {.minimum = -HUGE_VAL, .maximum = HUGE_VAL, .example = "0"};
    const tl_config *config = context;
    tl_plan_adjust *adjust = &config->adjust[index];
    tl_config_object entry;
    begin_variable(map, item, "{\"step\": 0.05}", &entry);
    *adjust = tl_plan_adjust_defaults(item->string, 0);
    adjust->where = tl_config_copy_path(map->reader, entry.path);
    /* Only the FMU shows later whether the variable is a Boolean, which needs no step. A step of 0
     * means that none was given. */
    (void)tl_config_get_number(&entry, "step", &step, &adjust->step);
    read_nominal(&entry, adjust);
    read_bounds(&entry, &any, &adjust->lower, &adjust->upper);
    read_approved(&entry, adjust);
    read_penalty(&entry, adjust);
    (void)tl_config_get_duration(&entry, "dwell_s", TL_CONFIG_OPTIONAL, "0.5", &adjust->dwell);
    tl_config_done(&entry);
}

static void read_find(const tl_config_object *map, const cJSON *item, size_t index, void *context) {
    static const tl_config_number any = {
        .need = TL_CONFIG_REQUIRED, .minimum = -1e100, .maximum = 1e100, .example = "0"};
    const tl_config *config = context;
    tl_plan_find *find = &config->find[index];
    tl_config_object entry;
    begin_variable(map, item, "{\"min\": 0, \"max\": 5}", &entry);
    find->variable = item->string;
    find->where = tl_config_copy_path(map->reader, entry.path);
    read_bounds(&entry, &any, &find->lower, &find->upper);
    tl_config_done(&entry);
}

/* Start values that are found in the first steps. */
static void read_start(tl_config_object *object, tl_config *config) {
    static const char *const example = "{\"over_s\": 10, \"find\": {\"tanks.level2\": {\"min\": 0, \"max\": 5}}}";
    static const tl_config_map rule = {.need = TL_CONFIG_REQUIRED,
                                       .least = 1,
                                       .most = TL_MAX_ADJUST,
                                       .example = "{\"tanks.level2\": {\"min\": 0, \"max\": 5}}"};
    tl_config_object start;
    tl_config_object map;
    tl_time over = 0;
    if (!tl_config_member(object, "start", TL_CONFIG_OPTIONAL, example, &start)) {
        return;
    }
    if (tl_config_get_duration(&start, "over_s", TL_CONFIG_REQUIRED, "10", &over) && config->step > 0) {
        char expected[96];
        tl_time steps = over / config->step + (over % config->step != 0);
        (void)snprintf(expected, sizeof expected, "at most %d times step_s, which is %.15g s", TL_FIND_STEPS,
                       tl_seconds(TL_FIND_STEPS * config->step));
        if (steps > TL_FIND_STEPS) {
            tl_config_wrong(&start, "over_s", NULL, expected, "10");
        }
        config->find_steps = (uint32_t)steps;
    }
    config->find = tl_config_take_entries(&start, "find", &rule, sizeof *config->find, &map, &config->find_count);
    tl_config_each(&map, read_find, config);
    tl_config_done(&start);
}

/* With all weights 0 there is nothing to optimise. */
static void check_weights(const tl_config_object *object, const tl_config *config) {
    bool any = config->match_count == 0; /* an empty list was reported before */
    for (size_t i = 0; i < config->match_count; i++) {
        any = any || config->match[i].weight > 0;
    }
    if (!any) {
        tl_config_wrong(object, "match", "weight 0 in every match", "at least one weight above 0 (default: 1)", NULL);
    }
}

/* J = Σ weight·(y − ŷ)²/ε equals J with the tolerance √ε for every match. Returns √ε, or 0 without
 * an epsilon. If epsilon is invalid, returns a value > 0, so that no tolerance is reported as
 * missing. */
static double read_epsilon(tl_config_object *object) {
    static const tl_config_number rule = {.above = true, .maximum = HUGE_VAL, .example = "0.01"};
    double epsilon = 1;
    (void)tl_config_get_number(object, "epsilon", &rule, &epsilon);
    return cJSON_GetObjectItemCaseSensitive(object->json, "epsilon") != NULL ? sqrt(epsilon) : 0;
}

/* Returns the solver with this name, or with this number of the thesis; NULL: none. */
static const char *solver_of(const cJSON *item) {
    if (cJSON_IsString(item)) {
        return tl_twin_solver_named(item->valuestring);
    }
    double number = cJSON_IsNumber(item) ? item->valuedouble : 0;
    bool is_number = number >= 1 && number <= INT_MAX && number == floor(number);
    return is_number ? tl_twin_solver_numbered((int)number) : NULL;
}

/* Returns NULL if no solver is given. */
static const char *read_solver(tl_config_object *object, const char *key) {
    static const char *const example = "\"secant\"";
    char expected[256];
    (void)snprintf(expected, sizeof expected, "one of %s, or the dissertation's number 1, 100 or 1000",
                   tl_twin_solver_names());
    const cJSON *item = tl_config_get(object, key, TL_CONFIG_OPTIONAL, expected, example);
    const char *solver = solver_of(item);
    if (item != NULL && solver == NULL) {
        tl_config_wrong(object, key, NULL, expected, example);
    }
    return solver;
}

static void read_solvers(tl_config_object *object, tl_config *config) {
    static const tl_config_number rule = {.whole = true, .minimum = 1, .maximum = 100000, .example = "30"};
    config->algorithm = read_solver(object, "algorithm");
    config->fallback = read_solver(object, "fallback");
    if (config->algorithm != NULL && config->fallback != NULL && strcmp(config->algorithm, config->fallback) == 0) {
        char expected[64];
        (void)snprintf(expected, sizeof expected, "another solver than algorithm, which is \"%s\"", config->algorithm);
        tl_config_wrong(object, "fallback", NULL, expected, NULL);
    }
    (void)tl_config_get_count(object, "stagnation", &rule, &config->stagnation);
}

static void read_saving(tl_config_object *object, const tl_plan *defaults, tl_config *config) {
    static const tl_config_number rule = {.whole = true, .minimum = 2, .maximum = 1000000, .example = "4096"};
    static const tl_config_number megabytes = {.whole = true, .minimum = 1, .maximum = 1000000, .example = "128"};
    tl_config_object saving;
    config->saving = defaults->saving;
    config->saving.nodes = 0;
    config->saving_memory = (uint32_t)(defaults->state_bytes >> 20);
    (void)tl_config_member(object, "saving", TL_CONFIG_OPTIONAL, "{\"nodes\": 4096}", &saving);
    (void)tl_config_get_boolean(&saving, "structure", &config->saving.structure);
    (void)tl_config_get_boolean(&saving, "sequences", &config->saving.sequences);
    (void)tl_config_get_count(&saving, "nodes", &rule, &config->saving.nodes);
    (void)tl_config_get_count(&saving, "memory_mb", &megabytes, &config->saving_memory);
    tl_config_done(&saving);
}

/* With a dynamic horizon: the first guess, nominal, and one value for each unknown. With fewer, a
 * solver never tries most of them. */
static uint32_t fewest_evaluations(const tl_config *config, double most) {
    double unknowns = config->shape == TL_DYNAMIC ? (double)config->prediction * (double)config->adjust_count : 0.0;
    return (uint32_t)fmin(unknowns + 2.0, most);
}

static void read_budget(tl_config_object *object, tl_config *config) {
    static const tl_config_number rule = {.whole = true, .minimum = 2, .maximum = 100000, .example = "60"};
    const tl_budget defaults = tl_budget_defaults(config->step);
    tl_config_object budget;
    config->budget_evaluations = defaults.evaluations;
    config->budget_time = defaults.time;
    (void)tl_config_member(object, "budget", TL_CONFIG_OPTIONAL, "{\"evaluations\": 60}", &budget);
    (void)tl_config_get_count(&budget, "evaluations", &rule, &config->budget_evaluations);
    (void)tl_config_get_duration(&budget, "time_s", TL_CONFIG_OPTIONAL, "0.006", &config->budget_time);
    tl_config_done(&budget);
    uint32_t fewest = fewest_evaluations(config, rule.maximum);
    config->budget_evaluations = config->budget_evaluations > fewest ? config->budget_evaluations : fewest;
}

static void read_free_twin(tl_config_object *object, tl_config *config) {
    const char *fault =
        config->event.start.signal != NULL ? "false (free_twin does not work with horizon.event)" : NULL;
    for (size_t i = 0; i < config->component_count && fault == NULL; i++) {
        fault = config->components[i].keep == TL_KEEP_OUTPUTS
                    ? "false (free_twin needs the states of all components: no \"keep\": \"outputs\")"
                    : NULL;
    }
    if (tl_config_get_boolean(object, "free_twin", &config->free_twin) && config->free_twin && fault != NULL) {
        tl_config_wrong(object, "free_twin", NULL, fault, NULL);
    }
}

/* Default: long enough for a plant that is sampled some hundred times in its longest reaction. */
static void read_release(tl_config_object *object, tl_config *config) {
    static const double fewest = 600.0;
    static const double horizons = 20.0;
    static const tl_config_number rule = {.maximum = TL_CONFIG_LONGEST_S, .example = "600"};
    double step_s = tl_seconds(config->step);
    double seconds = step_s * fmax(fewest, horizons * (double)config->prediction);
    if (tl_config_get_number(object, "release_s", &rule, &seconds) && seconds > 0.0 && seconds < 2.0 * step_s) {
        tl_config_wrong(object, "release_s", NULL, "0, or at least twice step_s", "600");
    }
    config->released_steps = step_s > 0.0 ? (uint32_t)fmin(rint(seconds / step_s), UINT32_MAX - 1.0) : 0;
}

/* Without caches there is nothing to choose. */
static void resolve_keep(const tl_config *config) {
    bool has_caches = config->synchronise && config->saving.sequences && config->event.start.signal == NULL;
    for (size_t i = 0; i < config->component_count && !has_caches; i++) {
        tl_config_component *component = &config->components[i];
        component->keep = component->keep == TL_KEEP_AUTO ? TL_KEEP_STATES : component->keep;
    }
}

void tl_config_read_synchronise(tl_config_object *root, tl_config *config) {
    static const tl_config_number margin = {.maximum = 1, .below = true, .example = "0.01"};
    static const tl_config_number noise_floor = {.maximum = HUGE_VAL, .example = "0.001"};
    static const tl_config_number verify_every = {.whole = true, .maximum = 1e9, .example = "400"};
    const tl_plan defaults = tl_plan_defaults(config->step);
    tl_config_object object;
    tl_config_object map;
    config->margin = defaults.margin;
    config->noise_floor = defaults.noise_floor;
    config->verify_every = defaults.verify_every;
    config->synchronise = tl_config_member(
        root, "synchronise", TL_CONFIG_OPTIONAL,
        "{\"adjust\": {\"motor.d\": {\"step\": 0.05}}, \"match\": {\"motor.omega\": {\"to\": \"plant.omega\", …}}}",
        &object);
    if (config->synchronise) {
        config->adjust =
            tl_config_take_entries(&object, "adjust", &ADJUST, sizeof *config->adjust, &map, &config->adjust_count);
        tl_config_each(&map, read_variable, config);
        match_list list = {
            .config = config,
            .example = "{\"to\": \"plant.omega\", \"tolerance\": 1.0}",
            .weighted = true,
            .tolerance = read_epsilon(&object),
        };
        config->has_epsilon = list.tolerance > 0;
        read_match(&object, "match", &MATCH, &list);
        check_weights(&object, config);
        read_start(&object, config);
    }
    read_horizon(&object, config);
    read_solvers(&object, config);
    (void)tl_config_get_number(&object, "margin", &margin, &config->margin);
    (void)tl_config_get_number(&object, "noise_floor", &noise_floor, &config->noise_floor);
    (void)tl_config_get_count(&object, "verify_every", &verify_every, &config->verify_every);
    read_free_twin(&object, config);
    config->rests = true;
    (void)tl_config_get_boolean(&object, "rest", &config->rests);
    read_release(&object, config);
    read_saving(&object, &defaults, config);
    resolve_keep(config);
    read_budget(&object, config);
    tl_config_done(&object);
}
