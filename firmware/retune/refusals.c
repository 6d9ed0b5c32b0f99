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

/* ---- reading ---- */

static void understand(tl_json_reader *reader, tl_refused *refusal) {
    const char *hash = tl_json_text(reader, "hash");
    *refusal = (tl_refused){.number = tl_json_count(reader, "number")};
    reader->right = reader->right && strlen(hash) < sizeof refusal->hash;
    show(refusal->hash, sizeof refusal->hash, hash);
    show(refusal->origin, sizeof refusal->origin, tl_json_text(reader, "origin"));
    show(refusal->result, sizeof refusal->result, tl_json_text(reader, "result"));
    show(refusal->who, sizeof refusal->who, tl_json_text(reader, "who"));
    show(refusal->why, sizeof refusal->why, tl_json_text(reader, "why"));
    show(refusal->reason, sizeof refusal->reason, tl_json_text(reader, "reason"));
    show(refusal->at, sizeof refusal->at, tl_json_text(reader, "at"));
}

static int by_number(const void *a, const void *b) {
    const tl_refused *left = a;
    const tl_refused *right = b;
    return left->number < right->number ? -1 : left->number > right->number ? 1 : 0;
}

void tl_refusals_open(tl_refusals *refusals, const tl_versions *versions) {
    *refusals = (tl_refusals){.count = 0};
    (void)snprintf(refusals->folder, sizeof refusals->folder, "%s", versions->folder);
    for (uint64_t i = 0; i < TL_REFUSALS_MOST; i++) {
        char path[PATH_MAX];
        tl_refused *refusal = &refusals->list[refusals->count];
        path_of(refusals, i, path);
        tl_json_reader reader = tl_json_file_read(path);
        understand(&reader, refusal);
        refusals->count += reader.right && refusal->number % TL_REFUSALS_MOST == i ? 1 : 0;
        tl_json_reader_free(&reader);
    }
    qsort(refusals->list, refusals->count, sizeof refusals->list[0], by_number);
}

/* ---- another one ---- */

static tl_status write_down(const tl_refusals *refusals, const tl_refused *refusal, tl_error *error) {
    char path[PATH_MAX];
    tl_json_writer writer;
    tl_json_writer_begin(&writer);
    tl_json_add_count(&writer, "number", refusal->number);
    tl_json_add_text(&writer, "hash", refusal->hash);
    tl_json_add_text(&writer, "origin", refusal->origin);
    tl_json_add_text(&writer, "result", refusal->result);
    tl_json_add_text(&writer, "reason", refusal->reason);
    tl_json_add_text(&writer, "who", refusal->who);
    tl_json_add_text(&writer, "why", refusal->why);
    tl_json_add_text(&writer, "at", refusal->at);
    path_of(refusals, refusal->number, path);
    tl_status status = tl_json_file_write(&writer, path, error);
    tl_json_writer_free(&writer);
    return status;
}

tl_status tl_refusals_add(tl_refusals *refusals, const tl_refused *news, tl_error *error) {
    tl_refused *list = refusals->list;
    tl_refused refusal = *news;
    refusal.number = refusals->count == 0 ? 1 : list[refusals->count - 1].number + 1;
    show(refusal.who, sizeof refusal.who, news->who);
    show(refusal.why, sizeof refusal.why, news->why);
    show(refusal.reason, sizeof refusal.reason, news->reason);
    tl_utc_text(tl_utc_now(), refusal.at);
    if (refusals->count == TL_REFUSALS_MOST) {
        memmove(&list[0], &list[1], (TL_REFUSALS_MOST - 1) * sizeof list[0]);
        refusals->count--;
    }
    list[refusals->count++] = refusal;
    return write_down(refusals, &refusal, error);
}
