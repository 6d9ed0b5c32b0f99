/* The CSV reader: rows, errors, and the values that error messages name. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include <unity.h>

#include "board/csv/csv.h"
#include "board/csv/csv_table.h"
#include "tests/support/message.h"
#include "tests/support/scratch.h"

static tl_scratch scratch;
static char path[PATH_MAX];
static tl_csv_reader *reader;
static tl_csv_row row;
static tl_error error;

static const tl_csv_column UV[] = {{"u", 1, 0}, {"v", 1, 0}};

void setUp(void) {
    reader = NULL;
    error = (tl_error){TL_OK, ""};
    memset(&row, 0xA5, sizeof row);
}

static void close_reader(void) {
    if (reader != NULL) {
        tl_csv_close(reader);
        reader = NULL;
    }
}

void tearDown(void) {
    close_reader();
    tl_scratch_empty(&scratch);
}

static void put(const char *bytes, size_t size) {
    FILE *file = fopen(path, "wb");
    TEST_ASSERT_NOT_NULL(file);
    TEST_ASSERT_EQUAL_size_t(size, fwrite(bytes, 1, size, file));
    TEST_ASSERT_EQUAL_INT(0, fclose(file));
}

/* Writes the text to the file and opens it for the columns u and v. */
static tl_status open_text(const char *text) {
    const tl_csv_settings settings = {.path = path, .time_column = "time", .columns = UV, .column_count = 2};
    close_reader();
    error = (tl_error){TL_OK, ""};
    put(text, strlen(text));
    return tl_csv_open(&settings, &reader, &error);
}

static void expect_open(const char *text) {
    tl_status status = open_text(text);
    TEST_ASSERT_EQUAL_STRING("", error.text);
    TEST_ASSERT_EQUAL_INT(TL_OK, status);
}

static void next(void) {
    bool end = true;
    tl_status status = tl_csv_next(reader, &row, &end, &error);
    TEST_ASSERT_EQUAL_STRING("", error.text);
    TEST_ASSERT_EQUAL_INT(TL_OK, status);
    TEST_ASSERT_FALSE(end);
}

static void expect_row(tl_time time, double u, double v) {
    next();
    TEST_ASSERT_EQUAL_INT64(time, row.time);
    TEST_ASSERT_TRUE(row.present[0]);
    TEST_ASSERT_TRUE(row.present[1]);
    TEST_ASSERT_EQUAL_INT(TL_GOOD, row.quality[0]);
    TEST_ASSERT_EQUAL_INT(TL_GOOD, row.quality[1]);
    TEST_ASSERT_EQUAL_DOUBLE(u, row.values[0]);
    TEST_ASSERT_EQUAL_DOUBLE(v, row.values[1]);
}

static void expect_end(void) {
    bool end = false;
    row.time = 77;
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_csv_next(reader, &row, &end, &error));
    TEST_ASSERT_TRUE(end);
    TEST_ASSERT_EQUAL_INT64(77, row.time);
}

static void expect_text(const char *parts) {
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, error.status);
    TL_EXPECT_PARTS(path, error.text);
    TL_EXPECT_PARTS(parts, error.text);
}

static void expect_bad_open(const char *text, const char *parts) {
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, open_text(text));
    TEST_ASSERT_NULL(reader);
    expect_text(parts);
}

static void expect_bad_row(const char *parts) {
    bool end = true;
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, tl_csv_next(reader, &row, &end, &error));
    TEST_ASSERT_FALSE(end);
    expect_text(parts);
}

/* ---- rows ---- */

static void test_rows(void) {
    expect_open("time,u,v\n0,1,2\n0.01,-1.5e3,+0.25\n");
    expect_row(0, 1, 2);
    expect_row(10000000, -1500, 0.25);
    expect_end();
    expect_end();
}

static void test_columns_in_another_order_and_further_ones(void) {
    expect_open("v,label,time,u\n2,first row,0,1\n4,\"a, b\",1,3\n");
    expect_row(0, 1, 2);
    expect_row(TL_SECOND, 3, 4);
    expect_end();
}

static void test_crlf_mark_blanks_and_no_last_line_end(void) {
    expect_open("\xEF\xBB\xBFtime,u,v\r\n\r\n0,1,2\r\n  \t\r\n1,3,4");
    expect_row(0, 1, 2);
    expect_row(TL_SECOND, 3, 4);
    expect_end();
}

static void test_quotes_and_spaces(void) {
    expect_open(" \"time\" ,\t\"u\", v \n \"0\" , 1 ,\t2\t\n");
    expect_row(0, 1, 2);
    expect_end();
}

