/* Copies of an FMU's private libraries: unpacked folders, tested with the loader of this
 * machine. */
#include <dlfcn.h>
#include <signal.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include <unity.h>

#include "firmware/fmu/own_copies.h"
#include "tests/support/message.h"

#define KINDS TL_BINARY_DIR "/tests/copies/"

static char scratch[64]; /* of all tests, because a library is never unloaded */
static char folder[128]; /* the folder that was created last */
static tl_error error;
static struct rlimit usual;

void setUp(void) {
    error = (tl_error){TL_OK, ""};
}

void tearDown(void) {}

/* ---- Helpers --------------------------------------------------------------------------------- */

static const char *path_of(const char *name) {
    static char path[256];
    (void)snprintf(path, sizeof path, "%s/%s", folder, name);
    return path;
}

static bool is_there(const char *name) {
    return access(path_of(name), F_OK) == 0;
}

/* True if there is a copy: a name with the same end. */
static bool has_copy_of(const char *name) {
    char command[512];
    (void)snprintf(command, sizeof command, "test -n \"$(find '%s' -name '[0-9][0-9a-z][0-9a-z]%s')\"", folder,
                   name + 3);
    return system(command) == 0; // NOLINT(cert-env33-c): our own names
}

/* Creates a folder with the libraries of one kind. */
static void unpack(const char *kind) {
    static int number;
    char command[512];
    (void)snprintf(folder, sizeof folder, "%s/%d", scratch, ++number);
    (void)snprintf(command, sizeof command, "cp -r '" KINDS "%s' '%s'", kind, folder);
    TEST_ASSERT_EQUAL_INT(0, system(command)); // NOLINT(cert-env33-c): our own names
}

static tl_status make_copies(void) {
    char binary[256];
    (void)snprintf(binary, sizeof binary, "%s", path_of("model.so"));
    return tl_own_copies_make(folder, binary, "box.fmu", &error);
}

/* Opens the model and calls it once. Returns its count: 1 if its library is not shared. */
static int open_and_count(void) {
    void *opened = dlopen(path_of("model.so"), RTLD_NOW | RTLD_LOCAL);
    TEST_ASSERT_NOT_NULL_MESSAGE(opened, dlerror());
    void *address = dlsym(opened, "model_count");
    int (*function)(void) = NULL;
    TEST_ASSERT_NOT_NULL(address);
    memcpy(&function, &address, sizeof address);
    return function();
}

/* Unpacks an FMU of this kind, makes its copies, and opens it. */
static int make_and_count(const char *kind) {
    unpack(kind);
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, make_copies(), error.text);
    return open_and_count();
}

static void leave_descriptors(rlim_t count) {
    int lowest = dup(STDERR_FILENO); /* all lower ones are in use */
    TEST_ASSERT_TRUE(lowest >= 0);
    TEST_ASSERT_EQUAL_INT(0, close(lowest));
    const struct rlimit tight = {.rlim_cur = (rlim_t)lowest + count, .rlim_max = usual.rlim_max};
    TEST_ASSERT_EQUAL_INT(0, setrlimit(RLIMIT_NOFILE, &tight));
}

/* ---- Tests, in this order -------------------------------------------------------------------- */

static void test_without_copies_the_loader_takes_the_first_one(void) {
    unpack("system");
    TEST_ASSERT_EQUAL_INT(1, open_and_count());
    unpack("system");
    TEST_ASSERT_EQUAL_INT(2, open_and_count());
}

static void test_the_first_stays_as_it_is(void) {
    TEST_ASSERT_EQUAL_INT(1, make_and_count("plain"));
    TEST_ASSERT_FALSE(has_copy_of("libtable.so"));
}

static void test_the_others_have_their_own(void) {
    for (int i = 0; i < 3; i++) {
        TEST_ASSERT_EQUAL_INT(1, make_and_count("plain"));
        TEST_ASSERT_TRUE(has_copy_of("libtable.so"));
        TEST_ASSERT_TRUE(is_there("libtable.so"));
    }
}

static void test_libraries_of_the_system_stay_shared(void) {
    TEST_ASSERT_EQUAL_INT(3, make_and_count("system"));
    TEST_ASSERT_EQUAL_INT(4, make_and_count("system"));
    TEST_ASSERT_FALSE(has_copy_of("libgomp.so.9"));
}

static void test_a_library_outside_of_fmus_is_never_copied(void) {
    unpack("versioned");
    TEST_ASSERT_EQUAL_INT(1, open_and_count()); /* like a library of the configuration: not in a folder of an FMU */
    TEST_ASSERT_EQUAL_INT(2, make_and_count("versioned"));
}

