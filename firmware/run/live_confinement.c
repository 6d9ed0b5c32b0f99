/* The confinement of `run`: see live_confinement.h. */
#include "firmware/run/live_confinement.h"

#include <libgen.h>
#include <limits.h>
#include <poll.h>
#include <pthread.h>
#include <sched.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include "firmware/base/clock.h"
#include "firmware/base/log.h"
#include "firmware/base/side_thread.h"
#include "firmware/confine/limits.h"
#include "firmware/process/host_state.h"
#include "firmware/process/private_folder.h"
#include "firmware/process/process_end.h"
#include "firmware/twin/fmu_refusals.h"
#include "firmware/twin/twin_places.h"

/* Where names of hosts are looked up, and what a box has that manages its network; which boot this is. */
static const char *const common[] = {
    "/etc",      "/run/systemd/resolve",           "/run/resolvconf", "/run/NetworkManager", "/run/connman",
    "/run/nscd", "/proc/sys/kernel/random/boot_id"};

enum { COMMON = sizeof common / sizeof common[0], FOLDERS_OF_A_FILE = 2 };

/* Texts of ours. */
typedef struct places {
    char **path;
    size_t count;
} places;

struct tl_live_confinement {
    tl_private_folder folder;
    char parent[PATH_MAX]; /* in which that is */
    tl_twin_places fmus;   /* what FMUs may read */
    places read;           /* what the others may, FMUs' places included */
    places write;
    bool shares_folder; /* the current folder is that of the whole process */
    tl_confine_facts facts;
    int listener; /* -1: none */
    int wake;     /* eventfd: the thread that answers is to look at what follows */
    bool stop;    /* it is to end, */
    bool give_up; /* and to remove the folder first */
    bool removed;
    pthread_t thread;
    bool is_started;      /* that thread */
    pthread_mutex_t lock; /* of the refusals */
    tl_fmu_refusals refusals;
    size_t told;
};

/* ---- places ---- */

static void free_places(places *list) {
    for (size_t i = 0; i < list->count; i++) {
        free(list->path[i]);
    }
    free(list->path);
    *list = (places){.path = NULL};
}

/* Room for all that add() is called with. */
static bool make_places(places *list, size_t most) {
    list->path = calloc(most, sizeof *list->path);
    return list->path != NULL;
}

static void add(places *list, const char *path) {
    char *found = realpath(path, NULL);
    if (found != NULL) {
        list->path[list->count++] = found;
    }
}

/* The folder of a file that may come later, or anew: that folder, or the nearest one above that is there. */
static void add_folder(places *list, const char *file) {
    char path[PATH_MAX];
    (void)snprintf(path, sizeof path, "%s", file);
    size_t before = list->count;
    char *folder = dirname(path);
    add(list, folder);
    while (list->count == before && strcmp(folder, "/") != 0 && strcmp(folder, ".") != 0) {
        folder = dirname(folder);
        add(list, folder);
    }
}

/* Also where a link leads to now. */
static void add_folders(places *list, const char *file) {
    char *found = realpath(file, NULL);
    add_folder(list, file);
    if (found != NULL) {
        add_folder(list, found);
    }
    free(found);
}

/* A device that is unplugged and plugged in has a new entry in /dev, to which links of other places lead. */
static void add_source(tl_live_confinement *self, const tl_config *config, const tl_config_source *source) {
    char path[PATH_MAX];
    if (source->kind == TL_SOURCE_CSV && tl_config_file_path(config, source->file, path, sizeof path)) {
        add_folders(&self->read, path);
    }
    if (source->kind == TL_SOURCE_MODBUS_RTU && tl_config_file_path(config, source->line.device, path, sizeof path)) {
        add_folders(&self->write, path);
    }
    if (source->kind == TL_SOURCE_MODBUS_RTU || source->kind == TL_SOURCE_GPIO) {
        add(&self->write, "/dev");
    }
    if (source->kind == TL_SOURCE_GPIO) { /* where libgpiod looks whether a device is a chip */
        add(&self->read, "/sys");
    }
}

static tl_status find_places(tl_live_confinement *self, const tl_assembly *assembly, const char *database,
                             tl_error *error) {
    enum { PER_SOURCE = FOLDERS_OF_A_FILE + 1 };
    const tl_config *config = &assembly->config;
    tl_twin_places_find(assembly, &self->fmus);
    if (!make_places(&self->read, self->fmus.count + COMMON + config->component_count +
                                      config->source_count * (FOLDERS_OF_A_FILE + 1)) ||
        !make_places(&self->write, 1 + FOLDERS_OF_A_FILE + config->source_count * PER_SOURCE)) {
        return tl_fail(error, TL_TRY_AGAIN, "not enough memory");
    }
    add(&self->write, self->folder.path);
    if (database != NULL) {
        add_folders(&self->write, database);
    }
    for (size_t i = 0; i < COMMON; i++) {
        add(&self->read, common[i]);
    }
    for (size_t i = 0; i < self->fmus.count; i++) {
        add(&self->read, self->fmus.path[i]);
    }
    for (size_t i = 0; i < config->component_count; i++) { /* the record says which FMUs they were */
        if (assembly->files[i].path != NULL) {
            add(&self->read, assembly->files[i].path);
        }
    }
    for (size_t i = 0; i < config->source_count; i++) {
        add_source(self, config, &config->sources[i]);
    }
    return TL_OK;
}

