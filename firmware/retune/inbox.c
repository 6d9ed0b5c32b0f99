/* The inbox: see inbox.h. */
#include "firmware/retune/inbox.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include "firmware/base/clock.h"
#include "firmware/base/file_bytes.h"
#include "firmware/base/log.h"
#include "firmware/control/control_words.h"
#include "firmware/process/interrupt.h"
#include "firmware/retune/inbox_folder.h"
#include "firmware/retune/talk.h"
#include "firmware/retune/talk_page.h"
#include "firmware/text/clean_text.h"

static const tl_time LOOK = TL_SECOND / 2;

/* A page that grows is written at most this often. It ends with these words until it is whole. */
static const tl_time WRITING = TL_SECOND;
static const char GOES_ON[] = "… it goes on; this page grows with it\n";

/* Before a folder that cannot be written to, and a run that is not there, are tried again. */
static const tl_time PAUSE = 60 * TL_SECOND;
static const tl_time PAUSE_OF_RUN = 5 * TL_SECOND;

/* One file on its way. */
typedef struct delivery {
    bool is_open;
    char name[NAME_MAX + 1];
    char result[NAME_MAX + 1]; /* the file that says what came of it */
    char *text;                /* of that; by open_memstream() */
    size_t size;
    tl_talk_page page;
    tl_talk talk;
    size_t shown;    /* bytes of it that are in the file */
    tl_time written; /* when that was */
} delivery;

typedef struct inbox {
    const char *socket;
    tl_inbox_folder folder;
    delivery now;
    tl_time rests;  /* until then nothing is taken */
    bool is_absent; /* the run, and that was said */
    char text[TL_CONTROL_MOST + 1];
} inbox;

/* ---- results ---- */

/* Replaced whole, and never through a link that somebody has put there. */
static void write_result(const inbox *self, const char *name, const char *text) {
    char made[NAME_MAX + 8];
    (void)snprintf(made, sizeof made, ".%.240s.new", name);
    (void)unlinkat(self->folder.descriptor, made, 0);
    int file = openat(self->folder.descriptor, made, O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, 0644);
    bool is_written = file >= 0 && write(file, text, strlen(text)) == (ssize_t)strlen(text) && fsync(file) == 0;
    int code = errno;
    if (file >= 0) {
        (void)close(file);
    }
    if (is_written && renameat(self->folder.descriptor, made, self->folder.descriptor, name) == 0) {
        return;
    }
    code = is_written ? errno : code;
    (void)unlinkat(self->folder.descriptor, made, 0);
    tl_log(TL_LOG_WARNING, "%s cannot be written: %s; it would say: %s", name, strerror(code), text);
}

static void name_result(const char *name, char result[NAME_MAX + 1]) {
    (void)snprintf(result, NAME_MAX + 1, "%.*s%s", (int)(NAME_MAX - strlen(TL_INBOX_RESULT)), name, TL_INBOX_RESULT);
}

static void name_taken(const char *name, char taken[NAME_MAX + 1]) {
    (void)snprintf(taken, NAME_MAX + 1, "%.*s%s", (int)(NAME_MAX - strlen(TL_INBOX_TAKEN)), name, TL_INBOX_TAKEN);
}

/* Without a word of the run. */
static void tell(const inbox *self, const char *name, const char *what, const char *why) {
    char result[NAME_MAX + 1];
    char text[512];
    name_result(name, result);
    (void)snprintf(text, sizeof text, "%s: %s\n", what, why);
    tl_log(TL_LOG_WARNING, "%s: %s: %s", name, what, why);
    write_result(self, result, text);
}

static void refuse(const inbox *self, const char *name, const char *why) {
    tell(self, name, "not taken", why);
}

/* ---- a delivery ---- */

