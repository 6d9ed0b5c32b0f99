/* A confined child: see confined.h. */
#include "tests/support/confined.h"

#include <errno.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

enum { PATIENCE_S = 60, LOOK_NS = 50000 };

/* Room for one descriptor beside a message. */
typedef union enclosed {
    struct cmsghdr header;
    char room[CMSG_SPACE(sizeof(int))];
} enclosed;

/* ---- the child ---- */

static bool hand_over(int line, const tl_confine_facts *facts, int listener) {
    tl_confine_facts copy = *facts;
    enclosed control;
    struct iovec part = {&copy, sizeof copy};
    struct msghdr message = {.msg_iov = &part, .msg_iovlen = 1};
    memset(&control, 0, sizeof control);
    if (listener >= 0) {
        message.msg_control = &control;
        message.msg_controllen = sizeof control.room;
        control.header =
            (struct cmsghdr){.cmsg_len = CMSG_LEN(sizeof listener), .cmsg_level = SOL_SOCKET, .cmsg_type = SCM_RIGHTS};
        memcpy(CMSG_DATA(&control.header), &listener, sizeof listener);
    }
    return sendmsg(line, &message, 0) == (ssize_t)sizeof copy;
}

static void be_confined(tl_confine_settings settings, tl_confined_body *body, void *context) {
    tl_error error;
    tl_confine_facts facts;
    int listener = -1;
    (void)prctl(PR_SET_PDEATHSIG, SIGKILL);
    if (tl_confine(&settings, &facts, &listener, &error) != TL_OK) {
        (void)dprintf(STDERR_FILENO, "not confined: %s\n", error.text);
        _exit(EXIT_FAILURE);
    }
    if (!hand_over(settings.start_socket, &facts, listener)) {
        (void)dprintf(STDERR_FILENO, "not handed over: %s\n", strerror(errno));
        _exit(EXIT_FAILURE);
    }
    (void)close(listener);
    (void)close(settings.start_socket);
    _exit(body(context) ? EXIT_SUCCESS : EXIT_FAILURE);
}

bool tl_confined_expect(bool holds, const char *what, int line) {
    const int code = errno;
    if (!holds) {
        (void)dprintf(STDERR_FILENO, "line %d: not so: %s (errno: %s)\n", line, what, strerror(code));
    }
    return holds;
}

bool tl_confined_has_no_socket(int family, int kind, int protocol) {
    int line = socket(family, kind, protocol);
    if (line >= 0) {
        (void)close(line);
        return false;
    }
    return errno == EPERM;
}

/* ---- the parent ---- */

static int take_over(int line, tl_confine_facts *facts) {
    int listener = -1;
    enclosed control;
    struct iovec part = {facts, sizeof *facts};
    struct msghdr message = {
        .msg_iov = &part, .msg_iovlen = 1, .msg_control = &control, .msg_controllen = sizeof control.room};
    if (recvmsg(line, &message, MSG_CMSG_CLOEXEC) == (ssize_t)sizeof *facts && CMSG_FIRSTHDR(&message) != NULL) {
        memcpy(&listener, CMSG_DATA(CMSG_FIRSTHDR(&message)), sizeof listener);
    }
    return listener;
}

static void watch(pid_t child, int listener, tl_confined *confined) {
    const time_t last = time(NULL) + PATIENCE_S;
    const struct timespec look = {.tv_nsec = LOOK_NS};
    tl_refusal refusal;
    int status = 0;
    while (waitpid(child, &status, WNOHANG) == 0) {
        while (tl_refusal_take(listener, &refusal)) {
            if (confined->refusal_count < TL_CONFINED_REFUSALS) {
                confined->refusals[confined->refusal_count++] = refusal;
            }
            tl_refusal_answer(listener, &refusal);
        }
        if (time(NULL) > last) {
            (void)kill(child, SIGKILL);
        }
        (void)nanosleep(&look, NULL);
    }
    confined->succeeded = WIFEXITED(status) && WEXITSTATUS(status) == EXIT_SUCCESS;
    confined->signal = WIFSIGNALED(status) ? WTERMSIG(status) : 0;
}

void tl_confined_run(tl_confine_settings settings, tl_confined_body *body, void *context, tl_confined *confined) {
    int line[2];
    memset(confined, 0, sizeof *confined);
    (void)fflush(NULL);
    if (socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, line) != 0) {
        perror("socketpair");
        exit(EXIT_FAILURE); // NOLINT(concurrency-mt-unsafe): the only thread
    }
    pid_t child = fork();
    if (child == 0) {
        (void)close(line[0]);
        settings.start_socket = line[1];
        be_confined(settings, body, context);
    }
    (void)close(line[1]);
    int listener = take_over(line[0], &confined->facts);
    watch(child, listener, confined);
    (void)close(line[0]);
    if (listener >= 0) {
        (void)close(listener);
    }
}

bool tl_confined_was_refused(const tl_confined *confined, const char *call) {
    bool was = false;
    for (size_t i = 0; i < confined->refusal_count && !was; i++) {
        was = strcmp(confined->refusals[i].name, call) == 0;
    }
    return was;
}
