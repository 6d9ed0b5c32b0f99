/* The way to a box: see push_link.h. */
#include "firmware/push/push_link.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include <curl/curl.h>

#include "firmware/tls/fingerprint.h"

enum { TEXT = 1024, CONNECT_S = 10, ANSWER_S = 120 };

static const char DEFAULT_PORT[] = "8443";
static const char PLANTS[] = "/api/v1/plants";
static const char CERTIFICATE[] = "Cert:";

struct tl_push_link {
    CURL *curl;
    char box[TEXT];   /* "https://box:8443" */
    char plant[TEXT]; /* "/api/v1/plants/motor" */
    char authorisation[TEXT];
    char said[CURL_ERROR_SIZE];
};

/* ---- where to ------------------------------------------------------------------------------------------------------ */

/* A part of the address, or "". */
static void take_part(CURLU *url, CURLUPart part, unsigned flags, char text[TEXT]) {
    char *found = NULL;
    text[0] = '\0';
    if (curl_url_get(url, part, &found, flags) == CURLUE_OK) {
        (void)snprintf(text, TEXT, "%s", found);
    }
    curl_free(found);
}

/* "/motor", "/api/v1/plants/motor". False: neither. */
static bool take_plant(const char *path, char plant[TEXT]) {
    const char *name = strncmp(path, PLANTS, strlen(PLANTS)) == 0 ? path + strlen(PLANTS) : path;
    size_t length = strlen(name);
    bool is_one = length > 1 && strchr(name + 1, '/') == NULL;
    return is_one && snprintf(plant, TEXT, "%s%s", PLANTS, name) < TEXT;
}

static bool take_url(CURLU *url, const char *words, tl_push_link *link) {
    char scheme[TEXT];
    char host[TEXT];
    char port[TEXT];
    char path[TEXT];
    char query[TEXT];
    if (curl_url_set(url, CURLUPART_URL, words, 0) != CURLUE_OK) {
        return false;
    }
    take_part(url, CURLUPART_SCHEME, 0, scheme);
    take_part(url, CURLUPART_HOST, 0, host);
    take_part(url, CURLUPART_PORT, 0, port);
    take_part(url, CURLUPART_PATH, 0, path);
    take_part(url, CURLUPART_QUERY, 0, query);
    int length = snprintf(link->box, sizeof link->box, "https://%s:%s", host, port[0] != '\0' ? port : DEFAULT_PORT);
    return strcmp(scheme, "https") == 0 && query[0] == '\0' && length < TEXT && take_plant(path, link->plant);
}

static tl_push_outcome find_box(const char *words, tl_push_link *link, tl_error *error) {
    CURLU *url = curl_url();
    bool is_one = url != NULL && take_url(url, words, link);
    curl_url_cleanup(url);
    if (!is_one) {
        (void)tl_fail(error, TL_BAD_USAGE,
                      "%.200s: expected the address of a plant, for example https://192.0.2.7:8443/motor", words);
    }
    return is_one ? TL_PUSH_OK : TL_PUSH_WRONG;
}

/* ---- who is there -------------------------------------------------------------------------------------------------- */

/* The certificate that the box has shown, as PEM; NULL: none. */
static const char *shown_by(CURL *curl) {
    struct curl_certinfo *chain = NULL;
    if (curl_easy_getinfo(curl, CURLINFO_CERTINFO, &chain) != CURLE_OK || chain == NULL || chain->num_of_certs < 1) {
        return NULL;
    }
    for (const struct curl_slist *line = chain->certinfo[0]; line != NULL; line = line->next) {
        if (strncmp(line->data, CERTIFICATE, strlen(CERTIFICATE)) == 0) {
            return line->data + strlen(CERTIFICATE);
        }
    }
    return NULL;
}

static tl_push_outcome compare(const char *box, const tl_fingerprint *seen, const char *pin, tl_error *error) {
    if (pin == NULL) {
        (void)tl_fail(
            error, TL_BAD_USAGE,
            "%.100s is not known yet. It shows %s; if `twinlock serve --fingerprint` on the box prints the same, say --pin "
            "'%s'",
            box, seen->pin, seen->pin);
        return TL_PUSH_STRANGER;
    }
    if (!tl_fingerprint_is_one(pin)) {
        (void)tl_fail(error, TL_BAD_USAGE,
                      "--pin %.100s is no pin: expected what `twinlock serve --fingerprint` prints on the box, such as "
                      "sha256//1vn7…= or AB:CD:…",
                      pin);
        return TL_PUSH_WRONG;
    }
    if (!tl_fingerprint_is(seen, pin)) {
        (void)tl_fail(
            error, TL_BAD_USAGE,
            "%.100s is not the box that you mean: it shows %s, and --pin is %.100s. Nothing was sent. Compare with `twinlock "
            "serve --fingerprint` on the box",
            box, seen->pin, pin);
        return TL_PUSH_STRANGER;
    }
    return TL_PUSH_OK;
}