static void test_names_with_quotes_and_commas(void) {
    const tl_csv_column columns[] = {{"a \"b\", c", 1, 0}, {"d e", 1, 0}};
    const tl_csv_settings settings = {.path = path, .time_column = "t [s]", .columns = columns, .column_count = 2};
    const char text[] = "t [s],\"a \"\"b\"\", c\",d e\n0,1,2\n";
    put(text, sizeof text - 1);
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_csv_open(&settings, &reader, &error));
    expect_row(0, 1, 2);
}

static void test_scales(void) {
    const tl_csv_column columns[] = {{"u", -0.5, 3}, {"u", 1, 0}};
    const tl_csv_settings settings = {.path = path, .time_column = "time", .columns = columns, .column_count = 2};
    static const char text[] = "time,u\n0,4\n1,-0\n2,\n3,x\n";
    put(text, sizeof text - 1);
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_csv_open(&settings, &reader, &error));
    expect_row(0, 1, 4);
    expect_row(TL_SECOND, 3, -0.0);
    TEST_ASSERT_TRUE(signbit(row.values[1]));
    next();
    TEST_ASSERT_FALSE(row.present[0]);
    next();
    TEST_ASSERT_EQUAL_INT(TL_NOT_A_NUMBER, row.quality[0]);
    TEST_ASSERT_EQUAL_DOUBLE(0, row.values[0]);
}

static void test_a_scaled_value_that_is_not_finite(void) {
    const tl_csv_column columns[] = {{"u", 1e300, 0}, {"u", 1, 0}};
    const tl_csv_settings settings = {.path = path, .time_column = "time", .columns = columns, .column_count = 2};
    put("time,u\n0,1e300\n", 15);
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_csv_open(&settings, &reader, &error));
    next();
    TEST_ASSERT_EQUAL_INT(TL_NOT_A_NUMBER, row.quality[0]);
    TEST_ASSERT_EQUAL_DOUBLE(0, row.values[0]);
    TEST_ASSERT_EQUAL_DOUBLE(1e300, row.values[1]);
}

static void test_one_column_for_two_channels(void) {
    const tl_csv_column columns[] = {{"u", 1, 0}, {"u", 1, 0}};
    const tl_csv_settings settings = {.path = path, .time_column = "time", .columns = columns, .column_count = 2};
    put("time,u\n0,5\n", 11);
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_csv_open(&settings, &reader, &error));
    expect_row(0, 5, 5);
    close_reader();
    put("time;u\n0;1,5\n", 13);
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_csv_open(&settings, &reader, &error));
    expect_row(0, 1.5, 1.5);
}

static void test_time_alone(void) {
    const tl_csv_settings settings = {.path = path, .time_column = "time", .columns = NULL, .column_count = 0};
    put("time\n3\n\n4\n", 10);
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_csv_open(&settings, &reader, &error));
    next();
    TEST_ASSERT_EQUAL_INT64(3 * TL_SECOND, row.time);
    next();
    TEST_ASSERT_EQUAL_INT64(4 * TL_SECOND, row.time);
    expect_end();
}

static void test_empty_cells_are_no_news(void) {
    expect_open("time,u,v\n0,,2\n1,\"\", \n");
    next();
    TEST_ASSERT_FALSE(row.present[0]);
    TEST_ASSERT_TRUE(row.present[1]);
    next();
    TEST_ASSERT_FALSE(row.present[0]);
    TEST_ASSERT_FALSE(row.present[1]);
}

static void test_cells_that_are_no_number(void) {
    static const char *const CELLS[] = {"nan", "NaN", "inf", "-Infinity", "0x10",  "1e999", "abc",    "1 2",
                                        "-",   ".",   "1e",  "--1",       "1.2.3", "truer", "\"1,5\""};
    for (size_t i = 0; i < sizeof CELLS / sizeof CELLS[0]; i++) {
        char text[64];
        (void)snprintf(text, sizeof text, "time,u,v\n0,%s,1\n", CELLS[i]);
        expect_open(text);
        next();
        TEST_ASSERT_TRUE_MESSAGE(row.present[0], CELLS[i]);
        TEST_ASSERT_EQUAL_INT_MESSAGE(TL_NOT_A_NUMBER, row.quality[0], CELLS[i]);
        TEST_ASSERT_EQUAL_DOUBLE(0, row.values[0]);
        TEST_ASSERT_EQUAL_INT(TL_GOOD, row.quality[1]);
    }
}

static void test_a_zero_byte_does_not_hide_what_follows(void) {
    const tl_csv_settings settings = {.path = path, .time_column = "time", .columns = UV, .column_count = 2};
    const char text[] = "time,u,v\n0,1,2\0junk\n";
    put(text, sizeof text - 1);
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_csv_open(&settings, &reader, &error));
    next();
    TEST_ASSERT_EQUAL_INT(TL_NOT_A_NUMBER, row.quality[1]);
}

