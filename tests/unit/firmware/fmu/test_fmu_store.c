/* Loading FMUs: a good one works. Each hostile or broken one is rejected; the message names the
 * cause, and no folder remains. */
#include <dirent.h>
#include <elf.h>
#include <limits.h>
#include <math.h>
#include <signal.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <unity.h>

#include "firmware/base/log.h"
#include "firmware/fmu/fmu_archive.h"
#include "firmware/fmu/fmu_store.h"
#include "tests/support/fmu_maker.h"
#include "tests/support/message.h"
#include "tests/support/stderr_capture.h"

#define GOOD TL_BINARY_DIR "/fmus/motor.fmu"
#define PREFIX "twinlock-fmu-"

static char folder[64];     /* of this test; contains the files below */
static char temporary[128]; /* TMPDIR, with characters that a URI must encode */
static char made[128];      /* the FMU that the test makes */
static tl_fmu_maker *maker;
static tl_fmu fmu;
static tl_error error;

static void remove_folder(void) {
    char command[96];
    (void)snprintf(command, sizeof command, "rm -rf '%s'", folder);
    TEST_ASSERT_EQUAL_INT(0, system(command)); // NOLINT(cert-env33-c): our own mkdtemp name
}

void setUp(void) {
    (void)snprintf(folder, sizeof folder, "/tmp/twinlock-test-XXXXXX");
    TEST_ASSERT_NOT_NULL(mkdtemp(folder));
    (void)snprintf(temporary, sizeof temporary, "%s/tmp 100%%\xC3\xBC", folder);
    (void)snprintf(made, sizeof made, "%s/box.fmu", folder);
    TEST_ASSERT_EQUAL_INT(0, mkdir(temporary, 0700));
    TEST_ASSERT_EQUAL_INT(0, setenv("TMPDIR", temporary, 1));
    maker = tl_fmu_maker_new(GOOD);
    TEST_ASSERT_NOT_NULL_MESSAGE(maker, GOOD " is not there; build all");
    fmu = (tl_fmu){0};
    error = (tl_error){TL_OK, ""};
    tl_log_set_level(TL_LOG_NOTICE);
}

void tearDown(void) {
    tl_fmu_unload(&fmu);
    tl_fmu_maker_free(maker);
    maker = NULL;
    remove_folder();
}

/* ---- Helpers --------------------------------------------------------------------------------- */

static size_t count_unpacked(void) {
    size_t count = 0;
    DIR *all = opendir(temporary);
    for (struct dirent *entry = readdir(all); entry != NULL; entry = readdir(all)) {
        count += strncmp(entry->d_name, PREFIX, strlen(PREFIX)) == 0 ? 1 : 0;
    }
    (void)closedir(all);
    return count;
}

/* Counts the entries of a folder. */
static size_t count_all(const char *path) {
    size_t count = 0;
    DIR *all = opendir(path);
    for (struct dirent *entry = readdir(all); entry != NULL; entry = readdir(all)) {
        count += entry->d_name[0] == '.' ? 0 : 1;
    }
    (void)closedir(all);
    return count;
}

static void expect_loaded(const char *path) {
    error = (tl_error){TL_OK, ""};
    tl_status status = tl_fmu_load(path, -1, TL_ROLLBACK_STATE, &fmu, &error);
    TEST_ASSERT_EQUAL_STRING("", error.text);
    TEST_ASSERT_EQUAL_INT(TL_OK, status);
    TEST_ASSERT_EQUAL_size_t(1, count_unpacked());
}

/* The message has the path and the parts. Nothing remains, neither in TMPDIR nor beside it. */
static void expect_refused_file(const char *path, tl_status expected, const char *parts) {
    tl_fmu empty = {0};
    size_t beside = count_all(folder);
    TEST_ASSERT_EQUAL_INT(expected, tl_fmu_load(path, -1, TL_ROLLBACK_STATE, &fmu, &error));
    TEST_ASSERT_EQUAL_INT(expected, error.status);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, path), error.text);
    TL_EXPECT_PARTS(parts, error.text);
    TEST_ASSERT_LESS_THAN_size_t_MESSAGE(TL_ERROR_TEXT - 1, strlen(error.text), "the text was cut");
    TEST_ASSERT_EQUAL_size_t(0, count_all(temporary));
    TEST_ASSERT_EQUAL_size_t(beside, count_all(folder));
    TEST_ASSERT_EQUAL_MEMORY(&empty, &fmu, sizeof fmu);
}

static void write_made(void) {
    TEST_ASSERT_TRUE(tl_fmu_maker_write(maker, made));
}

static void expect_refused(const char *parts) {
    write_made();
    expect_refused_file(made, TL_BAD_DATA, parts);
}

static void put_text(const char *name, const char *text) {
    TEST_ASSERT_TRUE(tl_fmu_maker_put_text(maker, name, text));
}

static void replace_in_description(const char *from, const char *to) {
    TEST_ASSERT_TRUE_MESSAGE(tl_fmu_maker_replace(maker, "modelDescription.xml", from, to), from);
}

/* On x86-64: "binaries/linux64/motor.so". */
static const char *binary_name(void) {
    const char *name = tl_fmu_maker_find(maker, "/motor.so");
    TEST_ASSERT_NOT_NULL(name);
    return name;
}

static unsigned char *binary(void) {
    size_t size;
    unsigned char *bytes = tl_fmu_maker_content(maker, binary_name(), &size);
    TEST_ASSERT_GREATER_THAN_size_t(sizeof(Elf32_Ehdr), size);
    return bytes;
}

static void patch_binary(const char *from, const char *to) {
    TEST_ASSERT_EQUAL_size_t(strlen(from), strlen(to));
    TEST_ASSERT_TRUE_MESSAGE(tl_fmu_maker_patch(maker, binary_name(), from, to, strlen(from) + 1), from);
}

