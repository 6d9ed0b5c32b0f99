/* The writer's file: damaged, foreign, without permission, truncated, overwritten, replaced or
 * missing, while a writer has it open and while it does not. */
#include <signal.h>
#include <sqlite3.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <unity.h>

#include "firmware/base/log.h"
#include "firmware/store/database_file.h"
#include "firmware/store/recorder.h"
#include "tests/support/faulty_vfs.h"
#include "tests/support/made_run.h"
#include "tests/support/message.h"
#include "tests/support/sql.h"
#include "tests/support/writer_bench.h"

enum { OTHER_USER = 65534 };

static tl_writer_bench bench;
static char beside[PATH_MAX + 16];
static char renamed[PATH_MAX + 16];

void setUp(void) {
    tl_writer_bench_begin(&bench);
    (void)snprintf(beside, sizeof beside, "%s.beside", bench.path);
    (void)snprintf(renamed, sizeof renamed, "%s.damaged-1", bench.path);
    tl_log_set_level(TL_LOG_ERROR - 1);
}

void tearDown(void) {
    tl_faulty_vfs_refuse(SQLITE_OK, 0);
    tl_faulty_vfs_read_only(false);
    tl_writer_bench_end(&bench);
}

static int64_t ask(const char *sql) {
    return tl_sql_integer(bench.path, sql);
}

static void write_now(void) {
    tl_recorder_writer_write(bench.writer);
}

static uint64_t written(void) {
    return tl_recorder_state_get(bench.state).written;
}

/* ---- Files that are damaged ---- */

static void write_bytes(const char *path, long at, size_t count) {
    FILE *file = fopen(path, "r+b");
    TEST_ASSERT_NOT_NULL(file);
    TEST_ASSERT_EQUAL_INT(0, fseek(file, at, SEEK_SET));
    for (size_t i = 0; i < count; i++) {
        TEST_ASSERT_EQUAL_INT(0xA5, fputc(0xA5, file));
    }
    TEST_ASSERT_EQUAL_INT(0, fclose(file));
}

static int64_t size_of(const char *path) {
    struct stat file;
    return stat(path, &file) == 0 ? (int64_t)file.st_size : -1;
}

/* The damaged file is renamed, and the run is recorded into a new one. */
static void expect_new_file(void) {
    int64_t size = size_of(bench.path);
    tl_writer_bench_forget(&bench);
    tl_writer_bench_record(&bench, 20);
    TEST_ASSERT_EQUAL_INT64(size, size_of(renamed));
    tl_writer_bench_expect_whole(bench.path);
    TEST_ASSERT_EQUAL_INT64(20, ask("SELECT samples_written FROM runs"));
    TEST_ASSERT_EQUAL_INT64(1, tl_writer_bench_count_own(bench.path, "damaged|run.db.damaged-1"));
    TEST_ASSERT_EQUAL_INT64(1, ask("SELECT count(*) FROM events"));
}

static void test_a_truncated_file(void) {
    tl_writer_bench_record(&bench, 2000);
    TEST_ASSERT_EQUAL_INT(0, truncate(bench.path, size_of(bench.path) / 2));
    expect_new_file();
}

static void test_a_truncated_header(void) {
    tl_writer_bench_record(&bench, 10);
    TEST_ASSERT_EQUAL_INT(0, truncate(bench.path, 80));
    expect_new_file();
}

static void test_damaged_pages(void) {
    tl_writer_bench_record(&bench, 10);
    write_bytes(bench.path, 100, 4000); /* the schema */
    expect_new_file();
}

/* Waiting entries are not lost. */
static void test_damage_during_a_run(void) {
    char wal[PATH_MAX + 24];
    (void)snprintf(wal, sizeof wal, "%s-wal", renamed);
    tl_writer_bench_open(&bench);
    tl_writer_bench_start(&bench, 7);
    tl_writer_bench_put(&bench, 0, 1000);
    write_now();
    tl_writer_bench_put(&bench, 1000, 10);
    tl_record_queue_event(&bench.twin, 1009, TL_EVENT_INFO, "twin", "an event");
    tl_faulty_vfs_refuse(SQLITE_CORRUPT, 0);
    write_now(); /* a new file fails, too */
    tl_faulty_vfs_refuse(SQLITE_OK, 0);
    tl_writer_bench_write_until(&bench, 2021);
    TEST_ASSERT_TRUE(tl_record_queue_put_end(&bench.twin, "SIGTERM"));
    tl_writer_bench_close_well(&bench);
    tl_writer_bench_expect_whole(bench.path);
    TEST_ASSERT_EQUAL_STRING("10 1000 0 SIGTERM 7",
                             tl_sql_text(bench.path, "SELECT samples_written || ' ' || removed_before || ' ' ||"
                                                     " entries_lost || ' ' || ended_reason || ' ' || start_ns"
                                                     " FROM runs JOIN beginnings USING (run)"));
    TEST_ASSERT_EQUAL_INT64(1, ask("SELECT count(*) FROM events WHERE source = 'twin'"));
    TEST_ASSERT_GREATER_THAN_INT64(0, size_of(wal)); /* its log was renamed, too */
    TEST_ASSERT_EQUAL_INT64(1000, tl_sql_integer(renamed, "SELECT samples_written FROM runs"));
}

