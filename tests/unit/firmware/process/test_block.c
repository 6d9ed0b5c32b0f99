/* Blocks of shared memory: both sides see the content, and seals protect size and content. */
#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <unity.h>

#include "firmware/process/block.h"
#include "tests/support/confined.h"
#include "tests/support/message.h"

enum { SIZE = 10000, LARGE = 64 * 1024 * 1024, PAGE = 4096 };

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

/* Another process maps the block at another address. */
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

/* A reader cannot write by mmap(), mprotect(), its descriptor, or a reopened descriptor. */
static void test_a_taken_block_is_read_only(void) {
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

static void test_a_written_block_is_read_only(void) {
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

static void refuse(int descriptor, size_t size, tl_block_writer writer, const char *parts) {
    tl_block taken;
    char shown[16];
    TEST_ASSERT_NOT_EQUAL_INT(-1, descriptor);
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, tl_block_take(descriptor, size, writer, &taken, &error));
    (void)snprintf(shown, sizeof shown, "%d", descriptor);
    TL_EXPECT_PARTS(shown, error.text);
    TL_EXPECT_PARTS(parts, error.text);
    TEST_ASSERT_NULL(taken.bytes);
    TEST_ASSERT_EQUAL_INT(-1, fcntl(descriptor, F_GETFD)); /* closed by tl_block_take() */
}

static void test_another_size_is_refused(void) {
    make(TL_BLOCK_THEY_WRITE);
    refuse(dup(block.descriptor), SIZE + 1, TL_BLOCK_THEY_WRITE, "size");
    refuse(memfd_create("empty", MFD_ALLOW_SEALING), 0, TL_BLOCK_IS_WRITTEN, "size");
}

static void test_unsealed_is_refused(void) {
    make(TL_BLOCK_THEY_WRITE);
    need_seals(F_SEAL_SHRINK);
    int file = memfd_create("unsealed", MFD_ALLOW_SEALING);
    TEST_ASSERT_EQUAL_INT(0, ftruncate(file, SIZE));
    refuse(file, SIZE, TL_BLOCK_THEY_WRITE, "change");
    refuse(dup(block.descriptor), SIZE, TL_BLOCK_IS_WRITTEN, "written");
}

static void test_other_descriptors_are_refused(void) {
    int ends[2];
    tl_block taken;
    TEST_ASSERT_EQUAL_INT(0, pipe(ends));
    refuse(ends[0], 0, TL_BLOCK_IS_WRITTEN, "shared memory");
    (void)close(ends[1]);
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, tl_block_take(-1, 0, TL_BLOCK_IS_WRITTEN, &taken, &error));
    TL_EXPECT_PARTS("-1|open", error.text);
}

/* No block can be made under this resource limit. */
static void fail_with(unsigned resource, rlim_t limit) {
    struct rlimit before;
    TEST_ASSERT_EQUAL_INT(0, getrlimit(resource, &before));
    const struct rlimit less = {.rlim_cur = limit, .rlim_max = before.rlim_max};
    TEST_ASSERT_EQUAL_INT(0, setrlimit(resource, &less));
    tl_status made = tl_block_make("test", SIZE, TL_BLOCK_WE_WRITE, &block, &error);
    tl_status made_of = tl_block_make_of("test", &block, sizeof block, &block, &error);
    tl_status sparse = tl_block_make("test", SIZE, TL_BLOCK_SPARSE, &block, &error);
    (void)setrlimit(resource, &before);
    TEST_ASSERT_EQUAL_INT(TL_TRY_AGAIN, made);
    TEST_ASSERT_EQUAL_INT(TL_TRY_AGAIN, made_of);
    TEST_ASSERT_EQUAL_INT(TL_TRY_AGAIN, sparse);
    TL_EXPECT_PARTS("10000 bytes|\"test\"", error.text);
    TEST_ASSERT_NULL(block.bytes);
}

static void test_resource_limits(void) {
    fail_with(RLIMIT_NOFILE, 3);
    (void)signal(SIGXFSZ, SIG_IGN);
    fail_with(RLIMIT_FSIZE, 10);
    (void)signal(SIGXFSZ, SIG_DFL);
}

static void test_closing_an_empty_block_does_nothing(void) {
    int before = dup(0);
    tl_block_close(&block);
    tl_block_close(&block);
    TEST_ASSERT_NOT_EQUAL_INT(-1, fcntl(0, F_GETFD));
    (void)close(before);
}

/* ---- blocks that another process writes ---- */

static void make_sparse(size_t size) {
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_block_make("test", size, TL_BLOCK_SPARSE, &block, &error), error.text);
    TEST_ASSERT_NULL(block.bytes);
    TEST_ASSERT_EQUAL_size_t(size, block.size);
}

/* Maps the block as its writer does. */
static void take_for_writing(tl_block *taken) {
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_block_take(dup(block.descriptor), block.size, TL_BLOCK_THEY_WRITE, taken, &error));
}

