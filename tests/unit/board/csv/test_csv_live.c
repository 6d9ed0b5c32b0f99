/* The live CSV driver: a file in its own time; a FIFO whose writer comes, errs, goes and comes back.
 *
 * Nothing here depends on how fast the machine is: a test waits for what it expects, or says what has come so far.
 */
#include <fcntl.h>
#include <math.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include <unity.h>

#include "board/csv/csv.h"
#include "board/csv/csv_anchor.h"

enum { KEPT = 64 };

static char folder[] = TL_BINARY_DIR "/test_csv_live_XXXXXX";
static char path[sizeof folder + 16];
static tl_plant_io *io;
static int writer;
static tl_error error;

/* What the driver said. */
static tl_reading readings[2][KEPT];
static size_t posts[2];
static size_t links;
static bool link_up;
static char link_text[1024];

static void on_post(void *context, size_t channel, const tl_reading *reading) {
    (void)context;
    TEST_ASSERT_TRUE(channel < 2);
    readings[channel][posts[channel] % KEPT] = *reading;
    posts[channel]++;
}

static void on_link(void *context, bool up, const char *text) {
    (void)context;
    links++;
    link_up = up;
    (void)snprintf(link_text, sizeof link_text, "%s", text);
}

static const tl_plant_io_sink SINK = {.post = on_post, .link = on_link, .context = NULL};

static tl_time now(void) {
    struct timespec time;
    (void)clock_gettime(CLOCK_MONOTONIC, &time);
    return (tl_time)time.tv_sec * TL_SECOND + time.tv_nsec;
}

static void pause_ms(long ms) {
    const struct timespec time = {.tv_sec = 0, .tv_nsec = ms * 1000000};
    (void)nanosleep(&time, NULL);
}

void setUp(void) {
    const char *const columns[] = {"u", "v"};
    const tl_csv_settings settings = {.path = path, .time_column = "time", .columns = columns, .column_count = 2};
    memset(posts, 0, sizeof posts);
    links = 0;
    link_up = false;
    link_text[0] = '\0';
    error = (tl_error){TL_OK, ""};
    writer = -1;
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_csv_open_live(&settings, &io, &error));
}

void tearDown(void) {
    tl_csv_driver.close(io);
    if (writer >= 0) {
        (void)close(writer);
    }
    (void)unlink(path);
}

/* ---- what the tests do ---- */

/* One poll that must go well; returns whether the driver has finished. */
static bool poll_once(void) {
    bool finished = true;
    tl_status status = tl_csv_driver.poll(io, &SINK, &finished, &error);
    TEST_ASSERT_EQUAL_STRING("", error.text);
    TEST_ASSERT_EQUAL_INT(TL_OK, status);
    return finished;
}

/* Polls until channel 0 has that many readings. */
static void poll_until(size_t count) {
    tl_time deadline = now() + 30 * TL_SECOND;
    while (posts[0] < count) {
        TEST_ASSERT_TRUE_MESSAGE(now() < deadline, "the reading did not come");
        (void)poll_once();
    }
}

static void expect_fatal(const char *part) {
    bool finished = true;
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, tl_csv_driver.poll(io, &SINK, &finished, &error));
    TEST_ASSERT_FALSE(finished);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, part), error.text);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, path), error.text);
}

static void expect_link(size_t count, bool up, const char *part) {
    TEST_ASSERT_EQUAL_size_t_MESSAGE(count, links, link_text);
    TEST_ASSERT_EQUAL_INT(up, link_up);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(link_text, part), link_text);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(link_text, path), link_text);
}

static const tl_reading *last(size_t channel) {
    TEST_ASSERT_TRUE(posts[channel] > 0);
    return &readings[channel][(posts[channel] - 1) % KEPT];
}

static void expect_last(size_t channel, double value, tl_quality quality) {
    TEST_ASSERT_EQUAL_INT(quality, last(channel)->quality);
    TEST_ASSERT_EQUAL_DOUBLE(value, last(channel)->value);
}

static void put_file(const char *text) {
    FILE *file = fopen(path, "wb");
    TEST_ASSERT_NOT_NULL(file);
    TEST_ASSERT_TRUE(fputs(text, file) >= 0);
    TEST_ASSERT_EQUAL_INT(0, fclose(file));
}

