/* Refused system calls: see refusal.h. */
#include "firmware/process/refusal.h"

#include <errno.h>
#include <linux/seccomp.h>
#include <poll.h>
#include <seccomp.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>

/* ---- refusal ---- */

/* Names by number. They are copied once, because libseccomp allocates them on the heap. */
enum { NAMES = 512 };
static char names[NAMES][TL_REFUSAL_NAME];
static bool names_ready;

/* If two threads do this at once, both write the same. */
static void read_names(void) {
    for (int number = 0; number < NAMES && !__atomic_load_n(&names_ready, __ATOMIC_ACQUIRE); number++) {
        char *name = seccomp_syscall_resolve_num_arch(SCMP_ARCH_NATIVE, number);
        if (name != NULL) {
            (void)snprintf(names[number], sizeof names[number], "%s", name);
        }
        free(name);
    }
    __atomic_store_n(&names_ready, true, __ATOMIC_RELEASE);
}

static void describe_request(const struct seccomp_notif *request, tl_refusal *refusal) {
    const int number = request->data.nr;
    *refusal = (tl_refusal){.id = request->id};
    if (number >= 0 && number < NAMES && names[number][0] != '\0') {
        (void)snprintf(refusal->name, sizeof refusal->name, "%s", names[number]);
    } else {
        (void)snprintf(refusal->name, sizeof refusal->name, "call %d", number);
    }
}

/* The command number contains the size of the struct that the kernel fills. */
bool tl_refusal_take(int listener, tl_refusal *refusal) {
    struct pollfd waiting = {.fd = listener, .events = POLLIN};
    struct seccomp_notif request = {.id = 0};
    if (listener < 0 || poll(&waiting, 1, 0) != 1 || (waiting.revents & POLLIN) == 0 ||
        ioctl(listener, SECCOMP_IOCTL_NOTIF_RECV, &request) != 0) {
        return false;
    }
    read_names();
    describe_request(&request, refusal);
    return true;
}

/* No memory of the other process is read, so SECCOMP_IOCTL_NOTIF_ID_VALID is not needed. If the
 * process has ended, the answer has no effect. */
void tl_refusal_answer(int listener, const tl_refusal *refusal) {
    struct seccomp_notif_resp reply = {.id = refusal->id, .error = -EPERM};
    (void)ioctl(listener, SECCOMP_IOCTL_NOTIF_SEND, &reply);
}

/* ---- fmu refusals ---- */

bool tl_fmu_refusals_note(tl_fmu_refusals *refusals, const tl_refusal *refusal, const tl_fmu_calls *calls) {
    tl_fmu_call call;
    bool in_call = tl_fmu_calls_poll(calls, &call);
    const char *fmu = in_call ? call.fmu : "";
    for (size_t i = 0; i < refusals->count; i++) {
        tl_fmu_refused *known = &refusals->entries[i];
        if (strcmp(known->call, refusal->name) == 0 && strcmp(known->fmu, fmu) == 0) {
            known->begun = call.begun;
            return false;
        }
    }
    if (refusals->count == TL_FMU_REFUSALS) {
        return false;
    }
    tl_fmu_refused *noted = &refusals->entries[refusals->count++];
    (void)snprintf(noted->call, sizeof noted->call, "%s", refusal->name);
    (void)snprintf(noted->fmu, sizeof noted->fmu, "%s", fmu);
    noted->is_in_call = in_call && strncmp(call.function, "fmi2", strlen("fmi2")) == 0;
    noted->begun = call.begun;
    if (in_call) {
        (void)snprintf(noted->message, sizeof noted->message, "FMU %s: system call %s denied in %s (reported once)",
                       fmu, refusal->name, call.function);
    } else {
        (void)snprintf(noted->message, sizeof noted->message,
                       "a thread of an FMU: system call %s denied outside of its functions (reported once)",
                       refusal->name);
    }
    return true;
}

const char *tl_fmu_refusals_next(const tl_fmu_refusals *refusals, size_t *reported_count) {
    return *reported_count < refusals->count ? refusals->entries[(*reported_count)++].message : NULL;
}

bool tl_fmu_refusals_may_be_cause(const tl_fmu_refusals *refusals, const tl_fmu_calls *calls) {
    bool may_be = false;
    for (size_t i = 0; i < refusals->count; i++) {
        const tl_fmu_refused *entry = &refusals->entries[i];
        may_be = may_be || !entry->is_in_call || entry->begun == tl_fmu_calls_failed(calls);
    }
    return may_be;
}
