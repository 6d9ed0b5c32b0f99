/* Frozen sensors: finds matched signals whose readings do not change any more.
 *
 * Purpose: the readings of a frozen sensor have good quality, and a twin that follows them is in
 *          lock. Such a signal gets the quality TL_FROZEN, so it is not matched.
 * Run:     good readings in a row with one value. A run is suspicious if it has TL_FROZEN_LEAST
 *          readings, if the value has changed TL_FROZEN_LEAST times before, and if the run lasts
 *          longer than TL_FROZEN_LONGER times the longest run so far. A suspicious run is frozen if
 *          the plant moves.
 * Motion:  in lock y does not move either, because u is corrected until y agrees with the reading.
 *          So the released twins decide (master/sync/released_twin.h). While the plant rests, each
 *          release starts from the same state and gives the same outputs at the same age. With a
 *          standing correction, an integrator in the model may add the same change to each. So the
 *          plant moves if the second difference of three releases in a row exceeds 3 tolerances and
 *          3 times the smallest change of the readings. Only releases count that begin R/4 after
 *          the start of the run, and R/4 after the last step out of tolerance; R is the duration of
 *          a release (`release_s`), 6 s at a step of 10 ms. So a frozen sensor is found after 1.75
 *          R to 2.75 R.
 * Longest: two kinds of runs do not count as the longest run: frozen ones, and those in which
 *          releases were compared and the plant was at rest.
 * Ends:    with the first reading that has another value. Samples of instants before it keep the
 *          quality TL_FROZEN.
 * Limits:  only Reals with a weight. Without released twins or lock, nothing is found. False
 *          alarms: a plant that is blocked, if its reading has no noise; and a plant at rest, if a
 *          standing correction makes a state of the model run away.
 * Replay:  the decision depends only on samples and records. A replay of a run with its own
 *          configuration takes the recorded qualities, because a live run may have no time for
 *          released twins.
 * Memory:  23 kB, in the struct. Thread: plain data; one thread at a time.
 */
#ifndef TL_FIRMWARE_MONITOR_FROZEN_H
#define TL_FIRMWARE_MONITOR_FROZEN_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "firmware/config/config.h"
#include "master/base/signal.h"
#include "master/base/simtime.h"
#include "master/twin/twin.h"

enum {
    TL_FROZEN_LEAST = 20, /* least number of readings of a run, and of changes before it */
    TL_FROZEN_LONGER = 4, /* multiple of the longest run so far */
    TL_FROZEN_AGES = 8    /* ages at which releases are compared, from R/2 on */
};

/* BEGUN: the signal is now left out. ENDED: it moves again. */
typedef enum tl_frozen_turn { TL_FROZEN_AS_BEFORE, TL_FROZEN_BEGUN, TL_FROZEN_ENDED } tl_frozen_turn;

/* One match. All fields may be read. */
typedef struct tl_frozen_match {
    size_t reading;        /* signal with the unfiltered readings; SIZE_MAX: this match is not watched */
    size_t signal;         /* signal that is matched; may be the same */
    double value;          /* of the current run */
    tl_time begin, newest; /* stamps of its first and last reading; TL_TIME_NEVER: no reading yet */
    int64_t tick;          /* of its first reading */
    uint32_t readings;     /* of the current run, at most TL_FROZEN_LEAST */
    uint32_t changes;      /* of the value since the start, at most TL_FROZEN_LEAST */
    tl_time longest;       /* longest run before, ns */
    double finest;         /* smallest change so far, in the signal's unit */
    int64_t held_from;     /* y has been within tolerance since this step */
    /* Output of the last two releases at each age, the newer one first, and the steps at which they
     * were released. */
    double released[TL_FROZEN_AGES][2];
    int64_t released_at[TL_FROZEN_AGES][2];
    bool is_compared, has_moved; /* in the current run: releases were compared; the plant moved */
    bool is_frozen;
    tl_time until;       /* samples of earlier instants are of the frozen run; TL_TIME_NEVER: there was none */
    tl_frozen_turn turn; /* set by the last sample */
} tl_frozen_match;

typedef struct tl_frozen_watch {
    const tl_config *config;
    tl_frozen_match match[TL_MAX_MATCH];
} tl_frozen_watch;

/* `config` must outlive the watch. */
void tl_frozen_watch_init(tl_frozen_watch *watch, const tl_config *config);

/* Adds the sample of a tick; call it before the step of the tick. Returns the signals to be marked,
 * as bits. `is_decided`: its qualities were recorded with this configuration; then returns 0. */
uint64_t tl_frozen_watch_sample(tl_frozen_watch *watch, const tl_sample *sample, bool is_decided);

/* Sets the quality of the signals in `frozen` (bits) to TL_FROZEN if it is TL_GOOD. */
void tl_frozen_mark(uint64_t frozen, tl_sample *sample);

/* Adds a committed step. */
void tl_frozen_watch_step(tl_frozen_watch *watch, const tl_record *record);

#endif
