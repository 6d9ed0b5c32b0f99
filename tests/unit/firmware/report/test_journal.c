/* The journal: events of all threads reach the log once and in order, and the database. */
#include <pthread.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <unity.h>

#include "firmware/report/journal.h"
#include "tests/support/made_run.h"
#include "tests/support/message.h"
#include "tests/support/scratch.h"
#include "tests/support/sql.h"
#include "tests/support/stderr_capture.h"

enum { WRITERS = 4, EVENTS = 2000 };

static tl_journal journal;
static tl_scratch scratch;

void setUp(void) {
    tl_journal_init(&journal, NULL);
}

void tearDown(void) {
    tl_scratch_empty(&scratch);
}

/* Returns what drain() writes to the log; free() it. */
static char *drained(void) {
    TEST_ASSERT_TRUE(tl_stderr_capture_begin());
    tl_journal_drain(&journal);
    char *text = tl_stderr_capture_end();
    TEST_ASSERT_NOT_NULL(text);
    return text;
}

static void expect_drained(const char *expected) {
    TEST_ASSERT_TRUE(tl_stderr_capture_begin());
    tl_journal_drain(&journal);
    tl_stderr_expect(expected);
}

static void test_events_are_logged_in_order(void) {
    tl_journal_event(&journal, -1, TL_EVENT_INFO, "plant", "%s is there", "inverter");
    tl_journal_event(&journal, 7, TL_EVENT_WARNING, "cycle", "%d ticks missed", 3);
    tl_journal_event(&journal, 8, TL_EVENT_ERROR, "twin", "over");
    expect_drained("twinlock: notice: plant: inverter is there\n"
                   "twinlock: warning: cycle: 3 ticks missed\n"
                   "twinlock: error: twin: over\n");
    expect_drained("");
}

static void count_event(void *context, int64_t tick, tl_severity severity, const char *source, const char *text) {
    size_t *event_count = context;
    TEST_ASSERT_TRUE(tick != 7 && severity != TL_EVENT_WARNING && source != NULL && text != NULL);
    (*event_count)++;
}

/* Events of a shadow go only to the log, and are marked there. */
static void test_events_of_a_shadow(void) {
    size_t event_count = 0;
    tl_journal_listen(&journal, count_event, &event_count);
    tl_journal_event(&journal, 6, TL_EVENT_INFO, "cycle", "before");
    tl_journal_set_apart(&journal, true);
    TEST_ASSERT_TRUE(tl_journal_is_apart(&journal));
    tl_journal_event(&journal, 7, TL_EVENT_WARNING, "cycle", "meanwhile");
    tl_journal_set_apart(&journal, false);
    tl_journal_event(&journal, 8, TL_EVENT_INFO, "cycle", "after");
    TEST_ASSERT_EQUAL_size_t(2, event_count);
    expect_drained("twinlock: notice: cycle: before\n"
                   "twinlock: warning: shadow: cycle: meanwhile\n"
                   "twinlock: notice: cycle: after\n");
}

static void test_repeated_events_are_counted(void) {
    for (int i = 0; i < 50; i++) {
        tl_journal_event(&journal, i, TL_EVENT_WARNING, "plant", "x1 is %d.5", i);
    }
    expect_drained("twinlock: warning: plant: x1 is 0.5\n"
                   "twinlock: warning: plant: x1 is 1.5\n");
    TEST_ASSERT_TRUE(tl_stderr_capture_begin());
    tl_journal_end(&journal);
    tl_stderr_expect("twinlock: warning: plant: x1 is 49.5 (47 more were not logged)\n");
}

static void test_long_texts_are_cut(void) {
    char text[2 * TL_JOURNAL_TEXT];
    memset(text, 'x', sizeof text - 1);
    text[sizeof text - 1] = '\0';
    tl_journal_event(&journal, -1, TL_EVENT_INFO, "a_source_with_a_long_name", "%s", text);
    char *log = drained();
    TEST_ASSERT_EQUAL_STRING_LEN("twinlock: notice: a_source_with_a: x", log, 36);
    TEST_ASSERT_EQUAL_size_t(35 + TL_JOURNAL_TEXT - 1 + 1, strlen(log));
    free(log);
}

/* Cuts off the last line of a text, and returns it. */
static const char *cut_last_line(char *text) {
    text[strlen(text) - 1] = '\0';
    char *before = strrchr(text, '\n');
    TEST_ASSERT_NOT_NULL(before);
    *before = '\0';
    return before + 1;
}

static void test_events_without_space_are_counted(void) {
    for (int i = 0; i < TL_JOURNAL_ENTRIES + 44; i++) {
        tl_journal_event(&journal, i, TL_EVENT_INFO, "twin", "e%d", i);
    }
    char *log = drained();
    TEST_ASSERT_EQUAL_size_t(TL_JOURNAL_ENTRIES + 1, tl_test_count_lines(log));
    const char *last = cut_last_line(log);
    TL_EXPECT_PARTS("warning|journal|44", last);
    TL_EXPECT_PARTS("twin: e255", log);
    TEST_ASSERT_FALSE(tl_test_has_parts(log, "twin: e256"));
    free(log);
    tl_journal_event(&journal, -1, TL_EVENT_INFO, "twin", "room again");
    expect_drained("twinlock: notice: twin: room again\n");
}

