/* An errand: a short-lived process that is given configurations, and comes back with an answer.
 *
 * Purpose: what a stranger has sent is parsed, and its FMUs are tried, by a process that holds nothing and may die of it.
 * Given:   path and text of the configuration in force and of the candidate, and names that are allowed in it, in memory that nobody can change.
 * Answer:  what it writes into a block of a known size, which whoever reads it copies and checks; lines that it prints; and how it ends.
 * Waiting: starting does, for a fork; looking does not. Whoever has started it looks, and it is killed if its time is over.
 * Owner:   the caller places an errand. A zeroed one is none.
 * Thread:  one, the main thread (role.h).
 */
#ifndef TL_FIRMWARE_RETUNE_ERRAND_H
#define TL_FIRMWARE_RETUNE_ERRAND_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "firmware/base/relay.h"
#include "firmware/process/block.h"
#include "firmware/process/role.h"
#include "master/base/simtime.h"
#include "master/base/status.h"

/* What it is sent with. Texts live during the start only. */
typedef struct tl_errand_job {
    const char *path;         /* of the configuration: relative names start at its folder */
    const char *in_force;     /* text; "": there is none */
    const char *kept;         /* text of the version that a probation would return to; NULL: that in force */
    const char *commissioned; /* text of the version that was commissioned last; NULL: that in force */
    const char *candidate;    /* text */
    const char *on_the_box;   /* text of the configuration's file as it is now; NULL: not known, */
    const char *list;         /* and of the administrator's list of names that are allowed (config_change.h), */
    const char *list_path;    /* and where that is; NULL, of both: there is none */
    uint64_t memory_limit;    /* bytes that the process of its FMUs may take; 0: as usual */
    bool unconfined;          /* FMUs may do what the user can */
} tl_errand_job;

typedef struct tl_errand_settings {
    const char *title; /* "validator [motor]" */
    tl_errand_job job;
    size_t answer;                               /* bytes of the block that it writes; 0: it writes none */
    tl_time limit;                               /* ns that it may take */
    int (*be)(const char *title, void *context); /* where there is no exec (role.h) */
    tl_relay_line *hear;                         /* what it prints; NULL: nobody does */
    void *context;                               /* of both */
} tl_errand_settings;

/* Fields are private. */
typedef struct tl_errand {
    tl_role role;
    tl_block answer;
    tl_relay relay;
    tl_time until;
    bool is_sent;
    bool is_late;
} tl_errand;

typedef enum tl_errand_state {
    TL_ERRAND_GOES_ON,
    TL_ERRAND_DONE,  /* it ended with exit code 0 */
    TL_ERRAND_FAILED /* tl_errand_why() says how */
} tl_errand_state;

enum { TL_ERRAND_WHY = 128 };

/* Errors: TL_TRY_AGAIN; then nothing is left. */
tl_status tl_errand_send(tl_errand *errand, const tl_errand_settings *settings, tl_error *error);

/* All that it has printed by now is passed on. */
tl_errand_state tl_errand_look(tl_errand *errand);

/* "it was killed by signal 11", "it took longer than 20 s". */
void tl_errand_why(const tl_errand *errand, char why[TL_ERRAND_WHY]);

/* The answer: hostile input. */
const void *tl_errand_answer(const tl_errand *errand);

/* Kills it if it has not ended. None is allowed. */
void tl_errand_close(tl_errand *errand);

/* ---- in its process ---- */

/* First in it. Takes what it was given; the texts live as long as the process. Errors: TL_BAD_DATA. */
tl_status tl_errand_begin(tl_errand_job *job, tl_error *error);

/* Its block. Errors: TL_BAD_DATA. */
tl_status tl_errand_take_answer(size_t size, void **answer, tl_error *error);

#endif
