/* Course of a run: its records if it is never interrupted, and if one twin ends and a new twin
 * resumes the run. For tests of resume.
 *
 * Twin:    the motor bench, with a solver that remembers nothing between two searches, so that a
 *          resumed twin computes the same u. Every thirteenth tick is missed, and some signals are
 *          not good. All FMUs are reset three times, and the tuning changes three times.
 * Use:     tl_course_open() computes the whole course. Then a test lets new twins
 *          (tl_course_anew()) compute parts of it, and compares them with the whole.
 * Errors:  any error fails the test.
 * Thread:  one. The environment variable TWINLOCK_FMU_PATH names the folder of the FMUs.
 */
#ifndef TL_TESTS_SUPPORT_COURSE_H
#define TL_TESTS_SUPPORT_COURSE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "firmware/store/record_queue.h"
#include "firmware/twin/assembly.h"

enum { TL_COURSE_TICKS = 240 };

/* Records by step. */
typedef struct tl_course_records {
    tl_record records[TL_COURSE_TICKS];
    bool there[TL_COURSE_TICKS];
} tl_course_records;

typedef struct tl_course {
    tl_assembly assembly;
    tl_account account;      /* equal for all its twins */
    tl_time start;           /* t_start; the last tick of the course was due just now */
    int64_t next;            /* next tick of the present twin */
    tl_course_records whole; /* of the uninterrupted run */
    tl_course_records part;  /* of the twins since tl_course_forget() */
    unsigned char *checkpoint;
    size_t checkpoint_size;
    int64_t checkpoint_tick;
    tl_record_queue queue;           /* tl_course_queue(); the following are what tl_course_read() has found in it */
    void *memory;                    /* of the queue */
    tl_resumption begun;             /* how its run began; tick −1: no run */
    int64_t kept_tick;               /* tick of its checkpoint */
    size_t kept_size;                /* bytes of its checkpoint; 0: none */
    size_t samples;                  /* number of samples */
    size_t tunings;                  /* number of tunings */
    char *other;                     /* text of the other configuration, to which the tuning changes */
    char other_hash[TL_SHA256_TEXT]; /* hash of that text */
    tl_tuning other_values;          /* tuning of that configuration */
} tl_course;

/* Computes the whole course. `path`: of tests/support/motor_lock.json. */
void tl_course_open(tl_course *course, const char *path, tl_pairing measurements);
void tl_course_close(tl_course *course);

/* Returns the tuning with which its twins are built. */
tl_run_tuning tl_course_configured(const tl_course *course);

/* Replaces the twin by a new one, which has not begun. */
void tl_course_anew(tl_course *course);

/* Fills the plant's sample at a tick; stamps are on the clock of t_start. */
void tl_course_sample(const tl_course *course, int64_t tick, tl_sample *sample);

/* Executes the ticks up to `last` as the cycle does. Stores the records in `part`, and puts samples
 * and records into the record queue (NULL: none). */
void tl_course_search(tl_course *course, int64_t last, tl_record_queue *queue);

/* Returns an empty record queue without a reader, for a resumed run. */
tl_record_queue *tl_course_queue(tl_course *course);

/* Reads that queue. Its steps must have been followed (TL_RESUMED), and go into `part`. Samples
 * must be those of the plant, and the checkpoint must be that of tl_course_save(). */
void tl_course_read(tl_course *course);

/* Saves the present twin, after its last tick, as the checkpoint of the course. */
void tl_course_save(tl_course *course);

/* Empties `part`. */
void tl_course_forget(tl_course *course);

/* Expects that u, nominal, y and measured of each step in `part` equal those in `whole`, bit by
 * bit. `part` must have at least `least` steps, and the last step of the course. */
void tl_course_expect_same(const tl_course *course, size_t least);

#endif
