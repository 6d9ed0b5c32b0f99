/* The GPIO driver on emulated lines: edges, missing edges, and missing lines.
 * tests/hil/box/test_live_gpio.py uses the chips and lines of a real kernel.
 */
#include <errno.h>
#include <math.h>
#include <poll.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include <unity.h>

#include "board/gpio/gpio.h"
#include "board/gpio/gpio_lines.h"
#include "tests/support/driver_probe.h"
#include "tests/support/message.h"
#include "tests/support/real_time.h"

#define MS (TL_SECOND / 1000)

enum { CHANNELS = 3, QUEUE = 4096, POSTS = 16384 };

/* ---- emulated lines ---- */

struct tl_gpio_line {
    bool open;
    bool without_edges;
    bool level;
    int level_failure, edges_failure, request_failure;
    const char *trouble; /* why the line is not found; NULL: it is found */
    tl_gpio_line_state state;
    int ready; /* eventfd; in one test a pipe that has hung up */
    tl_gpio_edge queue[QUEUE];
    size_t first, last;
    size_t requests;
    size_t looks; /* calls that read edges */
    tl_gpio_channel asked;
};

static struct tl_gpio_line lines[CHANNELS];
static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER; /* of the queues and levels */

static struct tl_gpio_line *find(const tl_gpio_channel *channel) {
    return &lines[channel->line == NULL ? channel->offset : (unsigned)(channel->line[0] - 'A')];
}

bool tl_gpio_find(const char *chip, const tl_gpio_channel *channel, tl_gpio_found *found, char *text, size_t size) {
    const struct tl_gpio_line *line = find(channel);
    (void)chip;
    *found = (tl_gpio_found){.path = "/dev/gpiochip9", .chip = "gpiochip9 (bench)", .state = line->state};
    found->offset = (unsigned)(line - lines);
    (void)snprintf(text, size, "%s", line->trouble != NULL ? line->trouble : "");
    return line->trouble == NULL;
}

int tl_gpio_line_request(const char *path, unsigned offset, const tl_gpio_channel *channel, tl_gpio_line **line) {
    TEST_ASSERT_EQUAL_STRING("/dev/gpiochip9", path);
    TEST_ASSERT_FALSE(lines[offset].open);
    lines[offset].requests++;
    lines[offset].asked = *channel;
    lines[offset].open = lines[offset].request_failure == 0;
    if (lines[offset].open) {
        *line = &lines[offset];
    }
    return lines[offset].request_failure;
}

int tl_gpio_line_descriptor(const tl_gpio_line *line) {
    return line->without_edges ? -1 : line->ready;
}

int tl_gpio_line_level(tl_gpio_line *line, bool *level) {
    (void)pthread_mutex_lock(&lock);
    *level = line->level;
    int failure = line->level_failure;
    (void)pthread_mutex_unlock(&lock);
    return failure;
}

int tl_gpio_line_edges(tl_gpio_line *line, tl_gpio_edge *edges, size_t room, size_t *count) {
    uint64_t waste = 0;
    (void)pthread_mutex_lock(&lock);
    int failure = line->edges_failure;
    line->looks++;
    for (*count = 0; failure == 0 && *count < room && line->first < line->last; (*count)++) {
        edges[*count] = line->queue[line->first % QUEUE];
        line->first++;
    }
    if (failure == 0 && *count == 0) {
        ssize_t was = read(line->ready, &waste, sizeof waste);
        (void)was;
        failure = EAGAIN;
    }
    (void)pthread_mutex_unlock(&lock);
    return failure;
}

void tl_gpio_line_release(tl_gpio_line *line) {
    if (line != NULL) {
        line->open = false;
    }
}

static void put_edge(size_t line, bool level, tl_time stamp) {
    const uint64_t one = 1;
    (void)pthread_mutex_lock(&lock);
    lines[line].level = level;
    lines[line].queue[lines[line].last % QUEUE] = (tl_gpio_edge){.level = level, .stamp = stamp};
    lines[line].last++;
    (void)pthread_mutex_unlock(&lock);
    ssize_t written = write(lines[line].ready, &one, sizeof one);
    (void)written;
}

