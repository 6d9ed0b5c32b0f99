/* Attacks by starting programs, and by unusual kinds of system calls. */
#include <errno.h>
#include <fcntl.h>
#include <linux/io_uring.h>
#include <signal.h>
#include <spawn.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include "tests/fmu/hostile/attack/attack.h"

/* The program is a shell that leaves a mark at a path and ends with 7. */
static char command[4200];

static char *const *shell(const char *mark) {
    static char *words[] = {"sh", "-c", command, NULL};
    (void)snprintf(command, sizeof command, "echo attack >'%s'; exit 7", mark);
    return words;
}

static int ended(int status) {
    return WIFEXITED(status) && WEXITSTATUS(status) == 7 ? 0 : EPERM;
}

static int ended_child(pid_t child) {
    int status = 0;
    if (child < 0) {
        return errno;
    }
    return waitpid(child, &status, __WALL) == child ? ended(status) : errno;
}

/* Replaces the attacker by the program. */
static int replace_itself(char *const words[]) {
    return attack_errno(execv("/bin/sh", shell(words[0])));
}

static int call_system(char *const words[]) {
    (void)shell(words[0]);
    int status = system(command); /* NOLINT(cert-env33-c): the attack */
    return status < 0 ? errno : ended(status);
}

static int call_popen(char *const words[]) {
    (void)shell(words[0]);
    FILE *program = popen(command, "r"); /* NOLINT(cert-env33-c): the attack */
    return program == NULL ? errno : ended(pclose(program));
}

static int call_spawn(char *const words[]) {
    pid_t child = -1;
    int error = posix_spawn(&child, "/bin/sh", NULL, NULL, shell(words[0]), NULL);
    return error != 0 ? error : ended_child(child);
}

static int call_fork(char *const words[]) {
    pid_t child = fork();
    if (child == 0) {
        (void)execv("/bin/sh", shell(words[0]));
        _exit(1);
    }
    return ended_child(child);
}

/* Uses clone(), where the C library might choose a newer system call. */
static int call_raw_fork(char *const words[]) {
    pid_t child = (pid_t)syscall(SYS_clone, SIGCHLD, 0, 0, 0, 0);
    if (child == 0) {
        (void)execv("/bin/sh", shell(words[0]));
        _exit(1);
    }
    return ended_child(child);
}

static int copy_into(int to, const char *path) {
    char bytes[65536];
    int from = open(path, O_RDONLY | O_CLOEXEC);
    ssize_t size = from < 0 ? -1 : 1;
    while (size > 0) {
        size = read(from, bytes, sizeof bytes);
        size = size > 0 ? write(to, bytes, (size_t)size) : size;
    }
    int error = attack_errno(size);
    (void)close(from);
    return error;
}

/* Executes a program from a file in memory, which has no path. */
static int execute_memory(char *const words[]) {
    static char *const none[] = {NULL};
    int memory = memfd_create("attack", MFD_CLOEXEC);
    if (memory < 0) {
        return errno;
    }
    int error = copy_into(memory, "/bin/sh");
    pid_t child = error == 0 ? fork() : -1;
    if (child == 0) {
        (void)fexecve(memory, shell(words[0]), none);
        _exit(1);
    }
    error = error != 0 ? error : ended_child(child);
    (void)close(memory);
    return error;
}

/* Maps machine code from a file in memory, and executes it; the code returns 42. */
static int map_memory(char *const words[]) {
#if defined(__x86_64__)
    static const uint8_t code[] = {0xB8, 42, 0, 0, 0, 0xC3};
#elif defined(__aarch64__)
    static const uint32_t code[] = {0x52800540, 0xD65F03C0};
#else
    static const uint32_t code[] = {0xE3A0002A, 0xE12FFF1E};
#endif
    int (*run)(void) = NULL;
    int memory = memfd_create("attack", MFD_CLOEXEC);
    (void)words;
    if (memory < 0 || write(memory, code, sizeof code) != (ssize_t)sizeof code) {
        return errno;
    }
    void *mapped = mmap(NULL, 4096, PROT_READ | PROT_EXEC, MAP_PRIVATE, memory, 0);
    int error = mapped == MAP_FAILED ? errno : 0;
    (void)close(memory);
    if (error == 0) {
        memcpy(&run, &mapped, sizeof run);
        error = run() == 42 ? 0 : EIO;
        (void)munmap(mapped, 4096);
    }
    return error;
}

