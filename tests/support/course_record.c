/* A course that is recorded: see course_record.h. */
#include "tests/support/course_record.h"

#include <stdio.h>

#include "firmware/base/os.h"

enum { CHECKPOINT_BYTES = 256 * 1024 };

void tl_course_record_open(tl_course_record *record, const char *configuration, const char *path, int64_t newest) {
    tl_course *course = &record->course;
    (void)snprintf(record->path, sizeof record->path, "%s", path);
    tl_identity_boot(record->boot);
    tl_course_open(course, configuration, TL_LAG);
    course->start = tl_clock_now(NULL) - (newest + 1) * course->assembly.config.step;
    tl_twin_recorder_describe(&course->assembly.config, record->path, &record->recorded);
    record->known = (tl_recorder_known){
        .hash = course->other_hash, .text = course->other, .who = "ann", .origin = "test", .why = "to see"};
    record->recorded.settings.known = &record->known;
    record->recorded.settings.known_count = 1;
    tl_test_queue_open(&record->box, &record->recorded.settings, CHECKPOINT_BYTES);
    tl_twin_recorder_start(&record->box.queue, course->assembly.twin, course->start);
}

void tl_course_record_to(tl_course_record *record, int64_t last) {
    tl_course_search(&record->course, last, &record->box.queue);
    tl_test_queue_write(&record->box);
}

void tl_course_record_close(tl_course_record *record) {
    tl_test_queue_close(&record->box);
    tl_course_close(&record->course);
}
