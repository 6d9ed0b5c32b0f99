/* Names in shared libraries. Linkers let names share bytes. */
#include <elf.h>
#include <link.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <unity.h>

#include "firmware/fmu/own_copies.h"
#include "tests/support/elf_maker.h"

#define UNIQUE ELF64_ST_INFO(STB_GNU_UNIQUE, STT_OBJECT)
#define GLOBAL ELF64_ST_INFO(STB_GLOBAL, STT_OBJECT)

static uint8_t bytes[TL_ELF_MADE];
static size_t size;
static tl_elf_file file;

void setUp(void) {}

void tearDown(void) {}

/* ---- Helpers ---- */

/* The word size of this machine. */
#define NATIVE .is_wide = sizeof(void *) == 8
#define STRINGS(text) .strings = (text), .strings_size = sizeof(text)

static void open_made(const tl_elf_plan *plan) {
    size = tl_elf_make(plan, bytes);
    TEST_ASSERT_TRUE(tl_elf_open(&file, bytes, size));
}

/* Appends a reference as "kind name ". */
static bool on_reference(void *context, tl_elf_reference reference) {
    char *all = context;
    static const char kinds[] = {
        [TL_ELF_NEEDED] = 'n', [TL_ELF_NAME] = 's', [TL_ELF_VERSION] = 'v', [TL_ELF_OTHER] = 'o'};
    const char *text = tl_elf_text(&file, reference.offset);
    size_t used = strlen(all);
    (void)snprintf(all + used, 512 - used, "%c %s ", kinds[reference.kind], text == NULL ? "?" : text);
    return true;
}

static void expect_references(const char *expected) {
    char all[512] = "";
    tl_elf_visit(&file, on_reference, all);
    TEST_ASSERT_EQUAL_STRING(expected, all);
}

static tl_elf_outcome rename_one(const char *from, const char *to) {
    tl_elf_rename rename = {"", ""};
    (void)snprintf(rename.old_name, sizeof rename.old_name, "%s", from);
    (void)snprintf(rename.new_name, sizeof rename.new_name, "%s", to);
    return tl_elf_rename_libraries(&file, &rename, 1);
}

/* ---- Reading and renaming ---- */

static void expect_all_of_it(tl_elf_plan plan) {
    plan.strings = "\0libtable.so\0libmain.so\0libc.so.6\0GLIBC_2.4\0$ORIGIN\0sin\0table_read\0TABLE_1";
    plan.strings_size = sizeof "\0libtable.so\0libmain.so\0libc.so.6\0GLIBC_2.4\0$ORIGIN\0sin\0table_read\0TABLE_1";
    plan.name = "libmain.so";
    plan.needed[0] = "libtable.so";
    plan.needed[1] = "libc.so.6";
    plan.path = "$ORIGIN";
    plan.version_of = "libtable.so";
    plan.version = "TABLE_1";
    plan.defined_base = "libmain.so";
    plan.defined = "GLIBC_2.4";
    plan.symbols[0] = (tl_elf_made_symbol){"sin", GLOBAL, false};
    plan.symbols[1] = (tl_elf_made_symbol){"table_read", GLOBAL, true};
    open_made(&plan);
    TEST_ASSERT_EQUAL_size_t(3, file.symbol_count);
    TEST_ASSERT_EQUAL_INT(plan.is_wide ? EM_AARCH64 : EM_ARM, file.machine);
    /* The null symbol has an empty name. */
    expect_references(
        "s libmain.so n libtable.so n libc.so.6 o $ORIGIN v libtable.so o TABLE_1 v libmain.so o GLIBC_2.4 "
        "o  o sin o table_read ");
    tl_elf_rename both[] = {{"libtable.so", "001table.so"}, {"libmain.so", "002main.so"}};
    TEST_ASSERT_EQUAL_INT(TL_ELF_DONE, tl_elf_rename_libraries(&file, both, 2));
    expect_references(
        "s 002main.so n 001table.so n libc.so.6 o $ORIGIN v 001table.so o TABLE_1 v 002main.so o GLIBC_2.4 "
        "o  o sin o table_read ");
}

static void test_what_is_read_and_renamed(void) {
    expect_all_of_it((tl_elf_plan){NATIVE});
    expect_all_of_it((tl_elf_plan){NATIVE, .has_old_hashes = true});
}

