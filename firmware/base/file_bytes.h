/* The bytes of a file that is open, in one call, whatever interrupts it.
 *
 * Thread: any thread.
 */
#ifndef TL_FIRMWARE_BASE_FILE_BYTES_H
#define TL_FIRMWARE_BASE_FILE_BYTES_H

#include <stddef.h>
#include <sys/types.h>

/* Reads until `bytes` has so many, or the file has no more. Returns how many there are; −1 with errno where reading failed. */
ssize_t tl_file_bytes_read(int file, char *bytes, size_t room);

#endif
