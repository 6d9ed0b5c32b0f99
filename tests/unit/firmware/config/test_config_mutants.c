/* Thousands of damaged configurations. The reader must not crash, read past the end, or leak.
 * It must not reject a configuration without reporting a problem.
 *
 * The seed is fixed, so each run is the same. For more mutants, pass their number and a seed:
 * test_config_mutants 1000000 7
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <unity.h>

#include "tests/support/config_text.h"
#include "tests/support/message.h"

#define FULL TL_SOURCE_DIR "/tests/support/configuration_full.json"

enum { MOST_BYTES = 32768, MOST_CHANGES = 4 };

static unsigned long mutants = 2000;
static uint64_t seed = 1;

void setUp(void) {}

void tearDown(void) {}

/* splitmix64 */
static uint64_t next_random(uint64_t *state) {
    uint64_t z = *state += 0x9E3779B97F4A7C15;
    z = (z ^ z >> 30) * 0xBF58476D1CE4E5B9;
    z = (z ^ z >> 27) * 0x94D049BB133111EB;
    return z ^ z >> 31;
}

static size_t below(uint64_t *state, size_t limit) {
    return (size_t)(next_random(state) % limit);
}

/* A text and its size. */
typedef struct draft {
    char bytes[MOST_BYTES];
    size_t size;
} draft;

static void insert(draft *d, size_t at, const char *bytes, size_t size) {
    if (d->size + size <= sizeof d->bytes) {
        memmove(d->bytes + at + size, d->bytes + at, d->size - at);
        memmove(d->bytes + at, bytes, size);
        d->size += size;
    }
}

static void erase(draft *d, size_t at, size_t size) {
    size = size < d->size - at ? size : d->size - at;
    memmove(d->bytes + at, d->bytes + at + size, d->size - at - size);
    d->size -= size;
}

/* Inserted texts: JSON syntax, limits of numbers, and keys of the format. */
static const char *const words[] = {
    "{",
    "}",
    "[",
    "]",
    ",",
    ":",
    "\"",
    "\\",
    "\\u0000",
    "\\ud800",
    "\\u0061",
    "null",
    "true",
    "{}",
    "[]",
    "\"\"",
    "0",
    "-1",
    "1e999",
    "01",
    "65536",
    "1e300",
    "1e-300",
    "0.1",
    "NaN",
    "//",
    "\xEF\xBB\xBF",
    "\xFF",
    "\xC0\xAF",
    "\n",
    "\t",
    "\"plant\":1,",
    "\"csv\":{},",
    "\"min\":9,",
    "\"source\":\"plc\",",
    "\"modbus\":{},",
    "[[[[[[[[[[[[[[[[[",
    "plant.",
    "\"sources\":[],",
    "\"plant\":[],",
    "\"components\":[1],",
    "\"connect\":{},",
    "\"compare\":{},",
    "\"epsilon\":1,",
    "\"fallback\":1,",
    "\"condition\":{},",
    "\"secant\"",
};

/* Returns the first position, at or after a random one, with a character of `set`. */
static size_t find(const draft *d, uint64_t *random, const char *set) {
    size_t at = below(random, d->size);
    while (at + 1 < d->size && strchr(set, d->bytes[at]) == NULL) {
        at++;
    }
    return at;
}

static void change(draft *d, uint64_t *random) {
    const char *word = words[below(random, sizeof words / sizeof words[0])];
    char copy[64];
    size_t at = below(random, d->size);
    size_t size = 1 + below(random, sizeof copy);
    switch (below(random, 7)) {
    case 0:
        d->bytes[at] = (char)below(random, 256);
        break;
    case 1:
        erase(d, at, size / 8 + 1);
        break;
    case 2: /* repeat a part */
        size = size < d->size - at ? size : d->size - at;
        memcpy(copy, d->bytes + at, size);
        insert(d, at, copy, size);
        break;
    case 3: /* insert a word anywhere */
        insert(d, at, word, strlen(word));
        break;
    case 4: /* insert a word at the start of a member */
        insert(d, find(d, random, "{,") + 1, word, strlen(word));
        break;
    case 5: /* replace a value */
        at = find(d, random, ":[") + 1;
        erase(d, at, strcspn(d->bytes + at, ",]}\n"));
        insert(d, at, word, strlen(word));
        break;
    default: /* cut the text */
        d->size = below(random, 20) == 0 ? at + 1 : d->size;
        break;
    }
    d->bytes[d->size < sizeof d->bytes ? d->size : sizeof d->bytes - 1] = '\0';
}

typedef struct tally {
    unsigned long good, bad_syntax, bad_values;
} tally;

/* The copy ends where the text ends, so a sanitizer detects a read past the end. */
static void check(const draft *d, tally *counts) {
    tl_test_verdict verdict;
    char *copy = malloc(d->size > 0 ? d->size : 1);
    TEST_ASSERT_NOT_NULL(copy);
    memcpy(copy, d->bytes, d->size);
    tl_test_judge_text(copy, d->size, &verdict);
    free(copy);
    if (verdict.status == TL_OK) {
        TEST_ASSERT_EQUAL_size_t(0, verdict.count);
        TEST_ASSERT_EQUAL_size_t(d->size, verdict.config.size);
        TEST_ASSERT_NOT_EQUAL_size_t(0, verdict.config.component_count);
        counts->good++;
    } else {
        TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, verdict.status);
        TEST_ASSERT_NOT_EQUAL_size_t(0, verdict.count);
        TEST_ASSERT_NULL(verdict.config.tree);
        TL_EXPECT_PARTS("line", verdict.problems[0].text);
        bool is_syntax = tl_test_has_parts(verdict.problems[0].text, "column");
        counts->bad_syntax += is_syntax ? 1 : 0;
        counts->bad_values += is_syntax ? 0 : 1;
    }
    tl_config_free(&verdict.config);
}

static void test_mutants(void) {
    static draft d;
    tally counts = {0, 0, 0};
    uint64_t random = seed;
    char *text = tl_test_read_text(FULL);
    TEST_ASSERT_NOT_NULL(text);
    for (unsigned long i = 0; i < mutants; i++) {
        d.size = strlen(text);
        memcpy(d.bytes, text, d.size + 1);
        for (size_t changes = 1 + below(&random, MOST_CHANGES); changes > 0 && d.size > 0; changes--) {
            change(&d, &random);
        }
        check(&d, &counts);
    }
    free(text);
    (void)printf("%lu good, %lu with bad syntax, %lu with bad values\n", counts.good, counts.bad_syntax,
                 counts.bad_values);
    TEST_ASSERT_GREATER_THAN(mutants / 50, counts.good);
    TEST_ASSERT_GREATER_THAN(mutants / 10, counts.bad_syntax);
    TEST_ASSERT_GREATER_THAN(mutants / 20, counts.bad_values);
}

int main(int count, char **arguments) {
    mutants = count > 1 ? strtoul(arguments[1], NULL, 10) : mutants;
    seed = count > 2 ? strtoull(arguments[2], NULL, 10) : seed;
    UNITY_BEGIN();
    RUN_TEST(test_mutants);
    return UNITY_END();
}
