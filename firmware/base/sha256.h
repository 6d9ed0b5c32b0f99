/* SHA-256: the fingerprint that ties a recording to the configuration it was made with.
 *
 * Purpose: none of the libraries that the program with FMUs links offers it. GnuTLS does, and is linked by those of the network only.
 * Source:  FIPS 180-4, section 6.2.
 * Thread:  pure function.
 */
#ifndef TL_FIRMWARE_BASE_SHA256_H
#define TL_FIRMWARE_BASE_SHA256_H

#include <stddef.h>

enum { TL_SHA256_TEXT = 65 }; /* 64 hexadecimal digits and the end of the text */

/* The digest of `size` bytes, in lower-case hexadecimal. */
void tl_sha256(const void *data, size_t size, char text[TL_SHA256_TEXT]);

#endif
