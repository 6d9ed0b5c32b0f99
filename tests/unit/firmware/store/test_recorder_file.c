/* The file that a writer writes: damaged, foreign, not permitted, cut off, overwritten, replaced or gone, while it is written and while it is not. */
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
#include "tests/support/sql.h"
#include "tests/support/writer_bench.h"

enum { OTHER_USER = 65534 };

static tl_writer_bench bench;
static char beside[PATH_MAX + 16];
static char aside[PATH_MAX + 16];

void setUp(void) {
    tl_writer_bench_begin(&bench);
    (void)snprintf(beside, sizeof beside, "%s.beside", bench.path);
    (void)snprintf(aside, sizeof aside, "%s.damaged-1", bench.path);
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

/* ---- Files that are damaged -------------------------------------------------------------------------------------- */

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

/* The file is put aside as it is, and a new one is written. */
static void expect_made_anew(void) {
    int64_t size = size_of(bench.path);
    tl_writer_bench_forget(&bench);
    tl_writer_bench_record(&bench, 20);
    TEST_ASSERT_EQUAL_INT64(size, size_of(aside));
    tl_writer_bench_expect_whole(bench.path);
    TEST_ASSERT_EQUAL_INT64(20, ask("SELECT samples_written FROM runs"));
    TEST_ASSERT_EQUAL_INT64(
        1, tl_writer_bench_count_own(bench.path, "was damaged, is called run.db.damaged-1 now, and was made anew: %"));
    TEST_ASSERT_EQUAL_INT64(1, ask("SELECT count(*) FROM events"));
}

static void test_a_truncated_file_is_put_aside(void) {
    tl_writer_bench_record(&bench, 2000);
    TEST_ASSERT_EQUAL_INT(0, truncate(bench.path, size_of(bench.path) / 2));
    expect_made_anew();
}

static void test_a_truncated_header_is_put_aside(void) {
    tl_writer_bench_record(&bench, 10);
    TEST_ASSERT_EQUAL_INT(0, truncate(bench.path, 80));
    expect_made_anew();
}

static void test_damaged_pages_are_put_aside(void) {
    tl_writer_bench_record(&bench, 10);
    write_bytes(bench.path, 100, 4000); /* the schema */
    expect_made_anew();
}

/* Nothing of what waits is lost. */
static void test_damage_that_shows_while_it_is_written(void) {
    char wal[PATH_MAX + 24];
    (void)snprintf(wal, sizeof wal, "%s-wal", aside);
    tl_writer_bench_open(&bench);
    tl_writer_bench_start(&bench, 7);
    tl_writer_bench_put(&bench, 0, 1000);
    write_now();
    tl_writer_bench_put(&bench, 1000, 10);
    tl_record_queue_event(&bench.twin, 1009, TL_EVENT_INFO, "twin", "an event");
    tl_faulty_vfs_refuse(SQLITE_CORRUPT, 0);
    write_now(); /* it cannot even make a new one */
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
    TEST_ASSERT_GREATER_THAN_INT64(0, size_of(wal)); /* its log went with it */
    TEST_ASSERT_EQUAL_INT64(1000, tl_sql_integer(aside, "SELECT samples_written FROM runs"));
}

/* Real pages, which the writer before has not looked at again. */
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
    TEST_ASSERT_GREATER_THAN_INT64(0, size_of(aside));
}

/* With so many of them there, it stays where it is. */
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
    TEST_ASSERT_EQUAL_INT64(1, tl_writer_bench_count_own(beside, "is recorded into instead: %"));
}

/* ---- Files that are not ours, or may not be written -------------------------------------------------------------- */

static void make_file(const char *text) {
    FILE *file = fopen(bench.path, "wb");
    TEST_ASSERT_NOT_NULL(file);
    TEST_ASSERT_TRUE(fputs(text, file) >= 0);
    TEST_ASSERT_EQUAL_INT(0, fclose(file));
}

