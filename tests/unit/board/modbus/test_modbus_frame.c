/* Modbus requests and answers as bytes, and the outcome of a request as text. */
#include <errno.h>
#include <modbus.h>
#include <stdio.h>
#include <string.h>

#include <unity.h>

#include "board/modbus/modbus_link.h"
#include "tests/support/message.h"

static const tl_modbus_read REGISTERS = {.unit_id = 17, .table = TL_MODBUS_INPUT, .address = 0x1234, .count = 3};
static const tl_modbus_read BITS = {.unit_id = 17, .table = TL_MODBUS_COIL, .address = 0x1234, .count = 10};

void setUp(void) {}

void tearDown(void) {}

static void expect(tl_modbus_kind kind, int found, int wanted, tl_modbus_outcome outcome) {
    TEST_ASSERT_EQUAL_INT(kind, outcome.kind);
    TEST_ASSERT_EQUAL_INT(found, outcome.found);
    TEST_ASSERT_EQUAL_INT(wanted, outcome.wanted);
}

static void test_a_request(void) {
    static const uint8_t EXPECTED[] = {0xAB, 0xCD, 0, 0, 0, 6, 17, 4, 0x12, 0x34, 0, 3};
    const tl_modbus_question asked = {.read = &REGISTERS, .transaction = 0xABCD};
    uint8_t request[TL_MODBUS_TCP_REQUEST];
    tl_modbus_put_request(&asked, request);
    TEST_ASSERT_EQUAL_size_t(sizeof EXPECTED, sizeof request);
    TEST_ASSERT_EQUAL_HEX8_ARRAY(EXPECTED, request, sizeof EXPECTED);
}

/* At each size the check asks for no byte beyond the answer. */
static void test_an_answer_as_it_grows(void) {
    static const uint8_t ANSWER[] = {0xAB, 0xCD, 0, 0, 0, 9, 17, 4, 6, 0, 1, 2, 3, 0xFF, 0xFE};
    const tl_modbus_question asked = {.read = &REGISTERS, .transaction = 0xABCD};
    for (size_t size = 0; size <= sizeof ANSWER; size++) {
        size_t missing = 99;
        tl_modbus_outcome outcome = tl_modbus_check_tcp(&asked, ANSWER, size, &missing);
        TEST_ASSERT_EQUAL_INT(TL_MODBUS_VALUES, outcome.kind);
        TEST_ASSERT_EQUAL_size_t((size < TL_MODBUS_TCP_FIRST ? TL_MODBUS_TCP_FIRST : sizeof ANSWER) - size, missing);
    }
    tl_modbus_values values;
    tl_modbus_take_values(&REGISTERS, ANSWER + TL_MODBUS_TCP_FIRST, &values);
    TEST_ASSERT_EQUAL_UINT16(1, values.registers[0]);
    TEST_ASSERT_EQUAL_UINT16(0x0203, values.registers[1]);
    TEST_ASSERT_EQUAL_UINT16(0xFFFE, values.registers[2]);
}

/* The unused bits of the last byte are ignored. */
static void test_bits(void) {
    static const uint8_t BYTES[] = {0x81, 0xFE};
    static const uint8_t EXPECTED[] = {1, 0, 0, 0, 0, 0, 0, 1, 0, 1, 7};
    tl_modbus_values values;
    values.bits[10] = 7;
    TEST_ASSERT_EQUAL_size_t(2, tl_modbus_value_bytes(&BITS));
    tl_modbus_take_values(&BITS, BYTES, &values);
    TEST_ASSERT_EQUAL_UINT8_ARRAY(EXPECTED, values.bits, sizeof EXPECTED);
}

/* Each byte of the header of an answer has one right value, except the unit with any_unit_id and the
 * transaction with any_transaction_id. */
