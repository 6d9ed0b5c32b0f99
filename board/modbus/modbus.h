/* Plant driver for Modbus: a client by TCP or serial line (RTU) that only reads (function codes 1
 * to 4).
 *
 * Purpose: polls the registers of one server, or of all units of one serial line. It sends as few
 *          requests as the addresses allow.
 * Link:    the driver connects again to a server that was absent or has failed, with back-off (from
 *          0.1 s, doubling, to at most 2 s). The link is up while any unit answers. If one unit of
 *          several is silent or answers with an exception, only its own channels get TL_NO_LINK.
 *          If a server closes a connection on which it has answered, the driver connects at once
 *          and repeats the request once. Some devices close after each answer.
 *          The driver polls silent units last, with the same back-off. It spends at most a fifth
 *          of the polling time on waiting for them.
 * Checks:  the driver uses an answer only if transaction, protocol, length, unit, function and
 *          number of bytes are right. Otherwise it posts TL_NO_LINK and reports the problem once.
 *          It also closes the TCP connection, because late bytes could be taken for the next
 *          answer.
 * Split:   a request for several values is split if the device rejects it (exceptions 2 and 3).
 *          With split_failed also after exception 4, and if its answer is missing or wrong twice in
 *          a row while others are answered. If no request is answered in two polls in a row, the
 *          driver tries each value once by itself, then joined requests again.
 * Pause:   with pause_s, a request to a busy device (exception 6) is repeated after the pause,
 *          until the poll has taken period_s.
 * Bound:   TCP: a poll waits at most timeout_s to connect and timeout_s for each response. The
 *          first missing or wrong response ends the poll. If the server sends more bytes than
 *          requested, the driver connects again before each request. If `host` is a name, each
 *          connection also takes the time to resolve it. interrupt() cannot end that wait.
 *          Line: a poll waits at most timeout_s for each response. The second missing or wrong
 *          response ends the poll. Each request also takes its transmission time and a wait until
 *          the line is silent: for 3.5 characters (1.75 ms above 19200 bit/s), after a failure for
 *          50 ms. If bytes keep arriving, this wait fails after about timeout_s. interrupt() cannot
 *          end the reception of a response that has started. The reception ends within the
 *          response's transmission time plus 0.2 s. Both: each request also waits for pause_s.
 * Line:    the driver is the only master and opens the device exclusively. It uses 8 data bits and
 *          the parameters in tl_modbus_line. RTU responses have no number. So a late response could
 *          be taken for the answer to a later request of the same kind to the same unit. Therefore
 *          timeout_s must exceed the response time of the slowest unit. After a timeout, if another
 *          request was answered, the driver sends no request to the silent unit during timeout_s.
 * Framing: RTU frames by TCP have no transaction. As on a line, timeout_s must exceed the response
 *          time of the slowest unit.
 * Stamp:   time at which the response had arrived completely.
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
    bool any_unit_id; /* TCP: accept answers with another unit than the request; some devices and gateways send them */
    bool any_transaction_id; /* TCP: accept answers with another transaction; some devices always send the same */
    bool rtu_framing;        /* TCP: frames of a line, as some gateways forward them */
    tl_modbus_line line;     /* line.device: NULL for TCP */
    uint8_t most_registers;  /* of a request with several values, 1 … 125; 0: 125 */
    bool split_failed;       /* also split a request after exception 4, and if its answer fails twice in a row */
    double pause_s;          /* before each request, since the last response or the connection, s; 0 … 60 */
    double period_s;         /* with a pause: how long in a poll requests are repeated to a busy device, s */
    double timeout_s;        /* longest wait for a connection, and for a response, s; 0.001 … 3600 */
    const tl_modbus_channel *channels;
    size_t channel_count;
} tl_modbus_settings;

extern const tl_plant_io_driver tl_modbus_driver;
extern const tl_plant_access tl_modbus_tcp_access, tl_modbus_rtu_access;

/* Creates a driver. Copies the settings; does not connect yet. The caller closes it by
 * tl_modbus_driver.close(). Errors: TL_BAD_DATA for a setting out of range, a type that its table
 * cannot hold, or a value that ends beyond address 65535; TL_TRY_AGAIN if memory or a descriptor is
 * missing. */
tl_status tl_modbus_open(const tl_modbus_settings *settings, tl_plant_io **io, tl_error *error);

#endif
