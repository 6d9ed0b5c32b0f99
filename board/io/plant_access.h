/* Plant access: system calls, sockets and folders that a plant driver needs beyond those that every
 * io process may use.
 *
 * Purpose: each driver defines its list beside its code. firmware/process/filter.c builds the
 *          system call filter of the driver's process from it; all other calls are denied. Landlock
 *          allows the folders. The rules for TCP and for resolving host names are in filter.c,
 *          because they also check the flags of send calls.
 * Life:    static constants of the driver.
 */
#ifndef TL_BOARD_IO_PLANT_ACCESS_H
#define TL_BOARD_IO_PLANT_ACCESS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* Arguments of socket() for a socket that the driver may open; flags in `type` are not compared. */
typedef struct tl_plant_socket {
    int family, type, protocol;
} tl_plant_socket;

typedef struct tl_plant_access {
    bool tcp;          /* may connect by TCP to the ports of its sources */
    const char *calls; /* names of further system calls, separated by spaces; any arguments; NULL: none */
    const tl_plant_socket *sockets;
    size_t socket_count;
    uint32_t bind_address_bytes; /* length of the address that bind() may have; 0: no bind() */
    const uint32_t *commands;    /* that ioctl() may have */
    size_t command_count;
    const char *read, *write; /* folder that it may read, or read and write, besides its sources' files; NULL: none */
} tl_plant_access;

#endif
