/* Status codes and error texts. The only file of the master that formats text. */
#include "master/base/status.h"

#include <stdarg.h>
#include <stdio.h>

tl_status tl_fail(tl_error *error, tl_status status, const char *format, ...) {
    if (error != NULL) {
        va_list arguments;
        va_start(arguments, format);
        error->status = status;
        (void)vsnprintf(error->text, sizeof error->text, format, arguments);
        va_end(arguments);
    }
    return status;
}

void tl_report_add(tl_report *report, tl_status status, const char *where, const char *format, ...) {
    char text[TL_ERROR_TEXT];
    va_list arguments;
    va_start(arguments, format);
    (void)vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    if (report->count == 0) {
        report->first_status = status;
    }
    report->count++;
    if (report->add != NULL) {
        report->add(report->context, status, where != NULL ? where : "", text);
    }
}

int tl_exit_code(tl_status status) {
    switch (status) {
    case TL_OK:
        return 0;
    case TL_BAD_USAGE:
        return 2;
    case TL_NOT_LOCKED:
        return 3;
    case TL_BAD_DATA:
        return 65;
    case TL_PLANT_DOWN:
        return 69;
    case TL_FMU_FAILED:
    case TL_FMU_FATAL:
        return 70;
    case TL_TRY_AGAIN:
    case TL_INTERRUPTED:
        return 75;
    }
    return 75;
}
