/* Options of the command line: see options.h. */
#include "firmware/cli/options.h"

#include <ctype.h>
#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "firmware/base/change.h"
#include "firmware/base/os.h"
#include "firmware/base/text.h"
#include "firmware/process/fmu_call_timeout.h"
#include "firmware/report/show.h"

/* ---- values ---- */

static const double MOST_SECONDS = 1e9;
static const double MOST_WHOLE_SECONDS = 3600;
static const double MOST_PERCENT = 100;
enum { LEAST_MEBIBYTES = 64, MOST_MEBIBYTES = 1 << 20 };

/* Names of the tables of `show --csv`, by tl_show_csv_table. */
static const char *const TABLES[] = {
    [TL_SHOW_OUTPUTS] = "outputs", [TL_SHOW_ADJUSTMENTS] = "adjustments", [TL_SHOW_STEPS] = "steps",
    [TL_SHOW_SAMPLES] = "samples", [TL_SHOW_EVENTS] = "events",
};

/* Returns false if the text is not a number, or out of the range of a double. */
static bool read_double(const char *text, double *number) {
    char *end = NULL;
    errno = 0;
    *number = strtod(text, &end);
    return errno == 0 && end != text && *end == '\0';
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

/* Parses for example "90s", "15m", "8h", "2d". */
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
    const int count = sizeof TABLES / sizeof TABLES[0];
    int i = 0;
    while (i < count && strcmp(text, TABLES[i]) != 0) {
        i++;
    }
    *(int *)target = i;
    return i < count;
}

/* If the option is given twice, the lower right counts. So a caller that can only append arguments
 * to a limited command line cannot raise its right. */
static bool read_right(const char *text, void *target) {
    uint32_t *least = target;
    tl_change_right right = TL_RIGHT_READ;
    bool is_right = tl_change_right_of(text, &right);
    *least = is_right && right < *least ? right : *least;
    return is_right;
}

/* ---- option table ---- */

const tl_verb_row tl_verb_rows[TL_VERB_COUNT] = {
    [TL_VERB_CHECK] =
        {"check", "CONFIG [options]", "configuration", "validate a configuration and its FMUs without running",
         "Validates a configuration with its FMUs: keys, variables, types, units, connections, paths,\n"
         "horizon. Tells what a step will cost, in executions and, by a short dry run, in time. Warns of\n"
         "what is right and perhaps not meant. Nothing is read from the plant."},
    [TL_VERB_REPLAY] =
        {"replay", "CONFIG [options]", "configuration", "run a recording through the twin, as fast as it can",
         "Runs a recording of the plant through the twin and tells how well they agree. Time budgets are\n"
         "ignored, so the same recording gives the same result to the bit."},
    [TL_VERB_RUN] = {"run", "CONFIG [options]", "configuration", "keep the twin locked to the plant, in real time",
                     "Keeps the twin locked to the plant in real time, until SIGTERM or Ctrl-C, or for the configured\n"
                     "duration. It only listens: nothing it does can reach the plant."},
    [TL_VERB_PLANT] =
        {"plant", "CONFIG [options]", "configuration", "play a recording or a plant model as a real plant",
         "Plays a plant in real time, for demonstrations and tests: the recording of CONFIG, or, if CONFIG\n"
         "has \"emulate\", its FMUs as the true plant with seeded noise. Its signals are served by Modbus TCP\n"
         "at the addresses where the configuration reads them (playing starts with the first request), sent\n"
         "as CAN frames, or written into a FIFO; not by Modbus RTU, nor of GPIO lines."},
    [TL_VERB_SHOW] =
        {"show", "DATABASE [options]", "database", "show what was corrected, when and why",
         "Shows what a run that was recorded had to correct, when and why: how well the twin followed, Δu per\n"
         "adjusted variable and since when, events. Works while the run is going on."},
    [TL_VERB_RELOAD] =
        {"reload", "CONFIG [options]", "configuration", "bring a changed configuration into a running plant's twin",
         "Hands a changed configuration to the run that was started with it and with --control. CONFIG \"-\" is\n"
         "standard input. At most 262144 bytes are read, held against the configuration in force, and\n"
         "activated: tolerances, weights, bounds, penalties and budgets in place; what takes another twin by a\n"
         "twin that runs beside the run's first, and takes over between two ticks; all else by a restart of\n"
         "the run, with a gap, if --restart allows that. It is on probation then, and returned from by itself\n"
         "if deadlines are missed or the lock is lost."},
};

