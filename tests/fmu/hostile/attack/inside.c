/* Attacks through what the process has from its start: descriptors, the terminal, shared memory. */
#include <errno.h>
#include <fcntl.h>
#include <fmi2FunctionTypes.h>
#include <linux/futex.h>
#include <math.h>
#include <pthread.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#include "tests/fmu/hostile/attack/attack.h"
#include "tests/fmu/hostile/hostile.h"

/* Returns terminal escapes with WORD: window title, clipboard, a query that the terminal answers as
 * if it were typed, colours, and the same as C1 control characters. */
static const char *escapes(const char *word) {
    static char made[512];
    (void)snprintf(made, sizeof made,
                   "\033]0;%s\007\033]52;c;YXR0YWNr\007\033[6n\033[31m\302\2332J\2332J\rattacked\b\n", word);
    return made;
}

static int print_escapes(char *const words[]) {
    const char *made = escapes(words[0]);
    int error = attack_errno(write(STDOUT_FILENO, made, strlen(made)));
    return error != 0 ? error : attack_errno(write(STDERR_FILENO, made, strlen(made)));
}

static int log_escapes(char *const words[]) {
    const fmi2CallbackFunctions *callbacks = hostile_callbacks;
    if (callbacks == NULL || callbacks->logger == NULL) {
        return ENOSYS;
    }
    callbacks->logger(callbacks->componentEnvironment, "hostile", fmi2Warning, "\033]0;category\007", "%s",
                      escapes(words[0]));
    return 0;
}

/* TEXT TERMINAL: puts the text into the input of the terminal, as if it had been typed. */
static int type_text(char *const words[]) {
    int terminal = open(words[1], O_RDWR | O_CLOEXEC | O_NOCTTY);
    int error = terminal < 0 ? errno : 0;
    for (const char *at = words[0]; error == 0 && *at != '\0'; at++) {
        error = attack_errno(ioctl(terminal, TIOCSTI, at));
    }
    error = error != 0 ? error : attack_errno(ioctl(terminal, TIOCSTI, "\n"));
    (void)close(terminal);
    return error;
}

/* TEXT: the same, through any open descriptor that is a terminal. */
static int type_by_descriptor(char *const words[]) {
    for (int i = 0; i < 256; i++) {
        if (isatty(i) == 1) {
            int error = 0;
            for (const char *at = words[0]; error == 0 && *at != '\0'; at++) {
                error = attack_errno(ioctl(i, TIOCSTI, at));
            }
            return error != 0 ? error : attack_errno(ioctl(i, TIOCSTI, "\n"));
        }
    }
    return ENOTTY;
}

/* WORD TERMINAL */
static int print_to_terminal(char *const words[]) {
    return attack_open(words[1], O_WRONLY, escapes(words[0]));
}

/* Opens its own log pipe again. */
static int open_own_pipe(int way) {
    return open("/proc/self/fd/2", way | O_NONBLOCK | O_CLOEXEC);
}

/* WORD: writes escapes to its own log pipe through each descriptor, also as packets and by
 * splice(); then restores the pipe. Returns ENOTTY, because a pipe is no terminal. */
static int write_own_pipe(char *const words[]) {
    const int ways[] = {STDERR_FILENO, open_own_pipe(O_WRONLY), open_own_pipe(O_RDWR)};
    const char *made = escapes(words[0]);
    const size_t size = strlen(made);
    int ends[2] = {-1, -1};
    (void)fcntl(STDERR_FILENO, F_SETPIPE_SZ, 4096);
    for (size_t i = 0; i < sizeof ways / sizeof *ways; i++) {
        (void)write(ways[i], made, size);
        const int flags = fcntl(ways[i], F_GETFL);
        (void)fcntl(ways[i], F_SETFL, flags | O_DIRECT);
        (void)write(ways[i], made, size);
        (void)fcntl(ways[i], F_SETFL, flags);
        if (pipe2(ends, O_CLOEXEC) == 0 && write(ends[1], made, size) == (ssize_t)size) {
            (void)splice(ends[0], NULL, ways[i], NULL, size, 0);
        }
        (void)close(ends[0]);
        (void)close(ends[1]);
        (void)(ways[i] == STDERR_FILENO ? 0 : close(ways[i]));
    }
    (void)fcntl(STDERR_FILENO, F_SETPIPE_SZ, 65536);
    return ENOTTY;
}

/* Reads from its own log pipe for a tenth of a second. Then requests a socket: the parent must
 * still log that this was denied. */
static int read_own_pipe(char *const words[]) {
    char taken[4096];
    int pipe = open_own_pipe(O_RDONLY);
    int error = pipe < 0 ? errno : EBADMSG; /* it has read nothing of other processes */
    (void)words;
    for (int i = 0; i < 100; i++) {
        (void)dprintf(STDERR_FILENO, "line %d, which is taken or not\n", i);
        if (read(pipe, taken, sizeof taken) < 0) {
            attack_pause(1);
        }
    }
    (void)close(pipe);
    (void)close(socket(AF_INET, SOCK_STREAM, 0));
    return error;
}

/* Seeks, writes and truncates all open descriptors except 0 to 2. Succeeds if a write succeeds. */
static int write_descriptors(char *const words[]) {
    int error = EBADF;
    (void)words;
    for (int i = 3; i < 256; i++) {
        (void)lseek(i, 0, SEEK_SET);
        ssize_t size = write(i, "attack", 6);
        int copy = dup(i);
        (void)ftruncate(copy, 3);
        (void)close(copy);
        error = size > 0 ? 0 : error;
    }
    return error;
}

