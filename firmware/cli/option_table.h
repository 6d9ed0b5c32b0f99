/* The table of verbs, options and exit codes.
 *
 * Purpose: one place that says what the command line may hold. It is read by options.c, printed as help, and from the help completed
 *          (board/debian/twinlock.bash) and held against the manual page (tests/package).
 * Thread:  constants.
 */
#ifndef TL_FIRMWARE_CLI_OPTION_TABLE_H
#define TL_FIRMWARE_CLI_OPTION_TABLE_H

#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

#include "firmware/cli/option_types.h"

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
    TL_OPTION_RIGHT          /* a tl_control_right as a uint32_t; given twice, the lesser one counts */
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

#endif