static void test_without_hashes_symbols_end_where_names_begin(void) {
    expect_all_of_it((tl_elf_plan){NATIVE, .has_no_hashes = true});
}

static void test_a_library_that_is_not_meant_stays(void) {
    uint8_t before[TL_ELF_MADE];
    tl_elf_plan plan = {NATIVE, STRINGS("\0libtable.so"), .needed = {"libtable.so"}};
    open_made(&plan);
    memcpy(before, bytes, sizeof before);
    TEST_ASSERT_EQUAL_INT(TL_ELF_DONE, rename_one("libother.so", "001other.so"));
    TEST_ASSERT_EQUAL_INT(TL_ELF_DONE, tl_elf_rename_libraries(&file, NULL, 0));
    TEST_ASSERT_EQUAL_MEMORY(before, bytes, sizeof before);
}

/* ---- Names that share bytes ---- */

static void test_a_name_that_is_the_end_of_another_one(void) {
    tl_elf_plan plan = {NATIVE, STRINGS("\0mylibtable.so"), .needed = {"libtable.so", "mylibtable.so"}};
    open_made(&plan);
    TEST_ASSERT_EQUAL_INT(TL_ELF_CONFLICT, rename_one("libtable.so", "001table.so"));
    open_made(&plan);
    TEST_ASSERT_EQUAL_INT(TL_ELF_CONFLICT, rename_one("mylibtable.so", "001ibtable.so"));
}

static void test_an_end_behind_what_is_changed_is_no_conflict(void) {
    tl_elf_plan plan = {NATIVE, .has_no_hashes = true, STRINGS("\0our_libtable.so"),
                        .needed = {"our_libtable.so", "libtable.so"}};
    open_made(&plan);
    TEST_ASSERT_EQUAL_INT(TL_ELF_DONE, rename_one("our_libtable.so", "001_libtable.so"));
    expect_references("n 001_libtable.so n libtable.so o  ");
}

static void test_two_that_share_bytes_and_are_both_renamed(void) {
    tl_elf_plan plan = {NATIVE, STRINGS("\0our_libtable.so"), .needed = {"libtable.so", "our_libtable.so"}};
    tl_elf_rename apart[] = {{"our_libtable.so", "001_libtable.so"}, {"libtable.so", "002table.so"}};
    open_made(&plan);
    TEST_ASSERT_EQUAL_INT(TL_ELF_CONFLICT, tl_elf_rename_libraries(&file, apart, 2));
}

/* With --default-symver, linkers name the version of all symbols after the library. */
static void test_a_version_or_a_symbol_of_that_name(void) {
    tl_elf_plan version = {NATIVE, STRINGS("\0libtable.so"), .name = "libtable.so", .defined_base = "libtable.so",
                           .defined = "libtable.so"};
    open_made(&version);
    TEST_ASSERT_EQUAL_INT(TL_ELF_CONFLICT, rename_one("libtable.so", "001table.so"));
    tl_elf_plan symbol = {NATIVE, STRINGS("\0libtable.so"), .name = "libtable.so",
                          .symbols = {{"libtable.so", GLOBAL, true}}};
    open_made(&symbol);
    TEST_ASSERT_EQUAL_INT(TL_ELF_CONFLICT, rename_one("libtable.so", "001table.so"));
}

/* ---- Symbols ---- */

static uint8_t info_of(size_t index) {
    return *tl_elf_symbol_at(&file, index).info;
}

static void test_unique_symbols_become_ordinary_ones(void) {
    tl_elf_plan plan = {
        NATIVE, STRINGS("\0_ZN7counter5countE\0_ZZN1a1fEvE1b\0plain"),
        .symbols = {{"_ZN7counter5countE", UNIQUE, true}, {"_ZZN1a1fEvE1b", UNIQUE, true}, {"plain", GLOBAL, true}}};
    open_made(&plan);
    TEST_ASSERT_EQUAL_size_t(2, tl_elf_unshare_symbols(&file));
    TEST_ASSERT_EQUAL_HEX8(GLOBAL, info_of(1));
    TEST_ASSERT_EQUAL_HEX8(GLOBAL, info_of(2));
    TEST_ASSERT_EQUAL_HEX8(GLOBAL, info_of(3));
    TEST_ASSERT_EQUAL_size_t(0, tl_elf_unshare_symbols(&file));
}

