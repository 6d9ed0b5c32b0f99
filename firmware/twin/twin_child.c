/* Twin in a child process, seen from the parent: see twin_child.h. */
#include "firmware/twin/twin_child.h"

#include <signal.h>
#include <stdlib.h>
#include <string.h>

#include "firmware/base/log.h"
#include "firmware/base/os.h"
#include "firmware/base/text.h"
#include "firmware/process/fmu_call_timeout.h"
#include "firmware/process/interrupt.h"
#include "firmware/twin/read_back.h"
#include "firmware/twin/twin_process.h"
#include "firmware/twin/twin_role.h"

/* Longest sleep before the process is checked. */
static const tl_time POLL = TL_SECOND / 10;

/* Longest silence in multiples of the call timeout: for a tick with all its calls, and
 * TL_FMU_CALL_TIMEOUT_CALLS for work outside of FMU calls, such as unpacking. The process itself
 * reports in which call it is, so this may be false. Missing messages cannot be forged. */
enum { TICK_CALLS = 100 };

struct tl_twin_child {
    tl_twin_child_settings settings;
    tl_twin_role_tasks tasks;
    tl_channel_settings wire;
    tl_block blocks[TL_SIDES];
    tl_block read_back; /* states shown to a reader process */
    unsigned readers;   /* number of reader processes started */
    tl_channel channel;
    const tl_twin_extra *extra;
    tl_twin_orders *orders;
    tl_twin_process *process;
    tl_time silence; /* since its last message */
    tl_time idle;    /* of this time, outside of FMU calls, as the process reports */
    tl_time asked;   /* of this time, after a request to end */
    bool has_ended;  /* its final message has come */
    bool stopping;
    tl_status last_status;
    tl_error last_error;
    int64_t least_step; /* lowest valid step of the next record */
    union {
        tl_twin_result result;
        tl_confine_facts facts;
        int32_t status;
    } payload; /* copy of a message */
};

/* ---- how it ended ---- */

/* Sanitises a text of the FMU process, which may still be writing it. */
static void copy_text(char text[TL_ERROR_TEXT], const char *reported) {
    memcpy(text, reported, TL_ERROR_TEXT);
    tl_clean_field(text, TL_ERROR_TEXT);
}

static void describe_call(const tl_twin_child *child, char *text, size_t size) {
    tl_fmu_call call;
    if (tl_fmu_calls_poll(&child->extra->calls, &call)) {
        (void)snprintf(text, size, "in %s of FMU %s", call.function, call.fmu);
    } else {
        (void)snprintf(text, size, "outside of FMU calls");
    }
}

bool tl_twin_child_was_killed_by_others(const tl_twin_child *child) {
    char why[TL_TWIN_KILLED_TEXT];
    return tl_twin_process_role(child->process)->signal == SIGKILL && !tl_twin_process_was_killed(child->process, why);
}

/* Describes an unexpected end. */
static tl_status describe_end(const tl_twin_child *child, tl_error *error) {
    const tl_role *role = tl_twin_process_role(child->process);
    char why[TL_TWIN_KILLED_TEXT];
    char where[160];
    tl_twin_process_flush(child->process);
    if (tl_twin_process_was_killed(child->process, why)) {
        return tl_fail(error, TL_FMU_FAILED, "%s", why);
    }
    describe_call(child, where, sizeof where);
    if (role->signal == SIGSYS) {
        return tl_fail(
            error, TL_FMU_FAILED,
            "the FMU process was killed by SIGSYS %s: it tried to access another process, used system calls of another "
            "architecture, or sent that signal to itself",
            where);
    }
    if (role->signal != 0) {
        return tl_fail(error, TL_FMU_FAILED, "the FMU process was ended by signal %d (%s), %s", role->signal,
                       strsignal(role->signal), where);
    }
    return tl_fail(error, TL_FMU_FAILED, "the FMU process ended unexpectedly with exit code %d, %s", role->code, where);
}

/* Kills the process after a violation of the protocol. */
static tl_status end_corrupted(tl_twin_child *child, const char *what, tl_error *error) {
    char where[160];
    describe_call(child, where, sizeof where);
    tl_twin_process_kill(child->process);
    return tl_fail(error, TL_FMU_FAILED, "the FMU process was killed, because its memory was corrupted %s: %s", where,
                   what);
}

/* ---- messages ---- */

