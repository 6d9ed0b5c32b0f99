/* What fuzz harnesses share: the function that libFuzzer calls, and bytes that are to be a file.
 *
 * Purpose: tests/fuzz/README.md says how a harness is written. Each fuzz_NAME.c defines LLVMFuzzerTestOneInput().
 * Files:   a harness may write below tl_fuzz_folder(), which is in memory and removed by tests/fuzz/run.
 * Errors:  what a harness needs itself and does not get ends the program.
 * Thread:  one thread.
 */
#ifndef TL_TESTS_FUZZ_HARNESS_H
#define TL_TESTS_FUZZ_HARNESS_H

#include <stddef.h>
#include <stdint.h>

#include "firmware/config/config.h"

/* Gives the bytes to what is under test, and returns 0. What it finds out has to depend on these bytes alone. */
int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

/* What this text configures, read once: always the same text in one program. */
const tl_config *tl_fuzz_config(const char *text);

/* A folder for this process: $TMPDIR, or /tmp. */
const char *tl_fuzz_folder(void);

/* The path of a file in memory with these bytes; valid until the next call, which changes the bytes. */
const char *tl_fuzz_file(const uint8_t *data, size_t size);

/* The descriptor of a pipe's other end once these bytes were written into it, and in *path its path; a pipe holds 64 KiB, and
 * further bytes are left out. The caller closes the descriptor with tl_fuzz_close_pipe(), when its reader has to see the end. */
int tl_fuzz_pipe(const uint8_t *data, size_t size, const char **path);
void tl_fuzz_close_pipe(int writer);

#endif
