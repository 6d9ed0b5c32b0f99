/* HTTP request: see http_request.h. */
#include "firmware/serve/http_request.h"

#include <ctype.h>
#include <errno.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "firmware/base/json.h"
#include "firmware/retune/control.h"
#include "firmware/serve/address.h"

/* ---- Query of a request: "check=1&why=a%20seal".
 *
 * Thread: pure.
 */

/* ---- keys ---- */

enum { LONGEST_NAME = 16, LONGEST_VALUE = TL_CONTROL_WHY };

#define MOST_VERSION (UINT64_C(1) << 53)
static const double MOST_PERCENT = 100;

/* One "name=value", decoded. */
typedef struct query_pair {
    char name[LONGEST_NAME];
    char value[LONGEST_VALUE];
} query_pair;

/* ---- values ---- */

typedef enum key_kind { FLAG, SECONDS, PERCENT, WHY, VERSION } key_kind;

typedef struct query_key {
    const char *name;
    key_kind kind;
    uint32_t flag; /* FLAG: bit in the request's flags */
    size_t offset; /* SECONDS: position of a uint32_t in the request */
    uint64_t most; /* SECONDS, VERSION: maximum */
    const char *expected;
} query_key;

static const query_key KEYS[] = {
    {"check", FLAG, .flag = TL_CONTROL_ONLY_CHECK, .expected = "0 or 1"},
    {"restart", FLAG, .flag = TL_CONTROL_MAY_RESTART, .expected = "0 or 1"},
    {"confirm", FLAG, .flag = TL_CONTROL_MUST_CONFIRM, .expected = "0 or 1"},
    {"wait", FLAG, .flag = TL_CONTROL_WAIT, .expected = "0 or 1"},
    {"accept_worse", FLAG, .flag = TL_CONTROL_ACCEPT_WORSE, .expected = "0 or 1"},
    {"probation", SECONDS, .offset = offsetof(tl_control_request, probation_s), .most = 604800,
     .expected = "whole seconds from 1 to 604800"},
    {"shadow", SECONDS, .offset = offsetof(tl_control_request, shadow_s), .most = 3600,
     .expected = "whole seconds from 1 to 3600"},
    {"require_lock", PERCENT, .expected = "a percentage from 0 to 100"},
    {"why", WHY, .expected = "plain text of at most 255 bytes"},
    {"version", VERSION, .most = MOST_VERSION, .expected = "a whole number from 1 on"},
};

static bool read_number(const char *value, uint64_t most, uint64_t *number) {
    size_t digits = strspn(value, "0123456789");
    errno = 0;
    *number = strtoull(value, NULL, 10);
    return digits > 0 && value[digits] == '\0' && errno == 0 && *number >= 1 && *number <= most;
}

static bool read_percent(const char *value, double *percent) {
    char *end = NULL;
    *percent = strtod(value, &end);
    bool is_plain = value[0] != '\0' && value[strspn(value, "0123456789.")] == '\0' && *end == '\0';
    return is_plain && *percent <= MOST_PERCENT;
}

static bool set_value(const query_key *key, const char *value, tl_control_request *control) {
    bool is_good = false;
    uint64_t number = 0;
    switch (key->kind) {
    case FLAG:
        control->flags |= strcmp(value, "1") == 0 ? key->flag : 0U;
        return strcmp(value, "1") == 0 || strcmp(value, "0") == 0;
    case SECONDS:
        is_good = read_number(value, key->most, &number);
        *(uint32_t *)((char *)control + key->offset) = (uint32_t)number;
        return is_good;
    case PERCENT:
        return read_percent(value, &control->require_lock);
    case WHY:
        (void)snprintf(control->why, sizeof control->why, "%s", value);
        return tl_text_is_plain(value);
    case VERSION:
        return read_number(value, key->most, &control->version);
    }
    return false;
}

/* ---- decoding ---- */

/* Decodes "%C3%A9+x" up to `end`. Returns false if it is not well formed, contains a NUL, or does
 * not fit. */
static bool decode(const char *from, const char *end, char *to, size_t room) {
    size_t used = 0;
    while (from < end && used + 1 < room) {
        char letter = *from == '+' ? ' ' : *from;
        if (letter == '%') {
            if (end - from <= 2 || isxdigit((unsigned char)from[1]) == 0 || isxdigit((unsigned char)from[2]) == 0) {
                return false;
            }
            const char digits[] = {from[1], from[2], '\0'};
            letter = (char)strtoul(digits, NULL, 16);
            from += 2;
        }
        if (letter == '\0') {
            return false;
        }
        to[used] = letter;
        used++;
        from++;
    }
    to[used] = '\0';
    return from == end;
}

static bool read_pair(const char *from, const char *end, query_pair *read) {
    const char *middle = memchr(from, '=', (size_t)(end - from));
    return middle != NULL && decode(from, middle, read->name, sizeof read->name) &&
           decode(middle + 1, end, read->value, sizeof read->value);
}

/* ---- whole query ---- */

