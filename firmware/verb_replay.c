/* twinlock replay: a recording through the twin. */
#include <getopt.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "firmware/assembly.h"
#include "firmware/interrupt.h"
#include "firmware/journal.h"
#include "firmware/log.h"
#include "firmware/output.h"
#include "firmware/recorder.h"
#include "firmware/recording.h"
#include "firmware/replay.h"
#include "firmware/trajectory.h"
#include "firmware/verbs.h"
#include "firmware/watch.h"

typedef struct replay_options {
    const char *config;
    const char *recording;
    const char *database;
    const char *trajectory;
    bool json;
    bool realtime;
    bool plain;
    FILE *output;
} replay_options;

/* Events on their way to the database. */
typedef struct event_way {
    tl_journal journal;
    tl_watch watch;
} event_way;

static void print_help(FILE *file) {
    (void)fputs("usage: twinlock replay CONFIG [options]\n\n"
                "Runs a recording of the plant through the twin and tells how well they agree. Time budgets are\n"
                "ignored, so the same recording gives the same result to the bit.\n\n"
                "  --recording FILE  a CSV file, or a database that `twinlock run` wrote; default: as configured\n"
                "  --json            print one JSON object instead of a table\n"
                "  --db FILE         record into a SQLite database, as `run` does\n"
                "  --csv FILE        write y, ŷ, u and û of every step (\"-\": standard output, without the table)\n"
                "  --realtime        at the plant's own pace\n"
                "  --plain           execute everything: no saving by structure or sequences; the results are the\n"
                "                    same to the bit\n"
                "  --help            this text\n",
                file);
}

/* 0: go on; else the exit code + 1. */
static int parse(int argc, char **argv, replay_options *options) {
    static const struct option LONG[] = {
        {"recording", required_argument, NULL, 'r'},
        {"json", no_argument, NULL, 'j'},
        {"db", required_argument, NULL, 'd'},
        {"csv", required_argument, NULL, 'c'},
        {"realtime", no_argument, NULL, 't'},
        {"plain", no_argument, NULL, 'p'},
        {"help", no_argument, NULL, 'h'},
        {NULL, 0, NULL, 0},
    };
    for (int option = 0; (option = getopt_long(argc, argv, "h", LONG, NULL)) != -1;) {
        switch (option) {
        case 'r':
            options->recording = optarg;
            break;
        case 'j':
            options->json = true;
            break;
        case 'd':
            options->database = optarg;
            break;
        case 'c':
            options->trajectory = optarg;
            break;
        case 't':
            options->realtime = true;
            break;
        case 'p':
            options->plain = true;
            break;
        case 'h':
            print_help(stdout);
            return 1;
        default:
            print_help(stderr);
            return 3;
        }
    }
    if (optind != argc - 1) {
        (void)fputs("twinlock replay: expected exactly one configuration\n\n", stderr);
        print_help(stderr);
        return 3;
    }
    options->config = argv[optind];
    return 0;
}

/* The same name, or one file by two names. */
static bool is_same_file(const char *one, const char *other) {
    struct stat first;
    struct stat second;
    return strcmp(one, other) == 0 || (stat(one, &first) == 0 && stat(other, &second) == 0 &&
                                       first.st_dev == second.st_dev && first.st_ino == second.st_ino);
}

/* --csv begins its file anew: it must not be one that this run reads or writes. */
static tl_status check_trajectory(const replay_options *options, const char *recording, tl_error *error) {
    const char *taken[] = {options->config, recording, options->database};
    for (size_t i = 0; options->trajectory != NULL && i < sizeof taken / sizeof *taken; i++) {
        if (taken[i] != NULL && is_same_file(options->trajectory, taken[i])) {
            return tl_fail(error, TL_BAD_USAGE, "--csv %s would overwrite %s: give it another name",
                           options->trajectory, taken[i]);
        }
    }
    return TL_OK;
}

static tl_status open_recording(const tl_assembly *assembly, const replay_options *options, tl_recording **recording,
                                tl_error *error) {
    const tl_config *config = &assembly->config;
    char configured[PATH_MAX];
    const char *path = options->recording;
    if (path == NULL && config->recording_file == NULL) {
        return tl_fail(error, TL_BAD_USAGE, "%s names no recording: give one with --recording FILE", config->path);
    }
    if (path == NULL) {
        tl_config_file_path(config, config->recording_file, configured, sizeof configured);
        path = configured;
    }
    tl_status status = check_trajectory(options, path, error);
    return status == TL_OK ? tl_recording_open(path, config, recording, error) : status;
}

