/* The Modbus driver on a serial line, with a peer at the other end of a pseudo-terminal.
 *
 * The peer records all that the driver sends. tearDown() checks that these are whole read requests
 * with right check sums.
 */
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <poll.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/inotify.h>
#include <sys/ioctl.h>
#include <sys/stat.h>
#include <sys/sysmacros.h>
#include <termios.h>
#include <unistd.h>

#include <unity.h>

#include "board/modbus/modbus.h"
#include "tests/support/driver_probe.h"
#include "tests/support/message.h"
#include "tests/support/modbus_peer.h"
#include "tests/support/real_time.h"
#include "tests/support/scratch.h"

enum { CHANNELS = 16, REQUEST = 8, FRAME = 264 };

/* ---- a peer with the answers of a test ---- */

/* Answers a request on the line. Runs in the thread of the peer. */
typedef void answer_function(int line, const uint8_t *request);

static tl_modbus_peer other = TL_MODBUS_PEER;
static int master; /* the end of the peer */
/* Guarded by the lock of the peer: */
static answer_function *answer_now;
static tl_time last_request; /* time of the last request */
static char path[64];        /* a link to the end of the driver */

static answer_function *note(const uint8_t *request) {
    (void)pthread_mutex_lock(&other.lock);
    tl_modbus_peer_note(&other, request, REQUEST);
    last_request = tl_test_now();
    answer_function *answer = answer_now;
    (void)pthread_mutex_unlock(&other.lock);
    return answer;
}

static void *run_peer(void *context) {
    uint8_t request[REQUEST];
    size_t size = 0;
    (void)context;
    for (;;) {
        struct pollfd both[2] = {{.fd = other.wake, .events = POLLIN}, {.fd = master, .events = POLLIN}};
        (void)poll(both, 2, -1);
        if (both[0].revents != 0) {
            return NULL;
        }
        ssize_t count = read(master, request + size, REQUEST - size);
        if (count <= 0) { /* the other end is closed */
            tl_test_pause_ms(1);
            continue;
        }
        size += (size_t)count;
        if (size == REQUEST) {
            size = 0;
            note(request)(master, request);
        }
    }
}

static void set_answer(answer_function *answer) {
    (void)pthread_mutex_lock(&other.lock);
    answer_now = answer;
    (void)pthread_mutex_unlock(&other.lock);
}

static void plug_in(answer_function *answer) {
    set_answer(answer);
    master = posix_openpt(O_RDWR | O_NOCTTY | O_CLOEXEC);
    TEST_ASSERT_TRUE(master >= 0);
    TEST_ASSERT_EQUAL_INT(0, grantpt(master));
    TEST_ASSERT_EQUAL_INT(0, unlockpt(master));
    TEST_ASSERT_EQUAL_INT(0, symlink(ptsname(master), path));
    tl_modbus_peer_run(&other, run_peer);
}

static void pull_out(void) {
    if (other.runs) {
        tl_modbus_peer_stop(&other);
        (void)close(master);
    }
    (void)unlink(path);
}

static void say(int line, const uint8_t *bytes, size_t size) {
    ssize_t written = write(line, bytes, size);
    (void)written;
}

static unsigned address_of(const uint8_t *request) {
    return (unsigned)request[2] * 256 + request[3];
}

static unsigned count_of(const uint8_t *request) {
    return (unsigned)request[4] * 256 + request[5];
}

static size_t finish(uint8_t *frame, size_t size) {
    uint16_t sum = tl_modbus_peer_sum(frame, size);
    frame[size] = (uint8_t)sum;
    frame[size + 1] = (uint8_t)(sum >> 8);
    return size + 2;
}

/* ---- answers ---- */

/* Each register holds its own address; a bit is 1 if its address is odd. */
static size_t right_answer(const uint8_t *request, uint8_t *frame) {
    frame[0] = request[0];
    frame[1] = request[1];
    return finish(frame, 2 + tl_modbus_peer_values(request[1], address_of(request), count_of(request), frame + 2));
}

static void sane(int line, const uint8_t *request) {
    uint8_t frame[FRAME];
    say(line, frame, right_answer(request, frame));
}

static void silent(int line, const uint8_t *request) {
    (void)line;
    (void)request;
}

static void exception(int line, const uint8_t *request, uint8_t code) {
    uint8_t frame[5] = {request[0], request[1] | 0x80, code};
    say(line, frame, finish(frame, 3));
}

static void half_a_frame(int line, const uint8_t *request) {
    uint8_t frame[FRAME];
    say(line, frame, right_answer(request, frame) / 2);
}

static void wrong_check_sum(int line, const uint8_t *request) {
    uint8_t frame[FRAME];
    size_t size = right_answer(request, frame);
    frame[size - 1] ^= 1;
    say(line, frame, size);
}

