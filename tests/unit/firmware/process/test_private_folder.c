/* Private folders: new, locked, removed after the death of their process, whatever they contain. */
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <signal.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <unity.h>

#include "firmware/base/log.h"
#include "firmware/process/private_folder.h"
#include "firmware/process/process_end.h"
#include "tests/support/message.h"

enum { DEEP = 5000, MANY = 20000, NOBODY = 65534 };

static char parent[PATH_MAX];
static tl_private_folder folder;
static tl_error error;

void setUp(void) {
    (void)snprintf(parent, sizeof parent, "/tmp/twinlock-test-XXXXXX");
    TEST_ASSERT_NOT_NULL(mkdtemp(parent));
    TEST_ASSERT_EQUAL_INT(0, setenv("TMPDIR", parent, 1));
    error = (tl_error){TL_OK, ""};
    folder = (tl_private_folder){.descriptor = -1};
}

/* Each test must leave an empty folder. */
void tearDown(void) {
    tl_private_folder_remove(&folder);
    TEST_ASSERT_EQUAL_INT_MESSAGE(0, rmdir(parent), "files remain");
}

static void make(void) {
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_private_folder_make("test", 0, &folder, &error), error.text);
}

static bool is_there(const char *path) {
    return access(path, F_OK) == 0;
}

static void write_file(int in, const char *name) {
    int file = openat(in, name, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0600);
    TEST_ASSERT_NOT_EQUAL_INT(-1, file);
    (void)close(file);
}

static void test_a_new_folder(void) {
    char expected[PATH_MAX + 64];
    struct stat status;
    make();
    (void)snprintf(expected, sizeof expected, "%s/twinlock-test-%d-", parent, (int)getpid());
    TEST_ASSERT_EQUAL_INT(0, strncmp(folder.path, expected, strlen(expected)));
    TEST_ASSERT_EQUAL_size_t(strlen(expected) + 6, strlen(folder.path));
    TEST_ASSERT_EQUAL_INT(0, fstat(folder.descriptor, &status));
    TEST_ASSERT_EQUAL_UINT(S_IFDIR | 0700, status.st_mode);
    int other = open(folder.path, O_RDONLY | O_DIRECTORY);
    TEST_ASSERT_EQUAL_INT(-1, flock(other, LOCK_EX | LOCK_NB));
    (void)close(other);
    tl_private_folder_remove(&folder);
    TEST_ASSERT_EQUAL_STRING("", folder.path);
    tl_private_folder_remove(&folder);
}

static void test_links_are_not_followed(void) {
    char outside[PATH_MAX + 16];
    (void)snprintf(outside, sizeof outside, "%s/outside", parent);
    TEST_ASSERT_EQUAL_INT(0, mkdir(outside, 0700));
    int there = open(outside, O_RDONLY | O_DIRECTORY);
    write_file(there, "kept");
    make();
    TEST_ASSERT_EQUAL_INT(0, mkdirat(folder.descriptor, "a", 0700));
    TEST_ASSERT_EQUAL_INT(0, symlinkat(outside, folder.descriptor, "a/link"));
    TEST_ASSERT_EQUAL_INT(0, symlinkat(outside, folder.descriptor, "link"));
    tl_private_folder_remove(&folder);
    TEST_ASSERT_EQUAL_INT(0, unlinkat(there, "kept", 0)); /* still exists */
    (void)close(there);
    TEST_ASSERT_EQUAL_INT(0, rmdir(outside));
}

/* Very deep folders, removed with few descriptors. */
static void test_deep_folders(void) {
    struct rlimit before;
    make();
    int at = dup(folder.descriptor);
    for (int i = 0; i < DEEP; i++) {
        TEST_ASSERT_EQUAL_INT(0, mkdirat(at, "d", 0700));
        write_file(at, "0"); /* a name that the removal uses in the root */
        int next = openat(at, "d", O_RDONLY | O_DIRECTORY);
        (void)close(at);
        at = next;
    }
    (void)close(at);
    TEST_ASSERT_EQUAL_INT(0, getrlimit(RLIMIT_NOFILE, &before));
    const struct rlimit few = {.rlim_cur = (rlim_t)folder.descriptor + 3, .rlim_max = before.rlim_max};
    TEST_ASSERT_EQUAL_INT(0, setrlimit(RLIMIT_NOFILE, &few));
    tl_private_folder_remove(&folder);
    TEST_ASSERT_EQUAL_INT(0, setrlimit(RLIMIT_NOFILE, &before));
}

static void test_many_files(void) {
    make();
    TEST_ASSERT_EQUAL_INT(0, mkdirat(folder.descriptor, "many", 0700));
    for (int i = 0; i < MANY; i++) {
        char name[32];
        (void)snprintf(name, sizeof name, "%s%d", i % 2 == 0 ? "many/" : "", i);
        write_file(folder.descriptor, name);
    }
    tl_private_folder_remove(&folder);
}

/* Runs `act` in a child without root, because root ignores file modes. */
static void as_user(void (*act)(void)) {
    int status = 0;
    TEST_ASSERT_EQUAL_INT(0, chmod(parent, 0777));
    pid_t pid = fork();
    TEST_ASSERT_NOT_EQUAL_INT(-1, pid);
    if (pid == 0) {
        if (getuid() == 0 && setuid(NOBODY) != 0) {
            _exit(2);
        }
        act();
        _exit(folder.path[0] == '\0' ? 0 : 1);
    }
    TEST_ASSERT_EQUAL_INT(pid, waitpid(pid, &status, 0));
    TEST_ASSERT_EQUAL_INT(0, status);
}

