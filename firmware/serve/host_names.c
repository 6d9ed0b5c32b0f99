/* Names: see host_names.h. */
#include "firmware/serve/host_names.h"

#include <stddef.h>
#include <string.h>
#include <strings.h>
#include <unistd.h>

enum { LONGEST = 256 };

tl_host_names tl_host_names_of(const tl_program_list *others) {
    tl_host_names names = {.others = *others};
    if (gethostname(names.own, sizeof names.own - 1) != 0) {
        names.own[0] = '\0';
    }
    return names;
}

/* "[::1]:8443" -> "::1", "box:8443" -> "box". False: it is no host. */
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
