/* What the processes of a run share of the machine's memory: how much, and what for. For who tells it before anything runs.
 *
 * Purpose: the sizes are those by which the tree makes the memory (live_wire.h). A page takes memory once it is used: of checkpoints and the past that
 *          are those which a twin of this size fills.
 * Thread:  pure.
 */
#ifndef TL_FIRMWARE_LIVE_LIVE_BLOCKS_H
#define TL_FIRMWARE_LIVE_LIVE_BLOCKS_H

#include <stddef.h>

#include "firmware/config/config.h"

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

#endif