static void test_a_name_that_cannot_be_changed(void) {
    char command[512];
    unpack("plain"); /* its libtable.so has a symbol version of that name */
    (void)snprintf(command, sizeof command, "cp '" KINDS "versioned/libversioned.so' '%s'", path_of("libtable.so"));
    TEST_ASSERT_EQUAL_INT(0, system(command)); // NOLINT(cert-env33-c): our own names
    (void)snprintf(command, sizeof command, "sed -i 's/libversioned[.]so/libtable.so\\x00ned/g' '%s'",
                   path_of("libtable.so"));
    TEST_ASSERT_EQUAL_INT(0, system(command)); // NOLINT(cert-env33-c): our own names
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, make_copies());
    TL_EXPECT_PARTS("box.fmu|libtable.so|rename", error.text);
}

static void test_a_broken_binary_is_left_to_the_loader(void) {
    unpack("plain");
    FILE *file = fopen(path_of("model.so"), "we");
    TEST_ASSERT_NOT_NULL(file);
    TEST_ASSERT_TRUE(fputs("no library", file) >= 0);
    TEST_ASSERT_EQUAL_INT(0, fclose(file));
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, make_copies(), error.text);
    TEST_ASSERT_FALSE(has_copy_of("libtable.so"));
    TEST_ASSERT_NULL(dlopen(path_of("model.so"), RTLD_NOW | RTLD_LOCAL));
}

static void test_files_that_are_no_libraries_are_left_out(void) {
    unpack("plain");
    TEST_ASSERT_EQUAL_INT(0, mkdir(path_of("folder.so"), 0700));
    TEST_ASSERT_EQUAL_INT(0, symlink("model.so", path_of("link.so")));
    TEST_ASSERT_EQUAL_INT(0, mkfifo(path_of("fifo.so"), 0600));
    FILE *file = fopen(path_of("empty.so"), "we");
    TEST_ASSERT_NOT_NULL(file);
    TEST_ASSERT_EQUAL_INT(0, fclose(file));
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, make_copies(), error.text);
    TEST_ASSERT_EQUAL_INT(1, open_and_count());
}

static void test_descriptors_one_by_one(void) {
    enum { MOST = 8 };
    tl_status status = TL_TRY_AGAIN;
    TEST_ASSERT_EQUAL_INT(0, getrlimit(RLIMIT_NOFILE, &usual));
    for (rlim_t count = 0; count < MOST && status != TL_OK; count++) {
        unpack("plain");
        leave_descriptors(count);
        status = make_copies();
        TEST_ASSERT_EQUAL_INT(0, setrlimit(RLIMIT_NOFILE, &usual));
        if (status != TL_OK) {
            TEST_ASSERT_EQUAL_INT(TL_TRY_AGAIN, status);
            TL_EXPECT_PARTS("Too many open files", error.text);
        }
        TEST_ASSERT_TRUE(status != TL_OK || count > 0);
    }
    TEST_ASSERT_EQUAL_INT(TL_OK, status);
    TEST_ASSERT_EQUAL_INT(1, open_and_count());
}

static void test_a_copy_that_cannot_be_written(void) {
    const struct rlimit tight = {.rlim_cur = 1000, .rlim_max = RLIM_INFINITY};
    unpack("plain");
    TEST_ASSERT_EQUAL_INT(0, getrlimit(RLIMIT_FSIZE, &usual));
    void (*before)(int) = signal(SIGXFSZ, SIG_IGN);
    TEST_ASSERT_EQUAL_INT(0, setrlimit(RLIMIT_FSIZE, &tight));
    tl_status status = make_copies();
    TEST_ASSERT_EQUAL_INT(0, setrlimit(RLIMIT_FSIZE, &usual));
    (void)signal(SIGXFSZ, before);
    TEST_ASSERT_EQUAL_INT(TL_TRY_AGAIN, status);
    TL_EXPECT_PARTS("box.fmu|libtable.so|File too large", error.text);
}

int main(void) {
    char command[96];
    UNITY_BEGIN();
    (void)snprintf(scratch, sizeof scratch, "/tmp/twinlock-test-XXXXXX");
    if (mkdtemp(scratch) == NULL) {
        return EXIT_FAILURE;
    }
    RUN_TEST(test_without_copies_the_loader_takes_the_first_one);
    RUN_TEST(test_the_first_stays_as_it_is);
    RUN_TEST(test_the_others_have_their_own);
    RUN_TEST(test_libraries_of_the_system_stay_shared);
    RUN_TEST(test_a_library_outside_of_fmus_is_never_copied);
    RUN_TEST(test_a_name_that_cannot_be_changed);
    RUN_TEST(test_a_broken_binary_is_left_to_the_loader);
    RUN_TEST(test_files_that_are_no_libraries_are_left_out);
    RUN_TEST(test_descriptors_one_by_one);
    RUN_TEST(test_a_copy_that_cannot_be_written);
    (void)snprintf(command, sizeof command, "rm -rf '%s'", scratch);
    return system(command) == 0 ? UNITY_END() : EXIT_FAILURE; // NOLINT(cert-env33-c): our own mkdtemp name
}
