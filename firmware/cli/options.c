/* Options of the command line: their table, reading and help: see options.h. */
#include "firmware/cli/options.h"

#include <ctype.h>
#include <errno.h>
#include <getopt.h>
#include <math.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include "firmware/base/change.h"
#include "firmware/base/os.h"
#include "firmware/base/text.h"
#include "firmware/cli/verb_program.h"
#include "firmware/process/fmu_patience.h"
#include "firmware/report/show.h"
#include "master/base/nearest.h"

/* ---- option table ---- */

/* A name and its value beyond this width have a line of their own. */
enum { WIDEST = 16, EXITS_OF_A_LINE = 4 };

const tl_verb_row tl_verb_rows[TL_VERB_COUNT] = {
    [TL_VERB_CHECK] =
        {"check", "CONFIG", "configuration", "validate a configuration and its FMUs without running",
         "Validates a configuration with its FMUs: keys, variables, types, units, connections, paths,\n"
         "horizon. Tells what a step will cost, in executions and, by a short dry run, in time. Warns of\n"
         "what is right and perhaps not meant. Nothing is read from the plant."},
    [TL_VERB_REPLAY] =
        {"replay", "CONFIG", "configuration", "run a recording through the twin, as fast as it can",
         "Runs a recording of the plant through the twin and tells how well they agree. Time budgets are\n"
         "ignored, so the same recording gives the same result to the bit."},
    [TL_VERB_RUN] = {"run", "CONFIG", "configuration", "keep the twin locked to the plant, in real time",
                     "Keeps the twin locked to the plant in real time, until SIGTERM or Ctrl-C, or for the configured\n"
                     "duration. It only listens: nothing it does can reach the plant."},
    [TL_VERB_PLANT] =
        {"plant", "CONFIG", "configuration", "play a recording or a plant model as a real plant",
         "Plays a plant in real time, for demonstrations and tests: the recording of CONFIG, or, if CONFIG\n"
         "has \"emulate\", its FMUs as the true plant with seeded noise. Its signals are served by Modbus TCP\n"
         "at the addresses where the configuration reads them (playing starts with the first request), sent\n"
         "as CAN frames, or written into a FIFO; not by Modbus RTU, nor of GPIO lines."},
    [TL_VERB_SHOW] =
        {"show", "DATABASE", "database", "show what was corrected, when and why",
         "Shows what a run that was recorded had to correct, when and why: how well the twin followed, Δu per\n"
         "adjusted variable and since when, events. Works while the run is going on."},
    [TL_VERB_RELOAD] =
        {"reload", "CONFIG", "configuration", "bring a changed configuration into a running plant's twin",
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

/* In the order in which they are explained. */
const tl_option tl_option_rows[TL_OPTION_COUNT] = {
    {CHECK, "variables", NULL, TL_OPTION_SWITCH, SETS(variables), .help = "list all variables of the FMUs"},
    {CHECK, "recording", "FILE", TL_OPTION_TEXT, SETS(recording),
     .help =
         "instead: look through a recording, as `replay` takes it, and propose between,\ncondition and tolerance by its noise and message times; no FMU is loaded"},
    {PLANT, "for", "CONFIG2", TL_OPTION_TEXT, SETS(listener),
     .help = "serve what this configuration reads; default: CONFIG itself"},
    {REPLAY, "recording", "FILE", TL_OPTION_TEXT, SETS(recording),
     .help = "a CSV file, or a database that `twinlock run` wrote; default: as configured"},
    {PLANT, "recording", "FILE", TL_OPTION_TEXT, SETS(recording),
     .help = "the CSV file to play; with \"emulate\", what drives the FMUs; default: as\nconfigured"},
    {REPLAY, "run", "N", TL_OPTION_RUN, SETS(run), .help = "of a database; default: its last run",
     .expected = "the number of a run, for example 3"},
    {CHECK, "run", "N", TL_OPTION_RUN, SETS(run), .needs = "recording",
     .help = "with --recording: of a database; default: its last run",
     .expected = "the number of a run, for example 3"},
    {CHECK, "json", NULL, TL_OPTION_SWITCH, SETS(json), .needs = "recording",
     .help = "with --recording: print one JSON object"},
    {SHOW, "run", "N|last", TL_OPTION_RUN_OR_LAST, SETS(run), .help = "which run; default: the last one",
     .expected = "the number of a run, for example 3, or last"},
    {SHOW, "since", "TIME", TL_OPTION_SINCE, SETS(since),
     .help = "only what came after: a date (UTC: 2026-11-21, 2026-11-21T10:02), or how far back\n"
             "from the run's end (90s, 15m, 8h, 2d)",
     .expected = "a date such as 2026-11-21T10:02, or 90s, 15m, 8h, 2d"},
    {SHOW, "events", NULL, TL_OPTION_SWITCH, SETS(events), .help = "all events, not only the last ten"},
    {REPLAY, "json", NULL, TL_OPTION_SWITCH, SETS(json), .help = "print one JSON object instead of a table"},
    {SHOW, "json", NULL, TL_OPTION_SWITCH, SETS(json), .help = "print one JSON object", .alone = true},
    {REPLAY, "db", "FILE", TL_OPTION_TEXT, SETS(database), .help = "record into a SQLite database, as `run` does"},
    {RUN, "db", "FILE", TL_OPTION_TEXT, SETS(database),
     .help = "record into this SQLite database; default: as configured"},
    {REPLAY, "csv", "FILE", TL_OPTION_TEXT, SETS(trajectory),
     .help = "write y, ŷ, u and û of every step (\"-\": standard output, without the table)"},
    {SHOW, "csv", "TABLE", TL_OPTION_TABLE, SETS(table),
     .help = "print a table as CSV: outputs, adjustments, steps, samples or events",
     .expected = "outputs, adjustments, steps, samples or events", .alone = true},
    {REPLAY, "report", "FILE", TL_OPTION_TEXT, SETS(report),
     .help = "write a page with key figures, plots and events, for a browser and for paper"},
    {SHOW, "report", "FILE", TL_OPTION_TEXT, SETS(report),
     .help = "write a page with key figures, plots and events, for a browser and for paper", .alone = true},
    {REPLAY, "realtime", NULL, TL_OPTION_SWITCH, SETS(realtime), .help = "at the plant's own pace"},
    {REPLAY, "plain", NULL, TL_OPTION_SWITCH, SETS(plain),
     .help = "execute everything: no saving by structure or sequences; the results are the\nsame to the bit"},
    {RUN, "duration", "S", TL_OPTION_SECONDS, SETS(duration_s), .help = "end after S seconds of plant time",
     .expected = "seconds > 0 and below 1e9, for example 14"},
    {RUN, "status", NULL, TL_OPTION_SWITCH, SETS(status),
     .help = "a status line per second also if the output is no terminal"},
    {RUN, "json", NULL, TL_OPTION_SWITCH, SETS(json), .help = "print the summary as one JSON object at the end"},
    {REPLAY | RUN, "require-lock", "PERCENT", TL_OPTION_PERCENT, SETS(require_lock),
     .help = "end with 3 unless the twin was in lock in at least so much of the steps;\n"
             "without this option, unless it was at some time",
     .expected = "a percentage above 0, at most 100, for example 95"},
    {RUN, "supervise", NULL, TL_OPTION_SWITCH, SETS(supervise), .alone = true,
     .help = "start the twin again if it hangs or dies, and without FMUs after a restart\n"
             "loop (safe hold); tell systemd, if that started it"},
    {RUN, "state", "DIR", TL_OPTION_TEXT, SETS(state), .needs = "supervise",
     .help =
         "with --supervise: count restarts in DIR/supervisor.json, across resets of the\nbox, and try what FMUs save before it is needed"},
    {RUN, "control", "SOCKET", TL_OPTION_TEXT, SETS(control), .needs = "state",
     .help = "with --state: take changed configurations by this socket; versions are kept\nin DIR/versions"},
    {RUN, "allowed", "FILE", TL_OPTION_TEXT, SETS(allowed), .needs = "control",
     .help =
         "with --control: names of files and libraries that a configuration from the\nnetwork may have, lines \"file NAME\", \"library NAME\"; default:\n/etc/twinlock/allowed"},
    {RELOAD, "control", "SOCKET", TL_OPTION_TEXT, SETS(control),
     .help = "of the run; default: /run/twinlock/NAME/control, NAME being that of the file;\nneeded with \"-\""},
    {RELOAD, "right", "RIGHT", TL_OPTION_RIGHT, SETS(right),
     .help = "ask with this right only: read, retune or commission; default: all that the box\nmay",
     .expected = "read, retune or commission"},
    {RELOAD, "no-activate", NULL, TL_OPTION_SWITCH, SETS(only_check), .changes = true,
     .help = "all steps but the activation"},
    {RELOAD, "restart", NULL, TL_OPTION_SWITCH, SETS(restart), .changes = true,
     .help = "end the run and begin anew for what needs that, or if the box does not carry\nboth twins"},
    {RELOAD, "shadow", "S", TL_OPTION_WHOLE_SECONDS, SETS(shadow_s), .changes = true,
     .help = "whole seconds for which another twin runs beside the run's before it takes\nover; default 60",
     .expected = "whole seconds from 1 to 3600, for example 60"},
    {RELOAD, "accept-worse", NULL, TL_OPTION_SWITCH, SETS(accept_worse), .changes = true,
     .help = "let another twin take over also if an output is more than twice as far off as\n"
             "the run's, and out of its tolerance"},
    {RELOAD, "probation", "S", TL_OPTION_WHOLE_SECONDS, SETS(probation_s), .changes = true,
     .help = "whole seconds in which it has to prove itself; default 300",
     .expected = "whole seconds from 1 to 3600, for example 60"},
    {RELOAD, "require-lock", "PERCENT", TL_OPTION_PERCENT, SETS(keep_lock), .changes = true,
     .help = "keep it if the twin was in lock in at least so much of the probation's\nsteps; default 95",
     .expected = "a percentage above 0, at most 100, for example 95"},
    {RELOAD, "until-confirmed", NULL, TL_OPTION_SWITCH, SETS(until_confirmed), .changes = true,
     .help = "keep it only if somebody confirms it during the probation"},
    {RELOAD, "wait", NULL, TL_OPTION_SWITCH, SETS(wait), .changes = true,
     .help = "end when it is kept, or returned from; also over a restart"},
    {RELOAD, "why", "TEXT", TL_OPTION_TEXT, SETS(why), .changes = true,
     .help = "a word to those who look at the versions later"},
    {RELOAD, "confirm", NULL, TL_OPTION_SWITCH, SETS(confirm), .alone = true, .only = true,
     .help = "keep the version that is on probation; nothing is sent"},
    {RELOAD, "rollback", NULL, TL_OPTION_SWITCH, SETS(rollback), .alone = true,
     .help = "bring the version before back, or cancel a change that is under way; nothing is\nsent"},
    {RELOAD, "version", "N", TL_OPTION_NUMBER, SETS(version), .needs = "rollback",
     .help = "with --rollback: which version", .expected = "the number of a version, see --versions"},
    {RELOAD, "versions", NULL, TL_OPTION_SWITCH, SETS(versions), .alone = true, .only = true,
     .help = "list what is kept, and what was refused last"},
    {RELOAD, "state", NULL, TL_OPTION_SWITCH, SETS(show), .alone = true, .only = true, .help = "say how the run is"},
    {RUN, "watchdog", "DEVICE", TL_OPTION_TEXT, SETS(watchdog), .needs = "supervise",
     .help = "with --supervise: stroke this watchdog (/dev/watchdog) while the twin is alive"},
    {RUN, "watchdog-timeout", "S", TL_OPTION_WHOLE_SECONDS, SETS(watchdog_s), .needs = "watchdog",
     .help = "whole seconds after which it resets the box; default 30",
     .expected = "whole seconds from 1 to 3600, for example 30"},
    {PLANT, "fifo", "FILE", TL_OPTION_TEXT, SETS(fifo), .alone = true,
     .help = "write rows into this FIFO instead (made if it does not exist)"},
    {PLANT, "record", "FILE", TL_OPTION_TEXT, SETS(record), .alone = true,
     .help = "write all rows into a new CSV file, as fast as possible, and end"},
    {PLANT, "real-bus", NULL, TL_OPTION_SWITCH, SETS(real_bus),
     .help = "send CAN frames on an interface that is hardware, too; default: vcan only"},
    {PLANT, "seed", "N", TL_OPTION_NUMBER, SETS(seed), .help = "of the noise and the message times; default 1",
     .expected = "a whole number"},
    {CHECK | REPLAY | PLANT, "call-limit", "S", TL_OPTION_SECONDS, SETS(call_limit_s),
     .help = "end with 70 if an FMU does not return from a call for S seconds; default 60",
     .expected = "seconds > 0 and below 1e9, for example 600"},
    {RUN, "call-limit", "S", TL_OPTION_SECONDS, SETS(call_limit_s), .alone = true,
     .help = "without --supervise: end with 70 if the FMUs hang for ten times S seconds;\ndefault 60",
     .expected = "seconds > 0 and below 1e9, for example 600"},
    {CHECK | REPLAY | PLANT | RUN, "memory-limit", "MIB", TL_OPTION_MEBIBYTES, SETS(memory_limit_mib),
     .help = "how much memory the process of the FMUs may take; default: half of the\nmachine's, at most 4096",
     .expected = "MiB from 64 to 1048576, for example 2048"},
    {CHECK | REPLAY | PLANT | RUN, "unconfined", NULL, TL_OPTION_SWITCH, SETS(unconfined),
     .help = "let FMUs do what this user can: files, network, programs; for FMUs that\nneed it, and are trusted"},
    {EVERY, "help", NULL, TL_OPTION_HELP, .help = "this text"},
};

const char *const tl_option_tables[] = {
    [TL_SHOW_OUTPUTS] = "outputs", [TL_SHOW_ADJUSTMENTS] = "adjustments", [TL_SHOW_STEPS] = "steps",
    [TL_SHOW_SAMPLES] = "samples", [TL_SHOW_EVENTS] = "events",           NULL,
};

/* What is said of each status that a process can end with. */
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

/* ---- help -------------------------------------------------------------------------------------------------------- */

/* Lines, each indented but the first. */
static void print_lines(const char *lines, int indent, FILE *file) {
    for (const char *line = lines;;) {
        size_t length = strcspn(line, "\n");
        (void)fprintf(file, "%.*s\n", (int)length, line);
        line += length;
        if (*line == '\0') {
            return;
        }
        (void)fprintf(file, "%*s", indent, "");
        line++;
    }
}

static size_t width_of(const tl_option *option) {
    return strlen("--") + strlen(option->name) + (option->value != NULL ? strlen(" ") + strlen(option->value) : 0);
}

static size_t widest_of(tl_verb verb) {
    size_t widest = 0;
    for (size_t i = 0; i < TL_OPTION_COUNT; i++) {
        size_t width = width_of(&tl_option_rows[i]);
        bool counts = (tl_option_rows[i].verbs >> verb & 1U) != 0 && width <= WIDEST;
        widest = counts && width > widest ? width : widest;
    }
    return widest;
}

static void print_option(const tl_option *option, size_t widest, FILE *file) {
    int indent = (int)(strlen("  ") + widest + strlen("  "));
    bool has_value = option->value != NULL;
    int used = fprintf(file, "  --%s%s%s", option->name, has_value ? " " : "", has_value ? option->value : "");
    if (width_of(option) > widest) {
        (void)fputc('\n', file);
        used = 0;
    }
    (void)fprintf(file, "%*s", indent - used, "");
    print_lines(option->help, indent, file);
}

void tl_option_table_print_help(tl_verb verb, FILE *file) {
    const tl_verb_row *row = &tl_verb_rows[verb];
    size_t widest = widest_of(verb);
    (void)fprintf(file, "usage: twinlock %s %s [options]\n\n%s\n\n", row->name, row->subject, row->description);
    for (size_t i = 0; i < TL_OPTION_COUNT; i++) {
        if ((tl_option_rows[i].verbs >> verb & 1U) != 0) {
            print_option(&tl_option_rows[i], widest, file);
        }
    }
}

void tl_option_table_print_usage(FILE *file) {
    const char *before = "Exit codes: ";
    (void)fputs("usage: twinlock VERB …\n\n"
                "Keeps the simulation of a plant locked to the plant, and records what it had to correct.\n\n",
                file);
    for (size_t i = 0; i < TL_VERB_COUNT; i++) {
        (void)fprintf(file, "  %-8s %s\n", tl_verb_rows[i].name, tl_verb_rows[i].purpose);
    }
    for (size_t i = 0; i < TL_VERB_PROGRAMS; i++) {
        (void)fprintf(file, "  %-8s %s\n", tl_verb_programs[i].name, tl_verb_programs[i].purpose);
    }
    (void)fputs(
        "\n`twinlock help VERB` and `twinlock VERB --help` say more. `twinlock --version` prints the version.\n", file);
    for (size_t i = 0; i < sizeof EXITS / sizeof EXITS[0]; i++) {
        (void)fprintf(file, "%s%d %s", before, tl_exit_code(EXITS[i].status), EXITS[i].meaning);
        before = i + 1 == EXITS_OF_A_LINE ? ",\n            " : ", ";
    }
    (void)fputs(".\n", file);
}

/* ---- options ---- */

/* What getopt_long() returns: a row of the table, from here on, so that no row is taken for a character. */
enum { FIRST_ROW = 256, LONGEST_NAME = 64 };

static const double MOST_SECONDS = 1e9;
static const double MOST_WHOLE_SECONDS = 3600;
static const double MOST_PERCENT = 100;
enum { LEAST_MEBIBYTES = 64, MOST_MEBIBYTES = 1 << 20 };

/* One command line while it is read. */
typedef struct reading {
    tl_verb verb;
    char **argv;
    tl_options *options;
    bool given[TL_OPTION_COUNT];
} reading;

static bool has_option(tl_verb verb, const tl_option *option) {
    return (option->verbs >> verb & 1U) != 0;
}

/* ---- what is wrong ----------------------------------------------------------------------------------------------- */

static tl_options_outcome refuse(const reading *self, const char *format, ...) TL_PRINTF(2, 3);

static tl_options_outcome refuse(const reading *self, const char *format, ...) {
    const tl_verb_row *row = &tl_verb_rows[self->verb];
    va_list arguments;
    (void)fprintf(stderr, "twinlock %s: ", row->name);
    va_start(arguments, format);
    (void)vfprintf(stderr, format, arguments);
    va_end(arguments);
    (void)fprintf(stderr, "\nusage: twinlock %s %s [options]; `twinlock %s --help` explains them\n", row->name,
                  row->subject, row->name);
    return TL_OPTIONS_WRONG;
}

static tl_options_outcome refuse_value(const reading *self, const tl_option *option, const char *found) {
    return refuse(self, "--%s: found \"%s\", expected %s", option->name, found, option->expected);
}

/* The verbs that have an option of this name: "replay, show"; "" if none has. */
static void list_verbs(const char *name, char *text, size_t size) {
    size_t used = 0;
    text[0] = '\0';
    for (size_t i = 0; i < TL_OPTION_COUNT; i++) {
        for (tl_verb verb = 0; verb < TL_VERB_COUNT && strcmp(tl_option_rows[i].name, name) == 0; verb++) {
            if (has_option(verb, &tl_option_rows[i]) && used < size) {
                used +=
                    (size_t)snprintf(text + used, size - used, "%s%s", used > 0 ? ", " : "", tl_verb_rows[verb].name);
            }
        }
    }
}

/* Of those of the verb that begin so, if there are several: "--record or --recording". */
static size_t list_longer(tl_verb verb, const char *name, char *text, size_t size) {
    size_t used = 0;
    size_t count = 0;
    for (size_t i = 0; i < TL_OPTION_COUNT; i++) {
        const tl_option *option = &tl_option_rows[i];
        if (has_option(verb, option) && strncmp(option->name, name, strlen(name)) == 0 && used < size) {
            used += (size_t)snprintf(text + used, size - used, "%s--%s", count > 0 ? " or " : "", option->name);
            count++;
        }
    }
    return count;
}

static const char *nearest_option(tl_verb verb, const char *name) {
    tl_nearest nearest = {.text = name};
    for (size_t i = 0; i < TL_OPTION_COUNT; i++) {
        if (has_option(verb, &tl_option_rows[i])) {
            tl_nearest_offer(&nearest, tl_option_rows[i].name);
        }
    }
    return nearest.best;
}

/* `word` begins with "--". */
static tl_options_outcome refuse_word(const reading *self, const char *word) {
    char name[LONGEST_NAME];
    char text[4 * LONGEST_NAME];
    const char *begin = word + strlen("--");
    (void)snprintf(name, sizeof name, "%.*s", (int)strcspn(begin, "="), begin);
    if (list_longer(self->verb, name, text, sizeof text) > 1) {
        return refuse(self, "--%s is short for several options: %s", name, text);
    }
    list_verbs(name, text, sizeof text);
    if (text[0] != '\0') {
        return refuse(self, "there is no option --%s here: it is one of %s", name, text);
    }
    const char *nearest = nearest_option(self->verb, name);
    if (nearest != NULL) {
        return refuse(self, "there is no option --%s: did you mean --%s?", name, nearest);
    }
    return refuse(self, "there is no option --%s", name);
}

/* getopt_long() came upon what it does not know, or upon a value that is missing (':') or not wanted. */
static tl_options_outcome refuse_option(const reading *self, int result) {
    if (optopt >= FIRST_ROW) {
        const tl_option *option = &tl_option_rows[optopt - FIRST_ROW];
        if (result == ':') {
            return refuse(self, "--%s: %s is missing behind it", option->name, option->value);
        }
        return refuse(self, "--%s takes no value: found \"%s\"", option->name, self->argv[optind - 1]);
    }
    if (optopt != 0) {
        return refuse(self, "there is no option -%c", optopt);
    }
    return refuse_word(self, self->argv[optind - 1]);
}

/* ---- values ------------------------------------------------------------------------------------------------------ */

/* False if the text is no number, or one that no double holds. */
static bool read_double(const char *text, double *number) {
    char *end = NULL;
    errno = 0;
    *number = strtod(text, &end);
    return errno == 0 && end != text && *end == '\0';
}

static bool read_switch(const char *text, void *target) {
    (void)text;
    *(bool *)target = true;
    return true;
}

static bool read_text(const char *text, void *target) {
    *(const char **)target = text;
    return true;
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

/* "90s", "15m", "8h", "2d". */
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
    int i = 0;
    while (tl_option_tables[i] != NULL && strcmp(text, tl_option_tables[i]) != 0) {
        i++;
    }
    *(int *)target = i;
    return tl_option_tables[i] != NULL;
}

/* Given twice, the lesser one counts: words behind those of a command line that limits its caller raise nothing. */
static bool read_right(const char *text, void *target) {
    uint32_t *least = target;
    tl_change_right right = TL_RIGHT_READ;
    bool is_right = tl_change_right_of(text, &right);
    *least = is_right && right < *least ? right : *least;
    return is_right;
}

/* Each sets what a value means; false if it is not what was expected. */
static bool (*const READ[])(const char *text, void *target) = {
    [TL_OPTION_SWITCH] = read_switch,
    [TL_OPTION_TEXT] = read_text,
    [TL_OPTION_SECONDS] = read_seconds,
    [TL_OPTION_WHOLE_SECONDS] = read_whole_seconds,
    [TL_OPTION_PERCENT] = read_percent,
    [TL_OPTION_NUMBER] = read_number,
    [TL_OPTION_MEBIBYTES] = read_mebibytes,
    [TL_OPTION_RUN] = read_run,
    [TL_OPTION_RUN_OR_LAST] = read_run_or_last,
    [TL_OPTION_SINCE] = read_since,
    [TL_OPTION_TABLE] = read_table,
    [TL_OPTION_RIGHT] = read_right,
};

/* ---- the command line -------------------------------------------------------------------------------------------- */

/* The verb's rows as getopt_long() wants them. */
static void list_options(tl_verb verb, struct option list[TL_OPTION_COUNT + 1]) {
    size_t count = 0;
    for (int i = 0; i < TL_OPTION_COUNT; i++) {
        const tl_option *option = &tl_option_rows[i];
        if (has_option(verb, option)) {
            int has_value = option->value != NULL ? required_argument : no_argument;
            list[count++] = (struct option){option->name, has_value, NULL, FIRST_ROW + i};
        }
    }
    list[count] = (struct option){NULL, 0, NULL, 0};
}

static tl_options_outcome take(reading *self, int result) {
    const tl_option *option = result == 'h' ? NULL : &tl_option_rows[result - FIRST_ROW];
    if (option == NULL || option->kind == TL_OPTION_HELP) {
        tl_option_table_print_help(self->verb, stdout);
        return TL_OPTIONS_HELPED;
    }
    if (!READ[option->kind](optarg, (char *)self->options + option->offset)) {
        return refuse_value(self, option, optarg);
    }
    self->given[result - FIRST_ROW] = true;
    return TL_OPTIONS_READ;
}

/* The option of this verb that is called so. */
static size_t find_option(tl_verb verb, const char *name) {
    size_t i = 0;
    while (!has_option(verb, &tl_option_rows[i]) || strcmp(tl_option_rows[i].name, name) != 0) {
        i++;
    }
    return i;
}

/* Those of which at most one may be there: "--json, --csv or --report". */
static tl_options_outcome refuse_together(const reading *self) {
    char text[4 * LONGEST_NAME];
    size_t used = 0;
    text[0] = '\0';
    for (size_t i = 0; i < TL_OPTION_COUNT; i++) {
        const tl_option *option = &tl_option_rows[i];
        if (has_option(self->verb, option) && option->alone && used < sizeof text) {
            used += (size_t)snprintf(text + used, sizeof text - used, "%s--%s", used > 0 ? ", " : "", option->name);
        }
    }
    return refuse(self, "expected at most one of %s", text);
}

/* The first given one that is so; NULL: none is. */
static const tl_option *find_given(const reading *self, bool only) {
    for (size_t i = 0; i < TL_OPTION_COUNT; i++) {
        const tl_option *option = &tl_option_rows[i];
        if (self->given[i] && (only ? option->only : option->changes)) {
            return option;
        }
    }
    return NULL;
}

/* What belongs together is there together, and nothing else is. */
static tl_options_outcome check_options(const reading *self) {
    size_t alone = 0;
    for (size_t i = 0; i < TL_OPTION_COUNT; i++) {
        const tl_option *option = &tl_option_rows[i];
        if (!self->given[i]) {
            continue;
        }
        alone += option->alone ? 1 : 0;
        if (option->needs != NULL && !self->given[find_option(self->verb, option->needs)]) {
            const char *value = tl_option_rows[find_option(self->verb, option->needs)].value;
            return refuse(self, "--%s needs --%s%s%s", option->name, option->needs, value != NULL ? " " : "",
                          value != NULL ? value : "");
        }
    }
    const tl_option *only = find_given(self, true);
    const tl_option *changes = find_given(self, false);
    if (alone <= 1 && only != NULL && changes != NULL) {
        return refuse(self, "--%s is of no use with --%s", changes->name, only->name);
    }
    return alone > 1 ? refuse_together(self) : TL_OPTIONS_READ;
}

static tl_options_outcome take_subject(const reading *self, int count, char **words) {
    const char *noun = tl_verb_rows[self->verb].subject_noun;
    if (count == 0) {
        return refuse(self, "expected exactly one %s, found none", noun);
    }
    if (count > 1) {
        return refuse(self, "expected exactly one %s, found \"%s\" and \"%s\"", noun, words[0], words[1]);
    }
    self->options->subject = words[0];
    return TL_OPTIONS_READ;
}

tl_options_outcome tl_options_read(tl_verb verb, int argc, char **argv, tl_options *options) {
    struct option list[TL_OPTION_COUNT + 1];
    reading self = {.verb = verb, .argv = argv, .options = options};
    *options = (tl_options){
        .call_limit_s = tl_seconds(TL_FMU_PATIENCE_CALL),
        .watchdog_s = 30,
        .seed = 1,
        .table = TL_OPTIONS_NO_TABLE,
        .right = TL_RIGHT_BOX,
    };
    list_options(verb, list);
    optind = 0; /* GNU: begin anew */
    opterr = 0;
    for (int result = 0; (result = getopt_long(argc, argv, ":h", list, NULL)) != -1;) {
        tl_options_outcome outcome =
            result == '?' || result == ':' ? refuse_option(&self, result) : take(&self, result);
        if (outcome != TL_OPTIONS_READ) {
            return outcome;
        }
    }
    tl_options_outcome outcome = take_subject(&self, argc - optind, argv + optind);
    return outcome == TL_OPTIONS_READ ? check_options(&self) : outcome;
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
