/* Files that a confined process reaches, with each version of Landlock up to the kernel's, and
 * without. */

#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <unity.h>

#include "firmware/process/confine.h"
#include "firmware/process/sanitizer.h"
#include "tests/support/confined.h"
#include "tests/support/scratch.h"

/* Another folder of the same user, with a file. */
static tl_scratch outside;
static tl_scratch inside;
static tl_confined confined;
static char victim[PATH_MAX];
static char below[PATH_MAX];

static const char content[] = "text";

void setUp(void) {
    FILE *file = fopen(victim, "w");
    TEST_ASSERT_TRUE(file != NULL && fputs(content, file) >= 0 && fclose(file) == 0);
    TEST_ASSERT_EQUAL_INT(0, chmod(victim, 0640));
}

void tearDown(void) {
    tl_scratch_empty(&inside);
    tl_scratch_empty(&outside);
}

static void need_landlock(int least) {
    if (tl_landlock_version() < least) {
        TEST_IGNORE_MESSAGE("no Landlock, or an older one");
    }
}

static void need_filter(void) {
    if (!tl_filter_is_offered()) {
        TEST_IGNORE_MESSAGE("no seccomp");
    }
}

/* Checks that the file and its folder have not changed. */
static void expect_untouched(void) {
    struct stat status;
    char now[sizeof content] = "";
    FILE *file = fopen(victim, "r");
    TEST_ASSERT_NOT_NULL(file);
    TEST_ASSERT_NOT_NULL(fgets(now, sizeof now, file));
    (void)fclose(file);
    TEST_ASSERT_EQUAL_STRING(content, now);
    TEST_ASSERT_EQUAL_INT(0, stat(victim, &status));
    TEST_ASSERT_EQUAL_UINT(0640, status.st_mode & 07777);
    TEST_ASSERT_EQUAL_INT(1, tl_scratch_count(&outside));
}

/* newest: as in tl_confine_settings. */
static void expect(int newest, tl_confined_body *body) {
    const tl_confine_settings settings = {.folder = inside.folder, .landlock_newest = newest};
    char version[32];
    (void)snprintf(version, sizeof version, "version %d", newest);
    tl_confined_run(settings, body, NULL, &confined);
    TEST_ASSERT_EQUAL_INT_MESSAGE(0, confined.signal, version);
    TEST_ASSERT_TRUE_MESSAGE(confined.succeeded, version);
    expect_untouched();
}

static bool is_denied(int answer) {
    return answer == -1 && (errno == EACCES || errno == EPERM);
}

/* ---- other files ---- */

static bool reach_out(void *context) {
    (void)context;
    return TL_EXPECT(is_denied(open(victim, O_RDONLY))) && TL_EXPECT(is_denied(open(victim, O_WRONLY))) &&
           TL_EXPECT(is_denied(open(victim, O_WRONLY | O_TRUNC))) &&
           TL_EXPECT(is_denied(open(victim, O_WRONLY | O_APPEND))) &&
           TL_EXPECT(is_denied(open(outside.folder, O_RDONLY | O_DIRECTORY))) &&
           TL_EXPECT(is_denied(open(below, O_WRONLY | O_CREAT, 0600))) && TL_EXPECT(is_denied(mkdir(below, 0700))) &&
           TL_EXPECT(is_denied(unlink(victim))) && TL_EXPECT(is_denied(rmdir(outside.folder))) &&
           TL_EXPECT(is_denied(open("/etc/shadow", O_RDONLY))) && TL_EXPECT(is_denied(open("/etc/passwd", O_RDONLY))) &&
           TL_EXPECT(is_denied(open("/usr/lib/os-release", O_RDWR))) &&
           TL_EXPECT(is_denied(open("/dev/mem", O_RDONLY)) || errno == ENOENT) &&
           TL_EXPECT(is_denied(open("/dev/tty", O_RDWR)) || errno == ENXIO || errno == ENOENT) &&
           TL_EXPECT(is_denied(open("/dev/ptmx", O_RDWR))) && TL_EXPECT(is_denied(open("/dev/zero", O_RDWR))) &&
           TL_EXPECT(is_denied(open("/proc/1/environ", O_RDONLY))) &&
           TL_EXPECT(is_denied(open("/proc/1/status", O_RDONLY))) &&
           TL_EXPECT(is_denied(open("/proc/self/mem", O_RDWR))) &&
           TL_EXPECT(is_denied(open("/proc/self/mem", O_RDONLY))) &&
           TL_EXPECT(is_denied(open("/proc/self/oom_score_adj", O_WRONLY))) &&
           TL_EXPECT(is_denied(open("/dev/shm/tl_confine", O_RDWR | O_CREAT, 0600)));
}

