/* What a check finds out by trying it: in processes of their own, so that whatever an FMU does there is a finding and no end.
 *
 * Bounds:  of each call as in a check (twin_child.h).
 * Thread:  one, as for twin_child.h.
 */
#ifndef TL_FIRMWARE_TWIN_CHECK_TRIALS_H
#define TL_FIRMWARE_TWIN_CHECK_TRIALS_H

#include <stdbool.h>

#include "firmware/twin/twin_child.h"
#include "firmware/twin/twin_trial.h"

/* ---- Another rollback method for a component that does not come back by the configured one.
 *
 * Purpose: for `check`. If the configuration names a method that is wrong for an FMU, tries what `auto` finds.
 * Trials:  each is a check of all components (twin_trial.h). At most one per component.
 */

typedef enum tl_other_way_kind {
    TL_OTHER_WAY_NOT_SOUGHT, /* there is nothing to say of it */
    TL_OTHER_WAY_UNKNOWN,    /* the trial failed: `text` says why */
    TL_OTHER_WAY_NONE,       /* no method is exact */
    TL_OTHER_WAY_FOUND
} tl_other_way_kind;

/* Of one component. */
typedef struct tl_other_way {
    tl_other_way_kind kind;
    tl_twin_way way;          /* FOUND */
    uint32_t replay_steps;    /* the limit of a rollback by replay */
    char text[TL_ERROR_TEXT]; /* UNKNOWN */
} tl_other_way;

enum { TL_OTHER_WAY_TEXT = TL_ERROR_TEXT + 400 };

/* `checked`: the result of the check with the settings' configuration. Fills an entry for each component. Errors: TL_INTERRUPTED. */
tl_status tl_other_way_find(const tl_twin_child_settings *settings, const tl_twin_ways *checked,
                            tl_other_way found[TL_RECORDER_COMPONENTS], tl_error *error);

/* Writes a sentence that follows the component's name. Not for TL_OTHER_WAY_NOT_SOUGHT. */
void tl_other_way_tell(const tl_other_way *other, char text[TL_OTHER_WAY_TEXT]);

/* ---- What two twins of one configuration tell of its FMUs.
 *
 * Purpose: one process has both twins (twin_trial.h). If they differ, another one has the first again, alone: an FMU that differs from itself alone is *not deterministic*; one that
 *          does not, and differs beside another instance, is for *one per process*, whatever it declares. So is one whose second instance crashes, never returns or is refused.
 * Bounds:  of steps as twin_trial.h says.
 */

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