static void set_level(size_t line, bool level) {
    (void)pthread_mutex_lock(&lock);
    lines[line].level = level;
    (void)pthread_mutex_unlock(&lock);
}

static void set_failures(size_t line, int level, int edges) {
    (void)pthread_mutex_lock(&lock);
    lines[line].level_failure = level;
    lines[line].edges_failure = edges;
    (void)pthread_mutex_unlock(&lock);
}

/* ---- reports of the driver ---- */

static tl_reading history[CHANNELS][POSTS];
static tl_driver_probe probe;

static void on_post(void *context, size_t channel, const tl_reading *reading) {
    TEST_ASSERT_TRUE(channel < CHANNELS && probe.posts[channel] < POSTS);
    if (reading->quality == TL_GOOD && probe.posts[channel] > 0) {
        TEST_ASSERT_TRUE(reading->stamp >= history[channel][probe.posts[channel] - 1].stamp);
    }
    TEST_ASSERT_TRUE(reading->stamp <= tl_test_now());
    history[channel][probe.posts[channel]] = *reading;
    tl_probe_post(context, channel, reading);
}

static void expect_connected(const char *parts) {
    tl_probe_expect_link(&probe, true, parts);
    tl_probe_expect_link(&probe, true, "connected");
    TEST_ASSERT_FALSE_MESSAGE(tl_test_has_parts(probe.link_text, "edges"), probe.link_text);
}

/* ---- the driver under test ---- */

static tl_gpio_channel channels[CHANNELS];

static void open_driver(size_t count, double period_s) {
    const tl_gpio_settings settings = {
        .chip = "bench", .period_s = period_s, .channels = channels, .channel_count = count};
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_gpio_open(&settings, &probe.io, &probe.error));
}

/* On a busy machine one poll may end before the driver reads the line a second time. */
static void poll_until_value(double value) {
    for (tl_time end = tl_test_now() + 60 * TL_SECOND; tl_probe_newest(&probe, 0)->value != value;) {
        TEST_ASSERT_TRUE(tl_test_now() < end);
        tl_probe_poll(&probe);
    }
    tl_probe_expect(&probe, 0, value, TL_GOOD);
}

void setUp(void) {
    static const char *const names[] = {"A", "B", NULL};
    memset(lines, 0, sizeof lines);
    for (size_t i = 0; i < CHANNELS; i++) {
        lines[i].ready = eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC);
        channels[i] = (tl_gpio_channel){.line = names[i], .offset = (unsigned)i};
    }
    tl_probe_begin(&probe, &tl_gpio_driver);
    probe.sink.post = on_post;
}

void tearDown(void) {
    tl_probe_end(&probe);
    for (size_t i = 0; i < CHANNELS; i++) {
        TEST_ASSERT_FALSE(lines[i].open);
        (void)close(lines[i].ready);
    }
}

/* ---- edges ---- */

static void test_levels_and_edges(void) {
    set_level(1, true);
    open_driver(3, 0.005);
    tl_probe_poll(&probe);
    tl_probe_expect(&probe, 0, 0, TL_GOOD);
    tl_probe_expect(&probe, 1, 1, TL_GOOD);
    tl_probe_expect(&probe, 2, 0, TL_GOOD);
    TEST_ASSERT_EQUAL_size_t(3, probe.links);
    expect_connected("line 2 of bench|gpiochip9 (bench)");
    tl_time stamp = tl_test_now();
    put_edge(0, true, stamp);
    tl_probe_poll(&probe);
    /* the stamp of the edge; the level follows */
    TEST_ASSERT_EQUAL_INT64(stamp, history[0][1].stamp);
    TEST_ASSERT_EQUAL_DOUBLE(1, history[0][1].value);
    TEST_ASSERT_EQUAL_size_t(3, probe.posts[0]);
    TEST_ASSERT_TRUE(tl_probe_newest(&probe, 0)->stamp > stamp);
    TEST_ASSERT_EQUAL_size_t(2, probe.posts[1]);
    TEST_ASSERT_EQUAL_size_t(3, probe.links);
}

