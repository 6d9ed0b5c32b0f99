/* Fuzzes the comparison of a candidate with the active configuration: the kind of the change, and
 * the right that it needs. Allowed names are those of the active configuration, plus the candidate
 * parsed as a list.
 *
 * Input:  a candidate; or the active configuration and a candidate, with a NUL between them. */
#include <stdlib.h>
#include <string.h>

#include "firmware/config/config_change.h"
#include "tests/fuzz/harness.h"
#include "tests/fuzz/input.h"

static const char usual[] =
    "{\"twinlock\": 1, \"name\": \"motor\", \"step_s\": 0.01, \"components\": {\"motor\": {\"fmu\": \"motor.fmu\"}},\n"
    " \"plant\": {\"torque\": {}, \"omega\": {}}, \"connect\": [[\"plant.torque\", \"motor.M_w\"]],\n"
    " \"synchronise\": {\"adjust\": {\"motor.d\": {\"nominal\": 0.0031, \"step\": 0.12}},\n"
    "  \"match\": {\"motor.omega\": {\"to\": \"plant.omega\", \"tolerance\": 1.0}}}}";

static tl_allowed_names allowed;

/* strndup() of the sanitizer reads a byte too many. */
static char *copy_text(const char *from, size_t size) {
    char *text = malloc(size + 1);
    if (text == NULL) {
        abort();
    }
    memcpy(text, from, size);
    text[size] = '\0';
    return text;
}

static void allow(const char *before, size_t before_size, const char *after, size_t after_size) {
    tl_error error = {TL_OK, ""};
    char *text = copy_text(before, before_size);
    char *list = copy_text(after, after_size);
    (void)tl_allowed_names_add_configuration(&allowed, text, &error);
    (void)tl_allowed_names_add_list(&allowed, list, &error);
    free(text);
    free(list);
}

static tl_status find(const char *before, size_t before_size, const char *after, size_t after_size,
                      tl_config_change *change) {
    tl_error error = {TL_OK, ""};
    tl_status status = tl_config_change_find(before, before_size, after, after_size, &allowed, change, &error);
    tl_fuzz_hold((status == TL_OK) == (error.text[0] == '\0'));
    return status;
}

/* Expects that the whole change needs at least what each edit needs. */
static void check(const tl_config_change *change) {
    tl_fuzz_hold((change->count == 0) == (change->needs.kind == TL_CHANGE_NONE));
    tl_fuzz_hold(change->listed == (change->count < TL_CONFIG_EDITS ? change->count : TL_CONFIG_EDITS));
    tl_change_kind worst = TL_CHANGE_NONE;
    for (size_t i = 0; i < change->listed; i++) {
        const tl_config_edit *edit = &change->edits[i];
        tl_fuzz_hold(edit->needs.kind <= change->needs.kind && edit->needs.right <= change->needs.right);
        tl_fuzz_hold(edit->before[0] != '\0' || edit->after[0] != '\0');
        worst = edit->needs.kind > worst ? edit->needs.kind : worst;
    }
    tl_fuzz_hold(worst == change->needs.kind);
    tl_fuzz_hold((change->privileged_count > 0) == (change->needs.right == TL_RIGHT_BOX));
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    static tl_config_change change;
    const char *after = (const char *)data;
    const char *end = size > 0 ? memchr(data, '\0', size) : NULL;
    const char *before = end != NULL ? after : usual;
    size_t before_size = end != NULL ? (size_t)(end - after) : strlen(usual);
    size_t after_size = end != NULL ? size - before_size - 1 : size;
    after = end != NULL ? end + 1 : after;
    allow(before, before_size, after, after_size);
    if (find(before, before_size, after, after_size, &change) == TL_OK) {
        check(&change);
        size_t count = change.count;
        tl_fuzz_hold(find(after, after_size, before, before_size, &change) == TL_OK && change.count == count);
        check(&change);
        tl_fuzz_hold(find(after, after_size, after, after_size, &change) == TL_OK && change.count == 0);
    }
    tl_allowed_names_free(&allowed);
    return 0;
}
