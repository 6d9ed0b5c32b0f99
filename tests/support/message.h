/* Messages of the program, compared by the values that they name.
 *
 * A test holds the object, the values and at most three words in a row, so that the wording can be improved.
 * Thread: any.
 */
#ifndef TL_TESTS_SUPPORT_MESSAGE_H
#define TL_TESTS_SUPPORT_MESSAGE_H

#include <stdbool.h>

#include <unity.h>

/* True if the message contains each of the parts, which '|' separates: "plant.level|18.55|0|5".
 * A part matches whole words and whole numbers only: "5" is not in "18.55". An empty list is in each message that is not empty. */
bool tl_test_has_parts(const char *message, const char *parts);

/* The test fails, and prints the message, unless it has all parts. */
#define TL_EXPECT_PARTS(parts, message) TEST_ASSERT_TRUE_MESSAGE(tl_test_has_parts(message, parts), message)

#endif
