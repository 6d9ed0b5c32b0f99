/* Another rollback method for a component that does not come back by the configured one, found by trials.
 *
 * Purpose: for `check`. If the configuration names a method that is wrong for an FMU, tries what `auto` finds.
 * Trials:  each is a check of all components in a process of its own (twin_ways.h), so that a crash of an FMU is a finding. At most one per component.
 * Limits:  each call as in a check (twin_child.h).
 * Thread:  one, as for twin_child.h.
 */
#ifndef TL_FIRMWARE_TWIN_OTHER_WAY_H
#define TL_FIRMWARE_TWIN_OTHER_WAY_H

#include "firmware/twin/twin_child.h"
#include "firmware/twin/twin_ways.h"

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

#endif
