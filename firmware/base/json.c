/* JSON texts: validation, reading of flat objects, writing: see json.h. */
#include "firmware/base/json.h"

#include <assert.h>
#include <cjson/cJSON.h>
#include <fcntl.h>
#include <limits.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "firmware/base/os.h"
#include "firmware/base/text.h"
#include "master/base/text.h"

/* ---- Scanner for RFC 8259, with a stack of open brackets instead of recursion. */

enum { END = -1 }; /* result of peek() at the end of the text */

typedef struct scanner {
    const char *text;
    size_t size;
    size_t at;
    uint32_t line; /* of `at`, from 1; only white space contains line breaks */
    size_t depth;
    char open[TL_JSON_MAX_DEPTH]; /* '{' or '[' of each level */
    tl_json_lines *lines;
    tl_error *error;
} scanner;

/* ---- characters ---- */

bool tl_text_is_plain(const char *text) {
    bool is_control = false;
    while (*text != '\0' && !is_control) {
        text += tl_show_character(text, &is_control);
    }
    return !is_control;
}

void tl_text_for_people(const char *text, char *copy, size_t size) {
    static const char cut[] = "…";
    enum { SHOWN = 16 }; /* most bytes that replace one character */
    size_t used = 0;
    size_t cut_at = 0; /* last end of a character that leaves room for "…" */
    while (*text != '\0') {
        char shown[SHOWN];
        bool is_control = false;
        size_t length = tl_show_character(text, &is_control);
        size_t added = *text == '\t' ? (size_t)snprintf(shown, sizeof shown, "\\t")
                                     : tl_clean_text(text, length, shown, sizeof shown);
        if (used + added >= size) {
            memcpy(copy + cut_at, cut, sizeof cut);
            return;
        }
        memcpy(copy + used, shown, added);
        used += added;
        cut_at = used + sizeof cut <= size ? used : cut_at;
        text += length;
    }
    copy[used] = '\0';
}

static bool is_digit(int character) {
    return character >= '0' && character <= '9';
}

/* Characters of numbers and words. */
static bool is_word(int character) {
    return is_digit(character) || (character >= 'a' && character <= 'z') || (character >= 'A' && character <= 'Z') ||
           character == '+' || character == '-' || character == '.' || character == '_';
}

static int peek(const scanner *s) {
    return s->at < s->size ? (unsigned char)s->text[s->at] : END;
}

static bool accept(scanner *s, int character) {
    bool found = peek(s) == character;
    s->at += found ? 1 : 0;
    return found;
}

static void skip_space(scanner *s) {
    for (;; s->at++) {
        int character = peek(s);
        if (character == '\n') {
            s->line++;
        } else if (character != ' ' && character != '\t' && character != '\r') {
            return;
        }
    }
}

/* Returns the length of the number or word that begins at `from`. */
static size_t word_length(const scanner *s, size_t from) {
    size_t end = from;
    while (end < s->size && is_word((unsigned char)s->text[end])) {
        end++;
    }
    return end - from;
}

/* ---- errors ---- */

/* Describes the character or word at an offset. */
static void describe_word(const scanner *s, size_t at, char *found, size_t size) {
    size_t word = word_length(s, at);
    unsigned byte = at < s->size ? (unsigned char)s->text[at] : 0;
    if (at == s->size) {
        (void)snprintf(found, size, "the end of the file");
    } else if (word > 0) {
        (void)snprintf(found, size, word > 24 ? "%.*s…" : "%.*s", word > 24 ? 24 : (int)word, s->text + at);
    } else if (byte == '\n' || byte == '\r') {
        (void)snprintf(found, size, "a line break");
    } else if (byte == '\t') {
        (void)snprintf(found, size, "a tab");
    } else if (byte < 0x20 || byte == 0x7F) {
        (void)snprintf(found, size, "the control character U+%04X", byte);
    } else {
        uint32_t code = 0;
        (void)tl_clean_text(s->text + at, tl_utf8_read(s->text + at, s->size - at, &code), found, size);
    }
}

/* Reports the error at an offset and returns false. */
static bool report_wrong(scanner *s, size_t at, const char *found, const char *expected) {
    size_t line = 1;
    size_t column = 1;
    for (size_t i = 0; i < at; i++) {
        if (s->text[i] == '\n') {
            line++;
            column = 1;
        } else if (((unsigned char)s->text[i] & 0xC0) != 0x80) {
            column++;
        }
    }
    (void)tl_fail(s->error, TL_BAD_DATA, "line %zu, column %zu: found %s, expected %s", line, column, found, expected);
    return false;
}

