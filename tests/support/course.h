/* The course of a run that is never interrupted, and those of a predecessor and a successor beside it: for tests of who goes on with whom.
 *
 * Twin:    the motor bench, with a solver that begins every search with an empty head, so that a successor has nothing to learn anew. Every
 *          thirteenth tick is missed, now and then a signal is not good, three times all FMUs begin anew, and three times it takes another tuning.
 * Use:     tl_course_open() makes the whole course; then twins go parts of it, each begun by tl_course_anew().
 * Errors:  what does not go well fails the test.
 * Thread:  one; the environment variable TWINLOCK_FMU_PATH leads to the FMUs.
 */
#ifndef TL_TESTS_SUPPORT_COURSE_H
#define TL_TESTS_SUPPORT_COURSE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "firmware/store/record_queue.h"
#include "firmware/twin/assembly.h"

enum { TL_COURSE_TICKS = 240 };

/* By step. */
typedef struct tl_course_records {
    tl_record records[TL_COURSE_TICKS];
    bool there[TL_COURSE_TICKS];
} tl_course_records;

typedef struct tl_course {
    tl_assembly assembly;
    tl_account account; /* of any of its twins */
    tl_time start;      /* t_start, such that the last tick was just now */
    int64_t next;       /* tick of the twin */
    tl_course_records whole;
    tl_course_records part; /* of the twins since tl_course_forget() */
    unsigned char *checkpoint;
    size_t checkpoint_size;
    int64_t checkpoint_tick;
    tl_record_queue queue; /* tl_course_queue(), and what tl_course_read() has found in it: */
    void *memory;
    tl_resumption begun; /* tick −1: no run */
    int64_t kept_tick;   /* of the checkpoint, */
    size_t kept_size;    /* and its size; 0: none */
    size_t samples;
    size_t tunings;
    char *other;                     /* text of the other configuration that it takes, */
    char other_hash[TL_SHA256_TEXT]; /* its digest, */
    tl_tuning other_values;          /* and what it says */
} tl_course;

/* `path` is that of tests/support/motor_lock.json. */
void tl_course_open(tl_course *course, const char *path, tl_pairing measurements);
void tl_course_close(tl_course *course);

/* What its twins are built with. */
tl_run_tuning tl_course_configured(const tl_course *course);

/* A new twin, which has not begun. */
void tl_course_anew(tl_course *course);

/* What the plant shows at a tick: stamps on the clock of t_start. */
void tl_course_sample(const tl_course *course, int64_t tick, tl_sample *sample);

/* As the cycle does: up to tick `last`. Records are kept in `part`, and put into the outbox (NULL: nowhere). */
void tl_course_search(tl_course *course, int64_t last, tl_record_queue *queue);

/* An empty outbox of its own, that nobody reads, for a run that goes on. */
tl_record_queue *tl_course_queue(tl_course *course);

/* What there is in it: steps go to `part`, and have been followed; samples must be those of the plant, the checkpoint that of the course. */
void tl_course_read(tl_course *course);

/* The twin as bytes, after the tick it is at. */
void tl_course_save(tl_course *course);

/* Empties `part`. */
void tl_course_forget(tl_course *course);

/* Every step that is in `part` is the same to the bit in `whole`; there are at least so many, the last one of the course among them. */
void tl_course_expect_same(const tl_course *course, size_t least);

#endif