static void hear(void *context, const tl_control_reply *reply) {
    const delivery *self = context;
    tl_talk_page_print(&self->page, reply);
    if (reply->kind == TL_CONTROL_END) {
        const tl_control_end *end = &reply->as.end;
        bool is_well = tl_control_exit_code((tl_control_result)end->result) == 0;
        tl_log(is_well ? TL_LOG_NOTICE : TL_LOG_WARNING, "%s: %s%s%s", self->name,
               tl_control_result_name((tl_control_result)end->result), end->text[0] == '\0' ? "" : ": ", end->text);
    }
}

static void write_page(const inbox *self, const delivery *done) {
    (void)fflush(done->page.output);
    write_result(self, done->result, done->text);
}

/* As far as it is, if there is more of it than the last time. */
static void write_growing_page(const inbox *self, delivery *it) {
    tl_time now = tl_clock_now(NULL);
    (void)fflush(it->page.output);
    if (it->size == it->shown || (it->shown != 0 && now - it->written < WRITING)) {
        return;
    }
    char *text = malloc(it->size + sizeof GOES_ON);
    if (text != NULL) {
        memcpy(text, it->text, it->size);
        memcpy(text + it->size, GOES_ON, sizeof GOES_ON);
        write_result(self, it->result, text);
    }
    free(text);
    it->shown = it->size;
    it->written = now;
}

static void end_delivery(inbox *self) {
    delivery *done = &self->now;
    if (!done->is_open) {
        return;
    }
    tl_talk_close(&done->talk);
    write_page(self, done);
    (void)fclose(done->page.output);
    free(done->text);
    *done = (delivery){.is_open = false};
}

static void look_at_delivery(inbox *self, tl_time time) {
    delivery *it = &self->now;
    tl_error error;
    if (tl_talk_look(&it->talk, time, &error) != TL_OK) {
        tl_log(TL_LOG_WARNING, "%s: %s", it->name, error.text);
        (void)fprintf(it->page.output, "%s\n", error.text);
        end_delivery(self);
    } else if (it->talk.ended) {
        end_delivery(self);
    } else {
        write_growing_page(self, it);
    }
}

static void fill_request(const inbox *self, const char *name, uid_t owner, tl_control_request *request) {
    (void)self;
    memset(request, 0, sizeof *request);
    request->verb = TL_CONTROL_TAKE;
    request->right = TL_CONTROL_MAY_RETUNE;
    request->origin = TL_CONTROL_BY_INBOX;
    request->flags = TL_CONTROL_WAIT;
    request->require_lock = -1.0;
    tl_talk_name(owner, request->who);
    (void)tl_clean_text(name, strlen(name), request->why, sizeof request->why);
}

/* The one that is on probation hears that another takes its place, and is told so: that comes at once. */
static void give_way(inbox *self) {
    for (int i = 0; i < 4 && self->now.is_open; i++) {
        look_at_delivery(self, LOOK);
    }
    if (self->now.is_open) {
        (void)fputs("another configuration came; `twinlock reload --versions` shows what came of this one\n",
                    self->now.page.output);
        end_delivery(self);
    }
}

static void deliver(inbox *self, const char *name, uid_t owner, size_t size, delivery *next) {
    tl_control_request request;
    tl_error error;
    fill_request(self, name, owner, &request);
    if (tl_talk_ask(&next->talk, &request, self->text, size, &error) != TL_OK) {
        tl_talk_close(&next->talk);
        refuse(self, name, error.text);
        return;
    }
    give_way(self);
    self->now = *next;
    delivery *it = &self->now;
    it->is_open = true;
    (void)snprintf(it->name, sizeof it->name, "%s", name);
    name_result(name, it->result);
    it->talk.settings.context = it;
    it->page = (tl_talk_page){.subject = it->name, .output = open_memstream(&it->text, &it->size)};
    if (it->page.output == NULL) {
        tl_talk_close(&it->talk);
        it->is_open = false;
        refuse(self, name, "not enough memory to hear what comes of it; `twinlock reload --versions` shows that");
    }
}

/* ---- taking ---- */

static void rest(inbox *self, tl_time time) {
    self->rests = tl_clock_now(NULL) + time;
    tl_inbox_folder_repeat(&self->folder);
}

