/* Identities: SHA-256 of bytes and files.
 *
 * Thread:  any.
 */
#ifndef TL_FIRMWARE_BASE_IDENTITY_H
#define TL_FIRMWARE_BASE_IDENTITY_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* ---- SHA-256: ties a recording to the configuration that it was made with.
 *
 * Purpose: the libraries that the program with FMUs links do not offer SHA-256. GnuTLS does, but
 *          only network programs link it.
 * Source:  FIPS 180-4, section 6.2.
 * Thread:  pure function.
 */

enum { TL_SHA256_TEXT = 65 }; /* 64 hexadecimal digits and NUL */

/* Computes the digest of `size` bytes, in lower-case hexadecimal. */
void tl_sha256(const void *data, size_t size, char text[TL_SHA256_TEXT]);

/* ---- What must be unchanged to resume a run: the FMUs, the boot of the system, and the program
 * that reads a checkpoint.
 *
 * Thread:  any.
 */

enum { TL_IDENTITY_TEXT = 128, TL_IDENTITY_FILES = 64 };

/* Computes SHA-256 over the digests of files, in their order; at most TL_IDENTITY_FILES. Sets "" if
 * a file cannot be read. */
void tl_identity_files(const char *const *paths, size_t count, char text[TL_SHA256_TEXT]);

/* Computes SHA-256 of a file that is open for reading. Returns false and sets "" if it cannot be
 * read. */
bool tl_identity_open_file(int descriptor, char text[TL_SHA256_TEXT]);

/* As tl_identity_files(), for files that are open for reading. Their offsets do not change. */
void tl_identity_open_files(const int *descriptors, size_t count, char text[TL_SHA256_TEXT]);

/* Returns a number for a set of open files. It changes if one of them is replaced or written. Never
 * 0. */
uint64_t tl_identity_number_of_open_files(const int *descriptors, size_t count);

/* Returns whether a text from another process has the form of these digests: "" or digits. */
bool tl_identity_is_sound(const char text[TL_SHA256_TEXT]);

/* Sets an ID that changes at each boot; "" if the kernel has none. Times of CLOCK_MONOTONIC are
 * only valid within one boot. */
void tl_identity_boot(char text[TL_IDENTITY_TEXT]);

/* Sets program version, machine and pointer size. A checkpoint can only be read if they are the
 * same. */
void tl_identity_format(char text[TL_IDENTITY_TEXT]);

#endif
