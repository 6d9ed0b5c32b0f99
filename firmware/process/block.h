/* Block: memory that two processes share. Neither process can change its size.
 *
 * Purpose: processes share data in sealed memfds. If one process could shrink a block, another
 *          process that uses the block would get SIGBUS. A sealed block can neither shrink nor
 *          grow.
 * Access:  each block has one writer. A reader can neither map the block for writing nor write to
 *          its descriptor. A block that its maker writes is sealed against other writers. If a
 *          process other than the maker writes the block, the readers get a read-only descriptor
 *          (tl_block_reader()).
 * Kernel:  before Linux 5.1, a reader of a block that its maker writes can write to it too. An
 *          emulator of another machine type may not support seals. The field `seals` shows which
 *          seals the kernel has set.
 * Owner:   the caller owns the struct. The block owns its memory and its descriptor until it is
 *          closed.
 * Errors:  TL_TRY_AGAIN if memory or descriptors are missing; TL_BAD_DATA if a descriptor is not a
 *          suitable block.
 * Thread:  any; one thread at a time per block.
 */
#ifndef TL_FIRMWARE_PROCESS_BLOCK_H
#define TL_FIRMWARE_PROCESS_BLOCK_H

#include <stdbool.h>
#include <stddef.h>
#include <sys/types.h>

#include "master/base/status.h"

/* Which process writes a block. The maker ("we") is the process that calls tl_block_make(). A
 * receiver ("they") is a process that calls tl_block_take(). A receiver that writes passes
 * THEY_WRITE. A receiver that only reads passes WE_WRITE, also if another receiver writes. */
typedef enum tl_block_writer {
    TL_BLOCK_WE_WRITE,   /* the maker, while it has the block open; all receivers read */
    TL_BLOCK_THEY_WRITE, /* one receiver; the maker could too, but must not */
    TL_BLOCK_SPARSE,     /* only for tl_block_make(): as THEY_WRITE, but each page takes memory at its first access */
    TL_BLOCK_IS_WRITTEN  /* no process: the content is final (tl_block_make_of()) */
} tl_block_writer;

/* Zeroed: no block. */
typedef struct tl_block {
    void *bytes;    /* start of the mapping, page-aligned; NULL: not mapped in this process */
    size_t size;    /* bytes; 0: no block */
    int descriptor; /* close-on-exec */
    unsigned seals; /* F_SEAL_… that the kernel has set */
} tl_block;

/* Makes a block of zeros with `size` > 0 bytes; /proc shows it as `name`. Reserves and maps its
 * memory, except for a sparse block. If memory is out at the first access to a page of a sparse
 * block, the kernel kills the accessing process. If a process has mapped a sparse block and calls
 * mlockall(), all pages of the block become resident. */
tl_status tl_block_make(const char *name, size_t size, tl_block_writer writer, tl_block *block, tl_error *error);

/* For the maker of a block that another process writes: returns a new descriptor for a reader,
 * read-only and close-on-exec. The caller closes the descriptor. The reader passes it to
 * tl_block_take() with TL_BLOCK_WE_WRITE, which maps it read-only. Returns -1 if descriptors or
 * memory are missing. The file mode of the block becomes read-only. After that a process can reopen
 * the memory for writing only if it has capabilities or may call chmod(). Existing writable
 * descriptors stay writable. Without /proc the result is a plain duplicate, which is writable. */
int tl_block_reader(const tl_block *block);

/* Makes a block with these bytes, which no process can change. */
tl_status tl_block_make_of(const char *name, const void *bytes, size_t size, tl_block *block, tl_error *error);

/* Maps a block that another process has made: for writing only if `writer` is TL_BLOCK_THEY_WRITE.
 * The block must have exactly `size` bytes (0: any size above 0). If the kernel supports seals, the
 * size must be sealed; with TL_BLOCK_IS_WRITTEN also the content. The block then owns `descriptor`;
 * on failure `descriptor` is closed. */
tl_status tl_block_take(int descriptor, size_t size, tl_block_writer writer, tl_block *block, tl_error *error);

/* For the process that writes the block: sets all bytes to zero and returns their memory to the
 * system, also if memory is locked. Does nothing if the system does not support that. */
void tl_block_forget(tl_block *block);

/* Unmaps the block and closes its descriptor. A zeroed block is allowed. */
void tl_block_close(tl_block *block);

/* ---- A packet with a descriptor, sent over a socket between two processes. Thread: any. ---- */

/* Sends a packet and a copy of `descriptor` (-1: none). Does not block. Returns false and sets
 * errno on failure. */
bool tl_packet_send(int socket, const void *bytes, size_t size, int descriptor);

/* Receives a packet of at most `size` bytes and its descriptor (-1: none; close-on-exec). Does not
 * block. Returns the number of bytes, 0 if the other end is closed, or -1 with errno. EBADMSG: the
 * packet was longer or had several descriptors, which are closed. */
ssize_t tl_packet_take(int socket, void *bytes, size_t size, int *descriptor);

#endif