/* From here on it is not taken again. False: the folder does not let us, or it is gone. */
static bool put_aside(inbox *self, const char *name) {
    char taken[NAME_MAX + 1];
    char result[NAME_MAX + 1];
    name_taken(name, taken);
    name_result(name, result);
    if (renameat(self->folder.descriptor, name, self->folder.descriptor, taken) != 0) {
        if (errno == EISDIR || errno == ENOTEMPTY || errno == EEXIST) {
            tl_log(TL_LOG_WARNING, "%s: %s is a folder: not taken", name, taken);
        } else if (errno != ENOENT) {
            tl_log(TL_LOG_ERROR, "%s cannot be renamed: %s; nothing is taken for %d s", name, strerror(errno),
                   (int)(PAUSE / TL_SECOND));
            rest(self, PAUSE);
        }
        return false;
    }
    (void)unlinkat(self->folder.descriptor, result, 0); /* of an earlier one of this name */
    return true;
}

/* Its bytes; < 0: it is none of what is taken, and that was said. *owner: whose it is. */
static ssize_t read_taken(inbox *self, const char *name, uid_t *owner) {
    char taken[NAME_MAX + 1];
    struct stat about;
    ssize_t size = -1;
    name_taken(name, taken);
    int file = openat(self->folder.descriptor, taken, O_RDONLY | O_NOFOLLOW | O_NONBLOCK | O_NOCTTY | O_CLOEXEC);
    if (file < 0 || fstat(file, &about) != 0) {
        refuse(self, name, strerror(errno));
    } else if (!S_ISREG(about.st_mode) || about.st_nlink != 1) {
        refuse(self, name, "it is no ordinary file, or has another name elsewhere");
    } else if (about.st_size < 1 || about.st_size > TL_CONTROL_MOST) {
        refuse(self, name, "a configuration has 1 to 262144 bytes");
    } else {
        *owner = about.st_uid;
        size = tl_file_bytes_read(file, self->text, sizeof self->text);
        if (size < 1 || size > TL_CONTROL_MOST) {
            refuse(self, name, size < 0 ? strerror(errno) : "it changes while it is read");
            size = -1;
        }
    }
    if (file >= 0) {
        (void)close(file);
    }
    return size;
}

/* The run must be there before the file is touched: it waits in its place for one that is not. */
static void take(inbox *self, const char *name) {
    struct stat about;
    static delivery next;
    tl_error error;
    uid_t owner = 0;
    if (fstatat(self->folder.descriptor, name, &about, AT_SYMLINK_NOFOLLOW) != 0) {
        return;
    }
    if (!S_ISREG(about.st_mode)) {
        tl_log(TL_LOG_WARNING, "%s is no ordinary file: it is left where it is", name);
        return;
    }
    next = (delivery){.is_open = false};
    const tl_talk_settings settings = {.path = self->socket, .hear = hear, .context = &next};
    if (tl_talk_open(&next.talk, &settings, &error) != TL_OK) {
        if (!self->is_absent) {
            tl_log(TL_LOG_WARNING, "%s waits: %s", name, error.text);
        }
        self->is_absent = true;
        rest(self, PAUSE_OF_RUN);
        return;
    }
    self->is_absent = false;
    ssize_t size = put_aside(self, name) ? read_taken(self, name, &owner) : -1;
    if (size < 0) {
        tl_talk_close(&next.talk);
        return;
    }
    deliver(self, name, owner, (size_t)size, &next);
}

/* Whoever writes it under its name shall know why nothing happens. */
static void refuse_written(inbox *self, const char *name) {
    struct stat about;
    if (fstatat(self->folder.descriptor, name, &about, AT_SYMLINK_NOFOLLOW) == 0 && S_ISREG(about.st_mode) &&
        put_aside(self, name)) {
        refuse(self, name,
               "it was written under this name, so nobody can know when it was complete: upload it as "
               "NAME.json.part, and rename it then");
    }
}

