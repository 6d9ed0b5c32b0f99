/* Fuzzes replies from a plant's control socket: the answer is lines of JSON of limited size without
 * control characters, and it ends.
 *
 * Input:  the verb of the request; then packets: a kind, the length (255: that of a reply), and
 *         bytes to fill it. */
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "firmware/base/json.h"
#include "firmware/serve/dialogue.h"
#include "tests/fuzz/harness.h"
#include "tests/fuzz/input.h"

enum { PACKETS = 8, WHOLE = 255 };

/* Sends a reply that is filled with the bytes of the input, repeated. */
static void send_packet(int socket, unsigned kind, unsigned length, const uint8_t *fill, size_t size) {
    tl_control_reply reply;
    for (size_t i = 0; i < sizeof reply; i++) {
        ((uint8_t *)&reply)[i] = size > 0 ? fill[i % size] : 0;
    }
    reply.kind = kind % (TL_CONTROL_KINDS + 1);
    if (kind >= 128) { /* its codes are valid */
        reply.as.end.result = reply.kind == TL_CONTROL_END ? length % TL_CONTROL_RESULTS : reply.as.end.result;
        reply.as.progress.step = reply.kind == TL_CONTROL_STEP ? length % TL_CONTROL_STEPS : reply.as.progress.step;
        reply.as.state.step = reply.kind == TL_CONTROL_STATE ? length % TL_CONTROL_STEPS : reply.as.state.step;
        length = WHOLE;
    }
    (void)send(socket, &reply, length == WHOLE ? sizeof reply : length, MSG_DONTWAIT | MSG_NOSIGNAL);
}

static void check_shown(const char *text) {
    for (const char *next = text; *next != '\0'; next++) {
        unsigned char byte = (unsigned char)*next;
        tl_fuzz_hold((byte >= ' ' && byte != 0x7F) || byte == '\t'); /* text.h keeps a tab */
        tl_fuzz_hold(byte != 0xC2 || (unsigned char)next[1] >= 0xA0);
    }
}

static void check_line(const char *line, size_t size) {
    static const char *const keys[] = {"reply", "step", "text", "path",   "before", "after", "kind", "right", "plant",
                                       "hash",  "lock", "line", "origin", "who",    "why",   "at",   "result"};
    tl_json_reader json = tl_json_reader_of(line, size);
    tl_fuzz_hold(json.right);
    for (size_t i = 0; i < sizeof keys / sizeof keys[0]; i++) {
        check_shown(tl_json_text(&json, keys[i])); /* "": there is none */
    }
    tl_json_reader_free(&json);
}

/* A client reads the whole answer, in pieces. */
static void read_answer(tl_dialogue *dialogue) {
    static char answer[TL_DIALOGUE_MOST];
    size_t size = 0;
    for (size_t now = 1; now > 0; size += now) {
        size_t left = sizeof answer - size;
        now = tl_dialogue_take(dialogue, answer + size, left < 777 ? left : 777);
    }
    for (const char *line = answer; line < answer + size;) {
        const char *end = memchr(line, '\n', (size_t)(answer + size - line));
        tl_fuzz_hold(end != NULL);
        if (end == NULL) {
            return;
        }
        check_line(line, (size_t)(end - line));
        line = end + 1;
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    static char room[TL_CONTROL_MOST + 1];
    int ends[2];
    tl_fuzz_begin(data, size);
    if (socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_NONBLOCK | SOCK_CLOEXEC, 0, ends) != 0) {
        return 0;
    }
    unsigned verb = tl_fuzz_take() % TL_CONTROL_VERBS;
    tl_dialogue dialogue = {
        .is_asked = true, .socket = ends[0], .request = {.plant = "motor", .is_change = verb >= TL_CONTROL_APPLY}};
    dialogue.request.control.verb = verb;
    for (int i = 0; i < PACKETS; i++) {
        unsigned kind = tl_fuzz_take();
        unsigned length = tl_fuzz_take();
        send_packet(ends[1], kind, length, data, size);
        tl_dialogue_follow(&dialogue, room);
    }
    (void)close(ends[1]);
    tl_dialogue_follow(&dialogue, room);
    tl_fuzz_hold(dialogue.has_ended && dialogue.status >= TL_HTTP_OK && dialogue.size <= TL_DIALOGUE_MOST);
    read_answer(&dialogue);
    tl_dialogue_close(&dialogue);
    return 0;
}
