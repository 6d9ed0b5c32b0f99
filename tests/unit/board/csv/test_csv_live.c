/* The live CSV driver: a file that is played at the pace of its time column, and a FIFO with
 * writers that connect, send malformed rows, leave and reconnect.
 *
 * No test depends on the speed of the machine: each waits for what it expects.
 */
#include <fcntl.h>
#include <math.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/inotify.h>
#include <sys/stat.h>
#include <sys/sysmacros.h>
#include <unistd.h>

#include <unity.h>

#include "board/csv/csv.h"
#include "board/csv/csv_live.h"
#include "tests/support/driver_probe.h"
#include "tests/support/message.h"
#include "tests/support/real_time.h"
#include "tests/support/scratch.h"

enum { KEPT = 64 };

static tl_scratch scratch;
static char path[PATH_MAX];
static int writer;
static tl_driver_probe probe;

static tl_reading history[2][KEPT];

static void on_post(void *context, size_t channel, const tl_reading *reading) {
    TEST_ASSERT_TRUE(channel < 2);
    history[channel][probe.posts[channel] % KEPT] = *reading;
    tl_probe_post(context, channel, reading);
}

void setUp(void) {
    const tl_csv_column columns[] = {{"u", 1, 0}, {"v", 1, 0}};
    const tl_csv_settings settings = {.path = path, .time_column = "time", .columns = columns, .column_count = 2};
    tl_probe_begin(&probe, &tl_csv_driver);
    probe.sink.post = on_post;
    writer = -1;
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_csv_open_live(&settings, &probe.io, &probe.error));
}

void tearDown(void) {
    tl_probe_end(&probe);
    if (writer >= 0) {
        (void)close(writer);
    }
    tl_scratch_empty(&scratch);
}

/* ---- helpers ---- */

/* Polls until channel 0 has that many readings. */
static void poll_until(size_t count) {
    tl_time deadline = tl_test_now() + 30 * TL_SECOND;
    while (probe.posts[0] < count) {
        TEST_ASSERT_TRUE_MESSAGE(tl_test_now() < deadline, "the reading did not come");
        tl_probe_poll(&probe);
    }
}

static void expect_link(size_t count, bool up, const char *parts) {
    TEST_ASSERT_EQUAL_size_t_MESSAGE(count, probe.links, probe.link_text);
    TEST_ASSERT_EQUAL_INT(up, probe.link_up);
    TL_EXPECT_PARTS(path, probe.link_text);
    TL_EXPECT_PARTS(parts, probe.link_text);
}

static void write_file(const char *how, const char *text) {
    FILE *file = fopen(path, how);
    TEST_ASSERT_NOT_NULL(file);
    TEST_ASSERT_TRUE(fputs(text, file) >= 0);
    TEST_ASSERT_EQUAL_INT(0, fclose(file));
}

/* Makes a file, or truncates it and writes it again. */
static void put_file(const char *text) {
    write_file("wb", text);
}

static void append(const char *text) {
    write_file("ab", text);
}

/* Renames the file, and makes a new one of the same name. */
static void rotate_file(const char *text) {
    char old[PATH_MAX + 4];
    (void)snprintf(old, sizeof old, "%s.1", path);
    TEST_ASSERT_EQUAL_INT(0, rename(path, old));
    put_file(text);
}

/* Makes the FIFO and lets the driver open it, so that a writer can open it too. */
static void make_fifo(void) {
    TEST_ASSERT_EQUAL_INT(0, mkfifo(path, 0600));
    tl_probe_poll(&probe);
    expect_link(1, false, path); /* no writer */
    TEST_ASSERT_EQUAL_size_t(1, probe.posts[0]);
    tl_probe_expect(&probe, 0, 0, TL_NO_LINK);
    tl_probe_expect(&probe, 1, 0, TL_NO_LINK);
    tl_probe_forget(&probe);
}

static void send(const char *text) {
    if (writer < 0) {
        writer = open(path, O_WRONLY | O_NONBLOCK);
        TEST_ASSERT_TRUE_MESSAGE(writer >= 0, "the driver has not opened the FIFO");
    }
    TEST_ASSERT_EQUAL_INT((int)strlen(text), (int)write(writer, text, strlen(text)));
}

static void leave(void) {
    TEST_ASSERT_EQUAL_INT(0, close(writer));
    writer = -1;
}