static void test_time_to_the_nearest_nanosecond(void) {
    expect_open("time,u,v\n-0.0000000016,0,0\n0.1,0,0\n0.3,0,0\n4600000000,0,0\n");
    expect_row(-2, 0, 0);
    expect_row(100000000, 0, 0);
    expect_row(300000000, 0, 0);
    expect_row(4600000000 * TL_SECOND, 0, 0);
}

/* Longer than one read() returns; some lines begin in one read() and end in the next. */
static void test_a_long_file(void) {
    enum { ROWS = 30000 };
    const tl_csv_settings settings = {.path = path, .time_column = "time", .columns = UV, .column_count = 2};
    FILE *file = fopen(path, "wb");
    TEST_ASSERT_NOT_NULL(file);
    TEST_ASSERT_TRUE(fprintf(file, "time,u,v\n") > 0);
    for (int i = 0; i < ROWS; i++) {
        TEST_ASSERT_TRUE(fprintf(file, "%d,%d.5,%d\n", i, i, -i) > 0);
    }
    TEST_ASSERT_EQUAL_INT(0, fclose(file));
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_csv_open(&settings, &reader, &error));
    for (int i = 0; i < ROWS; i++) {
        expect_row(i * TL_SECOND, i + 0.5, -i);
    }
    expect_end();
}

/* ---- errors ---- */

static void test_no_file(void) {
    const tl_csv_settings settings = {.path = path, .time_column = "time", .columns = UV, .column_count = 2};
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, tl_csv_open(&settings, &reader, &error));
    expect_text("No such file");
}

static void test_a_folder(void) {
    const tl_csv_settings settings = {.path = scratch.folder, .time_column = "time", .columns = UV, .column_count = 2};
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, tl_csv_open(&settings, &reader, &error));
    TL_EXPECT_PARTS("directory", error.text);
}

static void test_an_empty_file(void) {
    expect_bad_open("", "empty");
    expect_bad_open("\r\n  \n", "empty");
}

static void test_a_missing_column_names_those_that_are_there(void) {
    expect_bad_open("time,u,w\n", "line 1|\"v\"|time, u, w");
    expect_bad_open("Time,u,v\n", "line 1|\"time\"|Time, u, v");
}

static void test_a_missing_column_among_very_many(void) {
    char text[4096] = "time";
    for (int i = 0; i < 300; i++) {
        (void)snprintf(text + strlen(text), sizeof text - strlen(text), ",column%d", i);
    }
    expect_bad_open(text, "column1");
    expect_text(", ...");
}

static void test_a_column_twice(void) {
    expect_bad_open("time,u,v,u\n", "line 1|\"u\"|2");
    expect_bad_open("time,u,v,time\n", "line 1|\"time\"|2");
}

static void expect_form(const char *form) {
    TEST_ASSERT_EQUAL_STRING(form, tl_csv_get_form(reader).text);
}

static void test_semicolons_and_decimal_commas(void) {
    expect_open("time;u;v\n0;1,5;2\n0,5;-1,25e3;\"0,5\"\n1;1,2,3;1.000,5\n");
    expect_row(0, 1.5, 2);
    expect_row(TL_SECOND / 2, -1250, 0.5);
    expect_form("semicolons");
    next();
    TEST_ASSERT_EQUAL_INT(TL_NOT_A_NUMBER, row.quality[0]);
    TEST_ASSERT_EQUAL_INT(TL_NOT_A_NUMBER, row.quality[1]);
}

/* 1.000 may be a thousand where another value has a decimal comma, and the reverse. */
static void test_one_decimal_mark_in_a_file(void) {
    expect_open("time;u;v\n0.5;1,5;1.000\n");
    next();
    TEST_ASSERT_EQUAL_DOUBLE(1.5, row.values[0]);
    TEST_ASSERT_EQUAL_INT(TL_NOT_A_NUMBER, row.quality[1]);
    expect_open("time\tu\tv\n0\t1.5\t1,234\n1\t2\t2.5\n");
    next();
    TEST_ASSERT_EQUAL_INT(TL_NOT_A_NUMBER, row.quality[1]);
    expect_row(TL_SECOND, 2, 2.5);
}

static void test_separators_in_names(void) {
    expect_open("time;u, m;flow, l/min, x;u;v\n0;1;7;1;2\n");
    expect_row(0, 1, 2);
    expect_open("time,u,v,a;b;c;d;e\n0,1,2,3\n");
    expect_row(0, 1, 2);
    expect_open("time,\t\tu,\t\tv\n0,\t1,\t2\n");
    expect_row(0, 1, 2);
    expect_open("time,u,v,\"a;b;c;d;e\"\n0,1,2,3\n");
    expect_row(0, 1, 2);
    expect_form("");
    expect_bad_open("time;u;w\n", "line 1|\"v\"|time, u, w");
}