static void nothing_outside_is_read_or_changed(void) {
    need_landlock(1);
    for (int version = 1; version <= tl_landlock_version(); version++) {
        expect(version, reach_out);
        TEST_ASSERT_EQUAL_INT(version, confined.facts.landlock);
    }
}

/* Uses a link to a file outside, and moves files in and out. */
static bool go_round(void *context) {
    (void)context;
    return TL_EXPECT(is_denied(open("link", O_RDONLY))) && TL_EXPECT(is_denied(open("link", O_WRONLY | O_TRUNC))) &&
           TL_EXPECT(mkdir("own", 0700) == 0) &&
           TL_EXPECT(rename("own", below) == -1 && (errno == EACCES || errno == EXDEV || errno == EPERM)) &&
           TL_EXPECT(rename(victim, "taken") == -1) && TL_EXPECT(unlink(victim) == -1) && TL_EXPECT(rmdir("own") == 0);
}

static void links_and_moves_lead_nowhere(void) {
    need_landlock(1);
    for (int version = 1; version <= tl_landlock_version(); version++) {
        TEST_ASSERT_EQUAL_INT(0, symlink(victim, tl_scratch_path(&inside, "link")));
        expect(version, go_round);
        tl_scratch_empty(&inside);
    }
}

/* ---- not covered by Landlock: with each version, and without ---- */

static bool empty(void *context) {
    (void)context;
    return TL_EXPECT(is_denied(open(victim, O_RDONLY | O_TRUNC))) &&
           TL_EXPECT(is_denied(open(victim, O_ACCMODE | O_TRUNC))) &&
           TL_EXPECT(is_denied((int)syscall(SYS_openat, AT_FDCWD, victim, O_TRUNC))) &&
           TL_EXPECT(is_denied(truncate(victim, 0)));
}

static void no_file_is_truncated_without_write_access(void) {
    need_filter();
    for (int version = -1; version <= tl_landlock_version(); version++) {
        expect(version, empty);
    }
}

static bool change_modes(void *context) {
    const struct timespec then[2] = {{1, 0}, {1, 0}};
    (void)context;
    return TL_EXPECT(is_denied(chmod(victim, 0777))) && TL_EXPECT(is_denied(chown(victim, 1, 1))) &&
           TL_EXPECT(is_denied(lchown(victim, 1, 1))) && TL_EXPECT(is_denied(utimensat(AT_FDCWD, victim, then, 0))) &&
           TL_EXPECT(is_denied(link(victim, "link"))) && TL_EXPECT(is_denied(symlink(victim, "link"))) &&
           TL_EXPECT(is_denied(mkfifo("fifo", 0600))) && TL_EXPECT(is_denied(mkfifo(below, 0600))) &&
           TL_EXPECT(is_denied(fchmodat(AT_FDCWD, victim, 0777, 0)));
}

static void no_modes_owners_and_dates_change(void) {
    need_filter();
    for (int version = -1; version <= tl_landlock_version(); version++) {
        expect(version, change_modes);
    }
}

/* ---- what may be reached ---- */

static bool can_read(const char *path) {
    char byte = '\0';
    int file = open(path, O_RDONLY | O_CLOEXEC);
    return file >= 0 && read(file, &byte, 1) == 1 && close(file) == 0;
}

