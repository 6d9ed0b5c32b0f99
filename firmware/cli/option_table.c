/* Verbs, options and exit codes: see option_table.h. */
#include "firmware/cli/option_table.h"

#include <string.h>

#include "firmware/cli/verb_program.h"
#include "firmware/report/show.h"

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
