/* Which version is meant, what its text is, and with which text a run begins: see versions.h. */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "firmware/retune/versions_parts.h"

enum { SHORT_HASH = 12 };

/* ---- finding ---- */

static const tl_version *find_number(const tl_versions *versions, const char *what) {
    size_t digits = strspn(what, "0123456789");
    return digits > 0 && digits <= TL_VERSION_DIGITS && what[digits] == '\0'
               ? tl_versions_get(versions, strtoull(what, NULL, 10))
               : NULL;
}

static const tl_version *find_hash(const tl_versions *versions, const char *what, tl_error *error) {
    const tl_version *found = NULL;
    for (size_t i = 0; i < versions->count; i++) {
        const tl_version *version = &versions->list[i];
        if (strncmp(version->hash, what, strlen(what)) != 0) {
            continue;
        }
        if (found != NULL && strcmp(found->hash, version->hash) != 0) {
            (void)tl_fail(error, TL_BAD_DATA,
                          "%s may be version %" PRIu64 " (%.*s) or %" PRIu64 " (%.*s): give more of its digits", what,
                          found->number, (int)SHORT_HASH, found->hash, version->number, (int)SHORT_HASH, version->hash);
            return NULL;
        }
        found = version;
    }
    if (found == NULL) {
        (void)tl_fail(error, TL_BAD_DATA, "no version has a hash that begins with %s", what);
    }
    return found;
}

const tl_version *tl_versions_find(const tl_versions *versions, const char *what, tl_error *error) {
    const tl_version *found = find_number(versions, what);
    size_t length = strlen(what);
    if (found == NULL && length >= TL_VERSION_PREFIX && strspn(what, "0123456789abcdef") == length) {
        return find_hash(versions, what, error);
    }
    if (found == NULL) {
        (void)tl_fail(error, TL_BAD_DATA,
                      "there is no version \"%.70s\": expected its number, or the first %d digits of its hash or more",
                      what, (int)TL_VERSION_PREFIX);
    }
    return found;
}

tl_status tl_versions_read(const tl_versions *versions, uint64_t number, char **text, tl_error *error) {
    tl_error cause;
    const tl_version *version = tl_versions_get(versions, number);
    *text = NULL;
    if (version == NULL) {
        return tl_fail(error, TL_BAD_DATA, "there is no version %" PRIu64, number);
    }
    *text = tl_version_read_text(versions, version->hash, version->size, &cause);
    return *text != NULL ? TL_OK
                         : tl_fail(error, TL_BAD_DATA, "version %" PRIu64 " cannot be read: %s", number, cause.text);
}

tl_status tl_versions_mend(const tl_versions *versions, uint64_t number, const char *text, size_t size,
                           tl_error *error) {
    const tl_version *version = tl_versions_get(versions, number);
    char hash[TL_SHA256_TEXT];
    bool is_made = false;
    tl_sha256(text, size, hash);
    if (version == NULL || version->size != size || strcmp(version->hash, hash) != 0) {
        return tl_fail(error, TL_BAD_DATA, "that is not the text of version %" PRIu64, number);
    }
    return tl_version_write_text(versions, hash, text, size, &is_made, error);
}

/* ---- choosing ---- */

static void say(tl_version_choice *choice, const char *text) {
    size_t length = strlen(choice->say);
    (void)snprintf(choice->say + length, sizeof choice->say - length, "%s%s", length > 0 ? "; " : "", text);
}

static tl_status choose_file(const char *file, size_t size, tl_version_choice *choice, tl_error *error) {
    choice->text = malloc(size + 1);
    if (choice->text == NULL) {
        return tl_fail(error, TL_TRY_AGAIN, "not enough memory for a configuration of %zu bytes", size);
    }
    memcpy(choice->text, file, size);
    choice->text[size] = '\0';
    choice->size = size;
    return TL_OK;
}

