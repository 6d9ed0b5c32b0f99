/* Asking, saving, restoring: see forked_line.h. */
#include "firmware/forked/forked_line.h"

#include <errno.h>
#include <signal.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include "firmware/base/log.h"

/* Handles beside those of its user: a proof and a verifier have some. Slots beside handles: the one that goes on, and those that are about to end. */
enum { BESIDE = 16, ENDING = 48, LOOK_MS = 100, PATIENCE_LOOKS = 20 };

tl_status tl_forked_line_open(uint32_t snapshots, tl_forked_line *line, tl_error *error) {
    *line = (tl_forked_line){.alive = -1, .most = snapshots, .snapshot_count = snapshots + BESIDE};
    line->slot_count = line->snapshot_count + ENDING;
    line->block = tl_forked_block_make(line->slot_count);
    line->uses = calloc(line->slot_count, sizeof *line->uses);
    line->snapshots = calloc(line->snapshot_count, sizeof *line->snapshots);
    if (line->block == NULL || line->uses == NULL || line->snapshots == NULL) {
        tl_forked_line_close(line);
        return tl_fail(error, TL_TRY_AGAIN, "not enough memory for the processes of an FMU");
    }
    line->uses[0] = TL_FORKED_USED;
    return TL_OK;
}

static void end(tl_forked_line *line, uint32_t slot) {
    line->uses[slot] = TL_FORKED_ENDING;
    __atomic_store_n(&line->block->slots[slot].over, 1, __ATOMIC_RELEASE);
    tl_forked_wake(&line->block->slots[slot].asked);
}

void tl_forked_line_close(tl_forked_line *line) {
    if (line->alive >= 0) {
        (void)close(line->alive);
    }
    while (line->keeper > 0 && waitpid(line->keeper, NULL, 0) < 0 && errno == EINTR) {
    }
    if (line->block != NULL) {
        tl_forked_block_free(line->block, line->slot_count);
    }
    free(line->uses);
    free(line->snapshots);
    *line = (tl_forked_line){.alive = -1};
}

/* ---- ends ---- */

static bool has_ended(const tl_forked_line *line, uint32_t slot) {
    return __atomic_load_n(&line->block->slots[slot].ended, __ATOMIC_ACQUIRE) != 0;
}

/* Its children end with it. */
static bool keeper_has_ended(const tl_forked_line *line) {
    siginfo_t about = {.si_pid = 0};
    return waitid(P_PID, (id_t)line->keeper, &about, WEXITED | WNOHANG | WNOWAIT) != 0 || about.si_pid != 0;
}

static void note_failure(tl_forked_line *line, const char *format, ...) TL_PRINTF(2, 3);

static void note_failure(tl_forked_line *line, const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    if (line->failure[0] == '\0') {
        (void)vsnprintf(line->failure, sizeof line->failure, format, arguments);
    }
    va_end(arguments);
}

static void say_end(tl_forked_line *line, uint32_t slot) {
    int how = line->block->slots[slot].how;
    bool is_told = has_ended(line, slot);
    tl_fmu_call call;
    char reason[96] = "its process was killed";
    if (is_told && WIFSIGNALED(how)) {
        (void)snprintf(reason, sizeof reason, "%s", strsignal(WTERMSIG(how)));
    } else if (is_told) {
        (void)snprintf(reason, sizeof reason, "its process has ended itself with %d", WEXITSTATUS(how));
    }
    if (slot == line->current && tl_fmu_calls_look(&line->block->calls, &call)) {
        tl_log(TL_LOG_ERROR, "FMU %s crashed in %s: %s; export it again, or ask who made it", line->name, call.function,
               reason);
        note_failure(line, "crashed in %s: %s", call.function, reason);
    } else {
        const char *which = slot == line->current ? "the" : "an earlier";
        tl_log(TL_LOG_ERROR, "a process that keeps %s state of FMU %s has ended: %s", which, line->name, reason);
        note_failure(line, "has lost the process that keeps %s state: %s", which, reason);
    }
}

/* ---- asking ---- */

static bool is_answered(const tl_forked_line *line) {
    return __atomic_load_n(&line->block->answered, __ATOMIC_ACQUIRE) == line->number;
}

/* However long it takes: who looks for how long a call lasts ends this process, and those with it. False: there will be no answer. */
static bool wait_for_answer(const tl_forked_line *line, uint32_t slot) {
    for (;;) {
        uint32_t news = __atomic_load_n(&line->block->news, __ATOMIC_ACQUIRE);
        if (is_answered(line)) {
            return true;
        }
        if (has_ended(line, slot) || keeper_has_ended(line)) {
            return is_answered(line);
        }
        tl_forked_wait(&line->block->news, news, LOOK_MS);
    }
}

