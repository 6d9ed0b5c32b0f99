/* The options of all verbs: see options.h. */
#include "firmware/cli/options.h"

#include <ctype.h>
#include <errno.h>
#include <getopt.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "firmware/base/other_case.h"
#include "firmware/base/utc.h"
#include "firmware/cli/option_table.h"
#include "firmware/process/fmu_patience.h"
#include "firmware/retune/control_words.h"
#include "master/base/nearest.h"

/* What getopt_long() returns: a row of the table, from here on, so that no row is taken for a character. */
enum { FIRST_ROW = 256, LONGEST_NAME = 64 };

static const double MOST_SECONDS = 1e9;
static const double MOST_WHOLE_SECONDS = 3600;
static const double MOST_PERCENT = 100;
enum { LEAST_MEBIBYTES = 64, MOST_MEBIBYTES = 1 << 20 };

/* One command line while it is read. */
typedef struct reading {
    tl_verb verb;
    char **argv;
    tl_options *options;
    bool given[TL_OPTION_COUNT];
} reading;

static bool has_option(tl_verb verb, const tl_option *option) {
    return (option->verbs >> verb & 1U) != 0;
}

/* ---- what is wrong ----------------------------------------------------------------------------------------------- */

static tl_options_outcome refuse(const reading *self, const char *format, ...) TL_PRINTF(2, 3);

static tl_options_outcome refuse(const reading *self, const char *format, ...) {
    const tl_verb_row *row = &tl_verb_rows[self->verb];
    va_list arguments;
    (void)fprintf(stderr, "twinlock %s: ", row->name);
    va_start(arguments, format);
    (void)vfprintf(stderr, format, arguments);
    va_end(arguments);
    (void)fprintf(stderr, "\nusage: twinlock %s %s [options]; `twinlock %s --help` explains them\n", row->name,
                  row->subject, row->name);
    return TL_OPTIONS_WRONG;
}

static tl_options_outcome refuse_value(const reading *self, const tl_option *option, const char *found) {
    return refuse(self, "--%s: found \"%s\", expected %s", option->name, found, option->expected);
}

/* The verbs that have an option of this name: "replay, show"; "" if none has. */
static void list_verbs(const char *name, char *text, size_t size) {
    size_t used = 0;
    text[0] = '\0';
    for (size_t i = 0; i < TL_OPTION_COUNT; i++) {
        for (tl_verb verb = 0; verb < TL_VERB_COUNT && strcmp(tl_option_rows[i].name, name) == 0; verb++) {
            if (has_option(verb, &tl_option_rows[i]) && used < size) {
                used +=
                    (size_t)snprintf(text + used, size - used, "%s%s", used > 0 ? ", " : "", tl_verb_rows[verb].name);
            }
        }
    }
}

/* Of those of the verb that begin so, if there are several: "--record or --recording". */
static size_t list_longer(tl_verb verb, const char *name, char *text, size_t size) {
    size_t used = 0;
    size_t count = 0;
    for (size_t i = 0; i < TL_OPTION_COUNT; i++) {
        const tl_option *option = &tl_option_rows[i];
        if (has_option(verb, option) && strncmp(option->name, name, strlen(name)) == 0 && used < size) {
            used += (size_t)snprintf(text + used, size - used, "%s--%s", count > 0 ? " or " : "", option->name);
            count++;
        }
    }
    return count;
}

static const char *nearest_option(tl_verb verb, const char *name) {
    tl_nearest nearest = {.text = name};
    for (size_t i = 0; i < TL_OPTION_COUNT; i++) {
        if (has_option(verb, &tl_option_rows[i])) {
            tl_nearest_offer(&nearest, tl_option_rows[i].name);
        }
    }
    return nearest.best;
}

/* `word` begins with "--". */
static tl_options_outcome refuse_word(const reading *self, const char *word) {
    char name[LONGEST_NAME];
    char text[4 * LONGEST_NAME];
    const char *begin = word + strlen("--");
    (void)snprintf(name, sizeof name, "%.*s", (int)strcspn(begin, "="), begin);
    if (list_longer(self->verb, name, text, sizeof text) > 1) {
        return refuse(self, "--%s is short for several options: %s", name, text);
    }
    list_verbs(name, text, sizeof text);
    if (text[0] != '\0') {
        return refuse(self, "there is no option --%s here: it is one of %s", name, text);
    }
    const char *nearest = nearest_option(self->verb, name);
    if (nearest != NULL) {
        return refuse(self, "there is no option --%s: did you mean --%s?", name, nearest);
    }
    return refuse(self, "there is no option --%s", name);
}

/* getopt_long() came upon what it does not know, or upon a value that is missing (':') or not wanted. */
static tl_options_outcome refuse_option(const reading *self, int result) {
    if (optopt >= FIRST_ROW) {
        const tl_option *option = &tl_option_rows[optopt - FIRST_ROW];
        if (result == ':') {
            return refuse(self, "--%s: %s is missing behind it", option->name, option->value);
        }
        return refuse(self, "--%s takes no value: found \"%s\"", option->name, self->argv[optind - 1]);
    }
    if (optopt != 0) {
        return refuse(self, "there is no option -%c", optopt);
    }
    return refuse_word(self, self->argv[optind - 1]);
}

