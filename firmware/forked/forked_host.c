/* The process of an FMU: see forked_host.h. */
#include "firmware/forked/forked_host.h"

#include <errno.h>
#include <sched.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>

#include "firmware/base/log.h"
#include "firmware/forked/forked_answer.h"
#include "firmware/forked/forked_traces.h"
#include "firmware/process/host_state.h"

/* Saves that are looked at: the first ones, then one in so many. */
enum { FIRST = 24, THEN_ONE_IN = 4096 };

typedef struct host {
    tl_forked_block *block;
    uint32_t slots;
    uint32_t slot;
    uint32_t seen; /* requests to this slot that were seen */
    pid_t keeper;
    const tl_forked_service *service;
    tl_forked_answers answers;
    tl_forked_traces before; /* an FMU was here */
    long faults;             /* of this process, when it forked last */
} host;

/* ---- what a fork does not copy ---- */

/* Of saves that come after a step: the first ones, then one in so many. */
static bool is_to_be_looked_at(tl_forked_block *block) {
    if (block->stepped == 0) {
        return false;
    }
    block->stepped = 0;
    block->saves++;
    return block->saves <= FIRST || block->saves % THEN_ONE_IN == 0;
}

/* False: there is what `text` names. Threads are looked for each time: a copy of a process has none, whenever they were begun. */
static bool can_be_forked(const host *self, char text[TL_FORKED_TRACE_TEXT]) {
    tl_forked_traces now;
    if (tl_forked_has_threads()) {
        (void)snprintf(text, TL_FORKED_TRACE_TEXT, "a thread");
        return false;
    }
    if (!is_to_be_looked_at(self->block)) {
        return true;
    }
    tl_forked_traces_look(&now);
    return !tl_forked_traces_differ(&self->before, &now, text);
}

/* ---- forking ---- */

/* Who is ended when the keeper is; the child of a fork is asked anew. */
static void die_with_keeper(const host *self) {
    if (prctl(PR_SET_PDEATHSIG, SIGKILL) != 0 || getppid() != self->keeper) {
        _exit(0);
    }
}

/* The child: waits for what it is asked, in its slot. */
static void become(host *self, uint32_t slot, uint32_t seen) {
    self->slot = slot;
    self->seen = seen;
    self->faults = 0;
    __atomic_store_n(&self->block->slots[slot].process, (int32_t)getpid(), __ATOMIC_RELEASE);
    die_with_keeper(self);
}

/* Why not, for the twin to say: "has …", "cannot …". */
static void refuse(tl_forked_message *message, const char *what, const char *why, const char *rest) {
    message->status = 1;
    (void)snprintf((char *)message->bytes, TL_ERROR_TEXT, "%s%s%s", what, why, rest);
}

/* By the faults of the process, which a fork's child counts from 0. */
static uint32_t take_touched(host *self) {
    struct rusage usage = {.ru_minflt = 0};
    (void)getrusage(RUSAGE_SELF, &usage);
    long touched = usage.ru_minflt - self->faults;
    self->faults = usage.ru_minflt;
    return touched > 0 && touched <= INT32_MAX ? (uint32_t)touched : 0;
}

/* True: this is the child, which answers nothing. */
static bool fork_into(host *self, uint32_t slot) {
    tl_forked_message *message = &self->block->message;
    char text[TL_FORKED_TRACE_TEXT];
    if (!can_be_forked(self, text)) {
        refuse(message, "has ", text, ", which no fork takes back");
        return false;
    }
    uint32_t seen = __atomic_load_n(&self->block->slots[slot].asked, __ATOMIC_ACQUIRE);
    long child = syscall(SYS_clone, (unsigned long)CLONE_PARENT | SIGCHLD, NULL, NULL, NULL, NULL);
    if (child == 0) {
        become(self, slot, seen);
        return true;
    }
    message->status = 0;
    message->numbers[TL_FORKED_TOUCHED] = take_touched(self);
    if (child < 0) {
        refuse(message, "cannot be forked: ", strerror(errno), "");
    }
    return false;
}

/* ---- requests ---- */

static void load(host *self) {
    tl_forked_message *message = &self->block->message;
    tl_error error;
    tl_forked_texts texts = tl_forked_texts_of(message);
    tl_host_state_keep(); /* holds the current folder open */
    const char *folder = tl_forked_texts_next(&texts);
    const char *label = tl_forked_texts_next(&texts);
    tl_forked_traces_look(&self->before);
    tl_status status = self->service->load(folder, label, &self->answers.fmu, &error);
    message->status = (int32_t)status;
    (void)snprintf((char *)message->bytes, sizeof error.text, "%s", status == TL_OK ? "" : error.text);
}

/* False: there is nothing to answer. */
static bool serve(host *self) {
    uint32_t function = self->block->message.function;
    if (function == TL_FORKED_FORK) {
        return !fork_into(self, self->block->message.numbers[0]);
    }
    if (function == TL_FMU_LOADING) {
        load(self);
    } else {
        self->block->stepped = 1;
        tl_forked_answer(&self->answers, &self->block->message);
    }
    return true;
}

static void wait_for_request(host *self) {
    tl_forked_slot *slot = &self->block->slots[self->slot];
    uint32_t asked = __atomic_load_n(&slot->asked, __ATOMIC_ACQUIRE);
    while (asked == self->seen) {
        tl_forked_wait(&slot->asked, self->seen, 0);
        slot = &self->block->slots[self->slot];
        asked = __atomic_load_n(&slot->asked, __ATOMIC_ACQUIRE);
    }
    self->seen = asked;
    if (__atomic_load_n(&slot->over, __ATOMIC_ACQUIRE) != 0) {
        _exit(0);
    }
}

void tl_forked_host_run(tl_forked_block *block, uint32_t slots, pid_t keeper, const tl_forked_service *service) {
    static host self; /* one for the process */
    tl_error error;
    self = (host){.block = block, .slots = slots, .keeper = keeper, .service = service};
    __atomic_store_n(&block->slots[0].process, (int32_t)getpid(), __ATOMIC_RELEASE);
    die_with_keeper(&self);
    tl_fmu_calls_use(&block->calls);
    if (service->confine != NULL && service->confine(service->context, &error) != TL_OK) {
        tl_log(TL_LOG_ERROR, "the process of an FMU: %s", error.text);
        _exit(1);
    }
    for (;;) {
        wait_for_request(&self);
        if (serve(&self)) {
            __atomic_store_n(&block->answered, block->message.number, __ATOMIC_RELEASE);
            tl_forked_wake(&block->news);
        }
    }
}
