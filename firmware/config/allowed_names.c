/* Names that are allowed: see allowed_names.h. */
#include "firmware/config/allowed_names.h"

#include <stdlib.h>
#include <string.h>

#include "firmware/config/json_difference.h"

struct tl_allowed_name {
    tl_change_named kind;
    char *text;
};

static tl_status add(tl_allowed_names *allowed, tl_change_named kind, const char *text, size_t length,
                     tl_error *error) {
    if (allowed->count == allowed->room) {
        size_t room = allowed->room == 0 ? 16 : 2 * allowed->room;
        struct tl_allowed_name *names = realloc(allowed->names, room * sizeof *names);
        if (names == NULL) {
            return tl_fail(error, TL_TRY_AGAIN, "not enough memory for names that are allowed");
        }
        allowed->names = names;
        allowed->room = room;
    }
    struct tl_allowed_name *name = &allowed->names[allowed->count];
    name->kind = kind;
    name->text = strndup(text, length);
    if (name->text == NULL) {
        return tl_fail(error, TL_TRY_AGAIN, "not enough memory for names that are allowed");
    }
    allowed->count++;
    return TL_OK;
}

/* ---- a list ---- */

/* "file NAME": the name, which may have spaces within; NULL: the line is none of this kind. */
static const char *name_behind(const char *line, size_t length, const char *word) {
    size_t letters = strlen(word);
    if (length <= letters || strncmp(line, word, letters) != 0) {
        return NULL;
    }
    size_t blanks = strspn(line + letters, " \t");
    return blanks > 0 && letters + blanks < length ? line + letters + blanks : NULL;
}

static tl_status add_line(tl_allowed_names *allowed, const char *line, size_t length, unsigned number,
                          tl_error *error) {
    static const struct {
        const char *word;
        tl_change_named kind;
    } kinds[] = {{"file", TL_NAMES_FILE}, {"library", TL_NAMES_LIBRARY}};
    while (length > 0 && strchr(" \t\r", line[length - 1]) != NULL) {
        length--;
    }
    if (length == 0 || line[0] == '#') {
        return TL_OK;
    }
    for (size_t i = 0; i < sizeof kinds / sizeof kinds[0]; i++) {
        const char *name = name_behind(line, length, kinds[i].word);
        if (name != NULL) {
            return add(allowed, kinds[i].kind, name, length - (size_t)(name - line), error);
        }
    }
    return tl_fail(error, TL_BAD_DATA, "line %u: found \"%.*s\", expected \"file NAME\" or \"library NAME\"", number,
                   (int)(length < 80 ? length : 80), line);
}

tl_status tl_allowed_names_add_list(tl_allowed_names *allowed, const char *text, tl_error *error) {
    tl_status status = TL_OK;
    const char *line = text;
    for (unsigned number = 1; line[0] != '\0' && status == TL_OK; number++) {
        size_t length = strcspn(line, "\n");
        status = add_line(allowed, line, length, number, error);
        line += length + (line[length] == '\n' ? 1 : 0);
    }
    return status;
}

/* ---- a configuration ---- */

typedef struct name_search {
    tl_allowed_names *allowed;
    tl_status status;
    tl_error error;
} name_search;

static void collect(const tl_json_difference *difference, void *context) {
    name_search *c = context;
    tl_change_needs needs = tl_change_needs_of(difference);
    if (c->status == TL_OK && needs.names != TL_NAMES_NOTHING && difference->after.type == TL_JSON_TEXT) {
        const char *text = difference->after.text;
        c->status = add(c->allowed, needs.names, text, strlen(text), &c->error);
    }
}

tl_status tl_allowed_names_add_configuration(tl_allowed_names *allowed, const char *text, tl_error *error) {
    const tl_json_source nothing = {"{}", strlen("{}"), "nothing"};
    const tl_json_source all = {text, strlen(text), "a configuration"};
    name_search c = {.allowed = allowed, .status = TL_OK};
    tl_status status = tl_json_compare(&nothing, &all, collect, &c, error);
    return status != TL_OK ? status : c.status == TL_OK ? TL_OK : tl_fail(error, c.status, "%s", c.error.text);
}

/* ---- asking ---- */

bool tl_allowed_names_have(const tl_allowed_names *allowed, tl_change_named kind, const char *name) {
    for (size_t i = 0; i < allowed->count; i++) {
        if (allowed->names[i].kind == kind && strcmp(allowed->names[i].text, name) == 0) {
            return true;
        }
    }
    return false;
}

void tl_allowed_names_free(tl_allowed_names *allowed) {
    for (size_t i = 0; i < allowed->count; i++) {
        free(allowed->names[i].text);
    }
    free(allowed->names);
    *allowed = (tl_allowed_names){.count = 0};
}