/* ---- a regular file ---- */

static void test_a_path_that_comes_later(void) {
    tl_probe_poll(&probe);
    expect_link(1, false, "No such file");
    tl_probe_expect(&probe, 0, 0, TL_NO_LINK);
    tl_probe_poll(&probe);
    TEST_ASSERT_EQUAL_size_t(1, probe.links);
    TEST_ASSERT_EQUAL_size_t(2, probe.posts[0]);
    TEST_ASSERT_EQUAL_size_t(2, probe.posts[1]);
    put_file("time,u,v\n0,1,2\n");
    tl_probe_poll(&probe);
    expect_link(2, true, "open");
    tl_probe_expect(&probe, 0, 1, TL_GOOD);
    tl_probe_expect(&probe, 1, 2, TL_GOOD);
}

static void test_a_file_is_played_in_its_own_time(void) {
    put_file("time,u,v\n10,1,2\n10.03,3,4\n10.06,5,\n11,9,9");
    tl_time before = tl_test_now();
    tl_probe_poll(&probe);
    tl_time after = tl_test_now();
    if (after < before + 30000000) {
        TEST_ASSERT_EQUAL_size_t(1, probe.posts[0]); /* the second is not due yet */
    }
    expect_link(1, true, "open");
    poll_until(3);
    TEST_ASSERT_TRUE(tl_test_now() >= before + 60000000);
    tl_probe_poll(&probe); /* the last line has no end: it is not used */
    TEST_ASSERT_EQUAL_size_t(3, probe.posts[0]);
    TEST_ASSERT_EQUAL_size_t(2, probe.posts[1]); /* an empty cell is not posted */
    TEST_ASSERT_TRUE(history[0][0].stamp >= before && history[0][0].stamp <= after);
    TEST_ASSERT_EQUAL_INT64(history[0][0].stamp + 30000000, history[0][1].stamp);
    TEST_ASSERT_EQUAL_INT64(history[0][0].stamp + 60000000, history[0][2].stamp);
    tl_probe_expect(&probe, 0, 5, TL_GOOD);
    tl_probe_expect(&probe, 1, 4, TL_GOOD);
    TEST_ASSERT_EQUAL_size_t(1, probe.links);
}

/* The message tells what was recognised, because it was not configured. */
static void test_a_file_in_another_form(void) {
    put_file("time;u;v\n[ms];m;m\n10;1,5;TRUE\n40;3;4\n");
    tl_probe_poll(&probe);
    expect_link(1, true, "open|semicolons|ms");
    poll_until(2);
    TEST_ASSERT_EQUAL_INT64(history[0][0].stamp + 30000000, history[0][1].stamp);
    TEST_ASSERT_EQUAL_DOUBLE(1.5, history[0][0].value);
    tl_probe_expect(&probe, 1, 4, TL_GOOD);
}

static void test_a_cell_that_is_no_number(void) {
    put_file("time,u,v\n0,nan,1\n");
    tl_probe_poll(&probe);
    tl_probe_expect(&probe, 0, 0, TL_NOT_A_NUMBER);
    tl_probe_expect(&probe, 1, 1, TL_GOOD);
}

/* A writer may create it before its first row. */
static void test_a_file_without_rows_waits(void) {
    put_file("");
    tl_probe_poll(&probe);
    expect_link(1, false, "no row yet");
    tl_probe_expect(&probe, 0, 0, TL_NO_LINK);
    append("time,u,v\n");
    tl_probe_poll(&probe);
    TEST_ASSERT_EQUAL_size_t(1, probe.links);
    TEST_ASSERT_EQUAL_size_t(2, probe.posts[0]); /* each poll */
    append("0,1,2\n");
    tl_probe_poll(&probe);
    expect_link(2, true, "open");
    tl_probe_expect(&probe, 0, 1, TL_GOOD);
}

static void test_a_file_without_a_column(void) {
    put_file("time,u,w\n0,1,1\n");
    tl_probe_poll(&probe);
    expect_link(1, false, "line 1|\"v\"|time, u, w");
    tl_probe_expect(&probe, 0, 0, TL_NO_LINK);
}

