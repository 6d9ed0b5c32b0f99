/* The types of the command line: verbs, and what their options can say.
 *
 * Purpose: the table of options knows what a row sets, and who reads the command line knows the table.
 * Owner:   texts are those of the command line, and live as long as it does.
 * Thread:  plain data.
 */
#ifndef TL_FIRMWARE_CLI_OPTION_TYPES_H
#define TL_FIRMWARE_CLI_OPTION_TYPES_H

#include <stdbool.h>
#include <stdint.h>

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
    uint32_t right;     /* --right: a tl_control_right; TL_CONTROL_RIGHTS: not given, the rights of the box */
    double shadow_s;    /* whole; 0: as usual */
    double probation_s; /* whole; 0: as usual */
    double keep_lock;   /* --require-lock of reload: percent; below 0: as usual */
    int table;          /* --csv TABLE: a tl_show_csv_table; TL_OPTIONS_NO_TABLE: not given */
} tl_options;

#endif
