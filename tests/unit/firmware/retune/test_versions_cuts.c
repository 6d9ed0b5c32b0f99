/* Power cuts at each moment at which data reach the disk: the versions found afterwards are those
 * before or those after a change. Each call also fails once; then the change has no effect.
 *
 * Model: the program calls the fsync(), rename() and unlink() below. They inspect the folder before
 * and after the real calls, and derive the folders that a power cut may leave:
 *   - all names and bytes, as after a kill;
 *   - all names, but only synced bytes;
 *   - the names that the folder had at its last sync.
 * The test creates and opens each of them. */
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include <unity.h>

#include "firmware/base/log.h"
#include "firmware/retune/versions.h"
#include "tests/support/message.h"
#include "tests/support/scratch.h"

enum { MOST_FILES = 160, MOST_BYTES = 4096, MOST_STATES = 512, STATE = 4096, NAME = 256 };

static tl_scratch state;      /* of the program under test */
static tl_scratch folder;     /* its versions/ */
static tl_scratch cut;        /* after a power cut */
static tl_scratch cut_folder; /* its versions/ */
static tl_versions versions;
static tl_error error;

/* ---- the disk ---- */

typedef struct content {
    ino_t inode;
    size_t size;
    char bytes[MOST_BYTES];
} content;

typedef struct entry {
    char name[NAME];
    content content;
} entry;

static content synced[MOST_FILES]; /* inodes with durable bytes */
static size_t synced_count;
static entry durable[MOST_FILES]; /* durable names */
static size_t durable_count;
static bool has_folder;                 /* the folder's own name is durable */
static bool looks;                      /* the program under test makes the calls below */
static size_t calls, fails_at;          /* calls so far; the call that fails, from 1; 0: none */
static char states[MOST_STATES][STATE]; /* found after power cuts */
static size_t state_count;

static void read_content(int file, content *read_into) {
    struct stat about;
    TEST_ASSERT_EQUAL_INT(0, fstat(file, &about));
    read_into->inode = about.st_ino;
    ssize_t size = pread(file, read_into->bytes, MOST_BYTES, 0);
    TEST_ASSERT_TRUE(size >= 0 && size < MOST_BYTES);
    read_into->size = (size_t)size;
}

static content *find_synced(ino_t inode) {
    for (size_t i = 0; i < synced_count; i++) {
        if (synced[i].inode == inode) {
            return &synced[i];
        }
    }
    return NULL;
}

/* Lists the files of the folder with all bytes, or with their durable bytes only. */
static size_t list_names(entry names[MOST_FILES], bool only_synced) {
    size_t count = 0;
    DIR *listing = opendir(folder.folder);
    for (struct dirent *found = listing != NULL ? readdir(listing) : NULL; found != NULL; found = readdir(listing)) {
        if (found->d_name[0] != '.') {
            TEST_ASSERT_LESS_THAN_size_t(MOST_FILES, count);
            (void)snprintf(names[count].name, NAME, "%s", found->d_name);
            int file = open(tl_scratch_path(&folder, found->d_name), O_RDONLY | O_CLOEXEC);
            TEST_ASSERT_GREATER_OR_EQUAL_INT(0, file);
            read_content(file, &names[count].content);
            (void)close(file);
            const content *bytes = find_synced(names[count].content.inode);
            if (only_synced && bytes != NULL) {
                names[count].content = *bytes;
            } else if (only_synced) {
                names[count].content.size = 0;
            }
            count++;
        }
    }
    if (listing != NULL) {
        (void)closedir(listing);
    }
    return count;
}

/* The program's descriptor is write-only, so the bytes are read by name. */
static void sync_file(ino_t inode) {
    static entry names[MOST_FILES];
    size_t count = list_names(names, false);
    for (size_t i = 0; i < count; i++) {
        if (names[i].content.inode == inode) {
            content *there = find_synced(inode);
            TEST_ASSERT_LESS_THAN_size_t(MOST_FILES, synced_count);
            *(there != NULL ? there : &synced[synced_count++]) = names[i].content;
        }
    }
}

