/* twinlock init: writes a first configuration for FMUs. The FMUs' descriptions are read in this
 * process; their binaries run in an FMU process only. */
#include <errno.h>
#include <fcntl.h>
#include <libgen.h>
#include <limits.h>
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "board/csv/csv.h"
#include "firmware/base/log.h"
#include "firmware/base/os.h"
#include "firmware/base/output.h"
#include "firmware/base/text.h"
#include "firmware/cli/horizon_trials.h"
#include "firmware/cli/verb_job.h"
#include "firmware/config/json_document.h"
#include "firmware/fmu/draft.h"
#include "firmware/fmu/fmu_archive.h"
#include "firmware/fmu/model_description.h"
#include "firmware/monitor/proposal.h"
#include "firmware/monitor/survey.h"
#include "firmware/process/interrupt.h"

typedef struct initialisation {
    const tl_options *options;
    char output[PATH_MAX];
    char host[TL_DRAFT_COLUMN];
    char recording[PATH_MAX]; /* as the configuration names it */
    tl_draft draft;
    tl_model models[TL_DRAFT_FMUS];
    tl_arena arena;
    tl_csv_columns columns;
    cJSON *given;   /* file of --plant */
    cJSON *final;   /* the configuration */
    bool is_failed; /* the configuration does not pass a check; the reason was logged */
    tl_error error;
} initialisation;

/* ---- names of files ---- */

/* Name of a file without its folders and its last extension. */
static void find_stem(const char *path, char stem[TL_DRAFT_NAME]) {
    const char *name = strrchr(path, '/');
    (void)snprintf(stem, TL_DRAFT_NAME, "%s", name != NULL ? name + 1 : path);
    char *dot = strrchr(stem, '.');
    if (dot != NULL && dot != stem) {
        *dot = '\0';
    }
}

/* Writes the name of an existing file for a configuration in the folder of `output`: relative if it
 * is in there, else absolute. */
static void name_file(const initialisation *self, const char *path, char name[PATH_MAX]) {
    char folder[PATH_MAX];
    char whole[PATH_MAX];
    char copy[PATH_MAX];
    (void)snprintf(copy, sizeof copy, "%s", self->output);
    if (realpath(path, whole) == NULL || realpath(dirname(copy), folder) == NULL) {
        (void)snprintf(name, PATH_MAX, "%s", path);
        return;
    }
    size_t length = strlen(folder);
    bool is_within = strncmp(whole, folder, length) == 0 && (whole[length] == '/' || length == 1);
    (void)snprintf(name, PATH_MAX, "%s", is_within ? whole + length + (length > 1 ? 1 : 0) : whole);
}

static tl_status choose_output(initialisation *self) {
    char stem[TL_DRAFT_NAME];
    find_stem(self->options->fmus[0], stem);
    if (self->options->output != NULL) {
        (void)snprintf(self->output, sizeof self->output, "%s", self->options->output);
    } else {
        (void)snprintf(self->output, sizeof self->output, "%s.json", stem);
    }
    struct stat found;
    if (stat(self->output, &found) == 0) {
        return tl_fail(&self->error, TL_BAD_USAGE, "%s exists: give another name with --output FILE, or remove it",
                       self->output);
    }
    char copy[PATH_MAX];
    (void)snprintf(copy, sizeof copy, "%s", self->output);
    if (access(dirname(copy), W_OK) != 0) {
        return tl_fail(&self->error, TL_BAD_USAGE, "%s cannot be written: %s", self->output, strerror(errno));
    }
    find_stem(self->output, stem);
    self->draft.name = tl_arena_text(&self->arena, stem);
    return self->draft.name != NULL ? TL_OK : tl_fail(&self->error, TL_TRY_AGAIN, "not enough memory");
}

/* ---- FMUs ---- */

static tl_status read_model(initialisation *self, const char *path, tl_model *model) {
    tl_private_folder folder;
    char description[PATH_MAX + sizeof "/modelDescription.xml"];
    tl_status status = tl_fmu_archive_unpack(path, -1, path, &folder, &self->error);
    if (status == TL_OK) {
        (void)snprintf(description, sizeof description, "%s/modelDescription.xml", folder.path);
        status = tl_model_description_read(description, path, &self->arena, model, &self->error);
        tl_private_folder_remove(&folder);
    }
    return status;
}

