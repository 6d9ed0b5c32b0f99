/* The readings of one signal, conditioned before anything is made of them: outliers out, median, low-pass.
 *
 * Purpose: what is matched is what the plant does, not what one bad message or the noise of a sensor says. It counts readings, not ticks: each is
 *          taken once, as it comes, and what comes out are readings again, each under the stamp at which the plant was like that. So nothing that comes
 *          out is late: it comes later (config_lookups.c), and what lies between two of them is the affair of who looks them up.
 * Order:   gate, then median, then low-pass.
 * Gate:    a good reading further than `gate` from the last accepted one is rejected: nothing comes out. The third in a row that agree with each
 *          other (within the gate) is a new level: it is accepted, the filters start anew with these three, and nothing of the old level is in
 *          what they give. Readings that are not good neither make nor break the row. The very first good one is accepted unseen.
 * Median:  of so many readings in a row, under the stamp of the one in the middle. Until there are as many, of as many as there are if that is odd.
 * Low-pass: of first order, τ dy/dt = x − y, of the line x through the readings. It counts neither readings nor ticks: it is there at every instant, exactly,
 *          however unevenly messages come (tl_conditioner_between()). It starts on its first reading, and lags what moves evenly by τ; who looks it up makes
 *          up for that.
 * Quality: a reading that is not good comes out as it is, at once; the filters do not see it. What they give after it counts from its stamp on.
 * Gap:     where more than TL_CONDITIONER_GAP readings in a row were not accepted, or none for longer than what makes one stale, the
 *          filters start anew at the next good one, which is accepted wherever it is.
 * Units:   of the plant's signal.
 * Thread:  plain data; one thread at a time.
 */
#ifndef TL_FIRMWARE_PLANT_CONDITIONER_H
#define TL_FIRMWARE_PLANT_CONDITIONER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "master/base/signal.h"

enum {
    TL_CONDITIONER_GAP = 10,
    TL_CONDITIONER_MEDIAN = 99, /* readings at most */
    TL_CONDITIONER_LEVEL = 3    /* readings that make a new level, and that come out of one at most */
};

/* What comes out: a reading, and where the low-pass is at its stamp; its own value if there is none. */
typedef struct tl_conditioned {
    tl_reading reading;
    double smooth;
} tl_conditioned;

/* Fields are private. */
typedef struct tl_conditioner {
    tl_condition condition;
    tl_time stale;                            /* 0: never */
    tl_reading window[TL_CONDITIONER_MEDIAN]; /* of the median, in turn */
    size_t count;                             /* of these, since the filters started */
    size_t order[TL_CONDITIONER_MEDIAN];      /* their slots, by value */
    bool is_empty;                            /* the low-pass has got nothing since it started */
    tl_conditioned heard;                     /* what came into it last, and where it was then */
    bool has_accepted;
    tl_reading accepted;                          /* the last one */
    uint32_t since;                               /* readings since then */
    tl_reading pending[TL_CONDITIONER_LEVEL - 1]; /* rejected, as long as a new level may come of them */
    size_t pending_count;
    tl_time newest; /* stamp of what came out last; TL_TIME_NEVER: nothing has */
} tl_conditioner;

/* The median is odd, or none, and at most TL_CONDITIONER_MEDIAN. `stale` in ns; 0: never. */
void tl_conditioner_init(tl_conditioner *conditioner, const tl_condition *condition, tl_time stale);

/* The next reading, with a stamp later than the one before, and finite if it is good. How many readings come out, by ascending stamps that
 * are later than those before; none of one that is rejected. Bound: O(median). */
size_t tl_conditioner_take(tl_conditioner *conditioner, const tl_reading *reading, bool *is_rejected,
                           tl_conditioned out[TL_CONDITIONER_LEVEL]);

/* Where the low-pass is at an instant between two readings that came out one after the other; `low_pass` is τ > 0. */
double tl_conditioner_between(tl_time low_pass, const tl_conditioned *before, const tl_reading *after, tl_time at);

#endif
