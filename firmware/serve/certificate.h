/* The TLS certificate of this server, and its key.
 *
 * Purpose: the box generates its certificate when it is first needed, so that no two boxes share a
 *          key. An administrator can provide another one.
 * File:    contains both; only the server can read it. It is written as a whole: after a power cut
 *          the file is missing or complete, and a missing file is generated.
 * Time:    valid from 2020 to 9999 (2038 if time_t has 32 bits), so that it never has to be
 *          renewed. A box without a clock starts in 1970; clients compare the key, not the dates.
 * Memory:  tl_certificate_free() frees the texts of a certificate.
 * Thread:  one.
 */
#ifndef TL_FIRMWARE_SERVE_CERTIFICATE_H
#define TL_FIRMWARE_SERVE_CERTIFICATE_H

#include "master/base/status.h"

enum { TL_FINGERPRINT_TEXT = 96 };

/* Fingerprints that clients compare, because no authority has signed the certificate. The pin does
 * not change if the certificate is renewed with the same key. */
typedef struct tl_fingerprint {
    char pin[TL_FINGERPRINT_TEXT]; /* "sha256//" and base64: SHA-256 of the public key, for `curl --pinnedpubkey` */
    char certificate[TL_FINGERPRINT_TEXT]; /* "AB:CD:…": SHA-256 of the certificate, as browsers show it */
} tl_fingerprint;

/* PEM texts. The caller frees them with tl_certificate_free(). Zeroed: there is no certificate. */
typedef struct tl_certificate {
    char *chain;
    char *key;
    tl_fingerprint fingerprint;
} tl_certificate;

/* Loads a certificate from two files; `key` may be the same file. Errors: TL_BAD_DATA if they are
 * invalid or do not match; TL_TRY_AGAIN if they cannot be read. */
tl_status tl_certificate_load(const char *chain, const char *key, tl_certificate *certificate, tl_error *error);

/* Loads the certificate in this folder, and generates it if it is missing. Errors: as above; also
 * TL_TRY_AGAIN if it cannot be generated, TL_BAD_DATA if the folder is missing, TL_BAD_USAGE if its
 * name is too long. */
tl_status tl_certificate_provide(const char *folder, tl_certificate *certificate, tl_error *error);

void tl_certificate_free(tl_certificate *certificate);

#endif