/* The file is the active version: whatever it was before, it is taken. Its text on disk may be damaged; here is another one. */
static tl_status choose_same(tl_versions *versions, const char *file, size_t size, tl_version_choice *choice,
                             tl_error *error) {
    bool made = false;
    tl_versions next = *versions;
    const tl_version *active = tl_versions_get(versions, versions->active);
    tl_status status = choose_file(file, size, choice, error);
    choice->number = active->number;
    memcpy(next.taken, active->hash, sizeof next.taken);
    if (status == TL_OK &&
        (tl_version_write_text(versions, active->hash, file, size, &made, error) != TL_OK ||
         (strcmp(versions->taken, next.taken) != 0 && tl_version_put(versions, &next, error) != TL_OK))) {
        say(choice, error->text);
    }
    return status;
}

static bool was_good(const tl_version *version) {
    return version != NULL && (version->result == TL_VERSION_KEPT || version->result == TL_VERSION_ACTIVE);
}

/* Its parent, or else the newest before it that was good; 0: there is none. */
static uint64_t before(const tl_versions *versions, uint64_t number) {
    const tl_version *version = tl_versions_get(versions, number);
    uint64_t best = 0;
    if (version != NULL && was_good(tl_versions_get(versions, version->parent))) {
        return version->parent;
    }
    for (size_t i = 0; i < versions->count && versions->list[i].number < number; i++) {
        best = was_good(&versions->list[i]) ? versions->list[i].number : best;
    }
    return best;
}

/* The active version, or the nearest one before it that can be read. False: there is none. */
static bool choose_version(tl_versions *versions, tl_version_choice *choice) {
    tl_error error;
    uint64_t number = versions->active;
    while (number != 0 && tl_versions_read(versions, number, &choice->text, &error) != TL_OK) {
        say(choice, error.text);
        number = before(versions, number);
    }
    choice->number = number;
    if (number == 0) {
        return false;
    }
    choice->size = (size_t)tl_versions_get(versions, number)->size;
    if (number != versions->active) {
        char text[64];
        (void)snprintf(text, sizeof text, "version %" PRIu64 " runs in its place", number);
        say(choice, text);
        if (tl_versions_activate(versions, number, NULL, &error) != TL_OK) {
            say(choice, error.text);
        }
    }
    return true;
}

/* No version can be read: the file is the first one again. */
static tl_status begin_again(tl_versions *versions, const char *file, size_t size, tl_version_choice *choice,
                             tl_error *error) {
    tl_versions next = *versions;
    tl_error refused;
    next.active = 0;
    next.probation = (tl_version_probation){.version = 0};
    say(choice, "the configuration's file runs in its place");
    if (tl_version_put(versions, &next, &refused) != TL_OK) {
        say(choice, refused.text);
    }
    choice->is_candidate = true;
    return choose_file(file, size, choice, error);
}

tl_status tl_versions_choose(tl_versions *versions, const char *file, size_t size, tl_version_choice *choice,
                             tl_error *error) {
    const tl_version *active = tl_versions_get(versions, versions->active);
    char hash[TL_SHA256_TEXT] = "";
    *choice = (tl_version_choice){.number = 0};
    if (file != NULL) {
        tl_sha256(file, size, hash);
    }
    if (file != NULL && active != NULL && strcmp(hash, active->hash) == 0) {
        return choose_same(versions, file, size, choice, error);
    }
    if (file != NULL && (versions->active == 0 || strcmp(hash, versions->taken) != 0)) {
        choice->is_candidate = true;
        if (versions->active != 0) {
            say(choice, "the configuration's file was changed since it was taken last: it is tried");
        }
        return choose_file(file, size, choice, error);
    }
    if (choose_version(versions, choice)) {
        return TL_OK;
    }
    return file != NULL ? begin_again(versions, file, size, choice, error)
                        : tl_fail(error, TL_BAD_DATA,
                                  "there is no configuration: neither its file nor a version of it can be read");
}
