/* The emulated plant stream: rows in a file or a FIFO, and dropped rows. */
#include <fcntl.h>
#include <math.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include <unity.h>

#include "board/csv/csv.h"
#include "firmware/base/os.h"
#include "firmware/cli/plant_stream.h"
#include "tests/support/message.h"
#include "tests/support/scratch.h"

static tl_scratch scratch;
static char path[PATH_MAX];
static tl_plant_stream *stream;
static int reader;
static tl_error error;

static const char *const UV[] = {"u", "v"};
static const tl_csv_column CELLS[] = {{"u", 1, 0}, {"v", 1, 0}};

void setUp(void) {
    stream = NULL;
    reader = -1;
    error = (tl_error){TL_OK, ""};
}

static void close_reader(void) {
    if (reader >= 0) {
        TEST_ASSERT_EQUAL_INT(0, close(reader));
        reader = -1;
    }
}

static void close_stream(void) {
    if (stream != NULL) {
        tl_plant_stream_close(stream);
        stream = NULL;
    }
}

void tearDown(void) {
    close_stream();
    close_reader();
    tl_scratch_empty(&scratch);
}

static tl_status open_stream(const char *where, bool make_fifo, const char *const *columns, size_t count) {
    const tl_plant_stream_settings settings = {
        .path = where, .make_fifo = make_fifo, .time_column = "time", .columns = columns, .column_count = count};
    return tl_plant_stream_open(&settings, &stream, &error);
}

static void expect_open(bool make_fifo, const char *const *columns, size_t count) {
    tl_status status = open_stream(path, make_fifo, columns, count);
    TEST_ASSERT_EQUAL_STRING("", error.text);
    TEST_ASSERT_EQUAL_INT(TL_OK, status);
}

static bool row(tl_time time, double u, double v) {
    const double values[] = {u, v};
    return tl_plant_stream_row(stream, time, values, NULL);
}

static void expect_counts(uint64_t written, uint64_t dropped) {
    TEST_ASSERT_EQUAL_UINT64(written, tl_plant_stream_count(stream).written);
    TEST_ASSERT_EQUAL_UINT64(dropped, tl_plant_stream_count(stream).dropped);
}

static void open_reader(void) {
    reader = open(path, O_RDONLY | O_NONBLOCK | O_CLOEXEC);
    TEST_ASSERT_TRUE(reader >= 0);
}

/* Returns the present content of the FIFO. The caller frees it. */
static char *read_all(void) {
    size_t size = 0;
    char *text = malloc(1 << 20);
    TEST_ASSERT_NOT_NULL(text);
    for (;;) {
        ssize_t count = read(reader, text + size, (1 << 20) - size - 1);
        if (count <= 0) {
            text[size] = '\0';
            return text;
        }
        size += (size_t)count;
    }
}

static void expect_read(const char *expected) {
    char *text = read_all();
    TEST_ASSERT_EQUAL_STRING(expected, text);
    free(text);
}

/* ---- a file ---- */

static void expect_file(const char *expected) {
    close_stream();
    reader = open(path, O_RDONLY | O_CLOEXEC);
    TEST_ASSERT_TRUE(reader >= 0);
    expect_read(expected);
}

static void test_a_file(void) {
    const double values[] = {1, 2};
    const bool present[] = {false, true};
    expect_open(false, UV, 2);
    TEST_ASSERT_TRUE(row(0, 0.1, -2));
    TEST_ASSERT_TRUE(row(1234567890, 1e300, 0));
    TEST_ASSERT_TRUE(row(-1500000000, (double)NAN, HUGE_VAL));
    TEST_ASSERT_TRUE(tl_plant_stream_row(stream, 2 * TL_SECOND, values, present));
    expect_counts(4, 0);
    expect_file("time,u,v\n0.000000000,0.10000000000000001,-2\n1.234567890,1.0000000000000001e+300,0\n"
                "-1.500000000,,\n2.000000000,,2\n");
}

static void test_a_file_without_rows_has_its_header(void) {
    expect_open(false, UV, 2);
    expect_file("time,u,v\n");
}

static void test_time_alone(void) {
    expect_open(false, NULL, 0);
    TEST_ASSERT_TRUE(tl_plant_stream_row(stream, TL_SECOND, NULL, NULL));
    expect_file("time\n1.000000000\n");
}

