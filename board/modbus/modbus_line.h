/* A serial line that Modbus (RTU) is spoken on, as it is configured.
 *
 * Purpose: the parameters that all devices of the line share, and which of them there can be. 8 data bits always.
 * Owner:   the device's name belongs to the caller. Thread: any.
 * Source:  MODBUS over Serial Line 1.02, section 2.5.1.
 */
#ifndef TL_BOARD_MODBUS_MODBUS_LINE_H
#define TL_BOARD_MODBUS_MODBUS_LINE_H

#include <stdbool.h>
#include <stdint.h>

#include "master/base/status.h"

typedef struct tl_modbus_line {
    const char *device; /* a path, best one that stays: /dev/serial/by-id/… */
    uint32_t baud;      /* one of tl_modbus_bauds */
    char parity;        /* 'N', 'E', 'O' */
    uint8_t stop_bits;  /* 1, 2 */
    bool rs485;         /* the port's driver shall switch between sending and receiving (TIOCSRS485) */
} tl_modbus_line;

/* The speeds there are, rising, up to a 0. */
extern const uint32_t tl_modbus_bauds[];

/* TL_BAD_DATA for a line that there cannot be, or whose device has no name. Opens nothing. */
tl_status tl_modbus_line_check(const tl_modbus_line *line, tl_error *error);

#endif
