/* GPIO lines: configuration, search, and access by libgpiod.
 *
 * Thread:  the one that reads the source.
 */
#ifndef TL_BOARD_GPIO_GPIO_LINES_H
#define TL_BOARD_GPIO_GPIO_LINES_H

#include <stdbool.h>
#include <stddef.h>

#include "master/base/simtime.h"

/* ---- Configuration of a GPIO line.
 *
 * Purpose: shared by the driver, the search for lines and the libgpiod part.
 * Units:   seconds. Owner: the name belongs to the caller.
 */

typedef enum tl_gpio_bias {
    TL_GPIO_AS_IS, /* unchanged */
    TL_GPIO_PULL_UP,
    TL_GPIO_PULL_DOWN,
    TL_GPIO_NO_PULL
} tl_gpio_bias;

typedef struct tl_gpio_channel {
    const char *line; /* its name; NULL: identified by `offset` */
    unsigned offset;  /* within its chip */
    bool active_low;  /* 1 is the low level */
    tl_gpio_bias bias;
    double debounce_s; /* a level is valid after so long; 0: at once */
} tl_gpio_channel;

/* ---- Chips and lines by libgpiod, either version. Private to the GPIO driver.
 *
 * Purpose: all that the driver needs from libgpiod. gpio_lines_1.c is for 1.6, gpio_lines_2.c for
 *          2.x; the build uses the one for the installed version.
 * Thread:  one.
 * Errors:  errno.
 */

/* ---- a chip, to look for lines ---- */

typedef struct tl_gpio_chip tl_gpio_chip;

/* NULL with errno: ENOTTY or ENODEV if it is no GPIO chip. */
tl_gpio_chip *tl_gpio_chip_open(const char *path);

const char *tl_gpio_chip_name(const tl_gpio_chip *chip); /* "gpiochip0" */
const char *tl_gpio_chip_label(const tl_gpio_chip *chip);
unsigned tl_gpio_chip_lines(const tl_gpio_chip *chip);

/* State of a line in the kernel. */
typedef struct tl_gpio_line_state {
    char name[48]; /* empty: none */
    char consumer[48];
    bool used;
    bool output;
} tl_gpio_line_state;

/* 0, or errno. */
int tl_gpio_chip_read_line(tl_gpio_chip *chip, unsigned offset, tl_gpio_line_state *state);

void tl_gpio_chip_close(tl_gpio_chip *chip);

/* ---- a requested line ---- */

typedef struct tl_gpio_line tl_gpio_line;

typedef struct tl_gpio_edge {
    bool level; /* after the edge, with active_low applied */
    tl_time stamp;
} tl_gpio_edge;

/* Requests the line at `offset` of the chip at `path` as an input with the options of `channel`:
 * with edges, or without if the chip has none. Returns 0 or errno: EBUSY if another process uses
 * it. */
int tl_gpio_line_request(const char *path, unsigned offset, const tl_gpio_channel *channel, tl_gpio_line **line);

/* Descriptor to wait for edges; −1: there are none. */
int tl_gpio_line_descriptor(const tl_gpio_line *line);

/* Reads the level. Returns 0 or errno: ENODEV if the chip is gone. */
int tl_gpio_line_level(tl_gpio_line *line, bool *level);

/* Reads at most `room` queued edges without waiting. Returns 0 or errno: EAGAIN if there is none.
 */
int tl_gpio_line_edges(tl_gpio_line *line, tl_gpio_edge *edges, size_t room, size_t *count);

/* NULL is allowed. */
void tl_gpio_line_release(tl_gpio_line *line);

/* ---- Search for a GPIO line: its chip and offset. Private to the GPIO driver.
 *
 * Purpose: finds a line by name on one or all chips, or by offset on one chip. A chip is given by
 *          name, label or path. An ambiguous line is rejected; the text names both.
 */

typedef struct tl_gpio_found {
    char path[64]; /* of the chip */
    char chip[96]; /* for messages: "gpiochip0 (label)" */
    unsigned offset;
    tl_gpio_line_state state;
} tl_gpio_found;

/* Returns false if there is no line or more than one: `text` has what was searched and what exists.
 */
bool tl_gpio_find(const char *chip, const tl_gpio_channel *channel, tl_gpio_found *found, char *text, size_t size);

#endif
