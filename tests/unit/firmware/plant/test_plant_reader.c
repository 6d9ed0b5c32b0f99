/* Plant readers: their threads, ends and errors of drivers, and that they stop at once.
 * The driver here is a toy that each test configures.
 */
#include <errno.h>
#include <pthread.h>
#include <sched.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <time.h>
#include <unistd.h>

#include <unity.h>

#include "firmware/base/os.h"
#include "firmware/plant/plant_reader.h"
#include "tests/support/message.h"

/* ---- the toy ---- */

struct tl_plant_io {
    double value;       /* channel c posts value + c */
    size_t channels;    /* number of channels that it posts */
    size_t posts_until; /* last poll that posts; 0: none */
    bool says_link;     /* reports a link at each poll */
    bool part_fails;    /* reports a failed part at each poll */
    bool waits;         /* blocks until it is interrupted */
    long busy_ms;       /* duration of each poll */
    size_t polls;       /* this and the next fields are atomic */
    size_t closes;
    bool interrupted;
    int policy;
    bool signals_blocked;
    char name[16];
};

static void pause_ms(long ms) {
    const struct timespec time = {.tv_sec = ms / 1000, .tv_nsec = ms % 1000 * 1000000};
    (void)nanosleep(&time, NULL);
}

static void note_thread(tl_plant_io *io) {
    struct sched_param parameter;
    sigset_t blocked;
    (void)pthread_getschedparam(pthread_self(), &io->policy, &parameter);
    (void)pthread_sigmask(SIG_SETMASK, NULL, &blocked);
    io->signals_blocked = sigismember(&blocked, SIGINT) == 1 && sigismember(&blocked, SIGTERM) == 1 &&
                          sigismember(&blocked, SIGUSR1) == 1;
    (void)pthread_getname_np(pthread_self(), io->name, sizeof io->name);
}

static void toy_poll(tl_plant_io *io, const tl_plant_io_sink *sink) {
    size_t poll = __atomic_load_n(&io->polls, __ATOMIC_ACQUIRE) + 1;
    for (size_t c = 0; c < io->channels && (io->posts_until == 0 || poll <= io->posts_until); c++) {
        tl_reading reading = {.value = io->value + (double)c, .stamp = (tl_time)poll, .quality = TL_GOOD};
        sink->post(sink->context, c, &reading);
    }
    if (io->says_link) {
        sink->link(sink->context, true, "here I am");
    }
    if (io->part_fails) {
        sink->part_failed(sink->context, "one unit is silent");
    }
    if (io->busy_ms > 0) {
        pause_ms(io->busy_ms);
    }
    if (poll == 2) { /* the name is set by now */
        note_thread(io);
    }
    __atomic_store_n(&io->polls, poll, __ATOMIC_RELEASE);
    while (io->waits && !__atomic_load_n(&io->interrupted, __ATOMIC_ACQUIRE)) {
        pause_ms(1);
    }
}

static void toy_interrupt(tl_plant_io *io) {
    __atomic_store_n(&io->interrupted, true, __ATOMIC_RELEASE);
}

static void toy_close(tl_plant_io *io) {
    (void)__atomic_add_fetch(&io->closes, 1, __ATOMIC_RELEASE);
}

static const tl_plant_io_driver TOY = {.name = "toy", .poll = toy_poll, .interrupt = toy_interrupt, .close = toy_close};

/* ---- under test ---- */

enum { SOURCES = 200, BUFFERS = 8, DEPTH = 256 };

static tl_sample_buffer_slot slots[BUFFERS][DEPTH];
static uint64_t counts[BUFFERS];
static tl_sample_buffer buffers[BUFFERS];
static tl_plant_io toys[SOURCES];
static tl_plant_source sources[SOURCES];
static tl_plant_readers *readers;
static tl_error error;

static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
static size_t links;
static bool link_good;
static char link_source[32];
static char link_text[128];

static void on_link(void *context, const char *source, bool good, const char *text) {
    TEST_ASSERT_EQUAL_PTR(buffers, context);
    (void)pthread_mutex_lock(&lock);
    links++;
    link_good = good;
    (void)snprintf(link_source, sizeof link_source, "%s", source);
    (void)snprintf(link_text, sizeof link_text, "%s", text);
    (void)pthread_mutex_unlock(&lock);
}

void setUp(void) {
    memset(slots, 0, sizeof slots);
    memset(counts, 0, sizeof counts);
    memset(toys, 0, sizeof toys);
    for (size_t i = 0; i < BUFFERS; i++) {
        buffers[i] = (tl_sample_buffer){.slots = slots[i], .count = &counts[i], .depth = DEPTH};
    }
    for (size_t i = 0; i < SOURCES; i++) {
        sources[i] = (tl_plant_source){.name = "bench of the north wing",
                                       .driver = &TOY,
                                       .io = &toys[i],
                                       .signals = {4, 2},
                                       .signal_count = 2,
                                       .period = 1000000};
    }
    readers = NULL;
    links = 0;
    error = (tl_error){TL_OK, ""};
}

