/* Paths that an FMU may read: each kind, only existing ones, and never the whole disk. */
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include <unity.h>

#include "firmware/twin/assembly.h"
#include "tests/support/scratch.h"

enum { MANY = 2 * TL_READABLE_PATHS_MOST + 44 };

static const char *const variables[] = {"LD_LIBRARY_PATH", "PYTHONPATH", "LOCPATH",
                                        "PYTHONHOME",      "PATH",       TL_READABLE_PATHS_HOME};
enum { VARIABLES = sizeof variables / sizeof variables[0], LISTS = 3 };

static tl_scratch scratch;
static char root[PATH_MAX]; /* resolved; contains all files of the tests */
static tl_config_component component;
static tl_assembly_file found;
static tl_assembly assembly;
static tl_readable_paths places;

void setUp(void) {
    component = (tl_config_component){.name = "motor"};
    assembly =
        (tl_assembly){.config = {.directory = root, .components = &component, .component_count = 1}, .files = &found};
    for (size_t i = 0; i < VARIABLES; i++) {
        TEST_ASSERT_EQUAL_INT(0, unsetenv(variables[i]));
    }
}

void tearDown(void) {
    tl_readable_paths_free(&places);
}

/* A path below the root. Four results are valid at a time. */
static const char *in_root(const char *name) {
    static char paths[4][PATH_MAX];
    static size_t next;
    char *path = paths[next++ % 4];
    TEST_ASSERT_LESS_THAN_INT(PATH_MAX, snprintf(path, PATH_MAX, "%s/%s", root, name));
    return path;
}

static void make_folder(const char *name) {
    TEST_ASSERT_EQUAL_INT(0, mkdir(in_root(name), 0700));
}

static void make_file(const char *name) {
    FILE *file = fopen(in_root(name), "w");
    TEST_ASSERT_NOT_NULL(file);
    (void)fclose(file);
}

static void make_tree(void) {
    make_folder("data");
    make_file("data/table.csv");
    make_file("private.csv");
    make_folder("lib");
    make_file("lib/libvendor.so");
    make_folder("plugins");
    make_file("plugins/vendor.so");
    make_folder("venv");
    make_folder("venv/bin");
    make_folder("venv/lib");
    make_file("venv/pyvenv.cfg");
    make_file("venv/private");
    make_folder("python");
    make_folder("python/bin");
    make_folder("python/lib");
    make_folder("python/lib64");
    make_file("python/bin/python3.11");
    TEST_ASSERT_EQUAL_INT(0, symlink(in_root("python/bin/python3.11"), in_root("venv/bin/python3")));
}

static void remove_tree(void) {
    static const char *const made[] = {
        "venv/bin/python3", "venv/bin",         "venv/lib", "venv/pyvenv.cfg",       "venv/private",
        "python/lib",       "python/lib64",     "venv",     "python/bin/python3.11", "python/bin",
        "python",           "lib/libvendor.so", "lib",      "plugins/vendor.so",     "plugins",
        "private.csv",      "data/table.csv",   "data"};
    for (size_t i = 0; i < sizeof made / sizeof made[0]; i++) {
        (void)remove(in_root(made[i]));
    }
}

/* Expects these paths in this order, up to NULL. */
static void expect_places(const char *const *expected) {
    tl_readable_paths_find(&assembly, &places);
    size_t count = 0;
    for (; expected[count] != NULL; count++) {
        TEST_ASSERT_LESS_THAN_size_t(places.count, count);
        TEST_ASSERT_EQUAL_STRING(expected[count], places.path[count]);
    }
    TEST_ASSERT_EQUAL_size_t(count, places.count);
}

static void test_nothing_is_named(void) {
    expect_places((const char *const[]){NULL});
}

/* Relative to the folder of the configuration, or absolute. Missing paths are left out. */
static void test_what_a_component_reads(void) {
    tl_config_name reads[] = {
        {.name = "data"}, {.name = "data/../private.csv"}, {.name = "absent"}, {.name = ""}, {.name = NULL}};
    char absolute[PATH_MAX];
    (void)snprintf(absolute, sizeof absolute, "%s", in_root("data/table.csv"));
    reads[4].name = absolute;
    component.reads = reads;
    component.read_count = sizeof reads / sizeof reads[0];
    expect_places((const char *const[]){in_root("data"), in_root("private.csv"), absolute, NULL});
}

/* Only an absolute path in a text counts as a file name. */
static void test_texts_in_set(void) {
    char absolute[PATH_MAX];
    (void)snprintf(absolute, sizeof absolute, "%s", in_root("private.csv"));
    tl_plan_set set[] = {{.variable = "table", .value = {.type = TL_STRING, .text = absolute}},
                         {.variable = "name", .value = {.type = TL_STRING, .text = "data"}},
                         {.variable = "gone", .value = {.type = TL_STRING, .text = "/nowhere/at/all"}},
                         {.variable = "J", .value = {.type = TL_REAL, .real = 0.05}}};
    component.set = set;
    component.set_count = sizeof set / sizeof set[0];
    TEST_ASSERT_EQUAL_INT(0, chdir(root)); /* so that "data" could be found */
    expect_places((const char *const[]){absolute, NULL});
}

/* A library in a library folder brings the whole folder. A library elsewhere comes alone, a
 * missing one not at all. */
static void test_libraries(void) {
    char with_others[PATH_MAX];
    char alone[PATH_MAX];
    char *libraries[] = {with_others, NULL, alone};
    (void)snprintf(with_others, sizeof with_others, "%s", in_root("lib/libvendor.so"));
    (void)snprintf(alone, sizeof alone, "%s", in_root("plugins/vendor.so"));
    found.libraries = libraries;
    component.library_count = 3;
    expect_places((const char *const[]){in_root("lib"), alone, NULL});
}

