/* Plant driver for inputs of GPIO chips, by Linux's character device (libgpiod).
 *
 * Purpose: posts the new level (0 or 1) at each edge of a line. It also posts the level once per
 *          poll, so that the signal does not become stale. The driver requests lines as inputs
 *          only, and rejects a line that is already an output.
 * Link:    up while any line can be read. A line that does not exist, is used by another process,
 *          or disappears with its chip affects only its own channels: the driver searches the line
 *          again with back-off (from 0.1 s, doubling, to at most 2 s).
 * Stamp:   of an edge: the kernel's stamp (CLOCK_MONOTONIC). Before Linux 5.7, or if the kernel's
 *          stamp is in the future, the stamp is the time of reading. With debouncing: the stamp of
 *          the edge after which the line was stable. Of a level: the time of reading. Stamps of a
 *          line never decrease.
 * Debouncing: the driver debounces by the stamps of the edges, with both versions of libgpiod. The
 *             kernel's own debouncing would stamp the end of the wait, not the edge.
 * Bound:   a poll lasts period_s minus a margin: the smaller of period_s/10 and 1 ms. It reads a
 *          limited number of edges per line (TL_GPIO_EDGES). If there are more, the driver posts
 *          the newest level, and the next poll continues. The driver reports missed edges at most
 *          every 10 s. Their number is a lower bound: the kernel does not count dropped edges.
 * Without edges: if a chip has no interrupts, the driver reads its levels once per poll.
 * Source:  the GPIO character device's ABI, <linux/gpio.h>; libgpiod 1.6 or 2.x.
 */
#ifndef TL_BOARD_GPIO_GPIO_H
#define TL_BOARD_GPIO_GPIO_H

#include "board/gpio/gpio_lines.h"
#include "board/io/plant_access.h"
#include "board/io/plant_io.h"

/* Maximum number of edges that one poll reads of one line: TL_GPIO_EDGES, plus TL_GPIO_EDGES_PER_MS
 * for each ms of the period. A read that finds no edge counts as one edge. */
enum { TL_GPIO_EDGES = 128, TL_GPIO_EDGES_PER_MS = 2 };

typedef struct tl_gpio_settings {
    const char *chip;                /* name ("gpiochip0"), label, or path; NULL: all chips, if all lines have names */
    double period_s;                 /* s between the starts of two polls, 1e-5 … 3600; the reader starts them */
    const tl_gpio_channel *channels; /* several may use one line; the first of these defines its options */
    size_t channel_count;
} tl_gpio_settings;

extern const tl_plant_io_driver tl_gpio_driver;
extern const tl_plant_access tl_gpio_access;

/* Creates a driver. Copies the settings; opens no chip yet. Errors: TL_BAD_DATA for a setting out
 * of range, or an offset without a chip; TL_TRY_AGAIN if memory or a descriptor is missing. */
tl_status tl_gpio_open(const tl_gpio_settings *settings, tl_plant_io **io, tl_error *error);

#endif
