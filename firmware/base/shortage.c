/* Whether something ran out: see shortage.h. */
#include "firmware/base/shortage.h"

#include <errno.h>
#include <stddef.h>
#include <string.h>

static const int codes[] = {EMFILE, ENFILE, ENOMEM, ENOSPC, EDQUOT};

enum { CODES = sizeof codes / sizeof codes[0] };

bool tl_shortage_is(int code) {
    for (size_t i = 0; i < CODES; i++) {
        if (code == codes[i]) {
            return true;
        }
    }
    return false;
}

bool tl_shortage_is_told(const char *sentence) {
    for (size_t i = 0; i < CODES; i++) {
        if (strstr(sentence, strerror(codes[i])) != NULL) {
            return true;
        }
    }
    return false;
}
