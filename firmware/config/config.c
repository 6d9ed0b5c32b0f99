/* Reads a configuration: file, hash, JSON and sections; resolves the names of its files. */
#include "firmware/config/config.h"

#include <errno.h>
#include <fcntl.h>
#include <libgen.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "firmware/base/identity.h"
#include "firmware/base/log.h"
#include "firmware/base/os.h"
#include "firmware/base/text.h"
#include "firmware/config/config_reader.h"
#include "firmware/config/json_document.h"

/* ---- the root's own keys ---- */

/* A double cannot represent most decimal fractions exactly, so a difference of rounding size counts
 * as whole. */
static bool is_whole_nanoseconds(double seconds) {
    double nanoseconds = seconds * 1e9;
    return fabs(nanoseconds - round(nanoseconds)) <= 1e-6 + 1e-15 * nanoseconds;
}

static void read_times(tl_config_object *root, tl_config *config) {
    static const tl_config_number step_rule = {
        .need = TL_CONFIG_REQUIRED, .minimum = 1e-5, .maximum = 3600, .example = "0.01"};
    static const tl_config_number start_rule = {
        .need = TL_CONFIG_OPTIONAL, .minimum = -1e12, .maximum = 1e12, .example = "64800"};
    static const tl_config_number stop_rule = {
        .need = TL_CONFIG_OPTIONAL, .minimum = -1e12, .maximum = 1e12, .example = "86400"};
    double seconds = 0;
    if (tl_config_get_number(root, "step_s", &step_rule, &seconds)) {
        config->step = tl_time_of_seconds(seconds);
        if (!is_whole_nanoseconds(seconds)) {
            tl_config_wrong(root, "step_s", NULL, "a whole number of nanoseconds", step_rule.example);
        }
    }
    (void)tl_config_get_duration(root, "duration_s", TL_CONFIG_OPTIONAL, "14", &config->duration);
    config->start_s = config->stop_s = (double)NAN;
    if (tl_config_get_number(root, "start_s", &start_rule, &config->start_s)) {
        config->start_s += 0.0; /* not −0 */
    }
    if (tl_config_get_number(root, "stop_s", &stop_rule, &config->stop_s) && config->stop_s <= config->start_s) {
        tl_config_wrong(root, "stop_s", NULL, "a time after start_s", stop_rule.example);
    }
}

static void read_sections(tl_config_reader *reader, tl_config *config) {
    static const tl_config_number version_rule = {.need = TL_CONFIG_REQUIRED,
                                                  .minimum = 1,
                                                  .maximum = 1,
                                                  .expected = "1, the format version of this program",
                                                  .example = "\"twinlock\": 1"};
    double version = 0;
    const char *schema = NULL; /* for editors */
    tl_config_object root;
    tl_config_root(reader, &root);
    (void)tl_config_get_number(&root, "twinlock", &version_rule, &version);
    (void)tl_config_get_text(&root, "name", TL_CONFIG_REQUIRED, "\"motor bench\"", &config->name);
    read_times(&root, config);
    tl_config_read_fill_in(&root, config);
    tl_config_read_components(&root, config);
    tl_config_read_sources(&root, config);
    tl_config_read_signals(&root, config);
    tl_config_read_recording(&root, config);
    tl_config_read_connections(&root, config);
    tl_config_read_compare(&root, config);
    tl_config_read_synchronise(&root, config);
    tl_config_read_delays(&root, config);
    tl_config_build_lookups(&root, config);
    tl_config_read_record(&root, config);
    tl_config_read_detect(&root, config);
    tl_config_read_realtime(&root, config);
    tl_config_read_emulate(&root, config);
    (void)tl_config_get_text(&root, "$schema", TL_CONFIG_OPTIONAL, "\"twinlock-1.json\"", &schema);
    tl_config_done(&root);
}

/* ---- the text ---- */

static tl_status out_of_memory(tl_report *report) {
    tl_report_add(report, TL_TRY_AGAIN, "", "not enough memory for the configuration; free memory and try again");
    return TL_TRY_AGAIN;
}

static tl_status too_large(tl_report *report) {
    tl_report_add(report, TL_BAD_DATA, "", "found more than 256 KiB, expected at most 256 KiB");
    return TL_BAD_DATA;
}

static bool begin(const char *path, const char *text, size_t size, tl_config *config) {
    memset(config, 0, sizeof *config);
    tl_arena *arena = &config->arena;
    tl_arena_init(arena);
    char *copy = tl_arena_take(arena, size + 1, 1);
    if (copy != NULL && size > 0) {
        memcpy(copy, text, size);
    }
    config->text = copy;
    config->size = size;
    config->path = tl_arena_text(arena, path);
    char *folder = tl_arena_text(arena, path);
    config->directory = folder != NULL ? dirname(folder) : NULL;
    tl_sha256(text, size, config->hash);
    return copy != NULL && config->path != NULL && config->directory != NULL;
}

