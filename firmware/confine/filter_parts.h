/* What the sources behind filter.h share.
 *
 * Purpose: each adds its part to a filter whose default is to refuse.
 * Errors:  the functions return 0, or what libseccomp did (negative, as errno); they go on until the first one.
 */
#ifndef TL_FIRMWARE_CONFINE_FILTER_PARTS_H
#define TL_FIRMWARE_CONFINE_FILTER_PARTS_H

#include <seccomp.h>
#include <stddef.h>
#include <stdint.h>

#include "firmware/confine/filter.h"

/* A name that this machine or this libseccomp does not know is passed over: there is no such call to allow. */
int tl_filter_add(scmp_filter_ctx context, uint32_t action, const char *call, const struct scmp_arg_cmp *conditions,
                  unsigned count);

/* Names with blanks between them, allowed whatever their arguments. */
int tl_filter_allow_all(scmp_filter_ctx context, const char *calls);

/* filter_calls.c */
int tl_filter_add_calls(scmp_filter_ctx context, const tl_filter_settings *settings);

/* filter_arguments.c */
int tl_filter_add_arguments(scmp_filter_ctx context, const tl_filter_settings *settings);

/* filter_drivers.c */
int tl_filter_add_drivers(scmp_filter_ctx context, unsigned drivers);

/* filter_server.c */
int tl_filter_add_server(scmp_filter_ctx context);

#endif
