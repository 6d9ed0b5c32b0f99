/* Reads attack.txt, carries out its attacks, and reports their results. */
#include "tests/fmu/hostile/attack/attack.h"

#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "tests/fmu/hostile/hostile.h"

enum { ATTACKS = 256, TEXT = 65536 };

typedef struct order {
    char *where;
    char *label;
    char *name;
    char *words[ATTACK_WORDS + 1];
    bool in_thread;
    int call;
    int calls;
} order;

static char text[TEXT];
static order orders[ATTACKS];
static size_t order_count;

int attack_errno(long result) {
    return result < 0 ? errno : 0;
}

pid_t attack_pid(const char *word) {
    return strcmp(word, "parent") == 0 ? getppid() : (pid_t)strtol(word, NULL, 10);
}

void attack_pause(unsigned milliseconds) {
    const struct timespec pause = {.tv_sec = milliseconds / 1000, .tv_nsec = milliseconds % 1000 * 1000000L};
    (void)nanosleep(&pause, NULL);
}

static const attack *find(const char *name) {
    static const attack *const kinds[] = {attack_network, attack_files,  attack_processes, attack_programs,
                                          attack_bombs,   attack_inside, attack_kernel};
    for (size_t i = 0; i < sizeof kinds / sizeof *kinds; i++) {
        for (const attack *known = kinds[i]; known->name != NULL; known++) {
            if (strcmp(known->name, name) == 0) {
                return known;
            }
        }
    }
    return NULL;
}

static void carry_out(const order *given) {
    const attack *known = given->name != NULL ? find(given->name) : NULL;
    int error = known != NULL ? known->run(given->words) : ENOSYS;
    (void)dprintf(STDERR_FILENO, "attack %s: %s\n", given->label, error == 0 ? "succeeded" : strerrorname_np(error));
}

static void *carry_out_in_thread(void *given) {
    carry_out(given);
    return NULL;
}

void attack_orders_path(char path[ATTACK_PATH]) {
    Dl_info info;
    path[0] = '\0';
    if (dladdr((const void *)text, &info) != 0) {
        (void)snprintf(path, ATTACK_PATH, "%s", info.dli_fname);
    }
    for (int i = 0; i < 3 && strrchr(path, '/') != NULL; i++) {
        *strrchr(path, '/') = '\0';
    }
    (void)strncat(path, "/resources/attack.txt", ATTACK_PATH - strlen(path) - 1);
}

static ssize_t read_text(void) {
    char path[ATTACK_PATH];
    attack_orders_path(path);
    int file = open(path, O_RDONLY | O_CLOEXEC);
    ssize_t got = file < 0 ? -1 : read(file, text, sizeof text - 1);
    (void)close(file);
    return got;
}

static void understand(char *line) {
    order *next = &orders[order_count++];
    char *rest = NULL;
    next->where = strtok_r(line, "\t", &rest);
    next->label = strtok_r(NULL, "\t", &rest);
    next->name = strtok_r(NULL, "\t", &rest);
    for (size_t i = 0; i < ATTACK_WORDS; i++) {
        char *word = next->name != NULL ? strtok_r(NULL, "\t", &rest) : NULL;
        next->words[i] = word != NULL ? word : "";
    }
    char *thread = strstr(next->where, "@thread");
    next->in_thread = thread != NULL;
    if (thread != NULL) {
        *thread = '\0';
    }
    char *call = strchr(next->where, ':');
    next->call = call != NULL ? (int)strtol(call + 1, NULL, 10) : 1;
    if (call != NULL) {
        *call = '\0';
    }
}

static void read_orders(void) {
    char *rest = NULL;
    if (read_text() <= 0) {
        (void)dprintf(STDERR_FILENO, "attack: has no orders: %s\n", strerrorname_np(errno));
        return;
    }
    for (char *line = strtok_r(text, "\n", &rest); line != NULL && order_count < ATTACKS;
         line = strtok_r(NULL, "\n", &rest)) {
        understand(line);
    }
}

bool hostile_before(const char *function) {
    static bool known;
    if (!known) {
        known = true;
        read_orders();
    }
    for (size_t i = 0; i < order_count; i++) {
        order *given = &orders[i];
        pthread_t thread;
        if (strcmp(given->where, function) != 0 || ++given->calls != given->call) {
            continue;
        }
        if (!given->in_thread) {
            carry_out(given);
        } else if (pthread_create(&thread, NULL, carry_out_in_thread, given) == 0) {
            (void)pthread_join(thread, NULL);
        }
    }
    return true;
}
