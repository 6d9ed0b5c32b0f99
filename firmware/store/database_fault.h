/* What keeps a database from being opened or written, as a kind: who writes one does something else about each.
 *
 * Use:    as errno: every failure of this room sets it for its thread, and it means something only right after one.
 * Thread: any; each has its own.
 */
#ifndef TL_FIRMWARE_STORE_DATABASE_FAULT_H
#define TL_FIRMWARE_STORE_DATABASE_FAULT_H

#include "master/base/status.h"

typedef enum tl_database_fault {
    TL_DATABASE_LATER,   /* locked, no room, no memory: another time it may work */
    TL_DATABASE_TAKEN,   /* another twinlock writes it */
    TL_DATABASE_DENIED,  /* it, or what it is on, may not be read or not be written */
    TL_DATABASE_DAMAGED, /* it is ours, and its pages are not what they were */
    TL_DATABASE_OTHER,   /* another version of twinlock wrote it, in another format */
    TL_DATABASE_FOREIGN  /* it is not ours, or somebody has worked on it, or somebody's file is in its way */
} tl_database_fault;

tl_database_fault tl_database_get_fault(void);
void tl_database_set_fault(tl_database_fault fault);

/* By SQLite's result code and, if there is one, errno. */
tl_database_fault tl_database_fault_of(int code, int number);

/* The same of errno alone. */
tl_database_fault tl_database_fault_of_errno(int number);

/* Sets the fault, then as tl_fail(). */
tl_status tl_database_refuse(tl_database_fault fault, tl_error *error, tl_status status, const char *format, ...)
    TL_PRINTF(4, 5);

#endif
