/* Packets: see control_packet.h. */
#include "firmware/retune/control_packet.h"

#include <errno.h>
#include <linux/magic.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/vfs.h>
#include <unistd.h>

#include "firmware/process/block.h"
#include "firmware/retune/control_wire.h"

/* Descriptors that one packet may bring, at most: what finds no room here would not be closed by every emulator. */
enum { DESCRIPTORS = 253 };

typedef union room_for_descriptors {
    struct cmsghdr header; /* for its alignment */
    char bytes[CMSG_SPACE(DESCRIPTORS * sizeof(int))];
} room_for_descriptors;

/* ---- sending ---- */

static bool send_packet(int socket, const void *bytes, size_t size, int descriptor) {
    const union {
        const void *ours;
        void *for_kernel; /* which only reads it */
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

bool tl_control_packet_send(int socket, const void *bytes, size_t size, const char *text, size_t length) {
    tl_block block = {.descriptor = -1};
    if (text != NULL && tl_block_make_of("twinlock configuration", text, length, &block, NULL) != TL_OK) {
        errno = ENOMEM;
        return false;
    }
    bool is_sent = send_packet(socket, bytes, size, block.descriptor);
    int code = errno;
    tl_block_close(&block);
    errno = code;
    return is_sent;
}

/* ---- taking ---- */

/* How many of `found` there are. */
static size_t find_descriptors(struct msghdr *message, int found[DESCRIPTORS]) {
    size_t count = 0;
    for (struct cmsghdr *header = CMSG_FIRSTHDR(message); header != NULL; header = CMSG_NXTHDR(message, header)) {
        if (header->cmsg_level != SOL_SOCKET || header->cmsg_type != SCM_RIGHTS) {
            continue;
        }
        size_t bytes = header->cmsg_len - CMSG_LEN(0);
        size_t here = bytes / sizeof(int);
        here = here < DESCRIPTORS - count ? here : DESCRIPTORS - count;
        memcpy(&found[count], CMSG_DATA(header), here * sizeof(int));
        count += here;
    }
    return count;
}

/* Any other file could be slow to read, or end the reader. */
static bool is_memory(int descriptor, size_t *size) {
    struct stat about;
    struct statfs system;
    bool is = fstat(descriptor, &about) == 0 && S_ISREG(about.st_mode) && fstatfs(descriptor, &system) == 0 &&
              (unsigned long)system.f_type == TMPFS_MAGIC && about.st_size > 0 && about.st_size <= TL_CONTROL_MOST;
    *size = is ? (size_t)about.st_size : 0;
    return is;
}

static bool copy_text(int descriptor, char *text, size_t *length) {
    size_t size = 0;
    if (!is_memory(descriptor, &size)) {
        return false;
    }
    ssize_t got = pread(descriptor, text, size, 0);
    *length = got == (ssize_t)size ? size : 0;
    text[*length] = '\0';
    return *length != 0;
}

tl_control_arrival tl_control_packet_take(int socket, void *bytes, size_t size, char *text, size_t *length) {
    room_for_descriptors room = {.header = {0}};
    struct iovec part = {.iov_base = bytes, .iov_len = size};
    struct msghdr message = {
        .msg_iov = &part, .msg_iovlen = 1, .msg_control = room.bytes, .msg_controllen = sizeof room.bytes};
    int found[DESCRIPTORS];
    *length = 0;
    ssize_t got = recvmsg(socket, &message, MSG_DONTWAIT | MSG_CMSG_CLOEXEC);
    if (got < 0) {
        bool is_later = errno == EAGAIN || errno == EINTR;
        return is_later ? TL_CONTROL_NONE : TL_CONTROL_CLOSED;
    }
    size_t count = find_descriptors(&message, found);
    bool is_whole = got == (ssize_t)size && (message.msg_flags & (MSG_TRUNC | MSG_CTRUNC)) == 0;
    if (count != 0) {
        is_whole = is_whole && count == 1 && text != NULL && copy_text(found[0], text, length);
    }
    for (size_t i = 0; i < count; i++) {
        (void)close(found[i]);
    }
    return got == 0 ? TL_CONTROL_CLOSED : is_whole ? TL_CONTROL_PACKET : TL_CONTROL_GARBAGE;
}