/* ---- values ------------------------------------------------------------------------------------------------------ */

/* False if the text is no number, or one that no double holds. */
static bool read_double(const char *text, double *number) {
    char *end = NULL;
    errno = 0;
    *number = strtod(text, &end);
    return errno == 0 && end != text && *end == '\0';
}

static bool read_switch(const char *text, void *target) {
    (void)text;
    *(bool *)target = true;
    return true;
}

static bool read_text(const char *text, void *target) {
    *(const char **)target = text;
    return true;
}

static bool read_seconds(const char *text, void *target) {
    double *seconds = target;
    return read_double(text, seconds) && *seconds > 0.0 && *seconds < MOST_SECONDS;
}

static bool read_whole_seconds(const char *text, void *target) {
    double *seconds = target;
    return read_double(text, seconds) && *seconds >= 1.0 && *seconds <= MOST_WHOLE_SECONDS &&
           *seconds == floor(*seconds);
}

static bool read_percent(const char *text, void *target) {
    double *percent = target;
    return read_double(text, percent) && *percent > 0.0 && *percent <= MOST_PERCENT;
}

static bool read_number(const char *text, void *target) {
    char *end = NULL;
    errno = 0;
    *(uint64_t *)target = strtoull(text, &end, 10);
    return errno == 0 && end != text && *end == '\0' && strchr(text, '-') == NULL;
}

static bool read_mebibytes(const char *text, void *target) {
    const uint64_t *mebibytes = target;
    return read_number(text, target) && *mebibytes >= LEAST_MEBIBYTES && *mebibytes <= MOST_MEBIBYTES;
}

static bool read_run(const char *text, void *target) {
    const uint64_t *run = target;
    return read_number(text, target) && *run >= 1 && *run <= INT64_MAX;
}

static bool read_run_or_last(const char *text, void *target) {
    *(uint64_t *)target = 0;
    return strcmp(text, "last") == 0 || read_run(text, target);
}

/* "90s", "15m", "8h", "2d". */
static bool read_back(const char *text, double *seconds) {
    static const char letters[] = "smhd";
    static const double factors[] = {1.0, 60.0, 3600.0, 86400.0};
    char *end = NULL;
    double number = strtod(text, &end);
    const char *letter = *end == '\0' ? NULL : strchr(letters, *end);
    if (!isdigit((unsigned char)text[0]) || letter == NULL || end[1] != '\0' || !isfinite(number)) {
        return false;
    }
    *seconds = number * factors[letter - letters];
    return true;
}

static bool read_since(const char *text, void *target) {
    tl_options_since *since = target;
    since->text = text;
    since->is_date = !read_back(text, &since->back_s);
    return !since->is_date || tl_utc_parse(text, &since->at);
}

static bool read_table(const char *text, void *target) {
    int i = 0;
    while (tl_option_tables[i] != NULL && strcmp(text, tl_option_tables[i]) != 0) {
        i++;
    }
    *(int *)target = i;
    return tl_option_tables[i] != NULL;
}

/* Given twice, the lesser one counts: words behind those of a command line that limits its caller raise nothing. */
static bool read_right(const char *text, void *target) {
    uint32_t *least = target;
    tl_control_right right = TL_CONTROL_MAY_READ;
    bool is_right = tl_control_right_of(text, &right);
    *least = is_right && right < *least ? right : *least;
    return is_right;
}

/* Each sets what a value means; false if it is not what was expected. */
static bool (*const READ[])(const char *text, void *target) = {
    [TL_OPTION_SWITCH] = read_switch,
    [TL_OPTION_TEXT] = read_text,
    [TL_OPTION_SECONDS] = read_seconds,
    [TL_OPTION_WHOLE_SECONDS] = read_whole_seconds,
    [TL_OPTION_PERCENT] = read_percent,
    [TL_OPTION_NUMBER] = read_number,
    [TL_OPTION_MEBIBYTES] = read_mebibytes,
    [TL_OPTION_RUN] = read_run,
    [TL_OPTION_RUN_OR_LAST] = read_run_or_last,
    [TL_OPTION_SINCE] = read_since,
    [TL_OPTION_TABLE] = read_table,
    [TL_OPTION_RIGHT] = read_right,
};

/* ---- the command line -------------------------------------------------------------------------------------------- */

/* The verb's rows as getopt_long() wants them. */
static void list_options(tl_verb verb, struct option list[TL_OPTION_COUNT + 1]) {
    size_t count = 0;
    for (int i = 0; i < TL_OPTION_COUNT; i++) {
        const tl_option *option = &tl_option_rows[i];
        if (has_option(verb, option)) {
            int has_value = option->value != NULL ? required_argument : no_argument;
            list[count++] = (struct option){option->name, has_value, NULL, FIRST_ROW + i};
        }
    }
    list[count] = (struct option){NULL, 0, NULL, 0};
}