/* With everything that is in it now. */
static char *content_of(const char *path, size_t *size) {
    FILE *file = fopen(path, "rb");
    TEST_ASSERT_NOT_NULL(file);
    char *bytes = malloc(1 << 20);
    TEST_ASSERT_NOT_NULL(bytes);
    *size = fread(bytes, 1, 1 << 20, file);
    TEST_ASSERT_EQUAL_INT(0, fclose(file));
    return bytes;
}

static void expect_recorded_beside(const char *why) {
    char pattern[200];
    tl_writer_bench_forget(&bench);
    tl_writer_bench_record(&bench, 20);
    tl_writer_bench_expect_whole(beside);
    TEST_ASSERT_EQUAL_INT64(20, tl_sql_integer(beside, "SELECT samples_written FROM runs"));
    (void)snprintf(pattern, sizeof pattern, "is recorded into instead: %%%s%%", why);
    TEST_ASSERT_EQUAL_INT64_MESSAGE(1, tl_writer_bench_count_own(beside, pattern),
                                    tl_sql_text(beside, "SELECT text FROM events"));
    TEST_ASSERT_EQUAL_INT64(1, tl_sql_integer(beside, "SELECT count(*) FROM events"));
}

static void expect_left_alone(const char *why) {
    size_t before = 0;
    size_t after = 0;
    char *first = content_of(bench.path, &before);
    expect_recorded_beside(why);
    char *second = content_of(bench.path, &after);
    TEST_ASSERT_EQUAL_size_t(before, after);
    TEST_ASSERT_EQUAL_INT(0, memcmp(first, second, before));
    free(first);
    free(second);
    tl_scratch_empty(&bench.scratch);
    tl_writer_bench_forget(&bench);
}

/* Who is there to be told is told. */
static void expect_refused(tl_status status, const char *why) {
    bench.record.insistence = TL_DATABASE_IF_OURS;
    TEST_ASSERT_EQUAL_INT(status, tl_writer_bench_try_open(&bench));
    TEST_ASSERT_NULL(bench.writer);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(bench.error.text, why), bench.error.text);
    TEST_ASSERT_EQUAL_INT(1, tl_scratch_count(&bench.scratch));
    bench.record.insistence = TL_DATABASE_ANYHOW;
}

static void test_what_was_never_ours(void) {
    make_file("");
    expect_refused(TL_BAD_DATA, "only 0 bytes");
    expect_left_alone("only 0 bytes");
    make_file("time,omega\n0,1\n");
    expect_refused(TL_BAD_DATA, "only 15 bytes");
    expect_left_alone("only 15 bytes");
    tl_sql_execute(bench.path, "CREATE TABLE mine (x)");
    expect_refused(TL_BAD_DATA, "of another program");
    expect_left_alone("of another program");
}

static void expect_format_refused(const char *sql, const char *why) {
    tl_writer_bench_record(&bench, 10);
    tl_sql_execute(bench.path, sql);
    tl_writer_bench_forget(&bench);
    expect_refused(TL_BAD_DATA, why);
    expect_left_alone(why);
}

static void test_another_format(void) {
    expect_format_refused("PRAGMA user_version = 4", "format 4");
    expect_format_refused("PRAGMA user_version = 6", "format 6");
}

static void test_a_file_without_our_tables(void) {
    tl_writer_bench_record(&bench, 10);
    tl_sql_execute(bench.path, "DROP TABLE steps");
    tl_writer_bench_forget(&bench);
    expect_refused(TL_BAD_DATA, "no such table: steps");
    expect_left_alone("no such table");
}

static void test_what_is_no_file(void) {
    TEST_ASSERT_EQUAL_INT(0, mkdir(bench.path, 0700));
    expect_refused(TL_BAD_DATA, "no ordinary file");
    expect_recorded_beside("no ordinary file");
    TEST_ASSERT_EQUAL_INT(0, rmdir(bench.path));
    tl_scratch_empty(&bench.scratch);
    TEST_ASSERT_EQUAL_INT(0, symlink("absent.db", bench.path));
    expect_recorded_beside("symbolic link");
}