static void set_machine(unsigned machine) {
    bool little = __BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__;
    size_t at = offsetof(Elf32_Ehdr, e_machine);
    binary()[at + (little ? 0 : 1)] = (unsigned char)(machine & 0xFFU);
    binary()[at + (little ? 1 : 0)] = (unsigned char)(machine >> 8);
}

static void path_in_fmu(char *path, size_t size, const char *name) {
    DIR *all = opendir(temporary);
    path[0] = '\0';
    for (struct dirent *entry = readdir(all); entry != NULL; entry = readdir(all)) {
        if (strncmp(entry->d_name, PREFIX, strlen(PREFIX)) == 0) {
            (void)snprintf(path, size, "%s/%s%s%s", temporary, entry->d_name, name[0] == '\0' ? "" : "/", name);
        }
    }
    (void)closedir(all);
    TEST_ASSERT_NOT_EQUAL_CHAR('\0', path[0]);
}

static bool exists(const char *path) {
    struct stat status;
    return lstat(path, &status) == 0;
}

/* ---- A good FMU ------------------------------------------------------------------------------ */

static double run_ten_steps(void) {
    const tl_fmi2 *fmi = &fmu.guard.functions;
    const tl_variable *omega = tl_model_variable(&fmu.model, "omega");
    TEST_ASSERT_NOT_NULL(omega);
    fmi2Component instance = fmi->instantiate("one", fmi2CoSimulation, fmu.model.guid, fmu.resources,
                                              &fmu.guard.callbacks, fmi2False, fmi2False);
    TEST_ASSERT_NOT_NULL(instance);
    TEST_ASSERT_EQUAL_INT(fmi2OK, fmi->setup_experiment(instance, fmi2False, 0, 0, fmi2False, 0));
    TEST_ASSERT_EQUAL_INT(fmi2OK, fmi->enter_initialization_mode(instance));
    TEST_ASSERT_EQUAL_INT(fmi2OK, fmi->exit_initialization_mode(instance));
    for (int i = 0; i < 10; i++) {
        TEST_ASSERT_EQUAL_INT(fmi2OK, fmi->do_step(instance, 0.01 * i, 0.01, fmi2True));
    }
    fmi2Real value = (double)NAN;
    TEST_ASSERT_EQUAL_INT(fmi2OK, fmi->get_real(instance, &omega->reference, 1, &value));
    TEST_ASSERT_EQUAL_INT(fmi2OK, fmi->terminate(instance));
    fmi->free_instance(instance);
    return value;
}

static void test_a_good_fmu_runs(void) {
    expect_loaded(GOOD);
    TEST_ASSERT_EQUAL_STRING(GOOD, fmu.path);
    TEST_ASSERT_EQUAL_STRING("motor", fmu.model.identifier);
    TEST_ASSERT_EQUAL_PTR(&fmu.guard, fmu.guard.callbacks.componentEnvironment);
    TEST_ASSERT_NULL(fmu.guard.callbacks.stepFinished);
    TEST_ASSERT_TRUE(fmu.model.capabilities.can_get_and_set_state);
    TEST_ASSERT_NOT_NULL(fmu.guard.functions.get_fmu_state);
    TEST_ASSERT_NOT_NULL(fmu.guard.functions.deserialize_fmu_state);
    TEST_ASSERT_TRUE(isfinite(run_ten_steps()));
    tl_fmu_unload(&fmu);
    TEST_ASSERT_EQUAL_size_t(0, count_all(temporary));
    tl_fmu_unload(&fmu); /* zeroed: allowed */
}

static void test_each_load_has_a_binary_of_its_own(void) {
    tl_fmu other;
    expect_loaded(GOOD);
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_fmu_load(GOOD, -1, TL_ROLLBACK_STATE, &other, &error));
    TEST_ASSERT_EQUAL_size_t(2, count_unpacked());
    TEST_ASSERT_TRUE(fmu.guard.own.do_step != other.guard.own.do_step);
    TEST_ASSERT_EQUAL_DOUBLE(run_ten_steps(), run_ten_steps());
    tl_fmu_unload(&other);
    TEST_ASSERT_EQUAL_size_t(1, count_unpacked());
    TEST_ASSERT_TRUE(isfinite(run_ten_steps()));
}

static void test_resources(void) {
    char expected[768];
    char path[512];
    expect_loaded(GOOD); /* without resources */
    path_in_fmu(path, sizeof path, "resources");
    TEST_ASSERT_TRUE(exists(path));
    const char *name = strstr(path, PREFIX);
    (void)snprintf(expected, sizeof expected, "file://%s/tmp%%20100%%25%%C3%%BC/%s", folder, name);
    TEST_ASSERT_EQUAL_STRING(expected, fmu.resources);
    tl_fmu_unload(&fmu);
    put_text("resources/table.csv", "1;2\n");
    write_made();
    expect_loaded(made);
    path_in_fmu(path, sizeof path, "resources/table.csv");
    TEST_ASSERT_TRUE(exists(path));
}

static void test_the_folder_is_private(void) {
    struct stat status;
    char path[512];
    expect_loaded(GOOD);
    path_in_fmu(path, sizeof path, "");
    TEST_ASSERT_EQUAL_INT(0, stat(path, &status));
    TEST_ASSERT_EQUAL_UINT(0700, status.st_mode & 07777U);
    TEST_ASSERT_EQUAL_UINT(geteuid(), status.st_uid);
}

