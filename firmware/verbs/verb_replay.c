/* twinlock replay: a recording through the twin. */
#include <errno.h>
#include <getopt.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "firmware/base/clock.h"
#include "firmware/base/log.h"
#include "firmware/base/new_file.h"
#include "firmware/fmu/fmu_thread.h"
#include "firmware/plant/recording.h"
#include "firmware/process/fmu_patience.h"
#include "firmware/process/interrupt.h"
#include "firmware/process/process_end.h"
#include "firmware/record/recorder.h"
#include "firmware/report/trajectory.h"
#include "firmware/run/assembly.h"
#include "firmware/run/journal.h"
#include "firmware/run/replay.h"
#include "firmware/run/watch.h"
#include "firmware/text/output.h"
#include "firmware/verbs/verbs.h"

typedef struct replay_options {
    const char *config;
    const char *recording;
    const char *database;
    const char *trajectory;
    const char *report;
    int64_t run; /* of a database; 0: the last one */
    bool json;
    bool realtime;
    bool plain;
    tl_time limit;
    FILE *output;
} replay_options;

/* What is done in the FMUs' thread. */
typedef struct replay_job {
    const replay_options *options;
    tl_status status;
} replay_job;

/* Events on their way to the database and the report. */
typedef struct event_way {
    tl_journal journal;
    tl_watch watch;
} event_way;

static void print_help(FILE *file) {
    (void)fputs("usage: twinlock replay CONFIG [options]\n\n"
                "Runs a recording of the plant through the twin and tells how well they agree. Time budgets are\n"
                "ignored, so the same recording gives the same result to the bit.\n\n"
                "  --recording FILE  a CSV file, or a database that `twinlock run` wrote; default: as configured\n"
                "  --run N           of a database; default: its last run\n"
                "  --json            print one JSON object instead of a table\n"
                "  --db FILE         record into a SQLite database, as `run` does\n"
                "  --csv FILE        write y, ŷ, u and û of every step (\"-\": standard output, without the table)\n"
                "  --report FILE     write a page with key figures, plots and events, for a browser and for paper\n"
                "  --realtime        at the plant's own pace\n"
                "  --plain           execute everything: no saving by structure or sequences; the results are the\n"
                "                    same to the bit\n"
                "  --call-limit S    end with 70 where an FMU does not return from a call for S seconds; default 60\n"
                "  --help            this text\n",
                file);
}

static bool parse_run(const char *text, int64_t *run) {
    char *end = NULL;
    errno = 0;
    *run = strtoll(text, &end, 10);
    if (errno != 0 || end == text || *end != '\0' || *run < 1) {
        (void)fprintf(stderr, "twinlock replay: --run: found \"%s\", expected the number of a run, for example 3\n",
                      text);
        return false;
    }
    return true;
}

