/* Memory that the processes of a live run share.
 *
 * Thread:  as each part says.
 */
#ifndef TL_FIRMWARE_LIVE_LIVE_BLOCKS_H
#define TL_FIRMWARE_LIVE_LIVE_BLOCKS_H

#include <stddef.h>

#include "firmware/base/os.h"
#include "firmware/config/config.h"
#include "firmware/live/live_wire.h"
#include "firmware/live/recorded_course.h"
#include "firmware/process/block.h"
#include "firmware/twin/cycle.h"
#include "master/twin/account.h"

/* ---- What the processes of a run share of the machine's memory: how much, and what for. For who tells it before anything runs.
 *
 * Purpose: the sizes are those by which the tree makes the memory (live_wire.h). A page takes memory once it is used: of checkpoints and the past that
 *          are those which a twin of this size fills.
 * Thread:  pure.
 */

/* Bytes. */
typedef struct tl_live_blocks {
    size_t mail;        /* the plant's newest readings */
    size_t outbox;      /* what waits for the recorder, and what the processes say of themselves */
    size_t checkpoints; /* saved twins, as many as there is room for at a time; 0: none are saved */
    size_t past;        /* what a new twin goes on from; at most, and only until it has begun. 0: it never does */
    size_t shadow;      /* what another twin of this size has beside all that, while it runs as a shadow; at most */
} tl_live_blocks;

/* Of a twin that is saved in so many bytes; 0: it is not. `config` is one whose second look-ups are signals. */
void tl_live_blocks_of(const tl_config *config, size_t checkpoint, tl_live_blocks *blocks);

/* ---- Recorded samples for a shadow: the side of the recorder, which alone reads the database of a run.
 *
 * Purpose: the shadow says in its pulse from which tick on it wants samples; the recorder finds them, and puts them into the past block of its place
 *          (past_history.h).
 * Trust:   none in the shadow: it gets what is recorded, and at most what the block has room for.
 * Thread:  the recorder's. What is pointed to must stay.
 */

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

/* ---- How a twin shows what it does: its figures, in its pulse, for whoever shows and compares them (tl_run_status).
 *
 * Thread: one at a time. What is pointed to must stay.
 */

typedef struct tl_live_shown {
    const tl_config *config;      /* for the names of what is matched, */
    const tl_account *account;    /* and its units */
    const tl_live_mail_end *mail; /* that it reads once it is the run's */
    tl_latest *figures;           /* of the pulse */
} tl_live_shown;

/* A shadow over recorded samples. */
void tl_live_shown_recorded(const tl_live_shown *shown, const tl_run_status *recorded, const tl_metrics *match);

/* At the plant's ticks, or making up what was missed before. */
void tl_live_shown_live(const tl_live_shown *shown, const tl_cycle_status *status);

#endif