static tl_status read_fmu(initialisation *self, const char *path) {
    tl_draft *draft = &self->draft;
    const size_t index = draft->fmu_count;
    char found[PATH_MAX];
    char name[PATH_MAX];
    char stem[TL_DRAFT_NAME];
    const tl_config here = {.directory = "."};
    if (index == TL_DRAFT_FMUS) {
        return tl_fail(&self->error, TL_BAD_USAGE, "%zu FMUs (expected at most %d)", self->options->fmu_count,
                       (int)TL_DRAFT_FMUS);
    }
    bool is_here = access(path, F_OK) == 0;
    (void)tl_config_fmu_path(&here, path, found, sizeof found);
    tl_status status = read_model(self, found, &self->models[index]);
    if (status != TL_OK) {
        return status;
    }
    name_file(self, found, name);
    find_stem(path, stem);
    tl_draft_name(stem, tl_draft_fmu_name, draft, index, draft->fmus[index].name);
    draft->fmus[index].file = tl_arena_text(&self->arena, is_here ? name : path);
    draft->fmus[index].model = &self->models[index];
    draft->fmu_count++;
    return draft->fmus[index].file != NULL ? TL_OK : tl_fail(&self->error, TL_TRY_AGAIN, "not enough memory");
}

/* ---- signals ---- */

static tl_draft_signal *add_signal(tl_draft *draft) {
    tl_draft_signal *signal = &draft->signals[draft->signal_count];
    *signal = (tl_draft_signal){
        .port = SIZE_MAX, .least = (double)NAN, .most = (double)NAN, .middle = (double)NAN, .sigma = (double)NAN};
    return signal;
}

static tl_status read_given(initialisation *self) {
    const char *path = self->options->plant;
    size_t size = 0;
    char *text = tl_file_text_take(open(path, O_RDONLY | O_CLOEXEC | O_NOCTTY), TL_CONFIG_MAX_BYTES, &size);
    if (text == NULL) {
        return tl_fail(&self->error, TL_BAD_DATA, "%s: cannot be read: %s", path, strerror(errno));
    }
    tl_problems problems;
    tl_problems_init(&problems, path);
    tl_status status = tl_json_parse(text, size, &self->arena, &problems.report, &self->given);
    free(text);
    const cJSON *plant = cJSON_GetObjectItemCaseSensitive(self->given, "plant");
    if (status == TL_OK && (!cJSON_IsObject(plant) || cJSON_GetArraySize(plant) == 0)) {
        return tl_fail(&self->error, TL_BAD_DATA,
                       "%s: has no signals (expected {\"sources\": {…}, \"plant\": {…}}, as in a configuration)", path);
    }
    if (status == TL_OK && cJSON_GetArraySize(plant) > TL_MAX_SIGNALS) {
        return tl_fail(&self->error, TL_BAD_DATA, "%s: has %d signals (expected at most %d): remove the others", path,
                       cJSON_GetArraySize(plant), (int)TL_MAX_SIGNALS);
    }
    self->draft.sources = cJSON_GetObjectItemCaseSensitive(self->given, "sources");
    const cJSON *item = NULL;
    cJSON_ArrayForEach(item, plant) {
        if (strlen(item->string) >= TL_DRAFT_NAME) {
            return tl_fail(&self->error, TL_BAD_DATA, "%s: plant.%.100s: the name is longer than %d characters", path,
                           item->string, (int)TL_DRAFT_NAME - 1);
        }
        tl_draft_signal *signal = add_signal(&self->draft);
        const char *unit = cJSON_GetStringValue(cJSON_GetObjectItemCaseSensitive(item, "unit"));
        (void)snprintf(signal->unit, sizeof signal->unit, "%s", unit != NULL ? unit : "");
        (void)snprintf(signal->name, sizeof signal->name, "%s", item->string);
        const cJSON *csv = cJSON_GetObjectItemCaseSensitive(item, "csv");
        const char *column = cJSON_GetStringValue(cJSON_GetObjectItemCaseSensitive(csv, "column"));
        (void)snprintf(signal->column, sizeof signal->column, "%s", column != NULL ? column : item->string);
        signal->entry = item;
        self->draft.signal_count++;
    }
    return status;
}