/* ---- the two lists ---- */

/* Of the threads that are not the FMUs'. */
static tl_confine_settings settings_of_others(const tl_live_confinement *self) {
    return (tl_confine_settings){
        .read = (const char *const *)self->read.path,
        .read_count = self->read.count,
        .write = (const char *const *)self->write.path,
        .write_count = self->write.count,
        .clear = self->parent,
        .memory = tl_confine_fair_memory(),
        .start_socket = -1,
        .may_connect = true,
        .lives_on = true,
        .calls_later = true,
    };
}

static tl_confine_settings settings_of_fmus(const tl_live_confinement *self) {
    return (tl_confine_settings){
        .folder = self->folder.path,
        .read = (const char *const *)self->fmus.path,
        .read_count = self->fmus.count,
        .memory = tl_confine_fair_memory(),
        .start_socket = -1,
        .lives_on = true,
    };
}

static tl_status begin(tl_live_confinement *self, const tl_assembly *assembly, const char *database, tl_error *error) {
    enum { NICE_0 = 20 }; /* as RLIMIT_NICE counts */
    char path[PATH_MAX];
    tl_confine_facts facts;
    tl_status status = tl_private_folder_make(TL_LIVE_CONFINEMENT_KIND, 0, &self->folder, error);
    if (status != TL_OK) {
        return status;
    }
    (void)snprintf(path, sizeof path, "%s", self->folder.path);
    (void)snprintf(self->parent, sizeof self->parent, "%s", dirname(path));
    tl_private_folder_leave(); /* what FMUs have in it goes with it: their thread may have lost the right to remove it */
    status = find_places(self, assembly, database, error);
    if (status != TL_OK) {
        return status;
    }
    if (setenv("TMPDIR", self->folder.path, 1) != 0) {
        return tl_fail(error, TL_TRY_AGAIN, "not enough memory");
    }
    /* A thread without capabilities may put back what an FMU has done to its priority. */
    tl_limits_permit(RLIMIT_RTPRIO, (rlim_t)assembly->config.realtime_priority);
    tl_limits_permit(RLIMIT_NICE, NICE_0);
    const tl_confine_settings settings = settings_of_others(self);
    return tl_confine(&settings, &facts, NULL, error);
}

tl_status tl_live_confinement_begin(const tl_assembly *assembly, const char *database,
                                    tl_live_confinement **confinement, tl_error *error) {
    tl_live_confinement *made = calloc(1, sizeof *made);
    *confinement = NULL;
    if (made == NULL) {
        return tl_fail(error, TL_TRY_AGAIN, "not enough memory");
    }
    made->listener = -1;
    tl_refusal_prepare();
    made->wake = eventfd(0, EFD_CLOEXEC);
    (void)pthread_mutex_init(&made->lock, NULL);
    tl_status status = made->wake >= 0 ? begin(made, assembly, database, error)
                                       : tl_fail(error, TL_TRY_AGAIN,
                                                 "no descriptor for the thread that answers what FMUs are refused");
    if (status != TL_OK) {
        tl_live_confinement_end(made);
        return status;
    }
    *confinement = made;
    return TL_OK;
}

/* A current folder of this thread's own, which those that it starts share: relative names of ours stay what they were. */
tl_status tl_live_confinement_enter(tl_live_confinement *self, tl_error *error) {
    tl_confine_settings settings = settings_of_fmus(self);
    const char *const folder[] = {self->folder.path};
    self->shares_folder = unshare(CLONE_FS) != 0;
    if (self->shares_folder) { /* a container's filter may refuse that */
        settings.folder = NULL;
        settings.write = folder;
        settings.write_count = 1;
    }
    tl_status status = tl_confine(&settings, &self->facts, &self->listener, error);
    tl_host_state_keep_anew();
    return status;
}

/* ---- the thread that answers ---- */

/* Whoever ends this process may be the thread of the FMUs, by an FMU's exit(), and that may remove nothing. */
static tl_live_confinement *removed_by_thread;

static void tell_thread(tl_live_confinement *self, bool *what) {
    const uint64_t one = 1;
    __atomic_store_n(what, true, __ATOMIC_RELEASE);
    (void)!write(self->wake, &one, sizeof one);
}

