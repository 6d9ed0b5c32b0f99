/* Names in a configuration: what they may look like, and what they refer to.
 *
 * Names:      of components, signals and sources: [A-Za-z_][A-Za-z0-9_]*, at most 63 characters.
 * References: "component.variable" and "plant.signal". That the component or signal exists is checked here, so that
 *             it is reported with everything else; whether the variable exists, only the FMU can tell (twin.h).
 */
#ifndef TL_FIRMWARE_CONFIG_CONFIG_NAMES_H
#define TL_FIRMWARE_CONFIG_CONFIG_NAMES_H

#include <stdbool.h>
#include <stddef.h>

#include <cjson/cJSON.h>

#include "firmware/config/config_reader.h"

/* Reports the key of an entry where it is no name. */
void tl_config_check_name(const tl_config_object *map, const cJSON *entry, const char *example);

/* Has the entry a member that is called as one of `kinds`, which end with NULL? */
bool tl_config_is_of_kind(const cJSON *entry, const char *const *kinds);

/* "WHAT: one of a, b, c", the keys of a section; where `kinds` are given, of those entries that are of one. Just WHAT
 * where there are none; cut where it does not fit. */
void tl_config_list_names(const char *what, const cJSON *section, const char *const *kinds, char *text, size_t size);

/* What a reference may lead to. */
typedef enum tl_config_target {
    TL_CONFIG_VARIABLE = 1, /* component.variable */
    TL_CONFIG_SIGNAL = 2,   /* plant.signal */
    TL_CONFIG_EITHER = 3
} tl_config_target;

/* Reports `text`, which stands at `path`, where it does not lead to such a thing. Silent where the section it leads to
 * is missing or no object: that was reported already. */
void tl_config_check_reference(const tl_config_reader *reader, const char *path, size_t line, const char *text,
                               tl_config_target target);

#endif