static void test_those_of_the_languages_library_stay(void) {
    static const char names[] = "\0_ZNSs4_Rep20_S_empty_rep_storageE\0_ZGVNSt7collateIcE2idE\0"
                                "_ZZNSt19_Sp_make_shared_tag5_S_tiEvE5__tag\0_ZN9__gnu_cxx3poolE";
    tl_elf_plan plan = {NATIVE, .strings = names, .strings_size = sizeof names,
                        .symbols = {{"_ZNSs4_Rep20_S_empty_rep_storageE", UNIQUE, true},
                                    {"_ZGVNSt7collateIcE2idE", UNIQUE, true},
                                    {"_ZZNSt19_Sp_make_shared_tag5_S_tiEvE5__tag", UNIQUE, true},
                                    {"_ZN9__gnu_cxx3poolE", UNIQUE, true}}};
    open_made(&plan);
    TEST_ASSERT_EQUAL_size_t(0, tl_elf_unshare_symbols(&file));
}

static void test_who_opens_libraries(void) {
    tl_elf_plan opens = {NATIVE, STRINGS("\0dlopen"), .symbols = {{"dlopen", GLOBAL, false}}};
    open_made(&opens);
    TEST_ASSERT_TRUE(tl_elf_opens_libraries(&file));
    opens.symbols[0].is_defined = true; /* its own dlopen() */
    open_made(&opens);
    TEST_ASSERT_FALSE(tl_elf_opens_libraries(&file));
}

/* ---- Real libraries ---- */

static void test_real_libraries(void) {
    /* FMUs for several machines are in one folder each. */
    static const char *const paths[] = {".", "linux64", "aarch64-linux", "aarch32-linux"};
    static uint8_t real[1 << 20];
    size_t seen = 0;
    for (size_t i = 0; i < sizeof paths / sizeof paths[0]; i++) {
        char path[512];
        (void)snprintf(path, sizeof path, "%s/fmus/%s/lag.so", TL_BINARY_DIR, paths[i]);
        FILE *stream = fopen(path, "rbe");
        if (stream == NULL) {
            continue; /* no compiler for that machine */
        }
        size_t length = fread(real, 1, sizeof real, stream);
        (void)fclose(stream);
        if (!tl_elf_open(&file, real, length)) {
            continue; /* for another word size */
        }
        TEST_ASSERT_GREATER_THAN_size_t(20, file.symbol_count); /* the functions of FMI */
        TEST_ASSERT_EQUAL_INT(TL_ELF_DONE, rename_one("libc.so.6", "001c.so.6"));
        TEST_ASSERT_NULL_MESSAGE(memmem(real, length, "libc.so.6", 10), path);
        TEST_ASSERT_NOT_NULL_MESSAGE(memmem(real, length, "001c.so.6", 10), path);
        seen++;
    }
    TEST_ASSERT_GREATER_THAN_size_t(0, seen);
}

/* ---- Hostile libraries ---- */

/* Any bytes: no access outside the file (a sanitizer checks that), and no endless loop. */
static void try_everything(size_t length) {
    uint8_t *copy = malloc(length == 0 ? 1 : length);
    char all[512] = "";
    TEST_ASSERT_NOT_NULL(copy);
    memcpy(copy, bytes, length);
    if (tl_elf_open(&file, copy, length)) {
        tl_elf_visit(&file, on_reference, all);
        (void)rename_one("libtable.so", "001table.so");
        (void)tl_elf_unshare_symbols(&file);
        (void)tl_elf_opens_libraries(&file);
    }
    free(copy);
}

static void test_damaged_files(void) {
    static const uint8_t values[] = {0, 1, 0x7F, 0x80, 0xFF};
    for (unsigned kind = 0; kind < 2; kind++) {
        tl_elf_plan plan = {NATIVE,
                            .has_old_hashes = kind == 1,
                            STRINGS("\0libtable.so\0libmain.so\0V1"),
                            .name = "libmain.so",
                            .needed = {"libtable.so"},
                            .version_of = "libtable.so",
                            .version = "V1",
                            .defined_base = "libmain.so",
                            .defined = "V1",
                            .symbols = {{"V1", UNIQUE, true}}};
        size = tl_elf_make(&plan, bytes);
        for (size_t length = 0; length < size; length++) {
            try_everything(length);
        }
        for (size_t at = 0; at < size; at++) {
            uint8_t was = bytes[at];
            for (size_t i = 0; i < sizeof values; i++) {
                bytes[at] = values[i];
                try_everything(size);
            }
            bytes[at] = was;
        }
    }
}

