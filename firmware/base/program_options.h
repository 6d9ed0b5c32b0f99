/* Reads and checks the command line of a verb of `twinlock` or `twinlock-serve`, and prints its help.
 *
 * Purpose: each program has one table of its verbs and options. The completion (board/debian/twinlock.bash) and the manual pages (tests/package) depend on
 *          the form of the help.
 * Owner:   texts are those of the command line, and live as long as it does.
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
    const char *usage;       /* "CONFIG [options]" */
    const char *noun;        /* "configuration": the one word behind the verb; NULL: the caller checks the words */
    const char *purpose;     /* half a line; NULL: nothing lists the verbs */
    const char *description; /* lines, the last one without its end */
} tl_verb_row;

typedef struct tl_option {
    unsigned verbs; /* of each that has it, 1 << its row */
    const char *name;
    const char *value;                            /* what the help calls its value; NULL: it has none */
    bool (*read)(const char *text, void *target); /* false: it is not what was expected; NULL: prints the help */
    size_t offset;                                /* of the target in the settings of the verb */
    const char *help;                             /* lines, the last one without its end */
    const char *expected;                         /* what its value should be, if values are checked; else NULL */
    const char *needs;                            /* the name of an option that must be there too, or NULL */
    bool alone;                                   /* at most one of those that are `alone` may be there */
    bool changes;                                 /* says how something is changed, or why */
    bool only; /* changes nothing, or no more than it says: makes no sense with what `changes` */
} tl_option;

typedef struct tl_option_table {
    const tl_verb_row *verbs;
    size_t verb_count;
    const tl_option *options; /* in the order in which they are explained */
    size_t option_count;
    size_t widest; /* an option and its value beyond this width have a line of their own in the help */
} tl_option_table;

typedef enum tl_options_outcome {
    TL_OPTIONS_READ,   /* the verb can run */
    TL_OPTIONS_HELPED, /* help was asked for, and printed to standard output */
    TL_OPTIONS_WRONG   /* wrong usage; standard error says what, and what to do */
} tl_options_outcome;

/* The values of an option that may be given several times. */
typedef struct tl_option_list {
    const char *values[TL_OPTION_LIST];
    size_t count;
} tl_option_list;

/* Values: true for a bool, a text for a const char *, one more for a tl_option_list. */
bool tl_option_switch(const char *text, void *target);
bool tl_option_text(const char *text, void *target);
bool tl_option_listed(const char *text, void *target);

/* Reads what is behind argv[0] into `settings`, which hold the defaults before. Options may be shortened as long as they stay unambiguous, and may stand
 * before and behind other words. *words are those, in their order; `argv` is put into another one. */
tl_options_outcome tl_program_options_read(const tl_option_table *table, size_t verb, int argc, char **argv,
                                           void *settings, char ***words, size_t *count);

/* Tells standard error that a command line is wrong: a sentence without its end. */
tl_options_outcome tl_options_refuse(const tl_verb_row *verb, const char *format, ...) TL_PRINTF(2, 3);

/* What `twinlock VERB --help` prints, to standard output. */
void tl_options_print_help(const tl_option_table *table, size_t verb);

#endif
