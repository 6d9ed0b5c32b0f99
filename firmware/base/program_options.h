/* Reads and checks the command line of twinlock-serve and prints its help, in the form that `twinlock` uses.
 *
 * Purpose: the completion and the manual page depend on that form.
 * Owner:   texts are those of the command line, and live as long as it does.
 * Thread:  one thread, at the start of the process.
 */
#ifndef TL_FIRMWARE_BASE_PROGRAM_OPTIONS_H
#define TL_FIRMWARE_BASE_PROGRAM_OPTIONS_H

#include <stdbool.h>
#include <stddef.h>

enum { TL_PROGRAM_OPTIONS = 24, TL_PROGRAM_LIST = 8 };

/* What a value is, and what it sets. */
typedef enum tl_program_kind {
    TL_PROGRAM_SWITCH, /* no value; a bool */
    TL_PROGRAM_TEXT,   /* a const char * */
    TL_PROGRAM_LIST_OF /* a tl_program_list: may be given several times */
} tl_program_kind;

typedef struct tl_program_list {
    const char *values[TL_PROGRAM_LIST];
    size_t count;
} tl_program_list;

typedef struct tl_program_option {
    const char *name;
    const char *value; /* what the help calls its value; NULL: it has none */
    tl_program_kind kind;
    size_t offset;    /* of what it sets, in the program's settings */
    const char *help; /* lines, the last one without its end */
} tl_program_option;

typedef struct tl_program {
    const char *name;        /* "twinlock serve" */
    const char *usage;       /* "[options]" */
    const char *description; /* lines, the last one without its end */
    const tl_program_option *options;
    size_t option_count; /* at most TL_PROGRAM_OPTIONS */
    size_t least_words;  /* that are no options */
    size_t most_words;
} tl_program;

typedef enum tl_program_outcome {
    TL_PROGRAM_READ,   /* the program can run */
    TL_PROGRAM_HELPED, /* help was asked for, and printed to standard output */
    TL_PROGRAM_WRONG   /* wrong usage; standard error says what, and what to do */
} tl_program_outcome;

/* Reads what is behind argv[0] into `settings`, which hold the defaults before. *words are those that are no options, in their order, and argv is
 * put into another one. */
tl_program_outcome tl_program_options_read(const tl_program *program, int argc, char **argv, void *settings,
                                           char ***words, size_t *count);

/* Tells standard error that a command line is wrong: `what` is a sentence without its end. */
tl_program_outcome tl_program_options_refuse(const tl_program *program, const char *what);

#endif