static long pages_used(void) {
    struct stat about;
    TEST_ASSERT_EQUAL_INT(0, fstat(block.descriptor, &about));
    return (long)about.st_blocks * 512 / PAGE;
}

static void test_a_sparse_block_takes_only_used_pages(void) {
    tl_block taken;
    make_sparse(LARGE);
    TEST_ASSERT_EQUAL_INT(FD_CLOEXEC, fcntl(block.descriptor, F_GETFD));
    TEST_ASSERT_EQUAL_INT(0, pages_used());
    take_for_writing(&taken);
    unsigned char *bytes = taken.bytes;
    bytes[0] = 1;
    bytes[LARGE - 1] = 2;
    TEST_ASSERT_EQUAL_UINT8(0, bytes[LARGE / 2]);
    TEST_ASSERT_LESS_OR_EQUAL_INT(3, pages_used());
    tl_block_close(&taken);
}

static void test_the_size_of_a_sparse_block_is_sealed(void) {
    make_sparse(SIZE);
    need_seals(F_SEAL_SHRINK);
    TEST_ASSERT_EQUAL_INT(-1, ftruncate(block.descriptor, 100));
    TEST_ASSERT_EQUAL_INT(-1, ftruncate(block.descriptor, LARGE));
    TEST_ASSERT_EQUAL_INT(-1, fcntl(block.descriptor, F_ADD_SEALS, F_SEAL_WRITE));
}

static void test_an_unmapped_block_is_closed(void) {
    make_sparse(SIZE);
    int descriptor = block.descriptor;
    tl_block_close(&block);
    TEST_ASSERT_EQUAL_INT(-1, fcntl(descriptor, F_GETFD));
    TEST_ASSERT_EQUAL_size_t(0, block.size);
}

/* A real-time process locks its memory; its pages are freed all the same. */
static void test_forgotten_pages_are_freed(void) {
    tl_block taken;
    make_sparse(LARGE);
    take_for_writing(&taken);
    unsigned char *bytes = taken.bytes;
    memset(bytes, 7, (size_t)8 * PAGE);
    if (mlock(bytes, (size_t)8 * PAGE) != 0) {
        TEST_MESSAGE("memory cannot be locked");
    }
    TEST_ASSERT_EQUAL_INT(8, pages_used());
    tl_block_forget(&taken);
    TEST_ASSERT_EQUAL_INT(0, pages_used());
    for (size_t i = 0; i < (size_t)8 * PAGE; i++) {
        TEST_ASSERT_EQUAL_UINT8(0, bytes[i]);
    }
    bytes[3 * PAGE] = 9;
    TEST_ASSERT_EQUAL_UINT8(9, bytes[3 * PAGE]);
    tl_block_close(&taken);
}

static void test_a_reader_reads(void) {
    tl_block taken;
    tl_block read;
    make_sparse(SIZE);
    int reader = tl_block_reader(&block);
    TEST_ASSERT_NOT_EQUAL_INT(-1, reader);
    TEST_ASSERT_EQUAL_INT(FD_CLOEXEC, fcntl(reader, F_GETFD));
    take_for_writing(&taken); /* must not prevent the reader from mapping */
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_block_take(reader, SIZE, TL_BLOCK_WE_WRITE, &read, &error));
    memcpy(taken.bytes, "news", 5);
    TEST_ASSERT_EQUAL_STRING("news", read.bytes);
    int second = tl_block_reader(&block);
    TEST_ASSERT_NOT_EQUAL_INT(-1, second);
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, tl_block_take(second, SIZE, TL_BLOCK_THEY_WRITE, &(tl_block){0}, &error));
    tl_block_close(&read);
    tl_block_close(&taken);
}

static bool opens(const char *path, int flags) {
    int opened = open(path, flags);
    if (opened >= 0) {
        (void)close(opened);
    }
    return opened >= 0;
}

static bool maps_for_writing(int descriptor) {
    void *mapped = mmap(NULL, SIZE, PROT_READ | PROT_WRITE, MAP_SHARED, descriptor, 0);
    if (mapped != MAP_FAILED) {
        (void)munmap(mapped, SIZE);
    }
    return mapped != MAP_FAILED;
}

