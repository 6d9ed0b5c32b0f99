/* Main program of twinlock-serve. `twinlock serve` and `twinlock token` start it with their
 * arguments. */
#include <errno.h>
#include <libgen.h>
#include <limits.h>
#include <stdbool.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "firmware/base/change.h"
#include "firmware/base/log.h"
#include "firmware/base/os.h"
#include "firmware/base/program_options.h"
#include "firmware/base/text.h"
#include "firmware/process/confine.h"
#include "firmware/process/crash.h"
#include "firmware/process/interrupt.h"
#include "firmware/process/service.h"
#include "firmware/retune/control.h"
#include "firmware/serve/address.h"
#include "firmware/serve/server.h"
#include "firmware/serve/tokens.h"

#define COUNT(array) (sizeof(array) / sizeof(array)[0])

/* ---- options ---- */

/* Texts belong to the command line. */
typedef struct program_options {
    const char *listen; /* "127.0.0.1:8443" */
    tl_option_list hosts;
    const char *certificate; /* NULL: the generated one */
    const char *key;
    const char *state; /* folder of the generated certificate */
    const char *tokens;
    const char *plants;
    bool fingerprint;
    bool unconfined;
    const char *role; /* of `token add` */
} program_options;

enum { SERVE = 1 << 0, TOKEN = 1 << 1 }; /* bits: rows of VERBS */

static const tl_verb_row VERBS[] = {
    {"serve", "[options]", NULL, NULL,
     "Lets users with a token change the configuration of running plants over HTTPS, and ask "
     "for their state. Needs `twinlock token add`, and a run with --control for each plant.",
     "twinlock serve --listen 192.0.2.7:8443\ntwinlock serve --fingerprint"},
    {"token", "add NAME --role ROLE | list | revoke NAME", NULL, NULL,
     "Creates an access token and prints it once; only its hash is kept. Lists tokens, or revokes "
     "one. A change applies to the next request.",
     "twinlock token add anna --role retune\ntwinlock token revoke anna"},
};
static const tl_verb_row *const SERVE_VERB = &VERBS[0], *const TOKEN_VERB = &VERBS[1];

#define SETS(member) .offset = offsetof(program_options, member)

static const tl_option OPTIONS[] = {
    {SERVE, "listen", "ADDRESS", tl_option_text, SETS(listen),
     "address and port of this box, for example 192.0.2.7:8443 or [::]:8443; default: "
     "127.0.0.1:8443, which only this box can reach"},
    {SERVE, "fingerprint", NULL, tl_option_switch, SETS(fingerprint),
     "print the pin of the key for `curl --pinnedpubkey` and the SHA-256 of the "
     "certificate as browsers show it, and end"},
    {TOKEN, "role", "ROLE", tl_option_text, SETS(role),
     "read: see the state of plants; retune: also change values; commission: also change "
     "hosts, devices, files and components"},
    {SERVE, "host", "NAME", tl_option_listed, SETS(hosts),
     "a further name of this box, besides its addresses and host name; may be repeated",
     .expected = "at most 8 of them", .rare = true},
    {SERVE, "certificate", "FILE", tl_option_text, SETS(certificate),
     "own certificate (PEM, with its issuers); default: created at the first start", .rare = true},
    {SERVE, "key", "FILE", tl_option_text, SETS(key), "its key (PEM); default: in the same file",
     .needs = "certificate", .rare = true},
    {SERVE, "state", "DIR", tl_option_text, SETS(state),
     "folder of the created certificate; default: /var/lib/twinlock-serve", .rare = true},
    {SERVE | TOKEN, "tokens", "FILE", tl_option_text, SETS(tokens),
     "file of tokens; default: /etc/twinlock-serve/tokens", .rare = true},
    {SERVE, "plants", "DIR", tl_option_text, SETS(plants),
     "folder of the control sockets, NAME/control; default: /run/twinlock", .rare = true},
    {SERVE, "unconfined", NULL, tl_option_switch, SETS(unconfined),
     "keep all rights of this user: files, programs, connections", .rare = true},
    {SERVE | TOKEN, "help", .help = "this text", .rare = true},
};

static const tl_option_table TABLE = {VERBS, COUNT(VERBS), OPTIONS, COUNT(OPTIONS), .widest = 0};

/* Reads the options of a verb. Refuses fewer than `least` and more than `most` further words. */
static tl_options_outcome read_options(const tl_verb_row *verb, int argc, char **argv, void *settings, char ***words,
                                       size_t least, size_t most) {
    size_t count = 0;
    tl_options_outcome outcome =
        tl_program_options_read(&TABLE, (size_t)(verb - VERBS), argc, argv, settings, words, &count);
    if (outcome == TL_OPTIONS_READ && count < least) {
        return tl_options_refuse(verb, "found %zu arguments, expected at least %zu", count, least);
    }
    if (outcome == TL_OPTIONS_READ && count > most) {
        return tl_options_refuse(verb, "found the unexpected argument \"%.64s\"", (*words)[most]);
    }
    return outcome;
}