static void test_only_needed_entries_are_unpacked(void) {
    char path[512];
    put_text("documentation/index.html", "<p>");
    put_text("sources/model.c", "int x;");
    put_text("binaries/win64/motor.dll", "MZ");
    put_text("./extra//file.txt", "x");
    write_made();
    expect_loaded(made);
    path_in_fmu(path, sizeof path, "documentation/index.html");
    TEST_ASSERT_FALSE(exists(path));
    path_in_fmu(path, sizeof path, "sources/model.c");
    TEST_ASSERT_FALSE(exists(path));
    path_in_fmu(path, sizeof path, "binaries/win64/motor.dll");
    TEST_ASSERT_FALSE(exists(path));
    path_in_fmu(path, sizeof path, "extra/file.txt");
    TEST_ASSERT_TRUE(exists(path));
}

/* Some exporters for Windows write backslashes. */
static void test_backslashes_are_separators(void) {
    char name[128];
    (void)snprintf(name, sizeof name, "%s", binary_name());
    for (char *c = name; *c != '\0'; c++) {
        *c = *c == '/' ? '\\' : *c;
    }
    TEST_ASSERT_TRUE(tl_fmu_maker_rename(maker, binary_name(), name));
    write_made();
    expect_loaded(made);
    TEST_ASSERT_TRUE(isfinite(run_ten_steps()));
}

/* Unloading removes all files in the folder of the FMU, but not the target of a link. */
static void test_unloading_follows_no_link(void) {
    char inside[512];
    char outside[128];
    expect_loaded(GOOD);
    (void)snprintf(outside, sizeof outside, "%s/keep", folder);
    TEST_ASSERT_EQUAL_INT(0, mkdir(outside, 0700));
    path_in_fmu(inside, sizeof inside, "resources/link");
    TEST_ASSERT_EQUAL_INT(0, symlink(outside, inside));
    (void)snprintf(outside, sizeof outside, "%s/keep/file", folder);
    TEST_ASSERT_EQUAL_INT(0, mkdir(outside, 0700));
    tl_fmu_unload(&fmu);
    TEST_ASSERT_EQUAL_size_t(0, count_all(temporary));
    TEST_ASSERT_TRUE(exists(outside));
}

/* ---- Folders of killed processes ------------------------------------------------------------- */

/* Starts a process that loads the FMU and then waits. */
static pid_t start_loader(void) {
    int ready[2];
    char byte = 0;
    TEST_ASSERT_EQUAL_INT(0, pipe(ready));
    pid_t child = fork();
    if (child == 0) {
        byte = tl_fmu_load(GOOD, -1, TL_ROLLBACK_STATE, &fmu, NULL) == TL_OK ? 'y' : 'n';
        (void)!write(ready[1], &byte, 1);
        (void)pause();
        _exit(0);
    }
    (void)close(ready[1]);
    TEST_ASSERT_EQUAL_INT(1, read(ready[0], &byte, 1));
    (void)close(ready[0]);
    TEST_ASSERT_EQUAL_CHAR('y', byte);
    return child;
}

static void kill_loader(pid_t child) {
    (void)kill(child, SIGKILL);
    TEST_ASSERT_EQUAL_INT(child, waitpid(child, NULL, 0));
}

static void test_folders_of_killed_processes_are_swept(void) {
    pid_t dead = start_loader();
    kill_loader(dead);
    pid_t alive = start_loader(); /* removes the folder of the dead process */
    TEST_ASSERT_EQUAL_size_t(1, count_unpacked());
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_fmu_load(GOOD, -1, TL_ROLLBACK_STATE, &fmu, &error));
    TEST_ASSERT_EQUAL_size_t(2, count_unpacked()); /* of the living process, and ours */
    tl_fmu_unload(&fmu);
    TEST_ASSERT_EQUAL_size_t(1, count_unpacked());
    kill_loader(alive);
    expect_loaded(GOOD);
}

/* Files and folders with a similar name stay. */
static void test_sweeping_touches_nothing_else(void) {
    static const char *const names[] = {"twinlock-fmu-abc-XXXXXX",  "twinlock-fmu--1-XXXXXX", "twinlock-fmu-%ld-short",
                                        "twinlock-fmu-%ld-toolong", "twinlock-fmu-",          "other-%ld-XXXXXX"};
    pid_t dead = start_loader();
    kill_loader(dead);
    char path[512];
    for (size_t i = 0; i < sizeof names / sizeof names[0]; i++) {
        char name[64] = "";
        const char *number = strstr(names[i], "%ld");
        (void)snprintf(name, sizeof name, "%.*s", number == NULL ? 60 : (int)(number - names[i]), names[i]);
        if (number != NULL) {
            size_t length = strlen(name);
            (void)snprintf(name + length, sizeof name - length, "%ld%s", (long)dead, number + 3);
        }
        (void)snprintf(path, sizeof path, "%s/%s", temporary, name);
        TEST_ASSERT_EQUAL_INT(0, mkdir(path, 0700));
    }
    char target[128];
    (void)snprintf(target, sizeof target, "%s/target", folder);
    TEST_ASSERT_EQUAL_INT(0, mkdir(target, 0700));
    (void)snprintf(path, sizeof path, "%s/" PREFIX "%ld-linked", temporary, (long)dead);
    TEST_ASSERT_EQUAL_INT(0, symlink(target, path)); /* the right name, but a link */
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_fmu_load(GOOD, -1, TL_ROLLBACK_STATE, &fmu, &error));
    tl_fmu_unload(&fmu);
    TEST_ASSERT_EQUAL_size_t(sizeof names / sizeof names[0] + 1, count_all(temporary));
    TEST_ASSERT_TRUE(exists(target));
}

/* ---- The archive ----------------------------------------------------------------------------- */

