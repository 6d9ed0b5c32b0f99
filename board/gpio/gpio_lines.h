/* Chips and lines as libgpiod has them; either of its versions. Private to the GPIO driver.
 *
 * Purpose: all that the driver wants of libgpiod. gpio_lines_1.c is for 1.6, gpio_lines_2.c for 2.x; the build takes the one
 *          that fits what is installed.
 * Thread:  one.
 * Errors:  errno.
 */
#ifndef TL_BOARD_GPIO_GPIO_LINES_H
#define TL_BOARD_GPIO_GPIO_LINES_H

#include <stddef.h>

#include "board/gpio/gpio_channel.h"
#include "master/base/simtime.h"

/* ---- a chip, to look for lines ---- */

typedef struct tl_gpio_chip tl_gpio_chip;

/* NULL, errno: ENOTTY or ENODEV where it is no GPIO chip. */
tl_gpio_chip *tl_gpio_chip_open(const char *path);

const char *tl_gpio_chip_name(const tl_gpio_chip *chip); /* "gpiochip0" */
const char *tl_gpio_chip_label(const tl_gpio_chip *chip);
unsigned tl_gpio_chip_lines(const tl_gpio_chip *chip);

/* What the kernel says of a line now. */
typedef struct tl_gpio_line_state {
    char name[48]; /* empty: none */
    char consumer[48];
    bool used;
    bool output;
} tl_gpio_line_state;

/* 0, or errno. */
int tl_gpio_chip_look(tl_gpio_chip *chip, unsigned offset, tl_gpio_line_state *state);

void tl_gpio_chip_close(tl_gpio_chip *chip);

/* ---- a line that is ours ---- */

typedef struct tl_gpio_line tl_gpio_line;

typedef struct tl_gpio_edge {
    bool level; /* after it; active_low is taken into account */
    tl_time stamp;
} tl_gpio_edge;

/* Requests the line at `offset` of the chip at `path` as an input, as `channel` says: with edges, or without where the
 * chip has none. 0, or errno: EBUSY where somebody else has it. */
int tl_gpio_line_request(const char *path, unsigned offset, const tl_gpio_channel *channel, tl_gpio_line **line);

/* To wait for edges; −1: there are none. */
int tl_gpio_line_descriptor(const tl_gpio_line *line);

/* Its level now. 0, or errno: ENODEV where its chip is gone. */
int tl_gpio_line_level(tl_gpio_line *line, bool *level);

/* Takes edges that wait, at most `room`; waits for none. 0, or errno: EAGAIN where there is none. */
int tl_gpio_line_edges(tl_gpio_line *line, tl_gpio_edge *edges, size_t room, size_t *count);

/* NULL is allowed. */
void tl_gpio_line_release(tl_gpio_line *line);

#endif
