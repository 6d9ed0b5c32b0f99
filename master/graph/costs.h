/* Cost of executions, measured with as few clock readings as possible.
 *
 * Purpose: a search with a deadline must know the cost of an execution. But for a small FMU, a
 *          clock reading takes longer than a macro step. So it is normally read only once per
 *          macro step. The time between two readings is a lap. A lap's duration is shared among the
 *          components executed in it, in proportion to their expected costs. If all components
 *          execute in one call, only the duration of the call is learned.
 * Closely: to correct the proportions, the clock is read after each component in some macro steps:
 *          in the first one of every sixteenth step, and after a lap that took more than 1.5 times
 *          as long as expected.
 * Terms:   a macro step executes each component once, over T_S. A step contains the macro steps of
 *          all its candidates, and the committed one.
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
    double mean;  /* ns: recent mean over candidates, without the committed step, which may take far longer */
} tl_cost;

/* Number of executions in a row of which each may take as long as the longest recent one. */
enum { TL_COST_FEW = 16 };

/* Expected cost of `times` executions in a row, ns. TL_COST_FEW of them count with the longest
 * recent duration, all others with the mean. The sum may be too small: the caller reads the clock
 * after each macro step, and can abort a candidate. */
tl_time tl_cost_of(const tl_cost *cost, tl_time times);

typedef struct tl_costs {
    tl_time (*now)(void *clock); /* NULL: nothing is measured */
    void *clock;
    tl_time read;  /* last reading of the clock, ns */
    tl_cost *each; /* cost of one execution of each component, including the save of its state */
    tl_cost all;   /* cost of one execution of all components in one call */
    size_t count;
    size_t *ran; /* components that were executed in this lap */
    size_t ran_count;
    bool ran_all;               /* all were executed in one call in this lap */
    bool is_close;              /* the current macro step is measured component by component (see Closely) */
    size_t measured_components; /* components measured one by one in the current macro step */
    tl_time measured_time;      /* sum of their durations, ns */
    bool is_committed_step;     /* the committed step is being executed */
    bool walked;                /* an execution of a candidate was measured in this step */
    uint32_t steps;             /* number of steps that were started with a clock */
} tl_costs;

/* For `count` components. Returns false if memory is out. */
bool tl_costs_init(tl_costs *costs, tl_arena *arena, size_t count);

/* Starts a step and reads the clock `now`; NULL: nothing is measured in this step. */
void tl_costs_begin(tl_costs *costs, tl_time (*now)(void *clock), void *clock);

/* Call before tl_costs_begin() if time ran out in the last step. If no candidate was executed in
 * it, decreases the mean costs, so that a later step tries candidates again. */
void tl_costs_rest(tl_costs *costs);

/* The current lap executes the committed step: its duration is not part of the means. */
void tl_costs_commit(tl_costs *costs);

/* Records that one component was executed, or all in one call. */
void tl_costs_ran(tl_costs *costs, size_t component);
void tl_costs_ran_all(tl_costs *costs);

/* Ends a lap and reads the clock, which must not be NULL. If the lap has executions that were not
 * measured one by one, adds its duration to their costs and returns 0. Else returns the time since
 * the last clock reading, ns: the caller counts it as overhead. */
tl_time tl_costs_lap(tl_costs *costs);

#endif