static void test_no_file(void) {
    expect_refused_file("/nowhere/box.fmu", TL_BAD_DATA, "No such file");
    expect_refused_file(folder, TL_BAD_DATA, ".fmu file");
    TEST_ASSERT_EQUAL_INT(0, mkfifo(made, 0600));
    expect_refused_file(made, TL_BAD_DATA, ".fmu file");
}

static void test_no_zip(void) {
    FILE *file = fopen(made, "w");
    TEST_ASSERT_NOT_NULL(file);
    (void)fputs("This is a text, and long enough to be looked at as an archive.\n", file);
    (void)fclose(file);
    expect_refused_file(made, TL_BAD_DATA, "ZIP|Not a zip archive");
}

static void test_half_a_zip(void) {
    struct stat status;
    write_made();
    TEST_ASSERT_EQUAL_INT(0, stat(made, &status));
    TEST_ASSERT_TRUE(tl_fmu_maker_cut_file(made, (size_t)status.st_size / 2));
    expect_refused_file(made, TL_BAD_DATA, "ZIP archive|export");
    TEST_ASSERT_TRUE(tl_fmu_maker_cut_file(made, 0));
    expect_refused_file(made, TL_BAD_DATA, "ZIP archive|export");
}

static void test_changed_bytes(void) {
    put_text("resources/a.txt", "some text for the archive");
    write_made();
    /* Flips one bit in the content of the binary. */
    struct stat status;
    TEST_ASSERT_EQUAL_INT(0, stat(made, &status));
    FILE *file = fopen(made, "r+b");
    TEST_ASSERT_NOT_NULL(file);
    TEST_ASSERT_EQUAL_INT(0, fseeko(file, status.st_size / 3, SEEK_SET));
    int byte = fgetc(file);
    TEST_ASSERT_EQUAL_INT(0, fseek(file, -1, SEEK_CUR));
    (void)fputc(byte ^ 0x10, file);
    (void)fclose(file);
    expect_refused_file(made, TL_BAD_DATA, "motor.so|unpacked|export");
}

static void test_paths_that_lead_outside(void) {
    static const struct {
        const char *name;
        const char *parts;
    } cases[] = {
        {"../escape.txt", "\"..\""},
        {"resources/../../escape.txt", "\"..\""},
        {"resources\\..\\..\\escape.txt", "\"..\""},
        {"resources/..", "\"..\""},
        {"/tmp/escape.txt", "absolute"},
        {"\\escape.txt", "absolute"},
        {"C:/escape.txt", "absolute"},
        {"C:escape.txt", "absolute"},
        {"resources/two\nlines.txt", "control characters"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        put_text(cases[i].name, "x");
        expect_refused(cases[i].parts);
        const char *shown = strchr(cases[i].name, '\n') != NULL ? "two\\x0Alines" : cases[i].name;
        TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, shown), error.text);
        TEST_ASSERT_TRUE(tl_fmu_maker_remove(maker, cases[i].name));
    }
}

static void test_long_paths(void) {
    char name[1200];
    memset(name, 'a', sizeof name);
    for (size_t i = 10; i < sizeof name; i += 20) {
        name[i] = '/';
    }
    name[TL_FMU_ENTRY_PATH + 1] = '\0';
    put_text(name, "x");
    expect_refused("1024 bytes");
    TEST_ASSERT_TRUE(tl_fmu_maker_remove(maker, name));
    name[TL_FMU_ENTRY_PATH] = '\0'; /* the longest path that is allowed */
    put_text(name, "x");
    write_made();
    expect_loaded(made);
    tl_fmu_unload(&fmu);
    TEST_ASSERT_EQUAL_size_t(0, count_all(temporary));
    TEST_ASSERT_TRUE(tl_fmu_maker_remove(maker, name));
    memset(name, 'a', 300);
    name[300] = '\0';
    put_text(name, "x");
    expect_refused("255 bytes");
    TEST_ASSERT_TRUE(tl_fmu_maker_remove(maker, name));
    for (size_t i = 0; i < 200; i += 2) {
        memcpy(name + i, "d/", 3);
    }
    put_text(name, "");
    expect_refused("64|folders");
}

static void put_link(const char *name, const char *target) {
    put_text(name, target);
    TEST_ASSERT_TRUE(tl_fmu_maker_set_mode(maker, name, S_IFLNK | 0777));
}

static void expect_content(const char *name, const char *content) {
    char path[PATH_MAX + 64];
    char text[64] = "";
    struct stat facts;
    (void)snprintf(path, sizeof path, "%s/%s", fmu.folder.path, name);
    TEST_ASSERT_EQUAL_INT(0, lstat(path, &facts));
    TEST_ASSERT_TRUE(S_ISREG(facts.st_mode));
    FILE *file = fopen(path, "r");
    TEST_ASSERT_NOT_NULL(file);
    TEST_ASSERT_NOT_NULL(fgets(text, sizeof text, file));
    TEST_ASSERT_EQUAL_INT(0, fclose(file));
    TEST_ASSERT_EQUAL_STRING(content, text);
}

/* As between the versions of a library: each becomes a file. */
static void test_links_within_the_fmu(void) {
    put_link("resources/lib/a.so", "a.so.1");
    put_link("resources/lib/a.so.1", "./../lib//a.so.1.2");
    put_text("resources/lib/a.so.1.2", "library");
    put_link("resources/deep/er/up", "../../lib/a.so");
    put_link("top", "resources/deep/../lib/a.so.1.2");
    put_link("documentation/skipped", "/etc/passwd");
    write_made();
    expect_loaded(made);
    static const char *const names[] = {"resources/lib/a.so", "resources/lib/a.so.1", "resources/lib/a.so.1.2",
                                        "resources/deep/er/up", "top"};
    for (size_t i = 0; i < sizeof names / sizeof names[0]; i++) {
        expect_content(names[i], "library");
    }
}

