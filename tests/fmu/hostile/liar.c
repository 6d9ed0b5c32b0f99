/* Attacks the parent that monitors it, at the CALL-th call of the function AT (default:
 * fmi2DoStep). "The block" is the shared memory that the FMU process writes. HOW is
 *
 * "hammer"     threads request sockets without a pause; writes MEBIBYTES into its folder and hangs
 * "no call"    writes into the block that no FMU is being called, and hangs
 * "begun"      writes into the block, again and again, that another call has begun, and hangs
 * "toggle"     writes into the block that calls begin and end, and hangs
 * "bad name"   writes an invalid text as its name into the block, requests a socket, and hangs
 * "bad error"  fails, and writes an invalid text as the error into the block
 * "flood"      prints MEBIBYTES; with HANGS it then hangs
 * "page"       prints MEBIBYTES into the page of a check
 * "no page"    closes the page of a check
 * "signal"     sends the signal NUMBER to itself
 * "levels"     prints lines with forged log levels
 * "pipes"      starts a thread by clone() with the flags NUMBER; the thread fills pipes
 * "environment" prints its environment variables
 * "read"       reads FILE_NAME
 * "unshare"    gets a descriptor table of its own by close_range()
 * "failed"     sends the message NUMBER (channel.h) with the status TL_FMU_FAILED, without a reason
 */
#include "tests/fmu/hostile/hostile.h"

#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <sched.h>
#include <signal.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#ifndef AT
#define AT "fmi2DoStep"
#endif
#ifndef CALL
#define CALL 10
#endif
#ifndef MEBIBYTES
#define MEBIBYTES 0
#endif
#ifndef FILE_NAME
#define FILE_NAME ""
#endif
#ifndef NUMBER
#define NUMBER 0
#endif

enum { OWN_BLOCK = 6, PAGE_DESCRIPTOR = 3, PIECE = 1 << 16, NAME = 64, NAMES = 128 };

/* Layout of the calls in the block (firmware/process/fmu_call.h), as an attacker knows it. */
typedef struct account {
    volatile uint32_t begun;
    volatile uint32_t now;
    volatile uint32_t fmus;
    volatile uint32_t asked;
    volatile uint32_t failed;
    char names[NAMES][NAME];
} account;

static const char no_text[] = "e\x9b"
                              "2J\x9b"
                              "31m\xe2\x80\xaevil\xff<script>";

static char piece[PIECE];

static uint8_t *find_name(uint8_t *from, const uint8_t *end) {
    static const char name[] = "hostile";
    return memmem(from, (size_t)(end - from), name, sizeof name);
}

/* Finds the account in the block: it lies before the FMU's name, which is the first or the
 * second. */
static account *find_account(void) {
    struct stat about;
    (void)fstat(OWN_BLOCK, &about);
    uint8_t *bytes = mmap(NULL, (size_t)about.st_size, PROT_READ | PROT_WRITE, MAP_SHARED, OWN_BLOCK, 0);
    const uint8_t *end = bytes + about.st_size;
    for (uint8_t *at = find_name(bytes, end); at != NULL; at = find_name(at + 1, end)) {
        for (int before = 0; before < 2; before++) {
            account *found = (account *)(void *)(at - offsetof(account, names) - before * NAME);
            if (found->fmus >= 1 && found->fmus < NAMES && found->now != 0) {
                return found;
            }
        }
    }
    (void)fputs("has found no account\n", stderr);
    return NULL;
}

static void hang(void) {
    (void)fputs("hanging\n", stderr);
    for (;;) {
        (void)pause();
    }
}

static void begin(void *(*run)(void *), void *context) {
    pthread_t thread;
    (void)pthread_create(&thread, NULL, run, context);
}

static void *ask(void *unused) {
    for (;;) {
        (void)syscall(SYS_socket, AF_INET, SOCK_STREAM, 0);
    }
    return unused;
}

static void hammer(void) {
    for (int i = 0; i < 400; i++) {
        begin(ask, NULL);
    }
    int file = open("attack", O_CREAT | O_WRONLY, 0600);
    for (int i = 0; i < MEBIBYTES * ((1 << 20) / PIECE); i++) {
        (void)!write(file, piece, sizeof piece);
    }
    hang();
}

static void *count_calls(void *found) {
    for (;;) {
        ((account *)found)->begun += 3;
        (void)usleep(500);
    }
    return NULL;
}

static void *toggle(void *found) {
    account *lies = found;
    const uint32_t call = lies->now;
    for (;;) {
        lies->begun++;
        lies->now = call;
        (void)usleep(20000);
        lies->now = 0;
        (void)usleep(20000);
    }
    return NULL;
}

static void give_bad_name(void) {
    account *lies = find_account();
    for (uint32_t i = 0; i < lies->fmus; i++) {
        (void)snprintf(lies->names[i], NAME, "%s", no_text);
    }
    (void)syscall(SYS_socket, AF_INET, SOCK_STREAM, 0);
    hang();
}

/* Overwrites, again and again, each error text behind the account. */
static void *write_errors(void *found) {
    uint8_t *from = (uint8_t *)found + sizeof(account);
    for (;;) {
        for (size_t i = 0; i < 65536; i++) {
            if (memcmp(from + i, "hostile: fmi2DoStep", 19) == 0) {
                memcpy(from + i, no_text, sizeof no_text - 1);
            }
        }
    }
    return NULL;
}

