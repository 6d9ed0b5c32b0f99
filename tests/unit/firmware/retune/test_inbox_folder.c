/* The folder of an inbox: which files count as complete. Real files, in a real folder. */
#include "firmware/retune/inbox_folder.h"

#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "tests/support/scratch.h"
#include "unity.h"

static tl_scratch scratch;
static tl_inbox_folder folder;
static char name[NAME_MAX + 1];
static tl_error error;

static const tl_time SOON = TL_SECOND / 20;
static const tl_time LATER = 2 * TL_SECOND;

void setUp(void) {
    tl_scratch_empty(&scratch);
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_inbox_folder_open(scratch.folder, &folder, &error));
}

void tearDown(void) {
    tl_inbox_folder_close(&folder);
}

static FILE *begin_file(const char *of) {
    FILE *file = fopen(tl_scratch_path(&scratch, of), "w");
    TEST_ASSERT_NOT_NULL(file);
    (void)fputs("{}", file);
    (void)fflush(file);
    return file;
}

static void make(const char *of) {
    (void)fclose(begin_file(of));
}

static void move(const char *from, const char *to) {
    char path[PATH_MAX];
    (void)snprintf(path, sizeof path, "%s", tl_scratch_path(&scratch, from));
    TEST_ASSERT_EQUAL_INT(0, rename(path, tl_scratch_path(&scratch, to)));
}

/* What comes first within that time. */
static tl_inbox_news next(tl_time time) {
    tl_inbox_news news = TL_INBOX_NOTHING;
    for (tl_time waited = 0; news == TL_INBOX_NOTHING && waited < time; waited += SOON) {
        news = tl_inbox_folder_next(&folder, SOON, name);
    }
    return news;
}

static void test_names(void) {
    static const char *const good[] = {"a.json", "motor bench.json", "a.b.json", "ä.json"};
    static const char *const bad[] = {"a",       ".a.json",      ".json",       "a.json.part",       "a.tmp",
                                      "a.json~", "a.json.taken", "a.JSON.part", "a.json.result.txt", ""};
    char longest[NAME_MAX + 1];
    for (size_t i = 0; i < sizeof good / sizeof good[0]; i++) {
        TEST_ASSERT_TRUE_MESSAGE(tl_inbox_folder_wants(good[i]), good[i]);
    }
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        TEST_ASSERT_FALSE_MESSAGE(tl_inbox_folder_wants(bad[i]), bad[i]);
    }
    memset(longest, 'a', NAME_MAX);
    memcpy(longest + NAME_MAX - strlen(".json"), ".json", strlen(".json") + 1);
    TEST_ASSERT_FALSE(tl_inbox_folder_wants(longest)); /* its result could not be called so */
    TEST_ASSERT_TRUE(tl_inbox_folder_wants(longest + strlen(TL_INBOX_RESULT) + 1));
}

static void test_renamed(void) {
    make("a.json.part");
    TEST_ASSERT_EQUAL_INT(TL_INBOX_NOTHING, next(LATER));
    move("a.json.part", "a.json");
    TEST_ASSERT_EQUAL_INT(TL_INBOX_COMPLETE, next(SOON));
    TEST_ASSERT_EQUAL_STRING("a.json", name);
    TEST_ASSERT_EQUAL_INT(TL_INBOX_NOTHING, next(LATER));
}

static void test_linked(void) {
    char path[PATH_MAX];
    make("a.json.part");
    (void)snprintf(path, sizeof path, "%s", tl_scratch_path(&scratch, "a.json.part"));
    TEST_ASSERT_EQUAL_INT(0, link(path, tl_scratch_path(&scratch, "a.json")));
    (void)unlink(path);
    TEST_ASSERT_EQUAL_INT(TL_INBOX_COMPLETE, next(LATER));
}

