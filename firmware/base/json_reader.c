/* Members of cJSON's tree: see json_reader.h. */
#include "firmware/base/json_reader.h"

#include <cjson/cJSON.h>

#include "firmware/base/json_text.h"
#include "master/base/arena.h"

static const double LIMIT = 9e15; /* below 2^53: each is exact */

tl_json_reader tl_json_reader_of(const char *text, size_t size) {
    tl_json_reader reader = {NULL, false};
    tl_json_lines lines;
    tl_arena scratch;
    tl_error ignored;
    tl_arena_init(&scratch);
    if (tl_json_text_check(text, size, &scratch, &lines, &ignored) == TL_OK) {
        reader.root = cJSON_ParseWithLength(text, size);
        reader.right = cJSON_IsObject(reader.root) != 0;
    }
    tl_arena_release(&scratch);
    return reader;
}

bool tl_json_has(const tl_json_reader *reader, const char *key) {
    return cJSON_GetObjectItemCaseSensitive(reader->root, key) != NULL;
}

uint64_t tl_json_count(tl_json_reader *reader, const char *key) {
    const cJSON *item = cJSON_GetObjectItemCaseSensitive(reader->root, key);
    if (cJSON_IsNumber(item) && item->valuedouble >= 0.0 && item->valuedouble < LIMIT) {
        return (uint64_t)item->valuedouble;
    }
    reader->right = false;
    return 0;
}

double tl_json_number(tl_json_reader *reader, const char *key) {
    const cJSON *item = cJSON_GetObjectItemCaseSensitive(reader->root, key);
    reader->right = reader->right && cJSON_IsNumber(item) != 0;
    return cJSON_IsNumber(item) ? item->valuedouble : 0.0;
}

bool tl_json_truth(tl_json_reader *reader, const char *key) {
    const cJSON *item = cJSON_GetObjectItemCaseSensitive(reader->root, key);
    reader->right = reader->right && cJSON_IsBool(item) != 0;
    return cJSON_IsTrue(item) != 0;
}

const char *tl_json_text(tl_json_reader *reader, const char *key) {
    const cJSON *item = cJSON_GetObjectItemCaseSensitive(reader->root, key);
    if (cJSON_IsString(item)) {
        return item->valuestring;
    }
    reader->right = false;
    return "";
}

void tl_json_reader_free(tl_json_reader *reader) {
    cJSON_Delete(reader->root);
    *reader = (tl_json_reader){NULL, false};
}