/* 0: go on; else the exit code + 1. */
static int parse(int argc, char **argv, replay_options *options) {
    static const struct option LONG[] = {
        {"recording", required_argument, NULL, 'r'},
        {"run", required_argument, NULL, 'n'},
        {"json", no_argument, NULL, 'j'},
        {"db", required_argument, NULL, 'd'},
        {"csv", required_argument, NULL, 'c'},
        {"report", required_argument, NULL, 'R'},
        {"realtime", no_argument, NULL, 't'},
        {"plain", no_argument, NULL, 'p'},
        {"call-limit", required_argument, NULL, 'L'},
        {"help", no_argument, NULL, 'h'},
        {NULL, 0, NULL, 0},
    };
    for (int option = 0; (option = getopt_long(argc, argv, "h", LONG, NULL)) != -1;) {
        switch (option) {
        case 'r':
            options->recording = optarg;
            break;
        case 'n':
            if (!parse_run(optarg, &options->run)) {
                return 3;
            }
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
        case 'R':
            options->report = optarg;
            break;
        case 't':
            options->realtime = true;
            break;
        case 'p':
            options->plain = true;
            break;
        case 'L':
            if (!tl_fmu_patience_parse("replay", optarg, &options->limit)) {
                return 3;
            }
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

/* What begins its file anew must not be given one that this run reads or writes. */
static tl_status check_output(const char *option, const char *path, const char *const *taken, size_t count,
                              tl_error *error) {
    for (size_t i = 0; path != NULL && i < count; i++) {
        if (taken[i] != NULL && tl_new_file_is(path, taken[i])) {
            return tl_fail(error, TL_BAD_USAGE, "%s %s would overwrite %s: give it another name", option, path,
                           taken[i]);
        }
    }
    return TL_OK;
}

static tl_status check_outputs(const replay_options *options, const char *recording, tl_error *error) {
    const char *const taken[] = {options->config, recording, options->database, options->trajectory};
    tl_status status = check_output("--csv", options->trajectory, taken, 3, error);
    return status == TL_OK ? check_output("--report", options->report, taken, 4, error) : status;
}

/* Where the recording is goes to `path`. */
static tl_status find_recording(const tl_config *config, const replay_options *options, char path[PATH_MAX],
                                tl_error *error) {
    if (options->recording != NULL) {
        (void)snprintf(path, PATH_MAX, "%s", options->recording);
        return TL_OK;
    }
    if (config->recording_file == NULL) {
        return tl_fail(error, TL_BAD_USAGE, "%s names no recording: give one with --recording FILE", config->path);
    }
    tl_config_file_path(config, config->recording_file, path, PATH_MAX);
    return TL_OK;
}

static tl_status open_recording(const tl_assembly *assembly, const replay_options *options, char path[PATH_MAX],
                                tl_recording **recording, tl_error *error) {
    tl_status status = find_recording(&assembly->config, options, path, error);
    if (status == TL_OK) {
        status = check_outputs(options, path, error);
    }
    return status == TL_OK ? tl_recording_open(path, &assembly->config, recording, error) : status;
}

static void print_summary(const tl_assembly *assembly, const replay_options *options, const tl_summary *summary) {
    if (options->json) {
        tl_summary_print_json(summary, &assembly->config, assembly->twin, options->output);
    } else if (options->trajectory == NULL || strcmp(options->trajectory, "-") != 0) {
        tl_summary_print_table(summary, &assembly->config, assembly->twin, options->output);
    }
}

/* The process ends while an FMU has not returned. What was recorded is on the disk after a commit or two. */
static void keep(void *context, const char *why) {
    const tl_replay *replay = context;
    if (replay->recorder != NULL) {
        tl_recorder_event(replay->recorder, -1, TL_EVENT_ERROR, "twin", why);
        tl_clock_sleep_until(tl_clock_now(NULL) + 2 * replay->assembly->config.record_commit);
    }
    tl_replay_report_close(replay->report);
}

/* The recorder and the report, and the watch whose events they get. These are not logged: who replays has the table. */
static tl_status open_outputs(const tl_assembly *assembly, const replay_options *options, const char *recording,
                              event_way *way, tl_replay *replay, tl_error *error) {
    tl_status status = TL_OK;
    if (options->database != NULL) {
        status = tl_assembly_record(assembly, "replay", options->database, true, NULL, &replay->recorder, error);
    }
    if (status == TL_OK && options->report != NULL) {
        status = tl_replay_report_open(assembly, options->report, recording, &replay->report, error);
    }
    if (status == TL_OK && options->trajectory != NULL) {
        status =
            tl_trajectory_open(options->trajectory, options->output, &assembly->config, &replay->trajectory, error);
    }
    tl_journal_init(&way->journal, replay->recorder);
    tl_watch_init(&way->watch, &assembly->config, &way->journal);
    if (replay->report != NULL) {
        tl_replay_report_listen(replay->report, &way->journal);
    }
    replay->watch = replay->recorder != NULL || replay->report != NULL ? &way->watch : NULL;
    tl_process_keep(keep, replay);
    return status;
}

/* The first failure counts. */
static tl_status first_of(tl_status status, tl_status later_status, const tl_error *later, tl_error *error) {
    if (status == TL_OK && later_status != TL_OK) {
        *error = *later;
        return later_status;
    }
    return status;
}

static tl_status close_outputs(const replay_options *options, tl_replay *replay, tl_status status, tl_error *error) {
    tl_error later;
    tl_process_keep(NULL, NULL);
    if (replay->trajectory != NULL) {
        tl_status closed = tl_trajectory_close(replay->trajectory, options->output, options->trajectory, &later);
        status = first_of(status, closed, &later, error);
    }
    const char *reason = status == TL_OK            ? "end of recording"
                         : status == TL_INTERRUPTED ? tl_interrupt_requested()
                                                    : error->text;
    if (replay->recorder != NULL) {
        tl_recorder_counts counts;
        tl_status closed = tl_recorder_close(replay->recorder, reason, &counts, &later);
        status = first_of(status, closed, &later, error);
    }
    tl_replay_report_close(replay->report);
    return status;
}

/* Of a run that came to its end, or was interrupted. */
static tl_status tell(const tl_assembly *assembly, const replay_options *options, const tl_replay *replay,
                      const tl_summary *summary, tl_status status, tl_error *error) {
    tl_error later;
    print_summary(assembly, options, summary);
    tl_assembly_check_ledger(assembly, replay->recorder);
    if (replay->report != NULL) {
        const char *ended = status == TL_OK ? "end of recording" : error->text;
        tl_status kept = tl_replay_report_keep(replay->report, summary, ended, &later);
        status = first_of(status, kept, &later, error);
    }
    return status;
}

/* Runs, then closes what the run wrote. */
static tl_status replay_into(const tl_assembly *assembly, const replay_options *options, const char *recording,
                             event_way *way, tl_replay *replay, tl_error *error) {
    tl_summary summary;
    tl_status status = open_outputs(assembly, options, recording, way, replay, error);
    if (status == TL_OK) {
        status = tl_replay_run(replay, &summary, error);
        if (status == TL_OK || status == TL_INTERRUPTED) {
            status = tell(assembly, options, replay, &summary, status, error);
        }
    }
    return close_outputs(options, replay, status, error);
}

/* With what is too large for a small stack. */
static tl_status replay_and_tell(const tl_assembly *assembly, const replay_options *options, const char *recording,
                                 tl_replay *replay, tl_error *error) {
    event_way *made = calloc(1, sizeof *made);
    if (made == NULL) {
        return tl_fail(error, TL_TRY_AGAIN, "not enough memory");
    }
    tl_status status = replay_into(assembly, options, recording, made, replay, error);
    free(made);
    return status;
}

static tl_status load(const replay_options *options, tl_assembly *assembly) {
    tl_status status = tl_assembly_read(options->config, assembly);
    if (status != TL_OK) {
        return status;
    }
    assembly->config.recording_run = options->run;
    if (options->plain) {
        assembly->config.saving.structure = false;
        assembly->config.saving.sequences = false;
    }
    return tl_assembly_build(assembly);
}

static void replay(void *context) {
    replay_job *job = context;
    const replay_options *options = job->options;
    tl_assembly assembly;
    tl_error error;
    job->status = load(options, &assembly);
    if (job->status == TL_OK) {
        tl_replay replay = {.assembly = &assembly, .realtime = options->realtime};
        char recording[PATH_MAX];
        job->status = open_recording(&assembly, options, recording, &replay.recording, &error);
        if (job->status == TL_OK) {
            job->status = replay_and_tell(&assembly, options, recording, &replay, &error);
        }
        tl_recording_close(replay.recording);
        if (job->status != TL_OK) {
            tl_log(TL_LOG_ERROR, "%s", error.text);
        }
    }
    (void)fflush(options->output); /* an FMU may crash in being freed */
    tl_assembly_free(&assembly);
}

int tl_verb_replay(int argc, char **argv) {
    replay_options options = {.limit = TL_FMU_PATIENCE_CALL};
    int parsed = parse(argc, argv, &options);
    if (parsed != 0) {
        return parsed - 1;
    }
    tl_interrupt_install();
    options.output = tl_output_claim();
    replay_job job = {.options = &options};
    tl_status status = tl_fmu_thread_run(options.limit, replay, &job);
    return tl_exit_code(tl_output_finish(options.output, status == TL_OK ? job.status : status));
}