/* However long its writer pauses: it is told at the end that it was written so. */
static void test_written_in_place(void) {
    FILE *file = begin_file("a.json");
    TEST_ASSERT_EQUAL_INT(TL_INBOX_NOTHING, next(LATER));
    tl_inbox_folder_repeat(&folder);
    (void)fputs("{}", file);
    (void)fflush(file);
    TEST_ASSERT_EQUAL_INT(TL_INBOX_NOTHING, next(LATER));
    (void)fclose(file);
    TEST_ASSERT_EQUAL_INT(TL_INBOX_IN_PLACE, next(LATER));
    TEST_ASSERT_EQUAL_STRING("a.json", name);
}

/* Files that somebody writes to for ever are not in the way of others. */
static void test_many_writers(void) {
    FILE *files[TL_INBOX_WAITING + 8];
    char file[32];
    for (int i = 0; i < TL_INBOX_WAITING + 8; i++) {
        (void)snprintf(file, sizeof file, "%d.json", i);
        files[i] = begin_file(file);
        (void)next(SOON);
    }
    make("part");
    move("part", "a.json");
    TEST_ASSERT_EQUAL_INT(TL_INBOX_COMPLETE, next(LATER));
    TEST_ASSERT_EQUAL_STRING("a.json", name);
    for (int i = 0; i < TL_INBOX_WAITING + 8; i++) {
        (void)fclose(files[i]);
    }
}

/* Made, and nothing written to it yet. */
static void test_empty(void) {
    FILE *file = fopen(tl_scratch_path(&scratch, "a.json"), "w");
    TEST_ASSERT_EQUAL_INT(TL_INBOX_NOTHING, next(LATER));
    (void)fclose(file);
}

static void test_there_before(void) {
    tl_inbox_folder_close(&folder);
    make("a.json");
    make("b.json.part");
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_inbox_folder_open(scratch.folder, &folder, &error));
    TEST_ASSERT_EQUAL_INT(TL_INBOX_COMPLETE, next(LATER));
    TEST_ASSERT_EQUAL_INT(TL_INBOX_NOTHING, next(LATER));
    tl_inbox_folder_repeat(&folder);
    TEST_ASSERT_EQUAL_INT(TL_INBOX_COMPLETE, next(LATER));
}

/* More than are remembered: none is lost, and all that comes before is told first. */
static void test_very_many(void) {
    char file[32];
    enum { MANY = 5 * TL_INBOX_WAITING };
    for (int i = 0; i < MANY; i++) {
        (void)snprintf(file, sizeof file, "%d.json", i);
        make("part");
        move("part", file);
    }
    for (int i = 0; i < MANY; i++) {
        TEST_ASSERT_EQUAL_INT(TL_INBOX_COMPLETE, next(LATER));
        TEST_ASSERT_EQUAL_INT(0, unlink(tl_scratch_path(&scratch, name)));
    }
    TEST_ASSERT_EQUAL_INT(TL_INBOX_NOTHING, next(LATER));
}

static void test_gone(void) {
    char moved[PATH_MAX + 8];
    (void)snprintf(moved, sizeof moved, "%s.moved", scratch.folder);
    TEST_ASSERT_EQUAL_INT(0, rename(scratch.folder, moved));
    TEST_ASSERT_EQUAL_INT(TL_INBOX_GONE, next(LATER));
    TEST_ASSERT_EQUAL_INT(0, rename(moved, scratch.folder));
    tl_inbox_folder_close(&folder);
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, tl_inbox_folder_open("/nowhere/inbox", &folder, &error));
    TEST_ASSERT_NOT_NULL(strstr(error.text, "/nowhere/inbox"));
}

int main(void) {
    tl_scratch_make(&scratch, ".", "inbox");
    UNITY_BEGIN();
    RUN_TEST(test_names);
    RUN_TEST(test_renamed);
    RUN_TEST(test_linked);
    RUN_TEST(test_written_in_place);
    RUN_TEST(test_many_writers);
    RUN_TEST(test_empty);
    RUN_TEST(test_there_before);
    RUN_TEST(test_very_many);
    RUN_TEST(test_gone);
    return tl_scratch_finish(&scratch, UNITY_END());
}
