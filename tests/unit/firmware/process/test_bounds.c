/* Limits of a child process and of its folder, checked by its parent. */
#include "firmware/process/bounds.h"

#include <fcntl.h>
#include <pthread.h>
#include <signal.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <unity.h>

#include "tests/support/message.h"
#include "tests/support/scratch.h"

enum { KILOBYTE = 1024, MEGABYTE = 1024 * 1024 };

static tl_scratch scratch;
static char text[TL_BOUNDS_TEXT];

void setUp(void) {}

void tearDown(void) {
    tl_scratch_empty(&scratch);
}

static tl_bounds bounds(void) {
    return (tl_bounds){.folder = scratch.folder, .bytes = 4 * MEGABYTE, .files = 600, .threads = 8};
}

static void write_file(const char *name, size_t kilobytes) {
    char block[KILOBYTE];
    FILE *file = fopen(tl_scratch_path(&scratch, name), "w");
    TEST_ASSERT_NOT_NULL(file);
    memset(block, 'a', sizeof block);
    for (size_t i = 0; i < kilobytes; i++) {
        TEST_ASSERT_EQUAL_size_t(1, fwrite(block, sizeof block, 1, file));
    }
    TEST_ASSERT_EQUAL_INT(0, fclose(file));
}

static void make_files(int first, int after_last) {
    char name[32];
    for (int i = first; i < after_last; i++) {
        (void)snprintf(name, sizeof name, "%d", i);
        write_file(name, 0);
    }
}

/* ---- the folder ---- */

static void values_within_the_limits_and_missing_folders_are_accepted(void) {
    tl_bounds kept = bounds();
    write_file("file", 100);
    TEST_ASSERT_TRUE(tl_bounds_are_kept(&kept, getpid(), text));
    TEST_ASSERT_EQUAL_STRING("", text);
    kept.folder = "/none/at/all";
    TEST_ASSERT_TRUE(tl_bounds_are_kept(&kept, getpid(), text));
    kept.folder = NULL;
    TEST_ASSERT_TRUE(tl_bounds_are_kept(&kept, INT32_MAX, text));
}

static void too_many_bytes_are_found(void) {
    tl_bounds broken = bounds();
    write_file("file", 5 * KILOBYTE);
    TEST_ASSERT_FALSE(tl_bounds_are_kept(&broken, getpid(), text));
    TL_EXPECT_PARTS("4 MB|folder", text);
    broken.bytes = 0;
    broken.checks_left = 0;
    TEST_ASSERT_TRUE(tl_bounds_are_kept(&broken, getpid(), text));
}

/* One removed file is open twice. The other one is only mapped, which only root can see.
 * free_before and gone_before are set so that the check looks for removed files. */
static void removed_files_are_counted_once_each(void) {
    if (geteuid() != 0) {
        TEST_IGNORE_MESSAGE("only root sees mapped files");
    }
    tl_bounds looked = bounds();
    looked.free_before = UINT64_MAX;
    write_file("file", 3 * KILOBYTE);
    write_file("other", 3 * KILOBYTE);
    int one = open(tl_scratch_path(&scratch, "file"), O_RDONLY | O_CLOEXEC);
    TEST_ASSERT_TRUE(one >= 0);
    int same = fcntl(one, F_DUPFD_CLOEXEC, 0);
    int other = open(tl_scratch_path(&scratch, "other"), O_RDONLY | O_CLOEXEC);
    TEST_ASSERT_TRUE(same >= 0 && other >= 0);
    void *mapped = mmap(NULL, KILOBYTE, PROT_READ, MAP_PRIVATE, other, 0);
    (void)close(other);
    TEST_ASSERT_TRUE(mapped != MAP_FAILED);
    TEST_ASSERT_EQUAL_INT(0, unlink(tl_scratch_path(&scratch, "file")));
    TEST_ASSERT_TRUE_MESSAGE(tl_bounds_are_kept(&looked, getpid(), text), text);
    TEST_ASSERT_EQUAL_INT(0, unlink(tl_scratch_path(&scratch, "other")));
    looked.gone_before = 0;
    TEST_ASSERT_FALSE(tl_bounds_are_kept(&looked, getpid(), text));
    TL_EXPECT_PARTS("6 MB|4", text);
    (void)munmap(mapped, KILOBYTE);
    looked.gone_before = 0;
    TEST_ASSERT_TRUE_MESSAGE(tl_bounds_are_kept(&looked, getpid(), text), text);
    (void)close(same);
    (void)close(one);
}

