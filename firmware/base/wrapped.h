/* Paragraphs for a terminal.
 *
 * Purpose: what is told in sentences, broken between words at 79 columns.
 * Thread:  the writer's.
 */
#ifndef TL_FIRMWARE_BASE_WRAPPED_H
#define TL_FIRMWARE_BASE_WRAPPED_H

#include <stdio.h>

/* A paragraph and a new line: behind `first` blanks its first line, and behind `indent` all others. */
void tl_wrapped_print(FILE *file, const char *text, int first, int indent);

#endif
