/* A file with other letters' case: see other_case.h. */
#include "firmware/base/other_case.h"

#include <dirent.h>
#include <limits.h>
#include <stdio.h>
#include <string.h>
#include <strings.h>
#include <unistd.h>

/* The folder of a path as one that can be opened. */
static DIR *open_folder(const char *path, size_t length) {
    char folder[PATH_MAX];
    if (length >= sizeof folder) {
        return NULL;
    }
    (void)snprintf(folder, sizeof folder, "%.*s", (int)length, path);
    return opendir(length == 0 ? "." : folder);
}

const char *tl_other_case(const char *path, char text[TL_OTHER_CASE_TEXT]) {
    const char *slash = strrchr(path, '/');
    const char *name = slash != NULL ? slash + 1 : path;
    text[0] = '\0';
    DIR *folder = access(path, F_OK) == 0 ? NULL : open_folder(path, (size_t)(name - path));
    for (const struct dirent *entry = NULL; folder != NULL && (entry = readdir(folder)) != NULL;) {
        if (strcasecmp(entry->d_name, name) == 0) {
            (void)snprintf(text, TL_OTHER_CASE_TEXT, "; there is %s beside it, with other letters' case",
                           entry->d_name);
            break;
        }
    }
    if (folder != NULL) {
        (void)closedir(folder);
    }
    return text;
}
