/* The outcome of a Modbus request in words. */
#include "board/modbus/modbus_outcome.h"

#include <errno.h>
#include <modbus.h>
#include <stdio.h>

bool tl_modbus_outcome_is_same(const tl_modbus_outcome *a, const tl_modbus_outcome *b) {
    if (a->kind > TL_MODBUS_FAILED && b->kind > TL_MODBUS_FAILED) {
        return true;
    }
    return a->kind == b->kind && (a->kind != TL_MODBUS_FAILED || a->found == b->found);
}

/* libmodbus has words for those that Modbus defines, and a large number for others. */
static void exception_text(int code, char *text, size_t size) {
    if ((code >= 1 && code <= 8) || code == 10 || code == 11) {
        (void)snprintf(text, size, "%s", modbus_strerror(MODBUS_ENOBASE + code));
    } else {
        (void)snprintf(text, size, "exception %d, which Modbus does not define: see the manual of the device", code);
    }
}

static void failure_text(int failure, tl_time timeout, char *text, size_t size) {
    if (failure == ETIMEDOUT) {
        (void)snprintf(text, size, "no answer within %g s", tl_seconds(timeout));
    } else if (failure == EPROTO) {
        (void)snprintf(text, size, "its answer breaks off");
    } else if (failure == EBUSY) {
        (void)snprintf(text, size, "the line is never quiet: is there another master, or another speed?");
    } else {
        (void)snprintf(text, size, "%s", modbus_strerror(failure));
    }
}

void tl_modbus_outcome_text(const tl_modbus_outcome *outcome, bool on_a_line, tl_time timeout, char *text,
                            size_t size) {
    const int found = outcome->found;
    const int wanted = outcome->wanted;
    switch (outcome->kind) {
    case TL_MODBUS_EXCEPTION:
        exception_text(found, text, size);
        break;
    case TL_MODBUS_WRONG_TRANSACTION:
        (void)snprintf(text, size,
                       "answered transaction %d when asked for %d: it answers twice, or is no Modbus server", found,
                       wanted);
        break;
    case TL_MODBUS_WRONG_PROTOCOL:
        (void)snprintf(text, size, "answered in protocol %d, and Modbus is %d: is there a Modbus server at that port?",
                       found, wanted);
        break;
    case TL_MODBUS_WRONG_LENGTH:
        (void)snprintf(text, size, "gives %d bytes as the length of an answer of %d: is that a Modbus server?", found,
                       wanted);
        break;
    case TL_MODBUS_WRONG_UNIT:
        (void)snprintf(text, size, "answered as unit %d when asked for unit %d: %s", found, wanted,
                       on_a_line ? "is there another master on the line?"
                                 : "if it always does, give its source \"any_unit_id\": true");
        break;
    case TL_MODBUS_WRONG_FUNCTION:
        (void)snprintf(text, size, "answered function %d when asked for function %d: check the device%s", found, wanted,
                       on_a_line ? "" : " and the gateway before it");
        break;
    case TL_MODBUS_WRONG_BYTES:
        (void)snprintf(text, size, "answered %d bytes of values when asked for %d: check the device%s", found, wanted,
                       on_a_line ? "" : " and the gateway before it");
        break;
    case TL_MODBUS_FAILED:
    case TL_MODBUS_VALUES:
        failure_text(found, timeout, text, size);
        break;
    }
}