static tl_options_outcome take(reading *self, int result) {
    const tl_option *option = result == 'h' ? NULL : &tl_option_rows[result - FIRST_ROW];
    if (option == NULL || option->kind == TL_OPTION_HELP) {
        tl_option_table_print_help(self->verb, stdout);
        return TL_OPTIONS_HELPED;
    }
    if (!READ[option->kind](optarg, (char *)self->options + option->offset)) {
        return refuse_value(self, option, optarg);
    }
    self->given[result - FIRST_ROW] = true;
    return TL_OPTIONS_READ;
}

/* The option of this verb that is called so. */
static size_t find_option(tl_verb verb, const char *name) {
    size_t i = 0;
    while (!has_option(verb, &tl_option_rows[i]) || strcmp(tl_option_rows[i].name, name) != 0) {
        i++;
    }
    return i;
}

/* Those of which at most one may be there: "--json, --csv or --report". */
static tl_options_outcome refuse_together(const reading *self) {
    char text[4 * LONGEST_NAME];
    size_t used = 0;
    text[0] = '\0';
    for (size_t i = 0; i < TL_OPTION_COUNT; i++) {
        const tl_option *option = &tl_option_rows[i];
        if (has_option(self->verb, option) && option->alone && used < sizeof text) {
            used += (size_t)snprintf(text + used, sizeof text - used, "%s--%s", used > 0 ? ", " : "", option->name);
        }
    }
    return refuse(self, "expected at most one of %s", text);
}

/* The first given one that is so; NULL: none is. */
static const tl_option *find_given(const reading *self, bool only) {
    for (size_t i = 0; i < TL_OPTION_COUNT; i++) {
        const tl_option *option = &tl_option_rows[i];
        if (self->given[i] && (only ? option->only : option->changes)) {
            return option;
        }
    }
    return NULL;
}

/* What belongs together is there together, and nothing else is. */
static tl_options_outcome check_options(const reading *self) {
    size_t alone = 0;
    for (size_t i = 0; i < TL_OPTION_COUNT; i++) {
        const tl_option *option = &tl_option_rows[i];
        if (!self->given[i]) {
            continue;
        }
        alone += option->alone ? 1 : 0;
        if (option->needs != NULL && !self->given[find_option(self->verb, option->needs)]) {
            const char *value = tl_option_rows[find_option(self->verb, option->needs)].value;
            return refuse(self, "--%s needs --%s%s%s", option->name, option->needs, value != NULL ? " " : "",
                          value != NULL ? value : "");
        }
    }
    const tl_option *only = find_given(self, true);
    const tl_option *changes = find_given(self, false);
    if (alone <= 1 && only != NULL && changes != NULL) {
        return refuse(self, "--%s is of no use with --%s", changes->name, only->name);
    }
    return alone > 1 ? refuse_together(self) : TL_OPTIONS_READ;
}

static tl_options_outcome take_subject(const reading *self, int count, char **words) {
    const char *noun = tl_verb_rows[self->verb].subject_noun;
    if (count == 0) {
        return refuse(self, "expected exactly one %s, found none", noun);
    }
    if (count > 1) {
        return refuse(self, "expected exactly one %s, found \"%s\" and \"%s\"", noun, words[0], words[1]);
    }
    self->options->subject = words[0];
    return TL_OPTIONS_READ;
}

tl_options_outcome tl_options_read(tl_verb verb, int argc, char **argv, tl_options *options) {
    struct option list[TL_OPTION_COUNT + 1];
    reading self = {.verb = verb, .argv = argv, .options = options};
    *options = (tl_options){
        .call_limit_s = tl_seconds(TL_FMU_PATIENCE_CALL),
        .watchdog_s = 30,
        .seed = 1,
        .table = TL_OPTIONS_NO_TABLE,
        .right = TL_CONTROL_RIGHTS,
    };
    list_options(verb, list);
    optind = 0; /* GNU: begin anew */
    opterr = 0;
    for (int result = 0; (result = getopt_long(argc, argv, ":h", list, NULL)) != -1;) {
        tl_options_outcome outcome =
            result == '?' || result == ':' ? refuse_option(&self, result) : take(&self, result);
        if (outcome != TL_OPTIONS_READ) {
            return outcome;
        }
    }
    tl_options_outcome outcome = take_subject(&self, argc - optind, argv + optind);
    return outcome == TL_OPTIONS_READ ? check_options(&self) : outcome;
}

tl_status tl_options_find_recording(const tl_options *options, const tl_config *config, char path[PATH_MAX],
                                    tl_error *error) {
    char other[TL_OTHER_CASE_TEXT];
    if (options->recording != NULL) {
        (void)snprintf(path, PATH_MAX, "%s", options->recording);
    } else if (config->recording_file != NULL) {
        tl_config_file_path(config, config->recording_file, path, PATH_MAX);
    } else {
        return tl_fail(error, TL_BAD_USAGE, "%s names no recording: give one with --recording FILE", config->path);
    }
    if (tl_other_case(path, other)[0] != '\0') {
        return tl_fail(error, TL_BAD_DATA, "%s: No such file or directory%s", path, other);
    }
    return TL_OK;
}
