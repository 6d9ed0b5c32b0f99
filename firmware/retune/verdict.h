/* A verdict: what a validator found out about a candidate.
 *
 * Purpose: all that its asker learns of a text that it does not parse itself.
 * Trust:   made by a process that has read what a stranger sent. It lies in memory of a fixed size, has no pointers, and is believed nothing:
 *          tl_verdict_take() copies it, bounds its numbers and ends its texts. The worst that a lie can do is to call a candidate good that is not, or
 *          a change small that is not: the twin refuses a tuning that does not fit it, and all else is tried before it is activated.
 * Thread:  plain data.
 */
#ifndef TL_FIRMWARE_RETUNE_VERDICT_H
#define TL_FIRMWARE_RETUNE_VERDICT_H

#include <stdbool.h>
#include <stdint.h>

#include "firmware/monitor/lock_tally.h"
#include "firmware/retune/control_wire.h"
#include "master/plan/tuning.h"

enum { TL_VERDICT_PROBLEMS = 32, TL_VERDICT_CHANGES = 32, TL_VERDICT_WIDENED = 128 };

/* Of a window: more than any configuration can have. */
#define TL_VERDICT_LONGEST (1000000000 * TL_SECOND)

typedef struct tl_verdict {
    uint32_t is_there; /* 1: all of this is; the last to be written */
    uint32_t is_valid; /* 1: the candidate can be read without a problem, and `kind` … `tuning` mean something */
    uint32_t kind;     /* tl_change_kind */
    uint32_t right;    /* tl_change_right */
    uint32_t
        problems; /* that were found; of one that is valid: values that its sender may lack the right to; the first ones are listed */
    uint32_t changes;           /* the same */
    uint32_t strokes;           /* that must have ended before its lock is judged (lock_judge.h); 0: steps, */
    tl_time window;             /* ns that those take */
    char name[TL_CONTROL_NAME]; /* of the plant, as the candidate has it */
    tl_control_problem problem[TL_VERDICT_PROBLEMS];
    tl_control_change change[TL_VERDICT_CHANGES];
    tl_tuning tuning; /* the candidate's */
    tl_lock_yardstick
        yardstick; /* of the version that a probation would return to, in the order of the candidate's outputs; zeroed: there is none */
    char widened[TL_VERDICT_WIDENED]; /* the first output that the candidate judges less strictly, and how; "": none */
} tl_verdict;

/* False: there is none, or it cannot be one. */
bool tl_verdict_take(const tl_verdict *from, tl_verdict *verdict);

#endif