/* A confined attacker has only the descriptor of the reader. */
static bool cannot_write(void *context) {
    const int *reader = context;
    char path[64];
    (void)close(block.descriptor); /* an executed process has only `reader` */
    (void)snprintf(path, sizeof path, "/proc/self/fd/%d", *reader);
    void *readable = mmap(NULL, SIZE, PROT_READ, MAP_SHARED, *reader, 0);
    return TL_EXPECT(readable != MAP_FAILED) && TL_EXPECT(!opens(path, O_RDWR)) && TL_EXPECT(!opens(path, O_WRONLY)) &&
           TL_EXPECT(fchmod(*reader, S_IRWXU) != 0) && TL_EXPECT(chmod(path, S_IRWXU) != 0) &&
           TL_EXPECT(!opens(path, O_RDWR)) && TL_EXPECT(!maps_for_writing(*reader)) &&
           TL_EXPECT(mprotect(readable, SIZE, PROT_READ | PROT_WRITE) != 0) &&
           TL_EXPECT(pwrite(*reader, "x", 1, 0) < 0) && TL_EXPECT(ftruncate(*reader, 0) != 0) &&
           TL_EXPECT(fcntl(*reader, F_ADD_SEALS, F_SEAL_WRITE) != 0) && TL_EXPECT(memcmp(readable, "ours", 5) == 0);
}

static void expect_reader_cannot_write(uint32_t user) {
    static tl_confined confined;
    tl_block taken;
    make_sparse(SIZE);
    take_for_writing(&taken);
    memcpy(taken.bytes, "ours", 5);
    tl_block_close(&taken);
    int reader = tl_block_reader(&block);
    const tl_confine_settings settings = {.whole_process = true, .only_denies = true, .user = user};
    tl_confined_run(settings, cannot_write, &reader, &confined);
    (void)close(reader);
    TEST_ASSERT_EQUAL_INT(0, confined.signal);
    TEST_ASSERT_TRUE(confined.succeeded);
}

static void need_confinement(void) {
    tl_confine_facts facts;
    tl_confine_probe(&facts);
    if (!facts.filter) {
        TEST_IGNORE_MESSAGE("no seccomp");
    }
}

static void test_a_reader_without_capabilities_cannot_write(void) {
    need_confinement();
    expect_reader_cannot_write(0);
}

static void test_a_reader_of_another_user_cannot_write(void) {
    tl_confine_facts facts;
    tl_confine_probe(&facts);
    need_confinement();
    if (!facts.user) {
        TEST_IGNORE_MESSAGE("not root");
    }
    expect_reader_cannot_write(0x70000000U);
}

static void test_there_are_no_descriptors_for_a_reader(void) {
    struct rlimit before;
    make_sparse(SIZE);
    TEST_ASSERT_EQUAL_INT(0, getrlimit(RLIMIT_NOFILE, &before));
    const struct rlimit less = {.rlim_cur = 3, .rlim_max = before.rlim_max};
    TEST_ASSERT_EQUAL_INT(0, setrlimit(RLIMIT_NOFILE, &less));
    int reader = tl_block_reader(&block);
    (void)setrlimit(RLIMIT_NOFILE, &before);
    TEST_ASSERT_EQUAL_INT(-1, reader);
}

/* The root folder of the process has no /proc. */
static void test_a_reader_without_proc(void) {
    enum { NO_ROOT = 3 };
    char folder[] = "/tmp/block_XXXXXX";
    int status = 0;
    make_sparse(SIZE);
    TEST_ASSERT_NOT_NULL(mkdtemp(folder));
    pid_t pid = fork();
    TEST_ASSERT_NOT_EQUAL_INT(-1, pid);
    if (pid == 0) {
        tl_block taken;
        if (chroot(folder) != 0) {
            _exit(NO_ROOT);
        }
        _exit(tl_block_take(tl_block_reader(&block), SIZE, TL_BLOCK_WE_WRITE, &taken, &error) == TL_OK ? 0 : 1);
    }
    TEST_ASSERT_EQUAL_INT(pid, waitpid(pid, &status, 0));
    (void)rmdir(folder);
    if (WEXITSTATUS(status) == NO_ROOT) {
        TEST_IGNORE_MESSAGE("needs chroot()");
    }
    TEST_ASSERT_EQUAL_INT(0, status);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_size_is_sealed);
    RUN_TEST(test_two_processes);
    RUN_TEST(test_a_taken_block_is_read_only);
    RUN_TEST(test_a_written_block_is_read_only);
    RUN_TEST(test_another_size_is_refused);
    RUN_TEST(test_unsealed_is_refused);
    RUN_TEST(test_other_descriptors_are_refused);
    RUN_TEST(test_resource_limits);
    RUN_TEST(test_closing_an_empty_block_does_nothing);
    RUN_TEST(test_a_sparse_block_takes_only_used_pages);
    RUN_TEST(test_the_size_of_a_sparse_block_is_sealed);
    RUN_TEST(test_an_unmapped_block_is_closed);
    RUN_TEST(test_forgotten_pages_are_freed);
    RUN_TEST(test_a_reader_reads);
    RUN_TEST(test_a_reader_without_capabilities_cannot_write);
    RUN_TEST(test_a_reader_of_another_user_cannot_write);
    RUN_TEST(test_there_are_no_descriptors_for_a_reader);
    RUN_TEST(test_a_reader_without_proc);
    return UNITY_END();
}
