/* See file_bytes.h. */
#include "firmware/base/file_bytes.h"

#include <errno.h>
#include <unistd.h>

ssize_t tl_file_bytes_read(int file, char *bytes, size_t room) {
    size_t size = 0;
    while (size < room) {
        ssize_t got = read(file, bytes + size, room - size);
        if (got < 0 && errno != EINTR) {
            return -1;
        }
        if (got == 0) {
            break;
        }
        size += got > 0 ? (size_t)got : 0;
    }
    return (ssize_t)size;
}