/* Damaged pages, which the writer before has not read again. */
static void test_damage_that_a_successor_finds(void) {
    tl_writer_bench_open(&bench);
    tl_writer_bench_start(&bench, 7);
    tl_writer_bench_put(&bench, 0, 1000);
    tl_writer_bench_close_well(&bench);
    write_bytes(bench.path, 8 * 4096, (size_t)size_of(bench.path) - 9 * 4096);
    tl_writer_bench_put(&bench, 1000, 10);
    tl_writer_bench_open(&bench);
    tl_writer_bench_write_until(&bench, 2020);
    tl_writer_bench_close_well(&bench);
    tl_writer_bench_expect_whole(bench.path);
    TEST_ASSERT_EQUAL_STRING("10 1000 7", tl_sql_text(bench.path, "SELECT samples_written || ' ' || removed_before ||"
                                                                  " ' ' || start_ns FROM runs JOIN beginnings USING"
                                                                  " (run)"));
    TEST_ASSERT_GREATER_THAN_INT64(0, size_of(renamed));
}

/* The number of renamed files is limited: the next damaged file keeps its name. */
static void test_the_tenth_damaged_file_stays(void) {
    tl_writer_bench_record(&bench, 10);
    write_bytes(bench.path, 100, 4000);
    for (int i = 1; i <= TL_DATABASE_DAMAGED_MOST; i++) {
        char name[PATH_MAX + 32];
        (void)snprintf(name, sizeof name, "%s.damaged-%d", bench.path, i);
        TEST_ASSERT_EQUAL_INT(0, symlink("whatever", name));
    }
    tl_writer_bench_forget(&bench);
    int64_t size = size_of(bench.path);
    tl_writer_bench_record(&bench, 20);
    TEST_ASSERT_EQUAL_INT64(size, size_of(bench.path));
    TEST_ASSERT_EQUAL_INT64(20, tl_sql_integer(beside, "SELECT samples_written FROM runs"));
    TEST_ASSERT_EQUAL_INT64(1, tl_writer_bench_count_own(beside, "run.db|damaged"));
}

/* ---- Foreign files, and files without permission ---- */

static void make_file(const char *text) {
    FILE *file = fopen(bench.path, "wb");
    TEST_ASSERT_NOT_NULL(file);
    TEST_ASSERT_TRUE(fputs(text, file) >= 0);
    TEST_ASSERT_EQUAL_INT(0, fclose(file));
}

/* Returns the content of a file; the caller calls free(). */
static char *content_of(const char *path, size_t *size) {
    FILE *file = fopen(path, "rb");
    TEST_ASSERT_NOT_NULL(file);
    char *bytes = malloc(1 << 20);
    TEST_ASSERT_NOT_NULL(bytes);
    *size = fread(bytes, 1, 1 << 20, file);
    TEST_ASSERT_EQUAL_INT(0, fclose(file));
    return bytes;
}

/* The run is recorded into PATH.beside, and the only event has all parts. */
static void expect_recorded_beside(const char *parts) {
    tl_writer_bench_forget(&bench);
    tl_writer_bench_record(&bench, 20);
    tl_writer_bench_expect_whole(beside);
    TEST_ASSERT_EQUAL_INT64(20, tl_sql_integer(beside, "SELECT samples_written FROM runs"));
    TEST_ASSERT_EQUAL_INT64_MESSAGE(1, tl_writer_bench_count_own(beside, parts),
                                    tl_sql_text(beside, "SELECT text FROM events"));
    TEST_ASSERT_EQUAL_INT64(1, tl_sql_integer(beside, "SELECT count(*) FROM events"));
}

/* The run is recorded beside, and the file is not changed. */
static void expect_left_alone(const char *parts) {
    size_t before = 0;
    size_t after = 0;
    char *first = content_of(bench.path, &before);
    expect_recorded_beside(parts);
    char *second = content_of(bench.path, &after);
    TEST_ASSERT_EQUAL_size_t(before, after);
    TEST_ASSERT_EQUAL_INT(0, memcmp(first, second, before));
    free(first);
    free(second);
    tl_scratch_empty(&bench.scratch);
    tl_writer_bench_forget(&bench);
}

/* On a terminal, the writer refuses the file with an error. */
static void expect_refused(tl_status status, const char *parts) {
    bench.record.open_policy = TL_DATABASE_IF_OURS;
    TEST_ASSERT_EQUAL_INT(status, tl_writer_bench_try_open(&bench));
    TEST_ASSERT_NULL(bench.writer);
    TL_EXPECT_PARTS(parts, bench.error.text);
    TEST_ASSERT_EQUAL_INT(1, tl_scratch_count(&bench.scratch));
    bench.record.open_policy = TL_DATABASE_ANYHOW;
}

