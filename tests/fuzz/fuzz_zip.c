/* Fuzzes the ZIP archive of an FMU: unpacks it, and removes all unpacked files. */
#include <dirent.h>
#include <stdlib.h>
#include <string.h>

#include "firmware/fmu/fmu_archive.h"
#include "tests/fuzz/harness.h"

/* Returns the number of entries of a folder, to check that only the unpacked folder is added. */
static int count_entries(const char *folder) {
    int count = -2; /* . and .. */
    DIR *entries = opendir(folder);
    if (entries == NULL) {
        abort();
    }
    while (readdir(entries) != NULL) {
        count++;
    }
    (void)closedir(entries);
    return count;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    tl_private_folder folder;
    tl_error error = {TL_OK, ""};
    int before = count_entries(tl_fuzz_folder());
    tl_status status = tl_fmu_archive_unpack(tl_fuzz_file(data, size), -1, "input.fmu", &folder, &error);
    if (status != TL_OK && error.text[0] == '\0') {
        abort();
    }
    if (count_entries(tl_fuzz_folder()) != before + (status == TL_OK ? 1 : 0)) {
        abort();
    }
    if (status == TL_OK) {
        tl_private_folder_remove(&folder);
    }
    if (count_entries(tl_fuzz_folder()) != before) {
        abort();
    }
    return 0;
}
