/* The differences of two texts, each with what it needs. */
#include "firmware/config/config_change.h"

#include <stdbool.h>
#include <stdio.h>
#include <string.h>

typedef struct collection {
    tl_config_change *change;
    const tl_allowed_names *allowed;
    tl_config_edit edit; /* the last one: what is within it is still to come */
    bool has_edit;
} collection;

static void raise_needs(tl_change_needs *needs, tl_change_needs other) {
    needs->kind = other.kind > needs->kind ? other.kind : needs->kind;
    needs->right = other.right > needs->right ? other.right : needs->right;
}

static bool is_worse(tl_change_needs needs, tl_change_needs other) {
    return needs.kind != other.kind ? needs.kind > other.kind : needs.right > other.right;
}

/* The place of the last one that needs least. */
static size_t find_mildest(const tl_config_change *change) {
    size_t mildest = 0;
    for (size_t i = 1; i < change->listed; i++) {
        mildest = is_worse(change->edits[i].needs, change->edits[mildest].needs) ? mildest : i;
    }
    return mildest;
}

static void list(tl_config_change *change, const tl_config_edit *edit) {
    change->count++;
    if (change->listed == TL_CONFIG_EDITS) {
        size_t at = find_mildest(change);
        if (!is_worse(edit->needs, change->edits[at].needs)) {
            return;
        }
        change->listed--;
        memmove(&change->edits[at], &change->edits[at + 1], (change->listed - at) * sizeof change->edits[at]);
    }
    change->edits[change->listed++] = *edit;
}

static void list_last(collection *c) {
    if (c->has_edit) {
        list(c->change, &c->edit);
    }
    c->has_edit = false;
}

static void bar(tl_config_change *change, const tl_json_difference *difference, tl_change_named names) {
    size_t number = change->barred++;
    if (number < TL_CONFIG_BARRED) {
        tl_config_barred *barred = &change->bar[number];
        const tl_json_value *after = &difference->after;
        *barred = (tl_config_barred){.names = names};
        barred->is_installed = names == TL_NAMES_FMU && after->type == TL_JSON_TEXT && strchr(after->text, '/') == NULL;
        tl_json_way_path(barred->path, difference->way, difference->depth);
        tl_json_show(after, barred->found, sizeof barred->found);
    }
}

static tl_change_needs needs_of(collection *c, const tl_json_difference *difference) {
    tl_change_needs needs = tl_change_needs_of(difference);
    if (needs.right != TL_CHANGE_ON_THE_BOX) {
        return needs;
    }
    bool is_allowed = needs.names != TL_NAMES_NOTHING && difference->after.type == TL_JSON_TEXT &&
                      tl_allowed_names_have(c->allowed, needs.names, difference->after.text);
    if (is_allowed) {
        needs.right = TL_CHANGE_BY_COMMISSION;
    } else {
        bar(c->change, difference, needs.names);
    }
    return needs;
}

static void collect(const tl_json_difference *difference, void *context) {
    collection *c = context;
    tl_change_needs needs = needs_of(c, difference);
    if (needs.kind == TL_CHANGE_NONE) {
        return;
    }
    raise_needs(&c->change->needs, needs);
    if (difference->within) {
        raise_needs(&c->edit.needs, needs);
        return;
    }
    list_last(c);
    c->has_edit = true;
    c->edit.needs = needs;
    tl_json_way_path(c->edit.path, difference->way, difference->depth);
    if (difference->is_order) {
        (void)snprintf(c->edit.before, sizeof c->edit.before, "entries");
        (void)snprintf(c->edit.after, sizeof c->edit.after, "entries in another order");
    } else {
        tl_json_show(&difference->before, c->edit.before, sizeof c->edit.before);
        tl_json_show(&difference->after, c->edit.after, sizeof c->edit.after);
    }
}

tl_status tl_config_change_find(const char *in_force, size_t in_force_size, const char *candidate,
                                size_t candidate_size, const tl_allowed_names *allowed, tl_config_change *change,
                                tl_error *error) {
    collection c = {.change = change, .allowed = allowed};
    tl_json_source before = {in_force, in_force_size, "the configuration in force"};
    tl_json_source after = {candidate, candidate_size, "the new configuration"};
    *change = (tl_config_change){.count = 0};
    tl_status status = tl_json_compare(&before, &after, collect, &c, error);
    if (status == TL_OK) {
        list_last(&c);
    } else {
        *change = (tl_config_change){.count = 0};
    }
    return status;
}

void tl_config_edit_write(const tl_config_edit *edit, char text[TL_CONFIG_EDIT_TEXT]) {
    char what[3 * TL_CONFIG_EDIT_SHOWN];
    if (edit->before[0] == '\0') {
        (void)snprintf(what, sizeof what, "%s is added", edit->after);
    } else if (edit->after[0] == '\0') {
        (void)snprintf(what, sizeof what, "%s is removed", edit->before);
    } else {
        (void)snprintf(what, sizeof what, "%s → %s", edit->before, edit->after);
    }
    (void)snprintf(text, TL_CONFIG_EDIT_TEXT, "%s: %s (%s%s)", edit->path[0] != '\0' ? edit->path : "all of it", what,
                   tl_change_kind_name(edit->needs.kind),
                   edit->needs.right == TL_CHANGE_ON_THE_BOX      ? ", on the box only"
                   : edit->needs.right == TL_CHANGE_BY_COMMISSION ? ", needs the right to commission"
                                                                  : "");
}
