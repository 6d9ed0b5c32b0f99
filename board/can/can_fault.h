/* What an error frame of a CAN controller means. Private to the CAN driver.
 *
 * Purpose: from the bits of the kernel's error frames to the few things that a listener can tell.
 * Source:  linux/can/error.h; ISO 11898-1, fault confinement.
 */
#ifndef TL_BOARD_CAN_CAN_FAULT_H
#define TL_BOARD_CAN_CAN_FAULT_H

#include <stdbool.h>
#include <stdint.h>

/* The controller's state. */
typedef enum tl_can_health { TL_CAN_SAME, TL_CAN_ACTIVE, TL_CAN_WARNING, TL_CAN_PASSIVE, TL_CAN_BUS_OFF } tl_can_health;

typedef struct tl_can_fault {
    tl_can_health health;  /* TL_CAN_SAME: this frame does not tell */
    bool overflow;         /* the controller had no room for a frame */
    const char *bus_error; /* what is wrong on the bus, in words; NULL: nothing */
} tl_can_fault;

/* The classes of errors that are asked for: a value of CAN_RAW_ERR_FILTER. */
extern const uint32_t tl_can_fault_classes;

/* `classes`: the id of the error frame, with or without its flags. */
tl_can_fault tl_can_fault_of(uint32_t classes, const uint8_t data[8]);

/* What a state means and what to do about it; TL_CAN_SAME has no text. */
const char *tl_can_health_text(tl_can_health health);

#endif