/* Makes the FIFO; the driver has it open afterwards, so that a writer can come. */
static void make_fifo(void) {
    TEST_ASSERT_EQUAL_INT(0, mkfifo(path, 0600));
    (void)poll_once();
    expect_link(1, false, "nobody writes to it");
    TEST_ASSERT_EQUAL_size_t(1, posts[0]);
    expect_last(0, 0, TL_NO_LINK);
    expect_last(1, 0, TL_NO_LINK);
    posts[0] = 0;
    posts[1] = 0;
    links = 0;
}

static void send(const char *text) {
    if (writer < 0) {
        writer = open(path, O_WRONLY | O_NONBLOCK);
        TEST_ASSERT_TRUE_MESSAGE(writer >= 0, "nobody reads the FIFO");
    }
    TEST_ASSERT_EQUAL_INT((int)strlen(text), (int)write(writer, text, strlen(text)));
}

static void leave(void) {
    TEST_ASSERT_EQUAL_INT(0, close(writer));
    writer = -1;
}

/* ---- a regular file ---- */

static void test_a_path_that_comes_later(void) {
    TEST_ASSERT_FALSE(poll_once());
    expect_link(1, false, "No such file");
    expect_last(0, 0, TL_NO_LINK);
    TEST_ASSERT_FALSE(poll_once());
    TEST_ASSERT_EQUAL_size_t(1, links);
    TEST_ASSERT_EQUAL_size_t(2, posts[0]);
    TEST_ASSERT_EQUAL_size_t(2, posts[1]);
    put_file("time,u,v\n0,1,2\n");
    TEST_ASSERT_TRUE(poll_once());
    expect_link(2, true, "open");
    expect_last(0, 1, TL_GOOD);
    expect_last(1, 2, TL_GOOD);
}

static void test_a_file_is_played_in_its_own_time(void) {
    put_file("time,u,v\n10,1,2\n10.03,3,4\n10.06,5,");
    tl_time before = now();
    TEST_ASSERT_FALSE(poll_once());
    tl_time after = now();
    if (after < before + 30000000) {
        TEST_ASSERT_EQUAL_size_t(1, posts[0]); /* the second is not due yet */
    }
    expect_link(1, true, "open");
    while (!poll_once()) {
        pause_ms(1);
    }
    TEST_ASSERT_TRUE(now() >= before + 60000000);
    TEST_ASSERT_EQUAL_size_t(3, posts[0]);
    TEST_ASSERT_EQUAL_size_t(2, posts[1]); /* an empty cell is no news */
    TEST_ASSERT_TRUE(readings[0][0].stamp >= before && readings[0][0].stamp <= after);
    TEST_ASSERT_EQUAL_INT64(readings[0][0].stamp + 30000000, readings[0][1].stamp);
    TEST_ASSERT_EQUAL_INT64(readings[0][0].stamp + 60000000, readings[0][2].stamp);
    expect_last(0, 5, TL_GOOD);
    expect_last(1, 4, TL_GOOD);
    TEST_ASSERT_EQUAL_size_t(1, links);
}

static void test_a_cell_that_is_no_number(void) {
    put_file("time,u,v\n0,nan,1\n");
    TEST_ASSERT_TRUE(poll_once());
    expect_last(0, 0, TL_NOT_A_NUMBER);
    expect_last(1, 1, TL_GOOD);
}

static void test_a_file_without_rows_ends(void) {
    put_file("time,u,v\n");
    TEST_ASSERT_TRUE(poll_once());
    TEST_ASSERT_EQUAL_size_t(0, posts[0]);
}

static void test_an_empty_file(void) {
    put_file("");
    expect_fatal("is empty");
}

static void test_a_file_without_a_column(void) {
    put_file("time,u,w\n0,1,1\n");
    expect_fatal("there is no column \"v\", but: time, u, w");
}

static void test_a_malformed_row_of_a_file(void) {
    put_file("time,u,v\n0,1\n");
    expect_fatal("line 2: 2 cells");
}

static void test_time_of_a_file_must_increase(void) {
    put_file("time,u,v\n1,1,1\n1,1,1\n");
    expect_fatal("line 3: the time is 1.000000000 s, which is not after 1.000000000 s");
    TEST_ASSERT_EQUAL_size_t(1, posts[0]);
}