static void test_names_that_need_quotes(void) {
    const char *const columns[] = {"a, b", "say \"x\"", "plain.name"};
    expect_open(false, columns, 3);
    expect_file("time,\"a, b\",\"say \"\"x\"\"\",plain.name\n");
}

/* Numbers are written and read without loss: the same bits. */
static void test_numbers_come_back(void) {
    const tl_csv_settings settings = {.path = path, .time_column = "time", .columns = CELLS, .column_count = 2};
    const double values[] = {0.1, -1.0 / 3.0, 5e-324, 1.7976931348623157e308, -0.0, 123456789.123456789};
    const tl_time times[] = {INT64_C(-4500000000123456789), -1, 0, 1, 999999999, INT64_C(1234567123456789)};
    tl_csv_reader *csv = NULL;
    tl_csv_row got;
    bool end = true;
    expect_open(false, UV, 2);
    for (size_t i = 0; i < 6; i++) {
        TEST_ASSERT_TRUE(row(times[i], values[i], values[5 - i]));
    }
    close_stream();
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_csv_open(&settings, &csv, &error));
    for (size_t i = 0; i < 6; i++) {
        TEST_ASSERT_EQUAL_INT(TL_OK, tl_csv_next(csv, &got, &end, &error));
        TEST_ASSERT_FALSE(end);
        if (i > 0) { /* the first time has more digits than a double */
            TEST_ASSERT_EQUAL_INT64(times[i], got.time);
        }
        TEST_ASSERT_EQUAL_MEMORY(&values[i], &got.values[0], sizeof(double));
        TEST_ASSERT_EQUAL_MEMORY(&values[5 - i], &got.values[1], sizeof(double));
    }
    tl_csv_close(csv);
}

static void expect_refused(tl_status status, const char *parts) {
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, status);
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, error.status);
    TEST_ASSERT_NULL(stream);
    TL_EXPECT_PARTS(parts, error.text);
}

/* Limits the size of files, so that a write fails as on a full disk, but with another errno. */
static void limit_files(rlim_t size) {
    struct rlimit limit;
    TEST_ASSERT_EQUAL_INT(0, getrlimit(RLIMIT_FSIZE, &limit));
    limit.rlim_cur = size;
    TEST_ASSERT_EQUAL_INT(0, setrlimit(RLIMIT_FSIZE, &limit));
}

static void test_a_file_that_cannot_grow(void) {
    (void)signal(SIGXFSZ, SIG_IGN);
    expect_open(false, UV, 2);
    TEST_ASSERT_TRUE(row(0, 1, 2));
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_plant_stream_check(stream, &error));
    limit_files(30); /* the header, one row, and a part of the next row */
    bool written = row(TL_SECOND, 3, 4);
    limit_files(RLIM_INFINITY);
    TEST_ASSERT_FALSE(written);
    expect_counts(1, 1);
    TEST_ASSERT_EQUAL_INT(TL_TRY_AGAIN, tl_plant_stream_check(stream, &error));
    TL_EXPECT_PARTS("stream|File too large|1", error.text);
    close_stream();
    (void)unlink(path);
    limit_files(5); /* not even the header */
    tl_status status = open_stream(path, false, UV, 2);
    limit_files(RLIM_INFINITY);
    TEST_ASSERT_EQUAL_INT(TL_TRY_AGAIN, status);
    TEST_ASSERT_NULL(stream);
}

static void test_a_file_that_exists_is_not_overwritten(void) {
    FILE *file = fopen(path, "wb");
    TEST_ASSERT_NOT_NULL(file);
    TEST_ASSERT_TRUE(fputs("a recording", file) >= 0);
    TEST_ASSERT_EQUAL_INT(0, fclose(file));
    expect_refused(open_stream(path, false, UV, 2), "stream|remove|mkfifo");
    expect_refused(open_stream(path, true, UV, 2), "stream|remove");
    expect_file("a recording");
}

static void test_a_folder_that_is_not_there(void) {
    char nowhere[sizeof path + 16];
    (void)snprintf(nowhere, sizeof nowhere, "%s/no/stream", scratch.folder);
    expect_refused(open_stream(nowhere, false, UV, 2), "no/stream|No such file");
    expect_refused(open_stream(nowhere, true, UV, 2), "no/stream|FIFO|No such file");
}

/* ---- a FIFO ---- */