/* And what is beside it is not ours either. */
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
    if (geteuid() == 0) { /* who may do anything */
        TEST_ASSERT_EQUAL_INT(0, chmod(bench.scratch.folder, 0777));
        TEST_ASSERT_EQUAL_INT(0, seteuid(OTHER_USER));
    }
    TEST_ASSERT_TRUE(geteuid() != 0);
    (void)chmod(bench.path, 0444);
    bench.record.insistence = TL_DATABASE_IF_OURS; /* on a terminal too */
    expect_recorded_beside("may not be written");
    TEST_ASSERT_EQUAL_INT(0, seteuid(getuid()));
}

static void test_a_file_that_cannot_be_read(void) {
    tl_writer_bench_record(&bench, 10);
    TEST_ASSERT_EQUAL_INT(0, chmod(bench.path, 0));
    if (geteuid() == 0) {
        TEST_ASSERT_EQUAL_INT(0, chmod(bench.scratch.folder, 0777));
        TEST_ASSERT_EQUAL_INT(0, seteuid(OTHER_USER));
    }
    expect_recorded_beside("run.db: unable to open database file");
    TEST_ASSERT_EQUAL_INT(0, seteuid(getuid()));
}

/* A medium that has begun to fail; opened again, the file would look well. */
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

/* It goes on where it was, though that is not what was asked for. */
static void test_a_run_that_is_beside_goes_on_there(void) {
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

/* ---- What others do to a file while it is written ---------------------------------------------------------------- */

/* A run that is open, with what it has so far. */
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
                                               " entries_lost FROM runs ORDER BY run DESC LIMIT 1"));
}

/* What is committed is in the file before anything else is, so that nothing is lost if the box is switched off now. */
static void test_a_log_that_is_removed(void) {
    char wal[PATH_MAX + 8];
    (void)snprintf(wal, sizeof wal, "%s-wal", bench.path);
    begin_run(10);
    TEST_ASSERT_EQUAL_INT(0, unlink(wal));
    tl_writer_bench_put(&bench, 10, 10);
    write_now();
    TEST_ASSERT_GREATER_THAN_INT64(0, size_of(wal));
    TEST_ASSERT_EQUAL_INT64(20, ask("SELECT samples_written FROM runs")); /* as others see it */
    tl_writer_bench_close_well(&bench);
    expect_one_run(bench.path, "20 0 0");
    TEST_ASSERT_EQUAL_INT64(1, ask("SELECT count(*) FROM runs"));
    TEST_ASSERT_EQUAL_INT64(1, tl_writer_bench_count_own(bench.path, "its log, -wal, was removed: %"));
}

static void expect_cut(bool to_nothing) {
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
    TEST_ASSERT_EQUAL_INT64(size, size_of(aside));
    TEST_ASSERT_EQUAL_INT64(1, tl_writer_bench_count_own(bench.path, "was damaged, is called run.db.damaged-1 now, and"
                                                                     " was made anew: %was cut off"));
}

static void test_a_file_that_is_cut_off(void) {
    expect_cut(false);
}

static void test_a_file_that_is_emptied(void) {
    expect_cut(true);
}

/* A file that is shorter because there is less in it is none that was cut off. */
static void test_a_file_that_another_program_shortens(void) {
    begin_run(1000);
    tl_sql_execute(bench.path, "PRAGMA wal_checkpoint");
    tl_writer_bench_put(&bench, 1000, 10);
    write_now();
    int64_t size = size_of(bench.path);
    tl_sql_execute(bench.path, "DELETE FROM samples WHERE tick < 900; PRAGMA incremental_vacuum;"
                               " PRAGMA wal_checkpoint(TRUNCATE)");
    TEST_ASSERT_LESS_THAN_INT64(size, size_of(bench.path));
    tl_writer_bench_put(&bench, 1010, 10);
    write_now();
    tl_writer_bench_close_well(&bench);
    TEST_ASSERT_EQUAL_INT64(-1, size_of(aside));
    TEST_ASSERT_EQUAL_INT64(1020, ask("SELECT samples_written FROM runs"));
    TEST_ASSERT_EQUAL_INT64(0, ask("SELECT count(*) FROM events"));
}