static void garbage(int line, const uint8_t *request) {
    uint8_t frame[40];
    (void)request;
    for (size_t i = 0; i < sizeof frame; i++) {
        frame[i] = (uint8_t)(251 * i + 17);
    }
    say(line, frame, sizeof frame);
}

static void another_unit(int line, const uint8_t *request) {
    uint8_t other_request[REQUEST];
    memcpy(other_request, request, REQUEST);
    other_request[0]++;
    sane(line, other_request);
}

static void another_function(int line, const uint8_t *request) {
    uint8_t other_request[REQUEST];
    memcpy(other_request, request, REQUEST);
    other_request[1] ^= 7; /* 3 becomes 4 */
    sane(line, other_request);
}

static void too_few_values(int line, const uint8_t *request) {
    uint8_t frame[7] = {request[0], request[1], 2, 0, 0};
    say(line, frame, finish(frame, 5));
}

/* Sends surplus bytes after the answer. */
static void talkative(int line, const uint8_t *request) {
    static const uint8_t more[5] = {0xEE, 0xEE, 0xEE, 0xEE, 0xEE};
    sane(line, request);
    say(line, more, sizeof more);
}

static void trickle(int line, const uint8_t *request) {
    uint8_t frame[FRAME];
    size_t size = right_answer(request, frame);
    for (size_t i = 0; i < size; i++) {
        say(line, frame + i, 1);
        tl_test_pause_ms(5);
    }
}

static void too_late(int line, const uint8_t *request) {
    tl_test_pause_ms(260);
    sane(line, request);
}

static void first_too_late(int line, const uint8_t *request) {
    address_of(request) == 1 ? too_late(line, request) : sane(line, request);
}

static void unit_2_fails(int line, const uint8_t *request) {
    request[0] == 2 ? exception(line, request, 4) : sane(line, request);
}

static void unit_2_fails_strangely(int line, const uint8_t *request) {
    request[0] == 2 ? exception(line, request, 0x50) : sane(line, request);
}

static void unit_2_fails_with_0(int line, const uint8_t *request) {
    request[0] == 2 ? exception(line, request, 0) : sane(line, request);
}

static void too_many_values(int line, const uint8_t *request) {
    uint8_t frame[FRAME] = {request[0], request[1], 6, 0, 1, 0, 2, 0, 3};
    say(line, frame, finish(frame, 9));
}

/* The byte count differs from the number of bytes. */
static void wrong_number_of_bytes(int line, const uint8_t *request) {
    uint8_t frame[FRAME] = {request[0], request[1], 3, 0, 1, 0, 2};
    say(line, frame, finish(frame, 7));
}

static void unit_2_is_silent(int line, const uint8_t *request) {
    request[0] == 2 ? silent(line, request) : sane(line, request);
}

static void unit_2_garbles(int line, const uint8_t *request) {
    request[0] == 2 ? garbage(line, request) : sane(line, request);
}

static void units_1_and_3_are_silent(int line, const uint8_t *request) {
    request[0] == 1 || request[0] == 3 ? silent(line, request) : sane(line, request);
}

static void is_silent_at_4(int line, const uint8_t *request) {
    bool has_4 = address_of(request) <= 4 && address_of(request) + count_of(request) > 4;
    has_4 ? silent(line, request) : sane(line, request);
}

/* An adapter that receives what it sends. */
static void echoed(int line, const uint8_t *request) {
    say(line, request, REQUEST);
    sane(line, request);
}

static void echo_only(int line, const uint8_t *request) {
    say(line, request, REQUEST);
}

/* Another master has sent at the same time. */
static void wrong_echo(int line, const uint8_t *request) {
    uint8_t echo[REQUEST];
    memcpy(echo, request, REQUEST);
    echo[3] ^= 1;
    say(line, echo, REQUEST);
    sane(line, request);
}

static void echo_in_pieces(int line, const uint8_t *request) {
    say(line, request, 3);
    tl_test_pause_ms(5);
    say(line, request + 3, REQUEST - 3);
    sane(line, request);
}

static void has_a_hole(int line, const uint8_t *request) {
    unsigned end = address_of(request) + count_of(request);
    end > 4 && address_of(request) < 10 ? exception(line, request, 2) : sane(line, request);
}

/* ---- the driver under test ---- */

static tl_driver_probe probe;
static tl_modbus_channel channels[CHANNELS];
static size_t channel_count;
static uint32_t baud;

static void add_of(uint8_t unit_id, tl_modbus_table table, unsigned address, tl_modbus_type type) {
    channels[channel_count] =
        (tl_modbus_channel){.unit_id = unit_id, .table = table, .address = (uint16_t)address, .type = type, .scale = 1};
    channel_count++;
}

static void add(uint8_t unit_id, unsigned address) {
    add_of(unit_id, TL_MODBUS_HOLDING, address, TL_MODBUS_UINT16);
}

