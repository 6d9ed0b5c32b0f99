/* A sample buffer with a malicious writer, which writes any bytes, also during a read. */
#include <pthread.h>
#include <stdbool.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#include <unity.h>

#include "firmware/plant/sample_buffer.h"
#include "tests/support/random_numbers.h"
#include "tests/support/real_time.h"

#define PATIENCE (60 * TL_SECOND)

enum { DEPTH = 256, BYTES = DEPTH * sizeof(tl_sample_buffer_slot) + sizeof(uint64_t), ROUNDS = 2000, LOOKS = 20 };

/* Inaccessible pages surround the sample buffer, and the reader's mapping is read-only. */
static unsigned char *pages;
static size_t page, whole;
static tl_sample_buffer mine, theirs;

/* Maps the buffer a second time, for the attacker. */
static unsigned char *map(int file, size_t before, int rights) {
    /* cppcheck-suppress invalidFunctionArg ; an anonymous mapping has no file, which is -1 */
    unsigned char *made = mmap(NULL, before + whole + page, PROT_NONE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    TEST_ASSERT_NOT_EQUAL(MAP_FAILED, made);
    TEST_ASSERT_NOT_EQUAL(MAP_FAILED, mmap(made + before, whole, rights, MAP_SHARED | MAP_FIXED, file, 0));
    return made + before;
}

static tl_sample_buffer handle(unsigned char *begin) {
    unsigned char *slots = begin + whole - BYTES;
    return (tl_sample_buffer){
        .slots = (tl_sample_buffer_slot *)(void *)slots,
        .count = (uint64_t *)(void *)(slots + DEPTH * sizeof(tl_sample_buffer_slot)),
        .depth = DEPTH,
    };
}

void setUp(void) {
    page = (size_t)sysconf(_SC_PAGESIZE);
    whole = (BYTES + page - 1) / page * page;
    int file = memfd_create("mailbox", MFD_CLOEXEC);
    TEST_ASSERT_EQUAL_INT(0, ftruncate(file, (off_t)whole));
    pages = map(file, page, PROT_READ);
    mine = handle(pages);
    theirs = handle(map(file, page, PROT_READ | PROT_WRITE));
    (void)close(file);
}

void tearDown(void) {
    unsigned char *enemy = (unsigned char *)theirs.slots + BYTES - whole;
    (void)munmap(pages - page, page + whole + page);
    (void)munmap(enemy - page, page + whole + page);
}

/* Numbers that are likely to cause errors. */
static uint64_t any_word(tl_test_random *random) {
    static const uint64_t ODD[] = {0,
                                   1,
                                   2,
                                   DEPTH,
                                   DEPTH - 1,
                                   DEPTH + 1,
                                   UINT64_MAX,
                                   INT64_MAX,
                                   INT64_MAX - 1,
                                   UINT64_MAX - DEPTH,
                                   UINT64_MAX / 2 + 1};
    uint64_t bits = tl_test_random_bits(random);
    switch (tl_test_random_below(random, 3)) {
    case 0:
        return ODD[tl_test_random_below(random, sizeof ODD / sizeof ODD[0])];
    case 1:
        return bits % (4 * DEPTH);
    default:
        return bits;
    }
}

static void put(uint64_t *word, uint64_t value) {
    __atomic_store_n(word, value, __ATOMIC_RELAXED);
}

/* Forges a slot as the post of this number, or with a random number. */
static void lie(tl_test_random *random, uint64_t post) {
    tl_sample_buffer_slot *slot = &theirs.slots[post % DEPTH];
    put(&slot->sequence, tl_test_random_chance(random, 90) ? 2 * post + 2 : any_word(random));
    put(&slot->value, any_word(random));
    __atomic_store_n(&slot->stamp, (int64_t)any_word(random), __ATOMIC_RELAXED);
    put(&slot->quality, tl_test_random_chance(random, 50) ? any_word(random) % 8 : any_word(random));
}

static void lie_about_all(tl_test_random *random) {
    uint64_t count = any_word(random);
    put(theirs.count, count);
    for (uint64_t i = 1; i <= DEPTH; i++) {
        lie(random, count - i);
    }
}

/* Returns true if a reading was found. Each found reading is valid. */
static bool look(tl_test_random *random) {
    tl_reading reading = {.quality = TL_GOOD};
    tl_time one = (tl_time)any_word(random);
    tl_time other = (tl_time)any_word(random);
    bool found = tl_sample_buffer_from(&mine, one < other ? one : other, one < other ? other : one, &reading);
    TEST_ASSERT_TRUE(reading.quality >= TL_GOOD && reading.quality <= TL_OUTLIER);
    found = tl_sample_buffer_at(&mine, one, &reading) || found;
    TEST_ASSERT_TRUE(reading.quality >= TL_GOOD && reading.quality <= TL_OUTLIER);
    return found;
}

static void test_nothing_that_lies_there_leads_astray(void) {
    size_t found = 0;
    for (uint64_t seed = 1; seed <= ROUNDS; seed++) {
        tl_test_random random = {seed};
        lie_about_all(&random);
        for (int i = 0; i < LOOKS; i++) {
            found += look(&random) ? 1 : 0;
        }
    }
    TEST_ASSERT_TRUE(found > ROUNDS * LOOKS / 2); /* the forged slots were accepted */
}

static void test_a_quality_that_does_not_exist(void) {
    static const uint64_t QUALITIES[] = {TL_OUTLIER + 1, 256, 1ULL << 32, UINT64_MAX};
    for (size_t i = 0; i < sizeof QUALITIES / sizeof QUALITIES[0]; i++) {
        const tl_reading good = {.value = 1, .stamp = (tl_time)i, .quality = TL_GOOD};
        tl_reading reading;
        tl_sample_buffer_post(&theirs, &good);
        theirs.slots[i].quality = QUALITIES[i];
        TEST_ASSERT_TRUE(tl_sample_buffer_at(&mine, (tl_time)i, &reading));
        TEST_ASSERT_EQUAL_INT(TL_NO_LINK, reading.quality);
    }
}

/* The next writer can continue, whatever the dead one has left. */
static void test_a_successor_is_not_led_astray(void) {
    for (uint64_t seed = 1; seed <= ROUNDS; seed++) {
        tl_test_random random = {seed};
        tl_reading reading = {.quality = TL_NO_LINK};
        lie_about_all(&random);
        lie(&random, *theirs.count);
        tl_sample_buffer_repair(&theirs);
        const tl_reading newest = {.value = (double)seed, .stamp = INT64_MAX, .quality = TL_GOOD};
        tl_sample_buffer_post(&theirs, &newest);
        TEST_ASSERT_TRUE(tl_sample_buffer_at(&mine, INT64_MAX, &reading) || *theirs.count == 0);
        TEST_ASSERT_TRUE(*theirs.count == 0 || reading.value == (double)seed);
    }
}

/* ---- while it is read ---- */

static bool done; /* atomic */

static void *lie_on(void *context) {
    tl_test_random random = {11};
    (void)context;
    while (!__atomic_load_n(&done, __ATOMIC_ACQUIRE)) {
        uint64_t count = any_word(&random);
        lie(&random, count - 1);
        put(theirs.count, count);
        for (int i = 0; i < 50; i++) {
            lie(&random, count - 1 - tl_test_random_below(&random, DEPTH));
        }
    }
    return NULL;
}

static void test_while_it_is_read(void) {
    pthread_t enemy;
    tl_test_random random = {5};
    size_t found = 0;
    tl_time begun = tl_test_now();
    TEST_ASSERT_EQUAL_INT(0, pthread_create(&enemy, NULL, lie_on, NULL));
    while (tl_test_now() < begun + TL_SECOND / 2 || (found == 0 && tl_test_now() < begun + PATIENCE)) {
        for (int i = 0; i < LOOKS; i++) {
            found += look(&random) ? 1 : 0;
        }
    }
    __atomic_store_n(&done, true, __ATOMIC_RELEASE);
    TEST_ASSERT_EQUAL_INT(0, pthread_join(enemy, NULL));
    TEST_ASSERT_TRUE(found > 0);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_nothing_that_lies_there_leads_astray);
    RUN_TEST(test_a_quality_that_does_not_exist);
    RUN_TEST(test_a_successor_is_not_led_astray);
    RUN_TEST(test_while_it_is_read);
    return UNITY_END();
}