static void test_many_rounds(void) {
    for (int i = 0; i < 3 * TL_JOURNAL_ENTRIES; i += 100) {
        for (int k = i; k < i + 100; k++) {
            tl_journal_event(&journal, k, TL_EVENT_INFO, "twin", "e%d", k);
        }
        char *log = drained();
        char last[32];
        TEST_ASSERT_EQUAL_size_t(100, tl_test_count_lines(log));
        (void)snprintf(last, sizeof last, "twin: e%d\n", i + 99);
        TEST_ASSERT_NOT_NULL(strstr(log, last));
        free(log);
    }
}

static void test_events_go_to_the_database_too(void) {
    const char *path = tl_scratch_path(&scratch, "run.db");
    const tl_recorder_settings settings = tl_made_settings(path);
    tl_recorder *recorder = NULL;
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_recorder_open(&settings, &recorder, NULL));
    tl_journal_init(&journal, recorder);
    for (int i = 0; i < TL_JOURNAL_ENTRIES + 10; i++) {
        tl_journal_event(&journal, i, TL_EVENT_WARNING, "cycle", "event %d", i);
    }
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_recorder_close(recorder, "test", NULL, NULL));
    free(drained());
    TEST_ASSERT_EQUAL_INT64(TL_JOURNAL_ENTRIES + 10,
                            tl_sql_integer(path, "SELECT count(*) FROM events WHERE source = 'cycle'"));
    TEST_ASSERT_EQUAL_STRING("event 260", tl_sql_text(path, "SELECT text FROM events WHERE tick = 260"));
    TEST_ASSERT_EQUAL_INT64(TL_EVENT_WARNING, tl_sql_integer(path, "SELECT severity FROM events WHERE tick = 3"));
}

/* ---- several writers, one reader ---- */

static unsigned long written[WRITERS];
static unsigned running;

static void *write_events(void *argument) {
    const size_t writer = (size_t)((unsigned long *)argument - written);
    for (unsigned long i = 0; i < EVENTS; i++) {
        tl_journal_event(&journal, -1, TL_EVENT_INFO, "writer", "w%zu e%lu", writer, i);
    }
    (void)__atomic_sub_fetch(&running, 1, __ATOMIC_RELEASE);
    return NULL;
}

/* Returns the rest of a line that begins with `start`, else NULL. */
static char *after(char *line, const char *start) {
    size_t length = strlen(start);
    return strncmp(line, start, length) == 0 ? line + length : NULL;
}

/* Counts the events of each writer, in order, and the dropped ones that the journal reports. */
static void take_log(char *log, unsigned long *next, unsigned long *seen, unsigned long *dropped) {
    for (char *line = log; *line != '\0'; line = strchr(line, '\n') + 1) {
        char *event = after(line, "twinlock: notice: writer: w");
        if (event != NULL) {
            unsigned long writer = strtoul(event, &event, 10);
            unsigned long number = strtoul(event + strlen(" e"), &event, 10);
            TEST_ASSERT_EQUAL_CHAR('\n', *event);
            TEST_ASSERT_TRUE(writer < WRITERS && number >= next[writer]);
            next[writer] = number + 1;
            (*seen)++;
        } else {
            event = after(line, "twinlock: warning: journal: ");
            TEST_ASSERT_NOT_NULL(event);
            *dropped += strtoul(event + strcspn(event, "0123456789"), NULL, 10);
        }
    }
}

static void test_writers_at_once(void) {
    pthread_t threads[WRITERS];
    unsigned long next[WRITERS] = {0};
    unsigned long seen = 0;
    unsigned long dropped = 0;
    running = WRITERS;
    TEST_ASSERT_TRUE(tl_stderr_capture_begin());
    for (size_t i = 0; i < WRITERS; i++) {
        TEST_ASSERT_EQUAL_INT(0, pthread_create(&threads[i], NULL, write_events, &written[i]));
    }
    bool last = false;
    while (!last) {
        last = __atomic_load_n(&running, __ATOMIC_ACQUIRE) == 0;
        tl_journal_drain(&journal);
    }
    for (size_t i = 0; i < WRITERS; i++) {
        (void)pthread_join(threads[i], NULL);
    }
    char *log = tl_stderr_capture_end();
    take_log(log, next, &seen, &dropped);
    free(log);
    TEST_ASSERT_EQUAL_UINT64(WRITERS * EVENTS, seen + dropped);
    TEST_ASSERT_GREATER_OR_EQUAL_UINT64(TL_JOURNAL_ENTRIES, seen);
}

int main(void) {
    tl_scratch_make(&scratch, TL_BINARY_DIR, "test_journal");
    UNITY_BEGIN();
    RUN_TEST(test_events_are_logged_in_order);
    RUN_TEST(test_events_of_a_shadow);
    RUN_TEST(test_repeated_events_are_counted);
    RUN_TEST(test_long_texts_are_cut);
    RUN_TEST(test_events_without_space_are_counted);
    RUN_TEST(test_many_rounds);
    RUN_TEST(test_events_go_to_the_database_too);
    RUN_TEST(test_writers_at_once);
    tl_scratch_remove(&scratch);
    return UNITY_END();
}
