/* Channel between two of our processes, and the protocol of the FMU process: see channel.h. */
#include "firmware/process/channel.h"

#include <assert.h>
#include <errno.h>
#include <limits.h>
#include <linux/futex.h>
#include <string.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

#include "firmware/base/os.h"

/* ---- protocol ---- */

enum {
    STARTING = 1U << TL_STARTING,
    BUILDING = 1U << TL_BUILDING,
    STEPPING = 1U << TL_STEPPING,
    ENDING = 1U << TL_ENDING,
    ALIVE = STARTING | BUILDING | STEPPING
};

static const struct rule {
    const char *name;
    tl_side sender;
    unsigned phases; /* phases of the sender in which it is allowed */
    tl_phase next;   /* phase of the sender afterwards */
} rules[TL_MESSAGES] = {
    [TL_MESSAGE_TICK] = {"tick", TL_PARENT, STEPPING, TL_STEPPING},
    [TL_MESSAGE_FINISH] = {"finish", TL_PARENT, STEPPING, TL_ENDING},
    [TL_MESSAGE_SEEN] = {"seen", TL_PARENT, STEPPING, TL_STEPPING},
    [TL_MESSAGE_END] = {"end", TL_PARENT, ALIVE | ENDING, TL_ENDING},
    [TL_MESSAGE_READY] = {"ready", TL_CHILD, STARTING, TL_BUILDING},
    [TL_MESSAGE_BUILT] = {"built", TL_CHILD, BUILDING, TL_STEPPING},
    [TL_MESSAGE_RESULT] = {"result", TL_CHILD, STEPPING, TL_STEPPING},
    [TL_MESSAGE_SHOWN] = {"shown", TL_CHILD, STEPPING, TL_STEPPING},
    [TL_MESSAGE_ENDED] = {"ended", TL_CHILD, ALIVE, TL_ENDING},
};

static const char *const side_names[TL_SIDES] = {"the program", "the process of the FMUs"};
static const char *const phase_names[] = {"starting", "building", "stepping", "ending"};

tl_status tl_protocol_check(const tl_protocol_sizes *sizes, const tl_protocol_phases *phases, tl_side sender,
                            uint32_t type, uint32_t length, tl_error *error) {
    const char *sender_name = side_names[sender];
    const tl_phase phase = phases->of[sender];
    if (type >= TL_MESSAGES) {
        return tl_fail(error, TL_FMU_FAILED, "%s sent message %u, which does not exist", sender_name, type);
    }
    const struct rule *rule = &rules[type];
    if (rule->sender == sender && (rule->phases & 1U << phase) != 0 && length == sizes->bytes[type]) {
        return TL_OK;
    }
    return tl_fail(error, TL_FMU_FAILED,
                   "%s sent the message \"%s\" while %s, with %u bytes: not allowed (expected %u bytes of %s)",
                   sender_name, rule->name, phase_names[phase], length, sizes->bytes[type], side_names[rule->sender]);
}

void tl_protocol_continue(tl_protocol_phases *phases, tl_message type) {
    const struct rule *rule = &rules[type];
    phases->of[rule->sender] = rule->next;
    /* The parent follows the child's phase, unless the child is ending. */
    if (rule->sender == TL_CHILD && rule->next > phases->of[TL_PARENT] && rule->next != TL_ENDING) {
        phases->of[TL_PARENT] = rule->next;
    }
}

uint32_t tl_protocol_longest(const tl_protocol_sizes *sizes, tl_side sender) {
    uint32_t longest = 0;
    for (size_t i = 0; i < TL_MESSAGES; i++) {
        if (rules[i].sender == sender && sizes->bytes[i] > longest) {
            longest = sizes->bytes[i];
        }
    }
    return longest;
}

/* ---- Rings in shared memory.
 *
 * Counters count all messages and wrap around; only their differences are used. A side that goes to
 * sleep
 *   1. reads the other side's bell, 2. publishes that it sleeps and what it waits for, 3. checks
 *   whether that is there, 4. waits until the bell changes.
 * A side that has something to publish
 *   1. publishes it, 2. checks whether the other side sleeps, 3. changes its own bell and wakes the
 *   other side.
 * All these accesses are sequentially consistent. So if both sides do this at once, at least one
 * sees the change of the other. There are no fences, because ThreadSanitizer does not support them.
 */

enum { LINE = 64, PAGE = 4096, MASK = TL_CHANNEL_DEPTH - 1, WANT_BITS = 16, NUDGE_PAUSE_NS = 50000 };