enum {
    CHECK = 1 << TL_VERB_CHECK,
    REPLAY = 1 << TL_VERB_REPLAY,
    RUN = 1 << TL_VERB_RUN,
    PLANT = 1 << TL_VERB_PLANT,
    SHOW = 1 << TL_VERB_SHOW,
    RELOAD = 1 << TL_VERB_RELOAD,
    EVERY = (1 << TL_VERB_COUNT) - 1
};

#define SETS(member) .offset = offsetof(tl_options, member)

static const tl_option OPTIONS[] = {
    {CHECK, "variables", NULL, tl_option_switch, SETS(variables), .help = "list all variables of the FMUs"},
    {CHECK, "recording", "FILE", tl_option_text, SETS(recording),
     .help =
         "instead: look through a recording, as `replay` takes it, and propose between,\ncondition and tolerance by its noise and message times; no FMU is loaded"},
    {PLANT, "for", "CONFIG2", tl_option_text, SETS(listener),
     .help = "serve what this configuration reads; default: CONFIG itself"},
    {REPLAY, "recording", "FILE", tl_option_text, SETS(recording),
     .help = "a CSV file, or a database that `twinlock run` wrote; default: as configured"},
    {PLANT, "recording", "FILE", tl_option_text, SETS(recording),
     .help = "the CSV file to play; with \"emulate\", what drives the FMUs; default: as\nconfigured"},
    {REPLAY, "run", "N", read_run, SETS(run), .help = "of a database; default: its last run",
     .expected = "the number of a run, for example 3"},
    {CHECK, "run", "N", read_run, SETS(run), .needs = "recording",
     .help = "with --recording: of a database; default: its last run",
     .expected = "the number of a run, for example 3"},
    {CHECK, "json", NULL, tl_option_switch, SETS(json), .needs = "recording",
     .help = "with --recording: print one JSON object"},
    {SHOW, "run", "N|last", read_run_or_last, SETS(run), .help = "which run; default: the last one",
     .expected = "the number of a run, for example 3, or last"},
    {SHOW, "since", "TIME", read_since, SETS(since),
     .help = "only what came after: a date (UTC: 2026-11-21, 2026-11-21T10:02), or how far back\n"
             "from the run's end (90s, 15m, 8h, 2d)",
     .expected = "a date such as 2026-11-21T10:02, or 90s, 15m, 8h, 2d"},
    {SHOW, "events", NULL, tl_option_switch, SETS(events), .help = "all events, not only the last ten"},
    {REPLAY, "json", NULL, tl_option_switch, SETS(json), .help = "print one JSON object instead of a table"},
    {SHOW, "json", NULL, tl_option_switch, SETS(json), .help = "print one JSON object", .alone = true},
    {REPLAY | RUN | SHOW, "verbose", NULL, tl_option_switch, SETS(verbose),
     .help = "also outcomes, executions, the ledger and MSEs"},
    {REPLAY, "db", "FILE", tl_option_text, SETS(database), .help = "record into a SQLite database, as `run` does"},
    {RUN, "db", "FILE", tl_option_text, SETS(database),
     .help = "record into this SQLite database; default: as configured"},
    {REPLAY, "csv", "FILE", tl_option_text, SETS(trajectory),
     .help = "write y, ŷ, u and û of every step (\"-\": standard output, without the table)"},
    {SHOW, "csv", "TABLE", read_table, SETS(table),
     .help = "print a table as CSV: outputs, adjustments, steps, samples or events",
     .expected = "outputs, adjustments, steps, samples or events", .alone = true},
    {REPLAY, "report", "FILE", tl_option_text, SETS(report),
     .help = "write a page with key figures, plots and events, for a browser and for paper"},
    {SHOW, "report", "FILE", tl_option_text, SETS(report),
     .help = "write a page with key figures, plots and events, for a browser and for paper", .alone = true},
    {REPLAY, "realtime", NULL, tl_option_switch, SETS(realtime), .help = "at the plant's own pace"},
    {REPLAY, "plain", NULL, tl_option_switch, SETS(plain),
     .help = "execute everything: no saving by structure or sequences; the results are the\nsame to the bit"},
    {RUN, "duration", "S", read_seconds, SETS(duration_s), .help = "end after S seconds of plant time",
     .expected = "seconds > 0 and below 1e9, for example 14"},
    {RUN, "status", NULL, tl_option_switch, SETS(status),
     .help = "a status line per second also if the output is no terminal"},
    {RUN, "json", NULL, tl_option_switch, SETS(json), .help = "print the summary as one JSON object at the end"},
    {REPLAY | RUN, "require-lock", "PERCENT", read_percent, SETS(require_lock),
     .help = "end with 3 unless the twin was in lock in at least so much of the steps;\n"
             "without this option, unless it was at some time",
     .expected = "a percentage above 0, at most 100, for example 95"},
    {RUN, "supervise", NULL, tl_option_switch, SETS(supervise), .alone = true,
     .help = "start the twin again if it hangs or dies, and without FMUs after a restart\n"
             "loop (safe hold); tell systemd, if that started it"},
    {RUN, "state", "DIR", tl_option_text, SETS(state), .needs = "supervise",
     .help =
         "with --supervise: count restarts in DIR/supervisor.json, across resets of the\nbox, and try what FMUs save before it is needed"},
    {RUN, "control", "SOCKET", tl_option_text, SETS(control), .needs = "state",
     .help = "with --state: take changed configurations by this socket; versions are kept\nin DIR/versions"},
    {RUN, "allowed", "FILE", tl_option_text, SETS(allowed), .needs = "control",
     .help =
         "with --control: names of files and libraries that a configuration from the\nnetwork may have, lines \"file NAME\", \"library NAME\"; default:\n/etc/twinlock/allowed"},
    {RELOAD, "control", "SOCKET", tl_option_text, SETS(control),
     .help = "of the run; default: /run/twinlock/NAME/control, NAME being that of the file;\nneeded with \"-\""},
    {RELOAD, "right", "RIGHT", read_right, SETS(right),
     .help = "ask with this right only: read, retune or commission; default: all that the box\nmay",
     .expected = "read, retune or commission"},
    {RELOAD, "no-activate", NULL, tl_option_switch, SETS(only_check), .changes = true,
     .help = "all steps but the activation"},
    {RELOAD, "restart", NULL, tl_option_switch, SETS(restart), .changes = true,
     .help = "end the run and begin anew for what needs that, or if the box does not carry\nboth twins"},
    {RELOAD, "shadow", "S", read_whole_seconds, SETS(shadow_s), .changes = true,
     .help = "whole seconds for which another twin runs beside the run's before it takes\nover; default 60",
     .expected = "whole seconds from 1 to 3600, for example 60"},
    {RELOAD, "accept-worse", NULL, tl_option_switch, SETS(accept_worse), .changes = true,
     .help = "let another twin take over also if an output is more than twice as far off as\n"
             "the run's, and out of its tolerance"},
    {RELOAD, "probation", "S", read_whole_seconds, SETS(probation_s), .changes = true,
     .help = "whole seconds in which it has to prove itself; default 300",
     .expected = "whole seconds from 1 to 3600, for example 60"},
    {RELOAD, "require-lock", "PERCENT", read_percent, SETS(keep_lock), .changes = true,
     .help = "keep it if the twin was in lock in at least so much of the probation's\nsteps; default 95",
     .expected = "a percentage above 0, at most 100, for example 95"},
    {RELOAD, "until-confirmed", NULL, tl_option_switch, SETS(until_confirmed), .changes = true,
     .help = "keep it only if somebody confirms it during the probation"},
    {RELOAD, "wait", NULL, tl_option_switch, SETS(wait), .changes = true,
     .help = "end when it is kept, or returned from; also over a restart"},
    {RELOAD, "why", "TEXT", tl_option_text, SETS(why), .changes = true,
     .help = "a word to those who look at the versions later"},
    {RELOAD, "confirm", NULL, tl_option_switch, SETS(confirm), .alone = true, .only = true,
     .help = "keep the version that is on probation; nothing is sent"},
    {RELOAD, "rollback", NULL, tl_option_switch, SETS(rollback), .alone = true,
     .help = "bring the version before back, or cancel a change that is under way; nothing is\nsent"},
    {RELOAD, "version", "N", read_number, SETS(version), .needs = "rollback", .help = "with --rollback: which version",
     .expected = "the number of a version, see --versions"},
    {RELOAD, "versions", NULL, tl_option_switch, SETS(versions), .alone = true, .only = true,
     .help = "list what is kept, and what was refused last"},
    {RELOAD, "state", NULL, tl_option_switch, SETS(show), .alone = true, .only = true, .help = "say how the run is"},
    {RUN, "watchdog", "DEVICE", tl_option_text, SETS(watchdog), .needs = "supervise",
     .help = "with --supervise: stroke this watchdog (/dev/watchdog) while the twin is alive"},
    {RUN, "watchdog-timeout", "S", read_whole_seconds, SETS(watchdog_s), .needs = "watchdog",
     .help = "whole seconds after which it resets the box; default 30",
     .expected = "whole seconds from 1 to 3600, for example 30"},
    {PLANT, "fifo", "FILE", tl_option_text, SETS(fifo), .alone = true,
     .help = "write rows into this FIFO instead (made if it does not exist)"},
    {PLANT, "record", "FILE", tl_option_text, SETS(record), .alone = true,
     .help = "write all rows into a new CSV file, as fast as possible, and end"},
    {PLANT, "real-bus", NULL, tl_option_switch, SETS(real_bus),
     .help = "send CAN frames on an interface that is hardware, too; default: vcan only"},
    {PLANT, "seed", "N", read_number, SETS(seed), .help = "of the noise and the message times; default 1",
     .expected = "a whole number"},
    {CHECK | REPLAY | PLANT, "call-limit", "S", read_seconds, SETS(call_limit_s),
     .help = "end with 70 if an FMU does not return from a call for S seconds; default 60",
     .expected = "seconds > 0 and below 1e9, for example 600"},
    {RUN, "call-limit", "S", read_seconds, SETS(call_limit_s), .alone = true,
     .help = "without --supervise: end with 70 if the FMUs hang for ten times S seconds;\ndefault 60",
     .expected = "seconds > 0 and below 1e9, for example 600"},
    {CHECK | REPLAY | PLANT | RUN, "memory-limit", "MIB", read_mebibytes, SETS(memory_limit_mib),
     .help = "how much memory the process of the FMUs may take; default: half of the\nmachine's, at most 4096",
     .expected = "MiB from 64 to 1048576, for example 2048"},
    {CHECK | REPLAY | PLANT | RUN, "unconfined", NULL, tl_option_switch, SETS(unconfined),
     .help = "let FMUs do what this user can: files, network, programs; for FMUs that\nneed it, and are trusted"},
    {EVERY, "help", .help = "this text"},
};

/* Option names up to this width have their help on the same line. */
const tl_option_table tl_verb_table = {.verbs = tl_verb_rows,
                                       .verb_count = TL_VERB_COUNT,
                                       .options = OPTIONS,
                                       .option_count = sizeof OPTIONS / sizeof OPTIONS[0],
                                       .widest = 16};

/* ---- the command line ---- */

tl_options_outcome tl_options_read(tl_verb verb, int argc, char **argv, tl_options *options) {
    char **words = NULL;
    size_t count = 0;
    *options = (tl_options){
        .call_limit_s = tl_seconds(TL_FMU_CALL_TIMEOUT_CALL),
        .watchdog_s = 30,
        .seed = 1,
        .table = TL_OPTIONS_NO_TABLE,
        .right = TL_RIGHT_BOX,
    };
    tl_options_outcome outcome = tl_program_options_read(&tl_verb_table, verb, argc, argv, options, &words, &count);
    options->subject = outcome == TL_OPTIONS_READ ? words[0] : NULL;
    return outcome;
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
