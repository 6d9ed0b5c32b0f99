/* Level of a GPIO line: debouncing and counting of edges.
 *
 * Thread:  the one that reads the source.
 */
#ifndef TL_BOARD_GPIO_GPIO_INPUT_H
#define TL_BOARD_GPIO_GPIO_INPUT_H

#include <stdbool.h>
#include <stdint.h>

#include "board/io/plant_io.h"
#include "master/base/simtime.h"

/* ---- Debouncing: a level is valid after it has been stable for a time. Private to the GPIO
 * driver; pure.
 *
 * Purpose: converts stamped edges to stable changes. A change has the exact stamp of the edge after
 *          which the line was stable, however late it is evaluated.
 * Limits:  a line that is never stable keeps its last level, and `pending` stays true.
 */

typedef struct tl_gpio_debounce {
    tl_time time;  /* ns; 0: every edge counts */
    bool level;    /* valid level */
    bool newest;   /* level after the last edge */
    bool pending;  /* it has not been stable for long enough */
    tl_time since; /* stamp of the last edge, if pending */
} tl_gpio_debounce;

/* ---- Input: converts edges and levels to readings. Private to the GPIO driver; pure.
 *
 * Purpose: an edge gives the time, a level shows whether an edge was missed. A level that differs
 *          from the last edge is accepted when it is read a second time, because the edge may still
 *          be queued.
 * Missed:  two consecutive edges to the same level, and a level without an edge, count as one
 *          missed edge each.
 * Stamps:  never decrease. Edges older than an accepted level are dropped.
 */

typedef struct tl_gpio_input {
    tl_gpio_debounce debounce;
    bool level;      /* after the last edge, or the accepted level */
    bool doubtful;   /* another level was read since */
    tl_time seen;    /* stamp of that edge or level */
    tl_time posted;  /* stamp of the last reading */
    uint64_t missed; /* edges, at least */
} tl_gpio_input;

/* Initial settings of an input. */
typedef struct tl_gpio_input_settings {
    tl_time debounce; /* ns; 0: every edge counts */
    bool level;       /* the first, */
    tl_time stamp;    /* when it was read */
    uint64_t missed;  /* edges missed before the line was lost and found again; 0 at first */
} tl_gpio_input_settings;

/* Initialises the input. *reading is the first level. */
void tl_gpio_input_start(tl_gpio_input *input, const tl_gpio_input_settings *settings, tl_reading *reading);

/* Each of these returns true if there is a reading to post, in *reading. */

/* Adds an edge. `now`: when it was read; no stamp is later. */
bool tl_gpio_input_edge(tl_gpio_input *input, bool level, tl_time stamp, tl_time now, tl_reading *reading);

/* Adds a level read at `stamp` or later. */
bool tl_gpio_input_level(tl_gpio_input *input, bool level, tl_time stamp, tl_reading *reading);

/* The same; the level is accepted at once and earlier edges are dropped. */
bool tl_gpio_input_newest(tl_gpio_input *input, bool level, tl_time stamp, tl_reading *reading);

/* Evaluates debouncing at a time. */
bool tl_gpio_input_pass(tl_gpio_input *input, tl_time now, tl_reading *reading);

/* Latest time to call the function above; INT64_MAX: not needed. */
tl_time tl_gpio_input_due(const tl_gpio_input *input);

#endif
