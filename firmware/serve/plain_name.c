/* Names: see plain_name.h. */
#include "firmware/serve/plain_name.h"

#include <stddef.h>
#include <string.h>

#include "firmware/retune/control_wire.h"

bool tl_plain_name(const char *name) {
    static const char letters[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789-_.";
    size_t length = strlen(name);
    return length > 0 && length < TL_CONTROL_NAME && name[0] != '.' && strspn(name, letters) == length;
}