static void test_a_line_of_a_file_that_is_too_long(void) {
    char *text = malloc(70001);
    TEST_ASSERT_NOT_NULL(text);
    memset(text, 'x', 70000);
    text[70000] = '\0';
    put_file(text);
    free(text);
    expect_fatal("line 1: the line is longer");
}

static void test_a_folder_is_no_stream(void) {
    TEST_ASSERT_EQUAL_INT(0, mkdir(path, 0700));
    TEST_ASSERT_FALSE(poll_once());
    expect_link(1, false, "directory");
    expect_last(0, 0, TL_NO_LINK);
    TEST_ASSERT_EQUAL_INT(0, rmdir(path));
    put_file("time,u,v\n0,1,2\n");
    TEST_ASSERT_TRUE(poll_once());
    expect_last(0, 1, TL_GOOD);
}

static void test_too_many_columns(void) {
    const char *columns[TL_MAX_SIGNALS + 1];
    const tl_csv_settings settings = {
        .path = path, .time_column = "time", .columns = columns, .column_count = TL_MAX_SIGNALS + 1};
    for (size_t i = 0; i <= TL_MAX_SIGNALS; i++) {
        columns[i] = "u";
    }
    tl_plant_io *none = NULL;
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, tl_csv_open_live(&settings, &none, &error));
    TEST_ASSERT_NULL(none);
    TEST_ASSERT_NOT_NULL(strstr(error.text, "65 columns"));
}

/* ---- a FIFO ---- */

static void test_rows_are_posted_as_they_come(void) {
    make_fifo();
    tl_time before = now();
    send("time,u,v\n5,1,2\n");
    poll_until(1);
    expect_link(1, true, "rows are coming");
    expect_last(0, 1, TL_GOOD);
    expect_last(1, 2, TL_GOOD);
    TEST_ASSERT_TRUE(last(0)->stamp >= before && last(0)->stamp <= now());
    send("5.001,,nan\n");
    pause_ms(20); /* much later than its time says: it keeps its own */
    tl_time first = last(0)->stamp;
    while (posts[1] < 2) {
        (void)poll_once();
    }
    TEST_ASSERT_EQUAL_size_t(1, posts[0]); /* an empty cell is no news */
    expect_last(1, 0, TL_NOT_A_NUMBER);
    TEST_ASSERT_EQUAL_INT64(first + 1000000, last(1)->stamp);
    TEST_ASSERT_EQUAL_size_t(1, links);
}

static void test_no_stamp_is_in_the_future(void) {
    make_fifo();
    send("time,u,v\n0,1,2\n100,3,4\n200,5,6\n");
    poll_until(3);
    TEST_ASSERT_TRUE(readings[0][0].stamp <= readings[0][1].stamp);
    TEST_ASSERT_TRUE(readings[0][1].stamp <= readings[0][2].stamp);
    TEST_ASSERT_TRUE(readings[0][2].stamp <= now());
}

static void test_a_row_in_pieces(void) {
    make_fifo();
    send("time,u");
    (void)poll_once();
    send(",v\r\n0,1");
    (void)poll_once();
    TEST_ASSERT_EQUAL_size_t(0, posts[0]);
    send("2,");
    (void)poll_once();
    send("7\r");
    (void)poll_once();
    TEST_ASSERT_EQUAL_size_t(0, posts[0]);
    send("\n");
    poll_until(1);
    expect_last(0, 12, TL_GOOD);
    expect_last(1, 7, TL_GOOD);
}

static void test_silence_of_a_writer_is_no_trouble(void) {
    make_fifo();
    send("time,u,v\n0,1,2\n");
    poll_until(1);
    (void)poll_once();
    (void)poll_once();
    TEST_ASSERT_EQUAL_size_t(1, posts[0]); /* nothing new: how old is too old is judged above */
    TEST_ASSERT_EQUAL_size_t(1, links);
}