static void test_what_is_no_library(void) {
    tl_elf_plan plan = {NATIVE, STRINGS("\0libtable.so")};
    size = tl_elf_make(&plan, bytes);
    bytes[offsetof(ElfW(Ehdr), e_type)] = ET_EXEC;
    TEST_ASSERT_FALSE(tl_elf_open(&file, bytes, size));
    tl_elf_plan other = plan;
    other.is_wide = !other.is_wide;
    size = tl_elf_make(&other, bytes);
    TEST_ASSERT_FALSE(tl_elf_open(&file, bytes, size));
    other = plan;
    other.is_big = __BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__;
    size = tl_elf_make(&other, bytes);
    TEST_ASSERT_FALSE(tl_elf_open(&file, bytes, size));
    size = tl_elf_make(&plan, bytes);
    bytes[offsetof(ElfW(Ehdr), e_phnum)] = TL_ELF_SEGMENTS + 1;
    TEST_ASSERT_FALSE(tl_elf_open(&file, bytes, size));
    TEST_ASSERT_FALSE(tl_elf_open(&file, bytes, 8));
}

/* Reading a name of megabytes for each of many symbols would take hours. */
static void test_names_that_are_read_too_often(void) {
    enum { HALF = 2 << 20, COUNT = 60000 };
    tl_elf_plan plan = {NATIVE, STRINGS("\0"), .has_old_hashes = true};
    size = tl_elf_make(&plan, bytes);
    uint8_t *large = calloc(2, HALF);
    TEST_ASSERT_NOT_NULL(large);
    memcpy(large, bytes, size);
    TEST_ASSERT_TRUE(tl_elf_open(&file, large, size));
    size_t symbols = file.symbols;
    ElfW(Phdr) *load = (ElfW(Phdr) *)(void *)(large + sizeof(ElfW(Ehdr)));
    load->p_filesz = 2 * HALF;
    for (ElfW(Dyn) *entry = (ElfW(Dyn) *)(void *)(large + file.dynamic.offset); entry->d_tag != DT_NULL; entry++) {
        uint32_t count = COUNT;
        switch (entry->d_tag) {
        case DT_STRTAB:
            entry->d_un.d_ptr = load->p_vaddr + HALF;
            break;
        case DT_STRSZ:
            entry->d_un.d_val = HALF;
            break;
        case DT_HASH:
            memcpy(large + (entry->d_un.d_ptr - load->p_vaddr) + sizeof count, &count, sizeof count);
            break;
        default:
            break;
        }
    }
    memset(large + HALF, 'x', HALF);
    TEST_ASSERT_FALSE(tl_elf_open(&file, large, (size_t)2 * HALF));
    memset(large + symbols, 0xFF, (size_t)COUNT * sizeof(ElfW(Sym))); /* names outside of the table are not read */
    TEST_ASSERT_TRUE(tl_elf_open(&file, large, (size_t)2 * HALF));
    TEST_ASSERT_EQUAL_size_t(COUNT, file.symbol_count);
    free(large);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_what_is_read_and_renamed);
    RUN_TEST(test_without_hashes_symbols_end_where_names_begin);
    RUN_TEST(test_a_library_that_is_not_meant_stays);
    RUN_TEST(test_a_name_that_is_the_end_of_another_one);
    RUN_TEST(test_an_end_behind_what_is_changed_is_no_conflict);
    RUN_TEST(test_two_that_share_bytes_and_are_both_renamed);
    RUN_TEST(test_a_version_or_a_symbol_of_that_name);
    RUN_TEST(test_unique_symbols_become_ordinary_ones);
    RUN_TEST(test_those_of_the_languages_library_stay);
    RUN_TEST(test_who_opens_libraries);
    RUN_TEST(test_real_libraries);
    RUN_TEST(test_damaged_files);
    RUN_TEST(test_what_is_no_library);
    RUN_TEST(test_names_that_are_read_too_often);
    return UNITY_END();
}
