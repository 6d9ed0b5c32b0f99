/* What an FMU leaves behind a call: see fmu_traces.h. */
#include "firmware/rollback/fmu_traces.h"

#include <dirent.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include "firmware/base/text.h"

/* ---- threads and children ---- */

static unsigned long count_threads(void) {
    static const char key[] = "Threads:";
    char line[128];
    unsigned long threads = 0;
    FILE *file = fopen("/proc/self/status", "re");
    while (file != NULL && threads == 0 && fgets(line, sizeof line, file) != NULL) {
        if (strncmp(line, key, sizeof key - 1) == 0) {
            threads = strtoul(line + sizeof key - 1, NULL, 10);
        }
    }
    if (file != NULL) {
        (void)fclose(file);
    }
    return threads;
}

static bool has_children(void) {
    siginfo_t about;
    return waitid(P_ALL, 0, &about, WEXITED | WNOHANG | WNOWAIT) == 0;
}

/* ---- descriptors ---- */

static void find_descriptors(tl_fmu_traces *traces) {
    DIR *list = opendir("/proc/self/fd");
    for (const struct dirent *entry = list == NULL ? NULL : readdir(list); entry != NULL; entry = readdir(list)) {
        unsigned long number = strtoul(entry->d_name, NULL, 10);
        bool is_ours = entry->d_name[0] == '.' || (int)number == dirfd(list);
        if (!is_ours && number < TL_FMU_TRACES_DESCRIPTORS) {
            traces->descriptors[number / 64] |= (uint64_t)1 << number % 64;
        }
    }
    if (list != NULL) {
        (void)closedir(list);
    }
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
    if (length < 0) {
        return;
    }
    (void)tl_clean_text(target, (size_t)length, name, sizeof name);
    (void)snprintf(text, TL_FMU_TRACE_TEXT, "an open file or socket, %s", name);
}

/* ---- the whole ---- */

void tl_fmu_traces_look(tl_fmu_traces *traces) {
    *traces = (tl_fmu_traces){.threads = count_threads(), .has_children = has_children()};
    find_descriptors(traces);
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
