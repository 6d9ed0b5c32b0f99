/* provisional */
#ifndef TL_FIRMWARE_PROCESS_RELAY_H
#define TL_FIRMWARE_PROCESS_RELAY_H
#include <stdbool.h>
#include <stddef.h>
typedef void tl_relay_line(void *context, const char *line);
typedef struct tl_relay { int descriptor; tl_relay_line *pass; void *context; size_t length; char line[4096]; } tl_relay;
void tl_relay_open(tl_relay *relay, int descriptor, tl_relay_line *pass, void *context);
bool tl_relay_drain(tl_relay *relay);
void tl_relay_close(tl_relay *relay);
#endif
