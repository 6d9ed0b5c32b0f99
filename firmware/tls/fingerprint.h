/* By what a person tells one certificate from another.
 *
 * Purpose: a box makes its own certificate, which nobody has signed. So who connects compares it with what the box shows: the pin, which is of the
 *          key and stays if the certificate is renewed, or the fingerprint, which is what browsers show.
 * Thread:  pure.
 */
#ifndef TL_FIRMWARE_TLS_FINGERPRINT_H
#define TL_FIRMWARE_TLS_FINGERPRINT_H

#include <stdbool.h>
#include <stddef.h>

#include "master/base/status.h"

enum { TL_FINGERPRINT_TEXT = 96 };

typedef struct tl_fingerprint {
    char pin[TL_FINGERPRINT_TEXT];         /* "sha256//" and base64: SHA-256 of the public key */
    char certificate[TL_FINGERPRINT_TEXT]; /* "AB:CD:…": SHA-256 of the certificate */
} tl_fingerprint;

/* Of the first certificate in a text of PEM. TL_BAD_DATA: there is none. */
tl_status tl_fingerprint_of(const char *pem, size_t size, tl_fingerprint *fingerprint, tl_error *error);

/* Whether a person's words can be either of the two. */
bool tl_fingerprint_is_one(const char *words);

/* Whether a person's words, either of the two, mean this one; colons and case of the second do not matter. */
bool tl_fingerprint_is(const tl_fingerprint *fingerprint, const char *words);

#endif
