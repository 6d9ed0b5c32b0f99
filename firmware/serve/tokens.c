/* Access tokens: see tokens.h. */
#include "firmware/serve/tokens.h"

#include <errno.h>
#include <libgen.h>
#include <limits.h>
#include <stdio.h>
#include <string.h>
#include <sys/random.h>
#include <sys/stat.h>
#include <unistd.h>

#include "firmware/base/os.h"

/* ---- token delays ---- */

enum { FREE_TRIES = 3, MOST_COUNTED = 10 };

static const tl_time RESET_AFTER = 600 * TL_SECOND;

tl_time tl_token_delays_left(const tl_token_delays *delays, const tl_address *address, tl_time now) {
    for (size_t i = 0; i < TL_TOKEN_DELAYS; i++) {
        const tl_token_delay *row = &delays->rows[i];
        if (row->wrong > FREE_TRIES && tl_address_is(&row->address, address)) {
            tl_time left = row->last + (TL_SECOND << (row->wrong - FREE_TRIES - 1)) - now;
            return left > 0 ? left : 0;
        }
    }
    return 0;
}

void tl_token_delays_add(tl_token_delays *delays, const tl_address *address, tl_time now) {
    tl_token_delay *row = &delays->rows[0]; /* the row of this address, else a free one, else the oldest */
    for (size_t i = 0; i < TL_TOKEN_DELAYS; i++) {
        tl_token_delay *one = &delays->rows[i];
        if (one->wrong > 0 && tl_address_is(&one->address, address)) {
            row = one;
            break;
        }
        row = row->wrong > 0 && (one->wrong == 0 || one->last < row->last) ? one : row;
    }
    if (row->wrong == 0 || !tl_address_is(&row->address, address) || now - row->last > RESET_AFTER) {
        *row = (tl_token_delay){.address = *address};
    }
    row->wrong += row->wrong < MOST_COUNTED ? 1 : 0;
    row->last = now;
}

/* ---- tokens ---- */

enum { LINE = 256, RANDOM = 32, MODE = 0640 };

/* ---- reading ---- */

static bool is_hash(const char *text) {
    return strlen(text) == TL_SHA256_TEXT - 1 && strspn(text, "0123456789abcdef") == TL_SHA256_TEXT - 1;
}

/* "anna retune 01ab… 2026-11-23T10:02:03.456Z\n" */
static bool read_line(const char *line, tl_token *token) {
    char name[LINE];
    char role[LINE];
    char hash[LINE];
    char made[LINE];
    char rest[2];
    int found = sscanf(line, "%255s %255s %255s %255s %1s", name, role, hash, made, rest);
    bool is_good = found == 4 && strlen(name) < sizeof token->name && tl_plain_name(name) && is_hash(hash) &&
                   strlen(made) < sizeof token->created && tl_change_right_of(role, &token->role);
    if (is_good) {
        memcpy(token->name, name, strlen(name) + 1);
        memcpy(token->hash, hash, sizeof token->hash);
        memcpy(token->created, made, strlen(made) + 1);
    }
    return is_good;
}

static tl_status read_lines(FILE *file, const char *path, tl_tokens *tokens, tl_error *error) {
    char line[LINE];
    for (size_t number = 1; fgets(line, sizeof line, file) != NULL; number++) {
        if (line[0] == '#') {
            continue;
        }
        bool is_good = tokens->count < TL_TOKENS && read_line(line, &tokens->rows[tokens->count]);
        if (!is_good || tl_tokens_named(tokens, tokens->rows[tokens->count].name) != tokens->count) {
            tokens->count = 0;
            return tl_fail(
                error, TL_BAD_DATA,
                "%s, line %zu: invalid, a name twice, or more than 64 tokens (expected \"NAME ROLE SHA256 TIME\"): "
                "correct the file, or use `twinlock token`",
                path, number);
        }
        tokens->count++;
    }
    if (ferror(file) != 0) {
        tokens->count = 0;
        return tl_fail(error, TL_TRY_AGAIN, "%s: %s", path, strerror(errno));
    }
    return TL_OK;
}

tl_status tl_tokens_read(const char *path, tl_tokens *tokens, tl_error *error) {
    tokens->count = 0;
    FILE *file = fopen(path, "re");
    if (file == NULL) {
        return errno == ENOENT ? TL_OK : tl_fail(error, TL_TRY_AGAIN, "%s: cannot be read: %s", path, strerror(errno));
    }
    tl_status status = read_lines(file, path, tokens, error);
    (void)fclose(file);
    return status;
}

/* ---- writing ---- */

/* Only the group of the folder may read the file. A user other than root may be unable to change
 * the group; then the file keeps his. */
static bool set_group(int file, const char *path) {
    char folder[PATH_MAX];
    struct stat about;
    if (strlen(path) >= sizeof folder) {
        return false;
    }
    memcpy(folder, path, strlen(path) + 1);
    bool is_set = stat(dirname(folder), &about) == 0 && (fchown(file, (uid_t)-1, about.st_gid) == 0 || geteuid() != 0);
    return is_set && fchmod(file, MODE) == 0;
}

tl_status tl_tokens_write(const char *path, const tl_tokens *tokens, tl_error *error) {
    tl_new_file made;
    tl_status status = tl_new_file_open(path, &made, error);
    if (status != TL_OK) {
        return status;
    }
    if (!set_group(fileno(made.file), path)) {
        status = tl_fail(error, TL_TRY_AGAIN, "%s: cannot get the group of its folder: %s", path, strerror(errno));
        tl_new_file_discard(&made);
        return status;
    }
    (void)fputs("# Written by `twinlock token`: name, role, SHA-256 of the token, creation time.\n", made.file);
    for (size_t i = 0; i < tokens->count; i++) {
        const tl_token *token = &tokens->rows[i];
        (void)fprintf(made.file, "%s %s %s %s\n", token->name, tl_change_rights[token->role], token->hash,
                      token->created);
    }
    return tl_new_file_keep(&made, error);
}

/* ---- searching ---- */

/* No branch depends on the bytes, so that the duration reveals nothing. */
static bool is_same(const char *one, const char *other) {
    unsigned difference = 0;
    for (size_t i = 0; i < TL_SHA256_TEXT; i++) {
        difference |= (unsigned)(unsigned char)one[i] ^ (unsigned)(unsigned char)other[i];
    }
    return difference == 0;
}

const tl_token *tl_tokens_find(const tl_tokens *tokens, const char *secret) {
    char hash[TL_SHA256_TEXT];
    const tl_token *found = NULL;
    tl_sha256(secret, strlen(secret), hash);
    for (size_t i = 0; i < tokens->count; i++) {
        found = is_same(tokens->rows[i].hash, hash) ? &tokens->rows[i] : found;
    }
    return found;
}

size_t tl_tokens_named(const tl_tokens *tokens, const char *name) {
    size_t index = 0;
    while (index < tokens->count && strcmp(tokens->rows[index].name, name) != 0) {
        index++;
    }
    return index;
}

tl_status tl_token_make_secret(char secret[TL_TOKEN_SECRET], tl_error *error) {
    unsigned char bits[RANDOM];
    if (getrandom(bits, sizeof bits, 0) != (ssize_t)sizeof bits) {
        return tl_fail(error, TL_TRY_AGAIN, "cannot get random bits for a token: %s", strerror(errno));
    }
    for (size_t i = 0; i < sizeof bits; i++) {
        (void)snprintf(secret + 2 * i, 3, "%02x", bits[i]);
    }
    return TL_OK;
}