/* Splits "speed [rad/s]" into name and unit. */
static void split_unit(const char *column, char name[TL_DRAFT_COLUMN], char unit[TL_DRAFT_NAME]) {
    (void)snprintf(name, TL_DRAFT_COLUMN, "%s", column);
    size_t length = strlen(name);
    char close = length > 0 ? name[length - 1] : '\0';
    char *open = strrchr(name, close == ']' ? '[' : '(');
    if ((close == ']' || close == ')') && open != NULL && open != name) {
        name[length - 1] = '\0';
        (void)snprintf(unit, TL_DRAFT_NAME, "%s", open + 1);
        while (open > name && open[-1] == ' ') {
            open--;
        }
        *open = '\0';
    }
}

static void add_column(initialisation *self, size_t column) {
    tl_draft *draft = &self->draft;
    const char *title = self->columns.names[column];
    char name[TL_DRAFT_COLUMN];
    if (draft->signal_count == TL_DRAFT_SIGNALS || title[0] == '\0' || strlen(title) >= TL_DRAFT_COLUMN) {
        return;
    }
    tl_draft_signal *signal = add_signal(draft);
    (void)snprintf(signal->unit, sizeof signal->unit, "%s", self->columns.units[column]);
    split_unit(title, name, signal->unit);
    (void)snprintf(signal->column, sizeof signal->column, "%s", title);
    tl_draft_name(name, tl_draft_signal_name, draft, draft->signal_count, signal->name);
    draft->signal_count++;
}

static tl_status read_columns(initialisation *self) {
    const char *path = self->options->recording;
    struct stat found;
    if (stat(path, &found) == 0 && !S_ISREG(found.st_mode) && !S_ISDIR(found.st_mode)) {
        return tl_fail(&self->error, TL_BAD_DATA, "%s: not a regular file (expected a CSV file or a folder)", path);
    }
    tl_status status = tl_csv_columns_read(path, &self->columns, &self->error);
    if (status != TL_OK) {
        return status;
    }
    for (size_t i = 0; i < self->columns.count; i++) {
        if (!tl_text_is_plain(self->columns.names[i]) || !tl_text_is_plain(self->columns.units[i])) {
            return tl_fail(
                &self->error, TL_BAD_DATA,
                "%s: the header is not in UTF-8: convert the file, for example by `iconv -f CP1252 -t UTF-8`", path);
        }
    }
    name_file(self, path, self->recording);
    self->draft.recording = self->recording;
    self->draft.time_column = self->columns.names[self->columns.time];
    for (size_t i = 0; i < self->columns.count && self->given == NULL; i++) {
        if (i != self->columns.time) {
            add_column(self, i);
        }
    }
    return TL_OK;
}

/* HOST, HOST:PORT, [ADDRESS] or [ADDRESS]:PORT. An address with several colons has no port. */
static tl_status read_host(initialisation *self) {
    enum { DECIMAL = 10, LAST_PORT = 65535 };
    const char *text = self->options->modbus;
    const bool is_bracketed = text[0] == '[';
    (void)snprintf(self->host, sizeof self->host, "%s", text + (is_bracketed ? 1 : 0));
    char *end = is_bracketed ? strchr(self->host, ']') : strchr(self->host, ':');
    const char *port = end != NULL ? end + (is_bracketed ? 1 : 0) : "";
    bool is_right = !is_bracketed || end != NULL;
    if (!is_bracketed && end != NULL && strchr(end + 1, ':') != NULL) {
        end = NULL;
        port = "";
    }
    if (*port != '\0') {
        char *rest = NULL;
        unsigned long number = strtoul(port + 1, &rest, DECIMAL);
        is_right = is_right && *port == ':' && port[1] >= '0' && port[1] <= '9' && *rest == '\0' && number > 0 &&
                   number <= LAST_PORT;
        self->draft.port = (unsigned)number;
    }
    if (end != NULL) {
        *end = '\0';
    }
    self->draft.host = self->host;
    return is_right && self->host[0] != '\0'
               ? TL_OK
               : tl_fail(&self->error, TL_BAD_USAGE,
                         "--modbus %s: expected HOST or HOST:PORT, for example 192.0.2.10:502", text);
}

static tl_status read_inputs(initialisation *self) {
    tl_status status = choose_output(self);
    for (size_t i = 0; i < self->options->fmu_count && status == TL_OK; i++) {
        status = read_fmu(self, self->options->fmus[i]);
    }
    if (status == TL_OK && self->options->plant != NULL) {
        status = read_given(self);
    }
    if (status == TL_OK && self->options->recording != NULL) {
        status = read_columns(self);
    }
    if (status == TL_OK && self->options->modbus != NULL) {
        status = read_host(self);
    }
    return status;
}

