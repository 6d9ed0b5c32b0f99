/* Delays: how long a signal is on its way through dead times and cycles that know nothing of each other.
 *
 * Purpose: Δi and Δo (eq. 4.14, 4.15) from the model of asynchronous cycles (eq. 4.16).
 * Model:   a signal passes a chain of participants. Participants on one time base are synchronous; those of them that follow
 *          each other form a group, and every dead time in a group of two or more counts once. A link from one time base
 *          to another waits for the target's next cycle: uniform over its cycle time, and no dead time. The densities of
 *          the links convolve.
 * Exact:   a sum of uniforms has a density that is a polynomial between the sums of its parts, which are whole
 *          nanoseconds. It is kept as these parts, and evaluated by the recurrence of box splines, in which no term is negative:
 *          nothing cancels, however different the cycles are.
 * Mode:    the density of a sum of uniforms is symmetric, and falls from its middle on. The largest cycle L, spread over the
 *          density g of the others, gives (G(t) − G(t − L))/L with G = ∫g: constant 1/L from the sum of the others to L, where L is more
 *          than that sum: a plateau, and its right end is L. Else it grows while g(t) > g(t − L), and as g is symmetric,
 *          falls from its middle on and has no plateau as wide as L, that is up to the middle: half the sum of all.
 * Units:   ns; densities in 1/s. Thread: plain data.
 */
#ifndef TL_MASTER_PLAN_DELAY_H
#define TL_MASTER_PLAN_DELAY_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "master/base/simtime.h"

enum {
    TL_DELAY_CHAIN = 16, /* participants of a chain */
    TL_DELAY_LINKS = 7   /* asynchronous links of a chain */
};

/* A part of a chain: a bus, a controller, the simulation. */
typedef struct tl_delay_participant {
    tl_time dead;  /* τ, ≥ 0 */
    tl_time cycle; /* θ, > 0 */
    size_t base;   /* its time base: participants of the same one are synchronous */
} tl_delay_participant;

/* The delay of a chain: a constant, and a sum of uniforms. No uniform: the delay is the constant. */
typedef struct tl_delay_density {
    tl_time dead;
    size_t count;
    tl_time cycles[TL_DELAY_LINKS]; /* each is uniform from 0 to this */
} tl_delay_density;

/* The delay of the chain of `length` indices into `participants`. false: it has more than TL_DELAY_LINKS asynchronous links. */
bool tl_delay_of_chain(const tl_delay_participant *participants, const size_t *chain, size_t length,
                       tl_delay_density *density);

/* The rightmost mode (half a nanosecond is left out), and the longest delay there can be. */
tl_time tl_delay_mode(const tl_delay_density *density);
tl_time tl_delay_longest(const tl_delay_density *density);

/* The density at a delay, in 1/s; 0 of a delay that is constant. Bound: O(3^count · count). */
double tl_delay_density_at(const tl_delay_density *density, tl_time delay);

/* A look-up at an instant that lies `shift` after t_j (before it where that is < 0), from samples that are taken once a tick. */
typedef struct tl_delay_lookup {
    int32_t ticks;     /* it is in the sample of tick j + ticks, … */
    tl_time look_back; /* … which holds what was seen so long before its own instant, ≥ 0 */
} tl_delay_lookup;

/* The same at least `wait` later: so long may a sample wait for the next reading. |shift| + wait is less than 2^31 steps. */
tl_delay_lookup tl_delay_look_up(tl_time shift, tl_time wait, tl_time step);

/* The ticks, to the nearest whole one, by which a look-up moves so that ŷ is `delay` before y, where samples look back so far. */
int32_t tl_delay_ticks(tl_time look_back, tl_time delay, tl_time step);

#endif
