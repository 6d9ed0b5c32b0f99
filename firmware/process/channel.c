/* A channel between two of our processes: calls and answers of fixed sizes in shared memory, and the protocol of the process with FMUs: see channel.h. */
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
    unsigned phases; /* of the sender, in which it is allowed */
    tl_phase next;   /* the sender's phase after it */
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
    const char *who = side_names[sender];
    const tl_phase phase = phases->of[sender];
    if (type >= TL_MESSAGES) {
        return tl_fail(error, TL_FMU_FAILED, "%s sent a message of no kind there is, %u", who, type);
    }
    const struct rule *rule = &rules[type];
    if (rule->sender == sender && (rule->phases & 1U << phase) != 0 && length == sizes->bytes[type]) {
        return TL_OK;
    }
    return tl_fail(error, TL_FMU_FAILED,
                   "%s sent the message \"%s\" while %s, with %u bytes: not allowed (expected %u bytes of %s)", who,
                   rule->name, phase_names[phase], length, sizes->bytes[type], side_names[rule->sender]);
}

void tl_protocol_go_on(tl_protocol_phases *phases, tl_message type) {
    const struct rule *rule = &rules[type];
    phases->of[rule->sender] = rule->next;
    /* What the child has reached the parent may use, unless it is ending. */
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

/* ---- Rings in shared memory:
 *
 * Counters count messages for ever and wrap around; their differences count. A side that goes to sleep
 *   1. reads the other's bell, 2. says that it sleeps and what it wants, 3. looks whether that is there, 4. waits for the bell to change,
 * and one that has something to show
 *   1. shows it, 2. looks whether the other sleeps, 3. changes its own bell and wakes.
 * Sleep, counters and what is looked at are sequentially consistent, so at least one of two that do this at once sees the other. No fences:
 * ThreadSanitizer does not know them. */

enum { LINE = 64, PAGE = 4096, MASK = TL_CHANNEL_DEPTH - 1, WANT_BITS = 16, NUDGE_AGAIN_NS = 50000 };

/* A side's counters, each on a line of its own: at the beginning of its block. */
typedef struct tl_channel_control {
    uint32_t pushed __attribute__((aligned(LINE))); /* its messages that can be taken */
    uint32_t urgent;                                /* those up to this one are not kept for a batch */
    uint32_t taken __attribute__((aligned(LINE)));  /* of the other's */
    uint32_t sleep __attribute__((aligned(LINE)));  /* odd: it sleeps; each sleep has its number */
    uint32_t wants;                                 /* when it sleeps: messages, and from bit WANT_BITS on room */
    uint32_t bell __attribute__((aligned(LINE)));   /* what the other waits for to change */
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

/* ---- What the other says ---- */

static tl_side other_side(const tl_channel *channel) {
    return channel->side == TL_PARENT ? TL_CHILD : TL_PARENT;
}

static bool is_broken(const tl_channel *channel) {
    return channel->fault.status != TL_OK;
}

/* More than a ring holds, of what the other counts. */
static uint32_t check_count(tl_channel *channel, uint32_t count) {
    if (count > TL_CHANNEL_DEPTH && !is_broken(channel)) {
        (void)tl_fail(&channel->fault, TL_FMU_FAILED, "%s counts %u messages in a ring of %d",
                      side_names[other_side(channel)], count, (int)TL_CHANNEL_DEPTH);
    }
    return count <= TL_CHANNEL_DEPTH ? count : 0;
}

/* Messages that can be taken; 0 if the channel is broken. */
static uint32_t look_for_messages(tl_channel *channel) {
    channel->other_pushed = __atomic_load_n(&channel->other->pushed, __ATOMIC_SEQ_CST);
    return check_count(channel, channel->other_pushed - channel->taken);
}

/* Messages of ours that the other has not taken; 0 if the channel is broken. */
static uint32_t look_for_backlog(tl_channel *channel) {
    channel->other_taken = __atomic_load_n(&channel->other->taken, __ATOMIC_SEQ_CST);
    return check_count(channel, channel->offered - channel->other_taken);
}

/* ---- Sending ---- */

/* Whether one of them is not taken. */
static bool is_urgent(uint32_t urgent, uint32_t taken) {
    return (int32_t)(urgent - taken) > 0;
}

bool tl_channel_offer(tl_channel *channel, tl_message type, const void *payload) {
    if (channel->offered - channel->other_taken >= TL_CHANNEL_DEPTH && look_for_backlog(channel) >= TL_CHANNEL_DEPTH) {
        return false;
    }
    if (is_broken(channel)) {
        return false;
    }
    uint32_t length = channel->settings.sizes.bytes[type];
    assert(tl_protocol_check(&channel->settings.sizes, &channel->phases, channel->side, type, length, NULL) == TL_OK);
    slot *place = (slot *)(void *)(channel->own_slots + (channel->offered & MASK) * channel->own_stride);
    place->type = (uint32_t)type;
    place->length = length;
    if (length > 0) {
        memcpy(place->payload, payload, length);
    }
    channel->offered++;
    if (type != TL_MESSAGE_TICK && type != TL_MESSAGE_RESULT) {
        channel->urgent = channel->offered;
    }
    tl_protocol_go_on(&channel->phases, type);
    return true;
}

/* Everybody who waits for a bell: the one who should, and whom a hostile other may have put there. */
static void wake_all(const uint32_t *bell) {
    (void)syscall(SYS_futex, bell, FUTEX_WAKE, INT_MAX, NULL, NULL, 0);
}

/* Wakes the other if it sleeps, and there is what it wants; if `anything`, a part of that is enough. */
static void wake_other(tl_channel *channel, bool anything) {
    uint32_t sleep = __atomic_load_n(&channel->other->sleep, __ATOMIC_SEQ_CST);
    if ((sleep & 1) == 0 || sleep == channel->woken) {
        return;
    }
    uint32_t wants = __atomic_load_n(&channel->other->wants, __ATOMIC_RELAXED);
    uint32_t messages = wants & ((1U << WANT_BITS) - 1);
    uint32_t room = wants >> WANT_BITS;
    uint32_t there = look_for_backlog(channel);
    uint32_t pending = look_for_messages(channel);
    uint32_t room_there = TL_CHANNEL_DEPTH - pending;
    bool urgent = is_urgent(channel->urgent, channel->other_taken);
    if ((messages > 0 && there >= (anything || urgent ? 1 : messages)) ||
        (room > 0 && room_there >= (anything ? 1 : room))) {
        channel->woken = sleep;
        (void)__atomic_add_fetch(&channel->own->bell, 1, __ATOMIC_SEQ_CST);
        wake_all(&channel->own->bell);
    }
}

static void show(tl_channel *channel) {
    if (!is_urgent(channel->urgent, channel->other_taken)) {
        channel->urgent = channel->other_taken; /* moves on, so that it never looks new when counters wrap around */
    }
    __atomic_store_n(&channel->own->urgent, channel->urgent, __ATOMIC_RELAXED);
    __atomic_store_n(&channel->own->pushed, channel->offered, __ATOMIC_SEQ_CST);
    __atomic_store_n(&channel->own->taken, channel->taken, __ATOMIC_SEQ_CST);
}

/* Whoever sleeps is woken by a push only, so the order with that is not needed here. */
void tl_channel_show(tl_channel *channel) {
    __atomic_store_n(&channel->own->pushed, channel->offered, __ATOMIC_RELEASE);
}

void tl_channel_push(tl_channel *channel) {
    show(channel);
    wake_other(channel, false);
}

/* ---- Taking ---- */

/* So that it is here when it is taken. */
static void fetch_ahead(const tl_channel *channel) {
    if (channel->other_pushed != channel->taken) {
        const uint8_t *next = channel->other_slots + (channel->taken & MASK) * channel->other_stride;
        for (size_t i = 0; i < channel->other_stride; i += LINE) {
            __builtin_prefetch(next + i);
        }
    }
}

tl_channel_news tl_channel_take(tl_channel *channel, tl_message *type, void *payload) {
    if (!is_broken(channel) && channel->other_pushed == channel->taken && look_for_messages(channel) == 0 &&
        !is_broken(channel)) {
        return TL_CHANNEL_NOTHING;
    }
    const slot *place =
        (const slot *)(const void *)(channel->other_slots + (channel->taken & MASK) * channel->other_stride);
    uint32_t kind = __atomic_load_n(&place->type, __ATOMIC_RELAXED);
    uint32_t length = __atomic_load_n(&place->length, __ATOMIC_RELAXED);
    if (is_broken(channel) || tl_protocol_check(&channel->settings.sizes, &channel->phases, other_side(channel), kind,
                                                length, &channel->fault) != TL_OK) {
        return TL_CHANNEL_BROKEN;
    }
    if (length > 0) {
        memcpy(payload, place->payload, length);
    }
    *type = (tl_message)kind;
    tl_protocol_go_on(&channel->phases, *type);
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

/* Whether there is what is wanted, or a part of it while the other sleeps, whom nobody has woken. */
static bool is_served(tl_channel *channel, uint32_t messages, uint32_t room) {
    uint32_t sleep = __atomic_load_n(&channel->other->sleep, __ATOMIC_SEQ_CST);
    bool sleeps = (sleep & 1) != 0 && sleep != channel->woken;
    uint32_t there = look_for_messages(channel);
    uint32_t room_there = TL_CHANNEL_DEPTH - look_for_backlog(channel);
    bool urgent = is_urgent(__atomic_load_n(&channel->other->urgent, __ATOMIC_RELAXED), channel->taken);
    return (messages > 0 && there >= (sleeps || urgent ? 1 : messages)) ||
           (room > 0 && room_there >= (sleeps ? 1 : room));
}

/* 0, or errno: the time is over, a signal came. */
static int wait_for_bell(const tl_channel *channel, uint32_t bell, tl_time until) {
    struct timespec instant = {.tv_sec = (time_t)(until / TL_SECOND), .tv_nsec = (long)(until % TL_SECOND)};
    long result =
        syscall(SYS_futex, &channel->other->bell, FUTEX_WAIT_BITSET, bell, &instant, NULL, FUTEX_BITSET_MATCH_ANY);
    return result == 0 || errno == EAGAIN ? 0 : errno;
}

static tl_channel_news look_once(tl_channel *channel, uint32_t messages, uint32_t room, tl_time until, bool *is_over) {
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

tl_channel_news tl_channel_wait(tl_channel *channel, uint32_t messages, uint32_t room, tl_time until) {
    bool is_over = false;
    tl_channel_news news = TL_CHANNEL_NOTHING;
    assert(messages + room > 0 && messages <= TL_CHANNEL_DEPTH && room <= TL_CHANNEL_DEPTH);
    show(channel);
    while (news == TL_CHANNEL_NOTHING && !is_over) { /* whoever changes the bell without a reason gets nothing by it */
        news = look_once(channel, messages, room, until, &is_over);
    }
    return news;
}

void tl_channel_nudge(tl_channel *channel) {
    const struct timespec pause = {.tv_nsec = NUDGE_AGAIN_NS};
    uint32_t mine = __atomic_add_fetch(&channel->nudges, 1, __ATOMIC_SEQ_CST);
    /* The bell is not ours to change. So who is between looking and waiting is woken again, until it has noticed. */
    while (__atomic_load_n(&channel->sleeps, __ATOMIC_SEQ_CST) &&
           (int32_t)(__atomic_load_n(&channel->heeded, __ATOMIC_SEQ_CST) - mine) < 0) {
        wake_all(&channel->other->bell);
        (void)nanosleep(&pause, NULL);
    }
}
