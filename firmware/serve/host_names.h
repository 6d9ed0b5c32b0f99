/* By which names this server may be called.
 *
 * Purpose: a page of a stranger's in somebody's browser can have its own name lead to this box ("DNS rebinding"); it cannot choose the Host that the
 *          browser sends then. So a request must call the server what it is called here.
 * Thread:  pure.
 */
#ifndef TL_FIRMWARE_SERVE_HOST_NAMES_H
#define TL_FIRMWARE_SERVE_HOST_NAMES_H

#include <limits.h>
#include <stdbool.h>

#include "firmware/base/program_options.h"

typedef struct tl_host_names {
    char own[HOST_NAME_MAX + 1]; /* what the machine calls itself */
    tl_program_list others;      /* what the administrator has added */
} tl_host_names;

/* `others` are texts that live on. */
tl_host_names tl_host_names_of(const tl_program_list *others);

/* `host` is the header as it came, with a port or without; NULL: there was none. `local` is the address that the connection came to, which is a name, too;
 * on the loopback "localhost" is one. */
bool tl_host_names_know(const tl_host_names *names, const char *host, const char *local);

#endif
