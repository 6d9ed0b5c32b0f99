/* The log: style, levels, whole lines, and the limit per second. */
#include <fcntl.h>
#include <pthread.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <termios.h>
#include <unistd.h>

#include <unity.h>

#include "firmware/base/log.h"
#include "tests/support/message.h"
#include "tests/support/stderr_capture.h"

void setUp(void) {
    tl_log_set_level(TL_LOG_NOTICE);
}

void tearDown(void) {}

static void begin(void) {
    TEST_ASSERT_TRUE(tl_stderr_capture_begin());
}

static void test_plain_lines(void) {
    begin();
    tl_log(TL_LOG_ERROR, "no disk: %d", 7);
    tl_log(TL_LOG_WARNING, "slow");
    tl_log(TL_LOG_NOTICE, "ready");
    tl_stderr_expect("twinlock: error: no disk: 7\ntwinlock: warning: slow\ntwinlock: notice: ready\n");
}

/* Runs before any other error, because the flag is never cleared. */
static void test_an_error_is_remembered(void) {
    begin();
    tl_log(TL_LOG_WARNING, "slow");
    (void)tl_log_foreign(TL_LOG_FOREIGN, "error", 1000);
    (void)tl_log_foreign(TL_LOG_WARNING, "slow", 1000);
    TEST_ASSERT_FALSE(tl_log_has_error());
    (void)tl_log_foreign(TL_LOG_ERROR, "no disk", 1000);
    TEST_ASSERT_TRUE(tl_log_has_error());
    tl_stderr_expect("twinlock: warning: slow\nfmu: error\ntwinlock: warning: slow\ntwinlock: error: no disk\n");
}

static void test_kept_errors(void) {
    begin();
    tl_log(TL_LOG_ERROR, "before");
    tl_log_keep_errors();
    tl_log(TL_LOG_ERROR, "no disk %d", 1);
    tl_log(TL_LOG_WARNING, "slow");
    (void)tl_log_foreign(TL_LOG_ERROR, "no disk 2", 1000);
    TEST_ASSERT_EQUAL_STRING("no disk 1", tl_log_kept_error(0));
    TEST_ASSERT_EQUAL_STRING("no disk 2", tl_log_kept_error(1));
    TEST_ASSERT_NULL(tl_log_kept_error(2));
    for (int i = 2; i <= TL_LOG_KEPT; i++) {
        tl_log(TL_LOG_ERROR, "more");
    }
    TEST_ASSERT_EQUAL_STRING("more", tl_log_kept_error(TL_LOG_KEPT - 1));
    TEST_ASSERT_NULL(tl_log_kept_error(TL_LOG_KEPT));
}

static void test_levels(void) {
    begin();
    tl_log(TL_LOG_INFO, "not yet");
    tl_log_set_level(TL_LOG_DEBUG);
    tl_log(TL_LOG_INFO, "now");
    tl_log(TL_LOG_DEBUG, "this too");
    tl_log_set_level(TL_LOG_ERROR);
    tl_log(TL_LOG_WARNING, "no more");
    tl_stderr_expect("twinlock: info: now\ntwinlock: debug: this too\n");
}

static void test_one_message_is_one_line(void) {
    begin();
    tl_log(TL_LOG_ERROR, "two\nlines\t\x1b[31m and an end\r\n\n");
    tl_stderr_expect("twinlock: error: two lines  [31m and an end\n");
    begin();
    tl_log(TL_LOG_ERROR, "é\uFEFF\xC2\x9B\u2028\xFF€");
    tl_stderr_expect("twinlock: error: é????€\n");
}

static void test_long_messages_are_cut_between_characters(void) {
    static char message[2 * TL_LOG_TEXT];
    for (size_t i = 0; i + 2 < sizeof message; i += 2) { /* two bytes per character */
        memcpy(message + i, "\xC3\xA4", 3);
    }
    for (size_t shift = 0; shift < 2; shift++) {
        begin();
        tl_log(TL_LOG_ERROR, "%.*s%s", (int)shift, "x", message);
        char *text = tl_stderr_capture_end();
        TEST_ASSERT_NOT_NULL(text);
        size_t length = strlen(text);
        TEST_ASSERT_LESS_OR_EQUAL_size_t(TL_LOG_TEXT + 20, length);
        TEST_ASSERT_GREATER_THAN_size_t(TL_LOG_TEXT, length + 8);
        TEST_ASSERT_EQUAL_STRING("\xC3\xA4\xE2\x80\xA6\n", text + length - 6); /* whole, then the ellipsis */
        free(text);
    }
}