static tl_status ask(tl_forked_line *line, uint32_t slot, uint32_t function) {
    line->number++;
    line->block->message.number = line->number;
    line->block->message.function = function;
    tl_forked_wake(&line->block->slots[slot].asked);
    if (wait_for_answer(line, slot)) {
        return TL_OK;
    }
    say_end(line, slot);
    return TL_FMU_FATAL;
}

tl_status tl_forked_line_ask(tl_forked_line *line, uint32_t function) {
    return ask(line, line->current, function);
}

/* ---- slots ---- */

static bool is_free(tl_forked_line *line, uint32_t slot) {
    if (line->uses[slot] == TL_FORKED_ENDING && has_ended(line, slot)) {
        line->uses[slot] = TL_FORKED_FREE;
    }
    return line->uses[slot] == TL_FORKED_FREE;
}

/* slot_count: there is none. */
static uint32_t find_free(tl_forked_line *line) {
    for (uint32_t i = 0; i < line->slot_count; i++) {
        uint32_t slot = (line->next + i) % line->slot_count;
        if (is_free(line, slot)) {
            line->next = slot + 1;
            return slot;
        }
    }
    return line->slot_count;
}

/* Those that are told to end do so at once, but if nobody lets them: then this waits, for some seconds at most. */
static uint32_t take_free(tl_forked_line *line) {
    uint32_t slot = line->slot_count;
    for (int look = 0; look < PATIENCE_LOOKS && slot == line->slot_count; look++) {
        uint32_t news = __atomic_load_n(&line->block->news, __ATOMIC_ACQUIRE);
        slot = find_free(line);
        if (slot == line->slot_count) {
            tl_forked_wait(&line->block->news, news, LOOK_MS);
        }
    }
    return slot;
}

/* Once: a search would ask again and again. */
static void say_refusal(tl_forked_line *line) {
    char why[TL_ERROR_TEXT];
    memcpy(why, line->block->message.bytes, sizeof why);
    why[sizeof why - 1] = '\0';
    if (!line->is_refused) {
        tl_log(TL_LOG_ERROR, "FMU %s %s", line->name, why);
        note_failure(line, "%s", why);
    }
    line->is_refused = true;
}

/* A copy of the process in slot `from`, in *slot. */
static tl_status fork_from(tl_forked_line *line, uint32_t from, uint32_t *slot) {
    if (line->is_refused) {
        return TL_FMU_FAILED;
    }
    *slot = take_free(line);
    if (*slot == line->slot_count) {
        tl_log(TL_LOG_ERROR, "the processes of FMU %s do not end", line->name);
        note_failure(line, "has processes that do not end");
        return TL_FMU_FAILED;
    }
    tl_forked_slot *fresh = &line->block->slots[*slot];
    fresh->over = 0;
    fresh->process = 0;
    fresh->ended = 0;
    line->block->message.numbers[0] = *slot;
    tl_status status = ask(line, from, TL_FORKED_FORK);
    if (status == TL_OK && line->block->message.status != 0) {
        say_refusal(line);
        return TL_FMU_FAILED;
    }
    line->uses[*slot] = status == TL_OK ? TL_FORKED_USED : TL_FORKED_FREE;
    return status;
}

/* ---- snapshots ---- */

static tl_forked_snapshot *find_unused(tl_forked_line *line) {
    for (uint32_t i = 0; i < line->snapshot_count; i++) {
        if (!line->snapshots[i].used) {
            return &line->snapshots[i];
        }
    }
    tl_log(TL_LOG_ERROR, "more than %u snapshots of FMU %s", (unsigned)line->snapshot_count, line->name);
    return NULL;
}

tl_status tl_forked_line_save(tl_forked_line *line, tl_forked_snapshot **snapshot) {
    tl_forked_snapshot *kept = *snapshot != NULL ? *snapshot : find_unused(line);
    uint32_t slot = 0;
    tl_status status = kept != NULL ? fork_from(line, line->current, &slot) : TL_FMU_FAILED;
    if (status != TL_OK) {
        return status;
    }
    if (kept->used) {
        end(line, kept->slot);
    }
    *kept = (tl_forked_snapshot){.slot = slot, .used = true};
    *snapshot = kept;
    line->touched = line->block->message.numbers[TL_FORKED_TOUCHED];
    return TL_OK;
}

tl_status tl_forked_line_restore(tl_forked_line *line, const tl_forked_snapshot *snapshot) {
    uint32_t slot = 0;
    tl_status status = fork_from(line, snapshot->slot, &slot);
    if (status == TL_OK) {
        end(line, line->current);
        line->current = slot;
    }
    return status;
}

void tl_forked_line_forget(tl_forked_line *line, tl_forked_snapshot *snapshot) {
    if (snapshot != NULL && snapshot->used) {
        end(line, snapshot->slot);
        snapshot->used = false;
    }
}