tl_status tl_config_read_text(const char *path, const char *text, size_t size, tl_config *config, tl_report *report) {
    if (size > TL_CONFIG_MAX_BYTES) {
        memset(config, 0, sizeof *config);
        return too_large(report);
    }
    if (!begin(path, text, size, config)) {
        tl_config_free(config);
        return out_of_memory(report);
    }
    size_t before = report->count;
    tl_status status = tl_json_parse(config->text, config->size, &config->arena, report, &config->tree);
    if (config->tree != NULL) {
        tl_config_reader reader = {.root = config->tree, .arena = &config->arena, .report = report, .config = config};
        read_sections(&reader, config);
        status = reader.out_of_memory ? out_of_memory(report) : report->count > before ? TL_BAD_DATA : TL_OK;
    }
    if (status != TL_OK) {
        tl_config_free(config);
    }
    return status;
}

/* ---- the file ---- */

/* The caller's report adds the file name. */
static tl_status report_file(const char *path, tl_report *report) {
    if (errno == EFBIG) {
        return too_large(report);
    }
    bool passing = tl_shortage_is(errno) || errno == EIO;
    tl_status status = passing ? TL_TRY_AGAIN : TL_BAD_DATA;
    const char *cause = strerror(errno);
    const char *remedy = errno == EISDIR   ? ": give the .json file in it"
                         : errno == EACCES ? ": give this user the right to read it, with chmod or chown"
                                           : "";
    char other[TL_OTHER_CASE_TEXT];
    tl_report_add(report, status, "", "the configuration cannot be read: %s%s%s", cause, remedy,
                  tl_other_case(path, other));
    return status;
}

tl_status tl_config_read(const char *path, tl_config *config, tl_report *report) {
    size_t size = 0;
    char *text = tl_file_text_take(open(path, O_RDONLY | O_CLOEXEC | O_NOCTTY), TL_CONFIG_MAX_BYTES, &size);
    memset(config, 0, sizeof *config);
    tl_status status = text == NULL ? report_file(path, report) : tl_config_read_text(path, text, size, config, report);
    free(text);
    return status;
}

void tl_config_free(tl_config *config) {
    cJSON_Delete(config->tree);
    tl_arena_release(&config->arena);
    memset(config, 0, sizeof *config);
}

/* ---- lines and paths ---- */

size_t tl_config_line(const tl_config *config, const char *where) {
    if (config->tree == NULL || where[0] == '\0') {
        return 0;
    }
    const cJSON *item = tl_json_nearest(config->tree, where);
    return item != NULL ? tl_json_line(item) : 0;
}

/* Writes folder/name. If it does not fit, returns false and writes "", so that no other file is
 * opened. */
static bool join(const char *folder, size_t folder_size, const char *name, char *path, size_t size) {
    bool is_current = folder_size == 0 || (folder_size == 1 && folder[0] == '.');
    bool slash = !is_current && folder[folder_size - 1] != '/';
    int length = snprintf(path, size, "%.*s%s%s", is_current ? 0 : (int)folder_size, folder, slash ? "/" : "", name);
    bool fits = length >= 0 && (size_t)length < size;
    if (!fits && size > 0) {
        path[0] = '\0';
    }
    return fits;
}

bool tl_config_file_path(const tl_config *config, const char *file, char *path, size_t size) {
    const char *folder = file[0] == '/' ? "" : config->directory;
    return join(folder, strlen(folder), file, path, size);
}

bool tl_config_library_path(const tl_config *config, const char *library, char *path, size_t size) {
    if (strchr(library, '/') != NULL) {
        return tl_config_file_path(config, library, path, size);
    }
    return (size_t)snprintf(path, size, "%s", library) < size;
}

/* Sets `path` only if the candidate is a regular file. */
static bool is_file_in(const char *folder, size_t folder_size, const char *name, char *path, size_t size) {
    char candidate[4096];
    struct stat facts;
    return join(folder, folder_size, name, candidate, sizeof candidate) && stat(candidate, &facts) == 0 &&
           S_ISREG(facts.st_mode) && join(folder, folder_size, name, path, size);
}

/* Searches `folder`, relative to the running program: the build tree, or the installation. Returns
 * false if the path of the program is unknown. */
