/* Text on an HTML page: names and numbers that came from outside, written so that they can be nothing but text.
 *
 * Purpose: names of configurations, signals and units, and whatever a database holds, may have any character.
 * Source:  HTML Living Standard, "Parsing" and "Restrictions for contents of script elements"; RFC 8259 for JSON.
 * Thread:  the stream belongs to one thread.
 */
#ifndef TL_FIRMWARE_REPORT_HTML_TEXT_H
#define TL_FIRMWARE_REPORT_HTML_TEXT_H

#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

/* As content of an element, or of an attribute in double quotes. White space becomes blanks, and what cannot be shown what clean_text.h says; so it
 * does in a string. */
void tl_html_put_text(FILE *file, const char *text);

/* As a JSON string, quotes included, that may stand in a script element: no "<", ">" or "&" is left in it. */
void tl_html_put_string(FILE *file, const char *text);

/* As a JSON number with nine digits, enough for a plot; null where it is not finite. */
void tl_html_put_number(FILE *file, double value);

/* A count with its digits in groups of three: "1 234 567", by narrow spaces that do not break. */
void tl_html_put_count(FILE *file, uint64_t count);

/* The digest of a script as a Content-Security-Policy names it: "sha256-" and base64. */
enum { TL_HTML_DIGEST = 52 };
void tl_html_digest(const void *data, size_t size, char text[TL_HTML_DIGEST]);

#endif
