/* What a box answers, line by line, for people or as it is.
 *
 * Purpose: each line is a JSON object of twinlock-serve (config/SPEC.md, "HTTP"). It is told as soon as it is whole, so that a change is seen while
 *          it runs.
 * Trust:   a box may have been broken into: texts are cleaned before a terminal gets them, and what is no such object is not printed.
 * Thread:  one.
 */
#ifndef TL_FIRMWARE_PUSH_PUSH_LINES_H
#define TL_FIRMWARE_PUSH_PUSH_LINES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

enum { TL_PUSH_LINE = 64 * 1024, TL_PUSH_WORD = 32 };

enum { TL_PUSH_HASH = 65, TL_PUSH_SENTENCE = 512 };

/* How a plant is. */
typedef struct tl_push_state {
    char hash[TL_PUSH_HASH]; /* of what is active; "": no line said so */
    char step[TL_PUSH_WORD];
    unsigned long long version;
    unsigned long long left_s;
    bool runs;
} tl_push_state;

typedef struct tl_push_lines {
    FILE *file;                            /* where they go; NULL: nowhere, they are only looked at */
    bool as_json;                          /* as they are */
    const char *config;                    /* what problems are in; NULL: nothing */
    char result[TL_PUSH_WORD];             /* of the last "end"; "": there was none */
    char hash[TL_PUSH_HASH];               /* the same, */
    unsigned long long version;            /* and this */
    char step[TL_PUSH_WORD];               /* the last one; "": there was none */
    tl_push_state state;                   /* the last one */
    unsigned long long wanted;             /* the version of which */
    char version_result[TL_PUSH_SENTENCE]; /* is kept what came of it: what follows a colon */
    size_t used;
    bool is_broken; /* a line was none of ours, or too long: nothing of what follows is told */
    char line[TL_PUSH_LINE];
} tl_push_lines;

void tl_push_lines_begin(tl_push_lines *lines, FILE *file, bool as_json, const char *config);

/* Tells what the box could have told, had its answer lasted: a step, an end. */
void tl_push_lines_say(tl_push_lines *lines, const char *step, unsigned long long left_s, const char *text);
void tl_push_lines_end(tl_push_lines *lines, const char *result, const tl_push_state *now, const char *text);

/* The next bytes, in pieces of any size. */
void tl_push_lines_take(tl_push_lines *lines, const char *bytes, size_t size);

#endif
