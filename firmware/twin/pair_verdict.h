/* What two twins of one configuration tell of its FMUs: in processes of their own, so that whatever an FMU does there is a finding and no end.
 *
 * Purpose: one process has both twins (twin_trial.h). If they differ, another one has the first again, alone: an FMU that differs from itself alone is *not deterministic*; one that
 *          does not, and differs beside another instance, is for *one per process*, whatever it declares. So is one whose second instance crashes, never returns or is refused.
 * Bounds:  of each call as in a check (twin_child.h); of steps as twin_trial.h says.
 * Thread:  one, as for twin_child.h.
 */
#ifndef TL_FIRMWARE_TWIN_PAIR_VERDICT_H
#define TL_FIRMWARE_TWIN_PAIR_VERDICT_H

#include "firmware/twin/twin_child.h"
#include "firmware/twin/twin_trial.h"

typedef enum tl_pair_kind {
    TL_PAIR_UNKNOWN, /* the FMUs cannot step, or the machine cannot have two twins: `text` says so */
    TL_PAIR_SAME,
    TL_PAIR_NOT_DETERMINISTIC,
    TL_PAIR_ONE_PER_PROCESS
} tl_pair_kind;

typedef struct tl_pair_verdict {
    tl_pair_kind kind;
    uint32_t steps;               /* that were compared */
    char component[TL_PAIR_NAME]; /* "": not known */
    char text[TL_ERROR_TEXT];     /* what happens, if anything does */
} tl_pair_verdict;

/* `settings`: of a check, which has found no problem. Errors: TL_INTERRUPTED. */
tl_status tl_pair_verdict_find(const tl_twin_child_settings *settings, tl_pair_verdict *verdict, tl_error *error);

#endif