static void test_the_limit(void) {
    tl_log_limiter limiter = TL_LOG_LIMITER(5);
    begin();
    for (int i = 0; i < 1000; i++) {
        tl_log_limited(&limiter, TL_LOG_WARNING, "again");
        tl_log_limited(&limiter, TL_LOG_DEBUG, "not counted");
    }
    tl_log_limiter_end(&limiter);
    tl_log_limiter_end(&limiter); /* prints nothing more */
    char *text = tl_stderr_capture_end();
    TEST_ASSERT_NOT_NULL(text);
    size_t lines = tl_test_count_lines(text);
    TEST_ASSERT_TRUE(lines == 6 || lines == 12); /* 12 if a second ended meanwhile */
    TL_EXPECT_PARTS("warning|dropped|5", text);
    TEST_ASSERT_TRUE(lines == 12 || tl_test_has_parts(text, "995"));
    free(text);
}

static void test_a_new_second_has_room_again(void) {
    tl_log_limiter limiter = TL_LOG_LIMITER(1);
    begin();
    for (int i = 0; i < 60; i++) { /* 1.2 s */
        tl_log_limited(&limiter, TL_LOG_WARNING, "message %d", i);
        (void)usleep(20 * 1000);
    }
    char *text = tl_stderr_capture_end();
    TEST_ASSERT_NOT_NULL(text);
    TEST_ASSERT_NOT_NULL(strstr(text, "warning: message 0\n"));
    const char *dropped = strstr(text, "dropped");
    TL_EXPECT_PARTS("1", dropped);
    TEST_ASSERT_NOT_NULL(strstr(dropped, "\ntwinlock: warning: message "));
    free(text);
}

/* The pipe is full and has no reader: the message is dropped, and the call returns. */
static void test_a_limited_message_does_not_wait(void) {
    int pipes[2];
    TEST_ASSERT_EQUAL_INT(0, pipe(pipes));
    int flags = fcntl(pipes[1], F_GETFL);
    (void)fcntl(pipes[1], F_SETFL, flags | O_NONBLOCK);
    char block[4096] = {0};
    while (write(pipes[1], block, sizeof block) > 0) {
    }
    (void)fcntl(pipes[1], F_SETFL, flags);
    int saved = dup(STDERR_FILENO);
    (void)dup2(pipes[1], STDERR_FILENO);
    tl_log_limiter limiter = TL_LOG_LIMITER(20);
    (void)alarm(10); /* ends a test that hangs */
    for (int i = 0; i < 10; i++) {
        tl_log_limited(&limiter, TL_LOG_ERROR, "from within a step");
    }
    (void)alarm(0);
    (void)dup2(saved, STDERR_FILENO);
    (void)close(saved);
    (void)close(pipes[0]);
    (void)close(pipes[1]);
    begin();
    tl_log_limiter_end(&limiter);
    char *text = tl_stderr_capture_end();
    TL_EXPECT_PARTS("warning|dropped|10|20", text);
    TEST_ASSERT_EQUAL_size_t(1, tl_test_count_lines(text));
    free(text);
}

static void *write_lines(void *limiter) {
    for (int i = 0; i < 500; i++) {
        tl_log(TL_LOG_ERROR, "a line of some length that must stay whole");
        tl_log_limited(limiter, TL_LOG_ERROR, "a line of some length that must stay whole");
    }
    return NULL;
}

static void test_lines_of_many_threads_stay_whole(void) {
    enum { THREADS = 4 };
    static tl_log_limiter limiter = TL_LOG_LIMITER(100000);
    pthread_t threads[THREADS];
    begin();
    for (int i = 0; i < THREADS; i++) {
        TEST_ASSERT_EQUAL_INT(0, pthread_create(&threads[i], NULL, write_lines, &limiter));
    }
    for (int i = 0; i < THREADS; i++) {
        (void)pthread_join(threads[i], NULL);
    }
    char *text = tl_stderr_capture_end();
    TEST_ASSERT_NOT_NULL(text);
    size_t length = strlen("twinlock: error: a line of some length that must stay whole\n");
    TEST_ASSERT_EQUAL_size_t(length * THREADS * 1000, strlen(text));
    for (const char *line = text; *line != '\0'; line += length) {
        TEST_ASSERT_EQUAL_INT(0, memcmp(line, "twinlock: error: a line of some length that must stay whole\n", length));
    }
    free(text);
}

