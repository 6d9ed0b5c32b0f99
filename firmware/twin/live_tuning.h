/* The tuning block: how a running twin is told of another configuration that differs in its tuning only.
 *
 * Purpose: one process writes it, the activator, that holds no FMU and no plant; the twin's cycle looks at its number at the start of each tick, and
 *          takes what it finds; the recorder takes the text. What came of it, each says in its own pulse: tl_live_tuning_answer, and
 *          tl_recorder_state_get().tuning. Who writes the next one before both have said so loses what the recorder had to say of the one before.
 * Numbers: odd while it is written or there is none any more, and even when it is whole; each one is 2 more than the one before. A writer that died in between leaves an odd one,
 *          with which nobody does anything, and its successor goes on from there.
 * Trust:   none in what is read: all of it is looked at in a copy. Nor in the answer, which is the twin's.
 * Memory:  of a block (block.h), zeroed at first; copied by words, so that nobody waits for anybody.
 * Thread:  one writes; any reads.
 */
#ifndef TL_FIRMWARE_TWIN_LIVE_TUNING_H
#define TL_FIRMWARE_TWIN_LIVE_TUNING_H

#include <stdbool.h>
#include <stdint.h>

#include "firmware/base/identity.h"
#include "firmware/base/os.h"
#include "firmware/config/config.h"
#include "firmware/monitor/lock_tally.h"
#include "firmware/process/block.h"
#include "master/base/status.h"
#include "master/plan/tuning.h"

enum { TL_LIVE_TUNING_WHO = 64, TL_LIVE_TUNING_ORIGIN = 16, TL_LIVE_TUNING_WHY = 256 };

/* All but the text. Texts are UTF-8, without control characters, and end within their arrays. */
typedef struct tl_live_tuning_head {
    uint32_t number;
    uint32_t size;             /* bytes of the text */
    char hash[TL_SHA256_TEXT]; /* of the text */
    char who[TL_LIVE_TUNING_WHO];
    char origin[TL_LIVE_TUNING_ORIGIN]; /* by which way it came */
    char why[TL_LIVE_TUNING_WHY];
    tl_tuning tuning; /* of the configuration */
} tl_live_tuning_head;

typedef struct tl_live_tuning {
    tl_live_tuning_head head;
    tl_latest tolerances; /* tl_lock_tolerances: what the twin's lock is judged by as well; zeroed: nothing else */
    char text[TL_CONFIG_MAX_BYTES + 8]; /* whole words; a NUL behind it */
} tl_live_tuning;

/* What the twin made of the newest that it has looked at. */
typedef struct tl_live_tuning_answer {
    uint32_t number; /* of it; 0: there was none yet */
    uint32_t refused;
    int64_t tick;            /* the first with it */
    char why[TL_ERROR_TEXT]; /* it was refused */
} tl_live_tuning_answer;

/* ---- who writes ---- */

/* The next one. The head's number does not matter; its size and hash are those of the text, which is at most TL_CONFIG_MAX_BYTES long. Its number. */
uint32_t tl_live_tuning_write(tl_live_tuning *block, const tl_live_tuning_head *head, const char *text);

/* What is there is for nobody any more; and the next one has a number above this. */
void tl_live_tuning_skip(tl_live_tuning *block, uint32_t number);

/* What the twin says of this number. False: nothing yet. */
bool tl_live_tuning_answered(const tl_live_tuning_answer *answer, uint32_t number, tl_live_tuning_answer *copy);

/* ---- who reads ---- */

/* Of what is there, whole or not: one relaxed load. 0: nothing. */
static inline uint32_t tl_live_tuning_number(const tl_live_tuning *block) {
    return __atomic_load_n(&block->head.number, __ATOMIC_RELAXED);
}

/* A copy. Errors: TL_TRY_AGAIN: there is none, or it is being written; TL_BAD_DATA: it cannot be one, and its number, which is set, need not be looked
 * at again. */
tl_status tl_live_tuning_read(const tl_live_tuning *block, tl_live_tuning_head *head, tl_error *error);

/* The text too, of as many bytes and a NUL as `text` has room for. Errors: the same, also if the text is not that of the hash. */
tl_status tl_live_tuning_read_text(const tl_live_tuning *block, tl_live_tuning_head *head,
                                   char text[TL_CONFIG_MAX_BYTES + 1], tl_error *error);

/* In a process that locks its memory and needs no text: it is not mapped any more, as far as it has pages of its own. */
void tl_live_tuning_hide_text(const tl_block *block);

/* ---- the twin ---- */

/* NULL `why`: it is in force from this tick on. */
void tl_live_tuning_answer_with(tl_live_tuning_answer *answer, uint32_t number, int64_t tick, const char *why);

#endif
