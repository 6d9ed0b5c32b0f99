/* Plant access: system calls, sockets and folders that a plant driver needs beyond those that every
 * io process may use.
 *
 * Purpose: each driver defines its own list. firmware/process/filter.c builds from it the system
 *          call filter of the driver's process, which denies all other calls. Landlock also allows
 *          the listed folders. The rules for TCP and for resolving host names are in filter.c,
 *          because they also check the flags of send calls.
 * Owner:   the driver; static constants.
 */
#ifndef TL_BOARD_IO_PLANT_ACCESS_H
#define TL_BOARD_IO_PLANT_ACCESS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* Arguments of socket() for a socket that the driver may open. Flags that a program adds to `type`
 * are ignored, for example SOCK_CLOEXEC. */
typedef struct tl_plant_socket {
    int family, type, protocol;
} tl_plant_socket;

typedef struct tl_plant_access {
    bool tcp;          /* the driver may connect by TCP to the ports of its sources */
    const char *calls; /* names of further system calls, separated by spaces; any arguments; NULL: none */
    const tl_plant_socket *sockets;
    size_t socket_count;
    uint32_t bind_address_bytes; /* length of the address that bind() may have; 0: no bind() */
    const uint32_t *commands;    /* allowed commands of ioctl() */
    size_t command_count;
    const char *read, *write; /* folder that the driver may read, or read and write, besides its sources; NULL: none */
} tl_plant_access;

#endif
