/* A sample buffer whose writer is killed at any instruction, thousands of times. A new writer
 * follows each time. */
#include <signal.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include <unity.h>

#include "firmware/plant/sample_buffer.h"
#include "firmware/process/sanitizer.h"
#include "tests/support/random_numbers.h"

enum { DEPTH = 256, KILLS = 3000, FEW_KILLS = 300, LONGEST_NS = 200000, LONGEST_SLOW_NS = 5000000, LOOKS = 500 };

/* The reader's mapping is read-only; writers have another one. */
static struct shared {
    tl_sample_buffer_slot slots[DEPTH];
    uint64_t count;
} * ours, *theirs;

static tl_sample_buffer buffer;
static tl_time newest; /* seen so far */
static unsigned left_odd, left_uncounted;

void setUp(void) {
    int file = memfd_create("mailbox", MFD_CLOEXEC);
    TEST_ASSERT_EQUAL_INT(0, ftruncate(file, sizeof *ours));
    ours = mmap(NULL, sizeof *ours, PROT_READ, MAP_SHARED, file, 0);
    theirs = mmap(NULL, sizeof *theirs, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
    TEST_ASSERT_TRUE(ours != MAP_FAILED && theirs != MAP_FAILED);
    (void)close(file);
    buffer = (tl_sample_buffer){.slots = ours->slots, .count = &ours->count, .depth = DEPTH};
}

void tearDown(void) {
    (void)munmap(ours, sizeof *ours);
    (void)munmap(theirs, sizeof *theirs);
}

/* ---- the writer ---- */

/* A timer of the kernel sends the signal, so it arrives at any instruction, also on a busy
 * machine. */
static void be_killed_after(long nanoseconds) {
    struct sigevent event = {.sigev_notify = SIGEV_SIGNAL, .sigev_signo = SIGKILL};
    const struct itimerspec once = {.it_value = {.tv_nsec = nanoseconds}};
    timer_t timer;
    if (timer_create(CLOCK_MONOTONIC, &event, &timer) != 0 || timer_settime(timer, 0, &once, NULL) != 0) {
        _exit(1);
    }
}

/* Value, stamp and quality of a post match each other. The stamp is the number of the post. */
static void post(const tl_sample_buffer *own) {
    tl_time stamp = (tl_time)*own->count;
    const tl_reading reading = {.value = 3.0 * (double)stamp, .stamp = stamp, .quality = (tl_quality)(stamp % 5)};
    tl_sample_buffer_post(own, &reading);
}

/* Continues the posts of the previous writer. */
static void post_until_killed(long nanoseconds) {
    const tl_sample_buffer own = {.slots = theirs->slots, .count = &theirs->count, .depth = DEPTH};
    tl_sample_buffer_repair(&own);
    post(&own); /* before the timer, because an emulator needs long to translate new code */
    be_killed_after(nanoseconds);
    for (;;) {
        post(&own);
    }
}

static pid_t start(tl_test_random *random, long longest_ns) {
    long nanoseconds = 1 + (long)tl_test_random_below(random, (size_t)longest_ns);
    pid_t writer = fork();
    TEST_ASSERT_NOT_EQUAL_INT(-1, writer);
    if (writer == 0) {
        post_until_killed(nanoseconds);
    }
    return writer;
}

/* options: as for waitpid(). */
static bool is_dead(pid_t writer, int options) {
    int status = 0;
    pid_t ended = waitpid(writer, &status, options);
    TEST_ASSERT_TRUE(ended == 0 || (ended == writer && WIFSIGNALED(status) && WTERMSIG(status) == SIGKILL));
    return ended == writer;
}

/* ---- the reader ---- */

static void expect_whole(const tl_reading *reading) {
    TEST_ASSERT_EQUAL_DOUBLE(3.0 * (double)reading->stamp, reading->value);
    TEST_ASSERT_EQUAL_INT((int)(reading->stamp % 5), (int)reading->quality);
}

/* Reads the newest reading, any kept one, and the oldest. */
static void look(tl_test_random *random) {
    tl_reading reading;
    if (tl_sample_buffer_at(&buffer, INT64_MAX, &reading)) {
        expect_whole(&reading);
        TEST_ASSERT_TRUE(reading.stamp >= newest);
        newest = reading.stamp;
    }
    tl_time back = newest - (tl_time)tl_test_random_below(random, DEPTH);
    if (back >= 0 && tl_sample_buffer_at(&buffer, back, &reading)) {
        expect_whole(&reading);
        TEST_ASSERT_TRUE(reading.stamp >= back);
    }
    if (tl_sample_buffer_from(&buffer, -1, INT64_MAX, &reading)) {
        expect_whole(&reading);
        TEST_ASSERT_TRUE(reading.stamp > newest - DEPTH);
    }
}

/* Without a writer, all kept posts can be read, except the one that may be half overwritten. */
static void look_at_what_is_left(void) {
    uint64_t count = ours->count;
    const tl_sample_buffer_slot *next = &ours->slots[count % DEPTH];
    tl_reading reading;
    left_odd += next->sequence == 2 * count + 1 ? 1 : 0;
    left_uncounted += next->sequence == 2 * count + 2 ? 1 : 0;
    for (uint64_t post = count > DEPTH ? count - DEPTH + 1 : 0; post < count; post++) {
        TEST_ASSERT_TRUE(tl_sample_buffer_at(&buffer, (tl_time)post, &reading));
        TEST_ASSERT_EQUAL_INT64((tl_time)post, reading.stamp);
        expect_whole(&reading);
    }
}

static void test_killed_at_any_instruction(void) {
    tl_test_random random = {3};
    const bool is_slow = TL_HAS_SANITIZER || getenv("TL_EMULATOR") != NULL; /* the start of a process takes long */
    const int kills = is_slow ? FEW_KILLS : KILLS;
    const long longest_ns = is_slow ? LONGEST_SLOW_NS : LONGEST_NS;
    for (int i = 0; i < kills; i++) {
        pid_t writer = start(&random, longest_ns);
        for (int looks = 1; !is_dead(writer, looks < LOOKS ? WNOHANG : 0); looks++) {
            look(&random);
        }
        look(&random);
        look_at_what_is_left();
    }
    char message[128];
    (void)snprintf(message, sizeof message,
                   "of %d kills %u left a slot odd, %u a post that was not counted; %lld posts", kills, left_odd,
                   left_uncounted, (long long)newest);
    TEST_ASSERT_TRUE_MESSAGE(left_odd > 0, message); /* otherwise the test was not effective */
    TEST_MESSAGE(message);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_killed_at_any_instruction);
    return UNITY_END();
}