static void test_malformed_rows_of_a_file_are_skipped(void) {
    char *text = malloc(70001);
    TEST_ASSERT_NOT_NULL(text);
    memset(text, 'x', 70000);
    text[70000] = '\0';
    put_file("time,u,v\n0,1,2\n\n1,1\n0.001,3,4\n");
    append(text);
    append("\n0.002,5,6\n");
    free(text);
    poll_until(3);
    expect_link(2, true, "line 4|2|3");
    tl_probe_expect(&probe, 0, 5, TL_GOOD);
}

/* The clock of the device was set back: no row is lost. */
static void test_time_of_a_file_that_goes_back(void) {
    put_file("time,u,v\n5.1,1,1\n0.1,2,2\n0.101,3,3\n0.102,4,4\n");
    poll_until(4);
    expect_link(2, true, "5.100000000 s|0.100000000 s");
    for (size_t i = 0; i < 4; i++) {
        TEST_ASSERT_EQUAL_DOUBLE((double)i + 1, history[0][i].value);
        TEST_ASSERT_TRUE(i == 0 || history[0][i].stamp > history[0][i - 1].stamp);
    }
}

static void test_a_file_that_cannot_be_read(void) {
    if (symlink("/proc/self/mem", path) != 0) { /* its first page is not mapped */
        TEST_FAIL();
    }
    tl_probe_poll(&probe);
    tl_probe_poll(&probe);
    expect_link(1, false, "cannot be read");
    tl_probe_expect(&probe, 0, 0, TL_NO_LINK);
    TEST_ASSERT_EQUAL_INT(0, unlink(path));
    put_file("time,u,v\n0,1,2\n");
    tl_probe_poll_until(&probe, 0, TL_GOOD);
    tl_probe_expect(&probe, 0, 1, TL_GOOD);
}

/* ---- a file that a program writes ---- */

/* Rows that were there before are played until the file grows. Then its newest row is the present. */
static void test_a_growing_file_is_followed(void) {
    put_file("time,u,v\n10,1,2\n100,3,4\n200,5");
    tl_probe_poll(&probe);
    TEST_ASSERT_EQUAL_size_t(1, probe.posts[0]);
    tl_time before = tl_test_now();
    append(",6\n300,7");
    tl_probe_poll(&probe);
    expect_link(2, true, "only new rows");
    TEST_ASSERT_EQUAL_size_t(2, probe.posts[0]); /* not the second row, which is not due, and not the incomplete one */
    tl_probe_expect(&probe, 0, 5, TL_GOOD);
    TEST_ASSERT_TRUE(tl_probe_newest(&probe, 0)->stamp >= before);
    append(",8\n");
    tl_probe_poll(&probe);
    tl_probe_expect(&probe, 0, 7, TL_GOOD);
    TEST_ASSERT_TRUE(tl_probe_newest(&probe, 0)->stamp <= tl_test_now()); /* 100 s of the column are over */
    TEST_ASSERT_EQUAL_size_t(2, probe.links);
}

/* Lets the driver follow a file whose last row has the time 2. */
static void follow_file(void) {
    put_file("time,u,v\n1,1,1\n");
    tl_probe_poll(&probe);
    append("2,2,2\n");
    poll_until(2);
}

static void test_a_followed_file_that_is_replaced(void) {
    follow_file();
    append("3,3,3\n"); /* not read before it is renamed */
    rotate_file("time,u,v\n4,4,4\n");
    poll_until(4);
    rotate_file(""); /* a file without a header is read with the last one */
    tl_probe_poll(&probe);
    append("5,5,5\n");
    poll_until(5);
    for (size_t i = 0; i < 5; i++) {
        TEST_ASSERT_EQUAL_DOUBLE((double)i + 1, history[0][i].value);
    }
    TEST_ASSERT_EQUAL_size_t(2, probe.links);
}

/* A writer may write all rows again each time. */
static void test_old_rows_of_a_new_file_are_not_used_again(void) {
    follow_file();
    rotate_file("time,u,v\n1,1,1\n2,2,2\n3,3,3\n");
    poll_until(3);
    tl_probe_expect(&probe, 0, 3, TL_GOOD);
    rotate_file("time,u,v\n1,1,1\n2,2,2\n3,3,3\n");
    tl_probe_poll(&probe);
    tl_probe_poll(&probe);
    TEST_ASSERT_EQUAL_size_t(3, probe.posts[0]);
    append("4,4,4\n");
    poll_until(4);
    tl_probe_expect(&probe, 0, 4, TL_GOOD);
}