static bool find_near_program(const char *folder, const char *fmu, char *path, size_t size) {
    char program[4096] = "";
    char whole[4096 + 32];
    ssize_t length = readlink("/proc/self/exe", program, sizeof program - 1);
    return length > 0 && (size_t)snprintf(whole, sizeof whole, "%s/%s", dirname(program), folder) < sizeof whole &&
           is_file_in(whole, strlen(whole), fmu, path, size);
}

bool tl_config_fmu_path(const tl_config *config, const char *fmu, char *path, size_t size) {
    bool is_absolute = fmu[0] == '/';
    const char *start_folder = is_absolute ? "" : config->directory;
    (void)join(start_folder, strlen(start_folder), fmu, path, size); /* result if the file is not found */
    bool is_found = is_file_in(start_folder, strlen(start_folder), fmu, path, size);
    if (is_found || is_absolute) {
        return is_found;
    }
    const char *list = getenv("TWINLOCK_FMU_PATH");
    for (const char *folder = list; folder != NULL; folder = folder[0] == ':' ? folder + 1 : NULL) {
        size_t length = strcspn(folder, ":");
        if (length > 0 && is_file_in(folder, length, fmu, path, size)) {
            return true;
        }
        folder += length;
    }
    return find_near_program("../fmus", fmu, path, size) || find_near_program("../lib/twinlock/fmus", fmu, path, size);
}

/* ---- values that a running twin can change ---- */

void tl_config_tuning(const tl_config *config, tl_tuning *tuning) {
    const tl_plan plan = {
        .adjust = config->adjust,
        .adjust_count = config->adjust_count,
        .match = config->match,
        .match_count = config->match_count,
        .margin = config->margin,
        .noise_floor = config->noise_floor,
        .evaluations = config->budget_evaluations,
    };
    tl_tuning_of(&plan, tuning);
    tuning->time = config->budget_time;
}

void tl_config_retune(tl_config *config, const tl_tuning *tuning) {
    for (size_t i = 0; i < config->match_count; i++) {
        config->match[i].tolerance = tuning->match[i].tolerance;
        config->match[i].weight = tuning->match[i].weight;
        config->match[i].huber = tuning->match[i].huber;
    }
    for (size_t v = 0; v < config->adjust_count; v++) {
        tl_plan_adjust *adjust = &config->adjust[v];
        const tl_tuning_adjust *now = &tuning->adjust[v];
        adjust->nominal = now->has_nominal != 0 ? now->nominal : adjust->nominal;
        adjust->lower = now->lower;
        adjust->upper = now->upper;
        adjust->approved = now->approved;
        adjust->deviation_penalty = now->deviation_penalty;
        adjust->rate_penalty = now->rate_penalty;
    }
    config->margin = tuning->margin;
    config->noise_floor = tuning->noise_floor;
    config->budget_evaluations = (uint32_t)tuning->evaluations;
    config->budget_time = tuning->time;
}

tl_status tl_config_tuning_of(const tl_config *own, const char *text, tl_tuning *tuning, tl_error *error) {
    tl_config config;
    tl_report report = {.add = NULL};
    if (tl_config_read_text(own->path, text, strlen(text), &config, &report) != TL_OK) {
        return tl_fail(error, TL_BAD_DATA, "its text is not a valid configuration");
    }
    tl_config_tuning(&config, tuning);
    tl_config_free(&config);
    return tl_tuning_check(tuning, error);
}

bool tl_config_is_unconfined(const tl_config *config) {
    bool is_unconfined = false;
    for (size_t i = 0; i < config->component_count; i++) {
        is_unconfined = is_unconfined || config->components[i].unconfined;
    }
    return is_unconfined;
}

tl_status tl_config_check_filled_in(const tl_config *config, tl_error *error) {
    return config->fill_in_count == 0
               ? TL_OK
               : tl_fail(error, TL_BAD_DATA, "%s: fill_in: %zu left; fill in %.200s (%.200s), then remove its entry",
                         config->path, config->fill_in_count, config->fill_in[0].where, config->fill_in[0].name);
}

/* ---- limits that FMUs declare ---- */

static double find_noise(double least, double most, double limit, double scale) {
    static const double part = 0.01;
    static const double rounding = 1e-9;
    double range = isfinite(most - least) ? most - least : fmax(fabs(limit), scale);
    return fmax(part * range, rounding * fabs(limit));
}

