/* Plant driver for inputs of GPIO chips, by Linux's character device (libgpiod).
 *
 * Purpose: posts each edge of its lines as 0 or 1 when it comes, and each level once per poll, so
 *          that it does not become stale. Lines are requested as inputs only; a line that is an
 *          output now is not touched.
 * Link:    up while any line can be read. A line that does not exist, is used by another process,
 *          or disappears with its chip affects only its own channel: the driver searches it again
 *          with back-off from 0.1 s, doubling, to at most 2 s.
 * Stamp:   of an edge: the kernel's (CLOCK_MONOTONIC; before Linux 5.7, or if the kernel's stamp is
 *          impossible, the time of reading). With debouncing: of the edge after which the line was
 *          stable. Of a level: the time of reading. Stamps of a line never decrease.
 * Debouncing: done here on the stamps of the edges, with either version of libgpiod. The kernel's
 *             own debouncing would stamp the end of the wait, not the edge.
 * Bound:   a poll waits for edges for period_s minus a tenth of it (at most 1 ms). It reads a
 *          bounded number of edges of a line (TL_GPIO_EDGES). If there are more, the newest level
 *          counts, and the next poll continues. Missed edges are reported every 10 s at most, with
 *          their number as far as it is known: the kernel does not count dropped edges.
 * Without edges: if a chip has no interrupts, levels are read once per poll.
 * Source:  the GPIO character device's ABI, <linux/gpio.h>; libgpiod 1.6 or 2.x.
 */
#ifndef TL_BOARD_GPIO_GPIO_H
#define TL_BOARD_GPIO_GPIO_H

#include "board/gpio/gpio_lines.h"
#include "board/io/plant_access.h"
#include "board/io/plant_io.h"

/* Reads of edges of one line in one poll: a fixed number, plus a number for each ms of the period.
 */
enum { TL_GPIO_EDGES = 128, TL_GPIO_EDGES_PER_MS = 2 };

typedef struct tl_gpio_settings {
    const char *chip;                /* name ("gpiochip0"), label, or path; NULL: any chip, if all lines have names */
    double period_s;                 /* between the starts of polls, used by the reader; > 0 */
    const tl_gpio_channel *channels; /* several may use one line; the first of them defines its options */
    size_t channel_count;
} tl_gpio_settings;

extern const tl_plant_io_driver tl_gpio_driver;
extern const tl_plant_access tl_gpio_access;

/* Copies the settings that it needs and opens no chip yet. Errors: TL_BAD_DATA for a setting out of
 * range, or an offset without a chip. */
tl_status tl_gpio_open(const tl_gpio_settings *settings, tl_plant_io **io, tl_error *error);

#endif
