/* JSON document: parsing with lines, paths of values: see json_document.h. */
#include "firmware/config/json_document.h"

#include <assert.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* ---- iteration ---- */

cJSON *tl_json_walk_next(tl_json_walk *walk, cJSON *item) {
    if (item->child != NULL && walk->depth < TL_JSON_MAX_DEPTH) {
        walk->around[walk->depth++] = item;
        return item->child;
    }
    while (walk->depth > 0 && item->next == NULL) {
        item = walk->around[--walk->depth];
    }
    return walk->depth > 0 ? item->next : NULL;
}

/* ---- writing paths ---- */

void tl_json_member_path(char *path, const char *parent, const char *key) {
    char joined[TL_JSON_PATH + 1]; /* one more than fits, to detect a cut */
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

void tl_json_steps_path(char *path, const tl_json_step *way, size_t depth) {
    path[0] = '\0';
    for (size_t i = 0; i < depth; i++) {
        if (way[i].key != NULL) {
            tl_json_member_path(path, path, way[i].key);
        } else {
            tl_json_element_path(path, path, way[i].index);
        }
    }
}

/* ---- parsing and search ---- */

/* ---- paths ---- */

size_t tl_json_line(const cJSON *item) {
    return (size_t)item->valueint;
}

/* Returns the member whose key begins `path`; *length is the length of the key. */
static const cJSON *member_at(const cJSON *object, const char *path, size_t *length) {
    const cJSON *best = NULL;
    const cJSON *child = NULL;
    cJSON_ArrayForEach(child, object) {
        size_t size = strlen(child->string);
        if ((best == NULL || size > *length) && strncmp(path, child->string, size) == 0 &&
            strchr(".[", path[size]) != NULL) { /* also matches the end of the path */
            best = child;
            *length = size;
        }
    }
    return best;
}

static const cJSON *element_at(const cJSON *array, const char *path, size_t *length) {
    char *end = NULL;
    if (path[0] != '[') {
        return NULL;
    }
    long index = strtol(path + 1, &end, 10);
    if (end == path + 1 || *end != ']' || index < 0 || index > INT32_MAX) {
        return NULL;
    }
    *length = (size_t)(end + 1 - path);
    return cJSON_GetArrayItem(array, (int)index);
}

const cJSON *tl_json_nearest(const cJSON *root, const char *path) {
    const cJSON *item = root;
    while (item != NULL && *path != '\0') {
        size_t length = 0;
        const cJSON *inner = NULL;
        if (cJSON_IsObject(item)) {
            inner = member_at(item, path, &length);
        } else if (cJSON_IsArray(item)) {
            inner = element_at(item, path, &length);
        }
        if (inner == NULL) {
            return item == root ? NULL : item;
        }
        item = inner;
        path += length;
        path += *path == '.' ? 1 : 0;
    }
    return item;
}

/* ---- duplicate keys ---- */

static int by_key_then_position(const void *left, const void *right) {
    const cJSON *a = *(cJSON *const *)left;
    const cJSON *b = *(cJSON *const *)right;
    int order = strcmp(a->string, b->string);
    return order != 0 ? order : (a->valueint > b->valueint) - (a->valueint < b->valueint);
}

cJSON **tl_json_sorted(const cJSON *object, size_t *count) {
    cJSON **members = calloc((size_t)cJSON_GetArraySize(object) + 1, sizeof *members);
    cJSON *member = NULL;
    *count = 0;
    if (members != NULL) {
        cJSON_ArrayForEach(member, object) {
            members[(*count)++] = member;
        }
        qsort(members, *count, sizeof *members, by_key_then_position);
    }
    return members;
}

static void report_duplicate(const cJSON *first, const cJSON *second, tl_report *report) {
    char key[TL_JSON_SHOWN];
    tl_text_for_people(second->string, key, sizeof key);
    tl_report_add(report, TL_BAD_DATA, "",
                  "line %zu: found the key \"%s\" again, expected it once; the first is on line %zu",
                  tl_json_line(second), key, tl_json_line(first));
}

/* Reports keys that appear twice. Returns false if memory is out. */
static bool check_keys(const cJSON *object, tl_report *report) {
    size_t count = 0;
    size_t first = 0;
    cJSON **keys = tl_json_sorted(object, &count);
    if (keys == NULL) {
        return false;
    }
    for (size_t i = 1; i < count; i++) {
        if (strcmp(keys[i]->string, keys[first]->string) != 0) {
            first = i;
        } else {
            report_duplicate(keys[first], keys[i], report);
        }
    }
    free((void *)keys);
    return true;
}

static bool check_all_keys(cJSON *root, tl_report *report) {
    tl_json_walk w = {.depth = 0};
    for (cJSON *item = root; item != NULL; item = tl_json_walk_next(&w, item)) {
        if (cJSON_IsObject(item) && !check_keys(item, report)) {
            return false;
        }
    }
    return true;
}

/* ---- the document ---- */

tl_status tl_json_parse(const char *text, size_t size, tl_arena *scratch, tl_report *report, cJSON **root) {
    tl_json_lines lines;
    tl_error error;
    size_t before = report->count;
    *root = NULL;
    tl_status status = tl_json_text_check(text, size, scratch, &lines, &error);
    if (status != TL_OK) {
        tl_report_add(report, status, "", "%s", error.text);
        return status;
    }
    cJSON *tree = cJSON_ParseWithLength(text, size);
    tl_json_walk walk = {.depth = 0};
    size_t i = 0;
    for (cJSON *item = tree; item != NULL; item = tl_json_walk_next(&walk, item)) {
        assert(i < lines.count);
        item->valueint = (int)lines.line[i++];
    }
    if (tree == NULL || !check_all_keys(tree, report)) {
        cJSON_Delete(tree);
        tl_report_add(report, TL_TRY_AGAIN, "", "not enough memory to read %zu bytes of JSON", size);
        return TL_TRY_AGAIN;
    }
    *root = tree;
    return report->count == before ? TL_OK : TL_BAD_DATA;
}

/* ---- merge patch ---- */

/* The member that the patch changes recursively; an item of another type is replaced by an empty
 * object. NULL: memory is out. */
static cJSON *find_merged(cJSON *target, const char *key) {
    cJSON *member = cJSON_GetObjectItemCaseSensitive(target, key);
    if (member != NULL && cJSON_IsObject(member)) {
        return member;
    }
    cJSON_DeleteItemFromObjectCaseSensitive(target, key);
    return cJSON_AddObjectToObject(target, key);
}

/* Removes a member, or replaces it by a copy of the item. */
static bool replace_member(cJSON *target, const cJSON *item) {
    cJSON_DeleteItemFromObjectCaseSensitive(target, item->string);
    return cJSON_IsNull(item) || cJSON_AddItemToObject(target, item->string, cJSON_Duplicate(item, 1)) != 0;
}

bool tl_json_merge(cJSON *target, const cJSON *patch) {
    struct {
        cJSON *target;
        const cJSON *item;
    } levels[TL_JSON_MAX_DEPTH]; /* objects around, outermost first, with their next item */
    size_t depth = 1;
    levels[0].target = target;
    levels[0].item = patch->child;
    while (depth > 0) {
        const cJSON *item = levels[depth - 1].item;
        cJSON *around = levels[depth - 1].target;
        if (item == NULL) {
            depth--;
            continue;
        }
        levels[depth - 1].item = item->next;
        if (!cJSON_IsObject(item)) {
            if (!replace_member(around, item)) {
                return false;
            }
        } else {
            cJSON *member = depth < TL_JSON_MAX_DEPTH ? find_merged(around, item->string) : NULL;
            if (member == NULL) {
                return false;
            }
            levels[depth].target = member;
            levels[depth++].item = item->child;
        }
    }
    return true;
}