/* Returns true if `word` is one of a list that is separated by blanks. */
static bool is_among(const char *word, const char *list) {
    size_t length = strlen(word);
    for (const char *found = strstr(list, word); found != NULL && length > 0; found = strstr(found + 1, word)) {
        bool begins = found == list || found[-1] == ' ';
        if (begins && (found[length] == ' ' || found[length] == '\0')) {
            return true;
        }
    }
    return false;
}

static bool take_pair(const query_pair *read, const char *allowed, tl_control_request *control, char *sentence) {
    for (size_t i = 0; i < sizeof KEYS / sizeof KEYS[0] && is_among(read->name, allowed); i++) {
        if (strcmp(read->name, KEYS[i].name) != 0) {
            continue;
        }
        bool is_set = set_value(&KEYS[i], read->value, control);
        if (!is_set) {
            (void)snprintf(sentence, TL_HTTP_SENTENCE, "%s: found \"%.40s\", expected %s", KEYS[i].name, read->value,
                           KEYS[i].expected);
        }
        return is_set;
    }
    (void)snprintf(sentence, TL_HTTP_SENTENCE, "query: unknown key \"%s\" (expected %s)", read->name,
                   allowed[0] != '\0' ? allowed : "none");
    return false;
}

/* Sets the values of a query in `control`: check, restart, confirm, wait, accept_worse (each 0 or
 * 1), probation, shadow, require_lock, why, version. `allowed`: the keys of this address, for
 * example "check wait why". Returns false and sets `sentence` if the query is invalid. */
static bool read_query(const char *query, const char *allowed, tl_control_request *control, char *sentence) {
    query_pair read;
    for (const char *from = query; *from != '\0';) {
        const char *end = from + strcspn(from, "&");
        if (!read_pair(from, end, &read)) {
            (void)snprintf(sentence, TL_HTTP_SENTENCE,
                           "query: expected name=value&name=value, with values of at most 255 bytes");
            return false;
        }
        if (!take_pair(&read, allowed, control, sentence)) {
            return false;
        }
        from = *end == '&' ? end + 1 : end;
    }
    return true;
}

/* ---- http request ---- */

static const char ROOT[] = "/api/v1/plants";

/* The addresses below /api/v1/plants/NAME. The first row is also used for /api/v1/plants. */
typedef struct route {
    const char *path; /* after the name; a number follows if it ends in "/" */
    const char *method;
    const char *query; /* allowed keys */
    tl_control_verb verb;
    bool is_change;
    bool has_body;
} route;

static const route ROUTES[] = {
    {"", "GET", "", TL_CONTROL_SHOW, false, false},
    {"/configuration", "GET", "", TL_CONTROL_READ, false, false},
    {"/configuration", "PUT", "check restart confirm wait accept_worse probation shadow require_lock why",
     TL_CONTROL_APPLY, true, true},
    {"/versions", "GET", "", TL_CONTROL_VERSIONS, false, false},
    {"/versions/", "GET", "", TL_CONTROL_READ, false, false},
    {"/confirm", "POST", "why", TL_CONTROL_CONFIRM, true, false},
    {"/return", "POST", "version restart wait accept_worse probation shadow require_lock why", TL_CONTROL_ROLL_BACK,
     true, false},
    {"/change", "DELETE", "why wait", TL_CONTROL_ROLL_BACK, true, false},
};

static tl_http_status refuse(char *sentence, tl_http_status status, const char *why) {
    (void)snprintf(sentence, TL_HTTP_SENTENCE, "%s", why);
    return status;
}

/* ---- the address ---- */

/* "/motor/versions/3" -> "motor" and "/versions/3". */
static bool split_name(const char *path, tl_http_request *request, const char **rest) {
    size_t length = strcspn(path + 1, "/");
    if (path[0] != '/' || length >= sizeof request->plant) {
        return false;
    }
    memcpy(request->plant, path + 1, length);
    request->plant[length] = '\0';
    *rest = path + 1 + length;
    return tl_plain_name(request->plant);
}

/* Reads the number if the route ends in one. */
static bool fits(const route *one, const char *path, uint64_t *version) {
    size_t length = strlen(one->path);
    if (length == 0 || one->path[length - 1] != '/') {
        return strcmp(path, one->path) == 0;
    }
    return strncmp(path, one->path, length) == 0 && read_number(path + length, MOST_VERSION, version);
}

static tl_http_status find_route(const char *path, const char *method, tl_http_request *request, const route **found,
                                 char *sentence) {
    const char *rest = "";
    bool is_there = false;
    request->wants_plants = path[0] == '\0' || strcmp(path, "/") == 0;
    if (!request->wants_plants && !split_name(path, request, &rest)) {
        return refuse(sentence, TL_HTTP_NOT_FOUND, "not found: the name of a plant has letters, digits, - _ and .");
    }
    for (size_t i = 0; i < sizeof ROUTES / sizeof ROUTES[0]; i++) {
        if (!fits(&ROUTES[i], rest, &request->control.version)) {
            continue;
        }
        is_there = true;
        if (strcmp(method, ROUTES[i].method) == 0) {
            *found = &ROUTES[i];
            return TL_HTTP_OK;
        }
    }
    return is_there ? refuse(sentence, TL_HTTP_WRONG_METHOD, "this address does not have this method")
                    : refuse(sentence, TL_HTTP_NOT_FOUND,
                             "not found: a plant has configuration, versions, change, confirm and return");
}