/* ---- serve verb ---- */

enum { BACKLOG = 128, MEMORY = 64 * 1024 * 1024 };

static const tl_time TURN = TL_SECOND;

/* ---- listening ---- */

static tl_status listen_on(const char *text, int *listener, uint16_t *port, tl_error *error) {
    struct sockaddr_storage address;
    socklen_t size = 0;
    if (!tl_address_parse(text, &address, &size)) {
        return tl_fail(error, TL_BAD_USAGE,
                       "--listen: found \"%.64s\", expected an address with a port, such as 192.0.2.7:8443", text);
    }
    *listener = tl_tcp_listen((const struct sockaddr *)&address, size, BACKLOG, port);
    return *listener >= 0 ? TL_OK : tl_fail(error, TL_TRY_AGAIN, "%s: cannot listen: %s", text, strerror(errno));
}

/* ---- serving ---- */

static void serve(tl_server *server) {
    tl_time timeout = tl_service_watchdog_period();
    tl_time keepalive = tl_clock_now(NULL);
    (void)tl_service_notify("READY=1");
    while (tl_interrupt_requested() == NULL) {
        tl_server_turn(server, TURN);
        if (timeout > 0 && tl_clock_now(NULL) - keepalive >= timeout / 4) {
            (void)tl_service_notify("WATCHDOG=1");
            keepalive = tl_clock_now(NULL);
        }
    }
    (void)tl_service_notify("STOPPING=1");
}

/* Afterwards the process may use its listener, local sockets, and two folders for reading. */
static tl_status confine(const program_options *options, tl_error *error) {
    char folder[PATH_MAX];
    tl_confine_facts facts;
    if (options->unconfined) {
        return TL_OK;
    }
    if (snprintf(folder, sizeof folder, "%s", options->tokens) >= PATH_MAX) {
        return tl_fail(error, TL_BAD_USAGE, "--tokens %.300s…: the path is too long", options->tokens);
    }
    const char *const read[] = {dirname(folder), options->plants};
    const tl_confine_settings settings = {.read = read,
                                          .read_count = sizeof read / sizeof read[0],
                                          .memory = MEMORY,
                                          .file_bytes = 2 * (uint64_t)TL_CONTROL_MOST,
                                          .start_socket = -1,
                                          .whole_process = true,
                                          .is_server = true,
                                          .only_denies = true};
    tl_status status = tl_confine(&settings, &facts, NULL, error);
    if (status == TL_OK && (!facts.filter || facts.landlock == 0)) {
        tl_log(TL_LOG_NOTICE,
               "this kernel has no %s: an attacker who takes over this server gets all rights of its user",
               facts.filter ? "Landlock" : "seccomp");
    }
    return status;
}

static tl_status serve_on(const program_options *options, int listener, uint16_t port,
                          const tl_certificate *certificate, tl_error *error) {
    tl_server *server = NULL;
    const tl_host_names names = tl_host_names_of(&options->hosts);
    const tl_server_settings settings = {.listener = listener,
                                         .folder = options->plants,
                                         .tokens = options->tokens,
                                         .certificate = certificate,
                                         .names = &names};
    tl_status status = tl_server_open(&settings, &server, error);
    status = status == TL_OK ? confine(options, error) : status;
    if (status != TL_OK) {
        tl_server_close(server);
        return status;
    }
    tl_log(TL_LOG_NOTICE, "listening on port %u as %s for the plants in %s", port, certificate->fingerprint.pin,
           options->plants);
    serve(server);
    tl_server_close(server);
    return TL_OK;
}

static tl_status run(const program_options *options, const tl_certificate *certificate, tl_error *error) {
    int listener = -1;
    uint16_t port = 0;
    if (options->fingerprint) {
        (void)printf("pin          %s\ncertificate  %s\n", certificate->fingerprint.pin,
                     certificate->fingerprint.certificate);
        return TL_OK;
    }
    tl_interrupt_install();
    tl_status status = listen_on(options->listen, &listener, &port, error);
    if (status == TL_OK) {
        status = serve_on(options, listener, port, certificate, error);
        (void)close(listener);
    }
    return status;
}

static int exit_code_of(tl_options_outcome outcome) {
    return tl_exit_code(outcome == TL_OPTIONS_HELPED ? TL_OK : TL_BAD_USAGE);
}

