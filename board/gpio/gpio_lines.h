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
 * Owner:   the caller owns the name.
 */

typedef enum tl_gpio_bias {
    TL_GPIO_AS_IS, /* the driver does not change the bias */
    TL_GPIO_PULL_UP,
    TL_GPIO_PULL_DOWN,
    TL_GPIO_NO_PULL
} tl_gpio_bias;

typedef struct tl_gpio_channel {
    const char *line; /* name of the line; NULL: `offset` identifies it */
    unsigned offset;  /* number of the line on its chip, from 0; not used with a name */
    bool active_low;  /* the low level is 1, the high level is 0 */
    tl_gpio_bias bias;
    double debounce_s; /* time for which a level must be stable to be valid, s, 0 … 60 */
} tl_gpio_channel;

/* ---- Chips and lines by libgpiod, either version. Private to the GPIO driver.
 *
 * Purpose: wraps the functions of libgpiod that the driver needs. gpio_lines_1.c is for 1.6,
 *          gpio_lines_2.c for 2.x; the build uses the one for the installed version.
 * Thread:  one.
 * Errors:  values of errno.
 */

/* ---- a chip, to search for lines ---- */

typedef struct tl_gpio_chip tl_gpio_chip;

/* Opens a chip; the caller closes it. Returns NULL with errno on failure: ENOTTY or ENODEV if
 * `path` is no GPIO chip. */
tl_gpio_chip *tl_gpio_chip_open(const char *path);

/* Return name, label and number of lines. The texts are valid while the chip is open. */
const char *tl_gpio_chip_name(const tl_gpio_chip *chip); /* "gpiochip0" */
const char *tl_gpio_chip_label(const tl_gpio_chip *chip);
unsigned tl_gpio_chip_lines(const tl_gpio_chip *chip);

/* State of a line in the kernel. */
typedef struct tl_gpio_line_state {
    char name[48];     /* empty: none */
    char consumer[48]; /* name of the program that uses the line; may be empty */
    bool used;         /* another program or the kernel uses the line */
    bool output;       /* the line is an output now */
} tl_gpio_line_state;

/* Reads the state of a line without requesting it. Returns 0 or errno. */
int tl_gpio_chip_read_line(tl_gpio_chip *chip, unsigned offset, tl_gpio_line_state *state);

void tl_gpio_chip_close(tl_gpio_chip *chip);

/* ---- a requested line ---- */

typedef struct tl_gpio_line tl_gpio_line;

typedef struct tl_gpio_edge {
    bool level;    /* after the edge, with active_low applied */
    tl_time stamp; /* the kernel's stamp, ns */
} tl_gpio_edge;

/* Requests the line at `offset` of the chip at `path` as an input, with bias and active_low of
 * `channel`. Enables edge detection, unless the chip has no interrupt for the line. The caller
 * releases the line. Returns 0 or errno: EBUSY if another process uses the line. */
int tl_gpio_line_request(const char *path, unsigned offset, const tl_gpio_channel *channel, tl_gpio_line **line);

/* Returns the descriptor to wait for edges; −1: the line has no edge detection. */
int tl_gpio_line_descriptor(const tl_gpio_line *line);

/* Reads the level, with active_low applied. Returns 0 or errno: ENODEV if the chip is gone. */
int tl_gpio_line_level(tl_gpio_line *line, bool *level);

/* Reads at most `room` queued edges without waiting; the line must have edge detection. Sets
 * *count. Returns 0 or errno: EAGAIN if there is no edge. */
int tl_gpio_line_edges(tl_gpio_line *line, tl_gpio_edge *edges, size_t room, size_t *count);

/* Releases the line. NULL is allowed. */
void tl_gpio_line_release(tl_gpio_line *line);

/* ---- Search for a GPIO line: its chip and offset. Private to the GPIO driver.
 *
 * Purpose: finds a line by name on one or all chips, or by offset on one chip. A chip is given by
 *          name, label or path; NULL: all chips. If two lines fit, the search fails.
 */

typedef struct tl_gpio_found {
    char path[64];   /* of the chip */
    char chip[96];   /* for messages: "gpiochip0 (label)" */
    unsigned offset; /* of the line on its chip */
    tl_gpio_line_state state;
} tl_gpio_found;

/* Finds the line of `channel`. Returns false if no line fits, or more than one. Then `text` (`size`
 * bytes) has the reason and the chips that were searched. */
bool tl_gpio_find(const char *chip, const tl_gpio_channel *channel, tl_gpio_found *found, char *text, size_t size);

#endif