static bool report_unexpected(scanner *s, size_t at, const char *expected) {
    char found[64];
    char remedy[192];
    bool is_comment = at < s->size && (s->text[at] == '/' || s->text[at] == '#');
    describe_word(s, at, found, sizeof found);
    (void)snprintf(remedy, sizeof remedy, "%s%s", expected, is_comment ? "; JSON has no comments: remove it" : "");
    return report_wrong(s, at, found, remedy);
}

/* ---- values ---- */

/* Returns the value of four hexadecimal digits after \u; -1 if there are not four. */
static long hexadecimal(const scanner *s, size_t at) {
    char digits[5] = "";
    memcpy(digits, s->text + at, at < s->size ? (s->size - at < 4 ? s->size - at : 4) : 0);
    return strspn(digits, "0123456789abcdefABCDEF") == 4 ? strtol(digits, NULL, 16) : -1;
}

/* Scans \uXXXX, or a pair of them for a character above U+FFFF; `at` is at the u. */
static bool scan_unicode_escape(scanner *s) {
    size_t start = s->at - 1;
    long code = hexadecimal(s, s->at + 1);
    if (code < 0) {
        return report_wrong(s, start, "\\u without four hexadecimal digits", "four of them, for example \\u00e9");
    }
    if (code == 0) {
        return report_wrong(s, start, "\\u0000", "a text without NUL characters");
    }
    s->at += 5;
    if (code < 0xD800 || code > 0xDFFF) {
        return true;
    }
    bool pair = code < 0xDC00 && s->size - s->at >= 6 && memcmp(s->text + s->at, "\\u", 2) == 0;
    long low = pair ? hexadecimal(s, s->at + 2) : -1;
    if (low < 0xDC00 || low > 0xDFFF) {
        return report_wrong(s, start, "half of a surrogate pair", "both halves, for example \\ud83d\\ude00");
    }
    s->at += 6;
    return true;
}

/* Scans what follows a backslash. */
static bool scan_escape(scanner *s) {
    int character = peek(s);
    if (character == 'u') {
        return scan_unicode_escape(s);
    }
    if (character == END) {
        return report_unexpected(s, s->at, "the rest of an escape such as \\n");
    }
    if (character == 0 || strchr("\"\\/bfnrt", character) == NULL) {
        char found[64] = "\\";
        describe_word(s, s->at, found + 1, sizeof found - 1);
        return report_wrong(s, s->at - 1, found,
                            "one of \\\" \\\\ \\/ \\b \\f \\n \\r \\t \\u; write \\\\ for a backslash");
    }
    s->at++;
    return true;
}

static bool scan_string(scanner *s) {
    s->at++;
    for (;;) {
        int character = peek(s);
        if (character == END) {
            return report_unexpected(s, s->at, "the \" that ends a text");
        }
        if (character < 0x20) {
            return report_unexpected(s, s->at,
                                     "the \" that ends a text (within a text a line break is \\n, a tab \\t)");
        }
        s->at++;
        if (character == '"') {
            return true;
        }
        if (character == '\\' && !scan_escape(s)) {
            return false;
        }
    }
}

/* Returns whether there was a digit. */
static bool skip_digits(scanner *s) {
    size_t first = s->at;
    while (is_digit(peek(s))) {
        s->at++;
    }
    return s->at > first;
}

/* Scans -? int frac? exp?. Returns false if it has another form, or if more characters of a word
 * follow. */
static bool scan_number_shape(scanner *s) {
    (void)accept(s, '-');
    bool right = accept(s, '0') || skip_digits(s);
    if (right && accept(s, '.')) {
        right = skip_digits(s);
    }
    if (right && (accept(s, 'e') || accept(s, 'E'))) {
        if (!accept(s, '+')) {
            (void)accept(s, '-');
        }
        right = skip_digits(s);
    }
    return right && !is_word(peek(s));
}