static void test_a_fifo_is_made_or_found(void) {
    struct stat what;
    expect_open(true, UV, 2);
    TEST_ASSERT_EQUAL_INT(0, stat(path, &what));
    TEST_ASSERT_TRUE(S_ISFIFO(what.st_mode));
    close_stream();
    expect_open(true, UV, 2);
    close_stream();
    expect_open(false, UV, 2);
    open_reader();
    TEST_ASSERT_TRUE(row(0, 1, 2));
    expect_read("time,u,v\n0.000000000,1,2\n");
}

static void test_a_fifo_without_reader_is_no_failure(void) {
    expect_open(true, UV, 2);
    TEST_ASSERT_FALSE(row(0, 1, 2));
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_plant_stream_check(stream, &error));
    open_reader();
    TEST_ASSERT_TRUE(row(TL_SECOND, 3, 4));
    close_reader();
    TEST_ASSERT_FALSE(row(2 * TL_SECOND, 5, 6));
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_plant_stream_check(stream, &error));
}

static void test_readers_come_and_go(void) {
    expect_open(true, UV, 2);
    TEST_ASSERT_FALSE(row(0, 1, 1)); /* no reader yet */
    open_reader();
    TEST_ASSERT_TRUE(row(1 * TL_SECOND, 2, 2));
    TEST_ASSERT_TRUE(row(2 * TL_SECOND, 3, 3));
    expect_read("time,u,v\n1.000000000,2,2\n2.000000000,3,3\n");
    close_reader();
    TEST_ASSERT_FALSE(row(3 * TL_SECOND, 4, 4)); /* without SIGPIPE */
    TEST_ASSERT_FALSE(row(4 * TL_SECOND, 5, 5));
    open_reader();
    TEST_ASSERT_TRUE(row(5 * TL_SECOND, 6, 6));
    expect_read("time,u,v\n5.000000000,6,6\n");
    expect_counts(3, 3);
}

/* As many columns as a plant can have. */
static const char *WIDE[TL_MAX_SIGNALS];

static void make_wide_names(void) {
    static char names[TL_MAX_SIGNALS][16];
    for (int i = 0; i < TL_MAX_SIGNALS; i++) {
        (void)snprintf(names[i], sizeof names[i], "c%d", i);
        WIDE[i] = names[i];
    }
}

/* Each value is the row's number plus 1/7. */
static bool numbered_row(int number, size_t columns) {
    double values[TL_MAX_SIGNALS];
    for (size_t i = 0; i < columns; i++) {
        values[i] = number + 1.0 / 7.0;
    }
    return tl_plant_stream_row(stream, number * TL_SECOND, values, NULL);
}

/* Each line after the header is a whole row. The row numbers equal `written`, in order. */
static void expect_whole_rows(char *text, const int *written, int count, size_t columns) {
    int line = -1;
    for (char *rest = NULL, *at = strtok_r(text, "\n", &rest); at != NULL; at = strtok_r(NULL, "\n", &rest), line++) {
        size_t commas = 0;
        for (const char *c = at; *c != '\0'; c++) {
            commas += *c == ',' ? 1 : 0;
        }
        TEST_ASSERT_EQUAL_size_t(columns, commas);
        if (line >= 0) {
            char expected[64];
            TEST_ASSERT_TRUE(line < count);
            (void)snprintf(expected, sizeof expected, "%d.000000000,", written[line]);
            TEST_ASSERT_EQUAL_STRING_LEN(expected, at, strlen(expected));
            (void)snprintf(expected, sizeof expected, ",%.17g", written[line] + 1.0 / 7.0);
            TEST_ASSERT_EQUAL_STRING(expected, at + strlen(at) - strlen(expected));
        }
    }
    TEST_ASSERT_EQUAL_INT(count, line);
}

/* Appends the present content of the FIFO. */
static void read_more(char *text, size_t size) {
    char *more = read_all();
    TEST_ASSERT_TRUE(strlen(text) + strlen(more) < size);
    memcpy(text + strlen(text), more, strlen(more) + 1);
    free(more);
}

