/* State of an open file: a file that is emptied at any instant is truncated, not overwritten. */
#include <fcntl.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/stat.h>
#include <unistd.h>

#include <unity.h>

#include "firmware/base/os.h"
#include "firmware/store/database_file.h"
#include "tests/support/random_numbers.h"
#include "tests/support/scratch.h"

enum { TRIALS = 2000, LONGEST_NS = 20000 };

static tl_scratch scratch;
static tl_database_file file;
static char *content;
static size_t size;

static int begin_use(void *context, sqlite3 *connection) {
    (void)context;
    (void)connection;
    return SQLITE_OK;
}

static void end_use(void *context) {
    (void)context;
}

static void write_content(const char *bytes, size_t length) {
    int descriptor = open(file.path, O_WRONLY | O_CLOEXEC);
    TEST_ASSERT_TRUE(descriptor >= 0);
    TEST_ASSERT_EQUAL_INT64(length, pwrite(descriptor, bytes, length, 0));
    (void)close(descriptor);
}

static void read_content(void) {
    struct stat status;
    int descriptor = open(file.path, O_RDONLY | O_CLOEXEC);
    TEST_ASSERT_TRUE(descriptor >= 0);
    TEST_ASSERT_EQUAL_INT(0, fstat(descriptor, &status));
    size = (size_t)status.st_size;
    content = malloc(size);
    TEST_ASSERT_NOT_NULL(content);
    TEST_ASSERT_EQUAL_INT64(size, pread(descriptor, content, size, 0));
    (void)close(descriptor);
}

void setUp(void) {
    const tl_database_user user = {begin_use, end_use, NULL};
    const char *path = tl_scratch_path(&scratch, "run.db");
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_database_file_open(path, 0, &user, &file, NULL, NULL));
    TEST_ASSERT_TRUE(tl_database_file_write_back(&file));
    tl_database_file_note(&file);
    read_content();
}

void tearDown(void) {
    tl_database_file_close(&file);
    free(content);
    tl_scratch_empty(&scratch);
}

typedef struct emptying {
    tl_time delay;
    bool is_there; /* atomic */
    bool goes;     /* atomic */
    int result;
} emptying;

static void *empty_it(void *context) {
    emptying *later = context;
    __atomic_store_n(&later->is_there, true, __ATOMIC_RELEASE);
    while (!__atomic_load_n(&later->goes, __ATOMIC_ACQUIRE)) {
    }
    tl_time until = tl_clock_now(NULL) + later->delay;
    while (tl_clock_now(NULL) < until) {
    }
    later->result = truncate(file.path, 0);
    return NULL;
}

static tl_database_file_state look_while_it_is_emptied(tl_time delay) {
    emptying later = {.delay = delay};
    tl_database_file_state found = TL_DATABASE_IN_PLACE;
    pthread_t thread;
    TEST_ASSERT_EQUAL_INT(0, pthread_create(&thread, NULL, empty_it, &later));
    while (!__atomic_load_n(&later.is_there, __ATOMIC_ACQUIRE)) {
    }
    __atomic_store_n(&later.goes, true, __ATOMIC_RELEASE);
    while (found == TL_DATABASE_IN_PLACE) {
        found = tl_database_file_check(&file);
    }
    TEST_ASSERT_EQUAL_INT(0, pthread_join(thread, NULL));
    TEST_ASSERT_EQUAL_INT(0, later.result);
    return found;
}

static void test_emptied_at_any_instant(void) {
    tl_test_random dice = {20261126};
    for (int i = 0; i < TRIALS; i++) {
        tl_time delay = (tl_time)tl_test_random_below(&dice, LONGEST_NS);
        TEST_ASSERT_EQUAL_INT(TL_DATABASE_CUT, look_while_it_is_emptied(delay));
        write_content(content, size);
        TEST_ASSERT_EQUAL_INT(TL_DATABASE_IN_PLACE, tl_database_file_check(&file));
    }
}

static void test_another_content(void) {
    static const char foreign[] = "date;speed\n";
    TEST_ASSERT_EQUAL_INT(0, truncate(file.path, 0));
    write_content(foreign, sizeof foreign - 1);
    TEST_ASSERT_EQUAL_INT(TL_DATABASE_OVERWRITTEN, tl_database_file_check(&file));
    TEST_ASSERT_EQUAL_INT(0, truncate(file.path, 0));
    write_content(content, size);
}

static void test_cut_in_half(void) {
    TEST_ASSERT_EQUAL_INT(0, truncate(file.path, (off_t)(size / 2)));
    TEST_ASSERT_EQUAL_INT(TL_DATABASE_CUT, tl_database_file_check(&file));
    write_content(content, size);
    TEST_ASSERT_EQUAL_INT(TL_DATABASE_IN_PLACE, tl_database_file_check(&file));
}

int main(void) {
    tl_scratch_make(&scratch, TL_BINARY_DIR, "database_look");
    UNITY_BEGIN();
    RUN_TEST(test_emptied_at_any_instant);
    RUN_TEST(test_another_content);
    RUN_TEST(test_cut_in_half);
    return tl_scratch_finish(&scratch, UNITY_END());
}
