/* Fingerprints: see fingerprint.h. */
#include "firmware/tls/fingerprint.h"

#include <stdio.h>
#include <string.h>
#include <strings.h>

#include <gnutls/gnutls.h>
#include <gnutls/x509.h>

enum { DIGEST = 32, BASE64_OF_DIGEST = 44 };

static void write_hex(const unsigned char digest[DIGEST], char text[TL_FINGERPRINT_TEXT]) {
    for (size_t i = 0; i < DIGEST; i++) {
        (void)snprintf(text + 3 * i, 4, "%02X%s", digest[i], i + 1 < DIGEST ? ":" : "");
    }
}

static bool write_pin(const unsigned char digest[DIGEST], char text[TL_FINGERPRINT_TEXT]) {
    unsigned char copy[DIGEST];
    gnutls_datum_t encoded = {NULL, 0};
    memcpy(copy, digest, DIGEST);
    const gnutls_datum_t plain = {copy, DIGEST};
    if (gnutls_base64_encode2(&plain, &encoded) < 0) {
        return false;
    }
    (void)snprintf(text, TL_FINGERPRINT_TEXT, "sha256//%.*s", (int)encoded.size, (const char *)encoded.data);
    gnutls_free(encoded.data);
    return true;
}

static bool write_both(gnutls_x509_crt_t certificate, tl_fingerprint *fingerprint) {
    unsigned char key[DIGEST];
    unsigned char whole[DIGEST];
    size_t key_size = sizeof key;
    size_t size = sizeof whole;
    if (gnutls_x509_crt_get_key_id(certificate, GNUTLS_KEYID_USE_SHA256, key, &key_size) < 0 || key_size != DIGEST ||
        gnutls_x509_crt_get_fingerprint(certificate, GNUTLS_DIG_SHA256, whole, &size) < 0 || size != DIGEST) {
        return false;
    }
    write_hex(whole, fingerprint->certificate);
    return write_pin(key, fingerprint->pin);
}

tl_status tl_fingerprint_of(const char *pem, size_t size, tl_fingerprint *fingerprint, tl_error *error) {
    gnutls_x509_crt_t *list = NULL;
    unsigned count = 0;
    union { /* GnuTLS does not write to it, and does not say so */
        const char *is;
        unsigned char *as;
    } bytes = {.is = pem};
    const gnutls_datum_t text = {bytes.as, (unsigned)size};
    *fingerprint = (tl_fingerprint){.pin = ""};
    int failure = gnutls_x509_crt_list_import2(&list, &count, &text, GNUTLS_X509_FMT_PEM, 0);
    bool is_done = failure >= 0 && count > 0 && write_both(list[0], fingerprint);
    for (unsigned i = 0; i < count && failure >= 0; i++) {
        gnutls_x509_crt_deinit(list[i]);
    }
    if (failure >= 0) {
        gnutls_free(list);
    }
    return is_done ? TL_OK
                   : tl_fail(error, TL_BAD_DATA, "found no certificate (PEM): %s",
                             failure < 0 ? gnutls_strerror(failure) : "its key is unknown");
}

/* Digits without what a person may write between them, up to anything else. */
static size_t plain_hex(const char *words, char *plain, size_t room) {
    size_t used = 0;
    for (const char *next = words;
         used + 1 < room && *next != '\0' && strchr(": 0123456789ABCDEFabcdef", *next) != NULL; next++) {
        if (*next != ':' && *next != ' ') {
            plain[used] = *next;
            used++;
        }
    }
    plain[used] = '\0';
    return used;
}

bool tl_fingerprint_is_one(const char *words) {
    static const char letters[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/=";
    char plain[TL_FINGERPRINT_TEXT];
    size_t length = strlen(words);
    if (strncmp(words, "sha256//", strlen("sha256//")) == 0) {
        const char *digest = words + strlen("sha256//");
        return strlen(digest) == BASE64_OF_DIGEST && digest[strspn(digest, letters)] == '\0';
    }
    bool is_hex = words[strspn(words, ": 0123456789ABCDEFabcdef")] == '\0';
    return is_hex && length < TL_FINGERPRINT_TEXT && plain_hex(words, plain, sizeof plain) == 2 * (size_t)DIGEST;
}

bool tl_fingerprint_is(const tl_fingerprint *fingerprint, const char *words) {
    char one[TL_FINGERPRINT_TEXT];
    char other[TL_FINGERPRINT_TEXT];
    if (strncmp(words, "sha256//", strlen("sha256//")) == 0) {
        return strcmp(words, fingerprint->pin) == 0;
    }
    size_t length = strlen(words) < TL_FINGERPRINT_TEXT ? plain_hex(words, one, sizeof one) : 0;
    return length == 2 * (size_t)DIGEST && plain_hex(fingerprint->certificate, other, sizeof other) == length &&
           strcasecmp(one, other) == 0;
}