static void test_links_that_are_refused(void) {
    static const char *const cases[][2] = {
        {"/etc/passwd", "absolute"},    {"../../etc/passwd", "out of the FMU"},
        {"../..", "out of the FMU"},    {"../resources/../../x", "out of the FMU"},
        {"none", "no file|-ry"},        {"..", "no file|-ry"},
        {"../binaries", "no file|-ry"}, {"link", "followed"},
        {"other", "followed"},
    };
    put_link("resources/other", "link");
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        put_link("resources/link", cases[i][0]);
        char parts[80];
        (void)snprintf(parts, sizeof parts, "symbolic link|%s", cases[i][1]);
        expect_refused(parts);
    }
    put_link("resources/link", "");
    expect_refused("symbolic link|followed");
}

/* The bytes of links count, too. */
static void test_links_to_a_large_file(void) {
    enum { SIZE = 1024 * 1024, LINKS = 30 };
    TEST_ASSERT_TRUE(tl_fmu_maker_put(maker, "resources/zeros", NULL, SIZE));
    for (int i = 0; i < LINKS; i++) {
        char name[40];
        (void)snprintf(name, sizeof name, "resources/%d", i);
        put_link(name, "zeros");
    }
    expect_refused("200 times");
}

static void test_devices(void) {
    put_text("resources/link", "/etc/passwd");
    TEST_ASSERT_TRUE(tl_fmu_maker_set_mode(maker, "resources/link", S_IFIFO | 0600));
    expect_refused("\"resources/link\"|folder");
    TEST_ASSERT_TRUE(tl_fmu_maker_set_mode(maker, "resources/link", S_IFCHR | 0600));
    expect_refused("\"resources/link\"|folder");
}

static void test_names_that_occur_twice(void) {
    put_text("resources/one.txt", "1");
    put_text("resources/two.txt", "2");
    write_made();
    TEST_ASSERT_TRUE(tl_fmu_maker_patch_file(made, "resources/two.txt", "resources/one.txt", 17));
    expect_refused_file(made, TL_BAD_DATA, "\"resources/one.txt\"|name");
    put_text("resources/one.txt/inner", "a file as a folder");
    expect_refused("\"resources/one.txt/inner\"|name");
}

static void test_encrypted_and_other_methods(void) {
    put_text("resources/secret", "text text text");
    TEST_ASSERT_TRUE(tl_fmu_maker_encrypt(maker, "resources/secret"));
    expect_refused("\"resources/secret\"|encrypted");
    TEST_ASSERT_TRUE(tl_fmu_maker_remove(maker, "resources/secret"));
    TEST_ASSERT_TRUE(tl_fmu_maker_put(maker, "resources/bz", NULL, 10000));
    TEST_ASSERT_TRUE(tl_fmu_maker_use_bzip2(maker, "resources/bz"));
    expect_refused("\"resources/bz\"|stored");
}

static void test_too_many_entries(void) {
    tl_fmu_maker_free(maker);
    maker = tl_fmu_maker_new(NULL);
    for (int i = 0; i <= TL_FMU_ENTRIES; i++) {
        char name[32];
        (void)snprintf(name, sizeof name, "resources/%d", i);
        put_text(name, "");
    }
    expect_refused("10001 entries|10000");
}

/* 40 MiB of zeros in about 40 KiB: detected after 16 MiB. */
static void test_a_compression_bomb(void) {
    enum { SIZE = 40 * 1024 * 1024 };
    TEST_ASSERT_TRUE(tl_fmu_maker_put(maker, "resources/bomb", NULL, SIZE));
    expect_refused("\"resources/bomb\"|200 times");
    /* The same with a harmless size in the header. */
    const unsigned char true_size[4] = {0, 0, 0x80, 0x02};
    const unsigned char claimed[4] = {16, 0, 0, 0};
    TEST_ASSERT_TRUE(tl_fmu_maker_patch_file(made, true_size, claimed, 4));
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, tl_fmu_load(made, -1, TL_ROLLBACK_STATE, &fmu, &error));
    TL_EXPECT_PARTS("\"resources/bomb\"", error.text);
    TEST_ASSERT_EQUAL_size_t(0, count_all(temporary));
}

/* The limit counts the sum of all entries. */
static void test_a_bomb_in_parts(void) {
    for (int i = 0; i < 20; i++) {
        char name[32];
        (void)snprintf(name, sizeof name, "resources/part%d", i);
        TEST_ASSERT_TRUE(tl_fmu_maker_put(maker, name, NULL, 1 << 20));
    }
    expect_refused("200 times");
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "\"resources/part1"), error.text);
}

static void test_no_room(void) {
    struct rlimit original;
    (void)signal(SIGXFSZ, SIG_IGN);
    TEST_ASSERT_EQUAL_INT(0, getrlimit(RLIMIT_FSIZE, &original));
    struct rlimit small = {4096, original.rlim_max};
    TEST_ASSERT_EQUAL_INT(0, setrlimit(RLIMIT_FSIZE, &small));
    expect_refused_file(GOOD, TL_TRY_AGAIN, "File too large|TMPDIR");
    TEST_ASSERT_EQUAL_INT(0, setrlimit(RLIMIT_FSIZE, &original));
}

static void test_no_temporary_folder(void) {
    (void)setenv("TMPDIR", "/nowhere", 1);
    expect_refused_file(GOOD, TL_TRY_AGAIN, "/nowhere|TMPDIR");
}