static void test_tabs(void) {
    expect_open("time\tu\tv\n0\t 1 \t2\n1\t\t3\n");
    expect_row(0, 1, 2);
    next();
    TEST_ASSERT_FALSE(row.present[0]);
    TEST_ASSERT_EQUAL_DOUBLE(3, row.values[1]);
    expect_form("tabs");
}

static void test_truth_values(void) {
    expect_open("time,u,v\n0,TRUE,False\n");
    expect_row(0, 1, 0);
}

static void test_a_row_of_units(void) {
    expect_open("time,u,v\ns,rpm,1/min\n0,1,2\n");
    expect_row(0, 1, 2);
    expect_form("");
    expect_open("time;u;v\n[ms];rpm;1\n500;1;2\n");
    expect_row(TL_SECOND / 2, 1, 2);
    expect_form("semicolons, times in ms");
    expect_open("time,u,v\ns,1,1\ns,1,2\n");
    expect_bad_row("line 3|\"s\"");
}

static void test_dates(void) {
    expect_open("time;u;v\n30.11.2026 06:44:34,5;1;2\n30.11.2026 06:44:35;3;4\n");
    expect_row(INT64_C(1796021074500000000), 1, 2);
    expect_row(INT64_C(1796021075000000000), 3, 4);
    expect_form("semicolons, dates without zone (UTC)");
}

static void test_two_rows_with_one_time(void) {
    expect_open("time,u,v\n0,1,1\n1,1,1\n1,2,\n2,3,3\n");
    expect_row(0, 1, 1);
    expect_row(TL_SECOND, 2, 1);
    expect_row(2 * TL_SECOND, 3, 3);
    expect_open("time,u,v\n0,1,1\n0,2,2\n0,,3\n0,x,\n");
    next();
    TEST_ASSERT_EQUAL_INT(TL_NOT_A_NUMBER, row.quality[0]);
    TEST_ASSERT_EQUAL_DOUBLE(3, row.values[1]);
    expect_open("time,u,v\n0,1,1\n0,2,2\n0,3\n");
    expect_row(0, 2, 2);
    expect_bad_row("line 4|2|3");
    expect_open("time,u,v\n0,1,1\n0,2,2\n0,3,3\n0,4,4\n1,5,5\n1,6,6\n1,7,7\n1,8,8\n1,9,9\n");
    expect_row(0, 4, 4);
    TEST_ASSERT_EQUAL_INT64(3, tl_csv_get_form(reader).merged);
    expect_bad_row("line 10|1.000000000 s|4 rows");
}

static void test_files_that_are_no_text(void) {
    expect_bad_open("\x1F\x8B\x08junk", "compressed data|damaged");
    expect_bad_open("\xFD"
                    "7zXZ",
                    "xz -dc");
    expect_bad_open("BZh91AY", "bzip2 -dc");
    expect_bad_open("\x28\xB5\x2F\xFDx", "zstd -dc");
    expect_bad_open("PK\x03\x04junk", "CSV");
    expect_bad_open("\xFF\xFEt", "empty");
}

/* ---- decoded files ---- */

static const char GZIP[] = {'\x1F', '\x8B', '\x08', '\x00', '\x00', '\x00', '\x00', '\x00', '\x02', '\x03', '\x2B',
                            '\xC9', '\xCC', '\x4D', '\xD5', '\x29', '\xD5', '\x29', '\xE3', '\x32', '\xD0', '\x31',
                            '\xD4', '\x31', '\xE2', '\x32', '\xD4', '\x31', '\xD6', '\x31', '\xE1', '\x02', '\x00',
                            '\x67', '\x64', '\xBA', '\x53', '\x15', '\x00', '\x00', '\x00'};

static tl_status open_bytes(const char *bytes, size_t size) {
    const tl_csv_settings settings = {.path = path, .time_column = "time", .columns = UV, .column_count = 2};
    close_reader();
    put(bytes, size);
    return tl_csv_open(&settings, &reader, &error);
}

static void test_gzip(void) {
    TEST_ASSERT_EQUAL_INT(TL_OK, open_bytes(GZIP, sizeof GZIP));
    expect_row(0, 1, 2);
    expect_row(TL_SECOND, 3, 4);
    expect_end();
    expect_form("gzip");
}

static void test_damaged_gzip(void) {
    char bytes[sizeof GZIP];
    memcpy(bytes, GZIP, sizeof bytes);
    bytes[sizeof bytes - 5] ^= 1; /* of the checksum or the length */
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, open_bytes(bytes, sizeof bytes));
    expect_text("compressed data|damaged");
    error = (tl_error){TL_OK, ""};
    TEST_ASSERT_EQUAL_INT(TL_OK, open_bytes(GZIP, sizeof GZIP - 8));
    expect_row(0, 1, 2);
    expect_row(TL_SECOND, 3, 4);
    expect_bad_row("compressed data|incomplete");
}