static void remove_forbidden(void) {
    if (tl_private_folder_make("test", 0, &folder, &error) != TL_OK) {
        _exit(3);
    }
    int at = folder.descriptor;
    bool made = mkdirat(at, "a", 0700) == 0 && mkdirat(at, "a/b", 0700) == 0 && mkdirat(at, "a/b/c", 0700) == 0 &&
                mkdirat(at, "a/b/c/closed", 0) == 0 && mkdirat(at, "a/b/c/full", 0700) == 0 &&
                mkdirat(at, "a/b/c/full/x", 0) == 0 && fchmodat(at, "a/b/c/full", 0, 0) == 0 &&
                fchmodat(at, "a/b/c", 0500, 0) == 0 && fchmodat(at, "a/b", 0, 0) == 0 &&
                fchmodat(at, "a", 0400, 0) == 0 && fchmod(at, 0) == 0;
    tl_private_folder_remove(&folder);
    if (!made) {
        _exit(4);
    }
}

static void test_forbidden_folders(void) {
    as_user(remove_forbidden);
}

/* Making a folder sweeps those of dead processes. */
static void sweep(const char *kind) {
    tl_private_folder made;
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_private_folder_make(kind, 0, &made, &error), error.text);
    tl_private_folder_remove(&made);
}

/* Leaves the folder of a killed process, with a subfolder. */
static void leave_one(const char *kind, char path[PATH_MAX]) {
    int ends[2];
    TEST_ASSERT_EQUAL_INT(0, pipe(ends));
    pid_t pid = fork();
    TEST_ASSERT_NOT_EQUAL_INT(-1, pid);
    if (pid == 0) {
        if (tl_private_folder_make(kind, 0, &folder, &error) == TL_OK && mkdirat(folder.descriptor, "left", 0) == 0) {
            (void)!write(ends[1], folder.path, sizeof folder.path);
        }
        (void)pause();
    }
    TEST_ASSERT_EQUAL_INT(sizeof folder.path, read(ends[0], path, PATH_MAX));
    sweep(kind);
    TEST_ASSERT_TRUE(is_there(path)); /* because its process lives */
    TEST_ASSERT_EQUAL_INT(0, kill(pid, SIGKILL));
    TEST_ASSERT_EQUAL_INT(pid, waitpid(pid, NULL, 0));
    (void)close(ends[0]);
    (void)close(ends[1]);
}

static void test_folders_of_killed_processes(void) {
    char left[PATH_MAX];
    char other[PATH_MAX];
    leave_one("test", left);
    leave_one("other", other);
    make();
    TEST_ASSERT_FALSE(is_there(left));
    TEST_ASSERT_TRUE(is_there(other)); /* of another kind */
    sweep("other");
    TEST_ASSERT_FALSE(is_there(other));
    TEST_ASSERT_TRUE(is_there(folder.path));
}

static void test_a_folder_for_another_user(void) {
    struct stat status;
    if (getuid() != 0) {
        TEST_ASSERT_EQUAL_INT(TL_TRY_AGAIN, tl_private_folder_make("test", NOBODY, &folder, &error));
        TL_EXPECT_PARTS("twinlock-test|user 65534", error.text);
        return;
    }
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_private_folder_make("test", NOBODY, &folder, &error));
    TEST_ASSERT_EQUAL_INT(0, fstat(folder.descriptor, &status));
    TEST_ASSERT_EQUAL_UINT(NOBODY, status.st_gid);
    TEST_ASSERT_EQUAL_UINT(0, status.st_uid);
    TEST_ASSERT_EQUAL_HEX(S_IRWXU | S_IRWXG, status.st_mode & 0777);
}

/* A process that leaves the removal to another one. Returns 0, or the number of the failed
 * check. */
static int leave_to_another(const char *left) {
    char path[PATH_MAX];
    tl_private_folder_leave();
    if (tl_private_folder_make("test", 0, &folder, &error) != TL_OK || !is_there(left)) {
        return 1;
    }
    (void)snprintf(path, sizeof path, "%s", folder.path);
    tl_private_folder_remove(&folder);
    int here = open(path, O_RDONLY | O_DIRECTORY);
    return folder.path[0] == '\0' && here >= 0 && flock(here, LOCK_EX | LOCK_NB) == 0 ? 0 : 2;
}

static void test_removal_by_another_process(void) {
    char left[PATH_MAX];
    int status = 0;
    leave_one("test", left);
    pid_t pid = fork();
    TEST_ASSERT_NOT_EQUAL_INT(-1, pid);
    if (pid == 0) {
        _exit(leave_to_another(left));
    }
    TEST_ASSERT_EQUAL_INT(pid, waitpid(pid, &status, 0));
    TEST_ASSERT_EQUAL_INT(0, status);
    sweep("test");
}

static void refuse(const char *folder_for_files, const char *parts) {
    TEST_ASSERT_EQUAL_INT(0, setenv("TMPDIR", folder_for_files, 1));
    TEST_ASSERT_EQUAL_INT(TL_TRY_AGAIN, tl_private_folder_make("test", 0, &folder, &error));
    TL_EXPECT_PARTS(parts, error.text);
    TEST_ASSERT_EQUAL_STRING("", folder.path);
}

static void test_unusable_folders(void) {
    refuse("/nowhere", "/nowhere|TMPDIR|No such file");
    refuse("/proc", "/proc|TMPDIR");
}

int main(void) {
    tl_log_set_level(TL_LOG_WARNING);
    UNITY_BEGIN();
    RUN_TEST(test_a_new_folder);
    RUN_TEST(test_links_are_not_followed);
    RUN_TEST(test_deep_folders);
    RUN_TEST(test_many_files);
    RUN_TEST(test_forbidden_folders);
    RUN_TEST(test_folders_of_killed_processes);
    RUN_TEST(test_a_folder_for_another_user);
    RUN_TEST(test_removal_by_another_process);
    RUN_TEST(test_unusable_folders);
    return UNITY_END();
}
