/* Command line: parses and validates the options of a verb of `twinlock` or `twinlock-serve`, and
 * prints the help of the verb.
 *
 * Purpose: each program has one table of its verbs and options. The shell completion
 *          (board/debian/twinlock.bash) and the manual pages (tests/package) parse the help text.
 *          If you change its format, change them too.
 * Owner:   values that are texts point into the command line, and are valid as long as argv.
 * Thread:  one thread, at the start of the process.
 */
#ifndef TL_FIRMWARE_BASE_PROGRAM_OPTIONS_H
#define TL_FIRMWARE_BASE_PROGRAM_OPTIONS_H

#include <stdbool.h>
#include <stddef.h>

#include "master/base/status.h"

/* Maximum number of options of one verb, and of values of an option that may be given several
 * times. */
enum { TL_OPTIONS_MOST = 80, TL_OPTION_LIST = 8 };

/* A verb: the first word of the command line. */
typedef struct tl_verb_row {
    const char *name;
    const char *usage;       /* for example "CONFIG [options]" */
    const char *noun;        /* name of the only argument, for errors ("configuration"); NULL: the caller checks all */
    const char *purpose;     /* for the list of verbs, half a line; NULL: not in the list */
    const char *description; /* one paragraph for the help, wrapped when printed */
    const char *examples;    /* command lines; no newline after the last one */
} tl_verb_row;

typedef struct tl_option {
    unsigned verbs; /* verbs that have this option: bit 1 << index of the verb's row */
    const char *name;
    const char *value;                            /* name of its value in the help; NULL: no value */
    bool (*read)(const char *text, void *target); /* stores a value; false: invalid value; NULL: prints the help */
    size_t offset;                                /* offset of `target` in the settings of the verb */
    const char *help;                             /* is wrapped when printed */
    const char *expected; /* description of valid values, for the error; NULL: `read` accepts all */
    const char *needs;    /* name of an option of the same verb that must be given too; NULL: none */
    bool rare;            /* listed below the common options */
    bool alone;           /* at most one of the options with `alone` may be given */
    bool changes; /* is about a configuration that the verb sends to the run; not allowed with an `only` option */
    bool only;    /* the verb sends no configuration (--state); not allowed with a `changes` option */
} tl_option;

typedef struct tl_option_table {
    const tl_verb_row *verbs;
    size_t verb_count;
    const tl_option *options; /* in the order of the help, rare ones last */
    size_t option_count;
    size_t widest; /* columns; in the help, the text of an option that is wider begins on the next line */
} tl_option_table;

typedef enum tl_options_outcome {
    TL_OPTIONS_READ,   /* the options are valid: the verb can run */
    TL_OPTIONS_HELPED, /* help was requested and printed to standard output */
    TL_OPTIONS_WRONG   /* wrong usage; standard error has the message */
} tl_options_outcome;

/* Values of an option that may be given several times. */
typedef struct tl_option_list {
    const char *values[TL_OPTION_LIST];
    size_t count;
} tl_option_list;

/* Functions for tl_option.read. The first one stores true in a bool. The second one stores the text
 * in a const char *. The third one appends the text to a tl_option_list; it returns false if the
 * list is full. */
bool tl_option_switch(const char *text, void *target);
bool tl_option_text(const char *text, void *target);
bool tl_option_listed(const char *text, void *target);

/* Parses the words after argv[0] into `settings`, in which the caller has set the defaults. `verb`:
 * index of the verb's row. An option may be shortened if it stays unambiguous; -h prints the help.
 * Options and other words may be mixed. Reorders `argv`: *words are the *count other words in it,
 * in their order. */
tl_options_outcome tl_program_options_read(const tl_option_table *table, size_t verb, int argc, char **argv,
                                           void *settings, char ***words, size_t *count);

/* Prints an error in the command line and the usage of the verb to standard error. `format`: a
 * sentence without a full stop, as for printf(). Returns TL_OPTIONS_WRONG. */
tl_options_outcome tl_options_refuse(const tl_verb_row *verb, const char *format, ...) TL_PRINTF(2, 3);

/* Prints the text of `twinlock VERB --help` to standard output. */
void tl_options_print_help(const tl_option_table *table, size_t verb);

#endif
