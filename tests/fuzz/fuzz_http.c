/* Fuzzes an HTTP request: it is refused with a status, or becomes a request that exists.
 *
 * Input:  lines: method, target, Host, If-Match, Content-Length, Content-Encoding,
 *         Transfer-Encoding. An empty line: the header is missing. */
#include <stdlib.h>
#include <string.h>

#include "firmware/base/json.h"
#include "firmware/serve/address.h"
#include "firmware/serve/http_request.h"
#include "tests/fuzz/harness.h"
#include "tests/fuzz/input.h"

enum { LINES = 7 };

/* NULL for an empty line; `text` is cut into them. */
static void cut(char *text, const char *found[LINES]) {
    for (size_t i = 0; i < LINES; i++) {
        char *end = strchr(text, '\n');
        found[i] = text[0] == '\0' || text[0] == '\n' ? NULL : text;
        if (end != NULL) {
            *end = '\0';
            text = end + 1;
        } else {
            text += strlen(text);
        }
    }
}

static bool ends(const char *text, size_t room) {
    return strnlen(text, room) < room;
}

static void check(const tl_http_request *request) {
    const tl_control_request *control = &request->control;
    size_t hash = strnlen(control->if_match, sizeof control->if_match);
    tl_fuzz_hold(request->wants_plants || tl_plain_name(request->plant));
    tl_fuzz_hold(strchr(request->plant, '/') == NULL && request->plant[0] != '.');
    tl_fuzz_hold(control->verb < TL_CONTROL_VERBS && control->flags <= TL_CONTROL_FLAGS);
    tl_fuzz_hold(control->origin == TL_ORIGIN_NETWORK && control->right == 0 && control->who[0] == '\0');
    tl_fuzz_hold(control->require_lock >= -1.0 && control->require_lock <= 100.0);
    tl_fuzz_hold(control->probation_s <= 604800);
    tl_fuzz_hold(hash == 0 || hash == TL_SHA256_TEXT - 1);
    tl_fuzz_hold(ends(control->why, sizeof control->why) && tl_text_is_plain(control->why));
    tl_fuzz_hold(request->body <= TL_CONTROL_MOST);
    tl_fuzz_hold((request->body > 0) == (!request->wants_plants && control->verb == TL_CONTROL_APPLY));
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    static const tl_option_list none;
    const tl_host_names names = {.own = "box", .others = none};
    const char *found[LINES];
    char sentence[TL_HTTP_SENTENCE] = "";
    tl_http_request request;
    char *text = malloc(size + 1);
    if (text == NULL) {
        return 0;
    }
    if (size > 0) {
        memcpy(text, data, size);
    }
    text[size] = '\0';
    cut(text, found);
    const tl_http_words words = {.method = found[0] == NULL ? "GET" : found[0],
                                 .target = found[1] == NULL ? "/" : found[1],
                                 .if_match = found[3],
                                 .content_length = found[4],
                                 .content_encoding = found[5],
                                 .transfer_encoding = found[6]};
    tl_http_status status = tl_http_request_read(&words, &request, sentence);
    if (status == TL_HTTP_OK) {
        check(&request);
    } else {
        tl_fuzz_hold(status >= 400 && status < 600 && sentence[0] != '\0' && ends(sentence, sizeof sentence));
    }
    (void)tl_host_names_know(&names, found[2], "127.0.0.1");
    free(text);
    return 0;
}
