/* Addresses: see address.h. */
#include "firmware/serve/address.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { IPV4 = 4, IPV6 = 16, NETWORK = 8, LONGEST_PORT = 5, LAST_PORT = 65535 };

/* The 4 bytes of IPv4, also of one that came by a socket of IPv6; NULL: it is none. */
static const unsigned char *bytes_of_ipv4(const struct sockaddr *socket) {
    const struct sockaddr_in6 *ipv6 = (const struct sockaddr_in6 *)(const void *)socket;
    if (socket->sa_family == AF_INET) {
        return (const unsigned char *)&((const struct sockaddr_in *)(const void *)socket)->sin_addr;
    }
    bool is_mapped = socket->sa_family == AF_INET6 && IN6_IS_ADDR_V4MAPPED(&ipv6->sin6_addr);
    return is_mapped ? ipv6->sin6_addr.s6_addr + IPV6 - IPV4 : NULL;
}

tl_address tl_address_of(const struct sockaddr *socket) {
    tl_address address = {.is_ipv6 = false};
    const unsigned char *ipv4 = bytes_of_ipv4(socket);
    if (ipv4 != NULL) {
        memcpy(address.bytes + NETWORK - IPV4, ipv4, IPV4);
    } else if (socket->sa_family == AF_INET6) {
        address.is_ipv6 = true;
        memcpy(address.bytes, &((const struct sockaddr_in6 *)(const void *)socket)->sin6_addr, NETWORK);
    }
    return address;
}

bool tl_address_is(const tl_address *one, const tl_address *other) {
    return one->is_ipv6 == other->is_ipv6 && memcmp(one->bytes, other->bytes, sizeof one->bytes) == 0;
}

void tl_address_text(const struct sockaddr *socket, char text[TL_ADDRESS_TEXT]) {
    const unsigned char *ipv4 = bytes_of_ipv4(socket);
    const void *from = ipv4;
    if (ipv4 == NULL && socket->sa_family == AF_INET6) {
        from = &((const struct sockaddr_in6 *)(const void *)socket)->sin6_addr;
    }
    if (from == NULL || inet_ntop(ipv4 != NULL ? AF_INET : AF_INET6, from, text, TL_ADDRESS_TEXT) == NULL) {
        (void)snprintf(text, TL_ADDRESS_TEXT, "?");
    }
}

static bool parse_port(const char *text, unsigned *port) {
    size_t digits = strspn(text, "0123456789");
    unsigned long number = digits <= LONGEST_PORT ? strtoul(text, NULL, 10) : LAST_PORT + 1UL;
    *port = (unsigned)number;
    return digits > 0 && text[digits] == '\0' && number <= LAST_PORT;
}

bool tl_address_parse(const char *text, struct sockaddr_storage *socket, socklen_t *size, unsigned *port) {
    char host[TL_ADDRESS_TEXT];
    const char *colon = strrchr(text, ':');
    bool is_ipv6 = text[0] == '[';
    if (colon == NULL || colon == text || (size_t)(colon - text) >= sizeof host || !parse_port(colon + 1, port)) {
        return false;
    }
    memcpy(host, text, (size_t)(colon - text));
    host[colon - text] = '\0';
    memset(socket, 0, sizeof *socket);
    if (!is_ipv6) {
        struct sockaddr_in *ipv4 = (struct sockaddr_in *)(void *)socket;
        *size = sizeof *ipv4;
        ipv4->sin_family = AF_INET;
        ipv4->sin_port = htons((uint16_t)*port);
        return inet_pton(AF_INET, host, &ipv4->sin_addr) == 1;
    }
    struct sockaddr_in6 *ipv6 = (struct sockaddr_in6 *)(void *)socket;
    size_t last = strlen(host) - 1;
    bool is_closed = last > 0 && host[last] == ']';
    host[last] = '\0';
    *size = sizeof *ipv6;
    ipv6->sin6_family = AF_INET6;
    ipv6->sin6_port = htons((uint16_t)*port);
    return is_closed && inet_pton(AF_INET6, host + 1, &ipv6->sin6_addr) == 1;
}
