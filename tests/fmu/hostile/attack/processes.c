/* Attacks on other processes: signals, memory, priorities and limits. */
#include <errno.h>
#include <fcntl.h>
#include <sched.h>
#include <signal.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ptrace.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <sys/wait.h>
#include <unistd.h>

#include "tests/fmu/hostile/attack/attack.h"

static int number(const char *word) {
    return (int)strtol(word, NULL, 10);
}

static void *place(const char *word) {
    return (void *)(uintptr_t)strtoull(word, NULL, 0); /* NOLINT(performance-no-int-to-ptr): of another process */
}

static int send_kill(char *const words[]) {
    return attack_errno(kill(attack_pid(words[0]), number(words[1])));
}

static int send_tgkill(char *const words[]) {
    pid_t pid = attack_pid(words[0]);
    return attack_errno(syscall(SYS_tgkill, pid, pid, number(words[1])));
}

static int send_tkill(char *const words[]) {
    return attack_errno(syscall(SYS_tkill, attack_pid(words[0]), number(words[1])));
}

static int send_sigqueue(char *const words[]) {
    return attack_errno(sigqueue(attack_pid(words[0]), number(words[1]), (union sigval){.sival_int = 1}));
}

static int send_tgsigqueue(char *const words[]) {
    pid_t pid = attack_pid(words[0]);
    siginfo_t info = {.si_signo = number(words[1]), .si_code = SI_QUEUE};
    return attack_errno(syscall(SYS_rt_tgsigqueueinfo, pid, pid, info.si_signo, &info));
}

static int send_by_pidfd(char *const words[]) {
    long process = syscall(SYS_pidfd_open, attack_pid(words[0]), 0);
    if (process < 0) {
        return errno;
    }
    int error = attack_errno(syscall(SYS_pidfd_send_signal, process, number(words[1]), NULL, 0));
    (void)close((int)process);
    return error;
}

/* Lets the kernel send the signal when a pipe becomes readable; fcntl() sets the receiver. */
static int send_by_pipe(char *const words[]) {
    int ends[2];
    if (pipe2(ends, O_CLOEXEC) != 0) {
        return errno;
    }
    int error = attack_errno(fcntl(ends[0], F_SETOWN, attack_pid(words[0])));
    error = error != 0 ? error : attack_errno(fcntl(ends[0], F_SETSIG, number(words[1])));
    error = error != 0 ? error : attack_errno(fcntl(ends[0], F_SETFL, O_ASYNC));
    error = error != 0 ? error : attack_errno(write(ends[1], "x", 1));
    (void)close(ends[0]);
    (void)close(ends[1]);
    return error;
}

/* PID PLACE: attaches by ptrace(), and writes a word to this address. */
static int trace(char *const words[]) {
    pid_t pid = attack_pid(words[0]);
    if (ptrace(PTRACE_ATTACH, pid, NULL, NULL) != 0) {
        return errno;
    }
    (void)waitpid(pid, NULL, __WALL);
    int error =
        words[1][0] == '\0' ? 0 : attack_errno(ptrace(PTRACE_POKEDATA, pid, place(words[1]), (void *)0x6b636174L));
    (void)ptrace(PTRACE_DETACH, pid, NULL, NULL);
    return error;
}

static int write_by_call(char *const words[]) {
    struct iovec from = {.iov_base = "attack", .iov_len = 6};
    struct iovec to = {.iov_base = place(words[1]), .iov_len = 6};
    return attack_errno(process_vm_writev(attack_pid(words[0]), &from, 1, &to, 1, 0));
}

static int read_by_call(char *const words[]) {
    char got[65] = "";
    struct iovec to = {.iov_base = got, .iov_len = 64};
    struct iovec from = {.iov_base = place(words[1]), .iov_len = 64};
    int error = attack_errno(process_vm_readv(attack_pid(words[0]), &to, 1, &from, 1, 0));
    (void)dprintf(STDERR_FILENO, "attack has read \"%s\"\n", got);
    return error;
}