static tl_modbus_settings settings_with(double timeout_s) {
    return (tl_modbus_settings){.line = {.device = path, .baud = 115200, .parity = 'E', .stop_bits = 1},
                                .timeout_s = timeout_s,
                                .channels = channels,
                                .channel_count = channel_count};
}

static void open_driver(double timeout_s) {
    tl_modbus_settings settings = settings_with(timeout_s);
    settings.line.baud = baud;
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_modbus_open(&settings, &probe.io, &probe.error));
}

void setUp(void) {
    tl_probe_begin(&probe, &tl_modbus_driver);
    memset(channels, 0, sizeof channels);
    channel_count = 0;
    baud = 115200;
    tl_modbus_peer_forget(&other);
    (void)snprintf(path, sizeof path, "/tmp/test_modbus_rtu.%ld", (long)getpid());
}

void tearDown(void) {
    tl_probe_end(&probe);
    pull_out();
    for (size_t at = 0; at < other.recorded; at += REQUEST) {
        const uint8_t *request = other.record + at;
        unsigned sum = tl_modbus_peer_sum(request, REQUEST - 2);
        TEST_ASSERT_EQUAL_HEX8(sum & 0xFF, request[6]);
        TEST_ASSERT_EQUAL_HEX8(sum >> 8, request[7]);
        TEST_ASSERT_TRUE(request[0] >= 1 && request[0] <= 247);
        TEST_ASSERT_TRUE(request[1] >= 1 && request[1] <= 4);
        TEST_ASSERT_TRUE(count_of(request) >= 1 && count_of(request) <= (request[1] <= 2 ? 2000 : 125));
    }
}

/* ---- values ---- */

static void test_every_table(void) {
    add_of(1, TL_MODBUS_COIL, 11, TL_MODBUS_BIT);
    add_of(1, TL_MODBUS_COIL, 29, TL_MODBUS_BIT);
    add_of(1, TL_MODBUS_COIL, 30, TL_MODBUS_BIT);
    add_of(247, TL_MODBUS_DISCRETE, 65535, TL_MODBUS_BIT);
    add_of(1, TL_MODBUS_INPUT, 513, TL_MODBUS_UINT16);
    add_of(1, TL_MODBUS_HOLDING, 1, TL_MODBUS_UINT32);
    plug_in(sane);
    open_driver(5);
    tl_probe_poll(&probe);
    tl_probe_expect(&probe, 0, 1, TL_GOOD);
    tl_probe_expect(&probe, 1, 1, TL_GOOD);
    tl_probe_expect(&probe, 2, 0, TL_GOOD);
    tl_probe_expect(&probe, 3, 1, TL_GOOD);
    tl_probe_expect(&probe, 4, 513, TL_GOOD);
    tl_probe_expect(&probe, 5, 65538, TL_GOOD);
    TEST_ASSERT_EQUAL_size_t(4, tl_modbus_peer_requests(&other));
    tl_probe_expect_link(&probe, true, path);
    tl_probe_expect_link(&probe, true, "connected");
    TEST_ASSERT_EQUAL_size_t(1, probe.links);
}

static void test_the_request_as_it_is_on_the_line(void) {
    static const uint8_t known[REQUEST] = {0x01, 0x03, 0x00, 0x00, 0x00, 0x0A, 0xC5, 0xCD};
    add(1, 0);
    add(1, 9);
    plug_in(sane);
    open_driver(5);
    tl_probe_poll(&probe);
    TEST_ASSERT_EQUAL_size_t(1, tl_modbus_peer_requests(&other));
    TEST_ASSERT_EQUAL_HEX8_ARRAY(known, other.record, REQUEST);
}

static void test_an_answer_that_comes_byte_by_byte(void) {
    add(1, 7);
    plug_in(trickle);
    open_driver(5);
    tl_probe_poll(&probe);
    tl_probe_expect(&probe, 0, 7, TL_GOOD);
}

/* ---- the device comes and goes ---- */

static void test_a_device_that_is_plugged_in_later(void) {
    add(1, 3);
    open_driver(5);
    tl_probe_poll(&probe);
    tl_probe_expect(&probe, 0, 0, TL_NO_LINK);
    tl_probe_expect_link(&probe, false, path);
    tl_probe_expect_link(&probe, false, "No such file");
    tl_probe_poll(&probe);
    TEST_ASSERT_EQUAL_size_t(1, probe.links);
    plug_in(sane);
    tl_probe_poll_until(&probe, 0, TL_GOOD);
    tl_probe_expect(&probe, 0, 3, TL_GOOD);
    tl_probe_expect_link(&probe, true, "connected");
}

