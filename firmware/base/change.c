/* Kind, right and origin of a configuration change: see change.h. */
#include "firmware/base/change.h"

#include <string.h>

const char *const tl_change_kinds[TL_CHANGE_KINDS] = {[TL_CHANGE_NONE] = "none",
                                                      [TL_CHANGE_IN_PLACE] = "in place",
                                                      [TL_CHANGE_NEW_TWIN] = "new twin",
                                                      [TL_CHANGE_RESTART] = "restart"};

const char *const tl_change_rights[TL_RIGHTS] = {[TL_RIGHT_READ] = "read",
                                                 [TL_RIGHT_RETUNE] = "retune",
                                                 [TL_RIGHT_COMMISSION] = "commission",
                                                 [TL_RIGHT_BOX] = "on the box"};

const char *const tl_change_origins[TL_ORIGINS] = {[TL_ORIGIN_RELOAD] = "reload",
                                                   [TL_ORIGIN_NETWORK] = "network",
                                                   [TL_ORIGIN_LIMITED] = "limited",
                                                   [TL_ORIGIN_START] = "start",
                                                   [TL_ORIGIN_HAND] = "hand"};

bool tl_change_right_of(const char *word, tl_change_right *right) {
    for (unsigned i = 0; i < TL_RIGHT_BOX; i++) {
        if (strcmp(word, tl_change_rights[i]) == 0) {
            *right = (tl_change_right)i;
            return true;
        }
    }
    return false;
}