/* Counters of a side, at the start of its block; separate cache lines avoid false sharing. */
typedef struct tl_channel_control {
    uint32_t pushed __attribute__((aligned(LINE))); /* messages that can be received */
    uint32_t urgent;                                /* messages up to this number wake the other side at once */
    uint32_t taken __attribute__((aligned(LINE)));  /* messages received from the other side */
    uint32_t sleep __attribute__((aligned(LINE)));  /* odd: it sleeps; each sleep has its own number */
    uint32_t wants;                               /* while it sleeps: messages, and from bit WANT_BITS on free slots */
    uint32_t bell __attribute__((aligned(LINE))); /* futex of the other side */
} tl_channel_control;

typedef struct slot {
    uint32_t type;
    uint32_t length;
    uint8_t payload[];
} slot;

/* ---- Layout ---- */

static size_t round_up(size_t bytes, size_t to) {
    return (bytes + to - 1) / to * to;
}

static size_t stride_of(const tl_channel_settings *settings, tl_side side) {
    return round_up(sizeof(slot) + tl_protocol_longest(&settings->sizes, side), LINE);
}

static size_t extra_at(const tl_channel_settings *settings, tl_side side) {
    return PAGE + TL_CHANNEL_DEPTH * stride_of(settings, side);
}

size_t tl_channel_bytes(const tl_channel_settings *settings, tl_side side) {
    return round_up(extra_at(settings, side) + settings->extra[side], PAGE);
}

void *tl_channel_extra(const tl_channel_settings *settings, tl_side side, void *block) {
    return settings->extra[side] == 0 ? NULL : (uint8_t *)block + extra_at(settings, side);
}

void tl_channel_open(const tl_channel_settings *settings, tl_side side, void *const blocks[TL_SIDES],
                     tl_channel *channel) {
    tl_side other = side == TL_PARENT ? TL_CHILD : TL_PARENT;
    assert((uintptr_t)blocks[side] % LINE == 0 && (uintptr_t)blocks[other] % LINE == 0);
    *channel = (tl_channel){.settings = *settings,
                            .side = side,
                            .own = blocks[side],
                            .other = blocks[other],
                            .own_slots = (uint8_t *)blocks[side] + PAGE,
                            .other_slots = (const uint8_t *)blocks[other] + PAGE,
                            .own_stride = stride_of(settings, side),
                            .other_stride = stride_of(settings, other)};
}

/* ---- Reading the other side's counters ---- */

static tl_side other_side(const tl_channel *channel) {
    return channel->side == TL_PARENT ? TL_CHILD : TL_PARENT;
}

static bool is_broken(const tl_channel *channel) {
    return channel->fault.status != TL_OK;
}

/* A count above the ring size is a fault of the other side. */
static uint32_t check_count(tl_channel *channel, uint32_t count) {
    if (count > TL_CHANNEL_DEPTH && !is_broken(channel)) {
        (void)tl_fail(&channel->fault, TL_FMU_FAILED,
                      "%s reports %u messages in a ring of %d: its shared memory is corrupted",
                      side_names[other_side(channel)], count, (int)TL_CHANNEL_DEPTH);
    }
    return count <= TL_CHANNEL_DEPTH ? count : 0;
}

/* Returns the number of messages to receive; 0 if the channel is broken. */
static uint32_t count_messages(tl_channel *channel) {
    channel->other_pushed = __atomic_load_n(&channel->other->pushed, __ATOMIC_SEQ_CST);
    return check_count(channel, channel->other_pushed - channel->taken);
}

/* Returns the number of our messages that the other side has not received; 0 if the channel is
 * broken. */
static uint32_t count_backlog(tl_channel *channel) {
    channel->other_taken = __atomic_load_n(&channel->other->taken, __ATOMIC_SEQ_CST);
    return check_count(channel, channel->offered - channel->other_taken);
}

/* ---- Sending ---- */

/* Returns whether an urgent message was not yet received. */
static bool is_urgent(uint32_t urgent, uint32_t taken) {
    return (int32_t)(urgent - taken) > 0;
}