/* Describes the versions in one line. */
static void describe(const tl_versions *found, char text[STATE]) {
    const tl_version_probation *probation = &found->probation;
    int length =
        snprintf(text, STATE, "active %d, taken %.6s, probation %d to %d, %d ms;", (int)found->active, found->file_hash,
                 (int)probation->version, (int)probation->return_to, (int)probation->account.left_ms);
    for (size_t i = 0; i < found->count && length < STATE; i++) {
        const tl_version *version = &found->list[i];
        length += snprintf(text + length, (size_t)(STATE - length), " %d(%d) %s %s;", (int)version->number,
                           (int)version->parent, tl_version_results[version->result], version->reason);
    }
    TEST_ASSERT_LESS_THAN_INT(STATE, length);
}

/* Each version of the folder can be read, and one of them is chosen for the run. */
static void check_texts(tl_versions *found) {
    tl_version_choice choice;
    char *text = NULL;
    for (size_t i = 0; i < found->count; i++) {
        TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_versions_read(found, found->list[i].number, &text, &error), error.text);
        free(text);
    }
    const char *file = found->active == 0 ? "one" : NULL;
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_versions_choose(found, file, 3, &choice, &error), error.text);
    TEST_ASSERT_EQUAL_UINT64(found->active, choice.number);
    TEST_ASSERT_EQUAL_INT(found->active == 0, choice.is_candidate);
    free(choice.text);
}

static void empty_cut(void) {
    tl_scratch_empty(&cut_folder);
    (void)rmdir(cut_folder.folder);
}

/* Opens a folder with these files, as after a reboot. */
static void start_again(const entry *names, size_t count, bool has_a_folder) {
    tl_versions found;
    empty_cut();
    if (has_a_folder) {
        TEST_ASSERT_EQUAL_INT(0, mkdir(cut_folder.folder, 0755));
    }
    for (size_t i = 0; i < count && has_a_folder; i++) {
        FILE *file = fopen(tl_scratch_path(&cut_folder, names[i].name), "w");
        TEST_ASSERT_NOT_NULL(file);
        TEST_ASSERT_EQUAL_size_t(names[i].content.size, fwrite(names[i].content.bytes, 1, names[i].content.size, file));
        TEST_ASSERT_EQUAL_INT(0, fclose(file));
    }
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_versions_open(cut.folder, &found, &error), error.text);
    TEST_ASSERT_LESS_THAN_size_t(MOST_STATES, state_count);
    describe(&found, states[state_count++]);
    check_texts(&found);
    tl_versions_close(&found);
}

/* Simulates a power cut now, except in a test of failing calls. */
static void cut_power(void) {
    static entry names[MOST_FILES];
    if (fails_at != 0) {
        return;
    }
    looks = false;
    start_again(names, list_names(names, false), true);
    start_again(names, list_names(names, true), true);
    start_again(durable, durable_count, has_folder);
    looks = true;
}

/* Returns true if this call must fail. */
static bool begin_call(void) {
    if (!looks) {
        return false;
    }
    cut_power();
    calls++;
    errno = EIO;
    return calls == fails_at;
}

static int end_call(int result) {
    if (looks) {
        int cause = errno;
        cut_power();
        errno = cause;
    }
    return result;
}

/* ---- system calls of the program; fsync() does not wait for a disk ---- */

int fsync(int fd) {
    struct stat about;
    struct stat here;
    bool looked = looks;
    if (begin_call()) {
        return -1;
    }
    looks = false;
    if (looked && fstat(fd, &about) == 0 && S_ISREG(about.st_mode)) {
        sync_file(about.st_ino);
    } else if (looked && stat(folder.folder, &here) == 0 && here.st_ino == about.st_ino) {
        durable_count = list_names(durable, true);
    } else if (looked) {
        has_folder = true;
    }
    looks = looked;
    return end_call(0);
}

int rename(const char *old, const char *new) {
    return begin_call() ? -1 : end_call(renameat(AT_FDCWD, old, AT_FDCWD, new));
}