static void test_a_played_file_that_is_replaced(void) {
    put_file("time,u,v\n1,1,1\n100,2,2\n");
    tl_probe_poll(&probe);
    rotate_file("time,u,v\n3,3,3\n");
    poll_until(2);
    tl_probe_expect(&probe, 0, 3, TL_GOOD);
}

static void test_a_file_that_is_truncated(void) {
    follow_file();
    put_file("");
    tl_probe_poll(&probe);
    append("time,v,u\n0,8,9\n"); /* the writer has restarted */
    poll_until(3);
    tl_probe_expect(&probe, 0, 9, TL_GOOD);
    tl_probe_expect(&probe, 1, 8, TL_GOOD);
    append("1,10,11\n");
    poll_until(4);
    tl_probe_expect(&probe, 0, 11, TL_GOOD);
}

static void test_a_file_that_disappears(void) {
    follow_file();
    FILE *file = fopen(path, "ab");
    TEST_ASSERT_NOT_NULL(file);
    TEST_ASSERT_EQUAL_INT(0, unlink(path));
    tl_probe_poll(&probe);
    TEST_ASSERT_TRUE(fputs("3,3,3\n", file) >= 0); /* its writer still has it */
    TEST_ASSERT_EQUAL_INT(0, fclose(file));
    poll_until(3);
    put_file("time,u,v\n4,4,4\n");
    poll_until(4);
    TEST_ASSERT_EQUAL_size_t(2, probe.links);
}

/* The end is reported once, and so are new rows after it. */
static void test_a_file_that_does_not_grow_any_more(void) {
    follow_file();
    append("2.001,1,1\n");
    poll_until(3);
    tl_time deadline = tl_test_now() + 30 * TL_SECOND;
    while (probe.links == 2) {
        TEST_ASSERT_TRUE(tl_test_now() < deadline);
        tl_test_pause_ms(20);
        tl_probe_poll(&probe);
    }
    tl_probe_poll(&probe);
    expect_link(3, true, "no new one|stale_s");
    TEST_ASSERT_EQUAL_size_t(3, probe.posts[0]);
    append("8,1,1\n");
    poll_until(4);
    expect_link(4, true, "again");
}

static void test_a_folder_is_no_stream(void) {
    TEST_ASSERT_EQUAL_INT(0, mkdir(path, 0700));
    tl_probe_poll(&probe);
    expect_link(1, false, "directory");
    tl_probe_expect(&probe, 0, 0, TL_NO_LINK);
    TEST_ASSERT_EQUAL_INT(0, rmdir(path));
    put_file("time,u,v\n0,1,2\n");
    tl_probe_poll(&probe);
    tl_probe_expect(&probe, 0, 1, TL_GOOD);
}

/* A device such as /dev/watchdog resets the box if it is opened and closed. */
static void test_a_device_is_not_even_opened(void) {
    char seen[sizeof(struct inotify_event) + NAME_MAX + 1];
    if (mknod(path, S_IFCHR | 0600, makedev(1, 5)) != 0) {
        TEST_IGNORE_MESSAGE("only root makes devices");
    }
    int watch = inotify_init1(IN_NONBLOCK | IN_CLOEXEC);
    TEST_ASSERT_TRUE(inotify_add_watch(watch, path, IN_OPEN) > 0);
    tl_probe_poll(&probe);
    expect_link(1, false, "device|FIFO");
    TEST_ASSERT_EQUAL_INT(-1, read(watch, seen, sizeof seen));
    (void)close(watch);
}

static void test_too_many_columns(void) {
    tl_csv_column columns[TL_MAX_SIGNALS + 1];
    const tl_csv_settings settings = {
        .path = path, .time_column = "time", .columns = columns, .column_count = TL_MAX_SIGNALS + 1};
    for (size_t i = 0; i <= TL_MAX_SIGNALS; i++) {
        columns[i] = (tl_csv_column){"u", 1, 0};
    }
    tl_plant_io *none = NULL;
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, tl_csv_open_live(&settings, &none, &probe.error));
    TEST_ASSERT_NULL(none);
    TL_EXPECT_PARTS("65|64", probe.error.text);
}

/* ---- a FIFO ---- */

