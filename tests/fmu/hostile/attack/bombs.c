/* Attacks by excess: processes, threads, memory, disk and output. Each has a limit. */
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <signal.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ipc.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/shm.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "tests/fmu/hostile/attack/attack.h"

enum { MEBI = 1 << 20, LIFE_S = 20 };

static size_t number(const char *word) {
    return strtoul(word, NULL, 10);
}

/* A remaining process: has a name by which the test finds it, ends after LIFE_S, and keeps no
 * descriptor of its parent open. */
static void linger(void) {
    (void)prctl(PR_SET_NAME, "attack-left");
    (void)alarm(LIFE_S);
    for (int i = 0; i < 1024; i++) {
        (void)close(i);
    }
    for (;;) {
        (void)pause();
    }
}

/* COUNT: starts processes that remain. They inherit their name, so that they have it at once. */
static int processes(char *const words[]) {
    char name[16] = "";
    size_t wanted = number(words[0]);
    int failure = 0;
    (void)prctl(PR_GET_NAME, name);
    (void)prctl(PR_SET_NAME, "attack-left");
    for (size_t made = 0; made < wanted && failure == 0; made++) {
        pid_t child = fork();
        if (child == 0) {
            linger();
        }
        failure = child < 0 ? errno : 0;
    }
    (void)prctl(PR_SET_NAME, name);
    return failure;
}

/* Starts a daemon: a process in another session, whose parent has ended. */
static int daemon_process(char *const words[]) {
    int status = 0;
    (void)words;
    pid_t child = fork();
    if (child == 0) {
        (void)setsid();
        pid_t second = fork();
        if (second == 0) {
            linger();
        }
        _exit(second < 0);
    }
    if (child < 0 || waitpid(child, &status, 0) != child) {
        return errno;
    }
    attack_pause(100);
    return status == 0 ? 0 : EAGAIN;
}

static void *wait_in_thread(void *unused) {
    attack_pause(LIFE_S * 1000);
    return unused;
}

/* COUNT: starts threads that remain. */
static int threads(char *const words[]) {
    pthread_attr_t attributes;
    int error = 0;
    (void)pthread_attr_init(&attributes);
    (void)pthread_attr_setstacksize(&attributes, 65536);
    (void)pthread_attr_setdetachstate(&attributes, PTHREAD_CREATE_DETACHED);
    for (size_t made = 0, wanted = number(words[0]); made < wanted && error == 0; made++) {
        pthread_t thread;
        error = pthread_create(&thread, &attributes, wait_in_thread, NULL);
    }
    (void)pthread_attr_destroy(&attributes);
    return error;
}