/* TL_INTERRUPTED is valid only if we have interrupted it. */
static void take_status(tl_twin_child *child, tl_message type) {
    unsigned reported = (unsigned)child->payload.status;
    bool is_possible = reported < TL_INTERRUPTED || (reported == TL_INTERRUPTED && tl_interrupt_requested() != NULL);
    child->last_status = is_possible ? (tl_status)reported : TL_FMU_FAILED;
    child->last_error.status = child->last_status;
    copy_text(child->last_error.text, child->extra->error);
    child->has_ended = type == TL_MESSAGE_ENDED;
}

static void reset_silence(tl_twin_child *child) {
    child->silence = 0;
    child->idle = 0;
    child->asked = 0;
}

/* Time for many short calls after a request to end. A single long call is ended first, with its
 * name. */
static const tl_time LONGEST_END = TL_FMU_CALL_TIMEOUT_END + 3 * TL_SECOND;

static bool is_in_time(const tl_twin_child *child) {
    const tl_time call = child->settings.call_limit;
    return child->asked < LONGEST_END &&
           (call == 0 || (child->idle / TL_FMU_CALL_TIMEOUT_CALLS < call &&
                          child->silence / TICK_CALLS < call)); /* divided, not multiplied: the timeout may be years */
}

/* Sleeps until `wanted` messages are there, or for `longest`. Returns false if the process has been
 * silent for too long and must be killed. The watch thread checks FMU calls, but a process with
 * corrupted memory, or a hostile one, may report no call. */
static bool wait_messages(tl_twin_child *child, unsigned wanted, tl_time longest) {
    tl_fmu_call call;
    tl_time begun = tl_clock_now(NULL);
    (void)tl_channel_wait(&child->channel, wanted, 0, begun + longest);
    tl_time passed = tl_clock_now(NULL) - begun;
    passed = passed > TL_SECOND ? TL_SECOND
                                : passed; /* we may have been stopped meanwhile; that is no silence of the process */
    child->silence += passed;
    child->idle += tl_fmu_calls_poll(&child->extra->calls, &call) ? 0 : passed;
    child->asked += tl_interrupt_requested() != NULL ? passed : 0;
    return is_in_time(child);
}

static tl_status end_silent(tl_twin_child *child, tl_error *error) {
    tl_twin_process_kill(child->process);
    if (child->asked >= LONGEST_END) {
        return tl_fail(error, TL_INTERRUPTED,
                       "interrupted by %s; the FMU process was killed: it did not end within %.0f s",
                       tl_interrupt_requested(), tl_seconds(LONGEST_END));
    }
    return tl_fail(
        error, TL_FMU_FAILED,
        "the FMU process was killed: it sent nothing for %.0f s; if its FMUs need longer, raise --call-limit",
        tl_seconds(child->silence));
}

/* Copies the next message to child->payload. `allowed`: bit set of valid types. TL_FMU_FAILED: the
 * process has ended. */
static tl_status next_message(tl_twin_child *child, unsigned wanted, unsigned allowed, tl_message *type,
                              tl_error *error) {
    for (;;) {
        switch (tl_channel_take(&child->channel, type, &child->payload)) {
        case TL_CHANNEL_SOMETHING:
            reset_silence(child);
            if ((allowed & 1U << *type) == 0) {
                return end_corrupted(child, "an unexpected message", error);
            }
            if (*type == TL_MESSAGE_BUILT || *type == TL_MESSAGE_ENDED) {
                take_status(child, *type);
            }
            return TL_OK;
        case TL_CHANNEL_BROKEN:
            return end_corrupted(child, child->channel.fault.text, error);
        case TL_CHANNEL_NOTHING:
        case TL_CHANNEL_NUDGED:
            break;
        }
        if (tl_interrupt_requested() != NULL) {
            tl_twin_child_stop(child);
        }
        /* Messages sent before its end are taken first. */
        if (tl_twin_child_is_gone(child)) {
            return describe_end(child, error);
        }
        if (!tl_twin_process_reap(child->process) && !wait_messages(child, wanted, POLL)) {
            return end_silent(child, error);
        }
    }
}

static tl_status expect_message(tl_twin_child *child, tl_message wanted, tl_error *error) {
    tl_message type = wanted;
    return next_message(child, 1, 1U << wanted, &type, error);
}