static void test_each_byte_of_the_head(void) {
    static const uint8_t RIGHT[] = {0xAB, 0xCD, 0, 0, 0, 9, 17, 4, 6, 0, 1, 2, 3, 4, 5};
    static const tl_modbus_kind KINDS[] = {
        TL_MODBUS_WRONG_TRANSACTION, TL_MODBUS_WRONG_TRANSACTION, TL_MODBUS_WRONG_PROTOCOL,
        TL_MODBUS_WRONG_PROTOCOL,    TL_MODBUS_WRONG_LENGTH,      TL_MODBUS_WRONG_LENGTH,
        TL_MODBUS_WRONG_UNIT,        TL_MODBUS_WRONG_FUNCTION,    TL_MODBUS_WRONG_BYTES};
    for (size_t at = 0; at < TL_MODBUS_TCP_FIRST; at++) {
        for (unsigned value = 0; value < 256; value++) {
            uint8_t answer[sizeof RIGHT];
            size_t missing = 99;
            memcpy(answer, RIGHT, sizeof answer);
            answer[at] = (uint8_t)value;
            tl_modbus_question asked = {.read = &REGISTERS, .transaction = 0xABCD};
            tl_modbus_outcome outcome = tl_modbus_check_tcp(&asked, answer, sizeof answer, &missing);
            bool refusal = at == 7 && value == 0x84; /* an exception that is too long */
            TEST_ASSERT_EQUAL_INT(value == RIGHT[at] ? TL_MODBUS_VALUES
                                  : refusal          ? TL_MODBUS_WRONG_LENGTH
                                                     : KINDS[at],
                                  outcome.kind);
            TEST_ASSERT_EQUAL_size_t(0, missing);
            asked.any_unit_id = true;
            outcome = tl_modbus_check_tcp(&asked, answer, sizeof answer, &missing);
            TEST_ASSERT_EQUAL(value == RIGHT[at] || at == 6, outcome.kind == TL_MODBUS_VALUES);
            asked.any_unit_id = false;
            asked.any_transaction_id = true;
            outcome = tl_modbus_check_tcp(&asked, answer, sizeof answer, &missing);
            TEST_ASSERT_EQUAL(value == RIGHT[at] || at < 2, outcome.kind == TL_MODBUS_VALUES);
        }
    }
}

static void test_found_and_wanted_values(void) {
    uint8_t answer[] = {0, 1, 0, 0, 255, 255, 17, 4, 6};
    const tl_modbus_question asked = {.read = &REGISTERS, .transaction = 1};
    size_t missing = 99;
    expect(TL_MODBUS_WRONG_LENGTH, 65535, 9, tl_modbus_check_tcp(&asked, answer, 7, &missing));
    answer[4] = 0;
    answer[5] = 10;
    expect(TL_MODBUS_WRONG_LENGTH, 10, 9, tl_modbus_check_tcp(&asked, answer, 9, &missing));
    answer[5] = 3;
    answer[7] = 0x84;
    answer[8] = 0;
    expect(TL_MODBUS_EXCEPTION, 0, 0, tl_modbus_check_tcp(&asked, answer, 9, &missing));
    TEST_ASSERT_EQUAL_size_t(0, missing);
}

static void test_an_answer_on_a_line(void) {
    uint8_t answer[] = {17, 4, 6, 0, 1, 0, 2, 0, 3, 0};
    expect(TL_MODBUS_VALUES, 9, 9, tl_modbus_check_rtu(&REGISTERS, answer, 9));
    expect(TL_MODBUS_WRONG_LENGTH, 10, 9, tl_modbus_check_rtu(&REGISTERS, answer, 10));
    answer[2] = 7;
    expect(TL_MODBUS_WRONG_BYTES, 7, 6, tl_modbus_check_rtu(&REGISTERS, answer, 10));
    answer[1] = 3;
    expect(TL_MODBUS_WRONG_FUNCTION, 3, 4, tl_modbus_check_rtu(&REGISTERS, answer, 9));
    answer[0] = 0;
    expect(TL_MODBUS_WRONG_UNIT, 0, 17, tl_modbus_check_rtu(&REGISTERS, answer, 9));
}

/* ---- frames of a line by TCP: the example of the standard for function 3 ---- */

static const tl_modbus_read FRAMED = {.unit_id = 17, .table = TL_MODBUS_HOLDING, .address = 0x006B, .count = 3};
static const uint8_t FRAMED_ANSWER[] = {0x11, 3, 6, 0xAE, 0x41, 0x56, 0x52, 0x43, 0x40, 0x49, 0xAD};