void tearDown(void) {}

static void start(size_t count) {
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_plant_readers_start(sources, count, buffers, on_link, buffers, &readers, &error));
}

static void stop(size_t count) {
    tl_plant_readers_stop(readers);
    for (size_t i = 0; i < count; i++) {
        TEST_ASSERT_EQUAL_size_t(1, toys[i].closes);
    }
}

static size_t polls(size_t toy) {
    return __atomic_load_n(&toys[toy].polls, __ATOMIC_ACQUIRE);
}

static void wait_for_polls(size_t toy, size_t count) {
    tl_time deadline = tl_clock_now(NULL) + 60 * TL_SECOND;
    while (polls(toy) < count) {
        TEST_ASSERT_TRUE(tl_clock_now(NULL) < deadline);
        pause_ms(1);
    }
}

static void expect_reading(size_t signal, double value, tl_quality quality) {
    tl_reading reading;
    TEST_ASSERT_TRUE(tl_sample_buffer_at(&buffers[signal], INT64_MAX, &reading));
    TEST_ASSERT_EQUAL_DOUBLE(value, reading.value);
    TEST_ASSERT_EQUAL_INT(quality, reading.quality);
}

/* The toy's polls are 1 ns apart by their stamps. */
static void test_repeated_values_are_not_posted(void) {
    sources[0].repeats[0] = 2;
    toys[0].channels = 2;
    toys[0].posts_until = 9;
    start(1);
    wait_for_polls(0, 9);
    stop(1);
    TEST_ASSERT_EQUAL_UINT64(5, counts[4]);
    TEST_ASSERT_EQUAL_UINT64(9, counts[2]);
}

static void test_readings_go_to_their_signals(void) {
    toys[0].value = 10;
    toys[0].channels = 3; /* one more than there are signals: ignored */
    start(1);
    wait_for_polls(0, 3);
    stop(1);
    expect_reading(4, 10, TL_GOOD);
    expect_reading(2, 11, TL_GOOD);
    for (size_t i = 0; i < BUFFERS; i++) {
        TEST_ASSERT_EQUAL_INT(i == 4 || i == 2, counts[i] > 0);
    }
}

static void test_each_source_has_its_thread(void) {
    toys[0].waits = true; /* it blocks, but no other source */
    start(3);
    wait_for_polls(0, 1);
    wait_for_polls(1, 5);
    wait_for_polls(2, 5);
    TEST_ASSERT_EQUAL_size_t(1, polls(0));
    stop(3);
}

static void test_threads_are_ordinary_named_and_take_no_signals(void) {
    struct sched_param realtime = {.sched_priority = 1};
    (void)pthread_setschedparam(pthread_self(), SCHED_FIFO, &realtime); /* if permitted */
    start(1);
    struct sched_param ordinary = {.sched_priority = 0};
    TEST_ASSERT_EQUAL_INT(0, pthread_setschedparam(pthread_self(), SCHED_OTHER, &ordinary));
    wait_for_polls(0, 2);
    stop(1);
    TEST_ASSERT_EQUAL_INT(SCHED_OTHER, toys[0].policy);
    TEST_ASSERT_TRUE(toys[0].signals_blocked);
    TEST_ASSERT_EQUAL_STRING("io bench of the", toys[0].name);
    sigset_t blocked;
    TEST_ASSERT_EQUAL_INT(0, pthread_sigmask(SIG_SETMASK, NULL, &blocked));
    TEST_ASSERT_EQUAL_INT(0, sigismember(&blocked, SIGTERM)); /* unchanged in this thread */
}

static void test_links_are_told_by_name(void) {
    toys[0].says_link = true;
    start(1);
    wait_for_polls(0, 2);
    stop(1);
    TEST_ASSERT_EQUAL_size_t(polls(0), links);
    TEST_ASSERT_TRUE(link_good);
    TEST_ASSERT_EQUAL_STRING("bench of the north wing", link_source);
    TEST_ASSERT_EQUAL_STRING("here I am", link_text);
}

static void test_a_failed_part_is_not_good(void) {
    toys[0].part_fails = true;
    start(1);
    wait_for_polls(0, 2);
    stop(1);
    TEST_ASSERT_EQUAL_size_t(polls(0), links);
    TEST_ASSERT_FALSE(link_good);
    TEST_ASSERT_EQUAL_STRING("one unit is silent", link_text);
}