/* A process detects the style once, so each case forks. `stream` is the value of JOURNAL_STREAM;
 * NULL: that of our stderr. */
static char *log_of_child(const char *stream) {
    begin();
    pid_t child = fork();
    if (child == 0) {
        struct stat status;
        char own[64];
        (void)fstat(STDERR_FILENO, &status);
        (void)snprintf(own, sizeof own, "%llu:%llu", (unsigned long long)status.st_dev,
                       (unsigned long long)status.st_ino);
        (void)setenv("JOURNAL_STREAM", stream == NULL ? own : stream, 1);
        tl_log(TL_LOG_WARNING, "hello");
        (void)tl_log_foreign(TL_LOG_FOREIGN, "<0>wake up", 1000);
        _exit(0);
    }
    (void)waitpid(child, NULL, 0);
    return tl_stderr_capture_end();
}

static void test_journal(void) {
    char *ours = log_of_child(NULL);
    char *other = log_of_child("1:2"); /* stderr was redirected away from the journal */
    TEST_ASSERT_EQUAL_STRING("<4>hello\n<6>fmu: <0>wake up\n", ours);
    TEST_ASSERT_EQUAL_STRING("twinlock: warning: hello\nfmu: <0>wake up\n", other);
    free(ours);
    free(other);
}

static void expect_level(int level, const char *rest, const char *line) {
    const char *text = NULL;
    TEST_ASSERT_EQUAL_INT_MESSAGE(level, tl_log_level_of(line, &text), line);
    TEST_ASSERT_EQUAL_STRING(rest, text);
}

static void test_the_level_of_a_line(void) {
    expect_level(TL_LOG_ERROR, "broken", "<3>broken");
    expect_level(TL_LOG_DEBUG, "", "<7>");
    static const char *const others[] = {"", "<", "<3", "<2>not used by us", "<8>undefined", "3>text", " <3>text"};
    for (size_t i = 0; i < sizeof others / sizeof others[0]; i++) {
        expect_level(TL_LOG_FOREIGN, others[i], others[i]);
    }
}

static void test_foreign_lines(void) {
    static char line[TL_LOG_PLAIN + 100];
    memset(line, 'x', sizeof line - 1);
    begin();
    tl_log_plain("as it is: <3>, \tand so on");
    tl_log_plain("");
    tl_log_plain(line);
    char *text = tl_stderr_capture_end();
    TEST_ASSERT_NOT_NULL(text);
    static const char first[] = "as it is: <3>, \tand so on\n\n";
    TEST_ASSERT_EQUAL_STRING_LEN(first, text, sizeof first - 1);
    TEST_ASSERT_EQUAL_size_t(sizeof first - 1 + TL_LOG_PLAIN + 1, strlen(text));
    TEST_ASSERT_EQUAL_STRING("xx\n", text + strlen(text) - 3);
    free(text);
}

/* Lines of an FMU are marked, so that they cannot pass for ours. */
static void test_lines_of_fmus(void) {
    begin();
    TEST_ASSERT_TRUE(tl_log_foreign(TL_LOG_FOREIGN, "twinlock: error: forged", 1000));
    TEST_ASSERT_TRUE(tl_log_foreign(TL_LOG_WARNING, "slow", 1000));
    TEST_ASSERT_TRUE(tl_log_foreign(TL_LOG_DEBUG, "not wanted", 1000));
    tl_stderr_expect("fmu: twinlock: error: forged\ntwinlock: warning: slow\n");
}

/* The pipe is full and has no reader: lines are refused until it is read again. */
static void test_lines_of_fmus_never_wait(void) {
    static char line[TL_LOG_PLAIN];
    static char read_again[1 << 20];
    int ends[2];
    TEST_ASSERT_EQUAL_INT(0, pipe2(ends, O_CLOEXEC));
    int screen = dup(STDERR_FILENO);
    memset(line, 'x', sizeof line - 1);
    (void)dup2(ends[1], STDERR_FILENO);
    (void)alarm(20); /* ends a test that hangs */
    int taken = 0;
    while (tl_log_foreign(TL_LOG_FOREIGN, line, 10)) {
        taken++;
    }
    bool refused = !tl_log_foreign(TL_LOG_ERROR, "one more", 0);
    (void)alarm(0);
    ssize_t size = read(ends[0], read_again, sizeof read_again);
    bool again = tl_log_foreign(TL_LOG_ERROR, "read", 0);
    (void)dup2(screen, STDERR_FILENO);
    (void)close(screen);
    (void)close(ends[0]);
    (void)close(ends[1]);
    TEST_ASSERT_GREATER_THAN_INT(0, taken);
    TEST_ASSERT_TRUE(refused);
    TEST_ASSERT_GREATER_THAN_INT(taken * TL_LOG_PLAIN, (int)size);
    TEST_ASSERT_TRUE(again);
}

