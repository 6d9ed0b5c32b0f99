/* Where a GPIO line is: which chip, which offset. Private to the GPIO driver.
 *
 * Purpose: a line by its name, on one chip or on all, or by its offset on one chip. A chip is given by name, label or path.
 *          What fits two places fits none: both are named.
 */
#ifndef TL_BOARD_GPIO_GPIO_FIND_H
#define TL_BOARD_GPIO_GPIO_FIND_H

#include "board/gpio/gpio_lines.h"

typedef struct tl_gpio_place {
    char path[64]; /* of the chip */
    char chip[96]; /* for people: "gpiochip0 (label)" */
    unsigned offset;
    tl_gpio_line_state state;
} tl_gpio_place;

/* false where there is none, or more than one: `text` says what was looked for and what is there. */
bool tl_gpio_find(const char *chip, const tl_gpio_channel *channel, tl_gpio_place *place, char *text, size_t size);

#endif
