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

/* All of an ordinary file, with a NUL; NULL with errno. */
static char *read_all(int file, size_t most) {
    char *text = malloc(most + 2);
    ssize_t size = text == NULL ? -1 : tl_file_bytes_read(file, text, most + 1);
    if (size < 0 || (size_t)size > most || memchr(text, '\0', (size_t)size) != NULL) {
        errno = size < 0 ? errno : EFBIG;
        free(text);
        return NULL;
    }
    text[size] = '\0';
    return text;
}

/* A FIFO there must not be waited for. */
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
            (void)snprintf(fault, TL_BOX_FAULT, "nothing of %.300s counts: %s", path, strerror(errno));
        }
        return NULL;
    }
    char *text = NULL;
    if (!is_guarded(&about)) {
        (void)snprintf(fault, TL_BOX_FAULT, "nothing of %.300s counts: others than root may write it", path);
    } else if ((text = read_all(file, TL_BOX_LIST_MOST)) == NULL) {
        (void)snprintf(fault, TL_BOX_FAULT, "nothing of %.300s counts: it is no text of %d bytes at most", path,
                       (int)TL_BOX_LIST_MOST);
    } else if (!is_list(text, &error)) {
        (void)snprintf(fault, TL_BOX_FAULT, "nothing of %.200s counts: %.200s", path, error.text);
        free(text);
        text = NULL;
    }
    (void)close(file);
    return text;
}

/* ---- the configuration's file ---- */

char *tl_box_read_file(const char *path) {
    struct stat about;
    int file = open_ordinary(path, &about);
    if (file < 0) {
        return NULL;
    }
    char *text = read_all(file, TL_CONTROL_MOST);
    (void)close(file);
    return text;
}
