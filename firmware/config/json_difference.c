/* Compares two JSON trees with sorted keys in parallel. */
#include "firmware/config/json_difference.h"

#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "firmware/base/json.h"
#include "firmware/base/text.h"
#include "firmware/config/json_document.h"

/* ---- the documents ---- */

/* cJSON's convention: `prev` of the first item is the last one. */
static void relink_items(cJSON *object, cJSON **items, size_t count) {
    for (size_t i = 0; i < count; i++) {
        items[i]->next = i + 1 < count ? items[i + 1] : NULL;
        items[i]->prev = items[i > 0 ? i - 1 : count - 1];
    }
    object->child = items[0];
}

/* Replaces `valueint`, the line, by the position in the text. */
static bool sort_all_keys(cJSON *root) {
    tl_json_walk walk = {.depth = 0};
    int position = 0;
    for (cJSON *item = root; item != NULL; item = tl_json_walk_next(&walk, item)) {
        item->valueint = position++;
    }
    for (cJSON *item = root; item != NULL; item = tl_json_walk_next(&walk, item)) {
        size_t count = 0;
        cJSON **items = cJSON_IsObject(item) ? tl_json_sorted(item, &count) : NULL;
        if (items != NULL) {
            relink_items(item, items, count);
        } else if (cJSON_IsObject(item)) {
            return false; /* out of memory */
        }
        free((void *)items);
    }
    return true;
}

static tl_status read_sorted(const tl_json_source *source, cJSON **root, tl_error *error) {
    tl_arena scratch;
    tl_report report = {.add = NULL};
    tl_arena_init(&scratch);
    tl_status status = tl_json_parse(source->text, source->size, &scratch, &report, root);
    tl_arena_release(&scratch);
    if (status == TL_BAD_DATA) {
        return tl_fail(error, status, "%s: not valid JSON, or a key occurs twice", source->called);
    }
    return status == TL_OK && sort_all_keys(*root)
               ? TL_OK
               : tl_fail(error, TL_TRY_AGAIN, "%s: not enough memory to compare it", source->called);
}

/* ---- values ---- */

static bool is_container(const cJSON *item) {
    return cJSON_IsObject(item) || cJSON_IsArray(item);
}

static bool have_same_type(const cJSON *a, const cJSON *b) {
    return a != NULL && b != NULL && (a->type & 0xFF) == (b->type & 0xFF);
}

/* Compares two values without the contents of objects and arrays. 0 and −0 differ, because an FMU
 * may distinguish them. */
static bool is_same(const cJSON *a, const cJSON *b) {
    return a == b || (have_same_type(a, b) &&
                      (!cJSON_IsNumber(a) || memcmp(&a->valuedouble, &b->valuedouble, sizeof a->valuedouble) == 0) &&
                      (!cJSON_IsString(a) || strcmp(a->valuestring, b->valuestring) == 0));
}

static bool have_same_key(const cJSON *a, const cJSON *b) {
    return a->string == NULL || b->string == NULL ? a->string == b->string : strcmp(a->string, b->string) == 0;
}

/* Compares two values with all contents. */
static bool are_same(cJSON *a, cJSON *b) {
    tl_json_walk left = {.depth = 0};
    tl_json_walk right = {.depth = 0};
    bool same = is_same(a, b);
    while (same && a != NULL && b != NULL) {
        a = tl_json_walk_next(&left, a);
        b = tl_json_walk_next(&right, b);
        same = left.depth == right.depth && is_same(a, b) && (a == NULL || b == NULL || have_same_key(a, b));
    }
    return same;
}

/* The first item is found by cJSON's convention: see relink_items(). */
bool tl_json_has_sibling(const cJSON *item, const char *key) {
    while (item != NULL && item->prev != NULL && item->prev->next != NULL) {
        item = item->prev;
    }
    while (item != NULL && (item->string == NULL || strcmp(item->string, key) != 0)) {
        item = item->next;
    }
    return item != NULL;
}

/* ---- iteration ---- */

/* Unvisited items of one side: of a pair of objects or arrays, or of one without a counterpart. */
typedef struct side {
    cJSON *item; /* next item */
    size_t index;
    size_t left; /* items left of an array; SIZE_MAX: all */
} side;

typedef struct level {
    side before, after;
    size_t depth; /* number of steps to the object or array */
    bool within;
} level;

enum { LEVELS = TL_JSON_MAX_DEPTH + 2 }; /* one for each depth, and one more if an object replaces an array */

typedef struct comparison {
    level levels[LEVELS];
    size_t count;
    tl_json_step way[TL_JSON_MAX_DEPTH + 1];
    void (*see)(const tl_json_difference *difference, void *context);
    void *context;
    bool out_of_memory;
} comparison;

static side side_of(const cJSON *item) {
    return (side){item != NULL ? item->child : NULL, 0, SIZE_MAX};
}

/* Returns the last item, and counts the items from the present one in `left`. */
static cJSON *find_last(side *s) {
    cJSON *last = s->item;
    s->left = last != NULL ? 1 : 0;
    while (last != NULL && last->next != NULL) {
        last = last->next;
        s->left++;
    }
    return last;
}