/* What is in it now is not ours, and our log is not played into it. */
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
    TEST_ASSERT_EQUAL_INT64(1, tl_writer_bench_count_own(beside, "is recorded into instead of one that was overwritten"
                                                                 " with 20 samples, steps and events of this run: %"));
    TEST_ASSERT_EQUAL_INT64(1, tl_sql_integer(beside, "SELECT count(*) FROM events"));
    char *found = content_of(bench.path, &size);
    TEST_ASSERT_EQUAL_size_t(strlen(text), size);
    TEST_ASSERT_EQUAL_INT(0, memcmp(text, found, size));
    free(found);
    TEST_ASSERT_EQUAL_INT64(-1, size_of(wal));
}

/* And it is theirs from the moment on at which they have emptied it. */
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
    TEST_ASSERT_EQUAL_INT64(-1, size_of(aside));
    TEST_ASSERT_EQUAL_INT64(15, size_of(bench.path));
    expect_one_run(beside, "10 10 20");
}

/* As by somebody who puts an older copy back: it is written on, and our log is not played into it. */
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

/* What is in its place is not ours: all of it is said at once. */
static void test_a_file_that_is_replaced_by_a_foreign_one(void) {
    begin_run(10);
    TEST_ASSERT_EQUAL_INT(0, unlink(bench.path));
    make_file("somebody's text");
    tl_writer_bench_put(&bench, 10, 10);
    write_now();
    tl_writer_bench_close_well(&bench);
    TEST_ASSERT_EQUAL_INT64(15, size_of(bench.path));
    expect_one_run(beside, "10 10 20");
    TEST_ASSERT_EQUAL_INT64(1, tl_writer_bench_count_own(beside, "is recorded into instead of one that was removed with"
                                                                 " 20 samples, steps and events of this run: %"));
    TEST_ASSERT_EQUAL_INT64(1, tl_sql_integer(beside, "SELECT count(*) FROM events"));
}

/* The same of a file of ours that is damaged. */
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
    TEST_ASSERT_EQUAL_INT64(1, tl_writer_bench_count_own(bench.path,
                                                         "was removed with 20 samples, steps and events of this run;"
                                                         " what took its place was damaged, is called"
                                                         " run.db.damaged-1 now, and was made anew: %"));
    TEST_ASSERT_EQUAL_INT64(1, ask("SELECT count(*) FROM events"));
}

