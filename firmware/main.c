/* twinlock: the command line. Finds the verb and hands over. */
#include <stdio.h>
#include <string.h>

#include "firmware/base/c_locale.h"
#include "firmware/process/crash.h"
#include "firmware/process/process_end.h"
#include "firmware/verbs/verbs.h"

typedef struct verb {
    const char *name;
    int (*run)(int argc, char **argv);
    const char *purpose;
} verb;

static const verb VERBS[] = {
    {"check", tl_verb_check, "validate a configuration and its FMUs without running"},
    {"replay", tl_verb_replay, "run a recording through the twin, as fast as it can"},
    {"run", tl_verb_run, "keep the twin locked to the plant, in real time"},
    {"plant", tl_verb_plant, "play a recording or a plant model as a real plant"},
    {"show", tl_verb_show, "show what was corrected, when and why"},
};

enum { VERB_COUNT = sizeof VERBS / sizeof VERBS[0] };

static void print_usage(FILE *file) {
    (void)fputs("usage: twinlock VERB …\n\n"
                "Keeps the simulation of a plant locked to the plant, and records what it had to correct.\n\n",
                file);
    for (size_t i = 0; i < VERB_COUNT; i++) {
        (void)fprintf(file, "  %-8s %s\n", VERBS[i].name, VERBS[i].purpose);
    }
    (void)fputs(
        "\n`twinlock VERB --help` says more. `twinlock --version` prints the version.\n"
        "Exit codes: 0 done, 2 wrong usage, 65 bad configuration or data, 69 plant I/O, 70 FMU, 75 try again.\n",
        file);
}

static int run_command_line(int argc, char **argv) {
    tl_locale_use();
    if (argc < 2) {
        print_usage(stderr);
        return 2;
    }
    if (strcmp(argv[1], "--help") == 0 || strcmp(argv[1], "-h") == 0 || strcmp(argv[1], "help") == 0) {
        print_usage(stdout);
        return 0;
    }
    if (strcmp(argv[1], "--version") == 0) {
        (void)puts("twinlock " TL_VERSION);
        return 0;
    }
    for (size_t i = 0; i < VERB_COUNT; i++) {
        if (strcmp(argv[1], VERBS[i].name) == 0) {
            char title[32]; /* how getopt calls the program in its messages */
            (void)snprintf(title, sizeof title, "twinlock %s", VERBS[i].name);
            argv[1] = title;
            return VERBS[i].run(argc - 1, argv + 1);
        }
    }
    (void)fprintf(stderr, "twinlock: there is no verb \"%s\"\n\n", argv[1]);
    print_usage(stderr);
    return 2;
}

int main(int argc, char **argv) {
    tl_process_begin();
    tl_crash_install();
    tl_process_end(run_command_line(argc, argv));
}
