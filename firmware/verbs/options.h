/* The options of all verbs: what was given, read and checked.
 *
 * Purpose: a verb is run with values, not with words. option_table.h says which options there are; they are read here, as are the
 *          rules between them, and what is wrong is told with what was probably meant.
 * Owner:   texts are those of the command line, and live as long as it does.
 * Thread:  one thread, at the start of the process.
 */
#ifndef TL_FIRMWARE_VERBS_OPTIONS_H
#define TL_FIRMWARE_VERBS_OPTIONS_H

#include <limits.h>
#include <stdbool.h>
#include <stdint.h>

#include "firmware/config/config.h"

typedef enum tl_verb { TL_VERB_CHECK, TL_VERB_REPLAY, TL_VERB_RUN, TL_VERB_PLANT, TL_VERB_SHOW, TL_VERB_COUNT } tl_verb;

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
    double call_limit_s; /* default 60 */
    const char *recording;
    uint64_t run; /* 0: the last one */
    bool json;
    const char *database;
    const char *trajectory; /* --csv FILE */
    const char *report;
    bool realtime;
    bool plain;
    double duration_s; /* 0: as configured */
    bool status;
    bool supervise;
    const char *state;
    const char *watchdog;
    double watchdog_s;    /* whole; default 30 */
    const char *listener; /* --for */
    const char *fifo;
    const char *record;
    bool real_bus;
    uint64_t seed; /* default 1 */
    tl_options_since since;
    bool events;
    int table; /* --csv TABLE: a tl_show_csv_table; TL_OPTIONS_NO_TABLE: not given */
} tl_options;

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
