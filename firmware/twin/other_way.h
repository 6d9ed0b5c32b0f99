/* By which other way a component would be led back, found out by trying it: in processes of their own, so that whatever an FMU does there is a finding and no end.
 *
 * Purpose: for `check`, which has seen by which way each component comes back, or that one does not. One that comes back by replay, for so many steps only, may do so by forking for as long
 *          as it runs; one that does not come back may do so by what `auto` finds, or by forking, which `auto` does not try.
 * Trials:  each is a check of all components in another process (twin_trial.h), in which some are led back otherwise; who fails there has the next way of its own, or what it had. So there are at most
 *          three for each component and one, and none if nothing is to be tried.
 * Bounds:  of each call as in a check (twin_child.h).
 * Thread:  one, as for twin_child.h.
 */
#ifndef TL_FIRMWARE_TWIN_OTHER_WAY_H
#define TL_FIRMWARE_TWIN_OTHER_WAY_H

#include <stdbool.h>

#include "firmware/twin/twin_child.h"
#include "firmware/twin/twin_trial.h"

typedef enum tl_other_way_kind {
    TL_OTHER_WAY_NOT_SOUGHT, /* there is nothing to tell of it */
    TL_OTHER_WAY_UNKNOWN,    /* it could not be tried: `text` says why */
    TL_OTHER_WAY_NONE,       /* it comes back in no other */
    TL_OTHER_WAY_FOUND
} tl_other_way_kind;

/* Of one component. */
typedef struct tl_other_way {
    tl_other_way_kind kind;
    bool comes_back;       /* by replay, as it is configured */
    tl_twin_way way;       /* FOUND */
    uint32_t replay_steps; /* within which it is led back by replay */
    char text
        [TL_ERROR_TEXT]; /* UNKNOWN: why. Else how it does not come back by forking: "has a thread, …"; "": that was not tried */
} tl_other_way;

enum { TL_OTHER_WAY_TEXT = TL_ERROR_TEXT + 400 };

/* What `checked` leaves open; one for each component. `settings`: of that check. Errors: TL_INTERRUPTED. */
tl_status tl_other_way_find(const tl_twin_child_settings *settings, const tl_twin_ways *checked,
                            tl_other_way found[TL_RECORDER_COMPONENTS], tl_error *error);

/* A sentence behind the component's name, of one that was sought. */
void tl_other_way_tell(const tl_other_way *other, char text[TL_OTHER_WAY_TEXT]);

#endif
