/* Access tokens: their file, their check, and the delay after wrong tokens.
 *
 * Thread:  the server's.
 */
#ifndef TL_FIRMWARE_SERVE_TOKENS_H
#define TL_FIRMWARE_SERVE_TOKENS_H

#include <stddef.h>

#include "firmware/base/change.h"
#include "firmware/base/identity.h"
#include "firmware/retune/control.h"
#include "firmware/serve/address.h"
#include "master/base/simtime.h"
#include "master/base/status.h"

/* ---- Delays after wrong tokens, one for each client address (address.h).
 *
 * Purpose: limits how fast an address can guess tokens.
 * Rule:    the first three wrong tokens cause no delay. After each further one the address must
 *          wait 1 s, 2 s, 4 s … 64 s. In this time the server checks no token from this address.
 *          Only ten minutes without a wrong token reset the count. A right token does not reset the
 *          count: otherwise its owner could guess other tokens without a delay.
 * Bound:   TL_TOKEN_DELAYS addresses. If the table is full, a new address replaces the one whose
 *          last wrong token is the oldest.
 * Thread:  one; times are monotonic.
 */

enum { TL_TOKEN_DELAYS = 256 };

typedef struct tl_token_delay {
    tl_address address;
    unsigned wrong; /* number of wrong tokens; 0: the row is free */
    tl_time last;   /* instant of the last wrong token, ns */
} tl_token_delay;

/* Begins as zeros. */
typedef struct tl_token_delays {
    tl_token_delay rows[TL_TOKEN_DELAYS];
} tl_token_delays;

/* Returns how long the address still has to wait, ns; 0: the address need not wait. */
tl_time tl_token_delays_left(const tl_token_delays *delays, const tl_address *address, tl_time now);

/* Counts a wrong token of the address. */
void tl_token_delays_add(tl_token_delays *delays, const tl_address *address, tl_time now);

/* ---- Access tokens: the rights of network clients.
 *
 * Purpose: a token is 256 random bits. The administrator creates it on the box, which shows it only
 *          once. Only its SHA-256 is saved, so that the file does not reveal a token.
 * File:    one line per token, "NAME ROLE SHA256 TIME"; TIME is that of its creation, UTC (ISO
 *          8601). Lines that begin with "#" are comments. The file is replaced as a whole. Only its
 *          owner and the group of its folder can read it; the server is in this group.
 * Search:  compares all tokens completely, so that its duration reveals nothing about a token.
 * Thread:  one.
 */

/* Maximum number of tokens. Bytes of a name and of a secret, with the NUL. */
enum { TL_TOKENS = 64, TL_TOKEN_NAME = 32, TL_TOKEN_SECRET = 65 };

#define TL_TOKENS_FILE "/etc/twinlock-serve/tokens"

typedef struct tl_token {
    char name[TL_TOKEN_NAME]; /* see tl_plain_name() in address.h */
    tl_change_right role;
    char hash[TL_SHA256_TEXT];
    char created[TL_CONTROL_TIME];
} tl_token;

typedef struct tl_tokens {
    tl_token rows[TL_TOKENS];
    size_t count;
} tl_tokens;

/* Reads the file; a missing file means no tokens. Errors: TL_BAD_DATA if a line is invalid, a name
 * occurs twice or there are more than TL_TOKENS; TL_TRY_AGAIN if the file cannot be read. */
tl_status tl_tokens_read(const char *path, tl_tokens *tokens, tl_error *error);

/* Replaces the file; usually only root can do so. Errors: TL_TRY_AGAIN if it cannot be written. */
tl_status tl_tokens_write(const char *path, const tl_tokens *tokens, tl_error *error);

/* Returns the token with this secret, or NULL. The pointer is valid until `tokens` changes. */
const tl_token *tl_tokens_find(const tl_tokens *tokens, const char *secret);

/* Returns the index of the token with this name, or `count`. */
size_t tl_tokens_named(const tl_tokens *tokens, const char *name);

/* Generates 64 random hexadecimal digits. Waits if the kernel has no random bits yet, after a boot.
 * Errors: TL_TRY_AGAIN if this wait is interrupted. */
tl_status tl_token_make_secret(char secret[TL_TOKEN_SECRET], tl_error *error);

#endif