static bool scan_number(scanner *s) {
    size_t start = s->at;
    size_t length = word_length(s, start);
    char digits[TL_JSON_NUMBER_CHARS + 1];
    if (!scan_number_shape(s)) {
        return report_unexpected(s, start,
                                 "a number as JSON writes it (no leading zeros or +), for example 0.1 or -2e-3");
    }
    if (length > TL_JSON_NUMBER_CHARS) {
        return report_unexpected(s, start, "a number of at most 63 characters");
    }
    memcpy(digits, s->text + start, length);
    digits[length] = '\0';
    if (!isfinite(strtod(digits, NULL))) {
        return report_unexpected(s, start, "a number within ±1.7e308");
    }
    return true;
}

static bool scan_word(scanner *s) {
    static const char *const words[] = {"true", "false", "null"};
    size_t length = word_length(s, s->at);
    for (size_t i = 0; i < sizeof words / sizeof words[0]; i++) {
        if (length == strlen(words[i]) && memcmp(s->text + s->at, words[i], length) == 0) {
            s->at += length;
            return true;
        }
    }
    return report_unexpected(s, s->at,
                             "a JSON value: an object in {}, an array, a text in \", a number, true, false or null");
}

/* ---- objects and arrays ---- */

static bool scan_key(scanner *s) {
    skip_space(s);
    if (peek(s) != '"') {
        return report_unexpected(s, s->at, "a key in \", for example \"name\"");
    }
    if (!scan_string(s)) {
        return false;
    }
    skip_space(s);
    return accept(s, ':') || report_unexpected(s, s->at, "a : after the key");
}

/* Opens an object or array. Sets *ended if it is empty; else `at` is before its first value. */
static bool scan_opening(scanner *s, bool *ended) {
    char bracket = s->text[s->at];
    if (s->depth == TL_JSON_MAX_DEPTH) {
        return report_wrong(s, s->at, "a 33rd level of brackets", "at most 32");
    }
    s->open[s->depth++] = bracket;
    s->at++;
    skip_space(s);
    *ended = accept(s, bracket == '{' ? '}' : ']');
    if (*ended) {
        s->depth--;
        return true;
    }
    return bracket == '[' || scan_key(s);
}

/* Scans one value, or the start of an object or array. Sets *ended if the value is complete. */
static bool scan_value(scanner *s, bool *ended) {
    skip_space(s);
    s->lines->line[s->lines->count++] = s->line;
    int character = peek(s);
    *ended = true;
    if (character == '{' || character == '[') {
        return scan_opening(s, ended);
    }
    if (character == '"') {
        return scan_string(s);
    }
    if (character == '-' || is_digit(character)) {
        return scan_number(s);
    }
    return scan_word(s);
}

/* Reports a comma without a following entry, and a decimal comma, as in "a": 0,02. `comma` is an
 * offset. */
static bool check_comma(scanner *s, size_t comma) {
    char found[64];
    char expected[64];
    size_t start = comma;
    while (start > 0 && is_word((unsigned char)s->text[start - 1])) {
        start--;
    }
    if (s->open[s->depth - 1] == '{' && is_digit(s->text[comma - 1]) && is_digit(peek(s))) {
        int whole = comma - start < 20 ? (int)(comma - start) : 20;
        size_t digits = word_length(s, comma + 1);
        int fraction = digits < 20 ? (int)digits : 20;
        const char *after = s->text + comma + 1;
        (void)snprintf(found, sizeof found, "%.*s,%.*s", whole, s->text + start, fraction, after);
        (void)snprintf(expected, sizeof expected, "%.*s.%.*s (a decimal point)", whole, s->text + start, fraction,
                       after);
        return report_wrong(s, start, found, expected);
    }
    skip_space(s);
    if (peek(s) == '}' || peek(s) == ']') {
        (void)snprintf(found, sizeof found, "a comma before %c", (char)peek(s));
        return report_wrong(s, comma, found, "no comma there: JSON permits none");
    }
    return true;
}

/* After a complete value: closes all objects and arrays that end here, and scans the comma and key
 * before the next value. */
static bool scan_closing(scanner *s) {
    while (s->depth > 0) {
        bool object = s->open[s->depth - 1] == '{';
        skip_space(s);
        if (accept(s, ',')) {
            return check_comma(s, s->at - 1) && (!object || scan_key(s));
        }
        if (!accept(s, object ? '}' : ']')) {
            bool is_entry = peek(s) == '"';
            return report_unexpected(s, s->at,
                                     object ? (is_entry ? "a comma before it, or }" : "a , or }")
                                            : (is_entry ? "a comma before it, or ]" : "a , or ]"));
        }
        s->depth--;
    }
    return true;
}