/* ---- the recording ---- */

/* Parses a text as the configuration at `output`; problems are logged. */
static tl_status parse(initialisation *self, const char *text, tl_config *config) {
    tl_problems problems;
    tl_problems_init(&problems, self->output);
    return text != NULL ? tl_config_read_text(self->output, text, strlen(text), config, &problems.report)
                        : tl_fail(&self->error, TL_TRY_AGAIN, "not enough memory for the configuration");
}

static tl_status take_survey(initialisation *self, const tl_config *config, tl_survey *survey) {
    tl_recording *recording = NULL;
    tl_status status = tl_recording_open(self->options->recording, config, &recording, &self->error);
    if (status == TL_OK) {
        tl_recording_log_form(recording);
        status = tl_survey_take(recording, config, survey, &self->error);
    }
    tl_recording_close(recording);
    return status;
}

static void take_figures(tl_draft_signal *signal, const tl_survey_signal *found) {
    signal->sigma = found->noise.is_enough ? found->sigma : (double)NAN;
    for (size_t i = 0; i < found->kept_count; i++) {
        signal->least = fmin(signal->least, found->kept[i].value);
        signal->most = fmax(signal->most, found->kept[i].value);
    }
    signal->middle = found->kept_count != 0 ? found->kept[found->kept_count / 2].value : (double)NAN;
}

/* Measures range and noise of the signals, and the step if it is not given. */
static tl_status measure_recording(initialisation *self) {
    tl_draft *draft = &self->draft;
    char *text = tl_draft_text(draft, TL_DRAFT_COMPARED, 0);
    tl_config config;
    tl_survey survey = {.count = 0};
    tl_status status = parse(self, text, &config);
    free(text);
    if (status != TL_OK) {
        return status;
    }
    status = take_survey(self, &config, &survey);
    tl_time shortest = 0;
    for (size_t i = 0; i < survey.count && status == TL_OK; i++) {
        take_figures(&draft->signals[i], &survey.signals[i]);
        tl_time median = survey.signals[i].median;
        shortest = median > 0 && (shortest == 0 || median < shortest) ? median : shortest;
    }
    if (status == TL_OK && !draft->is_step_known && shortest > 0) {
        char digits[32];
        (void)snprintf(digits, sizeof digits, "%.3g", tl_seconds(shortest));
        draft->step_s = strtod(digits, NULL);
        draft->is_step_known = true;
    }
    tl_survey_free(&survey);
    tl_config_free(&config);
    return status;
}

/* ---- reactions ---- */

/* The line of tl_check_page_print(); "": none. */
static void take_reaction(const tl_draft *draft, tl_draft_candidate *candidate, const char *line) {
    enum { DECIMAL = 10 };
    char *rest = NULL;
    bool is_first = line[0] != '\0' && strtoul(line, &rest, DECIMAL) == 0;
    size_t match = is_first ? strtoul(rest, &rest, DECIMAL) : SIZE_MAX;
    double most = is_first ? strtod(rest, &rest) : (double)NAN;
    if (match < draft->match_count && isfinite(most)) {
        candidate->is_tried = true;
        candidate->match = match;
        candidate->most = most;
        candidate->half_s = strtod(rest, &rest);
    }
}

static tl_status check_job(tl_verb_job *job, FILE *page) {
    tl_twin_check found;
    tl_status status = tl_verb_job_start(job, page);
    status = status == TL_OK ? tl_twin_child_check(job->child, &found, &job->error) : status;
    return status == TL_OK ? tl_twin_child_wait(job->child, &job->error) : status;
}

/* Checks a configuration, and writes the lines of tl_check_page_print(), which the caller frees. A
 * failure is logged. */
static tl_status check_text(initialisation *self, const char *text, char **lines) {
    tl_verb_job job = {.options = self->options, .order = {.task = TL_TASK_CHECK, .reactions = true}};
    size_t size = 0;
    FILE *page = open_memstream(lines, &size);
    tl_status status = text != NULL && page != NULL ? tl_verb_job_read(&job, self->output, text)
                                                    : tl_fail(&job.error, TL_TRY_AGAIN, "not enough memory");
    status = status == TL_OK ? check_job(&job, page) : status;
    if (page != NULL) {
        (void)fclose(page);
    }
    (void)tl_verb_job_end(&job, status);
    return status;
}

