/* Error frames in words: see can_fault.h. */
#include "board/can/can_fault.h"

#include <linux/can.h>
#include <linux/can/error.h>
#include <stddef.h>

/* Not those that only a sender has: lost arbitration, missing acknowledgement, time-out. */
const uint32_t tl_can_fault_classes =
    CAN_ERR_CRTL | CAN_ERR_PROT | CAN_ERR_TRX | CAN_ERR_BUSOFF | CAN_ERR_BUSERROR | CAN_ERR_RESTARTED;

enum { CONTROLLER = 1, VIOLATION = 2, PLACE = 3, TRANSCEIVER = 4 }; /* bytes of the data */

static tl_can_health health_of(uint32_t classes, uint8_t controller) {
    if ((classes & CAN_ERR_BUSOFF) != 0) {
        return TL_CAN_BUS_OFF;
    }
    if ((classes & CAN_ERR_RESTARTED) != 0) {
        return TL_CAN_ACTIVE;
    }
    if ((classes & CAN_ERR_CRTL) == 0) {
        return TL_CAN_SAME;
    }
    if ((controller & (CAN_ERR_CRTL_RX_PASSIVE | CAN_ERR_CRTL_TX_PASSIVE)) != 0) {
        return TL_CAN_PASSIVE;
    }
    if ((controller & (CAN_ERR_CRTL_RX_WARNING | CAN_ERR_CRTL_TX_WARNING)) != 0) {
        return TL_CAN_WARNING;
    }
    return (controller & CAN_ERR_CRTL_ACTIVE) != 0 ? TL_CAN_ACTIVE : TL_CAN_SAME;
}

static const char *violation_of(uint8_t kind, uint8_t place) {
    if (place == CAN_ERR_PROT_LOC_CRC_SEQ || place == CAN_ERR_PROT_LOC_CRC_DEL) {
        return "wrong checksums";
    }
    if ((kind & CAN_ERR_PROT_STUFF) != 0) {
        return "bit stuffing errors";
    }
    if ((kind & CAN_ERR_PROT_FORM) != 0) {
        return "frames of a wrong form";
    }
    return (kind & CAN_ERR_PROT_OVERLOAD) != 0 ? "overload frames" : "bit errors";
}

static const char *transceiver_of(uint8_t status) {
    switch (status) {
    case CAN_ERR_TRX_CANH_NO_WIRE:
        return "no wire at CAN high";
    case CAN_ERR_TRX_CANL_NO_WIRE:
        return "no wire at CAN low";
    case CAN_ERR_TRX_CANL_SHORT_TO_CANH:
        return "CAN low and CAN high touch";
    default:
        return "a fault of the transceiver or of a wire";
    }
}

tl_can_fault tl_can_fault_of(uint32_t classes, const uint8_t data[8]) {
    tl_can_fault fault = {.health = health_of(classes, data[CONTROLLER])};
    fault.overflow = (classes & CAN_ERR_CRTL) != 0 && (data[CONTROLLER] & CAN_ERR_CRTL_RX_OVERFLOW) != 0;
    if ((classes & CAN_ERR_TRX) != 0 && data[TRANSCEIVER] != CAN_ERR_TRX_UNSPEC) {
        fault.bus_error = transceiver_of(data[TRANSCEIVER]);
    } else if ((classes & (CAN_ERR_PROT | CAN_ERR_BUSERROR)) != 0) {
        fault.bus_error = violation_of(data[VIOLATION], data[PLACE]);
    }
    return fault;
}

const char *tl_can_health_text(tl_can_health health) {
    switch (health) {
    case TL_CAN_ACTIVE:
        return "error active again: the controller counts few errors";
    case TL_CAN_WARNING:
        return "error warning: the controller counts many errors; check bit rate, termination and wiring";
    case TL_CAN_PASSIVE:
        return "error passive: the controller counts very many errors; check bit rate, termination and wiring";
    case TL_CAN_BUS_OFF:
        return "bus-off: the controller has left the bus; check bit rate, termination and wiring, and set `restart-ms` "
               "so that it comes back by itself";
    case TL_CAN_SAME:
        break;
    }
    return "";
}