static void test_a_framed_request(void) {
    static const uint8_t EXPECTED[] = {0x11, 3, 0, 0x6B, 0, 3, 0x76, 0x87};
    const tl_modbus_question asked = {.read = &FRAMED};
    uint8_t request[TL_MODBUS_TCP_REQUEST];
    tl_modbus_put_framed(&asked, request);
    TEST_ASSERT_EQUAL_HEX8_ARRAY(EXPECTED, request, sizeof EXPECTED);
}

static void test_a_framed_answer_as_it_grows(void) {
    const tl_modbus_question asked = {.read = &FRAMED};
    for (size_t size = 0; size <= sizeof FRAMED_ANSWER; size++) {
        size_t missing = 99;
        expect(TL_MODBUS_VALUES, size < 5 ? 0 : 9, size < 5 ? 0 : 9,
               tl_modbus_check_framed(&asked, FRAMED_ANSWER, size, &missing));
        TEST_ASSERT_EQUAL_size_t((size < 5 ? 5 : sizeof FRAMED_ANSWER) - size, missing);
    }
}

static void test_a_framed_answer_with_one_wrong_bit(void) {
    for (size_t bit = 0; bit < 8 * sizeof FRAMED_ANSWER; bit++) {
        const tl_modbus_question asked = {.read = &FRAMED, .any_unit_id = bit < 8};
        uint8_t answer[sizeof FRAMED_ANSWER];
        size_t missing = 99;
        memcpy(answer, FRAMED_ANSWER, sizeof answer);
        answer[bit / 8] = (uint8_t)(answer[bit / 8] ^ 1U << bit % 8);
        tl_modbus_outcome outcome = tl_modbus_check_framed(&asked, answer, sizeof answer, &missing);
        TEST_ASSERT_TRUE(outcome.kind > TL_MODBUS_EXCEPTION);
        TEST_ASSERT_EQUAL_size_t(0, missing);
        if (bit / 8 != 1 && bit / 8 != 2) {
            expect(TL_MODBUS_FAILED, EMBBADCRC, 0, outcome);
        }
    }
}

static void test_framed_answers_that_differ(void) {
    tl_modbus_question asked = {.read = &FRAMED};
    uint8_t answer[] = {0x12, 0x83, 2, 0, 0};
    size_t missing = 99;
    expect(TL_MODBUS_WRONG_UNIT, 0x12, 0x11, tl_modbus_check_framed(&asked, answer, sizeof answer, &missing));
    answer[0] = 0x11;
    expect(TL_MODBUS_FAILED, EMBBADCRC, 0, tl_modbus_check_framed(&asked, answer, sizeof answer, &missing));
    answer[3] = 0xC1; /* by pymodbus */
    answer[4] = 0x34;
    expect(TL_MODBUS_EXCEPTION, 2, 0, tl_modbus_check_framed(&asked, answer, sizeof answer, &missing));
    TEST_ASSERT_EQUAL_size_t(0, missing);
    answer[1] = 0x84;
    expect(TL_MODBUS_WRONG_FUNCTION, 0x84, 3, tl_modbus_check_framed(&asked, answer, sizeof answer, &missing));
    answer[1] = 3;
    expect(TL_MODBUS_WRONG_BYTES, 2, 6, tl_modbus_check_framed(&asked, answer, sizeof answer, &missing));
}

/* ---- text ---- */

static const char *text_of(tl_modbus_kind kind, int found, bool on_a_line) {
    static char text[160];
    const tl_modbus_outcome outcome = {.kind = kind, .found = found, .wanted = 1};
    tl_modbus_outcome_text(&outcome, on_a_line, TL_SECOND / 2, text, sizeof text);
    TEST_ASSERT_TRUE(strlen(text) < sizeof text - 1);
    return text;
}