static void test_foreign_files(void) {
    make_file("");
    expect_refused(TL_BAD_DATA, "run.db|0 bytes");
    expect_left_alone("run.db|0 bytes");
    make_file("time,omega\n0,1\n");
    expect_refused(TL_BAD_DATA, "run.db|15 bytes");
    expect_left_alone("run.db|15 bytes");
    tl_sql_execute(bench.path, "CREATE TABLE mine (x)");
    expect_refused(TL_BAD_DATA, "run.db|another program");
    expect_left_alone("run.db|another program");
}

static void expect_format_refused(const char *sql, const char *parts) {
    tl_writer_bench_record(&bench, 10);
    tl_sql_execute(bench.path, sql);
    tl_writer_bench_forget(&bench);
    expect_refused(TL_BAD_DATA, parts);
    expect_left_alone(parts);
}

static void test_another_format(void) {
    expect_format_refused("PRAGMA user_version = 4", "run.db|format 4");
    expect_format_refused("PRAGMA user_version = 9", "run.db|format 9");
}

static void test_a_file_without_our_tables(void) {
    tl_writer_bench_record(&bench, 10);
    tl_sql_execute(bench.path, "DROP TABLE steps");
    tl_writer_bench_forget(&bench);
    expect_refused(TL_BAD_DATA, "run.db|steps");
    expect_left_alone("run.db|steps");
}

static void test_paths_that_are_not_a_regular_file(void) {
    TEST_ASSERT_EQUAL_INT(0, mkdir(bench.path, 0700));
    expect_refused(TL_BAD_DATA, "run.db|file");
    expect_recorded_beside("run.db|file");
    TEST_ASSERT_EQUAL_INT(0, rmdir(bench.path));
    tl_scratch_empty(&bench.scratch);
    TEST_ASSERT_EQUAL_INT(0, symlink("absent.db", bench.path));
    expect_recorded_beside("run.db|symbolic link");
}

/* PATH.beside is a foreign file, too. */
static void test_the_next_name(void) {
    char next[PATH_MAX + 24];
    (void)snprintf(next, sizeof next, "%s.beside-2", bench.path);
    make_file("mine");
    TEST_ASSERT_EQUAL_INT(0, rename(bench.path, beside));
    make_file("mine too");
    tl_writer_bench_record(&bench, 20);
    TEST_ASSERT_EQUAL_INT64(20, tl_sql_integer(next, "SELECT samples_written FROM runs"));
    TEST_ASSERT_EQUAL_INT64(4, size_of(beside));
}

static void test_a_file_that_cannot_be_written(void) {
    tl_writer_bench_record(&bench, 10);
    if (geteuid() == 0) { /* root ignores permissions */
        TEST_ASSERT_EQUAL_INT(0, chmod(bench.scratch.folder, 0777));
        TEST_ASSERT_EQUAL_INT(0, seteuid(OTHER_USER));
    }
    TEST_ASSERT_TRUE(geteuid() != 0);
    (void)chmod(bench.path, 0444);
    bench.record.open_policy = TL_DATABASE_IF_OURS; /* also on a terminal */
    expect_recorded_beside("run.db|permissions");
    TEST_ASSERT_EQUAL_INT(0, seteuid(getuid()));
}

static void test_a_file_that_cannot_be_read(void) {
    tl_writer_bench_record(&bench, 10);
    TEST_ASSERT_EQUAL_INT(0, chmod(bench.path, 0));
    if (geteuid() == 0) {
        TEST_ASSERT_EQUAL_INT(0, chmod(bench.scratch.folder, 0777));
        TEST_ASSERT_EQUAL_INT(0, seteuid(OTHER_USER));
    }
    expect_recorded_beside("run.db|unable to open");
    TEST_ASSERT_EQUAL_INT(0, seteuid(getuid()));
}

/* The medium fails during the run. A second open of the file would succeed. */
static void test_a_file_that_can_no_longer_be_read(void) {
    tl_writer_bench_open(&bench);
    tl_writer_bench_start(&bench, 1);
    tl_writer_bench_put(&bench, 0, 10);
    write_now();
    tl_writer_bench_put(&bench, 10, 10);
    tl_faulty_vfs_refuse_once(SQLITE_IOERR_READ);
    write_now();
    TEST_ASSERT_EQUAL_UINT64(40, written());
    TEST_ASSERT_EQUAL_STRING(beside, tl_recorder_writer_path(bench.writer));
    tl_writer_bench_close_well(&bench);
    TEST_ASSERT_EQUAL_INT64(10, ask("SELECT samples_written FROM runs"));
    TEST_ASSERT_EQUAL_INT64(10, tl_sql_integer(beside, "SELECT samples_written FROM runs"));
}

/* A run that is recorded beside continues there, even if PATH is free again. */
static void test_a_run_beside_continues_there(void) {
    make_file("mine");
    tl_writer_bench_open(&bench);
    tl_writer_bench_start(&bench, 1);
    tl_writer_bench_put(&bench, 0, 10);
    tl_writer_bench_close_well(&bench);
    TEST_ASSERT_EQUAL_INT(0, unlink(bench.path));
    tl_writer_bench_put(&bench, 10, 10);
    tl_writer_bench_open(&bench);
    tl_writer_bench_close_well(&bench);
    TEST_ASSERT_EQUAL_INT64(20, tl_sql_integer(beside, "SELECT samples_written FROM runs"));
    TEST_ASSERT_EQUAL_INT64(-1, size_of(bench.path));
}