/* Skips equal elements at the start and at the end of two arrays. */
static void trim_equal(side *before, side *after) {
    while (before->item != NULL && after->item != NULL && are_same(before->item, after->item)) {
        *before = (side){before->item->next, before->index + 1, SIZE_MAX};
        *after = (side){after->item->next, after->index + 1, SIZE_MAX};
    }
    cJSON *a = find_last(before);
    cJSON *b = find_last(after);
    while (before->left > 0 && after->left > 0 && are_same(a, b)) {
        before->left--;
        after->left--;
        a = a->prev;
        b = b->prev;
    }
}

/* Positions of a key that both objects have. */
typedef struct pair {
    int before, after;
} pair;

static int by_position(const void *left, const void *right) {
    const pair *a = left;
    const pair *b = right;
    return (a->before > b->before) - (a->before < b->before);
}

/* Both objects are sorted by key. */
static bool is_in_order(comparison *c, const cJSON *before, const cJSON *after) {
    pair *pairs = calloc((size_t)cJSON_GetArraySize(before) + 1, sizeof *pairs);
    bool in_order = true;
    size_t count = 0;
    if (pairs == NULL) {
        c->out_of_memory = true;
        return true;
    }
    for (const cJSON *a = before->child, *b = after->child; a != NULL && b != NULL;) {
        int order = strcmp(a->string, b->string);
        if (order == 0) {
            pairs[count++] = (pair){a->valueint, b->valueint};
        }
        a = order <= 0 ? a->next : a;
        b = order >= 0 ? b->next : b;
    }
    qsort(pairs, count, sizeof *pairs, by_position);
    for (size_t i = 1; i < count; i++) {
        in_order = in_order && pairs[i].after > pairs[i - 1].after;
    }
    free(pairs);
    return in_order;
}

static void enter(comparison *c, const cJSON *before, const cJSON *after, size_t depth, bool within) {
    level next = {side_of(before), side_of(after), depth, within};
    if (cJSON_IsArray(before) && cJSON_IsArray(after)) {
        trim_equal(&next.before, &next.after);
    }
    if (c->count < LEVELS && depth <= TL_JSON_MAX_DEPTH) {
        c->levels[c->count++] = next;
    }
}

/* Compares two values at the same path; one may be NULL. */
static void compare_values(comparison *c, const cJSON *before, const cJSON *after, size_t depth, bool within) {
    tl_json_difference difference = {c->way, depth, before, after, within, false};
    if (have_same_type(before, after) && is_container(before)) {
        difference.is_order = cJSON_IsObject(before) && !is_in_order(c, before, after);
        if (difference.is_order) {
            c->see(&difference, c->context);
        }
        enter(c, before, after, depth, within);
    } else if (!is_same(before, after)) {
        c->see(&difference, c->context);
        if (is_container(after)) {
            enter(c, NULL, after, depth, true);
        }
        if (is_container(before)) {
            enter(c, before, NULL, depth, true);
        }
    }
}

static cJSON *first_of(const side *s) {
    return s->left > 0 ? s->item : NULL;
}

static cJSON *take(side *s) {
    cJSON *item = s->item;
    s->item = item->next;
    s->index++;
    s->left -= s->left == SIZE_MAX ? 0 : 1;
    return item;
}

/* Compares the next items of the innermost level. Returns false at its end. */
static bool compare_next(comparison *c) {
    level *l = &c->levels[c->count - 1];
    cJSON *a = first_of(&l->before);
    cJSON *b = first_of(&l->after);
    if (a == NULL && b == NULL) {
        return false;
    }
    int order = a != NULL && b != NULL && a->string != NULL && b->string != NULL ? strcmp(a->string, b->string) : 0;
    bool has_before = a != NULL && (b == NULL || order <= 0);
    bool has_after = b != NULL && (a == NULL || order >= 0);
    c->way[l->depth] = (tl_json_step){has_after ? b->string : a->string, has_after ? l->after.index : l->before.index};
    a = has_before ? take(&l->before) : NULL;
    b = has_after ? take(&l->after) : NULL;
    compare_values(c, a, b, l->depth + 1, l->within);
    return true;
}

tl_status tl_json_compare(const tl_json_source *before, const tl_json_source *after,
                          void (*see)(const tl_json_difference *difference, void *context), void *context,
                          tl_error *error) {
    cJSON *a = NULL;
    cJSON *b = NULL;
    comparison c = {.see = see, .context = context};
    tl_status status = read_sorted(before, &a, error);
    if (status == TL_OK) {
        status = read_sorted(after, &b, error);
    }
    if (status == TL_OK) {
        compare_values(&c, a, b, 0, false);
        while (c.count > 0) {
            c.count -= compare_next(&c) ? 0 : 1;
        }
    }
    if (c.out_of_memory) {
        status = tl_fail(error, TL_TRY_AGAIN, "%s: not enough memory to compare it", after->called);
    }
    cJSON_Delete(a);
    cJSON_Delete(b);
    return status;
}

void tl_json_show(const cJSON *item, char *text, size_t size) {
    char number[32] = "";
    char *printed = NULL;
    if (cJSON_IsNumber(item)) {
        tl_show_exact(item->valuedouble, number, sizeof number); /* cJSON sometimes prints one digit too few */
    } else if (item != NULL) {
        printed = cJSON_PrintUnformatted(item);
    }
    tl_text_for_people(printed != NULL ? printed : number, text, size);
    cJSON_free(printed);
}
