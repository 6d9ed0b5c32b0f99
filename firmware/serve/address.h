/* Addresses and names of the network: who asks, which hosts we are, names that a path may have.
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
 * Purpose: a plant's name is that of a folder, and a stranger may say any: only what cannot lead elsewhere is one.
 * Thread:  pure.
 */

/* Letters, digits, "-", "_" and ".", of which the last does not come first; at most TL_CONTROL_NAME - 1. */
bool tl_plain_name(const char *name);

/* ---- By which names this server may be called.
 *
 * Purpose: a page of a stranger's in somebody's browser can have its own name lead to this box ("DNS rebinding"); it cannot choose the Host that the
 *          browser sends then. So a request must call the server what it is called here.
 * Thread:  pure.
 */

typedef struct tl_host_names {
    char own[HOST_NAME_MAX + 1]; /* what the machine calls itself */
    tl_option_list others;       /* what the administrator has added */
} tl_host_names;

/* `others` are texts that live on. */
tl_host_names tl_host_names_of(const tl_option_list *others);

/* `host` is the header as it came, with a port or without; NULL: there was none. `local` is the address that the connection came to, which is a name, too;
 * on the loopback "localhost" is one. */
bool tl_host_names_know(const tl_host_names *names, const char *host, const char *local);

/* ---- Who is at the other end: addresses as they are counted, and as they are written.
 *
 * Purpose: limits and back-off are for each address. A network of IPv6 (/64) counts as one, since who has one address of it has all.
 * Thread:  pure.
 */

enum { TL_ADDRESS_TEXT = 48 };

/* An IPv4 address, also one that came mapped into IPv6, or a network of IPv6. */
typedef struct tl_address {
    unsigned char bytes[8]; /* of IPv4: four zeros before it */
    bool is_ipv6;
} tl_address;

tl_address tl_address_of(const struct sockaddr *socket);
bool tl_address_is(const tl_address *one, const tl_address *other);

/* "127.0.0.1", "fe80::1", whole and without a port; "?" for what is neither. */
void tl_address_text(const struct sockaddr *socket, char text[TL_ADDRESS_TEXT]);

/* "127.0.0.1:8443", "[::1]:8443", to listen on. False: it is none. */
bool tl_address_parse(const char *text, struct sockaddr_storage *socket, socklen_t *size);

#endif
