/* See driver_probe.h. */
#include "tests/support/driver_probe.h"

#include <stdio.h>
#include <string.h>
#include <unity.h>

#include "tests/support/message.h"
#include "tests/support/real_time.h"

void tl_probe_post(void *context, size_t channel, const tl_reading *reading) {
    tl_driver_probe *probe = context;
    TEST_ASSERT_TRUE(channel < TL_PROBE_CHANNELS);
    probe->newest[channel] = *reading;
    probe->posts[channel]++;
}

void tl_probe_link(void *context, bool up, const char *text) {
    tl_driver_probe *probe = context;
    probe->links++;
    probe->downs += up ? 0 : 1;
    probe->link_up = up;
    probe->is_part = false;
    (void)snprintf(probe->link_text, sizeof probe->link_text, "%s", text);
}

static void part_failed(void *context, const char *text) {
    tl_driver_probe *probe = context;
    probe->sink.link(context, probe->link_up, text);
    probe->part_failures++;
    probe->is_part = true;
}

void tl_probe_begin(tl_driver_probe *probe, const tl_plant_io_driver *driver) {
    tl_probe_forget(probe);
    probe->driver = driver;
    probe->sink =
        (tl_plant_io_sink){.post = tl_probe_post, .link = tl_probe_link, .part_failed = part_failed, .context = probe};
    probe->io = NULL;
    probe->error = (tl_error){TL_OK, ""};
}

void tl_probe_end(tl_driver_probe *probe) {
    if (probe->io != NULL) {
        probe->driver->close(probe->io);
        probe->io = NULL;
    }
}

void tl_probe_forget(tl_driver_probe *probe) {
    memset(probe->newest, 0, sizeof probe->newest);
    memset(probe->posts, 0, sizeof probe->posts);
    probe->links = 0;
    probe->downs = 0;
    probe->part_failures = 0;
    probe->is_part = false;
    probe->link_up = false;
    probe->link_text[0] = '\0';
}

void tl_probe_poll(tl_driver_probe *probe) {
    probe->driver->poll(probe->io, &probe->sink);
}

void tl_probe_poll_until(tl_driver_probe *probe, size_t channel, tl_quality quality) {
    tl_time deadline = tl_test_now() + 60 * TL_SECOND;
    tl_probe_poll(probe);
    while (probe->posts[channel] == 0 || probe->newest[channel].quality != quality) {
        TEST_ASSERT_TRUE_MESSAGE(tl_test_now() < deadline, probe->link_text);
        tl_test_pause_ms(5);
        tl_probe_poll(probe);
    }
}

const tl_reading *tl_probe_newest(const tl_driver_probe *probe, size_t channel) {
    TEST_ASSERT_TRUE(probe->posts[channel] > 0);
    return &probe->newest[channel];
}

void tl_probe_expect(const tl_driver_probe *probe, size_t channel, double value, tl_quality quality) {
    TEST_ASSERT_EQUAL_INT(quality, tl_probe_newest(probe, channel)->quality);
    TEST_ASSERT_EQUAL_DOUBLE(value, tl_probe_newest(probe, channel)->value);
}

void tl_probe_expect_link(const tl_driver_probe *probe, bool up, const char *parts) {
    TEST_ASSERT_FALSE_MESSAGE(probe->is_part, probe->link_text);
    TEST_ASSERT_EQUAL_INT_MESSAGE(up, probe->link_up, probe->link_text);
    TL_EXPECT_PARTS(parts, probe->link_text);
}

void tl_probe_expect_part(const tl_driver_probe *probe, const char *parts) {
    TEST_ASSERT_TRUE_MESSAGE(probe->link_up && probe->is_part, probe->link_text);
    TL_EXPECT_PARTS(parts, probe->link_text);
}

void tl_probe_poll_down(tl_driver_probe *probe, size_t count, const char *parts) {
    tl_probe_poll(probe);
    for (size_t i = 0; i < count; i++) {
        tl_probe_expect(probe, i, 0, TL_NO_LINK);
    }
    TEST_ASSERT_EQUAL_size_t(1, probe->links);
    tl_probe_expect_link(probe, false, parts);
}

void tl_probe_poll_up(tl_driver_probe *probe, size_t count, const double *values) {
    tl_probe_poll_until(probe, 0, TL_GOOD);
    for (size_t i = 0; i < count; i++) {
        tl_probe_expect(probe, i, values[i], TL_GOOD);
    }
    TEST_ASSERT_EQUAL_size_t(2, probe->links);
    tl_probe_expect_link(probe, true, "connected");
}

static void *interrupt(void *context) {
    tl_driver_probe *probe = context;
    tl_test_pause_ms(probe->interrupt_ms);
    probe->driver->interrupt(probe->io);
    return NULL;
}

pthread_t tl_probe_interrupt_after(tl_driver_probe *probe, long ms) {
    pthread_t thread;
    probe->interrupt_ms = ms;
    TEST_ASSERT_EQUAL_INT(0, pthread_create(&thread, NULL, interrupt, probe));
    return thread;
}
