/* Reading a file in pieces, with too small a buffer, and with interrupting signals. */
#include <errno.h>
#include <pthread.h>
#include <signal.h>
#include <string.h>
#include <unistd.h>

#include <unity.h>

#include "firmware/base/os.h"
#include "tests/support/real_time.h"

static int ends[2];
static char bytes[16];
static pthread_t reader; /* receives the signals */

void setUp(void) {
    TEST_ASSERT_EQUAL_INT(0, pipe(ends));
    memset(bytes, 0, sizeof bytes);
}

void tearDown(void) {
    (void)close(ends[0]);
}

static void *say_and_interrupt(void *context) {
    (void)context;
    for (int i = 0; i < 3; i++) {
        tl_test_pause_ms(20);
        (void)pthread_kill(reader, SIGUSR1);
        tl_test_pause_ms(20);
        ssize_t written = write(ends[1], "abc", 3);
        (void)written;
    }
    (void)close(ends[1]);
    return NULL;
}

static void nothing(int number) {
    (void)number;
}

static void test_pieces_and_signals(void) {
    const struct sigaction on_signal = {.sa_handler = nothing}; /* without SA_RESTART: read() ends with EINTR */
    pthread_t thread;
    reader = pthread_self();
    TEST_ASSERT_EQUAL_INT(0, sigaction(SIGUSR1, &on_signal, NULL));
    TEST_ASSERT_EQUAL_INT(0, pthread_create(&thread, NULL, say_and_interrupt, NULL));
    ssize_t size = tl_file_bytes_read(ends[0], bytes, sizeof bytes);
    TEST_ASSERT_EQUAL_INT(0, pthread_join(thread, NULL));
    TEST_ASSERT_EQUAL_INT(9, size);
    TEST_ASSERT_EQUAL_STRING("abcabcabc", bytes);
}

static void test_no_more_than_there_is_room_for(void) {
    TEST_ASSERT_EQUAL_INT(5, write(ends[1], "abcde", 5));
    (void)close(ends[1]);
    TEST_ASSERT_EQUAL_INT(3, tl_file_bytes_read(ends[0], bytes, 3));
    TEST_ASSERT_EQUAL_STRING("abc", bytes);
    TEST_ASSERT_EQUAL_INT(2, tl_file_bytes_read(ends[0], bytes, sizeof bytes));
    TEST_ASSERT_EQUAL_INT(0, tl_file_bytes_read(ends[0], bytes, sizeof bytes));
}

static void test_what_cannot_be_read(void) {
    TEST_ASSERT_EQUAL_INT(-1, tl_file_bytes_read(ends[1], bytes, sizeof bytes));
    TEST_ASSERT_EQUAL_INT(EBADF, errno);
    (void)close(ends[1]);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_pieces_and_signals);
    RUN_TEST(test_no_more_than_there_is_room_for);
    RUN_TEST(test_what_cannot_be_read);
    return UNITY_END();
}
