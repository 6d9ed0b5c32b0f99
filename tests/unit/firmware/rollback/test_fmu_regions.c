/* A library belongs to the FMU that alone uses it; libstdc++ stays with the one whose states
 * contain it. */
#include "firmware/rollback/fmu_regions.h"

#include <dlfcn.h>

#include <unity.h>

#include "firmware/process/sanitizer.h"

static const char first[] = "/nowhere/first";
static const char second[] = "/nowhere/second";
static tl_fmu_regions regions;

void setUp(void) {}

void tearDown(void) {}

static void *open_library(const char *name) {
    void *library = dlopen(name, RTLD_NOW | RTLD_LOCAL);
    if (library == NULL) {
        TEST_IGNORE_MESSAGE("this machine has no such library");
    }
    return library;
}

static size_t bytes_of(const char *folder) {
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_fmu_regions_find(folder, &regions, NULL));
    return regions.bytes;
}

static void test_a_library_of_two_fmus_is_of_none(void) {
    void *library = open_library("libresolv.so.2");
    unsigned long long before = tl_fmu_regions_changed();
    tl_fmu_regions_claim(first, library, tl_fmu_regions_loaded());
    TEST_ASSERT_GREATER_THAN_size_t(0, bytes_of(first));
    tl_fmu_regions_claim(second, library, tl_fmu_regions_loaded());
    TEST_ASSERT_TRUE(tl_fmu_regions_changed() > before);
    TEST_ASSERT_EQUAL_size_t(0, bytes_of(first));
    TEST_ASSERT_EQUAL_size_t(0, bytes_of(second));
}

static void test_libstdcpp_stays_with_the_fmu_whose_states_contain_it(void) {
    if (TL_HAS_SANITIZER) {
        TEST_IGNORE_MESSAGE("the sanitizer has loaded this library, so it belongs to the program");
    }
    void *library = open_library("libstdc++.so.6");
    tl_fmu_regions_claim(first, library, tl_fmu_regions_loaded());
    size_t bytes = bytes_of(first);
    TEST_ASSERT_GREATER_THAN_size_t(0, bytes);
    unsigned long long before = tl_fmu_regions_changed();
    tl_fmu_regions_claim(second, library, tl_fmu_regions_loaded());
    TEST_ASSERT_TRUE(tl_fmu_regions_changed() == before);
    TEST_ASSERT_EQUAL_size_t(bytes, bytes_of(first));
    TEST_ASSERT_EQUAL_size_t(0, bytes_of(second));
}

int main(void) {
    tl_fmu_regions_exclude(); /* what the program itself has loaded */
    UNITY_BEGIN();
    RUN_TEST(test_a_library_of_two_fmus_is_of_none);
    RUN_TEST(test_libstdcpp_stays_with_the_fmu_whose_states_contain_it);
    return UNITY_END();
}