static void fill_and_empty(size_t columns) {
    enum { ROWS = 30000, SIZE = 1 << 20 };
    static int written[ROWS];
    static char text[SIZE];
    int count = 0;
    int number = 0;
    text[0] = '\0';
    expect_open(true, WIDE, columns);
    open_reader();
    for (int round = 0; round < 3; round++) {
        int dropped = 0;
        for (; dropped < 2; number++) {
            TEST_ASSERT_TRUE(number < ROWS);
            tl_time begin = tl_clock_now(NULL);
            if (numbered_row(number, columns)) {
                written[count++] = number;
            } else {
                dropped++;
            }
            TEST_ASSERT_TRUE(tl_clock_now(NULL) - begin < 10 * TL_SECOND);
        }
        read_more(text, SIZE);
    }
    TEST_ASSERT_TRUE(numbered_row(number, columns));
    written[count++] = number;
    read_more(text, SIZE);
    expect_counts((uint64_t)count, 6);
    expect_whole_rows(text, written, count, columns);
}

static void test_a_reader_that_does_not_read(void) {
    fill_and_empty(2);
}

static void test_a_reader_that_does_not_read_wide_rows(void) {
    fill_and_empty(TL_MAX_SIGNALS);
}

static void test_a_reader_that_leaves_while_the_pipe_is_full(void) {
    expect_open(true, WIDE, TL_MAX_SIGNALS);
    open_reader();
    int number = 0;
    while (numbered_row(number, TL_MAX_SIGNALS)) {
        number++;
    }
    close_reader();
    TEST_ASSERT_FALSE(numbered_row(++number, TL_MAX_SIGNALS));
    open_reader();
    TEST_ASSERT_TRUE(numbered_row(++number, TL_MAX_SIGNALS));
    char *text = read_all();
    TEST_ASSERT_EQUAL_STRING_LEN("time,c0,c1,", text, 11);
    expect_whole_rows(text, &number, 1, TL_MAX_SIGNALS);
    free(text);
}

/* ---- with the live driver ---- */

static double last_value;
static tl_quality last_quality;

static void on_post(void *context, size_t channel, const tl_reading *reading) {
    (void)context;
    (void)channel;
    last_value = reading->value;
    last_quality = reading->quality;
}

static void on_link(void *context, bool up, const char *text) {
    (void)context;
    (void)up;
    (void)text;
}

static void test_the_live_driver_reads_it(void) {
    const tl_csv_settings settings = {.path = path, .time_column = "time", .columns = CELLS, .column_count = 1};
    const tl_plant_io_sink sink = {.post = on_post, .link = on_link};
    tl_plant_io *io = NULL;
    expect_open(true, UV, 2);
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_csv_open_live(&settings, &io, &error));
    for (int i = 0; i < 4; i++) {
        if (i % 2 == 0) { /* the plant restarts */
            close_stream();
            expect_open(true, UV, 2);
        }
        last_quality = TL_NO_LINK;
        for (int polls = 0; polls < 200 && last_quality != TL_GOOD; polls++) {
            (void)row(tl_clock_now(NULL), i, 0);
            tl_csv_driver.poll(io, &sink);
        }
        TEST_ASSERT_EQUAL_INT(TL_GOOD, last_quality);
        TEST_ASSERT_EQUAL_DOUBLE(i, last_value);
    }
    tl_csv_driver.close(io);
}

int main(void) {
    tl_scratch_make(&scratch, TL_BINARY_DIR, "test_plant_stream");
    (void)snprintf(path, sizeof path, "%s", tl_scratch_path(&scratch, "stream"));
    make_wide_names();
    UNITY_BEGIN();
    RUN_TEST(test_a_file);
    RUN_TEST(test_a_file_without_rows_has_its_header);
    RUN_TEST(test_time_alone);
    RUN_TEST(test_names_that_need_quotes);
    RUN_TEST(test_numbers_come_back);
    RUN_TEST(test_a_file_that_cannot_grow);
    RUN_TEST(test_a_file_that_exists_is_not_overwritten);
    RUN_TEST(test_a_folder_that_is_not_there);
    RUN_TEST(test_a_fifo_is_made_or_found);
    RUN_TEST(test_a_fifo_without_reader_is_no_failure);
    RUN_TEST(test_readers_come_and_go);
    RUN_TEST(test_a_reader_that_does_not_read);
    RUN_TEST(test_a_reader_that_does_not_read_wide_rows);
    RUN_TEST(test_a_reader_that_leaves_while_the_pipe_is_full);
    RUN_TEST(test_the_live_driver_reads_it);
    return tl_scratch_finish(&scratch, UNITY_END());
}