int unlink(const char *name) {
    return begin_call() ? -1 : end_call(unlinkat(AT_FDCWD, name, 0));
}

/* ---- changes ---- */

static const tl_probation_account account = {.terms = {60, 95.0, false}, .left_ms = 60000};
static const tl_probation_account passed = {.terms = {60, 95.0, false}, .left_ms = 50000};

static tl_status add(const char *text, tl_change_origin origin) {
    uint64_t number = 0;
    const tl_version_candidate candidate = {
        text, strlen(text), "anna", "", origin, TL_RIGHT_RETUNE, TL_CHANGE_IN_PLACE};
    return tl_versions_add(&versions, &candidate, &number, &error);
}

static tl_status open_folder(void) {
    tl_versions_close(&versions);
    return tl_versions_open(state.folder, &versions, &error);
}

static tl_status add_one(void) {
    return add("one", TL_ORIGIN_START);
}

static tl_status activate_one(void) {
    return tl_versions_activate(&versions, 1, NULL, &error);
}

static tl_status add_two(void) {
    return add("two", TL_ORIGIN_NETWORK);
}

static tl_status activate_two(void) {
    return tl_versions_activate(&versions, 2, &account, &error);
}

static tl_status pass(void) {
    return tl_versions_save_probation(&versions, &passed, &error);
}

static tl_status keep(void) {
    return tl_versions_end_probation(&versions, TL_VERSION_KEPT, "in lock", &error);
}

static tl_status add_three(void) {
    return add("three", TL_ORIGIN_RELOAD);
}

static tl_status activate_three(void) {
    return tl_versions_activate(&versions, 3, &account, &error);
}

static tl_status give_back(void) {
    return tl_versions_end_probation(&versions, TL_VERSION_ROLLED_BACK, "lost", &error);
}

static tl_status add_same(void) {
    return add("two", TL_ORIGIN_NETWORK);
}

static tl_status refuse_same(void) {
    return tl_versions_refuse(&versions, 4, "bad", &error);
}

static tl_status activate_three_again(void) {
    return tl_versions_activate(&versions, 3, &account, &error);
}

static tl_status activate_one_again(void) {
    return tl_versions_activate(&versions, 1, NULL, &error);
}

/* The changes in their order. */
static tl_status (*const changes[])(void) = {open_folder,
                                             add_one,
                                             activate_one,
                                             add_two,
                                             activate_two,
                                             pass,
                                             keep,
                                             add_three,
                                             activate_three,
                                             give_back,
                                             add_same,
                                             refuse_same,
                                             activate_three_again,
                                             activate_one_again};
enum { CHANGES = sizeof changes / sizeof changes[0] };

void setUp(void) {
    looks = false;
    tl_versions_close(&versions);
    tl_scratch_empty(&folder);
    (void)rmdir(folder.folder);
    synced_count = durable_count = state_count = 0;
    has_folder = false;
    calls = fails_at = 0;
}

void tearDown(void) {
    looks = false;
    tl_versions_close(&versions);
    empty_cut();
}

/* Each state found after a power cut is `before` or `after`. */
static void expect_one_of(const char *before, const char *after, const char *about) {
    for (size_t i = 0; i < state_count; i++) {
        if (strcmp(states[i], before) != 0) {
            TEST_ASSERT_EQUAL_STRING_MESSAGE(after, states[i], about);
        }
    }
}

static void test_old_or_new(void) {
    char before[STATE] = "";
    char after[STATE];
    char about[40];
    size_t cuts = 0;
    describe(&versions, before);
    for (size_t i = 0; i < CHANGES; i++) {
        state_count = 0;
        looks = true;
        tl_status status = changes[i]();
        cut_power();
        looks = false;
        TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, status, error.text);
        describe(&versions, after);
        (void)snprintf(about, sizeof about, "change %zu", i);
        expect_one_of(before, after, about);
        /* A change is durable once its call has returned. */
        for (size_t k = state_count - 3; k < state_count; k++) {
            TEST_ASSERT_EQUAL_STRING_MESSAGE(after, states[k], about);
        }
        cuts += state_count;
        memcpy(before, after, sizeof before);
    }
    TL_EXPECT_PARTS("active 1|taken 8b5b9d|probation 0 to 0|0 ms|1(0) active|2(1) kept in lock", before);
    TL_EXPECT_PARTS("3(2) returned|version 1|4(2) refused bad", before);
    TEST_ASSERT_EQUAL_size_t(4, versions.count);
    TEST_ASSERT_GREATER_THAN_size_t(300, cuts);
}