/* ---- headers ---- */

/* Parses a strong entity tag, which is a SHA-256 in quotes; * for any active configuration. */
static tl_http_status read_match(const char *value, tl_control_request *control, char *sentence) {
    if (value == NULL) {
        return refuse(sentence, TL_HTTP_MATCH_REQUIRED,
                      "If-Match is missing: send the ETag of the configuration that you have changed, or *");
    }
    if (strcmp(value, "*") == 0) {
        return TL_HTTP_OK;
    }
    size_t length = strlen(value);
    if (length != TL_SHA256_TEXT + 1 || value[0] != '"' || value[length - 1] != '"' ||
        strspn(value + 1, "0123456789abcdef") != TL_SHA256_TEXT - 1) {
        return refuse(sentence, TL_HTTP_CHANGED, "If-Match: expected the ETag of a configuration, or *");
    }
    memcpy(control->if_match, value + 1, TL_SHA256_TEXT - 1);
    return TL_HTTP_OK;
}

static tl_http_status read_length(const tl_http_words *words, size_t *length, char *sentence) {
    const char *value = words->content_length;
    *length = 0;
    if (words->transfer_encoding != NULL || words->content_encoding != NULL) {
        return refuse(sentence, TL_HTTP_LENGTH_REQUIRED,
                      "send the body without Transfer-Encoding and Content-Encoding, and with Content-Length");
    }
    if (value == NULL) {
        return TL_HTTP_OK;
    }
    size_t digits = strspn(value, "0123456789");
    if (digits == 0 || value[digits] != '\0') {
        return refuse(sentence, TL_HTTP_BAD_REQUEST, "Content-Length: expected a number");
    }
    uint64_t bytes = digits > 9 ? UINT64_MAX : strtoull(value, NULL, 10);
    if (bytes > TL_CONTROL_MOST) {
        return refuse(sentence, TL_HTTP_TOO_LARGE, "the body is too large: a configuration has at most 262144 bytes");
    }
    *length = (size_t)bytes;
    return TL_HTTP_OK;
}

static tl_http_status read_body(const tl_http_words *words, const route *found, tl_http_request *request,
                                char *sentence) {
    tl_http_status status = read_length(words, &request->body, sentence);
    if (status != TL_HTTP_OK) {
        return status;
    }
    if (!found->has_body) {
        return request->body == 0 ? TL_HTTP_OK : refuse(sentence, TL_HTTP_BAD_REQUEST, "this address takes no body");
    }
    if (request->body == 0) {
        return words->content_length == NULL
                   ? refuse(sentence, TL_HTTP_LENGTH_REQUIRED, "send a configuration, with its Content-Length")
                   : refuse(sentence, TL_HTTP_BAD_REQUEST, "the configuration is empty");
    }
    return read_match(words->if_match, &request->control, sentence);
}

/* ---- whole request ---- */

static tl_http_status read_routed(const tl_http_words *words, const char *path, const char *query,
                                  tl_http_request *request, char *sentence) {
    const route *found = NULL;
    tl_http_status status = find_route(path, words->method, request, &found, sentence);
    if (status != TL_HTTP_OK) {
        return status;
    }
    request->is_change = found->is_change;
    request->control.verb = found->verb;
    request->control.flags = strcmp(found->method, "DELETE") == 0 ? TL_CONTROL_ONLY_PENDING : 0U;
    return read_query(query, found->query, &request->control, sentence) ? read_body(words, found, request, sentence)
                                                                        : TL_HTTP_BAD_REQUEST;
}

tl_http_status tl_http_request_read(const tl_http_words *words, tl_http_request *request,
                                    char sentence[TL_HTTP_SENTENCE]) {
    char path[TL_HTTP_TARGET];
    size_t length = strlen(words->target);
    *request = (tl_http_request){.control = {.origin = TL_ORIGIN_NETWORK, .require_lock = -1.0}};
    if (length >= sizeof path) {
        return refuse(sentence, TL_HTTP_TARGET_TOO_LONG, "the address is too long: expected less than 1024 bytes");
    }
    memcpy(path, words->target, length + 1);
    char *mark = strchr(path, '?');
    const char *query = mark == NULL ? "" : mark + 1;
    if (mark != NULL) {
        *mark = '\0';
    }
    if (strncmp(path, ROOT, strlen(ROOT)) != 0) {
        return refuse(sentence, TL_HTTP_NOT_FOUND, "not found: the API begins at /api/v1/plants");
    }
    return read_routed(words, path + strlen(ROOT), query, request, sentence);
}
