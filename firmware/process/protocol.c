/* The table of all messages: see protocol.h. */
#include "firmware/process/protocol.h"

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

static tl_status refuse(const tl_protocol_sizes *sizes, const tl_protocol_phases *phases, tl_side sender, uint32_t type,
                        uint32_t length, tl_error *error) {
    const char *who = side_names[sender];
    if (type >= TL_MESSAGES) {
        return tl_fail(error, TL_FMU_FAILED, "%s sent a message of no kind there is, %u", who, type);
    }
    const struct rule *rule = &rules[type];
    if (rule->sender != sender) {
        return tl_fail(error, TL_FMU_FAILED, "%s sent the message \"%s\", which only %s may send", who, rule->name,
                       side_names[rule->sender]);
    }
    if ((rule->phases & 1U << phases->of[sender]) == 0) {
        return tl_fail(error, TL_FMU_FAILED, "%s sent the message \"%s\" while %s, when it is not allowed", who,
                       rule->name, phase_names[phases->of[sender]]);
    }
    return tl_fail(error, TL_FMU_FAILED, "%s sent the message \"%s\" with %u bytes instead of %u", who, rule->name,
                   length, sizes->bytes[type]);
}

tl_status tl_protocol_check(const tl_protocol_sizes *sizes, const tl_protocol_phases *phases, tl_side sender,
                            uint32_t type, uint32_t length, tl_error *error) {
    if (type < TL_MESSAGES && rules[type].sender == sender && (rules[type].phases & 1U << phases->of[sender]) != 0 &&
        length == sizes->bytes[type]) {
        return TL_OK;
    }
    return refuse(sizes, phases, sender, type, length, error);
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
