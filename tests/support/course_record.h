/* A course (course.h) that is recorded into a database as it goes: for what reads recorded samples.
 *
 * Owner:  the caller places it (it is large: make it static), zero at first.
 * Errors: what does not go well fails the test.
 * Thread: one.
 */
#ifndef TL_TESTS_SUPPORT_COURSE_RECORD_H
#define TL_TESTS_SUPPORT_COURSE_RECORD_H

#include <limits.h>
#include <stdint.h>

#include "firmware/base/identity.h"
#include "firmware/twin/twin_recorder.h"
#include "tests/support/course.h"
#include "tests/support/test_record_queue.h"

typedef struct tl_course_record {
    tl_course course;
    tl_test_queue box;
    char path[PATH_MAX]; /* of the database */
    char boot[TL_IDENTITY_TEXT];
    /* private */
    tl_twin_record recorded;
    tl_recorder_known known; /* the other configuration that the course takes */
} tl_course_record;

/* A run begins, such that tick `newest` was just now; nothing of it is recorded yet. `configuration` is the path of tests/support/motor_lock.json. */
void tl_course_record_open(tl_course_record *record, const char *configuration, const char *path, int64_t newest);

/* Goes on up to this tick, and writes. */
void tl_course_record_to(tl_course_record *record, int64_t last);

/* The box may be closed already. */
void tl_course_record_close(tl_course_record *record);

#endif
