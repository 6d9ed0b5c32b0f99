/* Refused calls, taken and answered: see refusal.h. */
#include "firmware/confine/refusal.h"

#include <errno.h>
#include <poll.h>
#include <seccomp.h>
#include <stdio.h>
#include <stdlib.h>

static void describe(const struct seccomp_notif *asked, tl_refusal *refusal) {
    char *name = seccomp_syscall_resolve_num_arch(SCMP_ARCH_NATIVE, asked->data.nr);
    *refusal = (tl_refusal){.id = asked->id, .number = asked->data.nr, .thread = (pid_t)asked->pid};
    if (name != NULL) {
        (void)snprintf(refusal->name, sizeof refusal->name, "%s", name);
    } else {
        (void)snprintf(refusal->name, sizeof refusal->name, "call %d", asked->data.nr);
    }
    free(name);
    for (int i = 0; i < TL_REFUSAL_ARGUMENTS; i++) {
        refusal->arguments[i] = asked->data.args[i];
    }
}

bool tl_refusal_take(int listener, tl_refusal *refusal) {
    struct pollfd waiting = {.fd = listener, .events = POLLIN};
    if (listener < 0 || poll(&waiting, 1, 0) != 1 || (waiting.revents & POLLIN) == 0) {
        return false;
    }
    struct seccomp_notif *asked = NULL;
    bool taken = seccomp_notify_alloc(&asked, NULL) == 0 && seccomp_notify_receive(listener, asked) == 0;
    if (taken) {
        describe(asked, refusal);
    }
    seccomp_notify_free(asked, NULL);
    return taken;
}

/* Nothing of the other process is read, so it does not matter whether it is still there (SECCOMP_IOCTL_NOTIF_ID_VALID): an answer that comes
 * too late goes nowhere. */
void tl_refusal_answer(int listener, const tl_refusal *refusal) {
    struct seccomp_notif_resp *reply = NULL;
    if (seccomp_notify_alloc(NULL, &reply) == 0) {
        reply->id = refusal->id;
        reply->error = -EPERM;
        (void)seccomp_notify_respond(listener, reply);
    }
    seccomp_notify_free(NULL, reply);
}