/* ---- Changes by others during a run ---- */

/* Starts a run and writes its first ticks. */
static void begin_run(int64_t ticks) {
    tl_writer_bench_open(&bench);
    tl_writer_bench_start(&bench, 7);
    tl_writer_bench_put(&bench, 0, ticks);
    write_now();
}

static void expect_one_run(const char *path, const char *samples_before_lost) {
    tl_writer_bench_expect_whole(path);
    TEST_ASSERT_EQUAL_STRING(samples_before_lost,
                             tl_sql_text(path, "SELECT samples_written || ' ' || coalesce(removed_before, 0) || ' ' ||"
                                               " entries_lost FROM runs ORDER BY runs.run DESC LIMIT 1"));
}

/* Committed data are written to the file first, so that a power cut loses nothing. */
static void test_a_log_that_is_removed(void) {
    char wal[PATH_MAX + 8];
    (void)snprintf(wal, sizeof wal, "%s-wal", bench.path);
    begin_run(10);
    TEST_ASSERT_EQUAL_INT(0, unlink(wal));
    tl_writer_bench_put(&bench, 10, 10);
    write_now();
    TEST_ASSERT_GREATER_THAN_INT64(0, size_of(wal));
    TEST_ASSERT_EQUAL_INT64(20, ask("SELECT samples_written FROM runs"));
    tl_writer_bench_close_well(&bench);
    expect_one_run(bench.path, "20 0 0");
    TEST_ASSERT_EQUAL_INT64(1, ask("SELECT count(*) FROM runs"));
    TEST_ASSERT_EQUAL_INT64(1, tl_writer_bench_count_own(bench.path, "-wal|removed"));
}

static void expect_truncation(bool to_nothing) {
    begin_run(1000);
    tl_sql_execute(bench.path, "PRAGMA wal_checkpoint");
    tl_writer_bench_put(&bench, 1000, 10);
    write_now();
    int64_t size = to_nothing ? 0 : size_of(bench.path) / 2;
    TEST_ASSERT_EQUAL_INT(0, truncate(bench.path, size));
    tl_writer_bench_put(&bench, 1010, 10);
    write_now();
    tl_writer_bench_close_well(&bench);
    expect_one_run(bench.path, "10 1010 0");
    TEST_ASSERT_EQUAL_INT64(size, size_of(renamed));
    TEST_ASSERT_EQUAL_INT64(1, tl_writer_bench_count_own(bench.path, "damaged|run.db.damaged-1|cut"));
}

static void test_a_file_that_is_truncated(void) {
    expect_truncation(false);
}

static void test_a_file_that_is_emptied(void) {
    expect_truncation(true);
}

/* A file that became shorter because it has less data is not truncated. */
static void test_a_file_that_another_program_shortens(void) {
    begin_run(1000);
    tl_sql_execute(bench.path, "PRAGMA wal_checkpoint");
    tl_writer_bench_put(&bench, 1000, 10);
    write_now();
    int64_t size = size_of(bench.path);
    tl_sql_execute(bench.path, "DELETE FROM main.samples WHERE tick < 900; PRAGMA incremental_vacuum;"
                               " PRAGMA wal_checkpoint(TRUNCATE)");
    TEST_ASSERT_LESS_THAN_INT64(size, size_of(bench.path));
    tl_writer_bench_put(&bench, 1010, 10);
    write_now();
    tl_writer_bench_close_well(&bench);
    TEST_ASSERT_EQUAL_INT64(-1, size_of(renamed));
    TEST_ASSERT_EQUAL_INT64(1020, ask("SELECT samples_written FROM runs"));
    TEST_ASSERT_EQUAL_INT64(0, ask("SELECT count(*) FROM events"));
}

/* The content is foreign now, and our log must not be written into it. */
static void test_a_file_that_is_overwritten(void) {
    static const char text[] = "somebody's text";
    char wal[PATH_MAX + 8];
    size_t size = 0;
    (void)snprintf(wal, sizeof wal, "%s-wal", bench.path);
    begin_run(10);
    make_file(text);
    tl_writer_bench_put(&bench, 10, 10);
    write_now();
    tl_writer_bench_close_well(&bench);
    expect_one_run(beside, "10 10 20");
    TEST_ASSERT_EQUAL_INT64(1, tl_writer_bench_count_own(beside, "overwritten|20 samples|15 bytes"));
    TEST_ASSERT_EQUAL_INT64(1, tl_sql_integer(beside, "SELECT count(*) FROM events"));
    char *found = content_of(bench.path, &size);
    TEST_ASSERT_EQUAL_size_t(strlen(text), size);
    TEST_ASSERT_EQUAL_INT(0, memcmp(text, found, size));
    free(found);
    TEST_ASSERT_EQUAL_INT64(-1, size_of(wal));
}

