/* Options of the command line: see options.h. */
#include "firmware/cli/options.h"

#include <ctype.h>
#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "firmware/base/change.h"
#include "firmware/base/os.h"
#include "firmware/base/text.h"
#include "firmware/process/fmu_call_timeout.h"
#include "firmware/report/show.h"

/* ---- values ---- */

static const double MOST_SECONDS = 1e9;
static const double MOST_WHOLE_SECONDS = 3600;
static const double LEAST_STEP_SECONDS = 1e-5;
static const double MOST_PERCENT = 100;
enum { LEAST_MEBIBYTES = 64, MOST_MEBIBYTES = 1 << 20 };

/* Names of the tables of `show --csv`, by tl_show_csv_table. */
static const char *const TABLES[] = {
    [TL_SHOW_OUTPUTS] = "outputs", [TL_SHOW_ADJUSTMENTS] = "adjustments", [TL_SHOW_STEPS] = "steps",
    [TL_SHOW_SAMPLES] = "samples", [TL_SHOW_EVENTS] = "events",           [TL_SHOW_MINUTES] = "minutes",
    [TL_SHOW_HOURS] = "hours",
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

static bool read_step(const char *text, void *target) {
    double *seconds = target;
    return read_double(text, seconds) && *seconds >= LEAST_STEP_SECONDS && *seconds <= MOST_WHOLE_SECONDS;
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

static bool read_onset(const char *text, void *target) {
    tl_options_since *since = target;
    since->is_time = read_double(text, &since->back_s) && since->back_s > 0.0 && since->back_s < MOST_SECONDS;
    since->text = text;
    return since->is_time || read_since(text, target);
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
    [TL_VERB_INIT] = {"init", "FMU… [options]", NULL, "write a first configuration for FMUs",
                      "Writes a configuration for FMUs: connects what has the same name, finds the outputs that the "
                      "plant measures, and tries which inputs and tunable parameters move them. With a recording it "
                      "also measures noise and tries horizons, which takes a minute or more. What it cannot know is "
                      "listed in \"fill_in\": `run` refuses the configuration until that list is empty.",
                      "twinlock init pump.fmu tank.fmu --recording monday.csv\n"
                      "twinlock init tank.fmu --modbus 192.0.2.10 --step 0.1"},
    [TL_VERB_CHECK] = {"check", "CONFIG [options]", "configuration",
                       "validate a configuration and its FMUs without running",
                       "Validates a configuration and its FMUs: keys, variables, types, units, connections. "
                       "Steps the FMUs for a moment and prints what a step costs. Warns of settings that "
                       "are valid but unlikely to be meant. Does not ask the plant.",
                       "twinlock check tank.json\n"
                       "twinlock check tank.json --recording monday.csv  # proposes settings"},
    [TL_VERB_PROBE] = {"probe", "CONFIG [options]", "configuration", "ask the plant for each signal, without a twin",
                       "Reads all signals of the plant for some seconds, as `run` does, and prints for each one its "
                       "value, how often it comes, how old it is, and what is wrong. Loads no FMU and writes "
                       "nothing to the plant. Exit code 65 if a signal is not good. If a Modbus source is bad, "
                       "tries other word orders, tables, addresses, units and port 502, and prints the only "
                       "plausible mapping.",
                       "twinlock probe tank.json\n"
                       "twinlock probe tank.json --duration 60 --json"},
    [TL_VERB_REPLAY] = {"replay", "CONFIG [options]", "configuration", "run a recording through the twin",
                        "Runs a recording of the plant through the twin, as fast as the machine can, and prints "
                        "how well both agree. Time limits are ignored: the result is the same to the bit.",
                        "twinlock replay tank.json --recording monday.csv --report monday.html"},
    [TL_VERB_RUN] = {"run", "CONFIG [options]", "configuration", "keep the twin locked to the plant in real time",
                     "Keeps the twin locked to the plant in real time until Ctrl-C or SIGTERM. It only listens: "
                     "nothing that it does can reach the plant.",
                     "twinlock run tank.json --db tank.db\n"
                     "twinlock run tank.json --supervise --state /var/lib/twinlock/tank"},
    [TL_VERB_PLANT] = {"plant", "CONFIG [options]", "configuration", "play a recording or a model as a plant",
                       "Plays a plant in real time, for rehearsals and tests: the recording of CONFIG, or its FMUs "
                       "with seeded noise if CONFIG has \"emulate\". Serves the signals by Modbus TCP at the addresses "
                       "that CONFIG reads (playing starts with the first request), as CAN frames, or in a FIFO. "
                       "Modbus RTU and GPIO lines cannot be played.",
                       "twinlock plant tank.json\n"
                       "twinlock plant tank.json --record monday.csv"},
    [TL_VERB_SHOW] =
        {"show", "DATABASE [options]", "database", "show what was corrected, when and why",
         "Shows what has changed, and a recorded run: how long the twin was in lock, its errors, the corrections and when "
         "they changed, events. Works during a run.",
         "twinlock show tank.db --since 8h\n"
         "twinlock show tank.db --report tank.html"},
    [TL_VERB_FINDING] = {"finding", "DATABASE --acknowledge N|--normal N [options]", "database",
                         "acknowledge a finding, or accept it as normal",
                         "Records that you have seen a finding, or that its level is normal, with your name and a "
                         "note. `twinlock show` lists the findings. Works during a run.",
                         "twinlock finding tank.db --acknowledge 3 --note \"filter is clogged, ordered\"\n"
                         "twinlock finding tank.db --normal 4 --note \"product B\""},
    [TL_VERB_EXPLAIN] =
        {"explain", "DATABASE [options]", "database", "name the causes that explain a change",
         "Ranks what may have caused a change: each input and parameter of the FMUs, and each "
         "sensor. Repeats the recorded run up to the change, then runs the twin once more for each "
         "candidate, and compares with what was measured. The answer is a set: causes that the "
         "record cannot tell apart belong together. `run` does this by itself after a finding. Gives way "
         "to all other processes.",
         "twinlock explain tank.db\n"
         "twinlock explain tank.db --finding 3 --config /etc/twinlock/tank.json\n"
         "twinlock explain tank.db --foresee  # before anything has happened"},
    [TL_VERB_LEARN] = {"learn", "DATABASE", "database", "learn again what is normal",
                       "Removes what was learnt from a database, for example after a repair: the next run, or the "
                       "present one, learns again what is normal. Open findings become normal. Samples and "
                       "corrections stay.",
                       "twinlock learn tank.db"},
    [TL_VERB_RELOAD] = {"reload", "CONFIG [options]", "configuration", "change the configuration of a running twin",
                        "Sends a changed configuration to the run of it that has --control. Tuning values change in "
                        "place. Other changes start a second twin beside the first, which takes over between two "
                        "ticks, or restart the run if --restart permits it. The new version is then on probation: "
                        "if deadlines are missed or the lock is lost, it is rolled back. CONFIG \"-\" is standard "
                        "input, at most 262144 bytes.",
                        "twinlock reload tank.json --wait\n"
                        "twinlock reload tank.json --rollback"},
};

enum {
    INIT = 1 << TL_VERB_INIT,
    CHECK = 1 << TL_VERB_CHECK,
    PROBE = 1 << TL_VERB_PROBE,
    REPLAY = 1 << TL_VERB_REPLAY,
    RUN = 1 << TL_VERB_RUN,
    PLANT = 1 << TL_VERB_PLANT,
    SHOW = 1 << TL_VERB_SHOW,
    FINDING = 1 << TL_VERB_FINDING,
    EXPLAIN = 1 << TL_VERB_EXPLAIN,
    RELOAD = 1 << TL_VERB_RELOAD,
    EVERY = (1 << TL_VERB_COUNT) - 1
};

#define SETS(member) .offset = offsetof(tl_options, member)

static const tl_option OPTIONS[] = {
    {INIT, "recording", "FILE", tl_option_text, SETS(recording),
     .help = "a CSV file or a folder of them: its columns become signals, if their names fit variables of the FMUs"},
    {INIT, "plant", "FILE", tl_option_text, SETS(plant), .alone = true,
     .help = "a JSON file with \"sources\" and \"plant\" of a configuration, for example of `script/dbc2json`"},
    {INIT, "modbus", "HOST[:PORT]", tl_option_text, SETS(modbus), .alone = true,
     .help = "read the signals from this device by Modbus TCP; their addresses are to be filled in"},
    {INIT, "step", "S", read_step, SETS(step_s), .help = "macro step, s; default: distance of the recording's rows",
     .expected = "seconds from 1e-5 to 3600, for example 0.01"},
    {INIT, "output", "FILE", tl_option_text, SETS(output),
     .help = "the new configuration; default: NAME.json, where NAME.fmu is the first FMU"},
    {CHECK, "variables", NULL, tl_option_switch, SETS(variables), .help = "list all variables of the FMUs"},
    {CHECK, "recording", "FILE", tl_option_text, SETS(recording),
     .help = "instead, measure noise and message times of a recording, replay it with several horizons, and propose "
             "\"between\", \"condition\", tolerances and the horizon; this takes a minute or more"},
    {REPLAY, "recording", "FILE", tl_option_text, SETS(recording),
     .help = "a CSV file, a folder of them, or a database that `twinlock run` wrote; default: that of CONFIG"},
    {PLANT, "recording", "FILE", tl_option_text, SETS(recording),
     .help =
         "the CSV file or folder of them to play, or with \"emulate\" the inputs of the FMUs; default: that of CONFIG"},
    {REPLAY | EXPLAIN, "run", "N", read_run, SETS(run), .help = "run of a database; default: its last run",
     .expected = "the number of a run, for example 3"},
    {CHECK, "run", "N", read_run, SETS(run), .needs = "recording",
     .help = "with --recording: run of a database; default: its last run",
     .expected = "the number of a run, for example 3"},
    {SHOW, "run", "N|last", read_run_or_last, SETS(run), .help = "which run; default: last",
     .expected = "the number of a run, for example 3, or last"},
    {EXPLAIN, "finding", "N", read_run, SETS(finding), .alone = true,
     .help = "number of the finding; default: the last open one, and what belongs to it",
     .expected = "the number of a finding, for example 3"},
    {EXPLAIN, "since", "TIME", read_onset, SETS(since), .alone = true,
     .help = "explain a change that you have seen yourself: s since the start of the run (16.5), a date (UTC), or a "
             "time before its end (90s, 15m, 8h, 2d)",
     .expected = "seconds such as 16.5, a date such as 2026-11-21T10:02, or 90s, 15m, 8h, 2d"},
    {EXPLAIN, "foresee", NULL, tl_option_switch, SETS(foresee), .alone = true,
     .help = "instead, print how large each change must be to be noticed"},
    {EXPLAIN, "config", "CONFIG", tl_option_text, SETS(beside),
     .help = "where the configuration of the run was: its FMUs are searched from there; default: beside the database"},
    {EXPLAIN, "save", NULL, tl_option_switch, SETS(save),
     .help = "also store the sentence with the finding, for `twinlock show`; default: the database is only read"},
    {CHECK | EXPLAIN | PROBE, "json", NULL, tl_option_switch, SETS(json), .help = "print one JSON object"},
    {SHOW, "since", "TIME", read_since, SETS(since),
     .help = "only what came after a date (UTC: 2026-11-21, 2026-11-21T10:02) "
             "or in the last part of the run (90s, 15m, 8h, 2d); "
             "default: all; of a long run the newest part",
     .expected = "a date such as 2026-11-21T10:02, or 90s, 15m, 8h, 2d"},
    {SHOW, "events", NULL, tl_option_switch, SETS(events), .help = "all events; default: the last ten"},
    {FINDING, "acknowledge", "N", read_run, SETS(acknowledge), .help = "number of the finding that you have seen",
     .expected = "the number of a finding, for example 3"},
    {FINDING, "normal", "N", read_run, SETS(normal),
     .help = "likewise; its level is normal and gives no finding again, without learning again",
     .expected = "the number of a finding, for example 3"},
    {FINDING, "note", "TEXT", tl_option_text, SETS(note), .help = "a remark"},
    {REPLAY, "db", "FILE", tl_option_text, SETS(database), .help = "record into a SQLite database, as `run` does"},
    {RUN, "db", "FILE", tl_option_text, SETS(database),
     .help = "record into this SQLite database; default: that of CONFIG"},
    {REPLAY, "report", "FILE", tl_option_text, SETS(report),
     .help = "write an HTML page with key figures, plots and events"},
    {SHOW, "report", "FILE", tl_option_text, SETS(report),
     .help = "write an HTML page with key figures, plots and events", .alone = true},
    {REPLAY, "csv", "FILE", tl_option_text, SETS(trajectory),
     .help = "write simulated, measured, applied and nominal values of "
             "each step (\"-\": to standard output, without the summary)"},
    {SHOW, "csv", "TABLE", read_table, SETS(table),
     .help = "CSV table: outputs, adjustments, steps, samples, events, minutes or hours",
     .expected = "outputs, adjustments, steps, samples, events, minutes or hours", .alone = true},
    {REPLAY | RUN, "json", NULL, tl_option_switch, SETS(json), .help = "print the summary as one JSON object"},
    {SHOW, "json", NULL, tl_option_switch, SETS(json), .help = "print one JSON object", .alone = true},
    {REPLAY | RUN | SHOW, "verbose", NULL, tl_option_switch, SETS(verbose),
     .help = "also outcomes, executions, the ledger and MSEs"},
    {REPLAY | RUN, "require-lock", "PERCENT", read_percent, SETS(require_lock),
     .help = "exit code 3 if the twin was in lock in less than PERCENT of "
             "the steps; default: if it never was",
     .expected = "a percentage above 0, at most 100, for example 95"},
    {RUN, "duration", "S", read_seconds, SETS(duration_s), .help = "end after S seconds of plant time",
     .expected = "seconds > 0 and below 1e9, for example 14"},
    {PROBE, "duration", "S", read_seconds, SETS(duration_s), .help = "read for S seconds; default: 5",
     .expected = "seconds > 0 and below 1e9, for example 14"},
    {RUN, "status", NULL, tl_option_switch, SETS(status),
     .help = "print a status line each second; default: on a terminal only"},
    {RUN, "follow", NULL, tl_option_switch, SETS(follow),
     .help = "print the state as a JSON line each second; the summary goes to standard error"},
    {RUN, "supervise", NULL, tl_option_switch, SETS(supervise), .alone = true,
     .help = "restart the twin if it hangs or dies; after five failures "
             "record without a twin (safe hold); notify systemd"},
    {RUN, "state", "DIR", tl_option_text, SETS(state), .needs = "supervise",
     .help = "with --supervise: keep the restart count in DIR over a reset of "
             "the box, and test saved states of FMUs before they are needed"},
    {RUN, "watchdog", "DEVICE", tl_option_text, SETS(watchdog), .needs = "supervise",
     .help = "with --supervise: send keepalives to this watchdog, for example /dev/watchdog, while the twin is alive"},
    {RUN, "control", "SOCKET", tl_option_text, SETS(control), .needs = "state",
     .help = "with --state: accept changed configurations on this socket; versions are kept in DIR/versions"},
    {PLANT, "record", "FILE", tl_option_text, SETS(record), .alone = true,
     .help = "write all rows into a new CSV file, as fast as possible, and end"},
    {PLANT, "fifo", "FILE", tl_option_text, SETS(fifo), .alone = true,
     .help = "write rows into this FIFO; creates it if needed"},
    {PLANT, "seed", "N", read_number, SETS(seed), .help = "seed of noise and message times; default: 1",
     .expected = "a whole number"},
    {RELOAD, "wait", NULL, tl_option_switch, SETS(wait), .changes = true,
     .help = "end when the version is kept or rolled back"},
    {RELOAD, "restart", NULL, tl_option_switch, SETS(restart), .changes = true,
     .help =
         "permit a restart of the run, with a gap, if the change needs one or if the box has no room for two twins"},
    {RELOAD, "no-activate", NULL, tl_option_switch, SETS(only_check), .changes = true,
     .help = "validate and compare only"},
    {RELOAD, "why", "TEXT", tl_option_text, SETS(why), .changes = true, .help = "a remark, recorded with the version"},
    {RELOAD, "confirm", NULL, tl_option_switch, SETS(confirm), .alone = true, .only = true,
     .help = "keep the version that is on probation; sends nothing"},
    {RELOAD, "rollback", NULL, tl_option_switch, SETS(rollback), .alone = true,
     .help = "return to the version before, or cancel a change; sends nothing"},
    {RELOAD, "version", "N", read_number, SETS(version), .needs = "rollback",
     .help = "with --rollback: to this version", .expected = "the number of a version, see --versions"},
    {RELOAD, "versions", NULL, tl_option_switch, SETS(versions), .alone = true, .only = true,
     .help = "list versions and the last refused changes"},
    {RELOAD, "state", NULL, tl_option_switch, SETS(show), .alone = true, .only = true,
     .help = "print the state of the run"},
    {RELOAD, "control", "SOCKET", tl_option_text, SETS(control), .rare = true,
     .help = "socket of the run; default: /run/twinlock/NAME/control, where "
             "NAME.json is CONFIG; required if CONFIG is \"-\""},
    {RELOAD, "right", "RIGHT", read_right, SETS(right), .rare = true,
     .help = "use only this right: read, retune or commission; default: all rights of the box",
     .expected = "read, retune or commission"},
    {RELOAD, "shadow", "S", read_whole_seconds, SETS(shadow_s), .rare = true, .changes = true,
     .help = "seconds for which a second twin runs beside the first before it takes over; default: 60",
     .expected = "whole seconds from 1 to 3600, for example 60"},
    {RELOAD, "accept-worse", NULL, tl_option_switch, SETS(accept_worse), .rare = true, .changes = true,
     .help = "permit a takeover if the error of an output has doubled and is outside its tolerance"},
    {RELOAD, "probation", "S", read_whole_seconds, SETS(probation_s), .rare = true, .changes = true,
     .help = "seconds of probation; default: 300", .expected = "whole seconds from 1 to 3600, for example 60"},
    {RELOAD, "require-lock", "PERCENT", read_percent, SETS(keep_lock), .rare = true, .changes = true,
     .help = "roll back if the twin was in lock in less than PERCENT of the steps of the probation; default: 95",
     .expected = "a percentage above 0, at most 100, for example 95"},
    {RELOAD, "until-confirmed", NULL, tl_option_switch, SETS(until_confirmed), .rare = true, .changes = true,
     .help = "roll back unless --confirm comes during the probation"},
    {REPLAY, "plain", NULL, tl_option_switch, SETS(plain), .rare = true,
     .help = "execute every component in every evaluation; the results are the same to the bit"},
    {REPLAY, "realtime", NULL, tl_option_switch, SETS(realtime), .rare = true, .help = "at the pace of the plant"},
    {PLANT, "for", "CONFIG2", tl_option_text, SETS(listener), .rare = true,
     .help = "serve what CONFIG2 reads; default: what CONFIG reads"},
    {PLANT, "real-bus", NULL, tl_option_switch, SETS(real_bus), .rare = true,
     .help = "permit CAN frames on real hardware; default: vcan only"},
    {RUN, "allowed", "FILE", tl_option_text, SETS(allowed), .rare = true, .needs = "control",
     .help = "with --control: files and libraries that a configuration from "
             "the network may name, in lines \"file NAME\", \"library NAME\"; "
             "default: /etc/twinlock/allowed"},
    {RUN, "watchdog-timeout", "S", read_whole_seconds, SETS(watchdog_s), .rare = true, .needs = "watchdog",
     .help = "seconds without keepalive until it resets the box; default: 30",
     .expected = "whole seconds from 1 to 3600, for example 30"},
    {INIT | CHECK | REPLAY | PLANT | EXPLAIN, "call-limit", "S", read_seconds, SETS(call_limit_s), .rare = true,
     .help = "exit code 70 if a call of an FMU takes S seconds; default: 60",
     .expected = "seconds > 0 and below 1e9, for example 600"},
    {RUN, "call-limit", "S", read_seconds, SETS(call_limit_s), .rare = true, .alone = true,
     .help = "without --supervise: exit code 70 if the FMUs hang for ten times S seconds; default: 60",
     .expected = "seconds > 0 and below 1e9, for example 600"},
    {INIT | CHECK | REPLAY | PLANT | RUN | EXPLAIN, "memory-limit", "MIB", read_mebibytes, SETS(memory_limit_mib),
     .rare = true, .help = "memory of the FMU process in MiB; default: half of the machine's, at most 4096",
     .expected = "MiB from 64 to 1048576, for example 2048"},
    {INIT | CHECK | REPLAY | PLANT | RUN | EXPLAIN, "unconfined", NULL, tl_option_switch, SETS(unconfined),
     .rare = true,
     .help =
         "give the FMUs all rights of this user: files, network, programs; only for FMUs that need them and are trusted"},
    {EVERY, "help", .rare = true, .help = "this text"},
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
    if (outcome != TL_OPTIONS_READ) {
        return outcome;
    }
    if (count == 0) { /* of a verb that takes several words */
        return tl_options_refuse(&tl_verb_rows[verb], "expected at least one FMU, found none");
    }
    options->subject = words[0];
    if (verb == TL_VERB_INIT) {
        options->fmus = words;
        options->fmu_count = count;
    }
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
    if (access(path, F_OK) != 0 && errno == ENOENT) {
        return tl_fail(error, TL_BAD_DATA, "%s: No such file or directory%s: give a recording with --recording FILE",
                       path, tl_other_case(path, other));
    }
    return TL_OK;
}
