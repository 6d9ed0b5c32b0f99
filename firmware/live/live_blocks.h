/* Memory that the processes of a live run share.
 *
 * Thread:  as each part says.
 */
#ifndef TL_FIRMWARE_LIVE_LIVE_BLOCKS_H
#define TL_FIRMWARE_LIVE_LIVE_BLOCKS_H

#include <stddef.h>

#include "firmware/base/os.h"
#include "firmware/config/config.h"
#include "firmware/live/live_job.h"
#include "firmware/live/live_wire.h"
#include "firmware/plant/plant_input.h"
#include "firmware/process/block.h"

/* ---- Which process of a run has which blocks (live_wire.h): asked by the supervisor, which gives them, and by the process, which takes them.
 *
 * Trust:   the mail is io's: what is in it is judged by who looks it up. A block of another size than it should have is not taken.
 * Thread:  any.
 */

typedef enum tl_live_kind { TL_LIVE_IS_IO, TL_LIVE_IS_RECORDER, TL_LIVE_IS_ACTIVATOR, TL_LIVE_IS_TWIN } tl_live_kind;

/* Bits by the number of the block. */
typedef struct tl_live_access {
    uint32_t reads;
    uint32_t writes;
} tl_live_access;

/* Those of the job's place; of a run that records or not, as the job says. */
tl_live_access tl_live_access_of(tl_live_kind kind, const tl_live_job *job);

/* Bytes of each block; an outbox is that of a twin of this configuration, whose second look-ups are signals. */
void tl_live_block_sizes(const tl_config *config, size_t sizes[TL_LIVE_BLOCKS]);

/* Takes all blocks of this process. `blocks` is zeroed before; what the process does not have stays so. Errors: TL_BAD_DATA. */
tl_status tl_live_blocks_take(tl_live_kind kind, const tl_live_job *job, const tl_config *config,
                              tl_block blocks[TL_LIVE_BLOCKS], tl_error *error);

/* Samples of the plant by the mail that was taken. Errors: TL_TRY_AGAIN. */
tl_status tl_live_input_open(const tl_config *config, const tl_block *mail, tl_plant_input *input, tl_error *error);

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
 *          (past_samples.h).
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

#endif
