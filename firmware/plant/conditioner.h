/* Conditioner: filters the readings of one signal: outliers, median, low-pass.
 *
 * Purpose:  the twin must not follow bad messages or sensor noise. The conditioner counts readings,
 *           not ticks: each reading enters once, when it comes. Its outputs are readings again,
 *           each with the stamp of the instant that it describes. So an output has no lag; it is
 *           only available later (config_lookups.c). The caller interpolates between two outputs.
 * Order:    leap or gate, then median, then low-pass.
 * Leap:     rejects isolated outliers without a parameter of the plant. A *move* is the difference
 *           of two successive accepted readings. The *usual move* is the largest recent one, or the
 *           smallest one ever if that is larger (the resolution of a quantised signal). A good
 *           reading *leaps* if its distance from the last accepted one exceeds both `leap` and
 *           twice the usual move. A reading A that leaps waits for the next reading B:
 *           - If B is at most a usual move away from A, both are accepted: the plant has stepped.
 *           - If B does not leap, A is rejected as an outlier if B is at least twice as near to the
 *             last accepted reading as to A. Else both are accepted.
 *           - If B leaps too, it also waits, and the next reading C decides. If C leaps as well,
 *             all three are accepted, and the smallest of their moves counts as a usual move.
 *           - If no reading follows within TL_CONDITIONER_PATIENCE times the interval before A, the
 *             waiting readings are accepted.
 *           The filters do not restart after a leap. The largest move decays slowly. One reading
 *           raises it by at most a quarter, or up to half of `leap`, so that an accepted outlier
 *           does not hide the next one.
 * Gate:     a good reading further than `gate` from the last accepted one is rejected: there is no
 *           output. If three rejected readings in a row agree with each other within the gate, they
 *           are a new level: they are accepted, and the filters restart with these three. Readings
 *           that are not good are ignored in this count. The first good reading is always accepted.
 * Median:   of `median` readings in a row, with the stamp of the middle one. At the start, fewer
 *           readings are used; there is an output if their number is odd.
 * Low-pass: first order, τ dy/dt = x − y, where x is the line through the readings. It is solved
 *           exactly for any instant, also with uneven intervals (tl_conditioner_between()). It
 *           starts at its first reading, with the value of that reading. It lags a ramp by τ; the
 *           caller compensates for that.
 * Quality:  a reading that is not good is output at once, unchanged; the filters ignore it. An
 *           output whose stamp is not later than that of the output before is dropped.
 * Gap:      the filters restart at the next good reading after a gap, and accept it with any value.
 *           A gap is more than TL_CONDITIONER_GAP readings in a row that were not accepted, or the
 *           stale time without an accepted one.
 * Units:    values in the unit of the plant's signal, stamps in ns.
 * Memory:   plain data of the caller. Errors: none.
 * Thread:   plain data; one thread at a time.
 */
#ifndef TL_FIRMWARE_PLANT_CONDITIONER_H
#define TL_FIRMWARE_PLANT_CONDITIONER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "master/base/signal.h"

enum {
    TL_CONDITIONER_GAP = 10,     /* see Gap */
    TL_CONDITIONER_MEDIAN = 99,  /* largest number of readings of a median */
    TL_CONDITIONER_MOVES = 256,  /* readings after which the largest move has decayed to 1/e */
    TL_CONDITIONER_PATIENCE = 4, /* see Leap */
    TL_CONDITIONER_LEVEL = 3     /* readings that define a new level; largest number of outputs of one reading */
};

/* An output: a reading, and the value of the low-pass at its stamp. Without a low-pass `smooth` is
 * the reading's own value. */
typedef struct tl_conditioned {
    tl_reading reading;
    double smooth;
} tl_conditioned;

/* Fields are private. */
typedef struct tl_conditioner {
    tl_condition condition;
    tl_time stale;                            /* ns; 0: never */
    tl_reading window[TL_CONDITIONER_MEDIAN]; /* readings of the median, a ring */
    size_t count;                             /* readings that entered it since the filters started */
    size_t order[TL_CONDITIONER_MEDIAN];      /* indices in the window, sorted by value */
    bool is_empty;                            /* the low-pass has had no reading since it started */
    tl_conditioned last_smoothed;             /* last reading that entered the low-pass, and its output then */
    bool has_accepted;
    double largest_move;                          /* largest recent move, decaying, in the signal's unit */
    double smallest_move;                         /* smallest one ever, above 0; infinity: none yet */
    tl_reading accepted;                          /* last accepted reading */
    uint32_t since;                               /* readings since `accepted` */
    tl_reading pending[TL_CONDITIONER_LEVEL - 1]; /* waiting or rejected readings that may be accepted later */
    size_t pending_count;
    tl_time newest; /* stamp of the last output; TL_TIME_NEVER: none */
} tl_conditioner;

/* `condition`: its median must be 0, or odd and at most TL_CONDITIONER_MEDIAN. `stale`: ns; 0:
 * never. */
void tl_conditioner_init(tl_conditioner *conditioner, const tl_condition *condition, tl_time stale);

/* Adds the next reading; its stamp must be later than the one before, and a good value must be
 * finite. Returns the number of outputs in `out`, in the order of their stamps; all are later than
 * earlier outputs. *is_rejected: this reading is rejected or waits, so it has no output yet. Bound:
 * O(median). */
size_t tl_conditioner_take(tl_conditioner *conditioner, const tl_reading *reading, bool *is_rejected,
                           tl_conditioned out[TL_CONDITIONER_LEVEL]);

/* Accepts the waiting readings if no reading has followed in time (see Leap) by the instant `now`.
 * Returns the number of outputs in `out`. tl_conditioner_take() does this too, so the outputs do
 * not depend on how often this function is called. */
size_t tl_conditioner_wait(tl_conditioner *conditioner, tl_time now, tl_conditioned out[TL_CONDITIONER_LEVEL]);

/* Returns the value of the low-pass at the instant `at`, between two successive outputs `before`
 * and `after`. `low_pass` is τ > 0 in ns. */
double tl_conditioner_between(tl_time low_pass, const tl_conditioned *before, const tl_reading *after, tl_time at);

#endif
