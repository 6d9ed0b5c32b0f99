/* twinlock run: the appliance. */
#include <errno.h>
#include <getopt.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include "firmware/assembly.h"
#include "firmware/clock.h"
#include "firmware/cycle.h"
#include "firmware/interrupt.h"
#include "firmware/journal.h"
#include "firmware/live_plant.h"
#include "firmware/log.h"
#include "firmware/output.h"
#include "firmware/realtime.h"
#include "firmware/resume.h"
#include "firmware/verbs.h"

typedef struct run_options {
    const char *config;
    const char *database;
    double duration_s; /* 0: as configured */
    bool json;
    bool status;
    FILE *output;
} run_options;

/* Everything that is open while the appliance runs. */
typedef struct appliance {
    const run_options *options;
    tl_assembly assembly;
    tl_journal journal;
    tl_recorder *recorder;
    tl_live_plant *plant;
    tl_cycle *cycle;
    tl_summary resumed; /* what was done to go on with an earlier run */
} appliance;

/* How long the start waits for a first reading of every signal. */
static const tl_time FIRST_READING = 2 * TL_SECOND;

static void print_help(FILE *file) {
    (void)fputs("usage: twinlock run CONFIG [options]\n\n"
                "Keeps the twin locked to the plant in real time, until SIGTERM or Ctrl-C, or for the configured\n"
                "duration.\n"
                "It only listens: nothing it does can reach the plant.\n\n"
                "  --db FILE      record into this SQLite database; default: as configured\n"
                "  --duration S   end after S seconds of plant time\n"
                "  --status       a status line per second also where the output is no terminal\n"
                "  --json         print the summary as one JSON object at the end\n"
                "  --help         this text\n",
                file);
}

static bool parse_duration(const char *text, double *duration) {
    char *end = NULL;
    errno = 0;
    *duration = strtod(text, &end);
    return errno == 0 && end != text && *end == '\0' && *duration > 0.0 && *duration < 1e9;
}

