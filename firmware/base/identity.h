/* Identities: SHA-256 of bytes and files; identification of open files, the boot, and the program.
 *
 * Thread:  any.
 */
#ifndef TL_FIRMWARE_BASE_IDENTITY_H
#define TL_FIRMWARE_BASE_IDENTITY_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* ---- SHA-256: for example, links a recording to the configuration with which it was made.
 *
 * Purpose: no library that `twinlock` links offers SHA-256. GnuTLS does, but only twinlock-serve
 *          links it.
 * Source:  FIPS 180-4, section 6.2.
 * Thread:  pure function.
 */

enum { TL_SHA256_TEXT = 65 }; /* 64 hexadecimal digits and NUL */

/* Computes the digest of `size` bytes, in lower-case hexadecimal. */
void tl_sha256(const void *data, size_t size, char text[TL_SHA256_TEXT]);

/* ---- Identification of what must be unchanged to resume a run: the FMUs, the boot of the system,
 * and the program, which must be able to read the checkpoint.
 *
 * Thread:  any.
 */

enum { TL_IDENTITY_TEXT = 128, TL_IDENTITY_FILES = 64 }; /* bytes of a text with its NUL; number of files */

/* Computes one SHA-256 over the SHA-256 digests of these files, in their order. `count` is at most
 * TL_IDENTITY_FILES. Sets "" if a file cannot be read or is empty, or if memory is out. */
void tl_identity_files(const char *const *paths, size_t count, char text[TL_SHA256_TEXT]);

/* Computes SHA-256 of a file that is open for reading; its offset does not change. Returns false
 * and sets "" if the file cannot be read or is empty, or if memory is out. */
bool tl_identity_open_file(int descriptor, char text[TL_SHA256_TEXT]);

/* As tl_identity_files(), for files that are open for reading. Their offsets do not change. */
void tl_identity_open_files(const int *descriptors, size_t count, char text[TL_SHA256_TEXT]);

/* Returns a number for a list of open files, never 0. The number changes if a file is replaced or
 * written: it depends on inode, size and time of modification, and not on the content. */
uint64_t tl_identity_number_of_open_files(const int *descriptors, size_t count);

/* Returns true if a text from another process has the form of a digest: "" or 64 hexadecimal digits
 * in lower case. The text may lack a NUL. */
bool tl_identity_is_sound(const char text[TL_SHA256_TEXT]);

/* Sets the kernel's ID of this boot; "" if there is none. Times of CLOCK_MONOTONIC are valid within
 * one boot only. */
void tl_identity_boot(char text[TL_IDENTITY_TEXT]);

/* Sets a text of program version, machine and pointer size. A checkpoint can be read only if this
 * text is the same as when it was written. */
void tl_identity_format(char text[TL_IDENTITY_TEXT]);

#endif
