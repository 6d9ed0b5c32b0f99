/* Plant driver for Modbus: a client by TCP or serial line (RTU) that only reads (function codes 1
 * to 4).
 *
 * Purpose: polls the registers of one server, or of the units of one line, in as few requests as
 *          their addresses allow.
 * Link:    the driver reconnects to servers that are absent, fail or return, with back-off (from
 *          0.1 s, doubling, to at most 2 s). The link is up while any unit answers. A unit behind a
 *          gateway or on a line that is silent or answers with an exception affects only its own
 *          channels. The driver polls silent units last, with the same back-off; waiting for them
 *          takes at most a fifth of the time.
 * Checks:  the driver uses an answer only if transaction, protocol, length, unit, function and
 *          number of bytes are right. Otherwise it posts TL_NO_LINK and reports the problem once.
 *          It closes a TCP connection, because late bytes could be taken for the next answer.
 * Bound:   a poll waits at most timeout_s to connect (before each request, if the server sends more
 *          than it was asked for) and timeout_s for each response. By TCP the first missing or
 *          wrong response ends the poll, on a line the second one. If `host` is a name, its
 *          resolution comes on top (once per try to connect) and cannot be interrupted. On a line,
 *          add the transmission time and the wait for silence: 50 ms after a failure, about
 *          timeout_s more if bytes keep arriving. On a line, a response that has started cannot be
 *          interrupted; it ends after at most its transmission time plus 0.2 s.
 * Line:    the driver is its only master and opens it exclusively. Parameters are 8 data bits and
 *          those of tl_modbus_line. RTU responses have no number: a late one could be taken for the
 *          answer to a later request of the same kind to the same unit. So timeout_s must exceed
 *          the slowest unit's response time. After a timeout, if another request was answered, the
 *          driver does not ask this unit for timeout_s.
 * Stamp:   time of arrival of the response.
 * Source:  MODBUS Application Protocol 1.1b3, section 6.1 to 6.4; MODBUS over Serial Line 1.02,
 *          section 2.5.1.
 */
#ifndef TL_BOARD_MODBUS_MODBUS_H
#define TL_BOARD_MODBUS_MODBUS_H

#include <stdint.h>

#include "board/io/plant_access.h"
#include "board/io/plant_io.h"
#include "board/modbus/modbus_link.h"
#include "board/modbus/modbus_map.h"

typedef struct tl_modbus_settings {
    const char *host; /* name or address; ignored if line.device is set */
    uint16_t port;
    bool any_unit_id;    /* TCP: an answer may have another unit than the request, as with some devices and gateways */
    tl_modbus_line line; /* line.device: NULL for TCP */
    double timeout_s;    /* of one response and of a connect, > 0 */
    const tl_modbus_channel *channels;
    size_t channel_count;
} tl_modbus_settings;

extern const tl_plant_io_driver tl_modbus_driver;
extern const tl_plant_access tl_modbus_tcp_access, tl_modbus_rtu_access;

/* Copies the settings that it needs and does not connect yet. Errors: TL_BAD_DATA for a setting out
 * of range, a type that its table cannot hold, or a value beyond address 65535. */
tl_status tl_modbus_open(const tl_modbus_settings *settings, tl_plant_io **io, tl_error *error);

#endif