/* No FMU is loaded before this message. So the exit code is reliable, and the cause was logged. */
static tl_status expect_ready(tl_twin_child *child, tl_error *error) {
    tl_status status = expect_message(child, TL_MESSAGE_READY, error);
    const tl_role *role = tl_twin_process_role(child->process);
    bool ended = status != TL_OK && role->has_ended && role->signal == 0;
    if (ended && role->code == tl_exit_code(TL_TRY_AGAIN)) {
        return tl_fail(error, TL_TRY_AGAIN, "the FMU process could not start; try again");
    }
    return status;
}

/* ---- start ---- */

static tl_status make_blocks(tl_twin_child *child, tl_error *error) {
    static const tl_block_writer writers[TL_SIDES] = {
        [TL_PARENT] = TL_BLOCK_WE_WRITE, [TL_CHILD] = TL_BLOCK_THEY_WRITE};
    child->wire = tl_twin_wire(child->settings.config, child->settings.job->attached);
    tl_status status = TL_OK;
    for (tl_side side = TL_PARENT; side < TL_SIDES && status == TL_OK; side++) {
        status =
            tl_block_make("twinlock", tl_channel_bytes(&child->wire, side), writers[side], &child->blocks[side], error);
    }
    if (status == TL_OK) {
        void *const bytes[TL_SIDES] = {child->blocks[TL_PARENT].bytes, child->blocks[TL_CHILD].bytes};
        child->extra = tl_channel_extra(&child->wire, TL_CHILD, child->blocks[TL_CHILD].bytes);
        child->orders = tl_channel_extra(&child->wire, TL_PARENT, child->blocks[TL_PARENT].bytes);
        tl_channel_open(&child->wire, TL_PARENT, bytes, &child->channel);
    }
    if (status == TL_OK && child->settings.job->reads_back && child->settings.others == NULL) {
        status = tl_block_make("twinlock-states", TL_READ_BACK_BYTES, TL_BLOCK_SPARSE, &child->read_back, error);
    }
    return status;
}

static tl_status start_process(tl_twin_child *child, tl_error *error) {
    const tl_twin_job *job = child->settings.job;
    bool is_for_states = child->settings.others != NULL || job->states_only;
    /* Processes with the same FMUs print the same; only one of them is logged. */
    bool is_silent = is_for_states || job->task == TL_TASK_PAIR || job->task == TL_TASK_METHODS;
    size_t twins = job->task == TL_TASK_PAIR ? 2 : 1;
    char title[TL_ROLE_TITLE];
    (void)snprintf(title, sizeof title, "%s [%s]", is_for_states ? TL_TWIN_READER : "twin",
                   child->settings.config->name);
    tl_status status = make_blocks(child, error);
    if (status != TL_OK) {
        return status;
    }
    tl_twin_process_settings settings = {
        .job = job,
        .fmus = tl_twin_fmus_of(child->settings.config),
        .which = child->settings.others != NULL || job->task == TL_TASK_METHODS ? 1 : 0,
        .title = title,
        .calls = &child->extra->calls,
        .channel = &child->channel,
        .page = child->settings.page,
        .is_silent = is_silent,
        .passes_signals = true,
        .call_limit = child->settings.call_limit,
        .memory_limit = child->settings.memory_limit,
        .tasks = &child->tasks,
    };
    settings.fmus.count *= twins;
    settings.fmus.unpacked_bytes *= twins;
    for (int i = 0; i < TL_ROLE_DESCRIPTORS; i++) {
        settings.given[i] = -1;
    }
    settings.given[TL_TWIN_PARENTS_BLOCK] = child->blocks[TL_PARENT].descriptor;
    settings.given[TL_TWIN_OWN_BLOCK] = child->blocks[TL_CHILD].descriptor;
    if (job->reads_back) {
        const tl_block *block = child->settings.others != NULL ? child->settings.others : &child->read_back;
        settings.given[TL_TWIN_READ_BACK] = block->descriptor;
    }
    status = tl_twin_process_start(&settings, &child->process, error);
    if (status == TL_OK) {
        status = expect_ready(child, error);
    }
    if (status == TL_OK && !is_silent && job->unconfined) {
        tl_log(TL_LOG_WARNING, "unconfined: FMUs can do what this user can");
    } else if (status == TL_OK && !is_silent) { /* missing confinement is logged once */
        char text[TL_CONFINE_TEXT];
        tl_confine_describe(&child->payload.facts, text);
        if (text[0] != '\0') {
            tl_log(TL_LOG_NOTICE, "%s", text);
        }
    }
    return status;
}

