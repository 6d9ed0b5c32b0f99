/* See comma_locale.h. */
#include "tests/support/comma_locale.h"

#include <ftw.h>
#include <limits.h>
#include <locale.h>
#include <spawn.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/wait.h>
#include <unistd.h>

static int remove_one(const char *path, const struct stat *about, int kind, struct FTW *place) {
    (void)about;
    (void)kind;
    (void)place;
    return remove(path);
}

static bool make_locale(char *path) {
    char words[][12] = {"localedef", "-i", "de_DE", "-f", "UTF-8"};
    char *command[] = {words[0], words[1], words[2], words[3], words[4], path, NULL};
    pid_t child = 0;
    int status = -1;
    return posix_spawnp(&child, command[0], NULL, NULL, command, environ) == 0 && waitpid(child, &status, 0) == child &&
           status == 0;
}

bool tl_comma_locale_set(void) {
    char folder[] = "/tmp/twinlock-locale-XXXXXX";
    char path[PATH_MAX];
    if (mkdtemp(folder) == NULL) {
        return false;
    }
    (void)snprintf(path, sizeof path, "%s/de_DE.UTF-8", folder);
    bool set = make_locale(path) && setenv("LOCPATH", folder, 1) == 0 && setlocale(LC_ALL, "de_DE.UTF-8") != NULL;
    (void)unsetenv("LOCPATH");
    (void)nftw(folder, remove_one, 8, FTW_DEPTH | FTW_PHYS); /* what was loaded stays */
    return set;
}