static void test_a_device_that_is_pulled_out_and_comes_back(void) {
    add(1, 3);
    plug_in(sane);
    open_driver(5);
    tl_probe_poll_until(&probe, 0, TL_GOOD);
    for (size_t i = 1; i <= 3; i++) {
        pull_out();
        tl_time begin = tl_test_now();
        tl_probe_poll_until(&probe, 0, TL_NO_LINK);
        TEST_ASSERT_TRUE(tl_test_now() - begin < TL_SECOND); /* not the timeout */
        TEST_ASSERT_EQUAL_size_t(i, probe.downs);
        tl_probe_expect_link(&probe, false, "No such file");
        plug_in(sane);
        tl_probe_poll_until(&probe, 0, TL_GOOD);
        TEST_ASSERT_EQUAL_size_t(2 * i + 1, probe.links);
    }
}

static void *pull_out_soon(void *context) {
    (void)context;
    tl_test_pause_ms(100);
    pull_out();
    return NULL;
}

static void test_a_device_that_is_pulled_out_while_it_is_asked(void) {
    pthread_t thread;
    add(1, 3);
    plug_in(silent);
    open_driver(50);
    tl_time begin = tl_test_now();
    TEST_ASSERT_EQUAL_INT(0, pthread_create(&thread, NULL, pull_out_soon, NULL));
    tl_probe_poll(&probe);
    (void)pthread_join(thread, NULL);
    TEST_ASSERT_TRUE(tl_test_now() - begin < 10 * TL_SECOND);
    tl_probe_expect(&probe, 0, 0, TL_NO_LINK);
    TEST_ASSERT_FALSE(probe.link_up);
}

static void test_files_that_are_no_serial_port(void) {
    tl_modbus_settings settings = settings_with(1);
    add(1, 3);
    settings.channel_count = 1;
    static const char *const none[] = {"/dev/null", "/tmp", TL_SOURCE_DIR "/README.md"};
    for (size_t i = 0; i < sizeof none / sizeof none[0]; i++) {
        settings.line.device = none[i];
        TEST_ASSERT_EQUAL_INT(TL_OK, tl_modbus_open(&settings, &probe.io, &probe.error));
        tl_probe_poll(&probe);
        tl_probe_expect_link(&probe, false, none[i]);
        tl_probe_expect_link(&probe, false, "Inappropriate ioctl for device");
        tl_modbus_driver.close(probe.io);
        probe.io = NULL;
    }
}

/* A device such as /dev/watchdog resets the box if it is opened and closed. */
static void test_another_device_is_not_even_opened(void) {
    char device[PATH_MAX];
    char seen[sizeof(struct inotify_event) + NAME_MAX + 1];
    static tl_scratch scratch;
    tl_modbus_settings settings = settings_with(1);
    tl_scratch_make(&scratch, "/tmp", "tl_rtu");
    (void)snprintf(device, sizeof device, "%.200s/zero", scratch.folder);
    if (mknod(device, S_IFCHR | 0600, makedev(1, 5)) != 0) {
        TEST_ASSERT_EQUAL_INT(0, tl_scratch_finish(&scratch, 0));
        TEST_IGNORE_MESSAGE("only root makes devices");
    }
    int watch = inotify_init1(IN_NONBLOCK | IN_CLOEXEC);
    TEST_ASSERT_TRUE(inotify_add_watch(watch, device, IN_OPEN) > 0);
    add(1, 3);
    settings.channel_count = 1;
    settings.line.device = device;
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_modbus_open(&settings, &probe.io, &probe.error));
    tl_probe_poll(&probe);
    tl_probe_expect_link(&probe, false, device);
    tl_probe_expect_link(&probe, false, "serial");
    TEST_ASSERT_EQUAL_INT(-1, read(watch, seen, sizeof seen));
    (void)close(watch);
    TEST_ASSERT_EQUAL_INT(0, tl_scratch_finish(&scratch, 0));
}

static void test_the_port_is_ours_alone(void) {
    if (getenv("TL_EMULATOR") != NULL) {
        TEST_IGNORE_MESSAGE("not in an emulator");
    }
    int exclusive = 0;
    add(1, 3);
    plug_in(sane);
    open_driver(5);
    tl_probe_poll(&probe);
    int second = open(path, O_RDWR | O_NOCTTY | O_CLOEXEC);
    if (second < 0) { /* only root can open it a second time */
        TEST_ASSERT_EQUAL_INT(EBUSY, errno);
        return;
    }
    TEST_ASSERT_EQUAL_INT(0, ioctl(second, TIOCGEXCL, &exclusive));
    (void)close(second);
    TEST_ASSERT_TRUE(exclusive);
}

static void test_a_port_that_cannot_switch_rs485(void) {
    tl_modbus_settings settings = settings_with(1);
    settings.line.rs485 = true;
    plug_in(sane);
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_modbus_open(&settings, &probe.io, &probe.error));
    tl_probe_poll(&probe);
    tl_probe_expect_link(&probe, false, "RS-485|rs485");
}

