/* Plant I/O driver: inputs of GPIO chips, by Linux's character device (libgpiod).
 *
 * Purpose: posts each edge of its lines, 0 or 1, as it comes, and each level once in a poll, so that it does not grow old.
 *          Lines are requested as inputs and as nothing else; one that is an output now is left alone.
 * Link:    up while any line can be read. A line that is not there, is used by others, or goes away with its chip,
 *          costs its own channel only: it is looked for anew, with back-off from 0.1 s, doubling, to at most 2 s.
 * Stamp:   of an edge: the kernel's (CLOCK_MONOTONIC; before Linux 5.7, and where the kernel's stamp cannot be, when it
 *          was read). With debouncing: of the edge after which the line was still. Of a level: when it was read. Stamps of
 *          a line never go back.
 * Debouncing: done here, on the stamps of the edges, with either libgpiod: the kernel's own would tell when it had
 *          waited, not when the edge was.
 * Bound:   a poll waits for edges for period_s less a rest of a tenth (1 ms at most). It takes a bounded number of edges of a
 *          line (TL_GPIO_EDGES); where more come, the newest level counts, and the next poll goes on. That edges were missed is told, every
 *          10 s at most, with their number as far as it can be known: the kernel does not count those that it drops.
 * Without edges: where a chip has no interrupts, levels are read once in a poll.
 * Source:  the GPIO character device's ABI, <linux/gpio.h>; libgpiod 1.6 or 2.x.
 */
#ifndef TL_BOARD_GPIO_GPIO_H
#define TL_BOARD_GPIO_GPIO_H

#include "board/gpio/gpio_lines.h"
#include "board/io/plant_access.h"
#include "board/io/plant_io.h"

/* Edges, and looks for edges, of one line in one poll: so many, and so many more for each ms of the period. */
enum { TL_GPIO_EDGES = 128, TL_GPIO_EDGES_PER_MS = 2 };

typedef struct tl_gpio_settings {
    const char *chip;                /* name ("gpiochip0"), label, or path; NULL: any, where all lines have names */
    double period_s;                 /* between the beginnings of polls, as the reader does it; > 0 */
    const tl_gpio_channel *channels; /* several may be one line, which is read as the first of them says */
    size_t channel_count;
} tl_gpio_settings;

extern const tl_plant_io_driver tl_gpio_driver;
extern const tl_plant_access tl_gpio_access;

/* Copies what it needs of `settings`. Opens no chip yet. Errors: TL_BAD_DATA for a setting out of its range, an offset
 * without a chip. */
tl_status tl_gpio_open(const tl_gpio_settings *settings, tl_plant_io **io, tl_error *error);

#endif