static void use_bounds(tl_config_signal *signal, const tl_account_signal *declared) {
    double least = fmax(signal->minimum, declared->least);
    double most = fmin(signal->maximum, declared->most);
    uint64_t items = declared->items;
    if (items != 0) { /* its first bit is the minimum */
        double skipped = ceil(least - declared->least);
        items = skipped < 64.0 ? items >> (unsigned)skipped : 0;
        least = declared->least + skipped;
    }
    if (signal->is_declared || !(declared->scale > 0.0) || !(least <= most) || (items == 0) != (declared->items == 0)) {
        return;
    }
    signal->below = least > signal->minimum && items == 0 ? find_noise(least, most, least, declared->scale) : 0.0;
    signal->above = most < signal->maximum && items == 0 ? find_noise(least, most, most, declared->scale) : 0.0;
    signal->is_declared = least > signal->minimum || most < signal->maximum || items != 0;
    signal->minimum = least;
    signal->maximum = most;
    signal->items = items;
}

void tl_config_use_bounds(tl_config *config, const tl_account *account) {
    for (size_t i = 0; i < config->signal_count; i++) {
        use_bounds(&config->signals[i], &account->signal[i]);
    }
}

/* ---- quality of a value, for people ---- */

static void describe_range(const tl_config_signal *signal, double value, char text[TL_CONFIG_DESCRIPTION]) {
    const char *unit = signal->plan.unit == NULL ? "" : signal->plan.unit;
    const char *space = unit[0] == '\0' ? "" : " ";
    bool is_below = value < signal->minimum;
    bool is_declared = (is_below ? signal->below : signal->above) > 0.0 || signal->items != 0;
    const char *by = is_declared ? " (declared by the FMU)" : "";
    if (!is_below && !(value > signal->maximum) && signal->plan.type == TL_REAL) {
        (void)snprintf(text, TL_CONFIG_DESCRIPTION, "%s", tl_quality_name(TL_OUT_OF_RANGE));
    } else if (!is_below && !(value > signal->maximum) && signal->items != 0) {
        (void)snprintf(text, TL_CONFIG_DESCRIPTION, "%.6g is not an item of the FMU's Enumeration", value);
    } else if (!is_below && !(value > signal->maximum)) {
        (void)snprintf(text, TL_CONFIG_DESCRIPTION, "%.6g is not of type %s", value, tl_type_name(signal->plan.type));
    } else if (isfinite(signal->minimum) && isfinite(signal->maximum)) {
        (void)snprintf(text, TL_CONFIG_DESCRIPTION, "%.6g%s%.60s is outside %.6g \342\200\246 %.6g%s", value, space,
                       unit, signal->minimum, signal->maximum, by);
    } else {
        (void)snprintf(text, TL_CONFIG_DESCRIPTION, "%.6g%s%.60s is %s %.6g%s", value, space, unit,
                       is_below ? "below the minimum of" : "above the maximum of",
                       is_below ? signal->minimum : signal->maximum, by);
    }
}

void tl_config_describe_quality(const tl_config *config, size_t signal, double value, tl_quality quality, tl_time age,
                                char text[TL_CONFIG_DESCRIPTION]) {
    const tl_config_signal *described = &config->signals[signal];
    switch (quality) {
    case TL_OUT_OF_RANGE:
        describe_range(described, value, text);
        break;
    case TL_STALE:
        (void)snprintf(text, TL_CONFIG_DESCRIPTION, "the last reading is %.3g s old, more than stale_s %g",
                       tl_seconds(age), described->stale_s);
        break;
    case TL_NO_LINK:
        if (described->source == SIZE_MAX) {
            (void)snprintf(text, TL_CONFIG_DESCRIPTION, "no value");
        } else {
            (void)snprintf(text, TL_CONFIG_DESCRIPTION, "no value from %.63s", config->sources[described->source].name);
        }
        break;
    default:
        (void)snprintf(text, TL_CONFIG_DESCRIPTION, "%s", tl_quality_name(quality));
        break;
    }
}

const char *tl_config_quality_remedy(const tl_config *config, size_t signal, tl_quality quality) {
    bool is_column = config->signals[signal].source == SIZE_MAX; /* of a recording */
    switch (quality) {
    case TL_OUT_OF_RANGE:
        return is_column ? "check csv.column, scale, min and max"
                         : "check type, scale, address, word order; or widen min and max";
    case TL_STALE:
        return "lower period_s, or raise stale_s";
    case TL_NOT_A_NUMBER:
        return is_column ? "check csv.column: a CSV file needs numbers, or 0 and 1"
                         : "check type and words; a CSV file needs numbers, or 0 and 1";
    case TL_OUTLIER:
        return "check the gate of its condition";
    case TL_FROZEN:
        return "check the sensor";
    default:
        return is_column ? "check csv.column, and that it has values" : "see the message of its source";
    }
}

/* ---- the choice of "keep": "auto" ---- */