/* What all requests have in common: no certificate of anybody's authority counts, only the pin. */
static void set_up(tl_push_link *link, CURL *curl) {
    (void)curl_easy_setopt(curl, CURLOPT_ERRORBUFFER, link->said);
    (void)curl_easy_setopt(curl, CURLOPT_NOSIGNAL, 1L);
    (void)curl_easy_setopt(curl, CURLOPT_PROTOCOLS_STR, "https");
    (void)curl_easy_setopt(curl, CURLOPT_SSLVERSION, (long)CURL_SSLVERSION_TLSv1_2);
    (void)curl_easy_setopt(curl, CURLOPT_SSL_VERIFYPEER, 0L);
    (void)curl_easy_setopt(curl, CURLOPT_SSL_VERIFYHOST, 0L);
    (void)curl_easy_setopt(curl, CURLOPT_CONNECTTIMEOUT, (long)CONNECT_S);
    (void)curl_easy_setopt(curl, CURLOPT_TCP_KEEPALIVE, 1L);
    (void)curl_easy_setopt(curl, CURLOPT_USERAGENT, "twinlock-push");
}

static tl_push_outcome meet(tl_push_link *link, tl_fingerprint *seen, tl_error *error) {
    CURL *curl = curl_easy_init();
    tl_push_outcome outcome = TL_PUSH_NOBODY;
    if (curl == NULL) {
        (void)tl_fail(error, TL_TRY_AGAIN, "out of memory");
        return outcome;
    }
    set_up(link, curl);
    (void)curl_easy_setopt(curl, CURLOPT_URL, link->box);
    (void)curl_easy_setopt(curl, CURLOPT_CONNECT_ONLY, 1L);
    (void)curl_easy_setopt(curl, CURLOPT_CERTINFO, 1L);
    CURLcode code = curl_easy_perform(curl);
    const char *pem = code == CURLE_OK ? shown_by(curl) : NULL;
    if (pem == NULL) {
        (void)tl_fail(error, TL_PLANT_DOWN, "%.100s: %s", link->box,
                      link->said[0] != '\0' ? link->said : curl_easy_strerror(code));
    } else if (tl_fingerprint_of(pem, strlen(pem), seen, error) == TL_OK) {
        outcome = TL_PUSH_OK;
    }
    curl_easy_cleanup(curl);
    return outcome;
}

/* ---- beginning and end --------------------------------------------------------------------------------------------- */

static tl_push_outcome open_link(tl_push_link *link, const char *url, const char *pin, tl_error *error) {
    tl_fingerprint seen;
    tl_push_outcome outcome = find_box(url, link, error);
    outcome = outcome == TL_PUSH_OK ? meet(link, &seen, error) : outcome;
    outcome = outcome == TL_PUSH_OK ? compare(link->box, &seen, pin, error) : outcome;
    if (outcome != TL_PUSH_OK) {
        return outcome;
    }
    link->curl = curl_easy_init();
    if (link->curl == NULL || curl_easy_setopt(link->curl, CURLOPT_PINNEDPUBLICKEY, seen.pin) != CURLE_OK) {
        (void)tl_fail(error, TL_TRY_AGAIN, "this libcurl cannot hold a box to its key");
        return TL_PUSH_BROKEN;
    }
    set_up(link, link->curl);
    return TL_PUSH_OK;
}

tl_push_outcome tl_push_link_open(const char *url, const char *pin, const char *token, tl_push_link **link,
                                  tl_error *error) {
    *link = calloc(1, sizeof **link);
    if (*link == NULL || curl_global_init(CURL_GLOBAL_DEFAULT) != CURLE_OK) {
        (void)tl_fail(error, TL_TRY_AGAIN, "out of memory");
        return TL_PUSH_BROKEN;
    }
    (void)snprintf((*link)->authorisation, sizeof(*link)->authorisation, "Authorization: Bearer %s", token);
    return open_link(*link, url, pin, error);
}

void tl_push_link_close(tl_push_link *link) {
    if (link != NULL) {
        curl_easy_cleanup(link->curl);
        curl_global_cleanup();
        explicit_bzero(link->authorisation, sizeof link->authorisation);
    }
    free(link);
}

/* ---- a request ----------------------------------------------------------------------------------------------------- */

/* One request under way. */
typedef struct asking {
    tl_push_link *link;
    tl_push_request *request;
    size_t sent;
} asking;

static size_t take_piece(char *bytes, size_t one, size_t count, void *context) {
    asking *self = context;
    (void)curl_easy_getinfo(self->link->curl, CURLINFO_RESPONSE_CODE, &self->request->status);
    self->request->take(self->request->context, self->request->status, bytes, one * count);
    return one * count;
}

