/* The folder of an inbox: see inbox_folder.h. */
#include "firmware/retune/inbox_folder.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <sys/inotify.h>
#include <sys/stat.h>
#include <unistd.h>

#include "firmware/base/clock.h"

/* A writer that has made a file under its name writes to it within that, or has not written anything. */
static const tl_time YOUTH = TL_SECOND;

enum { EVENTS_OF_A_READ = 16 * 1024 };
static const uint32_t EVENTS =
    IN_MOVED_TO | IN_CREATE | IN_MODIFY | IN_CLOSE_WRITE | IN_DELETE_SELF | IN_MOVE_SELF | IN_ONLYDIR;

bool tl_inbox_folder_wants(const char *name) {
    static const char end[] = ".json";
    size_t length = strlen(name);
    return name[0] != '.' && length > strlen(end) && length + strlen(TL_INBOX_RESULT) + 1 <= NAME_MAX &&
           strcmp(name + length - strlen(end), end) == 0;
}

/* ---- what is remembered ---- */

static void forget(tl_inbox_folder *self, size_t i) {
    self->count--;
    memmove(&self->files[i], &self->files[i + 1], (self->count - i) * sizeof self->files[0]);
}

/* `count` if there is none. */
static size_t find(const tl_inbox_folder *self, const char *name) {
    size_t i = 0;
    while (i < self->count && strcmp(self->files[i].name, name) != 0) {
        i++;
    }
    return i;
}

/* The first that is, or is not, being written; `count` if there is none. */
static size_t find_written(const tl_inbox_folder *self, bool is_written) {
    size_t i = 0;
    while (i < self->count && (self->files[i].state == TL_INBOX_WRITING) != is_written) {
        i++;
    }
    return i;
}

/* As the newest. If there is no room: in place of one of which we only know that it is not complete; else it is looked for later. */
static void remember(tl_inbox_folder *self, const char *name, tl_inbox_state state) {
    size_t known = find(self, name);
    if (known == self->count && self->count == TL_INBOX_WAITING) {
        known = find_written(self, true);
    }
    if (known < self->count) {
        forget(self, known);
    }
    if (self->count == TL_INBOX_WAITING) {
        self->is_incomplete = true;
        return;
    }
    tl_inbox_file *file = &self->files[self->count++];
    *file = (tl_inbox_file){.state = state, .ready = tl_clock_now(NULL) + (state == TL_INBOX_YOUNG ? YOUTH : 0)};
    (void)snprintf(file->name, sizeof file->name, "%s", name);
}