tl_status tl_twin_child_start(const tl_twin_child_settings *settings, tl_twin_child **child, tl_error *error) {
    tl_twin_child *made = calloc(1, sizeof *made);
    if (made == NULL) {
        return tl_fail(error, TL_TRY_AGAIN, "not enough memory for the FMU process");
    }
    made->settings = *settings;
    made->tasks = (tl_twin_role_tasks){.print_page = settings->print_page};
    tl_status status = start_process(made, error);
    if (status != TL_OK) {
        tl_twin_child_close(made);
        return status;
    }
    *child = made;
    return TL_OK;
}

/* ---- work ---- */

static tl_status take_account(tl_twin_child *child, const tl_account *reported, tl_account *account, tl_error *error) {
    *account = *reported;
    bool fits = account->components == child->settings.config->component_count + 1 &&
                account->matches == child->settings.config->match_count &&
                account->adjusts == child->settings.config->adjust_count;
    return fits && tl_account_is_sound(account) ? TL_OK : end_corrupted(child, "its account is invalid", error);
}

tl_status tl_twin_child_build(tl_twin_child *child, tl_account *account, tl_error *error) {
    tl_status status = expect_message(child, TL_MESSAGE_BUILT, error);
    if (status != TL_OK) {
        return status;
    }
    tl_twin_process_flush(child->process);
    if (child->last_status != TL_OK) {
        *error = child->last_error;
        return child->last_status;
    }
    return take_account(child, &child->extra->built, account, error);
}

/* Waits for the final message; `show` handles requests before it. */
static tl_status expect_end(tl_twin_child *child, tl_status (*show)(tl_twin_child *child, tl_error *error),
                            tl_error *error) {
    const unsigned allowed = 1U << TL_MESSAGE_ENDED | (show != NULL ? 1U << TL_MESSAGE_SHOWN : 0);
    tl_message type = TL_MESSAGE_SHOWN;
    tl_status status = expect_message(child, TL_MESSAGE_BUILT, error);
    while (status == TL_OK && !child->has_ended) {
        status = next_message(child, 1, allowed, &type, error);
        if (status == TL_OK && type == TL_MESSAGE_SHOWN && show != NULL) {
            status = show(child, error);
        }
    }
    if (status != TL_OK) {
        return status;
    }
    tl_twin_process_flush(child->process);
    if (child->last_status == TL_INTERRUPTED) {
        return tl_fail(error, TL_INTERRUPTED, "interrupted by %s", tl_interrupt_requested());
    }
    *error = child->last_error;
    return child->last_status;
}

/* ---- reader processes ---- */

static tl_status run_reader(const tl_twin_child *child, tl_error *error) {
    tl_twin_job job = *child->settings.job;
    tl_twin_child_settings settings = child->settings;
    tl_twin_child *reader = NULL;
    job.task = TL_TASK_READ;
    settings.job = &job;
    settings.page = NULL;
    settings.others = &child->read_back;
    tl_status status = tl_twin_child_start(&settings, &reader, error);
    if (status == TL_OK && reader != NULL) {
        status = expect_end(reader, NULL, error);
    }
    tl_twin_child_close(reader); /* kills it, because freeing its FMUs is not worth waiting for */
    if (status != TL_OK && error->text[0] == '\0') {
        return tl_fail(
            error, status,
            "its FMUs could not be loaded a second time"); /* the cause was not logged, because the process is silent */
    }
    return status;
}

/* Each request completes one component, initialised or not. If there are more, its memory is
 * corrupted or the process is hostile. */
static tl_status run_requested(tl_twin_child *child, tl_error *error) {
    const size_t most = child->read_back.size == 0 ? 0 : 2 * (child->settings.config->component_count + 1);
    tl_error end = {.text = ""};
    if (child->readers++ >= most) {
        return end_corrupted(child, "too many requests for other processes", error);
    }
    const int32_t result = (int32_t)run_reader(child, &end);
    reset_silence(child);
    if (child->stopping) {
        return TL_OK; /* it was reported */
    }
    (void)snprintf(child->orders->error, sizeof child->orders->error, "%s", end.text);
    if (!tl_channel_offer(&child->channel, TL_MESSAGE_SEEN, &result)) {
        return end_corrupted(child, child->channel.fault.text, error);
    }
    tl_channel_push(&child->channel);
    return TL_OK;
}

