/* Access tokens: the file, the check, the delay after wrong ones.
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

/* ---- Delays after wrong tokens, one for each address.
 *
 * Purpose: limits how fast an address can guess tokens.
 * Rule:    the first three wrong tokens cost nothing. After each further one the address must wait 1 s, 2 s, 4 s … 64 s, in which the server checks no
 *          token of it. Only time resets the count: ten minutes without a wrong token. A right token does not, because its owner could guess
 *          other tokens between two requests.
 * Bound:   TL_TOKEN_DELAYS addresses. If the table is full, a new address replaces the one whose last wrong token is the oldest.
 * Thread:  one; times are monotonic.
 */

enum { TL_TOKEN_DELAYS = 256 };

typedef struct tl_token_delay {
    tl_address address;
    unsigned wrong; /* tokens; 0: the row is free */
    tl_time last;   /* time of the last wrong token */
} tl_token_delay;

/* Begins as zeros. */
typedef struct tl_token_delays {
    tl_token_delay rows[TL_TOKEN_DELAYS];
} tl_token_delays;

/* Time that the address still has to wait; 0: none. */
tl_time tl_token_delays_left(const tl_token_delays *delays, const tl_address *address, tl_time now);

/* Counts a wrong token of the address. */
void tl_token_delays_add(tl_token_delays *delays, const tl_address *address, tl_time now);

/* ---- Tokens: who may do what by the network.
 *
 * Purpose: a token is 256 random bits, made on the box by its administrator and shown once. What is kept is its SHA-256, so that the file betrays none.
 * File:    a line for each, "NAME ROLE SHA256 TIME"; made whole or not at all, readable for the group of its folder, which is the server's.
 * Looking: takes the same time whichever token it is, or none.
 * Thread:  one.
 */

enum { TL_TOKENS = 64, TL_TOKEN_NAME = 32, TL_TOKEN_SECRET = 65 };

#define TL_TOKENS_FILE "/etc/twinlock-serve/tokens"

typedef struct tl_token {
    char name[TL_TOKEN_NAME]; /* as tl_plain_name() */
    tl_change_right role;
    char hash[TL_SHA256_TEXT];
    char made[TL_CONTROL_TIME];
} tl_token;

typedef struct tl_tokens {
    tl_token rows[TL_TOKENS];
    size_t count;
} tl_tokens;

/* None, if there is no file. TL_BAD_DATA: it is no such file, and says in which line; TL_TRY_AGAIN: it cannot be read. */
tl_status tl_tokens_read(const char *path, tl_tokens *tokens, tl_error *error);

/* TL_TRY_AGAIN: it cannot be written; who may is root. */
tl_status tl_tokens_write(const char *path, const tl_tokens *tokens, tl_error *error);

/* The one with this secret, or NULL. */
const tl_token *tl_tokens_find(const tl_tokens *tokens, const char *secret);

/* The place of the one with this name; `count` if there is none. */
size_t tl_tokens_named(const tl_tokens *tokens, const char *name);

/* 64 hexadecimal digits that nobody can guess. TL_TRY_AGAIN: this machine has no random bits yet. */
tl_status tl_token_make_secret(char secret[TL_TOKEN_SECRET], tl_error *error);

#endif