bool tl_channel_offer(tl_channel *channel, tl_message type, const void *payload) {
    if (channel->offered - channel->other_taken >= TL_CHANNEL_DEPTH && count_backlog(channel) >= TL_CHANNEL_DEPTH) {
        return false;
    }
    if (is_broken(channel)) {
        return false;
    }
    uint32_t length = channel->settings.sizes.bytes[type];
    assert(tl_protocol_check(&channel->settings.sizes, &channel->phases, channel->side, type, length, NULL) == TL_OK);
    slot *target = (slot *)(void *)(channel->own_slots + (channel->offered & MASK) * channel->own_stride);
    target->type = (uint32_t)type;
    target->length = length;
    if (length > 0) {
        memcpy(target->payload, payload, length);
    }
    channel->offered++;
    if (type != TL_MESSAGE_TICK && type != TL_MESSAGE_RESULT) {
        channel->urgent = channel->offered;
    }
    tl_protocol_continue(&channel->phases, type);
    return true;
}

/* Wakes all waiters, because a hostile other side may wait on this bell with several threads. */
static void wake_all(const uint32_t *bell) {
    (void)syscall(SYS_futex, bell, FUTEX_WAKE, INT_MAX, NULL, NULL, 0);
}

/* Wakes the other side if it sleeps and its condition is met; with `partly`, if it is partly met.
 */
static void wake_other(tl_channel *channel, bool partly) {
    uint32_t sleep = __atomic_load_n(&channel->other->sleep, __ATOMIC_SEQ_CST);
    if ((sleep & 1) == 0 || sleep == channel->woken) {
        return;
    }
    uint32_t wants = __atomic_load_n(&channel->other->wants, __ATOMIC_RELAXED);
    uint32_t messages = wants & ((1U << WANT_BITS) - 1);
    uint32_t room = wants >> WANT_BITS;
    uint32_t waiting = count_backlog(channel);
    uint32_t pending = count_messages(channel);
    uint32_t free_slots = TL_CHANNEL_DEPTH - pending;
    bool urgent = is_urgent(channel->urgent, channel->other_taken);
    if ((messages > 0 && waiting >= (partly || urgent ? 1 : messages)) ||
        (room > 0 && free_slots >= (partly ? 1 : room))) {
        channel->woken = sleep;
        (void)__atomic_add_fetch(&channel->own->bell, 1, __ATOMIC_SEQ_CST);
        wake_all(&channel->own->bell);
    }
}

static void publish_counters(tl_channel *channel) {
    if (!is_urgent(channel->urgent, channel->other_taken)) {
        channel->urgent = channel->other_taken; /* keeps up, so that wrap-around does not make it look new */
    }
    __atomic_store_n(&channel->own->urgent, channel->urgent, __ATOMIC_RELAXED);
    __atomic_store_n(&channel->own->pushed, channel->offered, __ATOMIC_SEQ_CST);
    __atomic_store_n(&channel->own->taken, channel->taken, __ATOMIC_SEQ_CST);
}

/* Only a push wakes a sleeping side, so this store needs no order with the sleep flag. */
void tl_channel_show(tl_channel *channel) {
    __atomic_store_n(&channel->own->pushed, channel->offered, __ATOMIC_RELEASE);
}

void tl_channel_push(tl_channel *channel) {
    publish_counters(channel);
    wake_other(channel, false);
}

/* ---- Receiving ---- */

/* Loads the next message into the cache. */
static void fetch_ahead(const tl_channel *channel) {
    if (channel->other_pushed != channel->taken) {
        const uint8_t *next = channel->other_slots + (channel->taken & MASK) * channel->other_stride;
        for (size_t i = 0; i < channel->other_stride; i += LINE) {
            __builtin_prefetch(next + i);
        }
    }
}

tl_channel_event tl_channel_take(tl_channel *channel, tl_message *type, void *payload) {
    if (!is_broken(channel) && channel->other_pushed == channel->taken && count_messages(channel) == 0 &&
        !is_broken(channel)) {
        return TL_CHANNEL_NOTHING;
    }
    const slot *target =
        (const slot *)(const void *)(channel->other_slots + (channel->taken & MASK) * channel->other_stride);
    uint32_t kind = __atomic_load_n(&target->type, __ATOMIC_RELAXED);
    uint32_t length = __atomic_load_n(&target->length, __ATOMIC_RELAXED);
    if (is_broken(channel) || tl_protocol_check(&channel->settings.sizes, &channel->phases, other_side(channel), kind,
                                                length, &channel->fault) != TL_OK) {
        return TL_CHANNEL_BROKEN;
    }
    if (length > 0) {
        memcpy(payload, target->payload, length);
    }
    *type = (tl_message)kind;
    tl_protocol_continue(&channel->phases, *type);
    channel->taken++;
    __atomic_store_n(&channel->own->taken, channel->taken, __ATOMIC_RELEASE);
    fetch_ahead(channel);
    return TL_CHANNEL_SOMETHING;
}

/* ---- Sleeping ---- */