static void test_rows_are_posted_as_they_come(void) {
    make_fifo();
    tl_time before = tl_test_now();
    send("time,u,v\n5,1,2\n");
    poll_until(1);
    expect_link(1, true, "rows");
    tl_probe_expect(&probe, 0, 1, TL_GOOD);
    tl_probe_expect(&probe, 1, 2, TL_GOOD);
    TEST_ASSERT_TRUE(tl_probe_newest(&probe, 0)->stamp >= before && tl_probe_newest(&probe, 0)->stamp <= tl_test_now());
    send("5.001,,nan\n");
    tl_test_pause_ms(20); /* later than the time column says; the stamp follows the column */
    tl_time first = tl_probe_newest(&probe, 0)->stamp;
    while (probe.posts[1] < 2) {
        tl_probe_poll(&probe);
    }
    TEST_ASSERT_EQUAL_size_t(1, probe.posts[0]); /* an empty cell is not posted */
    tl_probe_expect(&probe, 1, 0, TL_NOT_A_NUMBER);
    TEST_ASSERT_EQUAL_INT64(first + 1000000, tl_probe_newest(&probe, 1)->stamp);
    TEST_ASSERT_EQUAL_size_t(1, probe.links);
}

static void test_no_stamp_is_in_the_future(void) {
    make_fifo();
    send("time,u,v\n0,1,2\n100,3,4\n200,5,6\n");
    poll_until(3);
    TEST_ASSERT_TRUE(history[0][0].stamp <= history[0][1].stamp);
    TEST_ASSERT_TRUE(history[0][1].stamp <= history[0][2].stamp);
    TEST_ASSERT_TRUE(history[0][2].stamp <= tl_test_now());
}

static void test_a_row_in_pieces(void) {
    make_fifo();
    send("time,u");
    tl_probe_poll(&probe);
    send(",v\r\n0,1");
    tl_probe_poll(&probe);
    TEST_ASSERT_EQUAL_size_t(0, probe.posts[0]);
    send("2,");
    tl_probe_poll(&probe);
    send("7\r");
    tl_probe_poll(&probe);
    TEST_ASSERT_EQUAL_size_t(0, probe.posts[0]);
    send("\n");
    poll_until(1);
    tl_probe_expect(&probe, 0, 12, TL_GOOD);
    tl_probe_expect(&probe, 1, 7, TL_GOOD);
}

static void test_silence_of_a_writer_is_no_trouble(void) {
    make_fifo();
    send("time,u,v\n0,1,2\n");
    poll_until(1);
    tl_probe_poll(&probe);
    tl_probe_poll(&probe);
    /* no new row; the caller of the driver detects stale values */
    TEST_ASSERT_EQUAL_size_t(1, probe.posts[0]);
    TEST_ASSERT_EQUAL_size_t(1, probe.links);
}

static void test_the_writer_goes_and_comes_back(void) {
    make_fifo();
    send("time,u,v\n50,1,2\n51,3"); /* the incomplete row is dropped with its writer */
    poll_until(1);
    leave();
    poll_until(2);
    expect_link(2, false, "closed");
    tl_probe_expect(&probe, 0, 0, TL_NO_LINK);
    tl_probe_expect(&probe, 1, 0, TL_NO_LINK);
    tl_probe_poll(&probe);
    TEST_ASSERT_EQUAL_size_t(3, probe.posts[0]); /* each poll */
    TEST_ASSERT_EQUAL_size_t(2, probe.links);
    tl_time before = tl_test_now();
    send("3,10,20\n"); /* without a header, and time goes back */
    poll_until(4);
    expect_link(3, true, "rows");
    tl_probe_expect(&probe, 0, 10, TL_GOOD);
    tl_probe_expect(&probe, 1, 20, TL_GOOD);
    TEST_ASSERT_TRUE(tl_probe_newest(&probe, 0)->stamp >= before && tl_probe_newest(&probe, 0)->stamp <= tl_test_now());
}

static void test_a_writer_that_comes_back_with_other_columns(void) {
    make_fifo();
    send("time,u,v\n50,1,2\n");
    poll_until(1);
    leave();
    poll_until(2);
    tl_time before = tl_test_now();
    send("v,time,more,u\n4,1,0,3\n");
    poll_until(3);
    tl_probe_expect(&probe, 0, 3, TL_GOOD);
    tl_probe_expect(&probe, 1, 4, TL_GOOD);
    TEST_ASSERT_TRUE(tl_probe_newest(&probe, 0)->stamp >= before);
}

