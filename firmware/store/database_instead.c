/* Which file is written: see database_instead.h. */
#include "firmware/store/database_instead.h"

#include <fcntl.h>
#include <libgen.h>
#include <stdio.h>
#include <unistd.h>

#include "firmware/base/os.h"
#include "firmware/store/database.h"
#include "firmware/store/database_sql.h"

enum { DENIALS = 60 }; /* that are not believed */
static const tl_time DENIAL_PAUSE = TL_SECOND / 1000;
static const tl_time DENIAL_PAUSE_LAST = TL_SECOND / 64;

static bool is_refused(tl_database_insistence insistence, tl_database_fault fault) {
    bool is_ours = fault != TL_DATABASE_FOREIGN && fault != TL_DATABASE_OTHER && fault != TL_DATABASE_TAKEN;
    return insistence == TL_DATABASE_ALL_OR_NOTHING || (insistence == TL_DATABASE_IF_OURS && !is_ours);
}

static bool is_waited_for(tl_database_fault fault) {
    return fault == TL_DATABASE_LATER || fault == TL_DATABASE_TAKEN;
}

/* Which file the others are beside: links resolved. */
static const char *find_place(const char *given, char place[PATH_MAX]) {
    return tl_database_place(given, place, NULL) == TL_OK ? place : given;
}

/* Nothing can be written in its folder. Then no name beside it can be either, unless the folder is opened meanwhile, and then the file itself
 * can be. */
static bool is_shut_in(const char *path) {
    char copy[PATH_MAX];
    (void)snprintf(copy, sizeof copy, "%s", path);
    return faccessat(AT_FDCWD, dirname(copy), W_OK | X_OK, AT_EACCESS) != 0;
}

/* It is denied, and its mode does not say so: what is beside it is somebody else's, for as long as that one needs. */
static bool is_writable(const char *path) {
    return faccessat(AT_FDCWD, path, W_OK, AT_EACCESS) == 0;
}

/* One file, which `place` is without links; *shut: its folder is, so none beside it is to be tried. A file that was denied is tried again once its
 * folder is known to be open: else it might have been opened since, and another file be written for no reason. And more than once: a reader that is
 * root makes log and index as root's, and only then gives them to the owner of the file. */
static tl_status open_file(const char *path, const char *place, const tl_database_wanted *wanted,
                           tl_database_file *file, tl_database_aside *aside, bool *shut, tl_error *error) {
    tl_status status = tl_database_file_open(path, wanted->patience, wanted->user, file, aside, error);
    tl_time pause = DENIAL_PAUSE;
    for (int i = 0; i < DENIALS && status != TL_OK && tl_database_get_fault() == TL_DATABASE_DENIED; i++) {
        *shut = is_shut_in(place);
        if (*shut || (i > 0 && !is_writable(place))) {
            return status;
        }
        tl_clock_sleep_until(tl_clock_now(NULL) + pause); /* the reader may wait for its turn on a busy machine */
        pause = 2 * pause < DENIAL_PAUSE_LAST ? 2 * pause : DENIAL_PAUSE_LAST;
        status = tl_database_file_open(path, wanted->patience, wanted->user, file, aside, error);
    }
    return status;
}

static tl_status open_beside(const char *path, const char *why, const tl_database_user *user, tl_database_file *file,
                             tl_database_news *news, tl_error *error) {
    char name[PATH_MAX];
    tl_status status = TL_BAD_DATA;
    const tl_database_wanted wanted = {.path = name, .user = user};
    bool ends = false; /* also if the next one would meet the same */
    for (int i = 1; i <= TL_DATABASE_BESIDE_MOST && !ends; i++) {
        int length = i == 1 ? snprintf(name, sizeof name, "%s.beside", path)
                            : snprintf(name, sizeof name, "%s.beside-%d", path, i);
        if (length >= PATH_MAX) {
            return tl_database_refuse(TL_DATABASE_FOREIGN, error, TL_TRY_AGAIN, "%.200s…: the name is too long", path);
        }
        status = open_file(name, name, &wanted, file, &news->aside, &ends, error);
        ends = ends || status == TL_OK || tl_database_get_fault() == TL_DATABASE_LATER;
    }
    (void)snprintf(news->beside, sizeof news->beside, "%s", status == TL_OK ? why : "");
    return status;
}

tl_status tl_database_instead_beside(const char *given, const char *why, const tl_database_user *user,
                                     tl_database_file *file, tl_database_news *news, tl_error *error) {
    char place[PATH_MAX];
    return open_beside(find_place(given, place), why, user, file, news, error);
}

tl_status tl_database_instead_open(const tl_database_wanted *wanted, tl_database_file *file, tl_database_news *news,
                                   bool *waits, tl_error *error) {
    char place[PATH_MAX];
    tl_error first = {TL_OK, ""};
    bool shut = false;
    *news = (tl_database_news){.beside = ""};
    *waits = false;
    tl_database_aside *aside = wanted->insistence == TL_DATABASE_ALL_OR_NOTHING ? NULL : &news->aside;
    const char *path = find_place(wanted->path, place);
    tl_status status = open_file(wanted->path, path, wanted, file, aside, &shut, &first);
    tl_database_fault fault = tl_database_get_fault();
    if (status != TL_OK && !is_refused(wanted->insistence, fault) && !is_waited_for(fault)) {
        if (!shut && open_beside(path, first.text, wanted->user, file, news, NULL) == TL_OK) {
            return TL_OK;
        }
        *waits = wanted->insistence == TL_DATABASE_ANYHOW || tl_database_get_fault() == TL_DATABASE_LATER;
        tl_database_set_fault(fault);
    } else if (status != TL_OK) {
        *waits = !is_refused(wanted->insistence, fault);
    }
    if (status != TL_OK && error != NULL) {
        *error = first;
    }
    return status;
}
