/* Hangs in the CALL-th call of the function AT, for ever or for SECONDS. Before, it makes SIGTERM,
 * SIGINT and SIGHUP useless: it ignores them (IGNORE), blocks them in its thread (BLOCK), or
 * handles them without effect (HANDLE). */
#include "tests/fmu/hostile/hostile.h"

#include <signal.h>
#include <stddef.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#ifndef CALL
#define CALL 1
#endif

static void swallow(int number) {
    (void)number;
}

static void become_deaf(int number, sigset_t *set) {
#if defined(IGNORE)
    (void)signal(number, SIG_IGN);
#elif defined(HANDLE)
    (void)signal(number, swallow);
#endif
    (void)swallow;
    (void)sigaddset(set, number);
}

bool hostile_before(const char *function) {
    static int calls;
    sigset_t set;
    if (strcmp(function, AT) != 0 || ++calls != CALL) {
        return true;
    }
    (void)sigemptyset(&set);
    become_deaf(SIGTERM, &set);
    become_deaf(SIGINT, &set);
    become_deaf(SIGHUP, &set);
#if defined(BLOCK)
    (void)pthread_sigmask(SIG_BLOCK, &set, NULL);
#endif
    (void)fputs("hanging\n", stderr);
#if defined(SECONDS)
    return sleep(SECONDS) == 0;
#endif
    for (;;) {
        (void)pause();
    }
}
