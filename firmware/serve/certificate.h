/* The TLS certificate of this server, and its key.
 *
 * Purpose: the box generates its certificate when it is first needed, so that no two boxes share a
 *          key. An administrator can provide another certificate.
 * File:    "server.pem" has the certificate and the key; only the server's user can read it. After
 *          a power cut, the file is missing or complete. A missing file is generated.
 * Time:    the certificate is valid from 2020 to 9999 (2038 if time_t has 32 bits), so it needs no
 *          renewal. A box without a clock starts in 1970; clients compare the key, not the dates.
 * Memory:  tl_certificate_free() frees the texts of a certificate.
 * Thread:  one.
 */
#ifndef TL_FIRMWARE_SERVE_CERTIFICATE_H
#define TL_FIRMWARE_SERVE_CERTIFICATE_H

#include "master/base/status.h"

enum { TL_FINGERPRINT_TEXT = 96 }; /* bytes of a fingerprint's text, with the NUL */

/* Fingerprints that clients compare, because usually no authority has signed the certificate. `pin`
 * does not change if the certificate is renewed with the same key. */
typedef struct tl_fingerprint {
    char pin[TL_FINGERPRINT_TEXT]; /* "sha256//" and base64: SHA-256 of the public key, for `curl --pinnedpubkey` */
    char certificate[TL_FINGERPRINT_TEXT]; /* "AB:CD:…": SHA-256 of the certificate, as browsers show it */
} tl_fingerprint;

/* PEM texts. The caller frees them with tl_certificate_free(). Zeroed: there is no certificate. */
typedef struct tl_certificate {
    char *chain; /* the server's certificate, then those of the authorities that signed it, if any */
    char *key;
    tl_fingerprint fingerprint;
} tl_certificate;

/* Loads a certificate from the files `chain` and `key` (paths), which may be the same file. Errors:
 * TL_BAD_DATA if they are invalid or do not match; TL_TRY_AGAIN if they cannot be read. After an
 * error, *certificate is zeroed. */
tl_status tl_certificate_load(const char *chain, const char *key, tl_certificate *certificate, tl_error *error);

/* Loads "server.pem" in `folder`, and generates the file if it is missing. Errors: as above; also
 * TL_TRY_AGAIN if it cannot be generated, TL_BAD_DATA if the folder is missing, TL_BAD_USAGE if the
 * folder's name is too long. */
tl_status tl_certificate_provide(const char *folder, tl_certificate *certificate, tl_error *error);

void tl_certificate_free(tl_certificate *certificate);

#endif