/* The folder's regular files that are wanted, not empty and not known to be incomplete, as far as there is room. */
static void look_through(tl_inbox_folder *self) {
    int copy = openat(self->descriptor, ".", O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    DIR *list = copy < 0 ? NULL : fdopendir(copy);
    self->is_incomplete = false;
    if (list == NULL) {
        if (copy >= 0) {
            (void)close(copy);
        }
        return;
    }
    for (const struct dirent *entry = readdir(list); entry != NULL && !self->is_incomplete; entry = readdir(list)) {
        struct stat about;
        if (tl_inbox_folder_wants(entry->d_name) && find(self, entry->d_name) == self->count &&
            fstatat(self->descriptor, entry->d_name, &about, AT_SYMLINK_NOFOLLOW) == 0 && S_ISREG(about.st_mode) &&
            about.st_size > 0) {
            remember(self, entry->d_name, TL_INBOX_YOUNG);
        }
    }
    (void)closedir(list);
}

/* ---- what the kernel tells ---- */

static void take_event(tl_inbox_folder *self, const struct inotify_event *event) {
    if ((event->mask & (IN_DELETE_SELF | IN_MOVE_SELF | IN_UNMOUNT | IN_IGNORED)) != 0) {
        self->is_gone = true;
    } else if ((event->mask & IN_Q_OVERFLOW) != 0) {
        self->is_incomplete = true;
    } else if (event->len == 0 || !tl_inbox_folder_wants(event->name)) {
        return;
    } else if ((event->mask & IN_MOVED_TO) != 0) {
        remember(self, event->name, TL_INBOX_RENAMED);
    } else if ((event->mask & IN_CREATE) != 0) {
        remember(self, event->name, TL_INBOX_YOUNG);
    } else {
        remember(self, event->name, (event->mask & IN_CLOSE_WRITE) != 0 ? TL_INBOX_WRITTEN : TL_INBOX_WRITING);
    }
}

static void take_events(tl_inbox_folder *self) {
    union {
        struct inotify_event first;
        char bytes[EVENTS_OF_A_READ];
    } room;
    ssize_t size = read(self->events, room.bytes, sizeof room.bytes);
    while (size > 0) {
        for (ssize_t at = 0; at < size;) {
            const struct inotify_event *event = (const struct inotify_event *)(const void *)(room.bytes + at);
            take_event(self, event);
            at += (ssize_t)(sizeof *event + event->len);
        }
        size = read(self->events, room.bytes, sizeof room.bytes);
    }
}

/* ---- its life ---- */

tl_status tl_inbox_folder_open(const char *path, tl_inbox_folder *folder, tl_error *error) {
    *folder = (tl_inbox_folder){.events = -1};
    folder->descriptor = open(path, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (folder->descriptor < 0) {
        return tl_fail(error, TL_BAD_DATA, "%.300s: is no folder that can be read: %s", path, strerror(errno));
    }
    folder->events = inotify_init1(IN_NONBLOCK | IN_CLOEXEC);
    if (folder->events < 0 || inotify_add_watch(folder->events, path, EVENTS) < 0) {
        tl_status status = tl_fail(error, TL_TRY_AGAIN, "%.300s: cannot be watched: %s", path, strerror(errno));
        tl_inbox_folder_close(folder);
        return status;
    }
    look_through(folder);
    return TL_OK;
}

/* A link has its content at once; what was made and is empty still is being written. */
static bool is_complete(const tl_inbox_folder *self, const tl_inbox_file *file) {
    struct stat about;
    return file->state != TL_INBOX_YOUNG || (fstatat(self->descriptor, file->name, &about, AT_SYMLINK_NOFOLLOW) == 0 &&
                                             !(S_ISREG(about.st_mode) && about.st_size == 0));
}

/* The first one that is ready. */
static tl_inbox_news take_ready(tl_inbox_folder *self, char name[NAME_MAX + 1]) {
    tl_time now = tl_clock_now(NULL);
    for (size_t i = 0; i < self->count;) {
        const tl_inbox_file *file = &self->files[i];
        if (file->state == TL_INBOX_WRITING || file->ready > now) {
            i++;
            continue;
        }
        tl_inbox_news news = file->state == TL_INBOX_WRITTEN ? TL_INBOX_IN_PLACE
                             : is_complete(self, file)       ? TL_INBOX_COMPLETE
                                                             : TL_INBOX_NOTHING;
        memcpy(name, file->name, sizeof file->name);
        forget(self, i);
        if (news != TL_INBOX_NOTHING) {
            return news;
        }
    }
    return TL_INBOX_NOTHING;
}

tl_inbox_news tl_inbox_folder_next(tl_inbox_folder *folder, tl_time time, char name[NAME_MAX + 1]) {
    take_events(folder);
    if (folder->is_incomplete && find_written(folder, false) == folder->count) {
        look_through(folder);
    }
    tl_inbox_news news = take_ready(folder, name);
    if (news == TL_INBOX_NOTHING && !folder->is_gone) {
        struct pollfd waited = {.fd = folder->events, .events = POLLIN};
        (void)poll(&waited, 1, (int)(time / (TL_SECOND / 1000)));
        take_events(folder);
        news = take_ready(folder, name);
    }
    return news == TL_INBOX_NOTHING && folder->is_gone ? TL_INBOX_GONE : news;
}

void tl_inbox_folder_repeat(tl_inbox_folder *folder) {
    folder->is_incomplete = true;
}

void tl_inbox_folder_close(tl_inbox_folder *folder) {
    if (folder->descriptor >= 0) {
        (void)close(folder->descriptor);
    }
    if (folder->events >= 0) {
        (void)close(folder->events);
    }
    folder->descriptor = -1;
    folder->events = -1;
}
