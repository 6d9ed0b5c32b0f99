/* See json_path.h. */
#include "firmware/config/json_path.h"

#include <stdio.h>

#include "firmware/base/json_text.h"

void tl_json_member_path(char *path, const char *parent, const char *key) {
    char joined[TL_JSON_PATH + 1]; /* one more than fits, so that cutting is seen */
    char shown[TL_JSON_PATH];
    tl_text_for_people(key, shown, sizeof shown);
    (void)snprintf(joined, sizeof joined, "%s%s%s", parent, parent[0] == '\0' ? "" : ".", shown);
    tl_text_for_people(joined, path, TL_JSON_PATH);
}

void tl_json_element_path(char *path, const char *parent, size_t index) {
    char joined[TL_JSON_PATH + 1];
    (void)snprintf(joined, sizeof joined, "%s[%zu]", parent, index);
    tl_text_for_people(joined, path, TL_JSON_PATH);
}

void tl_json_way_path(char *path, const tl_json_step *way, size_t depth) {
    path[0] = '\0';
    for (size_t i = 0; i < depth; i++) {
        if (way[i].key != NULL) {
            tl_json_member_path(path, path, way[i].key);
        } else {
            tl_json_element_path(path, path, way[i].index);
        }
    }
}