tl_status tl_twin_child_check(tl_twin_child *child, tl_twin_check *found, tl_error *error) {
    static const uint64_t most = (uint64_t)1 << 50; /* bytes, more than any machine has */
    tl_status status = expect_end(child, run_requested, error);
    *found = child->extra->check;
    tl_clean_field(found->why, sizeof found->why);
    bool is_sound = found->least >= 0 && found->worst >= 0 && found->memory <= most;
    return status != TL_OK || is_sound ? status : end_corrupted(child, "the results of its check are invalid", error);
}

/* ---- comparison and trial ---- */

/* Uses the name that the process wrote; if it ended in a call, the name of that FMU. Not after its
 * final message, because then the calls only free FMUs. */
static void copy_component(const tl_twin_child *child, char component[TL_ASSEMBLY_NAME]) {
    tl_fmu_call call;
    tl_clean_field(component, TL_ASSEMBLY_NAME);
    if (!child->has_ended && tl_fmu_calls_poll(&child->extra->calls, &call)) {
        (void)snprintf(component, TL_ASSEMBLY_NAME, "%s", call.fmu);
    }
}

void tl_twin_child_get_methods(const tl_twin_child *child, tl_component_methods *ways) {
    *ways = child->extra->ways;
    copy_component(child, ways->component);
    for (size_t i = 0; i < TL_RECORDER_COMPONENTS; i++) {
        ways->of[i].rollback = ways->of[i].rollback < TL_ROLLBACKS ? ways->of[i].rollback : TL_ROLLBACK_NONE;
    }
}

tl_status tl_twin_child_finish(tl_twin_child *child, tl_twin_outcome *outcome, tl_error *error) {
    *outcome = (tl_twin_outcome){.status = expect_end(child, NULL, error)};
    if (tl_interrupt_requested() != NULL) {
        return tl_fail(error, TL_INTERRUPTED, "interrupted by %s", tl_interrupt_requested());
    }
    outcome->pair = child->extra->pair;
    outcome->pair.steps = outcome->pair.steps < TL_PAIR_STEPS ? outcome->pair.steps : TL_PAIR_STEPS;
    copy_component(child, outcome->pair.component);
    tl_twin_child_get_methods(child, &outcome->ways);
    outcome->has_ended = !child->has_ended;
    (void)snprintf(outcome->text, sizeof outcome->text, "%s", error->text);
    *error = (tl_error){TL_OK, ""};
    return TL_OK;
}

void tl_twin_child_report(tl_twin_child *child, tl_fmu_refusals_listener *on_event, void *context) {
    tl_twin_process_report(child->process, on_event, context);
}

tl_status tl_twin_child_enqueue(tl_twin_child *child, const tl_recording_tick *tick, bool last, tl_error *error) {
    if (child->stopping) {
        return TL_OK; /* the tick would be ignored */
    }
    if (!tl_channel_offer(&child->channel, last ? TL_MESSAGE_FINISH : TL_MESSAGE_TICK, tick)) {
        return end_corrupted(child, child->channel.fault.text, error);
    }
    return TL_OK;
}

void tl_twin_child_push(tl_twin_child *child) {
    tl_channel_push(&child->channel);
}

void tl_twin_child_stop(tl_twin_child *child) {
    if (!child->stopping) {
        child->stopping = true;
        __atomic_store_n(&child->orders->stop, 1, __ATOMIC_RELAXED);
        while (!tl_channel_offer(&child->channel, TL_MESSAGE_END, NULL) && child->channel.fault.status == TL_OK &&
               !tl_twin_process_reap(child->process)) {
            (void)tl_channel_wait(&child->channel, TL_CHANNEL_DEPTH, 1, tl_clock_now(NULL) + POLL);
        }
        tl_channel_push(&child->channel);
    }
}

/* The final message came. Unasked, it is valid only with an error; otherwise a run would end too
 * early without notice. */
static tl_status take_end(tl_twin_child *child, bool *stopped, tl_error *error) {
    *stopped = true;
    if (child->last_status != TL_OK && child->last_status != TL_INTERRUPTED && child->last_error.text[0] == '\0') {
        return tl_fail(error, child->last_status, "the FMU process ended without a reason");
    }
    if (child->last_status != TL_OK) {
        *error = child->last_error;
        return child->last_status;
    }
    return child->stopping ? TL_OK : end_corrupted(child, "it ended before it was asked to", error);
}

