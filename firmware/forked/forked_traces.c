/* What a fork does not copy: see forked_traces.h. */
#include "firmware/forked/forked_traces.h"

#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "firmware/base/text.h"

enum { TASKS_OF_ONE = 3 }; /* links of a folder with one folder in it */

bool tl_forked_has_threads(void) {
    struct stat tasks;
    return stat("/proc/self/task", &tasks) == 0 && tasks.st_nlink > TASKS_OF_ONE;
}

static unsigned count_shared(void) {
    char line[512];
    unsigned count = 0;
    FILE *maps = fopen("/proc/self/maps", "re");
    while (maps != NULL && fgets(line, sizeof line, maps) != NULL) {
        const char *rights = strchr(line, ' '); /* " rw-s …" */
        count += rights != NULL && strlen(rights) > 4 && rights[2] == 'w' && rights[4] == 's' ? 1 : 0;
    }
    if (maps != NULL) {
        (void)fclose(maps);
    }
    return count;
}

static bool has_children(void) {
    siginfo_t about;
    return waitid(P_ALL, 0, &about, WEXITED | WNOHANG | WNOWAIT) == 0;
}

static bool has(const tl_forked_traces *traces, unsigned number) {
    return (traces->descriptors[number / 64] >> number % 64 & 1) != 0;
}

static void describe_descriptor(unsigned number, char text[TL_FORKED_TRACE_TEXT]) {
    char link[64];
    char target[96];
    char name[96];
    (void)snprintf(link, sizeof link, "/proc/self/fd/%u", number);
    ssize_t length = readlink(link, target, sizeof target);
    (void)tl_clean_text(target, length > 0 ? (size_t)length : 0, name, sizeof name);
    (void)snprintf(text, TL_FORKED_TRACE_TEXT, "an open file or socket, %s", name);
}

void tl_forked_traces_look(tl_forked_traces *traces) {
    *traces = (tl_forked_traces){.shared = count_shared(), .has_children = has_children()};
    for (unsigned i = 0; i < TL_FORKED_DESCRIPTORS; i++) {
        if (fcntl((int)i, F_GETFD) >= 0) {
            traces->descriptors[i / 64] |= (uint64_t)1 << i % 64;
        }
    }
}

bool tl_forked_traces_differ(const tl_forked_traces *before, const tl_forked_traces *after,
                             char text[TL_FORKED_TRACE_TEXT]) {
    text[0] = '\0';
    if (after->has_children && !before->has_children) {
        (void)snprintf(text, TL_FORKED_TRACE_TEXT, "a process");
    } else if (after->shared > before->shared) {
        (void)snprintf(text, TL_FORKED_TRACE_TEXT, "memory that others share");
    }
    for (unsigned i = 0; i < TL_FORKED_DESCRIPTORS && text[0] == '\0'; i++) {
        if (has(after, i) && !has(before, i)) {
            describe_descriptor(i, text);
        }
    }
    return text[0] != '\0';
}