/* Marks all files as durable. */
static void make_durable(void) {
    synced_count = 0;
    durable_count = list_names(durable, false);
    for (size_t i = 0; i < durable_count; i++) {
        synced[synced_count++] = durable[i].content;
    }
    has_folder = true;
}

/* Makes the changes before this one, without power cuts. */
static void live_until(size_t change) {
    setUp();
    for (size_t i = 0; i < change; i++) {
        TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, changes[i](), error.text);
    }
    make_durable();
}

/* Makes the change with one failing call. Returns false if it makes fewer calls. */
static bool fail_once(size_t change, size_t call) {
    char before[STATE];
    char after[STATE];
    char found[STATE];
    char about[60];
    live_until(change + 1);
    describe(&versions, after);
    live_until(change);
    describe(&versions, before);
    fails_at = call;
    looks = true;
    tl_status status = changes[change]();
    looks = false;
    (void)snprintf(about, sizeof about, "change %zu, call %zu", change, call);
    if (calls < call) {
        TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, status, error.text);
        return false;
    }
    for (int i = 0; i < 2; i++) {
        describe(&versions, found);
        TEST_ASSERT_EQUAL_STRING_MESSAGE(status == TL_OK ? after : before, found, about);
        TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, open_folder(), error.text);
    }
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, add("another", TL_ORIGIN_NETWORK), error.text);
    return true;
}

static void test_each_call_fails_once(void) {
    size_t failures = 0;
    for (size_t change = 1; change < CHANGES; change++) { /* opening makes no such call */
        for (size_t call = 1; fail_once(change, call); call++) {
            failures++;
        }
    }
    TEST_ASSERT_GREATER_THAN_size_t(50, failures);
}

/* While old versions are removed, the active one stays active, and each listed one can be read. */
static void test_old_ones_are_removed(void) {
    char text[16];
    live_until(5);
    for (int i = 0; i < TL_VERSIONS_MOST - 2; i++) {
        (void)snprintf(text, sizeof text, "%d", i);
        TEST_ASSERT_EQUAL_INT(TL_OK, add(text, TL_ORIGIN_NETWORK));
    }
    make_durable();
    TEST_ASSERT_EQUAL_size_t(TL_VERSIONS_MOST, versions.count);
    looks = true;
    TEST_ASSERT_EQUAL_INT(TL_OK, add("one more", TL_ORIGIN_NETWORK));
    looks = false;
    TEST_ASSERT_EQUAL_size_t(TL_VERSIONS_MOST, versions.count);
    TEST_ASSERT_GREATER_THAN_size_t(20, state_count);
    for (size_t i = 0; i < state_count; i++) {
        TEST_ASSERT_EQUAL_STRING_LEN(states[0], states[i], strcspn(states[0], ";"));
    }
}

int main(void) {
    tl_scratch_make(&state, TL_BINARY_DIR, "versions_cuts");
    (void)snprintf(folder.folder, sizeof folder.folder, "%.*s/versions", PATH_MAX - 20, state.folder);
    tl_scratch_make(&cut, TL_BINARY_DIR, "versions_cut");
    (void)snprintf(cut_folder.folder, sizeof cut_folder.folder, "%.*s/versions", PATH_MAX - 20, cut.folder);
    tl_log_set_level(TL_LOG_ERROR);
    UNITY_BEGIN();
    RUN_TEST(test_old_or_new);
    RUN_TEST(test_each_call_fails_once);
    RUN_TEST(test_old_ones_are_removed);
    setUp();
    tl_scratch_remove(&cut);
    return tl_scratch_finish(&state, UNITY_END());
}
