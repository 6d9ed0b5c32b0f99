/* A file that is not there, but is with other letters' case.
 *
 * Purpose: who comes from a system that takes Config.json and config.json for one file is told which of them is there.
 * Thread:  any; reads a folder, so not the cycle's.
 */
#ifndef TL_FIRMWARE_BASE_OTHER_CASE_H
#define TL_FIRMWARE_BASE_OTHER_CASE_H

enum { TL_OTHER_CASE_TEXT = 320 };

/* The end of a sentence that says that `path` cannot be opened: "; there is Config.json beside it, with other letters' case". Empty if
 * the file is there, or none that differs only so. ASCII letters count. Returns `text`. */
const char *tl_other_case(const char *path, char text[TL_OTHER_CASE_TEXT]);

#endif
