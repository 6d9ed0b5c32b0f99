/* The program twinlock-serve: options and start: see serve_verb.h. */
#include "firmware/serve/serve_verb.h"

#include <errno.h>
#include <libgen.h>
#include <limits.h>
#include <netinet/in.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "firmware/base/log.h"
#include "firmware/base/os.h"
#include "firmware/process/confine.h"
#include "firmware/process/interrupt.h"
#include "firmware/process/service.h"
#include "firmware/retune/control.h"
#include "firmware/serve/address.h"
#include "firmware/serve/server.h"
#include "firmware/serve/tokens.h"

/* ---- serve options ---- */

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
    if (role == NULL || !tl_change_right_of(role, &options->role)) {
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

/* ---- serve verb ---- */

enum { BACKLOG = 128, MEMORY = 64 * 1024 * 1024 };

static const tl_time TURN = TL_SECOND;

/* ---- listening ---- */

static tl_status listen_on(const char *text, int *listener, tl_error *error) {
    struct sockaddr_storage address;
    socklen_t size = 0;
    unsigned port = 0;
    int on = 1;
    if (!tl_address_parse(text, &address, &size, &port)) {
        return tl_fail(error, TL_BAD_USAGE,
                       "--listen: found \"%.64s\", expected an address with a port, such as 192.0.2.7:8443", text);
    }
    *listener = socket(address.ss_family, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
    if (*listener < 0 || setsockopt(*listener, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on) != 0 ||
        setsockopt(*listener, SOL_SOCKET, SO_KEEPALIVE, &on, sizeof on) != 0 ||
        bind(*listener, (const struct sockaddr *)&address, size) != 0 || listen(*listener, BACKLOG) != 0) {
        int cause = errno;
        if (*listener >= 0) {
            (void)close(*listener);
        }
        return tl_fail(error, TL_TRY_AGAIN, "%s: cannot be listened on: %s", text, strerror(cause));
    }
    return TL_OK;
}

/* Of what was listened on; who asked for 0 has got one. */
static unsigned port_of(int listener) {
    struct sockaddr_storage address;
    socklen_t size = sizeof address;
    memset(&address, 0, sizeof address);
    (void)getsockname(listener, (struct sockaddr *)&address, &size);
    in_port_t port = address.ss_family == AF_INET6 ? ((const struct sockaddr_in6 *)(const void *)&address)->sin6_port
                                                   : ((const struct sockaddr_in *)(const void *)&address)->sin_port;
    return ntohs(port);
}

/* ---- serving ---- */

static void serve(tl_server *server) {
    tl_time patience = tl_service_patience();
    tl_time stroke = tl_clock_now(NULL);
    (void)tl_service_tell("READY=1");
    while (tl_interrupt_requested() == NULL) {
        tl_server_turn(server, TURN);
        if (patience > 0 && tl_clock_now(NULL) - stroke >= patience / 4) {
            (void)tl_service_tell("WATCHDOG=1");
            stroke = tl_clock_now(NULL);
        }
    }
    (void)tl_service_tell("STOPPING=1");
}

/* From now on it has its listener, local sockets, and two folders to look into. */
static tl_status confine(const tl_serve_options *options, tl_error *error) {
    char folder[PATH_MAX];
    tl_confine_facts facts;
    if (options->unconfined) {
        return TL_OK;
    }
    if (snprintf(folder, sizeof folder, "%s", options->tokens) >= PATH_MAX) {
        return tl_fail(error, TL_BAD_USAGE, "%.300s…: the name is too long", options->tokens);
    }
    const char *const read[] = {dirname(folder), options->plants};
    const tl_confine_settings settings = {.read = read,
                                          .read_count = sizeof read / sizeof read[0],
                                          .memory = MEMORY,
                                          .file_bytes = 2 * (uint64_t)TL_CONTROL_MOST,
                                          .start_socket = -1,
                                          .whole_process = true,
                                          .may_answer = true,
                                          .lives_on = true};
    tl_status status = tl_confine(&settings, &facts, NULL, error);
    if (status == TL_OK && (!facts.filter || facts.landlock == 0)) {
        tl_log(TL_LOG_NOTICE, "this kernel has no %s: what breaks into this server has what its user has",
               facts.filter ? "Landlock" : "seccomp");
    }
    return status;
}

static tl_status serve_on(const tl_serve_options *options, int listener, const tl_certificate *certificate,
                          tl_error *error) {
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
    tl_log(TL_LOG_NOTICE, "serves %s on port %u as %s", options->plants, port_of(listener),
           certificate->fingerprint.pin);
    serve(server);
    tl_server_close(server);
    return TL_OK;
}

static void print_fingerprint(const tl_fingerprint *fingerprint) {
    (void)printf("pin          %s\ncertificate  %s\n", fingerprint->pin, fingerprint->certificate);
}

static tl_status run(const tl_serve_options *options, const tl_certificate *certificate, tl_error *error) {
    int listener = -1;
    if (options->fingerprint) {
        print_fingerprint(&certificate->fingerprint);
        return TL_OK;
    }
    tl_interrupt_install();
    tl_status status = listen_on(options->listen, &listener, error);
    if (status == TL_OK) {
        status = serve_on(options, listener, certificate, error);
        (void)close(listener);
    }
    return status;
}

int tl_serve_verb_run(const tl_serve_options *options) {
    tl_certificate certificate;
    tl_error error = {TL_OK, ""};
    const char *chain = options->certificate;
    const char *key = options->key != NULL ? options->key : chain;
    tl_status status = chain != NULL ? tl_certificate_load(chain, key, &certificate, &error)
                                     : tl_certificate_have(options->state, &certificate, &error);
    if (status == TL_OK) {
        status = run(options, &certificate, &error);
        tl_certificate_free(&certificate);
    }
    if (status != TL_OK) {
        tl_log(TL_LOG_ERROR, "%s", error.text);
    }
    return tl_exit_code(status);
}
