/* Program options: see program_options.h. */
#include "firmware/base/program_options.h"

#include <getopt.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include "firmware/base/text.h"
#include "master/base/text.h"

/* Values of getopt_long() for the verb's options start here, so that they differ from all
 * characters. */
enum { FIRST_ROW = 256, LONGEST_NAME = 64, LIST = 256, NARROWEST = 4 };

/* State while one command line is parsed. */
typedef struct reading {
    const tl_option_table *table;
    const tl_verb_row *verb;
    char **argv;
    void *settings;
    size_t count; /* number of the verb's own options */
    const tl_option *options[TL_OPTIONS_MOST];
    bool given[TL_OPTIONS_MOST];
} reading;

static reading begin(const tl_option_table *table, size_t verb) {
    reading self = {.table = table, .verb = &table->verbs[verb]};
    for (size_t i = 0; i < table->option_count; i++) {
        if ((table->options[i].verbs >> verb & 1U) != 0) {
            self.options[self.count++] = &table->options[i];
        }
    }
    return self;
}

/* ---- values ---------------------------------------------------------------------------------- */

bool tl_option_switch(const char *text, void *target) {
    (void)text;
    *(bool *)target = true;
    return true;
}

bool tl_option_text(const char *text, void *target) {
    *(const char **)target = text;
    return true;
}

bool tl_option_listed(const char *text, void *target) {
    tl_option_list *list = target;
    bool fits = list->count < TL_OPTION_LIST;
    if (fits) {
        list->values[list->count++] = text;
    }
    return fits;
}

/* ---- help ------------------------------------------------------------------------------------ */

/* Prints lines; all but the first are indented. */
static void print_lines(const char *lines, int indent) {
    for (const char *line = lines;;) {
        size_t length = strcspn(line, "\n");
        (void)printf("%.*s\n", (int)length, line);
        line += length;
        if (*line == '\0') {
            return;
        }
        (void)printf("%*s", indent, "");
        line++;
    }
}

static size_t width_of(const tl_option *option) {
    return strlen("--") + strlen(option->name) + (option->value != NULL ? strlen(" ") + strlen(option->value) : 0);
}

static void print_option(const tl_option *option, size_t widest) {
    int indent = (int)(strlen("  ") + widest + strlen("  "));
    bool has_value = option->value != NULL;
    int used = printf("  --%s%s%s", option->name, has_value ? " " : "", has_value ? option->value : "");
    if (width_of(option) > widest) {
        (void)putchar('\n');
        used = 0;
    }
    (void)printf("%*s", indent - used, "");
    tl_wrapped_continue(stdout, option->help, indent, indent);
}

static void print_options(const reading *self, bool rare, size_t widest) {
    const char *heading = rare ? "\nless common options:\n" : "\noptions:\n";
    for (size_t i = 0; i < self->count; i++) {
        if (self->options[i]->rare == rare) {
            (void)fputs(heading, stdout);
            print_option(self->options[i], widest);
            heading = "";
        }
    }
}

void tl_options_print_help(const tl_option_table *table, size_t verb) {
    const reading self = begin(table, verb);
    size_t widest = NARROWEST;
    for (size_t i = 0; i < self.count; i++) {
        size_t width = width_of(self.options[i]);
        widest = width <= table->widest && width > widest ? width : widest;
    }
    (void)printf("usage: twinlock %s %s\n\n", self.verb->name, self.verb->usage);
    tl_wrapped_print(stdout, self.verb->description, 0, 0);
    (void)fputs("\n  ", stdout);
    print_lines(self.verb->examples, (int)strlen("  "));
    print_options(&self, false, widest);
    print_options(&self, true, widest);
}

/* ---- errors
 * -------------------------------------------------------------------------------------------------
 */

tl_options_outcome tl_options_refuse(const tl_verb_row *verb, const char *format, ...) {
    va_list arguments;
    (void)fprintf(stderr, "twinlock %s: ", verb->name);
    va_start(arguments, format);
    (void)vfprintf(stderr, format, arguments);
    va_end(arguments);
    (void)fprintf(stderr, "\nusage: twinlock %s %s; `twinlock %s --help` explains them\n", verb->name, verb->usage,
                  verb->name);
    return TL_OPTIONS_WRONG;
}

/* Adds a word to a list, for example "--record or --recording". */
static void add_to(char list[LIST], const char *separator, const char *before, const char *word) {
    size_t used = strlen(list);
    (void)snprintf(list + used, LIST - used, "%s%s%s", used > 0 ? separator : "", before, word);
}

/* Lists the verbs that have an option of this name, for example "replay, show"; "" if none has it.
 */
static void list_verbs(const tl_option_table *table, const char *name, char list[LIST]) {
    for (size_t i = 0; i < table->option_count; i++) {
        for (size_t verb = 0; verb < table->verb_count && strcmp(table->options[i].name, name) == 0; verb++) {
            if ((table->options[i].verbs >> verb & 1U) != 0) {
                add_to(list, ", ", "", table->verbs[verb].name);
            }
        }
    }
}

/* Reports an unknown or ambiguous option; `word` begins with "--". */
static tl_options_outcome refuse_word(const reading *self, const char *word) {
    char name[LONGEST_NAME];
    char longer[LIST] = "";
    char verbs[LIST] = "";
    size_t count = 0;
    tl_nearest nearest = {.text = name};
    const char *from = word + strlen("--");
    (void)snprintf(name, sizeof name, "%.*s", (int)strcspn(from, "="), from);
    for (size_t i = 0; i < self->count; i++) {
        tl_nearest_offer(&nearest, self->options[i]->name);
        if (strncmp(self->options[i]->name, name, strlen(name)) == 0) {
            add_to(longer, " or ", "--", self->options[i]->name);
            count++;
        }
    }
    if (count > 1) {
        return tl_options_refuse(self->verb, "--%s is short for several options: %s", name, longer);
    }
    list_verbs(self->table, name, verbs);
    if (verbs[0] != '\0') {
        return tl_options_refuse(self->verb, "there is no option --%s here: it is one of %s", name, verbs);
    }
    if (nearest.best != NULL) {
        return tl_options_refuse(self->verb, "there is no option --%s: did you mean --%s?", name, nearest.best);
    }
    return tl_options_refuse(self->verb, "there is no option --%s", name);
}

