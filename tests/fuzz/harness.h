/* Shared functions of the fuzz harnesses: a configuration, and input bytes as a file or a pipe.
 *
 * Purpose: tests/fuzz/README.md explains how to write a harness. Each fuzz_NAME.c defines
 *          LLVMFuzzerTestOneInput().
 * Files:   a harness may write below tl_fuzz_folder(), which is in memory and removed by
 *          tests/fuzz/run.
 * Errors:  a failure of the harness itself ends the program.
 * Thread:  one thread.
 */
#ifndef TL_TESTS_FUZZ_HARNESS_H
#define TL_TESTS_FUZZ_HARNESS_H

#include <stddef.h>
#include <stdint.h>

#include "firmware/config/config.h"

/* Passes the bytes to the code under test, and returns 0. Its behaviour must depend only on these
 * bytes. */
int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

/* Parses the configuration at the first call, and returns it. A program must pass the same text in
 * all calls. */
const tl_config *tl_fuzz_config(const char *text);

/* Returns the folder for files of this process: $TMPDIR, or /tmp. */
const char *tl_fuzz_folder(void);

/* Returns the path of a file in memory with these bytes. The next call replaces its content. */
const char *tl_fuzz_file(const uint8_t *data, size_t size);

/* Creates a pipe that contains these bytes, at most 64 KiB; further bytes are left out. Returns the
 * write end; *path is the path of the read end. tl_fuzz_close_pipe() closes both ends. */
int tl_fuzz_pipe(const uint8_t *data, size_t size, const char **path);
void tl_fuzz_close_pipe(int writer);

#endif