static void test_the_writer_goes_and_comes_back(void) {
    make_fifo();
    send("time,u,v\n50,1,2\n51,3"); /* the piece of a row is lost with its writer */
    poll_until(1);
    leave();
    poll_until(2);
    expect_link(2, false, "its writer has closed it");
    expect_last(0, 0, TL_NO_LINK);
    expect_last(1, 0, TL_NO_LINK);
    (void)poll_once();
    TEST_ASSERT_EQUAL_size_t(3, posts[0]); /* each poll */
    TEST_ASSERT_EQUAL_size_t(2, links);
    tl_time before = now();
    send("3,10,20\n"); /* without a header, and time goes back */
    poll_until(4);
    expect_link(3, true, "rows are coming");
    expect_last(0, 10, TL_GOOD);
    expect_last(1, 20, TL_GOOD);
    TEST_ASSERT_TRUE(last(0)->stamp >= before && last(0)->stamp <= now());
}

static void test_a_writer_that_comes_back_with_other_columns(void) {
    make_fifo();
    send("time,u,v\n50,1,2\n");
    poll_until(1);
    leave();
    poll_until(2);
    tl_time before = now();
    send("v,time,more,u\n4,1,0,3\n");
    poll_until(3);
    expect_last(0, 3, TL_GOOD);
    expect_last(1, 4, TL_GOOD);
    TEST_ASSERT_TRUE(last(0)->stamp >= before);
}

/* The change of writers happens between two polls: only the header tells. */
static void test_a_header_is_a_new_beginning(void) {
    make_fifo();
    send("time,u,v\n50,1,2\n");
    poll_until(1);
    tl_time before = now();
    send("time,u,v\n0,3,4\n");
    poll_until(2);
    expect_last(0, 3, TL_GOOD);
    TEST_ASSERT_TRUE(last(0)->stamp >= before);
    TEST_ASSERT_EQUAL_size_t(1, links);
}

static void test_time_that_goes_back_once_is_malformed_twice_is_a_new_beginning(void) {
    make_fifo();
    send("time,u,v\n50,1,2\n49,3,4\n51,5,6\n51,7,8\n");
    poll_until(2);
    expect_last(0, 5, TL_GOOD); /* 49 was left out, and so is the second 51 */
    TEST_ASSERT_EQUAL_size_t(2, links);
    TEST_ASSERT_TRUE(link_up);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(link_text, "line 3: the time goes back from 50.000000000 s"), link_text);
    tl_time before = now();
    send("1,9,10\n2,11,12\n");
    poll_until(4);
    TEST_ASSERT_TRUE(readings[0][2].stamp >= before);
    expect_last(0, 11, TL_GOOD);
}

static void test_malformed_rows_are_skipped_and_told_once_per_second(void) {
    make_fifo();
    send("time,u,v\n0,1\nx,1,2\n0,1,2,3\n0,\"1,2\n\n1,3,4\n");
    poll_until(1);
    expect_last(0, 3, TL_GOOD);
    TEST_ASSERT_TRUE(link_up);
    TEST_ASSERT_TRUE(links >= 2 && links < 5); /* the first of them, the link; not each of them */
    tl_time deadline = now() + 30 * TL_SECOND;
    for (int i = 0; strstr(link_text, "(skipped; ") == NULL || strstr(link_text, "; 1 since") != NULL; i++) {
        char text[32];
        TEST_ASSERT_TRUE(now() < deadline);
        (void)snprintf(text, sizeof text, "bad\n%d,1,1\n", i + 2);
        send(text);
        poll_until((size_t)i + 2);
        pause_ms(20);
    }
    TEST_ASSERT_TRUE(link_up);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(link_text, "1 cells, but the header has 3"), link_text);
}

static void test_rows_without_a_header(void) {
    make_fifo();
    send("0,1,2\n");
    (void)poll_once();
    expect_link(1, false, "there is no column \"time\"");
    TEST_ASSERT_EQUAL_size_t(0, posts[0]);
    send("time,u,v\n1,3,4\n");
    poll_until(1);
    expect_last(0, 3, TL_GOOD);
    expect_link(2, true, "rows are coming");
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
        (void)poll_once();
    }
    free(piece);
    expect_link(2, true, "line 3: the line is longer than 65536 bytes");
    send("\n1,3,4\n");
    poll_until(2);
    expect_last(0, 3, TL_GOOD);
    TEST_ASSERT_EQUAL_size_t(2, links);
}