/* ---- a terminal ---- */

#define WIPE "\r\x1b[K"

static int terminal = -1;
static int before = -1;
static pthread_t reader;
static char shown[1000000]; /* the output of the terminal, written by `reader` */
static size_t shown_size;

static void *read_terminal(void *unused) {
    ssize_t now = 1;
    while (now > 0 && shown_size < sizeof shown - 1) {
        now = read(terminal, shown + shown_size, sizeof shown - 1 - shown_size);
        shown_size += now > 0 ? (size_t)now : 0; /* EIO: the other end is closed */
    }
    shown[shown_size] = '\0';
    return unused;
}

static void open_terminal(unsigned short columns) {
    const struct winsize size = {.ws_row = 24, .ws_col = columns};
    struct termios raw;
    terminal = posix_openpt(O_RDWR | O_NOCTTY | O_CLOEXEC);
    TEST_ASSERT_NOT_EQUAL_INT(-1, terminal);
    TEST_ASSERT_EQUAL_INT(0, grantpt(terminal));
    TEST_ASSERT_EQUAL_INT(0, unlockpt(terminal));
    int end = open(ptsname(terminal), O_RDWR | O_NOCTTY | O_CLOEXEC);
    TEST_ASSERT_NOT_EQUAL_INT(-1, end);
    TEST_ASSERT_EQUAL_INT(0, tcgetattr(end, &raw));
    cfmakeraw(&raw);
    TEST_ASSERT_EQUAL_INT(0, tcsetattr(end, TCSANOW, &raw));
    TEST_ASSERT_EQUAL_INT(0, ioctl(end, TIOCSWINSZ, &size));
    before = dup(STDERR_FILENO);
    (void)dup2(end, STDERR_FILENO);
    (void)close(end);
    shown_size = 0;
    TEST_ASSERT_EQUAL_INT(0, pthread_create(&reader, NULL, read_terminal, NULL));
}

/* Returns the whole output of the terminal. */
static const char *close_terminal(void) {
    (void)dup2(before, STDERR_FILENO);
    (void)close(before);
    (void)pthread_join(reader, NULL);
    (void)close(terminal);
    return shown;
}

static void test_lines_wipe_the_status(void) {
    tl_log_limiter limiter = TL_LOG_LIMITER(5);
    open_terminal(80);
    tl_log(TL_LOG_NOTICE, "begins");
    tl_log_status(NULL); /* no status line yet */
    tl_log_status("1 s");
    tl_log(TL_LOG_WARNING, "slow");
    tl_log_limited(&limiter, TL_LOG_WARNING, "again");
    tl_log_plain("foreign");
    tl_log_status("2 s");
    tl_log_status("3 s");
    tl_log_status(NULL);
    tl_log_status(NULL);
    tl_log(TL_LOG_NOTICE, "ends");
    TEST_ASSERT_EQUAL_STRING("twinlock: notice: begins\n" WIPE "1 s" WIPE "twinlock: warning: slow\n" WIPE
                             "twinlock: warning: again\n" WIPE "foreign\n" WIPE "2 s" WIPE "3 s" WIPE
                             "twinlock: notice: ends\n",
                             close_terminal());
}

/* A wrapped status line could not be redrawn. Its width counts characters, not bytes. */
static void test_a_status_fits_the_terminal(void) {
    static char longest[3 * TL_LOG_TEXT];
    for (size_t i = 0; i + 3 < sizeof longest; i += 2) {
        memcpy(longest + i, "\xC3\xA4", 3);
    }
    open_terminal(10);
    tl_log_status("\xCE\x94u 0.1234567");
    tl_log_status("a\tb\x1b\n");
    tl_log_status(NULL);
    TEST_ASSERT_EQUAL_STRING(WIPE "\xCE\x94u 0.12" WIPE "a b  " WIPE, close_terminal());
    open_terminal(60000);
    tl_log_status(longest);
    tl_log_status(NULL);
    size_t length = strlen(close_terminal()) - 2 * strlen(WIPE);
    TEST_ASSERT_TRUE(length > TL_LOG_TEXT - 4 && length < TL_LOG_TEXT && length % 2 == 0);
}

