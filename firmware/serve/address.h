/* Who is at the other end: addresses as they are counted, and as they are written.
 *
 * Purpose: limits and back-off are for each address. A network of IPv6 (/64) counts as one, since who has one address of it has all.
 * Thread:  pure.
 */
#ifndef TL_FIRMWARE_SERVE_ADDRESS_H
#define TL_FIRMWARE_SERVE_ADDRESS_H

#include <stdbool.h>
#include <stdint.h>
#include <sys/socket.h>

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
bool tl_address_parse(const char *text, struct sockaddr_storage *socket, socklen_t *size, unsigned *port);

#endif
