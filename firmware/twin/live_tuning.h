/* Tuning block: passes a configuration that differs only in its tuning to a running twin.
 *
 * Purpose: the config manager writes the block. The twin's cycle checks the number at the start of
 *          each tick and applies a new tuning; the recorder stores the text. Each reports the
 *          result in its own status block: the twin a tl_live_tuning_answer, the recorder
 *          tl_recorder_state_get().tuning. If the next tuning is written before both have answered,
 *          the recorder's answer to the earlier one is lost.
 * Numbers: 0: no tuning yet. Even: the block is complete. Odd: a write is in progress, or the
 *          tuning was invalidated. Each tuning has a higher number than the one before. If the
 *          writer dies during a write, the number stays odd: readers skip the block, and the next
 *          writer continues from there.
 * Trust:   the content is untrusted: readers copy it before they validate it. The answer is
 *          untrusted too, because the twin writes it.
 * Memory:  in a block (block.h), zeroed at first; copied word by word, so that no process waits for
 *          another.
 * Thread:  one writer, any readers.
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

/* All fields except the text. Texts are UTF-8 without control characters, and end within their
 * arrays. */
typedef struct tl_live_tuning_head {
    uint32_t number;
    uint32_t size;                      /* bytes of the text, without its NUL */
    char hash[TL_SHA256_TEXT];          /* SHA-256 of the text */
    char who[TL_LIVE_TUNING_WHO];       /* name of the user who made the change */
    char origin[TL_LIVE_TUNING_ORIGIN]; /* how the change arrived, for example over the network */
    char why[TL_LIVE_TUNING_WHY];       /* the user's reason */
    tl_tuning tuning;                   /* tuning values of the configuration */
} tl_live_tuning_head;

typedef struct tl_live_tuning {
    tl_live_tuning_head head;
    tl_latest tolerances;               /* a tl_lock_tolerances, for tl_cycle_status.lock_before; zeroed: none */
    char text[TL_CONFIG_MAX_BYTES + 8]; /* text of the configuration with NUL; copied in 8-byte words */
} tl_live_tuning;

/* The twin's answer to the newest tuning that it has processed. */
typedef struct tl_live_tuning_answer {
    uint32_t number;         /* of that tuning; 0: none so far */
    uint32_t refused;        /* 1: the tuning was rejected */
    int64_t tick;            /* first tick with this tuning */
    char why[TL_ERROR_TEXT]; /* why it was rejected */
} tl_live_tuning_answer;

/* ---- writer ---- */

/* Writes the next tuning and returns its number. head->number is ignored. head->size and head->hash
 * must be those of the text, which has at most TL_CONFIG_MAX_BYTES bytes. */
uint32_t tl_live_tuning_write(tl_live_tuning *block, const tl_live_tuning_head *head, const char *text);

/* Invalidates the present tuning: its number becomes odd. The next number is above `number`. */
void tl_live_tuning_skip(tl_live_tuning *block, uint32_t number);

/* Copies the twin's answer to tuning `number`. Returns false if its newest answer is to another. */
bool tl_live_tuning_answered(const tl_live_tuning_answer *answer, uint32_t number, tl_live_tuning_answer *copy);

/* ---- readers ---- */

/* Number of the block, even or odd; one relaxed load. 0: no tuning yet. */
static inline uint32_t tl_live_tuning_number(const tl_live_tuning *block) {
    return __atomic_load_n(&block->head.number, __ATOMIC_RELAXED);
}

/* Copies the head. Errors: TL_TRY_AGAIN: there is no tuning, or it is being written. TL_BAD_DATA:
 * the content is invalid; head->number is set, so that the caller can skip this tuning. */
tl_status tl_live_tuning_read(const tl_live_tuning *block, tl_live_tuning_head *head, tl_error *error);

/* As tl_live_tuning_read(), with the text and a NUL. Errors: the same; TL_BAD_DATA also if the text
 * does not match the hash. */
tl_status tl_live_tuning_read_text(const tl_live_tuning *block, tl_live_tuning_head *head,
                                   char text[TL_CONFIG_MAX_BYTES + 1], tl_error *error);

/* Makes the pages that contain only text inaccessible (mprotect). For a process that locks its
 * memory and does not read the text: the kernel then allocates no pages for it. */
void tl_live_tuning_hide_text(const tl_block *block);

/* ---- twin ---- */

/* Publishes the answer. `why` NULL: the tuning applies from this tick on. Else: why it was
 * rejected. */
void tl_live_tuning_answer_with(tl_live_tuning_answer *answer, uint32_t number, int64_t tick, const char *why);

#endif
