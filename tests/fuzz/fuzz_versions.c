/* Fuzzes the folder of versions, as a damaged disk or an attacker left it.
 *
 * Input:  active.json, 1.record.json and 2.record.json, with a NUL after each; a missing one is not
 *         written. Their texts are "one" and "two". */
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "firmware/base/log.h"
#include "firmware/retune/versions.h"
#include "tests/fuzz/harness.h"
#include "tests/fuzz/input.h"

static void write_file(const char *name, const void *data, size_t size) {
    char path[PATH_MAX];
    (void)snprintf(path, sizeof path, "%s/versions/%s", tl_fuzz_folder(), name);
    FILE *file = fopen(path, "wb");
    if (file == NULL || fwrite(data, 1, size, file) != size || fclose(file) != 0) {
        exit(1);
    }
}

static void write_text(const char *text) {
    char name[TL_SHA256_TEXT + 8];
    tl_sha256(text, strlen(text), name);
    memcpy(name + TL_SHA256_TEXT - 1, ".json", 6);
    write_file(name, text, strlen(text));
}

static void write_folder(const uint8_t *data, size_t size) {
    static const char *const names[] = {"active.json", "1.record.json", "2.record.json"};
    char path[PATH_MAX];
    (void)snprintf(path, sizeof path, "%s/versions", tl_fuzz_folder());
    (void)mkdir(path, 0700);
    for (size_t i = 0; i < 3; i++) {
        const uint8_t *end = size > 0 ? memchr(data, '\0', size) : NULL;
        size_t part = end != NULL ? (size_t)(end - data) : size;
        if (size > 0) {
            write_file(names[i], data, part);
        } else {
            (void)snprintf(path, sizeof path, "%s/versions/%s", tl_fuzz_folder(), names[i]);
            (void)unlink(path);
        }
        part += end != NULL ? 1 : 0;
        data += part;
        size -= part;
    }
    write_text("one");
    write_text("two");
}

static void open_folder(tl_versions *versions) {
    tl_error error;
    tl_fuzz_hold(tl_versions_open(tl_fuzz_folder(), versions, &error) == TL_OK);
    for (size_t i = 0; i < versions->count; i++) {
        tl_fuzz_hold(versions->list[i].number >= 1 && versions->list[i].number <= 2 && versions->list[i].parent <= 1);
    }
}

/* Expects that a run can choose a configuration, whatever the folder contains. */
static void choose(tl_versions *versions) {
    tl_version_choice choice;
    tl_error error;
    tl_status status = tl_versions_choose(versions, "file", 4, &choice, &error);
    tl_fuzz_hold(status == TL_OK && strlen(choice.text != NULL ? choice.text : "file") == choice.size);
    free(choice.text);
}

/* Adds and activates a version; the caller reads it again. */
static uint64_t add(tl_versions *versions) {
    const tl_version_candidate candidate = {"new", 3, "", "", TL_ORIGIN_NETWORK, TL_RIGHT_RETUNE, TL_CHANGE_NONE};
    const tl_probation_account account = {.terms = {60, 95.0, false}, .left_ms = 60000};
    uint64_t number = 0;
    tl_error error;
    tl_fuzz_hold(tl_versions_add(versions, &candidate, &number, &error) == TL_OK);
    tl_fuzz_hold(tl_versions_activate(versions, number, &account, &error) == TL_OK);
    return number;
}

static void remove_version(uint64_t number) {
    char path[PATH_MAX];
    (void)snprintf(path, sizeof path, "%s/versions/%llu.record.json", tl_fuzz_folder(), (unsigned long long)number);
    (void)unlink(path);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    tl_versions versions;
    tl_log_set_level(TL_LOG_ERROR);
    write_folder(data, size);
    open_folder(&versions);
    choose(&versions);
    uint64_t number = add(&versions);
    tl_versions_close(&versions);
    tl_error error;
    tl_fuzz_hold(tl_versions_open(tl_fuzz_folder(), &versions, &error) == TL_OK && versions.active == number);
    tl_fuzz_hold(tl_versions_get(&versions, number) != NULL);
    tl_versions_close(&versions);
    remove_version(number);
    return 0;
}
