/* The C locale for a thread of ours: see c_locale.h. */
#include "firmware/base/c_locale.h"

#include <locale.h>
#include <pthread.h>

static pthread_once_t once = PTHREAD_ONCE_INIT;
static locale_t ours;

/* "C" itself is a constant of the C library: that cannot fail, and freeing it does nothing. */
static void make(void) {
    locale_t plain = newlocale(LC_ALL_MASK, "C", (locale_t)0);
    locale_t with_utf8 = newlocale(LC_CTYPE_MASK, "C.UTF-8", plain);
    ours = with_utf8 != (locale_t)0 ? with_utf8 : plain;
}

void tl_locale_use(void) {
    (void)pthread_once(&once, make);
    (void)uselocale(ours);
}
