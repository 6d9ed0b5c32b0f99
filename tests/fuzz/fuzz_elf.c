/* Fuzzes the renaming in a library of an FMU: only bytes of names may change, and no byte outside
 * of the library is accessed. */
#include <stdlib.h>
#include <string.h>

#include "firmware/fmu/own_copies.h"
#include "tests/fuzz/harness.h"
#include "tests/fuzz/input.h"

static bool read_name(void *context, tl_elf_reference reference) {
    const tl_elf_file *file = context;
    const char *text = tl_elf_text(file, reference.offset);
    tl_fuzz_hold(reference.offset < file->strings_size);
    tl_fuzz_hold(text == NULL || strlen(text) < file->strings_size);
    return true;
}

static void expect_only_names(const uint8_t *before, const tl_elf_file *file) {
    size_t end = file->strings + file->strings_size;
    tl_fuzz_hold(end <= file->size);
    tl_fuzz_hold(memcmp(before, file->bytes, file->strings) == 0);
    tl_fuzz_hold(memcmp(before + end, file->bytes + end, file->size - end) == 0);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    static const tl_elf_rename renames[] = {{"libtable.so", "001table.so"}, {"libmain.so", "002main.so"}};
    tl_elf_file file;
    uint8_t *bytes = malloc(size == 0 ? 1 : size); /* so that a sanitizer sees its end */
    if (bytes == NULL) {
        return 0;
    }
    if (size > 0) {
        memcpy(bytes, data, size);
    }
    if (tl_elf_open(&file, bytes, size)) {
        tl_elf_visit(&file, read_name, &file);
        (void)tl_elf_rename_libraries(&file, renames, sizeof renames / sizeof renames[0]);
        expect_only_names(data, &file);
        (void)tl_elf_unshare_symbols(&file);
        (void)tl_elf_opens_libraries(&file);
    }
    free(bytes);
    return 0;
}
