/* One twin writes its states, another reads them: the outputs are equal, or the difference is
 * reported. The bytes may be damaged. */
#include <stdlib.h>
#include <string.h>
#include <unity.h>

#include "master/twin/twin_read_back.h"
#include "tests/support/message.h"
#include "tests/support/test_scene.h"

enum { TICKS = 40, BYTES = 1 << 16, B = 1 /* "b", whose y0 is matched */ };

static tl_test_scene first, other;
static tl_read_back here[TL_SCENE_FMUS], there;
static unsigned char bytes[BYTES];
static size_t size;

void setUp(void) {
    memset(bytes, 0x55, sizeof bytes);
    size = 0;
}

void tearDown(void) {
    tl_test_scene_end(&first);
    tl_test_scene_end(&other);
}

static void begin(tl_test_scene_kind kind) {
    tl_test_scene_build(&first, kind);
    while (first.run.sample.tick < TICKS) {
        tl_test_scene_show(&first);
        tl_test_run_step(&first.run);
        TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, first.run.status, first.run.error.text);
    }
}

static tl_status write_twin(size_t capacity) {
    return tl_twin_write_states(first.run.twin, bytes, capacity, &size, here, &first.run.error);
}

static void begin_to_read(tl_test_scene_kind kind) {
    tl_test_scene_build(&other, kind);
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_twin_prepare_reader(other.run.twin, &other.run.error),
                                  other.run.error.text);
}

static void read_back(size_t component) {
    tl_twin_read_state(other.run.twin, bytes, size, component, &there);
}

/* Writing states does not change the further run of the twin. */
static void expect_undisturbed(tl_test_scene_kind kind) {
    tl_record records[TICKS];
    for (int i = 0; i < TICKS; i++) {
        tl_test_scene_show(&first);
        tl_test_run_step(&first.run);
        records[i] = first.run.record;
    }
    tl_test_scene_end(&first);
    begin(kind);
    for (int i = 0; i < TICKS; i++) {
        tl_test_scene_show(&first);
        tl_test_run_step(&first.run);
        TEST_ASSERT_EQUAL_INT64(records[i].step, first.run.record.step);
        TEST_ASSERT_EQUAL_MEMORY_MESSAGE(records[i].y, first.run.record.y, sizeof(double), tl_test_scene_name(kind));
    }
}

static void test_exact_in_every_mode(void) {
    for (tl_test_scene_kind kind = TL_SCENE_LAG; kind < TL_SCENES; kind++) {
        const char *name = tl_test_scene_name(kind);
        begin(kind);
        TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, write_twin(BYTES), first.run.error.text);
        if (size == 0) {
            TEST_ASSERT_EQUAL_INT(TL_SCENE_LONG, kind); /* an FMU would have to repeat steps */
            tl_test_scene_end(&first);
            continue;
        }
        begin_to_read(kind);
        for (size_t i = 0; i < TL_SCENE_FMUS; i++) {
            TEST_ASSERT_EQUAL_INT_MESSAGE(TL_READ_BACK_EXACT, here[i].outcome, name);
            read_back(i);
            TEST_ASSERT_EQUAL_INT_MESSAGE(TL_READ_BACK_EXACT, there.outcome, name);
            TEST_ASSERT_EQUAL_UINT_MESSAGE(TL_READ_BACK_STEPS, there.after, name);
        }
        expect_undisturbed(kind);
        tl_test_scene_end(&first);
        tl_test_scene_end(&other);
    }
}

/* An instance without initialisation can take a state. */
static void test_exact_without_initialisation(void) {
    begin(TL_SCENE_LAG);
    TEST_ASSERT_EQUAL_INT(TL_OK, write_twin(BYTES));
    tl_test_scene_build(&other, TL_SCENE_LAG);
    read_back(B);
    TEST_ASSERT_EQUAL_INT(TL_READ_BACK_EXACT, there.outcome);
}

/* An incomplete state shows in an output, which is reported with both values. */
static void test_it_differs(void) {
    begin(TL_SCENE_LAG);
    TEST_ASSERT_EQUAL_INT(TL_OK, write_twin(BYTES));
    begin_to_read(TL_SCENE_LAG);
    other.fmus[B].control.state_lies = true;
    read_back(B);
    TEST_ASSERT_EQUAL_INT(TL_READ_BACK_DIFFERS, there.outcome);
    TEST_ASSERT_EQUAL_STRING("y0", there.variable);
    TEST_ASSERT_EQUAL_UINT(1, there.after);
    TEST_ASSERT_TRUE(there.first != there.again);
    read_back(0);
    TEST_ASSERT_EQUAL_INT(TL_READ_BACK_EXACT, there.outcome);
}

