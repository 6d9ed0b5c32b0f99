/* JSON by cJSON's tree: see json_writer.h. */
#include "firmware/base/json_writer.h"

#include <assert.h>
#include <limits.h>
#include <string.h>

#include <cjson/cJSON.h>

void tl_json_writer_begin(tl_json_writer *writer) {
    *writer = (tl_json_writer){.open = {cJSON_CreateObject()}, .depth = 1};
    writer->failed = writer->open[0] == NULL;
}

/* NULL: there was no memory, for it or for its key. */
static cJSON *add(tl_json_writer *writer, const char *key, cJSON *item) {
    cJSON *around = writer->open[writer->depth - 1];
    bool added = item != NULL &&
                 (key == NULL ? cJSON_AddItemToArray(around, item) : cJSON_AddItemToObject(around, key, item)) != 0;
    if (!added) {
        cJSON_Delete(item);
        writer->failed = true;
    }
    return added ? item : NULL;
}

void tl_json_add_null(tl_json_writer *writer, const char *key) {
    (void)add(writer, key, cJSON_CreateNull());
}

void tl_json_add_truth(tl_json_writer *writer, const char *key, bool truth) {
    (void)add(writer, key, cJSON_CreateBool(truth));
}

/* cJSON makes null of what is not finite. */
void tl_json_add_number(tl_json_writer *writer, const char *key, double number) {
    (void)add(writer, key, cJSON_CreateNumber(number));
}

void tl_json_add_count(tl_json_writer *writer, const char *key, uint64_t count) {
    tl_json_add_number(writer, key, (double)count);
}

void tl_json_add_text(tl_json_writer *writer, const char *key, const char *text) {
    (void)add(writer, key, text == NULL ? cJSON_CreateNull() : cJSON_CreateString(text));
}

static void open_item(tl_json_writer *writer, const char *key, cJSON *item) {
    assert(writer->depth < TL_JSON_WRITER_DEPTH);
    writer->open[writer->depth] = add(writer, key, item);
    writer->depth++;
}

void tl_json_open_object(tl_json_writer *writer, const char *key) {
    open_item(writer, key, cJSON_CreateObject());
}

void tl_json_open_array(tl_json_writer *writer, const char *key) {
    open_item(writer, key, cJSON_CreateArray());
}

void tl_json_close(tl_json_writer *writer) {
    assert(writer->depth > 1);
    writer->depth--;
}

tl_status tl_json_writer_print(const tl_json_writer *writer, FILE *file, tl_error *error) {
    char *text = writer->failed ? NULL : cJSON_Print(writer->open[0]);
    if (text == NULL) {
        return tl_fail(error, TL_TRY_AGAIN, "out of memory");
    }
    (void)fprintf(file, "%s\n", text);
    cJSON_free(text);
    return TL_OK;
}

/* cJSON wants some bytes more than it writes. */
size_t tl_json_writer_line(const tl_json_writer *writer, char *line, size_t room) {
    bool fits = !writer->failed && room <= INT_MAX && cJSON_PrintPreallocated(writer->open[0], line, (int)room, 0) != 0;
    return fits ? strlen(line) : 0;
}

void tl_json_writer_free(tl_json_writer *writer) {
    cJSON_Delete(writer->open[0]);
    *writer = (tl_json_writer){.depth = 0};
}