static bool scan_document(scanner *s) {
    do {
        bool ended = false;
        if (!scan_value(s, &ended) || (ended && !scan_closing(s))) {
            return false;
        }
    } while (s->depth > 0);
    skip_space(s);
    return s->at == s->size || report_unexpected(s, s->at, "the end of the file (all brackets are closed)");
}

/* ---- the whole text ---- */

static bool check_encoding(scanner *s) {
    if (s->size >= 3 && memcmp(s->text, "\xEF\xBB\xBF", 3) == 0) {
        return report_wrong(s, 0, "a byte order mark", "UTF-8 without one: save the file as \"UTF-8 without BOM\"");
    }
    if (s->size >= 4 && memcmp(s->text, "PK\x03\x04", 4) == 0) {
        return report_wrong(s, 0, "PK, a zip file", "JSON; for an FMU, `twinlock init FMU` writes it");
    }
    for (size_t at = 0; at < s->size;) {
        uint32_t code = 0;
        size_t length = tl_utf8_read(s->text + at, s->size - at, &code);
        if (length == 0) {
            char found[64];
            (void)snprintf(found, sizeof found, "the byte 0x%02X, which is not UTF-8 here",
                           (unsigned)(unsigned char)s->text[at]);
            return report_wrong(s, at, found, "UTF-8: save the file in that encoding");
        }
        at += length;
    }
    return true;
}

tl_status tl_json_text_check(const char *text, size_t size, tl_arena *arena, tl_json_lines *lines, tl_error *error) {
    scanner s = {.text = text, .size = size, .line = 1, .lines = lines, .error = error};
    size_t most = 1; /* each value is the first, or follows a [ or , or : */
    for (size_t i = 0; i < size; i++) {
        most += text[i] == '[' || text[i] == ',' || text[i] == ':' ? 1 : 0;
    }
    lines->count = 0;
    lines->line = tl_arena_take(arena, most, sizeof *lines->line);
    if (lines->line == NULL) {
        return tl_fail(error, TL_TRY_AGAIN, "not enough memory to read %zu bytes of JSON", size);
    }
    return check_encoding(&s) && scan_document(&s) ? TL_OK : TL_BAD_DATA;
}

/* ---- json reader ---- */

static const double LIMIT = 9e15; /* below 2^53, so each integer is exact */

tl_json_reader tl_json_reader_of(const char *text, size_t size) {
    tl_json_reader reader = {NULL, false};
    tl_json_lines lines;
    tl_arena scratch;
    tl_error ignored;
    tl_arena_init(&scratch);
    if (tl_json_text_check(text, size, &scratch, &lines, &ignored) == TL_OK) {
        reader.root = cJSON_ParseWithLength(text, size);
        reader.right = cJSON_IsObject(reader.root) != 0;
    }
    tl_arena_release(&scratch);
    return reader;
}

tl_json_reader tl_json_file_read(const char *path) {
    enum { MOST_BYTES = 16 * 1024 };
    size_t size = 0;
    char *text = tl_file_text_take(open(path, O_RDONLY | O_CLOEXEC), MOST_BYTES, &size);
    tl_json_reader reader = text == NULL ? (tl_json_reader){NULL, false} : tl_json_reader_of(text, size);
    free(text);
    return reader;
}

bool tl_json_has(const tl_json_reader *reader, const char *key) {
    return cJSON_HasObjectItem(reader->root, key) != 0;
}

uint64_t tl_json_count(tl_json_reader *reader, const char *key) {
    const cJSON *item = cJSON_GetObjectItemCaseSensitive(reader->root, key);
    if (cJSON_IsNumber(item) && item->valuedouble >= 0.0 && item->valuedouble < LIMIT) {
        return (uint64_t)item->valuedouble;
    }
    reader->right = false;
    return 0;
}

double tl_json_number(tl_json_reader *reader, const char *key) {
    const cJSON *item = cJSON_GetObjectItemCaseSensitive(reader->root, key);
    reader->right = reader->right && cJSON_IsNumber(item) != 0;
    return cJSON_IsNumber(item) ? item->valuedouble : 0.0;
}

bool tl_json_truth(tl_json_reader *reader, const char *key) {
    const cJSON *item = cJSON_GetObjectItemCaseSensitive(reader->root, key);
    reader->right = reader->right && cJSON_IsBool(item) != 0;
    return cJSON_IsTrue(item) != 0;
}