static void remove_by_thread(void) {
    enum { LOOKS = 2000 };
    tl_live_confinement *self = removed_by_thread;
    tell_thread(self, &self->give_up);
    for (int i = 0; i < LOOKS && !__atomic_load_n(&self->removed, __ATOMIC_ACQUIRE); i++) {
        tl_clock_sleep_until(tl_clock_now(NULL) + TL_SECOND / 1000);
    }
}

static void *answer(void *context) {
    tl_live_confinement *self = context;
    enum { WAKE, LISTENER, WATCHED };
    struct pollfd watched[WATCHED] = {
        [WAKE] = {.fd = self->wake, .events = POLLIN}, [LISTENER] = {.fd = self->listener, .events = POLLIN}};
    while (!__atomic_load_n(&self->stop, __ATOMIC_ACQUIRE) && !__atomic_load_n(&self->give_up, __ATOMIC_ACQUIRE)) {
        (void)poll(watched, WATCHED, -1);
        if ((watched[LISTENER].revents & (POLLHUP | POLLERR)) != 0) {
            watched[LISTENER].fd = -1; /* the thread of the FMUs has ended */
        }
        tl_refusal refusal;
        for (int i = 0; i < 64 && tl_refusal_take(self->listener, &refusal); i++) {
            (void)pthread_mutex_lock(&self->lock);
            (void)tl_fmu_refusals_note(&self->refusals, &refusal, tl_fmu_calls_here());
            (void)pthread_mutex_unlock(&self->lock);
            tl_refusal_answer(self->listener, &refusal);
        }
    }
    if (__atomic_load_n(&self->give_up, __ATOMIC_ACQUIRE)) {
        tl_private_folder_remove(&self->folder);
        __atomic_store_n(&self->removed, true, __ATOMIC_RELEASE);
    }
    return NULL;
}

tl_status tl_live_confinement_finish(tl_live_confinement *self, tl_error *error) {
    const tl_confine_settings settings = settings_of_others(self);
    tl_confine_facts facts;
    tl_status status = tl_confine_calls(&settings, &facts, NULL, error);
    if (status != TL_OK) {
        return status;
    }
    int failure = tl_side_thread_start(&self->thread, 0, answer, self);
    self->is_started = failure == 0;
    if (self->is_started) {
        removed_by_thread = self;
        tl_process_remove_by(remove_by_thread);
    }
    return failure == 0
               ? TL_OK
               : tl_fail(error, TL_TRY_AGAIN, "no thread that answers what FMUs are refused: %s", strerror(failure));
}

/* ---- tell ---- */

void tl_live_confinement_describe(const tl_live_confinement *self, char text[TL_LIVE_CONFINEMENT_TEXT]) {
    tl_confine_describe(&self->facts, text);
    if (self->shares_folder) {
        size_t used = strlen(text);
        (void)snprintf(text + used, TL_LIVE_CONFINEMENT_TEXT - used,
                       "%sthe current folder of FMUs is the program's, where they may not write: unshare() is refused",
                       used > 0 ? "; " : "");
    }
}

static void tell_journal(void *context, const char *text) {
    tl_journal_event(context, -1, TL_EVENT_WARNING, "twin", "%s", text);
}

static void tell_log(void *context, const char *text) {
    (void)context;
    tl_log(TL_LOG_WARNING, "%s", text);
}

/* Nobody holds the lock while he does what may wait for an FMU: that may wait for an answer, for which the lock is taken. */
static const char *next(tl_live_confinement *self) {
    (void)pthread_mutex_lock(&self->lock);
    const char *said = tl_fmu_refusals_next(&self->refusals, &self->told);
    (void)pthread_mutex_unlock(&self->lock);
    return said;
}

static void tell(tl_live_confinement *self, tl_fmu_refusals_listener *hear, void *context) {
    const char *said = NULL;
    while ((said = next(self)) != NULL) {
        hear(context, said);
    }
}

void tl_live_confinement_tell(tl_live_confinement *self, tl_journal *journal) {
    tell(self, tell_journal, journal);
}

void tl_live_confinement_end(tl_live_confinement *self) {
    if (self == NULL) {
        return;
    }
    if (self->is_started) {
        tl_process_remove_by(NULL);
        tell_thread(self, &self->stop);
        (void)pthread_join(self->thread, NULL);
    }
    tell(self, tell_log, NULL);
    tl_private_folder_remove(&self->folder);
    tl_twin_places_free(&self->fmus);
    free_places(&self->read);
    free_places(&self->write);
    if (self->listener >= 0) {
        (void)close(self->listener);
    }
    if (self->wake >= 0) {
        (void)close(self->wake);
    }
    (void)pthread_mutex_destroy(&self->lock);
    free(self);
}
