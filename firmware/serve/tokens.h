/* Tokens: who may do what by the network.
 *
 * Purpose: a token is 256 random bits, made on the box by its administrator and shown once. What is kept is its SHA-256, so that the file betrays none.
 * File:    a line for each, "NAME ROLE SHA256 TIME"; made whole or not at all, readable for the group of its folder, which is the server's.
 * Looking: takes the same time whichever token it is, or none.
 * Thread:  one.
 */
#ifndef TL_FIRMWARE_SERVE_TOKENS_H
#define TL_FIRMWARE_SERVE_TOKENS_H

#include <stdbool.h>
#include <stddef.h>

#include "firmware/base/sha256.h"
#include "firmware/retune/control_wire.h"
#include "master/base/status.h"

enum { TL_TOKENS = 64, TL_TOKEN_NAME = 32, TL_TOKEN_SECRET = 65 };

#define TL_TOKENS_FILE "/etc/twinlock-serve/tokens"

typedef struct tl_token {
    char name[TL_TOKEN_NAME]; /* as tl_plain_name() */
    tl_control_right role;
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