static void test_no_descriptors(void) {
    struct rlimit original;
    TEST_ASSERT_EQUAL_INT(0, getrlimit(RLIMIT_NOFILE, &original));
    write_made();
    bool loaded = false;
    for (rlim_t limit = 3; limit < 40 && !loaded; limit++) { /* each call that opens a file fails once */
        struct rlimit few = {limit, original.rlim_max};
        TEST_ASSERT_EQUAL_INT(0, setrlimit(RLIMIT_NOFILE, &few));
        tl_status status = tl_fmu_load(made, -1, TL_ROLLBACK_STATE, &fmu, &error);
        TEST_ASSERT_EQUAL_INT(0, setrlimit(RLIMIT_NOFILE, &original));
        loaded = status == TL_OK;
        TEST_ASSERT_EQUAL_size_t(loaded ? 1 : 0, count_all(temporary));
    }
    TEST_ASSERT_TRUE(loaded);
}

/* ---- The description ------------------------------------------------------------------------- */

static void test_descriptions(void) {
    TEST_ASSERT_TRUE(tl_fmu_maker_rename(maker, "modelDescription.xml", "modeldescription.xml"));
    expect_refused("modelDescription.xml");
    TEST_ASSERT_FALSE(tl_test_has_parts(error.text, "line 1"));
    put_text("modelDescription.xml", "<fmiModelDescription fmiVersion='2.0'\n>>");
    expect_refused("modelDescription.xml|line 1|modelName");
    put_text("modelDescription.xml", "<fmiModelDescription\n<");
    expect_refused("modelDescription.xml|line 2|XML");
    put_text("modelDescription.xml", "<!DOCTYPE lolz [<!ENTITY a 'ha'><!ENTITY b '&a;&a;&a;&a;&a;&a;&a;&a;&a;&a;'>\n"
                                     "<!ENTITY c '&b;&b;&b;&b;&b;&b;&b;&b;'>]><fmiModelDescription modelName='&c;'/>");
    expect_refused("<!DOCTYPE lolz>");
    put_text("modelDescription.xml", "<fmiModelDescription fmiVersion='1.0' modelIdentifier='m'/>");
    expect_refused("FMI 1.0|FMI 2.0|Co-Simulation");
    put_text("modelDescription.xml", "<fmiModelDescription fmiVersion='3.0' instantiationToken='m'/>");
    expect_refused("FMI 3.0|FMI 2.0");
}

static void test_model_exchange_only(void) {
    replace_in_description("CoSimulation", "ModelExchange");
    expect_refused("Model Exchange|FMI 2.0|Co-Simulation");
}

static void test_an_identifier_that_leads_outside(void) {
    replace_in_description("modelIdentifier=\"motor\"", "modelIdentifier=\"../../../motor\"");
    expect_refused("modelIdentifier|\"../../../motor\"");
}

static void test_resources_as_a_file(void) {
    put_text("resources", "x");
    expect_refused("\"resources\"|file|folder");
}

/* ---- The binary ------------------------------------------------------------------------------ */

static void test_no_binary_for_this_machine(void) {
    TEST_ASSERT_TRUE(tl_fmu_maker_rename(maker, binary_name(), "binaries/win64/motor.dll"));
    expect_refused("/motor.so|this machine|win64");
    TEST_ASSERT_TRUE(tl_fmu_maker_remove(maker, "binaries/win64/motor.dll"));
    expect_refused("/motor.so|this machine|binaries/");
    TEST_ASSERT_FALSE(tl_test_has_parts(error.text, "win64"));
}

static const char *beside_binary(const char *name, char path[128]) {
    (void)snprintf(path, 128, "%.*s%s", (int)(strrchr(binary_name(), '/') + 1 - binary_name()), binary_name(), name);
    return path;
}

/* It is used if there is no doubt. */
static void test_another_name(void) {
    char other[128];
    char motor[128];
    replace_in_description("modelIdentifier=\"motor\"", "modelIdentifier=\"Pump\"");
    write_made();
    TEST_ASSERT_TRUE(tl_stderr_capture_begin());
    expect_loaded(made);
    char *log = tl_stderr_capture_end();
    TL_EXPECT_PARTS("notice|Pump|motor.so", log);
    free(log);
    tl_fmu_unload(&fmu);
    put_text(beside_binary("libother.so", other), "x");
    expect_refused("motor.so|Pump|rename");
    TL_EXPECT_PARTS("libother.so|Pump", error.text);
    TEST_ASSERT_TRUE(tl_fmu_maker_rename(maker, beside_binary("motor.so", motor), beside_binary("pump.so", other)));
    write_made();
    TEST_ASSERT_TRUE(tl_stderr_capture_begin());
    expect_loaded(made);
    free(tl_stderr_capture_end());
}

static void test_a_binary_for_another_machine(void) {
    set_machine(EM_PPC64);
    expect_refused("/motor.so|PowerPC|21|this machine");
}

static void test_a_binary_for_other_bits(void) {
    binary()[EI_CLASS] = sizeof(void *) == 8 ? ELFCLASS32 : ELFCLASS64;
    set_machine(sizeof(void *) == 8 ? EM_386 : EM_X86_64);
    expect_refused(sizeof(void *) == 8 ? "/motor.so|x86|3|32 bits|64 bits" : "/motor.so|x86-64|62|64 bits|32 bits");
}

static void test_a_binary_of_other_byte_order(void) {
    bool little = binary()[EI_DATA] == ELFDATA2LSB;
    binary()[EI_DATA] = little ? ELFDATA2MSB : ELFDATA2LSB;
    expect_refused(little ? "/motor.so|big endian|this machine" : "/motor.so|little endian|this machine");
}

static void test_a_binary_that_is_no_shared_object(void) {
    size_t at = offsetof(Elf32_Ehdr, e_type) + (__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__ ? 0 : 1);
    binary()[at] = ET_EXEC;
    expect_refused("/motor.so|ELF|shared object|type 2");
}