/* If the writer changes between two polls, only the header shows it. */
static void test_a_header_is_a_new_beginning(void) {
    make_fifo();
    send("time,u,v\n50,1,2\n");
    poll_until(1);
    tl_time before = tl_test_now();
    send("time,u,v\n0,3,4\n");
    poll_until(2);
    tl_probe_expect(&probe, 0, 3, TL_GOOD);
    TEST_ASSERT_TRUE(tl_probe_newest(&probe, 0)->stamp >= before);
    TEST_ASSERT_EQUAL_size_t(1, probe.links);
}

static void test_time_that_goes_back_once_is_malformed_twice_is_a_new_beginning(void) {
    make_fifo();
    send("time,u,v\n50,1,2\n49,3,4\n51,5,6\n");
    poll_until(2);
    tl_probe_expect(&probe, 0, 5, TL_GOOD); /* 49 is skipped */
    TEST_ASSERT_EQUAL_size_t(2, probe.links);
    TEST_ASSERT_TRUE(probe.link_up);
    TL_EXPECT_PARTS("line 4|50.000000000 s|49.000000000 s", probe.link_text);
    tl_time before = tl_test_now();
    send("1,7,8\n2,9,10\n");
    poll_until(4);
    TEST_ASSERT_TRUE(history[0][2].stamp >= before);
    TEST_ASSERT_EQUAL_DOUBLE(7, history[0][2].value);
    tl_probe_expect(&probe, 0, 9, TL_GOOD);
    TEST_ASSERT_EQUAL_size_t(3, probe.links);
    TL_EXPECT_PARTS("51.000000000 s|1.000000000 s", probe.link_text);
}

/* The newest report after the path, which may contain numbers. */
static const char *after_path(void) {
    const char *at = strstr(probe.link_text, path);
    return at == NULL ? "" : at + strlen(path);
}

static void test_malformed_rows_are_skipped_and_reported_once_per_second(void) {
    make_fifo();
    send("time,u,v\n0,1\nx,1,2\n0,1,2,3\n0,\"1,2\n\n1,3,4\n");
    poll_until(1);
    tl_probe_expect(&probe, 0, 3, TL_GOOD);
    TEST_ASSERT_TRUE(probe.link_up);
    /* the first malformed row, and the link */
    TEST_ASSERT_TRUE(probe.links >= 2 && probe.links < 5);
    tl_time deadline = tl_test_now() + 30 * TL_SECOND;
    /* until a report counts more than one row */
    for (int i = 0; !tl_test_has_parts(after_path(), "skipped|7") || tl_test_has_parts(after_path(), "1"); i++) {
        char text[32];
        TEST_ASSERT_TRUE(tl_test_now() < deadline);
        (void)snprintf(text, sizeof text, "a,b,c,d,e,f,g\n%d,1,1\n", i + 2);
        send(text);
        poll_until((size_t)i + 2);
        tl_test_pause_ms(20);
    }
    TEST_ASSERT_TRUE(probe.link_up);
    TL_EXPECT_PARTS("7|3", after_path());
}

static void test_rows_without_a_header(void) {
    make_fifo();
    send("0,1,2\n");
    tl_probe_poll(&probe);
    expect_link(1, false, "line 1|\"time\"|0, 1, 2");
    TEST_ASSERT_EQUAL_size_t(0, probe.posts[0]);
    send("time,u,v\n1,3,4\n");
    poll_until(1);
    tl_probe_expect(&probe, 0, 3, TL_GOOD);
    expect_link(2, true, "rows");
}

static void test_a_line_that_is_too_long_is_skipped(void) {
    enum { PIECE = 30000 };
    char *piece = malloc(PIECE + 1);
    TEST_ASSERT_NOT_NULL(piece);
    memset(piece, '1', PIECE);
    piece[PIECE] = '\0';
    make_fifo();
    send("time,u,v\n0,1,2\n");
    poll_until(1);
    for (int i = 0; i < 5; i++) {
        send(piece);
        tl_probe_poll(&probe);
    }
    free(piece);
    expect_link(2, true, "line 3|65536");
    send("\n1,3,4\n");
    poll_until(2);
    tl_probe_expect(&probe, 0, 3, TL_GOOD);
    TEST_ASSERT_EQUAL_size_t(2, probe.links);
}

