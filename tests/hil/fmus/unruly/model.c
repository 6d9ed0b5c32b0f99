/* Unruly: y = u, until it is told otherwise. The file that TWINLOCK_UNRULY names, in the folder that FMUs may write to, holds one word, which the
 * next step takes out and does:
 *
 *   hang   never returns      crash   is ended by SIGSEGV      exit   calls exit(0)
 *   scribble   writes over what the twin hands to the recorder, and goes on
 *   scribbles  the same at each step, as long as the word is there: it is not taken out
 *   over       says of its run that it is over, and ends the process as it said
 *   heartless  wipes out what the twin shows of its life, and never returns
 *
 * The word is taken out first, so that the process that is begun after this one is a well-behaved one. */
#include <inttypes.h>
#include <signal.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "description.h"
#include "fmus/common/model.h"

/* Each byte of where a process says why and with which code it ends, which is in these first ones: TL_END_CAUSE_OVER (firmware/process/heartbeat.h). */
enum { OVER = 2, PULSE = 4096 };

typedef struct unruly {
    fmi2Real u, y, t_step;
} unruly;

static void start(void *model) {
    unruly *self = model;
    self->y = self->u;
}

/* False where nobody wants anything. */
static bool take_word(char word[16]) {
    const char *path = getenv("TWINLOCK_UNRULY");
    FILE *file = path == NULL ? NULL : fopen(path, "r");
    if (file == NULL) {
        return false;
    }
    bool found = fscanf(file, "%15s", word) == 1;
    (void)fclose(file);
    if (found && strcmp(word, "scribbles") == 0) {
        return true;
    }
    file = found ? fopen(path, "w") : NULL; /* FMUs may remove nothing */
    return file != NULL && fclose(file) == 0;
}

static void hang(void) {
    for (volatile unsigned long i = 0;; i++) {
    }
}

/* Over the first `count` bytes of the block of this name, if it can be written; 0: over all of it. */
static void scribble(const char *block, int with, size_t count) {
    char line[512];
    FILE *maps = fopen("/proc/self/maps", "r");
    while (maps != NULL && fgets(line, sizeof line, maps) != NULL) {
        char *end = line;
        uintptr_t from = (uintptr_t)strtoull(line, &end, 16);
        uintptr_t to = *end == '-' ? (uintptr_t)strtoull(end + 1, NULL, 16) : from;
        if (strstr(line, block) != NULL && strstr(line, " rw-s ") != NULL) {
            void *begin = (void *)from; /* NOLINT(performance-no-int-to-ptr): as /proc tells */
            memset(begin, with, count != 0 ? count : to - from);
        }
    }
    if (maps != NULL) {
        (void)fclose(maps);
    }
}

static void obey(const char *word) {
    if (strcmp(word, "hang") == 0) {
        hang();
    } else if (strcmp(word, "exit") == 0) {
        exit(0);
    } else if (strncmp(word, "scribble", strlen("scribble")) == 0) {
        scribble("memfd:twinlock records", 0x55, 0);
    } else if (strcmp(word, "heartless") == 0) {
        scribble("memfd:twinlock twin", 0, 0);
        hang();
    } else if (strcmp(word, "over") == 0) {
        scribble("memfd:twinlock twin", OVER, PULSE);
        _exit(OVER);
    } else if (strcmp(word, "crash") == 0) {
        (void)signal(SIGSEGV, SIG_DFL);
        (void)raise(SIGSEGV);
    }
}

static void step(void *model, double h) {
    unruly *self = model;
    char word[16];
    (void)h;
    self->y = self->u;
    if (take_word(word)) {
        obey(word);
    }
}

TL_FMU_MODEL(unruly, .t_step = offsetof(unruly, t_step), .start = start, .step = step);