static int open_memory(const char *pid, int flags) {
    char path[64];
    (void)snprintf(path, sizeof path, "/proc/%d/mem", (int)attack_pid(pid));
    return open(path, flags | O_CLOEXEC);
}

static int write_by_file(char *const words[]) {
    int memory = open_memory(words[0], O_RDWR);
    if (memory < 0) {
        return errno;
    }
    int error = attack_errno(pwrite(memory, "attack", 6, (off_t)strtoull(words[1], NULL, 0)));
    (void)close(memory);
    return error;
}

static int read_by_file(char *const words[]) {
    char got[65] = "";
    int memory = open_memory(words[0], O_RDONLY);
    if (memory < 0) {
        return errno;
    }
    int error = attack_errno(pread(memory, got, 64, (off_t)strtoull(words[1], NULL, 0)));
    (void)dprintf(STDERR_FILENO, "attack has read \"%s\"\n", got);
    (void)close(memory);
    return error;
}

/* PID NAME WORD: reads a file of another process in /proc, and prints it from the word on. */
static int read_of_process(char *const words[]) {
    char path[64];
    static char got[65536];
    (void)snprintf(path, sizeof path, "/proc/%d/%s", (int)attack_pid(words[0]), words[1]);
    int file = open(path, O_RDONLY | O_CLOEXEC);
    if (file < 0) {
        return errno;
    }
    ssize_t size = read(file, got, sizeof got - 1);
    int error = attack_errno(size);
    (void)close(file);
    const char *found = size > 0 ? memmem(got, (size_t)size, words[2], strlen(words[2])) : NULL;
    if (found != NULL) {
        (void)dprintf(STDERR_FILENO, "attack has read \"%.100s\"\n", found);
    }
    return error;
}

static int set_limit(char *const words[]) {
    static const struct rlimit limit = {.rlim_cur = 4711, .rlim_max = 4711};
    return attack_errno(prlimit(attack_pid(words[0]), RLIMIT_MSGQUEUE, &limit, NULL));
}

/* PID: restricts the process to the first processor that the attacker may use. */
static int set_affinity(char *const words[]) {
    cpu_set_t own;
    cpu_set_t one;
    size_t first = 0;
    CPU_ZERO(&one);
    if (sched_getaffinity(0, sizeof own, &own) != 0) {
        return errno;
    }
    while (!CPU_ISSET(first, &own)) {
        first++;
    }
    CPU_SET(first, &one);
    return attack_errno(sched_setaffinity(attack_pid(words[0]), sizeof one, &one));
}

static int set_priority(char *const words[]) {
    return attack_errno(setpriority(PRIO_PROCESS, (id_t)attack_pid(words[0]), 7));
}

static int set_scheduler(char *const words[]) {
    static const struct sched_param none = {.sched_priority = 0};
    return attack_errno(sched_setscheduler(attack_pid(words[0]), SCHED_BATCH, &none));
}

const attack attack_processes[] = {{"send_kill", send_kill},
                                   {"send_tgkill", send_tgkill},
                                   {"send_tkill", send_tkill},
                                   {"send_sigqueue", send_sigqueue},
                                   {"send_tgsigqueue", send_tgsigqueue},
                                   {"send_by_pidfd", send_by_pidfd},
                                   {"send_by_pipe", send_by_pipe},
                                   {"trace", trace},
                                   {"write_by_call", write_by_call},
                                   {"read_by_call", read_by_call},
                                   {"write_by_file", write_by_file},
                                   {"read_by_file", read_by_file},
                                   {"read_of_process", read_of_process},
                                   {"set_limit", set_limit},
                                   {"set_affinity", set_affinity},
                                   {"set_priority", set_priority},
                                   {"set_scheduler", set_scheduler},
                                   {NULL, NULL}};
