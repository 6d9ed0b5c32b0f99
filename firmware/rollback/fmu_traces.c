/* What an FMU leaves behind a call: see fmu_traces.h. */
#include "firmware/rollback/fmu_traces.h"

#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "firmware/base/text.h"

enum { LINKS_BESIDE = 2 }; /* of a folder: its own ones */

static unsigned long count_threads(void) {
    struct stat tasks;
    return stat("/proc/self/task", &tasks) == 0 ? (unsigned long)tasks.st_nlink - LINKS_BESIDE : 0;
}

static bool has(const tl_fmu_traces *traces, unsigned number) {
    return (traces->descriptors[number / 64] >> number % 64 & 1) != 0;
}

/* Leaves the text empty if the descriptor is closed by now: another thread of ours had opened it for a moment. */
static void describe_descriptor(unsigned number, char text[TL_FMU_TRACE_TEXT]) {
    char link[64];
    char target[96];
    char name[96];
    (void)snprintf(link, sizeof link, "/proc/self/fd/%u", number);
    ssize_t length = readlink(link, target, sizeof target);
    if (length < 0 && fcntl((int)number, F_GETFD) < 0) {
        return;
    }
    (void)tl_clean_text(target, length > 0 ? (size_t)length : 0, name, sizeof name);
    (void)snprintf(text, TL_FMU_TRACE_TEXT, "an open file or socket, %s", name);
}

void tl_fmu_traces_look(tl_fmu_traces *traces) {
    siginfo_t about;
    *traces = (tl_fmu_traces){.threads = count_threads(),
                              .has_children = waitid(P_ALL, 0, &about, WEXITED | WNOHANG | WNOWAIT) == 0};
    for (unsigned i = 0; i < TL_FMU_TRACES_DESCRIPTORS; i++) {
        if (fcntl((int)i, F_GETFD) >= 0) {
            traces->descriptors[i / 64] |= (uint64_t)1 << i % 64;
        }
    }
}

bool tl_fmu_traces_differ(const tl_fmu_traces *before, const tl_fmu_traces *after, char text[TL_FMU_TRACE_TEXT]) {
    text[0] = '\0';
    if (after->threads > before->threads) {
        (void)snprintf(text, TL_FMU_TRACE_TEXT, "a thread");
    } else if (after->has_children && !before->has_children) {
        (void)snprintf(text, TL_FMU_TRACE_TEXT, "a process");
    }
    for (unsigned i = 0; i < TL_FMU_TRACES_DESCRIPTORS && text[0] == '\0'; i++) {
        if (has(after, i) && !has(before, i)) {
            describe_descriptor(i, text);
        }
    }
    return text[0] != '\0';
}