static void test_no_sources(void) {
    start(0);
    stop(0);
}

/* Neither for a period of an hour, nor for a driver that blocks. */
static void test_stop_does_not_wait(void) {
    sources[0].period = 3600 * TL_SECOND;
    toys[1].waits = true;
    start(2);
    wait_for_polls(0, 1);
    wait_for_polls(1, 1);
    tl_time begin = tl_clock_now(NULL);
    stop(2);
    TEST_ASSERT_TRUE(tl_clock_now(NULL) - begin < 10 * TL_SECOND);
}

static void test_periods(void) {
    sources[0].period = 20000000;
    tl_time begin = tl_clock_now(NULL);
    start(1);
    wait_for_polls(0, 6);
    TEST_ASSERT_TRUE(tl_clock_now(NULL) - begin >= 100000000); /* at least five periods */
    stop(1);
}

/* Polls of 25 ms with a period of 10 ms: at 0, 30, 60, 90 ms. Missed polls are skipped. */
static void test_a_slow_poll_skips_instants(void) {
    sources[0].period = 10000000;
    toys[0].busy_ms = 25;
    tl_time begin = tl_clock_now(NULL);
    start(1);
    wait_for_polls(0, 4);
    TEST_ASSERT_TRUE(tl_clock_now(NULL) - begin >= 115000000);
    stop(1);
}

static tl_time origin;

static tl_time run_start(void *context) {
    TEST_ASSERT_EQUAL_PTR(buffers, context);
    return origin;
}

/* The ticks are half a period after the first poll, so the second poll is not before one and a half
 * periods. The third one is. */
static void test_polls_follow_the_ticks(void) {
    sources[0].period = 40000000;
    sources[0].run_start = run_start;
    origin = tl_clock_now(NULL) + 20000000;
    start(1);
    wait_for_polls(0, 2);
    TEST_ASSERT_TRUE(tl_clock_now(NULL) - origin >= 40000000);
    stop(1);
}

static void test_no_memory_for_threads(void) {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
    TEST_IGNORE_MESSAGE("a sanitizer needs its address space");
#else
    if (getenv("TL_EMULATOR") != NULL) {
        TEST_IGNORE_MESSAGE("an emulator does not limit the address space");
    }
    struct rlimit before;
    TEST_ASSERT_EQUAL_INT(0, getrlimit(RLIMIT_AS, &before));
    char text[128] = "";
    FILE *statm = fopen("/proc/self/statm", "r");
    TEST_ASSERT_NOT_NULL(statm);
    TEST_ASSERT_NOT_NULL(fgets(text, sizeof text, statm)); /* its first number: pages in use */
    TEST_ASSERT_EQUAL_INT(0, fclose(statm));
    struct rlimit tight = before;
    tight.rlim_cur = strtoul(text, NULL, 10) * (rlim_t)sysconf(_SC_PAGESIZE) + ((rlim_t)8 << 20); /* not 200 stacks */
    TEST_ASSERT_EQUAL_INT(0, setrlimit(RLIMIT_AS, &tight));
    tl_status status = tl_plant_readers_start(sources, SOURCES, buffers, on_link, buffers, &readers, &error);
    TEST_ASSERT_EQUAL_INT(0, setrlimit(RLIMIT_AS, &before));
    TEST_ASSERT_EQUAL_INT(TL_TRY_AGAIN, status);
    TEST_ASSERT_NULL(readers);
    char parts[128];
    (void)snprintf(parts, sizeof parts, "thread|%s", strerror(EAGAIN));
    TL_EXPECT_PARTS(parts, error.text);
    for (size_t i = 0; i < SOURCES; i++) {
        TEST_ASSERT_EQUAL_size_t(1, toys[i].closes); /* with or without a thread */
    }
    size_t before_rest = polls(0);
    pause_ms(20);
    TEST_ASSERT_EQUAL_size_t(before_rest, polls(0)); /* no thread is left */
#endif
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_repeated_values_are_not_posted);
    RUN_TEST(test_readings_go_to_their_signals);
    RUN_TEST(test_each_source_has_its_thread);
    RUN_TEST(test_threads_are_ordinary_named_and_take_no_signals);
    RUN_TEST(test_links_are_told_by_name);
    RUN_TEST(test_a_failed_part_is_not_good);
    RUN_TEST(test_no_sources);
    RUN_TEST(test_stop_does_not_wait);
    RUN_TEST(test_periods);
    RUN_TEST(test_a_slow_poll_skips_instants);
    RUN_TEST(test_polls_follow_the_ticks);
    RUN_TEST(test_no_memory_for_threads);
    return UNITY_END();
}
