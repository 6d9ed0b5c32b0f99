/* Libraries for FMUs: FMUs that are opened later see their symbols. A missing library and a second
 * Python are rejected. The process ends without the destructors of the libraries. */
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <unity.h>

#include "firmware/fmu/fmu_binary.h"
#include "firmware/fmu/fmu_store.h"
#include "firmware/process/process_end.h"
#include "tests/support/fmu_maker.h"
#include "tests/support/message.h"

#define OLD TL_BINARY_DIR "/tests/interpreter-3.8.1.so"
#define NEW TL_BINARY_DIR "/tests/interpreter-3.12.3.so"

static char folder[64];
static tl_error error;

void setUp(void) {
    (void)snprintf(folder, sizeof folder, "/tmp/twinlock-test-XXXXXX");
    TEST_ASSERT_NOT_NULL(mkdtemp(folder));
    TEST_ASSERT_EQUAL_INT(0, setenv("TMPDIR", folder, 1));
    error = (tl_error){TL_OK, ""};
}

void tearDown(void) {
    char command[96];
    (void)snprintf(command, sizeof command, "rm -rf '%s'", folder);
    TEST_ASSERT_EQUAL_INT(0, system(command)); // NOLINT(cert-env33-c): our own mkdtemp name
}

/* ---- Helpers --------------------------------------------------------------------------------- */

static void in_folder(char *path, size_t size, const char *name) {
    (void)snprintf(path, size, "%s/%s", folder, name);
}

static void expect_refused(const char *path, const char *parts) {
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, tl_library_open(path, &error));
    TL_EXPECT_PARTS(parts, error.text);
    TEST_ASSERT_LESS_THAN_size_t_MESSAGE(TL_ERROR_TEXT - 1, strlen(error.text), "the text was cut");
}

/* Runs a body in a child process, because a library stays open. The exit code is the result. */
static void expect_in_child(int (*body)(void), int code) {
    int status = 0;
    (void)fflush(NULL);
    pid_t child = fork();
    if (child == 0) {
        tl_process_begin();
        tl_process_end(body());
    }
    TEST_ASSERT_GREATER_THAN_INT(0, child);
    TEST_ASSERT_EQUAL_INT(child, waitpid(child, &status, 0));
    TEST_ASSERT_TRUE_MESSAGE(WIFEXITED(status), "the child crashed");
    TEST_ASSERT_EQUAL_INT(code, WEXITSTATUS(status));
}

/* ---- Tests ----------------------------------------------------------------------------------- */

static void test_a_library_that_is_not_there(void) {
    expect_refused("libnothing.so.7", "libnothing.so.7|\"./libmodel.so\"");
    expect_refused("libpython3.99.so.1.0", "libpython3.99.so.1.0|Debian|libpython3.99");
    expect_refused("libpython3.99", "Debian|libpython3.99");
    expect_refused("/nowhere/libpython3.99.so.1.0", "/nowhere/libpython3.99.so.1.0|\"./libmodel.so\"");
}

static void test_what_is_no_library(void) {
    char path[96];
    in_folder(path, sizeof path, "text.so");
    FILE *file = fopen(path, "w");
    TEST_ASSERT_NOT_NULL(file);
    TEST_ASSERT_GREATER_THAN_INT(0, fprintf(file, "%4096s", "no library"));
    TEST_ASSERT_EQUAL_INT(0, fclose(file));
    expect_refused(path, "text.so|invalid ELF header");
    expect_refused(folder, "Is a directory");
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, tl_library_open(folder, NULL));
}

/* Loads an FMU that lacks a symbol. 0: rejected without the library and loaded with it. */
static int load_with_library(void) {
    char made[96];
    tl_fmu fmu = {0};
    in_folder(made, sizeof made, "lacking.fmu");
    tl_fmu_maker *maker = tl_fmu_maker_new(TL_BINARY_DIR "/fmus/motor.fmu");
    const char *name = maker == NULL ? NULL : tl_fmu_maker_find(maker, "/motor.so");
    if (name == NULL || !tl_fmu_maker_patch(maker, name, "strcmp", "Py_cmp", sizeof "strcmp") ||
        !tl_fmu_maker_write(maker, made)) {
        return 1;
    }
    tl_fmu_maker_free(maker);
    if (tl_fmu_load(made, -1, TL_ROLLBACK_STATE, &fmu, NULL) != TL_BAD_DATA || tl_library_open(OLD, NULL) != TL_OK) {
        return 2;
    }
    if (tl_fmu_load(made, -1, TL_ROLLBACK_STATE, &fmu, NULL) != TL_OK) {
        return 3;
    }
    fmi2Component instance =
        fmu.guard.functions.instantiate("one", fmi2CoSimulation, fmu.model.guid, fmu.resources, &fmu.guard.callbacks,
                                        fmi2False, fmi2False); /* compares the GUIDs */
    if (instance == NULL) {
        return 4;
    }
    fmu.guard.functions.free_instance(instance);
    tl_fmu_unload(&fmu);
    return 0;
}

static void test_all_fmus_see_its_symbols(void) {
    expect_in_child(load_with_library, 0);
}

static int open_two_pythons(void) {
    for (int time = 0; time < 2; time++) {
        if (tl_library_open(OLD, NULL) != TL_OK) {
            return 1;
        }
    }
    if (tl_library_open(NEW, &error) != TL_BAD_DATA) {
        return 2;
    }
    return tl_test_has_parts(error.text, "interpreter-3.12.3.so|Python 3.12.3|Python 3.8.1") ? 0 : 3;
}

static void test_two_pythons(void) {
    expect_in_child(open_two_pythons, 0);
}

static char written[96];
static FILE *unclosed;

static int leave_something_unwritten(void) {
    unclosed = fopen(written, "w");
    bool done = unclosed != NULL && fputs("written", unclosed) >= 0 && tl_library_open(OLD, NULL) == TL_OK;
    return done ? 42 : 1;
}

/* The exit code and the buffered output are kept. The destructor of the library does not run. */
static void test_the_end_of_the_process(void) {
    char ended[96];
    char text[16] = "";
    in_folder(ended, sizeof ended, "ended");
    in_folder(written, sizeof written, "written");
    TEST_ASSERT_EQUAL_INT(0, setenv("TL_TEST_ENDED", ended, 1));
    expect_in_child(leave_something_unwritten, 42);
    TEST_ASSERT_EQUAL_INT(0, unsetenv("TL_TEST_ENDED"));
    FILE *file = fopen(written, "r");
    TEST_ASSERT_NOT_NULL(file);
    TEST_ASSERT_NOT_NULL(fgets(text, sizeof text, file));
    (void)fclose(file);
    TEST_ASSERT_EQUAL_STRING("written", text);
    TEST_ASSERT_NOT_EQUAL_INT_MESSAGE(0, access(ended, F_OK), "the loader ended the library");
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_a_library_that_is_not_there);
    RUN_TEST(test_what_is_no_library);
    RUN_TEST(test_all_fmus_see_its_symbols);
    RUN_TEST(test_two_pythons);
    RUN_TEST(test_the_end_of_the_process);
    return UNITY_END();
}
