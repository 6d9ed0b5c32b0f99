/* Options of the command line: their table, reading and help.
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

/* ---- The types of the command line: verbs, and what their options can say.
 *
 * Purpose: the table of options knows what a row sets, and who reads the command line knows the table.
 * Owner:   texts are those of the command line, and live as long as it does.
 * Thread:  plain data.
 */

typedef enum tl_verb {
    TL_VERB_CHECK,
    TL_VERB_REPLAY,
    TL_VERB_RUN,
    TL_VERB_PLANT,
    TL_VERB_SHOW,
    TL_VERB_RELOAD,
    TL_VERB_COUNT
} tl_verb;

/* The value of --since. */
typedef struct tl_options_since {
    const char *text; /* as given; NULL: not given */
    bool is_date;
    int64_t at;    /* a date: ms since 1970, UTC */
    double back_s; /* else: so far back from the run's end, ≥ 0 */
} tl_options_since;

enum { TL_OPTIONS_NO_TABLE = -1 };

/* What was not given is NULL, 0 or false, or the default that is said. */
typedef struct tl_options {
    const char *subject; /* the one word that is no option: a configuration; of `show` a database */
    bool variables;
    double call_limit_s;       /* default 60 */
    uint64_t memory_limit_mib; /* 0: as much as is usual */
    bool unconfined;
    const char *recording;
    uint64_t run; /* 0: the last one */
    bool json;
    const char *database;
    const char *trajectory; /* --csv FILE */
    const char *report;
    bool realtime;
    bool plain;
    double duration_s;   /* 0: as configured */
    double require_lock; /* percent; 0: at all */
    bool status;
    bool supervise;
    const char *state;
    const char *control; /* a socket */
    const char *allowed; /* a list of names; NULL: where it is usually */
    const char *watchdog;
    double watchdog_s;    /* whole; default 30 */
    const char *listener; /* --for */
    const char *fifo;
    const char *record;
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
    uint64_t version; /* --version; 0: the one before */
    bool versions;
    bool show;
    const char *why;
    uint32_t right;     /* --right: a tl_change_right; TL_RIGHT_BOX: not given, the rights of the box */
    double shadow_s;    /* whole; 0: as usual */
    double probation_s; /* whole; 0: as usual */
    double keep_lock;   /* --require-lock of reload: percent; below 0: as usual */
    int table;          /* --csv TABLE: a tl_show_csv_table; TL_OPTIONS_NO_TABLE: not given */
} tl_options;

/* ---- The table of verbs, options and exit codes, and what was given.
 *
 * Purpose: one place that says what the command line may hold, and a verb is run with values, not with words.
 * Thread:  one thread, at the start of the process.
 */

extern const tl_verb_row tl_verb_rows[TL_VERB_COUNT];
extern const tl_option_table tl_verb_table;

/* Reads what is behind the verb: argv[1] is the first word of it. See tl_program_options_read(). */
tl_options_outcome tl_options_read(tl_verb verb, int argc, char **argv, tl_options *options);

/* The verbs: each runs with options that were read and checked, and returns the exit code of the process. */
int tl_verb_check(const tl_options *options);
int tl_verb_plant(const tl_options *options);
int tl_verb_reload(const tl_options *options);
int tl_verb_replay(const tl_options *options);
int tl_verb_run(const tl_options *options);
int tl_verb_show(const tl_options *options);

/* The path of the recording: the one given, else the one configured. TL_BAD_USAGE if there is neither, TL_BAD_DATA
 * if the file is only there with other letters' case; else who opens it says what is wrong with it. */
tl_status tl_options_find_recording(const tl_options *options, const tl_config *config, char path[PATH_MAX],
                                    tl_error *error);

#endif
