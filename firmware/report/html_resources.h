/* Parts of a report page that the build embeds: files of firmware/report/ and the plotting library.
 *
 * Purpose: no file is needed at run time. firmware/report/embed.cmake generates the definitions.
 * Thread:  constants.
 */
#ifndef TL_FIRMWARE_REPORT_HTML_RESOURCES_H
#define TL_FIRMWARE_REPORT_HTML_RESOURCES_H

#include <stddef.h>

typedef struct tl_html_resource {
    const unsigned char *bytes;
    size_t size;
} tl_html_resource;

extern const tl_html_resource tl_html_frame;         /* report/page.html: {{name}} is replaced by a part of the page */
extern const tl_html_resource tl_html_style;         /* report/page.css */
extern const tl_html_resource tl_html_script;        /* report/page.js */
extern const tl_html_resource tl_html_library;       /* dygraphs */
extern const tl_html_resource tl_html_library_style; /* of dygraphs */
extern const tl_html_resource tl_html_licence;       /* of dygraphs */

#endif
