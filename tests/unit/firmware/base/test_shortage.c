/* Opening an FMU or a library without descriptors or memory: the status is "try again". */
#include <errno.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <unistd.h>

#include <unity.h>

#include "board/csv/csv.h"
#include "firmware/base/os.h"
#include "firmware/fmu/fmu_archive.h"
#include "firmware/fmu/fmu_binary.h"
#include "firmware/fmu/fmu_store.h"
#include "tests/support/message.h"
#include "tests/support/scratch.h"

#define MOTOR TL_BINARY_DIR "/fmus/motor.fmu"

static const tl_model model = {.name = "motor", .identifier = "motor"};
static tl_scratch scratch;
static tl_private_folder folder;
static tl_fmu_guard guard;
static tl_error error;
static struct rlimit usual;

void setUp(void) {
    error = (tl_error){TL_OK, ""};
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_fmu_archive_unpack(MOTOR, -1, "motor", &folder, &error));
    tl_fmu_guard_open(&guard, "motor", "");
}

void tearDown(void) {
    tl_fmu_guard_close(&guard);
    tl_private_folder_remove(&folder);
}

static void expect_try_again(tl_status status, const char *parts) {
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_TRY_AGAIN, status, error.text);
    TL_EXPECT_PARTS(parts, error.text);
}

/* Limits the process to `count` further descriptors. */
static void leave_descriptors(rlim_t count) {
    int lowest = dup(STDERR_FILENO); /* all lower ones are in use */
    TEST_ASSERT_TRUE(lowest >= 0);
    TEST_ASSERT_EQUAL_INT(0, close(lowest));
    TEST_ASSERT_EQUAL_INT(0, getrlimit(RLIMIT_NOFILE, &usual));
    const struct rlimit tight = {.rlim_cur = (rlim_t)lowest + count, .rlim_max = usual.rlim_max};
    TEST_ASSERT_EQUAL_INT(0, setrlimit(RLIMIT_NOFILE, &tight));
}

static void put_back(void) {
    TEST_ASSERT_EQUAL_INT(0, setrlimit(RLIMIT_NOFILE, &usual));
}

static void test_errors_of_a_shortage(void) {
    TEST_ASSERT_TRUE(tl_shortage_is(EMFILE) && tl_shortage_is(ENFILE) && tl_shortage_is(ENOMEM));
    TEST_ASSERT_TRUE(tl_shortage_is(ENOSPC) && tl_shortage_is(EDQUOT));
    TEST_ASSERT_FALSE(tl_shortage_is(0) || tl_shortage_is(ENOENT) || tl_shortage_is(EACCES));
    TEST_ASSERT_TRUE(tl_shortage_is_reported("libm.so: cannot open shared object file: Too many open files"));
    TEST_ASSERT_FALSE(tl_shortage_is_reported("libm.so: cannot open shared object file: Permission denied"));
}

static void test_no_descriptor_for_a_binary(void) {
    leave_descriptors(0);
    tl_status status = tl_fmu_binary_open(folder.path, &model, "motor", &guard, &error);
    put_back();
    expect_try_again(status, "motor.so|Too many open files");
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_fmu_binary_open(folder.path, &model, "motor", &guard, &error));
}

static void test_no_descriptor_for_a_library(void) {
    leave_descriptors(0);
    tl_status status = tl_library_open(TL_BINARY_DIR "/tests/interpreter-3.8.1.so", &error);
    put_back();
    expect_try_again(status, "interpreter-3.8.1.so|Too many open files");
}

static void test_no_descriptor_for_a_recording(void) {
    const tl_csv_settings settings = {.path = TL_SOURCE_DIR "/config/motor/recording.csv", .time_column = "t"};
    tl_csv_reader *reader = NULL;
    leave_descriptors(0);
    tl_status status = tl_csv_open(&settings, &reader, &error);
    put_back();
    expect_try_again(status, "recording.csv|Too many open files");
}

static void expect_no_memory(const char *parts) {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
    (void)parts;
    TEST_IGNORE_MESSAGE("a sanitizer needs its address space");
#else
    if (getenv("TL_EMULATOR") != NULL) {
        TEST_IGNORE_MESSAGE("an emulator does not limit the address space");
    }
    free(malloc(64 * 1024)); /* leaves room on the heap, so that only mmap() fails */
    TEST_ASSERT_EQUAL_INT(0, getrlimit(RLIMIT_AS, &usual));
    const struct rlimit tight = {.rlim_cur = 4096, .rlim_max = usual.rlim_max};
    TEST_ASSERT_EQUAL_INT(0, setrlimit(RLIMIT_AS, &tight));
    tl_status status = tl_fmu_binary_open(folder.path, &model, "motor", &guard, &error);
    TEST_ASSERT_EQUAL_INT(0, setrlimit(RLIMIT_AS, &usual));
    expect_try_again(status, parts);
#endif
}

/* dlopen() cannot map the binary. The first binary of a process is not read before dlopen(). */
static void test_no_memory_for_a_binary(void) {
    expect_no_memory("motor.so|failed to map");
}

static void test_no_memory_to_read_a_second_binary(void) {
    expect_no_memory("motor.so|Cannot allocate memory");
}

/* Adds a descriptor each time until an FMU can be loaded. A failure leaves no temporary file. */
static void test_descriptors_one_by_one(void) {
    enum { MOST = 16 };
    int enough = -1;
    for (int count = 0; count < MOST; count++) {
        tl_fmu fmu;
        leave_descriptors((rlim_t)count);
        tl_status status = tl_fmu_load(MOTOR, -1, TL_ROLLBACK_STATE, &fmu, &error);
        put_back();
        if (status == TL_OK) {
            enough = enough < 0 ? count : enough;
            tl_fmu_unload(&fmu);
        } else {
            expect_try_again(status, "Too many open files");
        }
        TEST_ASSERT_TRUE_MESSAGE((status == TL_OK) == (enough >= 0), error.text);
        TEST_ASSERT_EQUAL_INT(1, tl_scratch_count(&scratch)); /* the folder of setUp() */
    }
    TEST_ASSERT_TRUE(enough > 2);
}

int main(void) {
    UNITY_BEGIN();
    tl_scratch_make(&scratch, "/tmp", "test_shortage");
    if (setenv("TMPDIR", scratch.folder, 1) != 0) {
        return EXIT_FAILURE;
    }
    RUN_TEST(test_no_memory_for_a_binary);
    RUN_TEST(test_no_memory_to_read_a_second_binary);
    RUN_TEST(test_errors_of_a_shortage);
    RUN_TEST(test_no_descriptor_for_a_binary);
    RUN_TEST(test_no_descriptor_for_a_library);
    RUN_TEST(test_no_descriptor_for_a_recording);
    RUN_TEST(test_descriptors_one_by_one);
    tl_scratch_remove(&scratch);
    return UNITY_END();
}
