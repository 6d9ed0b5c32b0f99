/* Names of plants and of tokens.
 *
 * Purpose: a plant's name is that of a folder, and a stranger may say any: only what cannot lead elsewhere is one.
 * Thread:  pure.
 */
#ifndef TL_FIRMWARE_SERVE_PLAIN_NAME_H
#define TL_FIRMWARE_SERVE_PLAIN_NAME_H

#include <stdbool.h>

/* Letters, digits, "-", "_" and ".", of which the last does not come first; at most TL_CONTROL_NAME - 1. */
bool tl_plain_name(const char *name);

#endif
