/* Fuzzes the log relay: a terminal gets only printable text of another process, and the same text
 * whatever the pieces in which it arrives.
 *
 * Input:  how many bytes arrive at once, the length of the line before them, then the output. */
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "firmware/base/relay.h"
#include "tests/fuzz/harness.h"
#include "tests/fuzz/input.h"

enum { ROOM = 1 << 17, LONGEST = ROOM / 16 };

/* All lines of one arrival. */
typedef struct page {
    size_t used;
    char text[ROOM];
} page;

/* Expects no control character except tab, no C1 character, no character that changes the direction
 * of text. Independent of the code under test. */
static void check_line(const unsigned char *line) {
    for (size_t i = 0; line[i] != '\0'; i++) {
        tl_fuzz_hold(line[i] >= ' ' || line[i] == '\t');
        tl_fuzz_hold(line[i] != 0x7F && line[i] != 0xC0 && line[i] != 0xC1 && line[i] < 0xF5);
        bool follows = i > 0 && line[i - 1] >= 0x80;
        tl_fuzz_hold((line[i] & 0xC0) != 0x80 || follows);
        tl_fuzz_hold(line[i] != 0xC2 || line[i + 1] >= 0xA0);
        bool is_e280 = line[i] == 0xE2 && line[i + 1] == 0x80;
        tl_fuzz_hold(!is_e280 || !(line[i + 2] >= 0xA8 && line[i + 2] <= 0xAE));
        bool is_e281 = line[i] == 0xE2 && line[i + 1] == 0x81;
        tl_fuzz_hold(!is_e281 || !(line[i + 2] >= 0xA6 && line[i + 2] <= 0xA9));
        tl_fuzz_hold(line[i] < 0xC0 || (line[i + 1] & 0xC0) == 0x80);
    }
}

static void keep(void *context, const char *line) {
    page *all = context;
    size_t size = strlen(line) + 1;
    tl_fuzz_hold(size <= TL_RELAY_CLEAN && all->used + size <= ROOM);
    check_line((const unsigned char *)line);
    memcpy(all->text + all->used, line, size);
    all->used += size;
}

static void print(page *all, const char *bytes, size_t size, size_t at_once) {
    tl_relay relay;
    int ends[2];
    tl_fuzz_hold(pipe(ends) == 0);
    tl_relay_open(&relay, ends[0], keep, all);
    for (size_t done = 0; done < size;) {
        size_t now = size - done < at_once ? size - done : at_once;
        tl_fuzz_hold(write(ends[1], bytes + done, now) == (ssize_t)now);
        tl_fuzz_hold(tl_relay_drain(&relay));
        done += now;
    }
    (void)close(ends[1]);
    tl_fuzz_hold(!tl_relay_drain(&relay));
    tl_relay_close(&relay);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    static page one;
    static page other;
    one.used = 0;
    other.used = 0;
    if (size > LONGEST) {
        return 0;
    }
    tl_fuzz_begin(data, size);
    size_t at_once = 1 + tl_fuzz_take() * 8;
    size_t before = tl_fuzz_take() % 2 == 0 ? 0 : TL_RELAY_LINE - 6;
    size_t rest = size > 2 ? size - 2 : 0;
    char *bytes = malloc(before + rest + 1);
    if (bytes == NULL) {
        return 0;
    }
    memset(bytes, 'x', before);
    if (rest > 0) {
        memcpy(bytes + before, data + 2, rest);
    }
    print(&one, bytes, before + rest, at_once);
    print(&other, bytes, before + rest, 32768);
    tl_fuzz_hold(one.used == other.used && memcmp(one.text, other.text, one.used) == 0);
    free(bytes);
    return 0;
}