static tl_time edge_stamp;

/* The driver posts the level first, then the edges. */
static void wait_for_level(void) {
    while (__atomic_load_n(&probe.posts[0], __ATOMIC_ACQUIRE) == 0) {
        tl_test_pause_ms(1);
    }
}

static void *edge_soon(void *context) {
    (void)context;
    wait_for_level();
    tl_test_pause_ms(50);
    edge_stamp = tl_test_now();
    put_edge(0, true, edge_stamp);
    return NULL;
}

/* The driver posts an edge at once, not at the end of the period. Repeated if a busy machine made
 * the edge late. */
static void test_an_edge_is_posted_when_it_comes(void) {
    tl_time begin;
    do {
        pthread_t thread;
        tearDown();
        setUp();
        open_driver(1, 1);
        TEST_ASSERT_EQUAL_INT(0, pthread_create(&thread, NULL, edge_soon, NULL));
        begin = tl_test_now();
        tl_probe_poll(&probe);
        TEST_ASSERT_TRUE(tl_test_now() - begin >= 990 * MS); /* the poll lasted the whole period */
        (void)pthread_join(thread, NULL);
    } while (edge_stamp - begin > 800 * MS);
    TEST_ASSERT_EQUAL_size_t(2, probe.posts[0]);
    TEST_ASSERT_EQUAL_INT64(edge_stamp, tl_probe_newest(&probe, 0)->stamp);
    tl_probe_expect(&probe, 0, 1, TL_GOOD);
}

static tl_time longest_gap; /* between two edges */

static void *bounce_soon(void *context) {
    (void)context;
    wait_for_level();
    tl_test_pause_ms(20);
    longest_gap = 0;
    for (int i = 0; i < 7; i++) {
        tl_time before = edge_stamp;
        edge_stamp = tl_test_now();
        put_edge(0, i % 2 == 0, edge_stamp);
        if (i > 0 && edge_stamp - before > longest_gap) {
            longest_gap = edge_stamp - before;
        }
        tl_test_pause_ms(1);
    }
    return NULL;
}

/* Repeated if a busy machine kept the line still between two edges, or moved it too late. */
static void test_a_bounce(void) {
    tl_time begin;
    do {
        pthread_t thread;
        tearDown();
        setUp();
        channels[0].debounce_s = 0.3;
        open_driver(1, 1);
        TEST_ASSERT_EQUAL_INT(0, pthread_create(&thread, NULL, bounce_soon, NULL));
        begin = tl_test_now();
        tl_probe_poll(&probe);
        (void)pthread_join(thread, NULL);
    } while (longest_gap > 250 * MS || edge_stamp - begin > 600 * MS);
    poll_until_value(1);
    TEST_ASSERT_EQUAL_size_t(2, probe.posts[0]);
    TEST_ASSERT_EQUAL_INT64(edge_stamp, tl_probe_newest(&probe, 0)->stamp);
}

static void test_a_burst_is_bounded_and_the_newest_wins(void) {
    open_driver(2, 0.005);
    tl_probe_poll(&probe);
    tl_time begin = tl_test_now();
    for (int i = 0; i < 3001; i++) {
        put_edge(0, i % 2 == 0, begin + i);
    }
    tl_probe_poll(&probe);
    TEST_ASSERT_TRUE(lines[0].looks <= 200);
    TEST_ASSERT_TRUE(probe.posts[0] <= 200);
    /* the level of the line, not that of the last edge within the budget */
    tl_probe_expect(&probe, 0, 1, TL_GOOD);
    tl_probe_expect_part(&probe, "line A|edges|missed");
    size_t before = probe.links;
    for (int i = 0; i < 40; i++) {
        tl_probe_poll(&probe);
    }
    TEST_ASSERT_EQUAL_size_t(before, probe.links); /* not reported again so soon */
    TEST_ASSERT_EQUAL_size_t(3001, lines[0].first);
    tl_probe_expect(&probe, 0, 1, TL_GOOD);
    tl_probe_expect(&probe, 1, 0, TL_GOOD);
}