static void print(int descriptor) {
    for (int i = 0; i < MEBIBYTES * ((1 << 20) / PIECE); i++) {
        memset(piece, 'f', sizeof piece);
        for (size_t k = 99; k < sizeof piece; k += 100) {
            piece[k] = '\n';
        }
        if (write(descriptor, piece, sizeof piece) < 0) {
            return;
        }
    }
}

static int fill_pipes(void *unused) {
    int ends[2];
    while (syscall(SYS_pipe2, ends, O_NONBLOCK) == 0) {
        while (syscall(SYS_write, ends[1], piece, 4096) == 4096) {
        }
    }
    for (;;) {
        (void)syscall(SYS_pause);
    }
    (void)unused;
    return 0;
}

static void begin_apart(void) {
    enum { STACK = 65536 };
    char *stack = mmap(NULL, STACK, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    int result = clone(fill_pipes, stack + STACK - 64, CLONE_VM | CLONE_SIGHAND | CLONE_THREAD | NUMBER, NULL);
    (void)fprintf(stderr, "a thread apart: %s\n", result < 0 ? strerror(errno) : "begun");
}

static void unshare_descriptors(void) {
    long result = syscall(SYS_close_range, 1000U, 1000U, 2U /* CLOSE_RANGE_UNSHARE */);
    (void)fprintf(stderr, "descriptors apart: %s\n", result < 0 ? strerror(errno) : "had");
}

static void say_no_call(void) {
    find_account()->now = 0;
    hang();
}

static void say_begun(void) {
    begin(count_calls, find_account());
    hang();
}

static void say_both(void) {
    begin(toggle, find_account());
    hang();
}

static void give_bad_error(void) {
    begin(write_errors, find_account());
    (void)usleep(10000);
}

static void print_much(void) {
    print(STDERR_FILENO);
#if defined(HANGS)
    hang();
#endif
}

static void print_page(void) {
    print(PAGE_DESCRIPTOR);
}

static void close_page(void) {
    (void)close(PAGE_DESCRIPTOR);
}

static void signal_itself(void) {
    (void)kill(getpid(), NUMBER);
}

static void print_levels(void) {
    (void)fputs("<0>forged 0\n<2>forged 2\n<3>forged 3\ntwinlock: error: forged\n", stderr);
}

static void print_environment(void) {
    for (char *const *variable = environ; *variable != NULL; variable++) {
        (void)fprintf(stderr, "has %s\n", *variable);
    }
}

static void read_file(void) {
    char got[64] = "";
    int file = open(FILE_NAME, O_RDONLY | O_CLOEXEC);
    ssize_t size = file < 0 ? -1 : read(file, got, sizeof got - 1);
    (void)fprintf(stderr, "has read %s\n", size > 0 ? got : "nothing");
}

/* Waits until the parent has taken all messages of this process. Its count of taken messages is in
 * its block (firmware/process/channel.c); the count of sent ones is at the beginning of ours. */
static void wait_until_taken(const uint32_t *sent) {
    enum { PARENTS_BLOCK = 5, TAKEN = 16, TIMES = 20000 };
    const uint32_t *theirs = mmap(NULL, PIECE, PROT_READ, MAP_SHARED, PARENTS_BLOCK, 0);
    for (int i = 0; i < TIMES && __atomic_load_n(&theirs[TAKEN], __ATOMIC_SEQ_CST) != *sent; i++) {
        (void)usleep(1000);
    }
}

/* Writes the message to each line of 64 bytes. Slots begin at such lines, so the next slot contains
 * it, whatever the size of a slot is. */
static void send_failed(void) {
    enum { SLOTS = 4096, LINE = 64, LINES = 1024, FMU_FAILED = 4 };
    const uint32_t message[] = {NUMBER, sizeof(uint32_t), FMU_FAILED};
    uint8_t *bytes = mmap(NULL, SLOTS + LINES * LINE, PROT_READ | PROT_WRITE, MAP_SHARED, OWN_BLOCK, 0);
    uint32_t *sent = (uint32_t *)(void *)bytes;
    wait_until_taken(sent);
    for (size_t i = 0; i < LINES; i++) {
        memcpy(bytes + SLOTS + i * LINE, message, sizeof message);
    }
    (void)__atomic_add_fetch(sent, 1, __ATOMIC_SEQ_CST);
    wait_until_taken(sent);
}

static const struct {
    const char *how;
    void (*act)(void);
    bool fails;
} acts[] = {
    {"hammer", hammer, false},
    {"no call", say_no_call, false},
    {"begun", say_begun, false},
    {"toggle", say_both, false},
    {"bad name", give_bad_name, false},
    {"bad error", give_bad_error, true},
    {"flood", print_much, false},
    {"page", print_page, false},
    {"no page", close_page, false},
    {"signal", signal_itself, false},
    {"levels", print_levels, false},
    {"pipes", begin_apart, false},
    {"unshare", unshare_descriptors, false},
    {"read", read_file, false},
    {"environment", print_environment, false},
    {"failed", send_failed, false},
};

bool hostile_before(const char *function) {
    static int calls;
    if (strcmp(function, AT) != 0 || ++calls != CALL) {
        return true;
    }
    for (size_t i = 0; i < sizeof acts / sizeof acts[0]; i++) {
        if (strcmp(acts[i].how, HOW) == 0) {
            acts[i].act();
            return !acts[i].fails;
        }
    }
    (void)fputs("does not know how\n", stderr);
    return false;
}
