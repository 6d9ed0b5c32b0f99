/* A flat folder of files. */
#include "tests/support/scratch.h"

#include <dirent.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

void tl_scratch_make(tl_scratch *scratch, const char *parent, const char *name) {
    (void)snprintf(scratch->folder, sizeof scratch->folder, "%s/%s_XXXXXX", parent, name);
    if (mkdtemp(scratch->folder) == NULL) {
        perror(scratch->folder);
        exit(EXIT_FAILURE); // NOLINT(concurrency-mt-unsafe): before any thread
    }
}

const char *tl_scratch_path(tl_scratch *scratch, const char *name) {
    if (snprintf(scratch->path, sizeof scratch->path, "%s/%s", scratch->folder, name) >= PATH_MAX) {
        abort();
    }
    return scratch->path;
}

/* Returns the number of files, and calls `visit` for each. NULL: only counts. */
static int walk(const char *folder, int (*visit)(const char *path)) {
    char path[PATH_MAX];
    int count = 0;
    DIR *listing = opendir(folder);
    if (listing == NULL) {
        return -1;
    }
    for (struct dirent *entry = readdir(listing); entry != NULL; entry = readdir(listing)) {
        if (strcmp(entry->d_name, ".") != 0 && strcmp(entry->d_name, "..") != 0 &&
            snprintf(path, sizeof path, "%s/%s", folder, entry->d_name) < PATH_MAX) {
            count++;
            if (visit != NULL) {
                (void)visit(path);
            }
        }
    }
    (void)closedir(listing);
    return count;
}

void tl_scratch_empty(tl_scratch *scratch) {
    (void)walk(scratch->folder, remove);
}

int tl_scratch_count(const tl_scratch *scratch) {
    return walk(scratch->folder, NULL);
}

void tl_scratch_remove(tl_scratch *scratch) {
    tl_scratch_empty(scratch);
    (void)rmdir(scratch->folder);
}

int tl_scratch_finish(tl_scratch *scratch, int failures) {
    tl_scratch_remove(scratch);
    return failures;
}
