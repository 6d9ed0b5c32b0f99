/* Texts of the box: see box_texts.h. */
#include "firmware/retune/box_texts.h"

#include <errno.h>
#include <fcntl.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "firmware/base/os.h"
#include "firmware/config/config_change.h"
#include "firmware/retune/control.h"

/* Closes `file`. Returns NULL if it cannot be read, has more than `most` bytes, or contains a NUL.
 */
static char *read_text(int file, size_t most) {
    size_t size = 0;
    char *text = tl_file_text_take(file, most, &size);
    if (text != NULL && strlen(text) != size) {
        free(text);
        text = NULL;
    }
    return text;
}

/* O_NONBLOCK, because opening a FIFO must not block. */
static int open_ordinary(const char *path, struct stat *about) {
    int file = open(path, O_RDONLY | O_CLOEXEC | O_NOCTTY | O_NONBLOCK);
    bool is_ordinary = file >= 0 && fstat(file, about) == 0 && S_ISREG(about->st_mode);
    if (file >= 0 && !is_ordinary) {
        (void)close(file);
        errno = EINVAL;
        return -1;
    }
    return file;
}

/* ---- the list ---- */

static bool is_guarded(const struct stat *about) {
    return (about->st_uid == 0 || about->st_uid == geteuid()) && (about->st_mode & (S_IWGRP | S_IWOTH)) == 0;
}

static bool is_list(const char *text, tl_error *error) {
    tl_allowed_names names = {.count = 0};
    tl_status status = tl_allowed_names_add_list(&names, text, error);
    tl_allowed_names_free(&names);
    return status == TL_OK;
}

char *tl_box_read_list(const char *path, char fault[TL_BOX_FAULT]) {
    struct stat about;
    tl_error error;
    fault[0] = '\0';
    int file = open_ordinary(path, &about);
    if (file < 0) {
        if (errno != ENOENT) {
            (void)snprintf(fault, TL_BOX_FAULT, "%.300s: ignored: %s", path, strerror(errno));
        }
        return NULL;
    }
    bool is_trusted = is_guarded(&about);
    char *text = read_text(file, TL_BOX_LIST_MOST);
    if (!is_trusted) {
        (void)snprintf(fault, TL_BOX_FAULT,
                       "%.300s: ignored, because users other than root can write it: chown root, chmod 644", path);
    } else if (text == NULL) {
        (void)snprintf(fault, TL_BOX_FAULT, "%.300s: ignored: not a text file of at most %d bytes", path,
                       (int)TL_BOX_LIST_MOST);
    } else if (!is_list(text, &error)) {
        (void)snprintf(fault, TL_BOX_FAULT, "%.200s: ignored: %.200s", path, error.text);
    }
    if (fault[0] != '\0') {
        free(text);
        text = NULL;
    }
    return text;
}

/* ---- the configuration's file ---- */

char *tl_box_read_file(const char *path) {
    struct stat about;
    return read_text(open_ordinary(path, &about), TL_CONTROL_MOST);
}