static void test_a_binary_that_is_no_elf(void) {
    char name[128];
    (void)snprintf(name, sizeof name, "%s", binary_name());
    put_text(name, "#!/bin/sh\necho a text file of more bytes than an ELF header has\n");
    expect_refused("/motor.so|ELF|Linux");
    put_text(name, "");
    expect_refused("/motor.so|ELF|Linux");
}

static void test_a_binary_that_is_cut(void) {
    size_t size;
    const unsigned char *bytes = tl_fmu_maker_content(maker, binary_name(), &size);
    Elf64_Ehdr *part = malloc(sizeof(Elf64_Ehdr));
    TEST_ASSERT_NOT_NULL(part);
    memcpy(part, bytes, sizeof(Elf64_Ehdr));
    bool put = tl_fmu_maker_put(maker, binary_name(), part, sizeof(Elf64_Ehdr));
    free(part);
    TEST_ASSERT_TRUE(put);
    expect_refused("motor.so|export");
}

static void test_a_missing_library(void) {
    patch_binary("libc.so.6", "libq.so.6");
    expect_refused("libq.so.6|install");
}

static void test_a_missing_symbol(void) {
    patch_binary("strcmp", "xtrcmp");
    expect_refused("xtrcmp|\"libraries\"");
    patch_binary("xtrcmp", "Py_cmp");
    expect_refused("Py_cmp|\"libraries\"|libpython3.11.so.1.0");
    patch_binary("Py_cmp", "_Pycmp");
    expect_refused("_Pycmp|Python");
}

static void test_missing_functions(void) {
    patch_binary("fmi2DoStep", "fmi2DoStop");
    expect_refused("fmi2DoStep|FMI 2.0");
    TEST_ASSERT_FALSE(tl_test_has_parts(error.text, "description"));
}

static void test_optional_functions(void) {
    patch_binary("fmi2SetFMUstate", "fmi2SetFMUstale");
    expect_refused("fmi2SetFMUstate|FMI 2.0|modelDescription.xml");
    replace_in_description("canGetAndSetFMUstate=\"true\"", "canGetAndSetFMUstate=\"false\"");
    replace_in_description("canSerializeFMUstate=\"true\"", "");
    write_made();
    expect_loaded(made);
    TEST_ASSERT_NULL(fmu.guard.functions.set_fmu_state);
    TEST_ASSERT_NULL(fmu.guard.functions.get_fmu_state);
    TEST_ASSERT_NULL(fmu.guard.functions.serialize_fmu_state);
}

static void test_versions_of_the_binary(void) {
    patch_binary("2.0", "9.9");
    expect_refused("FMI 9.9|2.0");
    patch_binary("9.9", "2.0");
    patch_binary("default", "defalut");
    expect_refused("platform|\"defalut\"|\"default\"");
}

#if defined(__x86_64__)
/* A wrong binary in the first folder does not hide the right one in the second. */
static void test_the_second_folder(void) {
    size_t size;
    const unsigned char *bytes = tl_fmu_maker_content(maker, binary_name(), &size);
    TEST_ASSERT_TRUE(tl_fmu_maker_put(maker, "binaries/x86_64-linux/motor.so", bytes, size));
    set_machine(EM_AARCH64);
    write_made();
    expect_loaded(made);
    TEST_ASSERT_TRUE(isfinite(run_ten_steps()));
}
#endif

/* The FMU itself detects it and calls our logger. Loading does not check the GUID. */
static void test_a_wrong_guid(void) {
    replace_in_description("guid=\"{", "guid=\"{0");
    write_made();
    expect_loaded(made);
    TEST_ASSERT_TRUE(tl_stderr_capture_begin());
    fmi2Component instance = fmu.guard.functions.instantiate("pump1", fmi2CoSimulation, fmu.model.guid, fmu.resources,
                                                             &fmu.guard.callbacks, fmi2False, fmi2False);
    char *text = tl_stderr_capture_end();
    TEST_ASSERT_NULL(instance);
    TEST_ASSERT_NOT_NULL(text);
    TL_EXPECT_PARTS("error|motor|fmi2Instantiate|GUID", text);
    free(text);
}

/* ---- Messages -------------------------------------------------------------------------------- */

static void expect_line(const char *parts) {
    tl_stderr_expect_lines(&parts, 1);
}

static void test_messages(void) {
    expect_loaded(GOOD);
    fmi2CallbackLogger logger = fmu.guard.callbacks.logger;
    fmi2ComponentEnvironment environment = fmu.guard.fmu_callbacks.componentEnvironment;
    TEST_ASSERT_TRUE(tl_stderr_capture_begin());
    logger(environment, "m1", fmi2OK, "logEvents", "not shown");
    logger(environment, "m1", fmi2Pending, "logEvents", "not shown");
    logger(environment, "m1", fmi2Warning, "logStatusWarning", "%s is %d or %.1f\n", "omega", 5, 2.5);
    logger(environment, "m1", fmi2Discard, "c", "step");
    logger(environment, NULL, fmi2Error, NULL, "100 %% wrong");
    logger(environment, "m1", fmi2Fatal, "c", "dead");
    logger(environment, "m1", fmi2Fatal, "c", NULL);
    logger(NULL, "m1", fmi2Fatal, "c", "no FMU");
    static const char *const parts[] = {"warning|motor|m1|omega is 5 or 2.5|logStatusWarning",
                                        "warning|motor|m1|step|c", "error|motor|100 % wrong", "error|motor|m1|dead|c",
                                        "error|(unknown)|m1|no FMU|c"};
    tl_stderr_expect_lines(parts, sizeof parts / sizeof parts[0]);
    tl_log_set_level(TL_LOG_DEBUG);
    TEST_ASSERT_TRUE(tl_stderr_capture_begin());
    logger(environment, "m1", fmi2OK, "logEvents", "shown now");
    expect_line("debug|motor|m1|shown now|logEvents");
}