const char *tl_json_text(tl_json_reader *reader, const char *key) {
    const cJSON *item = cJSON_GetObjectItemCaseSensitive(reader->root, key);
    if (cJSON_IsString(item)) {
        return item->valuestring;
    }
    reader->right = false;
    return "";
}

void tl_json_reader_free(tl_json_reader *reader) {
    cJSON_Delete(reader->root);
    *reader = (tl_json_reader){NULL, false};
}

/* ---- json writer ---- */

void tl_json_writer_begin(tl_json_writer *writer) {
    *writer = (tl_json_writer){.open = {cJSON_CreateObject()}, .depth = 1};
    writer->failed = writer->open[0] == NULL;
}

/* Adds an item. Returns NULL if memory is out for it or its key. */
static cJSON *add(tl_json_writer *writer, const char *key, cJSON *item) {
    cJSON *around = writer->open[writer->depth - 1];
    bool added = item != NULL &&
                 (key == NULL ? cJSON_AddItemToArray(around, item) : cJSON_AddItemToObject(around, key, item)) != 0;
    if (!added) {
        cJSON_Delete(item);
        writer->failed = true;
    }
    return added ? item : NULL;
}

void tl_json_add_truth(tl_json_writer *writer, const char *key, bool truth) {
    (void)add(writer, key, cJSON_CreateBool(truth));
}

/* cJSON writes null for a number that is not finite. */
void tl_json_add_number(tl_json_writer *writer, const char *key, double number) {
    (void)add(writer, key, cJSON_CreateNumber(number));
}

void tl_json_add_count(tl_json_writer *writer, const char *key, uint64_t count) {
    tl_json_add_number(writer, key, (double)count);
}

void tl_json_add_text(tl_json_writer *writer, const char *key, const char *text) {
    (void)add(writer, key, text == NULL ? cJSON_CreateNull() : cJSON_CreateString(text));
}

void tl_json_add_members(tl_json_writer *writer, const char *text) {
    cJSON *object = cJSON_Parse(text);
    writer->failed = writer->failed || !cJSON_IsObject(object);
    while (cJSON_IsObject(object) && object->child != NULL) {
        cJSON *member = cJSON_DetachItemViaPointer(object, object->child);
        (void)add(writer, member->string, member);
    }
    cJSON_Delete(object);
}

static void open_item(tl_json_writer *writer, const char *key, cJSON *item) {
    assert(writer->depth < TL_JSON_WRITER_DEPTH);
    writer->open[writer->depth] = add(writer, key, item);
    writer->depth++;
}

void tl_json_open_object(tl_json_writer *writer, const char *key) {
    open_item(writer, key, cJSON_CreateObject());
}

void tl_json_open_array(tl_json_writer *writer, const char *key) {
    open_item(writer, key, cJSON_CreateArray());
}

void tl_json_close(tl_json_writer *writer) {
    assert(writer->depth > 1);
    writer->depth--;
}

tl_status tl_json_writer_print(const tl_json_writer *writer, FILE *file, tl_error *error) {
    char *text = writer->failed ? NULL : cJSON_Print(writer->open[0]);
    if (text == NULL) {
        return tl_fail(error, TL_TRY_AGAIN, "not enough memory to write JSON; free memory and try again");
    }
    (void)fprintf(file, "%s\n", text);
    cJSON_free(text);
    return TL_OK;
}

tl_status tl_json_file_write(const tl_json_writer *writer, const char *path, tl_error *error) {
    tl_new_file file;
    tl_status status = tl_new_file_open(path, &file, error);
    if (status != TL_OK) {
        return status;
    }
    status = tl_json_writer_print(writer, file.file, error);
    if (status != TL_OK) {
        tl_new_file_discard(&file);
        return status;
    }
    return tl_new_file_keep(&file, error);
}

/* cJSON_PrintPreallocated() needs a few bytes more than it writes. */
size_t tl_json_writer_line(const tl_json_writer *writer, char *line, size_t room) {
    bool fits = !writer->failed && room <= INT_MAX && cJSON_PrintPreallocated(writer->open[0], line, (int)room, 0) != 0;
    return fits ? strlen(line) : 0;
}

void tl_json_writer_free(tl_json_writer *writer) {
    cJSON_Delete(writer->open[0]);
    *writer = (tl_json_writer){.depth = 0};
}