/* Other failures are those of one configuration. */
static bool is_final(tl_status status) {
    return status == TL_INTERRUPTED || status == TL_TRY_AGAIN;
}

static tl_status try_reaction(initialisation *self, size_t index) {
    char *text = tl_draft_text(&self->draft, TL_DRAFT_TRIED, index);
    char *lines = NULL;
    tl_status status = check_text(self, text, &lines);
    if (status == TL_OK) {
        take_reaction(&self->draft, &self->draft.candidates[index], lines);
    }
    free(lines);
    free(text);
    return status;
}

/* The configuration is written even if all fail. */
static tl_status try_reactions(initialisation *self) {
    tl_draft *draft = &self->draft;
    tl_progress progress;
    tl_status status = TL_OK;
    tl_progress_begin(&progress, "reactions to variable", (int64_t)draft->candidate_count);
    for (size_t i = 0; i < draft->candidate_count && !is_final(status); i++) {
        tl_progress_update(&progress, (int64_t)i);
        status = try_reaction(self, i);
    }
    tl_progress_end(&progress);
    tl_draft_choose(draft);
    return is_final(status) ? status : TL_OK;
}

/* ---- what the recording proposes ---- */

static tl_status try_horizons(initialisation *self, const tl_verb_job *job, tl_proposal_page *page,
                              tl_horizon_choice *choice) {
    char *patch = NULL;
    tl_status status = tl_proposal_write_patch(page, &patch, &self->error);
    if (status == TL_OK) {
        const tl_twin_child_settings child = tl_verb_job_settings(job, NULL);
        const tl_horizon_trials_settings settings = {
            .child = &child, .recording = self->options->recording, .patch = patch};
        status = tl_horizon_trials_run(&settings, choice, &self->error);
    }
    free(patch);
    return status;
}

static tl_status merge(initialisation *self, const tl_proposal_page *page) {
    char *text = NULL;
    tl_status status = tl_proposal_write_patch(page, &text, &self->error);
    cJSON *patch = status == TL_OK ? cJSON_Parse(text) : NULL;
    if (status == TL_OK && (patch == NULL || !tl_json_merge(self->final, patch))) {
        status = tl_fail(&self->error, TL_TRY_AGAIN, "not enough memory for the proposal");
    }
    cJSON_Delete(patch);
    free(text);
    return status;
}

/* As `check --recording`: proposes how signals are used, and tries horizons. `locked`: root mean
 * square error of the twin with them, tolerances; unchanged if it is not known. */
static tl_status propose(initialisation *self, const char *text, double *locked) {
    tl_verb_job job = {.options = self->options};
    tl_survey survey = {.count = 0};
    tl_proposal proposal;
    tl_horizon_choice choice;
    tl_proposal_page page = {
        .config = &job.config, .recording = self->options->recording, .survey = &survey, .proposal = &proposal};
    tl_status status = tl_verb_job_read(&job, self->output, text);
    status = status == TL_OK ? take_survey(self, &job.config, &survey) : status;
    if (status == TL_OK) {
        tl_proposal_make(&job.config, &survey, &proposal);
        status = try_horizons(self, &job, &page, &choice);
    }
    if (status == TL_OK) {
        page.choice = &choice;
        *locked = choice.chosen != SIZE_MAX ? choice.trial[choice.chosen].locked : *locked;
        status = merge(self, &page);
    }
    tl_survey_free(&survey);
    tl_config_free(&job.config);
    return status;
}

static tl_status finish(initialisation *self, double *locked) {
    char *text = tl_draft_text(&self->draft, TL_DRAFT_FINAL, 0);
    char *lines = NULL;
    bool is_adjusted = false;
    for (size_t i = 0; i < self->draft.candidate_count; i++) {
        is_adjusted = is_adjusted || self->draft.candidates[i].is_chosen;
    }
    self->final = text != NULL ? cJSON_Parse(text) : NULL;
    tl_status status =
        self->final != NULL ? TL_OK : tl_fail(&self->error, TL_TRY_AGAIN, "not enough memory for the configuration");
    if (status == TL_OK) {
        status = check_text(self, text, &lines);
        self->is_failed = status != TL_OK;
        status = is_final(status) ? status : TL_OK;
    }
    if (status == TL_OK && self->draft.recording != NULL && is_adjusted && !self->is_failed) {
        status = propose(self, text, locked);
    }
    free(lines);
    free(text);
    return status;
}

