/* An emulated plant device: a Modbus TCP server that can be read and never written.
 *
 * Purpose: what `twinlock plant` lets the appliance listen to, and what tests read. Its protocol is implemented here,
 *          without libmodbus, so that the driver and the device do not share mistakes.
 * Values:  coils, discrete inputs, holding and input registers of any number of units, as a list of channels says. A
 *          table reaches from the first to the last register of its channels; what is between them reads as 0, what
 *          is outside as the exception "illegal data address". A unit without channels is "gateway target failed".
 *          Where channels overlap, what was set last counts.
 * Limits:  8 clients at once, further ones are turned away. Functions 1 to 4; all others are "illegal function".
 * Thread:  its own. set() and count() from any; start and stop from one. A reply is made under the lock that set()
 *          takes, so no value, and with set_all() no row of values, is seen half.
 * Source:  MODBUS Application Protocol 1.1b3; MODBUS Messaging on TCP/IP 1.0b.
 */
#ifndef TL_FIRMWARE_CLI_PLANT_SERVER_H
#define TL_FIRMWARE_CLI_PLANT_SERVER_H

#include <stdbool.h>
#include <stdint.h>

#include "board/modbus/modbus.h"
#include "master/base/status.h"

enum { TL_PLANT_SERVER_CLIENTS = 8 };

typedef struct tl_plant_server_settings {
    const char *host; /* name or address to listen at, for example "127.0.0.1" or "0.0.0.0" */
    uint16_t port;    /* 0: any that is free */
    const tl_modbus_channel *channels;
    size_t channel_count;
} tl_plant_server_settings;

typedef struct tl_plant_server_counts {
    uint64_t requests;       /* of any kind that were answered */
    uint64_t refused_writes; /* of these: functions 5, 6, 15, 16, 22, 23 */
} tl_plant_server_counts;

typedef struct tl_plant_server tl_plant_server;

/* Copies what it needs. Channels are those of a configuration that was read. All values are 0 raw. Errors: TL_BAD_DATA for a host
 * that does not resolve, TL_TRY_AGAIN where the port is taken or not allowed, or a resource is missing. */
tl_status tl_plant_server_start(const tl_plant_server_settings *settings, tl_plant_server **server, tl_error *error);

/* The port it listens at. */
uint16_t tl_plant_server_port(const tl_plant_server *server);

/* Sets one value per channel at once, encoded as the channel says; where `present` is not NULL, those marked there. */
void tl_plant_server_set_all(tl_plant_server *server, const double *values, const bool *present);

tl_plant_server_counts tl_plant_server_count(tl_plant_server *server);

/* Closes all connections; returns within 0.2 s. */
void tl_plant_server_stop(tl_plant_server *server);

#endif