static bool read_system_files(void *context) {
    int null = open("/dev/null", O_RDWR | O_CLOEXEC);
    int own = open("/proc/self/fd", O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    char line[64];
    struct winsize size;
    (void)context;
    return TL_EXPECT(can_read("/usr/lib/os-release")) && TL_EXPECT(can_read("/etc/ld.so.cache")) &&
           TL_EXPECT(can_read("/proc/self/status")) && TL_EXPECT(can_read("/proc/self/maps")) &&
           TL_EXPECT(can_read("/proc/meminfo")) && TL_EXPECT(can_read("/proc/cpuinfo")) &&
           TL_EXPECT(can_read("/proc/sys/vm/overcommit_memory")) && TL_EXPECT(can_read("/dev/urandom")) &&
           TL_EXPECT(can_read("/sys/devices/system/cpu/online")) && TL_EXPECT(null >= 0 && write(null, "a", 1) == 1) &&
           TL_EXPECT(ioctl(null, TIOCGWINSZ, &size) == -1) &&
           TL_EXPECT(readlink("/proc/self/exe", line, sizeof line) > 0) && TL_EXPECT(own >= 0 && close(own) == 0);
}

static const char *const of_itself[] = {"cgroup", "cmdline", "comm", "limits", "maps",         "mountinfo",
                                        "mounts", "smaps",   "stat", "statm",  "smaps_rollup", "status"};
static const char *const of_others[] = {"environ", "net/tcp", "net/udp", "net", "mem", "fdinfo"};

#define COUNT(array) (sizeof(array) / sizeof(array)[0])

static bool is_closed(const char *folder, const char *name) {
    char path[128];
    (void)snprintf(path, sizeof path, "%s/%s", folder, name);
    return tl_confined_expect(is_denied(open(path, O_RDONLY)), path, __LINE__);
}

/* Opens files of this process in /proc by all of their names. */
static bool look_at_itself(void) {
    char task[64];
    char path[128];
    bool good = TL_EXPECT(is_denied(open("/proc/net/tcp", O_RDONLY))) &&
                (TL_HAS_SANITIZER || TL_EXPECT(is_denied(open("/proc/self/task", O_RDONLY | O_DIRECTORY))));
    (void)snprintf(task, sizeof task, "/proc/self/task/%ld", syscall(SYS_gettid));
    for (size_t i = 0; i < COUNT(of_itself); i++) {
        (void)snprintf(path, sizeof path, "/proc/self/%s", of_itself[i]);
        good = tl_confined_expect(can_read(path), path, __LINE__) && good;
        (void)snprintf(path, sizeof path, "/proc/%ld/%s", (long)getpid(), of_itself[i]);
        good = tl_confined_expect(can_read(path), path, __LINE__) && good;
    }
    for (size_t i = 0; i < COUNT(of_others); i++) {
        good = is_closed("/proc/self", of_others[i]) && (TL_HAS_SANITIZER || is_closed(task, of_others[i])) &&
               (TL_HAS_SANITIZER || is_closed("/proc/thread-self", of_others[i])) && good;
    }
    return good;
}

static void *look_in_thread(void *context) {
    *(bool *)context = look_at_itself();
    return NULL;
}

static bool look_in_threads(void *context) {
    pthread_t thread;
    bool good = false;
    (void)!write(*(const int *)context, "2", 1);
    return TL_EXPECT(look_at_itself()) && TL_EXPECT(pthread_create(&thread, NULL, look_in_thread, &good) == 0) &&
           TL_EXPECT(pthread_join(thread, NULL) == 0) && TL_EXPECT(good);
}

static void a_process_reads_harmless_files_about_itself(void) {
    int forget = -1;
    need_landlock(1);
    for (int version = 1; version <= tl_landlock_version(); version++) {
        const tl_confine_settings settings = {.folder = inside.folder, .landlock_newest = version};
        if (version == tl_landlock_version()) {
            /* Only root can drop the caches. The kernel then drops unused files of /proc, as if
             * memory were short. */
            forget = open("/proc/sys/vm/drop_caches", O_WRONLY | O_CLOEXEC);
        }
        tl_confined_run(settings, look_in_threads, &forget, &confined);
        TEST_ASSERT_TRUE(confined.succeeded);
    }
    if (forget >= 0) {
        (void)close(forget);
    }
}

static void system_files_for_programs_are_readable(void) {
    need_landlock(1);
    for (int version = 1; version <= tl_landlock_version(); version++) {
        expect(version, read_system_files);
    }
}

static bool write_text(const char *path) {
    FILE *file = fopen(path, "w");
    return file != NULL && fputs("text", file) >= 0 && fclose(file) == 0;
}

static bool work_inside(void *context) {
    char here[PATH_MAX];
    const char *temporary = getenv("TMPDIR"); // NOLINT(concurrency-mt-unsafe): the only thread
    (void)context;
    return TL_EXPECT(write_text("file")) && TL_EXPECT(can_read("file")) && TL_EXPECT(write_text("file")) &&
           TL_EXPECT(mkdir("folder", 0700) == 0) &&
           TL_EXPECT(temporary != NULL && strcmp(temporary, inside.folder) == 0) &&
           TL_EXPECT(getcwd(here, sizeof here) != NULL && strcmp(here, inside.folder) == 0);
}

static bool remove_inside(void *context) {
    return work_inside(context) && TL_EXPECT(rename("file", "renamed") == 0) && TL_EXPECT(unlink("renamed") == 0) &&
           TL_EXPECT(rmdir("folder") == 0);
}

/* Without Landlock no file can be removed, because nothing limits which ones. */
static void its_own_folder_is_writable(void) {
    need_filter();
    expect(-1, work_inside);
    tl_scratch_empty(&inside);
    for (int version = 1; version <= tl_landlock_version(); version++) {
        expect(version, remove_inside);
        tl_scratch_empty(&inside);
    }
}

static bool read_named(void *context) {
    (void)context;
    return TL_EXPECT(can_read(victim)) && TL_EXPECT(is_denied(open(victim, O_RDWR))) &&
           TL_EXPECT(is_denied(open(below, O_WRONLY | O_CREAT, 0600)));
}

static bool write_named(void *context) {
    (void)context;
    return TL_EXPECT(write_text(victim));
}

static void listed_paths_are_reached_and_missing_ones_skipped(void) {
    const char *const files[] = {"/none/at/all", victim};
    const char *const folders[] = {outside.folder, "/none"};
    tl_confine_settings settings = {.folder = inside.folder, .read = files, .read_count = 2};
    need_landlock(1);
    tl_confined_run(settings, read_named, NULL, &confined);
    TEST_ASSERT_TRUE(confined.succeeded);
    settings.read = folders;
    tl_confined_run(settings, read_named, NULL, &confined);
    TEST_ASSERT_TRUE(confined.succeeded);
    settings.read_count = 0;
    settings.write = files;
    settings.write_count = 2;
    tl_confined_run(settings, write_named, NULL, &confined);
    TEST_ASSERT_TRUE(confined.succeeded);
    expect_untouched();
}

int main(void) {
    UNITY_BEGIN();
    tl_scratch_make(&outside, "/tmp", "tl_outside");
    tl_scratch_make(&inside, "/tmp", "tl_inside");
    (void)snprintf(victim, sizeof victim, "%s", tl_scratch_path(&outside, "victim"));
    (void)snprintf(below, sizeof below, "%s", tl_scratch_path(&outside, "new"));
    RUN_TEST(nothing_outside_is_read_or_changed);
    RUN_TEST(links_and_moves_lead_nowhere);
    RUN_TEST(no_file_is_truncated_without_write_access);
    RUN_TEST(no_modes_owners_and_dates_change);
    RUN_TEST(a_process_reads_harmless_files_about_itself);
    RUN_TEST(system_files_for_programs_are_readable);
    RUN_TEST(its_own_folder_is_writable);
    RUN_TEST(listed_paths_are_reached_and_missing_ones_skipped);
    tl_scratch_remove(&outside);
    return tl_scratch_finish(&inside, UNITY_END());
}
