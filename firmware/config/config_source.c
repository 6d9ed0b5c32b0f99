/* What sources of every kind have: a period, and a name by which signals call them. */
#include <string.h>

#include "firmware/config/config_parts.h"
#include "firmware/config/config_reader.h"

void tl_config_read_period(tl_config_object *object, tl_config_source *source, const tl_config *config) {
    static const tl_config_number period = {.minimum = 1e-5, .maximum = 3600, .example = "0.1"};
    source->period_s = tl_seconds(config->step);
    (void)tl_config_get_number(object, "period_s", &period, &source->period_s);
}

const cJSON *tl_config_read_source_name(tl_config_object *object, tl_config_need need, const char *what,
                                        const char *const *kinds, tl_config_signal *signal) {
    const char *name = NULL;
    size_t index = 0;
    const cJSON *item = NULL;
    const cJSON *sources = cJSON_GetObjectItemCaseSensitive(object->reader->root, "sources");
    if (!tl_config_get_text(object, "source", need, "\"plc\"", &name) ||
        (sources != NULL && !cJSON_IsObject(sources))) { /* reported where it stands */
        return NULL;
    }
    cJSON_ArrayForEach(item, sources) {
        if (strcmp(item->string, name) == 0) {
            break;
        }
        index++;
    }
    if (item != NULL && tl_config_is_of_kind(item, kinds)) {
        signal->source = index;
        return item;
    }
    char expected[320];
    tl_config_list_names(what, sources, kinds, expected, sizeof expected);
    tl_config_wrong(object, "source", NULL, expected, NULL);
    return NULL;
}