/* The file is where it was, and open: what cannot be seen has not been moved away. */
static void test_a_folder_that_is_closed_meanwhile(void) {
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

/* ---- What others do to a file while nobody writes it ------------------------------------------------------------- */

/* The file is another one than the writer before has left: the run begins again in it. */
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

/* A run of so many ticks that are written by a process that is killed; as many wait. Its log has what it wrote. */
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

/* The next one writes all that waits, and says once what has become of the rest. */
static void expect_begun_again(const char *path, const char *samples_before_lost, const char *words) {
    uint64_t before = written();
    tl_writer_bench_open(&bench);
    tl_writer_bench_close_well(&bench);
    expect_one_run(path, samples_before_lost);
    TEST_ASSERT_EQUAL_INT64_MESSAGE(1, tl_writer_bench_count_own(path, words),
                                    tl_sql_text(path, "SELECT group_concat(text, ' | ') FROM events"));
    TEST_ASSERT_EQUAL_INT64(1, tl_sql_integer(path, "SELECT count(*) FROM events"));
    TEST_ASSERT_EQUAL_UINT64(before, written()); /* as many as were lost */
    TEST_ASSERT_EQUAL_UINT64(before, tl_recorder_state_get(bench.state).dropped);
}

static void test_a_file_that_is_removed_when_nobody_writes(void) {
    begin_and_be_killed(10);
    TEST_ASSERT_EQUAL_INT(0, unlink(bench.path));
    expect_begun_again(bench.path, "10 10 20",
                       "was gone with 20 samples, steps and events of this run, and is made anew");
}

static void test_a_folder_that_is_emptied_when_nobody_writes(void) {
    begin_and_be_killed(10);
    tl_scratch_empty(&bench.scratch);
    expect_begun_again(bench.path, "10 10 20",
                       "was gone with 20 samples, steps and events of this run, and is made anew");
}

/* By an older copy, say: the log of the one before is not played into it. */
static void test_a_file_that_is_replaced_when_nobody_writes(void) {
    char copy[PATH_MAX + 8];
    (void)snprintf(copy, sizeof copy, "%s.copy", bench.path);
    tl_writer_bench_record(&bench, 10);
    TEST_ASSERT_EQUAL_INT(0, rename(bench.path, copy));
    tl_writer_bench_forget(&bench);
    begin_and_be_killed(1000);
    TEST_ASSERT_EQUAL_INT(0, rename(copy, bench.path));
    expect_begun_again(bench.path, "1000 1000 2000", "was gone with 2000 samples%, and is made anew");
    TEST_ASSERT_EQUAL_STRING("10, 1000",
                             tl_sql_text(bench.path, "SELECT group_concat(samples_written, ', ') FROM runs"));
}

/* Somebody reads what is at the path while nobody writes, or before the one who writes has looked: SQLite makes an index of our log for them. */
typedef struct stranger {
    pid_t child;
    int go;   /* a byte to it: read now */
    int done; /* a byte from it: it has */
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

static void expect_replaced_before_a_reader(const char *words) {
    expect_one_run(bench.path, "10 10 20");
    TEST_ASSERT_EQUAL_STRING("10, 10", tl_sql_text(bench.path, "SELECT group_concat(samples_written, ', ') FROM runs"));
    TEST_ASSERT_EQUAL_INT64(1, tl_writer_bench_count_own(bench.path, words));
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
    expect_replaced_before_a_reader("was removed with 20 samples%, and is made anew");
}

static void test_a_file_that_is_replaced_before_a_reader_when_nobody_writes(void) {
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
    expect_replaced_before_a_reader("was gone with 20 samples%, and is made anew");
}

/* It takes our log for its own, and writes on into it: that stays. */
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
    TEST_ASSERT_NOT_NULL(strstr(bench.error.text, "another twinlock is writing it"));
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_recorder_close(other, "end", NULL, &bench.error));
    TEST_ASSERT_GREATER_THAN_INT64(0, size);
}

/* It is put aside as it was: our log would have made it look well. */
static void test_a_damaged_file_in_its_place_when_nobody_writes(void) {
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
    expect_begun_again(bench.path, "10 10 20",
                       "was gone with 20 samples%; what took its place was damaged, is called"
                       " run.db.damaged-1 now, and was made anew: %");
    char *second = content_of(aside, &after);
    TEST_ASSERT_EQUAL_size_t(before, after);
    TEST_ASSERT_EQUAL_INT(0, memcmp(first, second, before));
    free(first);
    free(second);
}

static void expect_foreign_left_alone(void) {
    make_file("somebody's text");
    expect_begun_again(beside, "10 10 20", "is recorded into instead of one that was gone with 20 samples%");
    TEST_ASSERT_EQUAL_INT64(15, size_of(bench.path));
}

static void test_a_foreign_file_in_its_place_when_nobody_writes(void) {
    char wal[PATH_MAX + 8];
    (void)snprintf(wal, sizeof wal, "%s-wal", bench.path);
    begin_and_be_killed(10);
    TEST_ASSERT_EQUAL_INT(0, unlink(bench.path));
    expect_foreign_left_alone();
    TEST_ASSERT_EQUAL_INT64(-1, size_of(wal)); /* it would be played into that */
}