/* Widens ASCII to UTF-16, after a byte order mark. */
static size_t widen(const char *text, bool big, char *wide) {
    size_t size = 0;
    wide[size++] = big ? '\xFE' : '\xFF';
    wide[size++] = big ? '\xFF' : '\xFE';
    for (; *text != '\0'; text++) {
        wide[size++] = big ? '\0' : *text;
        wide[size++] = big ? *text : '\0';
    }
    return size;
}

static void test_utf_16(void) {
    char wide[128];
    for (int big = 0; big < 2; big++) {
        const size_t size = widen("time;u;v\r\n0;1,5;2\r\n", big == 1, wide);
        TEST_ASSERT_EQUAL_INT(TL_OK, open_bytes(wide, size));
        expect_row(0, 1.5, 2);
        expect_end();
        expect_form("UTF-16, semicolons");
    }
}

/* A name of characters that have 2, 3 and 4 bytes in UTF-8, and halves of pairs alone. */
static void test_utf_16_beyond_ascii(void) {
    static const char bytes[] = "\xFE\xFF\0t\0,\x00\xB5\x20\xAC\xD8\x3D\xDE\x00\0,\xD8\x3D\0x\xDE\x00";
    tl_csv_columns columns;
    put(bytes, sizeof bytes - 1);
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_csv_columns_read(path, &columns, &error));
    TEST_ASSERT_EQUAL_size_t(3, columns.count);
    TEST_ASSERT_EQUAL_STRING("\xC2\xB5\xE2\x82\xAC\xF0\x9F\x98\x80", columns.names[1]);
    TEST_ASSERT_EQUAL_STRING("x?", columns.names[2]);
    tl_csv_columns_release(&columns);
}

/* Longer than is read at once, so pairs of bytes and lines are split. */
static void test_a_long_utf_16_file(void) {
    enum { ROWS = 9000, LONGEST = 16 * ROWS };
    char *text = malloc(LONGEST);
    char *wide = malloc(2 * LONGEST + 2);
    TEST_ASSERT_NOT_NULL(text);
    TEST_ASSERT_NOT_NULL(wide);
    size_t length = (size_t)snprintf(text, LONGEST, "time,u,v\n");
    for (int i = 0; i < ROWS; i++) {
        length += (size_t)snprintf(text + length, LONGEST - length, "%d,%d,1\n", i, -i);
    }
    TEST_ASSERT_EQUAL_INT(TL_OK, open_bytes(wide, widen(text, false, wide)));
    for (int i = 0; i < ROWS; i++) {
        expect_row(i * TL_SECOND, -i, 1);
    }
    expect_end();
    free(wide);
    free(text);
}

static size_t put_unit(char *wide, size_t at, unsigned unit) {
    wide[at] = (char)(unit & 0xFF);
    wide[at + 1] = (char)(unit >> 8);
    return at + 2;
}

/* A pair whose halves lie in two readings of 16 KiB, then as many characters of three bytes as fit. */
static void test_the_most_bytes_of_utf_16(void) {
    enum { CHUNK = 16384, UNITS = CHUNK / 2 };
    static char wide[3 * CHUNK];
    static const char head[] = "time,u,v,w\n0,1,2,";
    static const char tail[] = "\n1,3,4,x\n";
    size_t at = put_unit(wide, 0, 0xFEFF);
    for (size_t i = 0; i < sizeof head - 1; i++) {
        at = put_unit(wide, at, (unsigned char)head[i]);
    }
    while (at < CHUNK - 2) {
        at = put_unit(wide, at, 'a');
    }
    at = put_unit(wide, at, 0xD83D);
    at = put_unit(wide, at, 0xDE00);
    for (size_t i = 0; i < UNITS - 1; i++) {
        at = put_unit(wide, at, 0x20AC);
    }
    for (size_t i = 0; i < sizeof tail - 1; i++) {
        at = put_unit(wide, at, (unsigned char)tail[i]);
    }
    TEST_ASSERT_EQUAL_INT(TL_OK, open_bytes(wide, at));
    expect_row(0, 1, 2);
    expect_row(TL_SECOND, 3, 4);
    expect_end();
}

