/* Blocks: what is written here is read there, and neither size nor foreign content can be changed. */
#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <unity.h>

#include "firmware/process/block.h"

enum { SIZE = 10000 };

static tl_block block;
static tl_error error;

void setUp(void) {
    block = (tl_block){0};
    error = (tl_error){TL_OK, ""};
}

void tearDown(void) {
    tl_block_close(&block);
}

static void need_seals(unsigned seals) {
    if ((block.seals & seals) != seals) {
        TEST_IGNORE_MESSAGE("no such seals on this kernel");
    }
}

static void make(tl_block_writer writer) {
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_block_make("test", SIZE, writer, &block, &error));
    TEST_ASSERT_EQUAL_size_t(SIZE, block.size);
    TEST_ASSERT_EACH_EQUAL_UINT8(0, block.bytes, SIZE);
}

static void test_size_is_sealed(void) {
    make(TL_BLOCK_THEY_WRITE);
    need_seals(F_SEAL_SHRINK);
    TEST_ASSERT_EQUAL_INT(-1, ftruncate(block.descriptor, 100));
    TEST_ASSERT_EQUAL_INT(-1, ftruncate(block.descriptor, 100000));
    TEST_ASSERT_EQUAL_INT(-1, fcntl(block.descriptor, F_ADD_SEALS, F_SEAL_WRITE));
    TEST_ASSERT_EQUAL_INT(EPERM, errno);
    TEST_ASSERT_EQUAL_INT(FD_CLOEXEC, fcntl(block.descriptor, F_GETFD));
}

/* Another process takes it, at another address. */
static void test_two_processes(void) {
    int status = 0;
    make(TL_BLOCK_THEY_WRITE);
    pid_t pid = fork();
    TEST_ASSERT_NOT_EQUAL_INT(-1, pid);
    if (pid == 0) {
        tl_block taken;
        bool same = tl_block_take(block.descriptor, SIZE, TL_BLOCK_THEY_WRITE, &taken, &error) == TL_OK &&
                    taken.bytes != block.bytes;
        memcpy(taken.bytes, "hello", 6);
        _exit(same ? 0 : 1);
    }
    TEST_ASSERT_EQUAL_INT(pid, waitpid(pid, &status, 0));
    TEST_ASSERT_EQUAL_INT(0, status);
    TEST_ASSERT_EQUAL_STRING("hello", block.bytes);
}

/* Neither by a mapping, nor by its protection, nor by the descriptor, nor by one opened anew. */
static void test_who_takes_ours_reads_only(void) {
    make(TL_BLOCK_WE_WRITE);
    need_seals(F_SEAL_FUTURE_WRITE);
    tl_block taken;
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_block_take(dup(block.descriptor), SIZE, TL_BLOCK_WE_WRITE, &taken, &error));
    memcpy(block.bytes, "news", 5);
    TEST_ASSERT_EQUAL_STRING("news", taken.bytes);
    void *writable = mmap(NULL, SIZE, PROT_READ | PROT_WRITE, MAP_SHARED, taken.descriptor, 0);
    TEST_ASSERT_TRUE(writable == MAP_FAILED);
    TEST_ASSERT_EQUAL_INT(-1, mprotect(taken.bytes, SIZE, PROT_READ | PROT_WRITE));
    TEST_ASSERT_EQUAL_INT(-1, pwrite(taken.descriptor, "x", 1, 0));
    char path[64];
    (void)snprintf(path, sizeof path, "/proc/self/fd/%d", taken.descriptor);
    int again = open(path, O_RDWR);
    if (again >= 0) {
        TEST_ASSERT_EQUAL_INT(-1, pwrite(again, "x", 1, 0));
        (void)close(again);
    }
    tl_block_close(&taken);
}

static void test_one_that_is_written(void) {
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_block_make_of("job", "work", 5, &block, &error));
    TEST_ASSERT_EQUAL_STRING("work", block.bytes);
    need_seals(F_SEAL_WRITE);
    TEST_ASSERT_EQUAL_INT(-1, pwrite(block.descriptor, "x", 1, 0));
    tl_block taken;
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_block_take(dup(block.descriptor), 0, TL_BLOCK_IS_WRITTEN, &taken, &error));
    TEST_ASSERT_EQUAL_size_t(5, taken.size);
    TEST_ASSERT_EQUAL_STRING("work", taken.bytes);
    tl_block_close(&taken);
}

