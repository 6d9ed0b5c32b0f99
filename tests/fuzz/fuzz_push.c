/* What a box answers that has been broken into: nothing of it commands a terminal, whole or in pieces.
 *
 * Input:  how many bytes come at once; then the answer. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "firmware/push/push_lines.h"
#include "tests/fuzz/harness.h"
#include "tests/fuzz/input.h"

/* What is told of it; the caller's to free. */
static char *tell(const uint8_t *data, size_t size, size_t piece, size_t *told_size) {
    static tl_push_lines lines;
    char *told = NULL;
    FILE *file = open_memstream(&told, told_size);
    tl_fuzz_hold(file != NULL);
    tl_push_lines_begin(&lines, file, false, "motor.json");
    for (size_t i = 0; i < size; i += piece) {
        tl_push_lines_take(&lines, (const char *)data + i, size - i < piece ? size - i : piece);
    }
    (void)fclose(file);
    return told;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    size_t one_size = 0;
    size_t other_size = 0;
    if (size < 2) {
        return 0;
    }
    char *one = tell(data + 1, size - 1, 1U + data[0], &one_size);
    char *other = tell(data + 1, size - 1, size, &other_size);
    tl_fuzz_hold(one_size == other_size && memcmp(one, other, one_size) == 0);
    for (size_t i = 0; i < one_size; i++) {
        unsigned char byte = (unsigned char)one[i];
        tl_fuzz_hold((byte >= ' ' && byte != 0x7F) || byte == '\n' || byte == '\t');
    }
    free(one);
    free(other);
    return 0;
}
