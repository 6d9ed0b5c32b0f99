/* What a twin costs, as a check finds it out: told by the process of the FMUs behind its page, to who has started the check.
 *
 * Trust:   it comes from a process with FMUs; numbers are bounded by who reads them.
 * Thread:  pure functions.
 */
#ifndef TL_FIRMWARE_RETUNE_TWIN_COST_H
#define TL_FIRMWARE_RETUNE_TWIN_COST_H

#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>

#include "master/base/simtime.h"

typedef struct tl_twin_cost {
    tl_time least;   /* ns of a free step; 0: not known */
    tl_time worst;   /* ns of a step that uses all its evaluations; 0: not known, or nothing is searched */
    uint64_t memory; /* bytes that it will have beside what the process has before it steps */
} tl_twin_cost;

/* The last line of a page. */
void tl_twin_cost_print(const tl_twin_cost *cost, FILE *page);

/* Takes it from the page's end, which is cut there. False: there is none, or no number could be one. */
bool tl_twin_cost_take(char *page, tl_twin_cost *cost);

#endif