/* FIRST: closes this descriptor and all higher ones. */
static int close_descriptors(char *const words[]) {
    for (int i = (int)strtol(words[0], NULL, 10); i < 1024; i++) {
        (void)close(i);
    }
    return 0;
}

static uint32_t random_word(uint32_t *state) {
    *state ^= *state << 13;
    *state ^= *state >> 17;
    *state ^= *state << 5;
    return *state;
}

static void scribble(uint8_t *bytes, size_t size, void *state) {
    for (size_t i = 0; i < size; i += 1 + random_word(state) % 64) {
        bytes[i] = (uint8_t)random_word(state);
    }
}

/* Writes random bytes to each open file, through its descriptor and through the file opened again
 * for writing. Returns the number of successful mappings. */
static size_t scribble_over_descriptors(uint32_t *state) {
    size_t found = 0;
    for (int i = 0; i < 256; i++) {
        char path[64];
        struct stat about;
        (void)snprintf(path, sizeof path, "/proc/self/fd/%d", i);
        if (fstat(i, &about) != 0 || !S_ISREG(about.st_mode) || about.st_size == 0) {
            continue;
        }
        const int ways[] = {i, open(path, O_RDWR | O_CLOEXEC)};
        for (size_t way = 0; way < sizeof ways / sizeof *ways; way++) {
            void *shared = mmap(NULL, (size_t)about.st_size, PROT_READ | PROT_WRITE, MAP_SHARED, ways[way], 0);
            if (shared != MAP_FAILED) {
                scribble(shared, (size_t)about.st_size, state);
                (void)munmap(shared, (size_t)about.st_size);
                found++;
            }
        }
        (void)close(ways[1]);
    }
    return found;
}

/* Calls `write_over` for each writable shared mapping. Returns their number. */
static size_t for_each_shared(void (*write_over)(uint8_t *bytes, size_t size, void *with), void *with) {
    FILE *maps = fopen("/proc/self/maps", "re");
    size_t found = 0;
    char line[8192];
    while (maps != NULL && fgets(line, sizeof line, maps) != NULL) {
        uintptr_t from = 0;
        uintptr_t to = 0;
        char mode[5] = "";
        if (sscanf(line, "%zx-%zx %4s", &from, &to, mode) == 3 && strcmp(mode, "rw-s") == 0) {
            write_over((uint8_t *)from, to - from, with); /* NOLINT(performance-no-int-to-ptr): as /proc tells */
            found++;
        }
    }
    if (maps != NULL) {
        (void)fclose(maps);
    }
    return found;
}

/* SEED: writes random bytes over all shared memory. */
static int scribble_over_shared(char *const words[]) {
    uint32_t state = (uint32_t)strtoul(words[0], NULL, 10) | 1;
    size_t found = for_each_shared(scribble, &state);
    found += scribble_over_descriptors(&state);
    return found != 0 ? 0 : ENOENT;
}

enum { PATTERN = 16 };

static void fill(uint8_t *bytes, size_t size, void *pattern) {
    for (size_t i = 0; i + PATTERN <= size; i += PATTERN) {
        memcpy(bytes + i, pattern, PATTERN);
    }
}

/* PATTERN: writes NaN ("NaN"), or invalid text, over all shared memory. */
static int fill_shared(char *const words[]) {
    static const double no_numbers[] = {NAN, NAN};
    char pattern[PATTERN] = "\033]0;x\007\033[2J\n\302\233";
    if (strcmp(words[0], "NaN") == 0) {
        memcpy(pattern, no_numbers, sizeof no_numbers);
    }
    return for_each_shared(fill, pattern) != 0 ? 0 : ENOENT;
}

enum { PARENTS_BLOCK = 5, OWN_BLOCK, WORDS = 1024, EACH = 16, ELSEWHERE = 1000 };

/* Moves each waiter on a futex in the first page of a shared block to another futex, which no
 * process wakes. */
static void *move_on(void *unused) {
    for (;;) {
        for (int block = PARENTS_BLOCK; block <= OWN_BLOCK; block++) {
            uint32_t *page = mmap(NULL, 4096, PROT_READ, MAP_SHARED, block, 0);
            for (size_t i = 0; page != MAP_FAILED && i < WORDS; i += EACH) {
                (void)syscall(SYS_futex, &page[i], FUTEX_REQUEUE, 0L, 1000L, &page[ELSEWHERE], 0L);
            }
            (void)(page != MAP_FAILED ? munmap(page, 4096) : 0);
        }
    }
    return unused;
}

/* Does this in a thread, as long as the process lives. */
static int move_sleepers(char *const words[]) {
    pthread_t thread;
    (void)words;
    return pthread_create(&thread, NULL, move_on, NULL);
}

const attack attack_inside[] = {{"print_escapes", print_escapes},
                                {"log_escapes", log_escapes},
                                {"type_text", type_text},
                                {"type_by_descriptor", type_by_descriptor},
                                {"print_to_terminal", print_to_terminal},
                                {"write_descriptors", write_descriptors},
                                {"close_descriptors", close_descriptors},
                                {"write_own_pipe", write_own_pipe},
                                {"read_own_pipe", read_own_pipe},
                                {"scribble_over_shared", scribble_over_shared},
                                {"fill_shared", fill_shared},
                                {"move_sleepers", move_sleepers},
                                {NULL, NULL}};