static int serve_verb(int argc, char **argv) {
    program_options options = {
        .listen = "127.0.0.1:8443",
        .state = "/var/lib/twinlock-serve",
        .tokens = TL_TOKENS_FILE,
        .plants = TL_CONTROL_FOLDER,
    };
    tl_certificate certificate;
    tl_error error = {TL_OK, ""};
    char **words = NULL;
    tl_options_outcome outcome = read_options(SERVE_VERB, argc, argv, &options, &words, 0, 0);
    if (outcome != TL_OPTIONS_READ) {
        return exit_code_of(outcome);
    }
    const char *chain = options.certificate;
    const char *key = options.key != NULL ? options.key : chain;
    tl_status status = chain != NULL ? tl_certificate_load(chain, key, &certificate, &error)
                                     : tl_certificate_provide(options.state, &certificate, &error);
    if (status == TL_OK) {
        status = run(&options, &certificate, &error);
        tl_certificate_free(&certificate);
    }
    if (status != TL_OK) {
        tl_log(TL_LOG_ERROR, "%s", error.text);
    }
    return tl_exit_code(status);
}

/* ---- token verb ---- */

static tl_status add_token(const char *path, const char *name, tl_change_right role, tl_tokens *tokens,
                           tl_error *error) {
    char secret[TL_TOKEN_SECRET];
    tl_token *made = &tokens->rows[tokens->count];
    if (tl_tokens_named(tokens, name) != tokens->count) {
        return tl_fail(error, TL_BAD_USAGE, "token %s exists: revoke it first, or take another name", name);
    }
    if (tokens->count == TL_TOKENS) {
        return tl_fail(error, TL_BAD_USAGE, "there are %d tokens, the maximum: revoke one first", TL_TOKENS);
    }
    tl_status status = tl_token_make_secret(secret, error);
    if (status != TL_OK) {
        return status;
    }
    *made = (tl_token){.role = role};
    memcpy(made->name, name, strlen(name) + 1);
    tl_sha256(secret, strlen(secret), made->hash);
    tl_utc_text(tl_utc_now(), made->created);
    tokens->count++;
    status = tl_tokens_write(path, tokens, error);
    if (status == TL_OK) {
        (void)printf("%s\n", secret);
        (void)fprintf(stderr, "This is the token of %s. It is shown now and never again.\n", made->name);
    }
    return status;
}

static tl_status revoke_token(const char *path, const char *name, tl_tokens *tokens, tl_error *error) {
    size_t index = tl_tokens_named(tokens, name);
    if (index == tokens->count) {
        return tl_fail(error, TL_BAD_USAGE, "there is no token %s: see `twinlock token list`", name);
    }
    tokens->count--;
    memmove(&tokens->rows[index], &tokens->rows[index + 1], (tokens->count - index) * sizeof tokens->rows[0]);
    return tl_tokens_write(path, tokens, error);
}

static int token_verb(int argc, char **argv) {
    program_options options = {.tokens = TL_TOKENS_FILE};
    tl_tokens tokens;
    tl_change_right role = TL_RIGHT_READ;
    tl_error error = {TL_OK, ""};
    char **words = NULL;
    tl_options_outcome outcome = read_options(TOKEN_VERB, argc, argv, &options, &words, 1, 2);
    if (outcome != TL_OPTIONS_READ) {
        return exit_code_of(outcome);
    }
    bool lists = strcmp(words[0], "list") == 0;
    bool adds = strcmp(words[0], "add") == 0;
    const char *name = words[1];
    if (!lists && !adds && strcmp(words[0], "revoke") != 0) {
        return exit_code_of(tl_options_refuse(TOKEN_VERB, "expected add, list or revoke"));
    }
    if (!lists && name == NULL) {
        return exit_code_of(tl_options_refuse(TOKEN_VERB, "a name is missing, for example anna"));
    }
    if (!lists && (!tl_plain_name(name) || strlen(name) >= TL_TOKEN_NAME)) {
        return exit_code_of(tl_options_refuse(TOKEN_VERB, "a token's name has at most 31 letters, digits, - _ and ."));
    }
    if (adds && (options.role == NULL || !tl_change_right_of(options.role, &role))) {
        return exit_code_of(tl_options_refuse(TOKEN_VERB, "add needs --role read, retune or commission"));
    }
    tl_status status = tl_tokens_read(options.tokens, &tokens, &error);
    if (status == TL_OK && lists) {
        for (size_t i = 0; i < tokens.count; i++) {
            const tl_token *token = &tokens.rows[i];
            (void)printf("%-31s  %-10s  %s\n", token->name, tl_change_rights[token->role], token->created);
        }
    } else if (status == TL_OK) {
        status = adds ? add_token(options.tokens, name, role, &tokens, &error)
                      : revoke_token(options.tokens, name, &tokens, &error);
    }
    if (status != TL_OK) {
        tl_log(TL_LOG_ERROR, "%s", error.text);
    }
    return tl_exit_code(status);
}

int main(int argc, char **argv) {
    tl_crash_install();
    tl_locale_use();
    if (argc > 1 && strcmp(argv[1], "token") == 0) {
        return token_verb(argc - 1, argv + 1);
    }
    bool is_named = argc > 1 && strcmp(argv[1], "serve") == 0;
    return serve_verb(argc - (is_named ? 1 : 0), argv + (is_named ? 1 : 0));
}
