/* Options: see serve_options.h. */
#include "firmware/serve/serve_options.h"

#include <stdio.h>
#include <string.h>

#include "firmware/retune/control_client.h"
#include "firmware/retune/control_words.h"
#include "firmware/serve/plain_name.h"
#include "firmware/serve/tokens.h"

#define COUNT(array) (sizeof(array) / sizeof(array)[0])
#define SETS(type, member) .offset = offsetof(type, member)

/* ---- serve ------------------------------------------------------------------------------------------------------- */

static const tl_program_option SERVE[] = {
    {"listen", "ADDRESS", TL_PROGRAM_TEXT, SETS(tl_serve_options, listen),
     "an address of this box with a port, such as 192.0.2.7:8443 or [::]:8443; default\n127.0.0.1:8443, which nobody outside of the box reaches"},
    {"host", "NAME", TL_PROGRAM_LIST_OF, SETS(tl_serve_options, hosts),
     "a name that others call this box by, besides its addresses and its own name; may be\ngiven several times"},
    {"certificate", "FILE", TL_PROGRAM_TEXT, SETS(tl_serve_options, certificate),
     "a certificate of your own (PEM, with those that signed it); default: one that is made\nhere at the first start"},
    {"key", "FILE", TL_PROGRAM_TEXT, SETS(tl_serve_options, key), "its key (PEM); default: in the same file"},
    {"state", "DIR", TL_PROGRAM_TEXT, SETS(tl_serve_options, state),
     "where the certificate that is made here lies; default /var/lib/twinlock-serve"},
    {"tokens", "FILE", TL_PROGRAM_TEXT, SETS(tl_serve_options, tokens),
     "who may do what, as `twinlock token` writes it; default /etc/twinlock-serve/tokens"},
    {"plants", "DIR", TL_PROGRAM_TEXT, SETS(tl_serve_options, plants),
     "where plants have their control sockets, as NAME/control; default /run/twinlock"},
    {"fingerprint", NULL, TL_PROGRAM_SWITCH, SETS(tl_serve_options, fingerprint),
     "print the pin of this box's key, for `curl --pinnedpubkey`, and the SHA-256 of its\ncertificate, as browsers show it; then end"},
    {"unconfined", NULL, TL_PROGRAM_SWITCH, SETS(tl_serve_options, unconfined),
     "keep what the user may do: files, programs, connections"},
};

static const tl_program SERVE_PROGRAM = {
    .name = "twinlock serve",
    .usage = "[options]",
    .description = "Lets others change the configuration of running plants by HTTPS, and ask how they are. It needs a\n"
                   "token from each (`twinlock token`), and plants that `twinlock run --control` keeps.",
    .options = SERVE,
    .option_count = COUNT(SERVE),
};

tl_program_outcome tl_serve_options_read(int argc, char **argv, tl_serve_options *options) {
    char **words = NULL;
    size_t count = 0;
    *options = (tl_serve_options){
        .listen = "127.0.0.1:8443",
        .state = "/var/lib/twinlock-serve",
        .tokens = TL_TOKENS_FILE,
        .plants = TL_CONTROL_FOLDER,
    };
    tl_program_outcome outcome = tl_program_options_read(&SERVE_PROGRAM, argc, argv, options, &words, &count);
    if (outcome == TL_PROGRAM_READ && options->key != NULL && options->certificate == NULL) {
        return tl_program_options_refuse(&SERVE_PROGRAM, "--key needs --certificate FILE");
    }
    return outcome;
}

/* ---- token ------------------------------------------------------------------------------------------------------- */

typedef struct token_words {
    const char *role;
    const char *tokens;
} token_words;

static const tl_program_option TOKEN[] = {
    {"role", "ROLE", TL_PROGRAM_TEXT, SETS(token_words, role),
     "read: see how plants are; retune: and change values of theirs; commission: and name\nother hosts, devices, files and components"},
    {"tokens", "FILE", TL_PROGRAM_TEXT, SETS(token_words, tokens),
     "the file of tokens; default /etc/twinlock-serve/tokens"},
};

static const tl_program TOKEN_PROGRAM = {
    .name = "twinlock token",
    .usage = "add NAME --role ROLE | list | revoke NAME",
    .description =
        "Makes a token, shows it once, and keeps what tells it again; lists those there are; takes one back.\n"
        "`twinlock serve` looks at each request anew.",
    .options = TOKEN,
    .option_count = COUNT(TOKEN),
    .least_words = 1,
    .most_words = 2,
};

static tl_program_outcome take_name(char **words, size_t count, tl_token_options *options) {
    if (count < 2) {
        return tl_program_options_refuse(&TOKEN_PROGRAM, "a name is missing, for example anna");
    }
    if (!tl_plain_name(words[1]) || strlen(words[1]) >= TL_TOKEN_NAME) {
        return tl_program_options_refuse(&TOKEN_PROGRAM, "a token's name has at most 31 letters, digits, - _ and .");
    }
    options->name = words[1];
    return TL_PROGRAM_READ;
}

static tl_program_outcome take_role(const char *role, tl_token_options *options) {
    if (role == NULL || !tl_control_right_of(role, &options->role)) {
        return tl_program_options_refuse(&TOKEN_PROGRAM, "add needs --role read, retune or commission");
    }
    return TL_PROGRAM_READ;
}

tl_program_outcome tl_token_options_read(int argc, char **argv, tl_token_options *options) {
    char **words = NULL;
    size_t count = 0;
    token_words given = {.tokens = TL_TOKENS_FILE};
    tl_program_outcome outcome = tl_program_options_read(&TOKEN_PROGRAM, argc, argv, &given, &words, &count);
    if (outcome != TL_PROGRAM_READ) {
        return outcome;
    }
    *options = (tl_token_options){.tokens = given.tokens, .action = TL_TOKEN_LIST};
    if (strcmp(words[0], "list") == 0) {
        return TL_PROGRAM_READ;
    }
    if (strcmp(words[0], "revoke") == 0) {
        options->action = TL_TOKEN_REVOKE;
        return take_name(words, count, options);
    }
    if (strcmp(words[0], "add") == 0) {
        options->action = TL_TOKEN_ADD;
        outcome = take_name(words, count, options);
        return outcome == TL_PROGRAM_READ ? take_role(given.role, options) : outcome;
    }
    return tl_program_options_refuse(&TOKEN_PROGRAM, "expected add, list or revoke");
}
