/* Identities: SHA-256 of bytes and files.
 *
 * Thread:  any.
 */
#ifndef TL_FIRMWARE_BASE_IDENTITY_H
#define TL_FIRMWARE_BASE_IDENTITY_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* ---- SHA-256: the fingerprint that ties a recording to the configuration it was made with.
 *
 * Purpose: none of the libraries that the program with FMUs links offers it. GnuTLS does, and is linked by those of the network only.
 * Source:  FIPS 180-4, section 6.2.
 * Thread:  pure function.
 */

enum { TL_SHA256_TEXT = 65 }; /* 64 hexadecimal digits and the end of the text */

/* The digest of `size` bytes, in lower-case hexadecimal. */
void tl_sha256(const void *data, size_t size, char text[TL_SHA256_TEXT]);

/* ---- What must be the same so that a run can be gone on with: the FMUs, the system since it was booted, and who reads a checkpoint.
 *
 * Thread: any.
 */

enum { TL_IDENTITY_TEXT = 128, TL_IDENTITY_FILES = 64 };

/* SHA-256 over those of files, in their order; at most TL_IDENTITY_FILES. "" where one cannot be read (any more). */
void tl_identity_files(const char *const *paths, size_t count, char text[TL_SHA256_TEXT]);

/* SHA-256 of one file that is open for reading. False, and "": it cannot be read. */
bool tl_identity_open_file(int descriptor, char text[TL_SHA256_TEXT]);

/* Over those of files that are open for reading; where they are read from stays. */
void tl_identity_open_files(const int *descriptors, size_t count, char text[TL_SHA256_TEXT]);

/* A number of files that are open, which is another one if one of them was replaced, or written since. Never 0. */
uint64_t tl_identity_number_of_open_files(const int *descriptors, size_t count);

/* Whether a text of so many bytes, of another process, can be what these give: "", or digits. */
bool tl_identity_is_sound(const char text[TL_SHA256_TEXT]);

/* Another one after each boot; "" where the kernel tells none. Times of CLOCK_MONOTONIC belong to it. */
void tl_identity_boot(char text[TL_IDENTITY_TEXT]);

/* Version of this program, machine, size of a pointer: the bytes of a checkpoint are for the same ones only. */
void tl_identity_format(char text[TL_IDENTITY_TEXT]);

#endif
