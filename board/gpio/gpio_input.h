/* The level of a GPIO line, debounced, and the edges that are counted.
 *
 * Thread:  the one that reads the source.
 */
#ifndef TL_BOARD_GPIO_GPIO_INPUT_H
#define TL_BOARD_GPIO_GPIO_INPUT_H

#include <stdbool.h>
#include <stdint.h>

#include "board/io/plant_io.h"
#include "master/base/simtime.h"

/* ---- Debouncing: a level counts once it has stood for a time. Private to the GPIO driver; pure.
 *
 * Purpose: from edges with their stamps to changes that last. A change has the stamp of the edge after which the line was
 *          still, to the nanosecond, however late anybody looks.
 * Limits:  a line that never stands still for the time keeps its last level, and `pending` stays true.
 */

typedef struct tl_gpio_debounce {
    tl_time time;  /* ns; 0: every edge counts */
    bool level;    /* that counts */
    bool newest;   /* by the last edge */
    bool pending;  /* it has not stood for long enough */
    tl_time since; /* stamp of the last edge, where pending */
} tl_gpio_debounce;

/* ---- One input: from edges and levels to readings. Private to the GPIO driver; pure.
 *
 * Purpose: an edge says when, a level says that nothing was missed. A level that is not that of the last edge is believed
 *          when it is seen a second time: the edge may just be on its way.
 * Missed:  two edges in a row to the same level, and a level without an edge, each count as one at least.
 * Stamps:  of readings never go back. Edges that are older than a level that was believed are left out.
 */

typedef struct tl_gpio_input {
    tl_gpio_debounce debounce;
    bool level;      /* by the last edge, or the level that was believed */
    bool doubtful;   /* another level was seen since */
    tl_time seen;    /* stamp of that edge or level */
    tl_time posted;  /* stamp of the last reading */
    uint64_t missed; /* edges, at least */
} tl_gpio_input;

/* What an input begins with. */
typedef struct tl_gpio_input_settings {
    tl_time debounce; /* ns; 0: every edge counts */
    bool level;       /* the first, */
    tl_time stamp;    /* and when it was read */
    uint64_t missed;  /* edges, before it was lost and found again; 0 at first */
} tl_gpio_input_settings;

/* Whatever was in it. *reading is the first level. */
void tl_gpio_input_start(tl_gpio_input *input, const tl_gpio_input_settings *settings, tl_reading *reading);

/* Each of these returns true where there is something to post, and puts it into *reading. */

/* `now`: when it was read; no stamp is later. */
bool tl_gpio_input_edge(tl_gpio_input *input, bool level, tl_time stamp, tl_time now, tl_reading *reading);

/* A level that was read at `stamp`, or later. */
bool tl_gpio_input_level(tl_gpio_input *input, bool level, tl_time stamp, tl_reading *reading);

/* The same; it is believed at once, and what came before it is not wanted any more. */
bool tl_gpio_input_newest(tl_gpio_input *input, bool level, tl_time stamp, tl_reading *reading);

/* Time has passed. */
bool tl_gpio_input_pass(tl_gpio_input *input, tl_time now, tl_reading *reading);

/* When to call the one before, at the latest; INT64_MAX: there is no need. */
tl_time tl_gpio_input_due(const tl_gpio_input *input);

#endif
