/* Plant I/O driver: Modbus client, by TCP or on a serial line (RTU), that only reads (function codes 1 to 4).
 *
 * Purpose: polls the registers of one server, or of the units of one line, in as few requests as their addresses allow.
 * Link:    absent, dying and returning servers are survived: reconnect with back-off (from 0.1 s, doubling, to at
 *          most 2 s). The link is up while anything answers. One unit behind a gateway or on a line that is silent, or
 *          answers with an exception, costs its own channels only: it is asked last, with the same back-off, and so
 *          rarely that waiting for such units takes at most a fifth of the time.
 * Believed: only an answer that is right in transaction, protocol, length, unit, function and number of bytes. Of any
 *          other nothing is posted, and the connection is given up, so that nothing late or extra on it is taken for a
 *          later answer; what was wrong is told once.
 * Bound:   a poll waits at most timeout_s to connect (before each request, where the server sends more than it was asked
 *          for) and timeout_s for each response; by TCP the first response that does not come, or is wrong, ends it, on a
 *          line the second. Where `host` is a name, resolving it comes on top (once per attempt to connect) and cannot be
 *          interrupted. On a line the time on the wire is added, and up to 50 ms (after
 *          a failure) until it is quiet; a response that has begun can only be interrupted where it breaks off, after 0.2 s.
 * Line:    it has one master, us, and is opened exclusively. Parameters are 8 data bits, and those of tl_modbus_line. A
 *          response has no number: one that comes later than timeout_s and the silence after it could be taken for that
 *          of a later request of the same kind to the same unit. So timeout_s must be longer than the slowest unit takes,
 *          and after a silence nothing else is asked of the unit for that time.
 * Stamp:   when the response had arrived.
 * Source:  MODBUS Application Protocol 1.1b3, section 6.1 to 6.4; MODBUS over Serial Line 1.02, section 2.5.1.
 */
#ifndef TL_BOARD_MODBUS_MODBUS_H
#define TL_BOARD_MODBUS_MODBUS_H

#include <stdint.h>

#include "board/io/plant_access.h"
#include "board/io/plant_io.h"
#include "board/modbus/modbus_link.h"
#include "board/modbus/modbus_map.h"

typedef struct tl_modbus_settings {
    const char *host; /* name or address; not read where line.device is given */
    uint16_t port;
    bool any_unit_id;    /* TCP: an answer may name another unit than was asked, as some devices and gateways do */
    tl_modbus_line line; /* line.device: NULL for TCP */
    double timeout_s;    /* of one response and of a connect, > 0 */
    const tl_modbus_channel *channels;
    size_t channel_count;
} tl_modbus_settings;

extern const tl_plant_io_driver tl_modbus_driver;
extern const tl_plant_access tl_modbus_tcp_access, tl_modbus_rtu_access;

/* Copies what it needs of `settings`. Does not connect yet. Errors: TL_BAD_DATA for a setting out of its range,
 * a type that its table cannot hold, a value beyond address 65535. */
tl_status tl_modbus_open(const tl_modbus_settings *settings, tl_plant_io **io, tl_error *error);

#endif
