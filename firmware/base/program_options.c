/* The options of a program: see program_options.h. */
#include "firmware/base/program_options.h"

#include <getopt.h>
#include <stdio.h>
#include <string.h>

#include "master/base/nearest.h"

enum { FIRST_ROW = 256, SENTENCE = 256, INDENT = 4 };

/* ---- values ------------------------------------------------------------------------------------------------------ */

static bool add_to(tl_program_list *list, const char *text) {
    bool fits = list->count < TL_PROGRAM_LIST;
    if (fits) {
        list->values[list->count] = text;
        list->count++;
    }
    return fits;
}

/* False: it is not what it should be. */
static bool set_value(const tl_program_option *option, const char *text, void *settings) {
    void *target = (char *)settings + option->offset;
    bool is_right = true;
    switch (option->kind) {
    case TL_PROGRAM_SWITCH:
        *(bool *)target = true;
        break;
    case TL_PROGRAM_TEXT:
        *(const char **)target = text;
        break;
    case TL_PROGRAM_LIST_OF:
        is_right = add_to(target, text);
        break;
    }
    return is_right;
}

/* ---- what is wrong ----------------------------------------------------------------------------------------------- */

tl_program_outcome tl_program_options_refuse(const tl_program *program, const char *what) {
    (void)fprintf(stderr, "%s: %s\nusage: %s %s; `%s --help` explains them\n", program->name, what, program->name,
                  program->usage, program->name);
    return TL_PROGRAM_WRONG;
}

static tl_program_outcome refuse_word(const tl_program *program, const char *word) {
    char what[SENTENCE];
    tl_nearest nearest = {.text = word + strspn(word, "-")};
    for (size_t i = 0; i < program->option_count; i++) {
        tl_nearest_offer(&nearest, program->options[i].name);
    }
    if (nearest.best != NULL) {
        (void)snprintf(what, sizeof what, "there is no option %.64s: did you mean --%s?", word, nearest.best);
    } else {
        (void)snprintf(what, sizeof what, "there is no option %.64s, or it is short for several", word);
    }
    return tl_program_options_refuse(program, what);
}

/* getopt_long() came upon what it does not know, or upon a value that is missing (':') or not wanted. */
static tl_program_outcome refuse_option(const tl_program *program, int result, char *const *argv) {
    char what[SENTENCE];
    if (optopt < FIRST_ROW) {
        return refuse_word(program, argv[optind - 1]);
    }
    const tl_program_option *option = &program->options[optopt - FIRST_ROW];
    if (result == ':') {
        (void)snprintf(what, sizeof what, "--%s: %s is missing behind it", option->name, option->value);
    } else {
        (void)snprintf(what, sizeof what, "--%s takes no value", option->name);
    }
    return tl_program_options_refuse(program, what);
}

/* Only a list refuses a value: one too many. */
static tl_program_outcome refuse_value(const tl_program *program, const tl_program_option *option, const char *found) {
    char what[SENTENCE];
    (void)snprintf(what, sizeof what, "--%s: found \"%.64s\", expected at most %d of them", option->name, found,
                   TL_PROGRAM_LIST);
    return tl_program_options_refuse(program, what);
}

static tl_program_outcome check_words(const tl_program *program, size_t count, char *const *words) {
    char what[SENTENCE];
    if (count < program->least_words) {
        (void)snprintf(what, sizeof what, "something is missing: found %zu of at least %zu words", count,
                       program->least_words);
        return tl_program_options_refuse(program, what);
    }
    if (count > program->most_words) {
        (void)snprintf(what, sizeof what, "found \"%.64s\", which is one word too many", words[program->most_words]);
        return tl_program_options_refuse(program, what);
    }
    return TL_PROGRAM_READ;
}

/* ---- help -------------------------------------------------------------------------------------------------------- */

static void print_lines(const char *lines, int indent) {
    for (const char *line = lines; line != NULL;) {
        const char *end = strchr(line, '\n');
        int length = end != NULL ? (int)(end - line) : (int)strlen(line);
        (void)printf("%*s%.*s\n", indent, "", length, line);
        line = end != NULL ? end + 1 : NULL;
    }
}

static tl_program_outcome print_help(const tl_program *program) {
    (void)printf("usage: %s %s\n\n%s\n\n", program->name, program->usage, program->description);
    for (size_t i = 0; i < program->option_count; i++) {
        const tl_program_option *option = &program->options[i];
        const char *value = option->value != NULL ? option->value : "";
        (void)printf("  --%s%s%s\n", option->name, option->value != NULL ? " " : "", value);
        print_lines(option->help, 2 * INDENT);
    }
    (void)printf("  --help\n%*sthis text\n", 2 * INDENT, "");
    return TL_PROGRAM_HELPED;
}

/* ---- the whole --------------------------------------------------------------------------------------------------- */

static void list_options(const tl_program *program, struct option list[TL_PROGRAM_OPTIONS + 2]) {
    for (size_t i = 0; i < program->option_count; i++) {
        const tl_program_option *option = &program->options[i];
        list[i] = (struct option){option->name, option->value != NULL ? required_argument : no_argument, NULL,
                                  FIRST_ROW + (int)i};
    }
    list[program->option_count] = (struct option){"help", no_argument, NULL, 'h'};
    list[program->option_count + 1] = (struct option){NULL, 0, NULL, 0};
}

tl_program_outcome tl_program_options_read(const tl_program *program, int argc, char **argv, void *settings,
                                           char ***words, size_t *count) {
    struct option list[TL_PROGRAM_OPTIONS + 2];
    list_options(program, list);
    optind = 0; /* GNU: begin anew */
    opterr = 0;
    for (int result = 0; (result = getopt_long(argc, argv, ":h", list, NULL)) != -1;) {
        if (result == 'h') {
            return print_help(program);
        }
        if (result == '?' || result == ':') {
            return refuse_option(program, result, argv);
        }
        const tl_program_option *option = &program->options[result - FIRST_ROW];
        if (!set_value(option, optarg, settings)) {
            return refuse_value(program, option, optarg);
        }
    }
    *words = argv + optind;
    *count = (size_t)(argc - optind);
    return check_words(program, *count, *words);
}
