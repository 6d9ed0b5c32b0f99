/* The schema of a twinlock database.
 *
 * Purpose: what the file is made with, recognised by and held against. config/SPEC.md, "Database", says what everything means.
 * Thread:  constants.
 */
#ifndef TL_FIRMWARE_STORE_DATABASE_SCHEMA_H
#define TL_FIRMWARE_STORE_DATABASE_SCHEMA_H

enum {
    TL_DATABASE_APPLICATION = 0x74776C6B, /* "twlk" */
    TL_DATABASE_VERSION = 5               /* the format; no other is read */
};

/* The schema: one statement each for tables, indices and views, then NULL. */
extern const char *const tl_database_schema[];

/* The columns of the primary key of each table that is read in its order, ", " between them; then NULL. */
typedef struct tl_database_key {
    const char *table;
    const char *columns;
} tl_database_key;
extern const tl_database_key tl_database_keys[];

#endif
