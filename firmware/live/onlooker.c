/* Who looks at a process: see onlooker.h. */
#include "firmware/live/onlooker.h"

#include <dirent.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

/* The first lines of a thread's status, with its name, which nobody can put a line's end into, its state and who traces it. */
enum { STATUS = 1024 };

/* What stands behind this name; "": nothing. */
static const char *find(const char *status, const char *name) {
    const char *found = strstr(status, name);
    return found != NULL ? found + strlen(name) : "";
}

static bool is_held(const char *status) {
    char state = *find(status, "\nState:\t");
    return state == 'T' || state == 't' || strtol(find(status, "\nTracerPid:\t"), NULL, 10) != 0;
}

/* One that has ended meanwhile is not held. */
static bool is_thread_held(int tasks, const char *name) {
    char path[64];
    char status[STATUS + 1];
    (void)snprintf(path, sizeof path, "%.20s/status", name);
    int file = openat(tasks, path, O_RDONLY | O_CLOEXEC);
    ssize_t length = file >= 0 ? read(file, status, STATUS) : 0;
    if (file >= 0) {
        (void)close(file);
    }
    status[length > 0 ? length : 0] = '\0';
    return is_held(status);
}

bool tl_onlooker_holds(pid_t process) {
    char path[64];
    (void)snprintf(path, sizeof path, "/proc/%ld/task", (long)process);
    DIR *tasks = opendir(path);
    bool holds = false;
    for (const struct dirent *entry = NULL; !holds && tasks != NULL && (entry = readdir(tasks)) != NULL;) {
        holds = entry->d_name[0] != '.' && is_thread_held(dirfd(tasks), entry->d_name);
    }
    if (tasks != NULL) {
        (void)closedir(tasks);
    }
    return holds;
}
