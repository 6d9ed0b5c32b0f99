/* States between events. */
#include "firmware/report/show_lock.h"

#include <stdbool.h>
#include <string.h>

#include "firmware/store/history_rows.h"

typedef struct lock_course {
    const int64_t *range;
    int64_t lead;  /* of ticks before steps */
    int64_t since; /* the step from which on the state is this one */
    bool is_known;
    tl_lock_tally *tally;
} lock_course;

/* "locked: …". Other events of that source tell no state. */
static bool find_state(const char *text, tl_lock_state *state) {
    for (int i = 0; i < TL_LOCK_STATES; i++) {
        const char *name = tl_lock_state_name((tl_lock_state)i);
        size_t length = strlen(name);
        if (strncmp(text, name, length) == 0 && text[length] == ':') {
            *state = (tl_lock_state)i;
            return true;
        }
    }
    return false;
}

/* What lies within the range of the steps since the last change, before `until`. */
static void count_until(const lock_course *course, int64_t until) {
    int64_t first = course->since > course->range[0] ? course->since : course->range[0];
    int64_t end = until <= course->range[1] ? until : course->range[1] + 1;
    if (end > first) {
        course->tally->steps[course->tally->state] += (uint64_t)(end - first);
    }
}

static void take_event(void *context, const tl_history_event *event) {
    lock_course *course = context;
    tl_lock_state state = TL_LOCK_FREE;
    if (strcmp(event->source, "lock") != 0 || !event->has_tick || !find_state(event->text, &state)) {
        return;
    }
    int64_t step = event->tick - course->lead;
    bool is_within = step >= course->range[0] && step <= course->range[1];
    if (course->is_known) {
        count_until(course, step);
        course->tally->changes += is_within ? 1 : 0;
        course->tally->losses += is_within && state == TL_LOCK_LOST ? 1 : 0;
        course->since = step;
    }
    if (step <= course->range[1] || !course->is_known) {
        course->tally->state = state;
    }
    course->is_known = true;
}

tl_status tl_show_lock(tl_history *history, const tl_history_run *run, const int64_t range[2], tl_lock_tally *tally,
                       tl_error *error) {
    lock_course course = {.range = range, .lead = run->lead, .since = 0, .tally = tally};
    const tl_history_visitor visitor = {.context = &course, .event = take_event};
    memset(tally, 0, sizeof *tally);
    tl_status status = tl_history_events(history, run, "", -1, &visitor, error);
    if (status == TL_OK && course.is_known) {
        count_until(&course, range[1] + 1);
    }
    return status;
}