/* The message is no format: it must not write to memory nor crash the process. */
static void test_messages_that_write_back(void) {
    static const char *const texts[] = {"100%next", "100 % new", "%5$hhn", "%n", "a % b %ln"};
    expect_loaded(GOOD);
    for (size_t i = 0; i < sizeof texts / sizeof texts[0]; i++) {
        char parts[128];
        TEST_ASSERT_TRUE(tl_stderr_capture_begin());
        fmi2String message = texts[i];
        fmu.guard.fmu_callbacks.logger(&fmu.guard.logger, "m", fmi2Error, "c", message);
        (void)snprintf(parts, sizeof parts, "error|motor|m|%s|c", message);
        expect_line(parts);
    }
}

static void test_messages_are_bounded(void) {
    static char large[100000];
    memset(large, 'x', sizeof large - 1);
    expect_loaded(GOOD);
    TEST_ASSERT_TRUE(tl_stderr_capture_begin());
    fmu.guard.fmu_callbacks.logger(&fmu.guard.logger, "m", fmi2Error, "c", "%s", large);
    for (int i = 0; i < 1000; i++) {
        fmu.guard.fmu_callbacks.logger(&fmu.guard.logger, "m", fmi2Error, "c", "again and again %d", i);
    }
    tl_fmu_unload(&fmu); /* reports the number of dropped messages */
    char *text = tl_stderr_capture_end();
    TEST_ASSERT_NOT_NULL(text);
    TEST_ASSERT_LESS_THAN_size_t(TL_LOG_TEXT + 20 + 42 * 80, strlen(text));
    TL_EXPECT_PARTS("again and again 5|dropped|20", text);
    free(text);
}

static void test_error_may_be_null(void) {
    put_text("modelDescription.xml", "");
    write_made();
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, tl_fmu_load(made, -1, TL_ROLLBACK_STATE, &fmu, NULL));
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, tl_fmu_load("/nowhere", -1, TL_ROLLBACK_STATE, &fmu, NULL));
    TEST_ASSERT_EQUAL_size_t(0, count_all(temporary));
}

/* A message shows the end of a long path. */
static void test_long_paths_of_fmus(void) {
    char path[PATH_MAX];
    size_t used = (size_t)snprintf(path, sizeof path, "%s", folder);
    for (int i = 0; i < 200; i++) {
        used += (size_t)snprintf(path + used, sizeof path - used, "/./.");
    }
    (void)snprintf(path + used, sizeof path - used, "/none.fmu");
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, tl_fmu_load(path, -1, TL_ROLLBACK_STATE, &fmu, &error));
    TL_EXPECT_PARTS("/./none.fmu|No such file", error.text);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_a_good_fmu_runs);
    RUN_TEST(test_each_load_has_a_binary_of_its_own);
    RUN_TEST(test_resources);
    RUN_TEST(test_the_folder_is_private);
    RUN_TEST(test_only_needed_entries_are_unpacked);
    RUN_TEST(test_backslashes_are_separators);
    RUN_TEST(test_unloading_follows_no_link);
    RUN_TEST(test_folders_of_killed_processes_are_swept);
    RUN_TEST(test_sweeping_touches_nothing_else);
    RUN_TEST(test_no_file);
    RUN_TEST(test_no_zip);
    RUN_TEST(test_half_a_zip);
    RUN_TEST(test_changed_bytes);
    RUN_TEST(test_paths_that_lead_outside);
    RUN_TEST(test_long_paths);
    RUN_TEST(test_links_within_the_fmu);
    RUN_TEST(test_links_that_are_refused);
    RUN_TEST(test_links_to_a_large_file);
    RUN_TEST(test_devices);
    RUN_TEST(test_names_that_occur_twice);
    RUN_TEST(test_encrypted_and_other_methods);
    RUN_TEST(test_too_many_entries);
    RUN_TEST(test_a_compression_bomb);
    RUN_TEST(test_a_bomb_in_parts);
    RUN_TEST(test_no_room);
    RUN_TEST(test_no_temporary_folder);
    RUN_TEST(test_no_descriptors);
    RUN_TEST(test_descriptions);
    RUN_TEST(test_model_exchange_only);
    RUN_TEST(test_an_identifier_that_leads_outside);
    RUN_TEST(test_resources_as_a_file);
    RUN_TEST(test_no_binary_for_this_machine);
    RUN_TEST(test_another_name);
    RUN_TEST(test_a_binary_for_another_machine);
    RUN_TEST(test_a_binary_for_other_bits);
    RUN_TEST(test_a_binary_of_other_byte_order);
    RUN_TEST(test_a_binary_that_is_no_shared_object);
    RUN_TEST(test_a_binary_that_is_no_elf);
    RUN_TEST(test_a_binary_that_is_cut);
    RUN_TEST(test_a_missing_library);
    RUN_TEST(test_a_missing_symbol);
    RUN_TEST(test_missing_functions);
    RUN_TEST(test_optional_functions);
    RUN_TEST(test_versions_of_the_binary);
#if defined(__x86_64__)
    RUN_TEST(test_the_second_folder);
#endif
    RUN_TEST(test_a_wrong_guid);
    RUN_TEST(test_messages);
    RUN_TEST(test_messages_that_write_back);
    RUN_TEST(test_messages_are_bounded);
    RUN_TEST(test_error_may_be_null);
    RUN_TEST(test_long_paths_of_fmus);
    return UNITY_END();
}