/* ---- wrong answers ---- */

/* The peer gives this answer; the poll reports no link, with these parts. Then the peer gives right
 * answers on the same port. */
static void expect_down_and_up(answer_function *answer, const char *parts) {
    add(1, 1);
    add(1, 2);
    plug_in(answer);
    open_driver(0.4);
    tl_probe_poll_down(&probe, 2, parts);
    set_answer(sane);
    tl_probe_poll_up(&probe, 2, (const double[]){1, 2});
}

static void test_silence(void) {
    tl_time begin = tl_test_now();
    expect_down_and_up(silent, "0.4 s");
    TEST_ASSERT_TRUE(tl_test_now() >= begin + 400000000);
}

static void test_half_a_frame(void) {
    expect_down_and_up(half_a_frame, "answer");
}

static void test_a_wrong_check_sum(void) {
    expect_down_and_up(wrong_check_sum, "Invalid CRC");
}

static void test_garbage(void) {
    expect_down_and_up(garbage, path);
}

static void test_an_answer_of_another_unit(void) {
    expect_down_and_up(another_unit, "unit|2|1|master");
}

static void test_an_answer_of_another_function(void) {
    expect_down_and_up(another_function, "function|4|3");
}

static void test_too_few_values(void) {
    expect_down_and_up(too_few_values, "bytes|2|4");
}

static void test_too_many_values(void) {
    expect_down_and_up(too_many_values, "bytes|6|4");
}

static void test_a_wrong_number_of_bytes(void) {
    expect_down_and_up(wrong_number_of_bytes, "Invalid CRC");
}

static void test_more_than_was_asked_for(void) {
    add(1, 1);
    add(1, 1000);
    plug_in(talkative);
    open_driver(5);
    for (int i = 0; i < 20; i++) {
        tl_probe_poll(&probe);
        tl_probe_expect(&probe, 0, 1, TL_GOOD);
        tl_probe_expect(&probe, 1, 1000, TL_GOOD);
    }
    TEST_ASSERT_EQUAL_size_t(1, probe.links);
}

static void test_noise_between_polls(void) {
    static const uint8_t noise[] = {1, 3, 2, 0x55, 0x55};
    add(1, 1);
    plug_in(sane);
    open_driver(5);
    for (int i = 0; i < 20; i++) {
        tl_probe_poll(&probe);
        tl_probe_expect(&probe, 0, 1, TL_GOOD);
        say(master, noise, sizeof noise);
    }
    TEST_ASSERT_EQUAL_size_t(1, probe.links);
}

/* The driver never posts the value of another register, although both answers look the same. */
static void test_a_late_answer_is_not_taken_for_another(void) {
    add(1, 1);
    add(1, 1000);
    add(2, 1);
    plug_in(first_too_late);
    open_driver(0.2);
    for (int i = 0; i < 12; i++) {
        tl_probe_poll(&probe);
        for (size_t k = 0; k < channel_count; k++) {
            TEST_ASSERT_TRUE(probe.newest[k].quality == TL_NO_LINK || probe.newest[k].value == channels[k].address);
        }
        tl_test_pause_ms(5);
    }
    set_answer(sane);
    tl_probe_poll_until(&probe, 0, TL_GOOD);
    tl_probe_poll_until(&probe, 1, TL_GOOD);
    tl_probe_expect(&probe, 1, 1000, TL_GOOD);
}

enum { SHORTEST_QUIET_MS = 25 }; /* may count as the 32 ms of silence at 1200 baud */

static bool chatting; /* atomic */

/* Counts in *context, a size_t, how often a busy machine let the line be quiet. */
static void *chat(void *context) {
    static const uint8_t word = 0x42;
    size_t *quiet = context;
    tl_time last = tl_test_now();
    while (__atomic_load_n(&chatting, __ATOMIC_RELAXED)) {
        say(master, &word, 1);
        tl_time now = tl_test_now();
        *quiet += now - last >= SHORTEST_QUIET_MS * (TL_SECOND / 1000) ? 1 : 0;
        last = now;
        tl_test_pause_ms(2);
    }
    return NULL;
}