/* Reports why getopt_long() failed: an unknown option, a missing value (':'), or an unwanted one.
 */
static tl_options_outcome refuse_option(const reading *self, int result) {
    if (optopt >= FIRST_ROW) {
        const tl_option *option = self->options[optopt - FIRST_ROW];
        if (result == ':') {
            return tl_options_refuse(self->verb, "--%s: %s is missing behind it", option->name, option->value);
        }
        return tl_options_refuse(self->verb, "--%s takes no value: found \"%s\"", option->name, self->argv[optind - 1]);
    }
    if (optopt != 0) {
        return tl_options_refuse(self->verb, "there is no option -%c", optopt);
    }
    return refuse_word(self, self->argv[optind - 1]);
}

/* ---- rules between options ------------------------------------------------------------------- */

static tl_options_outcome check_words(const reading *self, size_t count, char *const *words) {
    const char *noun = self->verb->noun;
    if (noun != NULL && count == 0) {
        return tl_options_refuse(self->verb, "expected exactly one %s, found none", noun);
    }
    if (noun != NULL && count > 1) {
        return tl_options_refuse(self->verb, "expected exactly one %s, found \"%s\" and \"%s\"", noun, words[0],
                                 words[1]);
    }
    return TL_OPTIONS_READ;
}

static tl_options_outcome check_needs(const reading *self) {
    for (size_t i = 0; i < self->count; i++) {
        const char *needs = self->given[i] ? self->options[i]->needs : NULL;
        size_t needed = 0;
        while (needs != NULL && strcmp(self->options[needed]->name, needs) != 0) {
            needed++;
        }
        if (needs != NULL && !self->given[needed]) {
            const char *value = self->options[needed]->value;
            return tl_options_refuse(self->verb, "--%s needs --%s%s%s", self->options[i]->name, needs,
                                     value != NULL ? " " : "", value != NULL ? value : "");
        }
    }
    return TL_OPTIONS_READ;
}

/* Rejects options that exclude each other. */
static tl_options_outcome check_together(const reading *self) {
    char list[LIST] = "";
    size_t alone = 0;
    const tl_option *only = NULL;
    const tl_option *changes = NULL;
    for (size_t i = 0; i < self->count; i++) {
        const tl_option *option = self->options[i];
        if (option->alone) {
            add_to(list, ", ", "--", option->name);
        }
        alone += option->alone && self->given[i] ? 1 : 0;
        only = only == NULL && option->only && self->given[i] ? option : only;
        changes = changes == NULL && option->changes && self->given[i] ? option : changes;
    }
    if (alone > 1) {
        return tl_options_refuse(self->verb, "expected at most one of %s", list);
    }
    if (only != NULL && changes != NULL) {
        return tl_options_refuse(self->verb, "--%s has no effect with --%s", changes->name, only->name);
    }
    return TL_OPTIONS_READ;
}

/* ---- parsing
 * -------------------------------------------------------------------------------------------------
 */

static void list_options(const reading *self, struct option list[TL_OPTIONS_MOST + 1]) {
    for (size_t i = 0; i < self->count; i++) {
        int has_value = self->options[i]->value != NULL ? required_argument : no_argument;
        list[i] = (struct option){self->options[i]->name, has_value, NULL, FIRST_ROW + (int)i};
    }
    list[self->count] = (struct option){NULL, 0, NULL, 0};
}

static tl_options_outcome take(reading *self, int result) {
    const tl_option *option = result == 'h' ? NULL : self->options[result - FIRST_ROW];
    if (option == NULL || option->read == NULL) {
        tl_options_print_help(self->table, (size_t)(self->verb - self->table->verbs));
        return TL_OPTIONS_HELPED;
    }
    if (!option->read(optarg, (char *)self->settings + option->offset)) {
        return tl_options_refuse(self->verb, "--%s: found \"%s\", expected %s", option->name, optarg, option->expected);
    }
    self->given[result - FIRST_ROW] = true;
    return TL_OPTIONS_READ;
}

tl_options_outcome tl_program_options_read(const tl_option_table *table, size_t verb, int argc, char **argv,
                                           void *settings, char ***words, size_t *count) {
    struct option list[TL_OPTIONS_MOST + 1];
    reading self = begin(table, verb);
    tl_options_outcome outcome = TL_OPTIONS_READ;
    self.argv = argv;
    self.settings = settings;
    list_options(&self, list);
    optind = 0; /* GNU: restarts getopt_long() */
    opterr = 0;
    for (int result = 0; outcome == TL_OPTIONS_READ && (result = getopt_long(argc, argv, ":h", list, NULL)) != -1;) {
        outcome = result == '?' || result == ':' ? refuse_option(&self, result) : take(&self, result);
    }
    *words = argv + optind;
    *count = (size_t)(argc - optind);
    outcome = outcome == TL_OPTIONS_READ ? check_words(&self, *count, *words) : outcome;
    outcome = outcome == TL_OPTIONS_READ ? check_needs(&self) : outcome;
    return outcome == TL_OPTIONS_READ ? check_together(&self) : outcome;
}