/* The live source does not decode: a program appends to its file. */
static void test_kinds_that_the_live_source_refuses(void) {
    const tl_csv_settings settings = {.path = path, .time_column = "time", .columns = UV, .column_count = 2};
    static const char *const begins[][2] = {
        {"\x1F\x8B\x08", "gzip -dc"}, {"\xFF\xFEt", "iconv"}, {"\xFE\xFF", "iconv"}};
    tl_csv_table table;
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_csv_table_make(&table, &settings, &error));
    for (size_t i = 0; i < sizeof begins / sizeof begins[0]; i++) {
        char line[8];
        (void)snprintf(line, sizeof line, "%s", begins[i][0]);
        TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, tl_csv_table_header(&table, line, 1, &error));
        expect_text(begins[i][1]);
    }
    tl_csv_table_release(&table);
}

/* ---- files of a folder ---- */

static void put_file(const char *name, const char *text) {
    char kept[PATH_MAX];
    memcpy(kept, path, sizeof kept);
    (void)snprintf(path, sizeof path, "%s", tl_scratch_path(&scratch, name));
    put(text, strlen(text));
    memcpy(path, kept, sizeof path);
}

static tl_status open_folder(void) {
    error = (tl_error){TL_OK, ""};
    const tl_csv_settings settings = {.path = scratch.folder, .time_column = "time", .columns = UV, .column_count = 2};
    close_reader();
    return tl_csv_open(&settings, &reader, &error);
}

static void test_files_in_the_order_of_their_names(void) {
    put_file("day10.csv", "u;time;v\n5;2;6,5\n");
    put_file("day9.csv", "time,u,v\n0,1,2\n1,3,\n");
    put_file(".hidden", "junk");
    put_file("day9b.csv", "time,u,v\n1,,4\n");
    TEST_ASSERT_EQUAL_INT(TL_OK, open_folder());
    expect_row(0, 1, 2);
    expect_row(TL_SECOND, 3, 4);
    expect_row(2 * TL_SECOND, 5, 6.5);
    expect_end();
    TEST_ASSERT_EQUAL_size_t(3, tl_csv_get_form(reader).files);
    TEST_ASSERT_EQUAL_INT64(1, tl_csv_get_form(reader).merged);
}

static void test_files_that_do_not_follow(void) {
    put_file("a.csv", "time,u,v\n0,1,2\n7,3,4\n");
    put_file("b.csv", "time,u,v\n6.5,1,2\n");
    TEST_ASSERT_EQUAL_INT(TL_OK, open_folder());
    expect_row(0, 1, 2);
    expect_row(7 * TL_SECOND, 3, 4);
    bool end = true;
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, tl_csv_next(reader, &row, &end, &error));
    TL_EXPECT_PARTS("b.csv, line 2|6.500000000 s|7.000000000 s|a.csv|overlap", error.text);
}

static void test_a_bad_file_of_a_folder(void) {
    static const char *const bad[][2] = {{"", "b.csv|empty"},
                                         {"time,u\n", "b.csv, line 1|\"v\""},
                                         {"time,u,v\nms,,\n5,3,4\n", "b.csv|form or unit"},
                                         {"time,u,v\n2026-01-01T00:00:05Z,3,4\n", "b.csv|form or unit"}};
    put_file("a.csv", "time,u,v\n0,1,2\n");
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        put_file("b.csv", bad[i][0]);
        TEST_ASSERT_EQUAL_INT(TL_OK, open_folder());
        expect_row(0, 1, 2);
        bool end = true;
        TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, tl_csv_next(reader, &row, &end, &error));
        TL_EXPECT_PARTS(bad[i][1], error.text);
    }
}

static void test_a_folder_in_a_folder(void) {
    char inner[PATH_MAX];
    (void)snprintf(inner, sizeof inner, "%s", tl_scratch_path(&scratch, "inner"));
    TEST_ASSERT_EQUAL_INT(0, mkdir(inner, 0700));
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, open_folder());
    TL_EXPECT_PARTS("inner|directory", error.text);
    TEST_ASSERT_EQUAL_INT(0, rmdir(inner));
}

static void test_quotes_that_do_not_end(void) {
    expect_bad_open("time,\"u,v\n", "quote");
    expect_bad_open("time,\"u\"x,v\n", "quote");
    expect_open("time,u,v\n0,\"1,2\n");
    expect_bad_row("line 2|quote");
}

static void test_wrong_number_of_cells(void) {
    expect_open("time,u,v\n0,1,2\n\n1,1\n");
    expect_row(0, 1, 2);
    expect_bad_row("line 4|2|3");
    expect_open("time,u,v\n0,1,2,\n");
    expect_bad_row("line 2|4|3");
}

static void test_times_that_are_none(void) {
    static const char *const TIMES[] = {"", "now", "nan", "inf", "1e10", "-1e10", "0:01"};
    for (size_t i = 0; i < sizeof TIMES / sizeof TIMES[0]; i++) {
        char text[64];
        char parts[64];
        (void)snprintf(text, sizeof text, "time,u,v\n%s,1,1\n", TIMES[i]);
        (void)snprintf(parts, sizeof parts, "line 2|\"%s\"|-4.6e9|4.6e9", TIMES[i]);
        expect_open(text);
        expect_bad_row(parts);
    }
}

