/* twinlock token: see token_verb.h. */
#include "firmware/serve/token_verb.h"

#include <stdio.h>
#include <string.h>

#include "firmware/base/change.h"
#include "firmware/base/log.h"
#include "firmware/base/text.h"
#include "firmware/serve/tokens.h"

static tl_status add(const tl_token_options *options, tl_tokens *tokens, tl_error *error) {
    char secret[TL_TOKEN_SECRET];
    tl_token *made = &tokens->rows[tokens->count];
    if (tl_tokens_named(tokens, options->name) != tokens->count) {
        return tl_fail(error, TL_BAD_USAGE, "there is a token %s: revoke it first, or take another name",
                       options->name);
    }
    if (tokens->count == TL_TOKENS) {
        return tl_fail(error, TL_BAD_USAGE, "there are %d tokens, which is all that fit: revoke one first", TL_TOKENS);
    }
    tl_status status = tl_token_make_secret(secret, error);
    if (status != TL_OK) {
        return status;
    }
    *made = (tl_token){.role = options->role};
    memcpy(made->name, options->name, strlen(options->name) + 1);
    tl_sha256(secret, strlen(secret), made->hash);
    tl_utc_text(tl_utc_now(), made->made);
    tokens->count++;
    status = tl_tokens_write(options->tokens, tokens, error);
    if (status == TL_OK) {
        (void)printf("%s\n", secret);
        (void)fprintf(stderr, "This is the token of %s. It is shown now and never again.\n", made->name);
    }
    return status;
}

static tl_status revoke(const tl_token_options *options, tl_tokens *tokens, tl_error *error) {
    size_t place = tl_tokens_named(tokens, options->name);
    if (place == tokens->count) {
        return tl_fail(error, TL_BAD_USAGE, "there is no token %s: `twinlock token list` names those there are",
                       options->name);
    }
    tokens->count--;
    memmove(&tokens->rows[place], &tokens->rows[place + 1], (tokens->count - place) * sizeof tokens->rows[0]);
    return tl_tokens_write(options->tokens, tokens, error);
}

static void list(const tl_tokens *tokens) {
    for (size_t i = 0; i < tokens->count; i++) {
        const tl_token *token = &tokens->rows[i];
        (void)printf("%-31s  %-10s  %s\n", token->name, tl_change_rights[token->role], token->made);
    }
}

int tl_token_verb_run(const tl_token_options *options) {
    tl_tokens tokens;
    tl_error error = {TL_OK, ""};
    tl_status status = tl_tokens_read(options->tokens, &tokens, &error);
    if (status == TL_OK && options->action == TL_TOKEN_ADD) {
        status = add(options, &tokens, &error);
    } else if (status == TL_OK && options->action == TL_TOKEN_REVOKE) {
        status = revoke(options, &tokens, &error);
    } else if (status == TL_OK) {
        list(&tokens);
    }
    if (status != TL_OK) {
        tl_log(TL_LOG_ERROR, "%s", error.text);
    }
    return tl_exit_code(status);
}
