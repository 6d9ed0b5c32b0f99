/* Records a course (course.h) into a database while it is computed, for tests that read recorded
 * samples.
 *
 * Owner:  the caller provides the memory, zeroed at first; it is large, so make it static.
 * Errors: any error fails the test.
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
    tl_recorder_known known; /* the course's other configuration */
} tl_course_record;

/* Begins a run whose tick `newest` was due just now, and executes no tick. `configuration`: path of
 * tests/support/motor_lock.json. `path`: of the database. */
void tl_course_record_open(tl_course_record *record, const char *configuration, const char *path, int64_t newest);

/* Executes the ticks up to `last`, and writes them into the database. */
void tl_course_record_to(tl_course_record *record, int64_t last);

/* Closes record and course. The box may be closed already. */
void tl_course_record_close(tl_course_record *record);

#endif
