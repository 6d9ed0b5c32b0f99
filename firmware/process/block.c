/* Shared memory with a sealed size: see block.h. */
#include "firmware/process/block.h"

#include <errno.h>
#include <fcntl.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#include "firmware/base/os.h"

#if !defined(MFD_NOEXEC_SEAL)
#define MFD_NOEXEC_SEAL 0x0008U /* Linux 6.3 */
#endif

enum { SIZE_SEALS = F_SEAL_SHRINK | F_SEAL_GROW | F_SEAL_SEAL };

/* A kernel rejects flags that it does not know, so retry without them. */
static int make_memory_file(const char *name) {
    int file = memfd_create(name, MFD_CLOEXEC | MFD_ALLOW_SEALING | MFD_NOEXEC_SEAL);
    return file >= 0 || errno != EINVAL ? file : memfd_create(name, MFD_CLOEXEC | MFD_ALLOW_SEALING);
}

static void drop_block(tl_block *block) {
    if (block->bytes != NULL) {
        (void)munmap(block->bytes, block->size);
    }
    if (block->descriptor >= 0) {
        (void)close(block->descriptor);
    }
    *block = (tl_block){.descriptor = -1};
}

static tl_status fail_make(const char *name, tl_block *block, tl_error *error) {
    int code = errno;
    size_t size = block->size;
    drop_block(block);
    return tl_fail(error, TL_TRY_AGAIN,
                   "shared memory \"%s\": %zu bytes are not available: %s; free memory and try again", name, size,
                   strerror(code));
}

static bool map_block(tl_block *block, bool is_writable) {
    block->bytes =
        mmap(NULL, block->size, is_writable ? PROT_READ | PROT_WRITE : PROT_READ, MAP_SHARED, block->descriptor, 0);
    block->bytes = block->bytes == MAP_FAILED ? NULL : block->bytes;
    return block->bytes != NULL;
}

/* Returns the present seals; 0 if the kernel has none. */
static unsigned read_seals(int descriptor) {
    int seals = fcntl(descriptor, F_GET_SEALS);
    return seals < 0 ? 0 : (unsigned)seals;
}

/* Seals against writing first, because F_SEAL_SEAL forbids all further seals. */
static void seal_block(tl_block *block, int against_writers) {
    if (against_writers != 0) {
        (void)fcntl(block->descriptor, F_ADD_SEALS, against_writers);
    }
    (void)fcntl(block->descriptor, F_ADD_SEALS, SIZE_SEALS);
    block->seals = read_seals(block->descriptor);
}

/* For a sparse block only the size is sealed, because its writer maps it later. */
tl_status tl_block_make(const char *name, size_t size, tl_block_writer writer, tl_block *block, tl_error *error) {
    *block = (tl_block){.size = size, .descriptor = make_memory_file(name)};
    if (block->descriptor < 0) {
        return fail_make(name, block, error);
    }
    if (writer == TL_BLOCK_SPARSE) {
        errno = ftruncate(block->descriptor, (off_t)size) != 0 ? errno : 0;
    } else {
        errno = posix_fallocate(block->descriptor, 0, (off_t)size);
    }
    if (errno != 0 || (writer != TL_BLOCK_SPARSE && !map_block(block, true))) {
        return fail_make(name, block, error);
    }
    seal_block(block, writer == TL_BLOCK_WE_WRITE ? F_SEAL_FUTURE_WRITE : 0);
    return TL_OK;
}

/* A read-only descriptor can neither be mapped for writing nor written. Its receiver could reopen
 * the file in /proc if the file's mode allowed the owner to write, so the mode is changed. */
int tl_block_reader(const tl_block *block) {
    char path[64];
    (void)fchmod(block->descriptor, S_IRUSR);
    (void)snprintf(path, sizeof path, "/proc/self/fd/%d", block->descriptor);
    int reader = open(path, O_RDONLY | O_CLOEXEC);
    if (reader < 0 && errno != EMFILE && errno != ENFILE && errno != ENOMEM) {
        reader = fcntl(block->descriptor, F_DUPFD_CLOEXEC, 0);
    }
    return reader;
}

/* Uses the descriptor, because madvise() rejects locked memory. */
void tl_block_forget(tl_block *block) {
    (void)fallocate(block->descriptor, FALLOC_FL_PUNCH_HOLE | FALLOC_FL_KEEP_SIZE, 0, (off_t)block->size);
}

tl_status tl_block_make_of(const char *name, const void *bytes, size_t size, tl_block *block, tl_error *error) {
    *block = (tl_block){.size = size, .descriptor = make_memory_file(name)};
    if (block->descriptor < 0 || !tl_file_bytes_write(block->descriptor, bytes, size)) {
        return fail_make(name, block, error);
    }
    seal_block(block, F_SEAL_WRITE);
    return map_block(block, false) ? TL_OK : fail_make(name, block, error);
}

/* Returns the fault of a received block, or NULL. If F_GET_SEALS fails, either the kernel has
 * no seals, or the file is of another kind, which its size or mapping shows. */
