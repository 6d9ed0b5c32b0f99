/* What executions take, from as few readings of a clock as can be.
 *
 * Purpose: a deadline needs to know what an execution costs; an FMU may be so cheap that asking for the time costs more. So the
 *          clock is read at most once for each macro step: a lap. What a lap took is shared among the components that were executed
 *          in it, in proportion to what each is expected to take. Where everything is executed in one go there is nothing to
 *          share out.
 * Closely: now and then a macro step is looked at component by component, which is what keeps the proportions true: in every
 *          sixteenth step, and where a shared lap took longer than was expected.
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
    tl_time most; /* ns: the longest lately, fading */
    double
        mean; /* ns, of late, in candidates: made once in a while, as in the committed step, it may take many times as long */
} tl_cost;

/* Of so many executions, one after the other: a few as if each were as long as the longest lately. Of many, most are not, and who is about
 * to make them asks again after each: the others are as on average. */
tl_time tl_cost_of(const tl_cost *cost, tl_time times);

typedef struct tl_costs {
    tl_time (*now)(void *clock); /* NULL: nothing is measured */
    void *clock;
    tl_time read;  /* the clock, when it was read last */
    tl_cost *each; /* of one execution of each component, saving its state included */
    tl_cost all;   /* of one execution of all of them, in one go */
    size_t count;
    size_t *ran; /* components that were executed in this lap */
    size_t ran_count;
    bool ran_all;   /* in one go */
    bool closely;   /* the macro step at hand is looked at component by component, */
    size_t looked;  /* and so were this many, */
    tl_time seen;   /* which took as long */
    bool apart;     /* what is executed now is the committed step */
    bool walked;    /* something else was, in this step */
    uint32_t steps; /* that were begun under a clock */
} tl_costs;

/* Of `count` components. False when memory is out. */
bool tl_costs_init(tl_costs *costs, tl_arena *arena, size_t count);

/* A step begins, under this clock, which is read; NULL: without one. */
void tl_costs_begin(tl_costs *costs, tl_time (*now)(void *clock), void *clock);

/* The step before had no time for something. Where that was all its candidates, what they take on average is tried again some time. */
void tl_costs_rest(tl_costs *costs);

/* From here to the next lap it is the committed step that is executed. */
void tl_costs_commit(tl_costs *costs);

/* This component was executed; all of them were, in one go. */
void tl_costs_ran(tl_costs *costs, size_t component);
void tl_costs_ran_all(tl_costs *costs);

/* A macro step ends, or something beside: reads the clock, which there must be. The time since it was read last is that of what was
 * executed meanwhile, and then 0 is returned; where nothing was, the time is returned, ns. */
tl_time tl_costs_lap(tl_costs *costs);

#endif