static void test_folders_in_variables(void) {
    for (size_t i = 0; i < LISTS; i++) {
        char list[3 * PATH_MAX];
        (void)snprintf(list, sizeof list, ":%s:data:.:/nowhere/at/all::%s:", in_root("data"), in_root("lib"));
        TEST_ASSERT_EQUAL_INT(0, chdir(root)); /* so that "data" could be found */
        TEST_ASSERT_EQUAL_INT(0, setenv(variables[i], list, 1));
        expect_places((const char *const[]){in_root("data"), in_root("lib"), NULL});
        tl_readable_paths_free(&places);
        TEST_ASSERT_EQUAL_INT(0, unsetenv(variables[i]));
    }
}

/* A virtual environment and its base installation, of the first interpreter in PATH only. */
static void test_python(void) {
    char list[3 * PATH_MAX];
    (void)snprintf(list, sizeof list, "%s::%s:/usr/bin", in_root("data"), in_root("venv/bin"));
    TEST_ASSERT_EQUAL_INT(0, setenv("PATH", list, 1));
    expect_places((const char *const[]){in_root("venv/pyvenv.cfg"), in_root("venv/lib"), in_root("python/lib"),
                                        in_root("python/lib64"), NULL});
}

static void test_pythons_home(void) {
    char list[3 * PATH_MAX];
    (void)snprintf(list, sizeof list, "%s:%s", in_root("python"), in_root("data"));
    TEST_ASSERT_EQUAL_INT(0, setenv("PYTHONHOME", list, 1));
    expect_places((const char *const[]){in_root("python/lib"), in_root("python/lib64"), NULL});
}

/* Neither a home folder nor its parents, but folders inside a home. */
static void test_never_a_home(void) {
    char list[4 * PATH_MAX];
    (void)snprintf(list, sizeof list, "%s:%s:%s:%s:/tmp:/var/", root, in_root("venv"), in_root("venv/lib/.."),
                   in_root("venv/lib"));
    TEST_ASSERT_EQUAL_INT(0, setenv(TL_READABLE_PATHS_HOME, in_root("venv"), 1));
    for (size_t i = 0; i < LISTS; i++) {
        TEST_ASSERT_EQUAL_INT(0, setenv(variables[i], list, 1));
        expect_places((const char *const[]){in_root("venv/lib"), NULL});
        tl_readable_paths_free(&places);
        TEST_ASSERT_EQUAL_INT(0, unsetenv(variables[i]));
    }
}

/* In any spelling. */
static void test_never_everything(void) {
    tl_config_name reads[] = {
        {.name = "/"}, {.name = "//"}, {.name = "/tmp/.."}, {.name = "data/../../../../../../../../.."}};
    tl_plan_set set[] = {{.variable = "table", .value = {.type = TL_STRING, .text = "/"}},
                         {.variable = "other", .value = {.type = TL_STRING, .text = "/./tmp/../"}}};
    char *libraries[] = {(char[]){"/"}, (char[]){"/."}};
    component.reads = reads;
    component.read_count = sizeof reads / sizeof reads[0];
    component.set = set;
    component.set_count = sizeof set / sizeof set[0];
    found.libraries = libraries;
    component.library_count = 2;
    for (size_t i = 0; i < LISTS; i++) {
        TEST_ASSERT_EQUAL_INT(0, setenv(variables[i], "/:/..://", 1));
    }
    expect_places((const char *const[]){NULL});
}

/* A repeated path counts once. */
static void test_more_than_there_is_room_for(void) {
    static tl_config_name reads[MANY];
    static char names[MANY][16];
    for (size_t i = 0; i < MANY; i++) {
        (void)snprintf(names[i], sizeof names[i], "many-%zu", i / 2);
        if (i % 2 == 0) {
            make_file(names[i]);
        }
        reads[i].name = names[i];
    }
    component.reads = reads;
    component.read_count = 20;
    tl_readable_paths_find(&assembly, &places);
    TEST_ASSERT_EQUAL_size_t(10, places.count);
    tl_readable_paths_free(&places);
    component.read_count = MANY;
    tl_readable_paths_find(&assembly, &places);
    TEST_ASSERT_EQUAL_size_t(TL_READABLE_PATHS_MOST, places.count);
    for (size_t i = 0; i < MANY; i += 2) {
        (void)unlink(in_root(names[i]));
    }
}

static void test_freed_it_is_empty(void) {
    tl_config_name reads[] = {{.name = "data"}};
    component.reads = reads;
    component.read_count = 1;
    tl_readable_paths_find(&assembly, &places);
    tl_readable_paths_free(&places);
    TEST_ASSERT_EQUAL_size_t(0, places.count);
}

int main(void) {
    tl_scratch_make(&scratch, TL_BINARY_DIR, "places");
    if (realpath(scratch.folder, root) == NULL) {
        return 1;
    }
    UNITY_BEGIN();
    make_tree();
    RUN_TEST(test_nothing_is_named);
    RUN_TEST(test_what_a_component_reads);
    RUN_TEST(test_texts_in_set);
    RUN_TEST(test_libraries);
    RUN_TEST(test_folders_in_variables);
    RUN_TEST(test_python);
    RUN_TEST(test_pythons_home);
    RUN_TEST(test_never_a_home);
    RUN_TEST(test_never_everything);
    RUN_TEST(test_more_than_there_is_room_for);
    RUN_TEST(test_freed_it_is_empty);
    remove_tree();
    return tl_scratch_finish(&scratch, UNITY_END());
}
