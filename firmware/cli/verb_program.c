/* Verbs that are programs: see verb_program.h. */
#include "firmware/cli/verb_program.h"

#include <errno.h>
#include <libgen.h>
#include <limits.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "firmware/base/log.h"

enum { NAME = 32 };

const tl_verb_program tl_verb_programs[TL_VERB_PROGRAMS] = {
    {"serve", "twinlock-serve", "take changed configurations by HTTPS"},
    {"token", "twinlock-serve", "manage access tokens"},
};

const tl_verb_program *tl_verb_program_find(const char *name) {
    for (size_t i = 0; i < TL_VERB_PROGRAMS; i++) {
        if (strcmp(name, tl_verb_programs[i].name) == 0) {
            return &tl_verb_programs[i];
        }
    }
    return NULL;
}

/* Beside this program, wherever that is. False: nobody knows where. */
static bool find_beside(const char *program, char path[PATH_MAX]) {
    char own[PATH_MAX];
    ssize_t length = readlink("/proc/self/exe", own, sizeof own - 1);
    if (length <= 0) {
        return false;
    }
    own[length] = '\0';
    return snprintf(path, PATH_MAX, "%s/%s", dirname(own), program) < PATH_MAX;
}

int tl_verb_program_run(const tl_verb_program *verb, int argc, char **argv) {
    char path[PATH_MAX];
    char **words = calloc((size_t)argc + 2, sizeof *words);
    char name[NAME];
    size_t count = 0;
    (void)snprintf(name, sizeof name, "%s", verb->program);
    if (words == NULL) {
        tl_log(TL_LOG_ERROR, "out of memory");
        return tl_exit_code(TL_TRY_AGAIN);
    }
    words[count++] = name;
    if (strcmp(verb->name, "token") == 0) {
        words[count++] = argv[0];
    }
    memcpy(&words[count], &argv[1], (size_t)argc * sizeof *words); /* with the NULL at their end */
    if (find_beside(verb->program, path)) {
        (void)execv(path, words);
    } else {
        (void)execvp(verb->program, words);
    }
    int cause = errno;
    free(words);
    tl_log(TL_LOG_ERROR, "`twinlock %s` is the program %s, which is not here: %s; install the package twinlock-serve",
           verb->name, verb->program, strerror(cause));
    return tl_exit_code(TL_BAD_USAGE);
}