/* The file is foreign from the moment at which another program has emptied it. */
static void test_a_file_that_is_being_overwritten(void) {
    begin_run(10);
    pid_t other = fork();
    if (other == 0) {
        FILE *file = fopen(bench.path, "wb");
        (void)usleep(100000);
        _exit(file != NULL && fputs("somebody's text", file) >= 0 && fclose(file) == 0 ? 0 : 1);
    }
    while (size_of(bench.path) != 0) {
        (void)usleep(1000);
    }
    tl_writer_bench_put(&bench, 10, 10);
    write_now();
    tl_writer_bench_close_well(&bench);
    int how = 0;
    TEST_ASSERT_EQUAL_INT(other, waitpid(other, &how, 0));
    TEST_ASSERT_EQUAL_INT(0, how);
    TEST_ASSERT_EQUAL_INT64(-1, size_of(renamed));
    TEST_ASSERT_EQUAL_INT64(15, size_of(bench.path));
    expect_one_run(beside, "10 10 20");
}

/* A user restores an older copy: the run continues in it, and our log must not be written into
 * it. */
static void test_a_file_that_is_replaced(void) {
    char copy[PATH_MAX + 8];
    (void)snprintf(copy, sizeof copy, "%s.copy", bench.path);
    tl_writer_bench_record(&bench, 10);
    TEST_ASSERT_EQUAL_INT(0, rename(bench.path, copy));
    tl_writer_bench_forget(&bench);
    begin_run(1000);
    TEST_ASSERT_EQUAL_INT(0, rename(copy, bench.path));
    tl_writer_bench_put(&bench, 1000, 10);
    write_now();
    tl_writer_bench_close_well(&bench);
    expect_one_run(bench.path, "10 1000 2000");
    TEST_ASSERT_EQUAL_STRING("ok", tl_sql_text(bench.path, "PRAGMA integrity_check"));
    TEST_ASSERT_EQUAL_STRING("10, 10", tl_sql_text(bench.path, "SELECT group_concat(samples_written, ', ') FROM runs"));
}

/* A foreign file replaces ours: one event reports both. */
static void test_a_file_that_is_replaced_by_a_foreign_one(void) {
    begin_run(10);
    TEST_ASSERT_EQUAL_INT(0, unlink(bench.path));
    make_file("somebody's text");
    tl_writer_bench_put(&bench, 10, 10);
    write_now();
    tl_writer_bench_close_well(&bench);
    TEST_ASSERT_EQUAL_INT64(15, size_of(bench.path));
    expect_one_run(beside, "10 10 20");
    TEST_ASSERT_EQUAL_INT64(1, tl_writer_bench_count_own(beside, "removed|20 samples|15 bytes"));
    TEST_ASSERT_EQUAL_INT64(1, tl_sql_integer(beside, "SELECT count(*) FROM events"));
}

/* A damaged file of ours replaces the file. */
static void test_a_file_that_is_replaced_by_a_damaged_one(void) {
    char copy[PATH_MAX + 8];
    (void)snprintf(copy, sizeof copy, "%s.copy", bench.path);
    tl_writer_bench_record(&bench, 10);
    write_bytes(bench.path, 100, 4000);
    TEST_ASSERT_EQUAL_INT(0, rename(bench.path, copy));
    tl_writer_bench_forget(&bench);
    begin_run(10);
    TEST_ASSERT_EQUAL_INT(0, rename(copy, bench.path));
    tl_writer_bench_put(&bench, 10, 10);
    write_now();
    tl_writer_bench_close_well(&bench);
    expect_one_run(bench.path, "10 10 20");
    TEST_ASSERT_EQUAL_INT64(1, tl_writer_bench_count_own(bench.path, "removed|20 samples|damaged|run.db.damaged-1"));
    TEST_ASSERT_EQUAL_INT64(1, ask("SELECT count(*) FROM events"));
}

/* The open file is still there: a folder without permission is no moved file. */
static void test_a_folder_that_loses_its_permissions(void) {
    TEST_ASSERT_EQUAL_INT(0, chmod(bench.scratch.folder, 0777));
    bool is_root = geteuid() == 0;
    TEST_ASSERT_EQUAL_INT(0, is_root ? seteuid(OTHER_USER) : 0);
    begin_run(10);
    TEST_ASSERT_EQUAL_INT(0, seteuid(getuid()));
    TEST_ASSERT_EQUAL_INT(0, chmod(bench.scratch.folder, is_root ? 0700 : 0));
    TEST_ASSERT_EQUAL_INT(0, is_root ? seteuid(OTHER_USER) : 0);
    tl_writer_bench_put(&bench, 10, 10);
    write_now();
    uint64_t count = written();
    TEST_ASSERT_EQUAL_INT(0, seteuid(getuid()));
    TEST_ASSERT_EQUAL_INT(0, chmod(bench.scratch.folder, 0777));
    tl_writer_bench_close_well(&bench);
    TEST_ASSERT_EQUAL_UINT64(40, count);
    expect_one_run(bench.path, "20 0 0");
    TEST_ASSERT_EQUAL_INT64(0, ask("SELECT count(*) FROM events"));
}