/* Uses the system calls of 32-bit programs, where creat() is number 8. */
static int call_32_bits(char *const words[]) {
#if defined(__x86_64__)
    char *path = mmap(NULL, 4096, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_32BIT, -1, 0);
    if (path == MAP_FAILED) {
        return errno;
    }
    (void)snprintf(path, 4096, "%s", words[0]);
    long result = 8;
    __asm__ volatile("int $0x80" : "+a"(result) : "b"(path), "c"(0666L) : "memory", "r8", "r9", "r10", "r11");
    (void)munmap(path, 4096);
    if ((int)result >= 0) {
        (void)close((int)result);
    }
    return (int)result < 0 ? -(int)result : 0;
#else
    (void)words;
    return ENOSYS;
#endif
}

/* Uses the system calls of x32. */
static int call_x32(char *const words[]) {
#if defined(__x86_64__)
    long file = syscall(0x40000000L | SYS_open, words[0], O_CREAT | O_WRONLY, 0666);
    return attack_errno(file);
#else
    (void)words;
    return ENOSYS;
#endif
}

/* Submits one order. Both rings are one mapping since Linux 5.4. */
static int submit(int ring, const struct io_uring_params *made, const struct io_uring_sqe *order) {
    size_t size = made->cq_off.cqes + made->cq_entries * sizeof(struct io_uring_cqe);
    char *rings = mmap(NULL, size, PROT_READ | PROT_WRITE, MAP_SHARED, ring, IORING_OFF_SQ_RING);
    struct io_uring_sqe *orders = mmap(NULL, 4096, PROT_READ | PROT_WRITE, MAP_SHARED, ring, IORING_OFF_SQES);
    if (rings == MAP_FAILED || orders == MAP_FAILED) {
        return errno;
    }
    orders[0] = *order;
    *(uint32_t *)(void *)(rings + made->sq_off.array) = 0;
    __atomic_store_n((uint32_t *)(void *)(rings + made->sq_off.tail), 1, __ATOMIC_RELEASE);
    if (syscall(SYS_io_uring_enter, ring, 1, 1, IORING_ENTER_GETEVENTS, NULL, 0) < 0) {
        return errno;
    }
    const struct io_uring_cqe *result = (const struct io_uring_cqe *)(void *)(rings + made->cq_off.cqes);
    return result->res < 0 ? -result->res : 0;
}

/* Creates a file by io_uring, without a call of open(). */
static int create_by_ring(char *const words[]) {
    struct io_uring_params made = {.flags = 0};
    struct io_uring_sqe order = {
        .opcode = IORING_OP_OPENAT, .fd = AT_FDCWD, .len = 0666, .open_flags = O_CREAT | O_WRONLY};
    order.addr = (uint64_t)(uintptr_t)words[0];
    int ring = (int)syscall(SYS_io_uring_setup, 1, &made);
    if (ring < 0) {
        return errno;
    }
    int error = submit(ring, &made, &order);
    (void)close(ring);
    return error;
}

const attack attack_programs[] = {{"replace_itself", replace_itself}, {"call_system", call_system},
                                  {"call_popen", call_popen},         {"call_spawn", call_spawn},
                                  {"call_fork", call_fork},           {"call_raw_fork", call_raw_fork},
                                  {"execute_memory", execute_memory}, {"map_memory", map_memory},
                                  {"call_32_bits", call_32_bits},     {"call_x32", call_x32},
                                  {"create_by_ring", create_by_ring}, {NULL, NULL}};