static const char KEEP_EVENT[] = "saving:";

/* Returns the length, also if there is no room. */
static size_t print_keep(const tl_config_component *component, bool is_saved, char *text, size_t size) {
    return (size_t)snprintf(text, size, " %s %s", component->name, is_saved ? "states" : "none");
}

size_t tl_config_write_keep(const tl_config *config, uint64_t unsaved, size_t first, char text[TL_CONFIG_KEEP_TEXT]) {
    size_t length = (size_t)snprintf(text, TL_CONFIG_KEEP_TEXT, "%s", KEEP_EVENT);
    const char *separator = "";
    size_t k = first;
    for (; k < config->component_count; k++) {
        char part[TL_CONFIG_KEEP_TEXT];
        bool is_saved = k >= TL_TWIN_UNSAVED || (unsaved >> k & 1U) == 0;
        size_t needed = strlen(separator) + print_keep(&config->components[k], is_saved, part, sizeof part);
        if (config->components[k].keep == TL_KEEP_AUTO) {
            if (length + needed >= TL_CONFIG_KEEP_TEXT) {
                break;
            }
            (void)snprintf(text + length, TL_CONFIG_KEEP_TEXT - length, "%s%s", separator, part);
            length += needed;
            separator = ",";
        }
    }
    text[separator[0] != '\0' ? length : 0] = '\0';
    return k;
}

bool tl_config_read_keep(const tl_config *config, const char *text, uint64_t *unsaved) {
    bool is_choice = strncmp(text, KEEP_EVENT, sizeof KEEP_EVENT - 1) == 0;
    for (size_t k = 0; is_choice && k < config->component_count && k < TL_TWIN_UNSAVED; k++) {
        char part[TL_CONFIG_KEEP_TEXT];
        (void)print_keep(&config->components[k], false, part, sizeof part);
        *unsaved |= strstr(text, part) != NULL ? UINT64_C(1) << k : 0;
    }
    return is_choice;
}

/* ---- problems, logged for the user ---- */

size_t tl_problems_take_line(const char **text) {
    static const char PREFIX[] = "line ";
    if (strncmp(*text, PREFIX, sizeof PREFIX - 1) != 0) {
        return 0;
    }
    char *end = NULL;
    unsigned long line = strtoul(*text + sizeof PREFIX - 1, &end, 10);
    if (strncmp(end, ": ", 2) != 0) {
        return 0;
    }
    *text = end + 2;
    return line;
}

static void log_problem(void *context, tl_status status, const char *where, const char *text) {
    (void)status;
    const tl_problems *problems = context;
    size_t line = problems->config == NULL ? tl_problems_take_line(&text) : tl_config_line(problems->config, where);
    const char *separator = where[0] == '\0' ? "" : ": ";
    if (line != 0) {
        tl_log(TL_LOG_ERROR, "%s: line %zu: %s%s%s", problems->file, line, where, separator, text);
    } else {
        tl_log(TL_LOG_ERROR, "%s: %s%s%s", problems->file, where, separator, text);
    }
}

void tl_problems_init(tl_problems *problems, const char *file) {
    *problems = (tl_problems){.report = {.add = log_problem, .context = problems}, .file = file};
}

void tl_problems_add_json(tl_json_writer *json, const char *place, size_t line, const char *text) {
    char clean[TL_LOG_TEXT];
    tl_text_for_people(text, clean, sizeof clean);
    tl_json_open_object(json, NULL);
    tl_json_add_text(json, "place", place[0] != '\0' ? place : NULL);
    tl_json_add_number(json, "line", line != 0 ? (double)line : (double)NAN);
    tl_json_add_text(json, "text", clean);
    tl_json_close(json);
}

/* A place is a JSON path: no space before its first point or bracket, unlike "column 7". */
void tl_problems_add_logged(tl_json_writer *json, const char *file, const char *text) {
    char place[TL_LOG_TEXT] = "";
    size_t line = 0;
    const size_t length = strlen(file);
    if (strncmp(text, file, length) == 0 && strncmp(text + length, ": ", 2) == 0) {
        text += length + 2;
        line = tl_problems_take_line(&text);
        line =
            line == 0 && strncmp(text, "line ", 5) == 0 ? strtoul(text + 5, NULL, 10) : line; /* "line 1, column 7" */
        const char *end = strstr(text, ": ");
        const char *first = text + strcspn(text, " .[");
        if (end != NULL && (*first != ' ' || first > end)) {
            (void)snprintf(place, sizeof place, "%.*s", (int)(end - text), text);
            text = end + 2;
        }
    }
    tl_problems_add_json(json, place, line, text);
}
