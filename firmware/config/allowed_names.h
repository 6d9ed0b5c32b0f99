/* Names of files and libraries that a configuration from the network may have.
 *
 * Purpose: a library is native code, and a file is read by whoever may read it. So of those a configuration that does not come from the box names only what somebody on
 *          the box has named before: the administrator in a list, the active configuration, the file on the box.
 * Compare: names are compared as they are written, byte for byte. So nothing is looked up, no link is followed, and no ".." leads anywhere else.
 * Kinds:   a file that may be read is no library that may be loaded: who may write the one would bring code by the other.
 * Owner:   the caller places it; zeroed it is empty. tl_allowed_names_free() frees what it holds.
 * Thread:  one thread.
 */
#ifndef TL_FIRMWARE_CONFIG_ALLOWED_NAMES_H
#define TL_FIRMWARE_CONFIG_ALLOWED_NAMES_H

#include <stdbool.h>
#include <stddef.h>

#include "firmware/config/change_rules.h"
#include "master/base/status.h"

struct tl_allowed_name;

/* Fields are private. */
typedef struct tl_allowed_names {
    struct tl_allowed_name *names;
    size_t count, room;
} tl_allowed_names;

/* Those of an administrator's list: lines "file NAME" or "library NAME"; empty ones, and those that begin with #, say nothing. Other than these it is wrong as a whole.
 * Errors: TL_BAD_DATA, with the line; TL_TRY_AGAIN. */
tl_status tl_allowed_names_add_list(tl_allowed_names *allowed, const char *text, tl_error *error);

/* Those that a configuration has. Errors: TL_BAD_DATA for a text that is no JSON; TL_TRY_AGAIN. */
tl_status tl_allowed_names_add_configuration(tl_allowed_names *allowed, const char *text, tl_error *error);

bool tl_allowed_names_have(const tl_allowed_names *allowed, tl_change_named kind, const char *name);

void tl_allowed_names_free(tl_allowed_names *allowed);

#endif