static void test_a_line_that_is_never_quiet(void) {
    if (getenv("TL_EMULATOR") != NULL) {
        TEST_IGNORE_MESSAGE("not in an emulator");
    }
    pthread_t thread;
    baud = 1200; /* silence is 32 ms; the pauses of the thread are shorter */
    add(1, 1);
    plug_in(sane);
    open_driver(0.3);
    tl_probe_poll(&probe);
    tl_probe_expect(&probe, 0, 1, TL_GOOD);
    __atomic_store_n(&chatting, true, __ATOMIC_RELAXED);
    size_t before = tl_modbus_peer_requests(&other);
    size_t quiet = 0;
    TEST_ASSERT_EQUAL_INT(0, pthread_create(&thread, NULL, chat, &quiet));
    tl_probe_poll_until(&probe, 0, TL_NO_LINK);
    for (int i = 0; i < 3; i++) {
        tl_probe_poll(&probe);
        tl_test_pause_ms(120);
    }
    tl_probe_poll_until(&probe, 0, TL_NO_LINK);
    tl_probe_expect_link(&probe, false, "line|master");
    __atomic_store_n(&chatting, false, __ATOMIC_RELAXED);
    (void)pthread_join(thread, NULL);
    TEST_ASSERT_TRUE(tl_modbus_peer_requests(&other) - before <=
                     quiet); /* the driver does not send while others send */
    tl_probe_poll_until(&probe, 0, TL_GOOD);
}

/* ---- several units ---- */

static void add_three_units(void) {
    add(1, 1);
    add(2, 2);
    add(3, 3);
}

static void expect_own_channels_only(answer_function *answer, const char *parts) {
    add_three_units();
    plug_in(answer);
    open_driver(5);
    tl_probe_poll(&probe);
    tl_probe_expect(&probe, 0, 1, TL_GOOD);
    tl_probe_expect(&probe, 1, 0, TL_NO_LINK);
    tl_probe_expect(&probe, 2, 3, TL_GOOD);
    TEST_ASSERT_EQUAL_size_t(2, probe.links);
    tl_probe_expect_part(&probe, parts);
    set_answer(sane);
    tl_probe_poll_until(&probe, 1, TL_GOOD);
    tl_probe_expect(&probe, 1, 2, TL_GOOD);
    tl_probe_expect_link(&probe, true, "unit 2|holding|again");
    TEST_ASSERT_EQUAL_size_t(0, probe.downs);
}

static void test_an_exception_affects_its_own_channels_only(void) {
    expect_own_channels_only(unit_2_fails, "unit 2|holding|Slave device or server failure");
}

static void test_an_undefined_exception(void) {
    expect_own_channels_only(unit_2_fails_strangely, "unit 2|holding|exception 80");
}

static void test_the_exception_0(void) {
    expect_own_channels_only(unit_2_fails_with_0, "unit 2|holding|exception 0");
}

/* Also in the poll that finds the garbage. */
static void test_garbage_affects_its_own_channels_only(void) {
    expect_own_channels_only(unit_2_garbles, "unit 2|holding");
}

static void test_a_hole_is_not_read(void) {
    add(1, 2);
    add(1, 12);
    plug_in(has_a_hole);
    open_driver(5);
    tl_probe_poll(&probe);
    tl_probe_expect(&probe, 0, 2, TL_GOOD);
    tl_probe_expect(&probe, 1, 12, TL_GOOD);
    TEST_ASSERT_EQUAL_size_t(3, tl_modbus_peer_requests(&other));
    tl_probe_poll(&probe);
    TEST_ASSERT_EQUAL_size_t(5, tl_modbus_peer_requests(&other));
}

/* Polls for so long; the unit of `channel` must answer each poll. Returns the number of requests to
 * other units than 1 and 3. */
static size_t requests_beside(size_t channel, int seconds) {
    size_t before = tl_modbus_peer_requests(&other);
    size_t polls = 0;
    for (tl_time end = tl_test_now() + seconds * TL_SECOND; tl_test_now() < end; tl_test_pause_ms(5)) {
        probe.posts[channel] = 0;
        tl_probe_poll(&probe);
        polls++;
        TEST_ASSERT_TRUE(probe.posts[channel] > 0 && probe.newest[channel].quality == TL_GOOD);
    }
    return tl_modbus_peer_requests(&other) - before - 2 * polls;
}

static void test_a_silent_unit_does_not_stop_the_others(void) {
    add_three_units();
    plug_in(sane);
    open_driver(0.2);
    tl_probe_poll_until(&probe, 2, TL_GOOD);
    set_answer(unit_2_is_silent);
    tl_probe_poll(&probe);
    tl_probe_expect(&probe, 0, 1, TL_GOOD); /* also in the poll in which unit 2 goes silent */
    tl_probe_expect(&probe, 1, 0, TL_NO_LINK);
    tl_probe_expect(&probe, 2, 3, TL_GOOD);
    tl_probe_expect_part(&probe, "unit 2|holding|0.2 s");
    size_t before = probe.links;
    tl_time begun = tl_test_now();
    /* each takes 0.2 s; at least 3/4 of the time is left for the others */
    size_t waited = requests_beside(2, 4);
    TEST_ASSERT_TRUE((tl_time)waited * TL_SECOND / 5 <= (tl_test_now() - begun) / 4);
    TEST_ASSERT_EQUAL_size_t(before, probe.links);
    set_answer(sane);
    tl_probe_poll_until(&probe, 1, TL_GOOD);
    TEST_ASSERT_EQUAL_size_t(before + 1, probe.links);
    TEST_ASSERT_EQUAL_size_t(0, probe.downs);
}

