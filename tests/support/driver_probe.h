/* Polls a plant I/O driver as its reader thread does, and keeps the newest readings and link
 * messages.
 *
 * Use:    tl_probe_begin() in setUp(); the test opens the driver into `io`; tl_probe_end() in
 *         tearDown(). A test that needs more than the newest values sets its own functions in
 *         `sink`, which call these.
 * Errors: each failure fails the test.
 * Thread: one, except for tl_probe_interrupt_after().
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
    tl_plant_io *io;       /* NULL: not open */
    tl_error error;
    tl_reading newest[TL_PROBE_CHANNELS]; /* of each channel */
    size_t posts[TL_PROBE_CHANNELS];
    size_t links;         /* reports of the link */
    size_t downs;         /* those that say "down" */
    size_t part_failures; /* those of a failed part */
    bool link_up;
    bool is_part; /* the last report is of a failed part */
    char link_text[1024];
    long interrupt_ms; /* delay of tl_probe_interrupt_after() */
} tl_driver_probe;

/* Resets the probe for this driver. */
void tl_probe_begin(tl_driver_probe *probe, const tl_plant_io_driver *driver);

/* Closes the driver if it is open. */
void tl_probe_end(tl_driver_probe *probe);

/* Clears the readings and link reports. */
void tl_probe_forget(tl_driver_probe *probe);

/* Functions of the default sink; `context` is the probe. */
void tl_probe_post(void *context, size_t channel, const tl_reading *reading);
void tl_probe_link(void *context, bool up, const char *text);

/* Polls once. */
void tl_probe_poll(tl_driver_probe *probe);

/* Polls at least once, until the channel has that quality; fails after 60 s. */
void tl_probe_poll_until(tl_driver_probe *probe, size_t channel, tl_quality quality);

/* Returns the newest reading of the channel; fails if there is none. */
const tl_reading *tl_probe_newest(const tl_driver_probe *probe, size_t channel);
void tl_probe_expect(const tl_driver_probe *probe, size_t channel, double value, tl_quality quality);

/* Checks the last report of the link: up or down, and the parts of its text (see message.h). */
void tl_probe_expect_link(const tl_driver_probe *probe, bool up, const char *parts);

/* Checks that the last report is of a failed part while the link is up, and the parts of its text. */
void tl_probe_expect_part(const tl_driver_probe *probe, const char *parts);

/* Polls once. Expects no link for the first `count` channels, and one report: down, with these
 * parts. */
void tl_probe_poll_down(tl_driver_probe *probe, size_t count, const char *parts);

/* Call after tl_probe_poll_down(). Polls until channel 0 is good. Expects these values in the first
 * `count` channels, and one more report of the link: connected. */
void tl_probe_poll_up(tl_driver_probe *probe, size_t count, const double *values);

/* Starts a thread that interrupts the driver after so many ms. The caller joins it. */
pthread_t tl_probe_interrupt_after(tl_driver_probe *probe, long ms);

#endif
