/* The available solvers: their names, and their numbers in the thesis. */
#include <stdio.h>
#include <string.h>
#include <unity.h>

#include "master/solve/optimiser.h"

static const tl_optimiser_class *const classes[] = {&tl_secant, &tl_nelder_mead, &tl_bobyqa,
                                                    &tl_lbfgs,  &tl_sbplx,       &tl_boolean};
enum { CLASSES = sizeof classes / sizeof classes[0] };

void setUp(void) {}

void tearDown(void) {}

static void solvers_are_found_by_name(void) {
    const char *const names[CLASSES] = {"secant", "nelder-mead", "bobyqa", "l-bfgs", "sbplx", "boolean"};
    for (size_t i = 0; i < CLASSES; i++) {
        TEST_ASSERT_EQUAL_PTR(classes[i], tl_optimiser_find(names[i]));
        TEST_ASSERT_EQUAL_STRING(names[i], classes[i]->name);
    }
}

static void other_names_are_nobodys(void) {
    const char *const names[] = {"", "Nelder-Mead", "nelder_mead", "nelder-mead ", "lbfgs", "1"};
    for (size_t i = 0; i < sizeof names / sizeof names[0]; i++) {
        TEST_ASSERT_NULL_MESSAGE(tl_optimiser_find(names[i]), names[i]);
    }
}

static void solvers_are_found_by_the_thesiss_number(void) {
    TEST_ASSERT_EQUAL_PTR(&tl_nelder_mead, tl_optimiser_numbered(1));
    TEST_ASSERT_EQUAL_PTR(&tl_lbfgs, tl_optimiser_numbered(100));
    TEST_ASSERT_EQUAL_PTR(&tl_bobyqa, tl_optimiser_numbered(1000));
}

/* The number 0 means that a solver has none in the thesis. */
static void other_numbers_are_nobodys(void) {
    const int numbers[] = {0, -1, 2, 10, 101, 10000};
    for (size_t i = 0; i < sizeof numbers / sizeof numbers[0]; i++) {
        TEST_ASSERT_NULL(tl_optimiser_numbered(numbers[i]));
    }
}

static void messages_name_them_all_in_order(void) {
    char expected[200] = "";
    for (size_t i = 0; i < CLASSES; i++) {
        size_t used = strlen(expected);
        (void)snprintf(expected + used, sizeof expected - used, "%s\"%s\"", i == 0 ? "" : ", ", classes[i]->name);
    }
    TEST_ASSERT_EQUAL_STRING(expected, tl_optimiser_names());
}

static void one_solver_takes_booleans(void) {
    for (size_t i = 0; i < CLASSES; i++) {
        TEST_ASSERT_TRUE(classes[i]->booleans == (classes[i] == &tl_boolean));
        TEST_ASSERT_NOT_NULL(classes[i]->create);
        TEST_ASSERT_NOT_NULL(classes[i]->minimise);
        TEST_ASSERT_NOT_NULL(classes[i]->destroy);
    }
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(solvers_are_found_by_name);
    RUN_TEST(other_names_are_nobodys);
    RUN_TEST(solvers_are_found_by_the_thesiss_number);
    RUN_TEST(other_numbers_are_nobodys);
    RUN_TEST(messages_name_them_all_in_order);
    RUN_TEST(one_solver_takes_booleans);
    return UNITY_END();
}
