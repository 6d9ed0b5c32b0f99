/* Choice of the file to write: the folder gets its permissions during the attempts, and root reads
 * the file at the same time. */
#include "firmware/store/database_file.h"

#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <unity.h>

#include "firmware/base/os.h"
#include "tests/support/random_numbers.h"
#include "tests/support/scratch.h"

enum { OTHER_USER = 65534, TRIALS = 200, LONGEST_NS = 50000 };

static tl_scratch scratch;
static char path[PATH_MAX];
static tl_test_random dice;
static int trials;

static int begin_use(void *context, sqlite3 *connection) {
    (void)context;
    (void)connection;
    return SQLITE_OK;
}

static void end_use(void *context) {
    (void)context;
}

static const tl_database_user user = {begin_use, end_use, NULL};

/* The test runs as another user, because root ignores permissions. */
void setUp(void) {
    tl_scratch_make(&scratch, "/tmp", "database_instead");
    (void)snprintf(path, sizeof path, "%s", tl_scratch_path(&scratch, "run.db"));
    dice = (tl_test_random){20261123};
    if (geteuid() == 0) {
        TEST_ASSERT_EQUAL_INT(0, chown(scratch.folder, OTHER_USER, OTHER_USER));
        TEST_ASSERT_EQUAL_INT(0, seteuid(OTHER_USER));
    }
}

void tearDown(void) {
    TEST_ASSERT_EQUAL_INT(0, seteuid(getuid()));
    (void)chmod(scratch.folder, 0700);
    tl_scratch_empty(&scratch);
    tl_scratch_remove(&scratch);
}

static tl_status open_one(tl_database_file *file, bool *waits) {
    const tl_database_wanted wanted = {.path = path, .open_policy = TL_DATABASE_ANYHOW, .user = &user};
    tl_database_report report;
    tl_error error;
    return tl_database_replacement_open(&wanted, file, &report, waits, &error);
}

static void make_one(void) {
    tl_database_file file;
    bool waits = false;
    TEST_ASSERT_EQUAL_INT(TL_OK, open_one(&file, &waits));
    tl_database_file_close(&file);
}

typedef struct opening {
    tl_time delay;
    bool is_there; /* atomic */
    bool goes;     /* atomic */
    int result;
} opening;

static void *open_folder(void *context) {
    opening *later = context;
    __atomic_store_n(&later->is_there, true, __ATOMIC_RELEASE);
    while (!__atomic_load_n(&later->goes, __ATOMIC_ACQUIRE)) {
    }
    tl_time until = tl_clock_now(NULL) + later->delay;
    while (tl_clock_now(NULL) < until) {
    }
    later->result = chmod(scratch.folder, 0700);
    return NULL;
}

/* The writer opens the file, or waits for it. */
static void open_while_the_folder_opens(tl_time delay) {
    opening later = {.delay = delay};
    tl_database_file file = TL_DATABASE_FILE_NONE;
    pthread_t thread;
    bool waits = false;
    TEST_ASSERT_EQUAL_INT(0, chmod(scratch.folder, 0));
    TEST_ASSERT_EQUAL_INT(0, pthread_create(&thread, NULL, open_folder, &later));
    while (!__atomic_load_n(&later.is_there, __ATOMIC_ACQUIRE)) {
    }
    __atomic_store_n(&later.goes, true, __ATOMIC_RELEASE);
    tl_status status = open_one(&file, &waits);
    TEST_ASSERT_EQUAL_INT(0, pthread_join(thread, NULL));
    TEST_ASSERT_EQUAL_INT(0, later.result);
    if (status == TL_OK) {
        TEST_ASSERT_EQUAL_STRING(path, file.path);
        tl_database_file_close(&file);
    }
    TEST_ASSERT_TRUE(status == TL_OK || waits);
}

/* At any instant: the configured file is written, at once or later. */
static void a_folder_that_is_opened_meanwhile(void) {
    make_one();
    for (int i = 0; i < trials; i++) {
        open_while_the_folder_opens((tl_time)tl_test_random_below(&dice, LONGEST_NS));
    }
    TEST_ASSERT_EQUAL_INT(1, tl_scratch_count(&scratch));
}

/* A readable folder without write permission: the writer waits, too. */
static void a_folder_that_may_not_be_written(void) {
    tl_database_file file = TL_DATABASE_FILE_NONE;
    bool waits = false;
    make_one();
    TEST_ASSERT_EQUAL_INT(0, chmod(scratch.folder, 0500));
    TEST_ASSERT_NOT_EQUAL_INT(TL_OK, open_one(&file, &waits));
    TEST_ASSERT_TRUE(waits);
    TEST_ASSERT_EQUAL_INT(0, chmod(scratch.folder, 0700));
    TEST_ASSERT_EQUAL_INT(TL_OK, open_one(&file, &waits));
    TEST_ASSERT_EQUAL_STRING(path, file.path);
    tl_database_file_close(&file);
}

