/* A block: memory that two processes share, of a size that neither can change.
 *
 * Purpose: what crosses between processes lies in sealed memfds. Nobody can shrink one under the other's feet (SIGBUS) or let it grow.
 *          Each has one writer; who only reads one cannot map it for writing, nor write into it by its descriptor: that of a block which we
 *          write is sealed against it, of one that another process writes readers get a descriptor of their own (tl_block_reader()).
 * Kernel:  before Linux 5.1 a block of ours cannot be kept from being written by who takes it; a foreign machine's emulator may know no
 *          seals at all. Then these are missing, and `seals` tells so.
 * Owner:   the caller places a block; its memory and its descriptor are the block's until it is closed.
 * Errors:  TL_TRY_AGAIN if memory or descriptors are missing; TL_BAD_DATA for a descriptor that is no such block.
 * Thread:  any, one block at a time.
 */
#ifndef TL_FIRMWARE_PROCESS_BLOCK_H
#define TL_FIRMWARE_PROCESS_BLOCK_H

#include <stdbool.h>
#include <stddef.h>
#include <sys/types.h>

#include "master/base/status.h"

/* Who writes a block that we have made. */
typedef enum tl_block_writer {
    TL_BLOCK_WE_WRITE,   /* we do, as long as it is open here; who takes it reads */
    TL_BLOCK_THEY_WRITE, /* who takes it; nothing keeps us from it but this name */
    TL_BLOCK_SPARSE,     /* who takes it, and the memory is there only as far as it is used; not mapped here */
    TL_BLOCK_IS_WRITTEN  /* nobody does any more: tl_block_make_of() */
} tl_block_writer;

/* A zeroed one is none. */
typedef struct tl_block {
    void *bytes;    /* mapped at the beginning of a page; NULL: not mapped here */
    size_t size;    /* 0: there is no block */
    int descriptor; /* closed on exec */
    unsigned seals; /* F_SEAL_…, as the kernel has set them */
} tl_block;

/* A block of zeros, `size` > 0. `name` is what /proc shows of it. Using it cannot fail for lack of memory, unless it is sparse: if memory is out when a page of that
 * is used for the first time, the kernel ends who uses it; and mlockall() in a process that has it mapped readable takes all of it. */
tl_status tl_block_make(const char *name, size_t size, tl_block_writer writer, tl_block *block, tl_error *error);

/* A new descriptor of a block of ours that another process writes, closed on exec: who takes it (with TL_BLOCK_WE_WRITE) can only read. From now on
 * nobody who has no capability and may not chmod() opens the memory anew for writing; descriptors that can write stay so. Without /proc it is a
 * mere duplicate. The caller's to close; -1: descriptors are missing. */
int tl_block_reader(const tl_block *block);

/* A block with these bytes, which nobody can change. */
tl_status tl_block_make_of(const char *name, const void *bytes, size_t size, tl_block *block, tl_error *error);

/* Maps a block that another process has made. It must have exactly `size` bytes (0: any number but none) and a sealed size, where the kernel
 * has seals; of one that is mapped to be read only, `writer` says what else must be sealed. The descriptor is the block's, on failure too. */
tl_status tl_block_take(int descriptor, size_t size, tl_block_writer writer, tl_block *block, tl_error *error);

/* In the process that writes it, mapped: all bytes are zero again, and their memory is the machine's, also if memory is locked. If a machine
 * cannot do that, nothing happens. */
void tl_block_forget(tl_block *block);

/* Unmaps, and closes the descriptor. A zeroed block is allowed. */
void tl_block_close(tl_block *block);

/* ---- A packet with a descriptor, over a socket between two processes. Thread: any. ---- */

/* Sends a packet, and with it a copy of `descriptor` (-1: none). Does not wait. False: errno says why. */
bool tl_packet_send(int socket, const void *bytes, size_t size, int descriptor);

/* Takes a packet of at most `size` bytes without waiting, and the descriptor that came with it (-1: none), closed on exec. Returns the number of bytes; 0: the other end is
 * closed; -1: errno says why. EBADMSG: the packet was longer, or brought several descriptors, which are closed. */
ssize_t tl_packet_take(int socket, void *bytes, size_t size, int *descriptor);

#endif