/* Holes and the targets of links do not count. */
static void holes_and_links_do_not_count(void) {
    tl_bounds kept = bounds();
    int file = open(tl_scratch_path(&scratch, "sparse"), O_WRONLY | O_CREAT | O_CLOEXEC, 0600);
    TEST_ASSERT_TRUE(file >= 0 && ftruncate(file, (off_t)100 * MEGABYTE) == 0);
    (void)close(file);
    TEST_ASSERT_EQUAL_INT(0, symlink("/usr", tl_scratch_path(&scratch, "link")));
    TEST_ASSERT_TRUE(tl_bounds_are_kept(&kept, getpid(), text));
}

/* Returns the number of the check that finds a broken bound; one more than `most` if none does. */
static int check_until_broken(tl_bounds *broken, int most) {
    int checks = 1;
    while (checks <= most && tl_bounds_are_kept(broken, getpid(), text)) {
        checks++;
    }
    return checks;
}

/* The disk seems to have grown, so that nothing hints at the new files. */
static void too_many_files_are_found_within_100_checks(void) {
    tl_bounds broken = bounds();
    make_files(0, 99);
    broken.files = 100;
    TEST_ASSERT_TRUE(tl_bounds_are_kept(&broken, getpid(), text));
    make_files(99, 101);
    broken.least_bytes = 0;
    broken.least_files = 0;
    TEST_ASSERT_EQUAL_INT(TL_BOUNDS_CHECKS, check_until_broken(&broken, TL_BOUNDS_CHECKS + 1));
    TL_EXPECT_PARTS("100 files|folder", text);
}

/* Other programs also use the disk and may hide the growth, hence several attempts. */
static void growth_is_found_by_the_next_check(void) {
    int uncounted = 0;
    int found_bytes = 0;
    int found_files = 0;
    for (int i = 0; i < 20; i++) {
        tl_bounds grown = bounds();
        write_file("file", KILOBYTE);
        TEST_ASSERT_TRUE(tl_bounds_are_kept(&grown, getpid(), text));
        TEST_ASSERT_TRUE(tl_bounds_are_kept(&grown, getpid(), text));
        uncounted += grown.checks_left == TL_BOUNDS_CHECKS - 1 ? 1 : 0;
        grown.least_files = i % 2 == 0 ? 0 : UINT64_MAX; /* one reason at a time */
        grown.least_bytes = i % 2 == 0 ? grown.least_bytes : 0;
        write_file("more", 4 * KILOBYTE);
        found_bytes += check_until_broken(&grown, 1) == 1 && i % 2 == 0 ? 1 : 0;
        found_files += text[0] != '\0' && i % 2 == 1 ? 1 : 0;
        TEST_ASSERT_EQUAL_INT(0, unlink(tl_scratch_path(&scratch, "more")));
    }
    TEST_ASSERT_TRUE(uncounted > 0 && found_bytes > 0 && found_files == 10);
}

/* Even if the disk shrinks all the time. */
static void a_large_folder_is_counted_in_every_fifth_check(void) {
    tl_bounds broken = bounds();
    make_files(0, 599);
    TEST_ASSERT_TRUE(tl_bounds_are_kept(&broken, getpid(), text));
    make_files(599, 601);
    broken.least_bytes = UINT64_MAX;
    TEST_ASSERT_EQUAL_INT(5, check_until_broken(&broken, 10));
    TL_EXPECT_PARTS("600 files|folder", text);
}

/* Makes `count` nested folders and changes into the last one. Returns a descriptor of the old
 * folder. */