/* MEBIBYTES: maps shared memory in pieces, and writes to each page, so that it exists. */
static int shared_memory(char *const words[]) {
    enum { PIECE = 64 };
    for (size_t taken = 0, wanted = number(words[0]); taken < wanted; taken += PIECE) {
        char *piece = mmap(NULL, (size_t)PIECE * MEBI, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
        if (piece == MAP_FAILED) {
            return errno;
        }
        for (size_t i = 0; i < (size_t)PIECE * MEBI; i += 4096) {
            ((volatile char *)piece)[i] = 1;
        }
    }
    return 0;
}

static int heap_memory(char *const words[]) {
    for (size_t taken = 0, wanted = number(words[0]); taken < wanted; taken++) {
        char *piece = malloc(MEBI);
        if (piece == NULL) {
            return ENOMEM;
        }
        memset(piece, 1, MEBI);
    }
    return 0;
}

/* MEBIBYTES: makes the kernel allocate page tables. Reads one byte in each 2 MiB of a mapping,
 * which allocates a page of tables and no data page. */
static int page_tables(char *const words[]) {
    const size_t pages = number(words[0]) * (MEBI / 4096);
    const size_t piece = (size_t)64 * 1024 * MEBI;
    const size_t each = piece / (2 * MEBI);
    for (size_t made = 0; made < pages; made += each) {
        volatile char *at = mmap(NULL, piece, PROT_READ, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
        if (at == MAP_FAILED) {
            return errno;
        }
        for (size_t i = 0; i < each; i++) {
            (void)at[i * 2 * MEBI];
        }
    }
    return 0;
}

/* COUNT: makes timers. Each counts as a pending signal of the user, whose number is limited. */
static int timers(char *const words[]) {
    struct sigevent event = {.sigev_notify = SIGEV_SIGNAL, .sigev_signo = SIGURG};
    for (size_t made = 0, wanted = number(words[0]); made < wanted; made++) {
        timer_t timer;
        if (timer_create(CLOCK_MONOTONIC, &event, &timer) != 0) {
            return errno;
        }
    }
    return 0;
}

static int fill(int file, size_t mebibytes) {
    static char bytes[8 * MEBI];
    memset(bytes, 1, sizeof bytes);
    for (size_t written = 0; written < mebibytes; written += sizeof bytes / MEBI) {
        ssize_t size = write(file, bytes, sizeof bytes);
        if (size != (ssize_t)sizeof bytes) {
            return size < 0 ? errno : ENOSPC;
        }
    }
    return 0;
}

/* MEBIBYTES: fills a file in memory, which does not count as memory of a process. */
static int file_memory(char *const words[]) {
    int memory = memfd_create("attack", MFD_CLOEXEC);
    if (memory < 0) {
        return errno;
    }
    int error = fill(memory, number(words[0]));
    (void)close(memory);
    return error;
}

/* KEY: makes System V shared memory, which outlives its process. */
static int system_v_memory(char *const words[]) {
    return attack_errno(shmget((key_t)number(words[0]), 4096, IPC_CREAT | 0600));
}

static void *use_stack(void *mebibytes) {
    size_t size = (size_t)(uintptr_t)mebibytes * MEBI;
    volatile char *top = __builtin_frame_address(0);
    for (size_t i = 65536; i < size - 65536; i += 4096) {
        *(top - i) = 1;
    }
    return NULL;
}

/* MEBIBYTES: starts a thread with a stack of this size, and uses it. */
static int stack_memory(char *const words[]) {
    pthread_attr_t attributes;
    pthread_t thread;
    size_t mebibytes = number(words[0]);
    (void)pthread_attr_init(&attributes);
    int error = pthread_attr_setstacksize(&attributes, mebibytes * MEBI);
    error = error != 0 ? error : pthread_create(&thread, &attributes, use_stack, (void *)(uintptr_t)mebibytes);
    (void)pthread_attr_destroy(&attributes);
    return error != 0 ? error : pthread_join(thread, NULL);
}

/* Creates the file `name` in `folder`, or in $TMPDIR if `folder` is "". */
static int create_in(const char *folder, const char *name) {
    char path[4096];
    const char *temporary = getenv("TMPDIR");
    const char *chosen = folder[0] != '\0' ? folder : temporary != NULL ? temporary : "/tmp";
    (void)snprintf(path, sizeof path, "%s/%s", chosen, name);
    return open(path, O_RDWR | O_CREAT | O_CLOEXEC, 0600);
}

/* MEBIBYTES [FOLDER]: fills a file. */
static int fill_disk(char *const words[]) {
    int file = create_in(words[1], "attack.fill");
    if (file < 0) {
        return errno;
    }
    int error = fill(file, number(words[0]));
    (void)close(file);
    return error;
}

/* MEBIBYTES [FOLDER]: reserves disk space without writing. */
static int reserve_disk(char *const words[]) {
    int file = create_in(words[1], "attack.reserve");
    if (file < 0) {
        return errno;
    }
    int error = attack_errno(fallocate(file, 0, 0, (off_t)number(words[0]) * MEBI));
    (void)close(file);
    return error;
}

/* MEBIBYTES: fills removed files that are still open, 32 MiB each. */
static int fill_removed(char *const words[]) {
    for (size_t written = 0, wanted = number(words[0]); written < wanted; written += 32) {
        int file = create_in("", "attack.removed");
        if (file < 0) {
            return errno;
        }
        const char *temporary = getenv("TMPDIR");
        char path[4096];
        (void)snprintf(path, sizeof path, "%s/attack.removed", temporary != NULL ? temporary : "/tmp");
        int error = attack_errno(unlink(path));
        error = error != 0 ? error : fill(file, 32);
        if (error != 0) {
            return error;
        }
    }
    return 0;
}

/* COUNT [FOLDER]: creates empty files. */
static int many_files(char *const words[]) {
    char name[32];
    for (size_t made = 0, wanted = number(words[0]); made < wanted; made++) {
        (void)snprintf(name, sizeof name, "attack.%zu", made);
        int file = create_in(words[1], name);
        if (file < 0) {
            return errno;
        }
        (void)close(file);
    }
    return 0;
}

/* COUNT: makes descriptors that remain open. */
static int many_descriptors(char *const words[]) {
    for (size_t made = 0, wanted = number(words[0]); made < wanted; made++) {
        if (fcntl(STDERR_FILENO, F_DUPFD_CLOEXEC, 64) < 0) {
            return errno;
        }
    }
    return 0;
}

/* BYTES: writes lines to standard output. */
static int flood_output(char *const words[]) {
    static char line[65536];
    memset(line, 'f', sizeof line);
    for (size_t i = 99; i < sizeof line; i += 100) {
        line[i] = '\n';
    }
    for (size_t written = 0, wanted = number(words[0]); written < wanted;) {
        ssize_t size = write(STDOUT_FILENO, line, sizeof line);
        if (size <= 0) {
            return size < 0 ? errno : EIO;
        }
        written += (size_t)size;
    }
    return 0;
}

static int output_without_newline(char *const words[]) {
    for (size_t written = 0, wanted = number(words[0]); written < wanted; written++) {
        if (putchar('n') == EOF) {
            return errno;
        }
    }
    return fflush(stdout) == 0 ? 0 : errno;
}

const attack attack_bombs[] = {{"processes", processes},
                               {"daemon_process", daemon_process},
                               {"threads", threads},
                               {"shared_memory", shared_memory},
                               {"heap_memory", heap_memory},
                               {"file_memory", file_memory},
                               {"page_tables", page_tables},
                               {"timers", timers},
                               {"fill_removed", fill_removed},
                               {"system_v_memory", system_v_memory},
                               {"stack_memory", stack_memory},
                               {"fill_disk", fill_disk},
                               {"reserve_disk", reserve_disk},
                               {"many_files", many_files},
                               {"many_descriptors", many_descriptors},
                               {"flood_output", flood_output},
                               {"output_without_newline", output_without_newline},
                               {NULL, NULL}};
