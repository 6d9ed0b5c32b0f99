/* The list of system calls, loaded: see filter.h. */
#include "firmware/confine/filter.h"

#include <errno.h>
#include <linux/seccomp.h>
#include <string.h>
#include <sys/syscall.h>
#include <unistd.h>

#include "firmware/confine/filter_parts.h"

enum { NAME = 40 };

/* ---- what the kernel has ---- */

static bool has_action(uint32_t action) {
    return syscall(SYS_seccomp, SECCOMP_GET_ACTION_AVAIL, 0, &action) == 0;
}

bool tl_filter_is_offered(void) {
    return has_action(SECCOMP_RET_KILL_PROCESS) && has_action(SECCOMP_RET_ERRNO);
}

/* Version 5 of the interface, as libseccomp counts: notifications; 6: also for all threads. */
bool tl_filter_can_notify(void) {
    return tl_filter_is_offered() && has_action(SECCOMP_RET_USER_NOTIF) && seccomp_api_get() >= 6;
}

/* ---- what the parts use ---- */

int tl_filter_add(scmp_filter_ctx context, uint32_t action, const char *call, const struct scmp_arg_cmp *conditions,
                  unsigned count) {
    int number = seccomp_syscall_resolve_name(call);
    return number < 0 ? 0 : seccomp_rule_add_array(context, action, number, count, conditions);
}

int tl_filter_allow_all(scmp_filter_ctx context, const char *calls) {
    int failure = 0;
    while (*calls != '\0' && failure == 0) {
        char name[NAME] = "";
        size_t length = strcspn(calls, " ");
        memcpy(name, calls, length < NAME ? length : NAME - 1);
        failure = tl_filter_add(context, SCMP_ACT_ALLOW, name, NULL, 0);
        calls += length;
        calls += strspn(calls, " ");
    }
    return failure;
}

/* ---- load ---- */

static int set_attributes(scmp_filter_ctx context, const tl_filter_settings *settings) {
    const struct {
        enum scmp_filter_attr attribute;
        uint32_t value;
    } attributes[] = {
        {SCMP_FLTATR_ACT_BADARCH, SCMP_ACT_KILL_PROCESS},
        {SCMP_FLTATR_CTL_NNP, 1},
        {SCMP_FLTATR_CTL_TSYNC, settings->whole_process ? 1 : 0},
        {SCMP_FLTATR_CTL_SSB, 1}, /* FMUs run as fast as without: they do not defend themselves against each other */
        {SCMP_FLTATR_CTL_OPTIMIZE, 2}, /* a binary tree by the numbers of calls */
        {SCMP_FLTATR_API_SYSRAWRC, 1}, /* what the kernel says, not "it failed" */
    };
    int failure = 0;
    for (size_t i = 0; i < sizeof attributes / sizeof attributes[0] && failure == 0; i++) {
        failure = seccomp_attr_set(context, attributes[i].attribute, attributes[i].value);
    }
    return failure;
}

/* 0, or a negative number as errno. */
static int load(const tl_filter_settings *settings, uint32_t refuse, int *listener) {
    scmp_filter_ctx context = seccomp_init(refuse);
    if (context == NULL) {
        return -ENOMEM;
    }
    int failure = set_attributes(context, settings);
    failure = failure != 0 ? failure : tl_filter_add_calls(context, settings);
    failure = failure != 0 ? failure : tl_filter_add_arguments(context, settings);
    if (settings->drivers != 0) {
        failure = failure != 0 ? failure : tl_filter_add_drivers(context, settings->drivers);
    }
    if (settings->may_answer) {
        failure = failure != 0 ? failure : tl_filter_add_server(context);
    }
    failure = failure != 0 ? failure : seccomp_load(context);
    if (failure == 0 && refuse == SCMP_ACT_NOTIFY) {
        *listener = seccomp_notify_fd(context);
    }
    seccomp_release(context);
    return failure;
}

tl_status tl_filter_load(const tl_filter_settings *settings, int *listener, tl_error *error) {
    int failure = -EBUSY; /* the kernel's word for a second listener, as one of a container's may be there */
    if (listener != NULL) {
        *listener = -1;
        failure = tl_filter_can_notify() ? load(settings, SCMP_ACT_NOTIFY, listener) : failure;
    }
    if (failure == -EBUSY) {
        failure = load(settings, SCMP_ACT_ERRNO(EPERM), NULL);
    }
    return failure == 0
               ? TL_OK
               : tl_fail(error, TL_TRY_AGAIN, "the filter of system calls could not be loaded: %s", strerror(-failure));
}
