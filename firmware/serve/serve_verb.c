/* twinlock serve: see serve_verb.h. */
#include "firmware/serve/serve_verb.h"

#include <errno.h>
#include <libgen.h>
#include <limits.h>
#include <netinet/in.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "firmware/base/clock.h"
#include "firmware/base/log.h"
#include "firmware/process/confine.h"
#include "firmware/process/interrupt.h"
#include "firmware/process/service.h"
#include "firmware/serve/address.h"
#include "firmware/serve/server.h"

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
