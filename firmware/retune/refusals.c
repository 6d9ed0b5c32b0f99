/* Refusals: see refusals.h. */
#include "firmware/retune/refusals.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "firmware/base/json.h"
#include "firmware/retune/versions.h"

static void path_of(const tl_refusals *refusals, uint64_t number, char path[PATH_MAX]) {
    int length =
        snprintf(path, PATH_MAX, "%s/refused-%u.json", refusals->folder, (unsigned)(number % TL_REFUSALS_MOST));
    path[length < PATH_MAX ? length : 0] = '\0';
}

static void show(char *to, size_t room, const char *from) {
    tl_text_for_people(from, to, room);
}

static void show_result(tl_control_version *refusal, const char *result, const char *reason) {
    char text[2 * TL_CONTROL_WHY];
    (void)snprintf(text, sizeof text, "%.16s: %.*s", result, (int)sizeof refusal->result - 24, reason);
    show(refusal->result, sizeof refusal->result, text);
}

/* ---- reading ---- */

static void understand(tl_json_reader *reader, tl_control_version *refusal) {
    const char *hash = tl_json_text(reader, "hash");
    memset(refusal, 0, sizeof *refusal);
    refusal->version = tl_json_count(reader, "number");
    reader->right = reader->right && strlen(hash) < sizeof refusal->hash;
    show(refusal->hash, sizeof refusal->hash, hash);
    show(refusal->origin, sizeof refusal->origin, tl_json_text(reader, "origin"));
    show(refusal->who, sizeof refusal->who, tl_json_text(reader, "who"));
    show(refusal->why, sizeof refusal->why, tl_json_text(reader, "why"));
    show(refusal->at, sizeof refusal->at, tl_json_text(reader, "at"));
    show_result(refusal, tl_json_text(reader, "result"), tl_json_text(reader, "reason"));
}

static int by_number(const void *a, const void *b) {
    const tl_control_version *left = a;
    const tl_control_version *right = b;
    return left->version < right->version ? -1 : left->version > right->version ? 1 : 0;
}

void tl_refusals_open(tl_refusals *refusals, const tl_versions *versions) {
    *refusals = (tl_refusals){.count = 0};
    (void)snprintf(refusals->folder, sizeof refusals->folder, "%s", versions->folder);
    for (uint64_t i = 0; i < TL_REFUSALS_MOST; i++) {
        char path[PATH_MAX];
        tl_json_reader reader;
        tl_control_version *refusal = &refusals->list[refusals->count];
        path_of(refusals, i, path);
        if (tl_version_read_object(path, &reader)) {
            understand(&reader, refusal);
            refusals->count += reader.right && refusal->version % TL_REFUSALS_MOST == i ? 1 : 0;
        }
        tl_json_reader_free(&reader);
    }
    qsort(refusals->list, refusals->count, sizeof refusals->list[0], by_number);
}

/* ---- another one ---- */

static tl_status write_down(const tl_refusals *refusals, const tl_control_version *refusal, const char *result,
                            const char *reason, tl_error *error) {
    char path[PATH_MAX];
    tl_json_writer writer;
    tl_json_writer_begin(&writer);
    tl_json_add_count(&writer, "number", refusal->version);
    tl_json_add_text(&writer, "hash", refusal->hash);
    tl_json_add_text(&writer, "origin", refusal->origin);
    tl_json_add_text(&writer, "result", result);
    tl_json_add_text(&writer, "reason", reason);
    tl_json_add_text(&writer, "who", refusal->who);
    tl_json_add_text(&writer, "why", refusal->why);
    tl_json_add_text(&writer, "at", refusal->at);
    path_of(refusals, refusal->version, path);
    tl_status status = tl_version_write_object(path, &writer, error);
    tl_json_writer_free(&writer);
    return status;
}

tl_status tl_refusals_add(tl_refusals *refusals, const tl_control_request *request, const char *result,
                          const char *reason, tl_error *error) {
    tl_control_version *list = refusals->list;
    tl_control_version refusal;
    char shown[TL_CONTROL_WHY];
    memset(&refusal, 0, sizeof refusal);
    refusal.version = refusals->count == 0 ? 1 : list[refusals->count - 1].version + 1;
    memcpy(refusal.hash, request->hash, sizeof refusal.hash);
    (void)snprintf(refusal.origin, sizeof refusal.origin, "%s", tl_change_origins[request->origin]);
    show(refusal.who, sizeof refusal.who, request->who);
    show(refusal.why, sizeof refusal.why, request->why);
    show(shown, sizeof shown, reason);
    show_result(&refusal, result, shown);
    tl_utc_text(tl_utc_now(), refusal.at);
    if (refusals->count == TL_REFUSALS_MOST) {
        memmove(&list[0], &list[1], (TL_REFUSALS_MOST - 1) * sizeof list[0]);
        refusals->count--;
    }
    list[refusals->count++] = refusal;
    return write_down(refusals, &refusal, result, shown, error);
}
