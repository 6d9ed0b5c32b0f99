/* Command line: parses and validates the options of a verb of `twinlock` or `twinlock-serve`, and
 *               prints its help.
 *
 * Purpose: each program has one table of its verbs and options. The shell completion
 *          (board/debian/twinlock.bash) and the manual pages (tests/package) parse the help text,
 *          so its format must not change alone.
 * Owner:   texts point into the command line and live as long as it does.
 * Thread:  one thread, at the start of the process.
 */
#ifndef TL_FIRMWARE_BASE_PROGRAM_OPTIONS_H
#define TL_FIRMWARE_BASE_PROGRAM_OPTIONS_H

#include <stdbool.h>
#include <stddef.h>

#include "master/base/status.h"

enum { TL_OPTIONS_MOST = 64, TL_OPTION_LIST = 8 };

typedef struct tl_verb_row {
    const char *name;
    const char *usage;       /* for example "CONFIG [options]" */
    const char *noun;        /* "configuration": the single argument; NULL: the caller checks the arguments */
    const char *purpose;     /* half a line; NULL: the verb is in no list */
    const char *description; /* is wrapped when printed */
    const char *examples;    /* command lines; no newline after the last */
} tl_verb_row;

typedef struct tl_option {
    unsigned verbs; /* bit set of the verbs that have it: 1 << row */
    const char *name;
    const char *value;                            /* name of its value in the help; NULL: no value */
    bool (*read)(const char *text, void *target); /* false: the value is invalid; NULL: prints the help */
    size_t offset;                                /* of the target in the settings of the verb */
    const char *help;                             /* is wrapped when printed */
    const char *expected;                         /* description of valid values; NULL: values are not checked */
    const char *needs;                            /* name of another option that must be given too, or NULL */
    bool rare;                                    /* listed below the common options */
    bool alone;                                   /* at most one of the options with `alone` may be given */
    bool changes;                                 /* defines a change, or gives the reason for it */
    bool only;                                    /* makes no change, or a limited one: not allowed with `changes` */
} tl_option;

typedef struct tl_option_table {
    const tl_verb_row *verbs;
    size_t verb_count;
    const tl_option *options; /* in the order of the help, rare ones last */
    size_t option_count;
    size_t widest; /* wider options are printed on a line of their own in the help */
} tl_option_table;

typedef enum tl_options_outcome {
    TL_OPTIONS_READ,   /* the verb can run */
    TL_OPTIONS_HELPED, /* help was requested and printed to standard output */
    TL_OPTIONS_WRONG   /* wrong usage; standard error has the message */
} tl_options_outcome;

/* Values of an option that may be given several times. */
typedef struct tl_option_list {
    const char *values[TL_OPTION_LIST];
    size_t count;
} tl_option_list;

/* Store a value: true in a bool, the text in a const char *, or one more text in a tl_option_list.
 */
bool tl_option_switch(const char *text, void *target);
bool tl_option_text(const char *text, void *target);
bool tl_option_listed(const char *text, void *target);

/* Parses the words after argv[0] into `settings`, which contain the defaults. Options may be
 * abbreviated while they are unambiguous, and may be mixed with other words. Sets *words to the
 * other words, in their order; reorders `argv`. */
tl_options_outcome tl_program_options_read(const tl_option_table *table, size_t verb, int argc, char **argv,
                                           void *settings, char ***words, size_t *count);

/* Prints to standard error that the command line is wrong. `format`: a sentence without a full
 * stop. */
tl_options_outcome tl_options_refuse(const tl_verb_row *verb, const char *format, ...) TL_PRINTF(2, 3);

/* Prints the text of `twinlock VERB --help` to standard output. */
void tl_options_print_help(const tl_option_table *table, size_t verb);

#endif
