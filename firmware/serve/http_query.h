/* The query of a request: "check=1&why=a%20seal".
 *
 * Thread: pure.
 */
#ifndef TL_FIRMWARE_SERVE_HTTP_QUERY_H
#define TL_FIRMWARE_SERVE_HTTP_QUERY_H

#include <stdbool.h>

#include "firmware/retune/control_wire.h"

enum { TL_HTTP_QUERY_FAULT = 128 };

/* Sets what it says in `control`: check, restart, confirm, wait (each 0 or 1), probation, shadow, require_lock, why, version. `allowed` are those that the
 * address takes: "check wait why". False: `fault` says what is wrong. */
bool tl_http_query_read(const char *query, const char *allowed, tl_control_request *control,
                        char fault[TL_HTTP_QUERY_FAULT]);

#endif