tl_status tl_twin_child_take(tl_twin_child *child, int64_t tick, unsigned wanted, tl_twin_result *result, bool *stopped,
                             tl_error *error) {
    tl_message type = TL_MESSAGE_RESULT;
    const unsigned allowed = 1U << TL_MESSAGE_RESULT | 1U << TL_MESSAGE_ENDED;
    tl_status status = child->has_ended ? TL_OK : next_message(child, wanted, allowed, &type, error);
    if (status != TL_OK) {
        return status;
    }
    *stopped = false;
    if (child->has_ended) {
        return take_end(child, stopped, error);
    }
    memcpy(result, &child->payload.result, tl_twin_result_size(child->settings.config, child->settings.job->attached));
    if (!tl_twin_result_is_sound(result, child->settings.config, tick, child->least_step)) {
        result->tick = TL_TWIN_NO_TICK;
        return end_corrupted(child, "a result is invalid", error);
    }
    child->least_step = result->ready != 0 ? result->record.step + 1 : child->least_step;
    if (result->status != (int32_t)TL_OK) {
        copy_text(error->text, child->extra->error);
        error->status = (tl_status)result->status;
        if (error->text[0] == '\0') {
            return tl_fail(error, error->status, "a step failed, and the FMU process gave no reason");
        }
    }
    return (tl_status)result->status;
}

/* ---- end ---- */

tl_status tl_twin_child_end(tl_twin_child *child, tl_account *account, tl_error *error) {
    if (tl_twin_child_is_gone(child)) {
        return TL_OK; /* that was reported already */
    }
    tl_twin_child_stop(child);
    tl_status status = TL_OK;
    tl_message type = TL_MESSAGE_RESULT;
    while (status == TL_OK && !child->has_ended) {
        status = next_message(child, 1, ~0U, &type, error);
    }
    if (status == TL_OK && account != NULL) {
        status = take_account(child, &child->extra->ended, account, error);
    }
    return status;
}

/* TL_MESSAGE_END without a request to stop ends the ticks. */
tl_status tl_twin_child_explain(tl_twin_child *child, void (*advance)(void *context), void *context,
                                tl_explanation *explanation, tl_error *error) {
    const unsigned allowed = 1U << TL_MESSAGE_ENDED | 1U << TL_MESSAGE_SHOWN | 1U << TL_MESSAGE_RESULT;
    tl_message type = TL_MESSAGE_SHOWN;
    tl_status status = TL_OK;
    if (!child->stopping && !tl_channel_offer(&child->channel, TL_MESSAGE_END, NULL)) {
        return end_corrupted(child, child->channel.fault.text, error);
    }
    tl_channel_push(&child->channel);
    while (status == TL_OK && !child->has_ended) {
        status = next_message(child, 1, allowed, &type, error);
        advance(context);
    }
    if (status == TL_OK && tl_interrupt_requested() != NULL) {
        return tl_fail(error, TL_INTERRUPTED, "interrupted by %s", tl_interrupt_requested());
    }
    if (status != TL_OK || child->last_status != TL_OK) {
        *error = status == TL_OK ? child->last_error : *error;
        return status == TL_OK ? child->last_status : status;
    }
    *explanation = child->extra->explanation;
    return tl_explanation_is_sound(explanation, child->settings.config->match_count)
               ? TL_OK
               : end_corrupted(child, "its explanation is invalid", error);
}

bool tl_twin_child_refusal_may_be_cause(const tl_twin_child *child) {
    return tl_twin_process_refusal_may_be_cause(child->process);
}

bool tl_twin_child_is_gone(const tl_twin_child *child) {
    return tl_twin_process_role(child->process)->has_ended;
}

tl_status tl_twin_child_wait(tl_twin_child *child, tl_error *error) {
    const tl_role *role = tl_twin_process_role(child->process);
    if (role->has_ended) {
        return TL_OK;
    }
    reset_silence(child);
    while (!tl_twin_process_reap(child->process)) {
        if (!wait_messages(child, TL_CHANNEL_DEPTH, POLL / 20)) {
            return end_silent(child, error);
        }
    }
    return role->signal == 0 && role->code == 0 ? TL_OK : describe_end(child, error);
}

void tl_twin_child_close(tl_twin_child *child) {
    if (child == NULL) {
        return;
    }
    tl_twin_process_close(child->process);
    tl_block_close(&child->blocks[TL_PARENT]);
    tl_block_close(&child->blocks[TL_CHILD]);
    tl_block_close(&child->read_back);
    free(child);
}
