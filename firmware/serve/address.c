/* Addresses and names: see address.h. */
#include "firmware/serve/address.h"

#include <arpa/inet.h>
#include <netdb.h>
#include <netinet/in.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <unistd.h>

#include "firmware/retune/control.h"

/* ---- plain name ---- */

bool tl_plain_name(const char *name) {
    static const char letters[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789-_.";
    size_t length = strlen(name);
    return length > 0 && length < TL_CONTROL_NAME && name[0] != '.' && strspn(name, letters) == length;
}

/* ---- host names ---- */

enum { LONGEST = 256 };

tl_host_names tl_host_names_of(const tl_option_list *others) {
    tl_host_names names = {.others = *others};
    if (gethostname(names.own, sizeof names.own - 1) != 0) {
        names.own[0] = '\0';
    }
    return names;
}

/* "[::1]:8443" -> "::1", "box:8443" -> "box". Returns false if the host is invalid. */
static bool strip_port(const char *host, char name[LONGEST]) {
    bool is_ipv6 = host[0] == '[';
    const char *from = is_ipv6 ? host + 1 : host;
    size_t length = strcspn(from, is_ipv6 ? "]" : ":");
    const char *rest = from + length + (is_ipv6 && from[length] == ']' ? 1 : 0);
    if (length == 0 || length >= LONGEST || (is_ipv6 && rest == from + length)) {
        return false;
    }
    memcpy(name, from, length);
    name[length] = '\0';
    return rest[0] == '\0' || (rest[0] == ':' && rest[1] != '\0' && rest[1 + strspn(rest + 1, "0123456789")] == '\0');
}

static bool is_loopback(const char *address) {
    return strncmp(address, "127.", strlen("127.")) == 0 || strcmp(address, "::1") == 0;
}

bool tl_host_names_know(const tl_host_names *names, const char *host, const char *local) {
    char name[LONGEST];
    if (host == NULL || !strip_port(host, name)) {
        return false;
    }
    bool is_known = strcasecmp(name, local) == 0 || (is_loopback(local) && strcasecmp(name, "localhost") == 0) ||
                    (names->own[0] != '\0' && strcasecmp(name, names->own) == 0);
    for (size_t i = 0; i < names->others.count; i++) {
        is_known = is_known || strcasecmp(name, names->others.values[i]) == 0;
    }
    return is_known;
}

/* ---- address ---- */

enum { IPV4 = 4, IPV6 = 16, NETWORK = 8, LONGEST_PORT = 5, LAST_PORT = 65535 };

/* Returns the 4 bytes of an IPv4 address, also of one mapped into IPv6; NULL: it is another
 * address. */
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

static bool is_port(const char *text) {
    size_t digits = strspn(text, "0123456789");
    return digits > 0 && digits <= LONGEST_PORT && text[digits] == '\0' && strtoul(text, NULL, 10) <= LAST_PORT;
}

bool tl_address_parse(const char *text, struct sockaddr_storage *socket, socklen_t *size) {
    char host[TL_ADDRESS_TEXT];
    const char *colon = strrchr(text, ':');
    size_t length = colon == NULL ? 0 : (size_t)(colon - text);
    bool is_ipv6 = text[0] == '[';
    const struct addrinfo hints = {.ai_flags = AI_NUMERICHOST | AI_NUMERICSERV,
                                   .ai_family = is_ipv6 ? AF_INET6 : AF_INET,
                                   .ai_socktype = SOCK_STREAM};
    struct addrinfo *found = NULL;
    if (length == 0 || length >= sizeof host || !is_port(colon + 1) || (is_ipv6 && text[length - 1] != ']')) {
        return false;
    }
    (void)snprintf(host, sizeof host, "%.*s", (int)length - (is_ipv6 ? 2 : 0), text + (is_ipv6 ? 1 : 0));
    struct in_addr ipv4; /* getaddrinfo() also accepts "0", "127.1" and octal numbers */
    if ((!is_ipv6 && inet_pton(AF_INET, host, &ipv4) != 1) || getaddrinfo(host, colon + 1, &hints, &found) != 0) {
        return false;
    }
    memcpy(socket, found->ai_addr, found->ai_addrlen);
    *size = found->ai_addrlen;
    freeaddrinfo(found);
    return true;
}
