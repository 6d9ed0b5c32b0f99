/* The certificate of this server, and its key.
 *
 * Purpose: made on the box when it is first needed, so that no two boxes share a key; or an administrator's own.
 * File:    both in one, readable for the server only, made whole or not at all: a power cut leaves none, which is made then, or this one.
 * Time:    valid from 2020 to 9999 (2038 where time has 32 bits): a box without a clock comes up in 1970, and who connects compares the key, not dates.
 * Thread:  one.
 */
#ifndef TL_FIRMWARE_SERVE_CERTIFICATE_H
#define TL_FIRMWARE_SERVE_CERTIFICATE_H

#include "master/base/status.h"

enum { TL_FINGERPRINT_TEXT = 96 };

/* What a client compares, because nobody has signed the certificate. The pin stays the same if the certificate is renewed. */
typedef struct tl_fingerprint {
    char pin[TL_FINGERPRINT_TEXT]; /* "sha256//" and base64: SHA-256 of the public key, for `curl --pinnedpubkey` */
    char certificate[TL_FINGERPRINT_TEXT]; /* "AB:CD:…": SHA-256 of the certificate, as browsers show it */
} tl_fingerprint;

/* Texts of PEM, which are the caller's to free by tl_certificate_free(). A zeroed one is none. */
typedef struct tl_certificate {
    char *chain;
    char *key;
    tl_fingerprint fingerprint;
} tl_certificate;

/* From two files; `key` may be the same one. TL_BAD_DATA: they are none, or do not belong together; TL_TRY_AGAIN: they cannot be read. */
tl_status tl_certificate_load(const char *chain, const char *key, tl_certificate *certificate, tl_error *error);

/* The one in this folder, made if there is none. */
tl_status tl_certificate_have(const char *folder, tl_certificate *certificate, tl_error *error);

void tl_certificate_free(tl_certificate *certificate);

#endif
