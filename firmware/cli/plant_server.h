/* Emulated plant device: a Modbus TCP server that clients can read but not write.
 *
 * Purpose: device for `twinlock plant` and for tests. The protocol is implemented here, without
 *          libmodbus, so that the driver and the device do not share mistakes.
 * Values:  coils, discrete inputs, holding and input registers of any number of units, defined by a
 *          list of channels. Each of these four tables of a unit reaches from the first to the last
 *          register of its channels. Gaps in a table read as 0. A request outside of it returns the
 *          exception "illegal data address", one to a unit without channels "gateway target
 *          failed". If channels overlap, the value set last counts.
 * Limits:  8 clients at once; further connections are rejected. Functions 1 to 4 are supported; all
 *          others return "illegal function".
 * Thread:  the server has its own thread. set_all() and count() may be called from any thread,
 *          start and stop from one. A reply is built under the mutex that set_all() locks, so that
 *          a client never reads half of a value or of a row.
 * Source:  MODBUS Application Protocol 1.1b3; MODBUS Messaging on TCP/IP 1.0b.
 */
#ifndef TL_FIRMWARE_CLI_PLANT_SERVER_H
#define TL_FIRMWARE_CLI_PLANT_SERVER_H

#include <stdbool.h>
#include <stdint.h>

#include "board/modbus/modbus.h"
#include "master/base/status.h"

enum { TL_PLANT_SERVER_CLIENTS = 8 }; /* most clients at once */

typedef struct tl_plant_server_settings {
    const char *host; /* name or address to listen on, for example "127.0.0.1" or "0.0.0.0" */
    uint16_t port;    /* 0: any free port */
    const tl_modbus_channel *channels;
    size_t channel_count;
} tl_plant_server_settings;

typedef struct tl_plant_server_counts {
    uint64_t requests;       /* all answered requests, including rejected ones */
    uint64_t refused_writes; /* of these, rejected writes: functions 5, 6, 15, 16, 22, 23 */
} tl_plant_server_counts;

typedef struct tl_plant_server tl_plant_server;

/* Starts the server; copies the settings. The channels must come from a validated configuration.
 * All values start as 0 (raw). Errors: TL_BAD_DATA if the host does not resolve; TL_TRY_AGAIN if
 * the port is in use or not permitted, or if a resource is missing. */
tl_status tl_plant_server_start(const tl_plant_server_settings *settings, tl_plant_server **server, tl_error *error);

/* Returns the port that the server listens on. */
uint16_t tl_plant_server_port(const tl_plant_server *server);

/* Sets one value per channel, in the unit of the signal, all at once; each is encoded as the
 * channel defines. If `present` is not NULL, only the channels marked there are set. */
void tl_plant_server_set_all(tl_plant_server *server, const double *values, const bool *present);

/* Returns the counts since the start. */
tl_plant_server_counts tl_plant_server_count(tl_plant_server *server);

/* Closes all connections, ends the thread and frees the server; returns within 0.2 s. */
void tl_plant_server_stop(tl_plant_server *server);

#endif