/* If the twin does not follow the recording, tries others of the variables to which its outputs
 * react, one after the other. A variable is replaced if that reduces the error clearly. */
static tl_status try_others(initialisation *self, double locked) {
    static const double enough = 1.0; /* tolerances */
    static const double clearly = 0.9;
    enum { OTHERS = 4 }; /* each takes as long as `check --recording` */
    tl_draft *draft = &self->draft;
    tl_status status = TL_OK;
    size_t next = SIZE_MAX;
    for (size_t tried = 0; tried < OTHERS && locked > enough && !is_final(status); tried++) {
        next = tl_draft_find_next(draft);
        if (next == SIZE_MAX) {
            break;
        }
        cJSON *before = self->final;
        size_t replaced = tl_draft_replace(draft, next);
        double other = HUGE_VAL;
        self->final = NULL;
        status = finish(self, &other);
        if (status == TL_OK && other < clearly * locked) {
            locked = other;
            cJSON_Delete(before);
        } else {
            (void)tl_draft_replace(draft, replaced);
            cJSON_Delete(self->final);
            self->final = before;
        }
        self->is_failed = false; /* the first one, and those that are kept, have passed the check */
    }
    if (locked > enough && isfinite(locked)) {
        tl_log(TL_LOG_WARNING,
               "no variable keeps the twin at the recording (error %.3g tolerances): check sign, scale and unit of the "
               "signals, then the model",
               locked);
    }
    return is_final(status) ? status : TL_OK;
}

/* ---- the result ---- */

static tl_status write_file(initialisation *self) {
    tl_new_file file;
    char *text = cJSON_Print(self->final);
    tl_config config;
    tl_status status = parse(self, text, &config); /* also if a proposal does not fit */
    if (status == TL_OK) {
        tl_config_free(&config);
        status = tl_new_file_open(self->output, &file, &self->error);
    }
    if (status == TL_OK) {
        (void)fprintf(file.file, "%s\n", text);
        status = tl_new_file_keep(&file, &self->error);
    }
    cJSON_free(text);
    return status;
}

static void print_candidate(const tl_draft *draft, const tl_draft_candidate *candidate, FILE *output) {
    char path[TL_DRAFT_PATH];
    char matched[TL_DRAFT_PATH];
    char text[3 * TL_DRAFT_PATH];
    const tl_draft_port *port = &draft->ports[draft->matches[candidate->match].port];
    const char *unit = port->variable->unit != NULL ? port->variable->unit->name : "";
    tl_draft_variable(draft, candidate->fmu, candidate->variable, path);
    tl_draft_variable(draft, port->fmu, port->variable, matched);
    if (candidate->is_tried && candidate->most > 0.0) {
        (void)snprintf(text, sizeof text, "%s%s by %g moves %s by %.3g%s%s, half of it in %.3g s%s",
                       candidate->is_chosen ? "adjusted: " : "", path, candidate->step, matched, candidate->most,
                       unit[0] != '\0' ? " " : "", unit, candidate->half_s,
                       candidate->is_left_out ? "; another one is closer to the recording" : "");
    } else {
        (void)snprintf(text, sizeof text, "%s by %g %s", path, candidate->step,
                       candidate->is_tried ? "moves no matched output" : "was not tried");
    }
    tl_wrapped_print(output, text, 2, 4);
}

static void print_connections(const initialisation *self, FILE *output) {
    const cJSON *item = NULL;
    const cJSON *component = NULL;
    cJSON_ArrayForEach(item, cJSON_GetObjectItemCaseSensitive(self->final, "connect")) {
        (void)fprintf(output, "  %s \342\206\222 %s\n", cJSON_GetArrayItem(item, 0)->valuestring,
                      cJSON_GetArrayItem(item, 1)->valuestring);
    }
    cJSON_ArrayForEach(component, cJSON_GetObjectItemCaseSensitive(self->final, "components")) {
        cJSON_ArrayForEach(item, cJSON_GetObjectItemCaseSensitive(component, "set")) {
            if (cJSON_IsString(item) && strncmp(item->valuestring, "plant.", strlen("plant.")) == 0) {
                (void)fprintf(output, "  %s \342\206\222 %s.%s, at the start\n", item->valuestring, component->string,
                              item->string);
            }
        }
    }
}