static void test_a_status_is_for_terminals_only(void) {
    begin();
    tl_log_status("1 s");
    tl_log(TL_LOG_WARNING, "slow");
    tl_log_status(NULL);
    tl_stderr_expect("twinlock: warning: slow\n");
}

/* The socket delivers each write as one message. */
static void test_wiping_and_line_are_one_write(void) {
    int ends[2];
    char text[200] = "";
    TEST_ASSERT_EQUAL_INT(0, socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, ends));
    open_terminal(80);
    tl_log_status("1 s");
    int screen = dup(STDERR_FILENO);
    (void)dup2(ends[0], STDERR_FILENO);
    tl_log(TL_LOG_WARNING, "slow");
    tl_log_plain("foreign");
    (void)dup2(screen, STDERR_FILENO);
    (void)close(screen);
    tl_log_status(NULL);
    (void)close_terminal();
    TEST_ASSERT_EQUAL_INT(strlen(WIPE "twinlock: warning: slow\n"), recv(ends[1], text, sizeof text - 1, 0));
    TEST_ASSERT_EQUAL_STRING(WIPE "twinlock: warning: slow\n", text);
    TEST_ASSERT_EQUAL_INT(strlen(WIPE "foreign\n"), recv(ends[1], text, sizeof text - 1, 0));
    (void)close(ends[0]);
    (void)close(ends[1]);
}

enum { WRITTEN = 1000 };

static void *write_lines_that_wait(void *unused) {
    for (int i = 0; i < WRITTEN; i++) {
        tl_log(TL_LOG_ERROR, "a line of some length that must stay whole");
    }
    return unused;
}

/* While one thread draws the status, lines of the other threads stay whole. */
static void test_no_line_is_smeared(void) {
    enum { THREADS = 3, DRAWN = 2000 };
    pthread_t threads[THREADS];
    open_terminal(80);
    tl_log_status("status");
    for (int i = 0; i < THREADS; i++) {
        TEST_ASSERT_EQUAL_INT(0, pthread_create(&threads[i], NULL, write_lines_that_wait, NULL));
    }
    for (int i = 0; i < DRAWN; i++) {
        tl_log_status("status");
    }
    for (int i = 0; i < THREADS; i++) {
        (void)pthread_join(threads[i], NULL);
    }
    tl_log_status(NULL);
    static const char line[] = WIPE "twinlock: error: a line of some length that must stay whole\n";
    size_t lines = 0;
    for (const char *at = close_terminal(); *at != '\0'; lines++) {
        bool is_status = strncmp(at, WIPE "status", strlen(WIPE "status")) == 0;
        bool is_line = strncmp(at, line, sizeof line - 1) == 0;
        TEST_ASSERT_TRUE_MESSAGE(is_status || is_line || strcmp(at, WIPE) == 0, at);
        at += is_status ? strlen(WIPE "status") : is_line ? sizeof line - 1 : strlen(WIPE);
    }
    TEST_ASSERT_EQUAL_size_t(THREADS * WRITTEN + DRAWN + 2, lines);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_journal); /* first, before the style is detected */
    RUN_TEST(test_an_error_is_remembered);
    RUN_TEST(test_plain_lines);
    RUN_TEST(test_kept_errors);
    RUN_TEST(test_levels);
    RUN_TEST(test_one_message_is_one_line);
    RUN_TEST(test_long_messages_are_cut_between_characters);
    RUN_TEST(test_the_limit);
    RUN_TEST(test_a_new_second_has_room_again);
    RUN_TEST(test_a_limited_message_does_not_wait);
    RUN_TEST(test_lines_of_many_threads_stay_whole);
    RUN_TEST(test_the_level_of_a_line);
    RUN_TEST(test_foreign_lines);
    RUN_TEST(test_lines_of_fmus);
    RUN_TEST(test_lines_of_fmus_never_wait);
    RUN_TEST(test_lines_wipe_the_status);
    RUN_TEST(test_a_status_fits_the_terminal);
    RUN_TEST(test_a_status_is_for_terminals_only);
    RUN_TEST(test_wiping_and_line_are_one_write);
    RUN_TEST(test_no_line_is_smeared);
    return UNITY_END();
}
