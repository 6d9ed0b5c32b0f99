/* Kernel access that a plant driver needs, as data: its process is allowed this and nothing else.
 *
 * Purpose: the confinement of a driver stands beside its code; firmware/process/filter.c builds the
 *          system call filter from it. The filter itself handles TCP and host name resolution,
 *          because they depend on arguments.
 * Owner:   constants.
 */
#ifndef TL_BOARD_IO_PLANT_ACCESS_H
#define TL_BOARD_IO_PLANT_ACCESS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* A socket that it may open, by the arguments of socket(); flags of `type` are ignored. */
typedef struct tl_plant_socket {
    int family, type, protocol;
} tl_plant_socket;

typedef struct tl_plant_access {
    bool tcp;          /* connects by TCP to the ports of its sources */
    const char *calls; /* further system calls with any arguments, separated by spaces; NULL: none */
    const tl_plant_socket *sockets;
    size_t socket_count;
    uint32_t address_bytes;   /* bind() to an address of this length; 0: no bind() */
    const uint32_t *commands; /* of ioctl() */
    size_t command_count;
    const char *read, *write; /* a folder besides the files of its sources; NULL: none */
} tl_plant_access;

#endif