static void test_a_fifo_that_is_made_again(void) {
    make_fifo();
    TEST_ASSERT_EQUAL_INT(0, unlink(path));
    TEST_ASSERT_EQUAL_INT(0, mkfifo(path, 0600));
    tl_probe_poll(&probe); /* finds the new one */
    send("time,u,v\n0,1,2\n");
    poll_until(probe.posts[0] + 1);
    tl_probe_expect(&probe, 0, 1, TL_GOOD);
}

static void test_a_fifo_that_is_removed(void) {
    make_fifo();
    TEST_ASSERT_EQUAL_INT(0, unlink(path));
    tl_probe_poll(&probe);
    tl_probe_poll(&probe);
    TEST_ASSERT_EQUAL_size_t(0, probe.links); /* the link was down and stays down */
    tl_probe_expect(&probe, 0, 0, TL_NO_LINK);
}

/* ---- interrupt ---- */

static void test_an_interrupt_is_not_lost(void) {
    make_fifo();
    send("time,u,v\n0,1,2\n");
    tl_csv_driver.interrupt(probe.io);
    tl_csv_driver.interrupt(probe.io);
    tl_probe_poll(&probe); /* this one returns at once */
    TEST_ASSERT_EQUAL_size_t(0, probe.posts[0]);
    tl_probe_poll(&probe);
    TEST_ASSERT_EQUAL_size_t(1, probe.posts[0]);
}

/* An interrupt ends one poll only. */
static void test_an_interrupt_ends_one_wait(void) {
    make_fifo();
    send("time,u,v\n0,1,2\n");
    poll_until(1);
    for (bool in_time = false; !in_time;) { /* at least once it is in time */
        pthread_t other = tl_probe_interrupt_after(&probe, 5);
        tl_time begin = tl_test_now();
        tl_probe_poll(&probe);
        in_time = tl_test_now() - begin < 50000000;
        TEST_ASSERT_EQUAL_INT(0, pthread_join(other, NULL));
        if (!in_time) {
            tl_probe_poll(&probe); /* consumes the late interrupt */
        }
    }
    send("1,3,4\n");
    tl_probe_poll(&probe);
    TEST_ASSERT_EQUAL_size_t(2, probe.posts[0]);
    tl_probe_expect(&probe, 0, 3, TL_GOOD);
}

static bool stop; /* atomic */

static void *interrupt_often(void *context) {
    (void)context;
    while (!__atomic_load_n(&stop, __ATOMIC_ACQUIRE)) {
        tl_csv_driver.interrupt(probe.io);
        tl_test_pause_ms(1);
    }
    return NULL;
}

/* For ThreadSanitizer. No row is lost. */
static void test_interrupts_from_another_thread(void) {
    pthread_t other;
    make_fifo();
    send("time,u,v\n");
    __atomic_store_n(&stop, false, __ATOMIC_RELEASE);
    TEST_ASSERT_EQUAL_INT(0, pthread_create(&other, NULL, interrupt_often, NULL));
    for (int i = 0; i < 20; i++) {
        char text[32];
        (void)snprintf(text, sizeof text, "%d,%d,0\n", i, i);
        send(text);
        poll_until((size_t)i + 1);
        tl_probe_expect(&probe, 0, i, TL_GOOD);
    }
    __atomic_store_n(&stop, true, __ATOMIC_RELEASE);
    TEST_ASSERT_EQUAL_INT(0, pthread_join(other, NULL));
}

/* ---- the clock of the rows ---- */

static void test_anchor_keeps_the_rows_time(void) {
    tl_csv_anchor anchor = {.set = false};
    tl_csv_anchor_set(&anchor, 5 * TL_SECOND, 1000 * TL_SECOND);
    TEST_ASSERT_TRUE(anchor.set);
    TEST_ASSERT_EQUAL_INT64(1000 * TL_SECOND, tl_csv_anchor_stamp(&anchor, 5 * TL_SECOND, 1000 * TL_SECOND));
    TEST_ASSERT_EQUAL_INT64(1001 * TL_SECOND, tl_csv_anchor_stamp(&anchor, 6 * TL_SECOND, 1003 * TL_SECOND));
    TEST_ASSERT_EQUAL_INT64(1002 * TL_SECOND, tl_csv_anchor_stamp(&anchor, 7 * TL_SECOND, 1003 * TL_SECOND));
    /* an early one */
    TEST_ASSERT_EQUAL_INT64(1004 * TL_SECOND, tl_csv_anchor_stamp(&anchor, 10 * TL_SECOND, 1004 * TL_SECOND));
    TEST_ASSERT_EQUAL_INT64(1005 * TL_SECOND, tl_csv_anchor_stamp(&anchor, 11 * TL_SECOND, 1006 * TL_SECOND));
}