/* The driver does not know what a debounced line did beyond the budget. The line must be still
 * after the burst. Repeated if a busy machine kept the line still between two bursts. */
static void test_a_burst_does_not_pass_for_stillness(void) {
    size_t before;
    do {
        tearDown();
        setUp();
        channels[0].debounce_s = 0.5;
        open_driver(1, 0.01);
        tl_probe_poll(&probe);
        before = probe.posts[0];
        longest_gap = 0;
        for (tl_time end = tl_test_now() + TL_SECOND, last = tl_test_now(); last < end;) {
            for (int k = 0; k < 201; k++) {
                put_edge(0, k % 2 == 0, tl_test_now());
            }
            tl_probe_poll(&probe);
            tl_time gap = tl_test_now() - last;
            longest_gap = gap > longest_gap ? gap : longest_gap;
            last += gap;
        }
    } while (longest_gap > 400 * MS);
    TEST_ASSERT_EQUAL_size_t(before, probe.posts[0]);
    poll_until_value(1);
}

static void test_an_edge_that_never_comes(void) {
    open_driver(1, 0.02);
    tl_probe_poll(&probe);
    set_level(0, true);
    poll_until_value(1);
    tl_probe_expect_part(&probe, "line A|1 edges|missed");
}

static void test_a_line_without_edges(void) {
    lines[0].without_edges = true;
    open_driver(1, 0.005);
    tl_probe_poll(&probe);
    tl_probe_expect_link(&probe, true, "line A|connected|line 0|gpiochip9 (bench)|without edges");
    set_level(0, true);
    tl_probe_poll(&probe);
    tl_probe_expect(&probe, 0, 1, TL_GOOD);
    set_level(0, false);
    tl_probe_poll(&probe);
    tl_probe_expect(&probe, 0, 0, TL_GOOD);
    TEST_ASSERT_EQUAL_size_t(0, lines[0].looks);
}

static void test_a_line_without_edges_is_debounced(void) {
    lines[0].without_edges = true;
    channels[0].debounce_s = 0.05;
    open_driver(1, 0.005);
    tl_probe_poll(&probe);
    set_level(0, true);
    tl_time begin = tl_test_now();
    while (tl_probe_newest(&probe, 0)->value == 0) {
        TEST_ASSERT_TRUE(tl_test_now() < begin + 60 * TL_SECOND);
        tl_probe_poll(&probe);
    }
    TEST_ASSERT_TRUE(tl_test_now() - begin >= 50 * MS);
    /* levels between two reads are not counted as missed edges */
    TEST_ASSERT_EQUAL_size_t(1, probe.links);
}

/* A signal with two delays has two channels. */
static void test_two_channels_of_one_line(void) {
    channels[1].line = "A";
    channels[0].line = "B";
    channels[2] = channels[1];
    open_driver(3, 0.005);
    put_edge(0, true, tl_test_now());
    tl_probe_poll(&probe);
    put_edge(0, false, tl_test_now());
    tl_probe_poll(&probe);
    TEST_ASSERT_EQUAL_size_t(1, lines[0].requests);
    TEST_ASSERT_EQUAL_size_t(probe.posts[1], probe.posts[2]);
    TEST_ASSERT_EQUAL_MEMORY(history[1], history[2], probe.posts[1] * sizeof history[1][0]);
    tl_probe_expect(&probe, 2, 0, TL_GOOD);
    set_failures(0, ENODEV, 0);
    tl_probe_poll(&probe);
    tl_probe_expect(&probe, 1, 0, TL_NO_LINK);
    tl_probe_expect(&probe, 2, 0, TL_NO_LINK);
    tl_probe_expect(&probe, 0, 0, TL_GOOD);
}

/* ---- missing lines ---- */