static bool is_nudged(tl_channel *channel) {
    uint32_t nudges = __atomic_load_n(&channel->nudges, __ATOMIC_SEQ_CST);
    bool is_new = nudges != channel->heeded;
    __atomic_store_n(&channel->heeded, nudges, __ATOMIC_SEQ_CST);
    return is_new;
}

/* Returns whether the condition is met, or partly met while the other side sleeps and was not
 * woken. */
static bool is_served(tl_channel *channel, uint32_t messages, uint32_t room) {
    uint32_t sleep = __atomic_load_n(&channel->other->sleep, __ATOMIC_SEQ_CST);
    bool sleeps = (sleep & 1) != 0 && sleep != channel->woken;
    uint32_t waiting = count_messages(channel);
    uint32_t free_slots = TL_CHANNEL_DEPTH - count_backlog(channel);
    bool urgent = is_urgent(__atomic_load_n(&channel->other->urgent, __ATOMIC_RELAXED), channel->taken);
    return (messages > 0 && waiting >= (sleeps || urgent ? 1 : messages)) ||
           (room > 0 && free_slots >= (sleeps ? 1 : room));
}

/* Returns 0, or an errno: the time is over, or a signal arrived. */
static int wait_for_bell(const tl_channel *channel, uint32_t bell, tl_time until) {
    struct timespec instant = {.tv_sec = (time_t)(until / TL_SECOND), .tv_nsec = (long)(until % TL_SECOND)};
    long result =
        syscall(SYS_futex, &channel->other->bell, FUTEX_WAIT_BITSET, bell, &instant, NULL, FUTEX_BITSET_MATCH_ANY);
    return result == 0 || errno == EAGAIN ? 0 : errno;
}

static tl_channel_event wait_once(tl_channel *channel, uint32_t messages, uint32_t room, tl_time until, bool *is_over) {
    uint32_t bell = __atomic_load_n(&channel->other->bell, __ATOMIC_SEQ_CST);
    uint32_t sleep = channel->own->sleep + 1;
    int code = 0;
    __atomic_store_n(&channel->own->wants, messages | room << WANT_BITS, __ATOMIC_RELAXED);
    __atomic_store_n(&channel->own->sleep, sleep, __ATOMIC_SEQ_CST);
    __atomic_store_n(&channel->sleeps, true, __ATOMIC_SEQ_CST);
    wake_other(channel, true);
    bool nudged = is_nudged(channel);
    bool served = is_served(channel, messages, room);
    if (!nudged && !served && !is_broken(channel)) {
        code = wait_for_bell(channel, bell, until);
        nudged = is_nudged(channel);
        served = is_served(channel, messages, room);
    }
    __atomic_store_n(&channel->own->sleep, sleep + 1, __ATOMIC_SEQ_CST);
    __atomic_store_n(&channel->sleeps, false, __ATOMIC_SEQ_CST);
    if (is_broken(channel)) {
        return TL_CHANNEL_BROKEN;
    }
    if (nudged || code == EINTR) {
        return TL_CHANNEL_NUDGED;
    }
    *is_over = code != 0 || tl_clock_now(NULL) >= until;
    return served ? TL_CHANNEL_SOMETHING : TL_CHANNEL_NOTHING;
}

tl_channel_event tl_channel_wait(tl_channel *channel, uint32_t messages, uint32_t room, tl_time until) {
    bool is_over = false;
    tl_channel_event outcome = TL_CHANNEL_NOTHING;
    assert(messages + room > 0 && messages <= TL_CHANNEL_DEPTH && room <= TL_CHANNEL_DEPTH);
    publish_counters(channel);
    while (outcome == TL_CHANNEL_NOTHING && !is_over) { /* a change of the bell without a reason has no effect */
        outcome = wait_once(channel, messages, room, until, &is_over);
    }
    return outcome;
}

void tl_channel_nudge(tl_channel *channel) {
    const struct timespec pause = {.tv_nsec = NUDGE_PAUSE_NS};
    uint32_t own_nudge = __atomic_add_fetch(&channel->nudges, 1, __ATOMIC_SEQ_CST);
    /* We cannot write the other side's bell. So wake our waiting thread again and again until it
     * has noticed. */
    while (__atomic_load_n(&channel->sleeps, __ATOMIC_SEQ_CST) &&
           (int32_t)(__atomic_load_n(&channel->heeded, __ATOMIC_SEQ_CST) - own_nudge) < 0) {
        wake_all(&channel->other->bell);
        (void)nanosleep(&pause, NULL);
    }
}
