/* Level of a GPIO line: debouncing, and counting of missed edges.
 *
 * Owner:   the caller owns the structs; no allocation, no clock is read. Stamps are ns of
 *          CLOCK_MONOTONIC.
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
 * Purpose: converts stamped edges to stable changes of the level. A change has the stamp of the
 *          edge after which the line was stable, also if it is evaluated later.
 * Limits:  a line that is never stable keeps its last valid level, and `pending` stays true.
 */

typedef struct tl_gpio_debounce {
    tl_time time;  /* time for which a level must be stable to be valid, ns; 0: valid at once */
    bool level;    /* valid level */
    bool newest;   /* level after the last edge */
    bool pending;  /* `newest` has not been stable for long enough yet */
    tl_time since; /* stamp of the last edge, if pending */
} tl_gpio_debounce;

/* ---- Input: converts edges and levels to readings. Private to the GPIO driver; pure.
 *
 * Purpose: an edge gives the time of a change. A level, read once per poll, shows whether an edge
 *          was missed. If the level differs from the last edge, the missing edge may still be in
 *          the queue. So the level is accepted only if it is read a second time.
 * Missed:  one edge is counted as missed if an edge leads to the level that the input already has,
 *          or if an accepted level differs from the last edge.
 * Stamps:  never decrease. Edges older than the last edge or accepted level are dropped.
 */

typedef struct tl_gpio_input {
    tl_gpio_debounce debounce;
    bool level;         /* after the last edge, or the accepted level */
    bool doubtful;      /* after that, a different level was read once */
    tl_time last_stamp; /* stamp of the last edge or accepted level */
    tl_time posted;     /* stamp of the last reading */
    uint64_t missed;    /* number of missed edges, a lower bound */
} tl_gpio_input;

/* Initial settings of an input. */
typedef struct tl_gpio_input_settings {
    tl_time debounce; /* as tl_gpio_debounce.time */
    bool level;       /* first level of the line */
    tl_time stamp;    /* when this level was read */
    uint64_t missed;  /* edges missed before the line was lost and found again; 0 at first */
} tl_gpio_input_settings;

/* Initialises the input. Sets *reading to the first level, for posting. */
void tl_gpio_input_start(tl_gpio_input *input, const tl_gpio_input_settings *settings, tl_reading *reading);

/* Each of the following functions returns true if the caller must post *reading (value 0 or 1).
 * Otherwise *reading is undefined. */

/* Adds an edge to `level`. `now`: when it was read; a later `stamp` is replaced by `now`. */
bool tl_gpio_input_edge(tl_gpio_input *input, bool level, tl_time stamp, tl_time now, tl_reading *reading);

/* Adds a level that was read at `stamp` or shortly after it. A level that differs from the last
 * edge is only noted (`doubtful`), and accepted at the second call in a row. */
bool tl_gpio_input_level(tl_gpio_input *input, bool level, tl_time stamp, tl_reading *reading);

/* Adds a level and accepts it at once. Call it if edges may have been dropped or not read. From now
 * on, edges older than `stamp` are dropped. */
bool tl_gpio_input_resync(tl_gpio_input *input, bool level, tl_time stamp, tl_reading *reading);

/* Completes debouncing up to `now`. First add all edges before `now`. */
bool tl_gpio_input_advance(tl_gpio_input *input, tl_time now, tl_reading *reading);

/* Returns when to call tl_gpio_input_advance() next; INT64_MAX: no call is needed. */
tl_time tl_gpio_input_due(const tl_gpio_input *input);

#endif
