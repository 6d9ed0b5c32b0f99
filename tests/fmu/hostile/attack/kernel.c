/* Attacks by other services of the kernel. Each call leaves nothing behind if it succeeds. */
#include <errno.h>
#include <fcntl.h>
#include <mqueue.h>
#include <stdint.h>
#include <stdio.h>
#include <sys/inotify.h>
#include <sys/ipc.h>
#include <sys/personality.h>
#include <sys/prctl.h>
#include <sys/sem.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#include "tests/fmu/hostile/attack/attack.h"

enum { THREAD_KEYRING = -1, USER_MODE_ONLY = 1 };

/* Adds a key to the keyring of the thread, which ends with the thread. */
static int keep_key(char *const words[]) {
    (void)words;
    return attack_errno(syscall(SYS_add_key, "user", "attack", "attack", 6L, (long)THREAD_KEYRING));
}

static int open_queue(char *const words[]) {
    mqd_t queue = mq_open(words[0], O_CREAT | O_RDWR, 0600, NULL);
    int error = queue == (mqd_t)-1 ? errno : 0;
    if (error == 0) {
        (void)mq_close(queue);
        (void)mq_unlink(words[0]);
    }
    return error;
}

static int make_semaphores(char *const words[]) {
    int made = semget(IPC_PRIVATE, 1, IPC_CREAT | 0600);
    int error = attack_errno(made);
    (void)words;
    if (made >= 0) {
        (void)semctl(made, 0, IPC_RMID);
    }
    return error;
}

/* FOLDER: watches changes in this folder. */
static int watch_folder(char *const words[]) {
    int watcher = inotify_init1(IN_CLOEXEC);
    int error = watcher < 0 ? errno : attack_errno(inotify_add_watch(watcher, words[0], IN_ALL_EVENTS));
    (void)close(watcher);
    return error;
}

static int handle_faults(char *const words[]) {
    int faults = (int)syscall(SYS_userfaultfd, O_CLOEXEC | USER_MODE_ONLY);
    int error = attack_errno(faults);
    (void)words;
    (void)close(faults);
    return error;
}

/* PID: takes the standard input of this process. */
static int take_descriptor(char *const words[]) {
    int process = (int)syscall(SYS_pidfd_open, attack_pid(words[0]), 0);
    int taken = process < 0 ? -1 : (int)syscall(SYS_pidfd_getfd, process, 0, 0);
    int error = attack_errno(taken);
    (void)close(taken);
    (void)close(process);
    return error;
}

/* Lets processes of the same user read its memory, and itself through /proc. */
static int be_dumpable(char *const words[]) {
    (void)words;
    return attack_errno(prctl(PR_SET_DUMPABLE, 1L, 0L, 0L, 0L));
}

static int change_personality(char *const words[]) {
    (void)words;
    return attack_errno(personality(ADDR_NO_RANDOMIZE));
}

/* Calls uretprobe() (Linux 6.14), which is meant only for a probe in a program's code and passes
 * seccomp filters. Without a probe the kernel sends SIGILL. */
static int call_uretprobe(char *const words[]) {
    (void)words;
#if defined(__x86_64__)
    return attack_errno(syscall(335L));
#else
    return ENOSYS;
#endif
}

const attack attack_kernel[] = {{"keep_key", keep_key},
                                {"open_queue", open_queue},
                                {"make_semaphores", make_semaphores},
                                {"watch_folder", watch_folder},
                                {"handle_faults", handle_faults},
                                {"take_descriptor", take_descriptor},
                                {"be_dumpable", be_dumpable},
                                {"change_personality", change_personality},
                                {"call_uretprobe", call_uretprobe},
                                {NULL, NULL}};