static void expect_refused_then_there(const char *parts) {
    tl_time begin = tl_test_now();
    open_driver(1, 0.005);
    tl_probe_poll(&probe);
    tl_probe_expect(&probe, 0, 0, TL_NO_LINK);
    tl_probe_expect_link(&probe, false, parts);
    for (int i = 0; i < 30; i++) {
        tl_probe_poll(&probe);
    }
    TEST_ASSERT_EQUAL_size_t(1, probe.links); /* reported once */
    TEST_ASSERT_TRUE((tl_time)lines[0].requests <=
                     3 + (tl_test_now() - begin) / (200 * MS)); /* after 0.1 s, 0.2 s, 0.4 s, … */
    lines[0].trouble = NULL;
    lines[0].request_failure = 0;
    lines[0].state = (tl_gpio_line_state){.used = false};
    tl_probe_poll_until(&probe, 0, TL_GOOD);
    expect_connected("line A|line 0|gpiochip9 (bench)");
}

static void test_a_line_that_is_not_found(void) {
    lines[0].trouble = "ambiguous name";
    expect_refused_then_there("line A|ambiguous name");
    TEST_ASSERT_EQUAL_size_t(1, lines[0].requests);
}

static void test_a_line_in_use(void) {
    lines[0].state = (tl_gpio_line_state){.used = true, .consumer = "door"};
    expect_refused_then_there("line A|line 0|gpiochip9 (bench)|\"door\"");
}

static void test_a_line_that_cannot_be_requested(void) {
    lines[0].request_failure = EPERM;
    expect_refused_then_there("line A|line 0|gpiochip9 (bench)|Operation not permitted");
}

static void test_an_output_is_left_alone(void) {
    lines[0].state = (tl_gpio_line_state){.output = true};
    expect_refused_then_there("line A|line 0|gpiochip9 (bench)|output");
    TEST_ASSERT_EQUAL_size_t(1, lines[0].requests);
}

static void test_one_line_does_not_stop_the_others(void) {
    lines[1].trouble = "unknown name";
    open_driver(2, 0.005);
    tl_probe_poll(&probe);
    tl_probe_expect(&probe, 0, 0, TL_GOOD);
    tl_probe_expect(&probe, 1, 0, TL_NO_LINK);
    tl_probe_expect_part(&probe, "line B|unknown name");
    set_failures(0, ENODEV, 0);
    tl_probe_poll(&probe);
    tl_probe_expect(&probe, 0, 0, TL_NO_LINK);
    tl_probe_expect_link(&probe, false, "line A|chip");
}

static void test_a_level_that_fails_at_once(void) {
    set_failures(0, EIO, 0);
    open_driver(1, 0.005);
    tl_probe_poll(&probe);
    tl_probe_expect(&probe, 0, 0, TL_NO_LINK);
    tl_probe_expect_link(&probe, false, "line A|Input/output error");
}

/* ---- a chip that goes away ---- */

static void expect_gone_and_back(void) {
    tl_probe_poll_until(&probe, 0, TL_NO_LINK);
    tl_probe_expect_link(&probe, false, "line A|chip");
    TEST_ASSERT_FALSE(lines[0].open);
    set_failures(0, 0, 0);
    set_level(0, true);
    tl_probe_poll_until(&probe, 0, TL_GOOD);
    tl_probe_expect(&probe, 0, 1, TL_GOOD);
    TEST_ASSERT_EQUAL_size_t(2, lines[0].requests);
}

static void test_a_chip_that_only_the_level_misses(void) {
    open_driver(1, 0.005);
    tl_probe_poll(&probe);
    set_failures(0, ENODEV, 0);
    expect_gone_and_back();
}

static void test_a_chip_that_reading_edges_misses(void) {
    open_driver(1, 0.005);
    tl_probe_poll(&probe);
    set_failures(0, 0, ENODEV);
    expect_gone_and_back();
}

/* poll() always returns at once, but there is neither an edge nor an error. The driver must not
 * spin. */
static void test_a_line_that_has_hung_up(void) {
    int ends[2];
    open_driver(1, 0.2);
    tl_probe_poll(&probe);
    TEST_ASSERT_EQUAL_INT(0, pipe(ends));
    int ready = lines[0].ready;
    (void)close(ends[1]);
    lines[0].ready = ends[0]; /* hung up */
    lines[0].looks = 0;
    tl_time begin = tl_test_now();
    tl_probe_poll(&probe);
    TEST_ASSERT_TRUE(tl_test_now() - begin >= 190 * MS);
    TEST_ASSERT_TRUE(lines[0].looks <= 600);
    (void)close(ends[0]);
    lines[0].ready = ready;
}

