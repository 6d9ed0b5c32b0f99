/* Fuzzes a control socket and a validator: the hostile side is the client, the plant, or the
 * validator's result in shared memory.
 *
 * Input:  which side is hostile; changes of a valid message (how many bytes, where, to what), or
 *         raw bytes instead; whether memory is attached, and its content.
 * Holds:  each message that is accepted is valid: kinds and numbers exist, texts end within their
 *         arrays and have no control character except tab, and a candidate has the hash that the
 *         request names. No descriptor stays open. */
#include <fcntl.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "firmware/config/config_change.h"
#include "firmware/retune/control.h"
#include "firmware/retune/worker.h"
#include "tests/fuzz/harness.h"
#include "tests/fuzz/input.h"

enum { MOST = 4096 };

static char taken[TL_CONTROL_MOST + 1];
static char sent[MOST];
static int ends[2];

static size_t take_bytes(void *bytes, size_t room) {
    size_t size = tl_fuzz_take_word() % (room + 1);
    for (size_t i = 0; i < size; i++) {
        ((unsigned char *)bytes)[i] = (unsigned char)tl_fuzz_take();
    }
    return size;
}

static void change(void *bytes, size_t size) {
    unsigned count = tl_fuzz_take();
    for (unsigned i = 0; i < count && !tl_fuzz_is_over(); i++) {
        size_t at = tl_fuzz_take_word() % size;
        ((unsigned char *)bytes)[at] = (unsigned char)tl_fuzz_take();
    }
}

static void hold_text(const char *text, size_t room) {
    size_t length = strnlen(text, room);
    tl_fuzz_hold(length < room);
    for (size_t i = 0; i < length; i++) {
        tl_fuzz_hold((unsigned char)text[i] >= ' ' || text[i] == '\t');
    }
}

/* Returns the lowest unused descriptor number, which must be equal before and after. */
static int lowest_number(void) {
    int number = 3;
    while (fcntl(number, F_GETFD) >= 0) {
        number++;
    }
    return number;
}

static void send_changed(void *message, size_t size) {
    char text[256];
    size_t length = tl_fuzz_take() % 2 == 0 ? take_bytes(text, sizeof text) : 0;
    bool is_raw = tl_fuzz_take() % 8 == 0;
    if (is_raw) {
        size_t raw = take_bytes(sent, sizeof sent);
        (void)tl_control_packet_send(ends[1], sent, raw, length == 0 ? NULL : text, length);
    } else {
        change(message, size);
        (void)tl_control_packet_send(ends[1], message, size, length == 0 ? NULL : text, length);
    }
}

/* ---- we are the plant ---- */

static void fuzz_server(void) {
    static tl_control_request request;
    tl_control_peer peer = {.socket = ends[0]};
    char hash[TL_SHA256_TEXT];
    size_t size = 0;
    memset(&request, 0, sizeof request);
    request.protocol = TL_CONTROL_PROTOCOL;
    request.verb = tl_fuzz_take() % TL_CONTROL_VERBS;
    send_changed(&request, sizeof request);
    int before = lowest_number();
    if (tl_control_receive(&peer, &request, taken, &size) == TL_CONTROL_REQUEST) {
        tl_fuzz_hold(request.verb < TL_CONTROL_VERBS && request.right < TL_RIGHT_BOX);
        tl_fuzz_hold(request.origin < TL_ORIGIN_START && request.flags <= TL_CONTROL_FLAGS);
        tl_fuzz_hold((request.verb == TL_CONTROL_APPLY) == (size != 0));
        hold_text(request.who, sizeof request.who);
        hold_text(request.why, sizeof request.why);
        tl_sha256(taken, size, hash);
        tl_fuzz_hold(size == 0 || strcmp(hash, request.hash) == 0);
        tl_fuzz_hold(before == lowest_number());
        tl_control_close(&peer);
    }
    ends[0] = peer.socket;
}

/* ---- we are the client ---- */

static void fuzz_client(void) {
    static tl_control_reply reply;
    tl_error error;
    memset(&reply, 0, sizeof reply);
    reply.kind = tl_fuzz_take() % TL_CONTROL_KINDS;
    send_changed(&reply, sizeof reply);
    int before = lowest_number();
    if (tl_control_next(ends[0], 0, &reply, taken, &error) == TL_OK) {
        tl_fuzz_hold(reply.kind < TL_CONTROL_KINDS);
        tl_fuzz_hold(reply.kind != TL_CONTROL_END || reply.as.end.result < TL_CONTROL_RESULTS);
        tl_fuzz_hold(reply.kind != TL_CONTROL_PROBLEM ||
                     strnlen(reply.as.problem.text, TL_CONTROL_TEXT) < TL_CONTROL_TEXT);
    }
    tl_fuzz_hold(before == lowest_number());
}

/* ---- we read a validator's result ---- */

static void fuzz_verdict(void) {
    static tl_worker_result from;
    static tl_verdict verdict;
    memset(&from, 0, sizeof from);
    from.is_complete = 1;
    change(&from, sizeof from);
    if (!tl_verdict_take(&from, &verdict)) {
        return;
    }
    tl_fuzz_hold(verdict.kind < TL_CHANGE_KINDS && verdict.right < TL_RIGHTS && verdict.is_valid <= 1);
    tl_fuzz_hold(verdict.is_valid == 0 || verdict.right >= TL_RIGHT_RETUNE);
    for (size_t i = 0; i < TL_VERDICT_PROBLEMS; i++) {
        hold_text(verdict.problem[i].path, sizeof verdict.problem[i].path);
        hold_text(verdict.problem[i].text, sizeof verdict.problem[i].text);
    }
    for (size_t i = 0; i < TL_VERDICT_CHANGES; i++) {
        hold_text(verdict.change[i].before, sizeof verdict.change[i].before);
        hold_text(verdict.change[i].kind, sizeof verdict.change[i].kind);
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    tl_fuzz_begin(data, size);
    unsigned which = tl_fuzz_take() % 3;
    if (which == 2) {
        fuzz_verdict();
        return 0;
    }
    tl_fuzz_hold(socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_NONBLOCK | SOCK_CLOEXEC, 0, ends) == 0);
    if (which == 0) {
        fuzz_server();
    } else {
        fuzz_client();
    }
    for (size_t i = 0; i < 2; i++) {
        if (ends[i] >= 0) {
            (void)close(ends[i]);
        }
    }
    return 0;
}