static size_t take_header(char *bytes, size_t one, size_t count, void *context) {
    static const char name[] = "ETag: ";
    asking *self = context;
    size_t size = one * count;
    size_t length = strlen(name);
    if (size > length && strncasecmp(bytes, name, length) == 0) {
        size_t value = size - length;
        while (value > 0 && (bytes[length + value - 1] == '\n' || bytes[length + value - 1] == '\r')) {
            value--;
        }
        (void)snprintf(self->request->tag, sizeof self->request->tag, "%.*s", (int)value, bytes + length);
    }
    return size;
}

static size_t give_piece(char *to, size_t one, size_t count, void *context) {
    asking *self = context;
    size_t left = self->request->size - self->sent;
    size_t now = left < one * count ? left : one * count;
    memcpy(to, self->request->body + self->sent, now);
    self->sent += now;
    return now;
}

static struct curl_slist *list_headers(const tl_push_link *link, const tl_push_request *request) {
    char match[TEXT];
    struct curl_slist *list = curl_slist_append(NULL, link->authorisation);
    struct curl_slist *longer = list == NULL ? NULL : curl_slist_append(list, "Content-Type: application/json");
    if (longer != NULL && request->match != NULL) {
        (void)snprintf(match, sizeof match, "If-Match: %s", request->match);
        longer = curl_slist_append(list, match);
    }
    if (longer == NULL) {
        curl_slist_free_all(list);
    }
    return longer == NULL ? NULL : list;
}

static CURLcode perform(asking *self, const char *url, struct curl_slist *headers) {
    CURL *curl = self->link->curl;
    const tl_push_request *request = self->request;
    self->link->said[0] = '\0';
    (void)curl_easy_setopt(curl, CURLOPT_URL, url);
    (void)curl_easy_setopt(curl, CURLOPT_HTTPGET, 1L);
    if (request->body != NULL) {
        (void)curl_easy_setopt(curl, CURLOPT_UPLOAD, 1L);
        (void)curl_easy_setopt(curl, CURLOPT_INFILESIZE_LARGE, (curl_off_t)request->size);
        (void)curl_easy_setopt(curl, CURLOPT_READFUNCTION, give_piece);
        (void)curl_easy_setopt(curl, CURLOPT_READDATA, self);
    }
    (void)curl_easy_setopt(curl, CURLOPT_CUSTOMREQUEST, request->method);
    (void)curl_easy_setopt(curl, CURLOPT_HTTPHEADER, headers);
    (void)curl_easy_setopt(curl, CURLOPT_WRITEFUNCTION, take_piece);
    (void)curl_easy_setopt(curl, CURLOPT_WRITEDATA, self);
    (void)curl_easy_setopt(curl, CURLOPT_HEADERFUNCTION, take_header);
    (void)curl_easy_setopt(curl, CURLOPT_HEADERDATA, self);
    (void)curl_easy_setopt(curl, CURLOPT_TIMEOUT, request->can_last ? 0L : (long)ANSWER_S);
    return curl_easy_perform(curl);
}

static tl_push_outcome outcome_of(CURLcode code) {
    switch (code) {
    case CURLE_SSL_PINNEDPUBKEYNOTMATCH:
        return TL_PUSH_STRANGER;
    case CURLE_COULDNT_CONNECT:
        return TL_PUSH_NOBODY;
    case CURLE_SEND_ERROR:
    case CURLE_RECV_ERROR:
    case CURLE_GOT_NOTHING:
    case CURLE_PARTIAL_FILE:
        return TL_PUSH_HUNG_UP;
    default:
        return TL_PUSH_BROKEN;
    }
}

tl_push_outcome tl_push_link_ask(tl_push_link *link, tl_push_request *request, tl_error *error) {
    char url[3 * TEXT];
    asking self = {.link = link, .request = request};
    struct curl_slist *headers = list_headers(link, request);
    if (headers == NULL ||
        snprintf(url, sizeof url, "%s%s%s", link->box, link->plant, request->path) >= (int)sizeof url) {
        curl_slist_free_all(headers);
        (void)tl_fail(error, TL_TRY_AGAIN, "out of memory, or too long an address");
        return TL_PUSH_BROKEN;
    }
    CURLcode code = perform(&self, url, headers);
    (void)curl_easy_getinfo(link->curl, CURLINFO_RESPONSE_CODE, &request->status);
    curl_slist_free_all(headers);
    if (code == CURLE_OK) {
        return TL_PUSH_OK;
    }
    (void)tl_fail(error, TL_TRY_AGAIN, "%.100s: %s", link->box,
                  link->said[0] != '\0' ? link->said : curl_easy_strerror(code));
    return outcome_of(code);
}