/* Ten days of rows from a clock with an error of 100 ppm. The error of each stamp stays below the
 * drift of two windows, and stamps never go back. */
static void follow_drift(double rate) {
    tl_csv_anchor anchor = {.set = false};
    tl_time before = INT64_MIN;
    tl_csv_anchor_set(&anchor, 0, 0);
    for (int64_t i = 0; i < 864000; i++) {
        tl_time sent = i * TL_SECOND;
        tl_time arrival = sent + (i * 7919) % 1000 * 1000; /* up to a millisecond later */
        tl_time stamp = tl_csv_anchor_stamp(&anchor, (tl_time)((double)sent * rate), arrival);
        TEST_ASSERT_TRUE(stamp <= arrival);
        TEST_ASSERT_TRUE(stamp >= before);
        TEST_ASSERT_TRUE(sent - stamp < 15000000);
        before = stamp;
    }
}

static void test_anchor_follows_a_fast_clock(void) {
    follow_drift(1.0001);
}

static void test_anchor_follows_a_slow_clock(void) {
    follow_drift(0.9999);
}

int main(void) {
    tl_scratch_make(&scratch, TL_BINARY_DIR, "test_csv_live");
    (void)snprintf(path, sizeof path, "%s", tl_scratch_path(&scratch, "stream"));
    UNITY_BEGIN();
    RUN_TEST(test_a_path_that_comes_later);
    RUN_TEST(test_a_file_is_played_in_its_own_time);
    RUN_TEST(test_a_file_in_another_form);
    RUN_TEST(test_a_cell_that_is_no_number);
    RUN_TEST(test_a_file_without_rows_waits);
    RUN_TEST(test_a_file_without_a_column);
    RUN_TEST(test_malformed_rows_of_a_file_are_skipped);
    RUN_TEST(test_time_of_a_file_that_goes_back);
    RUN_TEST(test_a_file_that_cannot_be_read);
    RUN_TEST(test_a_growing_file_is_followed);
    RUN_TEST(test_a_followed_file_that_is_replaced);
    RUN_TEST(test_old_rows_of_a_new_file_are_not_used_again);
    RUN_TEST(test_a_played_file_that_is_replaced);
    RUN_TEST(test_a_file_that_is_truncated);
    RUN_TEST(test_a_file_that_disappears);
    RUN_TEST(test_a_file_that_does_not_grow_any_more);
    RUN_TEST(test_a_folder_is_no_stream);
    RUN_TEST(test_a_device_is_not_even_opened);
    RUN_TEST(test_too_many_columns);
    RUN_TEST(test_rows_are_posted_as_they_come);
    RUN_TEST(test_no_stamp_is_in_the_future);
    RUN_TEST(test_a_row_in_pieces);
    RUN_TEST(test_silence_of_a_writer_is_no_trouble);
    RUN_TEST(test_the_writer_goes_and_comes_back);
    RUN_TEST(test_a_writer_that_comes_back_with_other_columns);
    RUN_TEST(test_a_header_is_a_new_beginning);
    RUN_TEST(test_time_that_goes_back_once_is_malformed_twice_is_a_new_beginning);
    RUN_TEST(test_malformed_rows_are_skipped_and_reported_once_per_second);
    RUN_TEST(test_rows_without_a_header);
    RUN_TEST(test_a_line_that_is_too_long_is_skipped);
    RUN_TEST(test_a_fifo_that_is_made_again);
    RUN_TEST(test_a_fifo_that_is_removed);
    RUN_TEST(test_an_interrupt_is_not_lost);
    RUN_TEST(test_an_interrupt_ends_one_wait);
    RUN_TEST(test_interrupts_from_another_thread);
    RUN_TEST(test_anchor_keeps_the_rows_time);
    RUN_TEST(test_anchor_follows_a_fast_clock);
    RUN_TEST(test_anchor_follows_a_slow_clock);
    return tl_scratch_finish(&scratch, UNITY_END());
}
