/* Command line: see command_line.h. */
#include "firmware/cli/command_line.h"

#include <errno.h>
#include <libgen.h>
#include <limits.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "firmware/base/log.h"
#include "firmware/cli/options.h"
#include "master/base/text.h"

static int (*const RUN[TL_VERB_COUNT])(const tl_options *options) = {
    [TL_VERB_INIT] = tl_verb_init,     [TL_VERB_CHECK] = tl_verb_check,     [TL_VERB_PROBE] = tl_verb_probe,
    [TL_VERB_REPLAY] = tl_verb_replay, [TL_VERB_RUN] = tl_verb_run,         [TL_VERB_PLANT] = tl_verb_plant,
    [TL_VERB_SHOW] = tl_verb_show,     [TL_VERB_FINDING] = tl_verb_finding, [TL_VERB_EXPLAIN] = tl_verb_explain,
    [TL_VERB_LEARN] = tl_verb_learn,   [TL_VERB_RELOAD] = tl_verb_reload,
};

/* ---- Verbs of separate programs. This program loads FMUs and therefore does not link TLS; a box
 * needs no Python. */

static const struct {
    const char *name;
    const char *program; /* and the Debian package that has it */
    const char *purpose; /* half a line of help */
} PROGRAMS[] = {
    {"tune", "twinlock-tune", "search better settings with recordings"},
    {"serve", "twinlock-serve", "accept changed configurations over HTTPS"},
    {"token", "twinlock-serve", "manage access tokens"},
};

enum { PROGRAM_COUNT = sizeof PROGRAMS / sizeof PROGRAMS[0] };

/* Returns NULL if no separate program has this verb. */
static const char *find_program(const char *name) {
    size_t i = 0;
    while (i < PROGRAM_COUNT && strcmp(name, PROGRAMS[i].name) != 0) {
        i++;
    }
    return i < PROGRAM_COUNT ? PROGRAMS[i].program : NULL;
}

/* Finds the program in the folder of this one. Returns false if that folder is not known. */
static bool find_beside(const char *program, char path[PATH_MAX]) {
    char own[PATH_MAX];
    ssize_t length = readlink("/proc/self/exe", own, sizeof own - 1);
    if (length <= 0) {
        return false;
    }
    own[length] = '\0';
    return snprintf(path, PATH_MAX, "%s/%s", dirname(own), program) < PATH_MAX;
}

/* Executes the program with the same arguments; argv[1] is the verb. If that fails, logs the reason
 * and returns the exit code. */
static int run_program(const char *program, char **argv) {
    char path[PATH_MAX];
    char name[PATH_MAX];
    (void)snprintf(name, sizeof name, "%s", program);
    argv[0] = name;
    if (find_beside(program, path)) {
        (void)execv(path, argv);
    } else {
        (void)execvp(program, argv);
    }
    tl_log(TL_LOG_ERROR, "`twinlock %s`: program %s: %s; install the package %s", argv[1], program, strerror(errno),
           program);
    return tl_exit_code(TL_BAD_USAGE);
}

/* ---- usage ---- */

enum { EXITS_OF_A_LINE = 4 };

/* Text for each exit status of the process. */
static const struct {
    tl_status status;
    const char *meaning;
} EXITS[] = {
    {TL_OK, "done"},
    {TL_BAD_USAGE, "wrong usage"},
    {TL_NOT_LOCKED, "not in lock"},
    {TL_BAD_DATA, "bad configuration or data"},
    {TL_PLANT_DOWN, "plant I/O"},
    {TL_FMU_FAILED, "FMU"},
    {TL_TRY_AGAIN, "try again"},
};

static void print_usage(FILE *file) {
    const char *before = "Exit codes: ";
    (void)fputs("usage: twinlock VERB …\n\n"
                "Keeps the simulation of a plant locked to the plant and records corrections.\n\n",
                file);
    for (size_t i = 0; i < TL_VERB_COUNT; i++) {
        (void)fprintf(file, "  %-8s %s\n", tl_verb_rows[i].name, tl_verb_rows[i].purpose);
    }
    for (size_t i = 0; i < PROGRAM_COUNT; i++) {
        (void)fprintf(file, "  %-8s %s\n", PROGRAMS[i].name, PROGRAMS[i].purpose);
    }
    (void)fputs("\n`twinlock help VERB` explains a verb. `twinlock --version` prints the version.\n", file);
    for (size_t i = 0; i < sizeof EXITS / sizeof EXITS[0]; i++) {
        (void)fprintf(file, "%s%d %s", before, tl_exit_code(EXITS[i].status), EXITS[i].meaning);
        before = i + 1 == EXITS_OF_A_LINE ? ",\n            " : ", ";
    }
    (void)fputs(".\n", file);
}

/* ---- the verbs of this program ---- */

/* Returns TL_VERB_COUNT if there is no such verb. */
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
    for (size_t i = 0; i < PROGRAM_COUNT; i++) {
        tl_nearest_offer(&nearest, PROGRAMS[i].name);
    }
    (void)fprintf(stderr, "twinlock: there is no verb \"%s\"", name);
    if (nearest.best != NULL) {
        (void)fprintf(stderr, ": did you mean %s?", nearest.best);
    } else if (name[0] == '-') {
        (void)fputs(": options follow the verb", stderr);
    } else if (access(name, F_OK) == 0) {
        (void)fprintf(stderr, ": a verb comes first, for example `twinlock check %s`", name);
    }
    (void)fputs("\n\n", stderr);
    print_usage(stderr);
    return tl_exit_code(TL_BAD_USAGE);
}

/* Handles `twinlock help VERB`; argv[2] is the verb. */
static int help(char **argv) {
    tl_verb verb = find_verb(argv[2]);
    const char *program = find_program(argv[2]);
    if (program != NULL) {
        char option[] = "--help";
        char *words[] = {argv[0], argv[2], option, NULL};
        return run_program(program, words);
    }
    if (verb == TL_VERB_COUNT) {
        return refuse_verb(argv[2]);
    }
    tl_options_print_help(&tl_verb_table, verb);
    return tl_exit_code(TL_OK);
}

int tl_command_line_run(int argc, char **argv) {
    const char *first = argc > 1 ? argv[1] : "";
    tl_verb verb = find_verb(first);
    if (argc < 2) {
        print_usage(stderr);
        return tl_exit_code(TL_BAD_USAGE);
    }
    if (verb != TL_VERB_COUNT) {
        tl_options options;
        tl_options_outcome outcome = tl_options_read(verb, argc - 1, argv + 1, &options);
        return outcome == TL_OPTIONS_READ ? RUN[verb](&options)
                                          : tl_exit_code(outcome == TL_OPTIONS_HELPED ? TL_OK : TL_BAD_USAGE);
    }
    const char *program = find_program(first);
    if (program != NULL) {
        return run_program(program, argv);
    }
    if (strcmp(first, "help") == 0 && argc > 2) {
        return help(argv);
    }
    if (strcmp(first, "help") == 0 || strcmp(first, "--help") == 0 || strcmp(first, "-h") == 0) {
        print_usage(stdout);
        return tl_exit_code(TL_OK);
    }
    if (strcmp(first, "--version") == 0) {
        (void)puts("twinlock " TL_VERSION);
        return tl_exit_code(TL_OK);
    }
    return refuse_verb(first);
}
