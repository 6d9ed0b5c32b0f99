/* What ran out is told from what is broken: opening an FMU's binary or a library without descriptors or memory. */
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

static void expect_try_again(tl_status status, const char *what) {
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_TRY_AGAIN, status, error.text);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, what), error.text);
}

/* Leaves `count` descriptors. */
static void leave_descriptors(rlim_t count) {
    int lowest = dup(STDERR_FILENO); /* all below are taken */
    TEST_ASSERT_TRUE(lowest >= 0);
    TEST_ASSERT_EQUAL_INT(0, close(lowest));
    TEST_ASSERT_EQUAL_INT(0, getrlimit(RLIMIT_NOFILE, &usual));
    const struct rlimit tight = {.rlim_cur = (rlim_t)lowest + count, .rlim_max = usual.rlim_max};
    TEST_ASSERT_EQUAL_INT(0, setrlimit(RLIMIT_NOFILE, &tight));
}

static void put_back(void) {
    TEST_ASSERT_EQUAL_INT(0, setrlimit(RLIMIT_NOFILE, &usual));
}

static void test_what_is_a_shortage(void) {
    TEST_ASSERT_TRUE(tl_shortage_is(EMFILE) && tl_shortage_is(ENFILE) && tl_shortage_is(ENOMEM));
    TEST_ASSERT_TRUE(tl_shortage_is(ENOSPC) && tl_shortage_is(EDQUOT));
    TEST_ASSERT_FALSE(tl_shortage_is(0) || tl_shortage_is(ENOENT) || tl_shortage_is(EACCES));
    TEST_ASSERT_TRUE(tl_shortage_is_told("libm.so: cannot open shared object file: Too many open files"));
    TEST_ASSERT_FALSE(tl_shortage_is_told("libm.so: cannot open shared object file: No such file or directory"));
}

static void test_no_descriptor_for_a_binary(void) {
    leave_descriptors(0);
    tl_status status = tl_fmu_binary_open(folder.path, &model, "motor", &guard, &error);
    put_back();
    expect_try_again(status, "motor.so cannot be opened: Too many open files; try again");
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_fmu_binary_open(folder.path, &model, "motor", &guard, &error));
}

static void test_no_descriptor_for_a_library(void) {
    leave_descriptors(0);
    tl_status status = tl_library_open(TL_BINARY_DIR "/tests/interpreter-3.8.1.so", &error);
    put_back();
    expect_try_again(status, "Too many open files; try again");
}

static void test_no_descriptor_for_a_recording(void) {
    const tl_csv_settings settings = {.path = TL_SOURCE_DIR "/config/motor/recording.csv", .time_column = "t"};
    tl_csv_reader *reader = NULL;
    leave_descriptors(0);
    tl_status status = tl_csv_open(&settings, &reader, &error);
    put_back();
    expect_try_again(status, "recording.csv cannot be opened: Too many open files");
}

static void expect_no_memory(const char *what) {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
    (void)what;
    TEST_IGNORE_MESSAGE("a sanitizer needs its address space");
#else
    if (getenv("TL_EMULATOR") != NULL) {
        TEST_IGNORE_MESSAGE("an emulator does not limit the address space");
    }
    free(malloc(64 * 1024)); /* the heap has room for all that is no map */
    TEST_ASSERT_EQUAL_INT(0, getrlimit(RLIMIT_AS, &usual));
    const struct rlimit tight = {.rlim_cur = 4096, .rlim_max = usual.rlim_max};
    TEST_ASSERT_EQUAL_INT(0, setrlimit(RLIMIT_AS, &tight));
    tl_status status = tl_fmu_binary_open(folder.path, &model, "motor", &guard, &error);
    TEST_ASSERT_EQUAL_INT(0, setrlimit(RLIMIT_AS, &usual));
    expect_try_again(status, what);
#endif
}

/* dlopen() finds no room to map it. The first binary of the process: nothing looks into that before. */
static void test_no_memory_for_a_binary(void) {
    expect_no_memory("failed to map segment from shared object; free memory or descriptors and try again");
}

static void test_no_memory_to_look_into_a_second_binary(void) {
    expect_no_memory("motor.so cannot be read: Cannot allocate memory; free memory, descriptors or disk and try again");
}

/* One more each time, until an FMU can be loaded; nothing of it stays in the folder for temporary files. */
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
        TEST_ASSERT_EQUAL_INT(1, tl_scratch_count(&scratch)); /* that of setUp() */
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
    RUN_TEST(test_no_memory_to_look_into_a_second_binary);
    RUN_TEST(test_what_is_a_shortage);
    RUN_TEST(test_no_descriptor_for_a_binary);
    RUN_TEST(test_no_descriptor_for_a_library);
    RUN_TEST(test_no_descriptor_for_a_recording);
    RUN_TEST(test_descriptors_one_by_one);
    tl_scratch_remove(&scratch);
    return UNITY_END();
}
