/* Parameters of a serial line: see modbus_line.h. */
#include "board/modbus/modbus_line.h"

const uint32_t tl_modbus_bauds[] = {1200,   2400,   4800,   9600,   19200,  38400,   57600,
                                    115200, 230400, 460800, 500000, 921600, 1000000, 0};

static bool is_baud(uint32_t baud) {
    const uint32_t *known = tl_modbus_bauds;
    while (*known != 0 && *known != baud) {
        known++;
    }
    return *known != 0;
}

tl_status tl_modbus_line_check(const tl_modbus_line *line, tl_error *error) {
    if (line->device[0] == '\0') {
        return tl_fail(error, TL_BAD_DATA, "a Modbus line needs a device, for example /dev/serial/by-id/usb-0-port0");
    }
    if (!is_baud(line->baud)) {
        return tl_fail(error, TL_BAD_DATA, "Modbus line %s: %u Bd is no speed of a serial line", line->device,
                       (unsigned)line->baud);
    }
    if (line->parity != 'N' && line->parity != 'E' && line->parity != 'O') {
        return tl_fail(error, TL_BAD_DATA, "Modbus line %s: parity is none of N, E, O", line->device);
    }
    if (line->stop_bits != 1 && line->stop_bits != 2) {
        return tl_fail(error, TL_BAD_DATA, "Modbus line %s: %u stop bits, but must be 1 or 2", line->device,
                       (unsigned)line->stop_bits);
    }
    return TL_OK;
}