/* ---- Changes by others while no writer has the file open ---- */

/* A user restores an older copy between two writers: the run starts again in it. */
static void test_a_file_that_was_put_back(void) {
    char copy[PATH_MAX + 8];
    char command[3 * PATH_MAX];
    (void)snprintf(copy, sizeof copy, "%s.copy", bench.path);
    tl_writer_bench_open(&bench);
    tl_writer_bench_start(&bench, 1);
    tl_writer_bench_put(&bench, 0, 10);
    tl_writer_bench_close_well(&bench);
    (void)snprintf(command, sizeof command, "VACUUM INTO '%s'", copy);
    tl_sql_execute(bench.path, command);
    tl_writer_bench_put(&bench, 10, 10);
    tl_writer_bench_open(&bench);
    tl_writer_bench_close_well(&bench);
    TEST_ASSERT_EQUAL_INT(0, rename(copy, bench.path));
    tl_writer_bench_put(&bench, 20, 10);
    tl_writer_bench_open(&bench);
    tl_writer_bench_close_well(&bench);
    tl_writer_bench_expect_whole(bench.path);
    TEST_ASSERT_EQUAL_STRING("10, 10 20",
                             tl_sql_text(bench.path, "SELECT group_concat(samples_written || coalesce(' ' ||"
                                                     " removed_before, ''), ', ') FROM runs"));
}

/* A process writes this number of ticks and is killed. They are in SQLite's log. As many more
 * wait. */
static void begin_and_be_killed(int64_t ticks) {
    int how = 0;
    tl_writer_bench_start(&bench, 7);
    tl_writer_bench_put(&bench, 0, ticks);
    pid_t child = fork();
    if (child == 0) {
        if (tl_writer_bench_try_open(&bench) == TL_OK) {
            write_now();
            (void)raise(SIGKILL);
        }
        _exit(1);
    }
    TEST_ASSERT_EQUAL_INT(child, waitpid(child, &how, 0));
    TEST_ASSERT_TRUE(WIFSIGNALED(how));
    TEST_ASSERT_EQUAL_UINT64(2 * (uint64_t)ticks, written());
    tl_writer_bench_put(&bench, ticks, ticks);
}

/* The next writer writes all waiting entries. One event with all parts reports the lost ones. */
static void expect_restarted(const char *path, const char *samples_before_lost, const char *parts) {
    uint64_t before = written();
    tl_writer_bench_open(&bench);
    tl_writer_bench_close_well(&bench);
    expect_one_run(path, samples_before_lost);
    TEST_ASSERT_EQUAL_INT64_MESSAGE(1, tl_writer_bench_count_own(path, parts),
                                    tl_sql_text(path, "SELECT group_concat(text, ' | ') FROM events"));
    TEST_ASSERT_EQUAL_INT64(1, tl_sql_integer(path, "SELECT count(*) FROM events"));
    TEST_ASSERT_EQUAL_UINT64(before, written()); /* as many as were lost */
    TEST_ASSERT_EQUAL_UINT64(before, tl_recorder_state_get(bench.state).dropped);
}

static void test_a_file_that_is_removed_between_two_writers(void) {
    begin_and_be_killed(10);
    TEST_ASSERT_EQUAL_INT(0, unlink(bench.path));
    expect_restarted(bench.path, "10 10 20", "gone|20 samples");
}

static void test_a_folder_that_is_emptied_between_two_writers(void) {
    begin_and_be_killed(10);
    tl_scratch_empty(&bench.scratch);
    expect_restarted(bench.path, "10 10 20", "gone|20 samples");
}

/* An older copy replaces the file: the log of the killed writer must not be written into it. */
static void test_a_file_that_is_replaced_between_two_writers(void) {
    char copy[PATH_MAX + 8];
    (void)snprintf(copy, sizeof copy, "%s.copy", bench.path);
    tl_writer_bench_record(&bench, 10);
    TEST_ASSERT_EQUAL_INT(0, rename(bench.path, copy));
    tl_writer_bench_forget(&bench);
    begin_and_be_killed(1000);
    TEST_ASSERT_EQUAL_INT(0, rename(copy, bench.path));
    expect_restarted(bench.path, "1000 1000 2000", "gone|2000 samples");
    TEST_ASSERT_EQUAL_STRING("10, 1000",
                             tl_sql_text(bench.path, "SELECT group_concat(samples_written, ', ') FROM runs"));
}

/* Another process that reads the replaced file before the writer notices: SQLite then makes an
 * index of our log for that file. */
typedef struct stranger {
    pid_t child;
    int go;   /* one byte to it: read now */
    int done; /* one byte from it: done */
} stranger;