/* Opens and closes the file repeatedly. As the only process that has it open, SQLite creates and
 * removes log and index. `name` is shared memory and changes. */
static void read_as_root(pid_t parent, const char *name) {
    int result = seteuid(0);
    while (result == 0 && getppid() == parent) {
        sqlite3 *database = NULL;
        if (sqlite3_open_v2(name, &database, SQLITE_OPEN_READWRITE, NULL) == SQLITE_OK) {
            (void)sqlite3_exec(database, "SELECT count(*) FROM runs", NULL, NULL, NULL);
        }
        (void)sqlite3_close(database);
    }
    _exit(result);
}

static pid_t begin_to_read(const char *name) {
    pid_t parent = getpid();
    pid_t reader = fork();
    if (reader == 0) {
        read_as_root(parent, name);
    }
    TEST_ASSERT_GREATER_THAN_INT(0, reader);
    return reader;
}

static void end_reading(pid_t reader) {
    TEST_ASSERT_EQUAL_INT(0, seteuid(0));
    TEST_ASSERT_EQUAL_INT(0, kill(reader, SIGKILL));
    TEST_ASSERT_EQUAL_INT(reader, waitpid(reader, NULL, 0));
}

/* Returns true if another file is opened, or the file cannot be written. */
static bool is_written_wrongly(const char *wanted) {
    tl_database_file file = TL_DATABASE_FILE_NONE;
    bool waits = false;
    if (open_one(&file, &waits) != TL_OK) {
        return !waits;
    }
    bool is_written = sqlite3_exec(file.connection, "UPDATE runs SET name = ''", NULL, NULL, NULL) != SQLITE_READONLY;
    bool is_wanted = strcmp(wanted, file.path) == 0;
    tl_database_file_close(&file);
    return !is_wanted || !is_written;
}

/* Log and index belong to root for an instant. The writer must still be able to write. */
static void a_reader_who_is_root(void) {
    if (getuid() != 0) {
        TEST_IGNORE_MESSAGE("needs root");
    }
    make_one();
    pid_t reader = begin_to_read(path);
    int wrong = 0;
    for (int i = 0; i < 3 * trials; i++) {
        wrong += is_written_wrongly(path) ? 1 : 0;
    }
    end_reading(reader);
    TEST_ASSERT_EQUAL_INT(0, wrong);
}

static void write_foreign(void) {
    FILE *file = fopen(path, "w");
    TEST_ASSERT_NOT_NULL(file);
    TEST_ASSERT_GREATER_THAN_INT(0, fputs("time,omega\n", file));
    TEST_ASSERT_EQUAL_INT(0, fclose(file));
}

/* The same for a file beside a foreign one: the writer creates it and finds it again. */
static void a_reader_who_is_root_of_a_file_beside(void) {
    char name[32];
    if (getuid() != 0) {
        TEST_IGNORE_MESSAGE("needs root");
    }
    /* cppcheck-suppress invalidFunctionArg ; an anonymous mapping has no file, which is -1 */
    void *shared = mmap(NULL, PATH_MAX, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    TEST_ASSERT_TRUE(shared != MAP_FAILED);
    char *beside = shared;
    pid_t reader = begin_to_read(beside);
    int wrong = 0;
    for (int i = 0; i < trials; i++) {
        (void)snprintf(name, sizeof name, "%d.db", i);
        (void)snprintf(path, sizeof path, "%s", tl_scratch_path(&scratch, name));
        write_foreign();
        (void)snprintf(name, sizeof name, "%d.db.beside", i);
        (void)snprintf(beside, PATH_MAX, "%s", tl_scratch_path(&scratch, name));
        wrong += is_written_wrongly(beside) ? 1 : 0; /* created */
        wrong += is_written_wrongly(beside) ? 1 : 0; /* found again */
    }
    end_reading(reader);
    TEST_ASSERT_EQUAL_INT(0, munmap(beside, PATH_MAX));
    TEST_ASSERT_EQUAL_INT(0, wrong);
}

int main(void) {
    trials = (int)tl_test_campaign("TL_DATABASE_TRIALS", TRIALS);
    UNITY_BEGIN();
    RUN_TEST(a_reader_who_is_root);
    RUN_TEST(a_reader_who_is_root_of_a_file_beside);
    RUN_TEST(a_folder_that_is_opened_meanwhile);
    RUN_TEST(a_folder_that_may_not_be_written);
    return UNITY_END();
}