static int go_down(int count, mode_t mode) {
    int home = open(".", O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    TEST_ASSERT_EQUAL_INT(0, chdir(scratch.folder));
    for (int i = 0; i < count; i++) {
        TEST_ASSERT_EQUAL_INT(0, mkdir("deeper", mode));
        TEST_ASSERT_EQUAL_INT(0, chdir("deeper"));
    }
    return home;
}

static void restore_start(int count, int home) {
    for (int i = 0; i < count; i++) {
        TEST_ASSERT_EQUAL_INT(0, chdir(".."));
        TEST_ASSERT_EQUAL_INT(0, rmdir("deeper"));
    }
    TEST_ASSERT_EQUAL_INT(0, fchdir(home));
    (void)close(home);
}

static void too_deeply_nested_folders_are_found(void) {
    tl_bounds at = bounds();
    int home = go_down(TL_BOUNDS_DEPTH - 1, 0700);
    TEST_ASSERT_TRUE(tl_bounds_are_kept(&at, getpid(), text));
    TEST_ASSERT_EQUAL_INT(0, mkdir("deeper", 0700));
    at.checks_left = 0;
    bool kept = tl_bounds_are_kept(&at, getpid(), text);
    TEST_ASSERT_EQUAL_INT(0, rmdir("deeper"));
    restore_start(TL_BOUNDS_DEPTH - 1, home);
    TEST_ASSERT_FALSE(kept);
    TL_EXPECT_PARTS("folder|deep", text);
}

/* Root can read each folder, so another user checks. */
static void an_unreadable_folder_is_found(void) {
    int status = 0;
    TEST_ASSERT_EQUAL_INT(0, chmod(scratch.folder, 0755));
    TEST_ASSERT_EQUAL_INT(0, mkdir(tl_scratch_path(&scratch, "hidden"), 0300));
    (void)fflush(NULL);
    pid_t child = fork();
    if (child == 0) {
        tl_bounds broken = bounds();
        _exit((getuid() != 0 || setuid(65534) == 0) && !tl_bounds_are_kept(&broken, getpid(), text) &&
                      tl_test_has_parts(text, "folder") && !tl_test_has_parts(text, "deep")
                  ? EXIT_SUCCESS
                  : EXIT_FAILURE);
    }
    TEST_ASSERT_EQUAL_INT(child, waitpid(child, &status, 0));
    TEST_ASSERT_EQUAL_INT(0, rmdir(tl_scratch_path(&scratch, "hidden")));
    TEST_ASSERT_EQUAL_INT(0, status);
}

/* ---- the process ---- */

static void *wait_for_end(void *context) {
    (void)pause();
    return context;
}

/* Starts a child with threads and memory. It is not dumpable, and its name looks like fields of
 * /proc/PID/stat. Returns when the child is ready. */
static pid_t start_child(int threads, size_t megabytes) {
    int ready[2];
    char said = '\0';
    TEST_ASSERT_EQUAL_INT(0, pipe2(ready, O_CLOEXEC));
    (void)fflush(NULL);
    pid_t child = fork();
    if (child == 0) {
        pthread_t thread;
        (void)prctl(PR_SET_DUMPABLE, 0);
        (void)prctl(PR_SET_NAME, "a) R 1 1 (b 1");
        for (int i = 0; i < threads; i++) {
            (void)pthread_create(&thread, NULL, wait_for_end, NULL);
        }
        char *memory = malloc(megabytes * MEGABYTE);
        if (memory != NULL) {
            memset(memory, 'y', megabytes * MEGABYTE);
            (void)!write(ready[1], memory + megabytes * MEGABYTE - 1, 1); /* so that the compiler keeps memset() */
        }
        (void)pause();
    }
    (void)close(ready[1]);
    TEST_ASSERT_EQUAL_INT(1, read(ready[0], &said, 1));
    (void)close(ready[0]);
    TEST_ASSERT_EQUAL_CHAR('y', said);
    return child;
}

static void end_child(pid_t child) {
    TEST_ASSERT_EQUAL_INT(0, kill(child, SIGKILL));
    TEST_ASSERT_EQUAL_INT(child, waitpid(child, NULL, 0));
}

static long largest_number(const char *message) {
    long largest = 0;
    for (const char *at = strpbrk(message, "0123456789"); at != NULL; at = strpbrk(at, "0123456789")) {
        char *end = NULL;
        long number = strtol(at, &end, 10);
        largest = number > largest ? number : largest;
        at = end;
    }
    return largest;
}

static void threads_and_memory_of_another_process_are_found(void) {
    tl_bounds at = bounds();
    char of_threads[TL_BOUNDS_TEXT];
    pid_t child = start_child(15, 64);
    bool kept = tl_bounds_are_kept(&at, child, text);
    (void)snprintf(of_threads, sizeof of_threads, "%s", text);
    at.threads = 32; /* a sanitizer has further threads */
    bool kept_then = tl_bounds_are_kept(&at, child, text);
    at.memory = (uint64_t)32 * MEGABYTE;
    bool kept_last = tl_bounds_are_kept(&at, child, text);
    end_child(child);
    TEST_ASSERT_FALSE(kept);
    TL_EXPECT_PARTS("threads|8", of_threads);
    TEST_ASSERT_TRUE_MESSAGE(largest_number(of_threads) >= 16, of_threads);
    TEST_ASSERT_TRUE(kept_then);
    TEST_ASSERT_FALSE(kept_last);
    TL_EXPECT_PARTS("MB|memory|33", text);
    TEST_ASSERT_TRUE_MESSAGE(largest_number(text) >= 64, text);
}

#if UINTPTR_MAX > UINT32_MAX /* 32 GiB of addresses are needed */
/* Reads one byte per page table of a large mapping. Only the kernel's page tables take memory
 * then. */
static void fill_page_tables(void) {
    static const size_t span = (size_t)1 << 35;
    static const size_t apart = (size_t)2 * MEGABYTE;
    char *memory = mmap(NULL, span, PROT_READ, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
    char sum = '\0';
    if (memory != MAP_FAILED && madvise(memory, span, MADV_NOHUGEPAGE) == 0) {
        for (size_t at = 0; at < span; at += apart) {
            sum = (char)(sum | *(const volatile char *)(memory + at));
        }
    }
}

static void page_tables_count_as_memory(void) {
    tl_bounds at = {.memory = (uint64_t)48 * MEGABYTE};
    TEST_ASSERT_TRUE(tl_bounds_are_kept(&at, getpid(), text));
    (void)fflush(NULL);
    pid_t child = fork();
    if (child == 0) {
        fill_page_tables();
        _exit(tl_bounds_are_kept(&at, getpid(), text) ? EXIT_FAILURE : EXIT_SUCCESS);
    }
    int status = 0;
    TEST_ASSERT_EQUAL_INT(child, waitpid(child, &status, 0));
    TEST_ASSERT_EQUAL_INT(0, status);
}
#endif

int main(void) {
    UNITY_BEGIN();
    tl_scratch_make(&scratch, "/tmp", "tl_bounds");
    RUN_TEST(values_within_the_limits_and_missing_folders_are_accepted);
    RUN_TEST(too_many_bytes_are_found);
    RUN_TEST(removed_files_are_counted_once_each);
    RUN_TEST(holes_and_links_do_not_count);
    RUN_TEST(too_many_files_are_found_within_100_checks);
    RUN_TEST(growth_is_found_by_the_next_check);
    RUN_TEST(a_large_folder_is_counted_in_every_fifth_check);
    RUN_TEST(too_deeply_nested_folders_are_found);
    RUN_TEST(an_unreadable_folder_is_found);
    RUN_TEST(threads_and_memory_of_another_process_are_found);
#if UINTPTR_MAX > UINT32_MAX
    RUN_TEST(page_tables_count_as_memory);
#endif
    return tl_scratch_finish(&scratch, UNITY_END());
}
