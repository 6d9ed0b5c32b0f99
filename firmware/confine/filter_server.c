/* What a server on the network needs besides, which listens already: see filter.h.
 *
 * It accepts, and connects to local sockets: a new socket is a local one, so that it reaches nobody else. It makes memory that it hands over.
 */
#include "firmware/confine/filter_parts.h"

#include <fcntl.h>
#include <sys/socket.h>

int tl_filter_add_server(scmp_filter_ctx context) {
    const struct scmp_arg_cmp local = {0, SCMP_CMP_MASKED_EQ, UINT32_MAX, AF_UNIX};
    const struct scmp_arg_cmp seal = {1, SCMP_CMP_MASKED_EQ, UINT32_MAX, F_ADD_SEALS};
    int failure = tl_filter_allow_all(context, "accept accept4 connect shutdown getsockname getpeername getsockopt "
                                               "setsockopt send sendto sendmsg recv recvfrom recvmsg memfd_create");
    failure = failure != 0 ? failure : tl_filter_add(context, SCMP_ACT_ALLOW, "socket", &local, 1);
    failure = failure != 0 ? failure : tl_filter_add(context, SCMP_ACT_ALLOW, "fcntl", &seal, 1);
    return failure != 0 ? failure : tl_filter_add(context, SCMP_ACT_ALLOW, "fcntl64", &seal, 1);
}
