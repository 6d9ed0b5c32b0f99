/* Recorded samples for a shadow: the side of the recorder, which alone reads the database of a run.
 *
 * Purpose: the shadow says in its pulse from which tick on it wants samples; the recorder finds them, and puts them into the past block of its place
 *          (past_samples.h).
 * Trust:   none in the shadow: it gets what is recorded, and at most what the block has room for.
 * Thread:  the recorder's. What is pointed to must stay.
 */
#ifndef TL_FIRMWARE_LIVE_LIVE_SAMPLES_H
#define TL_FIRMWARE_LIVE_LIVE_SAMPLES_H

#include "firmware/live/live_wire.h"
#include "firmware/process/block.h"

typedef struct tl_live_samples {
    const tl_live_twin_pulse *pulse; /* of the twin in the other place, which it writes */
    tl_live_past_answer *answer;     /* of the recorder, to it */
    tl_block *past;                  /* for it; the recorder writes */
    const char *boot;                /* tl_identity_boot() */
    /* private, zeroed at first */
    tl_live_wish answered;
    bool is_filled;
} tl_live_samples;

/* Answers the newest wish with what is in the database at `path`, if there is one that was not answered; gives the memory back once nobody wants
 * any more. */
void tl_live_samples_look(tl_live_samples *self, const char *path);

#endif
