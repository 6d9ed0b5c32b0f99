/* Cost of executions, measured with as few clock readings as possible.
 *
 * Purpose: a deadline needs the cost of an execution, but for a cheap FMU a clock reading costs
 *          more than its step. So the clock is read at most once per macro step: a lap. The
 *          duration of a lap is shared among the components executed in it, in proportion to their
 *          expected costs. If all components execute in one call, the duration is that of the call.
 * Closely: to correct the proportions, some macro steps are measured component by component: in
 *          every sixteenth step, and if a lap took longer than expected.
 * Thread:  the twin's. Memory: the arena, at start-up.
 */
#ifndef TL_MASTER_GRAPH_COSTS_H
#define TL_MASTER_GRAPH_COSTS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "master/base/arena.h"
#include "master/base/simtime.h"

typedef struct tl_cost {
    tl_time most; /* ns: the longest recent duration, decaying */
    double mean;  /* ns, recent mean over candidates; the committed step may take many times as long, but comes once */
} tl_cost;

/* Expected cost of `times` executions in a row. A few count as if each took the longest recent
 * duration. Many count with the mean, since the caller asks again after each. */
tl_time tl_cost_of(const tl_cost *cost, tl_time times);

typedef struct tl_costs {
    tl_time (*now)(void *clock); /* NULL: nothing is measured */
    void *clock;
    tl_time read;  /* last reading of the clock */
    tl_cost *each; /* of one execution of each component, including the save of its state */
    tl_cost all;   /* of one execution of all components in one call */
    size_t count;
    size_t *ran; /* components that were executed in this lap */
    size_t ran_count;
    bool ran_all;   /* all in one call */
    bool closely;   /* the current macro step is measured component by component */
    size_t looked;  /* components measured so far */
    tl_time seen;   /* their duration */
    bool apart;     /* the committed step is being executed */
    bool walked;    /* something else was executed in this step */
    uint32_t steps; /* steps started with a clock */
} tl_costs;

/* For `count` components. Returns false if memory is out. */
bool tl_costs_init(tl_costs *costs, tl_arena *arena, size_t count);

/* Starts a step and reads the clock; NULL: without one. */
void tl_costs_begin(tl_costs *costs, tl_time (*now)(void *clock), void *clock);

/* There was no time for something in the last step. If that was all of its candidates, their mean
 * cost decays, so that they are tried again later. */
void tl_costs_rest(tl_costs *costs);

/* Until the next lap, the committed step is executed. */
void tl_costs_commit(tl_costs *costs);

/* Records that one component was executed, or all in one call. */
void tl_costs_ran(tl_costs *costs, size_t component);
void tl_costs_ran_all(tl_costs *costs);

/* Ends a lap and reads the clock, which must exist. If components were executed, assigns them the
 * duration and returns 0; otherwise returns the duration, ns. */
tl_time tl_costs_lap(tl_costs *costs);

#endif
