/* The command line: see command_line.h. */
#include "firmware/cli/command_line.h"

#include <stdio.h>
#include <string.h>

#include "firmware/cli/options.h"
#include "firmware/cli/verb_program.h"
#include "firmware/cli/verbs.h"
#include "master/base/text.h"

static int (*const RUN[TL_VERB_COUNT])(const tl_options *options) = {
    [TL_VERB_CHECK] = tl_verb_check, [TL_VERB_REPLAY] = tl_verb_replay, [TL_VERB_RUN] = tl_verb_run,
    [TL_VERB_PLANT] = tl_verb_plant, [TL_VERB_SHOW] = tl_verb_show,     [TL_VERB_RELOAD] = tl_verb_reload,
};

/* TL_VERB_COUNT if there is none. */
static tl_verb find_verb(const char *name) {
    tl_verb verb = 0;
    while (verb < TL_VERB_COUNT && strcmp(name, tl_verb_rows[verb].name) != 0) {
        verb++;
    }
    return verb;
}

static int refuse_verb(const char *name) {
    tl_nearest nearest = {.text = name};
    for (size_t i = 0; i < TL_VERB_COUNT; i++) {
        tl_nearest_offer(&nearest, tl_verb_rows[i].name);
    }
    for (size_t i = 0; i < TL_VERB_PROGRAMS; i++) {
        tl_nearest_offer(&nearest, tl_verb_programs[i].name);
    }
    (void)fprintf(stderr, "twinlock: there is no verb \"%s\"", name);
    if (nearest.best != NULL) {
        (void)fprintf(stderr, ": did you mean %s?", nearest.best);
    } else if (name[0] == '-') {
        (void)fputs(": options come behind the verb", stderr);
    }
    (void)fputs("\n\n", stderr);
    tl_options_print_usage(stderr);
    return tl_exit_code(TL_BAD_USAGE);
}

static int help_program(const tl_verb_program *program) {
    char name[] = "token";
    char option[] = "--help";
    char *words[] = {name, option, NULL};
    return tl_verb_program_run(program, 2, words);
}

/* `twinlock help`, `twinlock help VERB`. */
static int help(const char *name) {
    tl_verb verb = name != NULL ? find_verb(name) : TL_VERB_COUNT;
    const tl_verb_program *program = name != NULL ? tl_verb_program_find(name) : NULL;
    if (program != NULL) {
        return help_program(program);
    }
    if (name == NULL) {
        tl_options_print_usage(stdout);
    } else if (verb == TL_VERB_COUNT) {
        return refuse_verb(name);
    } else {
        tl_options_print_help(&tl_verb_table, verb);
    }
    return tl_exit_code(TL_OK);
}

static int run_verb(tl_verb verb, int argc, char **argv) {
    tl_options options;
    switch (tl_options_read(verb, argc, argv, &options)) {
    case TL_OPTIONS_READ:
        return RUN[verb](&options);
    case TL_OPTIONS_HELPED:
        return tl_exit_code(TL_OK);
    case TL_OPTIONS_WRONG:
        break;
    }
    return tl_exit_code(TL_BAD_USAGE);
}

int tl_command_line_run(int argc, char **argv) {
    const char *first = argc > 1 ? argv[1] : "";
    tl_verb verb = find_verb(first);
    const tl_verb_program *program = tl_verb_program_find(first);
    if (argc < 2) {
        tl_options_print_usage(stderr);
        return tl_exit_code(TL_BAD_USAGE);
    }
    if (verb != TL_VERB_COUNT) {
        return run_verb(verb, argc - 1, argv + 1);
    }
    if (program != NULL) {
        return tl_verb_program_run(program, argc - 1, argv + 1);
    }
    if (strcmp(first, "help") == 0) {
        return help(argc > 2 ? argv[2] : NULL);
    }
    if (strcmp(first, "--help") == 0 || strcmp(first, "-h") == 0) {
        return help(NULL);
    }
    if (strcmp(first, "--version") == 0) {
        (void)puts("twinlock " TL_VERSION);
        return tl_exit_code(TL_OK);
    }
    return refuse_verb(first);
}