/* 0: go on; else the exit code + 1. */
static int parse(int argc, char **argv, run_options *options) {
    static const struct option LONG[] = {
        {"db", required_argument, NULL, 'd'}, {"duration", required_argument, NULL, 'n'},
        {"status", no_argument, NULL, 's'},   {"json", no_argument, NULL, 'j'},
        {"help", no_argument, NULL, 'h'},     {NULL, 0, NULL, 0},
    };
    for (int option = 0; (option = getopt_long(argc, argv, "h", LONG, NULL)) != -1;) {
        switch (option) {
        case 'd':
            options->database = optarg;
            break;
        case 'n':
            if (!parse_duration(optarg, &options->duration_s)) {
                (void)fprintf(
                    stderr,
                    "twinlock run: --duration: found \"%s\", expected seconds > 0 and below 1e9, for example 14\n",
                    optarg);
                return 3;
            }
            break;
        case 's':
            options->status = true;
            break;
        case 'j':
            options->json = true;
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
        (void)fputs("twinlock run: expected exactly one configuration\n\n", stderr);
        print_help(stderr);
        return 3;
    }
    options->config = argv[optind];
    return 0;
}

static void on_link(void *context, const char *source, bool up, const char *text) {
    appliance *self = context;
    tl_journal_event(&self->journal, -1, up ? TL_EVENT_INFO : TL_EVENT_WARNING, "plant", "%s: %s", source, text);
}

/* False: nothing is recorded. */
static bool find_database(const appliance *self, char path[PATH_MAX]) {
    const tl_config *config = &self->assembly.config;
    if (self->options->database != NULL) {
        (void)snprintf(path, PATH_MAX, "%s", self->options->database);
    } else if (config->record_file != NULL) {
        tl_config_file_path(config, config->record_file, path, PATH_MAX);
    }
    return self->options->database != NULL || config->record_file != NULL;
}

static tl_status open_recorder(appliance *self, tl_error *error) {
    char path[PATH_MAX];
    return find_database(self, path) ? tl_assembly_record(&self->assembly, "run", path, false, &self->recorder, error)
                                     : TL_OK;
}

/* To where the run before was ended. An attempt that failed on its way has left a run of its own. */
static tl_status resume(appliance *self, tl_error *error) {
    char path[PATH_MAX];
    bool spoilt = false;
    if (!find_database(self, path)) {
        return TL_OK;
    }
    const tl_resume_settings settings = {
        .assembly = &self->assembly, .path = path, .recorder = self->recorder, .journal = &self->journal};
    tl_status status = tl_resume(&settings, &self->resumed, &spoilt, error);
    if (status == TL_OK && spoilt) {
        self->journal.recorder = NULL;
        status = tl_recorder_close(self->recorder, "could not go on with an earlier run", NULL, error);
        self->recorder = NULL;
        status = status == TL_OK ? open_recorder(self, error) : status;
        self->journal.recorder = self->recorder;
    }
    return status;
}

/* A sample without unknown values is a better start; a dead device must not prevent one. */
static void wait_for_readings(const appliance *self) {
    tl_time until = tl_clock_now(NULL) + FIRST_READING;
    while (tl_clock_now(NULL) < until && tl_interrupt_requested() == NULL && !tl_live_plant_is_complete(self->plant)) {
        tl_clock_sleep_until(tl_clock_now(NULL) + TL_SECOND / 100);
    }
}

static tl_status open_all(appliance *self, tl_error *error) {
    const tl_config *config = &self->assembly.config;
    tl_status status = open_recorder(self, error);
    if (status != TL_OK) {
        return status;
    }
    tl_journal_init(&self->journal, self->recorder);
    status = tl_live_plant_open(config, on_link, self, &self->plant, error);
    if (status != TL_OK) {
        return status;
    }
    if (self->recorder == NULL) { /* said only of a run that begins */
        tl_log(TL_LOG_NOTICE,
               "nothing is recorded: the configuration has no \"record\", and no --db was given; after a restart "
               "the twin begins anew");
    }
    status = resume(self, error);
    if (status != TL_OK) {
        return status;
    }
    wait_for_readings(self);
    if (config->realtime_lock_memory) {
        tl_realtime_lock_memory(&self->journal);
    }
    const tl_cycle_settings settings = {
        .assembly = &self->assembly,
        .input = tl_live_plant_input(self->plant),
        .recorder = self->recorder,
        .journal = &self->journal,
        .resumed = self->resumed,
    };
    return tl_cycle_start(&settings, &self->cycle, error);
}

/* Writes what the terminal has columns for: a line that wraps cannot be redrawn. Two are left for the ^C that the terminal
 * itself writes behind it. */
static void print_cut(const char *line) {
    struct winsize size = {0};
    size_t columns = ioctl(STDERR_FILENO, TIOCGWINSZ, &size) == 0 && size.ws_col > 3 ? size.ws_col - 3U : 77U;
    size_t end = 0;
    for (size_t shown = 0; line[end] != '\0'; end++) {
        bool begins_character = ((unsigned char)line[end] & 0xc0U) != 0x80U;
        if (begins_character && shown++ == columns) {
            break;
        }
    }
    (void)fprintf(stderr, "\r\033[K%.*s", (int)end, line);
}

/* What matters first: the end is cut off where the terminal is narrow. */
static void print_status(const appliance *self, const tl_cycle_status *status, bool terminal) {
    const tl_config *config = &self->assembly.config;
    const tl_record *record = &status->record;
    char line[512];
    int length = snprintf(line, sizeof line, "%8.2f s", tl_seconds(tl_time_of_step(0, config->step, record->step + 1)));
    for (size_t i = 0; i < config->adjust_count && i < 2; i++) {
        length += snprintf(line + length, sizeof line - (size_t)length, "  \316\224%.63s %+.4g",
                           config->adjust[i].variable, record->u[i] - record->u_hat[i]);
    }
    length += snprintf(line + length, sizeof line - (size_t)length, "  %-12s", tl_outcome_name(record->outcome));
    for (size_t i = 0; i < config->match_count && i < 2; i++) {
        length += snprintf(line + length, sizeof line - (size_t)length, "  %.63s %.4g (plant %.4g)",
                           config->match[i].variable, record->y[i], record->y_hat[i]);
    }
    (void)snprintf(line + length, sizeof line - (size_t)length, "  %.2f ms  skipped %llu",
                   tl_seconds(record->used) * 1e3, (unsigned long long)status->skipped);
    if (terminal) {
        print_cut(line);
    } else {
        (void)fprintf(stderr, "%s\n", line);
    }
    (void)fflush(stderr);
}

/* Watches until the cycle ends or a signal comes; the cycle needs nothing of this. */
static void look_on(appliance *self) {
    bool terminal = isatty(STDERR_FILENO) == 1;
    tl_time interval = terminal ? TL_SECOND / 10 : TL_SECOND;
    tl_time next = tl_clock_now(NULL) + interval;
    tl_cycle_status status = {0};
    while (tl_interrupt_requested() == NULL && !status.ended) {
        tl_clock_sleep_until(tl_clock_now(NULL) + TL_SECOND / 20);
        if (terminal && tl_journal_has_events(&self->journal)) {
            (void)fputs("\r\033[K", stderr); /* an event begins its own line */
        }
        tl_journal_drain(&self->journal);
        if (tl_cycle_status_now(self->cycle, &status) && status.steps != 0 && tl_clock_now(NULL) >= next &&
            (terminal || self->options->status)) {
            print_status(self, &status, terminal);
            next += interval;
        }
    }
    if (terminal) {
        (void)fputs("\r\033[K", stderr);
    }
}

static tl_status close_all(appliance *self, tl_status status, tl_summary *summary, tl_error *error) {
    tl_error later;
    if (self->cycle != NULL) {
        tl_status cycle_status = tl_cycle_stop(self->cycle, summary, &later);
        if (cycle_status != TL_OK && status == TL_OK) {
            *error = later;
            status = cycle_status;
            tl_journal_event(&self->journal, -1, TL_EVENT_ERROR, "twin", "%s", later.text);
        }
        tl_assembly_check_ledger(&self->assembly, self->recorder);
    }
    tl_live_plant_close(self->plant);
    if (self->recorder != NULL) {
        tl_recorder_counts counts;
        const char *signal = tl_interrupt_requested();
        const char *reason = status != TL_OK ? error->text : signal != NULL ? signal : "end of duration";
        tl_status closed = tl_recorder_close(self->recorder, reason, &counts, &later);
        if (closed != TL_OK && status == TL_OK) {
            *error = later;
            status = closed;
        }
        self->journal.recorder = NULL;
    }
    tl_journal_drain(&self->journal);
    return status;
}

static tl_status run(appliance *self) {
    tl_error error = {0};
    tl_summary summary = {0};
    tl_time started = tl_clock_now(NULL);
    tl_status status = open_all(self, &error);
    if (status == TL_OK) {
        look_on(self);
    }
    bool ran = self->cycle != NULL;
    status = close_all(self, status, &summary, &error);
    summary.wall_s = tl_seconds(tl_clock_now(NULL) - started);
    if (ran && self->options->json) {
        tl_summary_print_json(&summary, &self->assembly.config, self->assembly.twin, self->options->output);
    } else if (ran) {
        tl_summary_print_table(&summary, &self->assembly.config, self->assembly.twin, self->options->output);
    }
    if (status != TL_OK) {
        tl_log(TL_LOG_ERROR, "%s", error.text);
    }
    return status;
}

int tl_verb_run(int argc, char **argv) {
    run_options options = {0};
    int parsed = parse(argc, argv, &options);
    if (parsed != 0) {
        return parsed - 1;
    }
    tl_interrupt_install();
    options.output = tl_output_claim();
    appliance *self = calloc(1, sizeof *self);
    if (self == NULL) {
        tl_log(TL_LOG_ERROR, "not enough memory");
        return tl_exit_code(TL_TRY_AGAIN);
    }
    self->options = &options;
    tl_status status = tl_assembly_load(options.config, &self->assembly);
    if (status == TL_OK) {
        if (options.duration_s > 0.0) {
            self->assembly.config.duration = tl_time_of_seconds(options.duration_s);
        }
        status = run(self);
    }
    tl_assembly_free(&self->assembly);
    free(self);
    return tl_exit_code(tl_output_finish(options.output, status));
}