static void read_and_stay(int go, int done) {
    sqlite3 *database = NULL;
    char byte = 0;
    (void)prctl(PR_SET_PDEATHSIG, SIGKILL);
    if (read(go, &byte, 1) == 1 && sqlite3_open_v2(bench.path, &database, SQLITE_OPEN_READONLY, NULL) == SQLITE_OK &&
        sqlite3_exec(database, "SELECT count(*) FROM runs", NULL, NULL, NULL) == SQLITE_OK &&
        write(done, &byte, 1) == 1) {
        (void)pause();
    }
    _exit(1);
}

static stranger begin_stranger(void) {
    int go[2];
    int done[2];
    TEST_ASSERT_EQUAL_INT(0, pipe(go));
    TEST_ASSERT_EQUAL_INT(0, pipe(done));
    pid_t child = fork();
    if (child == 0) {
        (void)close(go[1]);
        (void)close(done[0]);
        read_and_stay(go[0], done[1]);
    }
    (void)close(go[0]);
    (void)close(done[1]);
    return (stranger){child, go[1], done[0]};
}

static void let_read(const stranger *who) {
    char byte = 0;
    TEST_ASSERT_EQUAL_INT(1, write(who->go, &byte, 1));
    TEST_ASSERT_EQUAL_INT(1, read(who->done, &byte, 1));
}

static void end_stranger(const stranger *who) {
    TEST_ASSERT_EQUAL_INT(0, kill(who->child, SIGKILL));
    TEST_ASSERT_EQUAL_INT(who->child, waitpid(who->child, NULL, 0));
    (void)close(who->go);
    (void)close(who->done);
}

static void expect_replaced_before_a_reader(const char *parts) {
    expect_one_run(bench.path, "10 10 20");
    TEST_ASSERT_EQUAL_STRING("10, 10", tl_sql_text(bench.path, "SELECT group_concat(samples_written, ', ') FROM runs"));
    TEST_ASSERT_EQUAL_INT64(1, tl_writer_bench_count_own(bench.path, parts));
    TEST_ASSERT_EQUAL_INT64(1, ask("SELECT count(*) FROM events"));
}

static void test_a_file_that_is_replaced_before_a_reader(void) {
    char copy[PATH_MAX + 8];
    (void)snprintf(copy, sizeof copy, "%s.copy", bench.path);
    tl_writer_bench_record(&bench, 10);
    TEST_ASSERT_EQUAL_INT(0, rename(bench.path, copy));
    tl_writer_bench_forget(&bench);
    stranger reader = begin_stranger();
    begin_run(10);
    TEST_ASSERT_EQUAL_INT(0, rename(copy, bench.path));
    let_read(&reader);
    tl_writer_bench_put(&bench, 10, 10);
    write_now();
    tl_writer_bench_close_well(&bench);
    end_stranger(&reader);
    expect_replaced_before_a_reader("removed|20 samples");
}

static void test_a_file_that_is_replaced_before_a_reader_between_two_writers(void) {
    char copy[PATH_MAX + 8];
    (void)snprintf(copy, sizeof copy, "%s.copy", bench.path);
    tl_writer_bench_record(&bench, 10);
    TEST_ASSERT_EQUAL_INT(0, rename(bench.path, copy));
    tl_writer_bench_forget(&bench);
    begin_and_be_killed(10);
    TEST_ASSERT_EQUAL_INT(0, rename(copy, bench.path));
    stranger reader = begin_stranger();
    let_read(&reader);
    tl_writer_bench_open(&bench);
    tl_writer_bench_close_well(&bench);
    end_stranger(&reader);
    expect_replaced_before_a_reader("gone|20 samples");
}

/* Another recorder uses our log for the replaced file and appends to it: the log is not removed. */
static void test_a_file_that_is_replaced_and_written_by_another(void) {
    char copy[PATH_MAX + 8];
    char wal[PATH_MAX + 8];
    tl_recorder *other = NULL;
    const tl_recorder_settings settings = tl_made_settings(bench.path);
    (void)snprintf(copy, sizeof copy, "%s.copy", bench.path);
    (void)snprintf(wal, sizeof wal, "%s-wal", bench.path);
    tl_writer_bench_record(&bench, 10);
    TEST_ASSERT_EQUAL_INT(0, rename(bench.path, copy));
    tl_writer_bench_forget(&bench);
    begin_and_be_killed(10);
    TEST_ASSERT_EQUAL_INT(0, rename(copy, bench.path));
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_recorder_open(&settings, &other, &bench.error));
    tl_writer_bench_open(&bench);
    int64_t size = size_of(wal);
    TEST_ASSERT_EQUAL_INT(TL_TRY_AGAIN, tl_writer_bench_close(&bench));
    TL_EXPECT_PARTS("twinlock|process", bench.error.text);
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_recorder_close(other, "end", NULL, &bench.error));
    TEST_ASSERT_GREATER_THAN_INT64(0, size);
}

