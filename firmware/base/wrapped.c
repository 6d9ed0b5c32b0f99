/* Paragraphs for a terminal: see wrapped.h. */
#include "firmware/base/wrapped.h"

#include <string.h>

enum { WIDTH = 79 };

/* Characters, not bytes. */
static int columns_of(const char *word, size_t length) {
    int columns = 0;
    for (size_t i = 0; i < length; i++) {
        columns += ((unsigned char)word[i] & 0xC0U) != 0x80U ? 1 : 0;
    }
    return columns;
}

void tl_wrapped_print(FILE *file, const char *text, int first, int indent) {
    int column = first;
    (void)fprintf(file, "%*s", first, "");
    for (const char *word = text; *word != '\0';) {
        size_t length = strcspn(word, " ");
        int columns = columns_of(word, length);
        if (word != text && column + 1 + columns > WIDTH) {
            (void)fprintf(file, "\n%*s", indent, "");
            column = indent;
        } else if (word != text) {
            (void)fputc(' ', file);
            column++;
        }
        (void)fprintf(file, "%.*s", (int)length, word);
        column += columns;
        word += length + (word[length] == ' ' ? 1 : 0);
    }
    (void)fputc('\n', file);
}
