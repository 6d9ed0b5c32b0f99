/* twinlock run: the appliance, supervised or not. */
#include <errno.h>
#include <getopt.h>
#include <stdio.h>
#include <stdlib.h>

#include "firmware/process/crash.h"
#include "firmware/process/process_end.h"
#include "firmware/run/appliance.h"
#include "firmware/supervise/supervisor.h"
#include "firmware/verbs/verbs.h"

typedef struct run_options {
    const char *config;
    const char *database;
    double duration_s; /* 0: as configured */
    bool json;
    bool status;
    bool supervise;
    const char *watchdog;
    double watchdog_s;
    const char *state;
} run_options;

static const double WATCHDOG_S = 30;

static void print_help(FILE *file) {
    (void)fputs("usage: twinlock run CONFIG [options]\n\n"
                "Keeps the twin locked to the plant in real time, until SIGTERM or Ctrl-C, or for the configured\n"
                "duration.\n"
                "It only listens: nothing it does can reach the plant.\n\n"
                "  --db FILE      record into this SQLite database; default: as configured\n"
                "  --duration S   end after S seconds of plant time\n"
                "  --status       a status line per second also where the output is no terminal\n"
                "  --json         print the summary as one JSON object at the end\n"
                "  --supervise    run the twin in a process of its own, and start it again when it hangs or dies, and\n"
                "                 without a twin after a restart loop (safe hold); tell systemd, where it started it\n"
                "  --state DIR    with --supervise: count restarts in DIR/supervisor.json, across resets of the box\n"
                "  --watchdog DEVICE\n"
                "                 with --supervise: stroke this watchdog (/dev/watchdog) while every thread is alive\n"
                "  --watchdog-timeout S\n"
                "                 whole seconds after which it resets the box; default 30\n"
                "  --help         this text\n",
                file);
}

/* Says what is wrong with it. */
static bool parse_seconds(const char *option, const char *text, const char *expected, double most, double *seconds) {
    char *end = NULL;
    errno = 0;
    *seconds = strtod(text, &end);
    bool right = errno == 0 && end != text && *end == '\0' && *seconds > 0.0 && *seconds <= most;
    if (!right) {
        (void)fprintf(stderr, "twinlock run: %s: found \"%s\", expected %s\n", option, text, expected);
    }
    return right;
}

static bool parse_watchdog_timeout(const char *text, double *seconds) {
    static const char *const expected = "whole seconds from 1 to 3600, for example 30";
    if (!parse_seconds("--watchdog-timeout", text, expected, 3600, seconds)) {
        return false;
    }
    bool whole = *seconds == (double)(int)*seconds;
    if (!whole) {
        (void)fprintf(stderr, "twinlock run: --watchdog-timeout: found \"%s\", expected %s\n", text, expected);
    }
    return whole;
}

/* What belongs together is there together. */
static bool check_options(const run_options *options, bool timeout) {
    const char *alone = options->watchdog != NULL ? "--watchdog" : options->state != NULL ? "--state" : NULL;
    if (alone != NULL && !options->supervise) {
        (void)fprintf(stderr, "twinlock run: %s needs --supervise: it is the supervisor's\n", alone);
        return false;
    }
    if (timeout && options->watchdog == NULL) {
        (void)fputs("twinlock run: --watchdog-timeout needs --watchdog DEVICE\n", stderr);
        return false;
    }
    return true;
}

enum { WATCHDOG_TIMEOUT = 256 };

static const struct option LONG[] = {
    {"db", required_argument, NULL, 'd'},       {"duration", required_argument, NULL, 'n'},
    {"status", no_argument, NULL, 's'},         {"json", no_argument, NULL, 'j'},
    {"supervise", no_argument, NULL, 'v'},      {"state", required_argument, NULL, 'S'},
    {"watchdog", required_argument, NULL, 'w'}, {"watchdog-timeout", required_argument, NULL, WATCHDOG_TIMEOUT},
    {"help", no_argument, NULL, 'h'},           {NULL, 0, NULL, 0},
};

/* 0: go on; else the exit code + 1. */
static int take(int option, run_options *options) {
    switch (option) {
    case 'd':
        options->database = optarg;
        return 0;
    case 'n':
        return parse_seconds("--duration", optarg, "seconds > 0 and below 1e9, for example 14", 1e9 - 1,
                             &options->duration_s)
                   ? 0
                   : 3;
    case 's':
        options->status = true;
        return 0;
    case 'j':
        options->json = true;
        return 0;
    case 'v':
        options->supervise = true;
        return 0;
    case 'S':
        options->state = optarg;
        return 0;
    case 'w':
        options->watchdog = optarg;
        return 0;
    case WATCHDOG_TIMEOUT:
        return parse_watchdog_timeout(optarg, &options->watchdog_s) ? 0 : 3;
    case 'h':
        print_help(stdout);
        return 1;
    default:
        print_help(stderr);
        return 3;
    }
}

/* 0: go on; else the exit code + 1. */
static int parse(int argc, char **argv, run_options *options) {
    bool timeout = false;
    for (int option = 0; (option = getopt_long(argc, argv, "h", LONG, NULL)) != -1;) {
        int end = take(option, options);
        if (end != 0) {
            return end;
        }
        timeout = timeout || option == WATCHDOG_TIMEOUT;
    }
    if (optind != argc - 1) {
        (void)fputs("twinlock run: expected exactly one configuration\n\n", stderr);
        print_help(stderr);
        return 3;
    }
    options->config = argv[optind];
    return check_options(options, timeout) ? 0 : 3;
}

/* In a process of its own, or in the only one. */
static int run(void *context, const tl_start *start) {
    tl_process_begin();
    tl_crash_install();
    tl_process_end(tl_appliance_run(context, start));
}

int tl_verb_run(int argc, char **argv) {
    run_options options = {.watchdog_s = WATCHDOG_S};
    int parsed = parse(argc, argv, &options);
    if (parsed != 0) {
        return parsed - 1;
    }
    tl_assembly assembly;
    tl_status status = tl_assembly_read(options.config, &assembly);
    if (status != TL_OK) {
        tl_assembly_free(&assembly);
        return tl_exit_code(status);
    }
    if (options.duration_s > 0.0) {
        assembly.config.duration = tl_time_of_seconds(options.duration_s);
    }
    tl_appliance_settings appliance = {
        .assembly = &assembly,
        .database = options.database,
        .json = options.json,
        .status = options.status,
    };
    if (!options.supervise) {
        return run(&appliance, NULL);
    }
    /* Every child builds its twin from what was read here: a restart runs what ran before, whatever the file says by then. */
    const tl_supervisor_settings settings = {
        .state = options.state,
        .watchdog = options.watchdog,
        .watchdog_s = (int)options.watchdog_s,
        .run = run,
        .context = &appliance,
    };
    int code = tl_supervise(&settings);
    tl_assembly_free(&assembly);
    return code;
}