static void test_silent_units_that_are_asked_first(void) {
    add_three_units();
    add(4, 4);
    plug_in(units_1_and_3_are_silent);
    open_driver(0.2);
    tl_probe_poll_until(&probe, 1, TL_GOOD);
    tl_probe_poll_until(&probe, 3, TL_GOOD);
    size_t before = probe.downs;
    for (int poll = 0; poll < 20; poll++) {
        probe.posts[3] = 0;
        tl_probe_poll(&probe);
        TEST_ASSERT_TRUE(probe.posts[3] > 0 && probe.newest[3].quality == TL_GOOD);
    }
    TEST_ASSERT_EQUAL_size_t(before, probe.downs);
    tl_probe_expect(&probe, 1, 2, TL_GOOD);
    tl_probe_expect(&probe, 0, 0, TL_NO_LINK);
    tl_probe_expect(&probe, 2, 0, TL_NO_LINK);
    set_answer(sane);
    tl_probe_poll_until(&probe, 0, TL_GOOD);
    tl_probe_poll_until(&probe, 2, TL_GOOD);
}

/* A poll does not wait for each unit of a dead line. */
/* With split_failed, also if the rest of the unit shares its request. */
static void test_silence_at_one_address(void) {
    add(1, 3);
    add(1, 4);
    add(1, 1000);
    plug_in(is_silent_at_4);
    tl_modbus_settings settings = settings_with(0.2);
    settings.split_failed = true;
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_modbus_open(&settings, &probe.io, &probe.error));
    tl_probe_poll_until(&probe, 0, TL_GOOD);
    tl_probe_expect(&probe, 0, 3, TL_GOOD);
    tl_probe_expect(&probe, 1, 0, TL_NO_LINK);
}

static void open_driver_with_echo(answer_function *answer, double timeout_s) {
    add(1, 1);
    add(1, 1000);
    plug_in(answer);
    tl_modbus_settings settings = settings_with(timeout_s);
    settings.line.echo = true;
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_modbus_open(&settings, &probe.io, &probe.error));
}

static void expect_echo_is_dropped(answer_function *answer) {
    open_driver_with_echo(answer, 5);
    for (int i = 0; i < 3; i++) {
        tl_probe_poll(&probe);
        tl_probe_expect(&probe, 0, 1, TL_GOOD);
        tl_probe_expect(&probe, 1, 1000, TL_GOOD);
    }
}

static void test_an_echo_is_dropped(void) {
    expect_echo_is_dropped(echoed);
}

static void test_an_echo_in_pieces_is_dropped(void) {
    expect_echo_is_dropped(echo_in_pieces);
}

static void test_an_echo_without_an_answer(void) {
    open_driver_with_echo(echo_only, 0.1);
    tl_probe_poll_down(&probe, 2, "0.1 s|baud");
}

/* Then the first bytes of the answer are no echo. */
static void test_an_echo_that_does_not_come(void) {
    open_driver_with_echo(sane, 0.1);
    tl_probe_poll_down(&probe, 2, "adapter|echo");
}

static void test_no_echo_and_no_answer(void) {
    open_driver_with_echo(silent, 0.1);
    tl_probe_poll_down(&probe, 2, "adapter|echo");
}

static void test_a_wrong_echo(void) {
    open_driver_with_echo(wrong_echo, 5);
    tl_probe_poll_down(&probe, 2, "adapter|echo");
    set_answer(echoed);
    tl_probe_poll_until(&probe, 0, TL_GOOD); /* the rest of the answer was dropped */
    tl_probe_expect(&probe, 0, 1, TL_GOOD);
}

static void test_an_echo_that_is_not_expected(void) {
    add(1, 1);
    plug_in(echoed);
    open_driver(0.1);
    tl_probe_poll_down(&probe, 1, "echo");
}

static void test_a_poll_of_a_dead_line_is_short(void) {
    for (uint8_t unit = 1; unit <= 10; unit++) {
        add(unit, unit);
    }
    plug_in(silent);
    open_driver(0.3);
    tl_time begin = tl_test_now();
    tl_probe_poll(&probe);
    /* twice 0.3 s and the silence between them */
    TEST_ASSERT_TRUE(tl_test_now() - begin < 2 * TL_SECOND);
    TEST_ASSERT_EQUAL_size_t(2, tl_modbus_peer_requests(&other));
    tl_probe_expect_link(&probe, false, "0.3 s");
}

/* ---- interrupt ---- */