/* The writing twin finds that its own state is incomplete, so the bytes are not the cause. */
static void test_it_differs_here(void) {
    begin(TL_SCENE_FREE); /* without a rollback check */
    first.fmus[B].control.state_lies = true;
    TEST_ASSERT_EQUAL_INT(TL_OK, write_twin(BYTES));
    TEST_ASSERT_EQUAL_INT(TL_READ_BACK_EXACT, here[0].outcome);
    TEST_ASSERT_EQUAL_INT(TL_READ_BACK_DIFFERS, here[B].outcome);
}

static void test_it_is_refused(void) {
    static const struct {
        tl_test_call call;
        const char *parts;
    } ways[] = {{TL_TEST_DESERIALIZE, "b|fmi2DeSerializeFMUstate|fmi2Error"},
                {TL_TEST_SET_STATE, "b|fmi2SetFMUstate|fmi2Error"},
                {TL_TEST_DO_STEP, "b|fmi2DoStep|fmi2Error"}};
    begin(TL_SCENE_LAG);
    TEST_ASSERT_EQUAL_INT(TL_OK, write_twin(BYTES));
    for (size_t i = 0; i < sizeof ways / sizeof ways[0]; i++) {
        begin_to_read(TL_SCENE_LAG);
        tl_test_fmu_fail(&other.fmus[B], ways[i].call, TL_TEST_ERROR, 1, UINT64_MAX);
        read_back(B);
        TEST_ASSERT_EQUAL_INT(TL_READ_BACK_REFUSED, there.outcome);
        TL_EXPECT_PARTS(ways[i].parts, there.error.text);
        tl_test_scene_end(&other);
    }
}

/* A twin that cannot write its states continues unchanged. */
static void test_a_twin_that_cannot_write(void) {
    begin(TL_SCENE_LAG);
    tl_test_fmu_fail(&first.fmus[B], TL_TEST_SERIALIZE, TL_TEST_ERROR, 1, UINT64_MAX);
    TEST_ASSERT_EQUAL_INT(TL_FMU_FAILED, write_twin(BYTES));
    TEST_ASSERT_EQUAL_size_t(0, size);
    expect_undisturbed(TL_SCENE_LAG);
}

static void test_no_states_before_the_first_step(void) {
    tl_test_scene_build(&first, TL_SCENE_LAG);
    TEST_ASSERT_EQUAL_INT(TL_OK, write_twin(BYTES));
    TEST_ASSERT_EQUAL_size_t(0, size);
}

static void test_too_little_room(void) {
    begin(TL_SCENE_LAG);
    TEST_ASSERT_EQUAL_INT(TL_OK, write_twin(BYTES));
    const size_t needed = size;
    memset(bytes, 0x55, sizeof bytes);
    TEST_ASSERT_EQUAL_INT(TL_OK, write_twin(needed - 1));
    TEST_ASSERT_EQUAL_size_t(needed, size);
    TEST_ASSERT_EACH_EQUAL_HEX8(0x55, bytes + needed - 1, BYTES - needed + 1);
}

/* Bytes of a wrong length, and with wrong numbers. */
static void test_damaged_bytes(void) {
    begin(TL_SCENE_LAG);
    TEST_ASSERT_EQUAL_INT(TL_OK, write_twin(BYTES));
    begin_to_read(TL_SCENE_LAG);
    const size_t whole = size;
    for (size = 0; size < whole; size += 7) {
        read_back(B);
        TEST_ASSERT_EQUAL_INT(TL_READ_BACK_REFUSED, there.outcome);
        TL_EXPECT_PARTS("b|state", there.error.text);
    }
    size = whole;
    for (size_t at = 0; at < 16; at++) { /* lengths of "a" */
        const unsigned char was = bytes[at];
        bytes[at] = 0xFF;
        read_back(B);
        TEST_ASSERT_EQUAL_INT(TL_READ_BACK_REFUSED, there.outcome);
        bytes[at] = was;
    }
    read_back(B);
    TEST_ASSERT_EQUAL_INT(TL_READ_BACK_EXACT, there.outcome);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_exact_in_every_mode);
    RUN_TEST(test_exact_without_initialisation);
    RUN_TEST(test_it_differs);
    RUN_TEST(test_it_differs_here);
    RUN_TEST(test_it_is_refused);
    RUN_TEST(test_a_twin_that_cannot_write);
    RUN_TEST(test_no_states_before_the_first_step);
    RUN_TEST(test_too_little_room);
    RUN_TEST(test_damaged_bytes);
    return UNITY_END();
}