static void test_texts_of_failures(void) {
    TL_EXPECT_PARTS("0.5 s", text_of(TL_MODBUS_FAILED, ETIMEDOUT, false));
    TL_EXPECT_PARTS("answer", text_of(TL_MODBUS_FAILED, EPROTO, false));
    TEST_ASSERT_FALSE(tl_test_has_parts(text_of(TL_MODBUS_FAILED, EPROTO, false), "0.5 s"));
    TL_EXPECT_PARTS("without an answer|Connection reset|programs", text_of(TL_MODBUS_FAILED, ECONNRESET, false));
    TL_EXPECT_PARTS("line|master", text_of(TL_MODBUS_FAILED, EBUSY, true));
    TL_EXPECT_PARTS("CRC|baud", text_of(TL_MODBUS_FAILED, EMBBADCRC, true));
    TL_EXPECT_PARTS("CRC|gateway|framing", text_of(TL_MODBUS_FAILED, EMBBADCRC, false));
}

/* The remedy names a gateway for TCP, and another master for a line. */
static void test_the_remedy_depends_on_the_link(void) {
    TL_EXPECT_PARTS("7|1|\"any_unit_id\": true", text_of(TL_MODBUS_WRONG_UNIT, 7, false));
    TL_EXPECT_PARTS("7|1|master", text_of(TL_MODBUS_WRONG_UNIT, 7, true));
    TEST_ASSERT_FALSE(tl_test_has_parts(text_of(TL_MODBUS_WRONG_UNIT, 7, true), "any_unit_id"));
    for (int kind = TL_MODBUS_WRONG_FUNCTION; kind <= TL_MODBUS_WRONG_BYTES; kind++) {
        TL_EXPECT_PARTS("7|1|gateway", text_of((tl_modbus_kind)kind, 7, false));
        TL_EXPECT_PARTS("7|1", text_of((tl_modbus_kind)kind, 7, true));
        TEST_ASSERT_FALSE(tl_test_has_parts(text_of((tl_modbus_kind)kind, 7, true), "gateway"));
    }
}

static bool is_same(tl_modbus_kind a, int found_a, tl_modbus_kind b, int found_b) {
    const tl_modbus_outcome first = {.kind = a, .found = found_a};
    const tl_modbus_outcome second = {.kind = b, .found = found_b};
    return tl_modbus_outcome_is_same(&first, &second) && tl_modbus_outcome_is_same(&second, &first);
}

static void test_outcomes_that_are_not_reported_again(void) {
    TEST_ASSERT_TRUE(is_same(TL_MODBUS_VALUES, 4, TL_MODBUS_VALUES, 0));
    TEST_ASSERT_TRUE(is_same(TL_MODBUS_WRONG_UNIT, 7, TL_MODBUS_WRONG_UNIT, 8));
    TEST_ASSERT_TRUE(is_same(TL_MODBUS_WRONG_UNIT, 7, TL_MODBUS_WRONG_BYTES, 250));
    TEST_ASSERT_TRUE(is_same(TL_MODBUS_EXCEPTION, 2, TL_MODBUS_EXCEPTION, 4));
    TEST_ASSERT_FALSE(is_same(TL_MODBUS_FAILED, ETIMEDOUT, TL_MODBUS_FAILED, ECONNRESET));
    TEST_ASSERT_FALSE(is_same(TL_MODBUS_FAILED, 0, TL_MODBUS_WRONG_UNIT, 0));
    TEST_ASSERT_FALSE(is_same(TL_MODBUS_VALUES, 0, TL_MODBUS_EXCEPTION, 0));
    TEST_ASSERT_FALSE(is_same(TL_MODBUS_EXCEPTION, 2, TL_MODBUS_WRONG_LENGTH, 2));
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_a_request);
    RUN_TEST(test_an_answer_as_it_grows);
    RUN_TEST(test_bits);
    RUN_TEST(test_each_byte_of_the_head);
    RUN_TEST(test_found_and_wanted_values);
    RUN_TEST(test_an_answer_on_a_line);
    RUN_TEST(test_a_framed_request);
    RUN_TEST(test_a_framed_answer_as_it_grows);
    RUN_TEST(test_a_framed_answer_with_one_wrong_bit);
    RUN_TEST(test_framed_answers_that_differ);
    RUN_TEST(test_texts_of_failures);
    RUN_TEST(test_the_remedy_depends_on_the_link);
    RUN_TEST(test_outcomes_that_are_not_reported_again);
    return UNITY_END();
}
