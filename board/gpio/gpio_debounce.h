/* Debouncing: a level counts once it has stood for a time. Private to the GPIO driver; pure.
 *
 * Purpose: from edges with their stamps to changes that last. A change has the stamp of the edge after which the line was
 *          still, to the nanosecond, however late anybody looks.
 * Limits:  a line that never stands still for the time keeps its last level, and `pending` stays true.
 */
#ifndef TL_BOARD_GPIO_GPIO_DEBOUNCE_H
#define TL_BOARD_GPIO_GPIO_DEBOUNCE_H

#include <stdbool.h>

#include "master/base/simtime.h"

typedef struct tl_gpio_debounce {
    tl_time time;  /* ns; 0: every edge counts */
    bool level;    /* that counts */
    bool newest;   /* by the last edge */
    bool pending;  /* it has not stood for long enough */
    tl_time since; /* stamp of the last edge, where pending */
} tl_gpio_debounce;

void tl_gpio_debounce_start(tl_gpio_debounce *debounce, tl_time time, bool level);

/* An edge to that level, not earlier than the one before. true where one before it, or this one itself, has changed the
 * level that counts; *since is when. */
bool tl_gpio_debounce_edge(tl_gpio_debounce *debounce, bool level, tl_time stamp, tl_time *since);

/* No further edge until then. The same. */
bool tl_gpio_debounce_pass(tl_gpio_debounce *debounce, tl_time now, tl_time *since);

#endif