static void test_interrupt_while_it_waits(void) {
    add(1, 1);
    plug_in(silent);
    open_driver(50);
    tl_time begin = tl_test_now();
    pthread_t thread = tl_probe_interrupt_after(&probe, 100);
    tl_probe_poll(&probe);
    (void)pthread_join(thread, NULL);
    TEST_ASSERT_TRUE(tl_test_now() - begin < 10 * TL_SECOND);
    TEST_ASSERT_EQUAL_size_t(0, probe.links);
    TEST_ASSERT_EQUAL_size_t(0, probe.posts[0]);
    set_answer(sane);
    tl_probe_poll(&probe);
    tl_probe_expect(&probe, 0, 1, TL_GOOD);
}

static void test_an_interrupt_is_not_lost(void) {
    add(1, 1);
    plug_in(sane);
    open_driver(5);
    tl_modbus_driver.interrupt(probe.io);
    tl_probe_poll(&probe);
    TEST_ASSERT_EQUAL_size_t(0, probe.posts[0]);
    tl_probe_poll(&probe);
    tl_probe_expect(&probe, 0, 1, TL_GOOD);
}

/* ---- settings ---- */

static void expect_refused(const tl_modbus_settings *settings, const char *parts) {
    tl_plant_io *none = NULL;
    probe.error = (tl_error){TL_OK, ""};
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, tl_modbus_open(settings, &none, &probe.error));
    TEST_ASSERT_NULL(none);
    TL_EXPECT_PARTS(parts, probe.error.text);
}

static void test_settings_that_are_wrong(void) {
    tl_modbus_settings settings = settings_with(1);
    settings.line.device = "";
    expect_refused(&settings, "line|device");
    settings = settings_with(1);
    settings.line.baud = 12345;
    expect_refused(&settings, "12345");
    settings = settings_with(1);
    settings.line.parity = 'e';
    expect_refused(&settings, "parity|N|E|O");
    settings = settings_with(1);
    settings.line.stop_bits = 3;
    expect_refused(&settings, "3|1|2");
    settings = settings_with(0);
    expect_refused(&settings, "timeout_s|0|0.001|3600");
    add(0, 1);
    settings = settings_with(1);
    expect_refused(&settings, "channel 0|unit_id|1|247");
    channels[0].unit_id = 255;
    expect_refused(&settings, "channel 0|255|247");
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_every_table);
    RUN_TEST(test_the_request_as_it_is_on_the_line);
    RUN_TEST(test_an_answer_that_comes_byte_by_byte);
    RUN_TEST(test_a_device_that_is_plugged_in_later);
    RUN_TEST(test_a_device_that_is_pulled_out_and_comes_back);
    RUN_TEST(test_a_device_that_is_pulled_out_while_it_is_asked);
    RUN_TEST(test_files_that_are_no_serial_port);
    RUN_TEST(test_another_device_is_not_even_opened);
    RUN_TEST(test_the_port_is_ours_alone);
    RUN_TEST(test_a_port_that_cannot_switch_rs485);
    RUN_TEST(test_silence);
    RUN_TEST(test_half_a_frame);
    RUN_TEST(test_a_wrong_check_sum);
    RUN_TEST(test_garbage);
    RUN_TEST(test_an_answer_of_another_unit);
    RUN_TEST(test_an_answer_of_another_function);
    RUN_TEST(test_too_few_values);
    RUN_TEST(test_too_many_values);
    RUN_TEST(test_a_wrong_number_of_bytes);
    RUN_TEST(test_more_than_was_asked_for);
    RUN_TEST(test_noise_between_polls);
    RUN_TEST(test_a_late_answer_is_not_taken_for_another);
    RUN_TEST(test_a_line_that_is_never_quiet);
    RUN_TEST(test_an_exception_affects_its_own_channels_only);
    RUN_TEST(test_an_undefined_exception);
    RUN_TEST(test_the_exception_0);
    RUN_TEST(test_garbage_affects_its_own_channels_only);
    RUN_TEST(test_a_hole_is_not_read);
    RUN_TEST(test_a_silent_unit_does_not_stop_the_others);
    RUN_TEST(test_silent_units_that_are_asked_first);
    RUN_TEST(test_silence_at_one_address);
    RUN_TEST(test_an_echo_is_dropped);
    RUN_TEST(test_an_echo_in_pieces_is_dropped);
    RUN_TEST(test_an_echo_without_an_answer);
    RUN_TEST(test_an_echo_that_does_not_come);
    RUN_TEST(test_no_echo_and_no_answer);
    RUN_TEST(test_a_wrong_echo);
    RUN_TEST(test_an_echo_that_is_not_expected);
    RUN_TEST(test_a_poll_of_a_dead_line_is_short);
    RUN_TEST(test_interrupt_while_it_waits);
    RUN_TEST(test_an_interrupt_is_not_lost);
    RUN_TEST(test_settings_that_are_wrong);
    return UNITY_END();
}