/* ---- what an inbox that was interrupted has left ---- */

/* There is none, or it was growing when nobody wrote it any more. What else is there is somebody's. */
static bool is_unfinished(const inbox *self, const char *result) {
    char end[sizeof GOES_ON] = "";
    struct stat about;
    int file = openat(self->folder.descriptor, result, O_RDONLY | O_NOFOLLOW | O_NONBLOCK | O_NOCTTY | O_CLOEXEC);
    if (file < 0) {
        return errno == ENOENT;
    }
    size_t length = sizeof GOES_ON - 1;
    bool is_read = fstat(file, &about) == 0 && S_ISREG(about.st_mode) && about.st_size >= (off_t)length &&
                   pread(file, end, length, about.st_size - (off_t)length) == (ssize_t)length;
    (void)close(file);
    return is_read && strcmp(end, GOES_ON) == 0;
}

static bool is_left(const inbox *self, const char *taken, char name[NAME_MAX + 1]) {
    char result[NAME_MAX + 1];
    size_t length = strlen(taken);
    if (length <= strlen(TL_INBOX_TAKEN) || strcmp(taken + length - strlen(TL_INBOX_TAKEN), TL_INBOX_TAKEN) != 0) {
        return false;
    }
    (void)snprintf(name, NAME_MAX + 1, "%.*s", (int)(length - strlen(TL_INBOX_TAKEN)), taken);
    name_result(name, result);
    return tl_inbox_folder_wants(name) && is_unfinished(self, result);
}

static void tell_left(const inbox *self) {
    char name[NAME_MAX + 1];
    int copy = openat(self->folder.descriptor, ".", O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    DIR *list = copy < 0 ? NULL : fdopendir(copy);
    for (const struct dirent *entry = list == NULL ? NULL : readdir(list); entry != NULL; entry = readdir(list)) {
        if (is_left(self, entry->d_name, name)) {
            tell(self, name, "interrupted",
                 "the inbox ended before it heard what came of it; `twinlock reload --versions` shows whether it came");
        }
    }
    if (list != NULL) {
        (void)closedir(list);
    } else if (copy >= 0) {
        (void)close(copy);
    }
}

/* ---- its life ---- */

/* False: the folder is gone. */
static bool look_at_folder(inbox *self, tl_time time) {
    char name[NAME_MAX + 1];
    switch (tl_inbox_folder_next(&self->folder, time, name)) {
    case TL_INBOX_COMPLETE:
        take(self, name);
        break;
    case TL_INBOX_IN_PLACE:
        refuse_written(self, name);
        break;
    case TL_INBOX_GONE:
        return false;
    case TL_INBOX_NOTHING:
        break;
    }
    return true;
}

static bool work(inbox *self) {
    bool is_free = !self->now.is_open || self->now.talk.is_tried;
    tl_time rests = self->rests - tl_clock_now(NULL);
    if (self->now.is_open) {
        look_at_delivery(self, LOOK);
    } else if (rests > 0) {
        const struct timespec pause = {.tv_nsec = (long)LOOK};
        (void)nanosleep(&pause, NULL);
    }
    return !is_free || rests > 0 || look_at_folder(self, self->now.is_open ? 0 : LOOK);
}

tl_status tl_inbox_run(const char *folder, const char *socket, tl_error *error) {
    static inbox self; /* it is large */
    self = (inbox){.socket = socket};
    tl_status status = tl_inbox_folder_open(folder, &self.folder, error);
    if (status != TL_OK) {
        return status;
    }
    tell_left(&self);
    while (status == TL_OK && tl_interrupt_requested() == NULL) {
        if (!work(&self)) {
            status = tl_fail(error, TL_TRY_AGAIN, "%.300s: the folder is gone", folder);
        }
    }
    if (self.now.is_open) {
        (void)fputs("the inbox ended; `twinlock reload --versions` shows what came of it\n", self.now.page.output);
        end_delivery(&self);
    }
    tl_inbox_folder_close(&self.folder);
    return status;
}