static void print_page(const initialisation *self, FILE *output) {
    const tl_draft *draft = &self->draft;
    (void)fprintf(output, "%s: written\nconnections\n", self->output);
    const cJSON *item = NULL;
    print_connections(self, output);
    (void)fputs("matched\n", output);
    for (size_t m = 0; m < draft->match_count; m++) {
        const tl_draft_port *port = &draft->ports[draft->matches[m].port];
        (void)fprintf(output, "  %s.%s \342\206\224 plant.%s\n", draft->fmus[port->fmu].name, port->variable->name,
                      draft->signals[draft->matches[m].signal].name);
    }
    (void)fputs("reactions\n", output);
    for (size_t i = 0; i < draft->candidate_count; i++) {
        print_candidate(draft, &draft->candidates[i], output);
    }
    const cJSON *fill_in = cJSON_GetObjectItemCaseSensitive(self->final, "fill_in");
    (void)fputs("to fill in\n", output);
    cJSON_ArrayForEach(item, fill_in) {
        char text[TL_DRAFT_PATH + TL_DRAFT_FILL_IN + TL_DRAFT_NAME];
        (void)snprintf(text, sizeof text, "%s: %s", item->string, item->valuestring);
        tl_wrapped_print(output, text, 2, 4);
    }
    if (cJSON_GetArraySize(fill_in) == 0) {
        (void)fputs("  nothing\n", output);
    }
    (void)fprintf(output, "next: twinlock check %s\n", self->output);
}

/* Reports what is wrong in a given plant once, before it is used. */
static tl_status check_plant(initialisation *self) {
    char *text = tl_draft_text(&self->draft, TL_DRAFT_COMPARED, 0);
    tl_config config;
    tl_status status = parse(self, text, &config);
    free(text);
    if (status == TL_OK) {
        tl_config_free(&config);
    } else if (self->error.text[0] == '\0' && self->given != NULL) {
        (void)tl_fail(&self->error, status, "%s: correct it; the lines above are those of a draft of %s",
                      self->options->plant, self->output);
    }
    return status;
}

static tl_status initialise(initialisation *self) {
    static const double guess = 0.01;
    tl_draft *draft = &self->draft;
    draft->is_step_known = self->options->step_s > 0.0;
    draft->step_s = draft->is_step_known ? self->options->step_s : guess;
    tl_status status = read_inputs(self);
    if (status == TL_OK) {
        const size_t known = draft->signal_count;
        tl_draft_link(draft);
        if (known > draft->signal_count) {
            tl_log(TL_LOG_NOTICE, "%zu signals of the plant fit no variable and are left out",
                   known - draft->signal_count);
        }
        status = draft->signal_count != 0
                     ? TL_OK
                     : tl_fail(&self->error, TL_BAD_DATA,
                               "%s has neither inputs nor Real outputs: there is nothing to compare with the plant",
                               self->options->fmus[0]);
    }
    status = status == TL_OK ? check_plant(self) : status;
    if (status == TL_OK && draft->recording != NULL) {
        status = measure_recording(self);
    }
    if (status == TL_OK) {
        tl_draft_propose(draft);
        status = try_reactions(self);
    }
    double locked = 0.0;
    status = status == TL_OK ? finish(self, &locked) : status;
    status = status == TL_OK && !self->is_failed ? try_others(self, locked) : status;
    return status == TL_OK ? write_file(self) : status;
}

int tl_verb_init(const tl_options *options) {
    static initialisation self;
    FILE *output = tl_output_claim();
    self.options = options;
    tl_interrupt_install();
    tl_arena_init(&self.arena);
    tl_status status = initialise(&self);
    if (status == TL_OK) {
        print_page(&self, output);
        status = self.is_failed ? TL_FMU_FAILED : TL_OK;
    } else if (self.error.text[0] != '\0') {
        tl_log(TL_LOG_ERROR, "%s", self.error.text);
    }
    tl_csv_columns_release(&self.columns);
    cJSON_Delete(self.given);
    cJSON_Delete(self.final);
    tl_arena_release(&self.arena);
    return tl_exit_code(tl_output_finish(output, status));
}