static const char *find_fault(const tl_block *block, const struct stat *status, size_t size, tl_block_writer writer) {
    bool has_seals = fcntl(block->descriptor, F_GET_SEALS) >= 0;
    if (!S_ISREG(status->st_mode)) {
        return "is not shared memory";
    }
    if (status->st_size <= 0 || (uint64_t)status->st_size > SIZE_MAX / 2 ||
        (size != 0 && (uint64_t)status->st_size != size)) {
        return "has another size";
    }
    if (has_seals && (block->seals & SIZE_SEALS) != SIZE_SEALS) {
        return "can still change its size";
    }
    if (has_seals && writer == TL_BLOCK_IS_WRITTEN && (block->seals & F_SEAL_WRITE) == 0) {
        return "can still be written";
    }
    return NULL;
}

tl_status tl_block_take(int descriptor, size_t size, tl_block_writer writer, tl_block *block, tl_error *error) {
    struct stat status;
    *block = (tl_block){.descriptor = descriptor, .seals = read_seals(descriptor)};
    const char *fault = fstat(descriptor, &status) != 0 ? "is not open" : find_fault(block, &status, size, writer);
    if (fault == NULL) {
        block->size = (size_t)status.st_size;
        fault = map_block(block, writer == TL_BLOCK_THEY_WRITE) ? NULL : "cannot be mapped";
    }
    if (fault != NULL) {
        drop_block(block);
        return tl_fail(error, TL_BAD_DATA, "the shared memory of descriptor %d %s; restart twinlock", descriptor,
                       fault);
    }
    (void)fcntl(descriptor, F_SETFD, FD_CLOEXEC);
    return TL_OK;
}

void tl_block_close(tl_block *block) {
    if (block->size > 0) {
        drop_block(block);
    }
}

/* ---- a packet with a descriptor ---- */

/* Most descriptors in one packet (kernel limit). With less room an emulator might not close those
 * that do not fit. */
enum { DESCRIPTORS = 253 };

typedef union room_for_descriptors {
    struct cmsghdr header; /* for alignment */
    char bytes[CMSG_SPACE(DESCRIPTORS * sizeof(int))];
} room_for_descriptors;

bool tl_packet_send(int socket, const void *bytes, size_t size, int descriptor) {
    const union {
        const void *ours;
        void *for_kernel; /* the kernel only reads it */
    } what = {.ours = bytes};
    room_for_descriptors room = {.header = {0}};
    struct iovec part = {.iov_base = what.for_kernel, .iov_len = size};
    struct msghdr message = {.msg_iov = &part, .msg_iovlen = 1};
    if (descriptor >= 0) {
        message.msg_control = room.bytes;
        message.msg_controllen = CMSG_SPACE(sizeof descriptor);
        struct cmsghdr *header = CMSG_FIRSTHDR(&message);
        header->cmsg_level = SOL_SOCKET;
        header->cmsg_type = SCM_RIGHTS;
        header->cmsg_len = CMSG_LEN(sizeof descriptor);
        memcpy(CMSG_DATA(header), &descriptor, sizeof descriptor);
    }
    ssize_t sent = -1;
    do {
        sent = sendmsg(socket, &message, MSG_DONTWAIT | MSG_NOSIGNAL);
    } while (sent < 0 && errno == EINTR);
    return sent == (ssize_t)size;
}

static void close_descriptor(int *descriptor) {
    if (*descriptor >= 0) {
        (void)close(*descriptor);
    }
    *descriptor = -1;
}

ssize_t tl_packet_take(int socket, void *bytes, size_t size, int *descriptor) {
    room_for_descriptors room = {.header = {0}};
    struct iovec part = {.iov_base = bytes, .iov_len = size};
    struct msghdr message = {
        .msg_iov = &part, .msg_iovlen = 1, .msg_control = room.bytes, .msg_controllen = sizeof room.bytes};
    size_t count = 0;
    *descriptor = -1;
    ssize_t got = recvmsg(socket, &message, MSG_DONTWAIT | MSG_CMSG_CLOEXEC);
    struct cmsghdr *header = got >= 0 ? CMSG_FIRSTHDR(&message) : NULL;
    for (; header != NULL; header = CMSG_NXTHDR(&message, header)) {
        bool brings = header->cmsg_level == SOL_SOCKET && header->cmsg_type == SCM_RIGHTS;
        size_t received = brings ? (header->cmsg_len - CMSG_LEN(0)) / sizeof(int) : 0;
        for (size_t i = 0; i < received; i++) {
            close_descriptor(descriptor);
            memcpy(descriptor, CMSG_DATA(header) + i * sizeof(int), sizeof *descriptor);
        }
        count += received;
    }
    if (got >= 0 && (count > 1 || (message.msg_flags & (MSG_TRUNC | MSG_CTRUNC)) != 0)) {
        close_descriptor(descriptor);
        errno = EBADMSG;
        return -1;
    }
    return got;
}
