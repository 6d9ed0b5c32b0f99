/* What must be the same so that a run can be gone on with: the FMUs, the system since it was booted, and who reads a checkpoint.
 *
 * Thread: any.
 */
#ifndef TL_FIRMWARE_IDENTITY_H
#define TL_FIRMWARE_IDENTITY_H

#include "firmware/assembly.h"
#include "firmware/sha256.h"

enum { TL_IDENTITY_TEXT = 128 };

/* SHA-256 over those of the components' FMU files, in their order. "" where one cannot be read (any more). */
void tl_identity_fmus(const tl_assembly *assembly, char text[TL_SHA256_TEXT]);

/* Another one after each boot; "" where the kernel tells none. Times of CLOCK_MONOTONIC belong to it. */
void tl_identity_boot(char text[TL_IDENTITY_TEXT]);

/* Version of this program, machine, size of a pointer: the bytes of a checkpoint are for the same ones only. */
void tl_identity_format(char text[TL_IDENTITY_TEXT]);

#endif