static void test_time_must_not_decrease(void) {
    expect_open("time,u,v\n-5,1,1\n-6,1,1\n");
    next();
    expect_bad_row("line 3|-6.000000000 s|-5.000000000 s");
}

/* A file with a header, then a line of that many bytes including its end. */
static tl_status open_with_line_of(size_t size) {
    const tl_csv_settings settings = {.path = path, .time_column = "time", .columns = UV, .column_count = 2};
    char *text = malloc(size + 64);
    TEST_ASSERT_NOT_NULL(text);
    int length = snprintf(text, size + 64, "time,u,v\n%-*s\n1,3,4\n", (int)size - 1, "0,1,2");
    put(text, (size_t)length);
    free(text);
    return tl_csv_open(&settings, &reader, &error);
}

static void test_the_longest_line(void) {
    TEST_ASSERT_EQUAL_INT(TL_OK, open_with_line_of(65536));
    expect_row(0, 1, 2);
    expect_row(TL_SECOND, 3, 4);
    expect_end();
}

static void test_a_line_that_is_too_long(void) {
    TEST_ASSERT_EQUAL_INT(TL_OK, open_with_line_of(65537));
    expect_bad_row("line 2|65536");
}

static void test_a_header_that_is_too_long(void) {
    char *text = malloc(70001);
    TEST_ASSERT_NOT_NULL(text);
    memset(text, 'x', 70000);
    text[70000] = '\0';
    tl_status status = open_text(text);
    free(text);
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, status);
    expect_text("line 1|65536");
}

static void feed(tl_csv_lines *lines, const char *text) {
    size_t room = 0;
    char *bytes = tl_csv_lines_room(lines, &room);
    TEST_ASSERT_TRUE(strlen(text) <= room);
    memcpy(bytes, text, strlen(text));
    tl_csv_lines_added(lines, strlen(text));
}

static void test_lines_after_one_that_is_too_long(void) {
    static tl_csv_lines lines;
    char *line = NULL;
    int too_long = 0;
    feed(&lines, "first\n");
    TEST_ASSERT_EQUAL_INT(TL_CSV_A_LINE, tl_csv_lines_take(&lines, false, &line));
    TEST_ASSERT_EQUAL_STRING("first", line);
    for (int i = 0; i < 20000; i++) {
        feed(&lines, "01234567");
        too_long += tl_csv_lines_take(&lines, false, &line) == TL_CSV_TOO_LONG ? 1 : 0;
    }
    TEST_ASSERT_EQUAL_INT(1, too_long);
    TEST_ASSERT_EQUAL_INT64(2, lines.number);
    feed(&lines, "its end\nthird\n\nfif");
    TEST_ASSERT_EQUAL_INT(TL_CSV_A_LINE, tl_csv_lines_take(&lines, false, &line));
    TEST_ASSERT_EQUAL_STRING("third", line);
    TEST_ASSERT_EQUAL_INT64(3, lines.number);
    TEST_ASSERT_EQUAL_INT(TL_CSV_NOTHING, tl_csv_lines_take(&lines, false, &line));
    feed(&lines, "th");
    TEST_ASSERT_EQUAL_INT(TL_CSV_A_LINE, tl_csv_lines_take(&lines, true, &line));
    TEST_ASSERT_EQUAL_STRING("fifth", line);
    TEST_ASSERT_EQUAL_INT64(5, lines.number);
    TEST_ASSERT_EQUAL_INT(TL_CSV_NOTHING, tl_csv_lines_take(&lines, true, &line));
}

static void test_too_many_columns(void) {
    tl_csv_column columns[TL_MAX_SIGNALS + 1];
    const tl_csv_settings settings = {
        .path = path, .time_column = "time", .columns = columns, .column_count = TL_MAX_SIGNALS + 1};
    for (size_t i = 0; i <= TL_MAX_SIGNALS; i++) {
        columns[i] = (tl_csv_column){"u", 1, 0};
    }
    put("time,u\n", 7);
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, tl_csv_open(&settings, &reader, &error));
    expect_text("65|64");
}

/* ---- the columns of a file ---- */

static tl_csv_columns columns;

static tl_status read_columns(const char *text) {
    error = (tl_error){TL_OK, ""};
    put(text, strlen(text));
    return tl_csv_columns_read(path, &columns, &error);
}

static void test_columns(void) {
    TEST_ASSERT_EQUAL_INT(TL_OK, read_columns("speed;t;\"a, b\"\n1;0;2\n"));
    TEST_ASSERT_EQUAL_size_t(3, columns.count);
    TEST_ASSERT_EQUAL_size_t(1, columns.time);
    TEST_ASSERT_EQUAL_STRING("speed", columns.names[0]);
    TEST_ASSERT_EQUAL_STRING("a, b", columns.names[2]);
    TEST_ASSERT_EQUAL_STRING("", columns.units[0]);
    tl_csv_columns_release(&columns);
}