static void test_a_file_that_is_overwritten_when_nobody_writes(void) {
    begin_and_be_killed(10);
    expect_foreign_left_alone();
}

/* What is in it is there still: it is not lost. */
static void test_a_file_that_is_damaged_when_nobody_writes(void) {
    begin_and_be_killed(10);
    tl_sql_execute(bench.path, "PRAGMA wal_checkpoint(TRUNCATE)");
    write_bytes(bench.path, 2L * 4096, (size_t)size_of(bench.path) - 2 * 4096);
    tl_writer_bench_open(&bench);
    tl_writer_bench_close_well(&bench);
    expect_one_run(bench.path, "10 10 0");
    TEST_ASSERT_EQUAL_INT64(1, tl_writer_bench_count_own(bench.path, "was damaged, is called run.db.damaged-1 now,%"));
    TEST_ASSERT_EQUAL_INT64(1, ask("SELECT count(*) FROM events"));
}

int main(void) {
    tl_faulty_vfs_install();
    tl_scratch_make(&bench.scratch, "/tmp", "test_recorder_file");
    UNITY_BEGIN();
    RUN_TEST(test_a_truncated_file_is_put_aside);
    RUN_TEST(test_a_truncated_header_is_put_aside);
    RUN_TEST(test_damaged_pages_are_put_aside);
    RUN_TEST(test_damage_that_shows_while_it_is_written);
    RUN_TEST(test_damage_that_a_successor_finds);
    RUN_TEST(test_the_tenth_damaged_file_stays);
    RUN_TEST(test_what_was_never_ours);
    RUN_TEST(test_another_format);
    RUN_TEST(test_a_file_without_our_tables);
    RUN_TEST(test_what_is_no_file);
    RUN_TEST(test_the_next_name);
    RUN_TEST(test_a_file_that_cannot_be_written);
    RUN_TEST(test_a_file_that_cannot_be_read);
    RUN_TEST(test_a_file_that_can_no_longer_be_read);
    RUN_TEST(test_a_run_that_is_beside_goes_on_there);
    RUN_TEST(test_a_log_that_is_removed);
    RUN_TEST(test_a_file_that_is_cut_off);
    RUN_TEST(test_a_file_that_is_emptied);
    RUN_TEST(test_a_file_that_another_program_shortens);
    RUN_TEST(test_a_file_that_is_overwritten);
    RUN_TEST(test_a_file_that_is_being_overwritten);
    RUN_TEST(test_a_file_that_is_replaced);
    RUN_TEST(test_a_file_that_is_replaced_by_a_foreign_one);
    RUN_TEST(test_a_file_that_is_replaced_by_a_damaged_one);
    RUN_TEST(test_a_folder_that_is_closed_meanwhile);
    RUN_TEST(test_a_file_that_was_put_back);
    RUN_TEST(test_a_file_that_is_removed_when_nobody_writes);
    RUN_TEST(test_a_folder_that_is_emptied_when_nobody_writes);
    RUN_TEST(test_a_file_that_is_replaced_when_nobody_writes);
    RUN_TEST(test_a_file_that_is_replaced_before_a_reader);
    RUN_TEST(test_a_file_that_is_replaced_before_a_reader_when_nobody_writes);
    RUN_TEST(test_a_file_that_is_replaced_and_written_by_another);
    RUN_TEST(test_a_damaged_file_in_its_place_when_nobody_writes);
    RUN_TEST(test_a_foreign_file_in_its_place_when_nobody_writes);
    RUN_TEST(test_a_file_that_is_overwritten_when_nobody_writes);
    RUN_TEST(test_a_file_that_is_damaged_when_nobody_writes);
    return tl_scratch_finish(&bench.scratch, UNITY_END());
}
