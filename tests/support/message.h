/* Messages of the program, compared by the values that they name.
 *
 * A test expects only the object, the values and at most three words in a row, so that the wording
 * can be improved.
 * Thread: any.
 */
#ifndef TL_TESTS_SUPPORT_MESSAGE_H
#define TL_TESTS_SUPPORT_MESSAGE_H

#include <stdbool.h>

#include <unity.h>

/* Returns true if the message contains all parts, which '|' separates: "plant.level|18.55|0|5". A
 * part matches whole words and whole numbers only: "5" is not in "18.55". An empty list matches no
 * message. */
bool tl_test_has_parts(const char *message, const char *parts);

/* True if one line of the text has all parts. */
bool tl_test_has_line(const char *text, const char *parts);

/* The test fails unless the message has all parts; prints both. */
#define TL_EXPECT_PARTS(parts, message) tl_test_expect_parts(parts, message, __LINE__)
void tl_test_expect_parts(const char *parts, const char *message, int line);

/* The text must have a time of `whole`.0 to `whole`.9 s. */
void tl_test_expect_seconds(int whole, const char *text);

#endif
