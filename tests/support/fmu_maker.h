/* Makes broken and hostile FMUs: copies a good FMU, changes its entries, and writes a ZIP file.
 *
 * Purpose: tests make such FMUs from a good one that the build made.
 * Errors:  a false or NULL result means that the test itself is wrong, or that the machine lacks
 *          memory or disk.
 * Thread:  one thread at a time for each maker.
 */
#ifndef TL_TESTS_SUPPORT_FMU_MAKER_H
#define TL_TESTS_SUPPORT_FMU_MAKER_H

#include <stdbool.h>
#include <stddef.h>

typedef struct tl_fmu_maker tl_fmu_maker;

/* Returns a maker with all entries of the FMU at `path`, except binaries for other machines. `path`
 * NULL: without entries. Returns NULL if the file cannot be read. */
tl_fmu_maker *tl_fmu_maker_new(const char *path);
void tl_fmu_maker_free(tl_fmu_maker *maker);

/* Adds an entry, or replaces the content of an existing one. The bytes are copied; NULL stands for
 * `size` zeros. Any name is allowed. */
bool tl_fmu_maker_put(tl_fmu_maker *maker, const char *name, const void *bytes, size_t size);
bool tl_fmu_maker_put_text(tl_fmu_maker *maker, const char *name, const char *text);

bool tl_fmu_maker_remove(tl_fmu_maker *maker, const char *name);
bool tl_fmu_maker_rename(tl_fmu_maker *maker, const char *from, const char *to);

/* Sets Unix mode and kind of file, for example S_IFLNK | 0777. Default: S_IFREG | 0644. */
bool tl_fmu_maker_set_mode(tl_fmu_maker *maker, const char *name, unsigned mode);

/* Encrypts the entry with traditional ZIP encryption. */
bool tl_fmu_maker_encrypt(tl_fmu_maker *maker, const char *name);

/* Compresses the entry with bzip2 instead of deflate. */
bool tl_fmu_maker_use_bzip2(tl_fmu_maker *maker, const char *name);

/* Returns the name of the first entry whose name ends with `ending`, or NULL. */
const char *tl_fmu_maker_find(const tl_fmu_maker *maker, const char *ending);

/* Returns the content of an entry, which may be changed in place. NULL: there is no such entry. */
unsigned char *tl_fmu_maker_content(tl_fmu_maker *maker, const char *name, size_t *size);

/* Replaces text in a text entry wherever it occurs. Returns false if it does not occur. */
bool tl_fmu_maker_replace(tl_fmu_maker *maker, const char *name, const char *from, const char *to);

/* Overwrites the `size` bytes of `from` by those of `to` wherever they occur in an entry. Returns
 * false if they do not occur. */
bool tl_fmu_maker_patch(tl_fmu_maker *maker, const char *name, const void *from, const void *to, size_t size);

bool tl_fmu_maker_write(const tl_fmu_maker *maker, const char *path);

/* As tl_fmu_maker_patch(), in a written file: for content that libzip refuses to write, for example
 * two entries with the same name. */
bool tl_fmu_maker_patch_file(const char *path, const void *from, const void *to, size_t size);

/* Keeps the first `size` bytes of a file. */
bool tl_fmu_maker_cut_file(const char *path, size_t size);

#endif
