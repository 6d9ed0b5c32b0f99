/* Makes FMUs that no exporter would: a good one is copied, changed entry by entry, and written as a ZIP file.
 *
 * Purpose: hostile and broken FMUs for tests, made at test time from one that the build made.
 * Errors:  a false or NULL result means that the test itself is wrong, or that the machine lacks memory or disk.
 * Thread:  one thread at a time for each maker.
 */
#ifndef TL_TESTS_SUPPORT_FMU_MAKER_H
#define TL_TESTS_SUPPORT_FMU_MAKER_H

#include <stdbool.h>
#include <stddef.h>

typedef struct tl_fmu_maker tl_fmu_maker;

/* With all entries of the FMU at `path` but its binaries for other machines, or without any where `path` is NULL. NULL where that cannot be read. */
tl_fmu_maker *tl_fmu_maker_new(const char *path);
void tl_fmu_maker_free(tl_fmu_maker *maker);

/* Adds an entry, or gives an existing one new content. The bytes are copied; NULL stands for `size` zeros. Any name is
 * allowed. */
bool tl_fmu_maker_put(tl_fmu_maker *maker, const char *name, const void *bytes, size_t size);
bool tl_fmu_maker_put_text(tl_fmu_maker *maker, const char *name, const char *text);

bool tl_fmu_maker_remove(tl_fmu_maker *maker, const char *name);
bool tl_fmu_maker_rename(tl_fmu_maker *maker, const char *from, const char *to);

/* Unix mode with the kind of file, e.g. S_IFLNK | 0777; default S_IFREG | 0644. */
bool tl_fmu_maker_set_mode(tl_fmu_maker *maker, const char *name, unsigned mode);

/* Traditional ZIP encryption. */
bool tl_fmu_maker_encrypt(tl_fmu_maker *maker, const char *name);

/* bzip2 instead of deflate. */
bool tl_fmu_maker_use_bzip2(tl_fmu_maker *maker, const char *name);

/* The name of the first entry that ends so, or NULL. */
const char *tl_fmu_maker_find(const tl_fmu_maker *maker, const char *ending);

/* An entry's content, which may be changed in place. NULL where there is none. */
unsigned char *tl_fmu_maker_content(tl_fmu_maker *maker, const char *name, size_t *size);

/* Replaces text in a text entry wherever it occurs. false where it does not. */
bool tl_fmu_maker_replace(tl_fmu_maker *maker, const char *name, const char *from, const char *to);

/* Overwrites bytes, of the same number, wherever they occur in an entry. false where they do not. */
bool tl_fmu_maker_patch(tl_fmu_maker *maker, const char *name, const void *from, const void *to, size_t size);

bool tl_fmu_maker_write(const tl_fmu_maker *maker, const char *path);

/* The same for a file that is written: what libzip itself refuses to write, such as a name twice. */
bool tl_fmu_maker_patch_file(const char *path, const void *from, const void *to, size_t size);

/* Keeps the first `size` bytes of a file. */
bool tl_fmu_maker_cut_file(const char *path, size_t size);

#endif
