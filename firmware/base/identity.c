/* Identities: see identity.h. */
#include "firmware/base/identity.h"

#include <fcntl.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/utsname.h>
#include <unistd.h>

/* ---- SHA-256 of a block of memory: first the complete blocks, then one or two blocks of padding.
 * Names as in FIPS 180-4. */

enum { BLOCK = 64, LENGTH_FIELD = 8, WORDS = 8, ROUNDS = 64 };

/* First 32 bits of the fractional parts of the cube roots of the first 64 primes. */
static const uint32_t K[ROUNDS] = {
    0x428a2f98, 0x71374491, 0xb5c0fbcf, 0xe9b5dba5, 0x3956c25b, 0x59f111f1, 0x923f82a4, 0xab1c5ed5,
    0xd807aa98, 0x12835b01, 0x243185be, 0x550c7dc3, 0x72be5d74, 0x80deb1fe, 0x9bdc06a7, 0xc19bf174,
    0xe49b69c1, 0xefbe4786, 0x0fc19dc6, 0x240ca1cc, 0x2de92c6f, 0x4a7484aa, 0x5cb0a9dc, 0x76f988da,
    0x983e5152, 0xa831c66d, 0xb00327c8, 0xbf597fc7, 0xc6e00bf3, 0xd5a79147, 0x06ca6351, 0x14292967,
    0x27b70a85, 0x2e1b2138, 0x4d2c6dfc, 0x53380d13, 0x650a7354, 0x766a0abb, 0x81c2c92e, 0x92722c85,
    0xa2bfe8a1, 0xa81a664b, 0xc24b8b70, 0xc76c51a3, 0xd192e819, 0xd6990624, 0xf40e3585, 0x106aa070,
    0x19a4c116, 0x1e376c08, 0x2748774c, 0x34b0bcb5, 0x391c0cb3, 0x4ed8aa4a, 0x5b9cca4f, 0x682e6ff3,
    0x748f82ee, 0x78a5636f, 0x84c87814, 0x8cc70208, 0x90befffa, 0xa4506ceb, 0xbef9a3f7, 0xc67178f2,
};

/* First 32 bits of the fractional parts of the square roots of the first 8 primes. */
static const uint32_t INITIAL[WORDS] = {
    0x6a09e667, 0xbb67ae85, 0x3c6ef372, 0xa54ff53a, 0x510e527f, 0x9b05688c, 0x1f83d9ab, 0x5be0cd19,
};

static uint32_t rotated(uint32_t word, unsigned bits) {
    return word >> bits | word << (32 - bits);
}

static void schedule(const unsigned char *block, uint32_t w[ROUNDS]) {
    for (size_t t = 0; t < 16; t++) {
        const unsigned char *bytes = block + 4 * t;
        w[t] = (uint32_t)bytes[0] << 24 | (uint32_t)bytes[1] << 16 | (uint32_t)bytes[2] << 8 | bytes[3];
    }
    for (size_t t = 16; t < ROUNDS; t++) {
        uint32_t sigma0 = rotated(w[t - 15], 7) ^ rotated(w[t - 15], 18) ^ w[t - 15] >> 3;
        uint32_t sigma1 = rotated(w[t - 2], 17) ^ rotated(w[t - 2], 19) ^ w[t - 2] >> 10;
        w[t] = sigma1 + w[t - 7] + sigma0 + w[t - 16];
    }
}

static void add_block(uint32_t state[WORDS], const unsigned char *block) {
    uint32_t w[ROUNDS];
    uint32_t a = state[0];
    uint32_t b = state[1];
    uint32_t c = state[2];
    uint32_t d = state[3];
    uint32_t e = state[4];
    uint32_t f = state[5];
    uint32_t g = state[6];
    uint32_t h = state[7];
    schedule(block, w);
    for (size_t t = 0; t < ROUNDS; t++) {
        uint32_t sum1 = rotated(e, 6) ^ rotated(e, 11) ^ rotated(e, 25);
        uint32_t choice = (e & f) ^ (~e & g);
        uint32_t t1 = h + sum1 + choice + K[t] + w[t];
        uint32_t sum0 = rotated(a, 2) ^ rotated(a, 13) ^ rotated(a, 22);
        uint32_t majority = (a & b) ^ (a & c) ^ (b & c);
        h = g; /* in variables, so in registers: as an array in memory they would take most of the time */
        g = f;
        f = e;
        e = d + t1;
        d = c;
        c = b;
        b = a;
        a = t1 + sum0 + majority;
    }
    const uint32_t added[WORDS] = {a, b, c, d, e, f, g, h};
    for (size_t i = 0; i < WORDS; i++) {
        state[i] += added[i];
    }
}