static void test_columns_with_a_row_of_units(void) {
    TEST_ASSERT_EQUAL_INT(TL_OK, read_columns("\xEF\xBB\xBFTime,speed\nms,rad/s\n0,1\n"));
    TEST_ASSERT_EQUAL_STRING("Time", columns.names[columns.time]);
    TEST_ASSERT_EQUAL_STRING("rad/s", columns.units[1]);
    tl_csv_columns_release(&columns);
    TEST_ASSERT_EQUAL_INT(TL_OK, read_columns("clock,speed\n")); /* no name of a time: the first column */
    TEST_ASSERT_EQUAL_size_t(0, columns.time);
    TEST_ASSERT_EQUAL_STRING("", columns.units[1]);
    tl_csv_columns_release(&columns);
}

static void test_columns_that_cannot_be_read(void) {
    const char *const texts[] = {"", "time,\"speed\n", "\x1F\x8B", "\xFF\xFE"};
    for (size_t i = 0; i < sizeof texts / sizeof texts[0]; i++) {
        TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, read_columns(texts[i]));
        tl_csv_columns_release(&columns);
    }
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, tl_csv_columns_read("/nowhere/file.csv", &columns, &error));
}

int main(void) {
    tl_scratch_make(&scratch, TL_BINARY_DIR, "test_csv");
    (void)snprintf(path, sizeof path, "%s", tl_scratch_path(&scratch, "recording.csv"));
    UNITY_BEGIN();
    RUN_TEST(test_rows);
    RUN_TEST(test_columns_in_another_order_and_further_ones);
    RUN_TEST(test_crlf_mark_blanks_and_no_last_line_end);
    RUN_TEST(test_quotes_and_spaces);
    RUN_TEST(test_names_with_quotes_and_commas);
    RUN_TEST(test_scales);
    RUN_TEST(test_a_scaled_value_that_is_not_finite);
    RUN_TEST(test_one_column_for_two_channels);
    RUN_TEST(test_time_alone);
    RUN_TEST(test_empty_cells_are_no_news);
    RUN_TEST(test_cells_that_are_no_number);
    RUN_TEST(test_a_zero_byte_does_not_hide_what_follows);
    RUN_TEST(test_time_to_the_nearest_nanosecond);
    RUN_TEST(test_a_long_file);
    RUN_TEST(test_no_file);
    RUN_TEST(test_a_folder);
    RUN_TEST(test_an_empty_file);
    RUN_TEST(test_a_missing_column_names_those_that_are_there);
    RUN_TEST(test_a_missing_column_among_very_many);
    RUN_TEST(test_a_column_twice);
    RUN_TEST(test_semicolons_and_decimal_commas);
    RUN_TEST(test_one_decimal_mark_in_a_file);
    RUN_TEST(test_separators_in_names);
    RUN_TEST(test_tabs);
    RUN_TEST(test_truth_values);
    RUN_TEST(test_a_row_of_units);
    RUN_TEST(test_dates);
    RUN_TEST(test_two_rows_with_one_time);
    RUN_TEST(test_files_that_are_no_text);
    RUN_TEST(test_gzip);
    RUN_TEST(test_damaged_gzip);
    RUN_TEST(test_utf_16);
    RUN_TEST(test_utf_16_beyond_ascii);
    RUN_TEST(test_a_long_utf_16_file);
    RUN_TEST(test_the_most_bytes_of_utf_16);
    RUN_TEST(test_kinds_that_the_live_source_refuses);
    RUN_TEST(test_files_in_the_order_of_their_names);
    RUN_TEST(test_files_that_do_not_follow);
    RUN_TEST(test_a_bad_file_of_a_folder);
    RUN_TEST(test_a_folder_in_a_folder);
    RUN_TEST(test_quotes_that_do_not_end);
    RUN_TEST(test_wrong_number_of_cells);
    RUN_TEST(test_times_that_are_none);
    RUN_TEST(test_time_must_not_decrease);
    RUN_TEST(test_the_longest_line);
    RUN_TEST(test_a_line_that_is_too_long);
    RUN_TEST(test_a_header_that_is_too_long);
    RUN_TEST(test_lines_after_one_that_is_too_long);
    RUN_TEST(test_too_many_columns);
    RUN_TEST(test_columns);
    RUN_TEST(test_columns_with_a_row_of_units);
    RUN_TEST(test_columns_that_cannot_be_read);
    return tl_scratch_finish(&scratch, UNITY_END());
}