static void print_summary(const tl_assembly *assembly, const replay_options *options, const tl_summary *summary) {
    if (options->json) {
        tl_summary_print_json(summary, &assembly->config, assembly->twin, options->output);
    } else if (options->trajectory == NULL || strcmp(options->trajectory, "-") != 0) {
        tl_summary_print_table(summary, &assembly->config, assembly->twin, options->output);
    }
}

/* The recorder, and the watch whose events it gets. They are not logged: who replays has the table. */
static tl_status open_database(const tl_assembly *assembly, const replay_options *options, event_way *way,
                               tl_replay *replay, tl_error *error) {
    tl_status status = tl_assembly_record(assembly, "replay", options->database, true, &replay->recorder, error);
    tl_journal_init(&way->journal, replay->recorder);
    tl_watch_init(&way->watch, &assembly->config, &way->journal);
    replay->watch = &way->watch;
    return status;
}

static tl_status close_database(tl_replay *replay, const char *reason, tl_error *error) {
    tl_recorder_counts counts;
    return replay->recorder == NULL ? TL_OK : tl_recorder_close(replay->recorder, reason, &counts, error);
}

/* Runs, then closes what the run wrote; the first failure counts. */
static tl_status replay_into(const tl_assembly *assembly, const replay_options *options, event_way *way,
                             tl_replay *replay, tl_error *error) {
    tl_summary summary;
    tl_status status = TL_OK;
    if (options->database != NULL) {
        status = open_database(assembly, options, way, replay, error);
    }
    if (status == TL_OK && options->trajectory != NULL) {
        status =
            tl_trajectory_open(options->trajectory, options->output, &assembly->config, &replay->trajectory, error);
    }
    if (status == TL_OK) {
        status = tl_replay_run(replay, &summary, error);
        if (status == TL_OK || status == TL_INTERRUPTED) {
            print_summary(assembly, options, &summary);
            tl_assembly_check_ledger(assembly, replay->recorder);
        }
    }
    tl_error later;
    if (replay->trajectory != NULL &&
        tl_trajectory_close(replay->trajectory, options->output, options->trajectory, &later) != TL_OK &&
        status == TL_OK) {
        *error = later;
        status = later.status;
    }
    const char *reason = status == TL_OK            ? "end of recording"
                         : status == TL_INTERRUPTED ? tl_interrupt_requested()
                                                    : error->text;
    if (close_database(replay, reason, &later) != TL_OK && status == TL_OK) {
        *error = later;
        status = later.status;
    }
    return status;
}

/* With what is too large for a small stack. */
static tl_status replay_and_tell(const tl_assembly *assembly, const replay_options *options, tl_replay *replay,
                                 tl_error *error) {
    event_way *made = calloc(1, sizeof *made);
    if (made == NULL) {
        return tl_fail(error, TL_TRY_AGAIN, "not enough memory");
    }
    tl_status status = replay_into(assembly, options, made, replay, error);
    free(made);
    return status;
}

static tl_status load(const replay_options *options, tl_assembly *assembly) {
    tl_status status = tl_assembly_read(options->config, assembly);
    if (status != TL_OK) {
        return status;
    }
    if (options->plain) {
        assembly->config.saving.structure = false;
        assembly->config.saving.sequences = false;
    }
    return tl_assembly_build(assembly);
}

int tl_verb_replay(int argc, char **argv) {
    replay_options options = {0};
    int parsed = parse(argc, argv, &options);
    if (parsed != 0) {
        return parsed - 1;
    }
    tl_interrupt_install();
    options.output = tl_output_claim();
    tl_assembly assembly;
    tl_error error;
    tl_status status = load(&options, &assembly);
    if (status == TL_OK) {
        tl_replay replay = {.assembly = &assembly, .realtime = options.realtime};
        status = open_recording(&assembly, &options, &replay.recording, &error);
        if (status == TL_OK) {
            status = replay_and_tell(&assembly, &options, &replay, &error);
        }
        tl_recording_close(replay.recording);
        if (status != TL_OK) {
            tl_log(TL_LOG_ERROR, "%s", error.text);
        }
    }
    tl_assembly_free(&assembly);
    return tl_exit_code(tl_output_finish(options.output, status));
}
