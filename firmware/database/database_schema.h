/* The schema of a twinlock database, and how an older one is brought up to it.
 *
 * Purpose: what the file is made with, recognised by and held against. config/SPEC.md, "Database", says what everything means.
 * Thread:  constants.
 */
#ifndef TL_FIRMWARE_DATABASE_DATABASE_SCHEMA_H
#define TL_FIRMWARE_DATABASE_DATABASE_SCHEMA_H

enum {
    TL_DATABASE_APPLICATION = 0x74776C6B, /* "twlk" */
    TL_DATABASE_VERSION = 5
};

/* The schema: one statement each for tables, indices and views, then NULL. */
extern const char *const tl_database_schema[];

/* The columns of the primary key of each table that is read in its order, ", " between them; then NULL. */
typedef struct tl_database_key {
    const char *table;
    const char *columns;
} tl_database_key;
extern const tl_database_key tl_database_keys[];

/* By format (there is none of format 0): it made the next one, and it read as if it were the newest (by views in the connection's own memory); the
 * same file. */
extern const char *const *const tl_database_upgrades[];
extern const char *const *const tl_database_bridges[];

#endif
