/* Options of the command line: their table, their parser and the help text.
 *
 * Thread:  the main thread.
 */
#ifndef TL_FIRMWARE_CLI_OPTIONS_H
#define TL_FIRMWARE_CLI_OPTIONS_H

#include <limits.h>
#include <stdbool.h>
#include <stdint.h>

#include "firmware/base/program_options.h"
#include "firmware/config/config.h"

/* ---- Types of the command line: verbs and the values of their options.
 *
 * Purpose: the table of options fills this struct; the verbs read it and do not need the table.
 * Owner:   the texts point into the command line and are valid as long as it is.
 * Thread:  plain data.
 */

typedef enum tl_verb {
    TL_VERB_INIT,
    TL_VERB_CHECK,
    TL_VERB_PROBE, /* reads the plant's signals without a twin */
    TL_VERB_REPLAY,
    TL_VERB_RUN,
    TL_VERB_PLANT, /* emulates a plant, from a recording or from FMUs */
    TL_VERB_SHOW,
    TL_VERB_FINDING,
    TL_VERB_EXPLAIN,
    TL_VERB_LEARN, /* deletes what was learned from a database: the run learns again what is normal */
    TL_VERB_RELOAD,
    TL_VERB_COUNT
} tl_verb;

/* Value of --since: a date, a time before the end of the run, or a time since its start. Only
 * `explain` accepts the last one. */
typedef struct tl_options_since {
    const char *text; /* as given; NULL: not given */
    bool is_date;     /* a date: `at` is valid, `back_s` is not */
    bool is_time;     /* a time since the start of the run */
    int64_t at;       /* of a date: ms since 1970 UTC */
    double back_s;    /* if is_time: s since the start of the run; else: s before its end; ≥ 0 */
} tl_options_since;

enum { TL_OPTIONS_NO_TABLE = -1 }; /* tl_options.table: not given */

/* Parsed options. Each member has the name of its option, unless the comment names another; the
 * table in options.c has the help. Options that were not given are NULL, 0 or false, or have the
 * default stated here. */
typedef struct tl_options {
    const char *subject; /* path of a configuration or, by verb, of a database; the only argument */
    char **fmus;         /* paths, for init: its arguments */
    size_t fmu_count;
    const char *plant;  /* path of a JSON file with `sources` and `plant` */
    const char *modbus; /* HOST or HOST:PORT */
    double step_s;      /* --step; 0: not given */
    const char *output; /* path of the new configuration */
    bool variables;
    double call_limit_s;       /* longest call of an FMU, s; default 60 */
    uint64_t memory_limit_mib; /* MiB for the FMU process; 0: half of the machine's memory, at most 4096 MiB */
    bool unconfined;
    const char *recording; /* path of a CSV file or a database to read */
    uint64_t run;          /* number of a run in a database; 0: the last run */
    bool verbose;
    bool json;
    const char *database;   /* --db FILE */
    const char *trajectory; /* --csv FILE */
    const char *report;
    bool realtime;
    bool plain;
    double duration_s;   /* s; 0: as configured; of probe: 5 */
    double require_lock; /* least share of the steps in lock, percent; 0: one step is enough (summary.h) */
    bool status;
    bool follow;
    bool supervise;
    const char *state;    /* path of a folder */
    const char *control;  /* path of a socket */
    const char *allowed;  /* path of a list of names; NULL: /etc/twinlock/allowed */
    const char *watchdog; /* path of a device */
    double watchdog_s;    /* --watchdog-timeout: whole s; default 30 */
    const char *listener; /* --for: path of the configuration of a twin that reads the emulated plant */
    const char *fifo;
    const char *record; /* path of a CSV file that `plant` writes */
    bool real_bus;
    uint64_t seed; /* default 1 */
    tl_options_since since;
    bool events;
    bool only_check; /* --no-activate */
    bool restart;
    bool until_confirmed;
    bool accept_worse;
    bool wait;
    bool confirm;
    bool rollback;
    uint64_t version; /* --version; 0: the version before the active one */
    bool versions;
    bool show;            /* --state of reload */
    uint64_t acknowledge; /* number of a finding, ≥ 1; 0: not given */
    uint64_t normal;      /* number of a finding whose level is normal, ≥ 1; 0: not given */
    const char *note;
    uint64_t finding;   /* number of a finding, ≥ 1; 0: not given */
    const char *beside; /* --config: path that the run's configuration had; FMU file names are relative to its folder */
    bool foresee;       /* prints how large each change must be to be noticed; explains no finding */
    bool save;          /* stores the explanation with the finding */
    const char *why;
    uint32_t right;     /* a tl_change_right; default TL_RIGHT_BOX: all rights of a user on this computer */
    double shadow_s;    /* duration of the shadow, whole s; 0: not given, so 60 s */
    double probation_s; /* duration of the probation, whole s; 0: not given, so 300 s */
    double keep_lock;   /* --require-lock of reload: percent of the steps; 0: not given, so 95 % */
    int table;          /* --csv TABLE: a tl_show_csv_table; TL_OPTIONS_NO_TABLE: not given */
} tl_options;

/* ---- Table of verbs, options and exit codes, and the parsed options.
 *
 * Purpose: one table defines all options that the command line accepts. A verb receives parsed and
 *          checked values, not texts.
 * Thread:  one thread, at the start of the process.
 */

extern const tl_verb_row tl_verb_rows[TL_VERB_COUNT];
extern const tl_option_table tl_verb_table;

/* Sets the defaults and parses the arguments after the verb, which begin at argv[1]. Returns the
 * outcome of tl_program_options_read(); the options are valid if it is TL_OPTIONS_READ. */
tl_options_outcome tl_options_read(tl_verb verb, int argc, char **argv, tl_options *options);

/* The verbs. Each one runs with parsed and checked options and returns the exit code of the
 * process. */
int tl_verb_check(const tl_options *options);
int tl_verb_explain(const tl_options *options);
int tl_verb_init(const tl_options *options);
int tl_verb_finding(const tl_options *options);
int tl_verb_learn(const tl_options *options);
int tl_verb_plant(const tl_options *options);
int tl_verb_probe(const tl_options *options);
int tl_verb_reload(const tl_options *options);
int tl_verb_replay(const tl_options *options);
int tl_verb_run(const tl_options *options);
int tl_verb_show(const tl_options *options);

/* Sets `path` to the path of the recording: that of --recording, else that of the configuration.
 * Does not check if the file can be opened. Errors: TL_BAD_USAGE if neither names a recording;
 * TL_BAD_DATA if there is only a file whose name differs in upper and lower case. */
tl_status tl_options_find_recording(const tl_options *options, const tl_config *config, char path[PATH_MAX],
                                    tl_error *error);

#endif
