/* Options of the command line: their table, reading and help.
 *
 * Thread:  the main thread.
 */
#ifndef TL_FIRMWARE_CLI_OPTIONS_H
#define TL_FIRMWARE_CLI_OPTIONS_H

#include <limits.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

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

/* ---- The table of verbs, options and exit codes.
 *
 * Purpose: one place that says what the command line may hold. It is read by options.c, printed as help, and from the help completed
 *          (board/debian/twinlock.bash) and held against the manual page (tests/package).
 * Thread:  constants.
 */

typedef struct tl_verb_row {
    const char *name;
    const char *subject;      /* "CONFIG": what the help calls it */
    const char *subject_noun; /* "configuration": what a sentence calls it */
    const char *purpose;      /* half a line */
    const char *description;  /* lines, the last one without its end */
} tl_verb_row;

/* What an option's value is, and what it sets in tl_options. */
typedef enum tl_option_kind {
    TL_OPTION_HELP,
    TL_OPTION_SWITCH,        /* no value; a bool */
    TL_OPTION_TEXT,          /* a file, a folder, a device; a const char * */
    TL_OPTION_SECONDS,       /* a double, above 0 and below 1e9 */
    TL_OPTION_WHOLE_SECONDS, /* a double, from 1 to 3600 */
    TL_OPTION_PERCENT,       /* a double, above 0 and at most 100 */
    TL_OPTION_NUMBER,        /* a uint64_t, whole */
    TL_OPTION_MEBIBYTES,     /* a uint64_t, from 64 to 1048576 */
    TL_OPTION_RUN,           /* a uint64_t, the number of a run, from 1 to INT64_MAX */
    TL_OPTION_RUN_OR_LAST,   /* the same, or "last", which is 0 */
    TL_OPTION_SINCE,         /* a tl_options_since */
    TL_OPTION_TABLE,         /* one of tl_option_tables; an int */
    TL_OPTION_RIGHT          /* a tl_change_right as a uint32_t; given twice, the lesser one counts */
} tl_option_kind;

typedef struct tl_option {
    unsigned verbs; /* of each that has it, 1 << tl_verb */
    const char *name;
    const char *value; /* what the help calls its value; NULL: it has none */
    tl_option_kind kind;
    size_t offset;        /* of what it sets, in tl_options */
    const char *help;     /* lines, the last one without its end */
    const char *expected; /* what its value should be, if values are checked; else NULL */
    const char *needs;    /* the name of an option that must be there too, or NULL */
    bool alone;           /* at most one of those that are `alone` may be there */
    bool changes;         /* says how something is changed, or why */
    bool only;            /* changes nothing, or no more than it says: makes no sense with what `changes` */
} tl_option;

enum { TL_OPTION_COUNT = 56 };

extern const tl_verb_row tl_verb_rows[TL_VERB_COUNT];
extern const tl_option tl_option_rows[TL_OPTION_COUNT];

/* The tables that `show --csv` prints, by tl_show_csv_table; NULL ends them. */
extern const char *const tl_option_tables[];

/* What is printed by `twinlock --help`: verbs and exit codes; and by `twinlock VERB --help`. */
void tl_option_table_print_usage(FILE *file);
void tl_option_table_print_help(tl_verb verb, FILE *file);

/* ---- The options of all verbs: what was given, read and checked.
 *
 * Purpose: a verb is run with values, not with words. options.h says which options there are; they are read here, as are the
 *          rules between them, and what is wrong is told with what was probably meant.
 * Owner:   texts are those of the command line, and live as long as it does.
 * Thread:  one thread, at the start of the process.
 */

typedef enum tl_options_outcome {
    TL_OPTIONS_READ,   /* the verb can run */
    TL_OPTIONS_HELPED, /* help was asked for, and printed to standard output */
    TL_OPTIONS_WRONG   /* wrong usage; standard error says what, and what to do */
} tl_options_outcome;

/* Reads what is behind the verb: argv[1] is the first word of it. Options may be shortened as long as they stay unambiguous, and may
 * stand before and behind the subject. `argv` is put into another order. */
tl_options_outcome tl_options_read(tl_verb verb, int argc, char **argv, tl_options *options);

/* The path of the recording: the one given, else the one configured. TL_BAD_USAGE if there is neither, TL_BAD_DATA
 * if the file is only there with other letters' case; else who opens it says what is wrong with it. */
tl_status tl_options_find_recording(const tl_options *options, const tl_config *config, char path[PATH_MAX],
                                    tl_error *error);

#endif
