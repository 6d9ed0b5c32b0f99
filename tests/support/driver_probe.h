/* A plant I/O driver under test: polled as its reader thread would, and all that it said.
 *
 * Purpose: tests of drivers differ in their devices; what they ask of a driver is alike.
 * Use:     tl_probe_begin() in setUp(); the test opens the driver into `io`; tl_probe_end() in tearDown(). A test that looks
 *          at more than what was said last puts functions of its own into `sink`, which call those here.
 * Errors:  what does not go well fails the test.
 * Thread:  one thread, but for what tl_probe_interrupt_after() starts.
 */
#ifndef TL_TESTS_SUPPORT_DRIVER_PROBE_H
#define TL_TESTS_SUPPORT_DRIVER_PROBE_H

#include <pthread.h>
#include <stdbool.h>
#include <stddef.h>

#include "board/io/plant_io.h"

enum { TL_PROBE_CHANNELS = 2200 };

typedef struct tl_driver_probe {
    const tl_plant_io_driver *driver;
    tl_plant_io_sink sink; /* its context is the probe */
    tl_plant_io *io;       /* NULL: none is open */
    tl_error error;
    tl_reading newest[TL_PROBE_CHANNELS]; /* of each channel */
    size_t posts[TL_PROBE_CHANNELS];
    size_t links; /* how often it spoke of the link */
    size_t downs; /* how often of these it was down */
    bool link_up;
    char link_text[1024];
    long interrupt_ms; /* of tl_probe_interrupt_after() */
} tl_driver_probe;

/* Nothing is open, nothing was said. */
void tl_probe_begin(tl_driver_probe *probe, const tl_plant_io_driver *driver);

/* Closes the driver if it is open. */
void tl_probe_end(tl_driver_probe *probe);

/* Forgets what was said. */
void tl_probe_forget(tl_driver_probe *probe);

/* What the sink does; `context` is the probe. */
void tl_probe_post(void *context, size_t channel, const tl_reading *reading);
void tl_probe_link(void *context, bool up, const char *text);

/* One poll, which goes well and is not the last one. */
void tl_probe_poll(tl_driver_probe *probe);

/* One poll, which goes well; true: it was the last one. */
bool tl_probe_poll_any(tl_driver_probe *probe);

/* Polls until the channel has that quality, a minute at most; once at least. */
void tl_probe_poll_until(tl_driver_probe *probe, size_t channel, tl_quality quality);

/* The newest reading of the channel; there is one. */
const tl_reading *tl_probe_newest(const tl_driver_probe *probe, size_t channel);
void tl_probe_expect(const tl_driver_probe *probe, size_t channel, double value, tl_quality quality);

/* What was said of the link last: up or down, with `part` in its text. */
void tl_probe_expect_link(const tl_driver_probe *probe, bool up, const char *part);

/* Another thread interrupts the driver after so many ms. The caller joins it. */
pthread_t tl_probe_interrupt_after(tl_driver_probe *probe, long ms);

#endif
