/* GPIO lines: how one is configured, how it is found, and what libgpiod does with it.
 *
 * Thread:  the one that reads the source.
 */
#ifndef TL_BOARD_GPIO_GPIO_LINES_H
#define TL_BOARD_GPIO_GPIO_LINES_H

#include <stdbool.h>
#include <stddef.h>

#include "master/base/simtime.h"

/* ---- Which GPIO line a signal is on, and how it is read: as it is configured.
 *
 * Purpose: what the driver, the search for lines and libgpiod's side of it all speak of.
 * Units:   seconds. Owner: the name belongs to the caller.
 */

typedef enum tl_gpio_bias {
    TL_GPIO_AS_IS, /* whatever it is now */
    TL_GPIO_PULL_UP,
    TL_GPIO_PULL_DOWN,
    TL_GPIO_NO_PULL
} tl_gpio_bias;

typedef struct tl_gpio_channel {
    const char *line; /* its name; NULL: it is the one at `offset` */
    unsigned offset;  /* within its chip */
    bool active_low;  /* 1 is the low level */
    tl_gpio_bias bias;
    double debounce_s; /* a level counts once it has stood for so long; 0: at once */
} tl_gpio_channel;

/* ---- Chips and lines as libgpiod has them; either of its versions. Private to the GPIO driver.
 *
 * Purpose: all that the driver wants of libgpiod. gpio_lines_1.c is for 1.6, gpio_lines_2.c for 2.x; the build takes the one
 *          that fits what is installed.
 * Thread:  one.
 * Errors:  errno.
 */

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
int tl_gpio_chip_find_lines(tl_gpio_chip *chip, unsigned offset, tl_gpio_line_state *state);

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

/* ---- Where a GPIO line is: which chip, which offset. Private to the GPIO driver.
 *
 * Purpose: a line by its name, on one chip or on all, or by its offset on one chip. A chip is given by name, label or path.
 *          What fits two places fits none: both are named.
 */

typedef struct tl_gpio_place {
    char path[64]; /* of the chip */
    char chip[96]; /* for people: "gpiochip0 (label)" */
    unsigned offset;
    tl_gpio_line_state state;
} tl_gpio_place;

/* false where there is none, or more than one: `text` says what was looked for and what is there. */
bool tl_gpio_find(const char *chip, const tl_gpio_channel *channel, tl_gpio_place *place, char *text, size_t size);

#endif
