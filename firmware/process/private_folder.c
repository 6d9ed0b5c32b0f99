/* provisional */
#include "firmware/process/private_folder.h"
#include <ftw.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
tl_status tl_private_folder_make(const char *kind, uint32_t user, tl_private_folder *folder, tl_error *error) {
    const char *t = getenv("TMPDIR");
    (void)snprintf(folder->path, sizeof folder->path, "%s/twinlock-%s-%d-XXXXXX", t ? t : "/tmp", kind, (int)getpid());
    if (mkdtemp(folder->path) == NULL) return tl_fail(error, TL_TRY_AGAIN, "no private folder");
    folder->user = user;
    if (user != 0 && chown(folder->path, user, user) != 0) folder->user = 0;
    return TL_OK;
}
static int rm(const char *p, const struct stat *s, int t, struct FTW *w) { (void)s; (void)t; (void)w; (void)remove(p); return 0; }
void tl_private_folder_remove(tl_private_folder *folder) {
    if (folder->path[0]) (void)nftw(folder->path, rm, 16, FTW_DEPTH | FTW_PHYS);
    folder->path[0] = '\0';
}