/* ---- interrupt ---- */

static void test_interrupt(void) {
    open_driver(1, 60);
    tl_time begin = tl_test_now();
    pthread_t thread = tl_probe_interrupt_after(&probe, 50);
    tl_probe_poll(&probe);
    (void)pthread_join(thread, NULL);
    TEST_ASSERT_TRUE(tl_test_now() - begin < 20 * TL_SECOND);
    size_t before = probe.posts[0];
    tl_gpio_driver.interrupt(probe.io); /* not lost if no poll is waiting */
    tl_probe_poll(&probe);
    TEST_ASSERT_TRUE(tl_test_now() - begin < 20 * TL_SECOND);
    TEST_ASSERT_EQUAL_size_t(before, probe.posts[0]);
}

/* ---- settings ---- */

static void expect_refused(const tl_gpio_settings *settings, const char *parts) {
    tl_plant_io *none = NULL;
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, tl_gpio_open(settings, &none, &probe.error));
    TEST_ASSERT_NULL(none);
    TL_EXPECT_PARTS(parts, probe.error.text);
}

static void test_settings_are_passed_on(void) {
    channels[0].active_low = true;
    channels[0].bias = TL_GPIO_PULL_UP;
    open_driver(1, 0.005);
    tl_probe_poll(&probe);
    TEST_ASSERT_TRUE(lines[0].asked.active_low);
    TEST_ASSERT_EQUAL_INT(TL_GPIO_PULL_UP, lines[0].asked.bias);
}

static void test_settings_that_are_wrong(void) {
    tl_gpio_settings settings = {.chip = "", .period_s = 1, .channels = channels, .channel_count = 3};
    expect_refused(&settings, "chip|empty");
    settings.chip = NULL;
    expect_refused(&settings, "channel 2|offset|chip");
    settings.chip = "bench";
    settings.period_s = 0;
    expect_refused(&settings, "period_s|0|1e-5|3600");
    settings.period_s = (double)NAN;
    expect_refused(&settings, "period_s|nan|1e-5|3600");
    settings.period_s = 1;
    channels[1].line = "";
    expect_refused(&settings, "channel 1|line|empty");
    channels[1].line = "B";
    channels[1].debounce_s = 61;
    expect_refused(&settings, "channel 1|debounce_s|61|60");
    channels[1].debounce_s = 0;
    channels[1].bias = (tl_gpio_bias)4;
    expect_refused(&settings, "channel 1|bias|4");
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_levels_and_edges);
    RUN_TEST(test_an_edge_is_posted_when_it_comes);
    RUN_TEST(test_a_bounce);
    RUN_TEST(test_a_burst_is_bounded_and_the_newest_wins);
    RUN_TEST(test_a_burst_does_not_pass_for_stillness);
    RUN_TEST(test_an_edge_that_never_comes);
    RUN_TEST(test_a_line_without_edges);
    RUN_TEST(test_a_line_without_edges_is_debounced);
    RUN_TEST(test_two_channels_of_one_line);
    RUN_TEST(test_a_line_that_is_not_found);
    RUN_TEST(test_a_line_in_use);
    RUN_TEST(test_a_line_that_cannot_be_requested);
    RUN_TEST(test_an_output_is_left_alone);
    RUN_TEST(test_one_line_does_not_stop_the_others);
    RUN_TEST(test_a_level_that_fails_at_once);
    RUN_TEST(test_a_chip_that_only_the_level_misses);
    RUN_TEST(test_a_chip_that_reading_edges_misses);
    RUN_TEST(test_a_line_that_has_hung_up);
    RUN_TEST(test_interrupt);
    RUN_TEST(test_settings_are_passed_on);
    RUN_TEST(test_settings_that_are_wrong);
    return UNITY_END();
}
