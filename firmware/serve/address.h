/* Network addresses, host names, and names of plants and tokens.
 *
 * Thread:  any; pure.
 */
#ifndef TL_FIRMWARE_SERVE_ADDRESS_H
#define TL_FIRMWARE_SERVE_ADDRESS_H

#include <limits.h>
#include <stdbool.h>
#include <sys/socket.h>

#include "firmware/base/program_options.h"

/* ---- Names of plants and of tokens.
 *
 * Purpose: a plant's name is the name of a folder, and an untrusted client can send any name. Only
 *          a name that cannot contain a path to another folder is valid.
 * Thread:  pure.
 */

/* Returns true if the name has 1 … TL_CONTROL_NAME - 1 bytes, only letters, digits, "-", "_" and
 * ".", and does not begin with ".". */
bool tl_plain_name(const char *name);

/* ---- Host names of this server.
 *
 * Purpose: a hostile web page in a user's browser can direct its own host name to this box ("DNS
 *          rebinding"). But the browser then sends the page's host name in the Host header. So the
 *          Host of a request must be a name of this server.
 * Thread:  pure.
 */

typedef struct tl_host_names {
    char own[HOST_NAME_MAX + 1]; /* the machine's own host name */
    tl_option_list others;       /* names that the administrator has added */
} tl_host_names;

/* Returns the machine's host name and `others`. The texts of `others` must outlive the result. */
tl_host_names tl_host_names_of(const tl_option_list *others);

/* Returns true if `host` is a name of this server. `host`: the header, with or without a port;
 * NULL: it is missing. `local`: the address to which the client connected, as text; it is also a
 * valid name. If it is a loopback address, "localhost" is valid too. */
bool tl_host_names_know(const tl_host_names *names, const char *host, const char *local);

/* ---- Client addresses: for counting and as text.
 *
 * Purpose: limits and delays apply to each address. An IPv6 network (/64) counts as one address,
 *          because a client with one address of it can use them all.
 * Thread:  pure.
 */

enum { TL_ADDRESS_TEXT = 48 };

/* An IPv4 address, also one mapped into IPv6, or an IPv6 network. */
typedef struct tl_address {
    unsigned char bytes[8]; /* of IPv4: four zeros before it */
    bool is_ipv6;
} tl_address;

tl_address tl_address_of(const struct sockaddr *socket);
bool tl_address_is(const tl_address *one, const tl_address *other);

/* Writes "127.0.0.1" or "fe80::1", complete and without a port; "?" for other families. */
void tl_address_text(const struct sockaddr *socket, char text[TL_ADDRESS_TEXT]);

/* Parses "127.0.0.1:8443" or "[::1]:8443", an address for listening. Returns false if it is
 * invalid. */
bool tl_address_parse(const char *text, struct sockaddr_storage *socket, socklen_t *size);

#endif