/* Adds the remaining data, a single 1 bit, zeros, and the length in bits. */
static void add_tail(uint32_t state[WORDS], const unsigned char *rest, size_t rest_size, uint64_t bits) {
    unsigned char tail[2 * BLOCK] = {0};
    size_t size = rest_size + 1 + LENGTH_FIELD <= BLOCK ? BLOCK : 2 * BLOCK;
    if (rest != NULL && rest_size > 0) {
        memcpy(tail, rest, rest_size);
    }
    tail[rest_size] = 0x80;
    for (size_t i = 0; i < LENGTH_FIELD; i++) {
        tail[size - 1 - i] = (unsigned char)(bits >> 8 * i & 0xff);
    }
    for (size_t at = 0; at < size; at += BLOCK) {
        add_block(state, tail + at);
    }
}

void tl_sha256(const void *data, size_t size, char text[TL_SHA256_TEXT]) {
    const unsigned char *bytes = data;
    uint32_t state[WORDS];
    size_t whole = size - size % BLOCK;
    memcpy(state, INITIAL, sizeof state);
    for (size_t at = 0; at < whole; at += BLOCK) {
        add_block(state, bytes + at);
    }
    add_tail(state, whole < size ? bytes + whole : NULL, size - whole, (uint64_t)size * 8);
    for (size_t i = 0; i < WORDS; i++) {
        (void)snprintf(text + 8 * i, 9, "%08x", (unsigned)state[i]);
    }
}

/* ---- identity ---- */

#ifndef TL_VERSION
#define TL_VERSION "unknown"
#endif

/* Reads the whole file without changing its offset. Returns false if it cannot be read. */
static bool read_all(int descriptor, unsigned char *bytes, size_t size) {
    size_t done = 0;
    ssize_t part = 1;
    while (done < size && part > 0) {
        part = pread(descriptor, bytes + done, size - done, (off_t)done);
        done += part > 0 ? (size_t)part : 0;
    }
    return done == size;
}

bool tl_identity_open_file(int descriptor, char text[TL_SHA256_TEXT]) {
    struct stat about;
    text[0] = '\0';
    if (fstat(descriptor, &about) != 0 || about.st_size <= 0) {
        return false;
    }
    size_t size = (size_t)about.st_size;
    unsigned char *bytes = malloc(size);
    bool whole = bytes != NULL && read_all(descriptor, bytes, size);
    if (whole) {
        tl_sha256(bytes, size, text);
    }
    free(bytes);
    return whole;
}

void tl_identity_open_files(const int *descriptors, size_t count, char text[TL_SHA256_TEXT]) {
    char digests[TL_IDENTITY_FILES * TL_SHA256_TEXT];
    text[0] = '\0';
    for (size_t i = 0; i < count; i++) {
        if (!tl_identity_open_file(descriptors[i], digests + i * TL_SHA256_TEXT)) {
            return;
        }
    }
    tl_sha256(digests, count * TL_SHA256_TEXT, text);
}

void tl_identity_files(const char *const *paths, size_t count, char text[TL_SHA256_TEXT]) {
    int descriptors[TL_IDENTITY_FILES] = {0};
    for (size_t i = 0; i < count; i++) {
        descriptors[i] = open(paths[i], O_RDONLY | O_CLOEXEC);
    }
    tl_identity_open_files(descriptors, count, text);
    for (size_t i = 0; i < count; i++) {
        if (descriptors[i] >= 0) {
            (void)close(descriptors[i]);
        }
    }
}

uint64_t tl_identity_number_of_open_files(const int *descriptors, size_t count) {
    char digest[TL_SHA256_TEXT] = ""; /* of the earlier files, then including this one */
    for (size_t i = 0; i < count; i++) {
        struct stat about;
        char text[TL_SHA256_TEXT + 100];
        if (fstat(descriptors[i], &about) == 0) {
            int length = snprintf(text, sizeof text, "%s %" PRIuMAX " %" PRIdMAX " %" PRIdMAX ".%09ld", digest,
                                  (uintmax_t)about.st_ino, (intmax_t)about.st_size, (intmax_t)about.st_mtim.tv_sec,
                                  about.st_mtim.tv_nsec);
            tl_sha256(text, (size_t)length, digest);
        }
    }
    digest[2 * sizeof(uint64_t)] = '\0';
    uint64_t number = strtoull(digest, NULL, 16);
    return number == 0 ? 1 : number;
}

bool tl_identity_is_sound(const char text[TL_SHA256_TEXT]) {
    size_t length = strnlen(text, TL_SHA256_TEXT);
    return length == 0 || (length == TL_SHA256_TEXT - 1 && strspn(text, "0123456789abcdef") == length);
}

void tl_identity_boot(char text[TL_IDENTITY_TEXT]) {
    FILE *file = fopen("/proc/sys/kernel/random/boot_id", "r");
    text[0] = '\0';
    if (file != NULL) {
        (void)!fgets(text, TL_IDENTITY_TEXT, file);
        text[strcspn(text, "\n")] = '\0';
        (void)fclose(file);
    }
}

void tl_identity_format(char text[TL_IDENTITY_TEXT]) {
    struct utsname system;
    const char *machine = uname(&system) == 0 ? system.machine : "unknown";
    (void)snprintf(text, TL_IDENTITY_TEXT, "twinlock %s, %.32s, %zu bit", TL_VERSION, machine, sizeof(void *) * 8);
}