static void test_a_fifo_that_is_made_again(void) {
    make_fifo();
    TEST_ASSERT_EQUAL_INT(0, unlink(path));
    TEST_ASSERT_EQUAL_INT(0, mkfifo(path, 0600));
    (void)poll_once(); /* finds the new one */
    send("time,u,v\n0,1,2\n");
    poll_until(posts[0] + 1);
    expect_last(0, 1, TL_GOOD);
}

static void test_a_fifo_that_is_removed(void) {
    make_fifo();
    TEST_ASSERT_EQUAL_INT(0, unlink(path));
    (void)poll_once();
    (void)poll_once();
    TEST_ASSERT_EQUAL_size_t(0, links); /* it was down, and is */
    expect_last(0, 0, TL_NO_LINK);
}

/* ---- interrupt ---- */

static void test_an_interrupt_is_not_lost(void) {
    make_fifo();
    send("time,u,v\n0,1,2\n");
    tl_csv_driver.interrupt(io);
    tl_csv_driver.interrupt(io);
    (void)poll_once(); /* this one returns at once */
    TEST_ASSERT_EQUAL_size_t(0, posts[0]);
    (void)poll_once();
    TEST_ASSERT_EQUAL_size_t(1, posts[0]);
}

static void *interrupt_soon(void *context) {
    (void)context;
    pause_ms(5);
    tl_csv_driver.interrupt(io);
    return NULL;
}

/* The poll that an interrupt ends is the only one that it ends. */
static void test_an_interrupt_ends_one_wait(void) {
    make_fifo();
    send("time,u,v\n0,1,2\n");
    poll_until(1);
    for (bool in_time = false; !in_time;) { /* once it must be */
        pthread_t other;
        TEST_ASSERT_EQUAL_INT(0, pthread_create(&other, NULL, interrupt_soon, NULL));
        tl_time begin = now();
        (void)poll_once();
        in_time = now() - begin < 50000000;
        TEST_ASSERT_EQUAL_INT(0, pthread_join(other, NULL));
        if (!in_time) {
            (void)poll_once(); /* takes notice of the one that came too late */
        }
    }
    send("1,3,4\n");
    (void)poll_once();
    TEST_ASSERT_EQUAL_size_t(2, posts[0]);
    expect_last(0, 3, TL_GOOD);
}

static bool stop; /* atomic */

static void *interrupt_often(void *context) {
    (void)context;
    while (!__atomic_load_n(&stop, __ATOMIC_ACQUIRE)) {
        tl_csv_driver.interrupt(io);
        pause_ms(1);
    }
    return NULL;
}

/* For ThreadSanitizer; and nothing is lost. */
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
        expect_last(0, i, TL_GOOD);
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

/* Ten days of rows from a clock that is wrong by 100 parts in a million: stamps stay within what it drifts in two
 * windows, and never go back. */
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
    if (mkdtemp(folder) == NULL) {
        return 1;
    }
    (void)snprintf(path, sizeof path, "%s/stream", folder);
    UNITY_BEGIN();
    RUN_TEST(test_a_path_that_comes_later);
    RUN_TEST(test_a_file_is_played_in_its_own_time);
    RUN_TEST(test_a_cell_that_is_no_number);
    RUN_TEST(test_a_file_without_rows_ends);
    RUN_TEST(test_an_empty_file);
    RUN_TEST(test_a_file_without_a_column);
    RUN_TEST(test_a_malformed_row_of_a_file);
    RUN_TEST(test_time_of_a_file_must_increase);
    RUN_TEST(test_a_line_of_a_file_that_is_too_long);
    RUN_TEST(test_a_folder_is_no_stream);
    RUN_TEST(test_too_many_columns);
    RUN_TEST(test_rows_are_posted_as_they_come);
    RUN_TEST(test_no_stamp_is_in_the_future);
    RUN_TEST(test_a_row_in_pieces);
    RUN_TEST(test_silence_of_a_writer_is_no_trouble);
    RUN_TEST(test_the_writer_goes_and_comes_back);
    RUN_TEST(test_a_writer_that_comes_back_with_other_columns);
    RUN_TEST(test_a_header_is_a_new_beginning);
    RUN_TEST(test_time_that_goes_back_once_is_malformed_twice_is_a_new_beginning);
    RUN_TEST(test_malformed_rows_are_skipped_and_told_once_per_second);
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
    int failures = UNITY_END();
    (void)rmdir(folder);
    return failures;
}
