/* Parts of a report page that the build embeds: files of firmware/report/page/ and the plotting
 * library dygraphs.
 *
 * Purpose: the program needs no file at run time. firmware/report/embed.cmake generates the
 *          definitions.
 * Thread:  constants.
 */
#ifndef TL_FIRMWARE_REPORT_HTML_RESOURCES_H
#define TL_FIRMWARE_REPORT_HTML_RESOURCES_H

#include <stddef.h>

typedef struct tl_html_resource {
    const unsigned char *bytes;
    size_t size;
} tl_html_resource;

extern const tl_html_resource tl_html_frame;         /* page/page.html; a part replaces each {{NAME}} */
extern const tl_html_resource tl_html_style;         /* page/page.css */
extern const tl_html_resource tl_html_script;        /* page/page.js */
extern const tl_html_resource tl_html_library;       /* dygraphs, JavaScript */
extern const tl_html_resource tl_html_library_style; /* CSS of dygraphs */
extern const tl_html_resource tl_html_licence;       /* licence of dygraphs */

#endif
