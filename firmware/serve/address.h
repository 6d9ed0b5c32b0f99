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
 * Purpose: a plant's name is the name of a folder, and an untrusted client can send any name. So a
 *          name is valid only if it cannot be a path to another folder.
 * Thread:  pure.
 */

/* Returns true if the name has 1 … TL_CONTROL_NAME - 1 bytes, only letters, digits, "-", "_" and
 * ".", and does not begin with ".". */
bool tl_plain_name(const char *name);

/* ---- Host names of this server.
 *
 * Purpose: a hostile web page in a user's browser can make its own host name point to this box
 *          ("DNS rebinding") and send requests. Their Host header has the page's host name. So the
 *          server accepts only requests whose Host header has a name of this server.
 * Thread:  pure.
 */

typedef struct tl_host_names {
    char own[HOST_NAME_MAX + 1]; /* the machine's own host name */
    tl_option_list others;       /* names that the administrator has added */
} tl_host_names;

/* Returns the machine's host name and `others`. The texts of `others` must outlive the result. */
tl_host_names tl_host_names_of(const tl_option_list *others);

/* Returns true if `host` is a name of this server; upper and lower case are equal. `host`: value of
 * the Host header, with or without a port; NULL: the header is missing. `local`: address to which
 * the client connected, as text; this text is a valid name too. If `local` is a loopback address,
 * "localhost" is also valid. */
bool tl_host_names_know(const tl_host_names *names, const char *host, const char *local);

/* ---- Client addresses: for counting and as text.
 *
 * Purpose: limits and delays apply to each client address. An IPv6 network (/64) counts as one
 *          address, because a client with one address in the network can use them all.
 * Thread:  pure.
 */

enum { TL_ADDRESS_TEXT = 48 }; /* bytes of the text, with the NUL */

/* A complete IPv4 address, or an IPv6 network. An IPv4 address mapped into IPv6 counts as IPv4. */
typedef struct tl_address {
    unsigned char bytes[8]; /* IPv6: the first 8 bytes; IPv4: four zeros, then the address */
    bool is_ipv6;
} tl_address;

/* Returns the address of a socket address for counting; zeros for other address families. */
tl_address tl_address_of(const struct sockaddr *socket);

/* Returns true if both are equal. */
bool tl_address_is(const tl_address *one, const tl_address *other);

/* Writes the complete address without a port: "127.0.0.1" or "fe80::1"; "?" for other families. */
void tl_address_text(const struct sockaddr *socket, char text[TL_ADDRESS_TEXT]);

/* Parses a numeric address with a port: "127.0.0.1:8443" or "[::1]:8443". Returns false if it is
 * invalid, for example a host name. */
bool tl_address_parse(const char *text, struct sockaddr_storage *socket, socklen_t *size);

#endif
