/* Which GPIO line a signal is on, and how it is read: as it is configured.
 *
 * Purpose: what the driver, the search for lines and libgpiod's side of it all speak of.
 * Units:   seconds. Owner: the name belongs to the caller.
 */
#ifndef TL_BOARD_GPIO_GPIO_CHANNEL_H
#define TL_BOARD_GPIO_GPIO_CHANNEL_H

#include <stdbool.h>

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

#endif