static void refuse(int descriptor, size_t size, tl_block_writer writer, const char *why) {
    tl_block taken;
    TEST_ASSERT_NOT_EQUAL_INT(-1, descriptor);
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, tl_block_take(descriptor, size, writer, &taken, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, why), error.text);
    TEST_ASSERT_NULL(taken.bytes);
    TEST_ASSERT_EQUAL_INT(-1, fcntl(descriptor, F_GETFD)); /* it was closed */
}

static void test_another_size_is_refused(void) {
    make(TL_BLOCK_THEY_WRITE);
    refuse(dup(block.descriptor), SIZE + 1, TL_BLOCK_THEY_WRITE, "another size");
    refuse(memfd_create("empty", MFD_ALLOW_SEALING), 0, TL_BLOCK_IS_WRITTEN, "another size");
}

static void test_unsealed_is_refused(void) {
    make(TL_BLOCK_THEY_WRITE);
    need_seals(F_SEAL_SHRINK);
    int file = memfd_create("unsealed", MFD_ALLOW_SEALING);
    TEST_ASSERT_EQUAL_INT(0, ftruncate(file, SIZE));
    refuse(file, SIZE, TL_BLOCK_THEY_WRITE, "change its size");
    refuse(dup(block.descriptor), SIZE, TL_BLOCK_IS_WRITTEN, "be written");
}

static void test_what_is_no_memory_is_refused(void) {
    int ends[2];
    tl_block taken;
    TEST_ASSERT_EQUAL_INT(0, pipe(ends));
    refuse(ends[0], 0, TL_BLOCK_IS_WRITTEN, "no shared memory");
    (void)close(ends[1]);
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, tl_block_take(-1, 0, TL_BLOCK_IS_WRITTEN, &taken, &error));
    TEST_ASSERT_NOT_NULL(strstr(error.text, "not open"));
}

/* With such a limit of the process. */
static void fail_with(unsigned resource, rlim_t limit) {
    struct rlimit before;
    TEST_ASSERT_EQUAL_INT(0, getrlimit(resource, &before));
    const struct rlimit less = {.rlim_cur = limit, .rlim_max = before.rlim_max};
    TEST_ASSERT_EQUAL_INT(0, setrlimit(resource, &less));
    tl_status made = tl_block_make("test", SIZE, TL_BLOCK_WE_WRITE, &block, &error);
    tl_status made_of = tl_block_make_of("test", &block, sizeof block, &block, &error);
    (void)setrlimit(resource, &before);
    TEST_ASSERT_EQUAL_INT(TL_TRY_AGAIN, made);
    TEST_ASSERT_EQUAL_INT(TL_TRY_AGAIN, made_of);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "\"test\""), error.text);
    TEST_ASSERT_NULL(block.bytes);
}

static void test_what_is_missing(void) {
    fail_with(RLIMIT_NOFILE, 3);
    (void)signal(SIGXFSZ, SIG_IGN);
    fail_with(RLIMIT_FSIZE, 10);
    (void)signal(SIGXFSZ, SIG_DFL);
}

static void test_none_can_be_closed(void) {
    int before = dup(0);
    tl_block_close(&block);
    tl_block_close(&block);
    TEST_ASSERT_NOT_EQUAL_INT(-1, fcntl(0, F_GETFD));
    (void)close(before);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_size_is_sealed);
    RUN_TEST(test_two_processes);
    RUN_TEST(test_who_takes_ours_reads_only);
    RUN_TEST(test_one_that_is_written);
    RUN_TEST(test_another_size_is_refused);
    RUN_TEST(test_unsealed_is_refused);
    RUN_TEST(test_what_is_no_memory_is_refused);
    RUN_TEST(test_what_is_missing);
    RUN_TEST(test_none_can_be_closed);
    return UNITY_END();
}
