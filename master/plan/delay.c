/* Delays: see delay.h. */
#include "master/plan/delay.h"

enum { MOST_STATES = 2187 }; /* 3^TL_DELAY_LINKS */

bool tl_delay_of_chain(const tl_delay_participant *participants, const size_t *chain, size_t length,
                       tl_delay_density *density) {
    *density = (tl_delay_density){0};
    for (size_t i = 0; i < length; i++) {
        const tl_delay_participant *part = &participants[chain[i]];
        bool joins = i > 0 && participants[chain[i - 1]].base == part->base;
        bool goes_on = i + 1 < length && participants[chain[i + 1]].base == part->base;
        if (joins || goes_on) {
            density->dead += part->dead;
        }
        if (i > 0 && !joins) {
            if (density->count == TL_DELAY_LINKS) {
                return false;
            }
            density->cycles[density->count++] = part->cycle;
        }
    }
    return true;
}

static tl_time sum_of_cycles(const tl_delay_density *density) {
    tl_time sum = 0;
    for (size_t i = 0; i < density->count; i++) {
        sum += density->cycles[i];
    }
    return sum;
}

tl_time tl_delay_mode(const tl_delay_density *density) {
    tl_time sum = sum_of_cycles(density);
    tl_time largest = 0;
    for (size_t i = 0; i < density->count; i++) {
        largest = density->cycles[i] > largest ? density->cycles[i] : largest;
    }
    return density->dead + (largest > sum - largest ? largest : sum / 2);
}

tl_time tl_delay_longest(const tl_delay_density *density) {
    return density->dead + sum_of_cycles(density);
}

/* The recurrence: the density of n uniforms at x, from those of n − 1 of them,
 *     (n − 1)·M(x) = Σ over i of τ·M_without_i(x) + (1 − τ)·M_without_i(x − a_i),  τ = x/Σa.
 * A state says of each uniform whether it is there (2), or gone and a_i subtracted (1) or not (0): a number in base 3. What a
 * state needs has a smaller number. */
static double density_of_state(const tl_delay_density *density, size_t state, tl_time at, const double *smaller) {
    size_t place = 1;
    size_t there = 0;
    tl_time sum = 0;
    for (size_t i = 0, rest = state; i < density->count; i++, rest /= 3) {
        there += rest % 3 == 2;
        sum += rest % 3 == 2 ? density->cycles[i] : 0;
        at -= rest % 3 == 1 ? density->cycles[i] : 0;
    }
    if (there == 0 || at < 0 || at >= sum) {
        return 0.0;
    }
    if (there == 1) {
        return 1.0 / tl_seconds(sum);
    }
    double share = (double)at / (double)sum;
    double rest_of_it = (double)(sum - at) / (double)sum; /* 1 − share would lose digits near 1 */
    double total = 0.0;
    for (size_t i = 0, rest = state; i < density->count; i++, rest /= 3, place *= 3) {
        if (rest % 3 == 2) {
            total += share * smaller[state - 2 * place] + rest_of_it * smaller[state - place];
        }
    }
    return total / (double)(there - 1);
}

double tl_delay_density_at(const tl_delay_density *density, tl_time delay) {
    double values[MOST_STATES] = {0.0};
    size_t states = 1;
    for (size_t i = 0; i < density->count; i++) {
        states *= 3;
    }
    for (size_t state = 0; state < states; state++) {
        values[state] = density_of_state(density, state, delay - density->dead, values);
    }
    return values[states - 1];
}

tl_delay_lookup tl_delay_look_up(tl_time shift, tl_time wait, tl_time step) {
    tl_time until = shift + wait;
    tl_time ticks = until / step + (until % step > 0);
    return (tl_delay_lookup){.ticks = (int32_t)ticks, .look_back = ticks * step - shift};
}

int32_t tl_delay_ticks(tl_time look_back, tl_time delay, tl_time step) {
    tl_time until = look_back - delay;
    tl_time half = until < 0 ? -(step / 2) : step / 2;
    return (int32_t)((until + half) / step);
}