/* The damaged file is renamed unchanged: our log must not repair it. */
static void test_a_damaged_file_in_its_place_between_two_writers(void) {
    char copy[PATH_MAX + 8];
    size_t before = 0;
    size_t after = 0;
    (void)snprintf(copy, sizeof copy, "%s.copy", bench.path);
    tl_writer_bench_record(&bench, 10);
    write_bytes(bench.path, 2L * 4096, (size_t)size_of(bench.path) - 2 * 4096);
    TEST_ASSERT_EQUAL_INT(0, rename(bench.path, copy));
    char *first = content_of(copy, &before);
    tl_writer_bench_forget(&bench);
    begin_and_be_killed(10);
    TEST_ASSERT_EQUAL_INT(0, rename(copy, bench.path));
    expect_restarted(bench.path, "10 10 20", "gone|20 samples|damaged|run.db.damaged-1");
    char *second = content_of(renamed, &after);
    TEST_ASSERT_EQUAL_size_t(before, after);
    TEST_ASSERT_EQUAL_INT(0, memcmp(first, second, before));
    free(first);
    free(second);
}

static void expect_foreign_left_alone(void) {
    make_file("somebody's text");
    expect_restarted(beside, "10 10 20", "gone|20 samples|15 bytes");
    TEST_ASSERT_EQUAL_INT64(15, size_of(bench.path));
}

static void test_a_foreign_file_in_its_place_between_two_writers(void) {
    char wal[PATH_MAX + 8];
    (void)snprintf(wal, sizeof wal, "%s-wal", bench.path);
    begin_and_be_killed(10);
    TEST_ASSERT_EQUAL_INT(0, unlink(bench.path));
    expect_foreign_left_alone();
    TEST_ASSERT_EQUAL_INT64(-1, size_of(wal)); /* SQLite would write it into the file */
}

static void test_a_file_that_is_overwritten_between_two_writers(void) {
    begin_and_be_killed(10);
    expect_foreign_left_alone();
}

/* Entries in the renamed file are not lost. */
static void test_a_file_that_is_damaged_between_two_writers(void) {
    begin_and_be_killed(10);
    tl_sql_execute(bench.path, "PRAGMA wal_checkpoint(TRUNCATE)");
    write_bytes(bench.path, 2L * 4096, (size_t)size_of(bench.path) - 2 * 4096);
    tl_writer_bench_open(&bench);
    tl_writer_bench_close_well(&bench);
    expect_one_run(bench.path, "10 10 0");
    TEST_ASSERT_EQUAL_INT64(1, tl_writer_bench_count_own(bench.path, "damaged|run.db.damaged-1"));
    TEST_ASSERT_EQUAL_INT64(1, ask("SELECT count(*) FROM events"));
}

int main(void) {
    tl_faulty_vfs_install();
    tl_scratch_make(&bench.scratch, "/tmp", "test_recorder_file");
    UNITY_BEGIN();
    RUN_TEST(test_a_truncated_file);
    RUN_TEST(test_a_truncated_header);
    RUN_TEST(test_damaged_pages);
    RUN_TEST(test_damage_during_a_run);
    RUN_TEST(test_damage_that_a_successor_finds);
    RUN_TEST(test_the_tenth_damaged_file_stays);
    RUN_TEST(test_foreign_files);
    RUN_TEST(test_another_format);
    RUN_TEST(test_a_file_without_our_tables);
    RUN_TEST(test_paths_that_are_not_a_regular_file);
    RUN_TEST(test_the_next_name);
    RUN_TEST(test_a_file_that_cannot_be_written);
    RUN_TEST(test_a_file_that_cannot_be_read);
    RUN_TEST(test_a_file_that_can_no_longer_be_read);
    RUN_TEST(test_a_run_beside_continues_there);
    RUN_TEST(test_a_log_that_is_removed);
    RUN_TEST(test_a_file_that_is_truncated);
    RUN_TEST(test_a_file_that_is_emptied);
    RUN_TEST(test_a_file_that_another_program_shortens);
    RUN_TEST(test_a_file_that_is_overwritten);
    RUN_TEST(test_a_file_that_is_being_overwritten);
    RUN_TEST(test_a_file_that_is_replaced);
    RUN_TEST(test_a_file_that_is_replaced_by_a_foreign_one);
    RUN_TEST(test_a_file_that_is_replaced_by_a_damaged_one);
    RUN_TEST(test_a_folder_that_loses_its_permissions);
    RUN_TEST(test_a_file_that_was_put_back);
    RUN_TEST(test_a_file_that_is_removed_between_two_writers);
    RUN_TEST(test_a_folder_that_is_emptied_between_two_writers);
    RUN_TEST(test_a_file_that_is_replaced_between_two_writers);
    RUN_TEST(test_a_file_that_is_replaced_before_a_reader);
    RUN_TEST(test_a_file_that_is_replaced_before_a_reader_between_two_writers);
    RUN_TEST(test_a_file_that_is_replaced_and_written_by_another);
    RUN_TEST(test_a_damaged_file_in_its_place_between_two_writers);
    RUN_TEST(test_a_foreign_file_in_its_place_between_two_writers);
    RUN_TEST(test_a_file_that_is_overwritten_between_two_writers);
    RUN_TEST(test_a_file_that_is_damaged_between_two_writers);
    return tl_scratch_finish(&bench.scratch, UNITY_END());
}
